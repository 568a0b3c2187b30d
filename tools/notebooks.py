#!/usr/bin/env python3
"""Runs notebooks of docs/notebooks and stores their outputs, so that a forge shows their pictures.

tools/notebooks.py [NAME...] runs all notebooks, or some by their names, with the package of this Python. It needs
Matplotlib.
"""

import ast
import base64
import contextlib
import io
import json
import os
import pathlib
import sys
import tempfile
import time

FOLDER = pathlib.Path(__file__).resolve().parents[1] / "docs" / "notebooks"
#: Pixels per inch of plots. The files stay small, because they are committed.
RESOLUTION = 60


def picture(data):
    return {"image/png": base64.b64encode(data).decode() + "\n"}


def displayed(value):
    """Returns a value as a notebook displays it."""
    data = {"text/plain": lines(repr(value))}
    for method, kind in (("_repr_html_", "text/html"), ("_repr_png_", "image/png")):
        shown = getattr(value, method, lambda: None)()
        if shown is not None:
            data |= picture(shown) if kind == "image/png" else {kind: lines(shown)}
    return data


def lines(text):
    return text.splitlines(keepends=True)


def run(source, names, number):
    """Runs a cell and returns its outputs. The value of its last line is displayed."""
    import matplotlib.pyplot as plt

    outputs, out = [], io.StringIO()

    def flush():
        if text := out.getvalue():
            outputs.append({"output_type": "stream", "name": "stdout", "text": lines(text)})
            out.seek(0)
            out.truncate()

    def show(*_, **__):
        flush()
        for figure in map(plt.figure, plt.get_fignums()):
            data = io.BytesIO()
            figure.savefig(data, format="png", dpi=RESOLUTION, bbox_inches="tight")
            shown = {"text/plain": lines(repr(figure))} | picture(data.getvalue())
            outputs.append({"output_type": "display_data", "data": shown, "metadata": {}})
        plt.close("all")

    plt.show = show
    body = ast.parse(source).body
    last = body.pop() if body and isinstance(body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(out):
        exec(compile(ast.Module(body, []), f"cell {number}", "exec"), names)
        value = None if last is None else eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), names)
        show()
    flush()
    if value is not None:
        outputs.append({"output_type": "execute_result", "execution_count": number, "data": displayed(value), "metadata": {}})
    return outputs


def main():
    import matplotlib

    matplotlib.use("Agg")
    # The notebooks run in another folder than their own.
    sys.path.append(str(FOLDER.parents[1] / "tests" / "peer"))
    wanted = sys.argv[1:] or [path.stem for path in sorted(FOLDER.glob("*.ipynb"))]
    for name in wanted:
        path = FOLDER / f"{name}.ipynb"
        notebook = json.loads(path.read_text(encoding="utf-8"))
        names, begun = {"__name__": "__main__"}, time.monotonic()
        code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
        for number, cell in enumerate(notebook["cells"], 1):
            cell.setdefault("id", f"{name}-{number}")
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            for number, cell in enumerate(code, 1):
                cell["outputs"] = run("".join(cell["source"]), names, number)
                cell["execution_count"] = number
            os.chdir(FOLDER)
        path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        print(f"{name}: {time.monotonic() - begun:.0f} s, {path.stat().st_size >> 10} KiB")


if __name__ == "__main__":
    main()
