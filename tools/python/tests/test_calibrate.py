"""Tests calibration with a Python function as the camera of a bench, which simulates the real display."""

import json
import os
import pathlib
import signal
import subprocess

import eyebox
import numpy as np
import pytest
from conftest import coded, LONG, named

SIDE = 64
FIELDS = dict(size=(SIDE, SIDE), pitch_um=8.0, focal_length_mm=400.0, wavelengths_nm={"green": 520.0})
HELLO = {
    "camera": {"resolution": [SIDE, SIDE], "bits": 12},
    "slm": {"takes": ["phases"]},
    "iris": {"x_mm": [-12, 12], "y_mm": [-12, 12], "diameter_mm": [1, 20]},
}


def bench(display, noise=2e-4):
    """Returns a camera that sees the real image of the SLM and counts electrons, and the list of its shots."""
    rng, shots = np.random.default_rng(5), []
    # The brightest picture has dots, and each dot has a share of the light of the whole SLM.
    bright = 20_000 * SIDE**2 / np.prod(display.resolution)

    def camera(shot):
        shots.append(shot)
        if shot.color is None:
            return np.zeros(display.resolution, np.uint16)
        shown = eyebox.Hologram.from_phases(shot.show, display, shot.color, exposure=1.0)
        x, y, diameter = shot.iris
        # A view has the same brightness through every iris, but a camera receives less light through a small one.
        share = np.pi / 4 * (diameter / display.eyebox) ** 2
        light = shown.view(x, y, diameter, shot.focus, engine="cpu")[..., 0] * share
        seen = light * (shot.exposure or 10e-3) / 10e-3 * bright + rng.normal(0, noise * 4095, light.shape)
        return np.round(np.clip(seen, 0, 4095) * shot.average)

    return camera, shots


def test_a_function_is_a_camera(tmp_path):
    """Four pictures find the drift, which is phases that are a tenth too large."""
    known = {"fill": 0.95}
    before = eyebox.Display(**FIELDS, model={"green": known})
    camera, shots = bench(eyebox.Display(**FIELDS, model={"green": {**known, "level": [[1.1] * 3] * 3}}))
    heard = []
    found = eyebox.calibrate(
        before, camera, hello=HELLO, captures=tmp_path / "kept", quick=True, callback=lambda *said: heard.append(said)
    )
    assert found.report["captures"] == 4 and len(shots) >= 4
    shot = next(shot for shot in shots if shot.color)
    assert shot.show.dtype == np.float32 and shot.show.ndim == 3 and shot.wavelength == pytest.approx(520e-9)
    assert any(share is not None for _, share in heard)
    levels = [p["value"] for p in found.report["parameters"] if p["name"].startswith("level")]
    assert len(levels) == 9 and np.allclose(levels, 1.1, atol=0.08), levels
    # The next calibration uses the pictures that were kept, and does not call the camera.
    shots.clear()
    again = eyebox.calibrate(before, camera, hello=HELLO, captures=tmp_path / "kept", quick=True)
    assert again.display == found.display and not shots


@pytest.mark.parametrize("by", ["ctrl-C", "the callback"])
def test_it_is_ended_between_two_pictures(by, tmp_path):
    before = eyebox.Display(**FIELDS, model={"green": {"fill": 0.95}})
    camera, shots = bench(before)

    def presses(shot):
        if len(shots) == 1 and by == "ctrl-C":
            signal.raise_signal(signal.SIGINT)
        return camera(shot)

    def hears(what, share):
        if len(shots) > 1 and by != "ctrl-C":
            raise LookupError(what)

    pressed = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt if by == "ctrl-C" else LookupError):
            eyebox.calibrate(before, presses, hello=HELLO, captures=tmp_path / "kept", callback=hears)
    finally:
        signal.signal(signal.SIGINT, pressed)
    assert 2 <= len(shots) <= 4, "it ends before all pictures are taken, which are 12 or more"
    assert list((tmp_path / "kept").iterdir()), "the pictures that were taken are kept"


@pytest.mark.skipif(not LONG, reason="a minute")
def test_the_command_fits_the_first_phases_of_the_display_that_it_writes(tmp_path):
    """The command fits one table for the calibrated color and the model in the file.

    A solve for the file reads this table and fits none.
    """
    program = os.environ.get("EYEBOX")
    if not program or not pathlib.Path(program).exists():
        pytest.skip("EYEBOX names no program")
    large = {**FIELDS, "size": (256, 256)}
    before = eyebox.Display(**large)
    (tmp_path / "bench.toml").write_text(before.to_toml())
    camera, _ = bench(eyebox.Display(**large, model={"green": {"level": [[1.08] * 3] * 3}}))
    hello = {**HELLO, "camera": {"resolution": [256, 256], "bits": 12}}

    def taken(what, share):
        if share is not None and share > 0.42:
            raise LookupError(what)

    with pytest.raises(LookupError):  # All pictures are there, and the command fits them.
        eyebox.calibrate(before, camera, hello=hello, captures=tmp_path / "kept", most=12, callback=taken)

    def command(*words):
        environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
        return subprocess.run([pathlib.Path(program).resolve(), *words], cwd=tmp_path, env=environment, check=True, capture_output=True, text=True)

    tables = lambda: {file.name: file.stat().st_mtime_ns for file in (tmp_path / "cache" / "eyebox").glob("start-*.table")}
    found = json.loads(command("display", "calibrate", "bench.toml", "--captures", "kept", "-o", "out.toml", "--json").stdout)
    made = tables()
    assert found["calibrated"] and len(made) == 1
    solve = ["solve", "builtin:plane", "--color", "green", "--steps", "0", "--engine", "cpu"]
    command(*solve, "--display", "out.toml", "-o", "own.zarr")
    assert tables() == made
    # The display before the calibration has another model and therefore another table.
    command(*solve, "--display", "bench.toml", "-o", "other.zarr")
    assert len(tables()) == 2 and made.items() <= tables().items()


def test_a_bench_that_fails_is_named():
    def broken(shot):
        raise RuntimeError("the shutter is stuck")

    with coded(eyebox.CalibrateError, "calibrate/refused"):
        eyebox.calibrate(eyebox.Display(**FIELDS), broken, hello=HELLO)
    with named(TypeError, "hello", "None"):
        eyebox.calibrate(eyebox.Display(**FIELDS), broken)
    with named(TypeError, "camera", "3"):
        eyebox.calibrate(eyebox.Display(**FIELDS), 3, hello=HELLO)
    with named(ValueError, "camera", "captures", "None"):
        eyebox.calibrate(eyebox.Display(**FIELDS))
    with named(ValueError, "most", "3"):
        eyebox.calibrate(eyebox.Display(**FIELDS), broken, hello=HELLO, most=3)


#: Faults of benches, which change the requested phase. Neither four pictures nor all of them make a calibration.
FAULTS = {
    "the other sign": lambda shown: -shown,
    "the other sign, a little stronger": lambda shown: -1.08 * shown,
    "the other sign and an offset": lambda shown: 1.0 - shown,
    "another pattern": lambda shown: np.random.default_rng(3).uniform(-3, 3, shown.shape),
    "no pattern": lambda shown: np.zeros_like(shown),
    "left and right exchanged in one half": lambda shown: np.where(np.arange(SIDE) < SIDE // 2, shown, shown[..., ::-1]),
    "upside down": lambda shown: shown[:, ::-1],
    "shifted": lambda shown: np.roll(shown, (7, 11), (1, 2)),
    "twice the phase": lambda shown: 2.5 * shown,
    "noise over it": lambda shown: shown + np.random.default_rng(4).normal(0, 1.5, shown.shape),
    "half of the pixels stuck": lambda shown: np.where(np.arange(SIDE) % 2, shown, 0.5),
}


def faulty(display, fault):
    camera, shots = bench(display)

    def take(shot):
        return camera(shot._replace(show=None if shot.show is None else fault(shot.show).astype(np.float32)))

    return take


@pytest.mark.parametrize("fault", FAULTS)
def test_what_four_pictures_do_not_show_is_no_calibration(fault):
    before = eyebox.Display(**FIELDS, model={"green": {"fill": 0.95}})
    camera = faulty(eyebox.Display(**FIELDS, model={"green": {"fill": 0.95, "level": [[1.08] * 3] * 3}}), FAULTS[fault])
    try:
        found = eyebox.calibrate(before, camera, hello=HELLO, quick=True)
    except eyebox.CalibrateError:
        return
    assert found.report["calibrated"] is False, found.report["parameters"]
    assert found.report["unexplained"] > 0.01 and any("not calibrated" in line for line in found.report["warnings"])
    if "sign" in fault:
        assert any("other sign" in line for line in found.report["warnings"]), found.report["warnings"]


@pytest.mark.skipif(not LONG, reason="minutes")
def test_the_other_sign_is_no_calibration_by_all_pictures():
    before = eyebox.Display(**FIELDS, model={"green": {"fill": 0.95}})
    found = eyebox.calibrate(before, faulty(before, FAULTS["the other sign"]), hello=HELLO)
    assert found.report["calibrated"] is False and any("other sign" in line for line in found.report["warnings"])


#: Ordinary drift that four pictures find, as (level, noise of the camera).
DRIFTS = [(1.0, 2e-4), (1.08, 2e-4), (1.1, 2e-4), (0.9, 2e-4), (0.85, 2e-4), (1.08, 3e-3)]


@pytest.mark.parametrize(("level", "noise"), DRIFTS)
def test_what_has_drifted_is_a_calibration(level, noise):
    known = {"fill": 0.95}
    before = eyebox.Display(**FIELDS, model={"green": known})
    camera, _ = bench(eyebox.Display(**FIELDS, model={"green": {**known, "level": [[level] * 3] * 3}}), noise)
    found = eyebox.calibrate(before, camera, hello=HELLO, quick=True)
    assert found.report["calibrated"] is True and 0 <= found.report["unexplained"] < 0.01


@pytest.mark.parametrize("level", [0.6, 0.7, 0.75, 0.8, 1.12, 1.15, 1.2, 1.3, 1.4, 1.6])
def test_more_drift_is_found_or_no_calibration(level):
    known = {"fill": 0.95}
    before = eyebox.Display(**FIELDS, model={"green": known})
    camera, _ = bench(eyebox.Display(**FIELDS, model={"green": {**known, "level": [[level] * 3] * 3}}))
    try:
        report = eyebox.calibrate(before, camera, hello=HELLO, quick=True).report
    except eyebox.CalibrateError:
        return
    levels = [p["value"] for p in report["parameters"] if p["name"].startswith("level")]
    right = len(levels) == 9 and np.allclose(levels, level, atol=0.03)
    assert report["calibrated"] is right, (levels, report["unexplained"])


@pytest.mark.parametrize("raised", [KeyboardInterrupt, SystemExit, GeneratorExit])
def test_what_ends_programs_ends_a_calibration_from_its_camera(raised):
    shots = []

    def camera(shot):
        shots.append(shot)
        raise raised("on purpose")

    with pytest.raises(raised):
        eyebox.calibrate(eyebox.Display(**FIELDS), camera, hello=HELLO)
    assert len(shots) == 1


def test_a_bench_says_what_it_is_in_numpys_numbers(tmp_path):
    before = eyebox.Display(**FIELDS, model={"green": {"fill": 0.95}})
    camera, _ = bench(before)
    hello = {
        "camera": {"resolution": np.array([SIDE, SIDE]), "bits": np.int64(12)},
        "slm": {"takes": ("phases",)},
        "iris": {"x_mm": np.array([-12.0, 12.0]), "y_mm": (np.float32(-12), 12), "diameter_mm": np.array([1, 20])},
    }
    found = eyebox.calibrate(before, camera, hello=hello, quick=np.bool_(True), most=np.int64(40))
    assert found.report["captures"] == 4
    for iris in ((1e-3, 2e-3), (1e-3, 2e-3, 3e-3, 4e-3), 3e-3, "abc"):
        with named((TypeError, ValueError), "iris"):
            eyebox.calibrate(before, camera, hello=hello, iris=iris)
