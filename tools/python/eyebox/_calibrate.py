"""Fits a model of the real display to pictures of a camera."""

from __future__ import annotations

import json
import os
import secrets
import shlex
import sys
import tempfile
import threading
from multiprocessing.connection import Client, Connection, Listener
from typing import TYPE_CHECKING, Any, Callable, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _arguments, _eyebox
from ._display import Display, display_of, engine_of
from ._hologram import Hologram
from ._interrupted import interrupted
from ._scene import Scene
from ._tables import frame

if TYPE_CHECKING:
    import pandas

    from ._types import DisplayLike, Path, Quantity, Whole


class Shot(NamedTuple):
    """A picture that the calibration requests from the camera.

    Attributes
    ----------
    show : numpy.ndarray or None
        Pattern on the SLM (sub-frame, row, column). It has gray levels (integers) or phases (float32, radians), as the
        camera takes them. Several sub-frames are shown in turn and exposed as whole sets.
    color : str or None
        Color of the light that is on, or None for darkness.
    wavelength : float or None
        Wavelength of the light in meters.
    iris : (float, float, float)
        Position and diameter of the iris (x, y, diameter), in meters.
    focus : float
        Depth at which the camera focuses, in meters.
    exposure : float or None
        Exposure time in seconds, or None if the camera chooses the best one.
    average : int
        Number of pictures to add.
    """

    show: NDArray[Any] | None
    color: str | None
    wavelength: float | None
    iris: tuple[float, float, float]
    focus: float
    exposure: float | None
    average: int


class Calibration(NamedTuple):
    """The result of a calibration.

    Attributes
    ----------
    display : Display
        Display with the fitted model.
    report : dict
        Certainty of the fit and the rest that it does not explain. Its keys are ``parameters``, ``unexplained``,
        ``noise``, ``calibrated``, ``warnings``, ...
    """

    display: Display
    report: dict[str, Any]

    def to_dataframe(self) -> pandas.DataFrame:
        """Returns the fitted numbers with their standard errors as a table of pandas."""
        return frame(list(self.report["parameters"]))


def calibrate(
    display: DisplayLike,
    camera: Callable[[Shot], Any] | None = None,
    color: str | None = None,
    *,
    hello: dict[str, Any] | None = None,
    full_scale: float | None = None,
    captures: Path | None = None,
    most: Whole = 40,
    quick: bool = False,
    iris: tuple[Quantity, Quantity, Quantity] | None = None,
    callback: Callable[[str, float | None], Any] | None = None,
) -> Calibration:
    """Fits the model of one color of a display to pictures of it. The fit begins with the model of the display.

    Parameters
    ----------
    display : Display, str or path
        Display to calibrate.
    camera : callable, optional
        Function that takes a :class:`Shot` and returns its picture (row, column). The picture is linear in light and at
        most ``full_scale`` times ``average``. An exception ends that picture, and the bench gets another request.
        KeyboardInterrupt and SystemExit end the calibration. Without a camera, ``captures`` has the pictures.
    color : str, optional
        Color to calibrate. The default is green, or the first color of a display without green.
    hello : dict, optional
        Description of the bench, like the answer of a camera's command (docs/calibrate.md). It has ``camera`` with
        ``resolution`` and ``bits``, and the values of ``slm``, ``iris`` and ``focus_mm`` that differ from the defaults.
        The display gives ``protocol``, ``colors`` and ``slm.resolution``. The default is the attribute ``hello`` of the
        camera, which :class:`eyebox.slmsuite.Bench` has.
    full_scale : float, optional
        Value at which a picture saturates. The default is 2 to the power of ``bits``, less 1.
    captures : path, optional
        Folder that keeps the pictures. After an interrupted calibration, the pictures in it are not taken again.
    most : int
        Highest number of pictures, 12 or more.
    quick : bool
        Take only four pictures, to find drift.
    iris : (float, float, float), optional
        Position and diameter of an iris that does not move (x, y, diameter), in meters. The default is the attribute
        ``iris`` of the camera, if it has one.
    callback : callable, optional
        Function that gets each activity with the share of all work that is done, and each line of the bench with None.
        An exception of the callback ends the calibration at once, as ctrl-C does. ``captures`` keeps the pictures.

    Raises
    ------
    CalibrateError
        If the bench or its pictures fail, or if the pictures do not determine the model.
    """
    display = display_of(display)
    if color is None:
        color = "green" if "green" in display.wavelengths else next(iter(display.wavelengths))
    folder = None if captures is None else _arguments.path(captures, "captures")
    still = _still(iris, camera)
    if callback is not None and not callable(callback):
        right = "callable with a text and a share or None"
        raise _arguments.wrong(TypeError, "callback", f"is {callback!r}: it must be {right}")
    how = (_arguments.count(most, "most", 1000), bool(quick), still)
    if camera is None:
        native, report = _eyebox.calibrate(display._native, color, (None, folder), how, callback)
        return Calibration(Display._of(native), json.loads(report))
    with _Bench(display, camera, hello, full_scale) as bench:
        try:
            native, report = _eyebox.calibrate(display._native, color, (bench.command, folder), how, bench.told(callback))
        finally:
            bench.ended = True
            if bench.raised is not None:
                raise bench.raised
    return Calibration(Display._of(native), json.loads(report))


class CameraSteps:
    """The steps of a solve with a camera. Their arguments are checked before the solve."""

    def __init__(self, display: Display, camera: Any, steps: Any, hello: Any, captures: Any) -> None:
        self.display = display
        self.folder = None if captures is None else _arguments.path(captures, "captures")
        self.count = _arguments.count(steps, "camera_steps", 65535)
        self.bench = _Bench(display, camera, hello, None)
        self.iris = _still(None, camera)

    def take(self, hologram: Hologram, scene: Scene, engine: Any) -> Hologram:
        """Takes the steps of a solved hologram. An error that ends them early has the best ``hologram``."""
        subject, own = (hologram._native, scene._native, self.display._native), engine_of(engine)
        with self.bench as bench:
            try:
                of = (bench.command, self.folder, self.iris)
                native, _, trouble = _eyebox.camera_steps(subject, own, of, self.count, bench.told(None))
            except KeyboardInterrupt as error:
                raise interrupted(error, lambda: hologram) from None
            finally:
                bench.ended = True
                if isinstance(bench.raised, KeyboardInterrupt):
                    raise interrupted(bench.raised, lambda: hologram) from None
                if bench.raised is not None:
                    raise bench.raised
        best = Hologram._of(native, scene, hologram.stopped)
        if trouble is not None:
            setattr(trouble, "hologram", best)
            raise trouble
        return best


def _still(iris: Any, camera: Any) -> list[float] | None:
    """Returns the iris that does not move in millimeters, from the argument or from the camera."""
    iris = getattr(camera, "iris", None) if iris is None else iris
    return None if iris is None else [1e3 * one for one in _arguments.quantities(iris, "m", "iris", "x, y, diameter")]


class _Bench:
    """Answers the requests of the library, which runs eyebox/_camera.py as the command of a camera."""

    def __init__(self, display: Display, camera: Any, hello: Any, full_scale: Any) -> None:
        if not callable(camera):
            raise _arguments.wrong(TypeError, "camera", f"is {camera!r}: it must be callable with a Shot")
        hello = getattr(camera, "hello", None) if hello is None else hello
        try:
            said = _arguments.plain(_arguments.with_units(dict(hello or {}), "hello"))
            bits = _arguments.whole(said["camera"]["bits"], "bits")
        except (KeyError, TypeError, ValueError) as error:
            if getattr(error, "argument", "").startswith("hello["):
                raise
            right = "{'camera': {'resolution': (rows, columns), 'bits': bits}, ...}"
            raise _arguments.wrong(TypeError, "hello", f"is {hello!r}: it must describe the bench, as {right}") from None
        self.full_scale = 2.0**bits - 1 if full_scale is None else _arguments.number(full_scale, "full_scale")
        colors = {color: metres * 1e9 for color, metres in display.wavelengths.items()}
        slm = {"resolution": display.resolution, **said.get("slm", {})}
        self.hello = {"protocol": 1, "colors": colors, **said, "slm": slm}
        self.camera = camera
        self.open: list[Connection] = []
        self.ended = False
        self.raised: BaseException | None = None

    def told(self, callback: Any) -> Callable[[str, float | None], None]:
        """Wraps the callback. The wrapper also raises an exception of the camera, which ends the calibration."""

        def told(line: str, share: float | None) -> None:
            if self.raised is not None:
                raise self.raised
            if callback is not None:
                callback(line, share)

        return told

    def __enter__(self) -> _Bench:
        self.key = key = secrets.token_bytes(32)
        self.listener = Listener(authkey=key)
        self.closed = False
        self.folder = tempfile.TemporaryDirectory(prefix="eyebox-")
        # The key is in a file of this user alone, because other users can see the arguments of a command.
        secret = os.path.join(self.folder.name, "key")
        with open(os.open(secret, os.O_CREAT | os.O_WRONLY, 0o600), "wb") as file:
            file.write(key)
        family = "AF_INET" if isinstance(self.listener.address, tuple) else "text"
        address = json.dumps(self.listener.address) if family == "AF_INET" else self.listener.address
        script = os.path.join(os.path.dirname(__file__), "_camera.py")
        self.command = shlex.join([sys.executable, script, family, address, secret])
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()
        return self

    def __exit__(self, *_: Any) -> None:
        # A thread that waits at a closed socket would take connections of the next socket with the same number.
        self.closed = True
        try:
            Client(self.listener.address, authkey=self.key).close()
        except OSError:
            pass
        self.thread.join(10)
        self.listener.close()
        for connection in self.open:
            connection.close()
        self.folder.cleanup()

    def serve(self) -> None:
        while True:
            try:
                connection = self.listener.accept()
            except Exception:  # A client had no key.
                if self.closed:
                    return
                continue
            if self.closed:
                connection.close()
                return
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
