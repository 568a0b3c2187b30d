"""More than one machine: sequences, scores and trade-offs as graphs of independent pieces, on Dask (``pip install dask[distributed]``).

A sequence's first hologram decides the exposure; the others need nothing of each other. Each is solved by whichever worker is free, and
saved beside the sequence: what is done is not done twice, a worker that dies loses the piece it was at, and the sequence that
the pieces are joined to has the bytes that one process writes. Workers and caller see the same folders.

>>> import eyebox.cluster
>>> scenes = [f"builtin:plane?depth={depth}" for depth in range(64)]
>>> eyebox.cluster.solve_sequence(scenes, "film.zarr", display=..., client=...)  # doctest: +SKIP
"""

from __future__ import annotations

import contextlib
import fractions
import json
import os
import shutil
import time
from typing import Any, Callable, Iterator

from . import _arguments, _eyebox
from ._display import Display, display_of, engine_of
from ._hologram import Hologram
from ._solve import solve

__all__ = ["evaluate", "solve_sequence", "tradeoff"]


def solve_sequence(
    scenes: Any,
    out: Any,
    display: Any = "paper",
    color: Any = None,
    *,
    client: Any = None,
    workers: int = 2,
    rate: Any = 30,
    engine: str = "auto",
    keep_pieces: bool = False,
    **settings: Any,
) -> int:
    """Solves a sequence of scenes on the workers of a Dask cluster.

    Parameters
    ----------
    scenes : sequence of str or path
        "builtin:NAME", folders of views or pictures, which all workers see: one for each hologram.
    out : path
        The sequence: NAME.zarr. One of the same scenes and settings that was cut off is gone on with.
    display, color
        As of :func:`eyebox.solve`.
    client : dask.distributed.Client, optional
        The cluster: dask_jobqueue's for Slurm, dask_kubernetes's, ...; where none is given, a cluster of this machine for as long as it
        takes.
    workers : int
        Processes of that cluster.
    rate : int or Fraction
        Holograms a second.
    engine : str
        Where each worker computes: "auto", "cpu" or "vulkan".
    keep_pieces : bool
        Whether the pieces, in a folder beside the sequence that ends in ``.pieces``, are left there.
    **settings
        As of :func:`eyebox.solve`. Every hologram begins cold.

    Returns
    -------
    int
        Holograms that were solved now; the others were there.

    Raises
    ------
    EyeboxError
        What a piece could not do.
    """
    display = display_of(display)
    names = _paths(scenes, "scenes")
    out = os.path.abspath(_arguments.path(out, "out"))
    if not out.endswith(".zarr"):
        raise ValueError(f"out is {out!r}: it must end in .zarr")
    try:
        shown = fractions.Fraction(rate)
    except (TypeError, ValueError, OverflowError, ZeroDivisionError):
        raise TypeError(f"rate is {rate!r}: it must be a number of holograms a second, or a Fraction") from None
    if not 0 < shown <= 100_000 or max(shown.as_integer_ratio()) >= 1 << 32:
        raise ValueError(f"rate is {rate!r}: it must be above 0, at most 100000, as a fraction of whole numbers")
    colors = _arguments.colors(color, list(display.wavelengths))
    job = (names, display.to_toml(), colors, _arguments.toml(settings), shown.as_integer_ratio(), engine)
    folder = out + ".pieces"
    os.makedirs(folder, exist_ok=True)
    paths = [os.path.join(folder, f"{index:06}.zarr") for index in range(len(names))]
    known = os.path.join(folder, "job.txt")
    _same_job(known, repr(job))
    with _cluster(client, workers) as there:
        # Done before, each is one look; a piece is there whole or not at all.
        first = there.submit(_piece, job, 0, paths[0], None, pure=False)
        rest = [there.submit(_piece, job, index, paths[index], paths[0], first, pure=False) for index in range(1, len(names))]
        solved = sum(there.gather([first, *rest]))
    _sequence(job).join(paths, out, engine_of(engine))
    if not keep_pieces:
        shutil.rmtree(folder)
    return solved


def evaluate(
    holograms: Any,
    out: Any,
    pupils: Any = None,
    *,
    scene: Any = None,
    client: Any = None,
    workers: int = 2,
    engine: str = "auto",
    keep_pieces: bool = False,
) -> list[dict[str, Any]]:
    """Scores holograms on the workers of a Dask cluster, each on one.

    Parameters
    ----------
    holograms : sequence of path
        Files of holograms, which all workers see.
    out : path
        Where the scores go: NAME.json. Of the same holograms, what is there is not done again.
    pupils : sequence of (x, y, diameter, depth), optional
        As of :meth:`eyebox.Hologram.score`, which each is scored by.
    scene : str or path, optional
        What all of them show; where none is given, what each was solved from.
    client, workers, engine, keep_pieces
        As of :func:`solve_sequence`.

    Returns
    -------
    list of dict
        For each, ``hologram`` (its path) and ``scores``: for each pupil ``psnr`` and ``ceiling`` (dB) and ``ssim``.
    """
    files = _paths(holograms, "holograms")
    scene = None if scene is None else _arguments.path(scene, "scene")
    at = None if pupils is None else _arguments.pupils(pupils)
    return _pieces(_scored, [(file, scene, at, engine) for file in files], out, client, workers, keep_pieces)


def tradeoff(
    scene: Any,
    out: Any,
    grid: Any,
    display: Any = "paper",
    color: Any = None,
    *,
    pupils: Any = None,
    client: Any = None,
    workers: int = 2,
    engine: str = "auto",
    keep_pieces: bool = False,
) -> list[dict[str, Any]]:
    """Solves a scene by each of several settings on the workers of a Dask cluster, and scores what comes of it.

    Parameters
    ----------
    scene : str or path
        The scene, which all workers see.
    out : path
        Where the results go: NAME.json. Of the same settings, what is there is not done again.
    grid : sequence of dict
        Settings of :func:`eyebox.solve`, by their names.
    display, color
        As of :func:`eyebox.solve`.
    pupils
        As of :meth:`eyebox.Hologram.score`.
    client, workers, engine, keep_pieces
        As of :func:`solve_sequence`.

    Returns
    -------
    list of dict
        For each, ``settings``, ``seconds`` that its solve took on its worker, and ``scores`` as of :func:`evaluate`.
    """
    display = display_of(display)
    name = _arguments.path(scene, "scene")
    colors = _arguments.colors(color, list(display.wavelengths))
    try:
        settings = [dict(one) for one in grid]
    except (TypeError, ValueError):
        raise TypeError(f"grid is {grid!r}: it must be a sequence of dicts of settings") from None
    for one in settings:
        _arguments.toml(one)
    at = None if pupils is None else _arguments.pupils(pupils)
    given = (name, display.to_toml(), colors)
    return _pieces(_traded, [(*given, one, at, engine) for one in settings], out, client, workers, keep_pieces)


def _paths(values: Any, what: str) -> list[str]:
    """Several names or paths."""
    if isinstance(values, (str, bytes)) or not hasattr(values, "__iter__"):
        raise TypeError(f"{what} is {values!r}: it must be a sequence of names or paths")
    paths = [_arguments.path(value, what) for value in values]
    if not paths:
        raise ValueError(f"{what} is empty: it must have one or more")
    return paths


def _pieces(
    make: Callable[..., Any], jobs: list[Any], out: Any, client: Any, workers: int, keep: bool
) -> list[dict[str, Any]]:
    """Results of independent pieces, each in a file of its own until all are in one."""
    out = os.path.abspath(_arguments.path(out, "out"))
    if not out.endswith(".json"):
        raise ValueError(f"out is {out!r}: it must end in .json")
    if not jobs:
        raise ValueError("grid is empty: it must have one or more")
    folder = out + ".pieces"
    os.makedirs(folder, exist_ok=True)
    _same_job(os.path.join(folder, "job.txt"), repr(jobs))
    paths = [os.path.join(folder, f"{index:06}.json") for index in range(len(jobs))]
    with _cluster(client, workers) as there:
        there.gather([there.submit(_result, make, job, path, pure=False) for job, path in zip(jobs, paths)])
    results = []
    for path in paths:
        with open(path, encoding="utf-8") as file:
            results.append(json.load(file))
    _write(out, results)
    if not keep:
        shutil.rmtree(folder)
    return results


def _result(make: Callable[..., Any], job: Any, path: str) -> None:
    """On a worker: one result, unless it is there."""
    if not os.path.exists(path):
        _write(path, make(*job))


def _write(path: str, value: Any) -> None:
    with open(path + ".part", "w", encoding="utf-8") as draft:
        json.dump(value, draft, indent=1)
    os.replace(path + ".part", path)


def _scored(file: str, scene: str | None, pupils: Any, engine: str) -> dict[str, Any]:
    return {"hologram": file, "scores": _scores(Hologram.load(file), scene, pupils, engine)}


def _traded(
    scene: str, display: str, colors: list[str], settings: dict[str, Any], pupils: Any, engine: str
) -> dict[str, Any]:
    begun = time.perf_counter()
    made = solve(scene, Display._of(_eyebox.Display.of_toml(display)), colors, engine=engine, **settings)
    if made.stopped == "interrupt":
        raise KeyboardInterrupt
    seconds = time.perf_counter() - begun
    return {"settings": settings, "seconds": seconds, "scores": _scores(made, None, pupils, engine)}


def _scores(hologram: Hologram, scene: Any, pupils: Any, engine: str) -> list[dict[str, Any]]:
    return [dict(score._asdict()) for score in hologram.score(scene, pupils, engine=engine)]


def _same_job(file: str, job: str) -> None:
    """Refuses pieces of another job."""
    try:
        with open(file, encoding="utf-8", errors="surrogateescape") as there:
            if there.read() != job:
                raise ValueError(f"{os.path.dirname(file)} has pieces of other scenes or settings: remove it, or use another name")
    except FileNotFoundError:
        with open(file + ".part", "w", encoding="utf-8", errors="surrogateescape") as draft:
            draft.write(job)
        os.replace(file + ".part", file)


def _sequence(job: Any) -> _eyebox.Sequence:
    names, display, colors, settings, rate, _ = job
    return _eyebox.Sequence(names, _eyebox.Display.of_toml(display), colors, settings, rate)


def _piece(job: Any, index: int, path: str, first: str | None, _after: Any = None) -> int:
    """On a worker: one hologram, unless it is there."""
    if os.path.exists(path):
        return 0
    before = None if first is None else Hologram.load(first)._native
    made = _sequence(job).piece(index, before, engine_of(job[-1]))
    if made is None:
        raise KeyboardInterrupt
    made.save(path)
    return 1


@contextlib.contextmanager
def _cluster(client: Any, workers: int) -> Iterator[Any]:
    if client is not None:
        yield client
        return
    try:
        from dask.distributed import Client, LocalCluster
    except ImportError:
        raise ImportError("eyebox.cluster needs Dask: pip install dask[distributed]") from None
    count = _arguments.count(workers, "workers", 4096)
    with LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None) as local, Client(local) as own:
        yield own
