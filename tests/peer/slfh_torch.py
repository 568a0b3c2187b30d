"""Stochastic Light Field Holography in plain PyTorch, the program that docs/measurements.md compares eyebox with.

    pip install torch numpy pillow
    python3 slfh_torch.py VIEWS --size 512 --iterations 200 --pupils 8 --cosine --save phases.npy

VIEWS is a folder of n x n pictures of a light field, whose names sort row by row. The program propagates every pupil at
full resolution, differentiates with autograd and descends with Adam. The display is the preset `paper` in green. The
equations are in docs/optics. It prints the time of an iteration and the PSNR of 16 random pupils, which no
iteration used. `--save` writes phases in radians as (sub-frame, row, column), which `eyebox eval score` reads.
"""

import argparse
import math
import time
from pathlib import Path

import numpy as np
import torch
from PIL import Image

PITCH, WAVELENGTH, FOCAL_LENGTH = 8e-6, 520e-9, 0.4
SHORTEST = 440e-9  # All colors of the display serve the eyebox of its shortest wavelength.
EYEBOX, COMMON_EYEBOX = (wavelength * FOCAL_LENGTH / PITCH for wavelength in (WAVELENGTH, SHORTEST))


def load_views(folder, size, device):
    """Returns the green of each view as linear light, its place in the pupil plane (m), and the distance of views (m)."""
    files = sorted(file for file in Path(folder).iterdir() if file.suffix.lower() in (".png", ".jpg"))
    side = math.isqrt(len(files))
    if side < 2 or side * side != len(files):
        raise SystemExit(f"{folder}: expected n x n pictures, found {len(files)}")
    levels = np.stack([np.asarray(Image.open(file).convert("RGB"))[..., 1] for file in files]) / 255.0
    light = torch.tensor(levels**2.2, dtype=torch.float32)[:, None]
    light = torch.nn.functional.interpolate(light, (size, size), mode="area")[:, 0].to(device)
    step = COMMON_EYEBOX / (side - 1)
    places = [((column - side // 2) * step, (row - side // 2) * step) for row in range(side) for column in range(side)]
    return light, places, step


def shifted(image, down, right):
    """Shifts an image by a fraction of pixels, bilinear and periodic."""
    whole = math.floor(down), math.floor(right)
    part = down - whole[0], right - whole[1]
    total = torch.zeros_like(image)
    for y, along_y in ((0, 1 - part[0]), (1, part[0])):
        for x, along_x in ((0, 1 - part[1]), (1, part[1])):
            total = total + along_y * along_x * torch.roll(image, (whole[0] + y, whole[1] + x), (0, 1))
    return total


def target_image(field, pupil):
    """Adds the views in a pupil, each by the share of its cell, shifted for the focus."""
    light, places, step = field
    x, y, diameter, focus = pupil
    inside = (np.arange(8) + 0.5) / 8 * step - step / 2
    pixels = focus / FOCAL_LENGTH / PITCH
    total, weights = torch.zeros_like(light[0]), 0.0
    for view, (view_x, view_y) in zip(light, places):
        distance = (view_x + inside[None] - x) ** 2 + (view_y + inside[:, None] - y) ** 2
        share = float((distance < (diameter / 2) ** 2).mean())
        if share > 0:
            total = total + share * shifted(view, pixels * view_y, pixels * view_x)
            weights += share
    return total / weights


def image(spectrum, pupil):
    """Returns the mean intensity of all sub-frames through a pupil, for a mean light of 1 in the whole eyebox."""
    x, y, diameter, focus = pupil
    frequency = torch.fft.fftfreq(spectrum.shape[-1], PITCH, dtype=torch.float64, device=spectrum.device)
    down, right = frequency[:, None], frequency[None]
    place = WAVELENGTH * FOCAL_LENGTH
    disc = (right * place - x) ** 2 + (down * place - y) ** 2 < (diameter / 2) ** 2
    sine = torch.clamp(WAVELENGTH**2 * (down**2 + right**2), max=1)
    path = focus * sine / (1 + torch.sqrt(1 - sine))
    transfer = torch.polar(disc.double(), -2 * math.pi / WAVELENGTH * path).to(torch.complex64)
    intensity = torch.fft.ifft2(spectrum * transfer).abs() ** 2
    return intensity.mean(0) / (math.pi / 4 * (diameter / EYEBOX) ** 2)


def random_pupil(random, options):
    """Draws a pupil that is inside the common eyebox, as x, y, diameter and focus (m)."""
    diameter = random.uniform(*options.diameters) * 1e-3
    reach = max(0.0, (COMMON_EYEBOX - diameter) / 2)
    depths = [depth * 1e-3 for depth in options.depth]
    return random.uniform(-reach, reach), random.uniform(-reach, reach), diameter, random.uniform(*depths)


def score(phases, field, pupils):
    """Returns the PSNR of each pupil after a mean of 2 x 2 pixels, with one exposure for all pupils."""
    with torch.no_grad():
        half = lambda plane: torch.nn.functional.avg_pool2d(plane[None], 2)[0]
        spectrum = torch.fft.fft2(torch.polar(torch.ones_like(phases), phases))
        images = torch.stack([half(image(spectrum, pupil)) for pupil in pupils])
        targets = torch.stack([half(target_image(field, pupil)) for pupil in pupils])
        exposure = (images * targets).sum() / (images * images).sum()
        errors = ((exposure * images - targets) ** 2).mean((1, 2))
        return -10 * torch.log10(errors).cpu().numpy()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("views")
    parser.add_argument("--size", type=int, default=512, help="rows and columns of the SLM")
    parser.add_argument("--frames", type=int, default=8, help="sub-frames")
    parser.add_argument("--iterations", type=int, default=200)
    parser.add_argument("--pupils", type=int, default=8, help="random pupils per iteration")
    parser.add_argument("--rate", type=float, default=0.1, help="step of Adam, rad")
    parser.add_argument("--cosine", action="store_true", help="lower the step along a cosine")
    parser.add_argument("--diameters", type=float, nargs=2, default=(2.0, 20.0), help="mm")
    parser.add_argument("--depth", type=float, nargs=2, default=(-3.0, 3.5), help="mm")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--save")
    options = parser.parse_args()

    field = load_views(options.views, options.size, options.device)
    tests = [random_pupil(np.random.default_rng(1000 + seed), options) for seed in range(16)]
    random = np.random.default_rng(0)
    torch.manual_seed(0)
    shape = (options.frames, options.size, options.size)
    phases = (2 * math.pi * torch.rand(shape)).to(options.device).requires_grad_(True)
    exposure = field[0].mean().clone().requires_grad_(True)
    adam = torch.optim.Adam([{"params": [phases], "lr": options.rate}, {"params": [exposure], "lr": 0.01}])
    decay = torch.optim.lr_scheduler.CosineAnnealingLR(adam, options.iterations, eta_min=options.rate / 20)
    times = []
    for _ in range(options.iterations):
        begun = time.perf_counter()
        adam.zero_grad()
        spectrum = torch.fft.fft2(torch.polar(torch.ones_like(phases), phases))
        loss = 0.0
        for pupil in (random_pupil(random, options) for _ in range(options.pupils)):
            loss = loss + ((exposure * image(spectrum, pupil) - target_image(field, pupil)) ** 2).mean()
        # The factor keeps gradients far above the epsilon of Adam.
        (1000 / options.pupils * loss).backward()
        adam.step()
        if options.cosine:
            decay.step()
        loss.item()  # A GPU has finished the iteration when its loss is known.
        times.append(time.perf_counter() - begun)
    psnr = score(phases.detach(), field, tests)
    print(f"{options.device}, {torch.get_num_threads()} threads, {options.pupils} pupils per iteration")
    print(f"iteration: median {1e3 * np.median(times):.1f} ms, {sum(times):.1f} s in all")
    print(f"16 random pupils: mean {psnr.mean():.2f} dB, worst {psnr.min():.2f} dB")
    if options.save:
        np.save(options.save, phases.detach().cpu().numpy())


if __name__ == "__main__":
    main()
