"""Decisions of a plan on responses whose errors are written down: each keeps what it promises."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fitting.fmu.accuracy import AccuracyAnnotation, Reduction
from fitting.fmu.runs import Run, row_times
from fitting.simulate.batch import alike
from fitting.simulate.budget import SHARES, Basis, Decision, Kind
from fitting.simulate.drive import Drive
from fitting.simulate.planner import DrivePlan, PlanOptions, plan_drives
from fitting.simulate.probe import Knowledge
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure
from tests.support.line_workers import LineWorkers, Output, line, together

F_HZ = 100.0
DRIVE = Drive(start_values={}, tones_hz=(F_HZ,), outputs=("x",))


def tone(t: FloatArray) -> FloatArray:
    return np.asarray(np.cos(2.0 * np.pi * np.mod(F_HZ * t, 1.0)))


def plan(
    output: Output,
    accuracy: float,
    options: PlanOptions | None = None,
    drive: Drive = DRIVE,
    **annotation: Any,
) -> DrivePlan:
    known = Knowledge(AccuracyAnnotation(**annotation))
    return plan_drives((drive,), accuracy, LineWorkers({"x": output}), known, options)


def only(found: DrivePlan, kind: Kind) -> Decision:
    [decision] = found.budget.of(kind)
    return decision


# --- the solver's own accuracy


def of_substep(t: FloatArray, values: Mapping[str, Scalar]) -> FloatArray:
    """Off by (h/1 ms)^4; 1/4000 s where nothing is said."""
    return np.asarray((1.0 + (float(values.get("h", 2.5e-4)) / 1e-3) ** 4) * tone(t))


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-7])
def test_a_substep_is_as_coarse_as_its_share_allows(accuracy: float) -> None:
    found = plan(of_substep, accuracy, substep="h")
    decision = only(found, Kind.SOLVER)
    step = float(found.settings["h"])
    assert decision.settings == {"h": step}
    assert (decision.basis, decision.forced, decision.taken) == (Basis.COMPARED, False, True)
    off = (step / 1e-3) ** 4
    assert off < decision.bound <= accuracy * SHARES[Kind.SOLVER]
    assert off > 0.005 * accuracy * SHARES[Kind.SOLVER]
    assert decision.bound == pytest.approx(2.0 * off * (1.0 - 1.0 / 16.0), rel=0.02)
    assert found.promised <= accuracy
    assert found.amplitudes[0][0, 0] == pytest.approx(1.0 + off)


def test_a_tolerance_of_examples_is_its_share_at_first_and_coarser_for_the_run_itself() -> None:
    """An error of a fifth of the tolerance."""
    output: Output = lambda t, v: np.asarray(  # noqa: E731
        (1.0 + 0.2 * float(v.get("tol", 1e-6))) * tone(t)
    )
    for examples in (True, False):
        found = plan(output, 1e-3, PlanOptions(examples=examples), tolerance="tol")
        share = 1e-3 * SHARES[Kind.SOLVER]
        tolerance = float(found.settings["tol"])
        decision = only(found, Kind.SOLVER)
        assert decision.bound == pytest.approx(2.0 * 0.2 * tolerance * 0.99, rel=0.01)
        assert decision.bound <= share
        assert decision.numbers["part"] == 0.01
        if examples:
            assert tolerance == pytest.approx(share)
        else:
            assert tolerance > share


def test_a_users_own_value_is_left_and_told_with_its_error() -> None:
    drive = replace(DRIVE, start_values={"h": 5e-4})
    found = plan(of_substep, 1e-4, PlanOptions(fixed=frozenset({"h"})), drive, substep="h")
    decision = only(found, Kind.SOLVER)
    assert "h" not in found.settings
    assert (decision.basis, decision.forced) == (Basis.PRESCRIBED, True)
    assert decision.settings == {"h": 5e-4}
    assert decision.bound == pytest.approx(2.0 * 0.5**4 * (15.0 / 16.0) / (1.0 + 0.25**4), rel=1e-6)
    assert found.promised > 1e-4


def test_a_parameter_without_effect_is_no_decision() -> None:
    found = plan(lambda t, _: tone(t), 1e-4, substep="h")
    assert found.budget.of(Kind.SOLVER) == ()
    assert found.settings == {}


# --- held inputs


class Staircase:
    """A response that is off by the square of 1/steps in a period of the input that is held."""

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        found = []
        for run in runs:
            assert run.input_signal is not None
            steps = 1.0 / (run.input_signal.step_s * F_HZ)
            values = (1.0 + steps**-2.0) * tone(np.array(row_times(run)))
            found.append(values[:, np.newaxis])
        return found


@pytest.mark.parametrize(("accuracy", "kept"), [(1e-2, True), (1e-3, True), (1e-7, False)])
def test_an_input_is_held_as_finely_as_its_share_asks(accuracy: float, kept: bool) -> None:
    drive = replace(DRIVE, input="b", steps_per_period=20)
    found = plan_drives((drive,), accuracy, Staircase(), Knowledge(), None)
    decision = only(found, Kind.INPUT)
    steps = int(decision.numbers["steps_per_period"])
    # steps divide the samples of a window: somewhat more than were asked for
    assert found.drives[0].steps_per_period == steps
    assert steps in (20, 40, 80, 160, 320, 640)
    assert (decision.bound <= accuracy * SHARES[Kind.INPUT]) is kept
    actual = float(found.amplitudes[0][0, 0]) - 1.0
    assert actual <= decision.bound + 1e-12
    if not kept:
        assert steps >= 320


def test_an_input_that_cannot_be_held_more_finely_is_promised_nothing() -> None:
    """At most 640 steps in a period: from 400 none is twice as many, and no change is seen."""
    drive = replace(DRIVE, input="b", steps_per_period=400)
    found = plan_drives((drive,), 1e-3, Staircase(), Knowledge(), None)
    decision = only(found, Kind.INPUT)
    assert (decision.numbers["steps_per_period"], decision.bound) == (400, math.inf)


def test_a_users_own_value_of_which_no_finer_one_runs_is_promised_nothing() -> None:
    """An error that cannot be measured has no bound."""

    def output(t: FloatArray, values: Mapping[str, Scalar]) -> FloatArray:
        if float(values.get("h", 1.0)) < 4e-4:
            raise FmuFailure("too many substeps", {}, Path("test.fmu"))
        return tone(t)

    drive = replace(DRIVE, start_values={"h": 5e-4})
    found = plan(output, 1e-4, PlanOptions(fixed=frozenset({"h"})), drive, substep="h")
    assert only(found, Kind.SOLVER).bound == math.inf
    assert not found.budget.kept
    assert not found.budget.kept


# --- combinations that fold


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6])
def test_lines_of_a_nonlinear_response_are_kept_off_the_tones(accuracy: float) -> None:
    """Harmonics up to the ninth of a tone, each a third of the one before."""
    output = together(*(line(k * F_HZ, 3.0 ** (1 - k), 0.3 * k) for k in range(1, 10)))
    found = plan(output, accuracy)
    decision = only(found, Kind.SAMPLES)
    assert abs(float(found.amplitudes[0][0, 0]) - 1.0) <= decision.bound + 1e-12
    assert decision.bound <= accuracy * SHARES[Kind.SAMPLES]
    assert found.order == decision.numbers["order"]
    assert int(decision.numbers["finer"]) > found.order
    counts = [w.samples for w in found.windows]
    assert (decision.numbers["least"], decision.numbers["most"]) == (min(counts), max(counts))


def test_a_linear_response_needs_no_more_than_its_tones() -> None:
    found = plan(lambda t, _: tone(t), 1e-6)
    assert found.order == 1
    assert only(found, Kind.SAMPLES).numbers["finer"] == 5


def test_what_folds_onto_the_tone_whatever_is_tried_is_in_the_bound() -> None:
    """Pulses: forty harmonics as strong as the tone. Each that is folded adds all of it again."""
    found = plan(together(*(line(k * F_HZ, 1.0) for k in range(1, 42))), 1e-3)
    assert found.amplitudes[0][0, 0] > 1.5
    assert only(found, Kind.SAMPLES).bound >= found.amplitudes[0][0, 0] - 1.0


def test_rounding_is_that_of_the_weakest_tone_of_all_drives() -> None:
    strong = replace(DRIVE, tones_hz=(100.0, 130.0))
    output = together(line(100.0, 1.0), line(130.0, 1e-3))
    for drives in ((DRIVE, strong), (strong, DRIVE)):
        found = plan_drives(drives, 1e-6, LineWorkers({"x": output}), Knowledge(), None)
        bounds = [reading.rounding for reading in found.readings]
        assert max(bounds) > 100.0 * min(bounds)
        decision = only(found, Kind.ROUNDING)
        assert decision.bound == max(bounds)
        assert only(found, Kind.WINDOW).subject == ""
    assert only(plan(output, 1e-6), Kind.WINDOW).subject == "100 Hz"


def test_equal_rows_are_one_run() -> None:
    """Bit for bit: groups by the first of each."""
    table = np.array([[1.0, 2.0], [3.0, 2.0], [1.0, 2.0], [1.0, 2.0 + 1e-15]])
    first, group = alike(table)
    assert sorted(first.tolist()) == [0, 1, 3]
    assert [int(first[k]) for k in group] == [0, 1, 0, 3]
    for one in (table[:1], np.empty((3, 0))):
        first, group = alike(one)
        assert first.tolist() == [0]
        assert group.tolist() == [0] * one.shape[0]


# --- reductions


def reducible(off: float, *, saves: bool = True, refuses: bool = False) -> Output:
    """A transient of 0.4 Hz, without which an approximation starts, off by some part."""

    def output(t: FloatArray, values: Mapping[str, Scalar]) -> FloatArray:
        reduced = bool(values.get("approximate", False))
        if reduced and refuses:
            raise FmuFailure("refused", {}, Path("test.fmu"))
        ringing = np.exp(-np.pi * 0.4 * t) if not (reduced and saves) else 0.0
        return np.asarray((1.0 + ringing + (off if reduced else 0.0)) * tone(t))

    return output


APPROXIMATE = Reduction("approximation", {"approximate": True}, cost=1.0)


def reduced(output: Output, accuracy: float = 1e-3, **annotation: Any) -> DrivePlan:
    return plan(output, accuracy, reductions=(APPROXIMATE,), **annotation)


def test_a_reduction_is_taken_where_its_error_fits_and_it_saves() -> None:
    """Of 1e-3 a model may use 0.3: 2e-4, twice measured with what is left of the transient, not."""
    found = reduced(reducible(5e-5))
    decision = only(found, Kind.MODEL)
    assert decision.taken
    assert found.settings == {"approximate": True}
    assert found.settle_s == 0.0
    assert decision.basis is Basis.COMPARED
    assert 2.0 * 5e-5 <= decision.bound <= 1e-3 * SHARES[Kind.MODEL]
    assert decision.numbers["left"] == pytest.approx(1e-3 * SHARES[Kind.MODEL])
    assert float(decision.numbers["times_cheaper"]) >= 1.0
    assert found.promised <= 1e-3
    assert found.amplitudes[0][0, 0] == pytest.approx(1.0 + 5e-5)


def test_a_reduction_beyond_what_is_left_is_not_taken() -> None:
    found = reduced(reducible(1e-3))
    decision = only(found, Kind.MODEL)
    assert not decision.taken
    assert found.settings == {}
    assert decision.bound >= 2e-3 * 0.99
    assert abs(float(found.amplitudes[0][0, 0]) - 1.0) <= found.promised
    assert found.settle_s > 1.0


def test_a_reduction_that_saves_nothing_is_not_taken() -> None:
    found = reduced(reducible(1e-6, saves=False))
    assert not only(found, Kind.MODEL).taken
    assert found.settings == {}


def test_reductions_are_forced_forbidden_and_refused() -> None:
    forced = reduced(reducible(0.01), force=("approximation",))
    decision = only(forced, Kind.MODEL)
    assert (decision.taken, decision.forced) == (True, True)
    assert decision.bound >= 0.02 * 0.99
    assert forced.settings == {"approximate": True}
    assert not forced.budget.kept
    forbidden = reduced(reducible(1e-6), forbid=("approximation",))
    assert only(forbidden, Kind.MODEL).basis is Basis.FORBIDDEN
    assert forbidden.settings == {}
    refused = reduced(reducible(1e-6, refuses=True))
    assert only(refused, Kind.MODEL).basis is Basis.REFUSED
    assert only(refused, Kind.MODEL).numbers["message"] == "refused"
    with pytest.raises(FmuFailure):
        reduced(reducible(1e-6, refuses=True), force=("approximation",))


def test_a_reduction_that_is_set_already_is_no_decision() -> None:
    drive = replace(DRIVE, start_values={"approximate": True})
    found = plan(reducible(1e-6), 1e-3, drive=drive, reductions=(APPROXIMATE,))
    assert found.budget.of(Kind.MODEL) == ()
    own = PlanOptions(fixed=frozenset({"approximate"}))
    assert plan(reducible(1e-6), 1e-3, own, reductions=(APPROXIMATE,)).settings == {}


def test_the_full_model_is_what_is_planned_unless_the_user_has_set_it() -> None:
    found = plan(reducible(0.5), 1e-3, full={"approximate": False})
    assert found.settings == {"approximate": False}
    own = PlanOptions(fixed=frozenset({"approximate"}))
    assert plan(reducible(0.5), 1e-3, own, full={"approximate": False}).settings == {}


STATED = Reduction("approximation", {"approximate": True}, bound="{output}_error")
#: A full model is off by the fourth power of its substep over this: 2.4e-4 at a fortieth of 10 ms.
FULL_S = 2e-3


def stated(off: float, full_s: float = FULL_S) -> LineWorkers:
    """A full model off by its substep; an approximation off by a part, that states a hundredth."""

    def output(t: FloatArray, values: Mapping[str, Scalar]) -> FloatArray:
        part = off if values.get("approximate", False) else 0.0
        return np.asarray((1.0 + (float(values.get("h", 1e-5)) / full_s) ** 4 + part) * tone(t))

    return LineWorkers({"x": output, "x_error": line(0.0, 0.01)})


def stated_plan(
    workers: LineWorkers,
    drives: tuple[Drive, ...] = (DRIVE,),
    options: PlanOptions | None = None,
) -> DrivePlan:
    variables: Any = {"x_error": SimpleNamespace(min=None, max=None)}
    known = Knowledge(AccuracyAnnotation(substep="h", reductions=(STATED,)), variables)
    return plan_drives(drives, 1e-3, workers, known, options)


def test_a_substep_of_the_users_own_is_not_refined_to_measure_a_reduction() -> None:
    drive = replace(DRIVE, start_values={"h": 1e-4})
    found = stated_plan(stated(1e-4), (drive,), PlanOptions(fixed=frozenset({"h"})))
    decision = only(found, Kind.MODEL)
    assert (decision.basis, decision.taken) == (Basis.STATED, False)
    assert decision.bound == pytest.approx(0.01)


def test_a_stated_bound_holds_for_the_weakest_tone_of_all_drives() -> None:
    """It is relative to the strongest: of the pair the other one is a tenth."""
    pair = replace(DRIVE, tones_hz=(100.0, 130.0), start_values={"second": 0.1})

    def output(t: FloatArray, values: Mapping[str, Scalar]) -> FloatArray:
        return tone(t) + float(values.get("second", 0.0)) * line(130.0, 1.0)(t, values)

    workers = LineWorkers({"x": output, "x_error": line(0.0, 1e-5)})
    for drives in ((DRIVE, pair), (pair, DRIVE)):
        decision = only(stated_plan(workers, drives), Kind.MODEL)
        assert decision.basis is Basis.STATED
        assert decision.bound == pytest.approx(1e-4)


# --- what cannot be planned


def test_what_does_not_oscillate_is_refused_with_its_value() -> None:
    with pytest.raises(BadInput, match=r"x is constant at 2\.5"):
        plan(lambda t, _: np.full(t.size, 2.5), 1e-3)
    for accuracy in (0.0, 1.0, math.nan):
        with pytest.raises(BadInput, match="accuracy"):
            plan(lambda t, _: tone(t), accuracy)


def test_a_run_that_costs_far_too_much_is_refused() -> None:
    """Ten thousand substeps a second over a window of 0.01 s are a hundred: twenty times four."""
    drive = replace(DRIVE, start_values={"h": 1e-4})
    for work, refused in ((4.0, True), (6.0, False)):
        options = PlanOptions(work=work, fixed=frozenset({"h"}))
        if refused:
            with pytest.raises(BadInput, match=r"at most 4\.0e"):
                plan(of_substep, 1e-3, options, drive, substep="h")
        else:
            assert not plan(of_substep, 1e-3, options, drive, substep="h").budget.kept


def test_windows_are_as_long_as_the_tones_of_each_drive_ask() -> None:
    """A period of 100 Hz, and of the beat of 100 and 130 Hz."""
    pair = replace(DRIVE, tones_hz=(100.0, 130.0))
    output = together(line(100.0, 1.0), line(130.0, 1.0))
    found = plan_drives((pair, DRIVE), 1e-3, LineWorkers({"x": output}), Knowledge(), None)
    numbers = only(found, Kind.WINDOW).numbers
    assert (numbers["shortest_s"], numbers["longest_s"]) == (0.01, 0.1)
    assert int(numbers["least"]) < int(numbers["most"])
