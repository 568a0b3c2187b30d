"""Tests the command of the package. It behaves as the program does, with reports and errors of Python."""

import os
import pathlib
import signal
import subprocess
import sys
import time

import eyebox
import numpy as np
import pytest
from conftest import coded, named

OWN = [sys.executable, "-m", "eyebox"]
LONG = ["solve", "builtin:still-life", "--size", "96", "--color", "green", "--engine", "cpu", "--steps"]


def program():
    """Returns the program `eyebox`, which the workspace's build makes."""
    found = os.environ.get("EYEBOX")
    if not found or not pathlib.Path(found).exists():
        pytest.skip("EYEBOX names no program")
    return [found]


def run(command, *words, **how):
    return subprocess.run([*command, *words], capture_output=True, timeout=120, **how)


@pytest.mark.parametrize(
    "words",
    [
        ["--version"],
        ["--help"],
        ["solve", "--help=all"],
        ["display", "list", "--json"],
        ["display", "show", "paper"],
        ["completions", "bash"],
        ["info", "/nowhere"],
        ["info", "/nowhere", "--json"],
        ["solve", "--stpes", "3"],
        ["solve", b"\xff.png"],
        ["solv"],
        [],
    ],
    ids=lambda words: " ".join(str(word) for word in words) or "none",
)
def test_output_and_exit_codes_are_those_of_the_program(words, tmp_path):
    own, other = (run(command, *words, cwd=tmp_path) for command in (OWN, program()))
    assert (own.returncode, own.stdout, own.stderr) == (other.returncode, other.stdout, other.stderr)


def test_a_solve_writes_the_bytes_of_the_program(tmp_path):
    words = [*LONG, "2", "--pupils", "2", "--frames", "2"]
    for name, command in (("own.zarr", OWN), ("other.zarr", program())):
        assert run(command, *words, "-o", tmp_path / name).returncode == 0
    own, other = (eyebox.Hologram.load(tmp_path / name) for name in ("own.zarr", "other.zarr"))
    assert own == other


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_a_solve_with_its_result(how, tmp_path):
    out = tmp_path / "stopped.zarr"
    # Shells start background programs so that they ignore ctrl-C, and so may the test's own parent.
    unblock = lambda: signal.signal(signal.SIGINT, signal.default_int_handler)  # noqa: E731
    ended = []
    for command in (OWN, program()):
        child = subprocess.Popen([*command, *LONG, "100000", "-o", out], stderr=subprocess.PIPE, text=True, preexec_fn=unblock)
        # The line about the engine is the last one before the steps.
        while "on CPU" not in child.stderr.readline():
            assert child.poll() is None
        time.sleep(0.5)
        child.send_signal(how)
        rest = child.communicate(timeout=60)[1]
        ended.append(child.returncode)
        assert "Traceback" not in rest and out.exists(), rest
        assert eyebox.Hologram.load(out).frames == 8
    assert ended[0] == ended[1]


@pytest.mark.skipif(os.name != "posix", reason="pipes")
def test_a_reader_that_goes_away_is_no_error():
    for command in (OWN, program()):
        child = subprocess.Popen([*command, "solve", "--help=all"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        child.stdout.close()
        said = child.stderr.read()
        child.stderr.close()
        assert (child.wait(60), said) == (0, b"")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="/dev/full")
def test_output_that_is_lost_is_an_error():
    with open("/dev/full", "wb") as full:
        ends = [
            subprocess.run([*command, "display", "list"], stdout=full, stderr=subprocess.PIPE).returncode
            for command in (OWN, program())
        ]
    assert ends == [2, 2]


@pytest.mark.skipif(os.name != "posix", reason="descriptors")
def test_closed_standard_output_does_not_reach_another_file(tmp_path):
    out = tmp_path / "one.zarr"
    words = [*OWN, *LONG, "1", "--frames", "1", "--pupils", "1", "-o", out]
    ended = subprocess.run(["sh", "-c", 'exec "$@" >&- 2>&-', "sh", *words], timeout=120).returncode
    assert ended == 0 and eyebox.Hologram.load(out).frames == 1


def test_reports_and_errors_are_pythons(tmp_path, hologram):
    assert eyebox.command("display", "list")["schema"] == "display-list/1"
    # A command without a report returns none.
    assert eyebox.command("completions", "bash") == {}
    with coded(eyebox.SceneError, "scene/not-found") as caught:
        eyebox.command("info", tmp_path / "nowhere")
    assert str(tmp_path / "nowhere") in caught.value.fields["path"]
    with coded(eyebox.EyeboxError, "usage/invalid-subcommand"):
        eyebox.command("solv")
    with named(TypeError, "words"):
        eyebox.command()
    hologram.save(tmp_path / "one.zarr")
    report = eyebox.command("eval", "score", tmp_path / "one.zarr", "--test-pupils", "random:3", "--seed", 5, "--jod", "none")
    own = hologram.score(pupils="random:3", seed=5, engine="cpu")
    assert [one["psnr_db"] for one in report["pupils"]] == pytest.approx([one.psnr for one in own], abs=1e-4)


def test_warnings_of_the_library_are_lines_of_the_command(tmp_path):
    """The package turns events of the library into warnings of Python. The command prints them."""
    light = tmp_path / "views.npy"
    views = np.tile(np.linspace(0.0, 1.0, 48, dtype=np.float32), (3, 3, 40, 1)) - np.float32(1e-6)
    np.save(light, np.repeat(views[..., None], 3, axis=-1))
    own, other = (run(command, "info", light, "--size", "40x48") for command in (OWN, program()))
    assert (own.returncode, own.stderr) == (other.returncode, other.stderr) and b"below 0" in own.stderr


def test_a_film_of_an_eye(tmp_path, hologram):
    keys = [{"t": 0, "x": -1e-3, "diameter": "4mm"}, {"t": 0.2, "x": "1mm", "depth": "0.01D", "jump": True}]
    made = eyebox.film(hologram, keys, tmp_path / "film.y4m", what="both")
    assert made["frames"] == 7 and made["size"][0] == 40 and (tmp_path / "film.y4m").stat().st_size > 7 * 40 * 96
    for wrong, argument in [([{"t": 0, "z": 1}], "keys[0]"), ([3], "keys[0]"), (3, "keys"), ([], "keys"), ([{"t": 0, "x": "1kg"}], "keys[0].x")]:
        with pytest.raises((TypeError, ValueError)) as caught:
            eyebox.film(hologram, wrong, tmp_path / "other.y4m")
        assert caught.value.argument == argument
    with coded(eyebox.EyeboxError, "film/path/time") as caught:
        eyebox.film(hologram, keys[::-1], tmp_path / "none.y4m")
    assert not (tmp_path / "none.y4m").exists() and "/tmp" not in str(caught.value)
