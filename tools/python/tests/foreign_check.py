"""Checks a wheel of eyebox on the machine on which this program runs. tools/python/foreign.sh runs it under emulators."""

import pathlib
import platform
import runpy
import sys

import eyebox
import numpy as np


def command(*words):
    """Runs the command in this process, because an emulator starts no other program."""
    sys.argv = ["eyebox", *map(str, words)]
    try:
        runpy.run_module("eyebox", run_name="__main__")
    except SystemExit as ended:
        assert not ended.code, (words, ended.code)


def main():
    display = eyebox.Display("planes8", size=(64, 64), color="green")
    # A random picture, which moves by a pixel per view.
    picture = np.random.default_rng(3).random((66, 66), dtype=np.float32)
    views = np.array([[picture[row : row + 64, column : column + 64] for column in range(3)] for row in range(3)])
    hologram = eyebox.solve(eyebox.Scene(views, display, view_pitch="1mm"), frames=8, steps=5, seed=1, depth=(0, 0), engine="cpu")
    again = eyebox.solve(eyebox.Scene(views, display, view_pitch="1mm"), frames=8, steps=5, seed=1, depth=(0, 0), engine="cpu")
    assert hologram == again
    assert hologram.phases["green"].shape == (8, 64, 64) and np.isfinite(hologram.view("1mm", 0, "4mm", "0.5D")).all()
    hologram.save("own.zarr")
    assert eyebox.Hologram.load("own.zarr") == hologram
    refined = hologram.refine(("1mm", 0, "4mm", 0), steps=3, scene=views, engine="cpu")
    assert refined.encode(display).dtype == np.uint8
    try:
        eyebox.Scene("builtin:nothing", display)
    except eyebox.SceneError as error:
        assert error.code.startswith("scene/")
    solved = eyebox.solve("builtin:still-life", display, frames=8, steps=20, seed=1, engine="cpu")
    mean = solved.score(pupils="random:8", seed=1, engine="cpu").summary().mean
    command("demo", "--engine", "cpu", "--size", 64, "--out", "demo")
    assert pathlib.Path("demo/still-life.zarr/zarr.json").exists()
    command("info", "demo/still-life.zarr")
    said = f"{platform.system()} on {platform.machine()}: Python {platform.python_version()}, NumPy {np.__version__}"
    print(f"{said}: eyebox {eyebox.__version__} solves with {mean:.2f} dB, and the command makes the demo", flush=True)


if __name__ == "__main__":
    main()
