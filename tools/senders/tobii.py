#!/usr/bin/env python3
"""Sends the samples of a Tobii Pro eye tracker to eyebox (pip install tobii-research).

The program follows the SDK's documentation and is not yet tested on a tracker. Run tobii.py --simulate to test the
connection without one.
"""

import threading
from sender import Sender, arguments, gaze, simulate


def eye(data, side):
    """Converts one eye of the SDK's gaze data.

    The SDK's axes are right and up as the user sees them, and towards the user, in mm.
    """
    valid = data[f"{side}_gaze_origin_validity"] and data[f"{side}_gaze_point_validity"]
    origin, point = (data[f"{side}_gaze_{what}_in_user_coordinate_system"] for what in ("origin", "point"))
    x, y, z = (b - a for a, b in zip(origin, point))
    diameter = data[f"{side}_pupil_diameter"] if data[f"{side}_pupil_validity"] else None
    return gaze((x, y, -z), valid, diameter)


def main():
    args = arguments(__doc__)
    sender = Sender(args)
    if args.simulate:
        return simulate(sender.send)
    import tobii_research

    found = tobii_research.find_all_eyetrackers()
    if not found:
        raise SystemExit("tobii: no eye tracker was found")
    done = threading.Event()

    def take(data):
        sample = {"t": data["device_time_stamp"] * 1e-6, "left": eye(data, "left"), "right": eye(data, "right")}
        if not sender.send(sample):
            done.set()

    found[0].subscribe_to(tobii_research.EYETRACKER_GAZE_DATA, take, as_dictionary=True)
    try:
        done.wait()
    finally:
        found[0].unsubscribe_from(tobii_research.EYETRACKER_GAZE_DATA, take)


if __name__ == "__main__":
    main()
