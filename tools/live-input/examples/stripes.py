#!/usr/bin/env python3
"""Stripes that move, as two layers: examples/stripes.py NAME [FRAMES]"""

import os, sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
import eyebox_live


def picture(live, seconds):
    """The far layer is grey and opaque; the near one has bright stripes with nothing between."""
    far = bytes([64] * live.channels + [255]) * (live.rows * live.columns)
    row = b"".join(bytes([255] * (live.channels + 1)) if (column + int(20 * seconds)) // 8 % 2 else bytes(live.channels + 1) for column in range(live.columns))
    return far + row * live.rows


def main():
    left = int(sys.argv[2]) if len(sys.argv) > 2 else -1
    with eyebox_live.Live(sys.argv[1]) as live:
        # The near one moves by 4 pixels before the far one, seen from one side of the eyebox and from the other.
        near = 4 * live.pixel_angle / (live.eyebox_mm[0] * 1e-3)
        while left:
            if request := live.wait(1.0):
                live.send(live.layers([0.0, near]), picture(live, request.lit_ns / 1e9), request=request)
                left -= 1


try:
    main()
except eyebox_live.LiveError as error:
    sys.exit(f"stripes: {error}")
