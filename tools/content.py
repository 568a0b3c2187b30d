#!/usr/bin/env python3
"""Makes docs/content.jpg, which shows one scene as the content of each kind that the page Content lists.

    EYEBOX=target/release/eyebox tools/content.py

A program of docs/tutorials/rgbd.md draws three balls in front of a wall, with the depth of each pixel. The other kinds are
made of this picture. It needs NumPy and Pillow.
"""

import os
import pathlib
import re
import subprocess
import sys
import tempfile

import numpy as np
from PIL import Image, ImageDraw, ImageFont

SIDE = 256
TUTORIAL = pathlib.Path(__file__).resolve().parent.parent / "docs/tutorials/rgbd.md"
#: Depths of the wall and of the nearest ball, in mm.
DEPTH = (-1.5, 1.5)
#: Focal length of the display in mm, which is that of the preset paper.
FOCAL = 400
LOOK = ["--size", str(SIDE), "--pupil=3,0,8,1.5"]


def balls():
    """Returns the picture (0 to 1, sRGB) of the tutorial, and the share of the depths of each pixel. The largest is the nearest."""
    program = re.search(r"^```python\n(# balls\.py.*?)^```", TUTORIAL.read_text(encoding="utf-8"), re.M | re.S)
    subprocess.run([sys.executable, "-c", program[1]], check=True)
    return [np.asarray(Image.open(name)) / 255 for name in ("photo.ppm", "depth.pgm")]


def save(name, values):
    pathlib.Path(name).parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray((255 * values).round().astype(np.uint8)).save(name)


def splats(name, picture, depth):
    """Writes a round splat for each pixel, at distances 2 (near) to 4, in front of a camera of 40 degrees."""
    distance = 1 / (0.25 + depth * 0.25)
    tangent = np.tan(np.radians(20))
    y, x = (np.mgrid[0:SIDE, 0:SIDE] + 0.5) / SIDE * 2 - 1
    pixel = 2 * tangent / SIDE * distance
    floats = np.stack([x * tangent * distance, y * tangent * distance, distance, *[0.6 * pixel] * 3], -1)
    data = np.zeros((SIDE * SIDE, 32), np.uint8)
    data[:, :24] = floats.reshape(-1, 6).astype("<f4").view(np.uint8)
    data[:, 24:27] = (255 * picture).round().reshape(-1, 3)
    data[:, 27:] = [255, 255, 128, 128, 128]
    data.tofile(name)


def main():
    eyebox = str(pathlib.Path(os.environ["EYEBOX"]).resolve())
    out = pathlib.Path(__file__).resolve().parent.parent / "docs/content.jpg"

    def run(*words):
        subprocess.run([eyebox, *map(str, words)], check=True, stdout=subprocess.DEVNULL)

    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        picture, depth = balls()
        save("photo.png", picture)
        save("depth.png", depth)
        save("pair.png", np.concatenate([picture, np.repeat(depth[..., None], 3, 2)], 1))
        splats("scene.splat", picture, depth)
        levels = sorted(set(depth.ravel()))
        for index, level in enumerate(levels):
            # A layer goes on behind the nearer ones, here in the color of its edge.
            save(f"layers/layer_{index}.png", np.concatenate([picture, (depth == level)[..., None].astype(float)], 2))
        metres = [1e-3 * (DEPTH[0] + level * (DEPTH[1] - DEPTH[0])) for level in levels]
        dioptres = ", ".join(f"{depth / (1e-3 * FOCAL) ** 2:.6f}" for depth in metres)
        pathlib.Path("layers/lightfield.toml").write_text(f"layers_dioptres = [{dioptres}]\n")
        of_map = ["--depth-map", "depth.png", f"--depth={DEPTH[0]}..{DEPTH[1]}"]
        # The views and the focal stack are seen in the picture with the map.
        pitch = 2.4
        pathlib.Path("views").mkdir()
        for row in range(9):
            for column in range(9):
                at = f"--pupil={(column - 4) * pitch},{(row - 4) * pitch},0.2,0"
                run("render", "photo.png", *of_map, "--size", SIDE, at, "-o", f"views/view_{row}_{column}.png", "--force")
        pathlib.Path("views/lightfield.toml").write_text(f"view_pitch_mm = {pitch}\n")
        focuses = [-1.5, -0.75, 0.0, 0.75, 1.5]
        pathlib.Path("stack").mkdir()
        for index, focus in enumerate(focuses):
            run("render", "photo.png", *of_map, "--size", SIDE, f"--pupil=0,0,12,{focus}", "-o", f"stack/picture_{index}.png")
        pathlib.Path("stack/lightfield.toml").write_text(f"focus_mm = {focuses}\naperture_mm = 12\n")
        views = [[np.asarray(Image.open(f"views/view_{row}_{column}.png")) for column in range(9)] for row in range(9)]
        np.save("views.npy", np.array(views))
        camera = "eye=0,0,0&fov=40&range=2,4"
        seen = [
            ("a picture with a depth map", ["photo.png", *of_map]),
            ("colors and depths in halves", ["pair.png?depth=right", "--near", "bright", of_map[-1]]),
            ("views of a grid of cameras", ["views", of_map[-1]]),
            ("an array of views", ["views.npy?srgb", "--view-pitch", pitch, of_map[-1]]),
            ("splats", [f"scene.splat?{camera}", of_map[-1]]),
            ("layers", ["layers"]),
            ("a focal stack", ["stack"]),
        ]
        panels = []
        for index, (about, words) in enumerate(seen):
            run("render", *words, *LOOK, "-o", f"seen{index}.png")
            panels.append((about, Image.open(f"seen{index}.png").convert("RGB")))
        panels.append(("the picture itself", Image.open("photo.png")))
    sheet(panels).save(out, quality=88)
    print(f"wrote {out}", file=sys.stderr)


def sheet(panels):
    """Returns the pictures in rows of four, each with a line below."""
    line, gap, columns = 26, 8, 4
    rows = -(-len(panels) // columns)
    page = Image.new("RGB", (columns * (SIDE + gap) - gap, rows * (SIDE + line + gap) - gap), (255, 255, 255))
    draw = ImageDraw.Draw(page)
    for index, (about, picture) in enumerate(panels):
        x, y = index % columns * (SIDE + gap), index // columns * (SIDE + line + gap)
        page.paste(picture, (x, y))
        draw.text((x + 2, y + SIDE + 5), about, fill=(40, 40, 40), font=ImageFont.load_default(14))
    return page


if __name__ == "__main__":
    main()
