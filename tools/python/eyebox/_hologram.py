"""Holograms with their files, phases and reconstructions."""

from __future__ import annotations

import json
import mmap
import os
import tempfile
from collections.abc import Mapping
from typing import Any, Callable, NamedTuple

import numpy as np

from . import _arguments, _eyebox, _files
from ._display import Display, display_of, engine_of
from ._interrupted import interrupted
from ._scene import Scene, scene_of


class Score(NamedTuple):
    """The quality of a reconstruction through a pupil, compared with its target image.

    Attributes
    ----------
    psnr : float or None
        PSNR over all colors in dB, or None if the target is black.
    ceiling : float or None
        Highest PSNR that any hologram can have there in dB, or None if it is unknown.
    ssim : float or None
        Mean SSIM over the colors, or None if the picture is smaller than the window of SSIM.
    against_clear : float or None
        PSNR in dB of the image past an obstruction, compared with the image of the same hologram through a clear
        pupil. It is None for a clear pupil.
    """

    psnr: float | None
    ceiling: float | None
    ssim: float | None
    against_clear: float | None = None


class Hologram:
    """Phases with their display, scene and settings. A hologram never changes.

    :func:`eyebox.solve`, :meth:`load`, :meth:`from_phases` and :meth:`refine` make holograms. A notebook displays one
    as an eye at the center of the eyebox sees it.
    """

    __slots__ = ("_native", "_png", "_scene", "_stopped", "_views")

    def __init__(self) -> None:
        raise TypeError("a Hologram is made by eyebox.solve, Hologram.load or Hologram.from_phases")

    @classmethod
    def _of(cls, native: _eyebox.Hologram, scene: Scene | None, stopped: str | None) -> Hologram:
        made = object.__new__(cls)
        made._native, made._scene, made._stopped = native, scene, stopped
        made._png, made._views = None, None
        return made

    @classmethod
    def load(cls, path: Any, at: int | None = None) -> Hologram:
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
        phases: Any,
        display: Any,
        color: Any = None,
        *,
        scene: Any = None,
        exposure: float | None = None,
        variable: str | None = None,
        engine: Any = "auto",
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
            raise TypeError("variable names an array in a file: phases is none")
        if isinstance(phases, Mapping):
            if color is not None or not phases:
                raise TypeError("color says which colour one array is for: a dict of phases has its own, one or more")
            names = _arguments.colors(list(phases), list(display.wavelengths))
            arrays = [_arguments.radians(value, f"phases[{name!r}]") for name, value in phases.items()]
        else:
            arrays = [_arguments.radians(phases, "phases")]
            names = _arguments.colors(color, list(display.wavelengths))
            if len(names) != 1:
                raise ValueError(f"phases are of one colour: color must say which of {', '.join(names)}")
        if scene is not None and exposure is not None:
            raise TypeError("exposure is what the scene decides: give one or the other")
        scene = None if scene is None else scene_of(scene, display, names)
        exposure = None if exposure is None else _arguments.number(exposure, "exposure")
        shown = None if scene is None else scene._native
        native = _eyebox.Hologram.of_phases(display._native, names, arrays, shown, exposure, engine_of(engine))
        return cls._of(native, scene, None)

    def save(self, path: Any) -> None:
        """Saves the hologram in the format of the file extension.

        A .zarr folder has all of it, and a .npy file only its phases. An existing hologram is replaced, but nothing
        else, and no partial file remains.
        """
        self._native.save(_arguments.path(path, "path"))

    @property
    def phases(self) -> dict[str, np.ndarray]:
        """Phases of each color (sub-frame, row, column), in radians in [-pi, pi). They are copies that you own."""
        return {color: self._native.phases(index) for index, color in enumerate(self.colors)}

    @property
    def phases_view(self) -> dict[str, np.ndarray]:
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
        return tuple(self._native.shape)

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
        return json.loads(self._native.metadata)

    @property
    def stopped(self) -> str | None:
        """Cause that ended the solve, which is "steps", "seconds", "quality", "callback", or "interrupt" after ctrl-C.

        It is None if :func:`eyebox.solve` did not return this hologram.
        """
        return self._stopped

    def view(
        self,
        x: float = 0.0,
        y: float = 0.0,
        diameter: float = 4e-3,
        depth: float = 0.0,
        *,
        engine: Any = "auto",
        obstructed: str | None = None,
    ) -> np.ndarray:
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
        scene: Any = None,
        pupils: Any = None,
        *,
        engine: Any = "auto",
        other_scene: bool = False,
        obstructed: str | None = None,
    ) -> list[Score]:
        """Compares reconstructions through pupils with the target images. All pupils share one exposure per color.

        Parameters
        ----------
        scene : Scene, str, path or array, optional
            Scene of the hologram. The default is the scene of the solve, read with the same options. If that scene was
            an array, pass the array again.
        pupils : sequence of (x, y, diameter, depth), optional
            Pupils in meters. The default is five pupils of 4 mm, in the center of the eyebox and around it.
        engine : Engine or str
            Engine that computes the scores.
        other_scene : bool
            Accept another scene than the scene of the solve.
        obstructed : str, optional
            Opaque marks in each pupil, either "lashes", "floaters", "opacity" or "scratches".

        Raises
        ------
        HologramError
            If the scene is another one, has changed or is not found.
        DisplayError
            If the obstruction is unknown.
        """
        marks = _arguments.name(obstructed, "obstructed")
        scene = self._scene_of(scene, other_scene)
        if pupils is None:
            side, wide = self.display.eyebox / 4, self._usual()
            pupils = [(x * side, y * side, wide, 0.0) for x, y in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))]
        at = _arguments.pupils(pupils, self._focal_length)
        scores = self._native.score(scene._native, at, marks, engine_of(engine), bool(other_scene))
        return [Score(*score) for score in scores]

    def refine(
        self,
        pupil: Any,
        steps: int = 16,
        *,
        scene: Any = None,
        spread: float = 0.0,
        engine: Any = "auto",
        callback: Callable[[int, float], Any] | None = None,
        other_scene: bool = False,
        **steering: Any,
    ) -> Hologram:
        """Refines the hologram for a pupil. Returns a new hologram in the best state that the steps reached.

        Parameters
        ----------
        pupil : (x, y, diameter, depth)
            Pupil in meters. ``spread`` is the standard deviation of its center along each axis, in meters.
        steps : int
            Highest number of steps.
        scene, engine, callback, other_scene, **steering
            Arguments of :class:`eyebox.Refiner` and of its ``step``.
        """
        from ._refiner import Refiner

        refiner = Refiner(self, scene, engine=engine, other_scene=other_scene, **steering)
        [where] = _arguments.pupils([pupil], self._focal_length)
        refiner.aim(*where, spread=spread)
        best = lambda: Hologram._of(refiner._native.best(), refiner._kept_scene, None)  # noqa: E731
        try:
            refiner._native.refine(_arguments.count(steps, "steps"), callback)
        except KeyboardInterrupt as error:
            raise interrupted(error, best) from None
        return best()

    def encode(self, display: Any = None) -> np.ndarray:
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


def _stored(array: np.ndarray) -> Any:
    """Writes an array to a file without a name, which is in memory if the system supports it."""
    if hasattr(os, "memfd_create"):
        file = os.fdopen(os.memfd_create("eyebox phases", os.MFD_CLOEXEC), "w+b")
    else:
        file = tempfile.TemporaryFile()
    file.write(memoryview(array).cast("B"))
    file.flush()
    return file
