"""Uses and misuses of the package, which test_checkers.py gives to mypy and pyright.

A type checker finds an error in each line with the comment "misuse" at its end, and in no other line. Nothing runs this file.
"""

from __future__ import annotations

import copy
import pathlib
import pickle

import eyebox
import eyebox.cluster
import eyebox.live
import eyebox.slmsuite
import numpy as np
from eyebox import Display, Engine, Hologram, Pupil, Refiner, Scene, SolveSettings


def displays(path: pathlib.Path) -> Display:
    Display("paper")
    Display(path)
    Display("planes8", size=(256, 256))
    Display("planes8", size="1080p", rate_hz="60Hz")
    Display("paper", color="green")
    Display("paper", color=3)  # misuse
    Display(size=(64, 64), pitch_um=8, focal_length_mm="40cm", wavelengths_nm={"green": 520.0})
    made = Display("small").replace(levels=16, encoding={"two_pi_level": 14}, model=None)
    copy.deepcopy(made), pickle.dumps(made), {made: made.name}
    Display(3)  # misuse
    Display("small", size=256)  # misuse
    Display("small", pich_um=8.0)  # misuse
    Display("small", geometry="far")  # misuse
    made.replace(levels="16 levels", size=(4, 4, 4))  # misuse
    made.name = "another"  # misuse
    made.resolutoin  # misuse
    return made


def scenes(display: Display, path: pathlib.Path, light: np.ndarray) -> Scene:
    Scene("builtin:plane", display, "green")
    Scene(path, display, ["red", "green"], views=5, view_pitch="2mm", depth=("-1mm", "0.5D"))
    Scene(light, display, name="mine")
    Scene([[0.0, 1.0], [1.0, 0.0]], display)
    Scene(light, display, depth_map=light[..., 0], view_synthesis="layers")
    Scene.from_layers(light, [0, "1mm"], display, views=np.int64(5)).contact_sheet()[0, 0]
    Scene.from_focal_stack([light, light], ["0.5D", 0.0], "4mm", display).measure().depth_range[0] + 1.0
    Scene.from_layers(light, display)  # misuse
    Scene.from_focal_stack([light], [0.0], display=display)  # misuse
    Scene(light, display, view_synthesis="sharp")  # misuse
    eyebox.read(path, "name").mean()
    eyebox.read(3)  # misuse
    eyebox.photograph("builtin:plane", "1mm", 0, "4mm", "0.5D", display=display).shape
    Scene(7, display)  # misuse
    Scene("builtin:plane", near="close")  # misuse
    Scene("builtin:plane", display, colour="green")  # misuse
    eyebox.photograph("builtin:plane", [1, 2])  # misuse
    return Scene("builtin:plane", display)


def solves(scene: Scene, display: Display, rng: np.random.Generator) -> Hologram:
    settings = SolveSettings(steps=20, diameter=("2mm", "6mm"), optimizer="adam")
    eyebox.solve(scene, settings=settings.replace(frames=4), rng=rng)
    eyebox.solve("builtin:plane", "small", steps=np.int64(4), seconds="10s", engine=Engine("cpu"), progress=True)
    eyebox.solve(scene, display, quality="fast", levels=16, callback=lambda step: step.step < 10)
    eyebox.solve(scene, display, optimizer={"kind": "adam", "rate": [0.1, 0.01]}, padding="need")
    eyebox.solve(scene, display, stpes=3)  # misuse
    eyebox.solve(scene, display, quality="good")  # misuse
    eyebox.solve(scene, display, steps="many")  # misuse
    eyebox.solve(scene, display, engine=3)  # misuse
    eyebox.solve(scene, display, callback=lambda: True)  # misuse
    eyebox.solve(display=display)  # misuse
    SolveSettings(quality="best")  # misuse
    SolveSettings(20)  # misuse
    settings.steps = 3  # misuse
    settings.replace(step=3)  # misuse
    return eyebox.solve(scene, display, seed=3)


def holograms(hologram: Hologram, phases: np.ndarray, display: Display) -> None:
    mean: float = float(hologram.view(x="2mm", diameter=4e-3, depth="0.5D").mean())
    scores = hologram.score(pupils=[(0, 0, "4mm", 0), Pupil(x=1e-3)])
    best: float | None = max(score.psnr or mean for score in scores)
    scores.to_dataframe()
    worst = hologram.score(pupils="random:24", seed=3, jod=True, viewing={"luminance": 200}).summary("jod")
    worst is None or worst.worst < 3
    hologram.score(pupils="paper").by_group()["Focal stack"].summary()
    hologram.score(pupils=24)  # misuse
    hologram.score(jod="some")  # misuse
    hologram.score().summary().mean  # misuse
    eyebox.random_pupils(display, 24, seed=3, depth=("-1mm", 1e-3))[0].x + 1.0
    eyebox.random_pupils(display)  # misuse
    eyebox.plan("builtin:plane", display, steps=3, forecast=True)["choices"]
    eyebox.plan("builtin:plane", display, stpes=3)  # misuse
    eyebox.command("info", "one.zarr", "--at", 3)["schema"]
    eyebox.film(hologram, [{"t": 0, "x": "1mm"}], "film.y4m", what="both")
    eyebox.film(hologram, [{"t": 0}], "film.y4m", what="eye")  # misuse
    refined = hologram.refine((4e-3, 0, 4e-3, 1e-3), steps=16, elsewhere=0.5, rng=np.random.default_rng(best is None))
    refined.encode(display).astype(np.float32)
    Hologram.from_phases({"green": phases}, display, exposure=1.0).save("one.zarr")
    Hologram.load("one.zarr", at=3).phases["green"][0]
    refiner = Refiner(hologram, strategy="adam")
    refiner.aim(x="1mm", spread=1e-4)
    hologram.view(aperture=4e-3)  # misuse
    hologram.view(obstructed="glasses")  # misuse
    hologram.score()[0].snr  # misuse
    hologram.refine((4e-3, 0, 4e-3))  # misuse
    hologram.phases = {}  # misuse
    hologram.exposures["green"]  # misuse
    Hologram.from_phases(phases)  # misuse
    Refiner("one.zarr")  # misuse
    refiner.step(2, callback=lambda loss: loss < 1)  # misuse


def shows(hologram: Hologram, display: Display) -> None:
    with eyebox.show(hologram, display, eye="own", clock="simulated", seconds="1s") as session:
        for frame in session:
            session.look("1mm", age="2ms")
            frame.pixels.shape[0] + frame.number
        session.frame(timeout="100ms")
    eyebox.show(hologram, display, output="screen")  # misuse
    eyebox.show(hologram, display, eye=3)  # misuse
    session.look()  # misuse
    frame.pixel  # misuse
    eyebox.slmsuite.play([hologram], object(), rate="60Hz", callback=lambda shown: shown.sub_frame < 8)
    eyebox.slmsuite.levels(hologram, object(), color=3)  # misuse
    eyebox.cluster.evaluate(["one.zarr"], "scores.json", [(0, 0, 4e-3, 0)]).to_dataframe()
    eyebox.cluster.solve_sequence(["builtin:plane"], "film.zarr", display, steps=3, seed=1, quality="fast")
    eyebox.cluster.solve_sequence([np.zeros((2, 2, 8, 8))], "film.zarr", display, max_workers=4)
    eyebox.cluster.solve_sequence([3], "film.zarr", display)  # misuse
    eyebox.cluster.solve_sequence(["builtin:plane"], "film.zarr", display, stesp=3)  # misuse
    eyebox.calibrate(display, lambda shot: np.zeros((4, 4)), hello={}).report["parameters"]
    eyebox.calibrate(display, lambda: np.zeros((4, 4)), hello={})  # misuse


def lives(samples: np.ndarray, depths: np.ndarray) -> None:
    try:
        there = eyebox.live.Live("demo")
    except eyebox.EyeboxError as error:
        print(error.code)
        raise
    with there:
        kind = there.color_and_depth(eyebox.live.F32, eyebox.live.LINEAR)
        while request := there.wait("100ms"):
            number: int = there.send(kind, samples, depths, request=request, center=("1mm", 0.0))
            eyebox.Pupil(request.x, request.y, request.diameter).depth + request.velocity[0] + number
            there.send(kind, samples, depths, request=request.number)  # misuse
            request.pupil_x_mm  # misuse
        there.views(3, 3, "1mm", eyebox.live.Sample.F16)
        there.views(3, 3)  # misuse
        there.layers(["0.5D", 0.0], transfer=eyebox.live.SRGB)
        there.layers("0.5D", 7)  # misuse
        there.color_and_depth(eyebox.live.LINEAR)  # misuse
        there.send(samples)  # misuse
        there.send("frame", samples)  # misuse
        there.eyebox_mm  # misuse
        there.kinds & {eyebox.live.Kind.VIEWS, eyebox.live.LAYERS}
        there.wait(None)  # misuse
        there.size[0] * there.size[1] * len(there.colors)
    eyebox.live.Live(b"demo")  # misuse
    eyebox.live.Live()  # misuse
