#!/usr/bin/env python3
"""Measures other uses of a table of first phases or of a similar start.

The uses are the far field, colors that share one drive, and steps that draw obstructions in the pupil. A projection in
NumPy, as in eyebox, starts from each. The results are PSNR by number of steps.

    tools/python.sh && PYTHONPATH=target/python/site target/python/tests/bin/python tools/other_starts.py \\
        target/release/eyebox docs/results/first-phases.json

The results go into the file that tools/first_phases.py writes, as `other_starts`.
"""
import json
import pathlib
import subprocess
import sys
import tempfile

import eyebox
import numpy as np
import scipy.fft

SIDE, FRAMES, TILE = 256, 8, 64
SCENES = ["still-life"]
LEVELS = np.array([0, 0.1, 0.2, 0.4, 0.6, 0.8, 1, 1.2, 1.4])  # Brightnesses of the table for a shared drive.
UNSTEPPED = 1.3  # By what the exposure of phases without a step is above the one of a solve.
KINDS = ["lashes", "floaters", "opacity", "scratches"]
GOLDEN_ANGLE = 2.399963229728653


def fft2(field):
    return scipy.fft.fft2(field, workers=-1)


def ifft2(field):
    return scipy.fft.ifft2(field, workers=-1)


def unit(field):
    return (field / np.maximum(abs(field), 1e-12)).astype(np.complex64)


class Pupils:
    """Draws pupils for one color of a display, and makes their transfer functions."""

    def __init__(self, display, color, seed, diameters):
        self.rng, self.diameters, self.eyebox = np.random.default_rng(seed), diameters, display.eyebox
        self.wavelength, focal = display.wavelengths[color], display.focal_length
        axes = [self.wavelength * focal * np.fft.fftfreq(n, display.pitch) for n in display.resolution]
        self.y, self.x = np.meshgrid(*axes, indexing="ij")
        self.slope = 1 - np.sqrt(np.maximum(0, 1 - (self.x**2 + self.y**2) / focal**2))

    def draw(self, depth=0.0):
        d = np.exp(self.rng.uniform(*np.log(self.diameters)))
        x, y = self.rng.uniform(-1, 1, 2) * max(0, self.eyebox - d) / 2
        return x, y, d, self.rng.uniform(-depth, depth)

    def kernel(self, pupil):
        x, y, d, z = pupil
        defocus = np.exp(-2j * np.pi / self.wavelength * z * self.slope)
        return ((np.hypot(self.x - x, self.y - y) < d / 2) * defocus).astype(np.complex64)

    def marks(self, pupil, kind, rng):
        """Returns the amplitude that passes opaque marks, which are turned and moved at random."""
        turn, shift, bin_size = rng.uniform(0, 2 * np.pi), rng.normal(0, 0.3e-3, 2), self.x[0, 1] - self.x[0, 0]
        dx, dy = self.x - pupil[0] - shift[0], self.y - pupil[1] - shift[1]
        x, y = np.cos(turn) * dx + np.sin(turn) * dy, np.cos(turn) * dy - np.sin(turn) * dx
        half = bin_size / 2
        covered = lambda at, w: (np.minimum(at + half, w / 2) - np.maximum(at - half, -w / 2)).clip(0) / bin_size
        line = lambda offset, normal, w: covered(x * np.cos(normal) + y * np.sin(normal) - offset, w)
        disc = lambda cx, cy, d: covered(np.hypot(x - cx, y - cy), d) * min(1, d / bin_size)
        if kind == "lashes":
            all_marks = [line((i - 2.5) * 0.6e-3, np.radians((i - 2.5) * 6), 0.2e-3) for i in range(6)]
        elif kind == "floaters":
            places = [(2e-3 * np.sqrt((i + 0.5) / 12), i * GOLDEN_ANGLE) for i in range(12)]
            all_marks = [disc(r * np.cos(a), r * np.sin(a), 0.1e-3 * (1 + i % 4)) for i, (r, a) in enumerate(places)]
        elif kind == "opacity":
            all_marks = [disc(0, 0, 1e-3)]
        else:
            all_marks = [line((i - 3.5) * 0.45e-3, i * GOLDEN_ANGLE, 0.05e-3) for i in range(8)]
        return np.prod([1 - mark for mark in all_marks], axis=0)


def light(v, kernel):
    """Returns the mean of the sub-frames, in units of light that is spread evenly over the eyebox."""
    return (abs(v) ** 2).mean(0) / max((abs(kernel) ** 2).mean(), 1e-9)


def ratio(target, seen):
    return (np.sqrt((target + 1e-4) / (seen + 1e-4)).clip(0, 3) - 1).astype(np.float32)


def falling(first, step, steps):
    return 0.3 + (first - 0.3) * np.cos(np.pi / 2 * step / steps) ** 2


def quality(colors):
    """Returns mean and worst PSNR over the pupils, from pairs of image and target per color, with one exposure per color."""
    pool = lambda a: a.reshape(SIDE // 2, 2, SIDE // 2, 2).mean((1, 3))
    errors = []
    for pairs in colors:
        pairs = [(pool(seen), pool(wanted)) for seen, wanted in pairs]
        exposure = sum((s * w).sum() for s, w in pairs) / sum((s * s).sum() for s, _ in pairs)
        errors.append([np.mean((exposure * s - w) ** 2) for s, w in pairs])
    db = -10 * np.log10(np.mean(errors, 0))
    return [round(float(db.mean()), 2), round(float(db.min()), 2)]


def looked_up(scene, **how):
    return eyebox.solve(scene, frames=FRAMES, steps=0, engine="cpu", **how)


def far_field(scene, display, counts=(0, 1, 2, 5, 10)):
    """Measures the far field, in which a pupil cuts out a piece of the SLM and sees its Fourier transform."""
    exposure = looked_up(scene).exposures["green"] / UNSTEPPED
    rng, test = np.random.default_rng(1), Pupils(display, "green", 2, (3e-3, 12e-3))
    random = lambda side: np.exp(1j * rng.uniform(-np.pi, np.pi, (FRAMES, side, side))).astype(np.complex64)
    amplitude = np.sqrt(scene.photograph(0, 0, 0.7 * display.eyebox, 0)[..., 0])
    tile = random(TILE)
    for _ in range(200):  # Phases of an even picture whose spectrum is even on the SLM, on a tile of the picture.
        tile = unit(ifft2(unit(fft2(tile))))
    repeats = (1, SIDE // TILE, SIDE // TILE)
    starts = {"random": random(SIDE), "transform": fft2(amplitude * random(SIDE)), "table": fft2(amplitude * np.tile(tile, repeats))}
    judged = [(test.kernel(p), scene.photograph(*p)[..., 0]) for p in (test.draw() for _ in range(16))]
    for start, field in starts.items():
        phases, pupils, row = np.angle(field), Pupils(display, "green", 5, (3e-3, 12e-3)), {"start": start}
        for step in range(max(counts) + 1):
            u, change, overlap = np.exp(1j * phases).astype(np.complex64), 0, 1
            if step in counts:
                row[str(step)] = quality([[(light(ifft2(u * k) * SIDE, k), wanted) for k, wanted in judged]])
            for pupil in (pupils.draw() for _ in range(16)):
                k = pupils.kernel(pupil)
                v = ifft2(u * k) * SIDE
                v *= ratio(scene.photograph(*pupil)[..., 0] / exposure, light(v, k))
                change, overlap = change + k.conj() * fft2(v) / SIDE, overlap + abs(k)
            phases = phases + 2.7 * (u.conj() * change).imag / np.sqrt(1.6 * overlap)
        yield row


def shared_drive_step(drive, slopes, pupils, drawn, wanted, gain, velocity):
    """Makes one step of a drive that turns each color by its own slope. `wanted` gives a pupil's target in a color."""
    total = 0
    for color, (slope, of) in enumerate(zip(slopes, pupils)):
        u = np.exp(1j * slope * drive).astype(np.complex64)
        spectrum, change, overlap = fft2(u), 0, 1
        for at, pupil in enumerate(drawn):
            k = of.kernel(pupil)
            v = ifft2(spectrum * k)
            v *= ratio(wanted(at, color), light(v, k))
            change, overlap = change + k.conj() * fft2(v), overlap + abs(k)
        total = total + slope * (u.conj() * ifft2(change / np.sqrt(1.6 * overlap))).imag
    return 0.5 * velocity + gain * total / np.square(slopes).sum()


def joint_color(scene, display, counts=(0, 1, 5, 20)):
    """Measures simultaneous color with one drive. The table has levels of gray, and the lookup uses green's picture."""
    colors = list(display.wavelengths)
    slopes = [display.wavelengths["red"] / display.wavelengths[color] for color in colors]
    exposures = np.array([looked_up(scene).exposures[color] for color in colors]) / UNSTEPPED
    tile, rng, table = eyebox.Display("paper", size=(TILE, TILE)), np.random.default_rng(7), {}
    of_tile = [Pupils(tile, color, 7, (2.2e-3, 12e-3)) for color in colors]

    def even(level, drive, gain, steps):
        velocity = 0
        for step in range(steps):
            drawn = [of_tile[0].draw(2e-3) for _ in range(16)]
            velocity = shared_drive_step(drive, slopes, of_tile, drawn, lambda *_: level, falling(gain, step, steps), velocity)
            drive = drive + velocity
        return drive

    table[4] = even(LEVELS[4], rng.uniform(-np.pi, np.pi, (FRAMES, TILE, TILE)), 2.5, 200)
    for at in [5, 6, 7, 8, 3, 2, 1, 0]:
        table[at] = even(LEVELS[at], table[at - 1 if at > 4 else at + 1], 1.5, 40)
    bright = (scene.photograph(0, 0, 0.7 * display.eyebox, 0) / exposures / UNSTEPPED)[..., 1]
    tiled = lambda at: np.tile(np.exp(1j * table[at]), (1, SIDE // TILE, SIDE // TILE))
    gray = sum(np.interp(bright, LEVELS, hat) * tiled(at) for at, hat in enumerate(np.eye(len(LEVELS))))
    green = looked_up(eyebox.Scene(scene.source, display, "green")).phases["green"]
    random = rng.uniform(-np.pi, np.pi, (FRAMES, SIDE, SIDE))
    starts = {"random": random, "green's table": green / slopes[1], "table of the drive": np.angle(gray)}
    test = [Pupils(display, color, 2, (2.2e-3, 12e-3)) for color in colors]
    judged = [(p, scene.photograph(*p)) for p in (test[0].draw() for _ in range(12))]
    for start, drive in starts.items():
        pupils, velocity, row = [Pupils(display, color, 5, (2.2e-3, 12e-3)) for color in colors], 0, {"start": start}
        for step in range(max(counts) + 1):
            if step in counts:
                spectra = [fft2(np.exp(1j * slope * drive).astype(np.complex64)) for slope in slopes]
                see = lambda c, p: light(ifft2(spectra[c] * test[c].kernel(p)), test[c].kernel(p))
                row[str(step)] = quality([[(see(c, p), wanted[..., c]) for p, wanted in judged] for c in range(3)])
            drawn = [pupils[0].draw() for _ in range(16)]
            targets = [scene.photograph(*p) / exposures for p in drawn]
            gain = falling(2.5 if start == "random" else 1.7, step, max(counts) + 1)
            velocity = shared_drive_step(drive, slopes, pupils, drawn, lambda at, c: targets[at][..., c], gain, velocity)
            drive = drive + velocity
        yield row


def score(program, hologram, *more):
    around = [[x, y, 4, 0] for x in (-6, 0, 6) for y in (-6, 0, 6)]
    with tempfile.TemporaryDirectory() as folder:
        out, pupils = pathlib.Path(folder, "h.zarr"), pathlib.Path(folder, "pupils.json")
        hologram.save(out)
        pupils.write_text(json.dumps(around))
        how = ["--test-pupils", pupils, "--engine", "cpu", "--jod", "none", "--json", *more]
        found = json.loads(subprocess.run([program, "eval", "score", out, *how], check=True, capture_output=True).stdout)["psnr_db"]
    return [round(found["mean"], 2), round(found["worst"], 2)]


def obstructions(program, scene, display, steps=20):
    """Measures PSNR for steps from the table, with marks in none, half and all of the drawn pupils."""
    begun = looked_up(scene)
    exposure = begun.exposures["green"] / UNSTEPPED
    for share in (0, 0.5, 1):
        phases, velocity, pupils, rng = begun.phases["green"], 0, Pupils(display, "green", 3, (2.2e-3, 20e-3)), np.random.default_rng(4)
        for step in range(steps):
            u = np.exp(1j * phases).astype(np.complex64)
            spectrum, change, overlap = fft2(u), 0, 1
            for pupil in (pupils.draw() for _ in range(16)):
                k = pupils.kernel(pupil)
                if rng.random() < share:
                    k = (k * pupils.marks(pupil, KINDS[rng.integers(4)], rng)).astype(np.complex64)
                v = ifft2(spectrum * k)
                v *= ratio(scene.photograph(*pupil)[..., 0] / exposure, light(v, k))
                change, overlap = change + k.conj() * fft2(v), overlap + abs(k) ** 2
            change = ifft2(change / np.sqrt(1.6 * overlap))
            velocity = 0.5 * velocity + falling(1.5, step, steps) * (u.conj() * change).imag
            phases = phases + velocity
        made = eyebox.Hologram.from_phases(phases, display, "green", scene=scene)
        seen = {kind: score(program, made, "--obstructed", kind) for kind in KINDS}
        yield {"share_with_marks": share, "clear": score(program, made), **seen}


def main():
    program, file = sys.argv[1:]
    display, rows = eyebox.Display("paper", size=(SIDE, SIDE)), []
    for name in SCENES:
        scenes = {color: eyebox.Scene(f"builtin:{name}", display, color) for color in ("green", None)}
        of = {
            "far field": far_field(scenes["green"], display),
            "joint color": joint_color(scenes[None], display),
            "obstructions": obstructions(program, scenes["green"], display),
        }
        for what, measured in of.items():
            for row in measured:
                rows.append({"what": what, "scene": f"builtin:{name}", **row})
                print(json.dumps(rows[-1]), flush=True)
    text = pathlib.Path(file).read_text(encoding="utf-8").partition(',\n "other_starts"')[0].rstrip().removesuffix("}")
    lines = ",\n  ".join(map(json.dumps, rows))
    pathlib.Path(file).write_text(f'{text},\n "other_starts": [\n  {lines}]}}\n', encoding="utf-8")


if __name__ == "__main__":
    main()
