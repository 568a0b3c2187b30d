"""Streams of Lab Streaming Layer as the programs of trackers make them, with samples and the eyes that they have.

The recorded bytes are in lsl-streams.json. `python lsl_streams.py` records them again, and needs pylsl.
"""

import json
import math
import os
import re
import tempfile
from pathlib import Path

RECORDED = Path(__file__).parent / "lsl-streams.json"
NAN = math.nan


def isolate():
    """Keeps LSL on this machine and in a session of its own. It acts before the first use of pylsl."""
    if "LSLAPICFG" not in os.environ:
        text = "[ports]\nIPv6 = disable\n[multicast]\nResolveScope = machine\n[lab]\nKnownPeers = {127.0.0.1}\n"
        file = tempfile.NamedTemporaryFile("w", suffix=".cfg", delete=False)
        file.write(f"{text}SessionID = eyebox-{os.getpid()}\n[log]\nlevel = -3\n")
        file.close()
        os.environ["LSLAPICFG"] = file.name


def pupil_capture():
    """The 22 channels of Pupil Capture's plugin. Eye 0 is the right one."""
    both = {"eye": "both"}
    yield {"label": "confidence", **both, "type": "Confidence", "unit": "normalized"}
    for axis in "xy":
        kind = {"type": f"Screen{axis.upper()}", "unit": "normalized", "coordinate_system": "world"}
        yield {"label": f"norm_pos_{axis}", **both, **kind}
    for axis in "xyz":
        kind = {"type": f"Direction{axis.upper()}", "unit": "mm", "coordinate_system": "world"}
        yield {"label": f"gaze_point_3d_{axis}", **both, **kind}
    for label in ("eye_center{}_3d_{}", "gaze_normal{}_{}"):
        for eye, side in enumerate(("right", "left")):
            for axis in "xyz":
                kind = {"type": f"Position{axis.upper()}", "unit": "mm", "coordinate_system": "world"}
                yield {"label": label.format(eye, axis), "eye": side, **kind}
    for form, unit in (("2d", "pixels"), ("3d", "mm")):
        for eye, side in enumerate(("right", "left")):
            kind = {"type": "Diameter", "unit": unit, "coordinate_system": f"eye{eye}"}
            yield {"label": f"diameter{eye}_{form}", "eye": side, **kind}


def scene_pixels():
    """The two channels of lsl-relay, whose type has another name."""
    for axis in "xy":
        kind = {"metatype": f"Screen{axis.upper()}", "unit": "pixels", "coordinate_system": "world"}
        yield {"label": axis, "eye": "both", **kind}


def neon():
    """The 16 channels of Neon's app with the eye state. Its document states the labels, but no types and units."""
    for axis in "xy":
        yield {"label": axis, "eye": "both", "type": f"Screen{axis.upper()}", "unit": "pixels"}
    for side in ("left", "right"):
        yield {"label": "PupilDiameter", "eye": side, "type": "Diameter", "unit": "mm"}
        for axis in "XYZ":
            yield {"label": f"EyeballCenter{axis}", "eye": side, "type": f"Position{axis}", "unit": "mm"}
        for axis in "XYZ":
            yield {"label": f"OpticalAxis{axis}", "eye": side, "type": f"Direction{axis}", "unit": "normalized"}


def titta():
    """The channels of TittaLSL for Tobii Pro."""
    for side in ("left", "right"):

        def flags(of, side=side):
            for flag in ("valid", "available"):
                label = f"{flag}.{of}.{side}_eye"
                yield {"label": label, "eye": side, "type": f"{flag.capitalize()}Flag", "unit": "bool"}

        for axis in "xy":
            label = f"{axis}.position_on_display_area.gaze_point.{side}_eye"
            yield {"label": label, "eye": side, "type": f"Screen{axis.upper()}", "unit": "normalized"}
        for axis in "xyz":
            label = f"{axis}.position_in_user_coordinates.gaze_point.{side}_eye"
            yield {"label": label, "eye": side, "type": f"Intersection{axis.upper()}", "unit": "mm"}
        yield from flags("gaze_point")
        yield {"label": f"diameter.pupil.{side}_eye", "eye": side, "type": "Diameter", "unit": "mm"}
        yield from flags("pupil")
        for axis in "xyz":
            label = f"{axis}.position_in_user_coordinates.gaze_origin.{side}_eye"
            yield {"label": label, "eye": side, "type": f"Pupil{axis.upper()}", "unit": "mm"}
        yield from flags("gaze_origin")
        yield {"label": f"diameter.eye_openness.{side}_eye", "eye": side, "type": "EyeLidDistance", "unit": "mm"}
        yield from flags("eye_openness")
    yield {"label": "device_time_stamp", "type": "TimeStamp", "unit": "s"}


def eyelink():
    """The ten channels of App-EyeLink, which have no eye and no unit."""
    labels = ["leftEyeX", "leftEyeY", "rightEyeX", "rightEyeY", "leftPupilArea", "rightPupilArea"]
    labels += ["pixelsPerDegreeX", "pixelsPerDegreeY", "eyelink_timestamp", "LSL_timestamp"]
    yield from ({"label": label, "type": "eyetracking"} for label in labels)


def half(point, diameter, origin, valid=1.0):
    """The values of one eye of TittaLSL. The eye openness is not available."""
    return [0.5, 0.5, *point, valid, 1.0, diameter, valid, 1.0, *origin, valid, 1.0, NAN, 0.0, 0.0]


# Name, type, rate, channels and samples of each stream.
STREAMS = {
    "pupil-capture": (
        ("pupil_capture", "Gaze", 0.0, list(pupil_capture())),
        [
            [0.9, 0.5, 0.5, 0, 0, 500, 31, 12, -30, -33, 11, -29, 0.6, 0, 0.8, 0, 0, 1, 40, 41, 3.5, 4.5],
            # Only eye 1, the left one, was seen.
            [0.8, 0.5, 0.5, NAN, NAN, NAN, NAN, NAN, NAN, -33, 11, -29, NAN, NAN, NAN, 0, -0.6, 0.8, NAN, 41, NAN, 4.5],
        ],
    ),
    "lsl-relay": (("Neon Companion_Gaze", "Gaze", 0.0, list(scene_pixels())), [[800.0, 600.0]]),
    "neon": (
        ("Neon Companion_Neon Gaze", "Gaze", 200.0, list(neon())),
        [[800, 600, 4.5, -33, 11, -29, 0, 0, 1, 3.5, 31, 12, -30, 0.6, 0, 0.8]],
    ),
    "titta": (
        ("Tobii_gaze", "Gaze", 600.0, list(titta())),
        [
            [*half((-33, 189, 0), 4.5, (-33, 11, 600)), *half((31, 12, 0), 3.5, (31, 12, 600)), 12.5],
            # The flags of the left eye are not valid, and its numbers are old.
            [*half((-33, 189, 0), 4.5, (-33, 11, 600), 0.0), *half((31, 12, 0), 3.5, (31, 12, 600)), 12.6],
        ],
    ),
    "eyelink": (
        ("EyeLink", "Gaze", 500.0, list(eyelink())),
        [
            [990, 540, 930, 600, 900, 800, 30, 30, 1000, 5.0],
            # The app sends a sample of the tracker twice, and then a blink of the left eye.
            [990, 540, 930, 600, 900, 800, 30, 30, 1000, 5.002],
            [-32768, -32768, 930, 600, 0, 800, 30, 30, 1002, 5.004],
        ],
    ),
}


def info(lsl, key):
    """Describes a stream for an outlet of liblsl."""
    name, kind, rate, channels = STREAMS[key][0]
    made = lsl.StreamInfo(name, kind, len(channels), rate, lsl.cf_double64, f"eyebox-test-{key}")
    described = made.desc().append_child("channels")
    for channel in channels:
        at = described.append_child("channel")
        for field, value in channel.items():
            at.append_child_value(field, value)
    return made


def described(lsl, key):
    """Returns the description that liblsl writes, without the parts that change from run to run."""
    text = info(lsl, key).as_xml()
    for field in ("uid", "created_at", "session_id", "hostname", "version"):
        text = re.sub(rf"<{field}>[^<]*</{field}>", f"<{field}/>", text)
    return re.sub(r">\s+<", "><", text).strip()


def record(lsl):
    """Writes the recorded bytes."""
    recorded = {key: {"description": described(lsl, key), "samples": STREAMS[key][1]} for key in STREAMS}
    RECORDED.write_text(json.dumps(recorded, indent=1) + "\n")


if __name__ == "__main__":
    isolate()
    import pylsl

    record(pylsl)
