"""A study of accuracy against cost: the same table, wherever and in whatever order it is made."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from shutil import copyfile
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.engine import files, run
from fitting.engine.local import LocalProcesses, LostProcess
from fitting.fmu import FmuWorkers
from fitting.lab.names import AMPLITUDES
from fitting.lab.tradeoff import item, study
from fitting.lab.tradeoff.api import memory_of
from fitting.lab.tradeoff.bench import Bench, Patience
from fitting.lab.tradeoff.records import Measurement, Study
from fitting.lab.tradeoff.scenes import scene_named
from tests.support.clusters import cluster_in_this_process

ONCE = Patience(1, 0.0, 0.0)
#: No plans, whose rows are measured here in any case; whatever counts its steps is extrapolated,
#: however fast the machine is.
OPTIONS = ff.StudyOptions(accuracies=(), quick=True, quantities=(AMPLITUDES,), longest_s=1e-12)


def row(m: Measurement) -> tuple[Any, ...]:
    """Everything of a measurement but its times, which no two runs have in common."""
    return replace(m, cost=replace(m.cost, seconds=0.0, cpu_s=0.0, repeats=0)), m.cost.repeats > 0


def table(found: Study) -> list[tuple[Any, ...]]:
    """Its rows in their order."""
    assert (found.status, found.notes) == ("finished", ())
    return [row(m) for m in found.measurements]


@pytest.fixture(scope="module", autouse=True)
def _once() -> Iterator[None]:
    """Every setting is timed once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "QUICK_PATIENCE", ONCE)
        yield


@pytest.fixture(scope="module")
def fmu(swift_fmu: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(swift_fmu, workers=1) as opened:
        yield opened


@pytest.fixture(scope="module")
def wanted(fmu: ff.Fmu) -> list[tuple[Any, ...]]:
    """The table as it is made here, one setting after the other."""
    found = table(ff.tradeoff("string", fmu, options=OPTIONS))
    assert len(found) > 20
    return found


def test_processes_make_the_same_table_interrupted_and_with_one_of_them_killed(
    wanted: list[tuple[Any, ...]], fmu: ff.Fmu, tmp_path: Path
) -> None:
    def stop(text: str) -> None:
        if text == f"6/{len(wanted)} settings":
            raise KeyboardInterrupt

    memory = memory_of(tmp_path, "string", fmu, OPTIONS)
    with ThreadPoolExecutor(2) as pool:  # processes take seconds to start
        broken = ff.tradeoff(
            "string", fmu, options=OPTIONS, memory=memory, progress=stop, executor=pool
        )
    assert broken.status == "interrupted"
    assert f"5 of {len(wanted)} " in broken.message
    assert "ThreadPoolExecutor" in broken.provenance["settings"]
    rows = [row(m) for m in broken.measurements]
    assert rows == [each for each in wanted if each in rows]
    kept = memory_of(tmp_path, "string", fmu, OPTIONS)
    assert kept.resume()
    assert len(kept) == 5
    told: list[str] = []
    killed: list[int] = []

    def kill(text: str) -> None:
        told.append(text)
        if text.startswith("9/"):
            killed.append(executor.pids[0])
            os.kill(killed[0], signal.SIGKILL)

    executor = LocalProcesses(2)
    try:
        found = ff.tradeoff(
            "string", fmu, options=OPTIONS, memory=kept, progress=kill, executor=executor
        )
        assert len(killed) == 1
        assert killed[0] not in executor.pids
    finally:
        executor.shutdown(wait=False)
    assert table(found) == wanted
    assert told[0] == f"6/{len(wanted)} settings"
    before = {m.setting.key: m.cost for m in broken.measurements}
    assert before.items() <= {m.setting.key: m.cost for m in found.measurements}.items()
    assert found.cost_kind == ("processor" if Path("/proc/self/schedstat").exists() else "wall")


def test_a_cluster_makes_the_same_table(
    wanted: list[tuple[Any, ...]],
    swift_fmu: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The workers have the FMU as it was sent: where it was, there is nothing when they begin."""
    path = tmp_path / swift_fmu.name
    copyfile(swift_fmu, path)

    def run_without_it(*given: Any) -> Any:
        path.unlink()
        return run.run(*given)

    monkeypatch.setattr(item, "run", run_without_it)
    monkeypatch.setattr(files, "_SENT", {})  # gone with the workers, which are in this process
    with cluster_in_this_process() as cluster, ff.Fmu(path, workers=1) as fmu:
        found = ff.tradeoff("string", fmu, options=OPTIONS, executor=cluster.scheduler_address)
    assert not path.exists()
    # errors are differences of nearly equal numbers: what is left of rounding may differ
    rows, expected = table(found), list(wanted)
    errors = [[m.error for m, _ in each] for each in (rows, expected)]
    assert errors[0] == pytest.approx(errors[1], rel=1e-6, abs=1e-15, nan_ok=True)
    assert [(replace(m, error=0.0), timed) for m, timed in rows] == [
        (replace(m, error=0.0), timed) for m, timed in expected
    ]


class Losing(Executor):
    """Works here and at once, and loses its worker at one setting, however often."""

    def __init__(self, number: int) -> None:
        self.number, self.key, self.asked = number, "", list[str]()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        key = args[0].setting.key
        self.asked.append(key)
        if len(self.asked) == self.number:
            self.key = key
        if key == self.key:
            future.set_exception(LostProcess("its process was killed by signal 9"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


def test_a_setting_that_is_lost_twice_is_a_row_that_says_so(
    wanted: list[tuple[Any, ...]], fmu: ff.Fmu, tmp_path: Path
) -> None:
    executor, memory = Losing(3), memory_of(tmp_path, "string", fmu, OPTIONS)
    found = ff.tradeoff("string", fmu, options=OPTIONS, memory=memory, executor=executor)
    assert executor.asked.count(executor.key) == 2
    rows, place = table(found), [m.failed for m in found.measurements].index(True)
    lost = found.measurements[place]
    assert lost.setting.key == executor.key
    assert "signal 9" in lost.note
    assert rows[:place] + rows[place + 1 :] == wanted[:place] + wanted[place + 1 :]
    assert memory.find(executor.key) is None


def test_what_others_do_in_the_same_process_costs_a_setting_nothing(swift_fmu: Path) -> None:
    """A worker of several threads: another one works while this one waits."""
    idle = threading.Event()

    def work() -> None:
        while not idle.is_set():
            math.sqrt(2.0)

    def wait() -> np.ndarray[Any, Any]:
        until = time.process_time() + 0.1
        while time.process_time() < until:
            time.sleep(0.01)
        return np.zeros(1)

    with FmuWorkers(swift_fmu) as workers:
        bench = Bench(scene_named("string"), workers, ONCE)
        other = threading.Thread(target=work)
        other.start()
        try:
            _, cost = bench.timed(wait)
        finally:
            idle.set()
            other.join()
    assert math.isnan(cost.cpu_s) or cost.cpu_s < 0.05
