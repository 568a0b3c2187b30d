"""tools/senders/neon.py with a phone that speaks the network protocols of the Companion app."""

import argparse
import asyncio
import collections
import json
import math
import os
import socket
import struct
import subprocess
import sys
import time
from itertools import islice
from pathlib import Path

import pytest
from neon_phone import RATE, Phone, payload, sender_report

SENDERS = Path(__file__).resolve().parents[2] / "senders"
sys.path.insert(0, str(SENDERS))

import neon  # noqa: E402
import place  # noqa: E402
import rtsp  # noqa: E402

WIDE = 60
RADIUS = 10.4
BEGUN = 1_700_000_000.0
TURN = math.degrees(math.atan2(0.6, 0.8))
DISPLAYS = ("--left=-29.3,11.7,-30", "--right=33.2,12.8,-30")


def arguments(*words):
    parser = argparse.ArgumentParser()
    neon.add(parser)
    return parser.parse_args(words)


class Clock:
    """The phone's clock without an offset."""

    offset = 0.0


def received(phone, count, *words, clock=Clock):
    """The first samples that neon.py sends from a phone."""
    args = arguments("--phone", phone.address, *words)
    found = neon.Phone(args.phone)
    stream = neon.samples(found, args, place.Eyes(args), clock)
    return list(islice(stream, count))


def steps(count, *data, **settings):
    """Samples 5 ms after each other."""
    data = data or (payload(**settings),)
    return [(BEGUN + 0.005 * i, data[i % len(data)]) for i in range(count)]


def numbers(eye):
    """The numbers of an eye. The app sends them in float32."""
    assert eye["valid"], eye
    return pytest.approx([eye["x"], eye["y"], eye["diameter"]], abs=2e-5)


@pytest.mark.parametrize("over", ["udp", "tcp"])
@pytest.mark.parametrize("length", [65, 89, 105])
def test_pupils_in_front_of_displays(over, length):
    with Phone(steps(3, length=length)) as phone:
        samples = received(phone, 3, "--over", over, *DISPLAYS)
    for i, sample in enumerate(samples):
        assert sample["t"] == pytest.approx(BEGUN + 0.005 * i, abs=1e-5)
        assert sample["left"]["what"] == sample["right"]["what"] == "pupil"
        assert numbers(sample["left"]) == [0, 0, 4.5]
        assert numbers(sample["right"]) == [0.6 * RADIUS, 0, 3.5]


def test_the_distance_to_the_pupil_is_a_setting_and_one_display_is_one_eye():
    with Phone(steps(1)) as phone:
        (sample,) = received(phone, 1, DISPLAYS[1], "--radius=11")
    assert "left" not in sample
    assert numbers(sample["right"]) == [6.6, 0, 3.5]


def test_directions_without_displays():
    with Phone(steps(1)) as phone:
        (sample,) = received(phone, 1)
    assert sample["left"]["what"] == "gaze"
    assert numbers(sample["left"]) == [0, 0, 4.5]
    assert numbers(sample["right"]) == [TURN, 0, 3.5]


def test_eyes_that_are_not_seen():
    nan = (math.nan,) * 3
    data = [payload(worn=0), payload(apertures=(2.9, 9.0)), payload(left=nan), payload(left=(0, 0, 0))]
    data += [payload(length=65)]
    with Phone(steps(5, *data)) as phone:
        samples = received(phone, 5, *DISPLAYS)
    seen = [[sample[side]["valid"] for side in ("left", "right")] for sample in samples]
    assert seen == [[False, False], [False, True], [False, True], [False, True], [True, True]]
    assert all("x" not in s["left"] for s in samples[:4])


@pytest.mark.parametrize("length", [9, 17, 25, 64])
def test_a_stream_without_eye_state_is_refused(length):
    with Phone(steps(1, length=length)) as phone, pytest.raises(rtsp.Refused) as refused:
        received(phone, 1)
    assert f"{length} bytes" in str(refused.value) and "\n" not in str(refused.value)
    assert length == 64 or "Compute eye state" in str(refused.value)


def test_a_stream_that_loses_its_eye_state_continues_when_it_returns():
    with Phone(steps(4, payload(), payload(length=9))) as phone:
        samples = received(phone, 2, "--over=tcp")
    assert [s["t"] - BEGUN for s in samples] == pytest.approx([0, 0.01], abs=1e-5)


def test_packets_before_the_first_report_are_left_out_and_rtp_times_wrap():
    # 100 counts before the end of 32 bits, so the second sample is at a small RTP time.
    with Phone(steps(4), report=2) as phone:
        samples = received(phone, 2, "--over=tcp")
    assert [s["t"] - BEGUN for s in samples] == pytest.approx([0.01, 0.015], abs=1e-5)


def test_a_stream_without_reports_is_refused(monkeypatch):
    monkeypatch.setattr(neon, "REPORT_S", 0.0)
    with Phone(steps(3), report=None) as phone, pytest.raises(rtsp.Refused, match="RTCP"):
        received(phone, 1, "--over=tcp")


def test_a_clock_behind_is_corrected_by_the_time_echo():
    with Phone(steps(1), behind=3600.0) as phone:
        clock = neon.Echo(neon.Phone(phone.address).echo)
        (sample,) = received(phone, 1, clock=clock)
    # The echo of the phone has whole milliseconds. Its answer lies between request and arrival.
    assert clock.offset == pytest.approx(3600.0, abs=0.5)
    assert sample["t"] == pytest.approx(BEGUN + clock.offset, abs=1e-5)


def test_the_echo_is_the_median_of_answers_and_the_first_is_left_out():
    ours, theirs = socket.socketpair()
    now = iter([0.0, 10.0] + [t for i in range(5) for t in (20.0 + i, 20.5 + i)])
    answers = [1.0, 18.25, 18.25, 21.25, 22.25, 23.25]
    monkey = pytest.MonkeyPatch()
    monkey.setattr(neon.socket, "create_connection", lambda *_: Pair(ours))
    sent = [0.0, 20.0, 21.0, 22.0, 23.0, 24.0]
    for begun, at in zip(sent, answers):
        theirs.sendall(struct.pack("!QQ", int(1e3 * begun), int(1e3 * at)))
    assert neon.echo(("phone", 1), count=5, now=lambda: next(now)) == pytest.approx(1.0)
    monkey.undo()
    theirs.close()


class Pair:
    """One end of a pair of sockets, without the options of TCP."""

    def __init__(self, end):
        self.sendall, self.recv, self.end = end.sendall, end.recv, end

    def setsockopt(self, *_):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end.close()


def test_a_phone_without_echo_keeps_its_own_time(capsys):
    with Phone(steps(1), has_echo=False) as phone:
        clock = neon.Echo(neon.Phone(phone.address).echo)
        (sample,) = received(phone, 1, clock=clock)
    assert clock.offset is None and sample["t"] == pytest.approx(BEGUN, abs=1e-5)
    assert "echo" in capsys.readouterr().err


@pytest.mark.parametrize("base", ["short", "full", None])
def test_addresses_of_the_session(base):
    with Phone(steps(1), base=base) as phone:
        received(phone, 1)
        requests = list(phone.requests)
    url = f"rtsp://127.0.0.1:{phone.ports[0]}/?camera=gaze&audioenable=on"
    at = f"rtsp://127.0.0.1:{phone.ports[0]}/gaze/" if base == "full" else url
    track = at + ("" if base == "full" else "/") + "trackID=2"
    assert requests[:4] == [("OPTIONS", url), ("DESCRIBE", url), ("SETUP", track), ("PLAY", at)]


def test_a_phone_without_udp_sends_by_tcp_and_one_with_neither_is_refused():
    with Phone(steps(1), udp=False) as phone:
        assert len(received(phone, 1)) == 1
    with Phone(steps(1), udp=False, tcp=False) as phone, pytest.raises(rtsp.Refused):
        received(phone, 1)


def test_reports_of_the_receiver_open_the_way():
    with Phone(steps(1)) as phone:
        received(phone, 1)
        until = time.monotonic() + WIDE
        while not phone.receiver_reports and time.monotonic() < until:
            time.sleep(0.01)
        report = phone.receiver_reports[0]
    # An empty report, then the name, as RFC 3550 requires.
    assert report[:4] == bytes([0x80, 201, 0, 1]) and report[8:12] == bytes([0x81, 202, 0, 4])
    assert len(report) == 28 and report[4:8] == report[12:16] and report[18:24] == b"eyebox"


# Settings of the phone and a part of the reason.
WRONG = [
    ({"connected": False}, "not connected"),
    ({"encoding": "H264"}, "H264"),
    ({"status": "[]"}, "Companion"),
    ({"status": "hello"}, "Companion"),
    ({"status": '{"result": []}'}, "gaze"),
]


@pytest.mark.parametrize(("settings", "reason"), WRONG)
def test_a_phone_without_gaze_is_refused_in_one_line(settings, reason):
    with Phone(steps(1), **settings) as phone:
        done = subprocess.run(program(phone, 9), capture_output=True, text=True, timeout=WIDE)
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1
    assert reason in done.stderr and "Traceback" not in done.stderr


def test_no_phone_is_one_line():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    done = subprocess.run(program(f"127.0.0.1:{port}", 9), capture_output=True, text=True, timeout=WIDE)
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1 and f"127.0.0.1:{port}" in done.stderr


def program(phone, to, *words):
    """The command line of neon.py."""
    address = phone if isinstance(phone, str) else phone.address
    return [sys.executable, "-B", SENDERS / "neon.py", "--phone", address, "--to", f"127.0.0.1:{to}", *words]


def test_a_stream_that_ends_is_requested_again():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
        heard.bind(("127.0.0.1", 0))
        heard.settimeout(WIDE)
        with Phone(steps(4), drop_after=2) as phone:
            words = program(phone, heard.getsockname()[1], "--over=tcp", "--count=6")
            sending = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
            times = [json.loads(heard.recv(4096))["t"] for _ in range(6)]
            _, said = sending.communicate(timeout=WIDE)
            assert sending.returncode == 0 and phone.sessions == 2
    assert "Trying again" in said and len(said.splitlines()) == 1
    begun = times[0]
    assert [t - begun for t in times] == pytest.approx([0, 0.005, 0, 0.005, 0.01, 0.015], abs=1e-5)


def test_frames_that_arrived_with_an_answer_are_read_before_the_end_of_the_connection():
    ours, phone = socket.socketpair()
    phone.close()
    with ours:
        stream = rtsp.Stream.__new__(rtsp.Stream)
        stream.connection = rtsp.Connection.__new__(rtsp.Connection)
        stream.connection.socket, stream.connection.data = ours, b""
        stream.connection.frames = collections.deque([(0, b"sample")])
        stream.sockets, stream.channels, stream.timeout = (), (0, 1), 1.0
        assert list(stream.received()) == [(0, b"sample")]
        with pytest.raises(OSError, match="closed"):
            list(stream.received())


def test_a_goodbye_ends_the_stream():
    with Phone(steps(2), goodbye=True) as phone, pytest.raises(OSError, match="ended"):
        received(phone, 3, "--over=tcp")


def test_rtp_packets():
    header = struct.pack("!BBHII", 0x80, 99, 5, 1000, 7)
    assert rtsp.Packet(header + b"data").payload == b"data"
    csrc = struct.pack("!BBHIII", 0x81, 99, 5, 1000, 7, 8)
    assert rtsp.Packet(csrc + b"data").payload == b"data"
    extended = struct.pack("!BBHIIHHI", 0x90, 99, 5, 1000, 7, 1, 1, 9)
    assert rtsp.Packet(extended + b"data").payload == b"data"
    padded = struct.pack("!BBHII", 0xA0, 99, 5, 1000, 7) + b"data\0\0\3"
    assert rtsp.Packet(padded).payload == b"data"
    for wrong in (b"", header[:11], bytes([0x40]) + header[1:], extended[:14], padded[:-1] + b"\xff"):
        assert rtsp.Packet(wrong).payload is None


def test_reports_of_the_sender():
    assert list(rtsp.reports(sender_report(BEGUN + 0.25, 77))) == [("report", BEGUN + 0.25, 77)]
    report = bytearray(sender_report(BEGUN, 77))
    # The seconds of NTP begin again in 2036.
    report[8:12] = struct.pack("!I", 5)
    assert list(rtsp.reports(bytes(report))) == [("report", 2**32 - rtsp.NTP_UNIX + 5, 77)]
    for size in range(28):
        assert list(rtsp.reports(sender_report(BEGUN, 77)[:size])) == []
    clock = rtsp.RtpClock(RATE)
    assert clock.time(0) is None
    clock.set(100.0, 10)
    assert [clock.time(10 + RATE), clock.time(2**32 - RATE + 10)] == [101.0, 99.0]


class Packets:
    """A stream of packets of which some come late or twice."""

    medium = argparse.Namespace(rate=RATE, payload_type=99)
    kept, every = math.inf, 0.0

    def __init__(self, *sequences, kind=99):
        self.all = [struct.pack("!BBHII", 0x80, kind, s, 9000, 7) + bytes([s % 256]) for s in sequences]

    def received(self):
        if not self.all:
            raise OSError("the end")
        yield 0, self.all.pop(0)


def test_late_packets_and_other_payloads_are_left_out():
    def order(stream):
        found = []
        with pytest.raises(OSError, match="the end"):
            for _, data in rtsp.Stream.payloads(stream):
                found.append(data[0])
        return found

    assert order(Packets(65534, 65535, 1, 0, 1, 2)) == [254, 255, 1, 2]
    assert order(Packets(1, 2, kind=96)) == []


class Bytes:
    """A connection whose bytes come in pieces."""

    def __init__(self, data, size):
        self.pieces = [data[i : i + size] for i in range(0, len(data), size)]

    def recv(self, _):
        return self.pieces.pop(0) if self.pieces else b""


@pytest.mark.parametrize("size", [1, 3, 1000])
def test_frames_between_answers_in_pieces(size):
    frame = b"$\x00\x00\x04\r\n\r\n"
    body = b"RTSP/1.0 200 OK\r\nCSeq: 1\r\ncontent-length: 3\r\n\r\nabc"
    connection = rtsp.Connection.__new__(rtsp.Connection)
    connection.data, connection.frames = b"", rtsp.collections.deque()
    connection.socket, found = Bytes(frame + body + frame + b"RTSP/1.0 404 No\r\nCSeq: 2\r\n\r\n", size), []
    while len(found) < 2:
        connection.receive()
        while answer := connection.next():
            found.append(answer)
    assert [(a.status, a.body, a.headers["cseq"]) for a in found] == [(200, "abc", "1"), (404, "", "2")]
    assert list(connection.frames) == [(0, b"\r\n\r\n")] * 2
    for wrong in (b"x" * 70000, b"RTSP/1.0 200 OK\r\nContent-Length: 99999\r\n\r\n"):
        connection.data = wrong
        with pytest.raises(OSError):
            connection.next()


@pytest.mark.skipif("EYEBOX" not in os.environ, reason="EYEBOX names no eyebox command")
def test_eyebox_watches_a_neon():
    """A sample goes from the phone to neon.py and by UDP to eyebox, 1 mm to the right of the center of the eyebox."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = ["tracker", "watch", f"udp://:{port}", "--duration", str(WIDE), "--json", "--predict"]
    watching = subprocess.Popen([os.environ["EYEBOX"], *words], stdout=subprocess.PIPE, text=True)
    with Phone(steps(4000), pace=0.005) as phone:
        sending = subprocess.Popen(program(phone, port, "--left=-30.3,11.7,-30"))
        try:
            rows = (json.loads(line) for line in watching.stdout)
            pupil = next(row["stages"]["placed"]["Ok"] for row in rows if "Ok" in row["stages"]["placed"])
            assert pupil["position"] == pytest.approx([1e-3, 0], abs=1e-7)
            assert pupil["diameter"] == pytest.approx(4.5e-3)
        finally:
            for running in (sending, watching):
                running.terminate()
                running.wait()


@pytest.mark.parametrize("length", [9, 17, 25, 65, 89, 105])
@pytest.mark.parametrize("base", ["short", "full", None])
def test_the_client_of_the_maker_reads_this_phone(length, base):
    """It shows that the phone of these tests speaks as the app does."""
    streaming = pytest.importorskip("pupil_labs.realtime_api.streaming.gaze", reason="no pupil-labs-realtime-api")
    from pupil_labs.realtime_api import Device
    from pupil_labs.realtime_api.time_echo import TimeOffsetEstimator

    async def read(phone):
        host, port = phone.address.split(":")
        async with Device(host, int(port)) as device:
            status = await device.get_status()
        sensor = status.direct_gaze_sensor()
        estimator = TimeOffsetEstimator(status.phone.ip, status.phone.time_echo_port)
        echo = await estimator.estimate(number_of_measurements=5)
        async for datum in streaming.receive_gaze_data(sensor.url):
            return echo.time_offset_ms.median, datum

    with Phone(steps(400, length=length), again=True, behind=3600.0, base=base) as phone:
        offset_ms, datum = asyncio.run(asyncio.wait_for(read(phone), WIDE))
        mine = neon.echo(neon.Phone(phone.address).echo)
    assert abs(offset_ms / 1e3 - mine) < 0.5
    assert datum.worn and (length == 17 or (datum.x, datum.y) == (800.5, 600.25))
    late = (datum.timestamp_unix_seconds - BEGUN) / 0.005
    assert abs(late - round(late)) < 0.01
    if length >= 65:
        ours = neon.Payload(payload(length=length)).eyes
        for side in ("left", "right"):
            center, axis, diameter, aperture = ours[side]
            assert center == tuple(getattr(datum, f"eyeball_center_{side}_{i}") for i in "xyz")
            assert axis == tuple(getattr(datum, f"optical_axis_{side}_{i}") for i in "xyz")
            assert diameter == getattr(datum, f"pupil_diameter_{side}")
            assert length == 65 or aperture == getattr(datum, f"eyelid_aperture_{side}")
