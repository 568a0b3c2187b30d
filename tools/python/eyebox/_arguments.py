"""Converts arguments to plain arrays, settings and numbers, from any order and kind. Each error names the argument."""

from __future__ import annotations

import itertools
import json
import math
import operator
import os
import warnings
from collections.abc import Mapping
from typing import Any, Callable, NamedTuple

import numpy as np

from . import _eyebox


class Pupil(NamedTuple):
    """The pupil of an eye in the eyebox, in meters.

    Attributes
    ----------
    x, y : float
        Center of the pupil, to the right and down.
    diameter : float
        Diameter of the pupil. The pupil of an eye has 2e-3 to 8e-3.
    depth : float
        Depth at which the eye focuses, from the image of the SLM. Positive is nearer.
    """

    x: float = 0.0
    y: float = 0.0
    diameter: float = 4e-3
    depth: float = 0.0


def warn(folder: str = "", name: str = "") -> None:
    """Issues the warnings of the library since the last call, with a name instead of a folder that goes away."""
    for text in _eyebox.take_warnings():
        warnings.warn(text.replace(folder + os.sep, "").replace(folder, name) if folder else text, stacklevel=3)


def wrong(kind: type[Exception], argument: str, text: str) -> Any:
    """Returns an exception whose message begins with the argument, and whose ``argument`` is its name."""
    error: Any = kind(f"{argument} {text}")
    error.argument = argument
    return error


def number(value: Any, what: str) -> float:
    """Returns a real number as a float. It may be in an array without axes, but not in a text."""
    try:
        if isinstance(value, (str, bytes, bytearray)):
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise wrong(TypeError, what, f"is {_short(value)}: it must be a number") from None


def finite(value: Any, what: str) -> float:
    """Returns a real number that is neither infinite nor NaN."""
    finite = number(value, what)
    if not math.isfinite(finite):
        raise wrong(ValueError, what, f"is {finite}: it must be finite")
    return finite


def _of_text(read: Callable[..., float], text: str, against: Any, what: str) -> float:
    """Reads a text with a unit as a number. An error names the argument."""
    try:
        return read(text, against)
    except (TypeError, ValueError) as error:
        error.args = (f"{what}: {error}",)
        setattr(error, "argument", what)
        raise


def quantity(value: Any, unit: str, what: str) -> float:
    """Returns a real number in ``unit``. It may be a text with any unit of this dimension, such as "4mm"."""
    return _of_text(_eyebox.quantity, value, unit, what) if isinstance(value, str) else number(value, what)


def finite_quantity(value: Any, unit: str, what: str) -> float:
    """Returns a quantity that is neither infinite nor NaN."""
    return finite(quantity(value, unit, what), what)


def quantities(value: Any, unit: str, what: str, right: str) -> list[float]:
    """Returns one quantity for each name in ``right``, which separates names by commas."""
    return [quantity(one, unit, what) for one in parts(value, what, right)]


def depth(value: Any, focal_length: Callable[[], float] | None, what: str = "depth") -> Any:
    """Returns a depth in meters.

    It may be a number, or a text in millimeters, diopters ("0.5D") or meters from the eye ("2m"). Without a focal
    length a text stays a text.
    """
    if not isinstance(value, str):
        return number(value, what)
    metres = _of_text(_eyebox.depth, value, 1.0 if focal_length is None else focal_length(), what)
    return value if focal_length is None else metres


#: Endings of keys of display files and of descriptions of benches, and the unit of their numbers.
_ENDINGS = {"_um": "um", "_mm": "mm", "_nm": "nm", "_hz": "Hz", "_us": "us", "_ms": "ms", "_deg": "deg"}


def with_units(fields: Mapping[str, Any], within: str = "") -> dict[str, Any]:
    """Returns keys with numbers in the unit of each key instead of texts such as "8um", also in tables of keys."""

    def number(value: Any, unit: str | None, what: str) -> Any:
        if isinstance(value, str):
            return value if unit is None else quantity(value, unit, what)
        if isinstance(value, Mapping):
            return {key: number(one, unit or _unit(key), f"{what}[{key!r}]") for key, one in value.items()}
        if isinstance(value, (list, tuple)):
            return [number(one, unit, f"{what}[{at}]") for at, one in enumerate(value)]
        return value

    return {key: number(value, _unit(key), f"{within}[{key!r}]" if within else key) for key, value in fields.items()}


def _unit(key: Any) -> str | None:
    """Returns the unit that the name of a key states."""
    return next((unit for ending, unit in _ENDINGS.items() if str(key).endswith(ending)), None)


def seed(value: Any, rng: Any) -> Any:
    """Returns a seed from ``seed``, or from the next number of a generator of NumPy. None leaves the default."""
    if rng is None:
        return value
    if value is not None:
        raise wrong(TypeError, "rng", "and seed are both given: give one")
    if isinstance(rng, (np.random.Generator, np.random.RandomState)):
        draw = rng.integers if isinstance(rng, np.random.Generator) else rng.randint
        return int(draw(0, 1 << 32, dtype=np.uint64))
    try:
        return operator.index(rng)
    except TypeError:
        right = "a numpy.random.Generator or a whole number"
        raise wrong(TypeError, "rng", f"is {_short(rng)}: it must be {right}") from None


def size(value: Any) -> list[int]:
    """Returns rows and columns from a pair, or from a text such as "1080p"."""
    if isinstance(value, str):
        try:
            return _eyebox.size(value)
        except ValueError as error:
            error.args = (f"size: {error}",)
            setattr(error, "argument", "size")
            raise
    try:
        rows, columns = value
    except (TypeError, ValueError):
        raise wrong(TypeError, "size", f"is {value!r}: it must be (rows, columns)") from None
    most = 65536
    return [count(rows, "size[0]", most), count(columns, "size[1]", most)]


def whole(value: Any, what: str) -> int:
    """Returns a whole number of any type that Python accepts as an index."""
    try:
        return operator.index(value)
    except TypeError:
        raise wrong(TypeError, what, f"is {_short(value)}: it must be a whole number") from None


def count(value: Any, what: str, most: int = 1_000_000, *, least: int = 1) -> int:
    """Returns a whole number from ``least`` to ``most``."""
    number = whole(value, what)
    if not least <= number <= most:
        raise wrong(ValueError, what, f"is {number}: it must be {least} to {most}")
    return number


def parts(value: Any, what: str, right: str) -> list[Any]:
    """Returns one value for each name in ``right``, which separates names by commas, without conversion."""
    try:
        # An iterable may have no end, such as a session.
        each = list(itertools.islice(value, len(right.split(",")) + 1))
    except TypeError:
        raise wrong(TypeError, what, f"is {_short(value)}: it must be ({right})") from None
    if len(each) != len(right.split(",")) or isinstance(value, (str, bytes)):
        raise wrong(ValueError, what, f"is {_short(value)}: it must be ({right})")
    return each


def ends(value: Any, what: str) -> list[Any]:
    """Returns both ends of a range without conversion."""
    return parts(value, what, "one end, the other")


def numbers(value: Any, what: str, right: str) -> list[float]:
    """Returns one number for each name in ``right``, which separates names by commas."""
    return [number(one, what) for one in parts(value, what, right)]


def pupil(x: Any, y: Any, diameter: Any, focus: Any, focal_length: Callable[[], float] | None) -> tuple[float, float, float, float]:
    """Returns the four numbers (x, y, diameter, depth) of a pupil."""
    place = quantity(x, "m", "x"), quantity(y, "m", "y"), quantity(diameter, "m", "diameter")
    return *place, depth(focus, focal_length)


def pupils(value: Any, focal_length: Callable[[], float] | None) -> list[tuple[float, float, float, float]]:
    """Returns several pupils, each as four numbers (x, y, diameter, depth)."""
    try:
        each = [parts(one, "pupils", "x, y, diameter, depth") for one in value]
    except TypeError:
        right = "a sequence of (x, y, diameter, depth)"
        raise wrong(TypeError, "pupils", f"is {_short(value)}: it must be {right}") from None
    if not each:
        raise wrong(ValueError, "pupils", f"is {_short(value)}: it must be one or more of (x, y, diameter, depth)")
    return [pupil(x, y, diameter, focus, focal_length) for x, y, diameter, focus in each]


def path(value: Any, what: str) -> str:
    """Returns a path as text."""
    try:
        text = os.fsdecode(value)
    except TypeError:
        raise wrong(TypeError, what, f"is {_short(value)}: it must be a path") from None
    if not text.isascii() and any("\ud800" <= letter <= "\udfff" for letter in text):
        raise wrong(ValueError, what, f"is {text!r}: the name is not UTF-8, so rename the file")
    return text


def name(value: Any, what: str) -> str | None:
    """Returns one name or None."""
    if value is not None and not isinstance(value, str):
        raise wrong(TypeError, what, f"is {_short(value)}: it must be a name")
    return value


def is_path(value: Any) -> bool:
    """Returns whether a value is a name or a path and not the object itself."""
    return isinstance(value, (str, os.PathLike))


#: Protocols of arrays of other libraries, which are PyTorch, JAX, h5py, zarr, xarray, dask, pandas and Pillow.
_PROTOCOLS = ("__dlpack__", "__array__", "__array_interface__", "to_numpy")


def is_array(value: Any) -> bool:
    """Returns whether a value may hold numbers."""
    return isinstance(value, (np.ndarray, list, tuple)) or any(hasattr(value, name) for name in _PROTOCOLS)


def _is_picture(value: Any) -> bool:
    """Returns whether a value is a picture of Pillow, which may store indices instead of colors."""
    return isinstance(getattr(value, "mode", None), str) and hasattr(value, "convert") and hasattr(value, "getbands")


def _of_picture(value: Any) -> np.ndarray:
    """Returns the pixels of a picture of Pillow. Transparency is composited over black, as for files."""
    if value.mode in ("RGBA", "LA", "PA") or "transparency" in getattr(value, "info", {}):
        value = value.convert("RGBA")
        over = value.convert("RGB")
        over.paste((0, 0, 0), mask=value.getchannel("A").point(lambda opacity: 255 - opacity))
        return np.asarray(over)
    if value.mode in ("L", "RGB", "F") or value.mode.startswith("I"):
        return np.asarray(value)
    return np.asarray(value.convert("L" if value.mode == "1" else "RGB"))


def colors(value: Any, has: list[str]) -> list[str]:
    """Returns the names of colors. None means all colors of ``has``."""
    if value is None:
        return list(has)
    names = [value] if isinstance(value, str) else value
    try:
        names = list(itertools.islice(names, len(has) + 1))
    except TypeError:
        names = [names]
    if not names or not all(isinstance(name, str) for name in names):
        raise wrong(TypeError, "color", f"is {_short(value)}: it must be one or more of {', '.join(has)}")
    return names


def array(value: Any, what: str, right: str) -> np.ndarray:
    """Returns an array on the host.

    An array that is already there is not copied. NumPy converts lists, DLPack gives arrays of PyTorch and JAX, and
    data sets of h5py, zarr, xarray and dask are read. Integers have the byte order of the machine.
    ``right`` describes a valid array in errors.
    """
    try:
        if isinstance(value, np.ndarray):
            plain = value
        elif _is_picture(value):
            plain = _of_picture(value)
        elif hasattr(value, "to_numpy"):
            plain = np.asarray(value.to_numpy())
        elif hasattr(value, "__dlpack__"):
            plain = np.from_dlpack(value)
        else:
            plain = np.asarray(value)
    except Exception as error:  # A foreign library may raise any exception.
        text = f"is {_short(value)}, of which NumPy makes no array ({error}): it must be {right}"
        raise wrong(TypeError, what, text) from error
    if plain.size == 0 or plain.ndim == 0:
        raise wrong(ValueError, what, f"has the shape {plain.shape}: it must be {right}")
    if isinstance(plain, np.ma.MaskedArray) and np.ma.is_masked(plain):
        raise wrong(ValueError, what, "has masked values: replace them, as by array.filled(0)")
    return plain.astype(plain.dtype.newbyteorder("="), copy=False) if plain.dtype.kind in "iu" else plain


def _float32(plain: np.ndarray) -> np.ndarray:
    # A number that is too large for float32 becomes infinite. The library then refuses it and names its place.
    with np.errstate(over="ignore", invalid="ignore"):
        return np.ascontiguousarray(plain, dtype=np.float32)


def _levels(plain: np.ndarray) -> int:
    """Returns the likely number of levels of integers, which is 256 or more."""
    return 1 << max(int(plain.max()).bit_length(), 8) if plain.max() < 1 << 16 else 1 << 16


def radians(value: Any, what: str) -> np.ndarray:
    """Returns phases (sub-frame, row, column) from floating-point numbers of this shape or of (row, column)."""
    right = "(sub-frame, row, column) or (row, column) of floating-point radians"
    plain = array(value, what, right)
    if plain.dtype.kind in "iu":
        remedy = f"gray levels become phases by array * (2 * numpy.pi / {_levels(plain)})"
        raise wrong(TypeError, what, f"has the dtype {plain.dtype}: it must be {right}; {remedy}")
    if plain.dtype.kind != "f":
        raise wrong(TypeError, what, f"has the dtype {plain.dtype}: it must be {right}")
    if plain.ndim not in (2, 3):
        raise wrong(ValueError, what, f"has the shape {plain.shape}: it must be {right}")
    return _float32(plain if plain.ndim == 3 else plain[None])


def light_field(value: Any, what: str) -> tuple[list[np.ndarray], int]:
    """Returns one array (view row, view column, row, column) of linear light per color, and the number of colors.

    Floating-point values are linear light. Values of 8 and 16 bits are sRGB, as in pictures.
    """
    right = (
        "(view row, view column, row, column[, 3]), or (row, column[, 3]) of one view, "
        "of linear light in floating point or of sRGB in uint8 or uint16"
    )
    plain = array(value, what, right)
    if plain.dtype.kind in "iu" and plain.dtype not in (np.uint8, np.uint16):
        white = _levels(plain) - 1
        remedy = f"if {white} is white, array.astype(numpy.uint{8 if white < 256 else 16}) is sRGB and array / {white} is linear light"
        raise wrong(TypeError, what, f"has the dtype {plain.dtype}, and nothing states which value is white: it must be {right}; {remedy}")
    if plain.dtype.kind not in "fbu":
        raise wrong(TypeError, what, f"has the dtype {plain.dtype}: it must be {right}")
    if plain.ndim in (3, 5) and plain.shape[-1] in (1, 3):
        planes = [plain[..., color] for color in range(plain.shape[-1])]
    elif plain.ndim in (2, 4):
        planes = [plain]
    else:
        raise wrong(ValueError, what, f"has the shape {plain.shape}: it must be {right}")
    if plain.dtype == np.uint16:
        _check_full_scale(plain, what)
    if plain.dtype.kind == "u":
        table = _eyebox.linear_light(int(np.iinfo(plain.dtype).max) + 1)
        planes = [table[plane] for plane in planes]
    planes = [_float32(plane if plane.ndim == 4 else plane[None, None]) for plane in planes]
    return planes, len(planes)


def _check_full_scale(words: np.ndarray, what: str) -> None:
    """Refuses 16-bit values that may have 14 bits or fewer, or that may be a dark picture.

    Multiples of 257 are accepted, because they are 8-bit values that were stretched.
    """
    most = int(words.max())
    if 0 < most <= 16383 and (words % 257).any():
        error = _eyebox.SceneError(
            f"{what}: 16-bit values up to {most}, as of {max(most.bit_length(), 8)} bits or of a dark picture, and nothing says "
            "which value is white: scale them, as by (array * (65535 / 1023)).astype(numpy.uint16)"
        )
        error.code, error.fields = "scene/full-scale", {"file": what, "white": most}
        raise error


def toml(settings: dict[str, Any]) -> str:
    """Returns settings as TOML. None leaves the default of a setting."""
    lines = (f"{_key(key)} = {_value(key, value)}" for key, value in settings.items() if value is not None)
    return "\n".join(lines)


def _key(key: Any) -> str:
    return _text(str(key))


def _text(text: str) -> str:
    # A string of JSON is a string of TOML, except for the character DEL.
    return json.dumps(text).replace("\x7f", "\\u007f")


#: Most values of an array that is a setting. A larger one is a mistake, and would fill the memory as a list.
_MOST_VALUES = 1 << 20


def plain(value: Any, what: str = "a setting") -> Any:
    """Converts numbers of other libraries, and arrays and containers of them, to types of Python."""
    if isinstance(value, (str, bytes, bool, np.bool_)) or value is None:
        return bool(value) if isinstance(value, np.bool_) else value
    if isinstance(value, dict):
        return {key: plain(one, what) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(one, what) for one in value]
    if getattr(value, "ndim", 0) and hasattr(value, "tolist"):
        if (count := math.prod(value.shape)) > _MOST_VALUES:
            raise wrong(ValueError, what, f"has {count} values: it must have {_MOST_VALUES} or fewer")
        return plain(value.tolist(), what)
    for protocol, to in (("__index__", operator.index), ("__float__", float)):
        try:
            if hasattr(value, protocol):
                return to(value)
        except TypeError:
            continue
    return value


def _value(name: str, value: Any) -> str:
    value = plain(value, name)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if is_path(value):
        return _text(os.fsdecode(value))
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(name, one) for one in value) + "]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(key)} = {_value(f'{name}.{key}', one)}" for key, one in value.items()) + " }"
    raise wrong(TypeError, name, f"is {_short(value)}: it must be a number, a text, a bool, or a list or dict of them")


def _short(value: Any) -> str:
    """Returns a value as a short text for a message."""
    text = repr(value)
    text = " ".join(text.split())
    return text if len(text) <= 60 else f"{text[:40]}... ({type(value).__name__})"
