#!/usr/bin/env python3
"""Measures what a solve gains by beginning from a table's phases: mean and worst PSNR over 24 random pupils by number of steps.

    cargo build --release && tools/first_phases.py target/release/eyebox docs/results/first-phases.json
"""
import json
import re
import subprocess
import sys
import tempfile

SCENES = ["still-life", "still-life-bright", "dense-grass", "chart", "points", "plane?depth=6"]
STEPS = [0, 1, 5, 10, 60]
SIZE = "256x256"


def measure(program, folder, scene, first_phases, steps):
    """Solves and scores one hologram: [mean, worst], dB."""
    out = f"{folder}/{first_phases}-{steps}.zarr"
    how = ["--size", SIZE, "--color", "green", "--engine", "cpu", "--steps", str(steps), "--first-phases", first_phases]
    subprocess.run([program, "solve", scene, *how, "-o", out], check=True, capture_output=True)
    score = [program, "score", out, "--pupils", "random:24", "--engine", "cpu", "--json"]
    found = json.loads(subprocess.run(score, check=True, capture_output=True, text=True).stdout)["psnr_db"]
    return [round(found["mean"], 2), round(found["worst"], 2)]


def main():
    program, file = sys.argv[1:]
    rows = []
    for name in SCENES:
        scene = f"builtin:{name}"
        with tempfile.TemporaryDirectory() as folder:
            row = {"scene": scene}
            for first_phases in ["random", "table"]:
                row[first_phases] = {str(n): measure(program, folder, scene, first_phases, n) for n in STEPS}
                print(scene, first_phases, row[first_phases], flush=True)
            rows.append(row)
    about = {"size": SIZE, "frames": 8, "color": "green", "pupils": "random:24", "db": "mean and worst PSNR by steps"}
    text = json.dumps({"about": about, "rows": rows})
    with open(file, "w", encoding="utf-8") as out:
        out.write(re.sub(r', "rows": \[|(?<=\}), (?=\{"scene)', lambda m: m.group(0).strip() + "\n  ", text) + "\n")


if __name__ == "__main__":
    main()
