"""Displays, and the engines that compute for them."""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from . import _arguments, _eyebox, _notebook
from ._values import Unchanging

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._types import Colors, DisplayFields, Path


def presets() -> list[str]:
    """Returns the names of the built-in displays."""
    return _eyebox.presets()


class Display(Unchanging):
    """A display with its SLM, its optics and the encoding of its phases. It never changes.

    Parameters
    ----------
    name : str or path, optional
        Preset (:func:`presets`) or display file (TOML, docs/displays.md). Without a name, the fields describe the
        whole display.
    size : (int, int) or str, optional
        Rows and columns of the SLM, or a text such as "1080p".
    color : str or sequence of str, optional
        Colors of the display, such as "green" for a display of one color. The default is all of them.
    **fields
        Keys of a display file, which replace the keys of ``name``. They include ``pitch_um``, ``focal_length_mm``,
        ``wavelengths_nm`` (a dict of colors), ``levels``, ``rate_hz``, ``geometry`` ("relay" or "far-field") and
        ``portrait``. The keys ``encoding``, ``model``, ``picture`` and ``prescription`` are dicts. A text with any
        unit of length replaces a number, as in ``focal_length_mm="40cm"``.

    Raises
    ------
    DisplayError
        If the display is not possible. The message names the key.

    Examples
    --------
    >>> import eyebox
    >>> eyebox.Display("planes8", size=(512, 512)).resolution
    (512, 512)
    >>> bench = eyebox.Display(
    ...     size=(1080, 1920), pitch_um=8.0, focal_length_mm=400.0, wavelengths_nm={"green": 520.0}, levels=256
    ... )
    >>> round(bench.eyebox * 1e3, 1)
    26.0
    """

    __slots__ = ("_native",)

    def __init__(
        self,
        name: Path | None = None,
        *,
        size: tuple[int, int] | str | None = None,
        color: Colors | None = None,
        **fields: Unpack[DisplayFields],
    ) -> None:
        if name is None and size is None and not fields:
            raise _arguments.wrong(TypeError, "name", "is not given: Display() needs a name, or the fields of a display file")
        named = None if name is None else _arguments.path(name, "name")
        self._native = _eyebox.Display(named, _arguments.toml(_fields(fields, size)))
        if color is not None:
            has = list(self.wavelengths)
            kept = _arguments.colors(color, has)
            if unknown := [one for one in kept if one not in has]:
                raise _arguments.wrong(ValueError, "color", f"is {unknown[0]!r}: it must be one or more of {', '.join(has)}")
            self._native = self._native.replace("", [f"wavelengths_nm.{one}" for one in has if one not in kept])

    @classmethod
    def _of(cls, native: _eyebox.Display) -> Display:
        made = object.__new__(cls)
        made._native = native
        return made

    @property
    def name(self) -> str:
        """Name of the display."""
        return self._native.name

    @property
    def resolution(self) -> tuple[int, int]:
        """Rows and columns of the SLM."""
        return self._native.resolution

    @property
    def picture_size(self) -> tuple[int, int]:
        """Rows and columns of the pictures that it shows."""
        return self._native.picture_size

    @property
    def pitch(self) -> float:
        """Pixel pitch in meters."""
        return self._native.pitch

    @property
    def focal_length(self) -> float:
        """Focal length of the relay in meters."""
        return self._native.focal_length

    @property
    def eyebox(self) -> float:
        """Side of the eyebox that all colors serve, in meters."""
        return self._native.eyebox

    @property
    def geometry(self) -> str:
        """Place of the SLM, either "relay" or "far-field"."""
        return self._native.geometry

    @property
    def wavelengths(self) -> dict[str, float]:
        """Wavelength of each color in meters."""
        return dict(self._native.wavelengths)

    @property
    def levels(self) -> int:
        """Number of phase levels of the SLM."""
        return self._native.levels

    def to_toml(self) -> str:
        """Returns the text of the display file."""
        return self._native.to_toml()

    def replace(
        self,
        *,
        name: str | None = None,
        size: tuple[int, int] | str | None = None,
        **fields: Unpack[DisplayFields],
    ) -> Display:
        """Returns the same display with other values of some keys.

        Parameters
        ----------
        name : str, optional
            Name of the display.
        size : (int, int) or str, optional
            Rows and columns of the SLM, or a text such as "1080p".
        **fields
            Keys of a display file, as for :class:`Display`. A dict replaces only the keys that it has. None removes a
            key, also within a dict.

        Raises
        ------
        DisplayError
            If the display is not possible. The message names the key.

        Examples
        --------
        >>> import eyebox
        >>> small = eyebox.Display("small", size=(64, 64)).replace(levels=16, focal_length_mm="20cm")
        >>> small.levels, small.focal_length
        (16, 0.2)
        """
        given = _fields(fields, size)
        if name is not None:
            given["name"] = str(name)
        return Display._of(self._native.replace(_arguments.toml(_without_none(given)), _removed(given)))

    def _repr_html_(self) -> str:
        rows, columns = self.resolution
        pictures = self.picture_size
        about = [
            ("SLM", f"{rows} x {columns} pixels of {self.pitch * 1e6:.4g} um, {self.levels} levels"),
            ("pictures", f"{pictures[0]} x {pictures[1]} pixels"),
            ("geometry", self.geometry),
            ("focal length", f"{self.focal_length * 1e3:.4g} mm"),
            ("eyebox", f"{self.eyebox * 1e3:.4g} mm"),
            ("wavelengths", ", ".join(f"{color} {metres * 1e9:.4g} nm" for color, metres in self.wavelengths.items())),
        ]
        return _notebook.table(("display", self.name), about)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Display) and self.to_toml() == other.to_toml()

    def __hash__(self) -> int:
        return hash(self.to_toml())

    def __reduce__(self) -> tuple[Any, ...]:
        return _display_of_toml, (self.to_toml(), self._native.file)

    def __repr__(self) -> str:
        (rows, columns), colors = self.resolution, ", ".join(self.wavelengths)
        return f"<eyebox.Display {self.name}: {rows} x {columns}, {colors}, eyebox {self.eyebox * 1e3:.1f} mm>"


def _fields(given: Mapping[str, Any], size: Any) -> dict[str, Any]:
    fields = _arguments.with_units(given)
    return fields if size is None else {**fields, "resolution": _arguments.size(size)}


def _without_none(fields: Mapping[str, Any]) -> dict[str, Any]:
    inner = {key: _without_none(value) if isinstance(value, Mapping) else value for key, value in fields.items()}
    return {key: value for key, value in inner.items() if value is not None}


def _removed(fields: Mapping[str, Any], of: str = "") -> list[str]:
    """Returns the keys whose value is None, with dots between tables and keys."""
    removed = []
    for key, value in fields.items():
        if value is None:
            removed.append(of + key)
        elif isinstance(value, Mapping):
            removed += _removed(value, f"{of}{key}.")
    return removed


def _display_of_toml(text: str, file: str | None = None) -> Display:
    return Display._of(_eyebox.Display.of_toml(text, file))


def display_of(value: Any) -> Display:
    """Returns a display that is given as such, by its name or by its file."""
    if isinstance(value, Display):
        return value
    if _arguments.is_path(value):
        return Display(value)
    right = "an eyebox.Display, the name of a preset or a display file"
    raise _arguments.wrong(TypeError, "display", f"is {value!r}: it must be {right}")


class Engine(Unchanging):
    """The CPU or the device that computes. Threads can share one engine and compute in parallel.

    Parameters
    ----------
    choice : {"auto", "cpu", "vulkan"}
        "auto" uses a real GPU if there is one that computes correctly, and otherwise the CPU. "vulkan" also accepts a
        device in software.
    """

    __slots__ = ("_choice", "_native")

    def __init__(self, choice: str = "auto") -> None:
        if not isinstance(choice, str):
            raise _arguments.wrong(TypeError, "choice", f"is {choice!r}: it must be auto, cpu or vulkan")
        self._choice = choice
        self._native = _eyebox.Engine(choice)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Engine) and (self._choice, self.reason) == (other._choice, other.reason)

    def __hash__(self) -> int:
        return hash((self._choice, self.reason))

    def __reduce__(self) -> tuple[Any, ...]:
        # Another process opens an engine of the same choice on its own devices.
        return Engine, (self._choice,)

    @property
    def reason(self) -> str:
        """Sentence that names the engine and the reason for this choice."""
        return self._native.reason

    def __repr__(self) -> str:
        return f"<eyebox.Engine {self.reason}>"


_opening = threading.Lock()


@functools.lru_cache(maxsize=None)
def _shared(choice: str) -> _eyebox.Engine:
    return _eyebox.Engine(choice)


def _forked() -> None:
    """Prepares a forked child, which must not use engines of the parent or wait for a lock that the parent held."""
    global _opening
    _opening = threading.Lock()
    _shared.cache_clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


def engine_of(value: Any) -> _eyebox.Engine:
    """Returns a given engine, or the shared engine of the process by its name."""
    if isinstance(value, Engine):
        return value._native
    if isinstance(value, str):
        with _opening:
            return _shared(value)
    raise _arguments.wrong(TypeError, "engine", f"is {value!r}: it must be an eyebox.Engine, auto, cpu or vulkan")
