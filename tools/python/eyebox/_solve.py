"""From scenes to holograms."""

from __future__ import annotations

from typing import Any, Callable, NamedTuple

from . import _arguments, _eyebox
from ._display import display_of, engine_of
from ._hologram import Hologram
from ._interrupted import interrupted
from ._scene import Scene, scene_of


class Step(NamedTuple):
    """How far a solve is. Colours are solved one after the other.

    Attributes
    ----------
    color : str
        The colour.
    step, steps : int
        Steps taken of this colour, and asked for.
    pilot : (int, int) or None
        Steps of the short solves that choose the exposure, taken and in all, while they run before the first step.
    seconds : float
        Since this colour began.
    loss : float
        Mean squared difference from the photographs over this step's pupils, in linear light.
    psnr : float or None
        Mean PSNR of the best state so far over validation pupils, dB; None before there is one.
    """

    color: str
    step: int
    steps: int
    pilot: tuple[int, int] | None
    seconds: float
    loss: float
    psnr: float | None


def solve(
    scene: Any,
    display: Any = None,
    color: Any = None,
    *,
    frames: int | None = None,
    steps: int | None = None,
    pupils: int | None = None,
    seed: int | None = None,
    engine: Any = "auto",
    callback: Callable[[Step], Any] | None = None,
    progress: Any = None,
    views: int | None = None,
    view_pitch: float | None = None,
    **settings: Any,
) -> Hologram:
    """Solves a scene for a display.

    Parameters
    ----------
    scene : Scene, str, path or array
        The scene: all but a :class:`Scene` is made one, by ``display``, ``color``, ``views`` and ``view_pitch``.
    display : Display, str or path, optional
        Where none is given, the scene's, or "paper".
    color : str or sequence of str, optional
        "red", "green", "blue"; all that there are where none is given.
    frames : int, optional
        Sub-frames that are shown one after the other, optimised jointly (8).
    steps : int, optional
        Steps, at most (60).
    pupils : int, optional
        Pupils drawn per step (16).
    seed : int, optional
        Decides the first phases and the pupils (0). The same seed gives the same phases, those of the command, bit for bit on
        the CPU.
    engine : Engine or str
        Where it is computed.
    callback : callable, optional
        Called with a :class:`Step` after each step, on the thread that called. An answer that is false ends the solve with the best
        so far; None does not. What it raises, ``solve`` raises.
    progress : optional
        ``True`` for a bar of tqdm, or whatever makes bars as tqdm does.
    views, view_pitch
        As of :class:`Scene`.
    **settings
        The other fields of the library's ``solve::Settings``, lengths in metres: ``seconds``, ``psnr`` (dB), ``efficiency``,
        ``depth`` and ``diameter`` (pairs), ``method``, ``optimizer``, ``storage``, ``padding``, ``first_phases`` ("table" or
        "random"), ...; and ``quality`` ("fast", "balanced", "accurate"), ``contrast`` and ``force`` as in the command.

    Returns
    -------
    Hologram
        Its ``stopped`` says why the solve ended.

    Raises
    ------
    Interrupted
        Ctrl-C: a KeyboardInterrupt whose ``hologram`` is the best so far.
    SolveError, SceneError, DisplayError
        What cannot be, in the library's words.

    Examples
    --------
    >>> import eyebox
    >>> small = eyebox.Display("small", size=(32, 32))
    >>> eyebox.solve("builtin:plane", small, color="green", frames=1, steps=2, seed=7).stopped
    'steps'
    """
    if display is None:
        display = scene.display if isinstance(scene, Scene) else "paper"
    display = display_of(display)
    scene = scene_of(scene, display, color, views=views, view_pitch=view_pitch)
    named = {"frames": frames, "steps": steps, "pupils": pupils, "seed": seed}
    text = _arguments.toml({**named, **settings})
    if callback is not None and not callable(callback):
        raise TypeError(f"callback is {callback!r}: it must be callable with a Step")
    bars = _Bars.of(progress)
    told = None
    if callback is not None or bars is not None:

        def told(*numbers: Any) -> Any:
            step = Step(*numbers)
            if bars is not None:
                bars.step(step)
            return callback(step) if callback is not None else None

    try:
        solved, unfinished = _eyebox.solve(scene._native, display._native, text, engine_of(engine), told)
    finally:
        if bars is not None:
            bars.close()
    if unfinished is None:
        native, stopped = solved
        return Hologram._of(native, scene, stopped)

    def best() -> Hologram | None:
        try:
            found = unfinished.finish()
        except _eyebox.EyeboxError:
            return None
        return None if found is None else Hologram._of(found[0], scene, found[1])

    error = unfinished.error
    raise interrupted(error, best) if isinstance(error, KeyboardInterrupt) else error


class _Bars:
    """One bar of tqdm's protocol for each colour."""

    def __init__(self, make: Callable[..., Any]) -> None:
        self.make = make
        self.bar: Any = None
        self.color: str | None = None
        self.at = 0

    @classmethod
    def of(cls, progress: Any) -> _Bars | None:
        if progress is None or progress is False:
            return None
        if progress is True:
            try:
                from tqdm.auto import tqdm as progress
            except ImportError:
                raise ImportError("progress=True needs tqdm: pip install tqdm, or give what makes bars as tqdm does") from None
        if not callable(progress):
            raise TypeError(f"progress is {progress!r}: it must be True, or callable as tqdm is")
        return cls(progress)

    def step(self, step: Step) -> None:
        if step.color != self.color:
            self.close()
            self.bar = self.make(total=step.steps, desc=step.color, unit="step")
            self.color, self.at = step.color, 0
        if step.pilot is not None:
            self.bar.set_postfix(exposure=f"{step.pilot[0]}/{step.pilot[1]}")
            return
        psnr = {} if step.psnr is None else {"PSNR": f"{step.psnr:.2f} dB"}
        self.bar.set_postfix(loss=f"{step.loss:.3g}", **psnr)
        self.bar.update(step.step - self.at)
        self.at = step.step

    def close(self) -> None:
        if self.bar is not None:
            self.bar.close()
            self.bar = None
