"""The gray levels that SLMs of slmsuite receive."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import _arguments, _eyebox
from ._display import Display
from ._hologram import Hologram

#: Keys of an encoding that describe video frames. The driver of slmsuite makes the frames instead.
_OF_FRAMES = ("packing", "map", "channel", "channel_order", "codes", "cells", "flip_video")


def slm_size(slm: Any) -> tuple[int, int]:
    """Returns rows and columns of an SLM. slmsuite's ``shape`` has this order."""
    rows, columns = _arguments.size(tuple(slm.shape))
    return rows, columns


def bit_depth(slm: Any) -> int:
    """Returns the bits of a level of an SLM."""
    return _arguments.count(slm.bitdepth, "slm.bitdepth", 16)


def level_type(slm: Any) -> np.dtype[Any]:
    """Returns the integer type that ``slm.set_phase`` accepts as levels. It refuses every other integer type."""
    own = getattr(slm, "dtype", None)
    return np.dtype(own if own is not None else np.uint8 if bit_depth(slm) <= 8 else np.uint16)


def plain_array(value: Any) -> np.ndarray:
    """Returns an array of slmsuite on the host. An SLM with ``gpu=True`` has arrays of CuPy."""
    return np.asarray(value.get() if hasattr(value, "get") else value)


def look_up(slm: Any, wavelengths: dict[str, float]) -> dict[str, Any]:
    """Returns the look-up table of an SLM of slmsuite as keys of an encoding, for wavelengths in meters.

    ``gamma`` has the waves of each level. Otherwise ``wav_design_um`` is the wavelength of which all levels are a wave.
    """
    gamma = getattr(slm, "gamma", None)
    if gamma is not None:
        return {"phases_turns": plain_array(gamma).ravel().tolist()}
    count, design = 2 ** bit_depth(slm), float(slm.wav_design_um) * 1e-6
    return {"two_pi_level": {color: count * wavelength / design for color, wavelength in wavelengths.items()}}


def levels(hologram: Hologram, slm: Any, color: str | None = None, display: Any = None) -> np.ndarray:
    """Computes the gray levels that an SLM of slmsuite shows for a hologram.

    Parameters
    ----------
    hologram : Hologram
        The hologram.
    slm : SLM of slmsuite
        The SLM, which determines the size and the type of the levels.
    color : str, optional
        Color to show. It is optional if the hologram has only one color.
    display : Display, str or path, optional
        Display with the phases of the levels. The default is the display of the solve if it is a preset or a file.
        Otherwise the default is the look-up table of the SLM, as for :func:`display_of`. Keys about video frames, such
        as ``packing`` and ``codes``, have no effect, because the driver of slmsuite makes the frames.

    Returns
    -------
    numpy.ndarray
        (sub-frame, row, column), of the integer type of the SLM. ``slm.set_phase`` sends them as they are.

    Raises
    ------
    ValueError
        If the SLM and the display differ in their size or in their number of levels.
    EncodeError
        If the hologram cannot be encoded.
    """
    if not isinstance(hologram, Hologram):
        raise _arguments.wrong(TypeError, "hologram", f"is {hologram!r}: it must be an eyebox.Hologram")
    shown = _shown_on(hologram, slm, display)
    names = hologram.colors
    [name] = _one_color(color, names)
    size, count = slm_size(slm), 2 ** bit_depth(slm)
    if tuple(shown.resolution) != size:
        (rows, columns), (height, width) = size, shown.resolution
        text = f"has {rows} x {columns} pixels, but the display has {height} x {width}"
        raise _arguments.wrong(ValueError, "slm", text)
    if shown.levels != count:
        raise _arguments.wrong(
            ValueError,
            "slm",
            f"has {count} levels, but the display has {shown.levels}: give display=display.replace(levels={count}), "
            "with the phases of these levels"
        )
    # The lower byte of a level is in red, and the upper byte in green.
    place = {"sub_frame": 0, "channel": "rgb", "bits": list(range((count - 1).bit_length()))}
    entries = [{**place, "color": one, "video_frame": at} for at, one in enumerate(names)]
    frames = hologram.encode(shown.replace(encoding={**dict.fromkeys(_OF_FRAMES), "packing": "map", "map": entries}))
    frames = frames[names.index(name) :: len(names)].astype(np.uint16)
    return (frames[..., 0] | frames[..., 1] << 8).astype(level_type(slm))


def _shown_on(hologram: Hologram, slm: Any, display: Any) -> Display:
    """Returns the given display, the display of the solve, or its optics with the look-up table of the SLM."""
    try:
        return hologram._shown_on(display)
    except _eyebox.DisplayError:
        if display is not None:
            raise
    made = hologram.display
    return made.replace(levels=2 ** bit_depth(slm), encoding=look_up(slm, made.wavelengths))


def _one_color(color: Any, has: list[str]) -> list[str]:
    names = _arguments.colors(color, has)
    if len(names) != 1 or names[0] not in has:
        text = f"is {color!r}: an SLM shows one color at a time. It must be one of {', '.join(has)}"
        raise _arguments.wrong(ValueError, "color", text)
    return names
