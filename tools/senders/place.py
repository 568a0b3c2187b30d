"""Places pupils in front of displays, for trackers that measure eyes in space.

The tracker's frame has its axes to the right, down and forward, as seen from the eyes, in millimeters. Each eye has its
own display. The frame of a display has its origin at the center of the eyebox and the same axes. The plane of the pupil
is its plane z = 0, and a pupil is projected onto this plane along z.
"""

import argparse, math, statistics
from sender import gaze, pupil

# The eye model of pye3d (Pupil Labs) has the pupil at this distance from the center of the eyeball.
RADIUS_MM = 10.4
# Number of samples of an eye from which its usual place is printed.
PLACES = 200


def numbers(text, *counts):
    """Reads numbers with commas between them, for argparse."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts or not all(map(math.isfinite, values)):
        raise argparse.ArgumentTypeError(f"'{text}' has to be {' or '.join(map(str, counts))} numbers with commas")
    return values


class Display:
    """The pose of a display in the tracker's frame.

    X, Y and Z are the center of the eyebox. RX, RY and RZ are degrees. The display first turns to the right by RY, then
    up by RX about its own axis, then clockwise by RZ about its own axis.
    """

    def __init__(self, text):
        *self.center, rx, ry, rz = (numbers(text, 3, 6) + [0.0] * 3)[:6]
        (sx, cx), (sy, cy), (sz, cz) = ((math.sin(a), math.cos(a)) for a in map(math.radians, (rx, ry, rz)))
        # The columns of Ry Rx Rz are the axes of the display in the tracker's frame.
        self.axes = [
            (cy * cz + sy * sx * sz, cx * sz, -sy * cz + cy * sx * sz),
            (-cy * sz + sy * sx * cz, cx * cz, sy * sz + cy * sx * cz),
            (sy * cx, -sx, cy * cx),
        ]

    def inside(self, point):
        """Returns a point of the tracker's frame in the frame of the display."""
        offset = [a - b for a, b in zip(point, self.center)]
        return [sum(a * b for a, b in zip(axis, offset)) for axis in self.axes]


def add_arguments(parser):
    """Adds the poses of the displays to a parser."""
    for side in ("left", "right"):
        about = f"display of the {side} eye in the tracker's frame, mm and degrees (write --{side}=-31,12,-33)"
        parser.add_argument(f"--{side}", type=Display, metavar="X,Y,Z[,RX,RY,RZ]", help=about)
    about = "distance from the center of the eyeball to the pupil"
    parser.add_argument("--radius", type=float, default=RADIUS_MM, metavar="MM", help=f"{about} [default: {RADIUS_MM}]")
    about = "print the usual places of the pupils in the tracker's frame as poses of displays, and stop"
    parser.add_argument("--where", action="store_true", help=about)


def finite(values):
    """Returns true if all values are numbers."""
    return values is not None and all(map(math.isfinite, values))


class Eyes:
    """Describes eyes for eyebox, as pupils in front of the displays, or as directions if no display is stated."""

    def __init__(self, args):
        self.displays = {side: display for side in ("left", "right") if (display := getattr(args, side))}
        self.radius = args.radius
        self.places = {"left": [], "right": []} if args.where else None

    def ball(self, side, center, axis, valid=True, diameter=None):
        """Describes an eye by the center of its ball and its optical axis, a vector of any length."""
        length = math.hypot(*axis)
        valid = valid and finite(center) and math.isfinite(length) and length > 0
        place = [c + self.radius * a / length for c, a in zip(center, axis)] if valid else None
        return self.eye(side, place, axis, valid, diameter)

    def eye(self, side, place, direction, valid=True, diameter=None):
        """Describes an eye by the place of its pupil or by its direction. The other one may be None.

        Returns None for an eye without a display, if the other eye has one.
        """
        diameter = diameter if diameter is not None and math.isfinite(diameter) else None
        if self.places is not None:
            self.count(side, place if valid else None)
        if not self.displays:
            valid = valid and finite(direction)
            right, down, forward = direction if valid else (0, 0, 0)
            return gaze((right, -down, forward), valid, diameter)
        if side not in self.displays:
            return None
        valid = valid and finite(place)
        return pupil(self.displays[side].inside(place)[:2] if valid else None, valid, diameter)

    def count(self, side, place):
        """Collects places, and ends the program with the usual ones."""
        if finite(place):
            self.places[side].append(place)
        if max(map(len, self.places.values())) == PLACES:
            seen = {side: places for side, places in self.places.items() if len(places) > PLACES // 2}
            usual = {side: [statistics.median(axis) for axis in zip(*places)] for side, places in seen.items()}
            print(*(f"--{side}={','.join(f'{v:.2f}' for v in place)}" for side, place in usual.items()))
            raise SystemExit(0)
