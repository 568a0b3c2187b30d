"""Arrays of any order and kind that makes sense, and sentences for those that make none."""

import eyebox
import numpy as np
import pytest
from conftest import coded, light_field

VIEWS = light_field(2, 3, 3)


class Exported:
    """Something of another library's that speaks DLPack."""

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
    # Another size is scaled to fit whole.
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
    with pytest.raises(TypeError, match="phases is .*grad"):
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
        (place(np.nan), "NaN in green, view 5, row 5, column 7.*finite and not negative"),
        (place(-0.5), "-0.5 in green, view 5, row 5, column 7"),
        (np.full((40, 48), 1e300), "inf in green"),
        (np.zeros((2, 3, 4, 5, 6)), r"scene has the shape \(2, 3, 4, 5, 6\): it must be \(view row"),
        (np.zeros((2, 0, 4, 5)), r"scene has the shape \(2, 0, 4, 5\)"),
        (np.zeros(7), r"scene has the shape \(7,\)"),
        (np.float32(3), "scene has the shape|scene is"),
        (np.zeros((65, 1, 2, 2)), "65 x 1.*1 to 64"),
        (np.zeros((4, 4), complex), "scene has the dtype complex128"),
        (np.zeros((4, 4), int), "scene has the dtype int64"),
        (np.array([["a"]]), "scene has the dtype <U1"),
        (np.array([[object()]]), "scene has the dtype object"),
        ([[1.0], [1.0, 2.0]], "scene is .*NumPy makes no array"),
        (Exported(VIEWS, BufferError("it is on a GPU")), "scene is .*it is on a GPU"),
        (None, "scene is None"),
        (7, "scene is 7"),
        ("builtin:nothing", "nothing"),
        ("/dev/null", "/dev/null"),
    ],
)
def test_what_makes_no_sense_is_named(display, wrong, says):
    with pytest.raises((ValueError, TypeError), match=says):
        scene(wrong, display)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (np.zeros((1, 40, 47)), r"phases of green has the shape \(1, 40, 47\): it must be \(sub-frame, 40, 48\)"),
        (np.zeros((40, 48), int), "phases has the dtype int64: .*radians"),
        (np.full((40, 48), np.inf), "phases of green is inf at sub-frame 0, row 0, column 0: it must be finite"),
        ({"green": np.zeros((40, 48)), "infrared": np.zeros((40, 48))}, "infrared"),
        ({}, "dict of phases"),
    ],
)
def test_phases_that_make_no_sense(display, wrong, says):
    with pytest.raises((ValueError, TypeError), match=says):
        eyebox.Hologram.from_phases(wrong, display, None if isinstance(wrong, dict) else "green")


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda d: eyebox.solve("builtin:plane", d, stpes=3), "stpes: no such setting: there are frames"),
        (lambda d: eyebox.solve("builtin:plane", d, steps="many"), "steps: invalid type"),
        (lambda d: eyebox.solve("builtin:plane", d, psnr=float("nan")), "psnr: every number must be finite"),
        (lambda d: eyebox.solve("builtin:plane", d, frames=0), "number of sub-frames is 0"),
        (lambda d: eyebox.solve("builtin:plane", d, levels=object()), "levels is <object"),
        (lambda d: eyebox.solve("builtin:plane", d, color="pink"), "color is \"pink\": it must be red, green or blue"),
        (lambda d: eyebox.solve("builtin:plane", d, callback=3), "callback is 3"),
        (lambda d: eyebox.solve("builtin:plane", d, progress=3), "progress is 3"),
        (lambda d: eyebox.solve("builtin:plane", d, engine="gpu"), "engine is \"gpu\": it must be auto, cpu or vulkan"),
        (lambda d: eyebox.solve("builtin:plane", 3), "display is 3"),
        (lambda d: eyebox.Display("nowhere.toml"), "nowhere.toml"),
        (lambda d: eyebox.Display("small", pitch=8), "pitch"),
        (lambda d: eyebox.Display("small", size=(0, 8)), r"size\[0\] is 0"),
        (lambda d: eyebox.Display("small", size=8), "size is 8"),
        (lambda d: eyebox.Display(), "Display\\(\\) needs"),
        (lambda d: eyebox.Hologram.load("nowhere.zarr"), "nowhere.zarr"),
        (lambda d: eyebox.Hologram.load(3), "path is 3"),
        (lambda d: eyebox.Hologram(), "made by eyebox.solve"),
    ],
)
def test_arguments_that_make_no_sense(display, call, says):
    with pytest.raises((ValueError, TypeError), match=says):
        call(display)


@pytest.mark.parametrize(
    ("pupil", "says"),
    [
        ({"x": "left"}, "x is 'left'"),
        ({"x": float("nan")}, "NaN|finite"),
        ({"x": 1.0}, "eyebox|pupil"),
        ({"diameter": 4}, "probably"),
        ({"depth": 1e9}, "depth"),
    ],
)
def test_pupils_that_make_no_sense(hologram, pupil, says):
    with pytest.raises((ValueError, TypeError), match=says):
        hologram.view(**pupil)


def test_views_that_are_no_neighbors_are_refused_unless_a_grid_is_stated(display):
    light = np.random.default_rng(3).random((3, 3, 40, 48), dtype=np.float32)
    with coded(eyebox.SceneError, "scene/cameras"):
        scene(light, display)
    assert scene(light, display, order="as-named").shape == (3, 3, 40, 48, 1)
    with coded(eyebox.SceneError, "scene/order/moves-otherwise"):
        scene(VIEWS[::-1], display)
    assert (scene(VIEWS[::-1], display, order="flip-rows").views == scene(VIEWS, display).views).all()
    with pytest.raises(ValueError, match="as-named"):
        scene(VIEWS, display, order="backwards")
