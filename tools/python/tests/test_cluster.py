"""Tests work on two processes. If one of them is killed, the files still have the bytes of one process."""

import contextlib
import functools
import json
import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import threading
import time

import eyebox
import numpy as np
import pytest

distributed = pytest.importorskip("distributed")
import eyebox.cluster  # noqa: E402
from eyebox import _cluster_pool  # noqa: E402
from conftest import coded, light_field, LONG, named  # noqa: E402

COUNT = 64 if LONG else 8

FAR_FIELD = """
name = "far"
resolution = [320, 320]
pitch_um = 4.0
focal_length_mm = 400.0
wavelengths_nm = { green = 520 }
geometry = "far-field"
"""


def files(folder):
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def one_process(scenes, out):
    program = os.environ.get("EYEBOX")
    if not program or not pathlib.Path(program).exists():
        pytest.skip("EYEBOX names no program")
    settings = "--display small --size 40x48 --color green --frames 2 --steps 40 --pupils 4 --seed 7 --engine cpu".split()
    subprocess.run([program, "solve", *scenes, *settings, "--warm-start", "cold", "-o", out], check=True, capture_output=True)


def test_one_of_two_workers_is_killed(tmp_path):
    display = eyebox.Display("small", size=(40, 48))
    scenes = [f"builtin:plane?depth={depth / COUNT}" for depth in range(COUNT)]
    settings = dict(frames=2, steps=40, pupils=4, seed=7)
    out = tmp_path / "cluster.zarr"
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        with distributed.Client(local) as client:
            killed = []

            def kill():
                while len(list(out.glob("phases/c/*/0/0/0/0"))) < 2:
                    time.sleep(0.005)
                victim = next(iter(local.workers.values())).pid
                os.kill(victim, signal.SIGKILL)
                killed.append(victim)

            thread = threading.Thread(target=kill, daemon=True)
            thread.start()
            how = dict(client=client, engine="cpu", **settings)
            assert eyebox.cluster.solve_sequence(scenes, out, display, "green", **how) == COUNT
            thread.join()
            assert killed
            # Finished work is not repeated. If a sequence loses two holograms, only these two are solved.
            before = files(out)
            assert eyebox.cluster.solve_sequence(scenes, out, display, "green", **how) == 0 and files(out) == before
            for lost in (1, COUNT - 1):
                (out / f"phases/c/{lost}/0/0/0/0").unlink()
            assert eyebox.cluster.solve_sequence(scenes, out, display, "green", **how) == 2 and files(out) == before
            # Other settings are refused, and no file changes.
            with coded(eyebox.EyeboxError, "hologram/other-sequence/other-setting"):
                eyebox.cluster.solve_sequence(scenes, out, display, "green", **{**how, "steps": 3})
            assert files(out) == before
    one_process(scenes, tmp_path / "one.zarr")
    assert files(out) == files(tmp_path / "one.zarr")


def test_scores_and_trade_offs_are_those_of_one_process(tmp_path, hologram, display):
    files = [tmp_path / "a.zarr", tmp_path / "b.zarr"]
    other = eyebox.solve("builtin:still-life", display, "green", frames=8, steps=1, pupils=2, seed=3, engine="cpu")
    for file, one in zip(files, (hologram, other)):
        one.save(file)
    pupils = [(0, 0, 4e-3, 0), (2e-3, 0, 4e-3, 1e-3)]
    grid = [dict(frames=8, steps=1, pupils=2, seed=3), dict(frames=8, steps=2, pupils=2, seed=3)]
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        with distributed.Client(local) as client:
            how = dict(client=client, engine="cpu")
            found = eyebox.cluster.evaluate(files, tmp_path / "scores.json", pupils, keep_pieces=True, **how)
            solved = eyebox.cluster.tradeoff("builtin:still-life", tmp_path / "grid.json", grid, display, "green", pupils=pupils, **how)
            # Finished work is not repeated.
            piece = tmp_path / "scores.json.pieces" / "000001.json"
            piece.write_text('{"kept": 1}')
            assert eyebox.cluster.evaluate(files, tmp_path / "scores.json", pupils, **how) == [found[0], {"kept": 1}]
            with pytest.raises(eyebox.HologramError):
                eyebox.cluster.evaluate([tmp_path / "nothing.zarr"], tmp_path / "none.json", **how)
    own = [[score._asdict() for score in one.score(pupils=pupils, engine="cpu")] for one in (hologram, other)]
    assert [one["scores"] for one in found] == own and [one["hologram"] for one in found] == [str(file) for file in files]
    assert solved[0]["scores"] == own[1] and solved[1]["settings"] == grid[1] and solved[1]["seconds"] > 0
    assert json.loads((tmp_path / "grid.json").read_text()) == solved and not (tmp_path / "grid.json.pieces").exists()
    with named(ValueError, ".json", "scores.zarr"):
        eyebox.cluster.evaluate(files, tmp_path / "scores.zarr")
    with named(TypeError, "grid"):
        eyebox.cluster.tradeoff("builtin:plane", tmp_path / "x.json", [3], display)


def test_arrays_are_scenes(tmp_path):
    """Arrays are stored next to the result, where all workers see them, and finished work is not repeated."""
    display = eyebox.Display("small", size=(40, 48))
    views = np.stack([light_field(2, 3, seed) for seed in range(3)])
    settings = dict(frames=2, steps=3, pupils=4, seed=7, engine="cpu")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        with distributed.Client(local) as client:
            out = tmp_path / "film.zarr"
            assert eyebox.cluster.solve_sequence(views, out, display, "green", client=client, **settings) == 3
            before = files(tmp_path)
            assert eyebox.cluster.solve_sequence(list(views), out, display, "green", client=client, **settings) == 0
            assert files(tmp_path) == before
            assert sorted(path.name for path in (tmp_path / "film.zarr.scenes").iterdir()) == [f"{i:06}.npy" for i in range(3)]
            how = dict(client=client, engine="cpu")
            found = eyebox.cluster.evaluate([out], tmp_path / "scores.json", [(0, 0, 4e-3, 0)], **how)
            grid = [dict(frames=2, steps=3, pupils=4, seed=7)]
            solved = eyebox.cluster.tradeoff(views[0], tmp_path / "grid.json", grid, display, "green", pupils=[(0, 0, 4e-3, 0)], **how)
    for at, each in enumerate(views):
        hologram, scene = eyebox.Hologram.load(out, at), eyebox.Scene(each, display, "green")
        own = hologram.score(scene, [(0, 0, 4e-3, 0)], other_scene=True, engine="cpu")
        assert found[at]["scores"][0]["psnr"] == pytest.approx(own[0].psnr)
    assert solved[0]["scores"][0]["psnr"] > 5
    with named(TypeError, "scene", "7"):
        eyebox.cluster.solve_sequence([7], tmp_path / "other.zarr", display)
    with named(TypeError, "scene", "int64"):
        eyebox.cluster.solve_sequence([views[0].astype(int)], tmp_path / "other.zarr", display)


def test_a_refusal_is_one_exception_without_lines_of_dask(tmp_path):
    text = """
        import eyebox.cluster, sys
        if __name__ == "__main__":
            display = eyebox.Display("small", size=(40, 48))
            scenes = ["builtin:plane", "builtin:nothing", *[f"builtin:plane?depth={n}" for n in range(20)]]
            try:
                eyebox.cluster.solve_sequence(scenes, sys.argv[1], display, "green", steps=1, frames=1, workers=1, max_workers=2, engine="cpu")
            except eyebox.EyeboxError as error:
                print(error.code, type(error).__name__)
    """
    file = tmp_path / "refused.py"
    file.write_text(textwrap.dedent(text))
    ran = subprocess.run([sys.executable, file, tmp_path / "x.zarr"], capture_output=True, text=True, timeout=120)
    assert ran.stdout.split()[0].startswith("scene/") and ran.stdout.split()[1] == "SceneError", ran
    assert ran.stderr == ""


def test_workers_are_added_for_more_work(tmp_path):
    """The default cluster begins with one worker and adapts to the work, up to ``max_workers``."""
    display, seen, ended = eyebox.Display("small", size=(64, 64)), [], threading.Event()

    def watch():
        while not ended.wait(0.02):
            with contextlib.suppress(ValueError):  # There is no cluster yet.
                seen.append(len(distributed.get_client().scheduler_info()["workers"]))

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        scenes = [f"builtin:plane?depth={depth / 48}" for depth in range(48)]
        how = dict(frames=4, steps=150, pupils=8, engine="cpu", workers=1, max_workers=2)
        assert eyebox.cluster.solve_sequence(scenes, tmp_path / "film.zarr", display, "green", **how) == 48
    finally:
        ended.set()
        thread.join()
    assert max(seen) == 2 and min(one for one in seen if one) == 1


def test_what_makes_no_sense(tmp_path):
    with named(TypeError, "max_workers", "adapt"):
        eyebox.cluster.solve_sequence(["builtin:plane"], tmp_path / "x.zarr", client=object(), max_workers=3)
    with named(ValueError, "max_workers", "1"):
        eyebox.cluster.solve_sequence(["builtin:plane"], tmp_path / "x.zarr", workers=2, max_workers=1)
    with named(TypeError, "scenes", "'builtin:plane'"):
        eyebox.cluster.solve_sequence("builtin:plane", tmp_path / "x.zarr")
    with named(ValueError, "scenes"):
        eyebox.cluster.solve_sequence([], tmp_path / "x.zarr")
    with named(ValueError, ".zarr"):
        eyebox.cluster.solve_sequence(["builtin:plane"], tmp_path / "x")
    with named(TypeError, "rate", "'fast'"):
        eyebox.cluster.solve_sequence(["builtin:plane"], tmp_path / "x.zarr", rate="fast")
    assert not list(tmp_path.iterdir())


def test_a_far_fields_regions_are_solved_side_by_side(tmp_path):
    """One of two workers is killed, and the file still has the bytes of one process."""
    program = os.environ.get("EYEBOX")
    if not program or not pathlib.Path(program).exists():
        pytest.skip("EYEBOX names no program")
    (tmp_path / "far.toml").write_text(FAR_FIELD)
    display = eyebox.Display(tmp_path / "far.toml")
    settings = dict(frames=2, steps=2, passes=2, picture=32, memory=600 << 20, seed=5, diameter=(0.2e-3, 0.4e-3))
    out = tmp_path / "cluster.zarr"
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        with distributed.Client(local) as client:

            def kill():
                while len([name for name in out.glob("staged/*") if name.name.isdigit()]) < 4:
                    time.sleep(0.005)
                os.kill(next(iter(local.workers.values())).pid, signal.SIGKILL)

            thread = threading.Thread(target=kill, daemon=True)
            thread.start()
            visits = eyebox.cluster.solve_far_field("builtin:plane", out, display, client=client, engine="cpu", **settings)
            thread.join()
    assert visits > 10
    run = "--display far.toml --frames 2 --steps 2 --set tiles.passes=2 --set tiles.picture=32 --memory 600MiB --seed 5 --pupil-diameter 0.2..0.4 --engine cpu"
    command = [program, "solve", "builtin:plane", *run.split(), "-o", "one.zarr"]
    subprocess.run(command, check=True, capture_output=True, cwd=tmp_path)
    assert files(out) == files(tmp_path / "one.zarr")
    with coded(eyebox.EyeboxError, "produce/job/tiles-in-a-relay"):
        eyebox.cluster.solve_far_field("builtin:plane", tmp_path / "x.zarr", "small", workers=1, engine="cpu")
    with named(ValueError, "passes", "0"):
        eyebox.cluster.solve_far_field("builtin:plane", tmp_path / "x.zarr", display, passes=0)
    with named(ValueError, "psnr"):
        eyebox.cluster.solve_far_field("builtin:plane", tmp_path / "x.zarr", display, psnr=30)


CTRL_C = """
import eyebox, eyebox.cluster, os, signal, sys, threading, time
def main():
    signal.signal(signal.SIGINT, signal.default_int_handler)
    out, at = sys.argv[1], []
    def press():
        while not os.path.exists(out):
            time.sleep(0.02)
        time.sleep(0.5)
        at.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)
    threading.Thread(target=press, daemon=True).start()
    scenes = [f"builtin:plane?depth={depth / 24}" for depth in range(24)]
    small = eyebox.Display("small", size=(128, 128))
    try:
        eyebox.cluster.solve_sequence(scenes, out, small, "green", engine="cpu", frames=2, steps=400)
    except KeyboardInterrupt:
        print(time.monotonic() - at[0], flush=True)
if __name__ == "__main__":
    main()
"""


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_ends_a_cluster_at_once(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(CTRL_C)
    ran = subprocess.run([sys.executable, script, tmp_path / "x.zarr"], capture_output=True, text=True, timeout=120)
    # The time includes the end of Dask's cluster, which takes 4 s if workers end by themselves.
    assert ran.stdout and float(ran.stdout) < 2, ran.stderr


def test_pieces_that_are_alone_have_all_threads(monkeypatch):
    monkeypatch.setenv("RAYON_NUM_THREADS", "6")
    of = lambda count, workers, client=None: [_cluster_pool.threads_of(i, count, client, workers) for i in range(count)]
    # The first piece is alone, and so is the last one of seven more over three workers.
    assert of(8, 3) == [6, *[None] * 6, 6]
    assert of(9, 3) == [6, *[None] * 6, 3, 3]
    assert of(7, 3) == [6, *[None] * 6]
    assert of(2, 4) == [6, 6] and of(3, 1) == [None] * 3
    assert of(8, 3, client="another machine") == [None] * 8


def test_idle_workers_load_the_first_scene_meanwhile(monkeypatch, tmp_path):
    class Client:
        nthreads = staticmethod(lambda: {"one": 2, "other": 1})

    submitted = []
    monkeypatch.setattr(eyebox.cluster, "submit", lambda there, work, *arguments: submitted.append(work.__name__))
    monkeypatch.setattr(eyebox.cluster, "gather", lambda futures: None)
    monkeypatch.setattr(eyebox._eyebox.Sequence, "finish", lambda out: None, raising=False)
    for count, idle in [(5, 2), (2, 1), (1, 0)]:
        submitted.clear()
        eyebox.cluster.solve_sequence(["builtin:plane"] * count, tmp_path / "s.zarr", "small", client=Client())
        assert submitted == ["begun", *["prepared"] * idle, *["piece"] * (count - 1)]


def test_pieces_run_in_turn():
    with _cluster_pool.cluster(None, 2, None) as there:
        started = []

        def start(index):
            # Two run at once, so all but one of those before have ended.
            assert sum(future.done() for future in started) >= index - 1
            started.append(_cluster_pool.submit(there, time.sleep, 0.05 * (index % 3)))
            return started[-1]

        _cluster_pool.gather_in_turn([functools.partial(start, index) for index in range(7)], 2)
        assert len(started) == 7 and all(future.done() for future in started)
        with pytest.raises(ValueError):
            failing = [lambda: _cluster_pool.submit(there, int, "x"), lambda: pytest.fail("it goes on")]
            _cluster_pool.gather_in_turn(failing, 1)


def test_workers_keep_their_memory(monkeypatch):
    name = "MALLOC_TRIM_THRESHOLD_"
    # Dask also sets it in this process, when a test before has started workers.
    monkeypatch.delenv(name, raising=False)
    with _cluster_pool.cluster(None, 1, None) as there:
        kept = there.run(lambda: __import__("os").environ.get("MALLOC_TRIM_THRESHOLD_"))
    assert set(kept.values()) == {None} and name not in os.environ
