"""Sends frames from a Python program to a display that shows ``live:NAME`` (docs/live-input.md). It needs Linux.

Lengths are meters and times are seconds of ``time.monotonic()``. The focus of an eye and the depths of a frame are
diopters, because the connection does not have the focal length of the display. Infinity is 0, and larger is nearer.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from . import _arguments, _live_input
from ._live_input import Gone, LiveError

if TYPE_CHECKING:
    from typing_extensions import Self

    from ._types import ArrayLike, Quantity, Whole

__all__ = [
    "COLOR_AND_DEPTH",
    "F16",
    "F32",
    "Frame",
    "Gone",
    "Kind",
    "LAYERS",
    "LINEAR",
    "Live",
    "LiveError",
    "Request",
    "SRGB",
    "Sample",
    "Transfer",
    "U16",
    "U8",
    "VIEWS",
]


class Kind(enum.IntEnum):
    """The content of a frame."""

    VIEWS = _live_input.VIEWS
    COLOR_AND_DEPTH = _live_input.COLOR_AND_DEPTH
    LAYERS = _live_input.LAYERS


class Sample(enum.IntEnum):
    """The type of a sample. U8 and U16 are unsigned integers, and F16 and F32 are floating-point numbers."""

    U8 = _live_input.U8
    U16 = _live_input.U16
    F16 = _live_input.F16
    F32 = _live_input.F32


class Transfer(enum.IntEnum):
    """The transfer function of the samples. sRGB is for integers only."""

    LINEAR = _live_input.LINEAR
    SRGB = _live_input.SRGB


VIEWS, COLOR_AND_DEPTH, LAYERS = Kind.VIEWS, Kind.COLOR_AND_DEPTH, Kind.LAYERS
U8, U16, F16, F32 = Sample.U8, Sample.U16, Sample.F16, Sample.F32
LINEAR, SRGB = Transfer.LINEAR, Transfer.SRGB

_TYPES = {U8: "uint8", U16: "uint16", F16: "float16", F32: "float32"}
#: Colors by their bits in the memory of the connection.
_COLORS = {"red": 1, "green": 2, "blue": 4}


class Request(NamedTuple):
    """A request of the display, in meters, seconds and diopters."""

    #: Number of the request, from 1.
    number: int
    #: Time when the next set lights up, in seconds of ``time.monotonic()``.
    lit: float
    #: Time from one set to the next, in seconds.
    period: float
    #: Center of the pupil in meters, to the right and down.
    x: float
    y: float
    #: Diameter of the pupil in meters.
    diameter: float
    #: Focus of the eye in diopters.
    focus_diopters: float
    #: Velocity of the pupil in meters per second.
    velocity: tuple[float, float]
    #: Requested content.
    kind: Kind
    #: Whether a tracker measured the pupil. Otherwise it is a guess.
    tracked: bool
    #: Requested numbers of views.
    view_rows: int
    view_columns: int
    #: Distance of neighboring views in meters.
    view_pitch: float
    #: Position of the central view in meters.
    center: tuple[float, float]

    @classmethod
    def _of(cls, raw: _live_input.Request) -> Request:
        return cls(
            raw.number, raw.lit_ns * 1e-9, raw.period_ns * 1e-9, raw.pupil_x_mm * 1e-3, raw.pupil_y_mm * 1e-3,
            raw.pupil_diameter_mm * 1e-3, raw.focus_dioptres, (raw.velocity_x_mm_s * 1e-3, raw.velocity_y_mm_s * 1e-3),
            Kind(raw.kind), bool(raw.tracked), raw.view_rows, raw.view_columns, raw.pitch_mm * 1e-3,
            (raw.center_x_mm * 1e-3, raw.center_y_mm * 1e-3),
        )  # fmt: skip


class Frame(NamedTuple):
    """The description of a frame, from :meth:`Live.views`, :meth:`Live.color_and_depth` or :meth:`Live.layers`."""

    kind: Kind
    sample: Sample
    transfer: Transfer
    #: Shape of the samples.
    shape: tuple[int, ...]
    #: Distance of neighboring views in meters, or 0 for other kinds.
    view_pitch: float
    #: Depths of layers, the farthest first.
    diopters: tuple[float, ...]


class Live:
    """A connection to the display that takes frames as ``live:NAME``. Use it in a ``with`` block.

    Parameters
    ----------
    name : str
        NAME of the display, as in ``eyebox.show("live:NAME")`` and ``eyebox show live:NAME``.

    Raises
    ------
    LiveError
        If no display takes frames by this name.
    """

    def __init__(self, name: str) -> None:
        if not isinstance(name, str):
            raise _arguments.wrong(TypeError, "name", f"is {name!r}: it must be a text")
        self._live = _live_input.Live(name)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connection to the display."""
        self._live.close()

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns of every picture."""
        return self._live.rows, self._live.columns

    @property
    def colors(self) -> list[str]:
        """Names of the colors of the samples, in their order."""
        return [name for name, bit in _COLORS.items() if self._live.colors & bit]

    @property
    def kinds(self) -> set[Kind]:
        """Kinds of content that the display accepts."""
        return {kind for kind in Kind if self._live.kinds & kind}

    @property
    def most_views(self) -> tuple[int, int]:
        """Largest numbers of rows and columns of views."""
        rows, columns = self._live.most_views
        return rows, columns

    @property
    def most_layers(self) -> int:
        """Largest number of layers."""
        return self._live.most_layers

    @property
    def pixel_angle(self) -> float:
        """Angle between neighboring pixels in radians."""
        return self._live.pixel_angle

    @property
    def eyebox(self) -> tuple[float, float]:
        """Width and height of the eyebox in meters. Content at D diopters moves by D width / pixel_angle pixels."""
        width, height = self._live.eyebox_mm
        return width * 1e-3, height * 1e-3

    def request(self) -> Request | None:
        """Returns the current request of the display, or None before the first request."""
        raw = self._live.request()
        return None if raw is None else Request._of(raw)

    def wait(self, seconds: Quantity) -> Request | None:
        """Waits for a request that no earlier wait returned.

        Returns None if none arrived in ``seconds``, which may be a text such as "100ms".

        Raises
        ------
        Gone
            If the display is gone.
        """
        raw = self._live.wait(_arguments.finite_quantity(seconds, "s", "seconds"))
        return None if raw is None else Request._of(raw)

    def views(
        self, rows: Whole, columns: Whole, view_pitch: Quantity, sample: Sample = U8, transfer: Transfer = SRGB
    ) -> Frame:
        """Describes frames of (view row, view column, row, column, color).

        Parameters
        ----------
        rows, columns : int
            Numbers of views.
        view_pitch : float
            Distance of neighboring views in meters.
        sample, transfer : Sample, Transfer
            Type of the samples, and transfer function.
        """
        grid = _arguments.count(rows, "rows", 64), _arguments.count(columns, "columns", 64)
        pitch = _arguments.finite_quantity(view_pitch, "m", "view_pitch")
        return self._frame(VIEWS, sample, transfer, (*grid, *self._picture(0)), pitch)

    def color_and_depth(self, sample: Sample = U8, transfer: Transfer = SRGB) -> Frame:
        """Describes frames of (row, column, color), with float32 diopters of (row, column)."""
        return self._frame(COLOR_AND_DEPTH, sample, transfer, self._picture(0))

    def layers(self, diopters: Iterable[Quantity], sample: Sample = U8, transfer: Transfer = SRGB) -> Frame:
        """Describes frames of (layer, row, column, color and opacity), with the farthest layer first.

        ``diopters`` are the depths of the layers, as numbers or as texts such as "0.5D".
        """
        try:
            depths = tuple(_arguments.finite_quantity(one, "D", "diopters") for one in diopters)
        except TypeError as error:
            if hasattr(error, "argument"):
                raise
            raise _arguments.wrong(TypeError, "diopters", f"is {diopters!r}: it must be a sequence of depths") from None
        return self._frame(LAYERS, sample, transfer, (len(depths), *self._picture(1)), 0.0, depths)

    def _picture(self, opacity: int) -> tuple[int, int, int]:
        return (*self.size, self._live.channels + opacity)

    def _frame(
        self, kind: Kind, sample: Any, transfer: Any, shape: tuple[int, ...], pitch: float = 0.0, depths: tuple[float, ...] = ()
    ) -> Frame:
        return Frame(kind, _one_of(Sample, sample, "sample"), _one_of(Transfer, transfer, "transfer"), shape, pitch, depths)

    def send(
        self,
        frame: Frame,
        samples: ArrayLike | bytes,
        diopters: ArrayLike | bytes | None = None,
        *,
        request: Request | None = None,
        content_time: Quantity | None = None,
        center: tuple[Quantity, Quantity] = (0.0, 0.0),
    ) -> int:
        """Sends a frame and returns its number.

        Parameters
        ----------
        frame : Frame
            Description of the frame.
        samples : array or bytes
            Samples of the shape and the type of ``frame``, or their bytes.
        diopters : array or bytes, optional
            Depth of each pixel in float32 diopters, for color and depth only.
        request : Request, optional
            Request that the frame answers.

        content_time : float, optional
            Time of the content in seconds of ``time.monotonic()``. The default is the time of the request.
        center : (float, float)
            Position of the central view or of the camera in meters.

        Raises
        ------
        LiveError
            If the display does not accept this frame.
        """
        if not isinstance(frame, Frame):
            raise _arguments.wrong(TypeError, "frame", f"is {frame!r}: it must be an eyebox.live.Frame")
        if request is not None and not isinstance(request, Request):
            raise _arguments.wrong(TypeError, "request", f"is {request!r}: it must be an eyebox.live.Request")
        light = _bytes(samples, "samples", frame.shape, _TYPES[frame.sample])
        depths = b"" if diopters is None else _bytes(diopters, "diopters", self.size, "float32")
        time = 0.0 if request is None else request.lit
        if content_time is not None:
            time = _arguments.finite_quantity(content_time, "s", "content_time")
        answered = None if request is None else _Answered(_arguments.count(request.number, "request", (1 << 64) - 1, least=0))
        x, y = _arguments.quantities(center, "m", "center", "x, y")
        rows, columns = frame.shape[:2] if frame.kind is VIEWS else (1, 1)
        raw = _live_input.Frame(
            int(frame.kind), int(frame.sample), int(frame.transfer), rows, columns, frame.view_pitch * 1e3, frame.diopters
        )
        return self._live.send(raw, light, depths, answered, round(time * 1e9), (x * 1e3, y * 1e3))


class _Answered(NamedTuple):
    """The number of a request, which is what a frame has of it."""

    number: int


def _one_of(kind: Any, value: Any, what: str) -> Any:
    """Returns a member of an enumeration."""
    try:
        return kind(value)
    except ValueError:
        right = ", ".join(f"eyebox.live.{one.name}" for one in kind)
        raise _arguments.wrong(ValueError, what, f"is {value!r}: it must be one of {right}") from None


def _bytes(value: Any, what: str, shape: tuple[int, ...], kind: str) -> Any:
    """Returns samples as a contiguous array of their shape and type. Bytes stay bytes."""
    if isinstance(value, (bytes, bytearray, memoryview)):
        return value
    right = f"{shape} of {kind}"
    made = _arguments.array(value, what, right)
    if made.dtype.kind == np.dtype(kind).kind == "f":
        made = np.asarray(made, kind)
    if made.dtype != np.dtype(kind):
        raise _arguments.wrong(TypeError, what, f"has the dtype {made.dtype}: it must be {right}")
    if made.shape != shape:
        raise _arguments.wrong(ValueError, what, f"has the shape {made.shape}: it must be {right}")
    return np.ascontiguousarray(made).reshape(-1)
