"""Runs pieces of work on a Dask cluster, which is given or is started on this machine for the call."""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import signal
from collections.abc import Sequence
from typing import Any, Callable, Iterable, Iterator

from . import _arguments


class _Refused:
    """An error of a piece. It is a result for Dask, which would print its own lines about an exception."""

    def __init__(self, error: Exception) -> None:
        self.error = error


def submit(there: Any, work: Callable[..., Any], *arguments: Any) -> Any:
    return there.submit(_answer, work, *arguments, pure=False)


def _answer(work: Callable[..., Any], *arguments: Any) -> Any:
    """Returns the result of a piece, or its error. A piece that needs the result of another one passes its error on."""
    for argument in arguments:
        for one in argument if isinstance(argument, list) else [argument]:
            if isinstance(one, _Refused):
                return one
    try:
        return work(*arguments)
    except (ValueError, TypeError, OSError) as error:
        return _Refused(error)


def gather(futures: Sequence[Any]) -> list[Any]:
    """Returns the results of pieces. The first error ends the others."""
    from dask.distributed import as_completed

    for future in as_completed(futures):
        result = future.result()
        if isinstance(result, _Refused):
            for other in futures:
                other.cancel()
            raise result.error
    return [future.result() for future in futures]


def gather_in_turn(pieces: Iterable[Callable[[], Any]], at_once: int) -> None:
    """Runs pieces in their order, as many at once as there are workers. The first error ends the others.

    Dask would give all pieces to the worker that has the result of the first one, and then move them in any order.
    """
    from dask.distributed import as_completed

    waiting = iter(pieces)
    running = as_completed([start() for start in itertools.islice(waiting, at_once)])
    for future in running:
        result = future.result()
        if isinstance(result, _Refused):
            raise result.error
        if (start := next(waiting, None)) is not None:
            running.add(start())


def threads_of(index: int, count: int, client: Any, workers: int) -> int | None:
    """Returns the threads of a piece of a sequence if other workers of this machine are idle, otherwise `None`.

    The first piece determines the exposure, so it is alone. The last pieces may be fewer than the workers. Machines of
    a given client are not known.
    """
    if client is not None:
        return None
    last = (count - 1) % workers
    beside = 1 if index == 0 else last if index >= count - last else workers
    return None if beside == workers else max(_threads() // beside, 1)


def _threads() -> int:
    stated = os.environ.get("RAYON_NUM_THREADS", "")
    return int(stated) if stated.isdecimal() else os.cpu_count() or 1


@contextlib.contextmanager
def cluster(client: Any, workers: Any, max_workers: Any) -> Iterator[Any]:
    if client is not None:
        if max_workers is not None:
            text = "is for the default cluster: call adapt(minimum=1, maximum=N) of your cluster"
            raise _arguments.wrong(TypeError, "max_workers", text)
        yield client
        return
    try:
        import dask
        from dask.distributed import Client, LocalCluster
    except ImportError:
        raise ImportError("eyebox.cluster needs Dask: pip install dask[distributed]") from None
    count = _arguments.count(workers, "workers", 4096)
    most = count if max_workers is None else _arguments.count(max_workers, "max_workers", 4096, least=count)
    # The workers share the cores of the machine. If each had all cores, they would wait for each other.
    own = {"RAYON_NUM_THREADS": str(max(_threads() // most, 1))}
    # Workers would warn of pieces that end with the call after the first error.
    how = {"threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.ERROR, "env": own}
    # Dask makes workers return memory to the system at once. A solve would then ask for it again in every step.
    spawn = "distributed.nanny.pre-spawn-environ"
    kept = {name: value for name, value in dask.config.get(spawn, {}).items() if name != "MALLOC_TRIM_THRESHOLD_"}
    with dask.config.set({spawn: kept}), LocalCluster(n_workers=count, **how) as local, Client(local) as one:
        if most > count:
            local.adapt(minimum=count, maximum=most)
        try:
            yield one
        except KeyboardInterrupt:
            # A worker would end only after its piece. It can be killed, because each file is whole or not there.
            for nanny in local.workers.values():
                nanny.close_gracefully()
                if nanny.pid is not None:
                    os.kill(nanny.pid, getattr(signal, "SIGKILL", signal.SIGTERM))
            raise
