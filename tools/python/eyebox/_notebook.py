"""Pictures and tables for notebooks."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from . import _eyebox

#: Largest number of rows that a notebook shows of a table.
MOST_ROWS = 60


def png(light: np.ndarray) -> bytes:
    """Encodes linear light (row, column, color) as an 8-bit sRGB PNG."""
    return bytes(_eyebox.png(np.ascontiguousarray(np.moveaxis(light, 2, 0), np.float32)))


def picture(light: np.ndarray, what: str) -> str:
    """Returns a picture of linear light (row, column, 3) as HTML."""
    data = base64.b64encode(png(light)).decode()
    return f'<img alt="{html.escape(what, quote=True)}" src="data:image/png;base64,{data}" style="max-width: 24em">'


def table(names: Sequence[str], rows: Iterable[Sequence[Any]], title: str = "") -> str:
    """Returns a table as HTML. Numbers have four digits."""
    cell = lambda value: f"<td>{html.escape(text(value))}</td>"  # noqa: E731
    shown = list(rows)
    body = "".join(f"<tr>{''.join(map(cell, row))}</tr>" for row in shown[:MOST_ROWS])
    if len(shown) > MOST_ROWS:
        body += f'<tr><td colspan="{len(names)}">{len(shown) - MOST_ROWS} more</td></tr>'
    head = "".join(f"<th>{html.escape(name)}</th>" for name in names)
    caption = f"<caption>{html.escape(title)}</caption>" if title else ""
    return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def text(value: Any) -> str:
    """Returns a value as a short text."""
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
