"""Scenes and their target images."""

from __future__ import annotations

import hashlib
import json
import os
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import _arguments, _eyebox, _files, _notebook
from ._display import Display, display_of, engine_of
from ._tables import xarray_module
from ._values import OfContent

if TYPE_CHECKING:
    from ._types import ArrayLike, Colors, DisplayLike, EngineLike, Path, Quantity, Range, SceneLike, Whole


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
        (PyTorch, JAX) are accepted. View (r, c) is the view from x = (c - (columns - 1) / 2) view_pitch,
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
    depth_map : path, optional
        Depth map of a picture.
    depth : (float, float), optional
        Depths of the two ends of the depth map, in meters.
    near : str, optional
        Values of the depth map that are near. These are "small" (distances, 0 is unknown), "large" (disparities),
        "bright" or "dark" (a picture, 0 is a value). By default the file determines them, or the map is refused.
    order : str, optional
        Order of the views if it differs from their names or axes. It is one or more of "transpose", "flip-rows" and
        "flip-columns", separated by commas. "as-named" accepts the views as a grid, whatever their pictures show.
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
        depth_map: Path | None = None,
        depth: Range | None = None,
        near: Literal["small", "large", "bright", "dark"] | None = None,
        order: str | None = None,
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
            raise _arguments.wrong(TypeError, "scene", f"is {source!r}: it must be an eyebox.Scene, a name, a path or an array of views")
        for what, given in (("views", views), ("depth_map", depth_map), ("depth", depth), ("near", near)):
            if given is not None:
                raise _arguments.wrong(TypeError, what, "belongs to scenes that are loaded: an array of views has its own")
        planes, has = _arguments.light_field(source, "scene")
        if has == 3:
            known = dict(zip(("red", "green", "blue"), planes))
            planes = [known[name] for name in names if name in known]
        elif has == 1:
            planes = planes * len(names)
        if not isinstance(name, str):
            raise _arguments.wrong(TypeError, "name", f"is {name!r}: it must be a text")
        self._native = _eyebox.Scene.of_views(name, native, names, planes, pitch, order)
        _arguments.warn()

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
