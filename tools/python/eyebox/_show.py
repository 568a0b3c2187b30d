"""Sessions, which show holograms on a display."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any, Callable, Iterator, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _arguments, _eyebox
from ._display import Display, display_of, engine_of
from ._hologram import Hologram

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._settings import RefineFields
    from ._types import Colors, DisplayLike, EngineLike, Path, Quantity, SceneLike, Whole


class Frame(NamedTuple):
    """A video frame as the display receives it.

    Attributes
    ----------
    pixels : numpy.ndarray
        (row, column, channel), uint8, with 1 channel (gray) or 3. You own the array. It is empty if the frame goes from
        a device directly to a window.
    number : int
        Number of the video frame on the display. Missed video frames count too.
    seconds : float
        Time at which the frame lights up, in seconds of the display's clock.
    hologram : int or None
        Number of the hologram in the content, or of the refined set. It is None for the idle picture.
    part : int
        Number of the video frame in its set.
    new : bool
        True if a set begins with the frame. ``hologram`` shows whether it is another set.
    late : str or None
        Cause if there is no newer frame although one was due.
    """

    pixels: NDArray[np.uint8]
    number: int
    seconds: float
    hologram: int | None
    part: int
    new: bool
    late: str | None


class Light(NamedTuple):
    """The light of a set, for ``on_light`` of :func:`eyebox.show`.

    Attributes
    ----------
    set : int
        Number of the set. Repeated sets count.
    hologram : int
        Number of the hologram in the content, or of the refined set.
    number : int
        Number of its first video frame on the display.
    new : bool
        True if the set shows new content.
    seconds : float
        Predicted time of its first light, in seconds of the display's clock.
    reported : float or None
        Time of its first light as the display reports it. It is None without a report.
    """

    set: int
    hologram: int
    number: int
    new: bool
    seconds: float
    reported: float | None


class Shows(NamedTuple):
    """The output of a session.

    Attributes
    ----------
    display : str
        Name of the output for people.
    rate : float
        Video frames per second.
    set_frames, sub_frames : int
        Video frames of a set (all sub-frames of all colors), and sub-frames of a set.
    rolls : bool
        True if any video frame may come from a newer set (rolling update).
    """

    display: str
    rate: float
    set_frames: int
    sub_frames: int
    rolls: bool


class Session:
    """Content on a display, from :func:`eyebox.show`. Threads of the session show it until the ``with`` block ends.

    An iteration gives each :class:`Frame` that was shown and kept, until the session ends.
    """

    __slots__ = ("_native", "_notes", "_statistics")
    _native: _eyebox.Session
    _notes: list[str]
    _statistics: dict[str, Any] | None

    def __init__(self) -> None:
        raise TypeError("sessions are made by eyebox.show")

    @classmethod
    def _of(cls, native: _eyebox.Session) -> Session:
        made = object.__new__(cls)
        made._native, made._notes, made._statistics = native, [], None
        return made

    def __enter__(self) -> Session:
        return self

    def __exit__(self, kind: Any, *_: Any) -> None:
        error = self._end()
        if error is not None and kind is None:
            raise error

    def __iter__(self) -> Iterator[Frame]:
        while (frame := self.frame()) is not None:
            yield frame

    def frame(self, timeout: Quantity | None = None) -> Frame | None:
        """Takes the oldest video frame that was not taken yet.

        Parameters
        ----------
        timeout : float, optional
            Seconds to wait for a frame. The default is to wait as long as the session shows content.

        Returns
        -------
        Frame or None
            None if no frame came in time, or if no more will come.
        """
        seconds = None if timeout is None else _arguments.quantity(timeout, "s", "timeout")
        given = self._native.frame(seconds)
        return None if given is None else Frame(*given)

    def look(
        self,
        x: Quantity,
        y: Quantity = 0.0,
        diameter: Quantity | None = None,
        *,
        velocity: tuple[float, float] | None = None,
        age: Quantity = 0.0,
    ) -> None:
        """Adds a sample of the pupil from your own tracker (``eye="own"``).

        Parameters
        ----------
        x, y : float
            Center of the pupil in meters, to the right and down. NaN is a closed eye.
        diameter : float, optional
            Diameter of the pupil in meters.
        velocity : (x, y), optional
            Velocity of the pupil in meters per second, to the right and down, if the tracker measures it.
        age : float
            Age of the sample in seconds.
        """
        wide = None if diameter is None else _arguments.quantity(diameter, "m", "diameter")
        moves = None
        if velocity is not None:
            along, down = _arguments.numbers(velocity, "velocity", "x, y")
            moves = along, down
        at = (_arguments.quantity(x, "m", "x"), _arguments.quantity(y, "m", "y"))
        self._native.look(*at, wide, moves, _arguments.quantity(age, "s", "age"))

    def steer(self, steered: bool = True) -> None:
        """Turns refinement for the tracked pupil on or off. Without it, the hologram for the whole eyebox is shown."""
        self._native.steer(bool(steered))

    def pause(self, paused: bool = True) -> None:
        """Pauses or resumes the content."""
        self._native.pause(bool(paused))

    def seek(self, holograms: Whole) -> None:
        """Moves the content by a number of holograms from the one that is shown. A negative number moves back."""
        most = 1 << 40
        self._native.seek(_arguments.count(holograms, "holograms", most, least=-most))

    @property
    def about(self) -> Shows:
        """Output of the session."""
        return Shows(*self._native.about)

    @property
    def running(self) -> bool:
        """True while the session shows content."""
        return self._native.is_running()

    @property
    def left_out(self) -> int:
        """Number of video frames that were shown but not kept, because you did not take earlier frames in time."""
        return self._native.left_out

    @property
    def notes(self) -> list[str]:
        """Messages for people about events, such as a hologram that was left out or a tracker that is gone."""
        self._notes += self._native.notes()
        return list(self._notes)

    @property
    def status(self) -> dict[str, Any]:
        """Shown frames and their delays until now, with the names of docs/playback.md and docs/live.md.

        The values of a refinement, such as ``steps``, are there after its first step. After the end of the session it is
        the statistics.
        """
        text = self._native.status()
        return json.loads(text) if text is not None else dict(self._statistics or {})

    @property
    def statistics(self) -> dict[str, Any] | None:
        """Statistics after the stop, as the command writes them with ``--stats``."""
        return self._statistics

    def stop(self) -> dict[str, Any]:
        """Stops the session, as the end of the ``with`` block does.

        Returns
        -------
        dict
            Statistics of the session.

        Raises
        ------
        SessionError
            If a failure ended the session, such as a display that is gone or a tracker that sent nothing.
        """
        error = self._end()
        if error is not None:
            raise error
        return dict(self._statistics or {})

    def _end(self) -> BaseException | None:
        self._notes += self._native.notes()
        ended = self._native.stop()
        if ended is None:
            return None
        self._statistics = json.loads(ended[0])
        return ended[1]

    def __repr__(self) -> str:
        about = self.about
        how = "shows" if self.running else "has ended"
        return f"<eyebox.Session {how}: {about.sub_frames} sub-frames a set on {about.display}>"


def show(
    what: Hologram | Path,
    display: DisplayLike | None = None,
    *,
    eye: Path | None = None,
    scene: SceneLike | None = None,
    output: Literal["offscreen", "window"] = "offscreen",
    monitor: str | int | None = None,
    rate: Quantity | None = None,
    seconds: Quantity | None = None,
    clock: Literal["real", "simulated"] = "real",
    step_time: Quantity | None = None,
    encode_time: Quantity = 1e-3,
    queue: Whole = 4,
    loop: bool = False,
    speed: float = 1.0,
    focus: Quantity = 0.0,
    latency: Quantity = 0.0,
    whole_sets: bool = False,
    moments: bool = True,
    restart: float = 0.5,
    color: Colors | None = None,
    frames: Whole = 8,
    ask: Literal["views", "depth", "layers"] = "views",
    views: Whole = 5,
    engine: EngineLike = "auto",
    other_scene: bool = False,
    on_light: Callable[[Light], Any] | None = None,
    **steering: Unpack[RefineFields],
) -> Session:
    """Shows a hologram, a sequence, or content of another process. The session is a context manager.

    Parameters
    ----------
    what : Hologram, path or "live:NAME"
        Hologram, file of a hologram or a sequence, or frames of an application (:mod:`eyebox.live`).
    display : Display, str or path, optional
        Display for which the content is encoded. The default of a hologram or a sequence is the display of its solve,
        cropped to its size. The default of an application is "paper".
    eye : str, optional
        Tracker of the pupil. "own" takes samples from :meth:`Session.look`, and "simulated" or "simulated:SEED"
        simulates an eye. "hid", "pupil://HOST", "udp://:PORT" and files are as in the command (docs/trackers.md). None
        shows holograms as they were solved, and refines content of an application for the whole eyebox.
    scene : Scene, str, path or array, optional
        Scene of a hologram that is refined. The default is the scene of the solve, read with the same options.
    output : {"offscreen", "window"}
        Memory, or a window that covers a monitor.
    monitor : str, optional
        Monitor of the window by its index, name or size as "ROWSxCOLUMNS".
    rate : float, optional
        Video frames per second. The default is the rate of the display, or 60.
    seconds : float, optional
        Duration of the content in seconds. The default is until the content or the ``with`` block ends.
    clock : {"real", "simulated"}
        Clock of offscreen output. "simulated" passes as fast as possible and waits until its video frames are taken. It
        shows the same frames each time.
    step_time, encode_time : float, optional
        Seconds for a step of one color and for encoding a set, in refinement on a simulated clock.
    queue : int
        Highest number of video frames that wait for :meth:`Session.frame`, or 0 for none. If there are more, the oldest
        are dropped, unless the clock is simulated.
    loop, speed
        Whether played content begins again at its end, and the factor of its speed.
    focus : float
        Depth at which the eye focuses in meters, if its tracker does not measure it.
    latency : float
        Seconds from the beginning of a video frame to its light.
    whole_sets : bool
        Show sets whole if a set takes several video frames. Otherwise each video frame is from the newest set.
    moments : bool
        Refine each sub-frame of moving content for its own time, and not all sub-frames for the time of the set.
    restart : float
        Jump of the pupil, in pupil diameters, that begins again with the hologram for the whole eyebox.
    color, frames, ask, views
        Colors, sub-frames, kind of frames ("views", "depth" or "layers") and highest number of views along an axis, for
        an application.
    engine : Engine or str
        Engine that computes the refinement.
    other_scene : bool
        Accept another scene than the scene of the solve.
    on_light : callable, optional
        Function that is called with the :class:`Light` of each set on a thread of the session, as soon as the display
        has reported it. An exception in it is printed, and the session continues.
    **steering
        Arguments of :class:`eyebox.Refiner`.

    Returns
    -------
    Session
        Session that shows the content at once, and stops at the end of the ``with`` block.

    Raises
    ------
    SessionError, EncodeError, HologramError
        If the content cannot be shown there. The message comes from the library.

    Examples
    --------
    >>> import eyebox
    >>> small = eyebox.Display("planes8", size=(32, 32))
    >>> hologram = eyebox.solve("builtin:plane", small, color="green", frames=8, steps=2)
    >>> with eyebox.show(hologram, small, clock="simulated") as session:
    ...     first = session.frame()
    >>> first.pixels.shape
    (32, 32, 1)
    """
    named = what[5:] if isinstance(what, str) and what.startswith("live:") else None
    application = named is not None
    display = _display_of(what, display, application)
    for name, value, known in (("output", output, ("offscreen", "window")), ("clock", clock, ("real", "simulated"))):
        if value not in known:
            raise _arguments.wrong(ValueError, name, f"is {value!r}: it must be {' or '.join(known)}")
    if output == "window" and clock == "simulated":
        raise _arguments.wrong(ValueError, "clock", 'is "simulated": a window has the clock of the system')
    if on_light is not None and not callable(on_light):
        raise _arguments.wrong(TypeError, "on_light", f"is {on_light!r}: it must be a function of one argument")
    if eye is not None and not _arguments.is_path(eye):
        raise _arguments.wrong(TypeError, "eye", f"is {eye!r}: it must be own, simulated or another tracker's name")
    eye = None if eye is None else _arguments.path(eye, "eye")
    where = {
        "rate": None if rate is None else _arguments.finite_quantity(rate, "Hz", "rate"),
        "seconds": None if seconds is None else _arguments.finite_quantity(seconds, "s", "seconds"),
        "window": output == "window",
        "monitor": None if monitor is None else str(monitor),
        "simulated": clock == "simulated",
        "queue": _arguments.count(queue, "queue", 1024, least=0),
        "on_light": None if on_light is None else (lambda *fields: on_light(Light(*fields))),
    }
    following = {
        "eye": eye,
        "focus": _arguments.finite(_arguments.depth(focus, lambda: display.focal_length, "focus"), "focus"),
        "step_time": None if step_time is None else _arguments.finite_quantity(step_time, "s", "step_time"),
        "encode_time": _arguments.finite_quantity(encode_time, "s", "encode_time"),
        "display_latency": _arguments.finite_quantity(latency, "s", "latency"),
        "whole_sets": bool(whole_sets),
        "moments": bool(moments),
        "restart": _arguments.number(restart, "restart"),
        "steering": _arguments.toml(dict(steering)),
    }
    if eye is None and not application and (steering or scene is not None or step_time is not None):
        raise _arguments.wrong(TypeError, "eye", "is None: a scene, step_time and a refinement need a tracker")
    if named is not None:
        if not hasattr(_eyebox.Session, "live"):
            raise NotImplementedError("live content exists on Linux alone")
        names = _arguments.colors(color, list(display.wavelengths))
        content = (names, _arguments.count(frames, "frames", 64), str(ask), _arguments.count(views, "views", 64))
        native = _eyebox.Session.live(named, display._native, content, engine_of(engine), following, where)
    elif eye is not None:
        hologram = what if isinstance(what, Hologram) else Hologram.load(what)
        scene = hologram._scene_of(scene, other_scene)
        native = _eyebox.Session.follow(
            hologram._native, scene._native, display._native, engine_of(engine), following, where, bool(other_scene)
        )
    elif isinstance(what, Hologram):
        native = _eyebox.Session.play(what._native, display._native, where)
    else:
        file = os.path.abspath(_arguments.path(what, "what"))
        native = _eyebox.Session.play_file(
            file, display._native, _arguments.number(speed, "speed"), bool(loop), where
        )
    return Session._of(native)


def _display_of(what: Any, display: Any, application: bool) -> Display:
    """Returns the given display, or the display of the solve of the content."""
    if isinstance(what, Hologram):
        return what._shown_on(display)
    if application or not (display is None or _arguments.is_path(display)):
        return display_of("paper" if display is None else display)
    named = None if display is None else _arguments.path(display, "display")
    return Display._of(_eyebox.Hologram.file_shown_on(os.path.abspath(_arguments.path(what, "what")), named))
