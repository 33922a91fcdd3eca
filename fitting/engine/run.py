"""Many independent items through one executor: results as they end, a lost worker's item again.

Nothing of an item is kept once its result is out; what waits is bounded. Files that items need are
found by their path on this machine, by their content on others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import TypeVar

from fitting.engine.local import LocalProcesses
from fitting.text.choices import MOST_WORKERS
from fitting.text.errors import BadInput
from fitting.text.files import read_whole


@dataclass(frozen=True)
class NeededFile:
    """A file by its path, and by the SHA-256 of its content."""

    path: str
    digest: str

    @classmethod
    def of(cls, path: Path) -> NeededFile:
        """The file as it is now.

        Args:
            path: of the file.

        Raises:
            BadInput: it cannot be read.
        """
        return cls(str(path.resolve()), sha256(read_whole(path)).hexdigest())


#: Where this process has files that were sent to it, by their digests.
_SENT: dict[str, Path] = {}


def keep(contents: Mapping[NeededFile, bytes], folder: Path) -> None:
    """Write files that were sent to this process.

    Args:
        contents: of the files.
        folder: of this process.
    """
    for file, content in contents.items():
        path = folder / file.digest / Path(file.path).name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        _SENT[file.digest] = path


def place_of(file: NeededFile) -> Path:
    """Where this process finds a file.

    Args:
        file: that is needed.

    Raises:
        BadInput: it was not sent, and nothing is at its path.
    """
    path = _SENT.get(file.digest, Path(file.path))
    if not path.is_file():
        raise BadInput(f"{path}: no such file on the machine of this worker")
    return path


Item = TypeVar("Item")
Result = TypeVar("Result")

#: Items that are handed over and have not ended: enough for any executor to have the next at hand.
AHEAD = 256


@dataclass(frozen=True)
class Place:
    """Where items run.

    ``losses`` are the exceptions of a worker that was lost, ``repeats`` how often its item
    is then done again: none where the executor does that itself. ``ahead`` items are handed over
    before the first has ended.
    """

    executor: Executor
    losses: tuple[type[BaseException], ...] = (BrokenExecutor,)
    repeats: int = 1
    ahead: int = AHEAD


def run(
    work: Callable[[Item], Result], items: Iterable[Item], place: Place
) -> Iterator[tuple[Item, Result | None, str]]:
    """Results of independent items, as they end; what has not started is left at the end.

    Each item comes with its result, or None and the words on why its worker was lost.

    Args:
        work: a function of a module, called in the executor with each item.
        items: are taken as there is room.
        place: where it runs.

    Raises:
        BrokenExecutor: the executor as a whole takes no more.
        Exception: whatever ``work`` raises.
    """
    coming = iter(items)
    running: dict[Future[Result], tuple[Item, int]] = {}  # items, and how often each was lost

    def submit(item: Item, lost: int = 0) -> None:
        running[place.executor.submit(work, item)] = item, lost

    try:
        while True:
            for item in islice(coming, place.ahead - len(running)):
                submit(item)
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                item, lost = running.pop(future)
                try:
                    result = future.result()
                except place.losses as loss:
                    if lost < place.repeats:
                        submit(item, lost + 1)
                    else:
                        yield item, None, str(loss) or type(loss).__name__
                    continue
                except CancelledError:  # nothing here has cancelled what is waited for
                    raise BrokenExecutor("it has given up what it had been handed") from None
                yield item, result, ""
    finally:
        for future in running:
            future.cancel()


#: What names a place: an executor, the address of a dask scheduler, a number of processes here.
Where = Executor | str | int


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
        try:
            from fitting.engine.cluster import cluster  # who has no cluster needs no such package
        except ImportError as error:
            if error.name not in ("dask", "distributed"):
                raise
            raise BadInput(
                "scheduler: wants the package distributed; install fmu-fit[cluster], here and on "
                "the workers"
            ) from None
        with cluster(where, files) as place:
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
