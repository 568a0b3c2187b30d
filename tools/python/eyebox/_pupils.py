"""Pupils for scores, which are random or the groups of the paper."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from . import _arguments, _eyebox
from ._arguments import Pupil
from ._display import Display, display_of

if TYPE_CHECKING:
    import numpy as np

    from ._types import Colors, DisplayLike, Range, Whole

#: Random pupils of the last group of the paper.
RANDOM = 24


def random_pupils(
    display: DisplayLike,
    count: Whole,
    seed: Whole | None = None,
    *,
    rng: np.random.Generator | Whole | None = None,
    color: Colors | None = None,
    diameter: Range | None = None,
    depth: Range = (0.0, 0.0),
) -> list[Pupil]:
    """Draws pupils in the eyebox of a display, the same as ``eyebox eval score --test-pupils random:N --seed S``.

    Parameters
    ----------
    display : Display, str or path
        Display with the eyebox.
    count : int
        Number of pupils.
    seed : int, optional
        Seed of the pupils. The default is 0.
    rng : numpy.random.Generator or int, optional
        Generator that draws the seed, or the seed itself.
    color : str or sequence of str, optional
        Colors, the first of which determines the lit sources of a display with switchable sources.
    diameter : (float, float), optional
        Smallest and largest diameter in meters. The default is 2 mm to most of the eyebox, and 20 mm at most.
    depth : (float, float)
        Farthest and nearest focus in meters.

    Returns
    -------
    list of Pupil
        Pupils in meters.

    Examples
    --------
    >>> import eyebox
    >>> len(eyebox.random_pupils("paper", 24, seed=3, depth=("-2mm", "3mm")))
    24
    """
    shown = display_of(display)
    drawn = _arguments.seed(seed, rng)
    number = 0 if drawn is None else _arguments.count(drawn, "seed", (1 << 64) - 1, least=0)
    wide = None
    if diameter is not None:
        wide = [_arguments.finite_quantity(end, "m", "diameter") for end in _arguments.ends(diameter, "diameter")]
    focus = lambda: shown.focal_length  # noqa: E731
    ends = [_arguments.finite(_arguments.depth(end, focus), "depth") for end in _arguments.ends(depth, "depth")]
    names = _arguments.colors(color, list(shown.wavelengths))
    most = _arguments.count(count, "count", 100_000)
    return [Pupil(*one) for one in _eyebox.random_pupils(shown._native, names, most, number, wide, sorted(ends))]


def paper_pupils(
    display: DisplayLike, depth: Range, *, count: Whole = RANDOM, seed: Whole | None = None, color: Colors | None = None
) -> dict[str, list[Pupil]]:
    """Returns the five groups of pupils with which the paper compares methods (its figure 12).

    Parameters
    ----------
    display : Display, str or path
        Display with the eyebox.
    depth : (float, float)
        Farthest and nearest depth of the scene in meters.
    count, seed, color
        Number of pupils of the random group, and arguments of :func:`random_pupils`.

    Returns
    -------
    dict of list of Pupil
        Pupils of each group by its name.
    """
    shown = display_of(display)
    focus = lambda: shown.focal_length  # noqa: E731
    far, near = sorted(_arguments.finite(_arguments.depth(end, focus), "depth") for end in _arguments.ends(depth, "depth"))
    drawn = random_pupils(shown, count, seed, color=color, depth=(far, near))
    groups: dict[str, list[Pupil]] = {}
    for name, pupil in _eyebox.paper_pupils(shown._native, [far, near], [tuple(one) for one in drawn]):
        groups.setdefault(name, []).append(Pupil(*pupil))
    return groups


def named(text: str, display: Display, colors: list[str], depth: Any, seed: Any) -> tuple[list[Pupil], list[str] | None]:
    """Returns the pupils of "random:N" or "paper", and the group of each pupil of the paper."""
    if text == "paper":
        groups = paper_pupils(display, depth, seed=seed, color=colors)
        return [one for each in groups.values() for one in each], [name for name, each in groups.items() for _ in each]
    kind, _, count = text.partition(":")
    if kind != "random" or not (count.isascii() and count.isdecimal()):
        raise _arguments.wrong(ValueError, "pupils", f'is {text!r}: it must be "random:N", "paper" or a sequence of pupils')
    return random_pupils(display, int(count), seed, color=colors, depth=depth), None
