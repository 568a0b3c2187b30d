"""Films of a hologram through a moving pupil, by the command."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, Literal

from . import _arguments, _given
from ._command import command
from ._hologram import Hologram

if TYPE_CHECKING:
    from ._types import Path, Quantity

_KEYS = ("t", "x", "y", "diameter", "depth", "jump")


def film(
    hologram: Hologram | Path,
    keys: Iterable[Mapping[str, Any]],
    out: Path,
    *,
    what: Literal["image", "target", "both"] | None = None,
    rate: Quantity = 30.0,
    blinks: Iterable[Quantity] = (),
    binning: int = 1,
) -> dict[str, Any]:
    """Makes a film of a hologram through a moving pupil (``eyebox render --path``).

    Parameters
    ----------
    hologram : Hologram or path
        Hologram, or the file of a hologram or of a sequence.
    keys : sequence of dict
        Keys of the path of the eye, by rising time. Each has the time ``t`` in seconds and any of ``x``, ``y``,
        ``diameter`` and ``depth`` in meters. ``jump=True`` is a saccade. Values between two keys follow a smooth
        movement.
    out : path
        NAME.y4m, or a folder for one PNG per frame.
    what : {"image", "target", "both"}, optional
        Content. The default is both, or the image alone if the scene of the hologram was an array.
    rate : float
        Frames per second.
    blinks : sequence of float
        Times at which blinks begin, in seconds.
    binning : int
        Number of pixels along each axis whose mean becomes one pixel.

    Returns
    -------
    dict
        Report of the command.
    """
    try:
        path = {
            "rate_hz": _arguments.finite_quantity(rate, "Hz", "rate"),
            "keys": [_key(one, f"keys[{at}]") for at, one in enumerate(keys)],
            "blinks_s": [_arguments.finite_quantity(one, "s", "blinks") for one in blinks],
        }
    except TypeError as error:
        if hasattr(error, "argument"):
            raise
        raise _arguments.wrong(TypeError, "keys", f"is {keys!r}: it must be a sequence of dicts") from None
    if not path["keys"]:
        raise _arguments.wrong(ValueError, "keys", "is empty: it must have one or more")
    with _given.folder() as folder:
        if isinstance(hologram, Hologram):
            source = os.path.join(folder, "hologram.zarr")
            hologram.save(source)
            if what is None and hologram.metadata.get("scenes") and hologram.metadata["scenes"][0].get("views"):
                what = "image"
        else:
            source = _arguments.path(hologram, "hologram")
        file = os.path.join(folder, "path.json")
        with open(file, "w", encoding="utf-8") as draft:
            json.dump(path, draft)
        words: list[Any] = ["render", source, "--path", file, "--out", out, "--binning", _arguments.count(binning, "binning")]
        return command(*words, *([] if what is None else ["--what", what]))


def _key(key: Any, what: str) -> dict[str, Any]:
    """Returns a key of a path in the units of the command."""
    if not isinstance(key, Mapping) or "t" not in key or any(name not in _KEYS for name in key):
        raise _arguments.wrong(TypeError, what, f"is {key!r}: it must be a dict with t and any of {', '.join(_KEYS[1:])}")
    made: dict[str, Any] = {"t_s": _arguments.finite_quantity(key["t"], "s", f"{what}.t")}
    for name in ("x", "y", "diameter"):
        if name in key:
            made[f"{name}_mm"] = _arguments.finite_quantity(key[name], "mm" if isinstance(key[name], str) else "m", f"{what}.{name}")
            if not isinstance(key[name], str):
                made[f"{name}_mm"] *= 1e3
    if "depth" in key:
        depth = key["depth"]
        made["focus"] = depth if isinstance(depth, str) else _arguments.finite(depth, f"{what}.depth") * 1e3
    if key.get("jump"):
        made["jump"] = True
    return made
