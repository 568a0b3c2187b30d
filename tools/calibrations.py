#!/usr/bin/env python3
"""Measures what calibrations regain on simulated benches, and writes the table.

    python3 tools/calibrations.py path/to/bench.py --eyebox target/release/eyebox --seeds 1-10 -o docs/results/calibrations.json

The bench is a separate program. `bench.py --seed N --trial EYEBOX` calibrates, and solves a scene for the calibrated and
for the ideal display. Its last line is one JSON object. This has the PSNR of the pupils in dB, as `mean` and `worst`,
and `lost`, `regained` and `share`, each as a pair of mean and worst. Results are written after each seed. Seeds that the
file has already are not measured again.
"""
import argparse
import json
import pathlib
import subprocess
import sys

from measurements import measured as head


def seeds(text):
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def measured(bench, eyebox, seed):
    """Runs a trial and returns its last line, or its error."""
    command = [sys.executable, bench, "--seed", str(seed), "--trial", eyebox]
    ran = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if ran.returncode != 0:
        return {"error": (ran.stderr.strip().splitlines() or ["no message"])[-1]}
    return json.loads(ran.stdout.strip().splitlines()[-1])


def table(rows):
    """Returns the rows as Markdown, with the mean and the least of the shares."""
    lines = ["| seed | PSNR, mean / worst | lost, mean / worst | regained, mean / worst |", "|---|---|---|---|"]
    good = [row for row in rows.values() if "share" in row]
    for seed, row in rows.items():
        if "share" not in row:
            lines.append(f"| {seed} | {row.get('error', 'no result')} | | |")
            continue
        lost, share = row["lost"], [100 * part for part in row["share"]]
        lines.append(f"| {seed} | {row['mean']:.2f} / {row['worst']:.2f} dB | {lost[0]:.2f} / {lost[1]:.2f} dB | {share[0]:.0f} / {share[1]:.0f} % |")
    for name, of in (("mean", lambda part: sum(part) / len(part)), ("least", min)):
        if good:
            parts = [100 * of([row["share"][i] for row in good]) for i in range(2)]
            lines.append(f"| {name} | | | {parts[0]:.0f} / {parts[1]:.0f} % |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bench")
    parser.add_argument("--eyebox", required=True)
    parser.add_argument("--seeds", type=seeds, default=range(1, 11))
    parser.add_argument("-o", "--out", type=pathlib.Path, required=True)
    args = parser.parse_args()
    rows = json.loads(args.out.read_text()) if args.out.exists() else {}
    rows.pop("about", None)
    for seed in args.seeds:
        if "share" not in rows.get(str(seed), {}):
            rows[str(seed)] = measured(args.bench, args.eyebox, seed)
            args.out.write_text(json.dumps({"about": head(args.eyebox), **rows}, indent=1) + "\n")
    print(table(rows))


if __name__ == "__main__":
    main()
