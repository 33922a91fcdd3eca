"""The loop of a worker process: hold one FMU open, answer each batch with one message."""

from __future__ import annotations

import contextlib
import os
import pickle
import shutil
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from multiprocessing import connection
from pathlib import Path

import numpy as np

from fitting.engine.process import end_marked, messages
from fitting.fmu.run_requests import Handled, Layout, RunRequest
from fitting.fmu.runs import Counts
from fitting.fmu.worker.answers import packed
from fitting.fmu.worker.confinement import allow_processor_time, confine, most_memory
from fitting.fmu.worker.instance import FmuInstance, load
from fitting.fmu.worker.log import CallFailed, Log
from fitting.fmu.worker.messages import Batch, Reply, Task
from fitting.fmu.worker.pulse import (
    AT_RUN,
    BEGUN,
    COUNTED_MEMORY,
    FREEING,
    IN_TRIAL,
    OWN_MEMORY,
    open_pulse,
)
from fitting.fmu.worker.reuse import Instances, ReuseDecision, run_with_reuse
from fitting.fmu.worker.simulation import Binding, bind, simulate, steps_of
from fitting.text.arrays import FloatArray

CALLER_S = 1.0  # time between two looks whether the caller is there
# Each instantiation leaks some ten kilobytes in many FMUs, and crashes are reported near 1,000.
MOST_INSTANCES = 500
MOST_GROWTH = 256 * 2**20  # bytes by which a worker may grow before a new process takes over


class _UsedUp(Exception):
    """A new instance is wanted that this process should not make."""


class _Holder:
    """The FMU of this process, its instance, and the account of what was done with it."""

    def __init__(self, task: Task, log: Log, pulse: memoryview) -> None:
        fmu = task.fmu
        self.decision = ReuseDecision(task.verdict)
        self.log = log
        self._isolation = task.isolation
        self._limit = 1 if fmu.one_instance_per_process else MOST_INSTANCES
        self._unpacked = fmu
        self._pulse = pulse
        self._fmu: FmuInstance | None = None
        self._instances = 0
        self._failed = False
        self._bindings: dict[int, Binding] = {}
        self._layouts: list[Layout] = []
        self._runs = self._steps = self._new_instances = 0
        self._seconds = self._processor_s = 0.0

    def learn(self, layouts: Sequence[Layout]) -> None:
        self._layouts += layouts

    def do(self, request: RunRequest) -> FloatArray:
        if self._isolation is not None:
            allow_processor_time(self._isolation)
        if self._failed:  # no reset was proven after a failure: the next run has a new instance
            self._failed = False
            self._forget()
        if request.handled is not None:
            return self._handled(request, request.handled)
        compared = self._compared if self._limit > 1 else None
        instances = Instances(self._fresh, self._again, self._tried, compared)
        return run_with_reuse(self.decision, self._layouts, request, instances)

    def take_counts(self) -> Counts:
        counts = Counts(
            runs=self._runs,
            steps=self._steps,
            seconds=self._seconds,
            processor_s=self._processor_s,
            instances=self._new_instances,
        )
        self._runs = self._steps = self._new_instances = 0
        self._seconds = self._processor_s = 0.0
        return counts

    def close(self) -> None:
        self._forget()

    def give_up(self) -> None:
        """A run has failed: its instance does no other."""
        self._failed = True

    def _forget(self) -> None:
        if self._fmu is not None:
            self._free(self._fmu)

    def _handled(self, request: RunRequest, handled: Handled) -> FloatArray:
        result = self._fresh(handled.before or request)
        if handled.before is not None:
            result = self._again(request)
        if handled.freed and self._fmu is not None:
            self._free(self._fmu)
        return result

    def _free(self, fmu: FmuInstance) -> None:
        self._pulse[FREEING] = 1
        fmu.free()
        self._pulse[FREEING] = 0

    def _fresh(self, request: RunRequest) -> FloatArray:
        if self._instances >= self._limit:
            raise _UsedUp
        if self._fmu is None:
            self._fmu = load(self._unpacked, self.log)
        self.log.new_run()
        self._free(self._fmu)
        self._pulse[BEGUN] += 1
        self._fmu.instantiate()
        self._instances += 1
        self._new_instances += 1
        return self._simulate(self._fmu, request)

    def _tried(self, request: RunRequest) -> FloatArray:
        return self._in_trial(self._again, request)

    def _compared(self, request: RunRequest) -> FloatArray:
        return self._in_trial(self._fresh, request)

    def _in_trial(
        self, made: Callable[[RunRequest], FloatArray], request: RunRequest
    ) -> FloatArray:
        self._pulse[IN_TRIAL] = 1
        try:
            return made(request)
        finally:
            self._pulse[IN_TRIAL] = 0

    def _again(self, request: RunRequest) -> FloatArray:
        fmu = self._fmu
        if fmu is None or fmu.instance is None:  # a new process has taken over
            return self._fresh(request)
        self._pulse[BEGUN] += 1
        self.log.new_run()
        began = _clocks()
        fmu.reset()
        return self._simulate(fmu, request, began)

    def _simulate(
        self, fmu: FmuInstance, request: RunRequest, began: tuple[float, float] | None = None
    ) -> FloatArray:
        """One run, counted from when it began, where something went before it."""
        binding = self._bindings.get(request.layout)
        if binding is None:
            binding = self._bindings[request.layout] = bind(fmu, self._layouts[request.layout])
        began = began or _clocks()
        result = simulate(fmu, binding, request)
        self._count(began)
        self._runs += 1
        self._steps += steps_of(request)
        return result

    def _count(self, began: tuple[float, float]) -> None:
        now = _clocks()
        self._seconds += now[0] - began[0]
        self._processor_s += now[1] - began[1]


def _clocks() -> tuple[float, float]:
    """The time, and the processor time of this process, s."""
    return time.perf_counter(), time.process_time()


def serve(pipe: connection.Connection, task: Task, pulse_descriptor: int | None) -> None:
    """Answer batches until the caller sends None; leave when the caller is gone.

    Args:
        pipe: the worker's end.
        task: what the process is there for.
        pulse_descriptor: of the pulse, None: it is in a file.
    """
    place = Path(task.pulse_path) if pulse_descriptor is None else pulse_descriptor
    pulse = open_pulse(place).numbers
    holder = _Holder(task, Log(sys.stderr.fileno()), pulse)
    pulse[OWN_MEMORY], pulse[COUNTED_MEMORY] = _memory(), most_memory()
    folder = Path.cwd()
    if task.isolation is not None:
        holder.log.warn(confine(task.isolation, folder))
    # an FMU was in the process that packed them: they are not read by one that may do more
    holder.decision.trials.update(pickle.loads(task.trials) if task.trials else {})  # noqa: S301
    # threads last, so that they have what this one has left
    arriving = messages(pipe, lambda: _clear(folder, Path(task.fmu.folder).parent))
    process = os.getpid()
    baseline: int | None = None
    while True:
        batch: Batch | None = arriving.get()
        if batch is None:
            holder.close()
            break
        reply = _answer(holder, batch, pulse, process)
        memory = _memory()
        baseline = memory if baseline is None else baseline
        used_up = reply.used_up or memory - baseline > MOST_GROWTH
        reply = reply._replace(used_up=used_up, memory=memory)
        with contextlib.suppress(OSError):  # the caller is gone, which the other thread deals with
            pipe.send_bytes(packed(reply))
    # not by way of the interpreter's teardown, in which FMUs are known to crash
    os._exit(0)


def _clear(folder: Path, home: Path) -> None:
    """End what the FMU has started, and remove its folder, as the caller cannot."""
    end_marked(folder)
    shutil.rmtree(home, ignore_errors=True)


def _answer(holder: _Holder, batch: Batch, pulse: memoryview, process: int) -> Reply:
    pulse[BEGUN] += 1
    results: list[FloatArray] = []
    used_up, failure = False, None
    holder.learn(batch.layouts)
    for number, request in enumerate(batch.requests):
        pulse[AT_RUN] = number
        try:
            results.append(holder.do(request))
        except _UsedUp:
            used_up = True
            break
        except CallFailed as error:
            failure = str(error)
            holder.give_up()
            break
        except Exception:  # a fault of ours must reach the caller as well, not a dead pipe
            failure = "fault in the worker process:\n" + traceback.format_exc()
            holder.give_up()
            break
        finally:
            if os.getpid() != process:  # a copy that the FMU has made: one answers, not two
                os._exit(0)
    return Reply(
        number=batch.number,
        process=process,
        results=_joined(results),
        done=len(results),
        used_up=used_up,
        failure=failure,
        warnings=holder.log.take_warnings(),
        counts=holder.take_counts(),
        verdict=holder.decision.verdict,
        trials=pickle.dumps(holder.decision.trials),
    )


def _joined(results: Sequence[FloatArray]) -> FloatArray:
    return np.concatenate([r.ravel() for r in results]) if results else np.empty(0)


def _memory() -> int:
    """Resident memory of this process in bytes; 0 where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")
