"""The bench of an SLM and a camera of slmsuite, as the camera of a calibration or of a solve."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable

import numpy as np

from . import _arguments
from ._calibrate import Shot
from ._display import display_of
from ._hologram import Hologram
from ._slmsuite_levels import bit_depth, level_type, levels, plain_array, slm_size

if TYPE_CHECKING:
    from ._types import DisplayLike, Quantity, Range


class Bench:
    """An SLM and a camera of slmsuite, as the ``camera`` of :func:`eyebox.calibrate` and :func:`eyebox.solve`.

    The camera sees the image of the SLM through a relay with an iris (docs/calibrate.md). slmsuite has no irises, focus
    stages and shutters, so functions of yours move them. All lengths are meters.

    Parameters
    ----------
    slm : SLM of slmsuite
        The SLM, which receives gray levels.
    camera : camera of slmsuite
        The camera, whose pictures are linear in light.
    iris : callable or (float, float, float), optional
        Function (x, y, diameter) that moves the iris and returns when it rests, or the position and the diameter of an
        iris that does not move.
    iris_range : ((float, float), (float, float), (float, float)), optional
        Ranges of x, y and the diameter of an iris that moves.
    focus : callable, optional
        Function (depth) that focuses the camera.
    focus_range : (float, float), optional
        Range of the depths. Texts in diopters need ``display``.
    light : callable, optional
        Function (color) that lights the laser of a color, or none for None. Without it, the laser is always on and no
        dark picture is taken.
    exposures : (float, float), optional
        Shortest and longest exposure in seconds. The default is the camera's ``exposure_bounds_s``.
    display : Display, str or path, optional
        Display whose encoding converts phases to levels. It is required if the encoding has look-up tables, corrections
        or rotations. Otherwise eyebox sends the levels.

    Attributes
    ----------
    hello : dict
        Description of the bench, which is the default of ``hello`` in :func:`eyebox.calibrate`.
    iris : tuple or None
        Iris that does not move, which is the default of ``iris`` there.
    """

    __slots__ = ("_camera", "_display", "_focus", "_light", "_move_iris", "_slm", "hello", "iris")

    def __init__(
        self,
        slm: Any,
        camera: Any,
        *,
        iris: Callable[[float, float, float], Any] | tuple[Quantity, Quantity, Quantity] | None = None,
        iris_range: Any = None,
        focus: Callable[[float], Any] | None = None,
        focus_range: Range | None = None,
        light: Callable[[str | None], Any] | None = None,
        exposures: Range | None = None,
        display: DisplayLike | None = None,
    ) -> None:
        for name, value in (("focus", focus), ("light", light)):
            if value is not None and not callable(value):
                raise _arguments.wrong(TypeError, name, f"is {value!r}: it must be callable")
        if callable(iris) != (iris_range is not None):
            raise _arguments.wrong(TypeError, "iris_range", "belongs to an iris that is a function: give both")
        if (focus is None) != (focus_range is None):
            raise _arguments.wrong(TypeError, "focus_range", "belongs to a function as focus: give both, or neither")
        self._slm, self._camera, self._focus, self._light = slm, camera, focus, light
        self._move_iris = iris if callable(iris) else None
        self.iris: tuple[float, ...] | None = None
        if iris is not None and not callable(iris):
            self.iris = tuple(_arguments.quantities(iris, "m", "iris", "x, y, diameter"))
        self._display = None if display is None else display_of(display)
        if exposures is None:
            exposures = getattr(camera, "exposure_bounds_s", None)
        seen: dict[str, Any] = {
            "resolution": [int(count) for count in camera.shape],
            "bits": _arguments.whole(camera.bitdepth, "camera.bitdepth"),
            "dark": light is not None,
        }
        if exposures is not None:
            seen["exposure_ms"] = _pair(exposures, "s", "exposures")
        takes = ["levels"] if self._display is None else ["phases"]
        self.hello: dict[str, Any] = {
            "name": f"{getattr(slm, 'name', 'SLM')} and {getattr(camera, 'name', 'camera')} of slmsuite",
            "camera": seen,
            "slm": {"resolution": list(slm_size(slm)), "levels": 2 ** bit_depth(slm), "takes": takes},
        }
        if iris_range is not None:
            x, y, diameter = _arguments.parts(iris_range, "iris_range", "range of x, range of y, range of the diameter")
            ranges = {"x_mm": x, "y_mm": y, "diameter_mm": diameter}
            self.hello["iris"] = {key: _pair(value, "m", "iris_range") for key, value in ranges.items()}
        if focus_range is not None:
            self.hello["focus_mm"] = self._focus_range(focus_range)

    def _focus_range(self, value: Any) -> list[float]:
        """Returns the range of the focus in millimeters. Diopters need a display, because they need a focal length."""
        ends = _arguments.ends(value, "focus_range")
        if self._display is None:
            return _pair(ends, "m", "focus_range")
        length = self._display.focal_length
        return [1e3 * _arguments.depth(end, lambda: length, "focus_range") for end in ends]

    def __call__(self, shot: Shot) -> np.ndarray:
        """Shows the pattern of a shot and takes its picture, the sum of ``shot.average`` pictures."""
        if self._light is not None:
            self._light(shot.color)
        if self._move_iris is not None:
            self._move_iris(*shot.iris)
        if self._focus is not None:
            self._focus(shot.focus)
        if shot.exposure is not None:
            self._camera.set_exposure(shot.exposure)
        if shot.show is not None:
            self._slm.set_phase(self._levels(shot), settle=True)
        # The camera may still hold a picture of the pattern before.
        self._camera.flush()
        return plain_array(self._camera.get_image(averaging=shot.average, hdr=False))

    def _levels(self, shot: Shot) -> np.ndarray:
        """Returns the levels (row, column) of a shot. The bench states that it shows one sub-frame at a time."""
        assert shot.show is not None
        if shot.show.dtype.kind != "f":
            return np.ascontiguousarray(shot.show[0], level_type(self._slm))
        assert self._display is not None
        made = Hologram.from_phases(shot.show, self._display, shot.color, exposure=1.0, engine="cpu")
        return levels(made, self._slm, shot.color, self._display)[0]


def _pair(value: Any, unit: str, what: str) -> list[float]:
    """Returns both ends of a range in thousandths of the unit."""
    return [1e3 * one for one in _arguments.quantities(value, unit, what, "least, most")]
