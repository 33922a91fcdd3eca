"""What a job will cost, held against what a small fit of the same problem is counted to take."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.api.cost import expected as expected_cost
from fitting.api.fitted import search_options
from fitting.inference.cost import Range, added
from fitting.inference.determine import own_profiled
from tests.support.in_process import told
from tests.support.small_campaign import small_campaign


@dataclass(frozen=True)
class Taken:
    """What was counted: runs of the plan, evaluations of fit and profiles, runs of all."""

    planning_runs: int
    search: int
    profiles: int
    runs: int


@pytest.fixture(scope="module")
def campaign(swift_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_campaign(tmp_path_factory.mktemp("cost") / "small", swift_fmu)


@pytest.fixture(scope="module")
def expected(campaign: Path) -> ff.Cost:
    return ff.cost(ff.Problem.of(campaign))


@pytest.fixture(scope="module")
def taken(campaign: Path) -> Taken:
    """The job itself, on a problem of its own."""
    problem = ff.Problem.of(campaign)
    counts = problem.fmu.workers
    _ = problem.objective
    planned = counts.counts.runs
    fit = ff.fit(problem)
    found = ff.profile(fit)
    assert found.knowledge is not None
    return Taken(planned, fit.nfev, found.knowledge.effort.evaluations, counts.counts.runs)


def inside(count: int, bounds: Range) -> bool:
    return bounds[0] <= count <= bounds[1]


def test_what_is_counted_lies_in_what_was_expected(expected: ff.Cost, taken: Taken) -> None:
    assert inside(taken.search, added(expected.expected.search, expected.expected.path))
    assert inside(taken.profiles, expected.expected.profiles)
    assert inside(taken.search + taken.profiles, expected.evaluations)
    assert inside(taken.runs, expected.runs)


def test_the_plan_is_the_one_of_the_job(expected: ff.Cost, taken: Taken) -> None:
    assert expected.planning_runs == taken.planning_runs


def test_further_starts_are_counted_in(campaign: Path) -> None:
    problem = ff.Problem.of(campaign)
    found = ff.cost(problem, starts=3, profiles=False)
    assert found.expected.profiles == (0.0, 0.0)
    assert inside(ff.fit(problem, starts=3).nfev, found.evaluations)


def test_what_the_job_consists_of(expected: ff.Cost) -> None:
    """The small campaign: a damping and five offsets of drift, one output, five levels."""
    parts = expected.expected
    assert (parts.parameters, parts.jacobian) == (6, 13)
    assert (parts.alternatives, parts.levels, parts.starts) == (1, 5, 1)
    assert (parts.profiled, parts.outputs, parts.refits) == (2, 1, 0)


def test_identify_counts_the_profiles_that_it_walks(campaign: Path) -> None:
    """Its offsets have one, too: a fit has a table of their own for them."""
    problem = ff.Problem.of(campaign)
    walked = ff.identify(problem).profiled
    record = problem.record
    whole = expected_cost(
        record,
        search_options(problem, None, 1, None),
        profiles=True,
        refits=0,
        own=own_profiled(record),
    )
    assert whole.profiled == len(walked) == 7


def test_a_range_is_told_that_means_something(expected: ff.Cost) -> None:
    for low, high in (expected.evaluations, expected.runs, expected.seconds):
        assert 0.0 < low < high < 30.0 * low


def test_an_evaluation_takes_a_run_for_each_pair_at_most(expected: ff.Cost) -> None:
    """Five pairs of tones and a sweep; a Jacobian simulates what its points share once."""
    assert 1.0 <= expected.runs_each <= 8.0
    assert expected.seconds_each > 0.0


def test_a_bootstrap_is_counted_in(campaign: Path) -> None:
    problem = ff.Problem.of(campaign)
    plain, more = (ff.cost(problem, bootstrap=n).expected for n in (0, 50))
    assert plain.bootstrap == (0.0, 0.0)
    assert more.bootstrap[1] > more.bootstrap[0] >= 50.0
    assert (plain.search, plain.profiles) == (more.search, more.profiles)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what a process holds")
def test_memory_is_that_of_three_processes(expected: ff.Cost) -> None:
    assert 3 * 10e6 < expected.memory_bytes < 4e9


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what a process holds")
def test_memory_that_was_given_back_counts(campaign: Path) -> None:
    """400 MB, written and given back before the job is looked at, were needed by then."""
    np.ones(50_000_000)
    assert ff.cost(ff.Problem.of(campaign)).memory_bytes > 400e6


def test_a_dry_run_writes_nothing(
    campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ("reconstruct", campaign, "--workers", "1", "--dry-run")
    ended, document = told(*words), told(*words, "--json")
    assert (ended.code, document.code) == (0, 0)
    assert "expected: " in ended.out.splitlines()[0]
    assert "2 n + 1 = 13 " in " ".join(ended.out.split())
    assert json.loads(document.out)["expected"]["parameters"] == 6
    assert list(tmp_path.iterdir()) == []
    assert "--budget" not in ended.out
    assert re.search(r"--budget .*\b500\b", told(*words, "--budget", "500").out)


def test_what_is_no_problem_is_refused() -> None:
    with pytest.raises(ff.BadInput, match=r"cost: .*'campaign.toml', wanted a Problem"):
        ff.cost("campaign.toml")  # type: ignore[arg-type]
