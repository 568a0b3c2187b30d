#!/usr/bin/env python3
"""Measures the effect of obstructions in a pupil of 4 mm on holograms of several methods.

The results are mean and worst PSNR against the scene, and against the image of the same hologram through a clear pupil.
The pupils are on the axis, where all methods show a picture.

    cargo build --release && tools/obstructions.py target/release/eyebox docs/results/obstructions.json
"""
import json
import pathlib
import subprocess
import sys
import tempfile

from measurements import measured

SCENES = ["still-life", "dense-grass"]
METHODS = ["slfh", "lf2fs", "smooth", "dpac"]
OBSTRUCTIONS = ["lashes", "floaters", "opacity", "scratches"]
SIZE, STEPS = "256x256", 60
AXIS = [[0, 0, 4, 0], [0.3, 0, 4, 0], [-0.3, 0.2, 4, 0], [0, 0.5, 4, 0]]
AROUND = [[x, y, 4, 0] for x in (-6, 0, 6) for y in (-6, 0, 6)]


def run(program, *words):
    return subprocess.run([program, *map(str, words)], check=True, capture_output=True, text=True).stdout


def score(program, hologram, pupils, *more):
    """Returns the PSNR against the scene and against a clear pupil, each as [mean, worst] in dB."""
    found = json.loads(run(program, "eval", "score", hologram, "--test-pupils", pupils, "--engine", "cpu", "--jod", "none", "--json", *more))
    return [of and [round(of["mean"], 2), round(of["worst"], 2)] for of in (found["psnr_db"], found["against_clear_db"])]


def main():
    program, file = sys.argv[1:]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        pupils = {"axis": AXIS, "around": AROUND}
        for name, places in pupils.items():
            pathlib.Path(folder, name).write_text(json.dumps(places))
        for scene in SCENES:
            for method in METHODS:
                out = f"{folder}/{scene}-{method}.zarr"
                how = ["--size", SIZE, "--color", "green", "--method", method, "--engine", "cpu"]
                run(program, "solve", f"builtin:{scene}", *how, "--steps", STEPS, "-o", out)
                # Off the axis only random phases send light.
                for place in pupils if method == "slfh" else ["axis"]:
                    row = {"scene": scene, "method": method, "pupils": place}
                    row["clear"] = score(program, out, f"{folder}/{place}")[0]
                    for name in OBSTRUCTIONS:
                        seen, own = score(program, out, f"{folder}/{place}", "--obstructed", name)
                        row[name] = {"scene": seen, "against_clear": own}
                    rows.append(row)
                    print(json.dumps(row), flush=True)
    about = {**measured(program), "size": SIZE, "steps": STEPS, "color": "green", "pupils": pupils, "db": "mean and worst PSNR"}
    lines = ",\n  ".join(json.dumps(row) for row in rows)
    pathlib.Path(file).write_text(f'{{"about": {json.dumps(about)}, "rows": [\n  {lines}\n]}}\n')


if __name__ == "__main__":
    main()
