"""Ctrl-C while something is computed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Callable

if TYPE_CHECKING:
    from ._hologram import Hologram


class Interrupted(KeyboardInterrupt):
    """Ctrl-C ended a solve or a refinement.

    ``except KeyboardInterrupt`` catches it, too. It is raised at once, while the step that is under way still runs.
    """

    _best: Callable[[], Hologram | None] | None = None
    _hologram: Hologram | None = None

    @property
    def hologram(self) -> Hologram | None:
        """The best hologram so far; None if there is none. The first use waits for the end of the step that is under way."""
        if self._best is not None:
            self._hologram, self._best = self._best(), None
        return self._hologram


def interrupted(error: KeyboardInterrupt, best: Callable[[], Hologram | None]) -> KeyboardInterrupt:
    """``error``, with the best hologram on it."""
    if type(error) is not KeyboardInterrupt:
        return error
    made = Interrupted(*error.args)
    made._best = best
    return made.with_traceback(error.__traceback__)
