"""Holograms: their files, their phases, and what is seen of them."""

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
    """What a pupil sees, against what it should see.

    Attributes
    ----------
    psnr : float or None
        PSNR over all colors, dB; None if the target is black.
    ceiling : float or None
        The most that any hologram could have there, dB; None where it is not known.
    ssim : float or None
        Mean SSIM over the colours; None where the picture is smaller than SSIM's window.
    against_clear : float or None
        PSNR of the image past an obstruction against the image that the same hologram shows a clear pupil, dB; None for a clear pupil.
    """

    psnr: float | None
    ceiling: float | None
    ssim: float | None
    against_clear: float | None = None


class Hologram:
    """Phases, and what they were made for and by. It never changes.

    Made by :func:`eyebox.solve`, :meth:`load`, :meth:`from_phases` or :meth:`refine`. In a notebook it shows itself as an eye
    in the middle of the eyebox sees it.
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
        """Opens a hologram that :meth:`save` or the command made: a .zarr folder, or hologram ``at`` of a sequence.

        Raises
        ------
        HologramError
            Nothing that is one, or a damaged one, with its file.
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
        """The hologram that phases of one's own are on a display: to be looked at, scored, refined, encoded and saved.

        Parameters
        ----------
        phases : array, dict of arrays, or path
            (sub-frame, row, column) or (row, column), radians in floating point, of the display's size; for several colours, a
            dict by their names. Whatever speaks DLPack (PyTorch, JAX) will do. A file is .npy, .npz, .mat (needs SciPy; version
            7.3 needs h5py) or .h5 (needs h5py), with one array of such a shape, or with arrays named red, green and blue.
        display : Display, str or path
            The display that they are for.
        color : str, optional
            The colour of an array; may be left out where the display has one only.
        scene : Scene, str, path or array, optional
            The scene that they show: it decides the exposures, without which nothing can be seen.
        exposure : float, optional
            The exposure of every colour, instead: by what the light is multiplied.
        variable : str, optional
            The name of the array in a file that has several.
        engine : Engine or str
            Where exposures are fitted.
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
        """Saves it by the ending of its name: .zarr is all of it, .npy its phases alone. A hologram that is there is replaced,
        anything else left alone, and nothing is left half written."""
        self._native.save(_arguments.path(path, "path"))

    @property
    def phases(self) -> dict[str, np.ndarray]:
        """The phases of each colour, (sub-frame, row, column), radians in [-pi, pi): copies, which are yours."""
        return {color: self._native.phases(index) for index, color in enumerate(self.colors)}

    @property
    def phases_view(self) -> dict[str, np.ndarray]:
        """The phases as of :attr:`phases`, read-only and without a copy per use: for reading large ones often.

        The first use makes one copy for all views. Each array is a private mapping of it: a library that writes into a read-only array
        nevertheless, as PyTorch's ``from_dlpack`` allows, changes that array alone.
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
        """Its colours; a number where one has no name."""
        return self._native.colors

    @property
    def shape(self) -> tuple[int, int, int]:
        """Sub-frames, rows and columns."""
        return tuple(self._native.shape)

    @property
    def frames(self) -> int:
        """Sub-frames."""
        return self.shape[0]

    @property
    def exposures(self) -> dict[str, float] | None:
        """By what the light of each colour is multiplied, once for the whole eyebox; None where that is not known."""
        known = self._native.exposures
        return None if known is None else dict(zip(self.colors, known))

    @property
    def scene(self) -> str:
        """The name of the scene that it shows."""
        return self._native.scene

    @property
    def display(self) -> Display:
        """The display that it was made for: its optics, without its encoding."""
        return Display._of(self._native.display)

    @property
    def metadata(self) -> dict[str, Any]:
        """How it was made, as its file has it (docs/hologram-format.md)."""
        return json.loads(self._native.metadata)

    @property
    def stopped(self) -> str | None:
        """Why its solve ended: "steps", "seconds", "quality", "callback", or "interrupt" of what ctrl-C left; None where it was not
        solved here."""
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
        """What an eye sees through a pupil.

        Parameters
        ----------
        x, y : float
            Its centre, metres: to the right, and down.
        diameter : float
            Its diameter, metres.
        depth : float
            Where it focuses, metres from the SLM's image; positive is nearer.
        engine : Engine or str
            Where it is computed.
        obstructed : str, optional
            Opaque marks in the pupil: "lashes", "floaters", "opacity" or "scratches".

        Returns
        -------
        numpy.ndarray
            (row, column, colour), float32, linear light with 1 as the scene's full scale.
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
        """Compares what pupils see with what they should see, with one exposure per colour for all of them.

        Parameters
        ----------
        scene : Scene, str, path or array, optional
            Its scene; the one that it was solved from where none is given, read as it was then. A hologram of an array takes
            that array again.
        pupils : sequence of (x, y, diameter, depth), optional
            Metres. Where none are given, five of 4 mm, in the middle of the eyebox and around it.
        engine : Engine or str
            Where it is computed.
        other_scene : bool
            Take a scene that is not the one that the hologram was solved from.
        obstructed : str, optional
            Opaque marks in each pupil: "lashes", "floaters", "opacity" or "scratches".

        Raises
        ------
        HologramError
            A scene that is another, was changed or is not found.
        DisplayError
            An obstruction that is unknown.
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
        """The same hologram, refined for where the pupil is, in the best state that the steps reached.

        Parameters
        ----------
        pupil : (x, y, diameter, depth)
            Where it is, metres; its centre is known to within ``spread``.
        steps : int
            Steps that are taken at most.
        scene, engine, callback, other_scene, **steering
            As of :class:`eyebox.Refiner` and its ``step``.
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
        """The video frames that a display receives.

        Parameters
        ----------
        display : Display, str or path, optional
            The display; the one that it was solved for where none is given, cut to the hologram's size.

        Returns
        -------
        numpy.ndarray
            (frame, row, column, channel), uint8, in the order in which they are shown; 1 channel (grey) or 3.
        """
        return self._native.encode(self._shown_on(display)._native)

    def _focal_length(self) -> float:
        return self.display.focal_length

    def _usual(self) -> float:
        return min(4e-3, self.display.eyebox)

    def _shown_on(self, display: Any) -> Display:
        """The display that is given, or that it was solved for."""
        if display is None or _arguments.is_path(display):
            named = None if display is None else _arguments.path(display, "display")
            return Display._of(self._native.shown_on(named))
        return display_of(display)

    def _scene_of(self, scene: Any, other_scene: bool = False) -> Scene:
        """Its scene, read as it was solved, or the one that is given."""
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
    """A file without a name, in memory if the system can, that holds an array."""
    if hasattr(os, "memfd_create"):
        file = os.fdopen(os.memfd_create("eyebox phases", os.MFD_CLOEXEC), "w+b")
    else:
        file = tempfile.TemporaryFile()
    file.write(memoryview(array).cast("B"))
    file.flush()
    return file
