"""Measures the cost of a sequence on a cluster.

    EYEBOX=.../eyebox python3 tools/python/measure/cluster_cost.py [COUNT] [SIDE] [STEPS] [FRAMES]

The script solves the same sequence twice. The first solve is one process of the command with all threads of this
machine, and the second is a call that starts two local workers. The script compares the files, the times
and the processor time, which depends little on other load. It also measures the time and the bytes of a piece. The
model below then gives the times of 1 to 1,000 workers.
"""

import math
import os
import pathlib
import resource
import subprocess
import sys
import tempfile
import time

import eyebox
import eyebox.cluster
from distributed import Client, LocalCluster

#: Seconds that the scheduler of Dask takes for a task, according to its documentation.
SCHEDULER = 1e-3


def contents(folder):
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def processor(who=resource.RUSAGE_SELF):
    """Returns the seconds of processor time that it has used."""
    used = resource.getrusage(who)
    return used.ru_utime + used.ru_stime


def used():
    """Returns the seconds of processor time of this process and of its children that have ended."""
    return processor() + processor(resource.RUSAGE_CHILDREN)


def seconds(workers, pieces, first, load, piece, finish):
    """Models the time of a sequence in seconds.

    The first piece determines the exposure, while the other workers load the first scene. The other pieces follow at once,
    one per worker at a time, but no faster than the scheduler submits them. The caller then checks that all are there.
    """
    return max(first, load) + max(math.ceil((pieces - 1) / workers) * piece, (pieces - 1) * SCHEDULER) + pieces * finish


def main():
    count, side, steps, frames = (int(given) for given in (sys.argv[1:] + ["64", "256", "20", "2"][len(sys.argv) - 1 :]))
    threads = os.cpu_count() or 1
    scenes = [f"builtin:plane?depth={depth / count}" for depth in range(count)]
    display = eyebox.Display("small", size=(side, side))
    settings = dict(frames=frames, steps=steps, pupils=4, seed=7)
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        options = f"--display small --size {side}x{side} --color green --frames {frames} --steps {steps} --pupils 4 --seed 7".split()
        run = [os.environ["EYEBOX"], "solve", *scenes, *options, "--engine", "cpu", "--warm-start", "cold", "-o", folder / "one.zarr"]
        begun, worked = time.perf_counter(), processor(resource.RUSAGE_CHILDREN)
        subprocess.run(run, check=True, capture_output=True, env={**os.environ, "RAYON_NUM_THREADS": str(threads)})
        one, one_worked = time.perf_counter() - begun, processor(resource.RUSAGE_CHILDREN) - worked
        # The cluster starts and ends with the call.
        begun, worked = time.perf_counter(), used()
        eyebox.cluster.solve_sequence(scenes, folder / "two.zarr", display, "green", workers=2, engine="cpu", **settings)
        two, two_worked = time.perf_counter() - begun, used() - worked
        begun, worked = time.perf_counter(), used()
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local, Client(local) as client:
            client.run(lambda: __import__("eyebox"))
            start = time.perf_counter() - begun
            time.sleep(max(min(two - start, 20), 0))
        idle = used() - worked
        assert contents(folder / "one.zarr") == contents(folder / "two.zarr"), "other bytes"
        carried = (folder / "two.zarr/phases/c/1/0/0/0/0").stat().st_size
        out = str(folder / "again.zarr")
        job = (tuple(scenes), eyebox.cluster._text(display), ("green",), eyebox._arguments.toml(settings), (30, 1), out, "cpu")
        begun = processor()
        eyebox._cluster_work.begun(job)
        first = processor() - begun
        begun = processor()
        for index in range(1, count):
            eyebox._cluster_work.piece(job, index)
        piece = (processor() - begun) / max(count - 1, 1)
        eyebox._cluster_work.sequence.cache_clear()
        begun = processor()
        eyebox._cluster_work.piece(job, 0)
        load = processor() - begun
        begun = time.perf_counter()
        eyebox._eyebox.Sequence.finish(out)
        finish = (time.perf_counter() - begun) / count
    print(f"{count} holograms of {side} x {side}, {frames} sub-frames, {steps} steps: the same files")
    print(f"one process with {threads} threads {one:.1f} s; two workers, started and ended, {two:.1f} s, {two / one:.2f} times")
    print(
        f"processors: {one_worked:.1f} s for the one, {two_worked:.1f} s for both and the caller, {two_worked / one_worked:.2f} times, "
        f"of which an idle cluster would have taken {idle:.1f} s; it started in {start:.1f} s"
    )
    print(
        f"of one processor: first piece {first:.2f} s, another {piece:.2f} s, a worker's beginning {load:.2f} s, "
        f"saying that one is there {finish * 1e3:.2f} ms; {carried / 1e6:.2f} MB written a piece"
    )
    for workers in (1, 10, 100, 1000):
        took = seconds(workers, 10_000, first, load, piece, finish)
        share = 10_000 * piece / workers / took
        rate = 10_000 * carried / 1e6 / took
        print(f"{workers:5} workers, 10,000 pieces: {took:9.0f} s, {100 * share:3.0f} % of it solving; {rate:.1f} MB/s written")


if __name__ == "__main__":
    main()
