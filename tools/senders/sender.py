"""Sends samples to eyebox as lines of JSON in UDP datagrams, for all senders in this folder.

docs/trackers.md defines the keys. Angles are in degrees, to the right and down, as seen from the eye. Diameters are in
millimeters. The focus of the eyes, focus_d, is in dioptres (1 / meters).
"""

import argparse, json, math, socket, statistics, sys, time


def arguments(about, add=None):
    """Reads the command line. All senders share these arguments, and `add` adds others to the parser."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--to", default="127.0.0.1:9123", metavar="HOST:PORT", help="where eyebox listens")
    parser.add_argument("--simulate", action="store_true", help="send a simulated eye, without the tracker's software")
    parser.add_argument("--count", type=int, default=0, metavar="N", help="stop after N samples")
    if add:
        add(parser)
    return parser.parse_args()


class Sender:
    """Sends samples to eyebox."""

    def __init__(self, args):
        host, port = args.to.rsplit(":", 1)
        self.socket, self.to = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), (host, int(port))
        self.left = args.count or math.inf

    def send(self, sample):
        """Sends one sample. Returns False once all requested samples are sent."""
        self.socket.sendto(json.dumps(sample).encode(), self.to)
        self.left -= 1
        return self.left > 0


class Age:
    """Prints once how old samples are when they are sent. Their times have to be on a clock of this computer."""

    def __init__(self, name, samples=200):
        self.name, self.samples, self.ages = name, samples, []

    def add(self, seconds):
        """Counts the age of one sample, seconds."""
        if len(self.ages) == self.samples:
            return
        self.ages.append(seconds)
        if len(self.ages) == self.samples:
            median = statistics.median(self.ages)
            # Other ages show that the times belong to another clock.
            if 0 <= median < 1:
                text = f"{1e3 * median:.1f} ms old when they are sent, a part of eyebox's --tracker-latency"
                print(f"{self.name}: samples are {text}", file=sys.stderr)


def gaze(direction, valid=True, diameter=None):
    """Describes one eye that looks along (right, up, forward), a vector of any length."""
    right, up, forward = direction
    eye = {"what": "gaze", "unit": "deg", "valid": bool(valid and forward > 0)}
    if eye["valid"]:
        eye["x"], eye["y"] = math.degrees(math.atan2(right, forward)), math.degrees(math.atan2(-up, forward))
    if diameter is not None and diameter > 0:
        eye["diameter"] = diameter
    return eye


def pupil(position, valid=True, diameter=None):
    """Describes one eye whose pupil is at (right, down), mm from the center of the eyebox."""
    eye = {"what": "pupil", "unit": "mm", "valid": bool(valid)}
    if eye["valid"]:
        eye["x"], eye["y"] = position
    if diameter is not None and diameter > 0:
        eye["diameter"] = diameter
    return eye


def simulate(send, both=True):
    """Sends an eye that looks around at 1 dioptre, 100 times per second."""
    begun = time.monotonic()
    while True:
        now = time.monotonic()
        x, y = 0.1 * math.sin(now - begun), 0.05 * math.sin(2 * (now - begun))
        half = 0.063 / 2
        eyes = {"left": gaze((x + half, y, 1), True, 4.0), "right": gaze((x - half, y, 1), True, 4.0)}
        sample = {"t": now, "focus_d": 1.0, **(eyes if both else gaze((x, y, 1)))}
        if not send(sample):
            return
        time.sleep(0.01)
