"""Types of the single file eyebox_live.py, as far as eyebox.live uses it."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from ._eyebox import EyeboxError

VIEWS: int
COLOR_AND_DEPTH: int
LAYERS: int
U8: int
U16: int
F16: int
F32: int
LINEAR: int
SRGB: int

class LiveError(EyeboxError): ...
class Gone(LiveError): ...

class Request(NamedTuple):
    number: int
    lit_ns: int
    period_ns: int
    pupil_x_mm: float
    pupil_y_mm: float
    pupil_diameter_mm: float
    focus_dioptres: float
    velocity_x_mm_s: float
    velocity_y_mm_s: float
    kind: int
    tracked: int
    view_rows: int
    view_columns: int
    pitch_mm: float
    center_x_mm: float
    center_y_mm: float

class Frame(NamedTuple):
    kind: int
    sample: int
    transfer: int
    view_rows: int
    view_columns: int
    pitch_mm: float
    dioptres: tuple[float, ...]

class Live:
    rows: int
    columns: int
    channels: int
    colors: int
    kinds: int
    most_views: Sequence[int]
    most_layers: int
    pixel_angle: float
    eyebox_mm: Sequence[float]
    def __init__(self, name: str) -> None: ...
    def close(self) -> None: ...
    def request(self) -> Request | None: ...
    def wait(self, seconds: float) -> Request | None: ...
    def send(
        self,
        frame: Frame,
        samples: Any,
        dioptres: Any = b"",
        request: Any = None,
        content_time_ns: int | None = None,
        center_mm: tuple[float, float] = ...,
    ) -> int: ...
