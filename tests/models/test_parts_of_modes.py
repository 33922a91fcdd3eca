"""What N modes are made of, outside of any FMU: matrices, propagators, start values by referees."""

from __future__ import annotations

import math
from decimal import Decimal
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from fmu_src.coupled_oscillator import CoupledOscillator
from fmu_src.modes_matrices import (
    applied,
    eigensystem,
    frobenius,
    inverse,
    length,
    product,
    solve_precise,
)
from fmu_src.modes_motion import Generator, PeriodTable, Propagator, PumpedPropagator
from fmu_src.oscillator_precise import Precise, in_precise_arithmetic
from fmu_src.start_values import BuildError, checked_start_values
from fmu_src.variables import Variable


def matrix(n: int, seed: int = 8) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((n, n))


def complex_matrix(n: int, seed: int = 8) -> np.ndarray:
    return np.asarray(matrix(n, seed) + 1j * matrix(n, seed + 1))


@pytest.mark.parametrize("n", [1, 2, 5])
def test_small_matrices_are_those_of_numpy(n: int) -> None:
    a, b, x = complex_matrix(n), complex_matrix(n, 3), complex_matrix(n, 5)[0]
    assert np.array(inverse(a.tolist())) == pytest.approx(np.linalg.inv(a), rel=1e-9)
    assert np.array(product(a.tolist(), b.tolist())) == pytest.approx(a @ b)
    assert applied(a.tolist(), x.tolist()) == pytest.approx((a @ x).tolist())
    assert frobenius(a.tolist()) == pytest.approx(np.linalg.norm(a))
    assert length(x.tolist()) == pytest.approx(np.linalg.norm(x))


def test_a_matrix_with_a_zero_on_its_diagonal_is_turned_round() -> None:
    turned = np.array([[0.0, 2.0, 0.0], [1e-300, 1.0, 1.0], [3.0, 0.0, 0.0]])
    assert np.array(inverse(turned.tolist())) @ turned == pytest.approx(np.eye(3), abs=1e-9)
    with pytest.raises(ZeroDivisionError):
        inverse([[1.0, 2.0], [2.0, 4.0]])


@pytest.mark.parametrize("n", [1, 2, 4])
def test_precise_solutions_have_forty_digits(n: int) -> None:
    a, b = complex_matrix(n), complex_matrix(n, 3)[0]
    with in_precise_arithmetic():
        rows = [[Precise(x.real, x.imag) for x in row] for row in a.tolist()]
        found = solve_precise(rows, [Precise(x.real, x.imag) for x in b.tolist()])
        parts = [(str(x.re), str(x.im)) for x in found]
        with pytest.raises(ZeroDivisionError):
            solve_precise([[Precise(0.0)]], [Precise(1.0)])
    with mp.workdps(60):
        truth = mp.lu_solve(mp.matrix(a.tolist()), mp.matrix(b.tolist()))
        for (re, im), wanted in zip(parts, truth, strict=True):
            assert abs(mp.mpc(re, im) - wanted) < mp.mpf(10) ** -40 * abs(wanted)


@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_eigenvalues_rise_and_vectors_are_orthonormal(n: int) -> None:
    a = matrix(n) + matrix(n).T
    values, vectors = eigensystem(a.tolist())
    assert values == pytest.approx(np.linalg.eigvalsh(a).tolist(), rel=1e-9)
    v = np.array(vectors)
    assert v.T @ v == pytest.approx(np.eye(n), abs=1e-12)
    assert v.T @ a @ v == pytest.approx(np.diag(values), abs=1e-12)
    assert all(column[int(np.argmax(np.abs(column)))] > 0.0 for column in v.T)


def test_small_eigenvalues_of_a_scaled_matrix_keep_their_digits() -> None:
    """D B D with D = (1, 1e-8): the smaller one is det/(larger one)."""
    values, _ = eigensystem([[2.0, 1e-8], [1e-8, 2e-16]])
    assert values[0] == pytest.approx(3e-16 / 2.0, rel=1e-9)


# --- motion


def decimals(a: np.ndarray) -> list[list[Decimal]]:
    return [[Decimal(x) for x in row] for row in a.tolist()]


@pytest.mark.parametrize("t", [1e-6, 0.03, 0.7, 12.0, 0.0])
def test_a_propagator_is_the_exponential_to_more_than_forty_digits(t: float) -> None:
    a = matrix(4) - 2.0 * np.eye(4)
    y = matrix(4, 9)[0]
    with in_precise_arithmetic():
        moved = Propagator(decimals(a)).moved([Decimal(x) for x in y.tolist()], Decimal(t))
        digits = [str(x) for x in moved]
    with mp.workdps(60):
        flow = mp.expm(2 * mp.pi * mp.mpf(t) * mp.matrix(a.tolist()), method="taylor")
        truth = flow * mp.matrix(y.tolist())
        size = mp.norm(truth)
        assert all(
            abs(mp.mpf(d) - x) < mp.mpf(10) ** -42 * size
            for d, x in zip(digits, truth, strict=True)
        )


def test_steps_that_nearly_recur_share_a_propagator_and_lose_nothing() -> None:
    a = matrix(2) - 2.0 * np.eye(2)
    y = np.array([1.0, -0.5])
    with in_precise_arithmetic():
        kept = Propagator(decimals(a))
        for t in (0.2, 0.2 + 1e-5, 0.2 - 1e-5, 0.5, 0.9, 1.3, 1.7, 0.2):
            moved = kept.moved([Decimal(x) for x in y.tolist()], Decimal(t))
            assert list(map(float, moved)) == pytest.approx(
                (expm(2.0 * np.pi * t * a) @ y).tolist(), rel=1e-9
            )
            assert len(kept._known) <= 4


def pumped(still: np.ndarray, depth: np.ndarray, pump_hz: float) -> PumpedPropagator:
    made = Generator(decimals(still), decimals(depth), Decimal(1))
    return PumpedPropagator(made, pump_hz, float(np.max(np.abs(np.linalg.eigvals(still)))))


STILL = np.array([[0.0, 1.3], [-1.3, -0.1]])
DEPTH = np.array([[0.0, 0.1], [-0.6, 0.0]])


def integrated(y: np.ndarray, span: float, psi: float, pump_hz: float) -> np.ndarray:
    """By scipy's Runge-Kutta of order 8."""
    found = solve_ivp(
        lambda t, y: 2 * np.pi * (STILL + DEPTH * np.cos(psi + 2 * np.pi * pump_hz * t)) @ y,
        (0.0, span),
        y,
        method="DOP853",
        rtol=1e-12,
        atol=1e-14,
    )
    return np.asarray(found.y[:, -1])


@pytest.mark.parametrize("pump_hz", [0.3, 2.6, 40.0])
@pytest.mark.parametrize("psi", [0.0, 1.1, -2.5])
def test_pumped_motion_is_what_scipy_integrates(pump_hz: float, psi: float) -> None:
    y = np.array([0.7, -0.4])
    for span in (0.01, 0.37, 2.0 / max(1.0, pump_hz)):
        found = pumped(STILL, DEPTH, pump_hz).moved(y.tolist(), span, psi)
        wanted = integrated(y, span, psi, pump_hz)
        assert found == pytest.approx(wanted.tolist(), abs=1e-9 * float(np.max(np.abs(wanted))))


@pytest.mark.parametrize("pump_hz", [0.3, 2.6])
def test_periods_of_the_pump_are_powers_of_one(pump_hz: float) -> None:
    y = np.array([0.7, -0.4])
    flow = pumped(STILL, DEPTH, pump_hz)
    table = PeriodTable(flow, 2)
    one = np.array(table.period)
    columns = [integrated(e, 1.0 / pump_hz, 0.0, pump_hz) for e in np.eye(2)]
    assert one == pytest.approx(np.array(columns).T, abs=1e-8 * np.max(np.abs(columns)))
    for periods in (0, 1, 2, 7):
        for fraction in (0.0, 0.24, 0.5, 0.999999, 1.0):
            found = table.after(y.tolist(), periods, fraction)
            begun = np.linalg.matrix_power(one, periods) @ y
            wanted = np.array(flow.moved(begun.tolist(), fraction / pump_hz, 0.0))
            assert found == pytest.approx(wanted.tolist(), abs=1e-9 * np.max(np.abs(wanted)))


# --- start values


class Model:
    """A table of variables of every kind."""

    variables = (
        Variable(
            "r", "Real", "parameter", "tunable", "one", 1, unit="Hz", minimum=0.5, maximum=2.5
        ),
        Variable("free", "Real", "parameter", "tunable", "one", 1),
        Variable("i", "Integer", "parameter", "tunable", "one", 1),
        Variable("b", "Boolean", "parameter", "tunable", "one", 1),
        Variable("s", "String", "parameter", "tunable", "one", 1),
        Variable("x", "Real", "output", "tunable", "one", 1),
        Variable("u", "Real", "input", "tunable", "one", 1),
    )


def checked(**given: Any) -> dict[str, Any]:
    return dict(checked_start_values(Model, given))  # type: ignore[arg-type]


def test_start_values_take_the_type_of_their_variable() -> None:
    found = checked(s="2", r="0.5", i="-7", b="TRUE", free=3)
    assert found == {"b": True, "free": 3.0, "i": -7, "r": 0.5, "s": "2"}
    assert [type(v) for v in found.values()] == [bool, float, int, float, str]
    assert list(found) == sorted(found)
    assert checked(b=False) == {"b": False}
    assert checked(r=2.5) == {"r": 2.5}
    assert checked(i=2**31 - 1) == {"i": 2**31 - 1}
    assert checked(i=-(2**31)) == {"i": -(2**31)}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"r": 0.4999}, "r = 0.4999 Hz: wanted is at least 0.5 Hz"),
        ({"r": 2.5001}, "r = 2.5001 Hz: wanted is at most 2.5 Hz"),
        ({"r": math.inf}, "wanted is a finite number"),
        ({"r": "nan"}, "wanted is a finite number"),
        ({"r": True}, "wanted is a finite number"),
        ({"r": "one"}, "wanted is a finite number"),
        ({"i": 2**31}, "wanted is a whole number of 32 bits"),
        ({"i": -(2**31) - 1}, "wanted is a whole number of 32 bits"),
        ({"i": 1.0}, "wanted is a whole number of 32 bits"),
        ({"i": "1.5"}, "wanted is a whole number of 32 bits"),
        ({"i": False}, "wanted is a whole number of 32 bits"),
        ({"b": 1}, "wanted is true or false"),
        ({"b": "yes"}, "wanted is true or false"),
        ({"s": 1}, "wanted is text"),
        ({"x": 1.0}, "x is not a parameter, it is an output"),
        ({"u": 1.0}, "u is not a parameter, it is an input"),
        ({"nothing": 1.0}, "Model has no variable 'nothing'"),
    ],
)
def test_what_is_no_start_value_is_refused_in_a_sentence(given: dict[str, Any], words: str) -> None:
    with pytest.raises(BuildError, match=words):
        checked(**given)


def test_a_table_of_the_shipped_model_is_checked_alike() -> None:
    assert checked_start_values(CoupledOscillator, {"d1": "94"}) == {"d1": 94.0}
