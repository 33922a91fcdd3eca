"""Threads, forks, other folders and pickles: an `ff.Fmu` and what is made of it bear them."""

from __future__ import annotations

import os
import pickle
import shutil
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.text import units
from fitting.text.once import made_once
from tests.support.small_campaign import of_pairs, small_campaign

ONE_TONE: dict[str, float] = {"A2": 0.0, "solver": 0}
#: What saves hardly more than it must may be taken or not, by the clock of a busy machine.
WHOLE = ff.Accuracy(forbid=("periodic start", "far mode left out", "far mode quasi-static"))


def peak(fmu: ff.Fmu, theta: float) -> complex:
    return complex(np.sum(fmu.simulate({**ONE_TONE, "theta": theta}, accuracy=WHOLE).peaks))


def at_once(call: Callable[[int], object], count: int = 4) -> list[object]:
    """What a call gives in so many threads that begin together."""
    together = threading.Barrier(count)

    def begin(number: int) -> object:
        together.wait()
        return call(number)

    with ThreadPoolExecutor(count) as threads:
        return list(threads.map(begin, range(count)))


def test_what_is_made_once_is_made_by_one_thread() -> None:
    calls: list[int] = []

    @made_once
    def make(key: int) -> object:
        calls.append(key)
        time.sleep(0.05)  # the others are at it by then; without a lock they would make theirs
        return object()

    made = at_once(lambda _: make(1))
    assert len(set(map(id, made))) == 1
    assert calls == [1]
    assert make(2) is not make(1)


def test_threads_have_one_registry_of_units() -> None:
    """As two threads of a dask worker have it that begin with their first laboratories."""
    for value in vars(units).values():
        getattr(value, "cache_clear", lambda: None)()
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        found = at_once(lambda k: units.convert(1.0, "mHz", "Hz", where=f"thread {k}"))
    finally:
        sys.setswitchinterval(before)
    assert found == [1e-3] * 4
    assert units.convert(1.0, "kHz", "Hz", where="afterwards") == 1e3
    assert units.product_words({"Hz": 2, "V": -1}) == "Hz²/V"


def test_threads_take_turns_at_one_fmu(swift_fmu: Path) -> None:
    with ff.Fmu(swift_fmu) as fmu:
        wanted = [peak(fmu, 1.9 + 0.01 * k) for k in range(4)]
        pids = fmu.workers.pids
        assert at_once(lambda k: peak(fmu, 1.9 + 0.01 * k)) == wanted
        assert fmu.workers.pids == pids


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks of POSIX")
def test_a_fork_has_processes_of_its_own(swift_fmu: Path) -> None:
    with ff.Fmu(swift_fmu, workers=1) as fmu:
        wanted, pids = peak(fmu, 1.9), fmu.workers.pids
        reads, writes = os.pipe()
        child = os.fork()
        if child == 0:
            try:
                os.write(writes, pickle.dumps((peak(fmu, 1.9), fmu.workers.pids)))
                fmu.close()
            finally:
                os._exit(0)
        os.close(writes)
        with os.fdopen(reads, "rb") as file:
            theirs = pickle.loads(file.read())
        os.waitpid(child, 0)
        assert theirs[0] == wanted
        assert not set(theirs[1]) & set(pids)
        assert peak(fmu, 1.9) == wanted
        assert fmu.workers.pids == pids


def test_the_folder_may_change_after_an_fmu_was_named(
    swift_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(swift_fmu, tmp_path / "model.fmu")
    monkeypatch.chdir(tmp_path)
    with ff.Fmu("model.fmu", workers=1) as fmu:
        monkeypatch.chdir("/")
        assert peak(fmu, 1.9)
        assert "model.fmu" in repr(fmu)


def test_a_fit_and_its_fmu_are_pickled(swift_fmu: Path, tmp_path: Path) -> None:
    campaign = of_pairs(small_campaign(tmp_path / "small", swift_fmu), 1, 3)
    problem = ff.Problem.of(campaign)
    fit = ff.fit(problem, ff.Tikhonov(levels=2, quick=True), starts=1)
    again: ff.Fit = pickle.loads(pickle.dumps(fit))
    assert again["d1"].value == fit["d1"].value
    assert np.array_equal(again.x, fit.x)
    place = fit.x.copy()
    assert again.problem.logp(place) == problem.logp(place)  # through workers of its own
    assert again.problem.fmu.workers.pids != problem.fmu.workers.pids
