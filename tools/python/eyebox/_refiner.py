"""Holograms that are refined for the tracked pupil."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable

import numpy as np

from . import _arguments, _eyebox
from ._display import engine_of
from ._hologram import Hologram
from ._interrupted import interrupted

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._settings import RefineFields
    from ._types import EngineLike, Quantity, SceneLike, Whole


class Refiner:
    """A hologram under refinement, step by step, for your own loops. The initial hologram does not change.

    Parameters
    ----------
    hologram : Hologram
        Hologram to refine.
    scene : Scene, str, path or array, optional
        Scene of the hologram. The default is the scene of the solve, read with the same options.
    engine : Engine or str
        Engine that computes. The refiner makes its own instances of it.
    other_scene : bool
        Accept another scene than the scene of the solve.
    rng : numpy.random.Generator or int, optional
        Generator that draws the ``seed``, or the seed itself.
    **steering
        Fields of the library's ``solve::RefineSettings``, such as ``pupils``, ``elsewhere``, ``strategy`` (a dict) and
        ``seed``.

    Examples
    --------
    >>> import eyebox
    >>> small = eyebox.Display("small", size=(32, 32))
    >>> hologram = eyebox.solve("builtin:plane", small, color="green", frames=1, steps=2)
    >>> refiner = eyebox.Refiner(hologram)
    >>> refiner.aim(x=2e-3, diameter=4e-3, depth=1e-3)
    >>> refiner.step() < 1
    True
    >>> refined = refiner.hologram
    """

    __slots__ = ("_aimed", "_kept_scene", "_native", "_scene", "_steps")

    def __init__(
        self,
        hologram: Hologram,
        scene: SceneLike | None = None,
        *,
        engine: EngineLike = "auto",
        other_scene: bool = False,
        rng: np.random.Generator | Whole | None = None,
        **steering: Unpack[RefineFields],
    ) -> None:
        if not isinstance(hologram, Hologram):
            raise _arguments.wrong(TypeError, "hologram", f"is {hologram!r}: it must be an eyebox.Hologram")
        self._aimed: _arguments.Pupil | None = None
        self._steps = 0
        self._scene = hologram._scene_of(scene, other_scene)
        # A result with another scene still names the scene of the solve.
        self._kept_scene = None if other_scene else self._scene
        text = _arguments.toml({**steering, "seed": _arguments.seed(steering.get("seed"), rng)})
        native, own = self._scene._native, engine_of(engine)
        self._native = _eyebox.Refiner(hologram._native, native, text, own, bool(other_scene))

    def aim(
        self,
        x: Quantity = 0.0,
        y: Quantity = 0.0,
        diameter: Quantity = 4e-3,
        depth: Quantity = 0.0,
        *,
        spread: Quantity = 0.0,
    ) -> None:
        """Sets the pupil of the next steps.

        Parameters
        ----------
        x, y : float
            Center of the pupil in meters, to the right and down.
        diameter : float
            Diameter of the pupil in meters.
        depth : float
            Depth at which the eye focuses, in meters from the image of the SLM. Positive is nearer.
        spread : float
            Standard deviation of the center along each axis, in meters.
        """
        pupil = _arguments.pupil(x, y, diameter, depth, lambda: self._scene.display.focal_length)
        self._native.aim(pupil, _arguments.quantity(spread, "m", "spread"))
        self._aimed = _arguments.Pupil(*pupil)

    def step(self, steps: Whole = 1, callback: Callable[[int, float], Any] | None = None) -> float:
        """Takes steps of every color.

        A callback (steps taken, loss) ends the steps early by a false answer other than None. Ctrl-C raises
        :class:`Interrupted`, whose ``hologram`` is the result of the steps taken.

        Returns
        -------
        float
            Loss of the last step, which is the mean squared difference over its pupils in linear light.
        """
        count = _arguments.count(steps, "steps")
        if callback is not None and not callable(callback):
            right = "callable with the steps taken and the loss"
            raise _arguments.wrong(TypeError, "callback", f"is {callback!r}: it must be {right}")
        try:
            loss, taken = self._native.step(count, callback)
            self._steps += taken
            return loss
        except KeyboardInterrupt as error:
            raise interrupted(error, lambda: self.hologram) from None

    @property
    def hologram(self) -> Hologram:
        """Hologram in the current state. It is a copy, so the refiner can continue."""
        return Hologram._of(self._native.hologram(), self._kept_scene, None)

    @property
    def pupil(self) -> _arguments.Pupil | None:
        """Pupil of the next steps in meters, or None for the whole eyebox."""
        return self._aimed

    def _repr_png_(self) -> bytes | None:
        """A notebook displays the current state as the eye sees it for which the refiner works."""
        shown, pupil = self.hologram, self._aimed
        if pupil is None or shown.exposures is None:
            return shown._repr_png_()
        return shown._native.picture((pupil.x, pupil.y, pupil.diameter, pupil.depth), engine_of("auto"))

    def __repr__(self) -> str:
        if self._aimed is None:
            where = "the whole eyebox"
        else:
            x, y, diameter, depth = (f"{1e3 * one:.4g}" for one in self._aimed)
            where = f"a pupil of {diameter} mm at ({x}, {y}) mm, focused at {depth} mm"
        return f"<eyebox.Refiner of {self._scene.source or 'an array'} for {where}: {self._steps} steps>"
