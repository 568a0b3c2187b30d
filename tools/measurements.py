#!/usr/bin/env python3
"""Writes docs/measurements.md from the result files in docs/results.

With --check it fails if the page differs from the files. With --record 'COMMAND' PROGRAM it prints the head of a record.

A result file has a title, a sentence, notes and records. The head of a record has the command that measures it again, the version of
eyebox, the build, the processor, the load ("quiet", or what else ran) and the date. Names of columns and rows follow. A list of numbers
is shown as "mean / worst". Records with "page" are on the page. An empty "page" shows all of a record, and "rows" and "columns" limit it
to the first ones. Scripts such as tools/slides.py write the other files, and the functions below make tables of them.
"""

import datetime
import json
import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RESULTS, PAGE = ROOT / "docs" / "results", ROOT / "docs" / "measurements.md"
LOAD = os.getloadavg()[0]  # Before a script that imports this module starts its work.
WIDTH, CELL = 120, 160
HEAD = """# Measurements

This page is for readers who want to check a number or measure it again. Each table comes from a file in `docs/results`
with the date, the build, the load and more rows ([how to add one](../CONTRIBUTING.md#numbers)). PSNR is in dB. `SCENE` is
*antinous* of the 4D Light Field Benchmark (9 x 9 views), unless a row names another scene. The *peer* is [plain
PyTorch](../tests/peer/slfh_torch.py) with autograd and Adam. Compare times only within a table."""


# The head of a record, for scripts that measure.


def processor():
    """The name of this machine's processor and the number of its cores."""
    names = re.findall(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M) if Path("/proc/cpuinfo").exists() else []
    return f"{names[0] if names else 'unknown processor'}, {os.cpu_count()} cores"


def measured(program, command=None):
    """The head of a record. Without a command it is the running script with its arguments, where paths of this machine become names."""
    words = [arg if not arg.startswith("/") else Path(arg).name for arg in sys.argv[1:]]
    prefix = ["EYEBOX=PROGRAM"] if os.environ.get("EYEBOX") == program else []
    version = subprocess.run([program, "--version"], check=True, capture_output=True, text=True).stdout.split()[1]
    return {
        "command": command or " ".join([*prefix, "tools/" + Path(sys.argv[0]).name, *words]),
        "version": version,
        "build": next((build for build in ("release", "debug") if build in Path(program).parts), "not recorded"),
        "processor": processor(),
        "load": "quiet" if LOAD < 0.5 else f"load average {LOAD:.1f} at the start",
        "date": datetime.date.today().isoformat(),
    }


# Tables of files that scripts write: (names of the columns, rows).


def load(name):
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def find(rows, **wanted):
    """The first row that has these values."""
    return next(row for row in rows if all(row.get(key) == value for key, value in wanted.items()))


def one(values):
    """Each number with one decimal."""
    return [round(value, 1) for value in values]


def first_phases():
    rows = load("first-phases")["rows"]
    cases = {
        "still-life": find(rows, scene="builtin:still-life"),
        "content at a depth of 6 mm (`builtin:plane?depth=6`)": find(rows, scene="builtin:plane?depth=6"),
        "display with strong crosstalk": find(rows, display="crosstalk"),
        "far field, the transform of the picture": find(rows, far_field="25.6 mm", scene="builtin:still-life"),
    }
    table = [[name, one(row["table"]["0"]), *(one(row[begin][n]) for n in ("1", "10", "60") for begin in ("random", "table"))]
             for name, row in cases.items()]
    joint = load("simultaneous-color")["records"][1]
    assert "first phases" in joint["columns"][0]
    random, looked_up = ([row[i] for i in (1, 2, 5, 6)] for row in joint["rows"][:2])
    table.append(["simultaneous color, three colors, 16 pupils", looked_up[0], *(pair for both in zip(random[1:], looked_up[1:]) for pair in both)])
    return ["case (mean / worst, dB)", "table, no step", "random, 1 step", "table, 1", "random, 10", "table, 10", "random, 60", "table, 60"], table


def slides_gain():
    first = find(load("slides")["rows"], sets_per_slide=1, steps_per_set=1)
    gain = first["table"][0] - first["last"][0]
    return f"On new slides, the first set has {gain:.1f} dB more from a table than from the last phases (`tools/slides.py`)."


def methods():
    record = load("methods")["records"][0]
    rows = [dict(zip(record["columns"], row)) for row in record["rows"]]
    names = list(dict.fromkeys(row["method"] for row in rows if row["method"] != "stft-unfiltered"))
    kinds = {"random pupils, mean / worst": ["random pupils: mean, dB", "worst, dB"], "focal stack": ["focal stack, dB"]}
    table = []
    for scene in ("still-life", "antinous"):
        for kind, columns in kinds.items():
            found = [find(rows, scene=scene, method=name) for name in names]
            table.append([f"{scene}, {kind}"] + [[row[c] for c in columns] if len(columns) > 1 else row[columns[0]] for row in found])
    return ["PSNR, dB", *names], table


def steps():
    """The H200 next to two CPU cores and to models of other GPUs."""
    gpu = load("gpu-h200")
    cpu = load("step-times")["records"][0]["rows"][0]
    peer = gpu["peer_512x512_step_ms"]
    modeled = {row[0]: row[-2:] for row in load("step-times")["records"][2]["rows"]}
    table = []
    for name, key, *others in [
        ("512 x 512, 4 pupils", "512, 4 pupils", peer["pytorch_4_pupils"], None, None, None),
        ("512 x 512, 16 pupils", "512, 16 pupils", peer["pytorch_16_pupils"], cpu[2], None, None),
        ("1080 x 1920, 16 pupils, fp16", "1080p, 16 pupils, fp16", None, None, *modeled["16 pupils, fp16"]),
        ("1080 x 1920, 16 pupils, fp32", "1080p, 16 pupils, fp32", None, cpu[3], *modeled["16 pupils, fp32"]),
    ]:
        step = gpu["steps"][key]
        table.append([name, f'{step["step_ms"][-1]:.2f}', f'{step["moved_gb"]:.2f}', step["gpu_mib"], *others])
    large = gpu["4K, 16 pupils, green"]
    table.append(["2160 x 3840, 16 pupils", f'{large["step_ms"][0]:.2f}', None, large["gpu_mib"], None, None, None, None])
    return ["8 sub-frames", "H200, ms", "moved, GB", "GPU memory, MiB", "PyTorch on the H200, ms", "eyebox on the CPU, ms",
            "RTX 4090, modeled, ms", "Radeon 780M, modeled, ms"], table


def session():
    live = load("gpu-h200")["sessions_1080x1920x8xrgb"]["live"]
    sets, steps = (live[key] / live["seconds"] for key in ("new_sets", "steps"))
    latency = live["latency"]["sample_to_light_ms"]
    return (f"A session with 1080 x 1920 pixels in three colors has {sets:.1f} sets and {steps:.0f} steps per second, and light follows "
            f'{latency["p50"]:.1f} ms after a tracker sample (median).')


def benches():
    """Rows of other files for the table of the display model."""
    drift = load("drift")["rows"][-1]
    model = load("solver-and-model")["rows"]
    all_terms, none = (find(model, display="bench", optimizer="projection", left_out=left_out)["db"]["60"] for left_out in (None, "all"))
    seeds = [row for key, row in load("calibrations").items() if key != "about"]
    camera = [row["with_camera"] for row in load("camera-steps")["benches"].values()]

    def mean(values):
        values = list(values)
        return sum(values) / len(values)

    def pair(rows):
        return [round(mean(row[key] for row in rows), 2) for key in ("mean", "worst")]

    without = [round(mean(row[key] - row["regained"][i] for row in seeds), 2) for i, key in enumerate(("mean", "worst"))]
    regained = [round(100 * mean(row["share"][0] for row in rows)) for rows in (seeds, camera)]
    yield ["ten benches with faults that no term describes", without, pair(seeds), None, regained[0]]
    yield ["the same with `solve --camera` in the last 20 steps", None, pair(camera), None, regained[1]]
    yield ["a bench that drifts, after 8 hours (model of hour 0, model that follows)", drift["hour 0"], drift["followed"], drift["true"], None]
    yield ["a bench with all terms, 60 steps (`tools/solver_and_model.py`)", none, None, all_terms, None]


def long_search():
    ideal = find(load("float64-bound")["rows"], size=128, display="ideal")
    best = max(row[3] for search in ideal["float64"].values() for row in search["history"])
    return f'On the ideal display, 600 steps have {ideal["eyebox"]["600"][0]:.1f} dB, and a long search in float64 has {best:.1f} dB.'


def obstructions():
    rows = load("obstructions")["rows"]
    table = []
    for method in ("slfh", "smooth", "dpac"):
        row = find(rows, scene="still-life", method=method, pupils="axis")
        seen = [one(row[kind][against]) for kind, against in (("lashes", "scene"), ("lashes", "against_clear"), ("opacity", "scene"),
                                                              ("opacity", "against_clear"), ("scratches", "against_clear"))]
        table.append([method, one(row["clear"]), *seen])
    return ["method (mean / worst, dB)", "clear pupil, scene", "lashes, scene", "lashes, clear pupil", "opacity, scene", "opacity, clear pupil",
            "scratches, clear pupil"], table


# The page.

MADE = {  # Topics whose table is made above: (title, sentence, table, notes)
    "first-phases": ("First phases", "Steps start with random phases or with a table's phases, and 24 random pupils score 256 x 256 "
                     "pixels in green.", first_phases, slides_gain),
    "methods": (None, None, methods, None),
    "gpu-h200": ("Time of a step", "A model within 20 % of the H200 gives the times of GPUs that were not measured.", steps, session),
    "obstructions": ("Obstructions", "The image behind an obstruction in a pupil of 4 mm is compared with the scene and with the image of "
                     "a clear pupil.", obstructions, None),
}
ADDED = {"display-model": (benches, long_search)}
MORE = {  # Other files that a topic shows.
    "gpu-h200": ["step-times"],
    "first-phases": ["simultaneous-color", "slides"],
    "display-model": ["calibrations", "camera-steps", "drift", "solver-and-model", "float64-bound"],
}
ORDER = ["against-pytorch", "methods", "gpu-h200", "threads", "steering", "closed-loop", "two-eyes", "content", "first-phases", "speed-and-accuracy", "sequences", "motion",
         "view-synthesis", "far-field", "display-model", "obstructions", "simultaneous-color", "sources-and-masks", "on-a-device", "python-building-tests"]
INSERTED = {"on-a-device": "on-a-device.md"}  # Topics whose table is also on another page.


def shown(column, header):
    """The cells of a column as text. Decibels of a column have the same number of decimals."""
    numbers = [n for cell in column for n in (cell if isinstance(cell, list) else [cell]) if isinstance(n, float)]
    decimals = max((len(str(n).partition(".")[2]) for n in numbers), default=0)
    even = not re.search(r", (s|ms|min|GB|MiB|mm|%)\b", header)

    def text(cell):
        if isinstance(cell, list):
            return " / ".join(map(text, cell))
        return "" if cell is None else f"{cell:.{decimals}f}" if isinstance(cell, float) and even else str(cell)

    return [text(cell) for cell in column]


def markdown_table(columns, rows):
    cells = list(zip(*(shown([row[i] for row in rows], name) for i, name in enumerate(columns))))
    long = [cell for row in [columns, *cells] for cell in row if len(cell) > CELL]
    if long:
        sys.exit(f"{PAGE.name}: a cell has more than {CELL} characters: {long[0]}")
    lines = ["| " + " | ".join(row) + " |" for row in [columns, *cells]]
    return [lines[0], "|" + "---|" * len(columns), *(re.sub(r"\|  (?=\|)", "| ", line) for line in lines[1:])]


def paragraph(text):
    """The text in lines of at most WIDTH columns. No line begins with an option, which would look like a list."""
    glued = re.sub(r" (?=-|\+|\d+\.)", "\0", text)
    return [line.replace("\0", " ") for line in textwrap.wrap(glued, WIDTH, break_long_words=False, break_on_hyphens=False)]


def records_table(records):
    """The rows of the records that are on the page. With one row per command, the command is the last column."""
    by_row = len(records) > 2 and all(len(record["rows"]) == 1 for record in records)
    columns = records[0]["columns"][: records[0]["page"].get("columns")]
    rows = []
    for record in records:
        rows += [row[: len(columns)] + ([f'`{record["command"]}`'] if by_row else []) for row in record["rows"][: record["page"].get("rows")]]
    return columns + (["measured by"] if by_row else []), rows, by_row


def commands(heads):
    """The commands and processors of records, each once."""
    all_of = [head["command"] if isinstance(head["command"], list) else [head["command"]] for head in heads]
    each = dict.fromkeys(command for some in all_of for command in some)
    processors = " and ".join(dict.fromkeys(head["processor"] for head in heads))
    return f'Measured by {", ".join(f"`{command}`" for command in each)} ({processors}).'


def topic(name):
    """The lines of one topic."""
    data = load(name)
    title, sentence, made, note = MADE.get(name, (None, None, None, None))
    records = [record for record in data.get("records", []) if "page" in record]
    by_row, notes = False, list(data.get("notes", []))
    if made:
        columns, rows = made()
        heads = data.get("records", [])[:1] or [data if "command" in data else data["about"]]
        heads += [load("step-times")["records"][i] for i in (0, 2)] if made is steps else []
    else:
        columns, rows, by_row = records_table(records)
        heads = records
    add, more = ADDED.get(name, (None, None))
    rows += add() if add else []
    notes += [each() for each in (note, more) if each]
    plots = [f"[{Path(plot).stem.partition('-')[2]}]({plot})" for record in records for plot in record.get("plots", [])]
    kept = "All rows are in " + ", ".join(f"[{file}.json](results/{file}.json)" for file in [name, *MORE.get(name, [])]) + "."
    measured_by = [] if by_row else [f"{commands(heads)} {kept}" + (f" The plots are {', '.join(plots)}." if plots else "")]
    lines = [f'## {title or data["title"]}', *paragraph(" ".join([sentence or data["sentence"], *notes, *([kept] if by_row else [])]))]
    return lines + measured_by + [""] + markdown_table(columns, rows) + [""]


def page():
    head = [line for block in HEAD.split("\n\n") for line in [*paragraph(block), ""]]
    return "\n".join(head + [line for name in ORDER for line in topic(name)])


def inserted(name):
    """A page of the documents with the table of a topic between its two comments."""
    file = ROOT / "docs" / INSERTED[name]
    columns, rows, _ = records_table([record for record in load(name)["records"] if "page" in record])
    begin, end = f"<!-- {name}: made by tools/measurements.py -->\n", "<!-- end -->\n"
    text = file.read_text(encoding="utf-8")
    table = "\n".join(["", *markdown_table(columns, rows), "", ""])
    return file, text[: text.index(begin) + len(begin)] + table + text[text.index(end):]


def main():
    if sys.argv[1:2] == ["--record"]:
        print(json.dumps(measured(sys.argv[3], sys.argv[2]), indent=1))
        return 0
    for file, text in [(PAGE, page()), *map(inserted, INSERTED)]:
        if sys.argv[1:] != ["--check"]:
            file.write_text(text, encoding="utf-8")
        elif file.read_text(encoding="utf-8") != text:
            print(f"{file.relative_to(ROOT)} differs from docs/results: run tools/measurements.py", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
