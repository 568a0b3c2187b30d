"""Writes pictures, depth maps and focal stacks that are arrays to temporary files, because the library reads them."""

from __future__ import annotations

import contextlib
import os
import struct
import tempfile
from collections.abc import Iterator
from typing import Any, Callable, NamedTuple

import numpy as np

from . import _arguments, _eyebox


class Given(NamedTuple):
    """A scene in files. ``near`` and ``depth`` are the meaning of its depth map."""

    source: str
    depth_map: str | None
    near: str | None
    depth: Any


def light(value: Any, what: str) -> np.ndarray:
    """Returns one picture of linear light (row, column, 1 or 3)."""
    planes, _ = _arguments.light_field(value, what)
    if planes[0].shape[:2] != (1, 1):
        raise _arguments.wrong(ValueError, what, f"has {planes[0].shape[0]} x {planes[0].shape[1]} views: it must be one picture")
    return np.stack([plane[0, 0] for plane in planes], axis=-1)


@contextlib.contextmanager
def folder() -> Iterator[str]:
    """Makes a folder for a scene. Errors of the library do not name it, because it goes away."""
    with tempfile.TemporaryDirectory(prefix="eyebox-") as made:
        try:
            yield made
        except _eyebox.EyeboxError as error:
            error.args = tuple(str(text).replace(made + os.sep, "") for text in error.args)
            raise


def picture(folder: str, source: Any, depth_map: Any, near: Any, depth: Any) -> Given:
    """Writes a picture and its depth map, as far as they are arrays."""
    if not _arguments.is_path(source):
        shown = light(source, "scene")
        source = os.path.join(folder, "scene.tif")
        write_tiff(source, shown)
    if _arguments.is_path(depth_map):
        return Given(_arguments.path(source, "scene"), _arguments.path(depth_map, "depth_map"), near, depth)
    right = "(row, column) of depths"
    values = _arguments.array(depth_map, "depth_map", right).squeeze()
    if values.dtype.kind not in "fiu":
        raise _arguments.wrong(TypeError, "depth_map", f"has the dtype {values.dtype}: it must be {right}")
    if values.ndim != 2:
        raise _arguments.wrong(ValueError, "depth_map", f"has the shape {values.shape}: it must be {right}")
    if near is None:
        near, depth = _meaning(values, depth)
    path = os.path.join(folder, "depth_map.npy")
    np.save(path, np.ascontiguousarray(values, np.float32))
    return Given(_arguments.path(source, "scene"), path, near, depth)


def _meaning(values: np.ndarray, depth: Any) -> tuple[str, Any]:
    """Returns the near values and the depths of the ends of a map whose caller states no ``near``."""
    if values.dtype == np.uint8:
        return "bright", depth
    if values.dtype.kind == "f" and depth is None:
        known = values[np.isfinite(values)]
        if known.size == 0:
            raise _arguments.wrong(ValueError, "depth_map", "has no finite value: it must have depths in meters")
        # Every value counts, also 0, which is the image of the SLM.
        return "bright", (float(known.min()), float(known.max()))
    right = 'near="small" (distances) or near="large" (disparities) with the depth of both ends, or depths in meters in floating point'
    raise _arguments.wrong(ValueError, "near", f"is not given for a depth map of {values.dtype}: give {right}")


def focal_stack(folder: str, pictures: Any, focus: Any, aperture: Any, focal_length: Callable[[], float]) -> str:
    """Writes the pictures of a focal stack with its settings. Returns its folder."""
    if not hasattr(pictures, "__iter__"):
        raise _arguments.wrong(TypeError, "pictures", f"is {pictures!r}: it must be a sequence of pictures")
    shown = [light(one, f"pictures[{at}]") for at, one in enumerate(pictures)]
    depths = _depths(focus, "focus", focal_length)
    if len(shown) != len(depths) or not shown:
        raise _arguments.wrong(ValueError, "focus", f"has {len(depths)} depths for {len(shown)} pictures: it must have one for each")
    for at, one in enumerate(shown):
        write_tiff(os.path.join(folder, f"{at:04}.tif"), one)
    wide = _arguments.finite_quantity(aperture, "m", "aperture")
    with open(os.path.join(folder, "lightfield.toml"), "w", encoding="utf-8") as file:
        file.write(f"focus_mm = {[depth * 1e3 for depth in depths]}\naperture_mm = {wide * 1e3!r}\n")
    return folder


class Layers(NamedTuple):
    """Layers with the farthest first, as one array (layer, row, column) per color and one of the opacity last."""

    planes: list[np.ndarray]
    depths: list[float]


def layers(value: Any, depths: Any, focal_length: Callable[[], float]) -> Layers:
    """Returns layers (layer, row, column, light and opacity) in the order of their depths."""
    right = "(layer, row, column, 2 or 4), with one or three colors and the opacity last"
    plain = _arguments.array(value, "layers", right)
    if plain.ndim != 4 or plain.shape[-1] not in (2, 4):
        raise _arguments.wrong(ValueError, "layers", f"has the shape {plain.shape}: it must be {right}")
    opacity = plain[..., -1]
    if plain.dtype.kind == "u":
        opacity = opacity / np.iinfo(plain.dtype).max
    opacity = np.asarray(opacity, np.float32)
    if not (np.isfinite(opacity).all() and 0 <= opacity.min() and opacity.max() <= 1):
        raise _arguments.wrong(ValueError, "layers", "has an opacity outside 0 to 1")
    colors, _ = _arguments.light_field(plain[None, ..., :-1], "layers")
    at = _depths(depths, "depths", focal_length)
    if len(at) != len(plain):
        raise _arguments.wrong(ValueError, "depths", f"has {len(at)} depths for {len(plain)} layers: it must have one for each")
    order = np.argsort(at, kind="stable")
    planes = [np.ascontiguousarray(plane[order], np.float32) for plane in [*(color[0] for color in colors), opacity]]
    return Layers(planes, [at[index] for index in order])


def _depths(value: Any, what: str, focal_length: Callable[[], float]) -> list[float]:
    if not hasattr(value, "__iter__") or isinstance(value, str):
        raise _arguments.wrong(TypeError, what, f"is {value!r}: it must be a sequence of depths")
    return [_arguments.finite(_arguments.depth(one, focal_length, what), what) for one in value]


def write_tiff(path: str, light: np.ndarray) -> None:
    """Writes linear light (row, column, 1 or 3) as a TIFF of floating-point values, which keeps every bit."""
    rows, columns, channels = light.shape
    data = np.ascontiguousarray(light, "<f4").tobytes()
    start, short, long = 8, 3, 4
    after = start + len(data)
    # Three values of 16 bits do not fit into an entry, so they come before the list of entries.
    bits, kinds = struct.pack(f"<{channels}H", *[32] * channels), struct.pack(f"<{channels}H", *[3] * channels)
    at = {258: after, 339: after + len(bits)}
    entries = [
        (256, long, 1, columns), (257, long, 1, rows), (258, short, channels, 32), (259, short, 1, 1),
        (262, short, 1, 2 if channels == 3 else 1), (273, long, 1, start), (277, short, 1, channels),
        (278, long, 1, rows), (279, long, 1, len(data)), (339, short, channels, 3),
    ]  # fmt: skip
    with open(path, "wb") as file:
        file.write(struct.pack("<2sHI", b"II", 42, after + len(bits) + len(kinds)))
        file.write(data + bits + kinds + struct.pack("<H", len(entries)))
        for tag, kind, count, value in entries:
            file.write(struct.pack("<HHII", tag, kind, count, at[tag] if tag in at and channels > 1 else value))
        file.write(struct.pack("<I", 0))
