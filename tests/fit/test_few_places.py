"""Few spectra of a map that stand for all of it: by counting, and against a search by all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.stats import chi2

import fitting as ff
from fitting.fit.few_places import of_few_places
from fitting.fit.likelihood import Likelihood, LikelihoodEvaluator, likelihood_of
from fitting.fit.objective import make_objective
from fitting.fit.search import minima
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import Evaluation
from fitting.text.arrays import FloatArray
from tests.support.virtual.crossing import ChainResponse, CrossingLaboratory, laboratory


@dataclass(frozen=True)
class Counted(ChainResponse):
    """The closed form, which notes how many spectra it was asked for at each parameter vector."""

    asked_for: list[int] = field(default_factory=list)

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        [measured] = self.asked or self.record.measurements
        self.asked_for.extend([len(measured.places)] * len(ps))
        return super().evaluate_many(ps, whole=whole)


@pytest.fixture(scope="module")
def lab() -> CrossingLaboratory:
    return laboratory(2, spectra=12, points=31, noise=0.02)


@pytest.fixture(scope="module")
def fmu(swift_models: None) -> Iterator[ff.Fmu]:
    """Whose variables are read alone."""
    with ff.Fmu("CoupledModes2", workers=1) as held:
        yield held


def likelihood(fmu: ff.Fmu, lab: CrossingLaboratory) -> tuple[Likelihood, list[int]]:
    """Of a laboratory, and what was asked."""
    problem = lab.through(fmu).record
    response = Counted(problem, lab.modes)
    objective = make_objective(response, problem.parameters, Dataset(problem.measurements))
    sigma = objective.data.sigma
    return likelihood_of(objective, sigma, np.zeros((sigma.size, 0))), response.asked_for


def test_they_are_the_outermost_ones_and_others_between_however_they_are_ordered(
    lab: CrossingLaboratory,
) -> None:
    whole = lab.measurement
    found = whole.few_places()
    assert found is not None
    few, rows = found
    volts = [float(s.settings["V"]) for s in few.spectra]
    assert {min(lab.volts), max(lab.volts)} < set(volts)
    assert np.max(np.diff(sorted(volts))) < 2.0 * np.ptp(lab.volts) / (len(volts) - 1)
    assert np.array_equal(few.measured, whole.measured[rows])
    other = replace(whole, spectra=whole.spectra[::-1]).few_places()
    assert other is not None
    assert {label for label, _ in other[0].places} == {label for label, _ in few.places}


def test_a_map_of_few_spectra_is_not_divided() -> None:
    assert laboratory(2, spectra=6, points=31).measurement.few_places() is None


def test_their_chi_square_is_that_of_their_rows(fmu: ff.Fmu, lab: CrossingLaboratory) -> None:
    whole, _ = likelihood(fmu, lab)
    few = of_few_places(whole)
    assert few is not None
    x = 0.3 * (whole.lower + whole.upper)
    rows = LikelihoodEvaluator(whole).one(x).rows
    seen = LikelihoodEvaluator(few.likelihood).one(x).rows
    assert np.allclose(seen, rows[few.kept], rtol=1e-9, atol=1e-9)
    assert seen.size < 0.6 * rows.size


def test_parameters_of_single_places_leave_a_map_whole(
    fmu: ff.Fmu, lab: CrossingLaboratory
) -> None:
    whole, _ = likelihood(fmu, lab)
    label = lab.measurement.places[0][0]
    first, *others = whole.objective.parameters
    own = (replace(first, experiment=label), *others)
    divided = replace(whole, objective=replace(whole.objective, parameters=own))
    assert of_few_places(divided) is None


def test_a_search_ends_at_the_minimum_of_all_spectra_and_asks_for_few(
    fmu: ff.Fmu, lab: CrossingLaboratory, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, asked = likelihood(fmu, lab)
    begin = np.zeros(whole.lower.size)
    asked.clear()
    found = minima.search_box(LikelihoodEvaluator(whole), [begin], 1, 600)
    assert found.explained
    assert sum(asked) < 0.75 * len(lab.volts) * len(asked)
    monkeypatch.setattr(minima, "of_few_places", lambda likelihood: None)
    by_all = minima.search_box(LikelihoodEvaluator(whole), [begin], 1, 600)
    assert found.minima[0].chi_square == pytest.approx(by_all.minima[0].chi_square, abs=0.01)


def test_where_noise_explains_the_few_and_not_all_the_whole_is_searched(
    fmu: ff.Fmu, lab: CrossingLaboratory, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = lab.measurement.few_places()
    assert found is not None
    inside = {label for label, _ in found[0].places}
    other = next(k for k, (label, _) in enumerate(lab.measurement.places) if label not in inside)
    amplitude = lab.amplitude.copy()
    amplitude[other] = amplitude[other][::-1]  # a spectrum that no parameters describe
    whole, asked = likelihood(fmu, replace(lab, amplitude=amplitude))
    for name, least in (("EVOLUTIONS", 0), ("FINER_SCANS", 1), ("SCREENS", 1)):
        monkeypatch.setattr(minima, name, least)
    asked.clear()
    search = minima.search_box(LikelihoodEvaluator(whole), [np.zeros(whole.lower.size)], 1, 600)
    assert not search.explained
    assert asked.count(len(lab.volts)) > minima.SCREENED


@pytest.mark.parametrize(
    ("probability", "thoroughly"),
    [(0.5, False), pytest.param(0.01, True, marks=pytest.mark.nightly)],
)
def test_what_noise_rarely_explains_is_searched_thoroughly_by_the_few(
    fmu: ff.Fmu,
    lab: CrossingLaboratory,
    monkeypatch: pytest.MonkeyPatch,
    probability: float,
    thoroughly: bool,
) -> None:
    """The noise is stated so that chance leaves as much in so many cases."""
    monkeypatch.setattr(minima, "EVOLUTIONS", 0)
    monkeypatch.setattr(minima, "FINER_SCANS", 1)
    whole, asked = likelihood(fmu, lab)
    begin, sigma = np.zeros(whole.lower.size), whole.objective.data.sigma
    least = minima.search_box(LikelihoodEvaluator(whole), [begin], 1, 600).minima[0].chi_square
    wanted = chi2.isf(probability, whole.data_rows - begin.size)
    sized = likelihood_of(
        whole.objective, sigma * np.sqrt(least / wanted), np.zeros((sigma.size, 0))
    )
    asked.clear()
    search = minima.search_box(LikelihoodEvaluator(sized), [begin], 1, 600)
    assert search.explained is not thoroughly
    assert search.minima[0].chi_square == pytest.approx(wanted, rel=1e-3)
    by_all = asked.count(len(lab.volts))
    assert (len(asked) - by_all > 4000) is thoroughly
    assert by_all < 4000


def test_a_response_that_answers_for_all_alone_is_left_whole(
    fmu: ff.Fmu, lab: CrossingLaboratory
) -> None:
    whole, _ = likelihood(fmu, lab)

    class Whole:
        def evaluate_many(
            self, ps: Sequence[FloatArray], *, whole: bool = False
        ) -> list[Evaluation]:
            raise AssertionError

        def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
            raise AssertionError

    alone = replace(whole, objective=replace(whole.objective, response=Whole()))
    assert of_few_places(alone) is None
