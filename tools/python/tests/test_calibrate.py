"""A Python function as the camera of a bench: the display as it is, simulated, is found."""

import signal

import eyebox
import numpy as np
import pytest

SIDE = 64
FIELDS = dict(size=(SIDE, SIDE), pitch_um=8.0, focal_length_mm=400.0, wavelengths_nm={"green": 520.0})
HELLO = {
    "camera": {"resolution": [SIDE, SIDE], "bits": 12},
    "slm": {"takes": ["phases"]},
    "iris": {"x_mm": [-12, 12], "y_mm": [-12, 12], "diameter_mm": [1, 20]},
}


def bench(display, noise=2e-4):
    """A camera that sees the SLM's image as it is, and counts electrons."""
    rng, shots = np.random.default_rng(5), []

    def camera(shot):
        shots.append(shot)
        if shot.color is None:
            return np.zeros((SIDE, SIDE), np.uint16)
        shown = eyebox.Hologram.from_phases(shot.show, display, shot.color, exposure=1.0)
        x, y, diameter = shot.iris
        # Of what is seen no iris is darker than another; of what falls onto a camera it is.
        share = np.pi / 4 * (diameter / display.eyebox) ** 2
        light = shown.view(x, y, diameter, shot.focus, engine="cpu")[..., 0] * share
        seen = light * (shot.exposure or 10e-3) / 10e-3 * 20_000 + rng.normal(0, noise * 4095, light.shape)
        return np.round(np.clip(seen, 0, 4095) * shot.average)

    return camera, shots


def test_a_function_is_a_camera(tmp_path):
    """What has drifted is found by four pictures: phases that are a tenth too large."""
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
    # From the pictures that were kept, without a camera.
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
    assert 2 <= len(shots) <= 4, "of twelve and more"
    assert list((tmp_path / "kept").iterdir()), "the pictures that were taken are kept"


def test_a_bench_that_fails_is_named():
    def broken(shot):
        raise RuntimeError("the shutter is stuck")

    with pytest.raises(eyebox.CalibrateError, match="the shutter is stuck"):
        eyebox.calibrate(eyebox.Display(**FIELDS), broken, hello=HELLO)
    with pytest.raises(TypeError, match="hello is None"):
        eyebox.calibrate(eyebox.Display(**FIELDS), broken)
    with pytest.raises(TypeError, match="camera is 3"):
        eyebox.calibrate(eyebox.Display(**FIELDS), 3, hello=HELLO)
    with pytest.raises(ValueError, match="camera and captures are both None"):
        eyebox.calibrate(eyebox.Display(**FIELDS))
    with pytest.raises(ValueError, match="most is 3"):
        eyebox.calibrate(eyebox.Display(**FIELDS), broken, hello=HELLO, most=3)
