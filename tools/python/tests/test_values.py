"""Tests holograms, scenes, displays and engines as values, which are compared, copied, pickled and replaced."""

import copy
import multiprocessing
import pickle

import eyebox
import numpy as np
import pytest
from conftest import light_field, named


def values(display, hologram):
    """Returns pairs of equal values, which were made independently of each other."""
    light = light_field(3, 3, 2)
    phases = np.random.default_rng(1).uniform(-3, 3, (2, 40, 48)).astype(np.float32)
    made = lambda: eyebox.Hologram.from_phases(phases, display, "green", exposure=1.5)  # noqa: E731
    return {
        "preset": (eyebox.Display("planes8", size=(40, 48)), display),
        "scene by name": (eyebox.Scene("builtin:still-life", display, "green"), eyebox.Scene("builtin:still-life", display, "green")),
        "scene of an array": (eyebox.Scene(light, display, "green", name="a"), eyebox.Scene(light.copy(), display, "green", name="a")),
        "phases": (made(), made()),
        "phases of a scene": tuple(eyebox.Hologram.from_phases(phases, display, "green", scene=light) for _ in range(2)),
        "solved": (eyebox.solve("builtin:still-life", display, color="green", frames=8, steps=3, pupils=4, seed=7, engine="cpu"), hologram),
        "engine": (eyebox.Engine("cpu"), eyebox.Engine("cpu")),
        "settings": (eyebox.SolveSettings(steps=3), eyebox.SolveSettings(steps=3)),
        "pupil": (eyebox.Pupil(1e-3), eyebox.Pupil(1e-3)),
    }


KINDS = ["preset", "scene by name", "scene of an array", "phases", "phases of a scene", "solved", "engine", "settings", "pupil"]


@pytest.fixture(scope="module")
def pairs(display, hologram):
    return values(display, hologram)


@pytest.mark.parametrize("kind", KINDS)
def test_equal_content_is_equal(pairs, kind):
    one, other = pairs[kind]
    assert one is not other and one == other and hash(one) == hash(other) and len({one, other}) == 1
    assert one != "something else" and one is not None


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("way", [pickle.dumps, copy.copy, copy.deepcopy], ids=["pickle", "copy", "deepcopy"])
def test_copies_are_equal(pairs, kind, way):
    one, _ = pairs[kind]
    again = pickle.loads(way(one)) if way is pickle.dumps else way(one)
    assert type(again) is type(one) and again == one and hash(again) == hash(one)


def test_other_content_is_not_equal(display, hologram, tmp_path):
    light = light_field(3, 3, 2)
    other = light.copy()
    other[1, 1, 5, 5] += 1e-3
    scene = lambda array, **options: eyebox.Scene(array, display, "green", **options)  # noqa: E731
    phases = np.zeros((40, 48), np.float32)
    made = lambda phases, exposure=1.0: eyebox.Hologram.from_phases(phases, display, "green", exposure=exposure)  # noqa: E731
    moved = phases.copy()
    moved[39, 47] = 1e-3
    file = tmp_path / "views.npy"
    np.save(file, light)
    before = eyebox.Scene(file, display, "green")
    np.save(file, other)
    different = [
        (before, eyebox.Scene(file, display, "green")),
        (eyebox.Scene("builtin:plane", display, "green"), eyebox.Scene("builtin:plane", display, "green", views=3)),
        (display, display.replace(levels=16)),
        (scene(light), scene(other)),
        (scene(light), scene(light, view_pitch=1e-3)),
        (scene(light), eyebox.Scene(light, display.replace(focal_length_mm=300), "green")),
        (made(phases), made(moved)),
        (made(phases), made(phases, 2.0)),
        (eyebox.SolveSettings(steps=3), eyebox.SolveSettings(steps=4)),
    ]
    for one, two in different:
        assert one != two and hash(one) != hash(two)


def test_a_pickled_hologram_does_all_that_the_original_does(display, hologram):
    again = pickle.loads(pickle.dumps(hologram))
    assert again.phases["green"].tobytes() == hologram.phases["green"].tobytes() and again.stopped == hologram.stopped
    assert again.metadata["solve"] == hologram.metadata["solve"] and again.display == hologram.display
    assert again.score(engine="cpu") == hologram.score(engine="cpu")
    assert (again.encode(display) == hologram.encode(display)).all()
    # The scene of an array comes along, because no name finds it.
    light = light_field(3, 3, 2)
    own = eyebox.solve(light, display, color="green", frames=1, steps=2, pupils=2, engine="cpu")
    assert pickle.loads(pickle.dumps(own)).score(engine="cpu") == own.score(engine="cpu")


def test_a_pickled_scene_is_the_scene_of_its_hologram(display, hologram, tmp_path):
    scene = pickle.loads(pickle.dumps(eyebox.Scene("builtin:still-life", display, "green")))
    assert hologram.score(scene, engine="cpu") == hologram.score(engine="cpu")
    assert scene.depth_range == eyebox.Scene("builtin:still-life", display, "green").depth_range
    # The views come along, so the file may be gone.
    np.save(tmp_path / "views.npy", light_field(3, 3, 2))
    text = pickle.dumps(eyebox.Scene(tmp_path / "views.npy", display, "green", view_pitch=2e-3))
    (tmp_path / "views.npy").unlink()
    scene = pickle.loads(text)
    assert scene.view_pitch == 2e-3 and scene.shape == (3, 3, 40, 48, 1)


def _scored(hologram):
    return hologram.score(engine="cpu")


def test_other_processes_receive_holograms(hologram):
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        [scores] = pool.map(_scored, [hologram])
    assert scores == hologram.score(engine="cpu") and scores.pupils == hologram.score(engine="cpu").pupils


def test_a_display_is_replaced(display):
    other = display.replace(levels=16, focal_length_mm="30cm", size="64x48", wavelengths_nm={"green": "530nm"})
    assert (other.levels, other.focal_length, other.resolution) == (16, 0.3, (64, 48))
    assert other.wavelengths == {**display.wavelengths, "green": pytest.approx(530e-9)} and other.name == display.name
    assert display == eyebox.Display("planes8", size=(40, 48)), "a display does not change"
    modeled = display.replace(model={"green": {"fill": 0.95, "lag": 0.1}})
    assert modeled.replace(model={"green": {"lag": 0.2}}).to_toml().count("fill = 0.95") == 1
    assert modeled.replace(model={"green": {"lag": None}}) == display.replace(model={"green": {"fill": 0.95}})
    assert modeled.replace(model=None) == display
    with named(eyebox.DisplayError, "levels"):
        display.replace(levels=1)
    with pytest.raises(ValueError, match="pich_um"):
        display.replace(pich_um=8)
    with named(TypeError, "focal_length_mm", "far"):
        display.replace(focal_length_mm="far")


def test_lengths_of_displays_take_units():
    fields = dict(size=(64, 64), levels=256)
    made = eyebox.Display(pitch_um="0.008mm", focal_length_mm="40cm", wavelengths_nm={"green": "0.52um"}, rate_hz="0.06kHz", **fields)
    assert made.pitch == pytest.approx(8e-6) and made.focal_length == pytest.approx(0.4)
    assert made.wavelengths["green"] == pytest.approx(520e-9) and "rate_hz = 60" in made.to_toml()
    with pytest.raises(ValueError) as caught:
        eyebox.Display(pitch_um="8Hz", focal_length_mm=400, wavelengths_nm={"green": 520}, **fields)
    assert caught.value.argument == "pitch_um"
