#!/usr/bin/env python3
"""Sends stripes that move, as two layers (run examples/stripes.py NAME [FRAMES])."""

import os, sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
import eyebox_live


def picture(live, seconds):
    """Returns an opaque gray layer and a near layer of bright stripes, which is clear between them."""
    far = bytes([64] * live.channels + [255]) * (live.rows * live.columns)
    row = b"".join(bytes([255] * (live.channels + 1)) if (column + int(20 * seconds)) // 8 % 2 else bytes(live.channels + 1) for column in range(live.columns))
    return far + row * live.rows


def main():
    left = int(sys.argv[2]) if len(sys.argv) > 2 else -1
    with eyebox_live.Live(sys.argv[1]) as live:
        # The near layer moves by 4 pixels against the far one between the two sides of the eyebox.
        near = 4 * live.pixel_angle / (live.eyebox_mm[0] * 1e-3)
        while left:
            if request := live.wait(1.0):
                live.send(live.layers([0.0, near]), picture(live, request.lit_ns / 1e9), request=request)
                left -= 1


try:
    main()
except eyebox_live.LiveError as error:
    sys.exit(f"stripes: {error}")
