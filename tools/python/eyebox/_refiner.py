"""Holograms that are refined for where the eye is."""

from __future__ import annotations

from typing import Any, Callable

from . import _arguments, _eyebox
from ._display import engine_of
from ._hologram import Hologram
from ._interrupted import interrupted


class Refiner:
    """A hologram under refinement, step by step, for loops of one's own. The hologram that it begins with stays as it is.

    Parameters
    ----------
    hologram : Hologram
        What is refined.
    scene : Scene, str, path or array, optional
        Its scene; the one that it was solved from where none is given, read as it was then.
    engine : Engine or str
        Where is computed, on engines of the refiner's own.
    other_scene : bool
        Take a scene that is not the one that the hologram was solved from.
    **steering
        Fields of the library's ``solve::RefineSettings``: ``pupils``, ``elsewhere``, ``strategy`` (a dict), ``seed``, ...

    Examples
    --------
    >>> import eyebox
    >>> small = eyebox.Display("small", size=(32, 32))
    >>> hologram = eyebox.solve("builtin:plane", small, color="green", frames=1, steps=2)
    >>> refiner = eyebox.Refiner(hologram)
    >>> refiner.aim(x=2e-3, diameter=4e-3, depth=1e-3)
    >>> refiner.step() < 1
    True
    >>> steered = refiner.hologram
    """

    __slots__ = ("_kept_scene", "_native", "_scene")

    def __init__(
        self,
        hologram: Hologram,
        scene: Any = None,
        *,
        engine: Any = "auto",
        other_scene: bool = False,
        **steering: Any,
    ) -> None:
        if not isinstance(hologram, Hologram):
            raise TypeError(f"hologram is {hologram!r}: it must be an eyebox.Hologram")
        self._scene = hologram._scene_of(scene, other_scene)
        # What comes of it still names the scene that it was solved from.
        self._kept_scene = None if other_scene else self._scene
        text = _arguments.toml(steering)
        native, engine = self._scene._native, engine_of(engine)
        self._native = _eyebox.Refiner(hologram._native, native, text, engine, bool(other_scene))

    def aim(
        self, x: float = 0.0, y: float = 0.0, diameter: float = 4e-3, depth: float = 0.0, *, spread: float = 0.0
    ) -> None:
        """The pupil is there from now on.

        Parameters
        ----------
        x, y : float
            Its centre, metres: to the right, and down.
        diameter : float
            Its diameter, metres.
        depth : float
            Where it focuses, metres from the SLM's image; positive is nearer.
        spread : float
            To within what its centre is known: a standard deviation along each axis, metres.
        """
        pupil = _arguments.pupil(x, y, diameter, depth, lambda: self._scene.display.focal_length)
        self._native.aim(pupil, _arguments.quantity(spread, "m", "spread"))

    def step(self, steps: int = 1, callback: Callable[[int, float], Any] | None = None) -> float:
        """Takes steps of every colour. A callback (steps taken, loss) ends it early by an answer that is false; None does not. Ctrl-C
        raises :class:`Interrupted`, whose ``hologram`` is that of the steps taken.

        Returns
        -------
        float
            The loss of the last: mean squared difference over its pupils, in linear light.
        """
        count = _arguments.count(steps, "steps")
        if callback is not None and not callable(callback):
            raise TypeError(f"callback is {callback!r}: it must be callable with the steps taken and the loss")
        try:
            return self._native.step(count, callback)[0]
        except KeyboardInterrupt as error:
            raise interrupted(error, lambda: self.hologram) from None

    @property
    def hologram(self) -> Hologram:
        """The hologram as it is now, a copy: the refiner goes on."""
        return Hologram._of(self._native.hologram(), self._kept_scene, None)
