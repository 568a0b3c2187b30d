"""Tests that each notebook runs. The long form of the tests has its full size, and a limit of three minutes."""

import json
import pathlib
import re
import time

import pytest
from conftest import LONG

FOLDER = pathlib.Path(__file__).parents[3] / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
#: Pixels along an axis of each notebook, and of its short form.
SIDE, SHORT = 512, 128


def cells(notebook, kind="code"):
    return [cell for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == kind]


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook(notebook, monkeypatch, tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    if notebook.stem in ("comparison", "pytorch"):
        pytest.importorskip("torch")
    monkeypatch.syspath_prepend(FOLDER.parents[1] / "tests" / "peer")
    monkeypatch.chdir(tmp_path)
    begun, names = time.monotonic(), {"__name__": "__main__"}
    for number, cell in enumerate(cells(notebook)):
        source = "".join(cell["source"])
        source = source if LONG else re.sub(rf"\b{SIDE}\b", str(SHORT), source)
        exec(compile(source, f"{notebook.name}, cell {number}", "exec"), names)
    assert not LONG or time.monotonic() - begun < 180


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_has_its_size_and_its_pictures(notebook):
    """tools/notebooks.py stores the outputs."""
    sources = ["".join(cell["source"]) for cell in cells(notebook)]
    assert any(re.search(rf"\b{SIDE}\b", source) for source in sources)
    outputs = [output for cell in cells(notebook) for output in cell["outputs"]]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 1
    assert all(cell["execution_count"] for cell in cells(notebook))
    assert not any(output["output_type"] == "error" for output in outputs)
