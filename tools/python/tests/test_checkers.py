"""Tests that type checkers find every misuse in hints_example.py, and no error in its uses."""

import importlib.util
import json
import os
import pathlib
import re
import subprocess
import sys

import eyebox
import pytest

EXAMPLE = pathlib.Path(__file__).with_name("hints_example.py")
#: Folder in which the package is.
SITE = pathlib.Path(eyebox.__file__).resolve().parents[1]
LINES = EXAMPLE.read_text(encoding="utf-8").splitlines()
MISUSES = {number for number, line in enumerate(LINES, 1) if line.endswith("# misuse")}


def mypy(folder):
    """Returns the lines in which mypy finds errors."""
    own = {} if SITE.name in ("site-packages", "dist-packages") else {"MYPYPATH": str(SITE)}
    words = ["--strict", "--no-error-summary", "--cache-dir", folder / "cache", "--python-executable", sys.executable, EXAMPLE]
    run = subprocess.run(
        [sys.executable, "-m", "mypy", *words], env={**os.environ, **own}, cwd=folder, capture_output=True, text=True
    )
    found = re.findall(rf"^.*{EXAMPLE.name}:(\d+): error", run.stdout, re.M)
    assert found, run.stdout + run.stderr
    return {int(line) for line in found}


def pyright(folder):
    """Returns the lines in which pyright finds errors."""
    (folder / EXAMPLE.name).write_text(EXAMPLE.read_text(encoding="utf-8"), encoding="utf-8")
    config = {"include": [EXAMPLE.name], "extraPaths": [str(SITE)], "typeCheckingMode": "standard"}
    (folder / "pyrightconfig.json").write_text(json.dumps(config))
    words = ["--outputjson", "--pythonpath", sys.executable, "--project", folder]
    run = subprocess.run([sys.executable, "-m", "pyright", *words], capture_output=True, text=True)
    if not run.stdout.lstrip().startswith("{"):
        pytest.skip(f"pyright does not start here: {run.stderr.strip()[-200:]}")
    found = json.loads(run.stdout)["generalDiagnostics"]
    return {one["range"]["start"]["line"] + 1 for one in found if one["severity"] == "error" and one["file"].endswith(EXAMPLE.name)}


@pytest.mark.parametrize("checker", [mypy, pyright], ids=lambda checker: checker.__name__)
def test_every_misuse_is_found_and_no_use_is(checker, tmp_path):
    if importlib.util.find_spec(checker.__name__) is None:
        pytest.skip(f"{checker.__name__} is not installed")
    found = checker(tmp_path)
    assert len(MISUSES) >= 35
    assert not {line: LINES[line - 1] for line in MISUSES - found}, "not found"
    assert not {line: LINES[line - 1] for line in found - MISUSES}, "no misuse"
