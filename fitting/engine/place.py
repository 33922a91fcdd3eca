"""Where independent items run: what people may name, opened and closed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager

from fitting.engine.files import NeededFile
from fitting.engine.local import LocalProcesses
from fitting.engine.run import Place
from fitting.text.errors import BadInput

#: What names a place: an executor, the address of a dask scheduler, a number of processes here.
Where = Executor | str | int

#: More processes than that are a slip of the pen on the machines of today.
MOST_WORKERS = 256


@contextmanager
def opened(where: Where, files: Sequence[NeededFile]) -> Iterator[Place]:
    """A place for items, closed at the end: what is under way then is not waited for.

    Args:
        where: An executor, which stays open; the address of a dask scheduler; or a number of
            processes of this machine.
        files: That the items need; an executor of others has them by their paths.

    Raises:
        BadInput: no such scheduler, no package for it, no such number of processes.
    """
    if isinstance(where, Executor):
        yield Place(where)
    elif isinstance(where, str):
        with _cluster(where, files) as place:
            yield place
    else:
        if not 1 <= where <= MOST_WORKERS:
            raise BadInput(f"workers is {where!r}, wanted 1 to {MOST_WORKERS}")
        executor = LocalProcesses(where)
        try:
            yield Place(executor)
            executor.shutdown()
        finally:
            executor.shutdown(wait=False)


def _cluster(scheduler: str, files: Sequence[NeededFile]) -> AbstractContextManager[Place]:
    try:
        from fitting.engine.cluster import cluster  # who has no cluster needs no such package
    except ImportError as error:
        if error.name not in ("dask", "distributed"):
            raise
        raise BadInput(
            "scheduler: wants the package distributed; install fmu-fit[cluster], here and on the "
            "workers"
        ) from None
    return cluster(scheduler, files)
