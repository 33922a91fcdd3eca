"""One planner: a plan is the same whatever the clock says, and keeps what a user sets."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from fitting.fmu.accuracy import AccuracyAnnotation, Reduction
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run
from fitting.simulate.budget import Basis, Kind
from fitting.simulate.drive import Drive
from fitting.simulate.planner import PlanOptions, plan_drives
from fitting.simulate.probe import Knowledge, Probe, knowledge_of
from fitting.simulate.response import plan_drive, respond
from fitting.simulate.settling import settle
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from tests.support import reference
from tests.support.scenes import STRING

PAIR = (6.94016e6, 6.94036e6)
LEFT_OUT = "far mode left out"
AT_REST = AccuracyAnnotation(forbid=("periodic start",))


@pytest.fixture(scope="module")
def workers(swift_fmu: Path) -> Iterator[FmuWorkers]:
    with FmuWorkers(swift_fmu) as running:
        yield running


class Ringing:
    """Response y = cos 2 pi f t + exp(-t / tau) cos 2 pi f' t of a mode that is not driven.

    `substep` adds an error of its square, where the FMU has one.
    """

    def __init__(self, tau_s: float, delays_s: Sequence[float] = (0.0,)) -> None:
        self.tau_s = tau_s
        self.delays_s = itertools.cycle(delays_s)

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Outputs of each run."""
        time.sleep(next(self.delays_s))
        found = []
        for run in runs:
            t = run.settle_s + np.arange(run.samples) * run.sample_step_s
            y = np.cos(2 * np.pi * 100.0 * t)
            y += np.exp(-t / self.tau_s) * np.cos(2 * np.pi * 93.7 * t)
            step = float(run.start_values.get("substep", 0.0))
            found.append((y * (1.0 + step**2))[:, np.newaxis])
        return found


RINGING = Drive(start_values={}, tones_hz=(100.0,), outputs=("y",))
STEPPED = Knowledge(
    AccuracyAnnotation(substep="substep", reductions=(Reduction("none", {"a": 1}),))
)


def test_a_plan_is_the_same_on_a_machine_that_stalls() -> None:
    """Delays of none to 40 ms, in another order each time; a run takes microseconds by itself."""
    plans = [
        plan_drives((RINGING,), 1e-4, Ringing(0.3, delays), STEPPED).record
        for delays in ((0.0,), (0.0, 0.0, 0.04, 0.0, 0.01), (0.02, 0.0, 0.0))
    ]
    assert plans[0] == plans[1] == plans[2]
    assert plans[0].promised <= 1e-4


def test_no_clock_is_asked(workers: FmuWorkers, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = Drive(start_values={"theta": 1.9}, tones_hz=PAIR, outputs=("q1_hybrid",))
    honest = plan_drive(workers, drive, 1e-4)
    ticks = itertools.count(1.0, 17.0)
    for clock in ("perf_counter", "process_time", "time"):
        monkeypatch.setattr(time, clock, lambda: next(ticks) ** 2)
    lied_to = plan_drive(workers, drive, 1e-4)
    assert lied_to.record == honest.record
    assert lied_to.runs == honest.runs


@pytest.mark.parametrize("tau_s", [0.05, 2.0])
def test_the_time_to_settle_follows_the_transient(tau_s: float) -> None:
    """What is left of exp(-t / tau) after it is what the plan says, and it is not wasted."""
    plan = plan_drives((RINGING,), 1e-4, Ringing(tau_s), Knowledge())
    (settling,) = plan.budget.of(Kind.SETTLING)
    assert settling.basis == Basis.WATCHED
    assert math.exp(-plan.settle_s / tau_s) <= settling.bound <= 1e-4
    assert plan.settle_s < 2.0 * tau_s * math.log(1e6)
    assert float(f"{plan.settle_s:.3g}") == plan.settle_s or plan.settle_s * 1600 % 1 == 0


class Folding(Ringing):
    """The pair 100 and 125 Hz with lines at 75 and 150 Hz, and a transient exp(-t / tau).

    The lines fold onto the tones where samples are few; `longest_s` is the last time asked for.
    """

    def __init__(self, tau_s: float) -> None:
        super().__init__(tau_s)
        self.longest_s = 0.0

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Outputs of each run."""
        found = []
        for run in runs:
            t = run.settle_s + np.arange(run.samples) * run.sample_step_s
            self.longest_s = max(self.longest_s, t[-1])
            y = np.cos(2 * np.pi * 100.0 * t) + np.cos(2 * np.pi * 125.0 * t + 0.3)
            y += 0.02 * (np.cos(2 * np.pi * 75.0 * t) + np.cos(2 * np.pi * 150.0 * t + 0.9))
            y += np.exp(-t / self.tau_s) * np.cos(2 * np.pi * 93.7 * t)
            found.append(y[:, np.newaxis])
        return found


def test_lines_that_fold_onto_tones_are_not_taken_for_a_transient() -> None:
    """The 7 samples of the search have a rate of 200 Hz or so, below twice every line."""
    drive = Drive(start_values={}, tones_hz=(100.0, 125.0), outputs=("y",))
    running = Folding(0.05)
    plan = plan_drives((drive,), 1e-3, running, Knowledge())
    (settling,) = plan.budget.of(Kind.SETTLING)
    assert settling.basis == Basis.WATCHED
    assert math.exp(-plan.settle_s / 0.05) <= settling.bound <= 1e-3
    # changes stand still at 1.28 and 2.56 s: one look beyond, some 16 times later, is all there is
    assert running.longest_s < 17.0 * 2.56
    found = plan.read(running.run(plan.runs)[0])
    assert float(np.max(np.abs(found - 1.0))) <= plan.promised <= 1e-3


class Mixing(Ringing):
    """Tones without a common period, and what a strongly nonlinear response adds next to them.

    Lines k f1 - (k - 1) f2 and k f2 - (k - 1) f1 from `first` on, each `part` of the one before.
    """

    TONES = (100.0 + 1.0 / 3.0, 100.0 + math.sqrt(2.0))

    def __init__(self, first: int, part: float, tones: Sequence[float] = TONES) -> None:
        super().__init__(0.05)
        self.first, self.part, self.tones = first, part, tones

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Outputs of each run."""
        low, high = self.tones[:2]
        found = []
        for run in runs:
            t = run.settle_s + np.arange(run.samples) * run.sample_step_s
            y = np.sum([np.cos(2 * np.pi * f * t + 0.3 * f) for f in self.tones], axis=0)
            y += np.exp(-t / self.tau_s) * np.cos(2 * np.pi * 93.7 * t)
            for k in range(self.first, 60):
                size = self.part ** (k - self.first + 1)
                for a, b, phase in ((low, high, 0.4), (high, low, 1.7)):
                    y += size * np.cos(2 * np.pi * (k * a - (k - 1) * b) * t + phase)
            found.append(y[:, np.newaxis])
        return found


@pytest.mark.parametrize("first", [4, 6])
def test_two_orders_with_the_same_samples_prove_nothing(first: int) -> None:
    """Without a common period lines up to order 5 are fitted at order 1, those of 7 and 11 not."""
    drive = Drive(start_values={}, tones_hz=Mixing.TONES, outputs=("y",))
    running = Mixing(first, 0.3)
    plan = plan_drives((drive,), 1e-3, running, Knowledge())
    (samples,) = plan.budget.of(Kind.SAMPLES)
    assert plan.order > 5
    assert samples.bound <= 1e-3
    found = plan.read(running.run(plan.runs)[0])
    assert float(np.max(np.abs(found - 1.0))) <= plan.promised <= 1e-3


def test_a_linear_response_takes_the_least_order_and_few_samples() -> None:
    drive = Drive(start_values={}, tones_hz=Mixing.TONES, outputs=("y",))
    plan = plan_drives((drive,), 1e-6, Mixing(60, 0.0), Knowledge())
    (samples,) = plan.budget.of(Kind.SAMPLES)
    assert (plan.order, samples.numbers["finer"]) == (1, 11)
    assert plan.promised <= 1e-6


@pytest.mark.parametrize("part", [0.0, 0.03])
def test_where_no_other_samples_are_possible_the_residuals_bound_what_is_added(part: float) -> None:
    """Three tones without a common period: the lines of order 11 are more than can be fitted."""
    tones = (*Mixing.TONES, 107.0 + math.pi)
    drive = Drive(start_values={}, tones_hz=tones, outputs=("y",))
    with pytest.raises(BadInput):
        drive.window(1.0, 11)
    running = Mixing(4, part, tones)
    plan = plan_drives((drive,), 1e-3, running, Knowledge())
    found = plan.read(running.run(plan.runs)[0])
    assert float(np.max(np.abs(found - 1.0))) <= plan.promised
    assert plan.budget.kept == (part == 0.0)


def test_an_oscillation_in_step_with_the_doublings_is_seen() -> None:
    """Modulated at 10 Hz, the response is the same at every doubling of its ten periods."""

    class Modulated(Ringing):
        def run(self, runs: Sequence[Run]) -> list[FloatArray]:
            found = []
            for run in runs:
                t = run.settle_s + np.arange(run.samples) * run.sample_step_s
                slow = 1.0 + 0.1 * np.cos(2 * np.pi * 10.0 * t)
                found.append((slow * np.cos(2 * np.pi * 100.0 * t))[:, np.newaxis])
            return found

    plan = plan_drives((RINGING,), 1e-4, Modulated(1.0), Knowledge())
    (settling,) = plan.budget.of(Kind.SETTLING)
    assert settling.basis == Basis.UNSTEADY


@pytest.mark.parametrize(("longest_s", "basis"), [(1.6, Basis.WATCHED), (0.8, Basis.UNSTEADY)])
def test_a_time_within_the_limit_is_confirmed_beyond_it(longest_s: float, basis: Basis) -> None:
    """exp(-t / tau), tau = 0.05 s, changes by 1e-7 from 0.8 to 1.6 s, by 3e-4 from 0.4 to 0.8 s."""
    # ten periods, doubled, may be rounded otherwise than the limit is
    probe = Probe((RINGING,), Ringing(0.05))
    found = settle(probe, {}, 0.2e-4, math.inf, longest_s * (1.0 - 1e-15))
    assert found.decision.basis == basis
    assert found.settle_s <= longest_s


def test_what_takes_too_much_work_is_not_looked_at_and_said() -> None:
    options = PlanOptions(work=500.0)
    plan = plan_drives((RINGING,), 1e-4, Ringing(100.0), Knowledge(), options)
    (settling,) = plan.budget.of(Kind.SETTLING)
    assert settling.basis == Basis.UNSTEADY
    assert not plan.budget.kept
    with pytest.raises(BadInput, match="one window"):
        plan_drives((RINGING,), 1e-4, Ringing(1.0), Knowledge(), PlanOptions(work=0.1))


def test_work_is_counted_in_steps() -> None:
    """A window of 0.01 s in 5 samples after 1 s: 6 communication steps, 1.008 s of substeps."""
    named = Probe((RINGING,), Ringing(1.0), Knowledge(AccuracyAnnotation(substep="substep")))
    window = RINGING.window(1.0)
    assert window.samples == 5
    last_s = window.times_s()[-1]
    assert named.work({"substep": 1e-3}, 1.0) == pytest.approx(6 + last_s / 1e-3)
    assert named.work({}, 1.0) == pytest.approx(6 + last_s * 40 * 100.0)
    # a name that changes nothing takes no substeps; who names none is taken for compiled code
    other = Knowledge(AccuracyAnnotation(substep="other"))
    assert Probe((RINGING,), Ringing(1.0), other).work({}, 1.0) == 6
    assert Probe((RINGING,), Ringing(1.0)).work({}, 1.0) == pytest.approx(6 + last_s * 10.0)


def truth(theta: float) -> np.ndarray:
    """|X| of the first mode at both tones, 50 digits, for the FMU's own start values."""
    scene = STRING.__class__("own", theta=theta, eta_plus=6.94026e6, eta_minus=7.0276e6)
    return np.array([float(abs(reference.phasors(scene, u)[0])) for u in PAIR])


@pytest.mark.parametrize(("settle_s", "kept"), [(5e-3, False), (40e-3, True)])
def test_a_prescribed_time_to_settle_is_a_part_of_the_promise(
    settle_s: float, kept: bool, workers: FmuWorkers
) -> None:
    drive = Drive(start_values={"theta": 1.9}, tones_hz=PAIR, outputs=("q1_hybrid",))
    plan = plan_drive(workers, drive, 1e-2, settle_s=settle_s, annotation=AT_REST)
    response = respond(workers, plan)
    (settling,) = response.plan.budget.of(Kind.SETTLING)
    assert settling.forced
    assert response.plan.settle_s == settle_s
    assert response.plan.budget.kept == response.steady == kept
    error = np.max(np.abs(response.peaks[:, 0] / truth(1.9) - 1.0))
    assert error <= response.accuracy
    assert response.accuracy < 0.5


def test_what_the_user_sets_is_left_as_it_is(workers: FmuWorkers) -> None:
    values = {"theta": 1.9, "periodic_start": False, "other_mode": 1}
    plan = plan_drive(
        workers, Drive(start_values=values, tones_hz=PAIR, outputs=("q1_hybrid",)), 1e-2
    )
    assert not set(plan.settings) & set(values)
    assert plan.settle_s > 0.0
    assert LEFT_OUT not in {d.subject for d in plan.decisions}


def test_a_prescribed_substep_is_measured(swift_fmu: Path) -> None:
    """rk4 of the linear model at 100 Hz, Q = 10: 10 substeps a period are not enough for 1e-4."""
    values = {
        "solver": 2,
        "rk4_substep": 1e-3,
        "periodic_start": False,
        "d1": 10.0,
        "d2": 10.0,
        "eta_plus": 100.0,
        "eta_minus": 130.0,
        "u1": 100.0,
        "A2": 0.0,
    }
    drive = Drive(start_values=values, tones_hz=(100.0,), outputs=("q1_hybrid",))
    with FmuWorkers(swift_fmu) as native:
        plan = plan_drive(native, drive, 1e-4)
    (solver,) = plan.budget.of(Kind.SOLVER, "rk4_substep")
    assert solver.forced
    assert solver.basis == Basis.PRESCRIBED
    scene = STRING.__class__(
        "slow", theta=1.9498, d1=10.0, d2=10.0, eta_plus=100.0, eta_minus=130.0
    )
    wanted = float(abs(reference.phasors(scene, 100.0)[0]))
    error = abs(plan.amplitudes[0][0, 0] / wanted - 1.0)
    assert 1e-4 < error <= plan.promised


def test_hints_of_the_fmu_that_do_not_exist_are_refused(workers: FmuWorkers) -> None:
    with pytest.raises(BadInput, match="'stride'"):
        knowledge_of(workers.description, AccuracyAnnotation(substep="stride"))
