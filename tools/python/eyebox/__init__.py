"""eyebox computes phase holograms for near-eye displays. The image stays correct across the whole eyebox and sharpens
at the tracked pupil.

The package converts a light field to phases of a spatial light modulator (SLM) by Stochastic Light Field Holography
(Schiffers et al. 2023, https://arxiv.org/abs/2307.06277). Lengths are meters and phases are radians. Images are linear
light with 1 as full scale, and depths are positive towards the eye. Arrays are (row, column) with rows going down.
Colors (red, green, blue) are the last axis.

>>> import eyebox
>>> display = eyebox.Display("small", size=(64, 64))
>>> hologram = eyebox.solve("builtin:still-life", display, color="green", frames=2, steps=4)
>>> hologram.phases["green"].shape
(2, 64, 64)
>>> hologram.view(x=2e-3, diameter=4e-3, depth=1e-3).shape
(64, 64, 1)
"""

import atexit
import os

from . import _eyebox
from ._arguments import Pupil
from ._calibrate import Calibration, Shot, calibrate
from ._command import command
from ._display import Display, Engine, presets
from ._eyebox import (
    CalibrateError,
    DisplayError,
    EncodeError,
    EngineError,
    EyeboxError,
    HologramError,
    SceneError,
    SessionError,
    SolveError,
    __version__,
)
from ._files import read
from ._film import film
from ._hologram import Hologram
from ._interrupted import Interrupted
from ._pupils import paper_pupils, random_pupils
from ._refiner import Refiner
from ._scene import Measured, Scene, photograph
from ._show import Frame, Light, Session, Shows, show
from ._settings import SolveSettings
from ._solve import Step, plan, solve
from ._tables import Score, Scores, Summary

__all__ = [
    "CalibrateError",
    "Calibration",
    "Display",
    "DisplayError",
    "EncodeError",
    "Engine",
    "EngineError",
    "EyeboxError",
    "Frame",
    "Hologram",
    "HologramError",
    "Interrupted",
    "Light",
    "Measured",
    "Pupil",
    "Refiner",
    "Scene",
    "SceneError",
    "Score",
    "Scores",
    "Session",
    "SessionError",
    "Shot",
    "Shows",
    "SolveError",
    "SolveSettings",
    "Step",
    "Summary",
    "__version__",
    "calibrate",
    "command",
    "film",
    "paper_pupils",
    "photograph",
    "plan",
    "presets",
    "random_pupils",
    "read",
    "show",
    "solve",
]

# The exit of the process waits for abandoned work. A forked child has no such work.
atexit.register(_eyebox.leave)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: atexit.unregister(_eyebox.leave))
