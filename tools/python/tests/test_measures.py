"""Tests pupils of scores, the groups of the paper, JOD, and plans of solves."""

import json
import os
import pathlib
import pickle
import statistics
import subprocess

import eyebox
import numpy as np
import pytest
from conftest import named


def program(*words):
    found = os.environ.get("EYEBOX")
    if not found or not pathlib.Path(found).exists():
        pytest.skip("EYEBOX names no program")
    return json.loads(subprocess.run([found, *map(str, words), "--json"], check=True, capture_output=True).stdout)


def test_random_pupils_and_their_scores_are_those_of_the_command(hologram, tmp_path):
    hologram.save(tmp_path / "one.zarr")
    words = ("eval", "score", tmp_path / "one.zarr", "--test-pupils", "random:6", "--seed", 9, "--engine", "cpu", "--jod", "all")
    report = program(*words)
    own = hologram.score(pupils="random:6", seed=9, jod=True, engine="cpu")
    np.testing.assert_allclose([1e3 * np.array(one) for one in own.pupils], [one["pupil_mm"] for one in report["pupils"]])
    for name, key in (("psnr", "psnr_db"), ("ssim", "ssim"), ("jod", "jod")):
        np.testing.assert_allclose([getattr(one, name) for one in own], [one[key] for one in report["pupils"]], rtol=1e-6)
    found = own.summary()
    for name in ("mean", "median", "worst", "best", "sd"):
        assert getattr(found, name) == pytest.approx(report["psnr_db"][name])
    depth = [1e-3 * one for one in program("solve", "builtin:still-life", "--display", "planes8", "--size", "40x48", "--dry-run")["depth_mm"]]
    drawn = eyebox.random_pupils(hologram.display, 6, 9, depth=sorted(hologram.metadata["solve"]["depth"]))
    assert drawn == own.pupils and len(depth) == 2
    assert eyebox.random_pupils("paper", 3, rng=9) == eyebox.random_pupils("paper", 3, 9) != eyebox.random_pupils("paper", 3)


def test_groups_are_those_of_the_paper(hologram):
    groups = eyebox.paper_pupils(hologram.display, ("-2mm", 3e-3))
    assert [len(each) for each in groups.values()] == [9, 9, 25, 25, 24]
    assert {one.depth for one in groups["LF near focus"]} == {3e-3}
    scores = hologram.score(pupils="paper", engine="cpu")
    assert len(scores) == 92 and list(scores.by_group()) == list(groups)
    near = scores.by_group()["LF near focus"]
    own = hologram.score(pupils=near.pupils, engine="cpu")
    # The exposure is fitted over all pupils, so scores of a group alone are at least as high on the whole.
    assert own.summary().mean == pytest.approx(near.summary().mean, abs=0.5)
    again = pickle.loads(pickle.dumps(scores))
    assert again == scores and again.groups == scores.groups
    pandas = pytest.importorskip("pandas")
    table = scores.to_dataframe()
    assert isinstance(table, pandas.DataFrame) and table.groupby("group")["psnr"].mean()["LF near focus"] == pytest.approx(near.summary().mean)


def test_jod_of_some_pupils(hologram):
    scores = hologram.score(pupils="random:4", jod=2, engine="cpu")
    judged = [one.jod for one in scores if one.jod is not None]
    assert len(judged) == 2 and all(0 < one <= 10 for one in judged)
    assert scores.summary("jod").mean == pytest.approx(statistics.fmean(judged)) and scores.summary("jod").count == 2
    assert scores.summary("against_clear") is None
    dark = hologram.score(pupils="random:4", jod=2, viewing={"luminance": 1, "black": 0.5}, engine="cpu")
    assert dark.summary("jod").mean > scores.summary("jod").mean
    hologram.score(pupils="random:1", jod=True, sub_frame_rate="480Hz", engine="cpu")


@pytest.mark.parametrize(
    ("wrong", "argument"),
    [
        ({"pupils": "random"}, "pupils"),
        ({"pupils": "random:0"}, "count"),
        ({"pupils": "random:-3"}, "pupils"),
        ({"pupils": "every one"}, "pupils"),
        ({"seed": 3}, "seed"),
        ({"pupils": "random:1", "seed": -1}, "seed"),
        ({"pupils": "random:1", "seed": 1, "rng": 2}, "rng"),
        ({"viewing": {"luminance": 1}}, "viewing"),
        ({"viewing": {"gloss": 1}, "jod": True}, "viewing"),
        ({"sub_frame_rate": 60}, "sub_frame_rate"),
        ({"jod": -1}, "jod"),
        ({"jod": "some"}, "jod"),
        ({"jod": 1, "sub_frame_rate": "4mm"}, "sub_frame_rate"),
    ],
)
def test_scores_that_make_no_sense(hologram, wrong, argument):
    with pytest.raises((TypeError, ValueError)) as caught:
        hologram.score(engine="cpu", **wrong)
    assert caught.value.argument == argument
    with named(ValueError, "score", "'speed'"):
        hologram.score(engine="cpu").summary("speed")


def test_a_plan_is_the_one_of_the_command(display, tmp_path):
    words = ("solve", "builtin:still-life", "--display", "planes8", "--size", "40x48", "--color", "green", "--steps", 7, "--dry-run", "--engine", "cpu")
    report = program(*words)
    planned = eyebox.plan("builtin:still-life", display, "green", steps=7, engine="cpu")
    assert planned["choices"] == report["choices"] and planned["settings"] == report["settings"]
    assert planned["colors"] == ["green"] and planned["forecast"] is None
    [found] = eyebox.plan("builtin:still-life", display, "green", steps=7, forecast=True, engine="cpu")["forecast"]
    assert found["color"] == "green" and found["step_seconds"] > 0 and found["peak_bytes"] > 1e5
    # Arrays have plans too, and settings are those of a solve.
    dark = eyebox.plan(np.zeros((1, 1, 40, 48, 3)) + [1, 0, 0], display, settings=eyebox.SolveSettings(frames=4))
    assert dark["dark"] == ["green", "blue"] and dark["settings"]["frames"] == 4
    with pytest.raises(eyebox.EyeboxError):
        eyebox.plan("builtin:still-life", display, stpes=3)


def test_refiners_show_themselves(hologram):
    refiner = eyebox.Refiner(hologram, engine="cpu")
    assert refiner.pupil is None and "whole eyebox" in repr(refiner) and refiner._repr_png_().startswith(b"\x89PNG")
    before = refiner._repr_png_()
    refiner.aim("2mm", 0, "4mm", "1mm")
    refiner.step(3)
    assert refiner.pupil == eyebox.Pupil(2e-3, 0, 4e-3, 1e-3) and "3 steps" in repr(refiner)
    assert refiner._repr_png_() != before
