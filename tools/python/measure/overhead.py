"""Measures the time that Python adds to a solve.

    EYEBOX=.../eyebox python3 tools/python/measure/overhead.py [PAIRS] [SIDE] [STEPS]

The command and the package load a scene, solve it and save it, in turn. The script compares phases, seconds on the
clock, and processor time, which depends little on other load. The solve of the package has a callback, which runs at
each step. Build both with the same profile.
"""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time

import eyebox


def taken(who):
    """Returns the seconds on the clock and the seconds of processor time."""
    used = resource.getrusage(who)
    return time.monotonic(), used.ru_utime + used.ru_stime


def since(before, who):
    """Returns the differences of both since ``before``."""
    return [now - then for now, then in zip(taken(who), before)]


def command(folder, side, steps):
    """Runs the command. Returns its seconds on the clock and of processors, and its hologram."""
    out = os.path.join(folder, "command.zarr")
    settings = f"--display planes8 --size {side}x{side} --color green --steps {steps} --seed 7 --engine cpu".split()
    before = taken(resource.RUSAGE_CHILDREN)
    subprocess.run([os.environ["EYEBOX"], "solve", "builtin:still-life", *settings, "-o", out], check=True, capture_output=True)
    return since(before, resource.RUSAGE_CHILDREN), eyebox.Hologram.load(out)


def package(folder, side, steps):
    """Runs the package. Returns its seconds on the clock and of processors, and its hologram."""
    told = []
    before = taken(resource.RUSAGE_SELF)
    display = eyebox.Display("planes8", size=(side, side))
    scene = eyebox.Scene("builtin:still-life", display, "green")
    hologram = eyebox.solve(scene, display, steps=steps, seed=7, engine="cpu", callback=told.append)
    hologram.save(os.path.join(folder, "package.zarr"))
    assert len(told) >= steps
    return since(before, resource.RUSAGE_SELF), hologram


def main():
    pairs, side, steps = (int(given) for given in (sys.argv[1:] + ["5", "512", "20"][len(sys.argv) - 1 :]))
    ratios = []
    with tempfile.TemporaryDirectory() as folder:
        for pair in range(pairs):
            # The order of the two alternates from pair to pair.
            if pair % 2 == 0:
                theirs, reference = command(folder, side, steps)
            own, hologram = package(folder, side, steps)
            if pair % 2 == 1:
                theirs, reference = command(folder, side, steps)
            assert hologram.phases["green"].tobytes() == reference.phases["green"].tobytes(), "other bytes"
            ratios.append([mine / other for mine, other in zip(own, theirs)])
            print("command {:.2f} s on the clock, {:.2f} s of processors, package {:.2f} s, {:.2f} s".format(*theirs, *own), flush=True)
    print("package over command, with the same bytes:")
    for name, found in zip(("clock", "processors"), zip(*ratios)):
        print(f"  {name}: median {statistics.median(found):.3f} ({min(found):.3f} to {max(found):.3f})")


if __name__ == "__main__":
    main()
