"""Tests the units and the checks of eyebox.live, with a session on the other side."""

import struct
import time

import eyebox
import numpy as np
import pytest
from conftest import named

live = pytest.importorskip("eyebox.live", exc_type=ImportError)


@pytest.fixture
def both(tmp_path, monkeypatch, display):
    """Returns a session that shows an application for an eye of its own, and the connection of the application."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with eyebox.show("live:units", display, color=["red", "green"], eye="own", rate=30, engine="cpu", queue=0) as session:
        with live.Live("units") as there:
            yield session, there


def requested(session, there, **look):
    """Looks until a request has the place of the pupil, and returns it."""
    until = time.monotonic() + 60
    while time.monotonic() < until:
        session.look(**look)
        request = there.wait("50ms")
        if request is not None and request.tracked and abs(request.x - look["x"]) < 1e-4:
            return request
    raise AssertionError("no request has the pupil")


def slot(there):
    """Returns view_pitch and center of the newest frame in millimeters, and the depths of its layers."""
    at = 4096 + there._live._newest * there._live._stride
    memory = there._live._map
    return struct.unpack_from("=3d", memory, at + 64), struct.unpack_from("=64f", memory, at + 128)


def test_a_request_is_in_meters_and_seconds(both, display):
    session, there = both
    request = requested(session, there, x=1.5e-3, y=-2e-3, diameter=3e-3)
    assert (request.x, request.y, request.diameter) == pytest.approx((1.5e-3, -2e-3, 3e-3), abs=1e-4)
    assert abs(request.lit - time.monotonic()) < 10 and 0 < request.period < 1
    raw = there._live.request()
    request = live.Request._of(raw)
    assert raw.pupil_x_mm == pytest.approx(1.5, abs=0.1) and request.x == raw.pupil_x_mm * 1e-3
    assert (request.lit, request.number) == (raw.lit_ns * 1e-9, raw.number) and isinstance(request.kind, live.Kind)
    assert request.view_pitch == raw.pitch_mm * 1e-3 and request.center == (raw.center_x_mm * 1e-3, raw.center_y_mm * 1e-3)
    assert there.size == display.picture_size and there.colors == ["red", "green"]
    assert there.eyebox == pytest.approx((display.eyebox, display.eyebox)) and 0 < there.pixel_angle < 0.01
    assert there.kinds == set(live.Kind) and there.most_layers >= 2 and min(there.most_views) >= 1


def test_a_frame_is_sent_in_the_units_of_the_connection(both):
    session, there = both
    rows, columns = there.size
    request = requested(session, there, x=0.0)
    views = there.views(2, 3, "1.5mm", live.F32, live.LINEAR)
    assert views.shape == (2, 3, rows, columns, 2) and views.view_pitch == 1.5e-3
    # Any memory order, and float64 for float32.
    samples = np.asfortranarray(np.random.default_rng(3).random(views.shape))
    number = there.send(views, samples, request=request, center=("2mm", -1e-3))
    assert slot(there)[0] == pytest.approx((1.5, 2.0, -1.0))
    layers = there.layers([0.0, "0.5D"], sample=live.U8)
    assert layers.shape == (2, rows, columns, 3)
    assert there.send(layers, np.zeros(layers.shape, np.uint8), content_time=request.lit) == number + 1
    assert slot(there)[1][:3] == (0.0, 0.5, 0.0)
    depth = there.color_and_depth(live.F16, live.LINEAR)
    assert there.send(depth, np.zeros(depth.shape), np.zeros((rows, columns))) == number + 2
    assert there.send(depth, bytes(2 * rows * columns * 2), bytes(4 * rows * columns)) == number + 3


def test_what_makes_no_sense(both):
    session, there = both
    rows, columns = there.size
    kind = there.color_and_depth(live.U8)
    light, depths = np.zeros(kind.shape, np.uint8), np.zeros((rows, columns), np.float32)
    with named(ValueError, "samples", str(columns)):
        there.send(kind, light[:-1], depths)
    with named(TypeError, "samples", "float64"):
        there.send(kind, light.astype(float), depths)
    with named(ValueError, "diopters"):
        there.send(kind, light, depths[:-1])
    with named(TypeError, "frame"):
        there.send(live.U8, light, depths)
    with named(TypeError, "request", "3"):
        there.send(kind, light, depths, request=3)
    with named(ValueError, "sample", "7"):
        there.views(2, 2, "1mm", 7)
    with named(TypeError, "diopters", "3"):
        there.layers(3)
    with pytest.raises(ValueError, match="diopters"):
        there.layers(["1mm"])
    with pytest.raises(ValueError, match="view_pitch"):
        there.views(2, 2, "1D")
    with pytest.raises(live.LiveError):
        there.send(kind, light)  # The depths are missing.
    with pytest.raises(live.LiveError):
        there.send(there.views(64, 64, "1mm"), np.zeros((64, 64, rows, columns, 2), np.uint8))
    there.close()
    with pytest.raises((live.LiveError, ValueError)):
        there.wait(0)
    session.stop()
