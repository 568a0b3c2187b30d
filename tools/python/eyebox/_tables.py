"""Results as tables of pandas and as data sets of xarray."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from . import _notebook
from ._arguments import Pupil, wrong

if TYPE_CHECKING:
    import pandas
    import xarray


class Score(NamedTuple):
    """The quality of a reconstruction through a pupil, compared with its target image.

    Attributes
    ----------
    psnr : float or None
        PSNR over all colors in dB, or None if the target is black.
    ceiling : float or None
        Highest PSNR that any hologram can have there in dB, or None if it is unknown.
    ssim : float or None
        Mean SSIM over the colors, or None if the picture is smaller than the window of SSIM.
    against_clear : float or None
        PSNR in dB of the image past an obstruction, compared with the image of the same hologram through a clear
        pupil. It is None for a clear pupil.
    jod : float or None
        Quality in just-objectionable differences (ColorVideoVDP), 10 at most, or None if the pupil was not judged.
    """

    psnr: float | None
    ceiling: float | None
    ssim: float | None
    against_clear: float | None = None
    jod: float | None = None


class Summary(NamedTuple):
    """A summary of scores over pupils. Higher is better.

    Attributes
    ----------
    mean, median, worst, best : float
        Statistics of the scores.
    sd : float
        Standard deviation over the pupils.
    count : int
        Number of pupils that have the score.
    """

    mean: float
    median: float
    worst: float
    best: float
    sd: float
    count: int


class Scores(list[Score]):
    """The scores of :meth:`eyebox.Hologram.score`, a list with one :class:`eyebox.Score` per pupil.

    A notebook displays it as a table.

    Attributes
    ----------
    pupils : list of Pupil
        Pupil of each score, in meters.
    groups : list of str or None
        Group of each pupil, if the pupils were the groups of the paper.
    """

    def __init__(
        self, scores: Iterable[Score], pupils: Iterable[Sequence[float]], groups: Iterable[str] | None = None
    ) -> None:
        super().__init__()
        for one in scores:
            if not isinstance(one, Score):
                raise wrong(TypeError, "scores", f"has {one!r}: it must have eyebox.Score alone")
            self.append(one)
        self.pupils = [Pupil(*pupil) for pupil in pupils]
        self.groups = None if groups is None else [str(group) for group, _ in zip(groups, self)]

    def __reduce__(self) -> tuple[Any, ...]:
        return Scores, (list(self), self.pupils, self.groups)

    def summary(self, score: str = "psnr") -> Summary | None:
        """Returns statistics of one of the scores over the pupils that have it, or None if no pupil has it."""
        if score not in Score._fields:
            raise wrong(ValueError, "score", f"is {score!r}: it must be one of {', '.join(Score._fields)}")
        values = [value for one in self if (value := getattr(one, score)) is not None]
        if not values:
            return None
        mean, spread = statistics.fmean(values), statistics.pstdev(values)
        return Summary(mean, statistics.median(values), min(values), max(values), spread, len(values))

    def by_group(self) -> dict[str, Scores]:
        """Returns the scores of each group of the paper by its name, or all scores as one group without a name."""
        groups = self.groups or [""] * len(self)
        made: dict[str, Scores] = {}
        for name in dict.fromkeys(groups):
            at = [index for index, group in enumerate(groups) if group == name]
            own = None if self.groups is None else [name] * len(at)
            made[name] = Scores([self[index] for index in at], [self.pupils[index] for index in at], own)
        return made

    def to_dataframe(self) -> pandas.DataFrame:
        """Returns the pupils (m) and their scores as a table of pandas, with one row per pupil. Unknown is NaN."""
        return frame(self._rows())

    def to_xarray(self) -> xarray.Dataset:
        """Returns the scores as a data set of xarray along the dimension ``pupil``, with the pupils as coordinates."""
        return dataset(self._rows(), "pupil", ("group", *Pupil._fields))

    def _rows(self) -> list[dict[str, Any]]:
        rows = [{**pupil._asdict(), **score._asdict()} for pupil, score in zip(self.pupils, self)]
        return rows if self.groups is None else [{"group": group, **row} for group, row in zip(self.groups, rows)]

    def _repr_html_(self) -> str:
        names = [f"{name} (mm)" for name in Pupil._fields]
        names += ["PSNR (dB)", "ceiling (dB)", "SSIM", "against clear (dB)", "JOD"]
        rows = [(*(1e3 * one for one in pupil), *score) for pupil, score in zip(self.pupils, self)]
        return _notebook.table(names, rows)


class Rows(list[dict[str, Any]]):
    """The results of :mod:`eyebox.cluster`, a list with one dict per hologram or per setting.

    A notebook displays it as a table.
    """

    def to_dataframe(self) -> pandas.DataFrame:
        """Returns the results as a table of pandas, with one row per pupil. Settings have columns of their own."""
        return frame(self._rows())

    def to_xarray(self) -> xarray.Dataset:
        """Returns the results as a data set of xarray along the dimension ``row``, as :meth:`to_dataframe`."""
        rows = self._rows()
        scores = (*Score._fields, "seconds")
        return dataset(rows, "row", tuple(dict.fromkeys(name for row in rows for name in row if name not in scores)))

    def _rows(self) -> list[dict[str, Any]]:
        rows = []
        for one in self:
            about = {name: value for name, value in one.items() if name not in ("scores", "settings")}
            about |= one.get("settings", {})
            rows += [{**about, "pupil": at, **score} for at, score in enumerate(one["scores"])]
        return rows

    def _repr_html_(self) -> str:
        rows = self._rows()
        names = list(dict.fromkeys(name for row in rows for name in row))
        return _notebook.table(names, [[row.get(name) for name in names] for row in rows])


def frame(rows: list[dict[str, Any]]) -> pandas.DataFrame:
    """Returns rows as a table of pandas."""
    try:
        import pandas
    except ImportError:
        raise ImportError("to_dataframe needs pandas: pip install pandas") from None
    made = pandas.DataFrame(rows)
    # A column of None alone, or of None and numbers, is a column of numbers of which some are unknown.
    for name in made.columns:
        if made[name].map(lambda value: value is None or isinstance(value, (int, float))).all():
            if made[name].isna().any():
                made[name] = made[name].astype(float)
    return made


def xarray_module() -> Any:
    """Returns the module xarray, which is optional."""
    try:
        import xarray
    except ImportError:
        raise ImportError("to_xarray needs xarray: pip install xarray") from None
    return xarray


def dataset(rows: list[dict[str, Any]], dimension: str, coordinates: Sequence[str]) -> xarray.Dataset:
    """Returns rows as a data set of xarray along one dimension."""
    made = xarray_module().Dataset
    columns = frame(rows)
    each = {name: (dimension, columns[name].to_numpy()) for name in columns.columns}
    where = {name: each[name] for name in coordinates if name in each}
    return made({name: value for name, value in each.items() if name not in where}, coords=where)
