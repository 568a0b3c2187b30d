"""A sequence over two processes, one of which is killed in the middle: the bytes of one process."""

import os
import pathlib
import signal
import subprocess
import threading
import time

import eyebox
import pytest

distributed = pytest.importorskip("distributed")
import eyebox.cluster  # noqa: E402
from conftest import LONG  # noqa: E402

COUNT = 64 if LONG else 8


def files(folder):
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file() and "lock" not in p.name}


def one_process(scenes, out):
    program = os.environ.get("EYEBOX")
    if not program or not pathlib.Path(program).exists():
        pytest.skip("EYEBOX names no program")
    settings = "--display small --size 40x48 --color green --frames 2 --steps 40 --pupils 4 --seed 7 --engine cpu".split()
    subprocess.run([program, "solve", *scenes, *settings, "--warm-start", "cold", "-o", out], check=True, capture_output=True)


def test_one_of_two_workers_is_killed(tmp_path):
    display = eyebox.Display("small", size=(40, 48))
    scenes = [f"builtin:plane?depth={depth / 8}" for depth in range(COUNT)]
    settings = dict(frames=2, steps=40, pupils=4, seed=7)
    out, pieces = tmp_path / "cluster.zarr", tmp_path / "cluster.zarr.pieces"
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        with distributed.Client(local) as client:
            killed = []

            def kill():
                while len(list(pieces.glob("*.zarr"))) < 2:
                    time.sleep(0.005)
                victim = next(iter(local.workers.values())).pid
                os.kill(victim, signal.SIGKILL)
                killed.append(victim)

            thread = threading.Thread(target=kill)
            thread.start()
            eyebox.cluster.solve_sequence(scenes, out, display, "green", client=client, engine="cpu", keep_pieces=True, **settings)
            thread.join()
            assert killed
            # What is done is not done twice.
            before = files(out)
            assert eyebox.cluster.solve_sequence(scenes, out, display, "green", client=client, engine="cpu", **settings) == 0
            assert files(out) == before and not pieces.exists()
    one_process(scenes, tmp_path / "one.zarr")
    assert files(out) == files(tmp_path / "one.zarr")


def test_what_makes_no_sense(tmp_path):
    with pytest.raises(TypeError, match="scenes is 'builtin:plane'"):
        eyebox.cluster.solve_sequence("builtin:plane", tmp_path / "x.zarr")
    with pytest.raises(ValueError, match="scenes is empty"):
        eyebox.cluster.solve_sequence([], tmp_path / "x.zarr")
    with pytest.raises(ValueError, match="must end in .zarr"):
        eyebox.cluster.solve_sequence(["builtin:plane"], tmp_path / "x")
    with pytest.raises(TypeError, match="rate is 'fast'"):
        eyebox.cluster.solve_sequence(["builtin:plane"], tmp_path / "x.zarr", rate="fast")
    assert not list(tmp_path.iterdir())
