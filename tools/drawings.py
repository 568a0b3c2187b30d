#!/usr/bin/env python3
"""Writes the six drawings of the optics pages to docs/concepts.

With `--check`, it writes nothing and fails if a checked-in drawing differs from the one that it would write.
Rays, overlaps and shifts are computed from the equations of docs/optics, so the pictures follow the same signs.
"""

import math
import sys
from pathlib import Path

from drawings_canvas import WIDTH, Drawing, eye, scene

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "concepts"


def display():
    out = Drawing("display", 385, "SLM, relay, eyebox and pupil",
                  "Side view. Light that leaves all pixels of the SLM in one direction meets at one place in the "
                  "pupil plane. The pupil passes the light around its center s. The steepest direction meets at the "
                  "edge of the eyebox.")
    slm, lens, plane, axis = 96, 290, 484, 168
    f, half_eyebox, half_pupil, s = lens - slm, 72, 17, 30
    out.path([(20, axis), (plane + 130, axis)], width=0.7, dashed=True)
    for y in (-36, -12, 12, 36):
        out.arrow((26, axis + y), (slm - 14, axis + y), "green")
    out.text(52, axis - 58, "laser", "green")
    for i in range(12):
        out.rectangle(slm - 8, axis - 54 + 9 * i, 8, 9, "ink", "soft", line=0.8)
    out.lens(lens, axis, 118)
    retina = eye(out, (plane, axis + s), half_pupil, 118)
    # A ray that leaves the SLM at the height y in the direction q reaches the lens at y + f slope. It reaches the pupil
    # plane at f slope = lambda f q, for any y. Behind the center of the pupil it continues straight.
    for y in (-36, 0, 36):
        out.path([(slm, axis + y), (lens, axis + y - half_eyebox), (plane, axis - half_eyebox)], "orange", 1.2, True)
        out.path([(slm, axis + y), (lens, axis + y + s), (plane, axis + s), retina(-y / f)], "blue", 1.8)
    for ends in ((-118, s - half_pupil * 1.9), (s + half_pupil * 1.9, 118)):
        out.path([(plane, axis + y) for y in ends], width=1, dashed=True)
    out.arrow((plane - 22, axis - half_eyebox), (plane - 22, axis + half_eyebox), "orange", 1.5, True)
    out.path([(plane - 7, axis - half_eyebox), (plane + 5, axis - half_eyebox)], "orange", 4)
    out.text(plane - 12, axis + half_eyebox + 20, "eyebox\nw = λf / p", "orange", "end")
    out.text(plane + 10, axis - half_eyebox - 6, "steepest direction,\nq = 1 / (2p)", "orange", "start")
    out.arrow((plane + 18, axis), (plane + 18, axis + s), "blue")
    out.text(plane + 30, axis + 19, "s", "blue")
    out.text(plane + 128, axis + 16, "pupil:\ncenter s,\ndiameter d", "blue", "start")
    out.text(slm - 2, axis + 76, "SLM,\npitch p")
    out.text(lens + 6, axis - 130, "last lens of the relay")
    out.text(plane + 20, axis - 130, "pupil plane")
    out.text(20, 26, "one direction q at the SLM\nis one place λf q\nin the pupil plane", "blue", "start")
    level = axis + 134
    for a, b in ((slm, lens), (lens, plane)):
        out.arrow((a + 3, level), (b - 3, level), both=True)
        out.text((a + b) / 2, level + 18, "f")
    level += 44
    out.path([(slm, level - 10), (slm, level + 6)])
    out.arrow((slm, level - 2), (slm + 56, level - 2))
    out.text(slm + 64, level + 3, "depth z: 0 at the SLM (or its image), positive nearer to the eye.\n"
             "Content at z appears at the distance f² / z from the eye.", anchor="start")
    return out


def pupil():
    out = Drawing("pupil", 348, "The pupil as a disc of the spectrum",
                  "Left: eyeboxes of three colors in the pupil plane, and a pupil of 4 mm. Middle: the spectrum in "
                  "green, with the pupil as a disc and a window around it. Right: the transform of the window is the "
                  "image on a coarser grid.")
    side, top, gap, left = 200, 44, 46, 14
    f, p, bins = 0.4, 8e-6, 256
    place, diameter = (0.006, -0.004), 0.004
    columns = [left + i * (side + gap) for i in range(3)]
    below = top + side + 24
    # Left: 33 mm of the pupil plane fill the side.
    scale = side / 0.033
    cx, cy = columns[0] + side / 2, top + side / 2
    for i, (hue, wavelength) in enumerate((("red", 660e-9), ("green", 520e-9), ("blue", 440e-9))):
        eyebox = wavelength * f / p
        w = eyebox * scale
        out.rectangle(cx - w / 2, cy - w / 2, w, w, hue)
        out.text(cx, below + 18 * i, f"{wavelength * 1e9:.0f} nm: eyebox {eyebox * 1e3:.0f} mm", hue)
    out.text(cx, below + 54, "f = 400 mm, p = 8 µm")
    spot = cx + place[0] * scale, cy + place[1] * scale
    out.arrow((cx, cy), spot, width=1.2)
    out.circle(*spot, diameter / 2 * scale, "ink", "soft")
    out.text(cx + 14, cy - 16, "s")
    out.text(spot[0] - 14, spot[1] - 17, "d = 4 mm")
    # Middle: the spectrum of one color.
    wavelength = 520e-9
    unit = side / bins
    per_meter = bins * p / (wavelength * f)
    mx, my = columns[1] + side / 2, top + side / 2
    out.rectangle(columns[1], top, side, side, "green", "soft", 0.1)
    middle = (mx + place[0] * per_meter * unit, my + place[1] * per_meter * unit)
    disc = diameter * per_meter
    half = disc * unit
    out.rectangle(middle[0] - half, middle[1] - half, 2 * half, 2 * half, "orange", dashed=True, line=2)
    out.circle(*middle, disc / 2 * unit, "green", "soft")
    out.path([(mx - 6, my), (mx + 6, my)])
    out.path([(mx, my - 6), (mx, my + 6)])
    out.text(mx - 12, my + 5, "q = 0", anchor="end")
    out.text(middle[0], middle[1] + half + 18, "window,\nM x M bins", "orange")
    out.text(columns[1] + 6, top + side - 8, "N x N bins", "green", "start")
    out.text(mx, below, "A place X is the bin q = X / (λf).\nThe disc is dNp / (λf) bins wide.\n"
             "K is zero outside of it.")
    # Right: the image has the same width, and as many samples as the window has bins.
    scene(out, columns[2], top, side, [(0, 0, 0.55)], [(0, 0, 0.55)])
    step, count = side / (2 * disc), 20
    x1, y1 = columns[2] + side, top + side
    for i in range(count + 1):
        out.path([(x1 - i * step, y1 - count * step), (x1 - i * step, y1)], "orange", 0.5)
        out.path([(x1 - count * step, y1 - i * step), (x1, y1 - i * step)], "orange", 0.5)
    out.text(x1 - count * step - 6, y1 - 8, "samples", "orange", "end")
    out.text(columns[2] + side / 2, below, "Inverse transform of K times\nthe window, M x M samples.\n"
             "If M is twice the disc, they\nhold all of the intensity.")
    for x, heading in zip(columns, ("Pupil plane", "Spectrum, green", "Image through the pupil"), strict=True):
        out.text(x + side / 2, top - 16, heading, bold=True)
        if x > left:
            out.arrow((x - gap + 7, cy), (x - 7, cy))
    return out


def coverage(center, radius, column, row):
    """The share of a unit cell, centered on (column, row), that is inside a disc."""
    steps = 40
    places = [(i + 0.5) / steps - 0.5 for i in range(steps)]
    inside = sum(math.hypot(column + x - center[0], row + y - center[1]) < radius for x in places for y in places)
    return inside / steps**2


def light_field():
    out = Drawing("light-field", 326, "From views to a target image",
                  "Left: views on a grid of cells, and a pupil that covers some in part. Middle: a near triangle "
                  "moves against the position of the view. Right: the sum of shifted views, sharp at the triangle "
                  "and blurred at a circle behind it.")
    cell, top, left = 40, 44, 14
    center, radius = (0.45, -0.3), 1.35
    shares = {}
    for row in range(-2, 3):
        for column in range(-2, 3):
            share = coverage(center, radius, column, row)
            x, y = left + (column + 2) * cell, top + (row + 2) * cell
            if share:
                shares[column, row] = share
                out.rectangle(x, y, cell, cell, "blue", "full", 0.6 * share, line=0)
            out.rectangle(x, y, cell, cell, line=0.8)
            out.circle(x + cell / 2, y + cell / 2, 1.6, fill="full", width=0)
    middle = left + 2.5 * cell, top + 2.5 * cell
    out.circle(middle[0] + center[0] * cell, middle[1] + center[1] * cell, radius * cell, "blue", width=2.5)
    out.bracket(left, left + cell, top + 5 * cell + 4)
    out.text(left + cell / 2, top + 5 * cell + 26, "c")
    out.text(left + 46, top + 5 * cell + 26, "One view for each cell.\nIts weight C is the share\n"
             "of the cell in the pupil.", anchor="start")
    # Content at depth z0 is displaced by (z - z0) q / f. A view has z = 0, so the triangle moves by -z0 q / f.
    shift, size, gap, x1 = 7, 61, 8, 268
    for i, column in enumerate((-1, 0, 1)):
        y = top + i * (size + gap)
        scene(out, x1, y, size, [(0, 0, 0.9)], [(-shift * column, 0, 0.9)])
        out.text(x1 + size + 8, y + size / 2 + 5, ("q = −c", "q = 0", "q = +c")[i], anchor="start")
    out.text(x1 - 14, top + 5 * cell + 26, "The near triangle\nmoves against q.", anchor="start")
    # The target adds the views by their shares, each shifted by z q / f with z = z0, so the circle moves by z0 q / f.
    large = 200
    x2, total = WIDTH - large - 14, sum(shares.values())
    enlarged = shift * large / size
    # The factor 1.6 makes up for copies that hide each other instead of adding up.
    copies = [(enlarged * column, enlarged * row, 1.6 * share / total) for (column, row), share in shares.items()]
    scene(out, x2, top, large, copies, [(0, 0, 0.9)])
    out.text(x2 + large / 2, top + 5 * cell + 26, "Focus z on the triangle.\nIt is sharp, and the circle\nis blurred.")
    out.arrow((x2 - 92, top + large / 2 + 34), (x2 - 8, top + large / 2 + 34))
    out.text(x2 - 50, top + large / 2 - 30, "sum of\nC × view,\nshifted by\nz q / f", "blue")
    for x, heading in ((left + 2.5 * cell, "Pupil plane"), (x1 + size / 2 + 18, "Views, focus z = 0"),
                       (x2 + large / 2, "Target image")):
        out.text(x, top - 16, heading, bold=True)
    return out


def sub_frames():
    out = Drawing("sub-frames", 424, "Sub-frames, multiplex sets and rolling updates",
                  "Three strips of time. A video frame of planes24 holds a whole set. A set of grey8 takes eight "
                  "video frames, and a movement of the eye takes effect with the next set. With a rolling update it "
                  "takes effect with the next video frame.")
    left, length = 14, 692
    top = 44
    out.text(left, top - 16, "planes24: one video frame is one set of 3 x 8 sub-frames", anchor="start", bold=True)
    frame = length / 3
    for k in range(3):
        for n in range(24):
            hue = ("red", "green", "blue")[n // 8]
            out.rectangle(left + k * frame + n * frame / 24, top, frame / 24, 30, hue, "soft", line=0.7)
        for c, hue in enumerate(("red", "green", "blue")):
            out.text(left + k * frame + (c + 0.5) * frame / 3, top + 48, f"8 {hue}", hue)
        out.bracket(left + k * frame + 2, left + (k + 1) * frame - 2, top + 56)
        out.text(left + (k + 0.5) * frame, top + 79, "video frame = set")
    cell, count = length / 18, 18
    moved = 4
    for top, heading, first in ((176, "grey8, one color: a set of 8 sub-frames is 8 video frames", 8),
                                (296, "grey8 with a rolling update", moved)):
        out.text(left, top - 16, heading, anchor="start", bold=True)
        for n in range(count):
            new = n >= first
            out.rectangle(left + n * cell, top, cell, 30, "blue" if new else "ink", "soft", 0.3 if new else 0.08)
            out.text(left + (n + 0.5) * cell, top + 20, str(n % 8 + 1), "blue" if new else "ink")
    for k in range(2):
        out.bracket(left + 8 * k * cell + 2, left + 8 * (k + 1) * cell - 2, 176 + 36)
        out.text(left + (8 * k + 4) * cell, 176 + 59, f"set {k + 1}")
    for a, row in ((2, 0), (7, 1)):
        out.bracket(left + a * cell + 2, left + (a + 8) * cell - 2, 296 + 36 + 10 * row, "orange")
    out.text(left + length, 296 + 72, "The eye sums any 8 in a row.", "orange", "end")
    x = left + moved * cell
    for top, length_below in ((176, 42), (296, 60)):
        out.path([(x, top - 8), (x, top + length_below)], "orange", 2.5, True)
    out.text(x + 6, 296 + 72, "The eye moves here.", "orange", "start")
    out.rectangle(left, 296 + 97, 18, 18, "ink", "soft", 0.08)
    out.text(left + 26, 296 + 111, "refined for the old position", anchor="start")
    out.rectangle(left + 260, 296 + 97, 18, 18, "blue", "soft", 0.3)
    out.text(left + 286, 296 + 111, "for the new position (computing time left out)", "blue", "start")
    return out


def session():
    out = Drawing("session", 384, "The refinement loop of a session and its times",
                  "Samples of the tracker are filtered. Refinement requests a prediction before each round of steps. "
                  "The set is then encoded and shown. The prediction is for the middle of its light. Seven stages "
                  "add up to the time from the sample to the light.")
    left, right = 96, 706
    # Each sample is filtered before the next one arrives. The last request uses the newest filtered sample.
    sample, arrival, filtered, request, refined, encoded, shown, light = 246, 276, 296, 318, 410, 474, 512, 608
    rows = {"tracker": 66, "gaze": 120, "refine": 186, "present": 252}
    for name, y in rows.items():
        out.text(10, y + 5, name, anchor="start", bold=True)
        out.path([(left, y + 16), (right, y + 16)], width=0.6)
    # Samples come at a regular rate, and each arrives after the delay of the tracker.
    for x in range(126, 660, 30):
        radius, hue, width = (5, "blue", 1.8) if x == sample else (3.5, "ink", 0.7)
        out.circle(x, rows["tracker"] + 6, radius, hue, "full", 0)
        out.arrow((x + 2, rows["tracker"] + 12), (x + arrival - sample, rows["gaze"] - 9), hue, width)
        out.rectangle(x + arrival - sample, rows["gaze"] - 8, filtered - arrival, 16, hue, "soft", line=0.8)
    # A round begins with a request of the prediction.
    y = rows["refine"]
    rounds = ((120, 214, "steps"), (219, 313, "steps"), (request, refined, "steps"), (480, 574, "next set"),
              (579, 673, ""))
    for start, end, words in rounds:
        hue, width = ("blue", 1.8) if start == request else ("ink", 1)
        out.rectangle(start, y - 14, end - start, 28, hue, "soft")
        out.text((start + end) / 2, y + 5, words, hue)
        out.arrow((start + 3, y - 16), (start + 3, rows["gaze"] + 18), hue, width, True)
    out.rectangle(refined, y - 14, encoded - refined, 28, "green", "soft")
    out.text((refined + encoded) / 2, y + 5, "encode", "green")
    frame = 2 * (light - shown)
    for k, words in ((-2, "video frame"), (-1, "set before"), (0, "this set")):
        hue = "ink" if k else "blue"
        out.rectangle(shown + k * frame, rows["present"] - 14, frame, 28, hue, "soft")
        out.text(shown + k * frame + 48, rows["present"] + 5, words, hue)
    out.arrow((encoded, y + 16), (shown - 2, rows["present"] - 15), "green")
    out.path([(light, 34), (light, rows["present"] + 44)], "orange", 2, True)
    out.text(right, 24, "The prediction is for the middle of the light of this set.", "orange", "end")
    edges = [sample, arrival, filtered, request, refined, encoded, shown, light]
    level = rows["present"] + 44
    for n, (a, b) in enumerate(zip(edges, edges[1:], strict=False), 1):
        out.bracket(a + 1, b - 1, level, "blue")
        out.text((a + b) / 2, level + 24, str(n), "blue", bold=True)
    out.text(14, level + 54, "1 tracker,  2 filter,  3 waiting,  4 refinement,  5 encoding,  6 hand-over,  7 display.\n"
             "The sum is the time from the sample to the light.", "blue", "start")
    return out


def far_field():
    out = Drawing("far-field", 366, "The far field",
                  "Left: a pupil covers a disc of the pixels of an SLM, inside a few tiles. Right: the eye is at the "
                  "SLM. Light in one direction from the covered piece is one point on the retina, and the directions "
                  "fill the field of view.")
    side, top, left = 210, 44, 30
    tiles, d, s = 6, 44, (38, -32)
    below = top + side + 26
    cx, cy = left + side / 2, top + side / 2
    tile = side / tiles
    middle = cx + s[0], cy + s[1]
    out.rectangle(left, top, side, side, "ink", "soft", 0.06)
    for i in range(1, tiles):
        out.path([(left + i * tile, top), (left + i * tile, top + side)], width=0.5)
        out.path([(left, top + i * tile), (left + side, top + i * tile)], width=0.5)
    first = [math.floor((m - o - d / 2) / tile) for m, o in zip(middle, (left, top), strict=True)]
    last = [math.ceil((m - o + d / 2) / tile) for m, o in zip(middle, (left, top), strict=True)]
    corner = left + first[0] * tile, top + first[1] * tile
    out.rectangle(*corner, (last[0] - first[0]) * tile, (last[1] - first[1]) * tile, "red", line=2.5)
    out.circle(*middle, d / 2, "blue", "soft", 2)
    out.text(*middle, "d", "blue")
    out.arrow((cx, cy), (middle[0] - 14, middle[1] + 12), "blue")
    out.text(cx + 10, cy - 16, "s", "blue")
    out.text(cx, top - 16, "The SLM from the front", bold=True)
    out.text(left, below, "A pupil covers a piece of the SLM.", "blue", "start")
    out.text(left, below + 20, "The tiles under it are a far field\nof their own.", "red", "start")
    out.text(left, below + 58, "Eyebox: the SLM, Np wide.", anchor="start")
    # Side view. The angle is drawn larger than asin(lambda / 2p), which is 1.9 degrees for green light and 8 um.
    slm, axis, half, half_pupil, s, count = 420, top + side / 2, 92, 26, -20, 22
    out.text(slm + 90, top - 16, "The SLM and the eye from the side", bold=True)
    for y in range(-80, 81, 32):
        out.arrow((slm - 84, axis + y), (slm - 18, axis + y), "green")
    out.text(slm - 52, axis - 92, "laser", "green")
    for i in range(count):
        out.rectangle(slm - 10, axis - half + 2 * half / count * i, 8, 2 * half / count, line=0.8, fill="soft")
    retina = eye(out, (slm + 4, axis + s), half_pupil, 150)
    for slope, hue in ((-0.32, "orange"), (0.32, "orange"), (0, "blue")):
        end = retina(slope)
        for y in (4 - half_pupil, 0, half_pupil - 4):
            out.path([(slm - 2, axis + s + y - 6 * slope), (slm + 4, axis + s + y), end], hue, 1.6)
        out.circle(*end, 3.5, hue, "full", 0)
    end = retina(0)
    out.text(end[0] + 12, end[1] - 4, "one direction,\none point", "blue", "start")
    out.text(slm - 84, below, "The retina receives the transform of the piece.", "blue", "start")
    out.text(slm - 84, below + 20, "The steepest directions, ± asin(λ / 2p), are the\n"
             "edges of the field of view, λf / p wide in X.", "orange", "start")
    out.text(slm - 84, below + 58, "Finest detail: λf / d.", anchor="start")
    return out


def main():
    wrong = []
    for drawing in (display(), pupil(), light_field(), sub_frames(), session(), far_field()):
        path, text = FOLDER / f"{drawing.name}.svg", drawing.file()
        if sys.argv[1:] != ["--check"]:
            FOLDER.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        elif not path.exists() or path.read_text() != text:
            wrong.append(f"docs/concepts/{path.name}: differs. Run tools/drawings.py to write it again.")
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main()
