"""Scenes, and photographs of them."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from . import _arguments, _eyebox, _files
from ._display import Display, display_of, engine_of


class Scene:
    """A scene as a light field: views from a grid of places in the pupil plane, of the size of a display's pictures.

    Parameters
    ----------
    source : str, path or array
        "builtin:NAME", a folder of views or a picture (docs/scenes.md); or a light field of one's own:
        (view row, view column, row, column) or (view row, view column, row, column, colour) with 3 colours; a single view may
        leave out its first two axes. A file of such an array is .npy, .npz, .mat (needs SciPy; version 7.3 needs h5py) or .h5
        (needs h5py). Floating point is linear light, finite and not negative, with 1 as full scale; uint8 and
        uint16 are sRGB. NumPy arrays in any order, lists, and whatever speaks DLPack (PyTorch, JAX) on the CPU. View (r, c)
        looks from x = (c - (columns - 1) / 2) view_pitch, y = (r - (rows - 1) / 2) view_pitch. Views of another size than the
        display's pictures are scaled to fit whole.
    display : Display, str or path
        The display that is to show it.
    color : str or sequence of str, optional
        "red", "green", "blue"; all of the display's where none is given. A grey light field is shown in each of them.
    views : int, optional
        Views per axis of scenes that are rendered, 1 to 64.
    view_pitch : float, optional
        Metres between neighbouring views; arrays are spread over the eyebox where none is given.
    depth_map : path, optional
        The depth map of a picture.
    depth : (float, float), optional
        What its ends mean, metres.
    near : str, optional
        Which values of the depth map are near: "small" (distances, 0 is unknown), "large" (disparities), "bright" or "dark" (a
        picture, 0 is a value). By default the file decides, or the map is refused.
    order : str, optional
        How views stand that do not stand as their names or axes say: "transpose", "flip-rows", "flip-columns", with commas between;
        "as-named" takes them as a grid whatever their pictures show.
    name : str, optional
        What holograms of an array remember as their scene.
    variable : str, optional
        The name of the array in a file of arrays that has several.

    Raises
    ------
    SceneError
        A scene that cannot be read or shown, with its file, or the place in the array.
    """

    __slots__ = ("_display", "_native")

    def __init__(
        self,
        source: Any,
        display: Any = "paper",
        color: Any = None,
        *,
        views: int | None = None,
        view_pitch: float | None = None,
        depth_map: Any = None,
        depth: tuple[float, float] | None = None,
        near: str | None = None,
        order: str | None = None,
        name: str = "",
        variable: str | None = None,
    ) -> None:
        self._display = display_of(display)
        native = self._display._native
        names = _arguments.colors(color, list(self._display.wavelengths))
        pitch = None if view_pitch is None else _arguments.quantity(view_pitch, "m", "view_pitch")
        if variable is not None and not _files.is_arrays(source):
            raise TypeError(f"variable names an array in a file of arrays: scene is {source!r}")
        # NumPy's files are the library's, too, which finds the views in them by itself.
        if _files.is_arrays(source) and not (os.fsdecode(source).lower().endswith((".npy", ".npz")) and variable is None):
            # The name finds the scene again.
            name = name or _arguments.path(source, "scene")
            source = _files.views(source, variable)
        order = None if order is None else str(order)
        if _arguments.is_path(source):
            views = None if views is None else _arguments.count(views, "views", 64)
            depth_map = None if depth_map is None else _arguments.path(depth_map, "depth_map")
            if depth is not None:
                ends = _arguments.ends(depth, "depth")
                depth = tuple(_arguments.depth(end, lambda: self._display.focal_length) for end in ends)
            source = _arguments.path(source, "scene")
            near = None if near is None else str(near)
            self._native = _eyebox.Scene.load(source, native, names, (views, pitch, depth_map, depth, near, order))
            _arguments.warn()
            return
        if not _arguments.is_array(source):
            raise TypeError(f"scene is {source!r}: it must be an eyebox.Scene, a name, a path or an array of views")
        for what, given in (("views", views), ("depth_map", depth_map), ("depth", depth), ("near", near)):
            if given is not None:
                raise TypeError(f"{what} belongs to scenes that are loaded: an array of views has its own")
        planes, has = _arguments.light_field(source, "scene")
        if has == 3:
            known = dict(zip(("red", "green", "blue"), planes))
            planes = [known[name] for name in names if name in known]
        elif has == 1:
            planes = planes * len(names)
        if not isinstance(name, str):
            raise TypeError(f"name is {name!r}: it must be a text")
        self._native = _eyebox.Scene.of_views(name, native, names, planes, pitch, order)
        _arguments.warn()

    @classmethod
    def _of(cls, native: _eyebox.Scene, display: Display) -> Scene:
        made = object.__new__(cls)
        made._native, made._display = native, display
        return made

    @property
    def display(self) -> Display:
        """The display that is to show it."""
        return self._display

    @property
    def source(self) -> str:
        """Where it came from."""
        return self._native.source

    @property
    def colors(self) -> list[str]:
        """Its colours."""
        return self._native.colors

    @property
    def shape(self) -> tuple[int, int, int, int, int]:
        """View rows, view columns, rows, columns, colours."""
        rows, columns, height, width = self._native.shape
        return rows, columns, height, width, len(self.colors)

    @property
    def views(self) -> np.ndarray:
        """All views, (view row, view column, row, column, colour), linear light: a copy."""
        planes = [self._native.views(color).reshape(self.shape[:4]) for color in range(len(self.colors))]
        return np.stack(planes, axis=-1)

    @property
    def view_pitch(self) -> float:
        """Metres between neighbouring views in the pupil plane."""
        return self._native.view_pitch(self._display._native)

    @property
    def depth_range(self) -> tuple[float, float] | None:
        """Farthest and nearest depth, metres; None where it is not known."""
        known = self._native.depth_range(self._display._native)
        return None if known is None else tuple(known)

    def photograph(
        self, x: float = 0.0, y: float = 0.0, diameter: float = 4e-3, depth: float = 0.0, *, engine: Any = "auto"
    ) -> np.ndarray:
        """What an eye should see of it: :func:`photograph`.

        Parameters
        ----------
        x, y, diameter, depth : float
            The pupil, metres, as of :func:`photograph`.
        engine : Engine or str
            Where it is computed.
        """
        pupil = _arguments.pupil(x, y, diameter, depth, lambda: self._display.focal_length)
        return self._native.photograph(self._display._native, pupil, engine_of(engine))

    def __repr__(self) -> str:
        rows, columns, height, width, _ = self.shape
        what = self.source or "of an array"
        return f"<eyebox.Scene {what}: {rows} x {columns} views of {height} x {width}, {', '.join(self.colors)}>"


def scene_of(value: Any, display: Display, color: Any = None, **options: Any) -> Scene:
    """A scene by itself, or of a name, a path or an array."""
    if not isinstance(value, Scene):
        return Scene(value, display, color, **options)
    if color is not None and _arguments.colors(color, value.colors) != value.colors:
        raise ValueError(f"color is {color!r}: the scene has {', '.join(value.colors)}; give it when the scene is made")
    if any(option is not None for option in options.values()):
        raise TypeError(f"{', '.join(options)} belong to a scene that is loaded here: give them when the scene is made")
    return value


def photograph(
    scene: Any,
    x: float = 0.0,
    y: float = 0.0,
    diameter: float = 4e-3,
    depth: float = 0.0,
    *,
    display: Any = "paper",
    color: Any = None,
    engine: Any = "auto",
) -> np.ndarray:
    """What an eye should see of a scene through a pupil.

    Parameters
    ----------
    scene : Scene, str, path or array
        The scene; all but a :class:`Scene` is made one for ``display`` and ``color``.
    x, y : float
        Centre of the pupil, metres: to the right, and down.
    diameter : float
        Its diameter, metres.
    depth : float
        Where it focuses, metres from the SLM's image; positive is nearer.
    display, color
        As of :class:`Scene`.
    engine : Engine or str
        Where it is computed.

    Returns
    -------
    numpy.ndarray
        (row, column, colour), float32, linear light with 1 as full scale.
    """
    if not isinstance(scene, Scene):
        scene = Scene(scene, display, color)
    return scene.photograph(x, y, diameter, depth, engine=engine)
