"""Directions, idle parameters, equal fits and verdicts, on closed forms and shipped campaigns."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign.parameters import Parameter, to_search
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective, evaluate_many, make_objective
from fitting.inference.determine import InferenceOptions, determine
from fitting.inference.likelihood.knowledge import Determined
from fitting.measurements.measurement import Evaluation
from fitting.report.screen import phrase
from fitting.result.result import Result, read_result, write_result
from fitting.text.arrays import FloatArray
from fitting.text.estimate import Verdict
from fitting.text.records import to_plain
from tests.support import closed_form
from tests.support.datasets import answer, dataset
from tests.support.shipped_runs import ShippedRun
from tests.support.whitened import learnt, parameter, whitened

DATA = Path(__file__).parents[2] / "data"
TRUTH = np.array([1.9498, 120.0, 90.0])


class BothModes(closed_form.ClosedFormResponse):
    """The series of the first mode, the second mode at its own resonance, and the cross response.

    All share one scale: what would determine the coupling, by its singular values.
    """

    def peaks(self, p: FloatArray) -> FloatArray:
        d = self._model(p)
        rows = [super().peaks(p)]
        etas = zip(self.pairs_hz, self.eta_plus_hz, self.eta_minus_hz, strict=True)
        for pair, plus, minus in etas:
            rows.append(closed_form.amplitude(pair, (plus, minus), d, 1))
            rows.append(closed_form.amplitude([minus - 30.0, minus + 20.0], (plus, minus), d, 1))
        return np.concatenate(rows)


def both_modes(reflection: bool = False) -> BothModes:
    old = closed_form.string_response()
    return BothModes(old.pairs_hz, old.eta_plus_hz, old.eta_minus_hz, old.sweep_hz, reflection)


def learn(
    response: closed_form.ClosedFormResponse, seed: int, start: Sequence[float]
) -> tuple[Objective, Determined]:
    measured = closed_form.measured_by(
        both_modes() if isinstance(response, BothModes) else response, noise=0.01, seed=seed
    )
    objective = make_objective(response, closed_form.string_parameters(), measured)
    sigma = measured.sigma
    x = to_search(objective.parameters, np.array(start))
    determined = determine(
        objective,
        x,
        RowNoise(sigma, np.zeros((sigma.size, 1))),
        InferenceOptions(units={"lambda": "Hz"}),
    )
    return objective, determined


@pytest.fixture(scope="module")
def blind() -> tuple[Objective, Determined]:
    """The first series alone."""
    return learn(closed_form.string_response(), 4, (1.96, 94.0, 94.0))


@pytest.fixture(scope="module")
def seeing() -> tuple[Objective, Determined]:
    """With the cross response, from a start in the other half of the circle."""
    return learn(both_modes(), 4, (0.4, 94.0, 94.0))


def test_one_series_sees_one_direction_of_three(blind: tuple[Objective, Determined]) -> None:
    first, second, third = blind[1].knowledge.directions
    assert first.change == {}
    assert first.singular > 1e3 * second.singular > 0.0
    assert second.singular > third.singular
    for unseen in (second, third):
        assert np.linalg.norm(list(unseen.vector.values())) == pytest.approx(1.0)
        assert unseen.largest <= 0.01


def test_the_change_that_is_named_changes_nothing(blind: tuple[Objective, Determined]) -> None:
    """Its own numbers, put into the closed form."""
    objective, determined = blind
    unseen = determined.knowledge.directions[1]
    change, most = [unseen.change[name] for name in ("theta", "d1", "d2")], unseen.largest
    text = phrase("knowledge", "change", unseen, determined.knowledge)
    told = [float(n.replace("−", "-")) for n in re.findall(r"[−\d][\d.]*(?:e-\d+)?", text)]
    for number in change:  # rounded in words, to a digit at least
        half = 0.5 * 10.0 ** math.floor(math.log10(abs(number)))
        assert np.min(np.abs(np.array(told) - number)) <= half
    # what is no more than a number is rounded up
    assert any(most <= number <= most + 10.0 ** math.floor(math.log10(most)) for number in told)
    assert most <= 0.01
    assert max(np.abs(change) / (np.pi, 120.0, 120.0)) > 0.01  # no trifle
    best = np.array([determined.parameters[name].likely for name in ("theta", "d1", "d2")])
    parameters = objective.parameters
    xs = [to_search(parameters, p) for p in (best, best + np.array(change))]
    before, after = evaluate_many(objective, xs)
    sigma = objective.data.sigma
    assert np.max(np.abs(after.residuals - before.residuals) / sigma) <= 1.05 * most


def test_a_prior_that_pulls_hides_no_direction() -> None:
    """The data say that o is 1, its prior that it is 0; along a b = 6 both are as content."""

    def rows(x: FloatArray) -> FloatArray:
        a, b, o = x
        return np.array([(a * b + o - 7.0) / 0.1, (a * b - o - 5.0) / 0.1])

    own = parameter("a", 1.0, 6.0, start=2.0), parameter("b", 1.0, 6.0, start=3.0)
    drift = parameter("o", -4.0, 4.0, start=0.0, prior=0.1)
    known = learnt(whitened(rows, *own, drift))
    [unseen] = [each for each in known.knowledge.directions if each.change]
    assert abs(unseen.change["a"]) > 0.1
    best = np.array([known.parameters[name].likely for name in ("a", "b", "o")])
    moved = best + [unseen.change.get(name, 0.0) for name in ("a", "b", "o")]
    assert np.max(np.abs(rows(moved) - rows(best))) <= 1.05 * unseen.largest <= 0.0105


def test_values_of_single_experiments_are_told_together() -> None:
    """A level, and an offset of each experiment that no row can tell from it."""
    level = parameter("level", 1.0, 9.0, start=5.0)
    single = [parameter(f"o{k}", -1.0, 1.0, unit="Hz", experiment=f"e{k}") for k in range(4)]

    def rows(x: FloatArray) -> FloatArray:
        return np.asarray((x[0] + x[1:] - 5.0) / 0.1)

    known = learnt(whitened(rows, level, *single))
    [unseen] = [each for each in known.knowledge.directions if each.change]
    by = unseen.change["level"]
    assert abs(by) > 0.01
    assert [unseen.change[each.name] for each in single] == pytest.approx([-by] * 4, abs=1e-3)
    sign = "+" if by < 0.0 else "−"
    about = f"with 4 values of single experiments by about {sign}{abs(by):.3g} Hz each"
    assert about in phrase("knowledge", "change", unseen, known.knowledge)


def test_with_the_cross_response_everything_is_determined(
    seeing: tuple[Objective, Determined],
) -> None:
    determined = seeing[1]
    assert {p.status for p in determined.profiled.values()} == {"determined"}
    assert all(direction.change == {} for direction in determined.knowledge.directions)
    truth = seeing[0].response.derived_many([TRUTH])[0]["lambda"][0]
    low, high = determined.derived["lambda"].ci95
    assert low < truth < high
    assert high - low < 0.15 * truth
    for name, value in zip(("theta", "d1", "d2"), TRUTH, strict=True):
        low, high = determined.parameters[name].ci95
        assert low < value < high, name


def test_the_same_matrix_a_quarter_turn_on_is_found(seeing: tuple[Objective, Determined]) -> None:
    """T(theta + pi/2) diag(d2, d1) T^T is the same matrix, but lambda^2 changes sign there."""
    determined = seeing[1]
    [twin] = [e for e in determined.knowledge.equivalents if e.origin == "start"]
    best = {name: determined.parameters[name].likely for name in ("theta", "d1", "d2")}
    assert twin.parameters["theta"] == pytest.approx(best["theta"] - np.pi / 2, abs=2e-3)
    assert twin.parameters["d1"] == pytest.approx(best["d2"], rel=1e-3)
    assert twin.parameters["d2"] == pytest.approx(best["d1"], rel=1e-3)
    assert np.isnan(twin.derived["lambda"])
    # so the reported point is the one at which the coupling exists, wherever the search began
    assert np.isfinite(determined.derived["lambda"].likely)


def test_a_parameter_without_effect_is_named() -> None:
    """At theta = 0, held there, the first mode does not feel d2."""
    response = closed_form.held(closed_form.string_response(), theta=0.0)

    class WithoutOutputs(closed_form.ClosedFormResponse):
        def _derived(self, p: FloatArray) -> dict[str, FloatArray]:
            return {}

    response = WithoutOutputs(**vars(response))
    measured = closed_form.measured_by(
        closed_form.string_response(), (0.0, 120.0, 90.0), noise=0.01, seed=1
    )
    objective = make_objective(response, closed_form.string_parameters()[1:], measured)
    sigma = measured.sigma
    determined = determine(objective, np.zeros(2), RowNoise(sigma, np.zeros((sigma.size, 1))))
    assert determined.knowledge.without_effect == ("d2",)
    assert determined.parameters["d1"].status == "determined"
    assert determined.parameters["d2"].status == "unconstrained"
    said = phrase("knowledge", "idle", "d2", determined.knowledge)
    assert said.startswith("d2 ")
    assert f"d1 = {determined.parameters['d1'].likely:.4g} Hz" in said


def test_two_minima_that_fit_alike_are_not_called_determined() -> None:
    """z = k^2 in a box around zero: k and -k."""

    class Square:
        def evaluate_many(
            self, ps: Sequence[FloatArray], *, whole: bool = False
        ) -> list[Evaluation]:
            return [answer(np.full(6, float(p[0]) ** 2)) for p in ps]

        def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
            return [{"k": np.array([p[0]]), "square": np.array([p[0] ** 2])} for p in ps]

    parameter = Parameter(
        name="k", unit="", lower=-3.0, upper=3.0, start=1.0, reference=0.0, scale=1.0
    )
    measured = dataset(np.full(6, 2.25), np.full(6, 0.02))
    objective = make_objective(Square(), (parameter,), measured)
    determined = determine(objective, np.array([1.4]), RowNoise(np.full(6, 0.01), np.zeros((6, 1))))
    k = determined.parameters["k"]
    assert k.likely == pytest.approx(1.5, abs=1e-3)
    assert k.ci95[0] < -1.49 < 1.49 < k.ci95[1]
    assert k.status is Verdict.SEVERAL
    assert "another minimum" in k.reason
    assert determined.derived["square"].status == "determined"
    [twin] = determined.knowledge.equivalents
    assert twin.parameters["k"] == pytest.approx(-1.5, abs=1e-3)


@pytest.fixture(scope="module", params=["q1", pytest.param("q2", marks=pytest.mark.nightly)])
def shipped(request: pytest.FixtureRequest) -> tuple[str, Result]:
    """The shipped campaigns through the FMU, by the command."""
    run: ShippedRun = request.getfixturevalue(f"string_{request.param}_run")
    return request.param, run.result


def test_shipped_data_determine_the_width_and_neither_angle_nor_coupling(
    shipped: tuple[str, Result],
) -> None:
    series, result = shipped
    seen, other = ("plus", "minus") if series == "q1" else ("minus", "plus")
    assert result.parameters["theta"].status == "unconstrained"
    assert result.derived["lambda"].status == "unconstrained"
    assert result.derived[f"width_{seen}"].status == "determined"
    assert result.derived[f"Q_{seen}"].status == "determined"
    assert result.derived[f"width_{other}"].status == "unconstrained"
    coupling = result.derived["lambda"]
    # eta- and eta+ of the campaigns, in the closed form of the largest coupling
    largest = np.sqrt(0.5 * (7.02760e6**2 - 6.94026e6**2))
    assert coupling.ci95[0] < 1.0
    assert coupling.ci95[1] == pytest.approx(largest, rel=1e-4)
    assert np.isnan(coupling.std)
    low, high = result.derived[f"width_{seen}"].ci95
    angle, widths = (1.9498, 2.0406)[series == "q2"], (120.0, 90.0)
    matrix = closed_form.damping(angle, *widths, reflection=False)
    assert low < matrix[(0, 1)[series == "q2"], (0, 1)[series == "q2"]] < high


def test_knowledge_comes_back_whole_from_the_file(
    shipped: tuple[str, Result], tmp_path: Path
) -> None:
    result = shipped[1]
    assert result.knowledge is not None
    write_result(result, tmp_path)
    again = read_result(tmp_path / "result.json")
    assert to_plain(again.knowledge) == to_plain(result.knowledge)
    assert set(result.profiled) == {*result.parameters, *result.derived}
