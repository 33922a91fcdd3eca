"""How long a response settles: transients that are written down."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from fitting.simulate.drive import Drive
from fitting.simulate.probe import Probe
from fitting.simulate.settling import Limits, settle, settle_as_prescribed, settling_s
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


def test_settling_leaves_what_was_asked_for() -> None:
    settle = settling_s(50.0, 1e-7)
    assert math.exp(-math.pi * 25.0 * settle) == pytest.approx(1e-7, rel=1e-9)
    with pytest.raises(ValueError, match="line width"):
        settling_s(0.0, 1e-7)


@pytest.mark.parametrize(("tau_s", "wanted"), [(0.2, 1e-4), (0.2, 1e-2), (2.0, 1e-4), (30.0, 1e-4)])
def test_a_transient_is_given_the_time_that_it_takes_and_little_more(
    tau_s: float, wanted: float
) -> None:
    """exp(-t/tau) is 0.3 of what is wanted at t = tau ln(1/(0.3 wanted)): three digits, upwards.

    The times tried are 0.1 s, 0.2 s, ...: the time is found between two of them.
    """
    found = settle(dying_away(tau_s), {}, wanted, Limits(math.inf))
    enough_s = tau_s * math.log(1.0 / (0.3 * wanted))
    assert found.steady
    assert 0.98 * enough_s < found.settle_s < 1.02 * enough_s
    assert float(f"{found.settle_s:.3g}") == found.settle_s
    assert math.exp(-found.settle_s / tau_s) < found.bound <= 1.5 * wanted


def test_a_time_tried_that_nearly_does_is_kept_as_it_is() -> None:
    """tau = 0.3 s: 3.12 s would do for 1e-4, and 3.2 s were tried."""
    found = settle(dying_away(0.3), {}, 1e-4, Limits(math.inf))
    assert found.settle_s == pytest.approx(3.2)


def test_what_a_users_own_time_leaves_is_told() -> None:
    """exp(-0.5/0.2) = 0.082 and with a margin of two; never more than all of it."""
    probe = dying_away(0.2)
    reference = settle(probe, {}, 1e-4, Limits(math.inf))
    early = settle_as_prescribed(probe, {}, 0.5, reference)
    assert (early.settle_s, early.prescribed) == (0.5, True)
    assert early.bound == pytest.approx(2.0 * math.exp(-2.5), rel=0.05)
    assert settle_as_prescribed(probe, {}, 0.0, reference).bound == 1.0
