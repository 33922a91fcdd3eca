"""An FMU as its users see it: batches of runs in, arrays out, failures in sentences."""

from __future__ import annotations

import logging
import math
import os
import re
import time
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing import connection
from pathlib import Path
from threading import RLock
from types import TracebackType
from typing import Literal

from fitting.fmu.archive import unpack
from fitting.fmu.description import FmuDescription, read_description
from fitting.fmu.isolation import Isolation
from fitting.fmu.runs import Counts, Run, RunRequest, RunRequests
from fitting.fmu.worker.messages import NotAnAnswer, Reply, Task
from fitting.fmu.worker.process import WorkerProcess
from fitting.fmu.worker.reuse import Verdict, refused
from fitting.text.arrays import FloatArray, is_real, is_whole
from fitting.text.choices import MOST_WORKERS
from fitting.text.errors import BadInput, FmuFailure, NoAnswer, shown
from fitting.text.scratch import Scratch

_log = logging.getLogger(__name__)

POLL_S = 0.1
CLOSING_S = 2.0
#: How long others may go on with a batch that has failed: about what it takes to start them anew.
SPARED_S = 0.3
MEDDLED = "wrote into the pipe by which its process answers"
MOST_WARNINGS, DROPPED = 50, "… further warnings dropped"
#: Runs that a worker is sent at once: it holds all of them, and what they gave.
MOST_SENT = 2_000
_PLAIN = re.compile(r"[A-Za-z0-9/._:\\-]+")


class OutOfTime(Exception):
    """A batch that was to begin after the processor time that its caller allows."""


class _Open:
    """What has to be closed: processes by number, the unpacked FMU, and whose they are."""

    def __init__(self, workers: int) -> None:
        self.processes: list[WorkerProcess | None] = [None] * workers
        self.scratch: Scratch | None = None
        self.owner = os.getpid()

    def close(self) -> None:
        """End the processes and remove the unpacked FMU; nothing in a fork of the owner."""
        if os.getpid() != self.owner:
            return
        alive = [worker for worker in self.processes if worker is not None]
        self.processes[:] = [None] * len(self.processes)
        for worker in alive:
            worker.ask_to_end()
        until = time.monotonic() + CLOSING_S
        for worker in alive:
            worker.end(max(0.0, until - time.monotonic()))
        scratch, self.scratch = self.scratch, None
        if scratch is not None:
            scratch.remove()

    @property
    def home(self) -> Path | None:
        """Folder of the unpacked FMU and the workers' files."""
        return None if self.scratch is None else self.scratch.path


@dataclass(kw_only=True)
class _Job:
    """A batch on its way: requests, the runs they were made of, and their results."""

    runs: Sequence[Run]
    requests: list[RunRequest]
    results: dict[int, FloatArray]
    todo: dict[int, list[int]]  # by worker: numbers of the runs that it has still to do
    repeated: set[int] = field(default_factory=set)  # workers that were killed and replaced


class FmuWorkers:
    """Processes that hold an FMU open and take batches of runs.

    Threads take turns at it, and a fork of the process has processes of its own; pickled, it is
    opened anew, from the same file, where it is unpickled.

    They are started when the first runs come, and end with `close`, at the end of a ``with`` block,
    when nothing refers to this object any more, or with the caller, however that ends.

    ``fmu`` is its path, or its description, which also has the interface by which it is run;
    ``workers`` processes; ``timeout_s`` longest time for one run; ``reuse`` "auto": instances are
    reset and reused where a repeated run is the same bit for bit, "never": a new one for each run;
    ``timeout_name`` what the user calls the time limit, for the message when it is over;
    ``isolation`` limits of what the FMU may take, None: those of the caller.

    ``warnings`` collects the different warnings that the FMU logged, ``latest_warnings`` those of
    the last call of ``run``; ``memory_bytes`` is the memory of the process that answered last, 0
    where the system does not report it. After an FmuFailure the object can be used on. Raises
    BadInput if the FMU cannot be read.
    """

    def __init__(
        self,
        fmu: Path | str | FmuDescription,
        *,
        workers: int = 1,
        timeout_s: float = 60.0,
        reuse: Literal["auto", "never"] = "auto",
        timeout_name: str = "timeout_s",
        isolation: Isolation | None = None,
    ) -> None:
        if not is_whole(workers) or not 1 <= workers <= MOST_WORKERS:
            raise BadInput(
                f"workers is {shown(workers)}, wanted a whole number, 1 to {MOST_WORKERS}"
            )
        if not is_real(timeout_s) or not timeout_s > 0:
            raise BadInput(f"timeout_s is {shown(timeout_s)}, wanted a positive time")
        self.description = fmu if isinstance(fmu, FmuDescription) else read_description(fmu)
        self.counts = Counts()
        self.warnings: tuple[str, ...] = ()
        self.latest_warnings: tuple[str, ...] = ()
        self.memory_bytes = 0
        #: Processor time of runs, s, after which no batch begins, but raises OutOfTime.
        self.until_s = math.inf
        self._timeout_s = timeout_s
        self._timeout_name = timeout_name
        self._isolation = isolation
        self._reuse = reuse
        self._begin_anew(int(workers))

    def _begin_anew(self, workers: int) -> None:
        """No processes yet, no thread at work."""
        self._turn = RLock()
        self._requests = RunRequests(self.description)
        self._open = _Open(workers)
        self._finaliser = weakref.finalize(self, self._open.close)
        never = self._reuse == "never"
        self._verdicts = [refused("so it was asked for") if never else Verdict()] * workers
        self._trials = [b""] * workers  # what was compared for the verdicts, unread

    @contextmanager
    def _own_turn(self) -> Iterator[None]:
        """Other threads wait; a fork leaves to its parent what is open and whoever had the turn."""
        if os.getpid() != self._open.owner:
            self._begin_anew(len(self._open.processes))
        with self._turn:
            yield

    def __reduce__(self) -> tuple[Callable[..., FmuWorkers], tuple[()]]:
        return partial(
            FmuWorkers,
            self.description,
            workers=len(self._open.processes),
            timeout_s=self._timeout_s,
            reuse=self._reuse,
            timeout_name=self._timeout_name,
            isolation=self._isolation,
        ), ()

    def __enter__(self) -> FmuWorkers:
        """Start the processes, so that they load while the caller prepares."""
        with self._own_turn():
            self._start_missing()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the processes and remove the unpacked FMU."""
        self.close()

    @property
    def pids(self) -> tuple[int, ...]:
        """Numbers of the processes that are running."""
        return tuple(worker.pid for worker in self._open.processes if worker is not None)

    @property
    def verdict(self) -> Verdict:
        """Whether instances are reset and reused, and what resets did, in all workers."""
        # a reset that failed comes first, then what one worker has refused, and has proven
        first = min(self._verdicts, key=lambda v: (not v.failure, v.reused is None, v.reused))
        return replace(
            first,
            ended=any(v.ended for v in self._verdicts),
            lied=any(v.lied for v in self._verdicts),
            failed=any(v.failed for v in self._verdicts),
        )

    def go_on_by(self, description: FmuDescription) -> None:
        """Run the same FMU by another interface from now on; counts and warnings go on.

        Args:
            description: of that interface.
        """
        with self._own_turn():
            self._open.close()
            self.description = description
            self._begin_anew(len(self._open.processes))

    def alone(self) -> AbstractContextManager[object]:
        """Within, no other thread runs the FMU by these workers."""
        return self._turn

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Results of the runs in their order, each (samples, outputs).

        Args:
            runs: to be simulated.

        Raises FmuFailure for the first run found to fail, with the FMU's words and the start values
        of that run; BadInput for names and values that do not fit the FMU.
        """
        if self.counts.processor_s > self.until_s:
            raise OutOfTime
        with self._own_turn():
            requests = self._requests.take_all(runs)
            self.latest_warnings = ()
            # dealt in turn: runs of one measurement may cost many times another's
            n, count = len(requests), len(self._open.processes)
            todo = {number: list(range(number, n, count)) for number in range(min(n, count))}
            job = _Job(runs=runs, requests=requests, results={}, todo=todo)
            try:
                self._start_missing()
                for number in todo:
                    self._send(number, job)
                while job.todo:
                    self._wait(job)
            except FmuFailure as failure:
                self._spare(job)
                failure.answers = job.results
                raise
            finally:  # no answer to an abandoned batch comes into the next one
                for number in job.todo:
                    self._kill(number)
            return [job.results[i] for i in range(n)]

    def renew(self) -> None:
        """End the processes; the next runs have new ones."""
        with self._own_turn():
            for number in range(len(self._open.processes)):
                self._kill(number)

    def limit(self, timeout_s: float, timeout_name: str) -> None:
        """Shorten the longest time of a run.

        Args:
            timeout_s: longest time for one run, s; a longer one than before is not taken.
            timeout_name: what the user calls that limit.
        """
        if timeout_s < self._timeout_s:
            self._timeout_s, self._timeout_name = timeout_s, timeout_name

    def close(self) -> None:
        """End the processes and remove the unpacked FMU."""
        with self._own_turn():
            self._open.close()

    def _start_missing(self) -> None:
        for number, worker in enumerate(self._open.processes):
            if worker is None:
                self._start(number)

    def _start(self, number: int) -> WorkerProcess:
        description = self.description
        if self._open.scratch is None:
            self._open.scratch = _unpack(description)
        home = self._open.scratch.path
        task = Task(
            fmu=replace(description, variables={}),
            folder=str(home / "fmu"),
            verdict=self._verdicts[number],
            trials=self._trials[number],
            pulse_path=str(home / f"worker{number}.pulse"),
            isolation=self._isolation,
        )
        try:
            worker = WorkerProcess(task)
        except OSError as error:
            text = f"no worker process could be started: {error}"
            raise FmuFailure(text, {}, description.path) from error
        self._open.processes[number] = worker
        self.counts += Counts(processes=1)
        _log.debug("worker %d: process %d started", number + 1, worker.pid)
        return worker

    def _kill(self, number: int) -> None:
        worker, self._open.processes[number] = self._open.processes[number], None
        if worker is not None:
            worker.end()

    def _send(self, number: int, job: _Job) -> None:
        worker = self._open.processes[number] or self._start(number)
        requests = [job.requests[i] for i in job.todo[number][:MOST_SENT]]
        worker.send(self._requests.layouts, requests)

    def _wait(self, job: _Job) -> None:
        """Take what has arrived, and look after who has ended or is late."""
        busy = {n: w for n in job.todo if (w := self._open.processes[n]) is not None}
        arrived = connection.wait([worker.pipe for worker in busy.values()], timeout=POLL_S)
        for number, worker in busy.items():
            reply: Reply | None = None
            ended, how = False, ""
            if worker.pipe in arrived:
                try:
                    reply = worker.receive()
                except EOFError:
                    ended = True
                except NotAnAnswer as error:
                    how = f"{MEDDLED} ({error})"
            if reply is not None:
                remaining = self._keep(number, reply, job)
                if remaining and reply.failure is None:
                    self._send(number, job)
                    continue
                del job.todo[number]
                if reply.failure is not None:
                    raise self._failure(reply.failure, job, remaining[0])
            elif ended or (not how and worker.has_ended):
                self._replace_ended(number, worker, job)
            elif how:
                self._blame(number, worker, job, how, NoAnswer)
            elif how := worker.written_too_much():
                self._blame(number, worker, job, how, FmuFailure)
            elif worker.is_late(self._timeout_s):
                how = f"gave no answer within {self._timeout_s:g} s and was stopped"
                how += f"; {self._timeout_name} sets that limit"
                self._blame(number, worker, job, how, NoAnswer)

    def _keep(self, number: int, reply: Reply, job: _Job) -> list[int]:
        """Take what a reply holds; numbers of the runs that its worker has still to do."""
        self._verdicts[number], self._trials[number] = reply.verdict, reply.trials
        self.counts += reply.counts
        self.memory_bytes = reply.memory
        self.warnings = _added(self.warnings, reply.warnings)
        self.latest_warnings = _added(self.latest_warnings, reply.warnings)
        worker = self._open.processes[number]
        if worker is not None:
            worker.has_failed = reply.failure is not None
        if reply.used_up:
            _log.info("worker %d: replaced, its process wants to do no more runs", number + 1)
            self._kill(number)
        todo, position = job.todo[number], 0
        for i in todo[: reply.done]:
            width = len(job.runs[i].outputs) + len(job.runs[i].initial)
            shape = (job.requests[i].rows, width)
            size = shape[0] * shape[1]
            job.results[i] = reply.results[position : position + size].reshape(shape)
            position += size
        job.todo[number] = todo[reply.done :]
        return job.todo[number]

    def _spare(self, job: _Job) -> None:
        """Let the others answer, so that they can take the next batch, where that is soon."""
        until = time.monotonic() + SPARED_S
        while (remaining_s := until - time.monotonic()) > 0.0:
            busy = {n: w for n in job.todo if (w := self._open.processes[n]) is not None}
            if not busy:
                break
            for number, worker in busy.items():
                if worker.pipe in connection.wait([worker.pipe], timeout=remaining_s / len(busy)):
                    try:
                        reply = worker.receive()
                    except (EOFError, NotAnAnswer):
                        self._kill(number)
                    else:
                        if reply is None:
                            continue
                        self._keep(number, reply, job)
                    del job.todo[number]

    def _replace_ended(self, number: int, worker: WorkerProcess, job: _Job) -> None:
        """Do again once what somebody has killed; what the FMU itself has ended, it would again."""
        how, killed_by, goes_on = worker.death()
        if worker.has_failed or not killed_by:
            # what has become another program does that whatever its values are
            self._blame(number, worker, job, how, NoAnswer if goes_on else FmuFailure)
        elif number in job.repeated:
            raise self._failure(
                f"the FMU had its process killed ({killed_by}) twice in the same runs, by somebody "
                "or by the system for want of memory",
                job,
                _run_of(number, worker, job),
                NoAnswer,
            )
        else:
            job.repeated.add(number)
            self._replace(number, job, f"killed ({killed_by})")

    def _blame(
        self, number: int, worker: WorkerProcess, job: _Job, how: str, kind: type[FmuFailure]
    ) -> None:
        """Go on without reuse if a reset was only being tried; else fail."""
        if worker.has_failed:
            # the runs before have left it so: those under way are not to blame
            self._replace(number, job, "it did not get over a run that failed")
            return
        at, in_trial = _run_of(number, worker, job), worker.pulse.in_trial
        if worker.pulse.freeing:
            how = f"was to free an instance and {how}"
        if not in_trial:
            self._kill(number)
            raise self._failure(f"the FMU {how}", job, at, kind)
        reason = f"when its reset was tried the FMU {how}"
        self._verdicts[number], self._trials[number] = refused(reason, ended=True), b""
        self._replace(number, job, reason)

    def _replace(self, number: int, job: _Job, reason: str) -> None:
        _log.info("worker %d: replaced, %s", number + 1, reason)
        self._kill(number)
        self._send(number, job)

    def _failure(
        self, message: str, job: _Job, at: int, kind: type[FmuFailure] = FmuFailure
    ) -> FmuFailure:
        failure = kind(message, job.runs[at].start_values, self.description.path)
        failure.at = at
        return failure


def _run_of(number: int, worker: WorkerProcess, job: _Job) -> int:
    """Number of the run that the process was at."""
    todo = job.todo[number]
    return todo[min(worker.pulse.at_run, len(todo) - 1)]


def _added(kept: tuple[str, ...], more: tuple[str, ...]) -> tuple[str, ...]:
    values = (*kept, *(text for text in more if text not in kept))
    return values if len(values) <= MOST_WARNINGS else (*values[:MOST_WARNINGS], DROPPED)


def _unpack(description: FmuDescription) -> Scratch:
    """Unpack the FMU to a folder of plain name; FMUs stumble over umlauts and brackets in it."""
    scratch = Scratch()
    if not _PLAIN.fullmatch(str(scratch.path)):
        scratch.remove()
        try:
            scratch = Scratch(Path("/tmp"))  # noqa: S108 - a private folder in it
        except BadInput as error:
            raise BadInput(
                f"{scratch.path.parent}: the folder for temporary files has a character in its "
                "name that FMUs stumble over, wanted letters, digits and ._-/ (set TMPDIR)"
            ) from error
    folder = scratch.path / "fmu"
    try:
        unpack(description.file, folder)
    except BaseException:
        scratch.remove()
        raise
    (folder / "resources").mkdir(exist_ok=True)  # some FMUs crash where it is missing
    return scratch
