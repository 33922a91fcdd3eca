"""Settling and solver parameters of responses whose errors are known in closed form."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.simulate.budget import Basis
from fitting.simulate.drive import Drive
from fitting.simulate.probe import Knowledge, Probe
from fitting.simulate.settling import Settled, settle, settle_as_prescribed
from fitting.simulate.solver import coarsest_value, solver_error
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import FmuFailure
from tests.support.line_workers import LineWorkers, Output

F_HZ = 100.0
DRIVE = Drive(start_values={}, tones_hz=(F_HZ,), outputs=("x",))


def dying(width_hz: float, share: float = 1.0) -> Output:
    """A line of one, and a transient exp(-pi w t) of the same frequency."""
    return lambda t, _: np.asarray(
        np.cos(2.0 * np.pi * np.mod(F_HZ * t, 1.0)) * (1.0 + share * np.exp(-np.pi * width_hz * t))
    )


def settled(
    output: Output, wanted: float, work: float = 1e9, longest_s: float = math.inf
) -> Settled:
    probe = Probe((DRIVE,), LineWorkers({"x": output}))
    return settle(probe, {}, wanted, work, longest_s)


@pytest.mark.parametrize("width_hz", [0.3, 4.0])
@pytest.mark.parametrize("wanted", [1e-2, 1e-5, 1e-8])
def test_what_is_left_is_within_its_bound_and_no_time_is_wasted(
    width_hz: float, wanted: float
) -> None:
    found = settled(dying(width_hz), wanted)
    left = math.exp(-math.pi * width_hz * found.settle_s)
    assert found.steady
    assert 0.2 * left < found.bound  # the transient falls further during the window
    assert left <= found.bound + 1e-12
    assert found.bound <= wanted
    enough_s = math.log(1.0 / wanted) / (math.pi * width_hz)
    assert enough_s < found.settle_s < 1.6 * enough_s
    assert found.decision.basis is Basis.WATCHED
    # three digits
    assert float(f"{found.settle_s:.3g}") == found.settle_s or found.settle_s in _doublings()


def _doublings() -> list[float]:
    return [10.0 / F_HZ * 2.0**k for k in range(20)]


def test_a_response_that_is_steady_from_the_start_needs_no_time() -> None:
    found = settled(dying(1.0, 0.0), 1e-6)
    assert (found.settle_s, found.steady) == (0.0, True)
    assert found.bound == pytest.approx(0.0, abs=1e-12)
    assert found.decision.basis is Basis.STEADY
    # a transient that is small enough, likewise
    assert settled(dying(1.0, 1e-7), 1e-6).settle_s == 0.0


def test_limits_end_the_search_and_say_so() -> None:
    """With 0.05 Hz of width 1e-6 takes 88 s."""
    found = settled(dying(0.05), 1e-6, longest_s=20.0)
    assert not found.steady
    assert 10.0 <= found.settle_s <= 20.0
    assert math.exp(-math.pi * 0.05 * found.settle_s) < found.bound
    decision = found.decision
    assert decision.basis is Basis.UNSTEADY
    assert decision.numbers == {
        "settle_s": found.settle_s,
        "ended_by": "periods",
        "limit": pytest.approx(20.0 * F_HZ),
        "change": pytest.approx(0.2, abs=0.01),
    }
    # work: one tenth of a substep in a period, so ten a second, beside the few samples
    worked = settled(dying(0.05), 1e-6, 100.0)
    assert not worked.steady
    numbers = worked.decision.numbers
    assert (numbers["ended_by"], numbers["limit"]) == ("work", 100.0)
    assert worked.settle_s * 10.0 <= 100.0 < 2.0 * worked.settle_s * 10.0 + 20.0


def test_an_oscillation_that_stays_is_never_steady() -> None:
    """A free line 0.03 Hz beside the tone: its phase goes round while the amplitude stands."""
    output: Output = lambda t, _: np.asarray(  # noqa: E731
        np.cos(2.0 * np.pi * np.mod(F_HZ * t, 1.0))
        + 0.01 * np.cos(2.0 * np.pi * np.mod(100.03 * t, 1.0))
    )
    found = settled(output, 1e-4, longest_s=1e3)
    assert not found.steady
    assert found.bound > 1e-4


def test_a_time_of_the_users_own_leaves_what_is_seen() -> None:
    probe = Probe((DRIVE,), LineWorkers({"x": dying(1.0)}))
    reference = settle(probe, {}, 1e-8, 1e9)
    found = settle_as_prescribed(probe, {}, 2.0, reference)
    left = math.exp(-2.0 * math.pi)
    assert found.settle_s == 2.0
    assert left < found.bound < 2.2 * left
    assert found.steady
    decision = found.decision
    assert decision.basis is Basis.PRESCRIBED
    assert decision.forced
    assert settle_as_prescribed(probe, {}, 0.0, reference).bound >= 1.0


# --- solver parameters


def of_order(order: float, size: float) -> Output:
    """An amplitude that is off by size h^order."""

    def output(t: FloatArray, values: Mapping[str, Scalar]) -> FloatArray:
        off = size * float(values["h"]) ** order
        return np.asarray((1.0 + off) * np.cos(2.0 * np.pi * np.mod(F_HZ * t, 1.0)))

    return output


@dataclass(frozen=True)
class Knob:
    """A substep of the FMU, or a tolerance, whose error goes as the first power."""

    output: Output
    low: float = 1e-6
    high: float = 1.0
    work: float = 1e12
    is_tolerance: bool = False

    @cached_property
    def probe(self) -> Probe:
        names = AccuracyAnnotation(**{"tolerance" if self.is_tolerance else "substep": "h"})  # type: ignore[arg-type]
        limits = SimpleNamespace(min=self.low, max=self.high)
        known = Knowledge(names, {"h": limits})  # type: ignore[dict-item]
        return Probe((DRIVE,), LineWorkers({"x": self.output}), known)

    def error_at(self, value: float) -> float:
        return solver_error(self.probe, "h", {}, 0.0, value)

    def coarsest(self, first: float, share: float, settle_s: float = 0.0) -> tuple[float, float]:
        limits = {"first": first, "share": share, "work": self.work}
        return coarsest_value(self.probe, "h", {}, settle_s, **limits)


@pytest.mark.parametrize("order", [2.0, 4.0])
def test_the_error_of_a_value_is_twice_the_change_of_a_finer_one(order: float) -> None:
    found = Knob(of_order(order, 3.0)).error_at(0.1)
    change = 3.0 * 0.1**order * (1.0 - 0.5**order)
    assert found == pytest.approx(2.0 * change / (1.0 + 3.0 * 0.05**order), rel=1e-6)


def test_a_parameter_that_changes_nothing_is_told_below_zero() -> None:
    still = Knob(of_order(1.0, 0.0))
    assert still.error_at(0.1) == -1.0
    assert still.coarsest(0.1, 1e-6) == (-1.0, 0.1)


@pytest.mark.parametrize("first", [5e-3, 0.1, 0.5])
@pytest.mark.parametrize("share", [1e-3, 1e-7])
def test_the_coarsest_value_within_a_share_is_found_from_anywhere(
    first: float, share: float
) -> None:
    bound, value = Knob(of_order(4.0, 1.0)).coarsest(first, share)
    assert 0.02 * share <= bound <= share
    assert bound == pytest.approx(2.0 * value**4 * (1.0 - 1.0 / 16.0), rel=0.01)


def test_a_value_that_uses_a_good_part_of_its_share_is_kept_without_another_look() -> None:
    """Twice 0.1^4 less its sixteenth is 19 % of 1e-3: it and its half are all that is run."""
    knob = Knob(of_order(4.0, 1.0))
    bound, value = knob.coarsest(0.1, 1e-3)
    assert value == 0.1
    assert bound == pytest.approx(2.0 * 1e-4 * (15.0 / 16.0), rel=0.01)
    steps = [run.start_values["h"] for run in knob.probe.workers.asked]  # type: ignore[attr-defined]
    assert steps == [0.1, 0.05]


def test_bounds_of_the_fmu_are_kept() -> None:
    coarse = Knob(of_order(4.0, 1e-6), high=0.2).coarsest(0.5, 1e-3)
    assert coarse[1] == 0.2
    # at the least value nothing finer can be tried: twice as coarse changes by the error itself
    bound, value = Knob(of_order(1.0, 1.0), low=1e-2).coarsest(0.5, 1e-9)
    assert value == 1e-2
    assert bound == pytest.approx(2.0 * 1e-2, rel=0.02)


def test_a_value_at_which_the_model_fails_is_made_finer() -> None:
    def output(t: FloatArray, values: Mapping[str, Scalar]) -> FloatArray:
        if float(values["h"]) > 0.01:
            raise FmuFailure("too long a substep", {}, Path("test.fmu"))
        return of_order(2.0, 1.0)(t, values)

    own = Knob(output)
    assert own.error_at(0.1) == math.inf
    bound, value = own.coarsest(0.1, 1e-3)
    assert value <= 0.01
    assert bound <= 1e-3


def test_no_finer_than_runs_may_take() -> None:
    """Work goes as 1/h: 10 substeps a second at h = 0.1; the share would take many times that."""
    free = Knob(of_order(4.0, 1e4)).coarsest(0.1, 1e-6, settle_s=10.0)
    assert free[1] < 4e-3
    bound, value = Knob(of_order(4.0, 1e4), work=1000.0).coarsest(0.1, 1e-6, settle_s=10.0)
    assert 5e-3 < value < 0.1
    assert bound > 1e-6
