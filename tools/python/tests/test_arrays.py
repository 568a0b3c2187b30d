"""Tests arrays of every valid order and kind, and the errors for invalid arguments."""

import eyebox
import numpy as np
import pytest
from conftest import coded, light_field, named

VIEWS = light_field(2, 3, 3)


class Exported:
    """An array of another library with DLPack."""

    def __init__(self, array, fails=None):
        self.array, self.fails = array, fails

    def __dlpack__(self, **options):
        if self.fails:
            raise self.fails
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


def scene(source, display, color="green", **options):
    return eyebox.Scene(source, display, color, **options)


@pytest.mark.parametrize(
    "same",
    [
        VIEWS,
        VIEWS.astype(np.float64),
        np.asfortranarray(VIEWS),
        np.ascontiguousarray(VIEWS[..., ::-1])[..., ::-1],
        np.moveaxis(np.ascontiguousarray(np.moveaxis(VIEWS, 3, 0)), 0, 3),
        VIEWS.astype(VIEWS.dtype.newbyteorder()),
        VIEWS.tolist(),
        Exported(VIEWS),
        np.repeat(VIEWS, 2, axis=3)[..., ::2],
        VIEWS[..., None],
    ],
    ids=["float32", "float64", "fortran", "reversed", "moved", "byte order", "lists", "dlpack", "strided", "one colour"],
)
def test_order_and_kind_do_not_matter(display, same):
    np.testing.assert_array_equal(scene(same, display).views, VIEWS[..., None])


def test_read_only_and_views_of_one_place(display):
    fixed = VIEWS.copy()
    fixed.setflags(write=False)
    assert scene(fixed, display).shape == (2, 3, 40, 48, 1)
    assert scene(VIEWS[0, 0], display).shape == (1, 1, 40, 48, 1)
    assert scene(np.zeros((40, 48, 3)), display, None).shape == (1, 1, 40, 48, len(display.wavelengths))
    # Views of another size are scaled to fit whole.
    assert scene(VIEWS[..., ::2, ::2], display).shape == (2, 3, 40, 48, 1)


def test_colours_are_last_and_integers_are_srgb(display):
    paper = eyebox.Display("paper", size=(40, 48))
    light = light_field(2, 2, 4, 3)
    both = eyebox.Scene(light, paper, ["blue", "red"])
    np.testing.assert_array_equal(both.views, light[..., [2, 0]])
    assert both.colors == ["blue", "red"] and eyebox.Scene(VIEWS, paper).shape[-1] == 3
    for dtype, top in ((np.uint8, 255), (np.uint16, 65535)):
        levels = np.full((40, 48), round(0.5 * top), dtype)
        seen = scene(levels, display).views
        assert abs(seen.mean() - 0.2140) < 2e-3 and scene(levels * 0 + dtype(top), display).views.max() == 1


def test_half_floats(display):
    half = VIEWS.astype(np.float16)
    np.testing.assert_array_equal(scene(half, display).views[..., 0], half.astype(np.float32))


def test_pytorch(display):
    torch = pytest.importorskip("torch")
    tensor = torch.from_numpy(VIEWS.copy())
    np.testing.assert_array_equal(scene(tensor, display).views[..., 0], VIEWS)
    phases = torch.zeros(1, 40, 48, requires_grad=True)
    with named(TypeError, "phases", "detach"):
        eyebox.Hologram.from_phases(phases, display, "green")
    assert eyebox.Hologram.from_phases(phases.detach(), display, "green").frames == 1


def test_jax(display):
    numpy = pytest.importorskip("jax.numpy")
    np.testing.assert_array_equal(scene(numpy.asarray(VIEWS), display).views[..., 0], VIEWS)
    phases = numpy.zeros((1, 40, 48))
    assert eyebox.Hologram.from_phases(phases, display, "green").phases["green"].shape == (1, 40, 48)


def place(value):
    views = VIEWS.copy()
    views[1, 2, 5, 7] = value
    return views


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (place(np.nan), "NaN green 5 7"),
        (place(-0.5), "-0.5 green 5 7"),
        (np.full((40, 48), 1e300), "inf green"),
        (np.zeros((2, 3, 4, 5, 6)), "scene (2, 3, 4, 5, 6)"),
        (np.zeros((2, 0, 4, 5)), "scene (2, 0, 4, 5)"),
        (np.zeros(7), "scene (7,)"),
        (np.float32(3), "scene"),
        (np.zeros((65, 1, 2, 2)), "65 1 64"),
        (np.zeros((4, 4), complex), "scene complex128"),
        (np.zeros((4, 4), int), "scene int64"),
        (np.array([["a"]]), "scene <U1"),
        (np.array([[object()]]), "scene object"),
        ([[1.0], [1.0, 2.0]], "scene"),
        (Exported(VIEWS, BufferError("it is on a GPU")), "scene it is on a GPU"),
        (None, "scene None"),
        (7, "scene 7"),
        ("builtin:nothing", "nothing"),
        ("/dev/null", "/dev/null"),
    ],
)
def test_what_makes_no_sense_is_named(display, wrong, says):
    with named((ValueError, TypeError), *says.split()):
        scene(wrong, display)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (np.zeros((1, 40, 47)), "phases green (1, 40, 47) 48"),
        (np.zeros((40, 48), int), "phases int64"),
        (np.full((40, 48), np.inf), "phases green inf 0"),
        ({"green": np.zeros((40, 48)), "infrared": np.zeros((40, 48))}, "infrared"),
        ({}, "phases"),
    ],
)
def test_phases_that_make_no_sense(display, wrong, says):
    with named((ValueError, TypeError), *says.split()):
        eyebox.Hologram.from_phases(wrong, display, None if isinstance(wrong, dict) else "green")


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda d: eyebox.solve("builtin:plane", d, stpes=3), "stpes frames"),
        (lambda d: eyebox.solve("builtin:plane", d, steps="many"), "steps"),
        (lambda d: eyebox.solve("builtin:plane", d, psnr=float("nan")), "psnr"),
        (lambda d: eyebox.solve("builtin:plane", d, frames=0), "0"),
        (lambda d: eyebox.solve("builtin:plane", d, levels=object()), "levels <object"),
        (lambda d: eyebox.solve("builtin:plane", d, color="pink"), "color pink red green blue"),
        (lambda d: eyebox.solve("builtin:plane", d, callback=3), "callback 3"),
        (lambda d: eyebox.solve("builtin:plane", d, progress=3), "progress 3"),
        (lambda d: eyebox.solve("builtin:plane", d, engine="gpu"), "engine gpu auto cpu vulkan"),
        (lambda d: eyebox.solve("builtin:plane", 3), "display 3"),
        (lambda d: eyebox.Display("nowhere.toml"), "nowhere.toml"),
        (lambda d: eyebox.Display("small", pitch=8), "pitch"),
        (lambda d: eyebox.Display("small", size=(0, 8)), "size[0] 0"),
        (lambda d: eyebox.Display("small", size=8), "size 8"),
        (lambda d: eyebox.Display(), "Display"),
        (lambda d: eyebox.Hologram.load("nowhere.zarr"), "nowhere.zarr"),
        (lambda d: eyebox.Hologram.load(3), "path 3"),
        (lambda d: eyebox.Hologram(), "eyebox.solve"),
    ],
)
def test_arguments_that_make_no_sense(display, call, says):
    with named((ValueError, TypeError), *says.split()):
        call(display)


@pytest.mark.parametrize(
    ("pupil", "says"),
    [
        ({"x": "left"}, "x 'left'"),
        ({"x": float("nan")}, ""),
        ({"x": 1.0}, "mm"),
        ({"diameter": 4}, "4 mm"),
        ({"depth": 1e9}, "depth"),
    ],
)
def test_pupils_that_make_no_sense(hologram, pupil, says):
    with named((ValueError, TypeError), *says.split()):
        hologram.view(**pupil)


def test_views_that_are_no_neighbors_are_refused_unless_a_grid_is_stated(display):
    light = np.random.default_rng(3).random((3, 3, 40, 48), dtype=np.float32)
    with coded(eyebox.SceneError, "scene/cameras"):
        scene(light, display)
    assert scene(light, display, order="as-named").shape == (3, 3, 40, 48, 1)
    with coded(eyebox.SceneError, "scene/order/moves-otherwise"):
        scene(VIEWS[::-1], display)
    assert (scene(VIEWS[::-1], display, order="flip-rows").views == scene(VIEWS, display).views).all()
    with named(ValueError, "as-named"):
        scene(VIEWS, display, order="backwards")
