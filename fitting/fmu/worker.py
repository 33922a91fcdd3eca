"""The worker process: holds one FMU open, answers each batch of orders with one message."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from multiprocessing import connection, parent_process
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fitting.fmu.interface import CallFailed, Interface, Setup, load
from fitting.fmu.log import Log
from fitting.fmu.orders import Layout, Order
from fitting.fmu.records import Counts
from fitting.fmu.reuse import Verdict, run_with_reuse
from fitting.fmu.simulation import Binding, bind, simulate, steps_of
from fitting.text.arrays import FloatArray

# Each instantiation leaks some ten kilobytes in many FMUs, and crashes are reported near 1,000.
MOST_INSTANCES = 500
MOST_GROWTH = 256 * 2**20  # bytes by which a worker may grow before a new process takes over

# Places in the pulse, the memory that worker and caller share: the run of the batch that is under
# way, a count of everything that was begun, and whether a reset instance is only being tried.
AT_RUN, BEGUN, IN_TRIAL = 0, 1, 2
PULSE_SIZE = 3


class Batch(NamedTuple):
    """Runs to do, and the layouts that they refer to."""

    layouts: list[Layout]
    orders: list[Order]


class Reply(NamedTuple):
    """Results of the first ``done`` orders, flat; the rest is left if ``used_up`` or ``failure``.

    ``used_up``: this process should do no more; ``failure``: why the order after the last done one
    failed.
    """

    results: FloatArray
    done: int
    used_up: bool
    failure: str | None
    warnings: tuple[str, ...]
    counts: Counts
    verdict: Verdict


class _UsedUp(Exception):
    """A new instance is wanted that this process should not make."""


class _Holder:
    """The FMU of this process, its instance, and the account of what was done with it."""

    def __init__(self, setup: Setup, log: Log, verdict: Verdict, pulse: Any) -> None:
        self.verdict = verdict
        self.log = log
        self._limit = 1 if setup.one_instance_per_process else MOST_INSTANCES
        self._setup = setup
        self._pulse = pulse
        self._fmu: Interface | None = None
        self._instances = 0
        self._bindings: dict[int, Binding] = {}
        self._layouts: list[Layout] = []
        self._runs = self._steps = self._new_instances = 0
        self._seconds = 0.0

    def do(self, layouts: list[Layout], order: Order) -> FloatArray:
        self._layouts = layouts
        return run_with_reuse(self.verdict, layouts, order, self._fresh, self._again)

    def take_counts(self) -> Counts:
        counts = Counts(self._runs, self._steps, self._seconds, self._new_instances)
        self._runs = self._steps = self._new_instances = 0
        self._seconds = 0.0
        return counts

    def close(self) -> None:
        if self._fmu is not None:
            self._fmu.free()

    def _fresh(self, order: Order) -> FloatArray:
        if self._instances >= self._limit:
            raise _UsedUp
        if self._fmu is None:
            self._fmu = load(self._setup, self.log)
        self.log.new_run()
        self._pulse[BEGUN] += 1
        self._fmu.instantiate()
        self._pulse[IN_TRIAL] = 0
        self._instances += 1
        self._new_instances += 1
        return self._simulate(self._fmu, order)

    def _again(self, order: Order) -> FloatArray:
        trial = self.verdict.trials[order.layout]
        fmu = self._fmu
        if fmu is None or fmu.instance is None:  # a new process has taken over
            return self._fresh(order)
        self._pulse[IN_TRIAL] = not trial.varied
        self._pulse[BEGUN] += 1
        self.log.new_run()
        began = time.perf_counter()
        fmu.reset()
        self._seconds += time.perf_counter() - began
        result = self._simulate(fmu, order)
        self._pulse[IN_TRIAL] = 0
        return result

    def _simulate(self, fmu: Interface, order: Order) -> FloatArray:
        binding = self._bindings.get(order.layout)
        if binding is None:
            binding = self._bindings[order.layout] = bind(fmu, self._layouts[order.layout])
        began = time.perf_counter()
        result = simulate(fmu, binding, order)
        self._seconds += time.perf_counter() - began
        self._runs += 1
        self._steps += steps_of(order)
        return result


def serve(
    pipe: connection.Connection, pulse: Any, setup: Setup, verdict: Verdict, log_path: str
) -> None:
    """Main function of the process: answer batches until the caller sends None or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the caller to deal with
    home = Path(setup.folder).parent
    _leave_with_caller(home)
    log_file = _divert_output(log_path)
    holder = _Holder(setup, Log(log_file), verdict, pulse)
    baseline: int | None = None
    while True:
        try:
            batch: Batch | None = pipe.recv()
        except (EOFError, OSError):  # the caller is gone and cannot clear up
            shutil.rmtree(home, ignore_errors=True)
            break
        if batch is None:
            holder.close()
            break
        reply = _answer(holder, batch, pulse)
        memory = _memory()
        baseline = memory if baseline is None else baseline
        pipe.send(reply._replace(used_up=reply.used_up or memory - baseline > MOST_GROWTH))
        _shorten(log_file)
    # not by way of the interpreter's teardown, in which FMUs are known to crash
    os._exit(0)


def _answer(holder: _Holder, batch: Batch, pulse: Any) -> Reply:
    pulse[BEGUN] += 1
    results: list[FloatArray] = []
    used_up, failure = False, None
    for number, order in enumerate(batch.orders):
        pulse[AT_RUN] = number
        try:
            results.append(holder.do(batch.layouts, order))
        except _UsedUp:
            used_up = True
            break
        except CallFailed as error:
            failure = str(error)
            break
        except Exception:  # a fault of ours must reach the caller as well, not a dead pipe
            failure = "fault in the worker process:\n" + traceback.format_exc()
            break
    return Reply(
        _joined(results),
        len(results),
        used_up,
        failure,
        holder.log.take_warnings(),
        holder.take_counts(),
        holder.verdict,
    )


def _joined(results: Sequence[FloatArray]) -> FloatArray:
    return np.concatenate([r.ravel() for r in results]) if results else np.empty(0)


def _leave_with_caller(folder: Path) -> None:
    """End this process when its caller is gone, killed for instance, even from an endless loop."""
    parent = parent_process()
    if parent is None:
        return
    sentinel = parent.sentinel

    def wait() -> None:
        connection.wait([sentinel])
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def _divert_output(path: str) -> int:
    """What the FMU prints goes to a file, from where its last words can be quoted."""
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o600)
    sys.stdout.flush()
    sys.stderr.flush()
    os.dup2(file, 1)
    os.dup2(file, 2)
    return file


def _shorten(file: int) -> None:
    if os.fstat(file).st_size > 2**20:
        os.ftruncate(file, 0)


def _memory() -> int:
    """Resident memory of this process in bytes; 0 where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")
