"""What Python adds to a solve: `EYEBOX=.../eyebox python3 tools/python/overhead.py [PAIRS] [SIDE] [STEPS]` solves the same by the command and
by the package, in turn, and compares phases and times: of the solves by their own account, and of the call of `eyebox.solve` around one. Both
want to be built with the same profile."""

import os
import re
import statistics
import subprocess
import sys
import tempfile
import time

import eyebox


def command(folder, side, steps):
    """Seconds of the command's solve, and its hologram."""
    out = os.path.join(folder, "command.zarr")
    settings = f"--display planes8 --size {side}x{side} --color green --steps {steps} --seed 7 --engine cpu".split()
    run = subprocess.run(
        [os.environ["EYEBOX"], "solve", "builtin:still-life", *settings, "-o", out], check=True, capture_output=True, text=True
    )
    return float(re.search(r"steps in ([0-9.]+) s", run.stderr).group(1)), eyebox.Hologram.load(out)


def package(scene, display, steps):
    """Seconds of the package's solve by its own account, of the whole call, and its hologram."""
    told = []
    begun = time.perf_counter()
    hologram = eyebox.solve(scene, display, steps=steps, seed=7, engine="cpu", callback=lambda step: told.append(step.seconds))
    return told[-1], time.perf_counter() - begun, hologram


def main():
    pairs, side, steps = (int(given) for given in (sys.argv[1:] + ["5", "512", "20"][len(sys.argv) - 1 :]))
    display = eyebox.Display("planes8", size=(side, side))
    scene = eyebox.Scene("builtin:still-life", display, "green")
    ratios, calls = [], []
    with tempfile.TemporaryDirectory() as folder:
        for pair in range(pairs):
            # Whoever is first in one pair is second in the next.
            if pair % 2 == 0:
                theirs, reference = command(folder, side, steps)
            own, call, hologram = package(scene, display, steps)
            if pair % 2 == 1:
                theirs, reference = command(folder, side, steps)
            assert hologram.phases["green"].tobytes() == reference.phases["green"].tobytes(), "other bytes"
            ratios.append(own / theirs)
            calls.append(call / own)
            print(f"command {theirs:.1f} s, package {own:.1f} s, the call {call:.2f} s", flush=True)
    print(f"package over command: median {statistics.median(ratios):.3f} ({min(ratios):.3f} to {max(ratios):.3f}); the same bytes")
    print(f"the call over its solve: median {statistics.median(calls):.3f}, at most {max(calls):.3f}")


if __name__ == "__main__":
    main()
