#!/usr/bin/env python3
"""Measures the gain of a solve that starts from the phases of a table.

The results are mean and worst PSNR over 24 random pupils by number of steps. They cover several scenes, and one scene
on displays with faults, with a source, with few sub-frames and in the far field.

    cargo build --release && tools/first_phases.py target/release/eyebox docs/results/first-phases.json
"""
import json
import pathlib
import re
import subprocess
import sys
import tempfile

from measurements import measured
from solver_and_model import HEAD, TERMS, WEAK, model

SCENES = ["still-life", "still-life-bright", "dense-grass", "chart", "points", "plane?depth=6"]
STEPS = [0, 1, 5, 10, 60]
SIZE = "256x256"
SCENE = SCENES[0]
HEAD_256 = HEAD.replace("[128, 128]", "[256, 256]")
DISPLAYS = {
    "no fault": "",
    "weak crosstalk": model({"crosstalk": WEAK}),
    **{name: model({name: TERMS[name]}) for name in ["crosstalk", "fill", "source", "undiffracted", "wavefront"]},
    "all faults": model(TERMS),
    "light-emitting diode": '\n[source.green]\nkind = "led"\n',
    "eye of -0.1 D": "\n[prescription]\nsphere = -0.1\n",
}
FEW = [1, 2, 4]
# An SLM in the pupil plane, 25.6 mm wide. The preset's is 4.1 mm wide, and its green picture does not fill the image.
FAR = """resolution = [256, 256]
pitch_um = 100.0
focal_length_mm = 400.0
wavelengths_nm = { green = 520 }
geometry = "far-field"
"""


def measure(program, scene, how):
    """Solves and scores one hologram. Returns [mean, worst] in dB."""
    with tempfile.TemporaryDirectory() as folder:
        out = f"{folder}/solved.zarr"
        solve = [program, "solve", scene, "--color", "green", "--engine", "cpu", *map(str, how), "-o", out]
        subprocess.run(solve, check=True, capture_output=True)
        score = [program, "eval", "score", out, "--test-pupils", "random:24", "--engine", "cpu", "--json"]
        found = json.loads(subprocess.run(score, check=True, capture_output=True, text=True).stdout)["psnr_db"]
    return [round(found["mean"], 2), round(found["worst"], 2)]


def compare(program, about, scene, how):
    """Returns one row with both starts, by number of steps."""
    row = {**about}
    for begin in ["random", "table"]:
        row[begin] = {str(n): measure(program, scene, [*how, "--steps", n, "--set", f"first_phases={begin}"]) for n in STEPS}
        print(*about.values(), begin, row[begin], flush=True)
    return row


def far_fields(program, display):
    """Returns the rows of the far field, in which first phases come from the picture's transform."""
    display.write_text(FAR)
    on = [(f"builtin:{name}", display) for name in SCENES] + [(f"builtin:{SCENE}", "far-field")]
    for scene, display in on:
        about = {"far_field": "preset" if display == "far-field" else "25.6 mm", "scene": scene}
        yield compare(program, about, scene, ["--display", display])


def main():
    program, file = sys.argv[1:]
    rows = [compare(program, {"scene": f"builtin:{name}"}, f"builtin:{name}", ["--size", SIZE]) for name in SCENES]
    scene = f"builtin:{SCENE}"
    with tempfile.TemporaryDirectory() as folder:
        display = pathlib.Path(folder, "display.toml")
        for name, faults in DISPLAYS.items():
            display.write_text(HEAD_256 + faults)
            rows.append(compare(program, {"display": name}, scene, ["--display", display]))
        display.write_text(HEAD_256)
        for frames in FEW:
            rows.append(compare(program, {"frames": frames}, scene, ["--display", display, "--frames", frames]))
        rows.extend(far_fields(program, display))
    about = {**measured(program), "size": SIZE, "frames": 8, "color": "green", "pupils": "random:24", "db": "mean and worst PSNR by steps"}
    text = json.dumps({"about": {**about, "scene": scene}, "rows": rows})
    text = re.sub(r', "rows": \[|(?<=\}), (?=\{"(scene|display|frames|far_field))', lambda m: m.group(0).strip() + "\n  ", text)
    # What tools/other_starts.py has added stays.
    file = pathlib.Path(file)
    added = "".join(file.read_text(encoding="utf-8").partition(',\n "other_starts"')[1:]) if file.exists() else ""
    file.write_text((text.removesuffix("}") + added if added else text + "\n"), encoding="utf-8")


if __name__ == "__main__":
    main()
