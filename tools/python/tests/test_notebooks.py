"""Tests that each notebook runs in less than three minutes."""

import json
import pathlib
import time

import pytest

FOLDER = pathlib.Path(__file__).parents[3] / "docs" / "notebooks"


@pytest.mark.parametrize("notebook", sorted(FOLDER.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebook(notebook, monkeypatch, tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    if notebook.stem in ("comparison", "pytorch"):
        pytest.importorskip("torch")
    monkeypatch.syspath_prepend(FOLDER.parents[1] / "tests" / "peer")
    monkeypatch.chdir(tmp_path)
    begun, names = time.monotonic(), {"__name__": "__main__"}
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    for number, cell in enumerate(cells):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"{notebook.name}, cell {number}", "exec"), names)
    assert time.monotonic() - begun < 180
