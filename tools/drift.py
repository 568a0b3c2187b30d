#!/usr/bin/env python3
"""Measure what `display calibrate --quick` saves on a bench that drifts over eight hours.

    EYEBOX=target/debug/eyebox tools/drift.py path/to/bench.py docs/results/drift.json

The bench is a separate program for docs/calibrate.md, with the arguments `--seed 1 --size 128x128 --faults FILE.json`.
The faults have the names of OPTICS 10. The bench is fully calibrated at hour 0. At each later hour its table, its beam
and the tilt of its light have changed. Holograms are then solved for three models. The first is the model of hour 0, the second is updated from
four pictures per hour, and the third is the true one. All are scored on the true display.

The script prints and writes PSNRs over 24 random pupils. It exits with 1 if the updated model loses more than 0.1 dB
against the true one, or if the model of hour 0 does not lose more than that at hour 8. It needs the standard library,
and the bench may need more. Models that --keep DIR has are not fitted again.

With --show, `show --camera` updates the model instead. The camera sees the shown holograms, and each picture is a
quarter of an hour later. The model of hour 8 is scored. `bench.py` must then be a module with Bench(faults, noise), .hello(ask)
and .capture(ask). The option --serve is that camera's command.
"""
import argparse, json, os, pathlib, shlex, signal, subprocess, sys, tempfile, time, tomllib

from measurements import measured
from solver_and_model import TERMS, display, score

HOURS, STEPS, LEAST_DB = range(9), 30, 0.1
SCORED = (0, 2, 4, 6, 8)


def truth(hour):
    """Returns the terms of the bench at an hour. The table loses 3 %, and the beam and the light's tilt move."""
    part = hour / 8
    moved = lambda term, by: [round(value + part * off, 6) for value, off in zip(TERMS[term], by)]
    level = [[round(value * (1 - 0.03 * part), 6) for value in row] for row in TERMS["level"]]
    return {**TERMS, "level": level, "source": moved("source", [0.15, -0.1, 0, 0, 0]), "iris": moved("iris", [0.3, -0.2, 0])}


def calibrated(bench, hour, known, out, *more):
    """Calibrates at an hour, starting from a display file, and returns the report."""
    faults = out.with_suffix(".json")
    faults.write_text(json.dumps({**truth(hour), "quantise": True}))
    camera = f"'{sys.executable}' '{bench}' --seed 1 --size 128x128 --noise {hour + 1} --faults '{faults}'"
    command = [os.environ["EYEBOX"], "display", "calibrate", known, "--camera", camera, "--json", "-o", out, *more]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"hour {hour}: {done.stderr}")
    return json.loads(done.stdout)


def terms_of(file):
    """Returns the terms of a display file's green model."""
    model = tomllib.loads(file.read_text())["model"]["green"]
    return {name: model[name] for name in TERMS if name in model}


def serve(bench, work):
    """Serves as the camera of a show. The bench drifts by a quarter of an hour from picture to picture."""
    sys.path.insert(0, str(bench.parent))
    import numpy as np
    from bench import Bench, drawn

    taken = 0
    for line in sys.stdin:
        ask = json.loads(line)
        answer = {}
        if ask["do"] in ("hello", "capture"):
            hour = min(taken / 4, 8)
            faults = {**drawn(1, [128, 128]), **truth(hour), "quantise": True, "resolution": [128, 128]}
            now = Bench(faults, taken)
        if ask["do"] == "hello":
            answer = now.hello(ask)
        elif ask["do"] == "capture":
            if ask["color"] is not None:
                levels = np.frombuffer((work / "video").read_bytes()[64:], np.uint8).reshape(1, 128, 128)
                np.save(ask["out"] + "-show.npy", levels)
                ask["show"] = {"file": ask["out"] + "-show.npy", "kind": "levels"}
                taken += 1
            answer = now.capture(ask)
            (work / "hour").write_text(str(hour))
        print(json.dumps({"id": ask["id"], **answer}), flush=True)
        if ask["do"] == "bye":
            return


def followed_show(bench, work):
    """Returns the display file after a show of all eight hours."""
    model, said = work / "shown.toml", work / "show.txt"
    camera = shlex.join([sys.executable, os.path.abspath(__file__), str(bench), str(work / "none"), "--serve", "--keep", str(work)])
    command = [os.environ["EYEBOX"], "show", "builtin:still-life", "--display", work / "hour-0.toml", "--color", "green", "--frames", "1",
               "--engine", "cpu", "--output", f"shared:{work / 'video'}", "--camera", camera, "--set", "camera.every=0.05",
               "--camera-model", model]
    with said.open("w") as to:
        show = subprocess.Popen(list(map(str, command)), stderr=to, stdout=to)
        hour = work / "hour"
        while show.poll() is None and not (hour.exists() and float(hour.read_text() or 0) >= 8):
            time.sleep(1)
        # Three more pictures of hour 8.
        time.sleep(1 if show.poll() is not None else 120)
        show.send_signal(signal.SIGINT)
        show.wait()
    print(said.read_text(), file=sys.stderr)
    return model


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bench", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--keep", type=pathlib.Path)
    parser.add_argument("--show", action="store_true")
    parser.add_argument("--serve", action="store_true")
    args = parser.parse_args()
    if args.serve:
        return serve(args.bench.resolve(), args.keep)
    work = args.keep or pathlib.Path(tempfile.mkdtemp())
    work.mkdir(exist_ok=True, parents=True)
    models, rows = [work / f"hour-{hour}.toml" for hour in HOURS], []
    ideal = work / "ideal.toml"
    ideal.write_text(display({}))
    for hour in HOURS:
        known, more = (models[hour - 1], ["--quick"]) if hour else (ideal, ["--set", "camera.pictures=40"])
        reported = work / f"report-{hour}.json"
        if not models[hour].exists():
            report = calibrated(args.bench.resolve(), hour, known, models[hour], *more)
            reported.write_text(json.dumps(report))
        report = json.loads(reported.read_text())
        row = {"hour": hour, "pictures": report["captures"], "verdict": report["verdict"],
               "unexplained": report["unexplained"], "seconds": round(report["seconds"], 1)}
        if hour in SCORED:
            at = lambda terms: score(work, truth(hour), terms, STEPS, "projection")
            row |= {"hour 0": at(terms_of(models[0])), "followed": at(terms_of(models[hour])), "true": at(truth(hour))}
        rows.append(row)
        print(json.dumps(row), flush=True)
        about = {**measured(os.environ["EYEBOX"]), "scene": "builtin:still-life", "size": [128, 128], "frames": 8,
                 "steps": STEPS, "pupils": "random:24",
                 "hour 0, followed, true": "mean and worst PSNR in dB, solved for that model and seen on the bench of that hour"}
        args.out.write_text(json.dumps({"about": about, "rows": rows}, indent=1) + "\n")
    scored = [row for row in rows if "true" in row]
    if args.show:
        model = followed_show(args.bench.resolve(), work.resolve())
        rows[-1]["followed by show"] = score(work, truth(8), terms_of(model), STEPS, "projection")
        print(json.dumps(rows[-1]), flush=True)
        args.out.write_text(json.dumps({"about": about, "rows": rows}, indent=1) + "\n")
    lost = lambda row, name: row["true"][0] - row[name][0]
    wrong = [row["hour"] for row in scored if lost(row, "followed") > LEAST_DB]
    if wrong or lost(scored[-1], "hour 0") <= LEAST_DB:
        sys.exit(f"the model that follows loses more than {LEAST_DB} dB at hours {wrong}" if wrong else "the bench did not drift")


if __name__ == "__main__":
    main()
