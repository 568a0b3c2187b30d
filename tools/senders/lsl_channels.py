"""Finds the eyes in the channels of a Lab Streaming Layer stream, by label, type and eye.

The layouts follow the code and the documents of their makers. Pupil Capture's plugin (App-PupilLabs) has the center and
the normal of each eye, in the frame of the scene camera. The app of Neon has the center of each eyeball and its optical
axis in the same frame, if it computes the eye state. TittaLSL (Tobii Pro) has the place of each pupil and its gaze
point, in the tracker's frame, with flags. App-EyeLink has the gaze in pixels of the screen, and pixels per degree.

Lengths without a unit are in millimeters. NaN is an unknown value.
"""

import math, re
import xml.etree.ElementTree as ElementTree
from place import finite

SIDES = ("left", "right")
# Pupil Labs numbers the eyes, and eye 0 is the right one.
NUMBERS = {"0": "right", "1": "left"}
LENGTHS_MM = {"": 1, "mm": 1, "millimeter": 1, "millimeters": 1, "m": 1e3, "meter": 1e3, "meters": 1e3}
XYZ = r"(?P<axis>[xyz])"
SIDE = r"(?P<side>left|right)"
# Each quantity has its label, the types that makers give it (None accepts all), and whether it is a length.
QUANTITIES = [
    ("center", rf"eye_center(?P<number>[01])_3d_{XYZ}", r"position[xyz]", True),
    ("center", rf"eyeballcenter{XYZ}", None, True),
    ("axis", rf"gaze_normal(?P<number>[01])_{XYZ}", r"position[xyz]", False),
    ("axis", rf"opticalaxis{XYZ}", None, False),
    ("place", rf"{XYZ}\.position_in_user_coordinates\.gaze_origin\.{SIDE}_eye", r"pupil[xyz]", True),
    ("point", rf"{XYZ}\.position_in_user_coordinates\.gaze_point\.{SIDE}_eye", r"intersection[xyz]", True),
    ("place_flag", rf"(?P<axis>valid|available)\.gaze_origin\.{SIDE}_eye", r"(valid|available)flag", False),
    ("point_flag", rf"(?P<axis>valid|available)\.gaze_point\.{SIDE}_eye", r"(valid|available)flag", False),
    ("diameter_flag", rf"(?P<axis>valid|available)\.pupil\.{SIDE}_eye", r"(valid|available)flag", False),
    ("diameter", r"diameter(?P<number>[01])_3d", r"diameter", True),
    ("diameter", r"pupildiameter", None, True),
    ("diameter", rf"diameter\.pupil\.{SIDE}_eye", r"diameter", True),
    ("confidence", r"confidence", r"confidence", False),
    ("pixel", rf"{SIDE}eye(?P<axis>[xy])", r"eyetracking", False),
    ("area", rf"{SIDE}pupilarea", r"eyetracking", False),
    ("density", r"pixelsperdegree(?P<axis>[xy])", r"eyetracking", False),
    ("tick", r"eyelink_timestamp", r"eyetracking", False),
    ("scene", r"(?P<axis>[xy])", r"screen[xy]", False),
]


class Unusable(Exception):
    """A stream that does not give what eyebox needs, with the missing part."""


class Channels:
    """The channels of a stream by quantity, eye and axis, as (index, scale)."""

    def __init__(self, description):
        """Reads the description of a stream, which is XML as liblsl writes it."""
        self.found, self.labels, self.other_units = {}, [], []
        stream = ElementTree.fromstring(description)
        channels, count = stream.findall("./desc/channels/channel"), int(stream.findtext("channel_count"))
        if len(channels) != count and channels:
            raise Unusable(f"it describes {len(channels)} channels, but it has {count}")
        if stream.findtext("channel_format") == "string":
            raise Unusable("its samples are text")
        for index, channel in enumerate(channels):
            text = {key: (channel.findtext(key) or "").strip() for key in ("label", "eye", "type", "metatype", "unit")}
            self.labels.append(text["label"])
            self.add(index, {key: value.lower() for key, value in text.items()})

    def add(self, index, text):
        """Adds one channel, if its label and its type belong to a known quantity."""
        for quantity, label, kind, is_length in QUANTITIES:
            match = re.fullmatch(label, text["label"])
            stated = text["type"] or text["metatype"]
            if not match or (kind and stated and not re.fullmatch(kind, stated)):
                continue
            scale = LENGTHS_MM.get(text["unit"]) if is_length else 1
            if scale is None:
                return self.other_units.append(f"{text['label']} in {text['unit']}")
            groups = match.groupdict()
            side = groups.get("side") or NUMBERS.get(groups.get("number"))
            stated = text["eye"] if text["eye"] in SIDES else None
            if side and stated and side != stated:
                raise Unusable(f"channel {text['label']} is of the {side} eye, but its description has eye '{stated}'")
            key = (quantity, side or stated, groups.get("axis"))
            if key in self.found:
                raise Unusable(f"two channels have label {text['label']} and eye '{text['eye']}'")
            self.found[key] = (index, scale)
            return None
        return None

    def has(self, quantity, side, axes):
        """Returns true if all these axes of a quantity are there."""
        return all((quantity, side, axis) in self.found for axis in axes)

    def read(self, values, quantity, side, axes="xyz"):
        """Returns these axes of a quantity, in millimeters if it is a length."""
        at = (self.found[quantity, side, axis] for axis in axes)
        return [values[index] * scale for index, scale in at]

    def one(self, values, quantity, side=None, axis=None):
        """Returns one value, or None if the stream does not have it or if it is NaN."""
        if (quantity, side, axis) not in self.found:
            return None
        index, scale = self.found[quantity, side, axis]
        return None if math.isnan(values[index]) else values[index] * scale

    def flagged(self, values, quantity, side):
        """Returns true unless a flag of the quantity states that it is not valid or not available."""
        flags = (self.one(values, f"{quantity}_flag", side, flag) for flag in ("valid", "available"))
        return all(flag is None or flag != 0 for flag in flags)


class Balls:
    """Eyes with center and axis, as Pupil Capture and Neon send them. The axes are right, down, forward."""

    def __init__(self, channels, eyes):
        self.channels, self.eyes = channels, eyes
        self.sides = [s for s in SIDES if channels.has("center", s, "xyz") and channels.has("axis", s, "xyz")]

    def sample(self, values):
        """Describes the eyes of one sample."""
        read, found = self.channels.read, {}
        for side in self.sides:
            center, axis = read(values, "center", side), read(values, "axis", side)
            found[side] = self.eyes.ball(side, center, axis, True, self.channels.one(values, "diameter", side))
        return found


class Pupils:
    """Eyes with the place of the pupil and a gaze point, as TittaLSL sends them.

    Tobii's axes are right and up, and towards the user.
    """

    def __init__(self, channels, eyes):
        self.channels, self.eyes = channels, eyes
        # A display needs only the place, and a direction also needs the gaze point.
        self.quantities = ("place",) if eyes.displays else ("place", "point")
        self.sides = [s for s in SIDES if all(channels.has(q, s, "xyz") for q in self.quantities)]

    def sample(self, values):
        """Describes the eyes of one sample."""
        found = {}
        for side in self.sides:
            valid = all(self.channels.flagged(values, q, side) for q in self.quantities)
            turned = [self.channels.read(values, q, side) for q in self.quantities]
            place, *point = [(x, -y, -z) for x, y, z in turned]
            direction = [b - a for a, b in zip(place, point[0])] if point else None
            seen = self.channels.flagged(values, "diameter", side)
            diameter = self.channels.one(values, "diameter", side) if seen else None
            found[side] = self.eyes.eye(side, place, direction, valid, diameter)
        return found


class Pixels:
    """Eyes with a gaze in pixels of the screen, as App-EyeLink sends them. A pixel is straight ahead."""

    def __init__(self, channels, eyes, straight):
        self.channels, self.eyes, self.straight, self.tick = channels, eyes, straight, None
        self.sides = [s for s in SIDES if channels.has("pixel", s, "xy") and channels.has("density", None, "xy")]

    def sample(self, values):
        """Describes the eyes of one sample. The app may send a sample of the tracker several times."""
        tick = self.channels.one(values, "tick")
        if tick is not None and tick == self.tick:
            return {}
        self.tick, found = tick, {}
        density = self.channels.read(values, "density", None, "xy")
        for side in self.sides:
            pixel = self.channels.read(values, "pixel", side, "xy")
            # The tracker reports a missing eye by an area of 0.
            valid = self.channels.one(values, "area", side) != 0 and finite(pixel) and min(density) > 0
            angles = [math.radians((p - s) / d) for p, s, d in zip(pixel, self.straight, density)] if valid else None
            direction = [math.tan(angles[0]), math.tan(angles[1]), 1] if valid else None
            found[side] = self.eyes.eye(side, None, direction, valid)
        return found


def layout(description, eyes, straight=None):
    """Returns the layout of a stream, whose `sample` describes the eyes of one sample.

    Raises Unusable if the stream does not give what eyebox needs.
    """
    channels = Channels(description)
    balls, pupils, pixels = Balls(channels, eyes), Pupils(channels, eyes), Pixels(channels, eyes, straight)
    wanted = list(eyes.displays) or SIDES
    for found in (balls, pupils):
        if any(side in found.sides for side in wanted):
            return found
        if found.sides:
            raise Unusable(f"it has the {found.sides[0]} eye only, but the display is the other eye's")
    if pixels.sides and eyes.displays:
        raise Unusable("it has directions of gaze and no places of eyes, so --left and --right need another stream")
    if pixels.sides and straight is None:
        raise Unusable("its gaze is in pixels of the screen: state the pixel straight ahead with --straight X,Y")
    if pixels.sides:
        return pixels
    if channels.has("scene", None, "xy"):
        need = "eyebox needs the center and axis of each eye (for Neon: turn on the eye state in its app)"
        raise Unusable(f"it has the gaze in pixels of the scene camera only, and {need}")
    labels = ", ".join(channels.labels[:8]) or "none with a label"
    units = f" ({', '.join(channels.other_units[:3])})" if channels.other_units else ""
    raise Unusable(f"no channel has an eye's center and axis, or place and gaze point: it has {labels}{units}")
