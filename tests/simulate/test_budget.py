"""Decisions and their sum; what a plan measures of FMUs that it knows nothing about."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign import bind, read_campaign
from fitting.campaign.parameters import starts
from fitting.cli.main import main
from fitting.fmu.accuracy import AccuracyAnnotation, Reduction, read_accuracy_annotation
from fitting.fmu.pool import FmuWorkers
from fitting.measurements.response_curve import ResponseCurve
from fitting.simulate.budget import Basis, Budget, Decision, Kind
from fitting.simulate.drive import Drive
from fitting.simulate.planner import DrivePlan, plan_drives
from fitting.simulate.probe import knowledge_of
from fitting.simulate.words import decision_in_words, warnings_in_words
from fitting.text.errors import BadInput
from tests.support import reference
from tests.support.cfmu_build import build_c_fmu
from tests.support.datasets import planned_with, through
from tests.support.plan_words import plan_in_words
from tests.support.scenes import STRING

PAIR = (6.94016e6, 6.94036e6)
DATA = Path(__file__).parents[2] / "data"
PERIODIC = Reduction("periodic start", {"periodic_start": True})


def test_bounds_add_up_and_the_sum_is_what_can_be_promised() -> None:
    budget = Budget(1e-4)
    seen = {"settle_s": 0.066}
    budget = budget.with_decision(
        Decision(kind=Kind.SETTLING, basis=Basis.WATCHED, bound=3e-5, numbers=seen)
    )
    budget = budget.with_decision(
        Decision(kind=Kind.MODEL, basis=Basis.STATED, bound=0.2, subject="mode", taken=False)
    )
    assert budget.promised == 3e-5
    assert budget.remaining() == pytest.approx(7e-5)
    assert budget.kept
    assert warnings_in_words(budget) == ()
    coarse = {"safety": 2.0, "part": 0.5}
    over = budget.with_decision(
        Decision(
            kind=Kind.SOLVER,
            basis=Basis.COMPARED,
            bound=2e-4,
            subject="substep",
            numbers=coarse,
            settings={"substep": 1e-6},
        )
    )
    assert over.promised == pytest.approx(2.3e-4)
    assert over.remaining() == 0.0
    assert over.of(Kind.SOLVER, "substep") == over.decisions[2:]
    budget = replace(over, decisions=(over.decisions[0], over.decisions[2]))
    assert "2.3e-04" in plan_in_words(budget)[-1]
    assert "solver (substep = 1e-06)" in warnings_in_words(budget)[0]


def test_what_is_no_decision_is_refused() -> None:
    with pytest.raises(ValueError, match="settling"):
        Decision(kind=Kind.SETTLING, basis=Basis.WATCHED, bound=-1e-3)
    with pytest.raises(ValueError, match="nan"):
        Decision(kind=Kind.SETTLING, basis=Basis.WATCHED, bound=math.nan)
    Decision(kind=Kind.MODEL, basis=Basis.STATED, bound=math.nan, taken=False)  # not known
    for accuracy in (0.0, 1.0, math.nan):
        with pytest.raises(BadInput, match="accuracy"):
            Budget(accuracy)
    one = Reduction("one", {"a": 1})
    with pytest.raises(BadInput, match=r"'two'.* one$"):
        AccuracyAnnotation(reductions=(one,), forbid=("two",))
    with pytest.raises(BadInput, match="both"):
        AccuracyAnnotation(reductions=(one,), forbid=("one",), force=("one",))
    with pytest.raises(BadInput, match=r"'two'.* none\b"):
        AccuracyAnnotation(forbid=("two",)).over(AccuracyAnnotation())


# --- reductions through the FMU ------------------------------------------------------------------


@pytest.fixture(scope="module")
def workers(swift_fmu: Path) -> Iterator[FmuWorkers]:
    with FmuWorkers(swift_fmu) as running:
        yield running


def planned(
    workers: FmuWorkers,
    accuracy: float,
    force: tuple[str, ...] = (),
    forbid: tuple[str, ...] = (),
) -> DrivePlan:
    drive = Drive(start_values={"theta": 1.9}, tones_hz=PAIR, outputs=("q1_hybrid",))
    annotation = AccuracyAnnotation(force=force, forbid=forbid)
    return plan_drives((drive,), accuracy, workers, knowledge_of(workers.description, annotation))


def test_the_fmu_says_what_may_be_left_out(workers: FmuWorkers) -> None:
    own = read_accuracy_annotation(workers.description)
    assert own.substep == "rk4_substep"
    assert own.reductions[0] == Reduction("periodic start", {"periodic_start": True}, start=True)
    assert own.reductions[1].bound == "{output}_error"


def test_a_forbidden_reduction_is_not_taken_and_listed(workers: FmuWorkers) -> None:
    plan = planned(workers, 1e-2, forbid=("periodic start", "rotating frame"))
    listed = {d.subject: d for d in plan.decisions}
    assert "periodic_start" not in plan.settings
    assert (listed["periodic start"].taken, listed["periodic start"].forced) == (False, True)
    assert "forbidden" in decision_in_words(listed["periodic start"])
    assert plan.settle_s > 0.0  # and so it has to settle


def test_a_reduction_that_saves_is_taken_where_its_bound_fits(oscillator_fmu: Path) -> None:
    others = ("periodic start", "rotating frame", "far mode quasi-static")
    with FmuWorkers(oscillator_fmu) as workers:  # in Python, where it saves most of the time
        rough, fine = (planned(workers, accuracy, forbid=others) for accuracy in (1e-2, 1e-9))
    assert rough.settings == {"other_mode": 2}  # a start at rest is then several times as fast
    assert fine.settings == {}
    listed = {d.subject: d for d in fine.decisions}
    left_out = listed["far mode left out"]
    assert not left_out.taken
    assert left_out.bound > max(1e-9, float(left_out.numbers["left"]))
    assert f"{float(left_out.numbers['left']):.1e}" in decision_in_words(left_out)


def test_a_forced_reduction_is_taken_with_a_warning(workers: FmuWorkers) -> None:
    plan = planned(workers, 1e-9, force=("far mode left out",))
    assert plan.settings["other_mode"] == 2
    assert not plan.budget.kept
    [forced] = [d for d in plan.decisions if d.subject.startswith("far mode left") and d.taken]
    assert any(text.startswith(forced.subject) for text in warnings_in_words(plan.budget))


# --- an FMU that is not ours ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "accuracy", [1e-4, *(pytest.param(x, marks=pytest.mark.nightly) for x in (1e-2, 1e-7))]
)
def test_a_foreign_fmu_is_settled_by_watching_it(accuracy: float, tmp_path: Path) -> None:
    """m x'' + c x' + k x = F cos: |X| = F/sqrt((k - m w^2)^2 + (c w)^2), from rest."""
    fmu = build_c_fmu(tmp_path)
    tones = (318.0, 322.0)
    drive = Drive(
        start_values={},
        tones_hz=tones,
        outputs=("displacement",),
        input="force",
        amplitude=2.0,
        steps_per_period=20,
    )
    with FmuWorkers(fmu) as running:
        plan = plan_drives((drive,), accuracy, running, knowledge_of(running.description))
        found = plan.read(running.run(plan.runs)[0])[:, 0]
    for tone, amplitude in zip(tones, found, strict=True):
        w = 2.0 * math.pi * tone
        truth = 2.0 / math.hypot(4e3 - 1e-3 * w * w, 2e-2 * w)
        assert abs(amplitude / truth - 1.0) <= plan.promised <= accuracy
    width = 2e-2 / 1e-3 / (2.0 * math.pi)
    needed = math.log(1.0 / accuracy) / (math.pi * width)
    assert 0.3 * needed < plan.settle_s < 4.0 * needed  # neither wasted nor too short


# --- the command line ----------------------------------------------------------------------------


def test_a_sweep_by_itself_is_planned_from_its_points(workers: FmuWorkers) -> None:
    """No drive pairs, from rest: without the settling the amplitudes would be those of a start."""
    campaign = read_campaign(DATA / "afm_sensor" / "campaign.toml")
    bound = bind(campaign, workers.description.variables)
    start = {k: v for k, v in bound.setup.start_values.items() if k != "periodic_start"}
    bound = replace(
        bound,
        setup=replace(
            bound.setup,
            start_values=start,
            steady_start=False,
            accuracy=1e-6,
            annotation=AccuracyAnnotation(reductions=(PERIODIC,), forbid=(PERIODIC.name,)),
        ),
    )
    plan = planned_with(bound, workers, workers.description.variables)
    assert 0.0 < plan.promised <= 1e-6
    assert plan.settle_s > math.log(1e6) / (math.pi * 26.0)  # the transient of a 26 Hz line
    p = starts(bound.parameters)
    values = {**start, **dict(zip(("eta_plus", "d1"), p, strict=True))}
    frequencies = np.array([30270.0, 30281.0, 30290.0])
    assert bound.sweep is not None
    model = through(workers, bound, plan, {}).models[""]
    found = np.abs(ResponseCurve(model, bound.sweep.settings).simulated(p, frequencies, workers))
    scene = replace(STRING, **{k: v for k, v in values.items() if hasattr(STRING, k)})
    truth = [float(abs(reference.phasors(scene, u)[0])) for u in frequencies]
    assert found == pytest.approx(truth, rel=plan.promised)


def test_the_plan_is_printed_and_nothing_written(
    swift_fmu: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", str(swift_fmu), "--accuracy", "1e-4", "--plan", "--verbose"]) == 0
    said = capsys.readouterr().out
    assert "settling: " in said
    assert "whole periods" in said
    assert "wanted 1.0e-04" in said.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--accuracy", "2", "--plan"], "--accuracy: found 2.0"),
        (["--plan", "--force", "magic"], "no reduction 'magic'"),
        (["--plan", "--settle=-1 ms"], "--settle"),
        (["--force", "fairy dust", "--out", "x"], "no reduction 'fairy dust'"),
        ([], "--out"),
    ],
)
def test_what_does_not_go_together_is_told(
    options: list[str], words: str, swift_fmu: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", str(swift_fmu), *options]) == 2
    assert words in capsys.readouterr().err
