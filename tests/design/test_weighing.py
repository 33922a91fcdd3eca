"""What to measure next, through the FMU: information, points of equal fit, and the choice."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm, t

from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.campaign.file import WrittenDesign
from fitting.campaign.parameters import Parameter, to_model, to_search
from fitting.design.api import proposed
from fitting.design.campaign import campaign_files
from fitting.design.candidates import ToneCandidates
from fitting.design.information import DataSoFar, Place, prior_sigmas_in_box
from fitting.design.limits import DesignTable, Limits, limits_of
from fitting.design.result import Design, DriveChoice
from fitting.design.weighing import Goal, Weighed, choose, known_of, losses, weigh
from fitting.fit.objective import make_objective
from fitting.fit.problem import plan_problem, problem_of
from fitting.fmu.pool import FmuWorkers
from fitting.lines.form import fit_resonance
from fitting.text.errors import BadInput
from fitting.text.results_folder import write_all
from fitting.text.schema import read_record
from tests.support import closed_form
from tests.support.datasets import linear
from tests.support.design_laboratories import Laboratory, so_far
from tests.support.exhaustive import exhaustive
from tests.support.string_benches import read_bench

Q1 = Path(__file__).parents[2] / "data" / "string_q1" / "campaign.toml"
TRUTH = np.array([1.9498, 120.0, 90.0])
ETA = (6940309.917628119, 7027650.274917843)


@pytest.fixture(scope="module")
def workers(swift_fmu: Path) -> Iterator[FmuWorkers]:
    with FmuWorkers(swift_fmu, workers=2) as made:
        yield made


@pytest.fixture(scope="module")
def bound(workers: FmuWorkers) -> BoundCampaign:
    return linear(bind(read_campaign(Q1), workers.description.variables))


def design_table(path: Path, table: dict[str, object]) -> DesignTable:
    return DesignTable(path, read_record(WrittenDesign, table, path, "design"))


def limits_from(bound: BoundCampaign, workers: FmuWorkers, **table: object) -> Limits:
    read = design_table(Path("x.toml"), table)
    return limits_of(bound, workers.description.variables, read)


@pytest.fixture(scope="module")
def limits(bound: BoundCampaign, workers: FmuWorkers) -> Limits:
    """The campaign's own limits on a coarser grid of drive frequencies."""
    return limits_from(bound, workers, frequency_step="20 Hz", repeats=[1, 100], levels=[1, 100])


@pytest.fixture(scope="module")
def weighed(bound: BoundCampaign, workers: FmuWorkers, limits: Limits) -> Weighed:
    start = Place(bound.alternatives[0], to_search(bound.parameters, TRUTH))
    return weighing([bound], workers, limits, Goal("lambda", "target"), start)


def weighing(
    bounds: Sequence[BoundCampaign],
    workers: FmuWorkers,
    limits: Limits,
    goal: Goal,
    start: Place | None = None,
) -> Weighed:
    """The candidates within limits, beside campaigns that have been measured."""
    problem = problem_of(bounds)
    planned = plan_problem(problem, workers)
    response = planned.response(problem.alternatives[0])
    steps = make_objective(response, problem.parameters, problem.data).steps
    return weigh(known_of(DataSoFar(problem, planned, steps), goal, start), limits)


def propose(weighed: Weighed) -> Design:
    """What is chosen of weighed candidates."""
    return proposed(weighed.choosing(), "Hz", {"command": "a test"})


def test_limits_are_those_the_campaign_kept_to(bound: BoundCampaign, workers: FmuWorkers) -> None:
    """Grid, spacing and detuning of the paper's pairs; resonances where they were last."""
    found = limits_from(bound, workers)
    assert found.outputs == ("q1_hybrid", "q2_hybrid")
    assert found.centres_hz == pytest.approx(ETA, abs=1e-3)
    grid = (found.frequency_step_hz, found.least_spacing_hz, found.farthest_hz)
    assert grid == (10.0, 20.0, 100.0)
    assert 0.15e-6 < found.noise_floor_v < 0.25e-6  # the bench draws floors of 0.2 to 0.3 uV
    assert found.setting_sigmas == pytest.approx({"eta_plus": 5.0, "eta_minus": 5.0}, rel=0.01)


def test_offsets_that_are_fitted_bring_their_prior(
    bound: BoundCampaign, workers: FmuWorkers
) -> None:
    """What drifts is then off by what the campaign says, not by a share of the drift."""
    offset = Parameter(
        name="offset[pair1]",
        unit="Hz",
        lower=-90.0,
        upper=90.0,
        start=0.0,
        reference=0.0,
        scale=30.0,
        experiment="pair1",
        adds_to=("eta_plus",),
        prior=30.0,
    )
    found = limits_from(replace(bound, parameters=(*bound.parameters, offset)), workers)
    assert found.setting_sigmas == pytest.approx({"eta_plus": 30.0, "eta_minus": 5.0}, rel=0.01)


def test_setups_keep_the_limits(bound: BoundCampaign, limits: Limits) -> None:
    setups = ToneCandidates.choices_of(bound, limits)
    assert len(setups) == 2 * 2 * 2 * 25
    for setup in setups:
        low, high = setup.tones_hz
        assert low < setup.centre_hz < high
        assert high - low >= 20.0
        assert max(setup.centre_hz - low, high - setup.centre_hz) <= 110.0
        assert low % 20.0 == high % 20.0 == 0.0
    with pytest.raises(BadInput, match="drive frequencies"):
        ToneCandidates.choices_of(bound, replace(limits, least_spacing_hz=500.0))
    with pytest.raises(BadInput, match=r"\d+ setups"):
        ToneCandidates.choices_of(bound, replace(limits, levels=tuple(map(float, range(1, 1000)))))


def log_amplitudes(
    setups: Sequence[DriveChoice], p: np.ndarray, shift_hz: float = 0.0
) -> np.ndarray:
    """ln of amplitudes over the maximum of the first mode's sweep, by the closed form."""
    d = closed_form.damping(p[0], p[1], p[2], reflection=False)
    top = max(
        float(closed_form.amplitude(6940209.887967911 + t, (6940209.887967911, 7027550.3), d, 0))
        for t in np.linspace(-0.5, 0.5, 11)
    )
    found = []
    for s in setups:
        mode = ("q1_hybrid", "q2_hybrid").index(s.output)
        eta = (ETA[0] + shift_hz, ETA[1])
        found.append(s.level * closed_form.amplitude(s.tones_hz, eta, d, mode) / top)
    return np.log(np.concatenate(found))


def test_derivatives_of_setups(bound: BoundCampaign, workers: FmuWorkers, limits: Limits) -> None:
    """By parameters and by what drifts, against the closed form at another step."""
    place = Place(bound.alternatives[0], to_search(bound.parameters, TRUTH))
    errors = replace(limits, setting_sigmas={"eta_plus": 5.0})
    made = ToneCandidates(so_far(bound, workers), errors, place)
    setups = made.choices
    [rows] = made.rows(place)
    by_x = (rows.by_x / rows.values[..., None]).reshape(-1, 3)
    by_setting = (rows.errors[..., 0] / rows.values / 5.0).ravel()
    assert made.linear
    for i, h in enumerate((1e-3, 0.03, 0.03)):
        moved = [TRUTH + sign * h * np.eye(3)[i] for sign in (1.0, -1.0)]
        above, below = (log_amplitudes(setups, p) for p in moved)
        scale = bound.parameters[i].scale
        expected = scale * (above - below) / (2.0 * h)
        assert by_x[:, i] == pytest.approx(expected, rel=1e-4, abs=1e-5)
    above, below = (log_amplitudes(setups, TRUTH, t) for t in (1.0, -1.0))
    assert by_setting == pytest.approx((above - below) / 2.0, rel=1e-3, abs=1e-8)


@pytest.mark.nightly
def test_points_of_equal_fit_share_what_the_data_hold(
    bound: BoundCampaign, weighed: Weighed
) -> None:
    """The q1 series knows the line width of its own mode and nothing else."""
    ps = np.array([to_model(bound.parameters, place.x) for place in weighed.known.places])
    widths = [closed_form.damping(p[0], p[1], p[2], reflection=False)[0, 0] for p in ps]
    assert widths == pytest.approx(np.full(len(ps), 94.1), abs=2.0)
    assert np.ptp(ps[:, 0] % math.pi) > 0.8
    assert np.ptp(ps[:, 1]) > 100.0
    assert 0.0 < np.nanmin(weighed.known.spread_values) < 0.4e6
    assert 0.7e6 < np.nanmax(weighed.known.spread_values) < 0.79e6


def test_the_expected_error_falls_tenfold(
    bound: BoundCampaign, weighed: Weighed, limits: Limits
) -> None:
    """And by the measurements that determine lambda by their singular values."""
    design = propose(weighed)
    last = design.proposals[-1].expected
    assert design.before.at / last.at > 8.0  # which the choice, best on average, does not see
    assert design.before.mean / last.mean > 10.0
    kinds = {(p.output, p.centre_hz > 7e6) for p in design.proposals}
    assert ("q2_hybrid", True) in kinds, "the line width of the other mode"
    assert kinds & {("q2_hybrid", False), ("q1_hybrid", True)}, "one mode at the other's resonance"
    falling = [p.expected.mean for p in design.proposals]
    assert falling == sorted(falling, reverse=True)
    more_of_the_same = [k for k in design.kinds if k.output == "q1_hybrid" and k.centre_hz < 7e6]
    assert min(k.best for k in more_of_the_same) > 0.99 * design.before.mean


def test_both_lines_known_the_cross_mode_is_what_is_missing(
    bound: BoundCampaign, workers: FmuWorkers, limits: Limits
) -> None:
    """With the q2 series beside, one mode at the other's resonance settles it."""
    path = Q1.parents[1] / "string_q2" / "campaign.toml"
    other = linear(bind(read_campaign(path), workers.description.variables))
    goal = Goal("lambda", "target")
    start = Place(bound.alternatives[0], to_search(bound.parameters, TRUTH))
    one = replace(bound, alternatives=bound.alternatives[:1])
    weighed = weighing(
        [one, replace(other, alternatives=one.alternatives)], workers, limits, goal, start
    )
    design = propose(weighed)
    first = design.proposals[0]
    assert (first.output, first.centre_hz > 7e6) in (("q2_hybrid", False), ("q1_hybrid", True))
    assert design.before.at / first.expected.at > 5.0
    ps = np.array([to_model(bound.parameters, place.x) for place in weighed.known.places])
    both = [np.diag(closed_form.damping(p[0], p[1], p[2], reflection=False)) for p in ps]
    assert np.array(both)[1:, 0] == pytest.approx(94.1, abs=2.0)
    assert np.ptp(np.array(both)[1:, 1]) < 8.0


@pytest.mark.parametrize("criterion", ["D", "target"])
def test_the_choice_is_near_the_best_of_all(weighed: Weighed, criterion: str) -> None:
    """Nine tenths of it, on a dozen candidates of which three are taken."""
    problem = weighed.problem
    picked = np.linspace(0, problem.candidates - 1, 12).astype(int)
    small = replace(problem, gains=problem.gains[:, picked], costs=problem.costs[picked])
    values = {
        how.__name__: float(losses(small, small.information(how(small, 3, criterion)), criterion))
        for how in (choose, exhaustive)
    }
    assert math.exp(values["exhaustive"] - values["choose"]) >= 0.9


@pytest.mark.parametrize(
    "seeds", [(11, 12), pytest.param(range(11, 17), marks=pytest.mark.nightly)]
)
def test_laboratories_that_follow_the_advice(
    bound: BoundCampaign,
    workers: FmuWorkers,
    weighed: Weighed,
    limits: Limits,
    tmp_path: Path,
    seeds: Sequence[int],
) -> None:
    """Refitted to its own q1 series and the proposed measurements, lambda scatters as expected.

    The benchmark tests/bench/bench_design.py does so for a hundred of them.
    """
    design = propose(weighed)
    write_all(tmp_path / "plan", campaign_files(design, bound, {}, limits, tmp_path / "plan"))
    bench = read_bench(Q1.parent / "truth.toml")
    starts = [np.array([1.6, 250.0, 90.0]), np.array([2.6, 60.0, 200.0])]
    found = []
    for seed in seeds:
        plan = tmp_path / "plan" / "campaign.toml"
        errors = dict(limits.setting_sigmas)
        laboratory = Laboratory(bench, plan, seed, tmp_path, workers, errors)
        found.append(laboratory.refit(starts, "lambda").target)
    gradient = weighed.problem.gradients[0, :3] / prior_sigmas_in_box(bound.parameters)
    expected = laboratory.expected(TRUTH, gradient)
    assert expected == pytest.approx(design.proposals[-1].expected.at, rel=0.3)
    if len(found) > 2:  # two tell no scatter
        assert 1.0 / 1.5 < np.std(found, ddof=1) / expected < 1.5
    true = math.sqrt(-0.5 * math.sin(2 * TRUTH[0]) * (7.0276e6**2 - 6.94026e6**2))
    assert np.mean(found) == pytest.approx(true, abs=3.0 * expected / math.sqrt(len(found)))


def test_a_sweep_alone_asks_for_points_of_a_sweep(workers: FmuWorkers) -> None:
    """Single tones; so far the width is known as well as a Lorentzian fit of the sweep knows it.

    The other mode is not driven there and answers nothing: it is not proposed.
    """
    path = Q1.parents[1] / "afm_sensor" / "campaign.toml"
    variables = workers.description.variables
    bound = bind(read_campaign(path), variables)
    limits = limits_of(bound, variables, design_table(path, {"levels": [1]}))
    assert limits.tones == 1
    assert limits.frequency_step_hz == 2.0
    goal = Goal("width_plus", "target")
    design = propose(weighing([bound], workers, limits, goal))
    assert bound.sweep is not None
    line = fit_resonance(bound.sweep.frequency_hz, bound.sweep.amplitude_v)
    # the line's own is Student's: its noise is told by residuals that are correlated
    gaussian = line.width.std / t.ppf(norm.cdf(1.0), line.dof)
    assert design.before.at == pytest.approx(gaussian / line.structure.widening, rel=0.05)
    assert {p.output for p in design.proposals} == {"q1_hybrid"}
    assert {len(p.tones_hz) for p in design.proposals} == {1}
    assert len(design.places) == 1


def test_nothing_measurable_is_said(
    bound: BoundCampaign, workers: FmuWorkers, limits: Limits
) -> None:
    deaf = replace(limits, noise_floor_v=1.0, outputs=("q1_hybrid",))
    one = replace(bound, alternatives=bound.alternatives[:1])
    with pytest.raises(BadInput, match=r"\d+ setups"):
        weighing([one], workers, deaf, Goal("lambda", "target"))
    with pytest.raises(BadInput, match="target 'nu'"):
        weighing([bound], workers, limits, Goal("nu", "target"))


def test_a_target_without_a_value_is_said(weighed: Weighed, limits: Limits) -> None:
    nowhere = np.full_like(weighed.problem.gradients, np.nan)
    without = replace(weighed, problem=replace(weighed.problem, gradients=nowhere))
    with pytest.raises(BadInput, match="no value"):
        without.choosing()
    known = replace(weighed.known, goal=Goal("lambda", "D"))
    assert len(replace(without, known=known).choosing().chosen) == limits.number


def test_a_prior_over_more_than_a_period_counts_once(bound: BoundCampaign) -> None:
    assert prior_sigmas_in_box(bound.parameters)[0] == pytest.approx(math.pi / math.sqrt(12.0))


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ({"outputs": ["q3_hybrid"]}, "'q3_hybrid'"),
        ({"outputs": []}, "outputs"),
        ({"frequency_step": 10}, "frequency_step"),
        ({"levels": [0]}, "levels"),
        ({"repeats": [1.5]}, "repeats"),
        ({"number": 0}, "number.* 1000"),
        ({"number": 1000}, "number.* 50"),
        ({"tones": 3}, "tones"),
        ({"noise_floor": "3 Hz"}, "noise_floor.*'V'"),
        ({"settings": {"g2": 0}}, "g2"),
        ({"setting_sigma": {"eta_plus": -1.0}}, "eta_plus"),
        ({"centres": "7 MHz"}, "centres"),
        ({"relative_noise": -0.1}, "relative_noise"),
        ({"spectra": 3}, "'spectra'"),
    ],
)
def test_limits_that_mean_nothing(
    bound: BoundCampaign, workers: FmuWorkers, table: dict[str, object], complaint: str
) -> None:
    with pytest.raises(BadInput, match=r"x\.toml: \[design.*" + complaint):
        limits_from(bound, workers, **table)
