"""Tests thousands of calls with any arguments and a thousand solves. None of them crashes or hangs, and memory stays flat."""

import contextlib
import faulthandler
import gc
import os
import random
import shutil
import signal

import eyebox
import eyebox.cluster
import eyebox.slmsuite
import numpy as np
import pytest
from conftest import LONG, light_field
from whatever_calls import ENDING, SIDE, Calls, NoUsualValue

#: Number of calls. The same calls are made on every machine.
CALLS = 10_000 if LONG else 600
#: Seconds of a call that hangs, on the slowest machine.
HANG = 600


class Pressed(KeyboardInterrupt):
    """Ctrl-C at any time."""


@contextlib.contextmanager
def pressed(after):
    """Presses ctrl-C after some seconds, unless the block ends earlier."""

    def press(*_):
        raise Pressed

    before = signal.signal(signal.SIGALRM, press)
    try:
        signal.setitimer(signal.ITIMER_REAL, after)
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def empty(kind):
    """Returns an object whose constructor never ran."""
    return object.__new__(kind)


class Plain:
    """An SLM and a camera with the attributes of slmsuite."""

    shape, bitdepth, dtype, name = (SIDE, SIDE), 1, np.uint8, "plain"
    pitch_um, wav_um, wav_design_um, phase_scaling, settle_time_s = (8.0, 8.0), 0.52, 0.52, 1.0, 0.0

    def set_phase(self, *_, **__):
        return np.zeros(self.shape, np.uint8)


def no_picture(shot):
    raise RuntimeError("no picture")


@pytest.fixture
def calls(tmp_path, monkeypatch):
    """Returns the calls, with objects of every class. Some are finished, never constructed, or without their files."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    display = eyebox.Display("planes8", size=(SIDE, SIDE))
    other = eyebox.Display("planes8", size=(SIDE, 2 * SIDE))
    (tmp_path / "tiny.toml").write_text(display.to_toml())
    np.save("views.npy", light_field(2, 2, 3)[..., :SIDE, :SIDE])
    shutil.copy("views.npy", "lost.npy")
    scene, lost = eyebox.Scene("builtin:plane", display, "green", views=2), eyebox.Scene("lost.npy", display, "green")
    hologram = eyebox.solve(scene, display, frames=8, steps=1, pupils=1, engine="cpu")
    hologram.save("one.zarr")
    orphan = eyebox.solve(lost, display, frames=8, steps=1, pupils=1, depth=(0, 0), engine="cpu")
    os.remove("lost.npy")
    refiner, settings = eyebox.Refiner(hologram, engine="cpu"), eyebox.SolveSettings(steps=1, frames=1, pupils=1)
    followed = eyebox.show(hologram, display, eye="own", queue=1, engine="cpu")
    ended = eyebox.show(hologram, display, clock="simulated")
    ended.stop()
    scores = hologram.score(pupils=[(0, 0, 4e-3, 0)], engine="cpu")
    pupil = [(0.0, 0.0, 4e-3, 0.0)]
    objects = {
        "eyebox.Calibration": [eyebox.Calibration(display, {"parameters": []})],
        "eyebox.Display": [display, display, other, empty(eyebox.Display)],
        "eyebox.Engine": [eyebox.Engine("cpu"), empty(eyebox.Engine)],
        "eyebox.Hologram": [hologram, hologram, orphan, empty(eyebox.Hologram)],
        "eyebox.Refiner": [refiner, refiner, empty(eyebox.Refiner)],
        "eyebox.Scene": [scene, scene, lost, empty(eyebox.Scene)],
        "eyebox.Scores": [scores, eyebox.Scores([], [])],
        "eyebox.Session": [followed, followed, ended, empty(eyebox.Session)],
        "ended eyebox.Session": [ended],
        "eyebox.SolveSettings": [settings],
        "eyebox.slmsuite.Bench": [empty(eyebox.slmsuite.Bench)],
    }
    usual = {
        "scene": [scene, scene, None, "builtin:plane", "views.npy", "builtin:nothing"],
        "source": ["builtin:plane", "views.npy", light_field(2, 2, 3)],
        "scenes": [["builtin:plane"], ["builtin:plane", "builtin:nothing"]],
        "display": [display, display, display, other, "tiny.toml"],
        "color": [None, "green", "green", ["red", "green"]],
        "hologram": [hologram, hologram, orphan],
        "holograms": [["one.zarr"]],
        "seek.holograms": [1, -1],
        "what": [hologram, "one.zarr"],
        "path": ["one.zarr", "views.npy"],
        "save.path": ["saved.zarr", "saved", "/proc/x.zarr"],
        "phases": [{"green": np.ones((2, SIDE, SIDE))}, np.ones((SIDE, SIDE))],
        "layers": [np.ones((2, SIDE, SIDE, 2), np.float32)],
        "depths": [[0.0, "0.1mm"]],
        "pictures": [np.ones((2, SIDE, SIDE), np.float32)],
        "from_focal_stack.focus": [[0.0, "1mm"]],
        "keys": [[{"t": 0, "x": "1mm"}, {"t": 0.05}]],
        "grid": [[{"frames": 1, "steps": 1, "pupils": 1}]],
        "settings": [None, settings],
        "pupil": [pupil[0], eyebox.Pupil(x=1e-3)],
        "pupils": [1],
        "score.pupils": [None, pupil, pupil, "random:1"],
        "evaluate.pupils": [None, pupil],
        "tradeoff.pupils": [None, pupil],
        "forward.pupils": [pupil],
        "out": ["out.zarr"],
        "evaluate.out": ["scores.json"],
        "tradeoff.out": ["grid.json"],
        "tradeoff.scene": ["builtin:plane"],
        "film.out": ["out.y4m", "out"],
        "frames": [1, 8],
        "steps": [1],
        "views": [2, None],
        "solve.views": [None],
        "plan.views": [None],
        "from_layers.views": [2],
        "show.views": [2],
        "seed": [None, None, 3],
        "rng": [None, None, 5],
        "engine": ["cpu"],
        "choice": ["cpu", "auto"],
        "callback": [None, lambda *_: None, lambda *_: False],
        "on_light": [None, lambda light: None],
        "progress": [None, False],
        "camera": [None, no_picture],
        "eyebox.slmsuite.Bench.__init__.camera": [Plain()],
        "camera_steps": [1],
        "hello": [None, {"camera": {"resolution": [SIDE, SIDE], "bits": 8}, "slm": {"takes": ["phases"]}}],
        "captures": [None, "captures"],
        "most": [12],
        "contact_sheet.most": [1, 40],
        "full_scale": [None, 255.0],
        "iris": [None, (0.0, 0.0, "4mm")],
        "iris_range": [None],
        "focus": [0.0, "0.5D"],
        "focus_range": [None],
        "light": [None],
        "exposures": [None, ("1ms", 1.0)],
        "slm": [Plain()],
        "eyebox.slmsuite.Bench.__init__.display": [None],
        "eyebox.slmsuite.Bench.__init__.focus": [None],
        "eyebox.slmsuite.levels.display": [None],
        "eyebox.slmsuite.show.display": [None],
        "eyebox.slmsuite.play.display": [None],
        "sets": [1],
        "sub_frame": [0, -1, 8],
        "x": [0.0, 1e-3, "-1mm"],
        "y": [0.0, "1mm"],
        "diameter": [4e-3, "4mm"],
        "random_pupils.diameter": [None, ("2mm", 4e-3)],
        "settings.diameter": [None, ("2mm", 4e-3)],
        "depth": [0.0, "0.5D"],
        "random_pupils.depth": [(0.0, "1mm")],
        "paper_pupils.depth": [(0.0, "1mm")],
        "eyebox.Scene.__init__.depth": [None],
        "settings.depth": [None, (0.0, "0.5D")],
        "aperture": ["4mm"],
        "view_pitch": [None, "1mm"],
        "spread": [0.0, "0.1mm"],
        "velocity": [None, (0.0, 1e-3)],
        "age": [0.0, "1ms"],
        "timeout": [0.0, "1ms"],
        "focal_length": [0.4, "40cm"],
        "exposure": [None, 1.0],
        "name": ["planes8", "mine"],
        "replace.name": [None, "mine"],
        "size": [(SIDE, SIDE), (SIDE, 2 * SIDE)],
        "variable": [None],
        "depth_map": [None, np.zeros((SIDE, SIDE), np.float32)],
        "near": [None, "bright", "small"],
        "order": [None, "transpose", "as-named"],
        "at": [None, 0, 1],
        "jod": [False],
        "viewing": [None],
        "sub_frame_rate": [None],
        "obstructed": [None, "lashes"],
        "display_of.color": [None, "green"],
        "output": ["offscreen"],
        "clock": ["simulated"],
        "eye": [None, "own"],
        "show.scene": [None],
        "monitor": [None, 0],
        "rate": [None, "60Hz", 30],
        "play.rate": [None, "1kHz"],
        "seconds": [0.02, "20ms"],
        "settings.seconds": [None, "1s"],
        "play.seconds": [None, 0.01],
        "wait.seconds": [0.0, "1ms"],
        "step_time": [None],
        "encode_time": [0.0],
        "latency": [0.0, "1ms"],
        "queue": [1, 4],
        "loop": [False],
        "speed": [1.0, 2.0],
        "restart": [0.5],
        "blinks": [(), ["10ms"]],
        "binning": [1, 2],
        "passes": [1],
        "memory": ["600MiB", 1 << 30],
        "picture": [SIDE],
        "workers": [1],
        "max_workers": [None],
        "count": [1, 2],
        "scores": [[], [scores[0]]],
        "score": ["psnr", "ssim"],
        "eyebox.Scores.__init__.pupils": [[], pupil],
        "groups": [None, ["one"]],
    }
    with contextlib.ExitStack() as stack:
        usual["client"] = [stack.enter_context(distributed.Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None))]
        stack.callback(followed.stop)
        _live(stack, display, objects, usual)
        _torch(display, objects, usual, pupil)
        yield Calls(random.Random(21), objects, usual), followed


def _live(stack, display, objects, usual):
    """Adds an application and a display that shows it, if the system has shared memory for them."""
    try:
        import eyebox.live as live
    except ImportError:
        return
    stack.enter_context(eyebox.show("live:fuzz", display, color="green", queue=0, engine="cpu"))
    there = stack.enter_context(live.Live("fuzz"))
    closed = empty(live.Live)
    frame = there.color_and_depth(live.U8)
    objects |= {"eyebox.live.Live": [there, there, closed], "ended eyebox.live.Live": [closed]}
    usual |= {
        "eyebox.live.Live.__init__.name": ["fuzz", "nobody"],
        "rows": [1, 2],
        "columns": [1, 2],
        "views.view_pitch": ["1mm"],
        "sample": list(live.Sample),
        "transfer": list(live.Transfer),
        "eyebox.live.Live.layers.diopters": [[0.0, "0.5D"]],
        "frame": [frame],
        "samples": [np.zeros(frame.shape, np.uint8), np.zeros(frame.shape, np.uint8), bytes(3)],
        "diopters": [np.zeros(there.size)],
        "request": [None],
        "content_time": [None, "1s"],
        "center": [(0.0, "1mm")],
    }


def _torch(display, objects, usual, pupil):
    """Adds a model for PyTorch, if it is installed."""
    try:
        import eyebox.torch
        import torch
    except ImportError:
        return
    objects["eyebox.torch.ForwardModel"] = [eyebox.torch.ForwardModel(display, "green", 1, engine="cpu")]
    usual |= {"forward.phases": [torch.zeros(1, SIDE, SIDE)]}
    usual |= {"eyebox.torch.ForwardModel.__init__.color": ["green"], "eyebox.torch.ForwardModel.__init__.exposure": [1.0]}


def test_whatever_is_called_with_ends_with_an_exception_or_a_result(calls, tmp_path):
    made, followed = calls
    outcomes, reached = {"results": 0}, set()
    # Each function is called at least twice.
    names = made.names * 2 + [made.rng.choice(made.names) for _ in range(CALLS - 2 * len(made.names))]
    for name in names:
        interrupted = made.rng.random() < 0.05
        faulthandler.dump_traceback_later(HANG, exit=True)
        try:
            with pressed(0.05 * made.rng.random()) if interrupted else contextlib.nullcontext():
                result = made.call(name)
            outcomes["results"] += 1
            reached.add(name)
            if isinstance(result, eyebox.Session):
                result.stop()
        except KeyboardInterrupt:
            assert interrupted, name
            outcomes["KeyboardInterrupt"] = outcomes.get("KeyboardInterrupt", 0) + 1
        except NoUsualValue:
            raise
        except Exception as error:  # A panic is no Exception, so it ends the test.
            assert str(error) or isinstance(error, (MemoryError, NotImplementedError)), (name, repr(error))
            outcomes[type(error).__name__] = outcomes.get(type(error).__name__, 0) + 1
        finally:
            faulthandler.cancel_dump_traceback_later()
    assert followed.running and followed.stop()["ended_by"] == "a stop"
    # The arguments are often right, so calls get past their first checks.
    assert outcomes["results"] > CALLS // 4 and outcomes["TypeError"] > CALLS // 50, outcomes
    ours = {"DisplayError", "SceneError", "HologramError", "ValueError", "KeyboardInterrupt"}
    assert ours <= outcomes.keys(), outcomes
    assert len(reached) > 0.75 * len(made.names), set(made.names) - reached
    assert not list(tmp_path.glob(".eyebox-*"))


def test_every_public_function_is_called(calls):
    """A new function needs an object or usual values of its arguments here."""
    made, _ = calls
    assert len(made.names) > 90 and ENDING & set(made.names)
    for name in made.names:
        for _ in range(20):
            made.arguments(name, made.functions[name])


def resident_kib():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4


def test_solves_leave_memory_flat(display):
    """A leak of only the phases would be 60 KiB per solve."""
    views = light_field(3, 3, 0)

    def solves(count):
        for seed in range(count):
            short = dict(frames=8, steps=1, pupils=1, depth=(0, 0), engine="cpu")
            hologram = eyebox.solve(views, display, color="green", seed=seed, **short)
            hologram.phases["green"].mean()
            hologram.view()
            hologram.encode(display)
        gc.collect()
        return resident_kib()

    count = 1000 if LONG else 150
    first = solves(max(count // 5, 60))
    assert solves(count) - first < 20 * count / 2
