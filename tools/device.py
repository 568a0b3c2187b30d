#!/usr/bin/env python3
"""Measures the size of the program for devices, and the first light and the memory of a session of 1080 x 1920 pixels.

    CARGO_PROFILE_DEVICE_STRIP=none cargo build --profile device -p eyebox-tools --bin eyebox --no-default-features
    tools/device.py target/device/eyebox [docs/results/on-a-device.json]

It needs nm, size and strip. The program keeps its symbols for the table of its parts, and a stripped copy is measured. The
script fails if this copy is larger than LIMIT. Without a file it prints the table.
"""
import collections
import json
import lzma
import pathlib
import re
import subprocess
import sys
import tempfile

from measurements import measured

LIMIT = 18_000_000  # bytes of the stripped program
PARTS = 12  # crates in the table
SECTIONS = {"code": [".text"], "constants": [".rodata"], "tables for unwinding": [".eh_frame", ".eh_frame_hdr", ".gcc_except_table"]}
SIZE = ["--size", "1080x1920", "--color", "green", "--engine", "cpu"]
SHOW = ["show", "h.zarr", "--display", "planes8", "--engine", "cpu", "--loop", "--duration", "10", "--stats", "s.json"]
SESSIONS = {"played as it was solved": [], "refined for a simulated eye": ["--tracker", "simulated"]}


def crates(program):
    """The bytes of code and data of each crate, by the names of symbols. A symbol without a crate counts as other."""
    listed = subprocess.run(["nm", "-S", "-C", "--defined-only", program], check=True, capture_output=True, text=True).stdout
    sizes, seen = collections.Counter(), set()
    for line in listed.splitlines():
        place, size, kind, name = (line.split(" ", 3) + [""] * 4)[:4]
        if len(size) != 16 or place in seen or kind in "bB":
            continue
        seen.add(place)
        crate = re.match(r"[<&\[(*]*(?:mut |dyn |\[)*([a-z]\w+)(?:::|$)", name)
        sizes[crate.group(1) if crate else "other"] += int(size, 16)
    return sizes


def sections(program):
    """The bytes of each group of sections."""
    listed = subprocess.run(["size", "-A", program], check=True, capture_output=True, text=True).stdout
    sizes = {words[0]: int(words[1]) for words in map(str.split, listed.splitlines()) if len(words) == 3 and words[1].isdigit()}
    return {name: sum(sizes.get(section, 0) for section in group) for name, group in SECTIONS.items()}


def sessions(program):
    """The time to the first light and the peak memory of each kind of session."""
    with tempfile.TemporaryDirectory() as folder:
        def run(*words):
            subprocess.run([program, *words], check=True, cwd=folder, capture_output=True)

        run("solve", "builtin:plane", "--steps", "1", "--frames", "8", "--views", "3", "-o", "h.zarr", *SIZE)
        for name, more in SESSIONS.items():
            run(*SHOW, *more)
            stats = json.loads((pathlib.Path(folder) / "s.json").read_text(encoding="utf-8"))
            yield f"first light after the start, 1080 x 1920 pixels and 8 sub-frames, {name}", f'{stats["first_light_s"]:.2f} s'
            yield f"largest resident memory, the same content, {name}", f'{stats["peak_memory_mib"]} MiB'


def main():
    program = pathlib.Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as folder:
        stripped = pathlib.Path(folder) / "eyebox"
        subprocess.run(["strip", "-o", stripped, program], check=True)
        size = stripped.stat().st_size
        rows = [["stripped program", f"{size / 1e6:.2f} MB"]]
        packed = len(lzma.compress(stripped.read_bytes(), preset=9))
        rows += [["the same compressed by xz, as in an image of a root file system", f"{packed / 1e6:.2f} MB"]]
        rows += [[f"of the program {name}", f"{of / 1e6:.2f} MB"] for name, of in sections(stripped).items()]
        rows += [[f"of code and constants `{name}`", f"{of / 1e6:.2f} MB"] for name, of in crates(program).most_common(PARTS)]
        rows += map(list, sessions(stripped))
    if len(sys.argv) > 2:
        record = measured(str(program), "tools/device.py target/device/eyebox")
        result = {
            "title": "On a device",
            "sentence": "The program of the profile `device` has the commands `solve`, `show` and `device`.",
            "notes": ["The parts are crates by the names of symbols. Generic code counts for the crate that defines it."],
            "records": [record | {"build": "device", "page": {}, "columns": ["what", "result"], "rows": rows}],
        }
        pathlib.Path(sys.argv[2]).write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    for name, value in rows:
        print(f"{value:>10}  {name}")
    if size > LIMIT:
        sys.exit(f"the stripped program has {size} bytes, more than {LIMIT}")


if __name__ == "__main__":
    main()
