"""Scenes and their target images."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _arguments, _eyebox, _files, _given, _notebook
from ._display import Display, display_of, engine_of
from ._tables import xarray_module
from ._values import OfContent

if TYPE_CHECKING:
    from ._types import ArrayLike, Colors, DisplayLike, EngineLike, Path, Quantity, Range, SceneLike, Whole


class Measured(NamedTuple):
    """The properties of a scene that its views show, from :meth:`Scene.measure`.

    Attributes
    ----------
    depth_range : (float, float)
        Farthest and nearest depth in meters.
    trust : str
        "stated" by the scene, "measured", "plausible" or "doubtful".
    certain : float or None
        Share of the detail that is found again with certainty, for plausible and doubtful depths.
    depth_map : numpy.ndarray
        Depth of each pixel of the central view (row, column), in meters.
    aliasing : float
        Movement of the nearest content against the farthest from view to view, in pixels. Beyond one pixel, wide
        pupils see ghosts.
    views_needed : int
        Views per axis without ghosts.
    brightest, mean : dict of float
        Brightest and mean light of each color, with 1 as full scale.
    """

    depth_range: tuple[float, float]
    trust: str
    certain: float | None
    depth_map: NDArray[np.float32]
    aliasing: float
    views_needed: int
    brightest: dict[str, float]
    mean: dict[str, float]


class Scene(OfContent):
    """A scene as a light field, with views from a grid of positions in the pupil plane.

    The views have the size of a display's pictures.

    Parameters
    ----------
    source : str, path or array
        "builtin:NAME", a folder of views, a picture (docs/scenes.md), or your own light field. A light field is
        (view row, view column, row, column), or (view row, view column, row, column, color) with 3 colors. A single
        view may omit the first two axes. A file of such an array is .npy, .npz, .mat (needs SciPy, or h5py for version
        7.3) or .h5 (needs h5py). Floating-point values are linear light, finite and not negative, with 1 as full scale.
        Values of uint8 and uint16 are sRGB. NumPy arrays in any order, lists, and CPU arrays of any library with DLPack
        (PyTorch, JAX) are accepted, and so are data sets of h5py, zarr, xarray and dask and pictures of Pillow. View (r, c) is the view from x = (c - (columns - 1) / 2) view_pitch,
        y = (r - (rows - 1) / 2) view_pitch. Views of another size than the display's pictures are scaled to fit whole.
    display : Display, str or path
        Display that is to show the scene.
    color : str or sequence of str, optional
        "red", "green" or "blue", or several of them. The default is all colors of the display. A gray light field is
        shown in each of them.
    views : int, optional
        Views per axis of rendered scenes, 1 to 64.
    view_pitch : float, optional
        Distance between neighboring views in meters. By default, arrays are spread over the eyebox.
    depth_map : path or array, optional
        Depth map of a picture. An array (row, column) of floating-point values has depths in meters, unless ``near`` or
        ``depth`` is given. In uint8, bright values are near.
    depth : (float, float), optional
        Depths of the two ends of the depth map, in meters.
    near : str, optional
        Values of the depth map that are near. These are "small" (distances, 0 is unknown), "large" (disparities),
        "bright" or "dark" (a picture, 0 is a value). By default the file determines them, or the map is refused.
    order : str, optional
        Order of the views if it differs from their names or axes. It is one or more of "transpose", "flip-rows" and
        "flip-columns", separated by commas. "as-named" accepts the views as a grid, whatever their pictures show.
    view_synthesis : {"auto", "cells", "layers", "between"}, optional
        Views from which target images are made if the own ones are too far apart (docs/scenes.md). The default is
        "auto" for folders, and "cells" for arrays, which uses the views as they are.
    name : str, optional
        Name of the scene that holograms of an array store.
    variable : str, optional
        Name of the array in a file with several arrays.

    Raises
    ------
    SceneError
        If the scene cannot be read or shown. The message names the file, or the place in the array.
    """

    __slots__ = ("_digest", "_display", "_native")

    def __init__(
        self,
        source: Path | ArrayLike,
        display: DisplayLike = "paper",
        color: Colors | None = None,
        *,
        views: Whole | None = None,
        view_pitch: Quantity | None = None,
        depth_map: Path | ArrayLike | None = None,
        depth: Range | None = None,
        near: Literal["small", "large", "bright", "dark"] | None = None,
        order: str | None = None,
        view_synthesis: Literal["auto", "cells", "layers", "between"] | None = None,
        name: str = "",
        variable: str | None = None,
    ) -> None:
        self._digest: bytes | None = None
        self._display = display_of(display)
        native = self._display._native
        names = _arguments.colors(color, list(self._display.wavelengths))
        pitch = None if view_pitch is None else _arguments.quantity(view_pitch, "m", "view_pitch")
        if variable is not None and not _files.is_arrays(source):
            raise _arguments.wrong(TypeError, "variable", f"names an array in a file: scene is {source!r}")
        # The library reads NumPy files too, and finds the views in them by itself.
        if _files.is_arrays(source) and not (os.fsdecode(source).lower().endswith((".npy", ".npz")) and variable is None):
            # A hologram finds the scene again by this name.
            name = name or _arguments.path(source, "scene")
            source = _files.views(source, variable)
        if not isinstance(name, str):
            raise _arguments.wrong(TypeError, "name", f"is {name!r}: it must be a text")
        order = None if order is None else str(order)
        synthesis = None if view_synthesis is None else str(view_synthesis)
        if not _arguments.is_path(source) and not _arguments.is_array(source):
            raise _arguments.wrong(TypeError, "scene", f"is {source!r}: it must be an eyebox.Scene, a name, a path or an array of views")
        if _arguments.is_path(source) or depth_map is not None:
            views = None if views is None else _arguments.count(views, "views", 64)
            near = None if near is None else str(near)
            if depth is not None:
                depth = tuple(_arguments.depth(end, self._focal_length) for end in _arguments.ends(depth, "depth"))
            given = _given.Given(source, depth_map, near, depth)
            is_files = _arguments.is_path(source) and (depth_map is None or _arguments.is_path(depth_map))
            with contextlib.nullcontext("") if is_files else _given.folder() as folder:
                if not is_files:
                    given = _given.picture(folder, *given)
                path = _arguments.path(given.source, "scene")
                map_path = None if given.depth_map is None else _arguments.path(given.depth_map, "depth_map")
                options = (views, pitch, map_path, given.depth, given.near, order, synthesis)
                if not is_files and not name and _arguments.is_path(source):
                    name = path
                self._native = _eyebox.Scene.load(path, native, names, options, None if is_files else name)
                _arguments.warn(folder)
            return
        for what, other in (("views", views), ("depth", depth), ("near", near)):
            if other is not None:
                raise _arguments.wrong(TypeError, what, "belongs to scenes that are loaded: an array of views has its own")
        self._set_views(source, names, name, (pitch, order, synthesis, None))

    def _set_views(
        self,
        views: Any,
        names: list[str],
        name: str,
        options: tuple[float | None, str | None, str | None, tuple[float, float] | None],
    ) -> None:
        """Makes the scene from an array of views."""
        planes, has = _arguments.light_field(views, "scene")
        if has == 3:
            known = dict(zip(("red", "green", "blue"), planes))
            planes = [known[name] for name in names if name in known]
        elif has == 1:
            planes = planes * len(names)
        self._native = _eyebox.Scene.of_views(name, self._display._native, names, planes, options)
        _arguments.warn()

    def _focal_length(self) -> float:
        return self._display.focal_length

    @classmethod
    def from_focal_stack(
        cls,
        pictures: Iterable[ArrayLike],
        focus: Iterable[Quantity],
        aperture: Quantity,
        display: DisplayLike = "paper",
        color: Colors | None = None,
        *,
        name: str = "",
    ) -> Scene:
        """Makes a scene from pictures through one aperture with different focus, by layers that explain them.

        Parameters
        ----------
        pictures : sequence of array
            Pictures (row, column) or (row, column, color), as views of :class:`Scene`.
        focus : sequence of float
            Depth at which each picture is sharp, in meters.
        aperture : float
            Diameter of the aperture in meters.
        display, color, name
            Arguments of :class:`Scene`.
        """
        shown = display_of(display)
        names = _arguments.colors(color, list(shown.wavelengths))
        options = (None, None, None, None, None, None, None)
        with _given.folder() as folder:
            source = _given.focal_stack(folder, pictures, focus, aperture, lambda: shown.focal_length)
            made = cls._of(_eyebox.Scene.load(source, shown._native, names, options, str(name)), shown)
            _arguments.warn(folder, str(name) or "the focal stack")
        return made

    @classmethod
    def from_layers(
        cls,
        layers: ArrayLike,
        depths: Iterable[Quantity],
        display: DisplayLike = "paper",
        color: Colors | None = None,
        *,
        views: Whole = 9,
        name: str = "",
    ) -> Scene:
        """Makes a scene from pictures with opacity, one in front of the other.

        Parameters
        ----------
        layers : array
            (layer, row, column, 2) or (layer, row, column, 4), with one or three colors and the opacity (0 to 1, or the
            full scale of integers) last. Colors are as views of :class:`Scene`, and not multiplied by the opacity.
        depths : sequence of float
            Depth of each layer in meters. Layers may be in any order.
        display, color, name
            Arguments of :class:`Scene`.
        views : int
            Views per axis, which are spread over the eyebox.
        """
        made = object.__new__(cls)
        made._display, made._digest = display_of(display), None
        shown = made._display
        names = _arguments.colors(color, list(shown.wavelengths))
        given = _given.layers(layers, depths, made._focal_length)
        count = _arguments.count(views, "views", 64)
        pitch = shown.eyebox / count
        at = [(index - (count - 1) / 2) * pitch for index in range(count)]
        rows, columns = given.planes[0].shape[1:]
        high, wide = shown.picture_size
        # Layers of another size are scaled to fit whole, and their movement with them.
        scale = min(high / rows, wide / columns)
        pixel = shown._native.picture_pixel * scale
        places = [[x, y] for y in at for x in at]
        found = _eyebox.layer_views(given.planes, given.depths, places, 1 / (shown.focal_length * pixel))
        planes = [plane.reshape(count, count, rows, columns) for plane in found]
        ends = (given.depths[0] / scale, given.depths[-1] / scale)
        made._set_views(np.stack(planes, axis=-1), names, str(name), (pitch, "as-named", None, ends))
        return made

    @classmethod
    def _of(cls, native: _eyebox.Scene, display: Display) -> Scene:
        made = object.__new__(cls)
        made._native, made._display, made._digest = native, display, None
        return made

    @property
    def display(self) -> Display:
        """Display that is to show the scene."""
        return self._display

    @property
    def source(self) -> str:
        """Name or path of the scene."""
        return self._native.source

    @property
    def colors(self) -> list[str]:
        """Names of the colors."""
        return self._native.colors

    @property
    def shape(self) -> tuple[int, int, int, int, int]:
        """Numbers of view rows, view columns, rows, columns and colors."""
        rows, columns, height, width = self._native.shape
        return rows, columns, height, width, len(self.colors)

    @property
    def views(self) -> NDArray[np.float32]:
        """Copy of all views (view row, view column, row, column, color), in linear light."""
        planes = [self._native.views(color).reshape(self.shape[:4]) for color in range(len(self.colors))]
        return np.stack(planes, axis=-1)

    @property
    def view_pitch(self) -> float:
        """Distance between neighboring views in the pupil plane, in meters."""
        return self._native.view_pitch(self._display._native)

    @property
    def depth_range(self) -> tuple[float, float] | None:
        """Farthest and nearest depth in meters, or None if they are unknown."""
        known = self._native.depth_range(self._display._native)
        return None if known is None else (known[0], known[1])

    def photograph(
        self,
        x: Quantity = 0.0,
        y: Quantity = 0.0,
        diameter: Quantity = 4e-3,
        depth: Quantity = 0.0,
        *,
        engine: EngineLike = "auto",
    ) -> NDArray[np.float32]:
        """Computes the target image of the scene through a pupil, as :func:`photograph` does.

        Parameters
        ----------
        x, y, diameter, depth : float
            Pupil in meters, as in :func:`photograph`.
        engine : Engine or str
            Engine that computes the image.
        """
        pupil = _arguments.pupil(x, y, diameter, depth, lambda: self._display.focal_length)
        return self._native.photograph(self._display._native, pupil, engine_of(engine))

    def measure(self) -> Measured:
        """Measures the depths and the light of the views, and how far apart views may be."""
        numbers, depths = _eyebox.measured(self._native, self._display._native)
        (far, near), trust, certain, aliasing, views, light = numbers
        brightest, mean = [dict(zip(self.colors, values)) for values in zip(*light)]
        return Measured((far, near), trust, certain, depths, aliasing, views, brightest, mean)

    def contact_sheet(self, most: Whole = 1600) -> NDArray[np.float32]:
        """Draws all views next to each other as they are read.

        Parameters
        ----------
        most : int
            Highest number of pixels along each axis.

        Returns
        -------
        numpy.ndarray
            (row, column, color), float32, linear light.
        """
        return _eyebox.contact(self._native, _arguments.count(most, "most", 65536))

    def to_xarray(self) -> Any:
        """Returns the views as a DataArray of xarray, with the positions of the views (m) as coordinates."""
        xarray = xarray_module()
        rows, columns, *_ = self.shape
        place = lambda count: (np.arange(count) - (count - 1) / 2) * self.view_pitch  # noqa: E731
        where = {"y": place(rows), "x": place(columns), "color": self.colors}
        return xarray.DataArray(self.views, where, ("y", "x", "row", "column", "color"), name=self.source or "views")

    def _content(self) -> bytes:
        """Returns a digest of the scene and of the display.

        The state of the scene has the digest of its file or of its array, or its name, and the options of its views.
        """
        if self._digest is None:
            text = f"{self.shape}\n{_eyebox.scene_state(self._native)}\n{self._display.to_toml()}"
            self._digest = hashlib.sha256(text.encode()).digest()
        return self._digest

    def __reduce__(self) -> tuple[Any, ...]:
        views = [self._native.views(color).reshape(self.shape[:4]) for color in range(len(self.colors))]
        return _scene_of_state, (_eyebox.scene_state(self._native), views, self._display)

    def _is_of_array(self) -> bool:
        """Returns whether the scene was an array, which no file and no name gives again."""
        return bool(json.loads(_eyebox.scene_state(self._native))["record"].get("views"))

    def _repr_html_(self) -> str:
        rows, columns, height, width, _ = self.shape
        depths = self.depth_range
        about = [
            ("views", f"{rows} x {columns}, {self.view_pitch * 1e3:.4g} mm apart"),
            ("pixels", f"{height} x {width}"),
            ("colors", ", ".join(self.colors)),
            ("depths", "-" if depths is None else f"{depths[0] * 1e3:.4g} to {depths[1] * 1e3:.4g} mm"),
            ("display", self._display.name),
        ]
        light = np.zeros((height, width, 3))
        for color, name in enumerate(self.colors):
            views = self._native.views(color).reshape(self.shape[:4])
            light[..., ("red", "green", "blue").index(name)] = views[(rows - 1) // 2, (columns - 1) // 2]
        return _notebook.picture(light, "central view") + _notebook.table(("scene", self.source or "array"), about)

    def __repr__(self) -> str:
        rows, columns, height, width, _ = self.shape
        what = self.source or "of an array"
        return f"<eyebox.Scene {what}: {rows} x {columns} views of {height} x {width}, {', '.join(self.colors)}>"


def _scene_of_state(state: str, views: list[np.ndarray], display: Display) -> Scene:
    planes = [np.ascontiguousarray(one, np.float32) for one in views]
    return Scene._of(_eyebox.scene_of_state(state, planes), display)


def scene_of(value: Any, display: Display, color: Any = None, **options: Any) -> Scene:
    """Returns a given scene, or makes one from a name, a path or an array."""
    if not isinstance(value, Scene):
        return Scene(value, display, color, **options)
    if color is not None and _arguments.colors(color, value.colors) != value.colors:
        has = ", ".join(value.colors)
        raise _arguments.wrong(ValueError, "color", f"is {color!r}: the scene has {has}. Give it when the scene is made")
    if any(option is not None for option in options.values()):
        given = [name for name, option in options.items() if option is not None]
        raise _arguments.wrong(TypeError, given[0], "belongs to a scene that is loaded here: give it when the scene is made")
    return value


def photograph(
    scene: SceneLike,
    x: Quantity = 0.0,
    y: Quantity = 0.0,
    diameter: Quantity = 4e-3,
    depth: Quantity = 0.0,
    *,
    display: DisplayLike = "paper",
    color: Colors | None = None,
    engine: EngineLike = "auto",
) -> NDArray[np.float32]:
    """Computes the target image, which is the image that an eye should see of a scene through a pupil.

    Parameters
    ----------
    scene : Scene, str, path or array
        Scene, or the source of a :class:`Scene` for ``display`` and ``color``.
    x, y : float
        Center of the pupil in meters, to the right and down.
    diameter : float
        Diameter of the pupil in meters.
    depth : float
        Depth at which the eye focuses, in meters from the image of the SLM. Positive is nearer.
    display, color
        Arguments of :class:`Scene`.
    engine : Engine or str
        Engine that computes the image.

    Returns
    -------
    numpy.ndarray
        (row, column, color), float32, linear light with 1 as full scale.
    """
    if not isinstance(scene, Scene):
        scene = Scene(scene, display, color)
    return scene.photograph(x, y, diameter, depth, engine=engine)
