"""Tests ten thousand calls with random arguments and a thousand solves. None of them crashes, and memory stays flat."""

import gc
import random

import eyebox
import numpy as np
from conftest import LONG, light_field

CALLS = 10_000
SIDE = 8

NUMBERS = [0, -0.0, 1e-3, -2e-3, 4e-3, 1, -1, 1e9, 1e300, -1e300, 1e-300, float("nan"), float("inf"), 10**30, True]
TEXTS = ["", "tiny.toml", "builtin:plane", "builtin:nothing", "/", "/dev/null", "nowhere.zarr", "cpu", "CPU", "\0", "\udcff", "é" * 99]
OTHERS = [None, [], {}, (), object(), b"bytes", {"a": 1}, [[1.0], [1, 2]], lambda *_: None, range(3), {1, 2}, 3j, int]
ARRAYS = [
    np.zeros((SIDE, SIDE)),
    np.zeros((2, 2, SIDE, SIDE)),
    np.full((SIDE, SIDE), np.nan),
    np.full((SIDE, SIDE, 3), -1.0),
    np.zeros((2, 0, 3)),
    np.zeros(()),
    np.zeros((1,) * 8),
    np.zeros((SIDE, SIDE), complex),
    np.zeros((SIDE, SIDE), "S3"),
    np.zeros((SIDE, SIDE), "M8[s]"),
    np.zeros((SIDE, SIDE), [("a", "f4")]),
    np.broadcast_to(np.float32(1), (2, 2, SIDE, SIDE)),
    np.zeros((1, SIDE, SIDE), np.float16),
    np.zeros((SIDE, 2 * SIDE))[:, ::-2],
    np.ma.masked_all((SIDE, SIDE)),
    np.zeros((SIDE, SIDE), np.uint8),
]
LAYERS = np.ones((2, SIDE, SIDE, 2), np.float32)
SETTINGS = ["steps", "frames", "pupils", "seed", "depth", "diameter", "psnr", "levels", "storage", "padding", "quality", "nothing", ""]


def test_whatever_is_called_with_ends_with_an_exception_or_a_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = random.Random(21)
    display = eyebox.Display("planes8", size=(SIDE, SIDE))
    other = eyebox.Display("planes8", size=(SIDE, 2 * SIDE))
    (tmp_path / "tiny.toml").write_text(display.to_toml())
    scene = eyebox.Scene("builtin:plane", display, "green", views=2)
    hologram = eyebox.solve(scene, display, frames=8, steps=1, pupils=1)
    refiner = eyebox.Refiner(hologram)
    short = {"steps": 1, "frames": 1, "pupils": 1}

    def whatever():
        return rng.choice(rng.choice([NUMBERS, TEXTS, OTHERS, ARRAYS, [display, other, scene, hologram, refiner]]))

    def number():
        return rng.choice([1e-3, 4e-3, 0.0]) if rng.random() < 0.7 else whatever()

    def often(usual):
        return usual if rng.random() < 0.6 else whatever()

    def shown():
        # The value None selects a display of two million pixels.
        given = often(display)
        return display if given is None else given

    def settings():
        given = {rng.choice(SETTINGS): rng.choice([whatever(), [number(), number()]]) for _ in range(rng.randrange(3))}
        # The steps must be few, because the solve takes all of them.
        few = lambda v: not isinstance(v, (int, float, np.ndarray)) or isinstance(v, bool) or not 8 < v < 1e18
        return {**short, **{key: v for key, v in given.items() if key not in short or isinstance(v, int) and few(v)}}

    names = ["scene", "output", "monitor", "rate", "step_time", "queue", "loop", "speed", "focus", "latency", "restart", "color", "seed"]
    followed = eyebox.show(hologram, display, eye="own", queue=1, engine="cpu")

    def show():
        how = {name: number() for name in rng.sample(names, 2)}
        with eyebox.show(often(hologram), shown(), clock="simulated", seconds=0.02, **how) as session:
            session.frame(often(0.0))

    calls = [
        # Each session has its own threads.
        lambda: show() if rng.random() < 0.2 else eyebox.show(whatever(), display),
        lambda: followed.look(number(), number(), often(None), velocity=often(None), age=number()),
        lambda: followed.frame(0.0 if rng.random() < 0.6 else "soon"),
        lambda: followed.seek(often(1)) or followed.steer(whatever()) or followed.status["steps"],
        lambda: eyebox.Display(often("planes8"), size=often((SIDE, SIDE)), **({rng.choice(["levels", "x"]): whatever()})),
        lambda: eyebox.Engine(whatever()),
        lambda: eyebox.Scene(whatever(), shown(), often("green"), views=rng.choice([None, 2, whatever()])),
        lambda: eyebox.Scene(rng.choice(ARRAYS), shown(), often("green"), view_pitch=rng.choice([None, number()])),
        lambda: eyebox.solve(often(scene), shown(), often(None), engine=often("cpu"), **settings()),
        lambda: eyebox.Hologram.load(whatever(), often(None)),
        lambda: eyebox.Hologram.from_phases(whatever(), shown(), often("green"), scene=often(None)),
        lambda: hologram.view(number(), number(), number(), number(), engine=often("cpu")),
        lambda: hologram.score(often(None), often([(0.0, number(), 4e-3, number())])),
        lambda: hologram.score(None, often(rng.choice(["random:1", "paper", "random:-1", "x"])), jod=often(False), seed=often(None)),
        lambda: eyebox.random_pupils(shown(), often(2), often(3), depth=often((number(), number())), diameter=often(None)),
        lambda: eyebox.paper_pupils(shown(), often((number(), number())), count=often(2)),
        lambda: eyebox.plan(often(scene), shown(), often(None), engine=often("cpu"), **settings()),
        lambda: eyebox.read(whatever(), often(None)),
        lambda: eyebox.Scene(rng.choice(ARRAYS), shown(), often("green"), depth_map=rng.choice(ARRAYS), views=2, depth=often(None), near=often(None)),
        lambda: eyebox.Scene.from_layers(often(LAYERS), often([number(), number()]), shown(), often("green"), views=often(2)),
        lambda: eyebox.Scene.from_focal_stack(often(LAYERS[..., 0]), often([0.0, number()]), number(), shown(), often("green")),
        lambda: eyebox.Scene(whatever(), shown(), often("green"), views=2, view_synthesis=often(None), order=often(None)),
        lambda: scene.contact_sheet(often(40)) if rng.random() < 0.5 else scene.measure(),
        lambda: eyebox.Display(often("planes8"), size=(SIDE, SIDE), color=often("green")),
        lambda: hologram.score(pupils=[(0.0, 0.0, 4e-3, 0.0)]).summary(often("psnr")),
        lambda: hologram.encode(shown()),
        lambda: hologram.refine(often((0, 0, number(), 0)), often(1), scene=often(None)),
        lambda: refiner.aim(number(), number(), number(), number(), spread=number()),
        lambda: refiner.step(often(1) if rng.random() < 0.9 else whatever(), often(None)),
        lambda: eyebox.photograph(often(scene), number(), number(), number(), number(), display=shown()),
        lambda: eyebox.Refiner(often(hologram), often(None), **({"pupils": whatever()} if rng.random() < 0.5 else {})),
    ]
    outcomes = {"results": 0}
    for _ in range(CALLS):
        try:
            rng.choice(calls)()
            outcomes["results"] += 1
        except Exception as error:  # A panic is no Exception, so it ends the test.
            assert str(error), repr(error)
            outcomes[type(error).__name__] = outcomes.get(type(error).__name__, 0) + 1
    assert followed.running and followed.stop()["ended_by"] == "a stop"
    assert outcomes["results"] > CALLS // 10 and outcomes["TypeError"] > CALLS // 20
    ours = {"DisplayError", "SceneError", "SolveError", "HologramError", "ValueError"}
    assert ours <= outcomes.keys(), outcomes
    assert not [left for left in tmp_path.iterdir() if left.suffix == ".zarr"]


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
