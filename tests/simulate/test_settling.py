"""How long a response settles: transients that are written down."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from fitting.simulate.drive import Drive
from fitting.simulate.probe import Probe
from fitting.simulate.settling import settle, settle_as_prescribed
from fitting.text.arrays import FloatArray, Scalar
from tests.support.line_workers import LineWorkers

F_HZ = 100.0


def dying_away(tau_s: float) -> Probe:
    """A tone of 100 Hz whose amplitude is 1 + exp(-t/tau)."""

    def output(t: FloatArray, _: Mapping[str, Scalar]) -> FloatArray:
        tone = np.cos(2.0 * np.pi * np.mod(F_HZ * t, 1.0))
        return np.asarray((1.0 + np.exp(-t / tau_s)) * tone)

    drive = Drive(start_values={}, tones_hz=(F_HZ,), outputs=("x",))
    return Probe((drive,), LineWorkers({"x": output}))


@pytest.mark.parametrize(("tau_s", "wanted"), [(0.2, 1e-4), (0.2, 1e-2), (2.0, 1e-4), (30.0, 1e-4)])
def test_a_transient_is_given_the_time_that_it_takes_and_little_more(
    tau_s: float, wanted: float
) -> None:
    """exp(-t/tau) is 0.3 of what is wanted at t = tau ln(1/(0.3 wanted)): three digits, upwards.

    The times tried are 0.1 s, 0.2 s, ...: the time is found between two of them.
    """
    found = settle(dying_away(tau_s), {}, wanted, math.inf)
    enough_s = tau_s * math.log(1.0 / (0.3 * wanted))
    assert found.steady
    assert 0.98 * enough_s < found.settle_s < 1.02 * enough_s
    assert float(f"{found.settle_s:.3g}") == found.settle_s
    assert math.exp(-found.settle_s / tau_s) < found.bound <= 1.5 * wanted


@pytest.mark.parametrize(("tau_s", "settle_s"), [(0.3, 3.2), (0.1504, 1.6)])
def test_a_time_tried_that_nearly_does_is_kept_as_it_is(tau_s: float, settle_s: float) -> None:
    """3.12 s and 1.57 s would do for 1e-4: what is left at the time tried, twice, is the bound."""
    found = settle(dying_away(tau_s), {}, 1e-4, math.inf)
    assert found.settle_s == pytest.approx(settle_s)
    assert found.bound == pytest.approx(2.0 * math.exp(-settle_s / tau_s), rel=0.05)


@pytest.mark.parametrize(("tau_s", "is_bounded"), [(0.2, True), (2.0, False), (-0.05, False)])
def test_a_bound_is_given_only_where_changes_die_away(tau_s: float, is_bounded: bool) -> None:
    """After 1.6 s of tau 0.2 s they fall twice in a row; of 2 s, and of growth, they do not."""
    found = settle(dying_away(tau_s), {}, 1e-9, math.inf, 1.6)
    assert not found.steady
    assert found.settle_s == pytest.approx(1.6)
    if is_bounded:
        assert math.exp(-1.6 / tau_s) < found.bound < 0.1
    else:
        assert found.bound == math.inf


def test_the_first_time_tried_is_ten_periods_of_the_fastest_drive() -> None:
    """Of 1 kHz beside 100 Hz: 10 ms, 20 ms, of which the second is after an onset of 15 ms."""

    def output(t: FloatArray, values: Mapping[str, Scalar]) -> FloatArray:
        tone = np.cos(2.0 * np.pi * np.mod(float(values["f"]) * t, 1.0))
        return np.asarray(np.where(t < 0.015, 2.0, 1.0) * tone)

    drives = tuple(
        Drive(start_values={"f": f}, tones_hz=(f,), outputs=("x",)) for f in (100.0, 1000.0)
    )
    found = settle(Probe(drives, LineWorkers({"x": output})), {}, 1e-3, math.inf)
    assert found.steady
    assert found.settle_s == pytest.approx(0.02)


def test_what_a_users_own_time_leaves_is_told() -> None:
    """exp(-0.5/0.2) = 0.082 and with a margin of two."""
    probe = dying_away(0.2)
    reference = settle(probe, {}, 1e-4, math.inf)
    early = settle_as_prescribed(probe, {}, 0.5, reference)
    assert (early.settle_s, early.decision.forced) == (0.5, True)
    assert early.bound == pytest.approx(2.0 * math.exp(-2.5), rel=0.05)
    assert settle_as_prescribed(probe, {}, 0.0, reference).bound == pytest.approx(2.0, rel=0.05)
