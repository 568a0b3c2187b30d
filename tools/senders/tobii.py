#!/usr/bin/env python3
"""Sends what a Tobii Pro eye tracker measures to eyebox (pip install tobii-research).

Written after the SDK's documentation; never run on a tracker. Try the way without one: tobii.py --simulate
"""

import threading
from sender import Sender, arguments, gaze, simulate


def eye(data, side):
    """One eye of the SDK's gaze data. Its axes: to the right and up as the user sees it, and towards the user; mm."""
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
