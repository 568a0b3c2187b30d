"""The exception of ctrl-C during a computation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Callable

if TYPE_CHECKING:
    from ._hologram import Hologram


class Interrupted(KeyboardInterrupt):
    """Ctrl-C ended a solve or a refinement.

    ``except KeyboardInterrupt`` also catches it. It is raised at once, while the current step still runs.
    """

    _best: Callable[[], Hologram | None] | None = None
    _hologram: Hologram | None = None

    @property
    def hologram(self) -> Hologram | None:
        """Best hologram until ctrl-C, or None if there is none. The first use waits for the end of the current step."""
        if self._best is not None:
            self._hologram, self._best = self._best(), None
        return self._hologram


def interrupted(error: KeyboardInterrupt, best: Callable[[], Hologram | None]) -> KeyboardInterrupt:
    """Returns ``error`` with the best hologram, if it is a plain KeyboardInterrupt."""
    if type(error) is not KeyboardInterrupt:
        return error
    made = Interrupted(*error.args)
    made._best = best
    return made.with_traceback(error.__traceback__)
