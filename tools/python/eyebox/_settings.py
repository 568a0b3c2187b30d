"""The settings of solves and refinements, with their types."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, SupportsFloat, TypedDict, Union

if TYPE_CHECKING:
    from typing_extensions import Unpack

from ._types import Quantity, Range, Whole

Method = Literal["slfh", "lf2fs", "stft", "stft-unfiltered", "stft-exact", "smooth", "dpac", "pupil-aware", "table"]
Optimizer = Union[Literal["projection", "adam"], Mapping[str, Any]]
Window = Union[Literal[1, 2, "full", "one", "two"]]
Storage = Literal["fp32", "fp16"]


class SolveFields(TypedDict, total=False):
    """Settings of :func:`eyebox.solve` that are no arguments of their own."""

    repeats: Whole | None
    method: Method | None
    first_phases: Literal["table", "random"] | None
    optimizer: Optimizer | None
    seconds: Quantity | None
    psnr: SupportsFloat | None
    efficiency: SupportsFloat | None
    window: Window | None
    diameter: Range | None
    depth: Range | None
    diameters: Literal["log", "log-uniform", "uniform", "reciprocal"] | None
    sequence: Literal["sobol", "random"] | None
    stft_filter: SupportsFloat | None
    stft_samples: Whole | None
    evenness: SupportsFloat | None
    patches: Whole | None
    levels: Whole | bool | Sequence[float] | None
    padding: Literal["never", "need", "always", "exact"] | bool | None
    pixel: Literal[1, 2] | None
    all_modes: bool | None
    joint: Mapping[str, Any] | None
    window_bytes: Whole | None
    storage: Storage | None
    quality: Literal["fast", "balanced", "accurate"] | None
    contrast: SupportsFloat | None
    force: bool | None
    full: str | Sequence[str] | None


class JobFields(SolveFields, total=False):
    """All settings of :func:`eyebox.solve`, for functions of :mod:`eyebox.cluster`."""

    frames: Whole | None
    steps: Whole | None
    pupils: Whole | None
    seed: Whole | None


class AllFields(JobFields, total=False):
    """The fields of :class:`SolveSettings`."""

    views: Whole | None


class FarFieldFields(SolveFields, total=False):
    """Settings of :func:`eyebox.cluster.solve_far_field` that are no arguments of their own."""

    frames: Whole | None
    seed: Whole | None


class RefineFields(TypedDict, total=False):
    """Settings of :class:`eyebox.Refiner`."""

    strategy: Optimizer | None
    pupils: Whole | None
    elsewhere: SupportsFloat | None
    window: Window | None
    repeats: Whole | None
    storage: Storage | None
    seed: Whole | None


@dataclass(frozen=True, kw_only=True)
class SolveSettings:
    """The settings of a solve. None leaves the default of the library, which depends on ``quality``.

    ``eyebox.solve(scene, display, settings=SolveSettings(steps=200))`` uses them. Arguments of :func:`eyebox.solve`
    replace the settings. docs/settings.md describes the values.

    Attributes
    ----------
    frames, repeats : int
        Sub-frames of a set, and the number of times that each solved sub-frame is shown.
    steps, pupils : int
        Highest number of steps, and pupils per step.
    seconds, psnr : float
        Duration (s, or a text such as "10s") and mean PSNR (dB) at which the solve ends.
    seed : int
        Seed of the first phases and the pupils.
    method, first_phases, optimizer, sequence, diameters, window, padding, storage, quality : str
        Names of choices.
    diameter, depth : (float, float)
        Ranges of drawn diameters and depths in meters, or texts such as "4mm" and "0.5D".
    efficiency, contrast, stft_filter, evenness : float
        Share of the light for the pupils, speckle contrast, Fourier filter, and weight of an even eyebox.
    stft_samples, patches, views, pixel : int
        Window of the STFT, patches of the eyebox, step between used views, and side of a solved pixel.
    levels : int, bool or sequence of float
        Phase levels of the SLM.
    joint : dict
        Simultaneous color.
    all_modes, force : bool
        All modes of the source for every pupil, and acceptance of unusual displays and pupils.
    full : str or sequence of str
        Parts of the model that are always computed in full.
    window_bytes : int
        Largest memory of the windows of pupils in flight, in bytes.

    Examples
    --------
    >>> fast = eyebox.SolveSettings(quality="fast", frames=4)
    >>> fast.replace(steps=20).steps
    20
    """

    frames: Whole | None = None
    repeats: Whole | None = None
    steps: Whole | None = None
    pupils: Whole | None = None
    seconds: Quantity | None = None
    psnr: SupportsFloat | None = None
    seed: Whole | None = None
    method: Method | None = None
    first_phases: Literal["table", "random"] | None = None
    optimizer: Optimizer | None = None
    efficiency: SupportsFloat | None = None
    window: Window | None = None
    diameter: Range | None = None
    depth: Range | None = None
    diameters: Literal["log", "log-uniform", "uniform", "reciprocal"] | None = None
    sequence: Literal["sobol", "random"] | None = None
    stft_filter: SupportsFloat | None = None
    stft_samples: Whole | None = None
    evenness: SupportsFloat | None = None
    patches: Whole | None = None
    levels: Whole | bool | Sequence[float] | None = None
    padding: Literal["never", "need", "always", "exact"] | bool | None = None
    views: Whole | None = None
    pixel: Literal[1, 2] | None = None
    all_modes: bool | None = None
    joint: Mapping[str, Any] | None = None
    window_bytes: Whole | None = None
    storage: Storage | None = None
    quality: Literal["fast", "balanced", "accurate"] | None = None
    contrast: SupportsFloat | None = None
    force: bool | None = None
    full: str | Sequence[str] | None = None

    def replace(self, **fields: Unpack[AllFields]) -> SolveSettings:
        """Returns the same settings with other values of some fields."""
        return dataclasses.replace(self, **fields)

    def given(self) -> dict[str, Any]:
        """Returns the settings that are not None, by their names."""
        named = ((field.name, getattr(self, field.name)) for field in dataclasses.fields(self))
        return {name: value for name, value in named if value is not None}
