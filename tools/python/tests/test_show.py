"""Tests that Python shows the same as the command and content of another process, and that no session hangs."""

import contextlib
import sys
import threading
import time

import eyebox
import numpy as np
import pytest
from test_same import command
from conftest import coded, named


def raw(tmp_path, *arguments):
    """Returns the video frames of `eyebox show`."""
    out = tmp_path / "command.raw"
    command("show", *arguments, "--display", "planes8", "--size", "40x48", "--clock", "simulated", "--output", f"raw:{out}")
    return np.fromfile(out, np.uint8).reshape(-1, 40, 48, 1)


def test_a_hologram_is_played_as_by_the_command(tmp_path, hologram, display):
    hologram.save(tmp_path / "x.zarr")
    theirs = raw(tmp_path, tmp_path / "x.zarr", "--duration", "0.2")
    with eyebox.show(hologram, display, clock="simulated", seconds=0.2) as session:
        frames = list(session)
    own = np.stack([frame.pixels for frame in frames])
    assert session.about.rate == 60 and session.about.sub_frames == 8 and session.about.set_frames == 1
    # The file of the command also has the picture that stays at the end.
    assert len(theirs) - len(own) in (0, 1) and np.array_equal(own, theirs[: len(own)])
    assert np.array_equal(own[-1], hologram.encode(display)[0])
    assert [frame.number for frame in frames] == list(range(len(frames)))
    assert frames[0].hologram is None and frames[-1].hologram == 0 and {frame.part for frame in frames} == {0}
    assert session.statistics["ended_by"] == "the duration" and not session.running and session.left_out == 0
    # The path of its file shows the same.
    with eyebox.show(tmp_path / "x.zarr", display, clock="simulated", seconds=0.2) as session:
        assert np.array_equal(np.stack([frame.pixels for frame in session]), own)


@pytest.mark.parametrize("moments", [True, False])
def test_an_eye_is_followed_as_by_the_command(tmp_path, hologram, display, moments):
    hologram.save(tmp_path / "x.zarr")
    follow = "--tracker simulated:3 --set show.step_time=5 --set show.encode_time=1 --duration 0.15 --engine cpu".split()
    theirs = raw(tmp_path, tmp_path / "x.zarr", *follow, "--set", "show.moments=" + ("on" if moments else "off"))
    how = dict(eye="simulated:3", clock="simulated", step_time=5e-3, seconds=0.15, engine="cpu", moments=moments)
    with eyebox.show(hologram, display, **how) as session:
        frames = list(session)
        assert session.status["steps"] > 10
    own = np.stack([frame.pixels for frame in frames])
    assert len(theirs) - len(own) in (0, 1) and np.array_equal(own, theirs[: len(own)])
    assert len({frame.pixels.tobytes() for frame in frames}) > 5, "it moves"
    assert session.statistics["sets_new"] == len({frame.hologram for frame in frames} - {None})


def test_samples_of_ones_own_are_followed(hologram, display):
    with eyebox.show(hologram, display, eye="own", rate=60, engine="cpu") as session:
        until, seen = time.monotonic() + 60, []
        while time.monotonic() < until and (session.status.get("steps", 0) < 4 or not seen):
            session.look(2e-3, -1e-3, 4e-3)
            session.look(2e-3, -1e-3, 4e-3, velocity=(1e-2, 0.0))
            if (frame := session.frame(timeout=0.05)) is not None:
                seen.append(frame)
        session.look(float("nan"))
        for wrong in ((1.0,), 1.0, "fast", (1.0, 2.0, 3.0)):
            with named((TypeError, ValueError), "velocity"):
                session.look(0.0, velocity=wrong)
        session.steer(False)
        assert session.running
    assert session.statistics["steps"] >= 4 and session.statistics["tracker"] == "the program's own tracker"
    assert seen and all(frame.pixels.shape == (40, 48, 1) and frame.pixels.flags.owndata is False for frame in seen)
    with named(ValueError, 'eye="own"'):
        with eyebox.show(hologram, display) as session:
            session.look(0.0)


def test_what_nobody_takes_is_given_up_and_the_display_goes_on(hologram, display):
    with eyebox.show(hologram, display, rate=200, queue=2) as session:
        while session.left_out < 5:
            time.sleep(0.01)
        assert session.frame(timeout=1.0) is not None
    with eyebox.show(hologram, display, rate=200, queue=0) as session:
        assert session.frame(timeout=0.02) is None and session.running
        session.pause()
    # A simulated display waits for a reader of its video frames, and does not hang if there is none any more.
    session = eyebox.show(hologram, display, clock="simulated")
    first = session.frame()
    time.sleep(0.05)
    assert session.left_out == 0 and session.frame().number == first.number + 1
    del session


@pytest.mark.parametrize(("ask", "engine"), [("depth", "cpu"), ("views", "vulkan")])
def test_an_application_in_python_comes_to_light(tmp_path, monkeypatch, display, ask, engine):
    live = pytest.importorskip("eyebox.live")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with pytest.raises(live.LiveError):
        live.Live("demo")
    asked = []

    def application():
        with live.Live("demo") as there:
            assert there.colors == ["green"] and there.eyebox == pytest.approx([display.eyebox] * 2)
            picture = np.zeros((*there.size, 1), np.float32)
            picture[10:30, 10:30] = 1
            if ask == "depth":
                kind = there.color_and_depth(live.F32, live.LINEAR)
                content = (picture, np.zeros(there.size, np.float32))
            else:
                kind = there.views(3, 3, "1mm", live.F32, live.LINEAR)
                content = (np.broadcast_to(picture, (3, 3, *picture.shape)).copy(),)
            with contextlib.suppress(live.Gone):
                while True:
                    if request := there.wait(1.0):
                        asked.append(request)
                        there.send(kind, *content, request=request)

    with eyebox.show("live:demo", display, color="green", ask=ask, rate=30, engine=engine) as session:
        thread = threading.Thread(target=application)
        thread.start()
        until, shown = time.monotonic() + 60, {}
        while time.monotonic() < until and len(shown) < 3:
            frame = session.frame(timeout=1.0)
            if frame is not None and frame.hologram is not None:
                shown[frame.hologram] = frame.pixels.tobytes()
    thread.join(20)
    assert not thread.is_alive() and asked and len(set(shown.values())) == 3, "it is refined"
    content = session.statistics["content"]
    assert content["shown"] >= 1 and content["refused"] == 0, content


def test_what_makes_no_sense(tmp_path, hologram, display):
    refused = [
        (dict(eye="nobody"), eyebox.SessionError, "nobody"),
        (dict(eye=3), TypeError, "eye", "3"),
        (dict(output="paper"), ValueError, "output", "'paper'"),
        (dict(clock="simulated", output="window"), ValueError, "clock"),
        (dict(clock="simulated", queue=0), ValueError, "queue", "seconds"),
        (dict(clock="simulated", eye="simulated"), ValueError, "step_time"),
        (dict(clock="simulated", eye="own", step_time=1e-3), eyebox.SessionError),
        (dict(eye="own", step_time=1e-3), ValueError, "step_time"),
        (dict(eye="own", pupils=0), eyebox.SolveError, "pupils"),
        (dict(eye="own", restart=float("nan")), eyebox.SessionError, "restart"),
        (dict(eye="own", scene="builtin:plane"), eyebox.SceneError, "still-life"),
        (dict(rate=1e9), eyebox.SessionError, "100000"),
        (dict(seconds=-1.0), ValueError, "seconds", "-1"),
        (dict(queue=-1), ValueError, "queue", "-1"),
        (dict(steps=3), TypeError, "eye"),
    ]
    for given, kind, *words in refused:
        with named(kind, *words):
            eyebox.show(hologram, display, **given)
    with coded(eyebox.SessionError, "setting/size", "session/setting/size"):
        eyebox.show(hologram, eyebox.Display("planes8", size=(32, 32)))
    with pytest.raises(eyebox.HologramError):
        eyebox.show(tmp_path / "nothing.zarr", display)
    with named(TypeError, "eyebox.show"):
        eyebox.Session()


def test_a_function_is_called_with_the_light_of_each_set(hologram, display, monkeypatch):
    lights = []
    with eyebox.show(hologram, display, clock="simulated", seconds=0.5, on_light=lights.append) as session:
        frames = list(session)
    begun = [frame for frame in frames if frame.hologram is not None and frame.part == 0]
    assert [light.number for light in lights] == [frame.number for frame in begun]
    assert [light.set for light in lights] == list(range(len(begun)))
    assert all(isinstance(light, eyebox.Light) and light.hologram == 0 for light in lights)
    assert lights[0].new and lights[1].reported is not None

    def fails(light):
        raise RuntimeError(f"set {light.set}")

    failures = []
    monkeypatch.setattr(sys, "unraisablehook", lambda failure: failures.append(str(failure.exc_value)))
    with eyebox.show(hologram, display, clock="simulated", seconds=0.1, on_light=fails) as session:
        assert list(session)
    assert failures[0] == "set 0" and session.statistics["ended_by"] == "the duration"
    with pytest.raises(TypeError, match="on_light"):
        eyebox.show(hologram, display, on_light=3)
    # A session that nobody stops ends with its object.
    forgotten = eyebox.show(hologram, display, on_light=lights.append)
    del forgotten
