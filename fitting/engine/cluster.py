"""Workers of a dask scheduler as an executor: the one door to ``distributed``.

Files go to each worker once, also to those that come later, and are known there by their content.
"""

from __future__ import annotations

import logging
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import urlsplit

from distributed import Client, KilledWorker, Worker, WorkerPlugin

import fitting
from fitting.engine.run import AHEAD, NeededFile, Place, keep
from fitting.text.errors import BadInput
from fitting.text.files import read_whole

CONNECTING_S = 30.0


class Files(WorkerPlugin):
    """Files that every worker keeps in a folder of its own, which goes with it.

    Args:
        contents: of the files.
    """

    def __init__(self, contents: Mapping[NeededFile, bytes]) -> None:
        self.contents, self.version = contents, fitting.__version__

    def setup(self, worker: Worker) -> None:
        """Keep the files.

        Args:
            worker: of which it is asked.

        Raises:
            BadInput: it has another version of this program, whose numbers may be others.
        """
        if fitting.__version__ != self.version:
            raise BadInput(f"fmu-fit {fitting.__version__} there, wanted {self.version}")
        keep(self.contents, Path(worker.local_directory))


@contextmanager
def _quiet() -> Iterator[None]:
    """No traceback of a scheduler that is lost: who waits for its results gets an error."""
    logger = logging.getLogger("distributed.client")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


@contextmanager
def cluster(scheduler: str, files: Sequence[NeededFile]) -> Iterator[Place]:
    """The workers of a scheduler, each with its copy of some files.

    The scheduler does the items of a lost worker again by itself: as often as its
    ``distributed.scheduler.allowed-failures`` allows.

    Args:
        scheduler: its address, as "tcp://10.0.0.1:8786".
        files: that `fitting.engine.run.place_of` finds on the workers.

    Raises:
        BadInput: no scheduler there, or a worker that cannot be used.
    """
    place = f"scheduler: found {scheduler!r}"
    wanted = "wanted the address of a dask scheduler, as tcp://10.0.0.1:8786"
    # a host and a port: a client that is made without waits for a minute when it goes
    try:
        parts = urlsplit(scheduler if "://" in scheduler else f"tcp://{scheduler}")
        # one of the same process, as "inproc://10.0.0.1/7/1", has no port
        known = parts.scheme == "inproc" or None not in (parts.hostname, parts.port)
    except ValueError as error:
        raise BadInput(f"{place}, {error}; {wanted}") from error
    if not known:
        raise BadInput(f"{place}, which has no host and port; {wanted}")
    contents = {file: read_whole(Path(file.path)) for file in files}
    name = f"fmu-fit-{secrets.token_hex(8)}"  # of this ensemble alone, which takes it back
    try:
        client = Client(scheduler, timeout=CONNECTING_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise BadInput(f"{place}, {str(error) or 'no answer'}; {wanted}") from error
    with _quiet(), client:
        try:
            client.register_plugin(Files(contents), name=name)
        except Exception as error:  # of any kind: it comes from the workers
            raise BadInput(f"scheduler: workers of {scheduler} cannot be used: {error}") from error
        executor = client.get_executor(pure=False)
        try:
            ahead = max(AHEAD, 2 * sum(client.nthreads().values()))
            yield Place(executor, (KilledWorker,), repeats=0, ahead=ahead)
        finally:
            executor.shutdown(wait=False)
            with suppress(Exception):  # of any kind, where the scheduler is gone
                client.unregister_worker_plugin(name)
