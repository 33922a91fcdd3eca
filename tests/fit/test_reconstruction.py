"""The whole job: on closed forms, and through the real FMU from a campaign file."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.cli import reconstruct as command
from fitting.fit import alternative, checkpoint
from fitting.fit.likelihood import LikelihoodEvaluator
from fitting.fit.optimum import Optimum, most_likely
from fitting.fit.options import options_of
from fitting.fit.path import PATH, Hooks, PathLevel, Progress
from fitting.fit.problem import problem_of
from fitting.fmu.description import read_description
from fitting.fmu.pool import FmuWorkers
from fitting.measurements.response_curve import ResponseCurve
from fitting.report.summary import detail_lines, result_lines, summary_of
from fitting.result.provenance import job_of, provenance_of
from fitting.result.result import Result, read_result, write_result
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.finding import Kind, of_kind
from fitting.text.results_folder import results_folder
from tests.fit.test_result import read_rows
from tests.support import closed_form
from tests.support.datasets import drafted, linear, through
from tests.support.in_process import told
from tests.support.processes import MOST_S
from tests.support.reconstruction import (
    NO_FMU,
    ReconstructionOptions,
    reconstruct,
    reconstruct_through,
)
from tests.support.shipped_runs import ShippedRun
from tests.support.small_campaign import of_pairs, small_campaign

TRUTH = (1.9498, 120.0, 90.0)
ROOT = Path(__file__).resolve().parents[2]
STRING_Q1 = ROOT / "data" / "string_q1" / "campaign.toml"
WIDTH = float(closed_form.damping(*TRUTH, reflection=False)[0, 0])


def respond(alternative: Mapping[str, Scalar]) -> closed_form.ClosedFormResponse:
    return closed_form.string_response(reflection=bool(alternative["reflection"]))


def run(bound: BoundCampaign, hooks: Hooks | None = None, **schedule: object) -> Result:
    options = options_of(bound.continuation)
    options = replace(options, schedule=replace(options.schedule, **schedule))  # type: ignore[arg-type]
    asked = ReconstructionOptions(options, hooks=hooks or Hooks(), profiles=False)
    return reconstruct(problem_of([bound]), respond, asked, {"lambda": "Hz"})


@pytest.fixture(scope="module")
def noisy_campaign(tmp_path_factory: pytest.TempPathFactory) -> BoundCampaign:
    response = closed_form.string_response()
    measured = closed_form.measured_by(response, noise=0.01)
    return closed_form.string_campaign(measured, response, tmp_path_factory.mktemp("campaign"))


@pytest.fixture(scope="module")
def watched(noisy_campaign: BoundCampaign) -> tuple[Result, list[Progress]]:
    """The whole job, and how far it was told to be."""
    seen: list[Progress] = []
    return run(noisy_campaign, Hooks(progress=seen.append)), seen


@pytest.fixture(scope="module")
def result(watched: tuple[Result, list[Progress]]) -> Result:
    return watched[0]


def test_the_width_is_determined_and_the_coupling_is_not(result: Result) -> None:
    width = result.derived["D11"]
    assert width.status == "linearised only"  # no profiles were asked for
    assert abs(width.value / (2 * np.pi) - WIDTH) < 4.0 * width.std / (2 * np.pi)
    assert width.std / width.value < 0.02
    for name in ("theta", "d1"):
        assert result.parameters[name].status == "not known"
        assert result.parameters[name].shrinkage < 0.01
    coupling = result.derived["lambda"]
    assert coupling.status == "not known"
    assert coupling.lower < 2e5 < 7e5 < coupling.upper
    assert "λ" in "; ".join(summary_of(result).unknown)


def test_no_error_is_claimed_where_nothing_is_known(result: Result, tmp_path: Path) -> None:
    for value in (result.parameters["theta"], result.derived["lambda"]):
        assert np.isnan(value.std)
    assert result.derived["lambda"].ci95 == result.derived["lambda"].bounds
    for p in result.parameters.values():
        assert p.lower <= p.ci95[0] <= p.value <= p.ci95[1] <= p.upper
    for d in result.derived.values():
        assert d.lower <= d.ci95[0] <= d.value <= d.ci95[1] <= d.upper
    width = result.derived["D11"]
    assert width.ci95[1] - width.ci95[0] == pytest.approx(2 * norm.ppf(0.975) * width.std)
    data = json.loads(write_result(result, tmp_path)[0].read_text())
    assert data["parameters"]["theta"]["std"] is None
    assert data["derived"]["lambda"]["std"] is None
    assert data["derived"]["lambda"]["ci95"][0] > 0.0
    words = ("not known", "covariance")
    told = {line.split()[0]: line for line in detail_lines(result) if any(w in line for w in words)}
    for name in ("theta", "lambda"):  # a range, and neither a value nor an error
        assert told[name].split()[1] == told[name].split()[3] == "-"
    assert f" {width.std:.2g} " in told["D11"]


def test_the_table_says_nothing_twice(result: Result) -> None:
    assert result_lines(result)[0].startswith("string (synthetic data) ")
    named = replace(result, title="String (synthetic)")
    assert result_lines(named)[0].count("ynthetic") == 1
    told = detail_lines(named)
    assert sum(line.startswith("alternative ") for line in told) == 2
    single = replace(result.alternatives[0], settings={})
    told = detail_lines(replace(result, alternatives=(single,), findings=()))
    assert not any("alternative" in line for line in told)


def test_the_scatter_of_the_width_over_noise_is_what_is_claimed(tmp_path: Path) -> None:
    draws = 12
    response = closed_form.string_response()
    found, claimed = [], []
    for seed in range(draws):
        measured = closed_form.measured_by(response, noise=0.01, seed=seed)
        bound = closed_form.string_campaign(measured, response, tmp_path)
        # by squares Algorithm 2 ends sooner; what is reported is of the likelihood either way
        assert bound.continuation is not None
        continuation = replace(bound.continuation, misfit="squares")
        bound = replace(bound, alternatives=bound.alternatives[:1], continuation=continuation)
        one = run(bound, starts=1, iterations=1)
        found.append(one.derived["D11"].value / (2 * np.pi))
        claimed.append(one.derived["D11"].std / (2 * np.pi))
    assert abs(np.mean(found) - WIDTH) < 3.0 * np.std(found) / np.sqrt(draws)
    # twelve draws know their scatter to a fifth, and are below half of it once in a hundred (chi
    # square of 11 below 12/4; of four draws, of 3 below 4/4: once in five); the median has pi/2
    # times the variance of a mean
    assert 0.5 < np.std(found) / np.mean(claimed) < 2.0


def test_both_alternatives_are_listed_and_their_tie_is_told(result: Result) -> None:
    assert [a.settings for a in result.alternatives] == [
        {"reflection": False},
        {"reflection": True},
    ]
    assert [a.reported for a in result.alternatives] == [True, False]
    assert all(a.equal_to_best for a in result.alternatives)
    assert of_kind(result.findings, Kind.equal_alternative)
    # the other form mirrors the first: its minima are images that took nothing
    own, mirrored = result.alternatives
    assert own.search is not None
    assert mirrored.search is not None
    assert own.search.evaluations > 0 == mirrored.search.evaluations
    assert len(mirrored.starts) == len(own.starts) >= 1
    assert sum(start.descents for start in own.starts) == own.search.descents


def test_deviations_are_those_of_the_peaks(result: Result) -> None:
    for which, simulated in (("initial", "initial_v"), ("final", "final_v")):
        table = getattr(result.deviations, which)
        expected = [abs(getattr(p, simulated) - p.measured_v) / p.measured_v for p in result.peaks]
        assert table.per_peak == pytest.approx(expected, rel=1e-9)
        assert table.mean == pytest.approx(np.mean(expected), rel=1e-12)
        pairs = np.reshape(expected, (5, 2)).mean(axis=1)
        assert table.per_experiment == pytest.approx(pairs, rel=1e-12)
    assert result.j_fit == pytest.approx(sum(result.deviations.final.per_peak), rel=1e-12)


def test_result_files_come_back_whole(result: Result, tmp_path: Path) -> None:
    whole, history = write_result(result, tmp_path)
    assert repr(read_result(whole)) == repr(result)
    rows = read_rows(history.read_text())
    assert len(rows) == len(result.history) >= 10
    for row, kept in zip(rows, result.history, strict=True):
        assert float(row["theta (rad)"]) == kept.parameters["theta"]
        assert float(row["j_fit"]) == kept.j_fit
    data = json.loads(whole.read_text())
    for key in ("status", "message", "evaluations", "seconds", "provenance", "history"):
        assert key in data
    for key in ("value", "unit", "std", "ci95", "reference", "shrinkage", "status"):
        assert key in data["parameters"]["theta"]
        assert key in data["derived"]["lambda"]
    assert {"spread", "values"} <= set(data["derived"]["lambda"])
    assert {"initial", "final", "improvement_percent"} <= set(data["deviations"])


def test_a_peak_moved_by_ten_sigma_stands_out(noisy_campaign: BoundCampaign) -> None:
    moved = list(noisy_campaign.experiments)
    peaks = moved[2].peaks_v.copy()
    peaks[0] += 10.0 * moved[2].sigmas_v[0]
    moved[2] = replace(moved[2], peaks_v=peaks)
    found = run(replace(noisy_campaign, experiments=tuple(moved)), starts=1, iterations=2)
    pairs = list(found.deviations.final.per_experiment)
    assert max(range(5), key=lambda m: pairs[m]) == 2
    assert pairs[2] > 2.0 * sorted(pairs)[-2]


def test_progress_counts_alternatives_and_then_levels(
    watched: tuple[Result, list[Progress]],
) -> None:
    told = watched[1]
    assert [(state.stage, state.done, state.of) for state in told] == [
        *(("search", k, 2) for k in range(2)),
        *(("path", k, 9) for k in range(9)),
    ]
    assert told[-1].evaluations > told[2].evaluations == 0
    assert told[-1].nu == pytest.approx(1e-9)
    assert told[-1].j_fit == pytest.approx(watched[0].history[-2].j_fit)


def test_ending_badly_is_a_value(
    noisy_campaign: BoundCampaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stalled(evaluator: LikelihoodEvaluator, begins: Sequence[FloatArray]) -> Optimum:
        return replace(most_likely(evaluator, begins), converged=False)

    monkeypatch.setattr(alternative, "most_likely", stalled)
    ended = run(noisy_campaign, starts=1, iterations=1)
    assert ended.status == "not converged"
    assert np.isfinite(ended.parameters["theta"].value)


class Stopping(checkpoint.Checkpoint):
    """A checkpoint during whose n-th write the user presses Ctrl-C, or the power fails."""

    stop_after = 3

    def record(self, step: PathLevel) -> None:
        super().record(step)
        if len(self) == self.stop_after:
            raise KeyboardInterrupt


def without_times(result: Result) -> str:
    history = tuple(replace(row, seconds=0.0) for row in result.history)
    provenance = replace(result.provenance, finished="")
    return repr(replace(result, seconds=0.0, history=history, provenance=provenance))


@pytest.mark.nightly
def test_an_interrupted_run_reports_and_a_resumed_one_ends_the_same(
    noisy_campaign: BoundCampaign, tmp_path: Path
) -> None:
    """In the first level, and in the last but one."""
    options = options_of(noisy_campaign.continuation)
    job = job_of(problem_of([noisy_campaign]), "", options)
    whole = run(noisy_campaign)
    assert [a.reported for a in whole.alternatives] == [True, False]
    for stop_after in (1, 8):
        memory = Stopping(tmp_path, job)
        memory.stop_after = stop_after
        partial = run(noisy_campaign, Hooks(memory=memory))
        assert partial.status == "interrupted"
        kept = checkpoint.Checkpoint(tmp_path, job, resume=True)
        assert len(kept) == stop_after
        again = run(noisy_campaign, Hooks(memory=kept))
        assert without_times(again) == without_times(whole)


def test_a_job_is_told_from_others(noisy_campaign: BoundCampaign) -> None:
    options = options_of(noisy_campaign.continuation)
    problem = problem_of([noisy_campaign])
    one = job_of(problem, "a", options)
    assert one == job_of(problem, "a", options)
    assert one != job_of(problem, "b", options)
    other = replace(options, schedule=replace(options.schedule, seed=2))
    assert one != job_of(problem, "a", other)


def test_files_of_one_name_in_several_folders_are_told_apart(
    noisy_campaign: BoundCampaign, tmp_path: Path
) -> None:
    folder = tmp_path / "campaign"
    paths = [folder / "campaign.toml", *(folder / f"pair{m}" / "trace.csv" for m in range(5))]
    paths.append(tmp_path / "shared" / "trace.csv")
    for k, path in enumerate(paths):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"content {k}\n")
    bound = replace(noisy_campaign, path=paths[0], files=tuple(paths))
    options, problem = options_of(bound.continuation), problem_of([bound])
    names = ["campaign.toml", *(f"pair{m}/trace.csv" for m in range(5)), "../shared/trace.csv"]
    assert list(provenance_of(problem, NO_FMU, "test", options).files) == names
    before = job_of(problem, "", options)
    for path in paths:
        kept = path.read_text()
        path.write_text("changed\n")
        assert job_of(problem, "", options) != before
        path.write_text(kept)
    assert job_of(problem, "", options) == before


# --- through the FMU ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def workers(swift_fmu: Path) -> Iterator[FmuWorkers]:
    with FmuWorkers(swift_fmu, workers=2) as started:
        yield started


@pytest.fixture(scope="module")
def string_q1(swift_fmu: Path) -> BoundCampaign:
    return linear(bind(read_campaign(STRING_Q1), read_description(swift_fmu).variables))


def test_the_fmu_answers_as_the_closed_form(workers: FmuWorkers, string_q1: BoundCampaign) -> None:
    plan = drafted(string_q1)
    sweep = string_q1.sweep
    assert sweep is not None
    for k, settings in enumerate(string_q1.alternatives):
        response = through(workers, string_q1, plan, settings)
        ps = [np.array(TRUTH), np.array([0.4, 60.0, 200.0])]
        answers = response.evaluate_many(ps)
        for p, answer in zip(ps, answers, strict=True):
            d = closed_form.damping(p[0], p[1], p[2], bool(k))
            expected = np.concatenate(
                [
                    closed_form.amplitude(
                        e.tones_hz,
                        (float(e.settings["eta_plus"]), float(e.settings["eta_minus"])),
                        d,
                        0,
                    )
                    for e in string_q1.experiments
                ]
            )
            peaks, swept = answer.predictions
            assert peaks.values == pytest.approx(expected, rel=1e-9)
            assert answer.runs >= 10
            eta = (float(sweep.settings["eta_plus"]), float(sweep.settings["eta_minus"]))
            fine = eta[0] + np.linspace(-2.0, 2.0, 20001)
            top = float(np.max(closed_form.amplitude(fine, eta, d, 0)))
            assert swept.maximum is not None
            assert swept.maximum.value == pytest.approx(top, rel=1e-9)
            assert swept.maximum.bias < string_q1.setup.accuracy
            assert swept.values.size == 0  # the scale needs the maximum alone
        [whole] = response.evaluate_many(ps[:1], whole=True)
        curve = ResponseCurve(response.models[""], sweep.settings)
        single = np.abs(curve.simulated(ps[0], sweep.frequency_hz, workers))
        assert np.array_equal(whole.predictions[1].values, single)
        assert single == pytest.approx(
            closed_form.amplitude(
                sweep.frequency_hz, eta, closed_form.damping(*TRUTH, reflection=bool(k)), 0
            ),
            rel=1e-9,
        )
        assert response.misfit(ps[0]) < 1e-8


def test_a_batch_answers_as_single_calls(workers: FmuWorkers, string_q1: BoundCampaign) -> None:
    plan = drafted(string_q1)
    ps = [np.array(TRUTH) * (1.0 + 1e-3 * k) for k in range(4)]
    response = through(workers, string_q1, plan, string_q1.alternatives[0])
    together = response.evaluate_many(ps)
    for p, answer in zip(ps, together, strict=True):
        alone = response.evaluate_many([p])[0]
        for one, other in zip(alone.predictions, answer.predictions, strict=True):
            assert np.array_equal(one.values, other.values)
            assert one.maximum == other.maximum
        assert answer.predictions[1].maximum is not None


def test_a_maximum_outside_the_first_points_is_found(
    workers: FmuWorkers, string_q1: BoundCampaign
) -> None:
    assert string_q1.sweep is not None
    plan = drafted(string_q1)
    settings = dict(string_q1.sweep.settings) | {"eta_plus": 6.9415e6}
    away = replace(string_q1, sweep=replace(string_q1.sweep, settings=settings))
    response = through(workers, away, plan, away.alternatives[0])
    found = response.evaluate_many([np.array(TRUTH)])[0].predictions[1].maximum
    assert found is not None
    d = closed_form.damping(*TRUTH, reflection=False)
    eta = (6.9415e6, float(settings["eta_minus"]))
    fine = eta[0] + np.linspace(-2.0, 2.0, 20001)
    assert found.value == pytest.approx(
        float(np.max(closed_form.amplitude(fine, eta, d, 0))), rel=1e-6
    )


@pytest.mark.parametrize(
    ("box", "start", "warned", "noted"),
    [
        pytest.param(
            (0.2, 0.5), 0.3, True, False, marks=pytest.mark.nightly
        ),  # sin 2 theta > 0: lambda is nowhere a real number
        ((1.2, 2.5), 1.3, False, True),  # it is not at the start, but it is at the end
        pytest.param((1.7, 2.5), 1.8, False, False, marks=pytest.mark.nightly),
    ],
)
def test_only_what_the_fmu_says_at_the_solution_is_a_warning(
    workers: FmuWorkers,
    string_q1: BoundCampaign,
    box: tuple[float, float],
    start: float,
    warned: bool,
    noted: bool,
) -> None:
    whole = string_q1.parameters[0]
    theta = replace(whole, lower=box[0], upper=box[1], start=start, period=None)
    if warned:
        theta = replace(theta, reference=start)
    bound = replace(
        string_q1,
        experiments=string_q1.experiments[:2],
        parameters=(theta, *string_q1.parameters[1:]),
        alternatives=string_q1.alternatives[:1],
    )
    options = options_of(bound.continuation)
    options = replace(options, schedule=replace(options.schedule, starts=1), path=False)
    asked = ReconstructionOptions(options, profiles=False)
    found = reconstruct_through(workers, problem_of([bound]), asked)
    said = of_kind(found.findings, Kind.fmu_warning)
    assert len(said) == warned
    assert len(found.provenance.notes) == noted
    if warned:
        assert f"theta = {found.parameters['theta'].value!r} rad" in said[0].names["text"][0]


def arguments(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    return parser.parse_args(words)


def test_the_command_reconstructs_the_shipped_campaign(string_q1_run: ShippedRun) -> None:
    out = string_q1_run.printed
    assert "unconstrained" in out
    # the sweep by itself determines the width better than the peaks
    assert "width_plus 94.18 ± 0.24 Hz (from the sweep)" in out
    found = string_q1_run.result
    assert found.ending.kind == "described"
    width = found.derived["width_plus"]
    assert abs(width.value - WIDTH) < 3.0 * width.std
    assert found.deviations.final.mean < found.deviations.initial.mean
    assert found.provenance.fmu_guid
    assert len(found.provenance.plan) > 5
    assert "reused" in found.provenance.plan[-1]
    # lambda is no real number at some starts and samples of the box, but at the solution it is
    assert not of_kind(found.findings, Kind.fmu_warning)
    assert "The FMU" not in out
    [note] = found.provenance.notes
    assert "lambda" in note
    assert not (string_q1_run.folder / checkpoint.NAME).exists()


SCRIPT = """
import os, signal, sys
from tests.fit.test_reconstruction import arguments
from fitting.cli import reconstruct
from fitting.fit import checkpoint

record = checkpoint.Checkpoint.record

def record_and_end(self, step):
    record(self, step)
    os.kill(os.getpid(), signal.SIGKILL)

checkpoint.Checkpoint.record = record_and_end
sys.exit(reconstruct.run(arguments(*sys.argv[1:])))
"""


@contextmanager
def interrupting() -> Iterator[None]:
    """SIGINT interrupts, as in a shell: a job in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_run_that_is_killed_goes_on_where_it_was(
    swift_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped with the first level on disk, by a signal to itself: no race with the clock.

    Killed it is in a process of its own; interrupted in this one.
    """
    script = tmp_path / "go.py"
    script.write_text(SCRIPT)
    campaign = of_pairs(small_campaign(tmp_path / "campaign", swift_fmu), 1, 5)
    words = [str(campaign), "--workers", "1", "--starts", "1", "--no-report", "--no-profiles"]
    killed = subprocess.run(
        [sys.executable, str(script), *words, "--out", str(tmp_path / "killed")],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        cwd=ROOT,
        text=True,
        capture_output=True,
        check=False,
        timeout=MOST_S,
    )
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert (tmp_path / "killed" / checkpoint.NAME).exists()
    assert not (tmp_path / "killed" / "result.json").exists()
    record = checkpoint.Checkpoint.record

    def record_and_interrupt(self: checkpoint.Checkpoint, step: PathLevel) -> None:
        record(self, step)
        os.kill(os.getpid(), signal.SIGINT)

    with monkeypatch.context() as patch, interrupting():
        patch.setattr(checkpoint.Checkpoint, "record", record_and_interrupt)
        stopped = told("reconstruct", *words, "--out", tmp_path / "stopped")
    assert stopped.code == 1, stopped.err
    assert "interrupted" in stopped.out
    assert read_result(tmp_path / "stopped" / "result.json").status == "interrupted"
    ends = []
    for folder in ("killed", "stopped"):
        resumed = told("reconstruct", *words, "--out", tmp_path / folder, "--resume")
        assert resumed.code == 0, resumed.err
        assert "levels found" in resumed.out
        ends.append(read_result(tmp_path / folder / "result.json"))
    one, two = (
        without_times(replace(e, provenance=replace(e.provenance, command="", fmu_file="")))
        for e in ends
    )
    assert one == two


def test_resuming_another_job_is_refused(swift_fmu: Path, tmp_path: Path) -> None:
    step = PathLevel(
        kind=PATH,
        alternative=0,
        level=0,
        nu=0.1,
        x=(0.0,),
        parameters=(0.0,),
        j_fit=0,
        j_reg=0,
        change=0,
        optimality=0,
        second_j=0,
        status="converged",
        message="",
        iterations=0,
        evaluations=0,
        jacobians=0,
        runs=0,
        seconds=0.0,
    )
    out, campaign = tmp_path / "out", small_campaign(tmp_path / "campaign", swift_fmu)
    with results_folder(out, command.NAME):
        checkpoint.Checkpoint(out, "another").record(step)
    args = arguments(str(campaign), "--out", str(out), "--resume", "--workers", "1")
    with pytest.raises(BadInput, match=checkpoint.NAME.replace(".", r"\.")):
        command.run(args)
