"""Holograms on a display."""

from __future__ import annotations

import json
import os
from typing import Any, Iterator, NamedTuple

import numpy as np

from . import _arguments, _eyebox
from ._display import Display, display_of, engine_of
from ._hologram import Hologram


class Frame(NamedTuple):
    """A video frame as the display is given it.

    Attributes
    ----------
    pixels : numpy.ndarray
        (row, column, channel), uint8, yours to keep; 1 channel (grey) or 3. Empty where it goes from a device straight to a window.
    number : int
        Which video frame of the display; those that it missed are counted.
    seconds : float
        When it lights up, on the display's clock.
    hologram : int or None
        Which hologram of what is played, or which refined set; None for the idle picture.
    part : int
        Which video frame of its set.
    new : bool
        Whether a set begins with it; ``hologram`` says whether it is another one.
    late : str or None
        Why there is no newer one, where one was due.
    """

    pixels: np.ndarray
    number: int
    seconds: float
    hologram: int | None
    part: int
    new: bool
    late: str | None


class Shows(NamedTuple):
    """What a session shows on.

    Attributes
    ----------
    display : str
        For people.
    rate : float
        Video frames a second.
    set_frames, sub_frames : int
        Video frames of a set (all sub-frames of all colours), and its sub-frames.
    rolls : bool
        Whether any video frame may be of a newer set.
    """

    display: str
    rate: float
    set_frames: int
    sub_frames: int
    rolls: bool


class Session:
    """What :func:`eyebox.show` gives: something on a display, shown by threads of its own until the ``with`` block ends.

    Iterating gives each :class:`Frame` that is shown and kept, until something ends it.
    """

    __slots__ = ("_native", "_notes", "_statistics")

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

    def frame(self, timeout: float | None = None) -> Frame | None:
        """The oldest video frame that was not taken yet.

        Parameters
        ----------
        timeout : float, optional
            Seconds that it waits for one; where none are given, as long as something is shown.

        Returns
        -------
        Frame or None
            None where none came in time, or none will come any more.
        """
        seconds = None if timeout is None else _arguments.quantity(timeout, "s", "timeout")
        given = self._native.frame(seconds)
        return None if given is None else Frame(*given)

    def look(
        self,
        x: float,
        y: float = 0.0,
        diameter: float | None = None,
        *,
        velocity: tuple[float, float] | None = None,
        age: float = 0.0,
    ) -> None:
        """The pupil is there: a sample of a tracker of your own (``eye="own"``).

        Parameters
        ----------
        x, y : float
            Its centre, metres: to the right, and down; NaN where the eye is closed.
        diameter : float, optional
            Its diameter, metres.
        velocity : (x, y), optional
            How fast it moves, metres a second: to the right, and down; of trackers that tell.
        age : float
            Seconds since it was there.
        """
        wide = None if diameter is None else _arguments.quantity(diameter, "m", "diameter")
        moves = None if velocity is None else tuple(_arguments.numbers(velocity, "velocity", "x, y"))
        at = (_arguments.quantity(x, "m", "x"), _arguments.quantity(y, "m", "y"))
        self._native.look(*at, wide, moves, _arguments.quantity(age, "s", "age"))

    def steer(self, steered: bool = True) -> None:
        """Whether it follows the eye; if not, the hologram for the whole eyebox is shown."""
        self._native.steer(bool(steered))

    def pause(self, paused: bool = True) -> None:
        """Has what is played stand still, or go on."""
        self._native.pause(bool(paused))

    def seek(self, holograms: int) -> None:
        """Goes so many holograms of what is played further than the one that is shown; back, where it is negative."""
        most = 1 << 40
        self._native.seek(_arguments.count(holograms, "holograms", most, least=-most))

    @property
    def about(self) -> Shows:
        """What it shows on."""
        return Shows(*self._native.about)

    @property
    def running(self) -> bool:
        """Whether something is still shown."""
        return self._native.is_running()

    @property
    def left_out(self) -> int:
        """Video frames that were shown and not kept, for nobody took the ones before in time."""
        return self._native.left_out

    @property
    def notes(self) -> list[str]:
        """What happened so far that people want to read: a hologram left out, a tracker gone."""
        self._notes += self._native.notes()
        return list(self._notes)

    @property
    def status(self) -> dict[str, Any]:
        """What was shown so far, and how late, by the names of docs/playback.md and docs/live.md; of what ended, the statistics."""
        text = self._native.status()
        return json.loads(text) if text is not None else dict(self._statistics or {})

    @property
    def statistics(self) -> dict[str, Any] | None:
        """What came of it, once it was stopped: what the command writes with ``--stats``."""
        return self._statistics

    def stop(self) -> dict[str, Any]:
        """Stops it, as the end of the ``with`` block does.

        Returns
        -------
        dict
            Its statistics.

        Raises
        ------
        SessionError
            What ended it, if that was a failure: a display that is gone, a tracker that said nothing.
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
    what: Any,
    display: Any = None,
    *,
    eye: str | None = None,
    scene: Any = None,
    output: str = "offscreen",
    monitor: str | None = None,
    rate: float | None = None,
    seconds: float | None = None,
    clock: str = "real",
    step_time: float | None = None,
    encode_time: float = 1e-3,
    queue: int = 4,
    loop: bool = False,
    speed: float = 1.0,
    focus: float = 0.0,
    latency: float = 0.0,
    whole_sets: bool = False,
    moments: bool = True,
    restart: float = 0.5,
    color: Any = None,
    frames: int = 8,
    ask: str = "views",
    views: int = 5,
    engine: Any = "auto",
    other_scene: bool = False,
    **steering: Any,
) -> Session:
    """Shows a hologram, a sequence, or what another process gives; a context manager.

    Parameters
    ----------
    what : Hologram, path or "live:NAME"
        A hologram; a file of one, or of a sequence; or the frames of an application (:mod:`eyebox.live`).
    display : Display, str or path, optional
        The display that it is encoded for; of a hologram or a sequence the one that it was solved for where none is given,
        cut to its size, and of an application "paper".
    eye : str, optional
        Who is followed: "own", whose samples come by :meth:`Session.look`; "simulated" or "simulated:SEED"; "hid",
        "pupil://HOST", "udp://:PORT" and files as of the command (docs/trackers.md). None shows what was solved; what an
        application gives is then refined for the whole eyebox.
    scene : Scene, str, path or array, optional
        What a hologram that is refined shows; what it was solved from where none is given, read as it was then.
    output : {"offscreen", "window"}
        Memory, or a window over all of a monitor.
    monitor : str, optional
        Of a window: the monitor by its index, name or size as "ROWSxCOLUMNS".
    rate : float, optional
        Video frames a second; the display's, or 60.
    seconds : float, optional
        How long content is shown; until it ends, or the ``with`` block does, where none are given.
    clock : {"real", "simulated"}
        Offscreen: "simulated" passes as fast as the machine is and waits for whoever takes the video frames; what it shows
        is the same each time.
    step_time, encode_time : float, optional
        On a simulated clock, of what is refined: seconds that a step of one colour and the encoding of a set take.
    queue : int
        Video frames that are kept for :meth:`Session.frame` at most, 0 for none. Of more the oldest are given up, unless
        the clock is simulated.
    loop, speed
        Of what is played: whether it begins again at its end, and how many times as fast as it was made for.
    focus : float
        Where the eye focuses, metres, where its tracker does not say.
    latency : float
        Seconds from a video frame's beginning to its light.
    whole_sets : bool
        Shows sets whole where one takes several video frames; else each is the newest set's.
    moments : bool
        Refines each sub-frame of content that moves for its own moment, and not all of them for the set's.
    restart : float
        Diameters of the pupil that a jump has to have to begin again with the hologram for the whole eyebox.
    color, frames, ask, views
        Of an application: colours, sub-frames, what it is asked for ("views", "depth" or "layers"), and how many views along an
        axis at most.
    engine : Engine or str
        Where refinement is computed.
    other_scene : bool
        Take a scene that is not the one that the hologram was solved from.
    **steering
        As of :class:`eyebox.Refiner`.

    Returns
    -------
    Session
        It shows already; at the end of the ``with`` block it stops.

    Raises
    ------
    SessionError, EncodeError, HologramError
        What cannot be shown there, in the library's words.

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
    application = isinstance(what, str) and what.startswith("live:")
    display = _display_of(what, display, application)
    for name, value, known in (("output", output, ("offscreen", "window")), ("clock", clock, ("real", "simulated"))):
        if value not in known:
            raise ValueError(f"{name} is {value!r}: it must be {' or '.join(known)}")
    if output == "window" and clock == "simulated":
        raise ValueError('clock is "simulated": a window has the system\'s')
    if eye is not None and not _arguments.is_path(eye):
        raise TypeError(f"eye is {eye!r}: it must be own, simulated or another tracker's name")
    eye = None if eye is None else _arguments.path(eye, "eye")
    where = {
        "rate": None if rate is None else _arguments.finite_quantity(rate, "Hz", "rate"),
        "seconds": None if seconds is None else _arguments.finite_quantity(seconds, "s", "seconds"),
        "window": output == "window",
        "monitor": None if monitor is None else str(monitor),
        "simulated": clock == "simulated",
        "queue": _arguments.count(queue, "queue", 1024, least=0),
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
        "steering": _arguments.toml(steering),
    }
    if eye is None and not application and (steering or scene is not None or step_time is not None):
        raise TypeError("scene, step_time and steering are for what is refined: give eye")
    if application:
        if not hasattr(_eyebox.Session, "live"):
            raise NotImplementedError("live content exists on Linux alone")
        names = _arguments.colors(color, list(display.wavelengths))
        content = (names, _arguments.count(frames, "frames", 64), str(ask), _arguments.count(views, "views", 64))
        native = _eyebox.Session.live(what[5:], display._native, content, engine_of(engine), following, where)
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
    """The display that is given, or that what is shown was solved for."""
    if isinstance(what, Hologram):
        return what._shown_on(display)
    if application or not (display is None or _arguments.is_path(display)):
        return display_of("paper" if display is None else display)
    named = None if display is None else _arguments.path(display, "display")
    return Display._of(_eyebox.Hologram.file_shown_on(os.path.abspath(_arguments.path(what, "what")), named))
