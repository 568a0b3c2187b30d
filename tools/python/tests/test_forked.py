"""Tests processes of every start method. Children compute or get an error of one line, and never hang."""

import functools
import multiprocessing
import os
import subprocess
import sys
import textwrap

import eyebox
import numpy as np
import pytest
from conftest import light_field

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")

SIZE = eyebox.Display("small", size=(32, 32))
HOW = dict(color="green", frames=2, steps=3, pupils=4, seed=3, engine="cpu")


def solved(seed=3):
    return eyebox.solve("builtin:still-life", SIZE, **{**HOW, "seed": seed})


def bytes_of(seed):
    return solved(seed).phases["green"].tobytes()


@functools.cache
def parents():
    """Returns a hologram of the parent, whose solve uses all threads of the parent."""
    return solved()


def in_child(work, timeout=60):
    """Returns the answer of work in a forked child as text."""
    parents()
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            said = str(work())
        except BaseException as error:
            said = f"{type(error).__name__}: {error}"
        os.write(writing, said[:4096].encode())
        os._exit(0)
    os.close(writing)
    import select

    try:
        ready = select.select([reading], [], [], timeout)[0]
        assert ready, "the child hangs"
        return os.read(reading, 4096).decode()
    finally:
        os.kill(child, 9)
        os.waitpid(child, 0)
        os.close(reading)


#: Work that gives the same result in a child and in its parent.
WORK = {
    "solve": lambda: hash(bytes_of(3)),
    "solve twice": lambda: hash(bytes_of(4) + bytes_of(5)),
    "Scene": lambda: float(eyebox.Scene("builtin:still-life", SIZE, "green").views.sum()),
    "Scene of views": lambda: float(eyebox.Scene(np.ones((3, 3, 40, 40)), SIZE, "green").views.sum()),
    "photograph": lambda: float(eyebox.photograph("builtin:still-life", display=SIZE, color="green").sum()),
    "view": lambda: float(parents().view(engine="cpu").sum()),
    "view by the default engine": lambda: float(parents().view().sum()),
    "score": lambda: [round(score.psnr, 9) for score in parents().score(engine="cpu")],
    "encode": lambda: int(parents().encode(SIZE).sum()),
    "refine": lambda: hash(parents().refine((1e-3, 0, 4e-3, 0), 3, engine="cpu").phases["green"].tobytes()),
    "phases": lambda: float(parents().phases["green"].sum()),
    "from_phases": lambda: eyebox.Hologram.from_phases(np.ones((32, 32)), SIZE, "green", scene="builtin:plane").exposures,
    "a child of a child": lambda: in_child(lambda: hash(bytes_of(3))),
    "threads": lambda: in_threads(),
}


def in_threads():
    """Runs two solves at once that wait for each other in their callbacks."""
    import threading

    meet, made = threading.Barrier(2, timeout=30), {}

    def work(seed):
        def callback(step):
            if step.pilot is None and step.step == 2:
                meet.wait()

        made[seed] = eyebox.solve("builtin:plane", SIZE, **{**HOW, "seed": seed, "callback": callback}).phases["green"].sum()

    threads = [threading.Thread(target=work, args=(seed,)) for seed in (1, 2)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    return sorted(map(float, made.values()))


@pytest.mark.parametrize("what", WORK)
def test_a_forked_child_computes_what_its_parent_does(what):
    own = str(WORK[what]())
    assert in_child(WORK[what]) == own


def test_what_belongs_to_the_parent_is_refused_in_one_line():
    refiner = eyebox.Refiner(parents(), engine="cpu")
    with eyebox.show(parents(), SIZE, eye="own", engine="cpu") as session:
        refused = {
            "refiner": lambda: refiner.step(),
            "its hologram": lambda: refiner.hologram,
            "frame": lambda: session.frame(1.0),
            "look": lambda: session.look(0.0),
            "stop": lambda: session.stop(),
            "running": lambda: session.running,
            "show": lambda: eyebox.show(parents(), SIZE, clock="simulated").frame(),
        }
        for what, call in refused.items():
            said = in_child(call)
            assert said.startswith("EngineError: ") and "forked" in said and "spawn" in said, (what, said)
        assert session.running
    # The remedy of the message works, and the work of a child does not affect its parent.
    assert float(in_child(lambda: eyebox.Refiner(parents(), engine="cpu").step())) > 0 and refiner.step() > 0


@pytest.mark.parametrize(("method", "chunk"), [("fork", 1), ("fork", 4), ("spawn", 2), ("forkserver", 2)])
def test_a_pool_of_processes_works(method, chunk):
    want = [bytes_of(seed) for seed in range(8)]
    with multiprocessing.get_context(method).Pool(2) as pool:
        assert pool.map_async(bytes_of, range(8), chunk).get(timeout=120) == want


def facts(display, scene, hologram, pupil):
    """Returns facts of objects that a child of another start method gets by pickle."""
    return hologram.view(*pupil, engine="cpu").tobytes(), scene.photograph(*pupil, engine="cpu").tobytes(), display.to_toml()


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_objects_go_to_processes_that_are_not_forked(method):
    scene = eyebox.Scene(light_field(3, 3, 3), SIZE, "green")
    hologram = eyebox.solve(scene, SIZE, depth=(0, 0), **HOW)
    given = (SIZE, scene, hologram, eyebox.Pupil(1e-3, 0, 4e-3, 1e-3))
    with multiprocessing.get_context(method).Pool(1) as pool:
        assert pool.apply_async(facts, given).get(timeout=120) == facts(*given)


class Holograms:
    """A data set for the DataLoader of torch. Its workers load, render and score."""

    def __init__(self, files):
        self.files = files

    def __len__(self):
        return len(self.files)

    def __getitem__(self, index):
        hologram = eyebox.Hologram.load(self.files[index])
        return hologram.phases["green"], hologram.view(), [score.psnr for score in hologram.score()]


def work(data, asked, answers):
    while (index := asked.get()) is not None:
        answers.put((index, data[index]))


def test_workers_of_a_data_set_as_torchs(tmp_path):
    files = []
    for seed in range(4):
        files.append(tmp_path / f"{seed}.zarr")
        solved(seed).save(files[-1])
    data = Holograms(files)
    want = [data[index] for index in range(4)]
    context = multiprocessing.get_context("fork")
    asked, answers = context.Queue(), context.Queue()
    workers = [context.Process(target=work, args=(data, asked, answers), daemon=True) for _ in range(2)]
    [worker.start() for worker in workers]
    [asked.put(index) for index in [0, 1, 2, 3, None, None]]
    for _ in range(4):
        index, (phases, seen, scores) = answers.get(timeout=60)
        assert (phases == want[index][0]).all() and (seen == want[index][1]).all() and scores == want[index][2]
    for worker in workers:
        worker.join(30)
        assert worker.exitcode == 0


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
def test_the_data_loader_of_torch(method, tmp_path):
    data = pytest.importorskip("torch.utils.data", reason="PyTorch is not installed")
    files = []
    for seed in range(4):
        files.append(tmp_path / f"{seed}.zarr")
        solved(seed).save(files[-1])
    own = Holograms(files)
    loader = data.DataLoader(own, batch_size=2, num_workers=2, multiprocessing_context=method, timeout=120)
    batches = list(loader)
    assert len(batches) == 2
    for number, (phases, seen, scores) in enumerate(batches):
        for at in range(2):
            want = own[2 * number + at]
            assert (phases[at].numpy() == want[0]).all() and (seen[at].numpy() == want[1]).all()
            assert [float(score[at]) for score in scores] == want[2]


def test_a_child_leaves_by_itself():
    """A child ends by sys.exit, which drops the engines, refiners and sessions of the parent."""
    body = """
    import eyebox, os, sys
    small = eyebox.Display("small", size=(32, 32))
    hologram = eyebox.solve("builtin:plane", small, color="green", frames=1, steps=2)
    refiner, session = eyebox.Refiner(hologram), eyebox.show(hologram, small)
    child = os.fork()
    if child == 0:
        hologram.view()
        sys.exit(7)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), session.running, refiner.step() > 0)
    """
    ran = subprocess.run([sys.executable, "-c", textwrap.dedent(body)], capture_output=True, text=True, timeout=60)
    assert ran.stdout == "7 True True\n", ran.stderr


def test_vulkan_stays_with_the_parent():
    body = """
    import eyebox, os, sys
    try:
        engine = eyebox.Engine("vulkan")
    except eyebox.EngineError:
        print("no Vulkan")
        sys.exit()
    small = eyebox.Display("small", size=(32, 32))
    hologram = eyebox.solve("builtin:plane", small, color="green", frames=1, steps=2, engine=engine)
    refiner = eyebox.Refiner(hologram, engine=engine)
    if os.fork() == 0:
        for call in (lambda: hologram.view(engine=engine), lambda: eyebox.Engine("vulkan"), lambda: refiner.step()):
            try:
                call()
                print("taken")
            except eyebox.EngineError as error:
                assert "forked" in str(error)
        print(hologram.view().shape, "forked" in eyebox.Engine("auto").reason, flush=True)
        sys.exit()
    print(os.wait()[1], hologram.view(engine=engine).shape)
    """
    ran = subprocess.run([sys.executable, "-c", textwrap.dedent(body)], capture_output=True, text=True, timeout=120)
    if ran.stdout == "no Vulkan\n":
        pytest.skip("no Vulkan")
    assert ran.stdout == "(32, 32, 1) True\n0 (32, 32, 1)\n", ran.stderr
