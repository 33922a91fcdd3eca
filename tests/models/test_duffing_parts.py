"""The parts of the Duffing oscillator's solvers, each against an independent calculation."""

from __future__ import annotations

import cmath
import math
from itertools import pairwise

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmu_src.duffing_envelope import EnvelopeSolver, Settings
from fmu_src.duffing_equations import Cubic, find_root, solve, steady_squares
from fmu_src.duffing_exponential import phi
from fmu_src.duffing_rk4 import DuffingRungeKutta
from fmu_src.duffing_slow import SlowModel
from fmu_src.oscillator_equations import Parameters

STRING = Parameters(
    theta=1.9,
    reflection=False,
    d1=5.0,
    d2=3.0,
    eta_plus=1000.0,
    eta_minus=1050.0,
    u1=1003.0,
    u2=1000.0,
    A1=2e5,
    A2=0.0,
    phase1=0.4,
    phase2=0.0,
    g1=1.0,
    g2=0.7,
)
CUBIC = Cubic(3e5, -2e5, 1.5e5)
OMEGA = 2 * math.pi * STRING.u1

amplitudes = st.complex_numbers(max_magnitude=1.0, allow_nan=False, allow_infinity=False)


def harmonic(values: np.ndarray, order: int) -> complex:
    return complex(2.0 / len(values) * np.fft.fft(values)[order])


@given(q1=amplitudes, q2=amplitudes)
def test_forces_are_the_fourier_components_of_the_cubes(q1: complex, q2: complex) -> None:
    """q = Re(Q e^i phi + R e^3i phi) cubed and projected, R from its own equation of motion.

    What the code leaves out is of second order in R/Q, about 1e-3 here.
    """
    alpha1, alpha2, kappa = CUBIC
    turns = np.exp(2j * np.pi * np.arange(32) / 32)

    def force(q: list[np.ndarray]) -> list[np.ndarray]:
        a, b = q
        return [alpha1 * a**3 + kappa * a * b**2, alpha2 * b**3 + kappa * a**2 * b]

    first = [(q * turns).real for q in (q1, q2)]
    thirds = []
    for f, eta, width in zip(force(first), (1000.0, 1050.0), widths(), strict=True):
        lossless = (2 * np.pi * eta) ** 2 - 9 * OMEGA**2
        thirds.append(-harmonic(f, 3) / (lossless + 6j * np.pi * OMEGA * width))
    both = [q + (r * turns**3).real for q, r in zip(first, thirds, strict=True)]
    wanted = [harmonic(f, 1) for f in force(both)]
    found = SlowModel(STRING, CUBIC, (0.0, 0.0)).forces(q1, q2)
    size = max(abs(q1), abs(q2)) ** 3 * 3e5
    ratio = max(abs(q1), abs(q2)) ** 2 * 1e-3
    for a, b in zip(found, wanted, strict=True):
        assert abs(a - b) <= (10 * ratio**2 + 1e-14) * size + 1e-300


def widths() -> tuple[float, float]:
    c, s = math.cos(STRING.theta) ** 2, math.sin(STRING.theta) ** 2
    return c * STRING.d1 + s * STRING.d2, s * STRING.d1 + c * STRING.d2


def test_the_state_of_an_orbit_is_displacement_and_its_derivative() -> None:
    """Velocities, third harmonics included, by differences over a millionth of a period."""
    solver = EnvelopeSolver(STRING, CUBIC, Settings(1e-8, False))
    solver.start(0.0, None, 0.0)
    largest = np.zeros(2)
    worst = np.zeros(2)
    for t in np.linspace(0.0, 1e-3, 41):
        state = solver.model.full_state(solver._slow(0.0), t)
        w = solver._slow(0.0)
        q = [
            solver.model.displacement(solver.model.amplitudes(w, solver.model.linear(s)), s)
            for s in (t - 1e-7, t, t + 1e-7)
        ]
        assert (state[0].real, state[1].real) == pytest.approx(q[1], rel=1e-9, abs=1e-9)
        speeds = (np.array(q[2]) - np.array(q[0])) / 2e-7
        found = 2 * math.pi * np.array([state[2].real, state[3].real])
        worst = np.maximum(worst, np.abs(found - speeds))
        largest = np.maximum(largest, np.abs(speeds))
    (shift,) = {solver.squares(0.0)[0] * 0.375 * 3e5 / OMEGA**2}
    assert 1e-3 < shift < 1e-2
    assert (worst / largest).max() < 10 * shift**2


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_slow_and_full_state_are_inverse(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = SlowModel(STRING, CUBIC, (0.3, 0.0))
    state = tuple(complex(x) for x in rng.normal(size=4) * [1.0, 1.0, 1000.0, 1000.0])
    back = model.full_state(model.slow_state(state, 0.123), 0.123)  # type: ignore[arg-type]
    scale = [1.0, 1.0, 1000.0, 1000.0]
    for a, b, size in zip(back, state, scale, strict=True):
        assert abs(a - b) <= 1e-9 * size


def test_the_orbit_of_rk4_closes_after_a_period() -> None:
    solver = DuffingRungeKutta(STRING, CUBIC, Settings(1e-6, False), 0.0)
    solver.start(0.0, None, 0.0)
    begin = np.array(solver._y)
    for k in range(1, 51):
        solver.advance(k / STRING.u1)
    size = np.abs(begin[:2]).max() * np.array([1.0, 1.0, OMEGA, OMEGA])
    assert np.abs((np.array(solver._y) - begin) / size).max() < 1e-9


@given(
    s=st.floats(-30.0, 10.0),
    loss=st.floats(1e-3, 1e3),
    alpha=st.floats(1e-6, 1e6) | st.floats(-1e6, -1e-6),
    drive=st.floats(1e-6, 1e6),
)
def test_steady_amplitudes_are_roots_of_the_cubic(
    s: float, loss: float, alpha: float, drive: float
) -> None:
    detuning = s * loss
    low, high = steady_squares(detuning, loss, alpha, drive)
    # in units in which the cubic's outer coefficients are 1 and -1
    unit = (drive / (0.75 * abs(alpha))) ** (2.0 / 3.0)
    delta = detuning / (0.75 * alpha * unit)
    square = (detuning**2 + loss**2) / (0.75 * alpha * unit) ** 2
    roots = np.roots([1.0, 2.0 * delta, square, -1.0])
    real = sorted(unit * r.real for r in roots if abs(r.imag) < 1e-6 * abs(r))
    apart = all(b - a > 1e-3 * b for a, b in pairwise(real))
    if apart and np.abs(roots).max() < 1e4 * np.abs(roots).min():  # else digits are lost in these
        assert (low, high) == pytest.approx((real[0], real[-1]), rel=1e-6)


def test_no_drive_and_no_cubic_term_are_plain_cases() -> None:
    assert steady_squares(-3.0, 1.0, 2.0, 0.0) == (0.0, 0.0)
    low, high = steady_squares(3.0, 4.0, 0.0, 10.0)
    assert low == high == pytest.approx(4.0, rel=1e-15)


@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 5))
def test_linear_equations_and_the_sign_of_their_determinant(seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, right = rng.normal(size=(size, size)), rng.normal(size=size)
    x, sign = solve(matrix.tolist(), right.tolist())
    assert matrix @ x == pytest.approx(right, rel=1e-8, abs=1e-8)
    assert sign == np.sign(np.linalg.det(matrix))


def test_a_saddle_is_not_taken_for_an_orbit() -> None:
    """x^2 = 1 moving as x' = x^2 - 1, y' = -y: stable at -1, a saddle at +1."""

    def motion(x: list[float]) -> list[float]:
        return [x[0] ** 2 - 1.0, -x[1]]

    assert find_root(motion, [-0.7, 0.2], [1.0, 1.0]) == pytest.approx([-1.0, 0.0], abs=1e-12)
    assert find_root(motion, [1.3, 0.2], [1.0, 1.0]) is None
    assert find_root(lambda x: [x[0] ** 2 + 1.0, -x[1]], [0.3, 0.1], [1.0, 1.0]) is None


@given(size=st.floats(-9.0, 2.3), angle=st.floats(-math.pi, math.pi))
def test_phi_functions_of_any_size(size: float, angle: float) -> None:
    z = cmath.rect(10.0**size, angle)
    with mp.workdps(60):
        wanted = [mp.exp(mp.mpc(z))]
        for k in range(3):
            wanted.append((wanted[-1] - 1 / mp.factorial(k)) / mp.mpc(z))
        for a, b in zip(phi(z), wanted, strict=True):
            assert abs(a - b) <= 1e-13 * max(abs(b), abs(wanted[0]) * 1e-3)
