"""Algorithm 2 on closed forms: known values come back, and what the solver claims is checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares, linprog

from fitting.campaign import ContinuationSettings
from fitting.campaign.parameters import Parameter, search_bounds, to_search
from fitting.fit.alternative import Outcome
from fitting.fit.alternative import run_alternative as run_course
from fitting.fit.objective import Objective, evaluate_many, make_objective
from fitting.fit.options import Options, options_of
from fitting.fit.solver import interior_point
from fitting.fit.solver.continuation import (
    Chain,
    ContinuationStep,
    Course,
    Journal,
    Schedule,
    distance,
    own_start,
)
from fitting.fit.solver.evaluator import Evaluator, total
from fitting.fit.solver.interior_point import SolveSettings, solve
from fitting.fit.solver.linear_program import follow, promised_decrease
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import Evaluation
from fitting.text.arrays import FloatArray
from tests.support import closed_form, datasets

TRUTH: tuple[float, float, float] = (1.9498, 120.0, 90.0)
WIDTH = float(closed_form.damping(*TRUTH, reflection=False)[0, 0])


def objective_of(measured: Dataset, *, reflection: bool = False) -> Objective:
    response = closed_form.string_response(reflection=reflection)
    return make_objective(response, closed_form.string_parameters(), measured)


def run_alternative(
    objective: Objective,
    schedule: Schedule,
    settings: SolveSettings,
    alternative: int = 0,
    journal: Journal | None = None,
) -> Outcome:
    return run_course(
        Course(
            objective=objective,
            schedule=schedule,
            settings=settings,
            alternative=alternative,
            journal=journal or Journal(),
        )
    )


@pytest.fixture(scope="module")
def clean() -> Dataset:
    return closed_form.measured_by(closed_form.string_response())


@pytest.fixture(scope="module")
def noisy() -> Dataset:
    return closed_form.measured_by(closed_form.string_response(), noise=0.01)


@pytest.fixture(scope="module")
def whole(noisy: Dataset) -> Outcome:
    """Noisy data fitted by the usual schedule."""
    return run_alternative(objective_of(noisy), Schedule(), SolveSettings())


@pytest.fixture(scope="module")
def least(noisy: Dataset) -> float:
    """J at the end of the first level from the campaign's start."""
    objective = objective_of(noisy)
    evaluator = Evaluator(objective)
    honest = solve(
        evaluator, own_start(objective.parameters), 0.1, SolveSettings(), np.random.default_rng(1)
    )
    return total(evaluator.point(honest.x), 0.1, "slack")


def width_of(outcome: Outcome, *, reflection: bool = False) -> float:
    assert outcome.best is not None
    theta, d1, d2 = outcome.best.steps[-1].parameters
    return float(closed_form.damping(theta, d1, d2, reflection)[0, 0])


def test_clean_data_give_the_width_back_and_both_forms_fit_alike(clean: Dataset) -> None:
    ends = []
    for reflection, starts in ((False, 3), (True, 1)):  # of the other form the box is the same
        objective = objective_of(clean, reflection=reflection)
        outcome = run_alternative(objective, Schedule(starts=starts), SolveSettings())
        assert outcome.best is not None
        ends.append(outcome.best.steps[-1])
        spent = sum(step.evaluations for chain in outcome.chains for step in chain.steps)
        assert spent < 2500  # without second-order corrections ten times as many
        assert ends[-1].status == "optimal"
        assert ends[-1].j_fit < 1e-6
        assert width_of(outcome, reflection=reflection) == pytest.approx(WIDTH, rel=1e-6)
        assert all(chain.steps[-1].j_fit < 1e-6 for chain in outcome.chains)  # one valley
    assert ends[0].j == pytest.approx(ends[1].j, abs=1e-8)


def test_a_damping_held_wrong_leaves_a_misfit_and_a_coupling_held_wrong_does_not(
    clean: Dataset,
) -> None:
    names = closed_form.string_parameters()
    wrong = {"damping": {"d1": 160.0, "d2": 140.0}, "coupling": {"theta": 1.7}}
    left = {}
    for label, values in wrong.items():
        response = closed_form.held(closed_form.string_response(), **values)
        free = tuple(p for p in names if p.name not in values)
        outcome = run_alternative(
            make_objective(response, free, clean), Schedule(starts=1), SolveSettings()
        )
        assert outcome.best is not None
        left[label] = outcome.best.steps[-1].j_fit
    assert left["damping"] > 0.5  # ten peaks, at least five percent each
    assert left["coupling"] < 1e-4  # the data cannot see it


def test_the_paper_start_is_a_stationary_point_of_the_misfit_that_the_prior_leaves(
    noisy: Dataset,
) -> None:
    objective = objective_of(noisy)
    outcome = run_alternative(objective, Schedule(starts=1, levels=1), SolveSettings())
    assert outcome.chains[0].begun[0] == pytest.approx(-closed_form.THETA_REFERENCE)
    assert outcome.chains[0].steps[0].parameters[0] == pytest.approx(
        closed_form.THETA_REFERENCE, abs=0.1
    )


# --- other solvers as referees -------------------------------------------------------------------


def referee(evaluator: Evaluator, x: np.ndarray, nu: float) -> float:
    """Least J of the sum of absolute values by plain sequential linear programs, its own loop."""
    radius, value = 0.3, total(evaluator.point(x), nu, "slack")
    m = evaluator.point(x).residuals.size
    for _ in range(400):
        r, matrix = evaluator.point(x).residuals, evaluator.jacobian(x)
        cost = np.concatenate([nu * x, np.ones(m)])
        a = np.block([[matrix, -np.eye(m)], [-matrix, -np.eye(m)]])
        box = [
            (max(-radius, lo - xi), min(radius, hi - xi))
            for lo, hi, xi in zip(evaluator.lower, evaluator.upper, x, strict=True)
        ]
        answer = linprog(cost, a, np.concatenate([-r, r]), bounds=[*box, *[(0, None)] * m])
        trial = np.clip(x + answer.x[: x.size], evaluator.lower, evaluator.upper)
        reached = total(evaluator.point(trial), nu, "slack")
        if reached < value:
            x, value, radius = trial, reached, min(1.0, 2.0 * radius)
        else:
            radius *= 0.5
        if radius < 1e-8:
            break
    return value


@pytest.mark.parametrize("nu", [0.1, 1e-3])
def test_the_interior_point_reaches_what_a_second_solver_reaches(noisy: Dataset, nu: float) -> None:
    objective = objective_of(noisy)
    start = own_start(objective.parameters)
    evaluator = Evaluator(objective)
    answer = solve(evaluator, start, nu, SolveSettings(), np.random.default_rng(1))
    reached = total(evaluator.point(answer.x), nu, "slack")
    best = min(referee(evaluator, x, nu) for x in (answer.x, np.zeros(3)))
    assert reached <= best + 1e-7 + 1e-4 * best


def test_squares_agree_with_least_squares(noisy: Dataset) -> None:
    objective = objective_of(noisy)
    evaluator, nu = Evaluator(objective), 0.1
    start = np.array([-0.5, 0.3, 0.3])
    settings = SolveSettings(misfit="squares", absolute=1e-7, relative=0.0, iterations=200)
    answer = solve(evaluator, start, nu, settings, np.random.default_rng(1))

    def rows(x: np.ndarray) -> np.ndarray:
        return np.concatenate([evaluator.point(x.copy()).residuals, np.sqrt(nu / 2) * x])

    truth = least_squares(
        rows,
        np.zeros(3),
        bounds=search_bounds(objective.parameters),
        xtol=1e-14,
        ftol=1e-15,
        gtol=1e-14,
        x_scale="jac",
    )
    assert total(evaluator.point(answer.x), nu, "squares") == pytest.approx(
        2 * truth.cost, rel=1e-6, abs=1e-10
    )


def test_plain_sum_of_absolute_values_is_slower_and_says_so(noisy: Dataset) -> None:
    objective = objective_of(noisy)
    start = own_start(objective.parameters)
    ends = {}
    for misfit in ("slack", "absolute"):
        evaluator = Evaluator(objective)
        settings = SolveSettings(misfit=misfit, restarts=0)
        answer = solve(evaluator, start, 0.1, settings, np.random.default_rng(1))
        ends[misfit] = (answer, total(evaluator.point(answer.x), 0.1, "slack"))
    assert ends["slack"][0].status == "optimal"
    assert ends["slack"][1] <= ends["absolute"][1] + 1e-9
    kinked = ends["absolute"][0]
    promise = promised_decrease(Evaluator(objective), kinked.x, 0.1, "absolute")
    assert kinked.optimality == pytest.approx(promise, rel=1e-6)
    assert (kinked.status == "optimal") == (promise <= 1e-7 + 1e-4 * ends["absolute"][1])


class Underived:
    """A response without derived outputs."""

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [{} for _ in ps]


def test_the_optimality_measure_is_zero_only_at_a_minimum() -> None:
    """|x - 1| + |x + 2 y| has its minimum 0 at (1, -1/2); the promise at (3, 0) is known."""

    class Lines(Underived):
        def evaluate_many(
            self, ps: Sequence[FloatArray], *, whole: bool = False
        ) -> list[Evaluation]:
            return [datasets.answer(np.array([p[0], p[0] + 2 * p[1] + 5.0])) for p in ps]

    data = datasets.dataset(np.array([1.0, 5.0]), np.ones(2))
    box = (
        Parameter(name="x", unit="1", lower=-9, upper=9, start=3, reference=0, scale=1),
        Parameter(name="y", unit="1", lower=-9, upper=9, start=0, reference=0, scale=1),
    )
    evaluator = Evaluator(make_objective(Lines(), box, data))
    # rows x - 1 and (x + 2 y)/5: at (3, 0) one unit of -x gives 1 + 1/5, one of -y 2/5
    there = promised_decrease(evaluator, np.array([3.0, 0.0]), 0.0, "slack")
    assert there == pytest.approx(1.6, rel=1e-6)
    end = follow(evaluator, np.array([3.0, 0.0]), 0.0, 1e-10)
    assert end.x == pytest.approx([1.0, -0.5], abs=1e-7)
    assert end.optimality < 1e-10


# --- guards ---------------------------------------------------------------------------------------


def test_a_start_on_a_bound_does_not_stall(noisy: Dataset) -> None:
    objective = objective_of(noisy)
    lower, upper = search_bounds(objective.parameters)
    inner = run_alternative(objective, Schedule(starts=1, levels=2), SolveSettings())
    on_bound = tuple(
        replace(p, start=p.upper if p.name != "theta" else p.lower) for p in objective.parameters
    )
    begun = own_start(on_bound)
    assert np.all((begun > lower) & (begun < upper))
    bound = replace(objective, parameters=on_bound)
    outer = run_alternative(bound, Schedule(starts=1, levels=2), SolveSettings())
    assert inner.best is not None
    assert outer.best is not None
    one, two = inner.best.steps[-1], outer.best.steps[-1]
    assert two.j == pytest.approx(one.j, rel=1e-3)


@pytest.mark.parametrize("claim", ["nothing done", "NaN", "outside"])
def test_a_false_success_of_the_solver_is_not_believed(
    noisy: Dataset, least: float, claim: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The known false successes of trust-constr, put in its place: J still gets to its minimum."""

    def liar(**given):  # type: ignore[no-untyped-def]
        x = {"nothing done": given["x0"], "NaN": np.full(13, np.nan), "outside": np.full(13, 1e3)}
        given["callback"](x[claim], None)

        class Answer:
            success, message = True, "`xtol` termination condition is satisfied."

        return Answer()

    objective = objective_of(noisy)
    evaluator = Evaluator(objective)
    start = own_start(objective.parameters)
    monkeypatch.setattr(interior_point, "minimize", liar)
    answer = solve(evaluator, start, 0.1, SolveSettings(), np.random.default_rng(1))
    assert np.all(np.isfinite(answer.x))
    assert total(evaluator.point(answer.x), 0.1, "slack") < total(
        evaluator.point(start), 0.1, "slack"
    )
    if answer.status == "optimal":
        assert total(evaluator.point(answer.x), 0.1, "slack") == pytest.approx(least, rel=1e-3)


def test_a_solve_never_ends_above_its_start(noisy: Dataset) -> None:
    objective = objective_of(noisy)
    for misfit in ("slack", "absolute", "squares"):
        evaluator = Evaluator(objective)
        start = np.array([0.01, 0.02, -0.01])
        settings = SolveSettings(misfit=misfit, iterations=2, restarts=0)
        answer = solve(evaluator, start, 1e-4, settings, np.random.default_rng(1))
        ends = [total(evaluator.point(x), 1e-4, misfit) for x in (answer.x, start)]
        assert ends[0] <= ends[1]


# --- schedule, stopping rules, starts -------------------------------------------------------------


def test_the_schedule_and_both_stopping_rules(noisy: Dataset, whole: Outcome) -> None:
    objective = objective_of(noisy)
    own = whole.chains[0]
    steps = own.steps
    assert [s.nu for s in steps] == pytest.approx([0.1**k for k in range(1, 10)], rel=1e-12)
    assert "9 levels" in own.ended
    for k, step in enumerate(steps):  # E as the paper writes it, with nu of the next level
        before = np.array(steps[k - 1].x if k else own.begun)
        x = np.array(step.x)
        following = 0.5 * step.nu * 0.1 * float(x @ x)
        expected = float(np.linalg.norm(x - before)) + abs(step.j_fit - following)
        assert step.change == pytest.approx(expected, rel=1e-9)
    loose = Schedule(starts=1, tolerance=2.0 * steps[1].change)
    short = run_alternative(objective, loose, SolveSettings())
    assert short.best is not None
    assert len(short.best.steps) == 2
    assert "tolerance" in short.best.ended


def test_a_campaign_that_says_nothing_is_solved_as_if_there_were_none() -> None:
    assert options_of(ContinuationSettings()) == Options()


def test_the_campaigns_own_start_comes_first() -> None:
    parameters = closed_form.string_parameters()
    assert own_start(parameters) == pytest.approx(
        to_search(parameters, np.array([0.0, 94.0, 94.0]))
    )


def test_distance_knows_periods() -> None:
    parameters = closed_form.string_parameters()
    x = np.array([0.1, 0.0, 0.0])
    assert distance(parameters, x, x + np.array([np.pi, 0, 0])) == pytest.approx(0.0, abs=1e-14)
    assert distance(parameters, x, x + np.array([np.pi - 0.2, 0, 0])) == pytest.approx(0.2)


def test_an_interruption_keeps_what_is_done_and_a_recalled_run_goes_on_bit_for_bit(
    noisy: Dataset,
) -> None:
    schedule = Schedule(starts=2, levels=2)
    whole: list[ContinuationStep] = []
    # of two unknowns the box is searched in a third of the time
    response = closed_form.held(closed_form.string_response(), theta=TRUTH[0])
    objective = make_objective(response, closed_form.string_parameters()[1:], noisy)
    full = run_alternative(objective, schedule, SolveSettings(), 0, Journal(record=whole.append))
    done: list[ContinuationStep] = []

    def stop_after_three(alternative: int, start: int, level: int) -> None:
        if len(done) == 3:
            raise KeyboardInterrupt

    half = run_alternative(
        objective,
        schedule,
        SolveSettings(),
        0,
        Journal(record=done.append, entering=stop_after_three),
    )
    assert half.interrupted
    assert half.best is not None
    kept = {(s.alternative, s.start, s.level): s for s in done}
    again = run_alternative(
        make_objective(response, objective.parameters, noisy),
        schedule,
        SolveSettings(),
        0,
        Journal(recall=lambda *key: kept.get(key), record=done.append),
    )
    assert timeless(again.chains) == timeless(full.chains)
    assert len(done) == len(whole)


def timeless(chains: tuple[Chain, ...]) -> list[Chain]:
    return [replace(c, steps=tuple(replace(s, seconds=0.0) for s in c.steps)) for c in chains]


def test_minima_apart_are_kept_apart() -> None:
    """(p^2 - 4)^2 from both sides: two minima of equal J that must not be merged."""

    class Double(Underived):
        def evaluate_many(
            self, ps: Sequence[FloatArray], *, whole: bool = False
        ) -> list[Evaluation]:
            return [datasets.answer(np.array([p[0] ** 2])) for p in ps]

    data = datasets.dataset(np.array([4.0]), np.ones(1))
    box = (
        Parameter(name="p", unit="1", lower=-5.0, upper=6.0, start=3.0, reference=0.0, scale=1.0),
    )
    objective = make_objective(Double(), box, data)
    outcome = run_alternative(objective, Schedule(starts=6, seed=2), SolveSettings())
    ends = sorted({round(c.steps[-1].parameters[0], 4) for c in outcome.chains if c.joined is None})
    assert ends == [-2.0, 2.0]
    assert outcome.best is not None
    assert outcome.best.start == 0  # of equals, the campaign's own


def test_evaluations_stay_within_the_budget(noisy: Dataset, whole: Outcome) -> None:
    spent = sum(step.evaluations for chain in whole.chains for step in chain.steps)
    assert spent < 1500
    assert evaluate_many(objective_of(noisy), [np.zeros(3)])[0].runs == 0
