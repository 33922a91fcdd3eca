"""A part of the measurements alone: what sweeps under a pump say beside unpumped ones."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure as Canvas

import fitting as ff
from fitting.campaign import bind
from fitting.fit.problem import problem_of
from fitting.inference.likelihood.knowledge import PartAlone
from fitting.lab.pumped import PumpedBench
from fitting.lab.synthesis import synthesize
from fitting.measurements.control_sweep import ControlSweep
from fitting.report.figures import measurements as measurement
from fitting.report.identification import identification_lines
from fitting.text.errors import BadInput
from fitting.text.estimate import Verdict
from fitting.text.finding import Kind, of_kind
from tests.support.pumped_line import SidebandLine

pytestmark = pytest.mark.usefixtures("swift_models")

#: Unpumped before and after, pumped on either side of the distance of the lines.
BENCH = PumpedBench(settings=((0.0, 0.0), (3e-4, -80.0), (3e-4, 80.0), (0.0, 0.0)), points=31)
UNPUMPED = (0, 3)


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> ff.Problem:
    folder = tmp_path_factory.mktemp("pumped")
    synthesize(BENCH, seed=1, out=folder)
    campaign = ff.read_campaign(folder / "campaign.toml")
    with ff.Fmu("CoupledModes2", 1) as fmu:
        record = problem_of([bind(campaign, fmu.variables)])
    return ff.Problem.answered_by(lambda _: SidebandLine(BENCH), record)


def test_a_part_has_the_rows_of_its_places(problem: ff.Problem) -> None:
    part = problem.part({"depth": 0.0})
    [whole], [kept] = problem.record.measurements, part.record.measurements
    assert [label for label, _ in kept.places] == [whole.places[k][0] for k in UNPUMPED]
    rows = problem.record.data.sigma.reshape(4, -1)[list(UNPUMPED)]
    assert np.array_equal(part.record.data.sigma, rows.ravel())
    assert problem.record.measurements == (whole,)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"dephts": 0.0}, "'dephts'.* depth, detuning, time"),
        ({"depth": 7.0}, r"depth = 7\.0"),
        ({"detuning": -80.0}, "wanted two or more"),
    ],
)
def test_what_is_no_part_is_refused(
    problem: ff.Problem, settings: dict[str, float], words: str
) -> None:
    with pytest.raises(BadInput, match=words):
        problem.part(settings)


@pytest.mark.nightly
def test_pumped_sweeps_determine_the_angle_and_unpumped_ones_do_not(problem: ff.Problem) -> None:
    """The closed form's own truth: theta enters the unpumped line through its width alone."""
    whole = ff.identify(problem)
    record = problem.part({"depth": 0.0}).record
    alone = ff.Problem.answered_by(lambda _: SidebandLine(BENCH, UNPUMPED), record)
    part = ff.identify(alone)
    for name, truth in (("theta", BENCH.string.theta_rad), ("d1", 120.0), ("d2", 90.0)):
        low, high = whole.profiled[name].ci95
        assert low - 0.5 * (high - low) <= truth <= high + 0.5 * (high - low)
        assert whole.profiled[name].status is Verdict.DETERMINED
        assert not part.profiled[name].status.has_value
    low, high = part.profiled["lambda12"].ci95
    assert high - low > 1e5
    # pi/2, where laws and model end, lies just below the box: what fits up to there is not open
    assert part.profiled["theta"].status is Verdict.UNCONSTRAINED
    assert part.profiled["lambda12"].status is Verdict.UNCONSTRAINED
    both = PartAlone(
        settings={"depth": 0.0},
        places=2,
        total=4,
        parameters=part.parameters,
        derived=part.derived,
        knowledge=part.knowledge,
    )
    said = " ".join(" ".join(identification_lines(replace(whole, part=both))).split())
    assert "depth = 0 (2 of 4 places)" in said
    assert re.search(r"range of theta, d1, d2\b.*lambda12 ", said)  # both ends of their ranges
    assert re.search(r"4 places .*theta, d1, d2\b", said)


def test_maps_go_by_the_controls_that_repeat(problem: ff.Problem) -> None:
    """A text for each sweep: detuning above depth; its own time tells a reader nothing."""
    [sweep] = problem.record.measurements
    assert isinstance(sweep, ControlSweep)
    [figure] = sweep.figures(sweep.measured, sweep.measured)
    for panel in figure.panels:
        assert panel.x.label.split() == ["detuning", "(Hz)", "above", "depth"]
        texts = [text.splitlines() for _, text in panel.x.ticks]
        told = [[float(part.replace("−", "-")) for part in text] for text in texts]
        assert told == [[s.settings["detuning"], s.settings["depth"]] for s in sweep.spectra]
    axes = Canvas().subplots()
    measurement.panel(figure.panels[0], ax=axes)
    assert [tick.get_text() for tick in axes.get_xticklabels()] == [
        text for _, text in figure.panels[0].x.ticks
    ]
    assert not any(line.get_visible() for line in axes.get_xgridlines() + axes.get_ygridlines())


@pytest.mark.parametrize("budget", [1100, pytest.param(900, marks=pytest.mark.nightly)])
def test_a_search_that_was_cut_does_not_hide_that_nothing_sees_the_coupling(
    problem: ff.Problem, budget: int
) -> None:
    """With d1 = d2 the damping is the same in all coordinates: theta leaves the line as it is.

    What was come by at both ends of theta then fits close to both ends of the coupling, too.
    """
    lines = SidebandLine(BENCH, UNPUMPED)
    sigma = 0.2e-6 / BENCH.volts_per_m
    angles = (1.58, 2.35)
    seen = [lines.swept(np.array([theta, 100.0, 100.0, 0.0, 0.0, 0.0])) for theta in angles]
    assert np.max(np.abs(seen[1] - seen[0])) < 1e-6 * sigma
    couplings = [lines.coupling_hz(np.array([theta, 1.0, 1.0, 0.0, 0.0, 0.0])) for theta in angles]
    record = problem.part({"depth": 0.0}).record
    alone = ff.Problem.answered_by(lambda _: lines, record)
    part = ff.identify(alone, budget=budget)
    # it was cut: what is left is less than a round of the search takes
    assert part.knowledge.effort.fmu_runs > 0.85 * budget
    assert part.profiled["theta"].status is Verdict.UNCONSTRAINED
    found = part.profiled["lambda12"]
    assert found.status is Verdict.UNCONSTRAINED
    low, high = found.ci95
    assert low <= couplings[0] < couplings[1] <= high
    incomplete = of_kind(part.findings, Kind.profiles_incomplete)
    assert not any("lambda12" in finding.names["values"] for finding in incomplete)
