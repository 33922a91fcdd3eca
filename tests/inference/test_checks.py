"""Every check by itself: silent on an honest fit, one kind of finding where one thing is planted.

The fit is that of a virtual laboratory of `tests.support.virtual`: closed form, files written and
read. What is planted is put into what the checks read: readings, drift, bounds, residuals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.fit.fit import Status
from fitting.fit.linearisation import Linearisation
from fitting.fit.path import HistoryRow
from fitting.fit.search import Minimum, SearchResult
from fitting.inference.agreement import SweepAgreement
from fitting.inference.checks.mistakes import check_exchanged_peaks, check_peaks, single_rows
from fitting.inference.checks.solutions import (
    Solved,
    check_agreement,
    check_bounds,
    check_correlation,
    check_drift,
    check_levels,
    check_minima,
    check_refusals,
    check_residuals,
    check_simulation,
    check_weak_peaks,
)
from fitting.inference.infer import CHECKS, findings_of
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.measurements.tones import Tones
from fitting.text.estimate import OffsetEstimate
from fitting.text.finding import Kind
from tests.support.virtual.answers import ModesResponse
from tests.support.virtual.kinds import KINDS

pytestmark = pytest.mark.usefixtures("swift_models")


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Solved:
    """What the checks read of a fit of pairs of tones and a sweep that gives their scale."""
    path = KINDS["readings"](5).write(tmp_path_factory.mktemp("readings"))
    record = ff.Problem.of(path, ff.Fmu("CoupledOscillator")).record
    problem = ff.Problem.answered_by(lambda chosen: ModesResponse(record, chosen), record)
    squares = ff.Tikhonov(nu=1e-3, levels=1, misfit="squares")
    inferred = ff.fit(problem, squares, starts=1).inferred
    return Solved(
        fit=inferred.fit,
        solution=inferred.fit.solution,
        best=inferred.fit.solution.final.parameters,
        adequacy=inferred.ending.adequacy,
        sweeps=inferred.sweeps,
        parameters=inferred.parameters,
        derived=inferred.derived,
        offsets=inferred.offsets,
    )


def test_every_check_is_silent_on_an_honest_fit(honest: Solved) -> None:
    for check in CHECKS:
        assert [f for f in check(honest) if f.severity != "note"] == [], check.__name__


def test_checks_do_not_depend_on_each_other(honest: Solved) -> None:
    """In reverse order each finds the same."""
    every = [finding for check in reversed(CHECKS) for finding in check(honest)]
    assert sorted(map(repr, every)) == sorted(map(repr, findings_of(honest)))


def with_rows(solved: Solved, change: Callable[[Any], Any]) -> Solved:
    """The same with other residuals at the solution."""
    final = solved.solution.final
    rows = change(final.residuals.copy())
    moved = replace(final, residuals=rows)
    solution = replace(solved.solution, final=moved)
    made = replace(solved, solution=solution, fit=replace(solved.fit, solution=solution))
    made.__dict__["likeliest"] = moved
    made.__dict__["noise"] = solved.noise
    return made


def with_experiments(solved: Solved, change: Callable[[Any], Any]) -> Solved:
    """The same with other readings in every experiment."""
    data = solved.problem.data
    measurements = tuple(
        replace(m, experiments=tuple(change(e) for e in m.experiments))
        if isinstance(m, Tones)
        else m
        for m in data.measurements
    )
    problem = replace(solved.problem, data=replace(data, measurements=measurements))
    made = replace(solved, fit=replace(solved.fit, problem=problem))
    made.__dict__["noise"] = solved.noise
    return made


def test_a_peak_far_off_is_an_outlier_with_its_place(honest: Solved) -> None:
    def off(rows: Any) -> Any:
        rows[3] += 40.0 * honest.noise.sigma[3]
        return rows

    [found] = check_peaks(with_rows(honest, off))
    experiment = honest.problem.experiments[3 // len(honest.problem.experiments[0].read_hz)]
    assert (found.kind, found.subject) == (Kind.outlier, experiment.label)
    assert found.numbers["frequency_hz"] in [pytest.approx(f) for f in experiment.read_hz]
    assert found.numbers["sigmas"] > 10.0
    # where a cause explains the misfit single peaks are none
    caused = replace(with_rows(honest, off), causes=(found,))
    assert [*check_peaks(caused)] == []


def test_rows_that_make_up_larger_noise_are_named(honest: Solved) -> None:
    assert honest.adequacy is not None
    named = replace(honest, adequacy=replace(honest.adequacy, outliers=(1,)))
    [found] = single_rows(named)
    assert found.kind is Kind.outlier
    assert [*single_rows(honest)] == []


def test_two_peaks_of_one_experiment_that_are_exchanged_are_named(honest: Solved) -> None:
    def exchanged(e: Any) -> Any:
        return replace(e, peaks_v=e.peaks_v[::-1].copy())

    labels = {e.label for e in honest.problem.experiments if np.ptp(e.peaks_v) > 0.5 * e.peaks_v[0]}
    found = [*check_exchanged_peaks(with_experiments(honest, exchanged))]
    assert labels
    assert {f.kind for f in found} == {Kind.peaks_exchanged}
    assert labels <= {f.subject for f in found}


def test_peaks_near_their_noise_are_weak(honest: Solved) -> None:
    weak = with_experiments(honest, lambda e: replace(e, sigmas_v=0.5 * e.peaks_v))
    [found] = check_weak_peaks(weak)
    assert found.kind is Kind.weak_peaks
    assert found.numbers["count"] == sum(len(e.read_hz) for e in honest.problem.experiments)


@pytest.mark.parametrize(
    ("adequacy", "severity", "kind"),
    [
        (Adequacy(chi_square=99.0, freedom=9.0, p_value=0.0, describes=False), "error", "misfit"),
        (
            Adequacy(chi_square=36.0, freedom=9.0, p_value=0.0, describes=True, noise_factor=2.0),
            "warning",
            "noise",
        ),
        (
            Adequacy(
                chi_square=9.0,
                freedom=9.0,
                p_value=0.5,
                describes=True,
                correlated_p=1e-9,
                share=0.01,
            ),
            "note",
            "correlated",
        ),
        (Adequacy(chi_square=9.0, freedom=9.0, p_value=0.5, describes=True), "", ""),
    ],
    ids=["refused", "noise", "correlated", "none"],
)
def test_residuals_are_named_by_the_rule(
    honest: Solved, adequacy: Adequacy, severity: str, kind: str
) -> None:
    kinds = {
        "misfit": Kind.not_described,
        "noise": Kind.noise_underestimated,
        "correlated": Kind.correlated_residuals,
    }
    found = [*check_residuals(replace(honest, adequacy=adequacy))]
    assert [(f.kind, f.severity) for f in found] == ([(kinds[kind], severity)] if kind else [])
    if kind == "noise":
        assert found[0].numbers["factor"] == 2.0


def test_scaled_errors_without_a_reason_are_a_warning(honest: Solved) -> None:
    [found] = check_residuals(replace(honest, inflation=1.7))
    assert (found.kind, found.numbers["inflation"]) == (Kind.excess_residuals, 1.7)
    assert [*check_residuals(replace(honest, inflation=1.4))] == []
    stopped = replace(honest, inflation=1.7, describes=False)
    assert [*check_residuals(stopped)] == []


def test_a_drift_beyond_the_width_is_named_and_a_smaller_one_is_not(honest: Solved) -> None:
    [(name, bound)] = honest.problem.campaigns.items()
    width = honest.sweeps.lines[name].width.value
    for share, kinds in ((1.5, [Kind.drift_wide]), (0.5, [])):
        ends = {"eta_plus": (0.0, share * width), "eta_minus": (0.0, 0.0)}
        units = {"eta_plus": "Hz", "eta_minus": "Hz"}
        drift = replace(bound.drift, ends=ends, units=units)
        problem = replace(honest.problem, campaigns={name: replace(bound, drift=drift)})
        solved = replace(honest, fit=replace(honest.fit, problem=problem), offsets=())
        assert [f.kind for f in check_drift(solved)] == kinds


def test_an_offset_beyond_the_width_is_named_where_its_prior_lets_it_be_so(honest: Solved) -> None:
    """A step of a walk has no prior of its own: there the data alone say how far it goes."""
    [(name, _)] = honest.problem.campaigns.items()
    width = honest.sweeps.lines[name].width.value
    label = honest.problem.experiments[0].label
    for share, prior, kinds in (
        (1.5, 0.1, [Kind.drift_offset_wide]),
        (0.5, 0.1, []),
        (1.5, np.nan, []),
    ):
        offset = OffsetEstimate(
            name="offset of eta_plus",
            value=-share * width,
            unit="Hz",
            std=0.01 * width,
            prior=prior * width,
            experiments=(label,),
            variables=("eta_plus",),
        )
        found = [*check_drift(replace(honest, offsets=(offset,)))]
        assert [f.kind for f in found] == kinds
        assert all(1.5 * width in f.numbers.values() for f in found)


def test_a_value_on_its_bound_is_named(honest: Solved) -> None:
    solution = honest.solution
    first, *rest = solution.parameters
    value = float(solution.final.parameters[0])
    on = replace(first, lower=value, start=value, reference=value)
    objective = replace(solution.objective, parameters=(on, *rest))
    bounded = replace(honest, solution=replace(solution, objective=objective))
    [found] = [f for f in check_bounds(bounded) if f.subject == first.name]
    assert (found.kind, found.numbers["at_bound"]) == (Kind.at_bound, 1.0)
    assert found.severity == "note"
    assert first.name not in [f.subject for f in check_bounds(honest)]
    # of a model that does not describe the data the bound may be why
    [found] = [
        f for f in check_bounds(replace(bounded, describes=False)) if f.subject == first.name
    ]
    assert found.severity == "warning"


def test_errors_that_are_not_reported_are_not_correlated(honest: Solved) -> None:
    assert [*check_correlation(replace(honest, describes=False))] == []


@pytest.mark.parametrize(
    ("factor", "sigmas", "reason"),
    [
        (np.sqrt(2.0), 9.0, ("rms",)),
        (0.5, 9.0, ("peak_to_peak",)),
        (1.2, 9.0, ()),
        (np.nan, 9.0, ()),
        (np.sqrt(2.0), 3.0, None),
    ],
    ids=["rms", "peak to peak", "gain", "none", "agrees"],
)
def test_peaks_that_contradict_their_sweep_are_named_with_the_factor(
    honest: Solved, factor: float, sigmas: float, reason: tuple[str, ...] | None
) -> None:
    test = SweepAgreement(series="", sigmas=sigmas, factor=float(factor), factor_std=0.003)
    found = [*check_agreement(replace(honest, sweeps=replace(honest.sweeps, agreement=(test,))))]
    assert [f.kind for f in found] == ([] if reason is None else [Kind.scale_contradicted])
    for each in found:
        assert each.names["reason"] == reason
        assert ("factor" in each.numbers) is bool(np.isfinite(factor))


def test_a_simulation_that_is_most_of_an_error_is_named(honest: Solved) -> None:
    name = next(n for n, v in honest.parameters.items() if v.status.has_value)
    value = honest.parameters[name]
    for share, kinds in ((0.5, [Kind.simulation_error]), (0.01, [])):
        moved = replace(value, simulation=share * value.std)
        solved = replace(honest, parameters={name: moved}, derived={}, offsets=())
        final = replace(solved.solution.final, promised=(1e-3,))
        solved = replace(solved, solution=replace(solved.solution, final=final))
        assert [f.kind for f in check_simulation(solved)] == kinds


def test_a_fit_that_did_not_converge_is_an_error(honest: Solved) -> None:
    stopped = replace(honest, fit=replace(honest.fit, status=Status.NOT_CONVERGED))
    assert [f.kind for f in check_residuals(stopped)][:1] == [Kind.not_converged]


def level(number: int, j: float, second_j: float, status: str = "converged") -> HistoryRow:
    return HistoryRow(
        level=number,
        nu=0.1**number,
        parameters={},
        derived={},
        j_fit=j,
        j_reg=0.0,
        change=0.0,
        optimality=0.0,
        second_j=second_j,
        status=status,
        message="",
        iterations=1,
        evaluations=1,
        seconds=0.0,
    )


@pytest.mark.parametrize(
    ("levels", "severity", "at_limit", "above"),
    [
        ([level(0, 1.0, 1.0), level(1, 1.0, 0.99995)], None, 0.0, ()),
        ([level(0, 1.0, 1.0, "iteration limit"), level(1, 1.0, 1.0)], "note", 1.0, ()),
        ([level(0, 1.0, 0.9998), level(1, 1.0, 1.0)], "warning", 0.0, ("0",)),
    ],
)
def test_levels_that_are_not_minimised_are_named(
    honest: Solved,
    levels: list[HistoryRow],
    severity: str | None,
    at_limit: float,
    above: tuple[str, ...],
) -> None:
    """2e-4 of J above what the second solver came by is above, half a ten-thousandth is not."""
    history = (level(-1, 5.0, np.nan, "start"), *levels)
    found = [*check_levels(replace(honest, fit=replace(honest.fit, path=history)))]
    assert [f.severity for f in found] == ([] if severity is None else [severity])
    for each in found:
        assert each.kind is Kind.level_not_minimised
        assert (each.numbers["levels"], each.numbers["at_limit"]) == (2.0, at_limit)
        assert each.names["above"] == above
    assert [*check_levels(replace(honest, fit=replace(honest.fit, path=())))] == []


#: A search whose lowest minimum noise explains.
SEARCH = SearchResult(
    screened=64, screens=1, descents=2, explained=True, evaluations=99, fmu_runs=99
)


def test_points_at_which_the_model_fails_are_told_in_its_words(honest: Solved) -> None:
    assert [*check_refusals(honest)] == []
    search = replace(SEARCH, refused=7, refusal="no motion")
    outcome = replace(honest.fit.outcome, search=search)
    outcomes = tuple(outcome if o is honest.fit.outcome else o for o in honest.fit.outcomes)
    [found] = check_refusals(replace(honest, fit=replace(honest.fit, outcomes=outcomes)))
    assert (found.kind, found.severity) == (Kind.points_refused, "note")
    assert (found.numbers, found.names) == ({"points": 7.0}, {"words": ("no motion",)})


def test_a_minimum_as_low_is_named_where_a_value_that_is_held_differs(honest: Solved) -> None:
    """Each is held to a hundredth: ten standard errors off along the first one, and two."""
    n = len(honest.fit.x)
    errors = Linearisation(rows=np.zeros(n), matrix=100.0 * np.eye(n), prior=np.ones(n))
    solution = replace(honest.fit.solution, errors=errors)
    fit, axis = replace(honest.fit, solution=solution), np.eye(n)[0]
    for sigmas, count in ((10.0, 1), (2.0, 0)):
        places = [fit.outcome.x, fit.outcome.x + 0.01 * sigmas * axis]
        minima = tuple(Minimum(x=x, start=x, chi_square=4.0, descents=1) for x in places)
        outcome = replace(fit.outcome, search=SEARCH, minima=minima)
        outcomes = tuple(outcome if o is fit.outcome else o for o in fit.outcomes)
        solved = replace(honest, fit=replace(fit, outcomes=outcomes))
        assert [f.kind for f in check_minima(solved)] == [Kind.equal_objective] * count
