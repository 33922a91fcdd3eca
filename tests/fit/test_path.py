"""Algorithm 2 on the closed form of the string, and PAPER's own minima of every level."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.campaign import ContinuationSettings
from fitting.campaign.parameters import search_bounds, to_search
from fitting.fit.fit import MOST_SLACKS, Status, solve_problem, with_path
from fitting.fit.objective import Objective, make_objective
from fitting.fit.options import Options, Schedule, options_of
from fitting.fit.path import (
    GLOBAL,
    PATH,
    Hooks,
    PathLevel,
    Progress,
    follow_path,
    history_rows,
    own_start,
)
from fitting.text.errors import BadInput
from tests.support import closed_form
from tests.support.rows import rows_objective

TRUTH = (1.9498, 120.0, 90.0)


@pytest.fixture(scope="module")
def objective() -> Objective:
    measured = closed_form.measured_by(closed_form.string_response(), noise=0.01)
    response = closed_form.string_response()
    return make_objective(response, closed_form.string_parameters(), measured)


def course(objective: Objective, **schedule: float) -> tuple[Objective, Options]:
    return objective, Options(schedule=Schedule(**schedule))  # type: ignore[arg-type]


@dataclass
class Kept:
    """Levels in memory."""

    levels: dict[tuple[str, int, int], PathLevel] = field(default_factory=dict)

    def recall(self, kind: str, alternative: int, level: int) -> PathLevel | None:
        return self.levels.get((kind, alternative, level))

    def record(self, level: PathLevel) -> None:
        self.levels[level.kind, level.alternative, level.level] = level


@pytest.fixture(scope="module")
def levels(objective: Objective) -> list[PathLevel]:
    return list(follow_path(*course(objective)))


def test_every_level_is_minimised_from_the_one_before(
    objective: Objective, levels: list[PathLevel]
) -> None:
    assert [level.nu for level in levels] == pytest.approx([0.1 * 0.1**k for k in range(9)])
    before = own_start(objective.parameters)
    for level in levels:
        assert 0 < level.iterations <= 40
        assert level.jacobians > 0
        assert level.gap <= 1e-4
        x = np.array(level.x)
        following = 0.05 * level.nu * float(x @ x)  # E as the paper writes it, at the next nu
        expected = float(np.linalg.norm(x - before)) + abs(level.j_fit - following)
        assert level.change == pytest.approx(expected, rel=1e-9)
        assert level.j_reg == pytest.approx(0.5 * level.nu * float(x @ x))
        before = x
    theta, d1, d2 = levels[-1].parameters
    width = float(closed_form.damping(theta, d1, d2, reflection=False)[0, 0])
    truth = float(closed_form.damping(*TRUTH, reflection=False)[0, 0])
    assert width == pytest.approx(truth, rel=0.02)


def test_levels_end_early_where_e_falls_to_the_tolerance(
    objective: Objective, levels: list[PathLevel]
) -> None:
    loose = course(objective, tolerance=2.0 * levels[1].change)
    assert len(list(follow_path(*loose))) == 2


def test_the_campaigns_own_start_is_the_first(objective: Objective) -> None:
    begun = to_search(objective.parameters, np.array([0.0, 94.0, 94.0]))
    assert own_start(objective.parameters) == pytest.approx(begun)
    lower, upper = search_bounds(objective.parameters)
    on_bound = tuple(replace(p, start=p.upper) for p in objective.parameters)
    assert np.all((own_start(on_bound) > lower) & (own_start(on_bound) < upper))


def test_a_level_that_was_finished_is_not_solved_again(
    objective: Objective, levels: list[PathLevel]
) -> None:
    """Stopped after three, resumed from them: the same to the last bit."""
    kept = Kept()

    def stop(state: Progress) -> None:
        if state.done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(follow_path(*course(objective), hooks=Hooks(progress=stop, memory=kept)))
    assert len(kept.levels) == 3
    again = list(follow_path(*course(objective), hooks=Hooks(memory=kept)))
    assert [replace(level, seconds=0.0) for level in again] == [
        replace(level, seconds=0.0) for level in levels
    ]
    assert len(kept.levels) == len(levels)


def test_the_history_begins_with_the_start(objective: Objective, levels: list[PathLevel]) -> None:
    rows = history_rows(*course(objective), levels)
    assert [row.level for row in rows] == list(range(-1, 9))
    assert rows[0].parameters["d1"] == pytest.approx(94.0)
    assert math.isnan(rows[0].nu)
    assert rows[-1].parameters["d2"] == pytest.approx(levels[-1].parameters[2])
    assert rows[-1].derived["lambda"] > 0.0
    assert history_rows(*course(objective), []) == ()


def test_a_level_over_the_box_is_at_most_the_published_one() -> None:
    """(p^2 - 4)^2 + p/8 from the higher well, which the path stays in, and the multistart not."""
    rows = lambda p: np.array([p[0] ** 2 - 4.0, 0.5 + p[0] / 8.0])  # noqa: E731
    wells = rows_objective(rows, [-5.0], [5.0])
    start = replace(wells.parameters[0], start=3.0)
    own = course(replace(wells, parameters=(start,)), nu_start=1e-3, iterations=2)
    followed, lowest = (list(follow_path(*own, kind=kind)) for kind in (PATH, GLOBAL))
    assert [level.kind for level in followed + lowest] == [PATH, PATH, GLOBAL, GLOBAL]
    assert followed[-1].x[0] == pytest.approx(2.0, abs=0.01)
    assert lowest[-1].x[0] == pytest.approx(-2.0, abs=0.01)
    assert all(b.j < a.j for a, b in zip(followed, lowest, strict=True))


def test_a_campaign_without_the_table_has_no_levels() -> None:
    assert not options_of(None).needs_path
    assert options_of(ContinuationSettings()) == Options(path=True)
    assert Options(estimator="algorithm2").needs_path


def problem_of_rows(tmp_path: Path) -> ff.Problem:
    measured = closed_form.measured_by(closed_form.string_response(), noise=0.01)
    bound = closed_form.string_campaign(measured, closed_form.string_response(), tmp_path)
    record = ff_problem(bound)
    return ff.Problem.answered_by(
        lambda chosen: closed_form.string_response(reflection=bool(chosen["reflection"])), record
    )


def ff_problem(bound: Any) -> Any:
    from fitting.fit.problem import problem_of

    return problem_of([bound])


@pytest.fixture(scope="module")
def string_problem(tmp_path_factory: pytest.TempPathFactory) -> ff.Problem:
    return problem_of_rows(tmp_path_factory.mktemp("string"))


def test_the_values_do_not_rest_on_the_levels(string_problem: ff.Problem) -> None:
    fits = [
        ff.fit(string_problem, ff.Tikhonov(path=path, levels=2), starts=1) for path in (True, False)
    ]
    assert [len(fit.path) for fit in fits] == [3, 0]
    assert np.array_equal(fits[0].x, fits[1].x)
    assert math.isfinite(fits[0]["d1"].algorithm2)
    assert math.isnan(fits[1]["d1"].algorithm2)


def test_an_interrupted_path_keeps_its_levels(string_problem: ff.Problem) -> None:
    record = string_problem.record
    options = Options(schedule=Schedule(starts=1, iterations=3), path=True)
    fit = solve_problem(record, string_problem.respond, options)
    calls: Iterator[int] = iter(range(100))

    def stop(state) -> None:  # type: ignore[no-untyped-def]
        if next(calls) == 2:
            raise KeyboardInterrupt

    stopped = with_path(fit, Hooks(progress=stop))
    assert stopped.status is Status.INTERRUPTED
    assert len(stopped.levels) == 2
    assert [row.level for row in stopped.path] == [-1, 0, 1]
    assert stopped.x == pytest.approx(fit.x)


def test_too_many_slacks_are_refused(string_problem: ff.Problem) -> None:
    options = Options(schedule=Schedule(starts=1, iterations=1), path=True)
    fit = solve_problem(string_problem.record, string_problem.respond, options)
    many = np.zeros(MOST_SLACKS + 1)
    final = replace(fit.solution.final, residuals=many)
    with pytest.raises(BadInput, match="squares"):
        with_path(replace(fit, solution=replace(fit.solution, final=final)))


#: PAPER.md, section 7: theta, d1, d2 and J_fit of the least J at every nu of the published series.
PUBLISHED = [
    (1e-1, 1.7444, 17.4, 95.8, 1.41288),
    (1e-2, 1.7573, 17.0, 96.2, 1.41287),
    (1e-3, 2.3903, 174.0, 1.0, 1.41171),
    (1e-4, 1.8773, 1000.0, 3.2, 1.39966),
    (1e-5, 1.2609, 1000.0, 1.0, 1.39934),
    *((nu, 1.8807, 1000.0, 1.0, 1.39934) for nu in (1e-6, 1e-7, 1e-8, 1e-9)),
]


def equivalent(theta: float, d1: float, d2: float) -> list[tuple[float, float, float]]:
    """The same damping matrix: half turns, quarter turns with the dampings exchanged, and signs.

    The published series sees the first diagonal element alone, which is even in theta.
    """
    turned = [(theta, d1, d2), (theta + math.pi / 2.0, d2, d1)]
    return turned + [(-t, a, b) for t, a, b in turned]


@pytest.mark.nightly
def test_the_least_j_of_every_level_is_that_of_an_independent_search(
    swift_models: None, tmp_path: Path
) -> None:
    """At 1e-3 and 1e-4 it is lower than theirs, by 2e-5 and 2e-4: the minimum is another one.

    Of settled amplitudes, with the noise taken off in quadrature.
    """
    fmu = ff.Fmu("CoupledOscillator", workers=2)
    path = ff.example("string_q1_published", tmp_path / "campaign")
    for old in ("as_published = true", 'noise_floor = "mean"'):
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, ""))
    problem = ff.Problem.of(path, fmu)
    fit = ff.fit(problem, replace(ff.Tikhonov.of(problem.options), global_path=True))
    _, *rows = fit.global_path
    scale, reference = (
        np.array([1.0, 100.0, 100.0]),
        np.array([5.0 * math.pi / 8.0, 15.004, 15.004]),
    )
    for row, (nu, theta, d1, d2, j_fit) in zip(rows, PUBLISHED, strict=True):
        p = np.array([row.parameters[name] for name in ("theta", "d1", "d2")])
        assert row.nu == pytest.approx(nu)
        x = (np.array([theta, d1, d2]) - reference) / scale
        theirs = j_fit + 0.5 * nu * float(x @ x)
        assert row.j <= theirs * (1.0 + 1e-4)
        if nu in (1e-3, 1e-4):
            continue
        assert row.j_fit == pytest.approx(j_fit, rel=1e-4)
        turns = [math.remainder(p[0] - t, math.pi) for t, _, _ in equivalent(theta, d1, d2)]
        assert min(map(abs, turns)) < 1e-3
