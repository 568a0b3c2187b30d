"""Shows holograms on SLMs of slmsuite, and takes pictures with its cameras (docs/slmsuite.md).

slmsuite (https://github.com/slmsuite/slmsuite) has drivers for many SLMs and cameras. ``pip install slmsuite`` installs
it. This module does not import slmsuite. It uses the SLM and the camera objects that you made with it.

SLMs receive gray levels and never phases. slmsuite negates floating-point phases before it converts them to levels, so
the same number means the other phase there. It sends levels as they are. The display of the hologram converts phases to
levels, with its look-up tables, corrections and gratings. slmsuite's own ``gamma`` and wavefront correction do not
apply to levels.

>>> import eyebox.slmsuite
>>> eyebox.slmsuite.show(hologram, slm)  # doctest: +SKIP
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, Callable, NamedTuple

import numpy as np

from . import _arguments, _eyebox
from ._display import Display
from ._hologram import Hologram
from ._slmsuite_bench import Bench
from ._slmsuite_levels import bit_depth, levels, look_up, slm_size

if TYPE_CHECKING:
    from ._types import Quantity

__all__ = ["Bench", "Played", "Shown", "display_of", "levels", "play", "show"]

class Shown(NamedTuple):
    """A pattern that an SLM shows and that has settled.

    Attributes
    ----------
    hologram : int
        Number of the hologram in the content, from 0.
    sub_frame : int
        Number of the sub-frame in its multiplex set, from 0.
    seconds : float
        Time from the start of the content until the driver had written the pattern.
    """

    hologram: int
    sub_frame: int
    seconds: float


class Played(NamedTuple):
    """The account of played content.

    Attributes
    ----------
    holograms : int
        Number of holograms that were shown. Repetitions count too.
    sub_frames : int
        Number of patterns that were written.
    late : int
        Number of patterns that were written after their time.
    seconds : float
        Duration in seconds.
    """

    holograms: int
    sub_frames: int
    late: int
    seconds: float


def display_of(
    slm: Any,
    focal_length: Quantity,
    color: str | None = None,
    **fields: Any,
) -> Display:
    """Describes an SLM of slmsuite as a display, with its size, pitch, levels, wavelength and look-up table.

    Parameters
    ----------
    slm : SLM of slmsuite
        The SLM. If it has a ``gamma``, this is the look-up table of the display. Otherwise ``wav_um`` and
        ``wav_design_um`` determine the level of 2 pi.
    focal_length : float or str
        Focal length of the relay in meters, or a text such as "400mm".
    color : str, optional
        Name of the wavelength, "red", "green" or "blue". The default is the name that fits it best.
    **fields
        Further keys of a display file, as for :class:`eyebox.Display`. They replace the keys of the SLM.

    Raises
    ------
    ValueError
        If the pixels of the SLM are not square.
    DisplayError
        If the display is not possible.
    """
    pitch = [float(one) for one in np.broadcast_to(np.asarray(slm.pitch_um, dtype=float), 2)]
    if abs(pitch[0] / pitch[1] - 1) > 1e-6:
        raise _arguments.wrong(ValueError, "slm", f"has pixels of {pitch[0]} x {pitch[1]} um: they must be square")
    wavelength = float(slm.wav_um) * 1e3
    if color is None:
        color = "blue" if wavelength < 490 else "green" if wavelength < 580 else "red"
    encoding = look_up(slm, {color: wavelength * 1e-9})
    known = {
        "pitch_um": pitch[0],
        "focal_length_mm": 1e3 * _arguments.finite_quantity(focal_length, "m", "focal_length"),
        "wavelengths_nm": {color: wavelength},
        "levels": 2 ** bit_depth(slm),
    }
    given = fields.pop("encoding", None)
    made = Display(size=slm_size(slm), **{**known, "encoding": {**encoding, **(given or {})}, **fields})
    return made.replace(name=str(getattr(slm, "name", "") or "slmsuite"))


def show(
    hologram: Hologram,
    slm: Any,
    color: str | None = None,
    display: Any = None,
    *,
    sub_frame: int = 0,
    settle: bool = True,
    **options: Any,
) -> np.ndarray:
    """Shows one sub-frame of a hologram on an SLM of slmsuite.

    Parameters
    ----------
    hologram, slm, color, display
        Arguments of :func:`levels`.
    sub_frame : int
        Number of the sub-frame, from 0.
    settle : bool
        Wait for the settle time of the SLM.
    **options
        Arguments of ``slm.set_phase``, such as ``timeout_s`` of some SLMs.

    Returns
    -------
    numpy.ndarray
        Levels (row, column) that were sent.
    """
    every = levels(hologram, slm, color, display)
    at = _arguments.count(sub_frame, "sub_frame", len(every) - 1, least=0)
    slm.set_phase(every[at], settle=bool(settle), **options)
    return every[at]


def play(
    what: Any,
    slm: Any,
    color: str | None = None,
    display: Any = None,
    *,
    sets: int = 1,
    loop: bool = False,
    rate: Quantity | None = None,
    seconds: Quantity | None = None,
    input_trigger: bool = False,
    output_trigger: bool = False,
    callback: Callable[[Shown], Any] | None = None,
    **options: Any,
) -> Played:
    """Plays holograms on an SLM of slmsuite, one sub-frame after the other. Returns after the last one.

    Each pattern stays for the settle time of the SLM, or for the period of ``rate`` if it is longer. The levels of the
    next hologram are computed meanwhile.

    Parameters
    ----------
    what : Hologram, path, or iterable of them
        A hologram, the file of a hologram or a sequence, or several of them.
    slm, color, display
        Arguments of :func:`levels`.
    sets : int
        Number of times that the multiplex set of each hologram is shown before the next hologram.
    loop : bool
        Begin again at the end, until ``seconds`` are over, the callback ends it, or ctrl-C. An iterable that can be
        iterated only once ends there.
    rate : float or str, optional
        Highest number of sub-frames per second. The default is as fast as the SLM settles.
    seconds : float or str, optional
        Highest duration in seconds.
    input_trigger : bool
        Let each write wait for the input trigger of the SLM.
    output_trigger : bool
        Let the SLM send its output trigger.
    callback : callable, optional
        Function that gets a :class:`Shown` when a pattern has settled. A picture that a camera takes there shows this
        pattern. A false answer other than None ends the content.
    **options
        Arguments of ``slm.set_phase``.

    Returns
    -------
    Played
        Numbers of holograms and patterns, and the patterns that were late.

    Raises
    ------
    NotImplementedError
        If the driver of slmsuite has no such trigger.
    """
    if callback is not None and not callable(callback):
        raise _arguments.wrong(TypeError, "callback", f"is {callback!r}: it must be callable with a Shown")
    repeats = _arguments.count(sets, "sets")
    period = 0.0 if rate is None else 1.0 / _positive(rate, "Hz", "rate")
    period = max(period, float(getattr(slm, "settle_time_s", 0.0)))
    most = None if seconds is None else _positive(seconds, "s", "seconds")
    wanted = (("set_input_trigger", input_trigger), ("set_output_trigger", output_trigger))
    triggers = [_trigger(slm, name) for name, on in wanted if on]
    holograms = sub_frames = late = 0
    switched: list[Callable[[bool], Any]] = []
    patterns = _ahead(_all(what, loop), lambda hologram: levels(hologram, slm, color, display))
    try:
        for trigger in triggers:
            trigger(True)
            switched.append(trigger)
        # The time starts when the first levels are there.
        first = list(itertools.islice(patterns, 1))
        begun = due = time.perf_counter()
        for every in itertools.chain(first, patterns):
            for at, pattern in ((at, one) for _ in range(repeats) for at, one in enumerate(every)):
                if most is not None and time.perf_counter() - begun >= most:
                    return Played(holograms, sub_frames, late, time.perf_counter() - begun)
                late += time.perf_counter() > due + 0.5 * period if sub_frames else 0
                slm.set_phase(pattern, settle=False, **options)
                written = time.perf_counter()
                # The pattern settles after the write. A late one moves all later ones, so that none is shortened.
                due = max(due, written) + period
                sub_frames += 1
                time.sleep(max(due - time.perf_counter(), 0.0))
                answer = None if callback is None else callback(Shown(holograms, at, written - begun))
                if answer is not None and not answer:
                    return Played(holograms + 1, sub_frames, late, time.perf_counter() - begun)
            holograms += 1
        return Played(holograms, sub_frames, late, time.perf_counter() - begun)
    finally:
        patterns.close()
        for trigger in switched:
            trigger(False)


def _trigger(slm: Any, name: str) -> Callable[[bool], Any]:
    """Returns the switch of a trigger. Early versions of slmsuite have none."""
    switch: Callable[[bool], Any] | None = getattr(slm, name, None)
    if switch is None:
        raise NotImplementedError(f"slm has no {name}")
    return switch


def _positive(value: Any, unit: str, what: str) -> float:
    number = _arguments.finite_quantity(value, unit, what)
    if number <= 0:
        raise _arguments.wrong(ValueError, what, f"is {number}: it must be above 0")
    return number


def _all(what: Any, loop: bool) -> Iterator[Hologram]:
    """Yields the holograms of content, once or again and again."""
    while True:
        before = 0
        for one in [what] if isinstance(what, Hologram) or _arguments.is_path(what) else _iterable(what):
            for hologram in _holograms(one):
                before += 1
                yield hologram
        if not loop or not before:
            return


def _iterable(what: Any) -> Iterable[Any]:
    if isinstance(what, Mapping) or not hasattr(what, "__iter__"):
        raise _arguments.wrong(TypeError, "what", f"is {what!r}: it must be an eyebox.Hologram, a path, or several of them")
    return what  # type: ignore[no-any-return]


def _holograms(one: Any) -> Iterator[Hologram]:
    if isinstance(one, Hologram):
        yield one
        return
    file = _arguments.path(one, "what")
    count = _eyebox.Hologram.count(file)
    for at in [None] if count is None else range(count):
        yield Hologram.load(file, at)


def _ahead(holograms: Iterator[Hologram], make: Callable[[Hologram], np.ndarray]) -> Any:
    """Yields the levels of each hologram, and computes the next ones on a thread meanwhile."""
    with ThreadPoolExecutor(1) as pool:
        # The levels of a hologram that repeats are computed once.
        kept: list[tuple[Hologram, np.ndarray]] = []

        def next_one() -> np.ndarray | None:
            hologram = next(holograms, None)
            if hologram is None:
                return None
            if not kept or kept[0][0] is not hologram:
                kept[:] = [(hologram, make(hologram))]
            return kept[0][1]

        coming = pool.submit(next_one)
        while (pattern := coming.result()) is not None:
            coming = pool.submit(next_one)
            yield pattern
