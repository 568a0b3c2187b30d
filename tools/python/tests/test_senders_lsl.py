"""tools/senders/lsl.py with the streams of four programs, from recorded bytes and from outlets of liblsl."""

import argparse
import contextlib
import json
import math
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from lsl_streams import RECORDED, STREAMS, described, info, isolate

SENDERS = Path(__file__).resolve().parents[2] / "senders"
sys.path.insert(0, str(SENDERS))

import lsl  # noqa: E402
import place  # noqa: E402
import sender as common  # noqa: E402
from lsl_channels import Unusable, layout  # noqa: E402

isolate()
try:
    import pylsl
except (ImportError, RuntimeError):
    pylsl = None
needs_pylsl = pytest.mark.skipif(pylsl is None, reason="pylsl is not installed")

WIDE = 60
RADIUS = 10.4


def arguments(*words):
    """The command line of lsl.py."""
    parser = argparse.ArgumentParser()
    lsl.add(parser)
    return parser.parse_args(words)


def eyes(*words):
    return place.Eyes(arguments(*words))


def recorded(key):
    stream = json.loads(RECORDED.read_text())[key]
    return stream["description"], stream["samples"]


def reading(found):
    """The position and the diameter of an eye."""
    assert found["valid"], found
    return pytest.approx([found["x"], found["y"], found.get("diameter")], abs=1e-9)


# The eyes of each sample without displays, as [degrees right, degrees down, mm of diameter] or None.
UP = math.degrees(math.atan2(178, 600))
TURN = math.degrees(math.atan2(0.6, 0.8))
DIRECTIONS = {
    "pupil-capture": [{"left": [0, 0, 4.5], "right": [TURN, 0, 3.5]}, {"left": [0, -TURN, 4.5], "right": None}],
    "neon": [{"left": [0, 0, 4.5], "right": [TURN, 0, 3.5]}],
    "titta": [{"left": [0, -UP, 4.5], "right": [0, 0, 3.5]}, {"left": None, "right": [0, 0, 3.5]}],
    "eyelink": [{"left": [1, 0, None], "right": [-1, 2, None]}, {}, {"left": None, "right": [-1, 2, None]}],
}
# With the displays at X, Y, Z, and the pupils in their frames.
DISPLAYS = {
    "pupil-capture": ("--left=-33,11,-19", "--right=31,12,-20"),
    "neon": ("--left=-33,11,-19", "--right=31,12,-20"),
    "titta": ("--left=-33,-10,-590", "--right=30,-12,-590"),
}
PUPILS = {
    "pupil-capture": [
        {"left": [0, 0, 4.5], "right": [0.6 * RADIUS, 0, 3.5]},
        {"left": [0, -0.6 * RADIUS, 4.5], "right": None},
    ],
    "neon": [{"left": [0, 0, 4.5], "right": [0.6 * RADIUS, 0, 3.5]}],
    "titta": [{"left": [0, -1, 4.5], "right": [1, 0, 3.5]}, {"left": None, "right": [1, 0, 3.5]}],
}


def same(sample, wanted, what):
    """Compares the eyes of a sample with the wanted ones."""
    assert {side for side in ("left", "right") if side in sample} == set(wanted)
    for side, numbers in wanted.items():
        assert sample[side]["what"] == what
        assert sample[side]["unit"] == {"gaze": "deg", "pupil": "mm"}[what]
        if numbers is None:
            assert sample[side]["valid"] is False and "x" not in sample[side]
        else:
            assert reading(sample[side]) == numbers


@pytest.mark.parametrize("key", DIRECTIONS)
def test_directions_of_recorded_streams(key):
    description, samples = recorded(key)
    found = layout(description, eyes(), [960, 540])
    for values, wanted in zip(samples, DIRECTIONS[key], strict=True):
        same(found.sample(values), wanted, "gaze")


@pytest.mark.parametrize("key", PUPILS)
def test_pupils_of_recorded_streams_in_front_of_displays(key):
    description, samples = recorded(key)
    found = layout(description, eyes(*DISPLAYS[key]))
    for values, wanted in zip(samples, PUPILS[key], strict=True):
        same(found.sample(values), wanted, "pupil")
    one = layout(description, eyes(DISPLAYS[key][1]))
    assert [side for side, eye in one.sample(samples[0]).items() if eye] == ["right"]


@pytest.mark.parametrize("key", [*DIRECTIONS])
def test_channels_are_found_by_label_and_not_by_index(key):
    description, samples = recorded(key)
    head, body = description.split("<channels>")
    parts = body.split("</channel>")[:-1]
    moved = [7 * i % len(parts) for i in range(len(parts))]
    if sorted(moved) != list(range(len(parts))):
        moved = list(reversed(range(len(parts))))
    body = "".join(f"{parts[i]}</channel>" for i in moved)
    found = layout(f"{head}<channels>{body}</channels></desc></info>", eyes(), [960, 540])
    for values, wanted in zip(samples, DIRECTIONS[key], strict=True):
        same(found.sample([values[i] for i in moved]), wanted, "gaze")


def changed(key, *pairs):
    description, samples = recorded(key)
    for old, new in pairs:
        assert old in description
        description = description.replace(old, new)
    return description, samples[0]


@pytest.mark.parametrize("flag", ["valid", "available"])
@pytest.mark.parametrize(("of", "without_display", "with_display"), [
    ("gaze_point", None, [0, -1, 4.5]),
    ("gaze_origin", None, None),
    ("pupil", [0, -UP, None], [0, -1, None]),
])
def test_each_flag_concerns_its_own_quantity(flag, of, without_display, with_display):
    """A display needs no gaze point, and a diameter that is not valid is unknown."""
    description, samples = recorded("titta")
    labels = [channel["label"] for channel in STREAMS["titta"][0][3]]
    values = list(samples[0])
    values[labels.index(f"{flag}.{of}.left_eye")] = 0.0
    for words, what, wanted in (((), "gaze", without_display), (DISPLAYS["titta"][:1], "pupil", with_display)):
        found = layout(description, eyes(*words)).sample(values)
        same({"left": found["left"]}, {"left": wanted}, what)


def test_meters_and_unknown_units():
    meters, values = changed("neon", ("<unit>mm</unit>", "<unit>m</unit>"))
    at = [i for i, c in enumerate(STREAMS["neon"][0][3]) if c["unit"] == "mm"]
    values = [value / 1e3 if i in at else value for i, value in enumerate(values)]
    same(layout(meters, eyes(*DISPLAYS["neon"])).sample(values), PUPILS["neon"][0], "pupil")
    unstated, values = changed("neon", ("<unit>mm</unit>", ""))
    same(layout(unstated, eyes(*DISPLAYS["neon"])).sample(values), PUPILS["neon"][0], "pupil")
    inches, _ = changed("neon", ("<unit>mm</unit>", "<unit>inches</unit>"), ("<label>x</label>", ""))
    with pytest.raises(Unusable, match="eyeballcenterx in inches"):
        layout(inches, eyes())


# The description of a stream that eyebox cannot use, arguments, and a part of the reason that names what is missing.
UNUSABLE = [
    ("lsl-relay", [], [], "eye state"),
    ("lsl-relay", [], DISPLAYS["neon"], "eye state"),
    ("eyelink", [], [], "--straight"),
    ("eyelink", [], ["--left=0,0,0"], "places"),
    ("pupil-capture", [("eye_center", "x"), ("gaze_normal", "y")], [], "confidence"),
    ("pupil-capture", [("eye_center0", "x")], ["--right=0,0,0"], "left eye only"),
    ("pupil-capture", [("eye_center0_3d_x</label><eye>right", "eye_center0_3d_x</label><eye>left")], [], "eye 'left'"),
    ("neon", [("<eye>right</eye>", "<eye>left</eye>")], [], "two channels"),
    ("neon", [("<channel_count>16", "<channel_count>17")], [], "16 channels"),
    ("neon", [("double64", "string")], [], "text"),
    ("titta", [("PupilX", "Other")], ["--left=0,0,0"], "no channel"),
]


@pytest.mark.parametrize(("key", "pairs", "words", "missing"), UNUSABLE)
def test_a_stream_that_is_not_enough_is_refused_with_the_missing_part(key, pairs, words, missing):
    with pytest.raises(Unusable) as refused:
        layout(changed(key, *pairs)[0], eyes(*words))
    assert missing in str(refused.value) and "\n" not in str(refused.value)


def test_the_pose_of_a_display_turns_and_moves_points():
    display = place.Display("1,2,3,0,90,0")
    # The display looks to the right: its forward axis is to the right, and its right axis is backwards.
    assert display.inside([11, 2, 3]) == pytest.approx([0, 0, 10])
    assert display.inside([1, 2, -7]) == pytest.approx([10, 0, 0])
    assert place.Display("0,0,0,90,0,0").inside([0, -5, 0]) == pytest.approx([0, 0, 5])
    assert place.Display("0,0,0,0,0,90").inside([0, 5, 0]) == pytest.approx([5, 0, 0])
    # First to the right, then up about the turned axis, then clockwise.
    assert place.Display("0,0,0,90,90,0").inside([0, -5, 0]) == pytest.approx([0, 0, 5])
    assert place.Display("0,0,0,90,90,90").inside([5, 0, 0]) == pytest.approx([5, 0, 0])
    # Another way to the same: the axes of the display, turned one after the other.
    sx, cx, sy, cy, sz, cz = (f(math.radians(a)) for a in (10, 20, 30) for f in (math.sin, math.cos))
    clockwise = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    up = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    right = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    for axis in np.eye(3):
        point = np.array([1, 2, 3]) + right @ up @ clockwise @ axis
        assert place.Display("1,2,3,10,20,30").inside(point) == pytest.approx(axis)
    for wrong in ("1,2", "1,2,3,4", "a,b,c", "1,2,nan"):
        with pytest.raises(argparse.ArgumentTypeError):
            place.Display(wrong)


def test_the_usual_places_are_printed_as_poses(capsys):
    description, samples = recorded("neon")
    found = layout(description, eyes("--where"))
    with pytest.raises(SystemExit) as ended:
        for _ in range(place.PLACES):
            found.sample(samples[0])
    assert ended.value.code == 0
    printed = capsys.readouterr().out.split()
    assert printed == ["--left=-33.00,11.00,-18.60", "--right=37.24,12.00,-21.68"]


class Inlet:
    """An inlet with offsets of its own. None is an answer that does not come in time."""

    def __init__(self, *offsets):
        self.offsets = list(offsets)

    def time_correction(self, timeout):
        offset = self.offsets.pop(0)
        if offset is None:
            raise RuntimeError("timed out")
        return offset


def test_the_offset_of_the_clock_is_requested_again():
    now = [0.0]
    clock = lsl.Clock(Inlet(None, 2.0, 2.5), lambda: now[0])
    times = []
    for second in (0, 1, lsl.CORRECT_S, lsl.CORRECT_S + 1, 2 * lsl.CORRECT_S + 1):
        now[0] = second
        times.append(clock.time(100.0))
    assert times == [100.0, 100.0, 102.0, 102.0, 102.5]


def test_the_age_of_samples_is_printed_once(capsys):
    age = common.Age("lsl", samples=3)
    for seconds in (0.004, 0.008, 0.9, 0.9):
        age.add(seconds)
    assert "8.0 ms" in capsys.readouterr().err
    other = common.Age("lsl", samples=1)
    other.add(-1e9)
    assert capsys.readouterr().err == ""


@needs_pylsl
@pytest.mark.parametrize("key", STREAMS)
def test_the_recorded_bytes_are_of_liblsl(key):
    description, samples = recorded(key)
    assert described(pylsl, key) == description
    assert json.dumps(samples) == json.dumps(STREAMS[key][1])


@needs_pylsl
@pytest.mark.parametrize("key", DIRECTIONS)
def test_streams_of_outlets(key):
    outlet = pylsl.StreamOutlet(info(pylsl, key))
    words = ["--stream", f"eyebox-test-{key}", "--straight=960,540", f"--wait={WIDE}"]
    inlet, found = lsl.choose(pylsl, arguments(*words), eyes())
    inlet.open_stream(WIDE)
    begun = pylsl.local_clock()
    for i, values in enumerate(STREAMS[key][1]):
        outlet.push_sample(values, begun + 0.01 * i)
    wanted = [(i, sample) for i, sample in enumerate(DIRECTIONS[key]) if sample]
    received = [sample for _, sample in zip(wanted, lsl.samples(inlet, found))]
    for (i, eyes_wanted), sample in zip(wanted, received, strict=True):
        same(sample, eyes_wanted, "gaze")
        assert sample["t"] - received[0]["t"] == pytest.approx(0.01 * i, abs=1e-6)
        assert sample["t_unit"] == "s"
    if key == "pupil-capture":
        assert [sample["left"]["confidence"] for sample in received] == [0.9, 0.8]


@needs_pylsl
def test_the_usable_stream_is_chosen_and_two_need_a_name():
    relay, neon = (pylsl.StreamOutlet(info(pylsl, key)) for key in ("lsl-relay", "neon"))
    args = arguments(f"--wait={WIDE}")
    assert lsl.choose(pylsl, args, eyes())[0].info(WIDE).name() == "Neon Companion_Neon Gaze"
    titta = pylsl.StreamOutlet(info(pylsl, "titta"))
    with pytest.raises(Unusable, match="--stream") as refused:
        lsl.choose(pylsl, args, eyes())
    assert "'Tobii_gaze'" in str(refused.value) and "'Neon Companion_Neon Gaze'" in str(refused.value)
    with pytest.raises(Unusable, match="eye state"):
        lsl.choose(pylsl, arguments(f"--wait={WIDE}", "--stream", "Neon Companion_Gaze"), eyes())
    with pytest.raises(Unusable, match="'absent'"):
        lsl.choose(pylsl, arguments("--wait=0.5", "--stream", "absent"), eyes())
    del relay, neon, titta


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


needs_eyebox = pytest.mark.skipif("EYEBOX" not in os.environ, reason="EYEBOX names no eyebox command")
NEON_VALUES = STREAMS["neon"][1][0]


@contextlib.contextmanager
def pushing(outlet):
    """Pushes samples until the end of the block."""
    stop = threading.Event()

    def push():
        while not stop.wait(0.01):
            outlet.push_sample(NEON_VALUES)

    thread = threading.Thread(target=push)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def send(to, *words):
    """Starts lsl.py with the stream of the outlet and a display 1 mm to the left of the left pupil."""
    words = ["--to", f"127.0.0.1:{to}", "--stream", "eyebox-test-neon", "--left=-34,11,-19", f"--wait={WIDE}", *words]
    return subprocess.Popen([sys.executable, "-B", SENDERS / "lsl.py", *words])


def placed(row):
    """The pupil of a row of `eyebox tracker watch --json --predict`."""
    return row["stages"]["placed"].get("Ok")


@needs_pylsl
@needs_eyebox
def test_eyebox_watches_a_stream():
    """A sample goes from an outlet to lsl.py and by UDP to eyebox."""
    port = free_port()
    words = ["tracker", "watch", f"udp://:{port}", "--duration", str(WIDE), "--json", "--predict"]
    watching = subprocess.Popen([os.environ["EYEBOX"], *words], stdout=subprocess.PIPE, text=True)
    with pushing(pylsl.StreamOutlet(info(pylsl, "neon"))):
        sending = send(port)
        try:
            pupil = next(filter(None, (placed(json.loads(line)) for line in watching.stdout)))
            assert pupil["position"] == pytest.approx([1e-3, 0], abs=1e-9)
            assert pupil["diameter"] == pytest.approx(4.5e-3)
        finally:
            for running in (sending, watching):
                running.terminate()
                running.wait()


@needs_pylsl
@needs_eyebox
def test_eyebox_reads_the_recorded_bytes(tmp_path):
    """The datagrams of lsl.py, written to a file, are a recording for eyebox."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
        heard.bind(("127.0.0.1", 0))
        heard.settimeout(WIDE)
        with pushing(pylsl.StreamOutlet(info(pylsl, "neon"))):
            sending = send(heard.getsockname()[1], "--count", "20")
            lines = [heard.recv(4096).decode() for _ in range(20)]
            assert sending.wait() == 0
    (tmp_path / "neon.jsonl").write_text("\n".join(lines) + "\n")
    words = ["tracker", "watch", tmp_path / "neon.jsonl", "--json", "--predict"]
    done = subprocess.run([os.environ["EYEBOX"], *words], capture_output=True, text=True, check=True)
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(rows) == 20
    assert all(placed(row)["position"] == pytest.approx([1e-3, 0], abs=1e-9) for row in rows)


def test_a_missing_pylsl_is_one_line(tmp_path):
    (tmp_path / "pylsl.py").write_text("raise ImportError('absent')\n")
    where = {**os.environ, "PYTHONPATH": str(tmp_path)}
    words = [sys.executable, "-B", SENDERS / "lsl.py"]
    done = subprocess.run(words, env=where, capture_output=True, text=True, timeout=WIDE)
    assert done.returncode == 1 and done.stdout == ""
    assert len(done.stderr.splitlines()) == 1 and "pip install pylsl" in done.stderr
