"""Types of arguments for type checkers."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, Protocol, SupportsFloat, SupportsIndex, TypeAlias, TypedDict, Union

if TYPE_CHECKING:
    from ._arguments import Pupil
    from ._display import Display, Engine
    from ._scene import Scene


class SupportsDLPack(Protocol):
    """An array of PyTorch, JAX or another library with DLPack."""

    def __dlpack__(self, *, stream: Any = None) -> Any: ...


class SupportsArray(Protocol):
    """An object from which NumPy makes an array."""

    def __array__(self, *arguments: Any, **options: Any) -> Any: ...


#: A path, or a name that stands for one.
Path: TypeAlias = Union[str, bytes, "os.PathLike[str]", "os.PathLike[bytes]"]
#: A number, or a text with its unit such as "4mm", "0.5D" or "10s".
Quantity: TypeAlias = Union[SupportsFloat, str]
Whole: TypeAlias = SupportsIndex
#: The center, the diameter and the depth of a pupil.
PupilLike: TypeAlias = Union["Pupil", tuple[Quantity, Quantity, Quantity, Quantity], SupportsArray]
Pupils: TypeAlias = Union[Iterable[PupilLike], SupportsArray]
ArrayLike: TypeAlias = Union[SupportsDLPack, SupportsArray, Sequence[Any]]
ColorName: TypeAlias = Literal["red", "green", "blue"]
#: One or several names of colors. A text that is no literal is checked when the program runs.
Colors: TypeAlias = Union[str, Sequence[str]]
DisplayLike: TypeAlias = Union["Display", Path]
SceneLike: TypeAlias = Union["Scene", Path, ArrayLike]
EngineLike: TypeAlias = Union["Engine", str]
Obstruction: TypeAlias = Literal["lashes", "floaters", "opacity", "scratches"]
Range: TypeAlias = Union[tuple[Quantity, Quantity], list[float], list[str], SupportsArray]


class DisplayFields(TypedDict, total=False):
    """Keys of a display file (docs/displays.md). A text with a unit replaces a number."""

    resolution: Sequence[int]
    pitch_um: Quantity
    focal_length_mm: Quantity
    wavelengths_nm: Mapping[str, Quantity]
    levels: Whole
    rate_hz: Quantity | None
    geometry: Literal["relay", "far-field"]
    portrait: bool
    dispersion: Mapping[str, SupportsFloat] | None
    sources_lit: str | Mapping[str, Any] | None
    encoding: Mapping[str, Any] | None
    model: Mapping[str, Any] | None
    source: Mapping[str, Any] | None
    mask: Mapping[str, Any] | None
    sources: Sequence[Mapping[str, Any]] | None
    picture: Mapping[str, Any] | None
    prescription: Mapping[str, Any] | None
    viewing: Mapping[str, Any] | None
    device: Mapping[str, Any] | None
    trigger_out: Mapping[str, Any] | None
    trigger_in: Mapping[str, Any] | None
