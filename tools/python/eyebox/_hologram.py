"""Holograms with their files, phases and reconstructions."""

from __future__ import annotations

import hashlib
import json
import mmap
import os
import tempfile
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Callable, SupportsFloat

import numpy as np
from numpy.typing import NDArray

from . import _arguments, _eyebox, _files, _pupils
from ._display import Display, display_of, engine_of
from ._interrupted import interrupted
from ._scene import Scene, scene_of
from ._tables import Score, Scores, xarray_module
from ._values import OfContent

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._settings import RefineFields
    from ._types import (
        ArrayLike,
        Colors,
        DisplayLike,
        EngineLike,
        Obstruction,
        Path,
        PupilLike,
        Pupils,
        Quantity,
        SceneLike,
        Whole,
    )

#: Keys of the metadata that depend on the place of files and on the speed of the machine, and not on the hologram.
_OF_PLACE = ("scenes", "display_file", "seconds")


class Hologram(OfContent):
    """Phases with their display, scene and settings. A hologram never changes.

    :func:`eyebox.solve`, :meth:`load`, :meth:`from_phases` and :meth:`refine` make holograms. A notebook displays one
    as an eye at the center of the eyebox sees it.
    """

    __slots__ = ("_digest", "_native", "_png", "_scene", "_stopped", "_views")
    _digest: bytes | None
    _native: _eyebox.Hologram
    _png: bytes | None
    _scene: Scene | None
    _stopped: str | None
    _views: dict[str, Any] | None

    def __init__(self) -> None:
        raise TypeError("a Hologram is made by eyebox.solve, Hologram.load or Hologram.from_phases")

    @classmethod
    def _of(cls, native: _eyebox.Hologram, scene: Scene | None, stopped: str | None) -> Hologram:
        made = object.__new__(cls)
        made._native, made._scene, made._stopped = native, scene, stopped
        made._png, made._views, made._digest = None, None, None
        return made

    @classmethod
    def load(cls, path: Path, at: Whole | None = None) -> Hologram:
        """Opens a .zarr folder that :meth:`save` or the command made, or hologram ``at`` of a sequence.

        Raises
        ------
        HologramError
            If the file is damaged or is no hologram. The message names the file.
        """
        if at is not None:
            at = _arguments.count(at, "at", 1 << 40, least=0)
        return cls._of(_eyebox.Hologram.load(_arguments.path(path, "path"), at), None, None)

    @classmethod
    def from_phases(
        cls,
        phases: ArrayLike | Path | Mapping[str, ArrayLike],
        display: DisplayLike,
        color: Colors | None = None,
        *,
        scene: SceneLike | None = None,
        exposure: float | None = None,
        variable: str | None = None,
        engine: EngineLike = "auto",
    ) -> Hologram:
        """Makes a hologram from your own phases, to render, score, refine, encode and save it.

        Parameters
        ----------
        phases : array, dict of arrays, or path
            Floating-point radians (sub-frame, row, column) or (row, column), of the display's size. Several colors are
            a dict by their names. Arrays of any library with DLPack (PyTorch, JAX) are accepted. A file is .npy, .npz,
            .mat (needs SciPy, or h5py for version 7.3) or .h5 (needs h5py). It has one array of such a shape, or arrays
            named red, green and blue.
        display : Display, str or path
            Display for the phases.
        color : str, optional
            Color of an array. It is optional if the display has only one color.
        scene : Scene, str, path or array, optional
            Scene that the phases show. It determines the exposures, which every reconstruction needs.
        exposure : float, optional
            Exposure of every color, if there is no scene. The light is multiplied by it.
        variable : str, optional
            Name of the array in a file with several arrays.
        engine : Engine or str
            Engine that fits the exposures.
        """
        display = display_of(display)
        if _arguments.is_path(phases):
            phases = _files.phases(phases, variable, display.resolution)
        elif variable is not None:
            raise _arguments.wrong(TypeError, "variable", "names an array in a file: phases is none")
        if isinstance(phases, Mapping):
            if color is not None or not phases:
                raise _arguments.wrong(TypeError, "color", "is for one array: a dict of phases has its own colors")
            names = _arguments.colors(list(phases), list(display.wavelengths))
            arrays = [_arguments.radians(value, f"phases[{name!r}]") for name, value in phases.items()]
        else:
            arrays = [_arguments.radians(phases, "phases")]
            names = _arguments.colors(color, list(display.wavelengths))
            if len(names) != 1:
                raise _arguments.wrong(ValueError, "color", f"is not given: one array is of one of {', '.join(names)}")
        if scene is not None and exposure is not None:
            raise _arguments.wrong(TypeError, "exposure", "and scene are both given: the scene decides the exposure")
        scene = None if scene is None else scene_of(scene, display, names)
        exposure = None if exposure is None else _arguments.number(exposure, "exposure")
        shown = None if scene is None else scene._native
        native = _eyebox.Hologram.of_phases(display._native, names, arrays, shown, exposure, engine_of(engine))
        return cls._of(native, scene, None)

    def save(self, path: Path) -> None:
        """Saves the hologram in the format of the file extension.

        A .zarr folder has all of it, and a .npy file only its phases. An existing hologram is replaced, but nothing
        else, and no partial file remains.
        """
        self._native.save(_arguments.path(path, "path"))

    @property
    def phases(self) -> dict[str, NDArray[np.float32]]:
        """Phases of each color (sub-frame, row, column), in radians in [-pi, pi). They are copies that you own."""
        return {color: self._native.phases(index) for index, color in enumerate(self.colors)}

    @property
    def phases_view(self) -> dict[str, NDArray[np.float32]]:
        """Phases as in :attr:`phases`, but read-only and without a copy per use, to read large arrays often.

        The first use makes one copy for all views. Each array is a private mapping of this copy. If a library writes
        into a read-only array nevertheless, as PyTorch's ``from_dlpack`` allows, only that array changes.
        """
        if self._views is None:
            self._views = {color: _stored(array) for color, array in self.phases.items()}
        views = {}
        for color, file in self._views.items():
            memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
            views[color] = np.frombuffer(memory, np.float32).reshape(self.shape)
            views[color].setflags(write=False)
        return views

    @property
    def colors(self) -> list[str]:
        """Name of each color, or its number if it has no name."""
        return self._native.colors

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of sub-frames, rows and columns."""
        frames, rows, columns = self._native.shape
        return frames, rows, columns

    @property
    def frames(self) -> int:
        """Number of sub-frames."""
        return self.shape[0]

    @property
    def exposures(self) -> dict[str, float] | None:
        """Factor of the light of each color, the same for the whole eyebox, or None if it is unknown."""
        known = self._native.exposures
        return None if known is None else dict(zip(self.colors, known))

    @property
    def scene(self) -> str:
        """Name of the scene that the hologram shows."""
        return self._native.scene

    @property
    def display(self) -> Display:
        """Display for which the hologram was made, with its optics but without its encoding."""
        return Display._of(self._native.display)

    @property
    def metadata(self) -> dict[str, Any]:
        """Metadata of the hologram, with the keys of its file (docs/hologram-format.md)."""
        metadata: dict[str, Any] = json.loads(self._native.metadata)
        return metadata

    @property
    def stopped(self) -> str | None:
        """Cause that ended the solve, which is "steps", "seconds", "quality", "callback", or "interrupt" after ctrl-C.

        It is None if :func:`eyebox.solve` did not return this hologram.
        """
        return self._stopped

    def view(
        self,
        x: Quantity = 0.0,
        y: Quantity = 0.0,
        diameter: Quantity = 4e-3,
        depth: Quantity = 0.0,
        *,
        engine: EngineLike = "auto",
        obstructed: Obstruction | None = None,
    ) -> NDArray[np.float32]:
        """Computes the image that an eye sees through a pupil.

        Parameters
        ----------
        x, y : float
            Center of the pupil in meters, to the right and down.
        diameter : float
            Diameter of the pupil in meters.
        depth : float
            Depth at which the eye focuses, in meters from the image of the SLM. Positive is nearer.
        engine : Engine or str
            Engine that computes the image.
        obstructed : str, optional
            Opaque marks in the pupil, either "lashes", "floaters", "opacity" or "scratches".

        Returns
        -------
        numpy.ndarray
            (row, column, color), float32, linear light with 1 as full scale of the scene.
        """
        at, marks = _arguments.pupil(x, y, diameter, depth, self._focal_length), _arguments.name(obstructed, "obstructed")
        return self._native.view(at, marks, engine_of(engine))

    def score(
        self,
        scene: SceneLike | None = None,
        pupils: Pupils | str | None = None,
        *,
        seed: Whole | None = None,
        rng: np.random.Generator | Whole | None = None,
        jod: bool | Whole = False,
        viewing: Mapping[str, SupportsFloat] | None = None,
        sub_frame_rate: Quantity | None = None,
        engine: EngineLike = "auto",
        other_scene: bool = False,
        obstructed: Obstruction | None = None,
    ) -> Scores:
        """Compares reconstructions through pupils with the target images. All pupils share one exposure per color.

        Parameters
        ----------
        scene : Scene, str, path or array, optional
            Scene of the hologram. The default is the scene of the solve, read with the same options. If that scene was
            an array, pass the array again.
        pupils : sequence of (x, y, diameter, depth), or str, optional
            Pupils in meters, "random:N" for random ones over the depths of the solve, or "paper" for the groups of
            pupils of the paper. The default is five pupils of 4 mm, in the center of the eyebox and around it.
        seed, rng : optional
            Seed of random pupils, or the generator that draws it, as for :func:`random_pupils`.
        jod : bool or int
            Judge the pictures of all pupils in JOD too, or of this number of pupils, spread evenly. It takes longer
            than the other scores.
        viewing : dict, optional
            Conditions of JOD, which are ``luminance`` and ``black`` (cd/m2) and ``pixels_per_degree``. The default is
            the display file's.
        sub_frame_rate : float, optional
            Sub-frames per second for JOD of their flicker. By default their mean is judged.
        engine : Engine or str
            Engine that computes the scores.
        other_scene : bool
            Accept another scene than the scene of the solve.
        obstructed : str, optional
            Opaque marks in each pupil, either "lashes", "floaters", "opacity" or "scratches".

        Returns
        -------
        list of Score
            One score per pupil. ``summary()`` has their statistics, ``by_group()`` the groups of the paper, and
            ``to_dataframe()`` and ``to_xarray()`` return them as tables.

        Raises
        ------
        SceneError
            If the scene is another one, has changed or is not found.
        DisplayError
            If the obstruction is unknown.
        """
        marks = _arguments.name(obstructed, "obstructed")
        scene = self._scene_of(scene, other_scene)
        drawn, groups = _arguments.seed(seed, rng), None
        if drawn is not None and not isinstance(pupils, str):
            raise _arguments.wrong(TypeError, "seed", 'is for random pupils: give pupils="random:N"')
        if pupils is None:
            side, wide = self.display.eyebox / 4, self._usual()
            pupils = [(x * side, y * side, wide, 0.0) for x, y in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))]
        elif isinstance(pupils, str):
            pupils, groups = _pupils.named(pupils, self.display, self.colors, self._depths(scene), drawn)
        at = _arguments.pupils(pupils, self._focal_length)
        judging = _judging(jod, viewing, sub_frame_rate)
        own = engine_of(engine)
        scores = _eyebox.score(self._native, scene._native, at, marks, own, bool(other_scene), judging)
        return Scores([Score(*score) for score in scores], at, groups)

    def _depths(self, scene: Scene) -> tuple[float, float]:
        """Returns the farthest and nearest depth of the solve, or of the scene if nothing was solved."""
        solved = self.metadata.get("solve")
        if solved is not None:
            far, near = sorted(solved["depth"])
            return far, near
        known = scene.depth_range
        return scene.measure().depth_range if known is None else known

    def refine(
        self,
        pupil: PupilLike,
        steps: Whole = 16,
        *,
        scene: SceneLike | None = None,
        spread: Quantity = 0.0,
        engine: EngineLike = "auto",
        callback: Callable[[int, float], Any] | None = None,
        other_scene: bool = False,
        rng: np.random.Generator | Whole | None = None,
        **steering: Unpack[RefineFields],
    ) -> Hologram:
        """Refines the hologram for a pupil. Returns a new hologram in the best state that the steps reached.

        Parameters
        ----------
        pupil : (x, y, diameter, depth)
            Pupil in meters. ``spread`` is the standard deviation of its center along each axis, in meters.
        steps : int
            Highest number of steps.
        scene, engine, callback, other_scene, rng, **steering
            Arguments of :class:`eyebox.Refiner` and of its ``step``.
        """
        from ._refiner import Refiner

        refiner = Refiner(self, scene, engine=engine, other_scene=other_scene, rng=rng, **steering)
        [where] = _arguments.pupils([pupil], self._focal_length)
        refiner.aim(*where, spread=spread)
        best = lambda: Hologram._of(refiner._native.best(), refiner._kept_scene, None)  # noqa: E731
        try:
            refiner._native.refine(_arguments.count(steps, "steps"), callback)
        except KeyboardInterrupt as error:
            raise interrupted(error, best) from None
        return best()

    def encode(self, display: DisplayLike | None = None) -> NDArray[np.uint8]:
        """Encodes the hologram as the video frames that a display receives.

        Parameters
        ----------
        display : Display, str or path, optional
            Display of the video frames. The default is the display of the solve, cropped to the size of the hologram.

        Returns
        -------
        numpy.ndarray
            (frame, row, column, channel), uint8, in the order in which they are shown, with 1 channel (gray) or 3.
        """
        return self._native.encode(self._shown_on(display)._native)

    def to_xarray(self) -> Any:
        """Returns the phases as a data set of xarray, with the metadata of the hologram as attributes."""
        xarray = xarray_module()
        phases = np.stack(list(self.phases.values()))
        known = self.exposures
        variables: dict[str, Any] = {"phases": (("color", "sub_frame", "row", "column"), phases, {"units": "rad"})}
        if known is not None:
            variables["exposure"] = (("color",), np.array(list(known.values())), {})
        about = {"scene": self.scene, "display": self.display.to_toml(), "metadata": json.dumps(self.metadata)}
        return xarray.Dataset(variables, {"color": self.colors}, about)

    def _content(self) -> bytes:
        """Returns a digest of all that decides what the hologram shows."""
        if self._digest is None:
            about = {key: value for key, value in self.metadata.items() if key not in _OF_PLACE}
            digest = hashlib.sha256(json.dumps([self.shape, self.colors, self.exposures, self.scene, about]).encode())
            digest.update(self.display.to_toml().encode())
            for array in self.phases.values():
                digest.update(array.tobytes())
            self._digest = digest.digest()
        return self._digest

    def __reduce__(self) -> tuple[Any, ...]:
        with tempfile.TemporaryDirectory(prefix="eyebox-") as folder:
            root = os.path.join(folder, "hologram.zarr")
            self.save(root)
            files = {}
            for at, _, names in os.walk(root):
                for name in names:
                    with open(os.path.join(at, name), "rb") as file:
                        files[os.path.relpath(os.path.join(at, name), root).replace(os.sep, "/")] = file.read()
        # A scene of a file or of a name is found again. A scene of an array is not.
        scene = self._scene if self._scene is not None and self._scene._is_of_array() else None
        return _hologram_of_files, (files, scene, self._stopped)

    def _focal_length(self) -> float:
        return self.display.focal_length

    def _usual(self) -> float:
        return min(4e-3, self.display.eyebox)

    def _shown_on(self, display: Any) -> Display:
        """Returns the given display, or the display of the solve."""
        if display is None or _arguments.is_path(display):
            named = None if display is None else _arguments.path(display, "display")
            return Display._of(self._native.shown_on(named))
        return display_of(display)

    def _scene_of(self, scene: Any, other_scene: bool = False) -> Scene:
        """Returns the given scene, or the scene of the solve, read with the options of the solve."""
        if scene is None and self._scene is not None:
            return self._scene
        if isinstance(scene, Scene):
            return scene
        if scene is None or _arguments.is_path(scene):
            named = None if scene is None else _arguments.path(scene, "scene")
            return Scene._of(self._native.scene_as_solved(named, bool(other_scene)), self.display)
        made = Scene(scene, self.display, self.colors)
        known = self.metadata.get("view_pitch_mm")
        if known is not None and not other_scene and abs(made.view_pitch * 1e3 / known - 1) > 1e-9:
            made = Scene(scene, self.display, self.colors, view_pitch=known * 1e-3)
        return made

    def _repr_png_(self) -> bytes | None:
        if self._png is None and self.exposures is not None:
            try:
                pupil = (0.0, 0.0, self._usual(), 0.0)
            except _eyebox.EyeboxError:
                return None
            self._png = self._native.picture(pupil, engine_of("auto"))
        return self._png

    def __repr__(self) -> str:
        frames, rows, columns = self.shape
        of = f" of {self.scene}" if self.scene else ""
        return f"<eyebox.Hologram{of}: {frames} sub-frames of {rows} x {columns}, {', '.join(self.colors)}>"


def _judging(jod: Any, viewing: Any, sub_frame_rate: Any) -> _eyebox._Judging | None:
    """Returns the settings of scores in JOD, or None without them."""
    names = ("luminance", "black", "pixels_per_degree")
    wrong = None if viewing is None else [name for name in viewing if name not in names]
    if wrong:
        raise _arguments.wrong(TypeError, "viewing", f"has {wrong[0]!r}: it must have any of {', '.join(names)}")
    most = (1 << 32) if jod is True else 0 if jod is False else _arguments.count(jod, "jod", 1 << 32)
    if most == 0:
        if viewing is not None or sub_frame_rate is not None:
            what = "viewing" if viewing is not None else "sub_frame_rate"
            raise _arguments.wrong(TypeError, what, "is for scores in JOD: give jod=True")
        return None
    known = {} if viewing is None else {name: _arguments.finite(value, f"viewing[{name!r}]") for name, value in viewing.items()}
    rate = None if sub_frame_rate is None else _arguments.finite_quantity(sub_frame_rate, "Hz", "sub_frame_rate")
    return most, [known.get(name) for name in names], rate


def _hologram_of_files(files: dict[str, bytes], scene: Scene | None, stopped: str | None) -> Hologram:
    with tempfile.TemporaryDirectory(prefix="eyebox-") as folder:
        root = os.path.join(folder, "hologram.zarr")
        for name, data in files.items():
            path = os.path.join(root, *name.split("/"))
            os.makedirs(os.path.dirname(path), exist_ok=True)
            with open(path, "wb") as file:
                file.write(data)
        return Hologram._of(_eyebox.Hologram.load(root, None), scene, stopped)


def _stored(array: np.ndarray) -> Any:
    """Writes an array to a file without a name, which is in memory if the system supports it."""
    if hasattr(os, "memfd_create"):
        file = os.fdopen(os.memfd_create("eyebox phases", os.MFD_CLOEXEC), "w+b")
    else:
        file = tempfile.TemporaryFile()
    file.write(memoryview(array).cast("B"))
    file.flush()
    return file
