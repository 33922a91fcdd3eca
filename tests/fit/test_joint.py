"""Several campaigns fitted together, whether they agree, and values from elsewhere.

Truth: the closed forms of `tests.closed_form` and the virtual laboratory; the statistics of the
test of agreement are held to those of a chi square.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.campaign.joint import series_names
from fitting.fit.alternative import search_alternative
from fitting.fit.fit import solution_of
from fitting.fit.objective import Evaluator, Objective, evaluate_many
from fitting.fit.options import Schedule, options_of
from fitting.fit.problem import Problem, problem_of
from fitting.fmu.description import read_description
from fitting.fmu.pool import FmuWorkers
from fitting.inference.agreement import consistency
from fitting.inference.estimates import outputs_of
from fitting.inference.likelihood.knowledge import JointResult
from fitting.lab.bench import measure
from fitting.lab.benches import string_bench
from fitting.lab.instruments import LockIns
from fitting.lab.laboratories import changed
from fitting.lab.writer import campaign_files
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.measurement import Evaluation
from fitting.measurements.sweep import Sweep
from fitting.result.external import check_external, with_external
from fitting.result.result import Result, read_result, write_result
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Kind
from tests.support import closed_form
from tests.support.closed_form import (
    ClosedFormResponse,
    measured_by,
    measured_peaks,
    string_campaign,
    string_parameters,
    string_response,
)
from tests.support.datasets import drafted, linear
from tests.support.reconstruction import ReconstructionOptions, reconstruct_through
from tests.support.small_campaign import of_pairs

pytestmark = pytest.mark.usefixtures("swift_models")

DATA = Path(__file__).parents[2] / "data"
TRUTH = (1.9498, 120.0, 90.0)
Campaigns = tuple[BoundCampaign, BoundCampaign]


@pytest.fixture(scope="module")
def shipped(swift_fmu: Path) -> Campaigns:
    variables = read_description(swift_fmu).variables
    one, two = (
        linear(bind(read_campaign(DATA / name / "campaign.toml"), variables))
        for name in ("string_q1", "string_q2")
    )
    return one, two


def acting(problem: Problem, series: str) -> dict[str | None, list[int]]:
    """Positions of the parameters that act in a series: in its sweep (None), in an experiment."""
    bound = problem.campaigns[series]
    model = DrivenModel(setup=bound.setup, parameters=problem.parameters, plan=drafted(bound))
    labels = {e.label.removeprefix(f"{series}/"): e.label for e in bound.experiments}
    return {None: model.columns(None), **{k: model.columns(v) for k, v in labels.items()}}


def test_campaigns_share_by_name_and_keep_what_is_theirs(shipped: Campaigns) -> None:
    offset = replace(
        shipped[0].parameters[1],
        name="offset[pair2]",
        experiment="pair2",
        prior=3.0,
        adds_to=("eta_plus",),
    )
    one = replace(shipped[0], parameters=(*shipped[0].parameters, offset))
    joint = problem_of([one, shipped[1]])
    assert [p.name for p in joint.parameters] == [
        "theta",
        "d1",
        "d2",
        "offset[string_q1/pair2]",
    ]
    shared = {key: [0, 1, 2] for key in (None, *(f"pair{m}" for m in range(1, 6)))}
    assert acting(joint, "string_q1") == shared | {"pair2": [0, 1, 2, 3]}
    assert acting(joint, "string_q2") == shared
    assert joint.parameters[3].experiments == ("string_q1/pair2",)
    assert [e.label for e in joint.experiments][:6:5] == ["string_q1/pair1", "string_q2/pair1"]
    assert {e.output for e in joint.experiments} == {"q1_hybrid", "q2_hybrid"}
    assert measured_peaks(joint.data).size == 20
    assert joint.data.series == ("string_q1", "string_q2")
    # the damping of either is that of its own sweep: the first one's is taken, and told
    [note] = [note for note in joint.notes if note.subject == "d1"]
    assert note.kind is Kind.starts_differ
    assert (note.numbers["start_one"], note.numbers["start_other"]) == (94.18, 100.0)


@pytest.mark.parametrize("field", ["upper", "unit", "period", "alternatives", "twice"])
def test_contradictions_name_both_files(shipped: Campaigns, field: str) -> None:
    one, two = shipped
    theta = two.parameters[0]
    changed = {
        "upper": replace(theta, upper=7.0),
        "unit": replace(theta, unit="deg"),
        "period": replace(theta, period=None),
    }
    if field == "alternatives":
        two = replace(two, alternatives=({},))
    elif field == "twice":
        two = one
    else:
        two = replace(two, parameters=(changed[field], *two.parameters[1:]))
    with pytest.raises(BadInput) as caught:
        problem_of([one, two])
    assert str(two.path) in str(caught.value)
    assert field in ("twice",) or str(one.path) in str(caught.value)
    assert "\n" not in str(caught.value)


def series(
    folder: Path, name: str, mode: int, seed: int, truth: tuple[float, float, float]
) -> tuple[BoundCampaign, ClosedFormResponse]:
    """A campaign of the closed form in a folder of its own, 1 % of noise."""
    (folder / name).mkdir(parents=True, exist_ok=True)
    response = string_response(mode=mode, drift_hz=60.0)
    if mode == 1:  # around the other mode
        shift = 7.02760e6 - 6.94026e6
        response = replace(
            response,
            pairs_hz=tuple((a + shift, b + shift) for a, b in response.pairs_hz),
            sweep_hz=response.sweep_hz + shift,
        )
    measured = measured_by(response, truth, noise=0.01, seed=seed)
    bound = string_campaign(measured, response, folder / name)
    return bound, response


@dataclass(frozen=True)
class SideBySide:
    """Responses of single series as that of all: first everybody's peaks, then the sweeps."""

    members: tuple[ClosedFormResponse, ...]

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        answers = [member.evaluate_many(ps, whole=whole) for member in self.members]
        return [
            Evaluation(tuple(part.predictions[k] for k in range(2) for part in parts))
            for parts in zip(*answers, strict=True)
        ]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        answers = [member.derived_many(ps) for member in self.members]
        return [
            {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
            for parts in zip(*answers, strict=True)
        ]


def joined(
    folder: Path, modes: tuple[int, int], seed: int, other: tuple[float, float, float] = TRUTH
) -> tuple[list[BoundCampaign], Problem, Objective]:
    """Two campaigns, the problem of both, and its objective with maxima that are known."""
    one, first = series(folder, "one", modes[0], 2 * seed, TRUTH)
    two, second = series(folder, "two", modes[1], 2 * seed + 1, other)
    joint = problem_of([one, two])
    exact = tuple(
        replace(m, maximum_sigma=1e-9) if isinstance(m, Sweep) else m for m in joint.measurements
    )
    data = replace(joint.data, measurements=exact)
    response = SideBySide((first, second))
    return (
        [one, two],
        joint,
        Objective(
            response=response, parameters=string_parameters(), data=data, steps=np.full(3, 1e-3)
        ),
    )


def test_joint_rows_are_those_of_each_campaign(tmp_path: Path) -> None:
    bounds, joint, objective = joined(tmp_path, (0, 1), 3)
    assert isinstance(objective.response, SideBySide)
    assert joint.parameters == string_parameters()
    x = np.array([0.1, 0.2, -0.1])
    [both] = evaluate_many(objective, [x])
    for k, (bound, response) in enumerate(zip(bounds, objective.response.members, strict=True)):
        data = problem_of([bound]).data
        [point] = evaluate_many(
            Objective(
                response=response, parameters=string_parameters(), data=data, steps=objective.steps
            ),
            [x],
        )
        mine = objective.data.series_of_rows == k
        assert np.count_nonzero(mine) == 10
        assert both.residuals[mine] == pytest.approx(point.residuals, rel=1e-12)
        assert both.chis[k] == pytest.approx(point.chi)
        assert objective.data.sigma[mine] == pytest.approx(data.sigma, rel=1e-12)
    assert both.chis[0] != pytest.approx(both.chis[1])


def test_fitted_sweeps_and_scales_of_a_joint_fit_stay_with_their_series(tmp_path: Path) -> None:
    """Peaks of all stand before the sweeps, and each series has the scale that it has alone."""
    made = [series(tmp_path, name, mode, 7, TRUTH) for mode, name in enumerate(("one", "two"))]
    kinds = ("fit", "robust")
    bounds = [
        replace(bound, sweep=replace(bound.sweep, use="fit", scale=kind))
        for (bound, _), kind in zip(made, kinds, strict=True)
        if bound.sweep is not None
    ]
    members = tuple(replace(response, with_sweep=True) for _, response in made)
    joint = problem_of(bounds)
    steps, x = np.full(3, 1e-3), np.array([0.1, 0.2, -0.1])
    whole = Objective(
        response=SideBySide(members), parameters=joint.parameters, data=joint.data, steps=steps
    )
    [both] = evaluate_many(whole, [x])
    assert joint.data.series_of_rows.tolist() == [0] * 10 + [1] * 10 + [0] * 41 + [1] * 41
    for k, (bound, response) in enumerate(zip(bounds, members, strict=True)):
        data = problem_of([bound]).data
        [alone] = evaluate_many(
            Objective(response=response, parameters=bound.parameters, data=data, steps=steps), [x]
        )
        mine = joint.data.series_of_rows == k
        assert both.residuals[mine] == pytest.approx(alone.residuals, rel=1e-12)
        assert joint.data.measured_rows[mine] == pytest.approx(data.measured_rows, rel=1e-12)
        assert both.chis[k] == pytest.approx(alone.chi, rel=1e-12)
        assert joint.data.scale_sigmas[k] == pytest.approx(data.scale_sigmas[0], rel=1e-12)
    assert both.chis[0] != pytest.approx(both.chis[1])


def test_series_keep_the_order_of_their_campaigns(shipped: Campaigns) -> None:
    """Peaks stand before sweeps in the rows, also those of a later campaign."""
    first, second = shipped
    assert first.sweep is not None
    swept = replace(first, experiments=(), sweep=replace(first.sweep, use="fit"))
    data = problem_of([swept, second]).data
    assert data.series == ("string_q1", "string_q2")
    assert [m.series for m in data.measurements] == ["string_q2", "string_q1", "string_q2"]
    assert set(data.series_of_rows[data.curve_rows]) == {0}


def agreement(
    folder: Path, modes: tuple[int, int], seed: int, other: tuple[float, float, float] = TRUTH
) -> JointResult:
    _, joint, objective = joined(folder, modes, seed, other)
    evaluator = Evaluator(objective)
    outcome = search_alternative(objective, Schedule(starts=1))
    solution = solution_of(evaluator, outcome.x, 1e-3)
    return consistency(joint, solution, outputs_of(solution))


@pytest.mark.parametrize("pairs", [6, pytest.param(12, marks=pytest.mark.nightly)])
def test_series_of_one_sample_differ_as_chi_square_does(pairs: int, tmp_path: Path) -> None:
    """Both see the width of mode 1 and nothing else: one number, chi square 1 on average."""
    found = [agreement(tmp_path, (0, 0), seed) for seed in range(pairs)]
    for result in found:
        assert [part.determined for part in result.series] == [1, 1]
        [tension] = result.tensions
        assert tension.freedom == 1
    values = np.array([result.tensions[0].chi_square for result in found])
    # the errors are widened by up to 1.2 where a short series scatters more than its noise
    assert 0.3 < np.mean(values) < 2.2
    assert np.mean(values > 3.84) <= 0.2


def test_samples_of_other_width_contradict_each_other(tmp_path: Path) -> None:
    """A width 8 % larger, each known to about 0.7 %: some eight standard deviations."""
    scaled = (TRUTH[0], 1.08 * TRUTH[1], 1.08 * TRUTH[2])
    result = agreement(tmp_path, (0, 0), 4, scaled)
    [tension] = result.tensions
    alone = [part.alone["D11"] for part in result.series]
    apart = (alone[0].value - alone[1].value) / math.hypot(alone[0].std, alone[1].std)
    assert tension.sigmas == pytest.approx(abs(apart), rel=0.1)
    assert tension.sigmas > 5.0


def test_what_noise_does_now_and_then_is_no_contradiction(tmp_path: Path) -> None:
    """A width 3.5 % larger: between three and four standard deviations, and how often that is."""
    scaled = (TRUTH[0], 1.035 * TRUTH[1], 1.035 * TRUTH[2])
    [tension] = agreement(tmp_path, (0, 0), 4, scaled).tensions
    assert 3.0 < tension.sigmas < 4.0
    # both tails of a normal distribution
    assert 1.0 / tension.p_value == pytest.approx(
        1.0 / math.erfc(tension.sigmas / math.sqrt(2.0)), rel=0.1
    )


def test_series_that_see_different_things_cannot_contradict(tmp_path: Path) -> None:
    other = (TRUTH[0], 1.5 * TRUTH[1], 0.7 * TRUTH[2])
    [tension] = agreement(tmp_path, (0, 1), 5, other).tensions
    assert tension.freedom == 0
    assert math.isnan(tension.sigmas)


# --- through the FMU ------------------------------------------------------------------------------


def quickly(workers: FmuWorkers, bounds: Sequence[BoundCampaign], levels: int = 2) -> Result:
    """One alternative, one start."""
    problem = problem_of(bounds)
    problem = replace(problem, alternatives=problem.alternatives[:1])
    options = options_of(bounds[0].continuation)
    options = replace(
        options,
        schedule=replace(options.schedule, starts=1, iterations=levels, nu_start=1e-2, beta=1e-3),
        misfit="squares",
    )
    asked = ReconstructionOptions(options, profiles=False)
    return reconstruct_through(workers, problem, asked)


def of_two_pairs(folder: Path) -> list[Path]:
    """The shipped campaigns with two of their five pairs, so with two offsets: their files."""
    paths = []
    for name in ("string_q1", "string_q2"):
        shutil.copytree(DATA / name, folder / name)
        paths.append(folder / name / "campaign.toml")
        of_pairs(paths[-1], 1, 5)
    return paths


@pytest.mark.nightly
def test_the_shipped_series_together_hold_the_widths_alone(swift_fmu: Path, tmp_path: Path) -> None:
    with FmuWorkers(swift_fmu, workers=2) as workers:
        variables = workers.description.variables
        bounds = [bind(read_campaign(path), variables) for path in of_two_pairs(tmp_path)]
        result = quickly(workers, bounds, levels=1)
    assert result.parameters["theta"].status == "not known"
    assert result.derived["lambda"].status == "not known"
    for name in ("width_plus", "width_minus"):
        assert result.derived[name].status == "linearised only"
    assert abs(result.derived["width_plus"].value - 94.107) < 3 * result.derived["width_plus"].std
    assert result.joint is not None
    alone = [part.alone for part in result.joint.series]
    assert math.isfinite(alone[0]["width_plus"].std)
    assert math.isnan(alone[0]["width_minus"].std)
    assert math.isfinite(alone[1]["width_minus"].std)
    assert math.isnan(alone[1]["theta"].std)
    told = with_external(result, ["lambda=0.8604 MHz", "width_plus=0.1 kHz +- 2 Hz"])
    assert math.isnan(told.external[0].sigmas)
    assert told.external[0].name == "lambda"
    width = result.derived["width_plus"]
    assert told.external[1].sigmas == pytest.approx(
        (width.value - 100.0) / math.hypot(width.std, 2.0), rel=1e-3
    )
    write_result(told, tmp_path / "out")
    assert repr(read_result(tmp_path / "out" / "result.json")) == repr(told)


def test_both_modes_at_both_resonances_hold_the_coupling(swift_fmu: Path, tmp_path: Path) -> None:
    """|q2| while driving at eta_plus gives D12, the series around eta_minus D22: theta follows."""
    variables = read_description(swift_fmu).variables
    bounds = []
    for name in ("q1", "q2"):
        bench = string_bench(name)
        bench = changed(bench, theta_rad=1.9498, curvature_hz=20.0)
        bench = replace(bench, instrument=LockIns())
        for file, text in campaign_files(measure(bench, 21), "test").items():
            path = tmp_path / name / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        bound = bind(read_campaign(tmp_path / name / "campaign.toml"), variables)
        theta = replace(bound.parameters[0], lower=1.6, upper=2.3, start=1.8, period=None)
        bounds.append(replace(bound, parameters=(theta, *bound.parameters[1:])))
    with FmuWorkers(swift_fmu, workers=2) as workers:
        result = quickly(workers, bounds, levels=1)
    coupling = result.derived["lambda"]
    assert coupling.status == "linearised only"
    # closed form of the paper at the true angle and the mean eigenfrequencies
    truth = math.sqrt(-0.5 * math.sin(2 * 1.9498) * (7027600.0**2 - 6940260.0**2))
    assert coupling.ci95[0] < truth < coupling.ci95[1]
    assert coupling.std < 0.05 * truth
    assert len(result.offsets) == 10
    assert result.joint is not None
    assert abs(result.joint.tensions[0].sigmas) < 3.0


def test_cross_peaks_are_those_of_the_other_mode(swift_fmu: Path, tmp_path: Path) -> None:
    made = measure(replace(string_bench("q1"), noise_scale=0.0, instrument=LockIns()), 1)
    for file, text in campaign_files(made, "test").items():
        (tmp_path / file).write_text(text)
    variables = read_description(swift_fmu).variables
    bound = bind(read_campaign(tmp_path / "campaign.toml"), variables)
    assert series_names([bound]) == (tmp_path.name,)
    d = closed_form.damping(*TRUTH, False)
    for k, e in enumerate(bound.experiments):
        state = made.true_modes[k // 2]
        eta = (state.eta_plus_hz, state.eta_minus_hz)
        expected = made.gain * closed_form.amplitude(e.tones_hz, eta, d, k % 2)
        assert e.peaks_v == pytest.approx(expected, rel=1e-9)
        assert e.sigmas_v == pytest.approx(0.01 * expected, rel=1e-9)
        assert e.output == ("q1_hybrid", "q2_hybrid")[k % 2]
    # the two records of a pair are one state of the sample
    assert bound.parameters[3].experiments == ("pair1", "pair1_cross")


@pytest.mark.parametrize("text", ["lambda", "lambda=", "=3", "lambda=fast", "lambda=3 parsecs^"])
def test_values_from_elsewhere_that_cannot_be_read_are_refused(text: str) -> None:
    with pytest.raises(BadInput, match="--external"):
        check_external([text])


def test_a_name_that_nobody_will_report_is_refused_before_the_fit() -> None:
    known = {"theta": "rad", "lambda": "Hz"}
    check_external(["lambda=1 MHz +- 2 kHz", "theta=110 deg"], known)
    with pytest.raises(BadInput, match=r"'lamda'.*lambda\b"):
        check_external(["lamda=1 MHz"], known)
    with pytest.raises(BadInput, match=r"lambda: .*Hz"):
        check_external(["lambda=3 kg"], known)
    with pytest.raises(BadInput, match=r"lambda: .*Hz"):
        check_external(["lambda=3 MHz +- 1 s"], known)
