"""Tests numbers of every type. Whole numbers need __index__, other numbers __float__, and a text is no number."""

import decimal
import fractions
import pathlib

import eyebox
import numpy as np
import pytest
from conftest import named


class Index:
    def __init__(self, value):
        self.value = value

    def __index__(self):
        return self.value


WHOLE = [int, np.int8, np.int32, np.int64, np.uint8, np.uint64, Index, np.array, lambda v: np.array(v, np.uint16), lambda v: v == 1 or v]
NO_WHOLE = [1.0, np.float64(1.0), "1", b"1", None, [1], np.array([1]), 1j, np.float32("nan"), decimal.Decimal(1)]
REAL = [float, np.float32, np.float64, np.float16, fractions.Fraction, decimal.Decimal, np.array, lambda v: np.array(v, np.float32), lambda v: np.longdouble(v), lambda v: memoryview(np.array(v))[()]]
NO_REAL = ["0.001", b"0.001", None, 1j, [1, 2], {}, np.zeros(2), object(), bytearray(b"1"), np.str_("1")]


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    import os
    import subprocess

    program = os.environ.get("EYEBOX")
    if not program or not pathlib.Path(program).exists():
        pytest.skip("EYEBOX names no program")
    out = tmp_path_factory.mktemp("sequence") / "x.zarr"
    scenes = [f"builtin:plane?depth={depth}" for depth in range(4)]
    how = "--display small --size 40x48 --color green --frames 1 --steps 2 --pupils 2 --engine cpu".split()
    subprocess.run([program, "solve", *scenes, *how, "-o", out], check=True, capture_output=True)
    return out


@pytest.mark.parametrize("kind", WHOLE)
@pytest.mark.parametrize("at", range(4))
def test_a_hologram_of_a_sequence_is_the_one_that_is_asked_for(sequence, kind, at):
    asked = eyebox.Hologram.load(sequence, at=kind(at))
    assert asked.scene == f"builtin:plane?depth={at}"


@pytest.mark.parametrize("wrong", NO_WHOLE[:4] + NO_WHOLE[5:])
def test_what_is_no_whole_number_opens_no_hologram(sequence, wrong):
    with named(TypeError, "at"):
        eyebox.Hologram.load(sequence, at=wrong)


def test_numbers_outside_the_sequence_are_refused(sequence):
    for wrong in (-1, np.int64(-1), 4, np.uint8(200), 1 << 50):
        with pytest.raises(ValueError):
            eyebox.Hologram.load(sequence, at=wrong)


@pytest.mark.parametrize("kind", WHOLE[:-1])
def test_whole_numbers_everywhere(kind, tmp_path):
    small = eyebox.Display("planes8", size=(kind(32), kind(48)))
    assert small.resolution == (32, 48) and eyebox.Scene("builtin:plane", small, "green", views=kind(3)).shape[:2] == (3, 3)
    made = eyebox.solve("builtin:plane", small, color="green", frames=kind(8), steps=kind(2), pupils=kind(2), seed=kind(5))
    same = eyebox.solve("builtin:plane", small, color="green", frames=8, steps=2, pupils=2, seed=5)
    assert made.phases["green"].tobytes() == same.phases["green"].tobytes()
    refined = made.refine((0, 0, 4e-3, 0), kind(2), seed=kind(1), pupils=kind(2))
    assert refined.phases["green"].tobytes() == made.refine((0, 0, 4e-3, 0), 2, seed=1, pupils=2).phases["green"].tobytes()
    with eyebox.show(made, small, clock="simulated", seconds=0.1, queue=kind(3)) as session:
        session.seek(kind(1))
        assert session.frame() is not None


@pytest.mark.parametrize("wrong", NO_WHOLE)
def test_what_is_no_whole_number_is_refused_everywhere(display, hologram, wrong):
    calls = [
        lambda: eyebox.Display("small", size=(wrong, 8)),
        lambda: eyebox.Scene("builtin:plane", display, views=wrong) if wrong is not None else int(None),
        lambda: hologram.refine((0, 0, 4e-3, 0), wrong),
        lambda: eyebox.show(hologram, display, queue=wrong),
        lambda: eyebox.calibrate(display, captures="nowhere", most=wrong),
        lambda: eyebox.calibrate(display, lambda shot: None, hello={"camera": {"bits": wrong}}),
    ]
    for call in calls:
        with pytest.raises(TypeError):
            call()
    with eyebox.show(hologram, display, clock="simulated") as session:
        with pytest.raises(TypeError):
            session.seek(wrong)


@pytest.mark.parametrize("kind", REAL)
def test_real_numbers_everywhere(display, hologram, kind):
    want = hologram.view(x=2e-3, diameter=4e-3, depth=float(np.float16(1e-3)))
    seen = hologram.view(x=kind(2e-3), diameter=kind(4e-3), depth=kind(np.float16(1e-3).item()))
    np.testing.assert_allclose(seen, want, atol=2e-2)
    assert hologram.score(pupils=[(kind(0), kind(0), kind(4e-3), kind(0))])[0].psnr > 5
    solved = eyebox.solve("builtin:plane", display, color="green", frames=1, steps=2, pupils=2, depth=(kind(0), kind(0)))
    assert solved.metadata["solve"]["depth"] == [0, 0] or solved.frames == 1


@pytest.mark.parametrize("wrong", NO_REAL)
def test_what_is_no_number_is_refused(display, hologram, wrong):
    calls = [
        lambda: hologram.view(x=wrong),
        lambda: hologram.view(diameter=wrong),
        lambda: hologram.score(pupils=[(0, 0, 4e-3, wrong)]),
        lambda: eyebox.show(hologram, display, focus=wrong),
        lambda: eyebox.show(hologram, display, latency=wrong),
        lambda: eyebox.photograph("builtin:plane", wrong, display=display, color="green"),
        lambda: eyebox.Refiner(hologram).aim(x=wrong),
        lambda: eyebox.Refiner(hologram).aim(spread=wrong),
    ]
    for call in calls:
        with pytest.raises((TypeError, ValueError)):
            call()


NAN = float("nan")


def test_numbers_that_are_none_are_refused_where_they_mean_nothing(display, hologram):
    refused = [
        lambda: hologram.view(x=NAN),
        lambda: hologram.view(depth=NAN),
        lambda: hologram.score(pupils=[(0, NAN, 4e-3, 0)]),
        lambda: eyebox.Refiner(hologram).aim(spread=NAN),
        lambda: eyebox.show(hologram, display, seconds=NAN),
        lambda: eyebox.show(hologram, display, rate=NAN),
        lambda: eyebox.show(hologram, display, latency=NAN),
        lambda: eyebox.show(hologram, display, eye="own", focus=NAN),
        lambda: eyebox.show(hologram, display, clock="simulated", eye="simulated", seconds=0.1, step_time=NAN),
        lambda: eyebox.show(hologram, display, clock="simulated", eye="simulated", seconds=0.1, step_time=1e-3, encode_time=NAN),
        lambda: eyebox.Scene(np.ones((2, 2, 8, 8)), display, view_pitch=NAN),
        lambda: eyebox.Scene("builtin:plane", display, view_pitch=NAN),
        lambda: eyebox.Hologram.from_phases(np.ones((40, 48)), display, "green", exposure=NAN),
        lambda: eyebox.solve("builtin:plane", display, color="green", seconds=NAN),
    ]
    taken = []
    for number, call in enumerate(refused):
        try:
            got = call()
            taken.append(number)
            if isinstance(got, eyebox.Session):
                got.stop()
        except (ValueError, TypeError):
            pass
    assert not taken
    with eyebox.show(hologram, display, eye="own", queue=1, engine="cpu") as session:
        for wrong in (dict(age=NAN), dict(age=-1), dict(diameter=4), dict(diameter=-1e-3), dict(x=2.0), dict(y=-3)):
            with pytest.raises(ValueError):
                session.look(**{"x": 0.0, **wrong})
        with pytest.raises(ValueError):
            session.frame(NAN)
        # NaN is valid for a closed eye and for an unknown diameter.
        session.look(NAN, NAN)
        session.look(0.0, diameter=NAN)


def test_paths_of_every_kind(tmp_path, hologram):
    class Path:
        def __fspath__(self):
            return str(tmp_path / "x.zarr")

    for path in (Path(), tmp_path / "x.zarr", str(tmp_path / "x.zarr"), str(tmp_path / "x.zarr").encode()):
        hologram.save(path)
        assert eyebox.Hologram.load(path).shape == hologram.shape
    with eyebox.show(Path(), eyebox.Display("planes8", size=(40, 48)), clock="simulated", seconds=0.1) as session:
        assert session.frame() is not None
    # The tracker is a recording, named by its path.
    (tmp_path / "eye.jsonl").write_text('{"time_s": 0.0, "pupil_mm": [0, 0]}\n')
    try:
        eyebox.show(hologram, eyebox.Display("planes8", size=(40, 48)), eye=tmp_path / "eye.jsonl", engine="cpu").stop()
    except eyebox.EyeboxError:
        pass
