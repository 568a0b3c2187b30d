"""Tests that a hologram finds its scene, reads it with the options of the solve, and accepts no other scene."""

import json
import shutil

import eyebox
import numpy as np
import pytest
from conftest import coded, light_field

PUPILS = [(0, 0, 4e-3, 0), (2e-3, 0, 4e-3, 1e-3)]
HOW = dict(frames=8, steps=3, pupils=2, seed=7, engine="cpu")


def write_views(folder, seed):
    """Writes 2 x 2 gray views to one array."""
    folder.mkdir(parents=True, exist_ok=True)
    # All views of a plane at infinity are equal.
    view = np.random.default_rng(seed).integers(0, 255, (40, 48), dtype=np.uint8)
    light = np.tile(view, (2, 2, 1, 1))
    np.save(folder / "views.npy", light)
    return light


def psnr(hologram, scene=None, **more):
    return [score.psnr for score in hologram.score(scene, PUPILS, engine="cpu", **more)]


@pytest.fixture
def files(tmp_path, display):
    """Makes two folders, each with a scene of the same name, and the hologram of the first scene."""
    write_views(tmp_path / "a", 1)
    write_views(tmp_path / "b", 2)
    solved = eyebox.solve(tmp_path / "a" / "views.npy", display, "green", depth=(0, 0), view_pitch=2e-3, **HOW)
    solved.save(tmp_path / "a" / "h.zarr")
    return tmp_path, psnr(solved)


def test_its_scene_is_found_wherever_it_is(files, monkeypatch):
    at, right = files
    monkeypatch.chdir(at / "b")
    assert psnr(eyebox.Hologram.load("../a/h.zarr")) == pytest.approx(right, abs=1e-9)
    assert psnr(eyebox.Hologram.load("../a/h.zarr"), "../a/views.npy") == pytest.approx(right, abs=1e-9)
    shutil.copytree(at / "a" / "h.zarr", at / "b" / "h.zarr")
    assert psnr(eyebox.Hologram.load("h.zarr")) == pytest.approx(right, abs=1e-9)
    (at / "a").rename(at / "moved")
    moved = eyebox.Hologram.load("../moved/h.zarr")
    assert psnr(moved) == pytest.approx(right, abs=1e-9)
    assert eyebox.Refiner(moved, engine="cpu").step() < 1
    with coded(eyebox.SceneError, "hologram/changed-scene"):
        # The old place of the scene is empty, and the folder of the hologram has another scene.
        psnr(eyebox.Hologram.load("h.zarr"))


def test_another_scene_is_refused_unless_it_is_asked_for(files):
    at, right = files
    hologram = eyebox.Hologram.load(at / "a" / "h.zarr")
    for scene in (at / "b" / "views.npy", "builtin:plane", np.zeros((2, 2, 40, 48), np.float32) + 0.5):
        with pytest.raises(eyebox.SceneError):
            psnr(hologram, scene)
        with pytest.raises(eyebox.SceneError):
            hologram.refine((0, 0, 4e-3, 0), 1, scene=scene, engine="cpu")
        assert psnr(hologram, scene, other_scene=True) != pytest.approx(right, abs=0.1)
    write_views(at / "a", 3)
    with coded(eyebox.SceneError, "hologram/changed-scene"):
        psnr(hologram)
    assert len(psnr(hologram, other_scene=True)) == 2


def test_an_array_is_its_own_name(tmp_path, display):
    light = light_field(3, 3, 4)
    solved = eyebox.solve(light, display, "green", depth=(0, 0), view_pitch=1.5e-3, **HOW)
    right = psnr(solved)
    solved.save(tmp_path / "h.zarr")
    loaded = eyebox.Hologram.load(tmp_path / "h.zarr")
    assert psnr(loaded, light) == pytest.approx(right, abs=1e-6)
    assert psnr(loaded, np.asfortranarray(light)) == pytest.approx(right, abs=1e-6)
    with coded(eyebox.SceneError, "hologram/no-scene"):
        psnr(loaded)
    other = light.copy()
    other[1, 1, 0, 0] += 0.25
    for wrong in (other, "builtin:plane"):
        with coded(eyebox.SceneError, "hologram/other-scene"):
            psnr(loaded, wrong)
    assert len(psnr(loaded, other, other_scene=True)) == 2
    named = eyebox.solve(eyebox.Scene(light, display, "green", name="mine"), depth=(0, 0), **HOW)
    with pytest.raises(eyebox.SceneError):
        psnr(named, eyebox.Scene(other, display, "green", name="mine"))


@pytest.mark.parametrize("options", [dict(views=5), dict(views=4, view_pitch=1e-3)])
def test_a_scene_is_read_as_it_was(tmp_path, display, options):
    solved = eyebox.solve("builtin:still-life", display, "green", **options, **HOW)
    solved.save(tmp_path / "h.zarr")
    loaded = eyebox.Hologram.load(tmp_path / "h.zarr")
    assert psnr(loaded) == pytest.approx(psnr(solved), abs=1e-6)
    assert psnr(loaded, "builtin:still-life") == pytest.approx(psnr(solved), abs=1e-6)


def test_a_refined_hologram_is_the_best_state(display):
    small = eyebox.Display("paper", size=(128, 128))
    solved = eyebox.solve("builtin:still-life", small, "green", frames=2, steps=6, engine="cpu")
    pupil = (4e-3, 0, 4e-3, 1e-3)
    at_eye = lambda hologram: hologram.score(None, [pupil], engine="cpu")[0].psnr
    before, fell = at_eye(solved), 0
    for steps in (8, 16, 32):
        refiner = eyebox.Refiner(solved, engine="cpu")
        refiner.aim(*pupil, spread=0.25e-3)
        refiner.step(steps)
        last = at_eye(refiner.hologram)
        best = at_eye(solved.refine(pupil, steps, spread=0.25e-3, engine="cpu"))
        assert best >= max(before, last) - 0.01
        before, fell = best, max(fell, best - last)
    assert fell > 0.1, "a last state that is worse shows that the best is kept"


def test_the_display_is_found(tmp_path, display, monkeypatch):
    (tmp_path / "bench.toml").write_text(display.to_toml().replace('name = "planes8"', 'name = "bench"'))
    for name in ("planes8", tmp_path / "bench.toml"):
        solved = eyebox.solve("builtin:plane", eyebox.Display(name, size=(32, 40)), "green", **HOW)
        solved.save(tmp_path / "h.zarr")
        loaded = eyebox.Hologram.load(tmp_path / "h.zarr")
        right = loaded.encode(eyebox.Display(name, size=(32, 40)))
        assert np.array_equal(loaded.encode(), right) and np.array_equal(loaded.encode(name), right)
        with eyebox.show(loaded, clock="simulated", seconds=0.1) as session:
            assert session.frame().pixels.shape[:2] == (32, 40)
        with eyebox.show(tmp_path / "h.zarr", clock="simulated", seconds=0.1) as session:
            assert session.frame().pixels.shape[:2] == (32, 40)
    (tmp_path / "bench.toml").unlink()
    with coded(eyebox.DisplayError, "hologram/display-not-found"):
        eyebox.Hologram.load(tmp_path / "h.zarr").encode()


def test_each_hologram_of_a_sequence_is_scored(tmp_path, display):
    pytest.importorskip("distributed")
    import eyebox.cluster

    scenes = ["builtin:plane?depth=0", "builtin:plane?depth=0.5"]
    out = tmp_path / "s.zarr"
    eyebox.cluster.solve_sequence(scenes, out, display, "green", workers=1, **HOW)
    with coded(eyebox.HologramError, "hologram/not-a-hologram/is-a-sequence"):
        eyebox.Hologram.load(out)
    found = eyebox.cluster.evaluate([out], tmp_path / "scores.json", PUPILS, workers=1, engine="cpu")
    assert [one["at"] for one in found] == [0, 1]
    own = [psnr(eyebox.Hologram.load(out, at)) for at in (0, 1)]
    assert [[score["psnr"] for score in one["scores"]] for one in found] == own
    assert json.loads((tmp_path / "scores.json").read_text()) == found


def test_a_refinement_that_cannot_begin_names_its_cause(display):
    scene = eyebox.Scene("builtin:still-life", display, ["red", "green"])
    hologram = eyebox.solve(scene, display, frames=1, steps=1, pupils=1, engine="cpu")
    green = eyebox.Scene("builtin:still-life", display, "green")
    with pytest.raises(eyebox.DisplayError):
        eyebox.Refiner(hologram, green, engine="cpu", other_scene=True)
    with pytest.raises(eyebox.SolveError):
        eyebox.Refiner(hologram, scene, engine="cpu", pupils=0)
