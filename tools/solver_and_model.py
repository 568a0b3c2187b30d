#!/usr/bin/env python3
"""Measure whether the solver uses a display's model, and whether more steps ever end lower.

    EYEBOX=target/debug/eyebox tools/solver_and_model.py docs/results/solver-and-model.json

The table has two parts, each at 20, 60 and 120 steps, by projection and by Adam.

- Displays with crosstalk alone, sigma from 1 to 50, and the ideal display have the score of the solve in its own model.
- Displays with all terms are solved with all of them, and with each left out. Each hologram is scored on the full
  display. Adam leaves out only crosstalk, or all terms.

A row fails if its score falls with the steps by more than 0.1 dB. It also fails if it has one term less and beats the
row of all terms by more than 0.1 dB. The script writes the table first and then exits with 1 if a row failed. It needs
only the standard library. Each row is written when it is measured, and rows that the file contains already are kept. The same
command therefore continues a table that was interrupted. The option --only TEXT limits it to displays whose name
contains TEXT. The option --jobs N runs N solves at a time (default 2).
"""
import argparse, concurrent.futures, json, os, pathlib, shutil, subprocess, sys, tempfile

from measurements import measured

HEAD = """name = "measured"
resolution = [128, 128]
pitch_um = 8.0
focal_length_mm = 400.0
wavelengths_nm = { green = 520 }
levels = 256
"""
SCENE, STEPS, OPTIMIZERS, FALL_DB = "builtin:still-life", (20, 60, 120), ("projection", "adam"), 0.1
WEAK = [[1.3, 5.7], [1.2, 4.5], [1.3, 4.0], [1.3, 4.0]]
STRONG = [[1.3136, 2.8604], [1.2176, 2.269], [1.2675, 2.0076], [1.2781, 1.9776]]
TERMS = {
    "level": [[1.0027, 1.064, 1.005], [0.9766, 1.0716, 1.052], [1.0328, 1.0429, 1.0588]],
    "bend": [-0.0042, -0.0263], "lag": 0.0361, "crosstalk": STRONG, "fill": 0.9425,
    "source": [0.0051, 0.0576, -0.3441, -0.0269, -0.2408], "undiffracted": [0.0902, 0.2041, 0.5291, -0.0091, 0.2765],
    "wavefront": {3: 0.0185, 4: 0.0268, 8: 0.0537, 10: -0.0559, 11: -0.0408, 12: -0.019}, "iris": [0.1204, 0.0441, 1.0011],
}
FULL = {"bench, weak crosstalk": {**TERMS, "crosstalk": WEAK}, "bench": TERMS}
SIGMAS = (1, 1.5, 2.03, 3, 5, 10, 50)


def model(terms):
    """Returns the section of a display file that has these terms."""
    value = lambda v: "{ %s }" % ", ".join(f"{k} = {n}" for k, n in v.items()) if isinstance(v, dict) else json.dumps(v)
    lines = "".join(f"{name} = {value(v)}\n" for name, v in terms.items())
    return f"\n[model.green]\n{lines}" if terms else ""


def display(terms):
    """Writes a display file with these terms."""
    return HEAD + model(terms)


def run(*words):
    environment = {**os.environ, "RAYON_NUM_THREADS": "1"}
    done = subprocess.run([os.environ["EYEBOX"], *map(str, words)], capture_output=True, text=True, env=environment)
    if done.returncode:
        sys.exit(f"eyebox {' '.join(map(str, words))}: {done.stderr}")
    return done.stdout


def score(folder, truth, known, steps, optimizer):
    """Returns mean and worst PSNR in dB, on the display `truth`, of a hologram that was solved for the display `known`."""
    work = pathlib.Path(tempfile.mkdtemp(dir=folder))
    for name, terms in (("truth", truth), ("known", known)):
        (work / f"{name}.toml").write_text(display(terms))
    run("solve", SCENE, "--display", work / "known.toml", "--color", "green", "--frames", 8, "--engine", "cpu", "--steps", steps,
        "--set", f"optimizer={optimizer}", "-o", work / "solved.zarr", "--json")
    scored = work / "solved.zarr"
    if known != truth:
        run("convert", scored, work / "phases.npy")
        scored = work / "seen.zarr"
        run("convert", work / "phases.npy", scored, "--display", work / "truth.toml", "--scene", SCENE)
    psnr = json.loads(run("eval", "score", scored, SCENE, "--test-pupils", "random:24", "--jod", "none", "--engine", "cpu", "--json"))["psnr_db"]
    shutil.rmtree(work)
    return [round(psnr[name], 2) for name in ("mean", "worst")]


def rows_to_measure(only):
    """Returns (display, left-out term, optimizer, present terms, terms that the solver has) of each row."""
    crosstalk = {f"crosstalk of sigma {sigma}": {"crosstalk": [[1.2, sigma]] * 4} for sigma in SIGMAS}
    alone = {"ideal": {}, **crosstalk}
    rows = [(name, None, optimizer, terms, terms) for name, terms in alone.items() for optimizer in OPTIMIZERS]
    for name, terms in FULL.items():
        without = [(term, {k: v for k, v in terms.items() if k != term}) for term in terms]
        rows += [(name, left_out, optimizer, terms, known) for left_out, known in [(None, terms), *without, ("all", {})]
                 for optimizer in OPTIMIZERS if optimizer == "projection" or left_out in (None, "crosstalk", "all")]
    return [row for row in rows if only in row[0]]


def faults(rows):
    """Returns the violated conditions in words."""
    found = []
    for row in rows:
        name = f"{row['display']}, {row['optimizer']}, without {row['left_out'] or 'nothing'}"
        for (before, (low, _)), (after, (high, _)) in zip(row["db"].items(), list(row["db"].items())[1:]):
            if row["left_out"] is None and high < low - FALL_DB:
                found.append(f"{name}: {low} dB after {before} steps, {high} after {after}")
        if row["left_out"]:
            full = (row["display"], row["optimizer"], None)
            of_all = next(r for r in rows if (r["display"], r["optimizer"], r["left_out"]) == full)
            for steps, (less, _) in row["db"].items():
                if less > of_all["db"][steps][0] + FALL_DB:
                    found.append(f"{name}, {steps} steps: {less} dB, more than {of_all['db'][steps][0]} with all terms")
    return found


def write(out, rows):
    about = {**measured(os.environ["EYEBOX"]), "scene": SCENE, "size": [128, 128], "frames": 8, "color": "green",
             "pupils": "random:24", "db": "mean and worst PSNR by number of steps"}
    lines = ",\n".join("  " + json.dumps(row) for row in rows)
    out.write_text(f'{{"about": {json.dumps(about)},\n "faults": {json.dumps(faults(rows))},\n "rows": [\n{lines}\n]}}\n')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out")
    parser.add_argument("--only", default="")
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    out = pathlib.Path(asked.out)
    rows = json.loads(out.read_text())["rows"] if out.exists() else []
    measured = {(row["display"], row["left_out"], row["optimizer"]) for row in rows}
    with tempfile.TemporaryDirectory() as folder, concurrent.futures.ThreadPoolExecutor(asked.jobs) as pool:
        wanted = [row for row in rows_to_measure(asked.only) if row[:3] not in measured]
        under_way = [[pool.submit(score, folder, truth, known, steps, optimizer) for steps in STEPS]
                     for _, _, optimizer, truth, known in wanted]
        for (name, left_out, optimizer, *_), scores in zip(wanted, under_way):
            db = {str(steps): score.result() for steps, score in zip(STEPS, scores)}
            rows.append({"display": name, "left_out": left_out, "optimizer": optimizer, "db": db})
            write(out, rows)
            print(f"{name:22} {optimizer:10} without {left_out or '-':13}", *("%5.2f / %5.2f" % tuple(x) for x in db.values()), flush=True)
    found = faults(rows)
    print(*found, sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
