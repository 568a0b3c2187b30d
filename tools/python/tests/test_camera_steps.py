"""Tests solves whose last steps use a Python function as the camera of a simulated bench."""

import eyebox
import numpy as np
import pytest
from conftest import coded, named
from test_calibrate import FIELDS, HELLO as WIDE, bench

#: The light through the largest iris is at most 3 times that through the smallest one.
HELLO = {**WIDE, "iris": {**WIDE["iris"], "diameter_mm": [5, 8]}}
#: The display file has no model, and the relay of the real display has a wavefront error.
REAL = {"green": {"wavefront": {"4": 0.3, "5": 0.2}}}
HOW = dict(color="green", frames=1, steps=10, pupils=4, seed=2, engine="cpu")
#: A solve whose camera steps gain 0.4 dB.
LONGER = dict(frames=2, steps=20, pupils=8)


def solve(camera, **more):
    return eyebox.solve("builtin:still-life", eyebox.Display(**FIELDS), camera=camera, hello=HELLO, **{**HOW, **more})


def test_the_camera_improves_the_hologram_on_the_real_display(tmp_path):
    real = eyebox.Display(**FIELDS, model=REAL)
    camera, shots = bench(real)
    plain = eyebox.solve("builtin:still-life", eyebox.Display(**FIELDS), **{**HOW, **LONGER})
    better = solve(camera, camera_steps=8, captures=tmp_path / "kept", **LONGER)
    [gain] = better.metadata["camera"]
    assert gain["color"] == "green" and 0 < gain["steps"] <= 8 and gain["pictures"] > 8 * 6
    assert gain["psnr_db"][1] > gain["psnr_db"][0] + 0.2
    assert better.phases["green"].tobytes() != plain.phases["green"].tobytes() and better.stopped == "steps"
    assert list((tmp_path / "kept").iterdir()), "the pictures are kept"


def test_the_levels_are_those_of_the_display():
    """A level of 2 pi that differs from the number of levels reaches the camera."""
    camera, shots = bench(eyebox.Display(**FIELDS))
    levels = []

    def takes(shot):
        levels.append(int(shot.show.max()))
        raise KeyboardInterrupt

    display = eyebox.Display(**FIELDS, encoding={"two_pi_level": 128})
    with pytest.raises(eyebox.Interrupted):
        eyebox.solve("builtin:plane", display, camera=takes, hello={**HELLO, "slm": {}}, **HOW)
    assert levels and max(levels) < 128


@pytest.mark.parametrize("at", [1, 9])
def test_a_camera_that_fails_leaves_the_best_hologram(at):
    camera, shots = bench(eyebox.Display(**FIELDS, model=REAL))

    def fails(shot):
        if len(shots) >= at:
            raise RuntimeError("the shutter is stuck")
        return camera(shot)

    with coded(eyebox.CalibrateError, "calibrate/refused") as caught:
        solve(fails, camera_steps=3)
    if at > 1:
        assert caught.value.hologram.shape == (1, 64, 64) and caught.value.hologram.metadata["camera"]


@pytest.mark.parametrize("raised", [KeyboardInterrupt, SystemExit])
def test_what_ends_programs_ends_the_steps(raised):
    def camera(shot):
        raise raised("on purpose")

    with pytest.raises(raised) as caught:
        solve(camera)
    if raised is KeyboardInterrupt:
        plain = eyebox.solve("builtin:still-life", eyebox.Display(**FIELDS), **HOW)
        assert isinstance(caught.value, eyebox.Interrupted) and caught.value.hologram == plain


def test_wrong_arguments_are_named_before_the_solve():
    for error, name, wrong in (
        (TypeError, "camera", {"camera": 3}),
        (TypeError, "hello", {"hello": {}}),
        (ValueError, "camera_steps", {"camera_steps": 0}),
    ):
        camera = wrong.pop("camera", lambda shot: None)
        with named(error, name):
            solve(camera, steps=0, **wrong)
    with pytest.raises(ValueError, match="joint"):
        eyebox.solve("builtin:plane", "small", camera=lambda shot: None, hello=HELLO, joint={"brightness": 1.0}, frames=1, steps=0)
