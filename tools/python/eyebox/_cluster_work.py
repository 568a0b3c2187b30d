"""Computes pieces on the workers of a cluster. A worker keeps the last job, so each job is prepared once per worker."""

from __future__ import annotations

import functools
import json
import os
import time
from typing import Any, Callable

from . import _eyebox
from ._display import Display, engine_of
from ._hologram import Hologram
from ._solve import solve


@functools.lru_cache(maxsize=1)
def sequence(job: Any) -> _eyebox.Sequence:
    """Returns the current sequence of a worker, which keeps the results of its first scene."""
    names, display, colors, settings, rate, out, _ = job
    return _eyebox.Sequence(list(names), _eyebox.Display.of_toml(*display), list(colors), settings, rate, out)


def begun(job: Any, threads: int | None = None) -> Any:
    """Solves the first hologram on a worker, which begins the file. Returns the job for the others."""
    piece(job, 0, threads)
    return job


def prepared(job: Any) -> None:
    """Loads the first scene on a worker that is idle while another one solves the first hologram."""
    sequence(job).prepare(engine_of(job[-1]))


def piece(job: Any, index: int, threads: int | None = None) -> None:
    """Solves one hologram on a worker, unless it exists, on this number of threads instead of the worker's own."""
    sequence(job).piece(index, engine_of(job[-1]), threads)


@functools.lru_cache(maxsize=1)
def far_field(job: Any) -> _eyebox.FarField:
    """Returns the current far field of a worker, which keeps the loaded data of its scene."""
    scene, display, colors, settings, request, out, _ = job
    return _eyebox.FarField(scene, _eyebox.Display.of_toml(*display), list(colors), settings, request, out)


def far_field_begun(job: Any) -> tuple[Any, list[bool], list[list[int]]]:
    """Begins the file on a worker. Returns the job, whether each visit is done, and the visits before each one."""
    done, after, _ = far_field(job).begin(engine_of(job[-1]))
    return job, done, after


def visit(begun: tuple[Any, ...], visit: int, _after: Any) -> None:
    """Makes a visit to a region on a worker, unless it is done."""
    far_field(begun[0]).visit(visit, engine_of(begun[0][-1]))


def result(make: Callable[..., Any], job: Any, path: str) -> None:
    """Computes one result on a worker, unless it exists."""
    if not os.path.exists(path):
        write(path, make(*job))


def write(path: str, value: Any) -> None:
    with open(path + ".part", "w", encoding="utf-8") as draft:
        json.dump(value, draft, indent=1)
    os.replace(path + ".part", path)


def scored(file: str, index: int | None, _when: Any, scene: str | None, pupils: Any, engine: str) -> dict[str, Any]:
    at = {} if index is None else {"at": index}
    return {"hologram": file, **at, "scores": _scores(Hologram.load(file, index), scene, pupils, engine)}


def traded(
    scene: str, display: tuple[str, Any], colors: list[str], settings: dict[str, Any], pupils: Any, engine: str
) -> dict[str, Any]:
    begun = time.perf_counter()
    made = solve(scene, Display._of(_eyebox.Display.of_toml(*display)), colors, engine=engine, **settings)
    seconds = time.perf_counter() - begun
    return {"settings": settings, "seconds": seconds, "scores": _scores(made, None, pupils, engine)}


def _scores(hologram: Hologram, scene: Any, pupils: Any, engine: str) -> list[dict[str, Any]]:
    return [dict(score._asdict()) for score in hologram.score(scene, pupils, engine=engine)]
