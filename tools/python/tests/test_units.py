"""Tests texts with units instead of numbers."""

import eyebox
import numpy as np
import pytest
from conftest import coded


def test_texts_with_units_are_numbers(display, hologram):
    depth = 0.01 * display.focal_length**2
    want = hologram.view(1e-3, -2e-3, 4e-3, depth)
    for pupil in (("1mm", "-0.2cm", "4000um", "0.01D"), ("1 mm", -2e-3, 4e-3, "100m"), (1e-3, -2e-3, "4mm", f"{depth * 1e3} mm")):
        np.testing.assert_allclose(hologram.view(*pupil), want, atol=1e-5)
    seen = eyebox.photograph("builtin:plane", "1mm", 0, "4mm", "0.01D", display=display, color="green")
    np.testing.assert_allclose(
        seen, eyebox.photograph("builtin:plane", 1e-3, 0, 4e-3, depth, display=display, color="green"), atol=1e-5
    )
    eyebox.Refiner(hologram).aim("1mm", diameter="4mm", depth="0.01D", spread="0.1mm")
    assert eyebox.Display("planes8", size="256").resolution == (256, 256)
    assert eyebox.Display("planes8", size="1080p").resolution == (1080, 1920)
    assert eyebox.Scene("builtin:plane", display, "green", view_pitch="2mm").view_pitch == 2e-3
    with eyebox.show(hologram, display, clock="simulated", seconds="100ms", rate="60Hz", latency="1ms") as session:
        assert session.frame("10s") is not None


def test_settings_of_a_solve_take_units(display):
    how = dict(color="green", frames=1, steps=2, pupils=2, seed=3)
    made = eyebox.solve("builtin:plane", display, diameter=("2mm", "6mm"), depth=("-1mm", "1mm"), seconds="1h", **how)
    same = eyebox.solve("builtin:plane", display, diameter=(2e-3, 6e-3), depth=(-1e-3, 1e-3), seconds=3600, **how)
    assert made.phases["green"].tobytes() == same.phases["green"].tobytes()


def test_other_units_and_texts_are_refused(display, hologram):
    for call in (
        lambda: hologram.view(diameter="4D"),
        lambda: hologram.view(depth="1s"),
        lambda: eyebox.show(hologram, display, latency="1mm"),
        lambda: hologram.score(pupils=[(0, "1Hz", 4e-3, 0)]),
    ):
        with coded(ValueError, "quantity/other-dimension"):
            call()
    with coded(ValueError, "quantity/not-a-size"):
        eyebox.Display("planes8", size="large")
    for text in ("4", "", "wide"):
        with pytest.raises(TypeError, match="diameter"):
            hologram.view(diameter=text)
