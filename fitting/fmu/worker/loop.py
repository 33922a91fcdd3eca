"""The loop of a worker process: hold one FMU open, answer each batch with one message."""

from __future__ import annotations

import contextlib
import os
import pickle
import shutil
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from multiprocessing import connection
from pathlib import Path

import numpy as np

from fitting.engine.process import end_marked, messages
from fitting.fmu.runs import Counts, Layout, RunRequest
from fitting.fmu.worker.confinement import allow_processor_time, confine, most_memory
from fitting.fmu.worker.instance import FmuInstance, load
from fitting.fmu.worker.log import CallFailed, Log
from fitting.fmu.worker.messages import Reply, Task
from fitting.fmu.worker.pulse import Pulse, open_pulse
from fitting.fmu.worker.reuse import Reuse
from fitting.fmu.worker.simulation import Binding, bind, simulate, steps_of
from fitting.text.arrays import FloatArray

# Each instantiation leaks some ten kilobytes in many FMUs, and crashes are reported near 1,000.
MOST_INSTANCES = 500
MOST_GROWTH = 256 * 2**20  # bytes by which a worker may grow before a new process takes over


class _UsedUp(Exception):
    """A new instance is wanted that this process should not make."""


class Instances:
    """The FMU of this process, its instance, and the account of what was done with it.

    ``single``: the process bears one instance alone.
    """

    def __init__(self, task: Task, log: Log, pulse: Pulse) -> None:
        self.reuse = Reuse(task.verdict)
        self.layouts: list[Layout] = []
        self.has_failed = False  # the last run, and no reset was proven after a failure
        self.single = task.fmu.one_instance_per_process
        self._task, self._log, self._pulse = task, log, pulse
        self._fmu: FmuInstance | None = None
        self._count = 0  # of instances so far
        self._bindings: dict[int, Binding] = {}
        self._account: Counter[str] = Counter()
        self._seconds = self._processor_s = 0.0

    def run(self, request: RunRequest) -> FloatArray:
        """Result of a run, on an instance as it asks for or as is proven to be as good.

        Args:
            request: a run, in value references.
        """
        if self._task.isolation is not None:
            allow_processor_time(self._task.isolation)
        if self.has_failed:
            self.has_failed = False
            self.free()
        if request.handled is None:
            return self.reuse.run(self.layouts[request.layout].names, request, self)
        before, freed = request.handled
        result = self.fresh(before or request)
        if before is not None:
            result = self.again(request)
        if freed:
            self.free()
        return result

    def take_counts(self) -> Counts:
        """What was done since the last call."""
        counts = Counts(seconds=self._seconds, processor_s=self._processor_s, **self._account)
        self._account.clear()
        self._seconds = self._processor_s = 0.0
        return counts

    def free(self) -> None:
        """Free the instance, if there is one."""
        if self._fmu is not None:
            self._pulse.freeing = 1
            self._fmu.free()
            self._pulse.freeing = 0

    def fresh(self, request: RunRequest) -> FloatArray:
        """Result of a run on a new instance.

        Args:
            request: a run, in value references.
        """
        if self._count >= (1 if self.single else MOST_INSTANCES):
            raise _UsedUp
        if self._fmu is None:
            self._fmu = load(self._task.fmu, self._task.folder, self._log)
        self._log.new_run()
        self.free()
        self._pulse.started += 1
        self._fmu.instantiate()
        self._count += 1
        self._account["instances"] += 1
        return self._simulate(self._fmu, request)

    def again(self, request: RunRequest) -> FloatArray:
        """Result of a run on the present instance after a reset.

        Args:
            request: a run, in value references.
        """
        fmu = self._fmu
        if fmu is None or fmu.instance is None:  # a new process has taken over
            return self.fresh(request)
        self._pulse.started += 1
        self._log.new_run()
        clocks = time.perf_counter(), time.process_time()
        fmu.call("Reset")
        return self._simulate(fmu, request, clocks)

    @contextlib.contextmanager
    def trying(self) -> Iterator[None]:
        """Within, a reset may turn out to be the end of the process."""
        self._pulse.in_trial = 1
        try:
            yield
        finally:
            self._pulse.in_trial = 0

    def _simulate(
        self, fmu: FmuInstance, request: RunRequest, clocks: tuple[float, float] | None = None
    ) -> FloatArray:
        """One run, counted from where the clocks stood, if something went before it."""
        binding = self._bindings.get(request.layout)
        if binding is None:
            binding = self._bindings[request.layout] = bind(fmu, self.layouts[request.layout])
        since, processor_since = clocks or (time.perf_counter(), time.process_time())
        result = simulate(fmu, binding, request)
        self._seconds += time.perf_counter() - since
        self._processor_s += time.process_time() - processor_since
        self._account["runs"] += 1
        self._account["steps"] += steps_of(request)
        return result


def serve(pipe: connection.Connection, task: Task, pulse_descriptor: int | None) -> None:
    """Answer batches until the caller sends None; leave when the caller is gone.

    Args:
        pipe: the worker's end.
        task: what the process is there for.
        pulse_descriptor: of the pulse, None: it is in a file.
    """
    place = Path(task.pulse_path) if pulse_descriptor is None else pulse_descriptor
    pulse = open_pulse(place)
    log, folder = Log(sys.stderr.fileno()), Path.cwd()
    instances = Instances(task, log, pulse)
    pulse.own_memory, pulse.counted_memory = _memory(), most_memory()
    if task.isolation is not None:
        log.warn(confine(task.isolation, folder))
    # an FMU was in the process that packed them: they are not read by one that may do more
    instances.reuse.trials.update(pickle.loads(task.trials) if task.trials else {})  # noqa: S301

    def clear() -> None:
        # what the FMU has started, and its folder, as the caller cannot
        end_marked(folder)
        shutil.rmtree(Path(task.folder).parent, ignore_errors=True)

    # threads last, so that they have what this one has left
    arriving = messages(pipe, clear)
    process = os.getpid()
    baseline: int | None = None
    while (batch := arriving.get()) is not None:
        pulse.started += 1
        batch_number, layouts, rows = batch
        instances.layouts += layouts
        results: list[FloatArray] = []
        used_up, failure = False, None
        for number, row in enumerate(rows):
            pulse.at_run = number
            try:
                results.append(instances.run(RunRequest._make(row)))
            except _UsedUp:
                used_up = True
                break
            except CallFailed as error:
                failure, used_up = str(error), error.is_fatal
                break
            except Exception:  # a fault of ours must reach the caller as well, not a dead pipe
                failure = "fault in the worker process:\n" + traceback.format_exc()
                break
            finally:
                if os.getpid() != process:  # a copy that the FMU has made: one answers, not two
                    os._exit(0)
        instances.has_failed = failure is not None
        memory = _memory()
        baseline = memory if baseline is None else baseline
        reply = Reply(
            number=batch_number,
            process=process,
            results=np.concatenate([r.ravel() for r in results]) if results else np.empty(0),
            done=len(results),
            used_up=used_up or memory - baseline > MOST_GROWTH,
            failure=failure,
            warnings=log.take_warnings(),
            counts=instances.take_counts(),
            verdict=instances.reuse.verdict,
            trials=pickle.dumps(instances.reuse.trials),
            memory=memory,
        )
        with contextlib.suppress(OSError):  # the caller is gone, which the other thread deals with
            pipe.send_bytes(reply.packed())
    instances.free()
    # not by way of the interpreter's teardown, in which FMUs are known to crash
    os._exit(0)


def _memory() -> int:
    """Resident memory of this process in bytes; 0 where the system does not report it."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")
