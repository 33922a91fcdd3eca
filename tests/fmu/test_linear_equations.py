"""Equations of model exchange that are linear, told from those that are not."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from fitting.fmu.worker.linear_equations import linear_equations

MATRIX = np.array([[0.0, 1.0], [-4e6, -20.0]])


def linear(x: np.ndarray, u: float) -> np.ndarray:
    rate: np.ndarray = MATRIX @ x + np.array([0.0, 1e3 * u - 9.81])
    return rate


def test_linear_equations_are_found() -> None:
    found = linear_equations(linear, np.ones(2), driven=True)
    assert found is not None
    assert found.matrix == pytest.approx(MATRIX, rel=1e-12)
    assert found.drive == pytest.approx([0.0, 1e3], rel=1e-12)
    assert found.constant == pytest.approx([0.0, -9.81], rel=1e-12)
    assert found.fastest_hz == pytest.approx(math.sqrt(4e6 - 100.0) / (2.0 * math.pi), rel=1e-12)


@pytest.mark.parametrize(
    "force",
    [
        lambda x, u: 1e-3 * x[0] ** 3,
        lambda x, u: 1e3 * np.clip(x[0], -1e-6, 1e-6),
        lambda x, u: 1e3 * max(abs(x[0]) - 0.1, 0.0),
        lambda x, u: 1e-4 * x[1] * abs(x[1]),
        lambda x, u: 1e-3 * u * x[0],
        lambda x, u: np.sign(x[1]),
    ],
    ids=["cubic", "limit", "gap", "drag", "modulation", "friction"],
)
def test_what_is_not_linear_everywhere_is_not_taken_for_it(force: object) -> None:
    def rate(x: np.ndarray, u: float) -> np.ndarray:
        return linear(x, u) + np.array([0.0, force(x, u)])  # type: ignore[operator]

    assert linear_equations(rate, np.ones(2), driven=True) is None


def test_rounding_is_no_constant_force() -> None:
    """Learnt at rest at 1 mm, where -4000 is off by 5e-13: at x = 0 that would be all there is."""

    def spring(x: np.ndarray, u: float) -> np.ndarray:
        return np.array([x[1], -4e6 * x[0]])

    found = linear_equations(spring, np.ones(2), driven=False)
    assert found is not None
    x = np.array([1e-3, 2.0])
    anew = found.with_constant(spring(x, 0.0) * (1.0 + 2e-16), x, 0.0)
    still = np.array([-5.7e-17, 2.0])
    assert anew.describe(spring(still, 0.0), still, 0.0)
    pushed = found.with_constant(spring(x, 0.0) - np.array([0.0, 9.81]), x, 0.0)
    assert pushed.constant == pytest.approx([0.0, -9.81], rel=1e-12)


def test_a_state_that_is_refused_is_no_number() -> None:
    with np.errstate(divide="ignore", invalid="ignore"):
        assert linear_equations(lambda x, u: np.log(x), np.ones(2), driven=False) is None


@pytest.mark.parametrize("step_s", [1e-6, 3e-4, 0.2])
def test_motion_under_tones_is_that_of_fifty_digits(step_s: float) -> None:
    """x(t + h) of two tones and a weight, against a matrix exponential of mpmath."""
    found = linear_equations(linear, np.ones(2), driven=True)
    assert found is not None
    tones = ((318.0, 1.0, 0.3), (25.0, 0.2, -1.0))
    by = found.propagator(step_s, tones)
    x = found.moved(by, np.array([1e-4, 0.2]), [0.3, -1.0])
    with mpmath.workdps(50):
        whole = mpmath.zeros(7, 7)
        whole[0, 1], whole[1, 0], whole[1, 1], whole[1, 6] = 1, -4000000, -20, mpmath.mpf("-9.81")
        for k, (f, a, _) in enumerate(tones):
            w = 2 * mpmath.pi * f
            whole[1, 2 + 2 * k] = 1000 * mpmath.mpf(a)
            whole[2 + 2 * k, 3 + 2 * k], whole[3 + 2 * k, 2 + 2 * k] = -w, w
        begun = [1e-4, 0.2, *(g(p) for _, _, p in tones for g in (mpmath.cos, mpmath.sin)), 1]
        truth = mpmath.expm(whole * mpmath.mpf(step_s)) * mpmath.matrix(begun)
    size = [abs(float(truth[0])) + float(abs(truth[1])) / 2e3, 0.2 + abs(float(truth[1]))]
    assert abs(x[0] - float(truth[0])) <= 1e-11 * size[0]
    assert abs(x[1] - float(truth[1])) <= 1e-11 * size[1]
