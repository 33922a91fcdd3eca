"""Drift that is not linear: offsets and walks, through the FMU, against the virtual laboratory.

Truth: `fitting.lab.string`, which shares no code with the FMU, and sums done by hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.campaign.binder import Binder
from fitting.campaign.drift import bind_drift
from fitting.campaign.measured import Experiment
from fitting.campaign.parameters import Parameter
from fitting.fit.interior_point import solve
from fitting.fit.objective import Evaluator, Objective, weights
from fitting.fit.options import Options, options_of
from fitting.fit.problem import problem_of
from fitting.fmu.description import read_description
from fitting.fmu.pool import FmuWorkers
from fitting.inference.checks.solutions import drift_findings
from fitting.lab.bench import Measured, measure
from fitting.lab.benches import string_bench
from fitting.lab.writer import campaign_files
from fitting.measurements.measurement import Evaluation
from fitting.result.result import Result
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Kind
from fitting.text.units import Written, written_values
from tests.support.datasets import answer, dataset
from tests.support.reconstruction import ReconstructionOptions, reconstruct_through

OFFSETS = 'model = "offsets"\nprior = "30 Hz"\n'


def written(folder: Path, files: dict[str, str], *changes: tuple[str, str]) -> Path:
    """The campaign of these files, its text changed."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    path = folder / "campaign.toml"
    text = path.read_text().replace(OFFSETS, "", 1)  # linear, before the changes
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text)
    return path


def bound_to(fmu: Path, path: Path) -> BoundCampaign:
    return bind(read_campaign(path), read_description(fmu).variables)


def series_of(curvature_hz: float, seed: int) -> Measured:
    return measure(replace(string_bench("q1"), curvature_hz=curvature_hz, noise_scale=0.5), seed)


def quickly(bound: BoundCampaign) -> Options:
    """One start: enough for what is determined."""
    options = options_of(bound.continuation)
    schedule = replace(options.schedule, starts=1)
    return Options(schedule=schedule)


def fitted(workers: FmuWorkers, bound: BoundCampaign) -> Result:
    bound = replace(bound, alternatives=bound.alternatives[:1])
    asked = ReconstructionOptions(quickly(bound), profiles=False)
    return reconstruct_through(workers, problem_of([bound]), asked)


def true_offsets(series: Measured) -> np.ndarray:
    """Departure of every experiment from the interpolation between the ends, in Hz."""
    eta = np.array([modes.eta_plus_hz for modes in series.true_modes])
    return eta - np.linspace(eta[0], eta[-1], eta.size)


@pytest.mark.parametrize(
    "drifts",
    [
        ((3, 40.0),),
        pytest.param(((1, -20.0), (2, 30.0), (3, 40.0)), marks=pytest.mark.nightly),
    ],
    ids=["one", "three"],
)
def test_offsets_take_up_a_drift_that_is_not_linear(
    drifts: Sequence[tuple[int, float]], swift_fmu: Path, tmp_path: Path
) -> None:
    """At half the bench's noise, where its peaks give the line width to 0.4 % (one sigma)."""
    away, widths = [], []
    with FmuWorkers(swift_fmu, workers=1) as workers:
        for seed, curvature in drifts:
            series = series_of(curvature, seed)
            path = written(tmp_path / str(seed), campaign_files(series, "test"))
            if seed == 3:
                straight = fitted(workers, bound_to(swift_fmu, path))
                assert straight.deviations.final.mean > 0.12  # what linear interpolation leaves
            path = written(tmp_path / str(seed), {}, ("eta_plus = {", OFFSETS + "eta_plus = {"))
            bound = bound_to(swift_fmu, path)
            result = fitted(workers, bound)
            assert result.status == "converged", result.message
            noise = float(np.mean(problem_of([bound]).data.sigma))
            assert result.deviations.final.mean < 1.5 * noise
            truth = true_offsets(series)
            away += [(o.value - t) / o.std for o, t in zip(result.offsets, truth, strict=True)]
            width = result.derived["width_plus"]
            assert width.status == "linearised only"
            widths.append(width.value / series.bench.modes.widths_hz()[0] - 1.0)
    assert np.max(np.abs(widths)) < 0.01
    assert np.max(np.abs(away)) < 3.0
    assert 0.4 < np.sqrt(np.mean(np.square(away))) < 1.6  # neither too proud nor too modest


def test_a_walk_is_reported_as_offsets(swift_fmu: Path, tmp_path: Path) -> None:
    """Steps are fitted, what they add up to is told: the same as independent offsets here."""
    series = series_of(30.0, 5)
    walk = OFFSETS.replace("offsets", "walk")
    path = written(
        tmp_path, campaign_files(series, "test"), ("eta_plus = {", walk + "eta_plus = {")
    )
    bound = bound_to(swift_fmu, path)
    assert [p.name for p in bound.parameters[3:]] == [f"step[pair{m}]" for m in range(1, 6)]
    assert bound.parameters[4].experiments == ("pair2", "pair3", "pair4", "pair5")
    with FmuWorkers(swift_fmu, workers=1) as workers:
        result = fitted(workers, bound)
    assert [o.experiments for o in result.offsets] == [(f"pair{m}",) for m in range(1, 6)]
    for o, truth in zip(result.offsets, true_offsets(series), strict=True):
        assert abs(o.value - truth) < 3.0 * o.std
    steps = np.diff([o.value for o in result.offsets])
    assert steps == pytest.approx([o.fitted for o in result.offsets[1:]])


def with_times(folder: Path, fmu: Path, drift: str, times: list[str]) -> BoundCampaign:
    """The campaign with a column of time stamps."""
    files = campaign_files(series_of(5.0, 1), "test")
    head, *rows = [line for line in files["experiments.csv"].splitlines() if line[0] != "#"]
    stamped = [f"{row},{time}" for row, time in zip([head, *rows], times, strict=True)]
    files["experiments.csv"] = "\n".join(stamped) + "\n"
    return bound_to(fmu, written(folder, files, ("eta_plus = {", drift + "eta_plus = {")))


@pytest.mark.parametrize(
    ("drift", "times", "shares"),
    [
        ("", ["time (min)", "0", "10", "20", "30", "100"], (0.0, 0.1, 0.2, 0.3, 1.0)),
        (
            'before_time = "-100 min"\nafter_time = "2 h"\n',
            ["time (min)", "-100", "10", "10", "65", "120"],
            (0.0, 0.5, 0.5, 0.75, 1.0),
        ),
        (
            "",
            [
                "time",
                "2024-05-01T08:00",
                "2024-05-01T09:00",
                "2024-05-01T20:00",
                "2024-05-02T08:00",
                "2024-05-02T08:00",
            ],
            (0.0, 1 / 24, 0.5, 1.0, 1.0),
        ),
    ],
)
def test_drift_follows_the_clock(
    swift_fmu: Path, tmp_path: Path, drift: str, times: list[str], shares: tuple[float, ...]
) -> None:
    bound = with_times(tmp_path, swift_fmu, f'time = "time"\n{drift}', times)
    before, after = bound.drift.ends["eta_plus"]
    for e, share in zip(bound.experiments, shares, strict=True):
        assert e.settings["eta_plus"] == pytest.approx(before + share * (after - before), abs=1e-6)


def test_experiments_of_one_time_share_their_offset(swift_fmu: Path, tmp_path: Path) -> None:
    times = ["time (s)", "0", "3", "3", "7", "12"]
    bound = with_times(tmp_path, swift_fmu, OFFSETS + 'time = "time"\n', times)
    names = [p.experiments for p in bound.parameters[3:]]
    assert names == [("pair1",), ("pair2", "pair3"), ("pair4",), ("pair5",)]
    walk = OFFSETS.replace("offsets", "walk") + 'time = "time"\n'
    bound = with_times(tmp_path / "walk", swift_fmu, walk, times)
    sigmas = [p.prior_sigma for p in bound.parameters[3:]]  # mean step: 4 s
    assert sigmas == pytest.approx([30.0, *(30.0 * np.sqrt(np.array([3, 4, 5]) / 4))])
    apart = OFFSETS + "share = false\n"
    path = written(
        tmp_path / "apart",
        campaign_files(series_of(5.0, 1), "test"),
        ("eta_plus = {", apart + "eta_plus = {"),
    )
    added = [p.adds_to for p in bound_to(swift_fmu, path).parameters[3:]]
    assert added == [("eta_plus",)] * 5 + [("eta_minus",)] * 5


@pytest.mark.parametrize(
    ("drift", "found"),
    [
        ('model = "offsets"', r"\[drift\] prior: is missing"),
        ('model = "offset"', "model: .*'offset'"),
        ('prior = "30 Hz"', "prior: .*model"),
        ('model = "walk"\nprior = "30 s"', "prior"),
        ('model = "walk"\nprior = "-3 Hz"', "prior: .*-3"),
        ('time = "clock"', "'clock'"),
        ('before_time = "3 s"', "before_time: .*time"),
        ('modle = "walk"', "modle"),
    ],
)
def test_a_drift_that_makes_no_sense_is_refused(
    swift_fmu: Path, tmp_path: Path, drift: str, found: str
) -> None:
    files = campaign_files(series_of(5.0, 1), "test")
    path = written(tmp_path, files, ("eta_plus = {", f"{drift}\neta_plus = {{"))
    with pytest.raises(BadInput, match=found) as caught:
        bound_to(swift_fmu, path)
    assert "\n" not in str(caught.value)


def test_drift_beyond_the_line_width_is_told(swift_fmu: Path, tmp_path: Path) -> None:
    path = written(tmp_path, campaign_files(series_of(5.0, 1), "test"))
    bound = bound_to(swift_fmu, path)
    assert not [*drift_findings(bound, (), 200.0)]
    [found] = drift_findings(bound, (), 94.0)
    assert found.kind is Kind.drift_wide
    assert found.numbers["eta_plus"] == pytest.approx(100.0, abs=0.1)
    assert found.numbers["width_hz"] == 94.0


def test_a_smaller_drift_is_told_where_the_model_does_not_describe_the_data(
    swift_fmu: Path, tmp_path: Path
) -> None:
    path = written(tmp_path, campaign_files(series_of(5.0, 1), "test"))
    bound = bound_to(swift_fmu, path)
    [found] = drift_findings(bound, (), 200.0, describes=False)
    assert (found.kind, found.severity) == (Kind.drift_suspected, "warning")
    assert found.numbers["eta_plus"] == pytest.approx(100.0, abs=0.1)
    assert not [*drift_findings(bound, (), 2000.0, describes=False)]


class Line:
    """Rows r_i = s_i (a + offset_i) of a straight model, to try the weight of a prior."""

    slopes = np.array([1.0, 2.0])

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [answer(1.0 + self.slopes * (p[0] + p[1:])) for p in ps]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [{} for _ in ps]


def test_a_prior_keeps_the_weight_that_bayes_gives_it() -> None:
    """Sum of squares in units of the noise: the exact Gaussian posterior, whatever nu is."""
    sigma, prior = np.array([0.1, 0.3]), 0.5
    parameters = (
        Parameter(
            name="a",
            unit="1",
            lower=-9.0,
            upper=9.0,
            start=0.0,
            reference=0.0,
            scale=1.0,
            prior=2.0,
        ),
        *(
            Parameter(
                name=f"o[{m}]",
                unit="1",
                lower=-9.0,
                upper=9.0,
                start=0.0,
                reference=0.0,
                scale=prior,
                experiment=str(m),
                prior=prior,
            )
            for m in (1, 2)
        ),
    )
    data = np.array([0.7, -0.2])  # peaks 1 + data, relative errors sigma
    measured = dataset(1.0 + data, sigma * (1.0 + data), weigh=True)
    objective = Objective(
        response=Line(), parameters=parameters, data=measured, steps=np.full(3, 1e-3)
    )
    matrix = np.array([[1.0, 1.0, 0.0], [2.0, 0.0, 2.0]])
    precision = np.diag(1.0 / np.array([2.0, prior, prior]) ** 2)
    noise = np.diag((sigma * (1.0 + data)) ** -2)
    truth = np.linalg.solve(matrix.T @ noise @ matrix + precision, matrix.T @ noise @ data)
    for nu in (1e-1, 1e-9):
        evaluator = Evaluator(objective)
        held = weights(objective, nu, "squares")
        found = solve(evaluator, np.zeros(3), held, "squares")
        # the barrier ends within a thousandth of the posterior's width
        assert evaluator.point(found.x).parameters == pytest.approx(truth, abs=1e-4)


def test_what_two_outputs_read_of_one_drive_is_one_state(swift_fmu: Path, tmp_path: Path) -> None:
    """Three drives, two of them read at both outputs; a drive that comes again later is another."""
    measured = [
        Experiment(
            label=label,
            tones_hz=(tone - 40.0, tone + 40.0),
            peaks_v=np.array([2e-5, 2e-5]),
            written=written_values({"u1": tone - 40.0, "u2": tone + 40.0}, label),
            observed=Written(output, None, label),
        )
        for label, tone, output in [
            ("a1", 6.94e6, "q1_hybrid"),
            ("a2", 6.94e6, "q2_hybrid"),
            ("b1", 6.9401e6, "q1_hybrid"),
            ("c1", 6.94e6, "q1_hybrid"),
            ("c2", 6.94e6, "q2_hybrid"),
        ]
    ]
    files = campaign_files(series_of(5.0, 1), "test")
    changes = ("eta_plus = {", OFFSETS + "eta_plus = {")
    campaign = read_campaign(written(tmp_path, files, changes))
    campaign = replace(campaign, experiments=tuple(measured))
    drift = bind_drift(campaign, Binder(read_description(swift_fmu).variables))
    assert drift.positions == (0.0, 0.0, 0.5, 1.0, 1.0)
    assert [p.experiments for p in drift.parameters] == [("a1", "a2"), ("b1",), ("c1", "c2")]
