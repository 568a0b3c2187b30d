"""Tests holograms on SLMs and cameras of slmsuite, which are simulated, and runs the programs of docs/slmsuite.md."""

import pathlib
import re
import subprocess
import sys

import eyebox
import eyebox.slmsuite
import numpy as np
import pytest
from conftest import named

pytest.importorskip("slmsuite", reason="slmsuite is not installed")
import matplotlib  # noqa: E402

matplotlib.use("Agg")
from slmsuite.hardware.cameras.simulated import SimulatedCamera  # noqa: E402
from slmsuite.hardware.slms.simulated import SimulatedSLM  # noqa: E402

PAGE = pathlib.Path(__file__).parents[3] / "docs" / "slmsuite.md"
ROWS, COLUMNS = 48, 64


@pytest.fixture(scope="module")
def page():
    """Runs the programs of the page in their order and returns their names."""
    programs = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    names = {"__name__": "page"}
    for number, program in enumerate(programs):
        exec(compile(program, f"docs/slmsuite.md, program {number}", "exec"), names)
    return names


def slm_of(bitdepth=8, **options):
    return SimulatedSLM((COLUMNS, ROWS), wav_um=0.52, bitdepth=bitdepth, **options)


def grating(display, period=8):
    """Returns a hologram whose phase rises to the right, by a wave per period."""
    phases = np.broadcast_to(2 * np.pi * np.arange(COLUMNS, dtype=np.float32) / period, (ROWS, COLUMNS))
    return eyebox.Hologram.from_phases(phases.copy(), display, "green", exposure=1.0)


def test_the_page_shows_what_it_says(page):
    assert page["played"].sub_frames == 12 and page["played"].holograms == 2
    order = [(hologram, sub_frame) for hologram in (0, 1) for _ in range(3) for sub_frame in (0, 1)]
    assert [(hologram, sub_frame) for hologram, sub_frame, _ in page["pictures"]] == order
    want = eyebox.slmsuite.levels(page["hologram"], page["slm"])
    assert (page["shown"] == want[0]).all()
    assert all((levels == want[sub_frame]).all() for hologram, sub_frame, levels in page["pictures"] if hologram == 0)
    assert page["played"].seconds >= 12 / 60


def test_a_camera_of_slmsuite_calibrates_and_takes_part_in_a_solve(page):
    found = page["found"]
    levels = [one["value"] for one in found.report["parameters"] if one["name"].startswith("level")]
    assert found.report["captures"] == 4 and len(levels) == 9 and np.allclose(levels, 1.08, atol=0.03), levels
    assert len(found.to_dataframe()) == len(found.report["parameters"])
    [taken] = page["better"].metadata["camera"]
    assert taken["color"] == "green" and taken["pictures"] >= 12 and taken["psnr_db"] is not None


def test_levels_are_the_phases_of_eyebox():
    slm = slm_of()
    display = eyebox.slmsuite.display_of(slm, 0.4)
    want = (256 * np.arange(COLUMNS) // 8) % 256
    levels = eyebox.slmsuite.levels(grating(display), slm)
    assert levels.shape == (1, ROWS, COLUMNS) and levels.dtype == slm.dtype and (levels == want).all()
    assert (eyebox.slmsuite.show(grating(display), slm, settle=False) == want).all() and (slm.display == want).all()


def test_the_phase_of_slmsuite_has_the_other_sign():
    """The same phases, as levels of eyebox and as phases of slmsuite, deflect the light to opposite sides."""
    slm = slm_of()
    camera = SimulatedCamera(slm, bitdepth=12)
    camera.set_exposure(1.0)
    hologram = grating(eyebox.slmsuite.display_of(slm, 0.4))
    seen = []
    for show in (
        lambda: eyebox.slmsuite.show(hologram, slm, settle=False),
        lambda: slm.set_phase(hologram.phases["green"][0], phase_correct=False),
        lambda: slm.set_phase(-hologram.phases["green"][0], phase_correct=False),
    ):
        show()
        picture = camera.get_image()
        seen.append(np.unravel_index(picture.argmax(), picture.shape)[1] - COLUMNS // 2)
    assert abs(seen[0]) == COLUMNS // 8 and seen == [seen[0], -seen[0], seen[0]]


@pytest.mark.parametrize("bitdepth", [4, 8, 10, 12])
def test_levels_have_the_bits_of_the_slm(bitdepth):
    slm = slm_of(bitdepth)
    display = eyebox.slmsuite.display_of(slm, "40cm")
    assert display.levels == 2**bitdepth
    levels = eyebox.slmsuite.levels(grating(display, 64), slm)
    assert levels.dtype == (np.uint8 if bitdepth <= 8 else np.uint16)
    off = (levels[0, 0] / 2**bitdepth - np.arange(COLUMNS) / 64 + 0.5) % 1 - 0.5
    assert np.abs(off).max() <= 0.5 / 2**bitdepth + 1e-6
    slm.set_phase(levels[0])


def test_an_slm_states_its_table():
    slm = slm_of(wav_design_um=0.65)
    display = eyebox.slmsuite.display_of(slm, 0.4)
    # At a shorter wavelength, fewer levels are a wave.
    assert eyebox.slmsuite.levels(grating(display), slm).max() < 256 * 0.52 / 0.65
    assert display.wavelengths == {"green": pytest.approx(520e-9)} and display.resolution == (ROWS, COLUMNS)
    assert display.pitch == pytest.approx(8e-6) and display.focal_length == 0.4
    gamma = 1.25 * (np.arange(256) / 256) ** 2
    slm.set_gamma(gamma)
    display = eyebox.slmsuite.display_of(slm, 0.4)
    levels = eyebox.slmsuite.levels(grating(display), slm)[0, 0]
    off = (gamma[levels] - np.arange(COLUMNS) / 8 + 0.5) % 1 - 0.5
    assert np.abs(off).max() < 0.01
    with named(ValueError, "slm", "8.0", "9.0"):
        eyebox.slmsuite.display_of(slm_of(pitch_um=(8, 9)), 0.4)


@pytest.mark.parametrize("bitdepth", [8, 10])
def test_the_encoding_of_the_display_is_used_apart_from_its_video_frames(bitdepth):
    slm = slm_of(bitdepth)
    display = eyebox.slmsuite.display_of(slm, 0.4)
    plain = eyebox.slmsuite.levels(grating(display), slm)
    turned = display.replace(encoding={"flip": "horizontal", "packing": "grey8", "channel": "green"})
    assert (eyebox.slmsuite.levels(grating(display), slm, display=turned) == plain[..., ::-1]).all()


def test_one_color_of_several_is_shown():
    slm = slm_of()
    display = eyebox.Display("small", size=(ROWS, COLUMNS))
    phases = {color: np.full((2, ROWS, COLUMNS), phase, np.float32) for color, phase in (("red", 0.5), ("blue", 1.5))}
    hologram = eyebox.Hologram.from_phases(phases, display, exposure=1.0)
    for color, phase in (("red", 0.5), ("blue", 1.5)):
        levels = eyebox.slmsuite.levels(hologram, slm, color)
        assert levels.shape == (2, ROWS, COLUMNS) and (levels == round(phase / (2 * np.pi) * 256)).all()
    for color in (None, "green", ["red", "blue"]):
        with named(ValueError, "color", "red", "blue"):
            eyebox.slmsuite.levels(hologram, slm, color)


def test_another_slm_is_refused():
    hologram = grating(eyebox.slmsuite.display_of(slm_of(), 0.4))
    with named(ValueError, "slm", "64", "48"):
        eyebox.slmsuite.levels(hologram, SimulatedSLM((ROWS, COLUMNS)))
    with named(ValueError, "slm", "1024", "256"):
        eyebox.slmsuite.levels(hologram, slm_of(10), display=eyebox.slmsuite.display_of(slm_of(), 0.4))
    with named(TypeError, "hologram"):
        eyebox.slmsuite.levels(hologram.phases, slm_of())


class RecordingSLM(SimulatedSLM):
    """An SLM with triggers that records its calls."""

    def __init__(self, **options):
        self.calls, self.fails_at = [], None
        super().__init__((COLUMNS, ROWS), wav_um=0.52, **options)
        self.calls.clear()

    def _set_phase_hw(self, display, timeout_s=1.0):
        self.calls.append(("write", int(display[0, 1]), timeout_s))
        if len([call for call in self.calls if call[0] == "write"]) == self.fails_at:
            raise RuntimeError("the cable")

    def set_input_trigger(self, on=False):
        self.calls.append(("input", on))

    def set_output_trigger(self, on=False):
        self.calls.append(("output", on))


@pytest.fixture
def sequence(tmp_path):
    """Solves a sequence of three holograms of two sub-frames."""
    import eyebox.cluster

    display = eyebox.slmsuite.display_of(slm_of(), 0.4)
    names = [f"builtin:plane?depth={depth}" for depth in range(3)]
    job = (tuple(names), (display.to_toml(), None), ("green",), "steps = 1\nframes = 2\npupils = 2", (30, 1), str(tmp_path / "film.zarr"), "cpu")
    for index in range(3):
        eyebox._cluster_work.piece(job, index)
    eyebox._eyebox.Sequence.finish(str(tmp_path / "film.zarr"))
    return tmp_path / "film.zarr"


def test_a_sequence_is_played_in_its_order(sequence):
    slm = RecordingSLM(settle_time_s=0.02)
    shown = []
    played = eyebox.slmsuite.play(sequence, slm, sets=2, callback=shown.append, timeout_s=3.0)
    assert [(one.hologram, one.sub_frame) for one in shown] == [(h, f) for h in range(3) for _ in range(2) for f in range(2)]
    want = [eyebox.slmsuite.levels(eyebox.Hologram.load(sequence, at), slm) for at in range(3)]
    assert slm.calls == [("write", int(want[one.hologram][one.sub_frame, 0, 1]), 3.0) for one in shown]
    assert (played.holograms, played.sub_frames) == (3, 12)
    # No pattern is shorter than the time in which the SLM settles.
    assert all(after.seconds - before.seconds >= 0.02 for before, after in zip(shown, shown[1:]))
    assert played.seconds >= 12 * 0.02


def test_content_repeats_until_it_is_ended(sequence):
    slm = RecordingSLM(settle_time_s=0.0)
    seen = []
    played = eyebox.slmsuite.play(sequence, slm, loop=True, callback=lambda at: seen.append(at) or len(seen) < 15)
    assert played.sub_frames == 15 and [one.hologram for one in seen[:8]] == [0, 0, 1, 1, 2, 2, 3, 3]
    assert eyebox.slmsuite.play(sequence, slm, loop=True, seconds="50ms").seconds >= 0.05
    assert eyebox.slmsuite.play([], slm, loop=True).sub_frames == 0


def test_triggers_are_on_while_content_is_played(sequence):
    slm = RecordingSLM(settle_time_s=0.0)
    eyebox.slmsuite.play(sequence, slm, input_trigger=True, output_trigger=True)
    assert slm.calls[:2] == [("input", True), ("output", True)] and slm.calls[-2:] == [("input", False), ("output", False)]
    slm.calls.clear()
    slm.fails_at = 3
    with pytest.raises(RuntimeError, match="cable"):
        eyebox.slmsuite.play(sequence, slm, output_trigger=True)
    assert slm.calls[0] == ("output", True) and slm.calls[-1] == ("output", False)
    with pytest.raises(NotImplementedError):
        eyebox.slmsuite.play(sequence, slm_of(), input_trigger=True)


def test_wrong_arguments_are_named(sequence):
    slm = RecordingSLM(settle_time_s=0.0)
    for error, name, wrong in (
        (ValueError, "sets", {"sets": 0}),
        (ValueError, "rate", {"rate": -1}),
        (TypeError, "rate", {"rate": "fast"}),
        (ValueError, "seconds", {"seconds": 0}),
        (TypeError, "callback", {"callback": 3}),
    ):
        with named(error, name):
            eyebox.slmsuite.play(sequence, slm, **wrong)
    with named(TypeError, "what", "3"):
        eyebox.slmsuite.play(3, slm)
    assert slm.calls == []


def test_a_bench_does_what_a_shot_says():
    slm, calls = RecordingSLM(settle_time_s=0.0), []
    camera = SimulatedCamera(slm, bitdepth=12, exposure_bounds_s=(1e-3, 2.0))
    flush = camera.flush
    camera.flush = lambda: (calls.append("flush"), flush())
    bench = eyebox.slmsuite.Bench(
        slm,
        camera,
        iris=lambda *at: calls.append(("iris", at)),
        iris_range=((-0.01, "10mm"), (-0.01, 0.01), (1e-3, 0.02)),
        focus=lambda depth: calls.append(("focus", depth)),
        focus_range=("-5mm", "5mm"),
        light=lambda color: calls.append(("light", color)),
    )
    assert bench.hello["camera"] == {"resolution": [ROWS, COLUMNS], "bits": 12, "dark": True, "exposure_ms": [1.0, 2000.0]}
    assert bench.hello["slm"] == {"resolution": [ROWS, COLUMNS], "levels": 256, "takes": ["levels"]}
    assert bench.hello["iris"]["x_mm"] == pytest.approx([-10, 10]) and bench.hello["focus_mm"] == pytest.approx([-5, 5])
    levels = np.full((1, ROWS, COLUMNS), 77, np.uint16)
    shot = eyebox.Shot(levels, "green", 520e-9, (1e-3, 0.0, 6e-3), 2e-3, 0.5, 3)
    picture = bench(shot)
    assert slm.calls == [("write", 77, 1.0)] and camera.get_exposure() == 0.5
    assert calls == [("light", "green"), ("iris", (1e-3, 0.0, 6e-3)), ("focus", 2e-3), "flush"]
    assert picture.shape == (ROWS, COLUMNS) and (picture == 3 * camera.get_image()).all()
    # Darkness shows no pattern.
    bench(shot._replace(show=None, color=None))
    assert len(slm.calls) == 1 and ("light", None) in calls


def test_a_bench_with_a_display_converts_phases():
    slm = slm_of()
    display = eyebox.slmsuite.display_of(slm, 0.4).replace(encoding={"two_pi_level": 128, "flip": "horizontal"})
    bench = eyebox.slmsuite.Bench(slm, SimulatedCamera(slm, bitdepth=12), display=display, iris=(0, 0, "6mm"))
    assert bench.hello["slm"]["takes"] == ["phases"] and bench.iris == pytest.approx((0, 0, 6e-3))
    phases = np.broadcast_to(2 * np.pi * np.arange(COLUMNS, dtype=np.float32) / COLUMNS, (1, ROWS, COLUMNS))
    bench(eyebox.Shot(phases, "green", 520e-9, (0.0, 0.0, 0.0), 0.0, None, 1))
    assert (slm.display[0] == 2 * np.arange(COLUMNS)[::-1]).all()
    for error, name, wrong in (
        (TypeError, "iris_range", {"iris_range": ((0, 1),) * 3}),
        (TypeError, "focus_range", {"focus": print}),
        (TypeError, "light", {"light": 3}),
        (ValueError, "iris", {"iris": (1, 2)}),
    ):
        with named(error, name):
            eyebox.slmsuite.Bench(slm, SimulatedCamera(slm), **wrong)


def test_eyebox_does_not_import_slmsuite():
    program = "import sys, eyebox, eyebox.slmsuite; sys.exit('slmsuite' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program]).returncode == 0
