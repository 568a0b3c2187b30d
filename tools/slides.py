#!/usr/bin/env python3
"""Measures slides, which are 20 pictures without any content in common.

The results are the PSNR at the eye in the first sets of each slide, for steps that start from a table's phases, from
the last phases and from random phases. The script also measures the JOD of an even picture from a table.

    cargo build --release && tools/slides.py target/release/eyebox docs/results/slides.json

It needs NumPy. It makes the pictures itself, as arrays of 5 x 5 views in linear light.
"""
import json
import pathlib
import re
import subprocess
import sys
import tempfile

import numpy as np

from measurements import measured

SIDE, VIEWS, COUNT = 256, 5, 20
HOW = ["--size", f"{SIDE}x{SIDE}", "--color", "green", "--engine", "cpu", "--order", "as-named"]
STARTS = ["random", "last", "table"]
SETS = [1, 2, 3]  # After a change, as `eval gaze` counts them.
EVEN, EVEN_STEPS = 0.3, [("table", 0), ("random", 2), ("random", 5), ("random", 10)]


def smooth(light, width):
    """Blurs a picture by a Gaussian of this width in pixels."""
    q = np.fft.fftfreq(SIDE)
    filtered = np.fft.fft2(light) * np.exp(-2 * (np.pi * width) ** 2 * (q[:, None] ** 2 + q**2))
    return np.fft.ifft2(filtered).real


def between_0_and_1(light):
    return (light - light.min()) / (light.max() - light.min())


def leaves(rng, smallest, largest, dark):
    """Returns discs that hide each other, as in natural images, with sizes by a power law and random brightness."""
    y, x = np.mgrid[:SIDE, :SIDE]
    light = np.full((SIDE, SIDE), 0.5)
    for _ in range(3000):
        radius = 1 / np.sqrt(rng.uniform(largest**-2, smallest**-2))
        light[np.hypot(x - rng.uniform(0, SIDE), y - rng.uniform(0, SIDE)) < radius] = rng.random()
    return smooth(light, 0.7).clip(0, 1) ** dark


def clouds(rng, power, dark):
    """Returns noise whose spectrum falls by a power law, as in natural images."""
    q = np.hypot(*np.meshgrid(*[np.fft.fftfreq(SIDE)] * 2))
    falling = np.divide(1, q**power, where=q > 0, out=np.zeros_like(q))
    return between_0_and_1(np.fft.ifft2(np.fft.fft2(rng.standard_normal((SIDE, SIDE))) * falling).real) ** dark


def pictures():
    """Returns 20 pictures (row, column) from 0 to 1, 12 with the statistics of natural images and 8 graphic ones."""
    rng = np.random.default_rng(20)
    kinds = [(4, 60, 1), (2, 30, 2), (8, 90, 3), (3, 100, 2), (6, 40, 1), (10, 60, 2)]
    photographs = [leaves(rng, *kind) for kind in kinds] + [clouds(rng, *kind) for kind in [(1, 2), (1.2, 3), (1.5, 1), (1.5, 2), (1, 4), (2, 2)]]
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE
    radius, angle = np.hypot(x - 0.5, y - 0.5), np.arctan2(y - 0.5, x - 0.5)
    places = rng.random((40, 2))
    near = np.sort(np.hypot(x - places[:, :1, None], y - places[:, 1:, None]), axis=0)
    blocks = np.kron(rng.random((16, 16)), np.ones((SIDE // 16, SIDE // 16)))
    points = np.zeros((SIDE, SIDE))
    points[tuple(rng.integers(4, SIDE - 4, (2, 60)))] = 1
    graphic = [
        x,
        (np.floor(8 * x) + np.floor(8 * y)) % 2,
        0.5 + 0.5 * np.sin(24 * np.pi * (x + y)),
        0.5 + 0.5 * np.cos(16 * angle),
        (radius < 0.3) * 1.0,
        blocks,
        (near[1] - near[0] > 0.015) * 1.0,
        between_0_and_1(smooth(points, 1.5)),
    ]
    return [picture for i in range(4) for picture in photographs[i::4] + graphic[i::4]]


def light_field(picture, brightness, parallax):
    """Returns views (row, column, row, column, 1) of a picture, at this brightness and shift in pixels per view."""
    light = (picture * brightness / picture.mean()).clip(0, 1).astype(np.float32)
    middle = VIEWS // 2
    moved = [[np.roll(light, (parallax * (r - middle), parallax * (c - middle)), (0, 1)) for c in range(VIEWS)] for r in range(VIEWS)]
    return np.array(moved)[..., None]  # Five axes are views, four would be phases.


def run(program, *words):
    return subprocess.run([program, *map(str, words)], check=True, capture_output=True, text=True).stdout


def slides(program, folder, files, every, steps):
    """Returns one row with the PSNR at the tracked pupil, as the mean over the changes, by the start of a slide."""
    first, *others = files
    row = {"sets_per_slide": every, "steps_per_set": steps}
    for start in STARTS:
        table = {"content": "jumping", "jumps_to": ",".join(others), "jumps_every": every, "sets": every * (len(files) + 1),
                 "steps_per_set": steps, "jumps_from": start, "fixation": 100_000}
        how = [word for key, value in table.items() for word in ("--set", f"gaze.{key}={value}")]
        how += ["--json", "--overwrite", "-o", f"{folder}/study"]
        summary = json.loads(run(program, "eval", "gaze", first, "--display", "planes8", *HOW, *how))["summary"]
        [seen] = [one["after_jumps_db"] for one in summary if one["steered"] and one["moments"]]
        row[start] = [round(db, 1) for db in seen[: min(every, len(SETS))]]
    print(row, flush=True)
    return row


def even_picture(program, folder):
    """Measures PSNR and JOD of an even picture by the start of its solve, because its tiles may be visible."""
    scene, out = f"{folder}/even.npy", f"{folder}/even.zarr"
    np.save(scene, np.full((VIEWS, VIEWS, SIDE, SIDE, 1), EVEN, np.float32))
    for start, steps in EVEN_STEPS:
        run(program, "solve", scene, *HOW, "--steps", steps, "--set", f"first_phases={start}", "-o", out)
        found = json.loads(run(program, "eval", "score", out, "--test-pupils", "random:8", "--engine", "cpu", "--json"))
        row = {"begun_with": start, "steps": steps, "psnr_db": round(found["psnr_db"]["mean"], 1), "jod": round(found["jod"]["mean"], 2)}
        print(row, flush=True)
        yield row


def main():
    program, file = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        files = []
        for i, picture in enumerate(pictures()):
            files.append(f"{folder}/{i:02}.npy")
            brightness = 0.05 + 0.25 * ((i * 7 + 10) % COUNT) / COUNT
            np.save(files[-1], light_field(picture, brightness, (0, 1, -1)[i % 3]))
        assert len(files) == COUNT
        rows = [slides(program, folder, files, every, steps) for every, steps in [(1, 1), (1, 2), (4, 1)]]
        even = list(even_picture(program, folder))
    about = {**measured(program), "size": f"{SIDE}x{SIDE}", "color": "green", "display": "planes8", "pictures": COUNT}
    about["db"] = f"PSNR at the steered pupil in the sets {SETS} after a change, mean over the changes"
    text = json.dumps({"about": about, "rows": rows, "even_picture": even})
    pathlib.Path(file).write_text(re.sub(r"(?<=\[|,)\s*(?=\{)", "\n  ", text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
