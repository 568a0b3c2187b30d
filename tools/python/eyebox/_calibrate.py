"""A model of the display as it is, fitted from a camera's pictures."""

from __future__ import annotations

import json
import os
import secrets
import shlex
import sys
import tempfile
import threading
from multiprocessing.connection import Connection, Listener
from typing import Any, Callable, NamedTuple

import numpy as np

from . import _arguments, _eyebox
from ._display import Display, display_of


class Shot(NamedTuple):
    """A picture that is asked for.

    Attributes
    ----------
    show : numpy.ndarray or None
        What the SLM shows: (sub-frame, row, column), grey levels (integers) or phases (float32, radians) as the camera takes
        them. Several are shown in turn, and exposed as whole sets.
    color : str or None
        The light that is on; None for darkness.
    wavelength : float or None
        Its wavelength, metres.
    iris : (float, float, float)
        Where the iris stands, and how wide it is: x, y, diameter, metres.
    focus : float
        Where the camera focuses, metres.
    exposure : float or None
        Seconds; None for what the camera finds best.
    average : int
        So many pictures are added.
    """

    show: np.ndarray | None
    color: str | None
    wavelength: float | None
    iris: tuple[float, float, float]
    focus: float
    exposure: float | None
    average: int


class Calibration(NamedTuple):
    """A display that was calibrated.

    Attributes
    ----------
    display : Display
        The display with what was fitted.
    report : dict
        How sure that is, and what it leaves unexplained: ``parameters``, ``unexplained``, ``noise``, ``calibrated``,
        ``warnings``, ...
    """

    display: Display
    report: dict[str, Any]


def calibrate(
    display: Any,
    camera: Callable[[Shot], Any] | None = None,
    color: str | None = None,
    *,
    hello: dict[str, Any] | None = None,
    full_scale: float | None = None,
    captures: Any = None,
    most: int = 40,
    quick: bool = False,
    iris: tuple[float, float, float] | None = None,
    callback: Callable[[str, float | None], Any] | None = None,
) -> Calibration:
    """Fits the model of one colour of a display to pictures of it; the display's own model is where the fit begins.

    Parameters
    ----------
    display : Display, str or path
        The display.
    camera : callable, optional
        Takes a :class:`Shot` and answers with its picture, (row, column), linear in light and no more than ``full_scale`` times
        ``average``. An exception ends that picture, and the bench is asked again; KeyboardInterrupt and SystemExit end the
        calibration. Without a camera, ``captures`` has the pictures.
    color : str, optional
        Green where none is given, or the display's first.
    hello : dict
        What the bench is, as a camera's command answers it (docs/calibrate.md): ``camera`` with ``resolution`` and ``bits``, and what
        of ``slm``, ``iris`` and ``focus_mm`` is not as by default. ``protocol``, ``colors`` and ``slm.resolution`` are the display's.
    full_scale : float, optional
        The value at which a picture saturates; 2 to the power of ``bits`` less 1 where none is given.
    captures : path, optional
        Where pictures are kept; those of a calibration that was broken off are not asked for again.
    most : int
        Pictures at most, 12 or more.
    quick : bool
        Four pictures, for what drifts.
    iris : (float, float, float), optional
        Where an iris stands that does not move: x, y, diameter, metres.
    callback : callable, optional
        Called with what is being done and the share of all that is done, and with lines of the bench and None. What it raises
        ends the calibration at once, as ctrl-C does. Pictures are kept where ``captures`` says.

    Raises
    ------
    CalibrateError
        The bench, its pictures, or what they do not tell.
    """
    display = display_of(display)
    if color is None:
        color = "green" if "green" in display.wavelengths else next(iter(display.wavelengths))
    folder = None if captures is None else _arguments.path(captures, "captures")
    still = None if iris is None else [1e3 * one for one in _arguments.quantities(iris, "m", "iris", "x, y, diameter")]
    if callback is not None and not callable(callback):
        raise TypeError(f"callback is {callback!r}: it must be callable with a text and a share or None")
    how = (_arguments.count(most, "most", 1000), bool(quick), still)
    if camera is None:
        native, report = _eyebox.calibrate(display._native, color, (None, folder), how, callback)
        return Calibration(Display._of(native), json.loads(report))
    if not callable(camera):
        raise TypeError(f"camera is {camera!r}: it must be callable with a Shot")
    with _Bench(display, camera, hello, full_scale) as bench:
        try:
            native, report = _eyebox.calibrate(display._native, color, (bench.command, folder), how, bench.told(callback))
        finally:
            bench.ended = True
            if bench.raised is not None:
                raise bench.raised
    return Calibration(Display._of(native), json.loads(report))


class _Bench:
    """The library asks a camera's command; this one asks back here (eyebox/_camera.py)."""

    def __init__(self, display: Display, camera: Any, hello: Any, full_scale: Any) -> None:
        try:
            said = _arguments.plain(dict(hello or {}))
            bits = _arguments.whole(said["camera"]["bits"], "bits")
        except (KeyError, TypeError, ValueError):
            right = "{'camera': {'resolution': (rows, columns), 'bits': bits}, ...}"
            raise TypeError(f"hello is {hello!r}: it must say what the bench is, as {right}") from None
        self.full_scale = 2.0**bits - 1 if full_scale is None else _arguments.number(full_scale, "full_scale")
        colors = {color: metres * 1e9 for color, metres in display.wavelengths.items()}
        slm = {"resolution": display.resolution, **said.get("slm", {})}
        self.hello = {"protocol": 1, "colors": colors, **said, "slm": slm}
        self.camera = camera
        self.open: list[Connection] = []
        self.ended = False
        self.raised: BaseException | None = None

    def told(self, callback: Any) -> Callable[[str, float | None], None]:
        """The callback, which also ends the calibration by what the camera raised."""

        def told(line: str, share: float | None) -> None:
            if self.raised is not None:
                raise self.raised
            if callback is not None:
                callback(line, share)

        return told

    def __enter__(self) -> _Bench:
        key = secrets.token_bytes(32)
        self.listener = Listener(authkey=key)
        self.folder = tempfile.TemporaryDirectory(prefix="eyebox-")
        # The key goes by a file that nobody else may read: others see a command's words.
        secret = os.path.join(self.folder.name, "key")
        with open(os.open(secret, os.O_CREAT | os.O_WRONLY, 0o600), "wb") as file:
            file.write(key)
        family = "AF_INET" if isinstance(self.listener.address, tuple) else "text"
        address = json.dumps(self.listener.address) if family == "AF_INET" else self.listener.address
        script = os.path.join(os.path.dirname(__file__), "_camera.py")
        self.command = shlex.join([sys.executable, script, family, address, secret])
        threading.Thread(target=self.serve, daemon=True).start()
        return self

    def __exit__(self, *_: Any) -> None:
        self.listener.close()
        for connection in self.open:
            connection.close()
        self.folder.cleanup()

    def serve(self) -> None:
        while True:
            try:
                connection = self.listener.accept()
            except Exception:  # It is closed, or somebody without the key called.
                if getattr(self.listener, "_listener", None) is None:
                    return
                continue
            self.open.append(connection)
            threading.Thread(target=self.answer, args=(connection,), daemon=True).start()

    def answer(self, connection: Connection) -> None:
        try:
            while True:
                asked = json.loads(connection.recv_bytes())
                answer: dict[str, Any] = {"id": asked.get("id")}
                try:
                    answer |= self.do(asked)
                except BaseException as error:
                    answer["error"] = f"{type(error).__name__}: {error}"
                    if not isinstance(error, Exception):
                        self.ended, self.raised = True, error
                connection.send_bytes(json.dumps(answer).encode())
        except (EOFError, OSError):
            return

    def do(self, asked: dict[str, Any]) -> dict[str, Any]:
        if self.ended:
            raise RuntimeError("it was ended")
        if asked.get("do") == "hello":
            return self.hello
        if asked.get("do") != "capture":
            return {}
        show, nm, exposure = asked.get("show"), asked.get("wavelength_nm"), asked.get("exposure_ms")
        shot = Shot(
            show=None if show is None else np.load(show["file"]),
            color=asked.get("color"),
            wavelength=None if nm is None else nm * 1e-9,
            iris=tuple(mm * 1e-3 for mm in asked.get("iris_mm") or (0.0, 0.0, 0.0)),
            focus=(asked.get("focus_mm") or 0.0) * 1e-3,
            exposure=None if exposure is None else exposure * 1e-3,
            average=asked.get("average", 1),
        )
        right = "(row, column) of real numbers"
        picture = _arguments.array(self.camera(shot), "the camera's picture", right)
        if picture.ndim != 2 or picture.dtype.kind not in "fiub":
            raise TypeError(f"the camera's picture is {picture.shape} of {picture.dtype}: it must be {right}")
        file = asked["out"] + ".npy"
        np.save(file, picture)
        return {"file": file, "full_scale": self.full_scale * shot.average, "exposure_ms": exposure}
