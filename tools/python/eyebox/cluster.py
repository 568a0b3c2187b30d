"""Computes sequences, far fields, scores and trade-offs on several machines, as graphs of pieces for Dask.

``pip install dask[distributed]`` installs Dask. The first hologram of a sequence determines the exposure, and the
others are independent of each other. Any free worker solves a hologram into its place in the one file of the sequence.
Finished work is not repeated, and a worker that dies loses only its current piece. There is no merge step, and the file
has the bytes that one process writes. The pieces of a far field are visits to regions. Regions that share no pixel are
solved in parallel. A region that shares pixels with others waits for the regions before it. Workers and caller must see
the same folders.

>>> import eyebox.cluster
>>> scenes = [f"builtin:plane?depth={depth}" for depth in range(64)]
>>> eyebox.cluster.solve_sequence(scenes, "film.zarr", display=..., client=...)  # doctest: +SKIP
"""

from __future__ import annotations

import contextlib
import fractions
import functools
import json
import numbers
import os
import shutil
from typing import TYPE_CHECKING, Any, Callable, Iterable, Mapping

import numpy as np

from . import _arguments, _cluster_work, _eyebox
from ._cluster_pool import cluster, gather, gather_in_turn, submit, threads_of
from ._display import Display, display_of
from ._tables import Rows

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._settings import FarFieldFields, JobFields
    from ._types import ArrayLike, Colors, DisplayLike, Path, Pupils, Quantity, Whole

__all__ = ["evaluate", "solve_far_field", "solve_sequence", "tradeoff"]


def solve_sequence(
    scenes: Iterable[Path | ArrayLike],
    out: Path,
    display: DisplayLike = "paper",
    color: Colors | None = None,
    *,
    client: Any = None,
    workers: Whole = 2,
    max_workers: Whole | None = None,
    rate: Quantity | fractions.Fraction = 30,
    engine: str = "auto",
    **settings: Unpack[JobFields],
) -> int:
    """Solves a sequence of scenes on the workers of a Dask cluster.

    Parameters
    ----------
    scenes : sequence of str, path or array
        "builtin:NAME", folders of views or pictures that all workers see, one per hologram. Arrays of views, also one
        array whose first axis is the hologram, are stored next to the sequence in a folder that ends in ``.scenes``.
    out : path
        Path of the sequence, NAME.zarr. An interrupted sequence of the same scenes and settings is continued.
    display, color
        Arguments of :func:`eyebox.solve`.
    client : dask.distributed.Client, optional
        Client of the cluster, such as one of dask_jobqueue for Slurm or of dask_kubernetes. The default is a cluster on
        this machine for the duration of the call.
    workers : int
        Number of processes of the default cluster.
    max_workers : int, optional
        Highest number of processes. The default cluster then starts with ``workers`` and adapts to the work. A cluster
        of your own does the same after ``cluster.adapt(minimum=2, maximum=100)``.
    rate : int or Fraction
        Holograms per second.
    engine : str
        Engine of each worker, either "auto", "cpu" or "vulkan".
    **settings
        Arguments of :func:`eyebox.solve`. Every hologram begins cold.

    Returns
    -------
    int
        Number of holograms that this call solved. The others were there before.

    Raises
    ------
    EyeboxError
        If a piece fails.
    """
    display = display_of(display)
    out = _store(out)
    names = _scenes(scenes, out)
    rate = _arguments.quantity(rate, "Hz", "rate") if isinstance(rate, str) else rate
    try:
        shown = fractions.Fraction(rate if isinstance(rate, numbers.Rational) else _arguments.number(rate, "rate"))
    except (TypeError, ValueError, OverflowError, ZeroDivisionError):
        right = "a number of holograms per second, or a Fraction"
        raise _arguments.wrong(TypeError, "rate", f"is {rate!r}: it must be {right}") from None
    if not 0 < shown <= 100_000 or max(shown.as_integer_ratio()) >= 1 << 32:
        right = "above 0, at most 100000, as a fraction of whole numbers"
        raise _arguments.wrong(ValueError, "rate", f"is {rate!r}: it must be {right}")
    colors = _arguments.colors(color, list(display.wavelengths))
    job = (tuple(names), _text(display), tuple(colors), _arguments.toml(dict(settings)), shown.as_integer_ratio(), out, engine)
    before = _eyebox.Sequence.there(out) if os.path.exists(out) else 0
    with cluster(client, workers, max_workers) as there:
        own = [threads_of(index, len(names), client, max_workers or workers) for index in range(len(names))]
        first = submit(there, _cluster_work.begun, job, own[0])
        idle = min(sum(there.nthreads().values()), len(names)) - 1
        beside = [submit(there, _cluster_work.prepared, job) for _ in range(idle)]
        piece = functools.partial(submit, there, _cluster_work.piece)
        if client is None and max_workers is None:
            gather([first, *beside])
            gather_in_turn([functools.partial(piece, job, i, own[i]) for i in range(1, len(names))], workers)
        else:
            # A cluster that adapts to the work must see all of it. The first piece passes the job to the others, so each
            # worker fetches it once for any number of pieces.
            gather([first, *beside, *(piece(first, i, own[i]) for i in range(1, len(names)))])
    _eyebox.Sequence.finish(out)
    return len(names) - before


def solve_far_field(
    scene: Path | ArrayLike,
    out: Path,
    display: DisplayLike = "far-field",
    color: Colors | None = None,
    *,
    steps: Whole = 8,
    passes: Whole = 3,
    memory: Whole | str = 4 << 30,
    picture: Whole = 1024,
    client: Any = None,
    workers: Whole = 2,
    max_workers: Whole | None = None,
    engine: str = "auto",
    **settings: Unpack[FarFieldFields],
) -> int:
    """Solves a far field larger than memory, region by region, on the workers of a Dask cluster.

    Regions that share no pixel are solved in parallel. A region that shares pixels with others begins with the results
    of the regions before it, so the file has the bytes that one machine writes. The number of workers with work is the
    number of regions that are apart from each other.

    Parameters
    ----------
    scene : str, path or array
        "builtin:NAME", a folder of views or a picture that all workers see, or an array of views, which is stored next
        to the hologram.
    out : path
        Path of the hologram, NAME.zarr. An interrupted hologram of the same scene and settings is continued.
    display, color
        Arguments of :func:`eyebox.solve`. The display must be a far field.
    steps : int
        Steps of one visit to a region.
    passes : int
        Passes over the SLM.
    memory : int or str
        Memory limit of each worker in bytes, or a text such as "4GiB". It determines the size of the regions, so it is
        part of the settings.
    picture : int
        Pixels along each axis of the scene's views.
    client, workers, max_workers, engine
        Arguments of :func:`solve_sequence`. All workers must compute on the same kind of engine.
    **settings
        Arguments of :func:`eyebox.solve`.

    Returns
    -------
    int
        Number of visits to regions that this call made. The others were done before.
    """
    display = display_of(display)
    out = _store(out)
    name = _scene(scene, out)
    colors = _arguments.colors(color, list(display.wavelengths))
    for setting in ("levels", "method", "psnr", "pupils", "quality", "seconds", "storage"):
        if setting in settings:
            text = "is not for a far field that is solved region by region: leave it out"
            raise _arguments.wrong(ValueError, setting, text)
    text = _arguments.toml({"steps": _arguments.count(steps, "steps", 1024), **settings})
    most = 1 << 50
    memory = int(_arguments.quantity(memory, "B", "memory")) if isinstance(memory, str) else memory
    request = (_arguments.count(passes, "passes"), _arguments.count(memory, "memory", most), _arguments.count(picture, "picture"))
    job = (name, _text(display), tuple(colors), text, request, out, engine)
    with cluster(client, workers, max_workers) as there:
        first = submit(there, _cluster_work.far_field_begun, job)
        [(_, done, after)] = gather([first])
        visits: list[Any] = []
        for visit, before in enumerate(after):
            visits.append(submit(there, _cluster_work.visit, first, visit, [visits[i] for i in before]))
        gather(visits)
    _eyebox.FarField.finish(out)
    return done.count(False)


def evaluate(
    holograms: Iterable[Path],
    out: Path,
    pupils: Pupils | None = None,
    *,
    scene: Path | ArrayLike | None = None,
    client: Any = None,
    workers: Whole = 2,
    max_workers: Whole | None = None,
    engine: str = "auto",
    keep_pieces: bool = False,
) -> Rows:
    """Scores holograms on the workers of a Dask cluster, each hologram on one worker.

    Parameters
    ----------
    holograms : sequence of path
        Files of holograms that all workers see. Each hologram of a sequence is scored.
    out : path
        Path of the scores, NAME.json. Existing scores of the same holograms are not computed again.
    pupils : sequence of (x, y, diameter, depth), optional
        Pupils of each score, as in :meth:`eyebox.Hologram.score`.
    scene : str, path or array, optional
        Scene of all holograms. The default for each hologram is the scene of its solve.
    client, workers, max_workers, engine
        Arguments of :func:`solve_sequence`.
    keep_pieces : bool
        Keep the pieces. Their folder is next to the scores, and its name ends in ``.pieces``.

    Returns
    -------
    list of dict
        One dict per hologram. ``hologram`` is its path, and ``at`` is its number in a sequence (from 0). ``scores`` has
        one dict per pupil, with the fields of :class:`eyebox.Score`. These are ``psnr`` and ``ceiling`` (dB), ``ssim``,
        and ``against_clear`` (dB), which is None because the pupils are clear. ``to_dataframe()`` and ``to_xarray()``
        return the results as tables.
    """
    files = _paths(holograms, "holograms")
    scene = None if scene is None else _scene(scene, _arguments.path(out, "out"))
    # Each hologram converts depths from texts with its own focal length.
    at = None if pupils is None else _arguments.pupils(pupils, None)
    jobs = [(file, index, _when(file), scene, at, engine) for file in files for index in _indices(file)]
    return _pieces(_cluster_work.scored, jobs, out, (client, workers, max_workers), keep_pieces)


def tradeoff(
    scene: Path | ArrayLike,
    out: Path,
    grid: Iterable[Mapping[str, Any]],
    display: DisplayLike = "paper",
    color: Colors | None = None,
    *,
    pupils: Pupils | None = None,
    client: Any = None,
    workers: Whole = 2,
    max_workers: Whole | None = None,
    engine: str = "auto",
    keep_pieces: bool = False,
) -> Rows:
    """Solves a scene with each of several settings on the workers of a Dask cluster, and scores the results.

    Parameters
    ----------
    scene : str, path or array
        Scene that all workers see, or an array of views, which is stored next to the results.
    out : path
        Path of the results, NAME.json. Existing results of the same settings are not computed again.
    grid : sequence of dict
        Settings of :func:`eyebox.solve` by their names.
    display, color
        Arguments of :func:`eyebox.solve`.
    pupils
        Argument of :meth:`eyebox.Hologram.score`.
    client, workers, max_workers, engine, keep_pieces
        Arguments of :func:`evaluate`.

    Returns
    -------
    list of dict
        One dict per item of ``grid``. ``settings`` is the item, ``seconds`` is the time of its solve on its worker, and
        ``scores`` is as in :func:`evaluate`.
    """
    display = display_of(display)
    name = _scene(scene, _arguments.path(out, "out"))
    colors = _arguments.colors(color, list(display.wavelengths))
    try:
        settings = [_arguments.plain(dict(one)) for one in grid]
    except (TypeError, ValueError):
        raise _arguments.wrong(TypeError, "grid", f"is {grid!r}: it must be a sequence of dicts of settings") from None
    for one in settings:
        _arguments.toml(one)
    at = None if pupils is None else _arguments.pupils(pupils, lambda: display.focal_length)
    given = (name, _text(display), colors)
    jobs = [(*given, one, at, engine) for one in settings]
    return _pieces(_cluster_work.traded, jobs, out, (client, workers, max_workers), keep_pieces)


def _text(display: Display) -> tuple[str, str | None]:
    """Returns a display as workers receive it, with its text and the record of its file."""
    return display.to_toml(), display._native.file


def _store(out: Any) -> str:
    """Returns the absolute path of a hologram."""
    out = os.path.abspath(_arguments.path(out, "out"))
    if not out.endswith(".zarr"):
        raise _arguments.wrong(ValueError, "out", f"is {out!r}: it must end in .zarr")
    return out


def _paths(values: Any, what: str) -> list[str]:
    """Returns several names or paths as texts."""
    if isinstance(values, (str, bytes)) or not hasattr(values, "__iter__"):
        raise _arguments.wrong(TypeError, what, f"is {values!r}: it must be a sequence of names or paths")
    paths = [_arguments.path(value, what) for value in values]
    if not paths:
        raise _arguments.wrong(ValueError, what, "is empty: it must have one or more")
    return paths


def _scenes(values: Any, out: str) -> list[str]:
    """Returns the names of scenes. Arrays are stored next to a file, where all workers see them."""
    if isinstance(values, (str, bytes)) or not hasattr(values, "__iter__"):
        raise _arguments.wrong(TypeError, "scenes", f"is {values!r}: it must be a sequence of names, paths or arrays")
    names = [_scene(value, out, at) for at, value in enumerate(values)]
    if not names:
        raise _arguments.wrong(ValueError, "scenes", "is empty: it must have one or more")
    return names


def _scene(value: Any, out: str, at: int = 0) -> str:
    """Returns the name of a scene. An array is stored next to a file, unless the same array is there."""
    if _arguments.is_path(value):
        return _arguments.path(value, "scene")
    if not _arguments.is_array(value):
        raise _arguments.wrong(TypeError, "scene", f"is {value!r}: it must be a name, a path or an array of views")
    plain = _arguments.array(value, "scene", "(view row, view column, row, column[, 3])")
    # The same checks as for a scene, before any worker starts.
    _arguments.light_field(plain, "scene")
    if plain.ndim < 4:
        plain = plain[None, None]
    if plain.dtype.kind != "u":
        plain = np.asarray(plain, np.float32)
    folder = os.path.abspath(out) + ".scenes"
    os.makedirs(folder, exist_ok=True)
    path = os.path.join(folder, f"{at:06}.npy")
    with contextlib.suppress(OSError, ValueError):
        there = np.load(path, mmap_mode="r", allow_pickle=False)
        if there.dtype == plain.dtype and np.array_equal(there, plain):
            return path
    with open(path + ".part", "wb") as draft:
        np.save(draft, np.ascontiguousarray(plain))
    os.replace(path + ".part", path)
    return path


def _pieces(
    make: Callable[..., Any], jobs: list[Any], out: Any, there: tuple[Any, Any, Any], keep: bool
) -> Rows:
    """Computes independent pieces. Each result has its own file until all are in one file.

    ``there`` are the client, and the number of workers without one.
    """
    client, workers, max_workers = there
    out = os.path.abspath(_arguments.path(out, "out"))
    if not out.endswith(".json"):
        raise _arguments.wrong(ValueError, "out", f"is {out!r}: it must end in .json")
    if not jobs:
        raise _arguments.wrong(ValueError, "grid", "is empty: it must have one or more")
    folder = out + ".pieces"
    os.makedirs(folder, exist_ok=True)
    _same_job(os.path.join(folder, "job.txt"), repr(jobs))
    paths = [os.path.join(folder, f"{index:06}.json") for index in range(len(jobs))]
    with cluster(client, workers, max_workers) as there:
        gather([submit(there, _cluster_work.result, make, job, path) for job, path in zip(jobs, paths)])
    results = Rows()
    for path in paths:
        with open(path, encoding="utf-8") as file:
            results.append(json.load(file))
    _cluster_work.write(out, results)
    if not keep:
        shutil.rmtree(folder)
    return results


def _indices(file: str) -> list[int | None]:
    """Returns the numbers of the holograms in a sequence, or [None] for a single hologram."""
    try:
        count = _eyebox.Hologram.count(os.path.abspath(file))
    except _eyebox.EyeboxError:
        # The worker that opens the file reports its error.
        return [None]
    return [None] if count is None else list(range(count))


def _when(file: str) -> int | None:
    """Returns a number that changes when a hologram is written again."""
    try:
        return os.stat(os.path.join(file, "zarr.json")).st_mtime_ns
    except OSError:
        return None


def _same_job(file: str, job: str) -> None:
    """Refuses a folder with pieces of another job."""
    try:
        with open(file, encoding="utf-8", errors="surrogateescape") as there:
            if there.read() != job:
                raise ValueError(f"{os.path.dirname(file)} has pieces of other scenes or settings: remove it, or use another name")
    except FileNotFoundError:
        with open(file + ".part", "w", encoding="utf-8", errors="surrogateescape") as draft:
            draft.write(job)
        os.replace(file + ".part", file)
