"""Solves scenes for displays."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Callable, NamedTuple

import numpy as np

from . import _arguments, _eyebox
from ._calibrate import CameraSteps, Shot
from ._display import display_of, engine_of
from ._hologram import Hologram
from ._interrupted import interrupted
from ._scene import Scene, scene_of
from ._settings import SolveSettings

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._settings import JobFields, SolveFields
    from ._types import Colors, DisplayLike, EngineLike, Path, Quantity, SceneLike, Whole


class Step(NamedTuple):
    """The progress of a solve. Colors are solved one after the other.

    Attributes
    ----------
    color : str
        Color that is solved.
    step, steps : int
        Steps taken of this color, and the requested number.
    pilot : (int, int) or None
        Steps of the short solves that choose the exposure, taken and in all. They run before the first step, and the
        value is None afterwards.
    seconds : float
        Seconds since the start of this color.
    loss : float
        Mean squared difference from the target images over the pupils of this step, in linear light.
    psnr : float or None
        Mean PSNR of the best state over validation pupils in dB, or None before there is one.
    """

    color: str
    step: int
    steps: int
    pilot: tuple[int, int] | None
    seconds: float
    loss: float
    psnr: float | None


def solve(
    scene: SceneLike,
    display: DisplayLike | None = None,
    color: Colors | None = None,
    *,
    frames: Whole | None = None,
    steps: Whole | None = None,
    pupils: Whole | None = None,
    seed: Whole | None = None,
    rng: np.random.Generator | Whole | None = None,
    engine: EngineLike = "auto",
    callback: Callable[[Step], Any] | None = None,
    progress: bool | Callable[..., Any] | None = None,
    views: Whole | None = None,
    view_pitch: Quantity | None = None,
    camera: Callable[[Shot], Any] | None = None,
    camera_steps: Whole = 20,
    hello: dict[str, Any] | None = None,
    captures: Path | None = None,
    settings: SolveSettings | None = None,
    **fields: Unpack[SolveFields],
) -> Hologram:
    """Solves a scene for a display.

    Parameters
    ----------
    scene : Scene, str, path or array
        Scene, or the source of a :class:`Scene` with ``display``, ``color``, ``views`` and ``view_pitch``.
    display : Display, str or path, optional
        Display to solve for. The default is the display of the scene, or "paper".
    color : str or sequence of str, optional
        "red", "green" or "blue", or several of them. The default is all available colors.
    frames : int, optional
        Sub-frames, which are shown one after the other and optimized jointly. The default is 8.
    steps : int, optional
        Highest number of steps. The default is 60.
    pupils : int, optional
        Pupils drawn per step. The default is 16.
    seed : int, optional
        Seed of the first phases and the pupils. The default is 0. The same seed gives the phases of the command, bit
        for bit on the CPU.
    rng : numpy.random.Generator or int, optional
        Generator that draws the seed, or the seed itself.
    engine : Engine or str
        Engine that computes the solve.
    callback : callable, optional
        Function that gets a :class:`Step` after each step, on the thread that called. A false answer other than None
        ends the solve with the best result. An exception of the callback leaves ``solve``.
    progress : optional
        ``True`` for a bar of tqdm, or a callable that makes bars as tqdm does.
    views, view_pitch
        Arguments of :class:`Scene`.
    camera : callable, optional
        Function that shows patterns and takes pictures, as in :func:`eyebox.calibrate`. It takes part in steps after
        the solve, which correct faults that no model describes (docs/calibrate.md).
    camera_steps : int
        Number of steps of each color with the camera.
    hello, captures
        Arguments of :func:`eyebox.calibrate` for the camera.
    settings : SolveSettings, optional
        Settings as one object. Arguments replace its values.
    **fields
        Other fields of the library's ``solve::Settings``, with lengths in meters. They include ``seconds``, ``psnr``
        (dB), ``efficiency``, ``depth`` and ``diameter`` (pairs), ``method``, ``optimizer``, ``storage``, ``padding``
        and ``first_phases`` ("table" or "random"). The settings ``quality`` ("fast", "balanced", "accurate"),
        ``contrast`` and ``force`` are as in the command.

    Returns
    -------
    Hologram
        Solved hologram, whose ``stopped`` is the cause that ended the solve.

    Raises
    ------
    Interrupted
        After ctrl-C. It is a KeyboardInterrupt whose ``hologram`` is the best result.
    SolveError, SceneError, DisplayError
        If the arguments are not possible. The message comes from the library.
    CalibrateError
        If the camera or its pictures fail. If the solve is finished, the error has the best result as ``hologram``.

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
    base = _base(settings)
    named = {"frames": frames, "steps": steps, "pupils": pupils, "seed": _arguments.seed(seed, rng), **fields}
    text = _arguments.toml({**base, **{name: value for name, value in named.items() if value is not None}})
    after = None if camera is None else CameraSteps(display, camera, camera_steps, hello, captures)
    if callback is not None and not callable(callback):
        raise _arguments.wrong(TypeError, "callback", f"is {callback!r}: it must be callable with a Step")
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
        made = Hologram._of(native, scene, stopped)
        return made if after is None or stopped == "callback" else after.take(made, scene, engine)

    def best() -> Hologram | None:
        try:
            found = unfinished.finish()
        except _eyebox.EyeboxError:
            return None
        return None if found is None else Hologram._of(found[0], scene, found[1])

    error = unfinished.error
    raise interrupted(error, best) if isinstance(error, KeyboardInterrupt) else error


def plan(
    scene: SceneLike,
    display: DisplayLike | None = None,
    color: Colors | None = None,
    *,
    forecast: bool = False,
    engine: EngineLike = "auto",
    views: Whole | None = None,
    view_pitch: Quantity | None = None,
    settings: SolveSettings | None = None,
    **fields: Unpack[JobFields],
) -> dict[str, Any]:
    """Plans a solve without solving anything (``eyebox solve --dry-run``).

    Parameters
    ----------
    scene, display, color, engine, views, view_pitch, settings, **fields
        Arguments of :func:`solve`.
    forecast : bool
        Predict the time and the memory too. The engine is measured once per machine, which takes seconds.

    Returns
    -------
    dict
        ``choices`` has the decisions with their reasons, ``settings`` the settings with the decisions applied (meters),
        ``colors`` and ``dark`` the colors that are solved and those without light. ``forecast`` has ``step_seconds``
        and ``peak_bytes`` of each color, or is None.

    Examples
    --------
    >>> import eyebox
    >>> eyebox.plan("builtin:plane", eyebox.Display("small", size=(32, 32)), "green", steps=3)["settings"]["steps"]
    3
    """
    if display is None:
        display = scene.display if isinstance(scene, Scene) else "paper"
    display = display_of(display)
    scene = scene_of(scene, display, color, views=views, view_pitch=view_pitch)
    text = _arguments.toml({**_base(settings), **{name: value for name, value in fields.items() if value is not None}})
    planned = _eyebox.plan(scene._native, display._native, text, engine_of(engine), bool(forecast))
    made: dict[str, Any] = json.loads(planned)
    return made


def _base(settings: SolveSettings | None) -> dict[str, Any]:
    """Returns the given settings of an object, or none without it."""
    if settings is not None and not isinstance(settings, SolveSettings):
        raise _arguments.wrong(TypeError, "settings", f"is {settings!r}: it must be an eyebox.SolveSettings")
    return {} if settings is None else settings.given()


class _Bars:
    """Shows one bar per color by the protocol of tqdm."""

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
            raise _arguments.wrong(TypeError, "progress", f"is {progress!r}: it must be True, or callable as tqdm is")
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
