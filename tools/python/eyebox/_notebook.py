"""Pictures and tables for notebooks."""

from __future__ import annotations

import base64
import html
import struct
import zlib
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

#: Largest number of rows that a notebook shows of a table.
MOST_ROWS = 60


def png(light: np.ndarray) -> bytes:
    """Encodes linear light (row, column, 3) as a PNG in sRGB (IEC 61966-2-1), with 1 as white."""
    light = np.clip(np.nan_to_num(np.asarray(light, dtype=np.float64)), 0, 1)
    srgb = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    levels = np.rint(255 * srgb).astype(np.uint8)
    rows, columns, _ = levels.shape
    # Each row begins with its filter, which is none.
    lines = np.zeros((rows, 1 + 3 * columns), np.uint8)
    lines[:, 1:] = levels.reshape(rows, -1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0)
    packed = zlib.compress(lines.tobytes(), 6)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


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
