"""The command ``eyebox``, as the package installs it, and its reports for programs."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from typing import Any

from . import _arguments, _eyebox

#: First part of the code of an error, and its exception. Other errors are EyeboxErrors.
_KINDS: dict[str, type[_eyebox.EyeboxError]] = {
    "optics": _eyebox.DisplayError,
    "scene": _eyebox.SceneError,
    "solve": _eyebox.SolveError,
    "produce": _eyebox.SolveError,
    "hologram": _eyebox.HologramError,
    "file": _eyebox.HologramError,
    "encode": _eyebox.EncodeError,
    "calibrate": _eyebox.CalibrateError,
    "session": _eyebox.SessionError,
    "engine": _eyebox.EngineError,
}


def main() -> int:
    """Runs the command with the arguments of the process. Returns its exit code."""
    # Python would turn ctrl-C into an exception after the command has ended. The command handles it by itself. If the
    # process was started with ctrl-C ignored, it stays ignored.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    _open_standard_files()
    return _eyebox.command(["eyebox", *sys.argv[1:]])


def _open_standard_files() -> None:
    """Opens standard files that are closed, as a Rust program does. Otherwise another file could take their place."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # The lowest free number is this one.
            os.open(os.devnull, os.O_RDWR)


def command(*words: Any) -> dict[str, Any]:
    """Runs a command of ``eyebox`` in another process and returns its report.

    Use it for commands that have no function in this package, such as films and studies.

    Parameters
    ----------
    *words : str, path or number
        Command and its arguments, as in a shell. ``--json`` is added.

    Returns
    -------
    dict
        Report of the command, with the keys of docs/json.md. It is empty for a command without one.

    Raises
    ------
    EyeboxError
        If the command fails. It has the ``code`` and the ``fields`` of the error.

    Examples
    --------
    >>> import eyebox
    >>> eyebox.command("display", "list")["schema"]
    'display-list/1'
    """
    given = [os.fsdecode(word) if _arguments.is_path(word) else str(word) for word in words]
    if not given:
        raise _arguments.wrong(TypeError, "words", "is empty: it must have a command, such as \"info\", and its arguments")
    done = _run(given if "--json" in given else [*given, "--json"])
    error = None if done.returncode == 0 else _error(done)
    if error is not None and error.code == "usage/unknown-argument" and error.fields.get("argument") == "--json":
        done = _run(given)
        error = None if done.returncode == 0 else _error(done)
    if error is not None:
        raise error
    return _last_object(done.stdout) or {}


def _run(words: list[str]) -> subprocess.CompletedProcess[str]:
    """Runs the command. The child is in the process group of this program, so ctrl-C ends both."""
    program = [sys.executable, "-m", "eyebox", *words]
    environment = {**os.environ, "EYEBOX_JSON_ERRORS": "1"}
    return subprocess.run(program, stdin=subprocess.DEVNULL, capture_output=True, text=True, env=environment)


def _last_object(text: str) -> dict[str, Any] | None:
    """Returns the last line that is a JSON object."""
    for line in reversed(text.splitlines()):
        if line.startswith("{"):
            try:
                found: dict[str, Any] = json.loads(line)
            except ValueError:
                continue
            return found
    return None


def _error(done: subprocess.CompletedProcess[str]) -> _eyebox.EyeboxError:
    """Returns the error of a command as the exception of its code."""
    report = _last_object(done.stderr)
    if report is None or "error" not in report:
        said = done.stderr.strip().splitlines()
        return _eyebox.EyeboxError(said[-1] if said else f"eyebox ended with exit code {done.returncode}")
    told = report["error"]
    kind = _KINDS.get(str(told["code"]).split("/")[0], _eyebox.EyeboxError)
    error = kind(told["message"])
    error.code, error.fields = told["code"], told["fields"]
    return error
