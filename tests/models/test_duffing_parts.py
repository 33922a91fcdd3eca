"""The parts of the Duffing oscillator's solvers, each against an independent calculation."""

from __future__ import annotations

import cmath
import math
from itertools import pairwise
from types import SimpleNamespace

import mpmath as mp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fmu_src import duffing_exponential as exponential
from fmu_src.duffing_envelope import EnvelopeSolver, Settings
from fmu_src.duffing_equations import Cubic, find_root, shift, solve, steady_squares
from fmu_src.duffing_exponential import phi, take_step, weights
from fmu_src.duffing_orbit import averaged_orbit
from fmu_src.duffing_rk4 import DuffingRungeKutta
from fmu_src.duffing_slow import SlowModel
from fmu_src.model_error import ModelError
from fmu_src.oscillator_equations import Parameters
from tests.support import duffing_reference

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
@example(q1=0.03125 + 0j, q2=0.03125 + 0j)  # without the damping across the modes: too much
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
    w11, w12, w22 = widths()
    omega = 3.0 * OMEGA
    stiff = [(2 * np.pi * eta) ** 2 - omega**2 for eta in (1000.0, 1050.0)]
    damped = 2j * np.pi * omega * np.array([[w11, w12], [w12, w22]])
    thirds = np.linalg.solve(np.diag(stiff) + damped, [-harmonic(f, 3) for f in force(first)])
    both = [q + (r * turns**3).real for q, r in zip(first, thirds, strict=True)]
    wanted = [harmonic(f, 1) for f in force(both)]
    found = SlowModel(STRING, CUBIC, (0.0, 0.0)).forces(q1, q2)
    size = max(abs(q1), abs(q2)) ** 3 * 3e5
    ratio = max(abs(q1), abs(q2)) ** 2 * 1e-3
    for a, b in zip(found, wanted, strict=True):
        assert abs(a - b) <= (10 * ratio**2 + 1e-14) * size + 1e-300


def widths() -> tuple[float, float, float]:
    """Return the damping of the modes in Hz, w11, w12 and w22."""
    c, s = math.cos(STRING.theta), math.sin(STRING.theta)
    d1, d2 = STRING.d1, STRING.d2
    return c * c * d1 + s * s * d2, c * s * (d1 - d2), s * s * d1 + c * c * d2


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
    assert np.max(worst / largest) < 10 * shift**2


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


# --- the motion of the envelope, in nanometres ---------------------------------------------------

NM = 1e-9
SMALL = Cubic(*(coefficient / NM**2 for coefficient in CUBIC))
PULLED = (0.8 * NM, -0.5 * NM, 300.0 * NM, 700.0 * NM)


def small(**changes: float) -> Parameters:
    """The string of Q about 50, driven by two tones to about a nanometre."""
    own = {"d1": 25.0, "d2": 15.0, "u2": 995.0, "A1": 2e6 * NM, "A2": 1.5e6 * NM, "phase2": -1.0}
    return Parameters(**{**STRING._asdict(), **own, **changes})


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"u1": 880.0, "u2": 1120.0},
        pytest.param({"eta_minus": 970.0}, marks=pytest.mark.nightly),
        pytest.param({"eta_minus": 3.0 * 999.0 / 1.12}, marks=pytest.mark.nightly),
        pytest.param({"eta_minus": 3.0 * 999.0 / 0.88}, marks=pytest.mark.nightly),
        pytest.param({"u1": 530.0, "u2": 530.0}, marks=pytest.mark.nightly),
    ],
    ids=[
        "near",
        "tones-apart",
        "reversed",
        "below-the-third",
        "above-the-third",
        "slow",
    ],
)
def test_the_envelope_goes_on_from_any_state_as_the_full_equations(
    changes: dict[str, float],
) -> None:
    """By scipy's DOP853, also where frequencies are as far from each other as is allowed.

    What averaging leaves out is of second order: of the shift eps and of the frequencies' spread.
    """
    p = small(**changes)
    solver = EnvelopeSolver(p, SMALL, Settings(1e-8, False))
    q1, q2, v1, v2 = PULLED
    solver.start(0.0, (complex(q1), complex(q2), complex(v1), complex(v2)), 0.0)
    times = np.linspace(0.0, 0.06, 60)[1:]
    found, squares = [], []
    for t in times.tolist():
        solver.advance(t)
        found.append(solver.displacement(t))
        squares.append(solver.squares(t))
    full = SimpleNamespace(**p._asdict(), **SMALL._asdict())
    start = (q1, q2, 2.0 * math.pi * v1, 2.0 * math.pi * v2)
    truth = duffing_reference.motion(full, times, start, rtol=1e-10).q
    m1, m2 = np.max(squares, axis=0) / (2.0 * math.pi * 0.5 * (p.u1 + p.u2)) ** 2
    eps = 0.375 * max(
        abs(SMALL.alpha1) * m1 + SMALL.kappa * m2, abs(SMALL.alpha2) * m2 + SMALL.kappa * m1
    )
    tones = (p.u1, p.u2)
    spread = max(abs(u - f) for u in tones for f in (*tones, p.eta_plus, p.eta_minus)) / p.u1
    errors = np.abs(np.array(found) - truth).max(axis=0) / np.abs(truth).max(axis=0)
    assert eps > 1e-3
    assert errors.max() < 0.2 * eps * (3.0 * eps + spread)


@pytest.mark.parametrize("run_s", [0.0, 0.01])
def test_an_envelope_that_is_restored_goes_on_to_the_last_bit(run_s: float) -> None:
    """Stored before its first step, too."""
    solver = EnvelopeSolver(small(), SMALL, Settings(1e-6, False))
    solver.start(0.0, (0j, 0j, 0j, 0j), 0.0)
    solver.advance(run_s)
    stored = solver.snapshot()
    again = EnvelopeSolver(small(), SMALL, Settings(1e-6, False))
    again.restore(stored)
    for t in (0.01, 0.0123, 0.05):
        for each in (solver, again):
            each.advance(t)
        assert again.displacement(t) == solver.displacement(t)
        assert again.full_state(t) == solver.full_state(t)


@pytest.mark.parametrize("g", [(1.0, 0.0), (0.0, 1.0)])
@pytest.mark.parametrize("only", [0, 1])
def test_one_driven_mode_and_one_cubic_term_start_on_their_orbit(
    g: tuple[float, float], only: int
) -> None:
    """An orbit repeats after its tone's period, from the first one on."""
    p = small(theta=0.0, eta_minus=1005.0, A2=0.0, g1=g[0], g2=g[1])
    cubic = Cubic(*(SMALL[k] if k == only else 0.0 for k in range(3)))
    solver = EnvelopeSolver(p, cubic, Settings(1e-8, False))
    solver.start(0.0, None, 0.0)
    first = solver.displacement(0.0)
    periods = 50
    solver.advance(periods / p.u1)
    again = solver.displacement(periods / p.u1)
    assert np.abs(np.array(again) - first).max() < 1e-6 * np.abs(first).max()
    assert np.abs(first).max() > 0.0


def test_two_tones_start_where_the_slower_mode_has_settled_too() -> None:
    """A settled motion repeats after its tones' common period; one mode is eight times as wide."""
    p = small(theta=0.0, d1=40.0, d2=5.0, eta_minus=1010.0, u1=1000.0, u2=1010.0, A2=5e5 * NM)
    weak = Cubic(*(0.1 * coefficient for coefficient in SMALL))
    solver = EnvelopeSolver(p, weak, Settings(1e-7, False))
    solver.start(0.0, None, 0.0)
    times = np.linspace(0.0, 2e-3, 17)
    rows = []
    for begin in (0.0, 0.1):
        for t in (begin + times).tolist():
            solver.advance(t)
            rows.append(solver.displacement(t))
    first, second = np.split(np.array(rows), 2)
    assert np.abs(second - first).max() < 1e-6 * np.abs(first).max()
    assert np.abs(first).max(axis=0).min() > 0.1 * NM


@pytest.mark.parametrize("unit", [1.0, NM])
@pytest.mark.parametrize("alpha", [1.0, -1.0])
def test_the_shift_is_that_of_the_exact_period(unit: float, alpha: float) -> None:
    """x'' + w^2 x + alpha x^3 = 0 has the period 4 K(m)/sqrt(w^2 + alpha a^2), elliptic; along
    q~1 = q~2 the coupling is such a force."""
    w = 2.0 * math.pi * 1000.0
    cubic = alpha * 1e-3 * w**2 / unit**2
    with mp.workdps(30):
        stiff = mp.mpf(w) ** 2 + cubic * unit**2
        period = 4 * mp.ellipk(cubic * unit**2 / (2 * stiff)) / mp.sqrt(stiff)
        wanted = abs(float(2 * mp.pi / period / w - 1))
    alone = shift(Cubic(cubic, 0.0, 0.0), (unit**2, 0.0), 1000.0)
    other = shift(Cubic(0.0, cubic, 0.0), (0.0, unit**2), 1000.0)
    both = shift(Cubic(0.75 * cubic, 0.0, 0.25 * cubic), (unit**2, unit**2), 1000.0)
    assert (alone, other, both) == pytest.approx((wanted, wanted, wanted), rel=2e-3)


@pytest.mark.parametrize("growing", [0, 1])
def test_a_linear_mode_grows_as_its_exponential_beside_one_that_decays(growing: int) -> None:
    """x'' + 2 pi d x' + (2 pi eta)^2 x = 0 from x' = 0, up to 1e90 of it: nothing is refused while
    its cube is a number."""
    eta, rate = (1000.0, 1050.0)[growing], math.pi * 20.0
    d = {"d1": -20.0, "d2": 40.0} if growing == 0 else {"d1": 40.0, "d2": -20.0}
    p = small(theta=0.0, A1=0.0, A2=0.0, **d)
    solver = EnvelopeSolver(p, Cubic(0.0, 0.0, 0.0), Settings(1e-6, False))
    begin = [0j, 0j]
    begin[growing] = 1.0 + 0j
    solver.start(0.0, (begin[0], begin[1], 0j, 0j), 0.0)
    turning = math.sqrt((2.0 * math.pi * eta) ** 2 - rate**2)
    for t in (0.3, 2.0, 2.0001, 3.3):
        solver.advance(t)
        phase = turning * t
        wanted = math.exp(rate * t) * (math.cos(phase) - rate / turning * math.sin(phase))
        found = solver.displacement(t)
        assert found[growing] == pytest.approx(wanted, abs=1e-9 * math.exp(rate * t))
        assert abs(found[1 - growing]) <= 1e-9 * math.exp(rate * t)


@pytest.mark.parametrize("upper", [False, True])
@pytest.mark.parametrize("reflection", [False, True])
def test_the_averaged_orbit_balances_forces_at_the_drive(reflection: bool, upper: bool) -> None:
    """(C~ - w^2 + i w D~) Q + N = g A exp(i phase), N = 3/4 alpha_n |Q_n|^2 Q_n + kappa/4
    (2 |Q_m|^2 Q_n + conj(Q_n) Q_m^2), with much damping between the modes."""
    p = small(theta=0.6, reflection=reflection, d1=60.0, d2=5.0, A2=0.0)
    model = SlowModel(p, SMALL, (0.0, 0.0))
    q = np.array(averaged_orbit(model, model.linear(0.0), upper))
    c, s, w = math.cos(p.theta), math.sin(p.theta), 2.0 * math.pi * p.u1
    t = np.array([[-c, s], [s, c]] if reflection else [[c, -s], [s, c]])
    damping = 2.0 * math.pi * t @ np.diag([p.d1, p.d2]) @ t.T
    stiffness = (2.0 * math.pi) ** 2 * np.diag([p.eta_plus**2 - p.u1**2, p.eta_minus**2 - p.u1**2])
    other = q[::-1]
    cubic = 0.75 * np.array([SMALL.alpha1, SMALL.alpha2]) * np.abs(q) ** 2 * q
    cubic += 0.25 * SMALL.kappa * (2.0 * np.abs(other) ** 2 * q + q.conjugate() * other**2)
    drive = p.A1 * cmath.exp(1j * p.phase1) * np.array([p.g1, p.g2])
    left = (stiffness + 1j * w * damping) @ q + cubic - drive
    assert np.abs(left).max() < 1e-9 * np.abs(drive).max()
    assert np.abs(cubic).max() > 1e-3 * np.abs(drive).max()


def test_rk4_moves_from_any_state_as_the_full_equations() -> None:
    """By scipy's DOP853; a thousand substeps in a period of either mode, 10 periods."""
    p = small()
    full = SimpleNamespace(**p._asdict(), **SMALL._asdict())
    q1, q2, v1, v2 = PULLED
    times = [0.0013, 0.01]
    start = (q1, q2, 2.0 * math.pi * v1, 2.0 * math.pi * v2)
    truth = duffing_reference.motion(full, times, start, rtol=1e-11).q
    solver = DuffingRungeKutta(p, SMALL, Settings(1e-6, False), 1e-6)
    solver.start(0.0, (complex(q1), complex(q2), complex(v1), complex(v2)), 0.0)
    for t, row in zip(times, truth, strict=True):
        solver.advance(t)
        assert solver.displacement(t) == pytest.approx(row.tolist(), abs=1e-9 * NM)


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


@pytest.mark.parametrize("s", [-1.8, -2.5, -7.0, -30.0])
@pytest.mark.parametrize("alpha", [3.0, -3.0])
@pytest.mark.parametrize("share", [-0.3, 0.1, 0.5, 0.9, 1.3])
def test_between_the_folds_the_smallest_and_the_largest_of_three_are_told(
    s: float, alpha: float, share: float
) -> None:
    """x ((s + x)^2 + 1) = P has three roots for P between its two turns, by numpy's roots."""
    fold = sorted(x * ((s + x) ** 2 + 1.0) for x in np.roots([3.0, 4.0 * s, s * s + 1.0]).real)
    power = fold[0] + share * (fold[1] - fold[0])
    if power <= 0.0:
        power = 0.5 * fold[0]
    roots = np.roots([1.0, 2.0 * s, s * s + 1.0, -power])
    real = np.sort(roots[np.abs(roots.imag) < 1e-9 * np.abs(roots)].real)
    assert real.size == (3 if 0.0 < share < 1.0 else 1)
    loss, unit = 7.0, 7.0 / (0.75 * abs(alpha))  # x = 3/4 |alpha| |a|^2/loss
    drive = loss * math.sqrt(power * unit)
    found = steady_squares(s * math.copysign(loss, alpha), loss, alpha, drive)
    assert found == pytest.approx((real[0] * unit, real[-1] * unit), rel=1e-9)


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


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_a_root_is_found_in_any_unit(unit: float) -> None:
    """x^2 = 2 and x y = 1, in units of x."""
    root = find_root(
        lambda x: [(x[0] / unit) ** 2 - 2.0, x[0] * x[1] / unit**2 - 1.0],
        [1.0 * unit, 0.5 * unit],
        [unit, unit],
    )
    assert root is not None
    assert root == pytest.approx([math.sqrt(2.0) * unit, math.sqrt(0.5) * unit], rel=1e-10, abs=0)


def test_a_step_is_of_order_four_and_what_is_between_follows() -> None:
    """y' = L y + y^2 has y = L/((L/y0 + 1) exp(-L t) - 1): the error of a step falls as h^5."""
    rates, begin = (-1.0 + 3.0j, -0.5 + 0j), (0.6 + 0.2j, 0.3 + 0j)
    none = 0j, 0j

    def slope(
        y: tuple[complex, complex], _: tuple[complex, complex]
    ) -> tuple[complex, complex, complex, complex]:
        return y[0] * y[0], y[1] * y[1], y[0], y[1]

    def exact(t: float) -> list[complex]:
        return [
            rate / ((rate / y + 1.0) * cmath.exp(-rate * t) - 1.0)
            for rate, y in zip(rates, begin, strict=True)
        ]

    sizes, ends, inner = (0.2, 0.1, 0.05), [], []
    for h in sizes:
        first = begin, slope(begin, none)[:2]
        pair = weights(rates[0], h), weights(rates[1], h)
        step = take_step((0.0, *first), h, pair, slope, (none, none, none))
        ends.append([abs(a - b) for a, b in zip(step.y_end, exact(h), strict=True)])
        there = step.between(rates, 0.3 * h)
        inner.append([abs(a - b) for a, b in zip(there, exact(0.3 * h), strict=True)])
        assert np.max(step.error) > np.max(ends[-1])
    for errors, order in ((ends, 5.0), (inner, 4.0)):
        for each in np.transpose(errors):
            assert np.polyfit(np.log(sizes), np.log(each), 1)[0] > order - 0.4


@given(size=st.floats(-9.0, 2.3), angle=st.floats(-math.pi, math.pi))
def test_phi_functions_of_any_size(size: float, angle: float) -> None:
    z = cmath.rect(10.0**size, angle)
    with mp.workdps(60):
        wanted = [mp.exp(mp.mpc(z))]
        for k in range(3):
            wanted.append((wanted[-1] - 1 / mp.factorial(k)) / mp.mpc(z))
        for a, b in zip(phi(z), wanted, strict=True):
            assert abs(a - b) <= 1e-13 * max(abs(b), abs(wanted[0]) * 1e-3)


def test_what_a_step_misses_is_the_integral_of_the_cubic_through_its_points() -> None:
    """s (s - 1/2) (s - 1) is zero where the parabola is exact, and largest at the probe."""
    cubic = np.polynomial.Polynomial.fromroots([0.0, 0.5, 1.0])
    assert cubic.deriv()(exponential.PROBE) == pytest.approx(0.0, abs=1e-15)
    whole = cubic.integ()
    missed = (whole(0.5) - whole(0.0)) / cubic(exponential.PROBE)
    assert missed == pytest.approx(exponential.MISSED, rel=1e-14)
    for power, value in enumerate((1.0, exponential.PROBE, exponential.PROBE**2)):
        slopes = (0.0**power, 2.0 * 0.5**power, 1.0)  # that at the middle is there twice
        there = sum(k * n for k, n in zip(exponential.PARABOLA, slopes, strict=True))
        assert there == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize("name", ["alpha1", "alpha2", "kappa"])
def test_each_cubic_term_by_itself_wants_tones_that_one_frame_holds(name: str) -> None:
    p = small(u1=500.0, u2=1500.0)
    one = Cubic(**{**dict.fromkeys(Cubic._fields, 0.0), name: 1e10})
    with pytest.raises(ModelError, match="rotating frame"):
        EnvelopeSolver(p, one, Settings(1e-6, False))
    EnvelopeSolver(p, Cubic(*[0.0] * 3), Settings(1e-6, False))  # a linear motion wants none


# --- what settles, and what a period repeats -----------------------------------------------------


@pytest.mark.parametrize("lone", [0, 1])
def test_a_mode_that_no_other_moves_goes_as_the_full_equations(lone: int) -> None:
    """By scipy's DOP853, beside a mode that is linear and rings off."""
    p = small(theta=0.0)
    cubic = Cubic(*(SMALL[k] if k == lone else 0.0 for k in range(3)))
    solver = EnvelopeSolver(p, cubic, Settings(1e-8, False))
    assert solver.model.lone == lone
    q1, q2, v1, v2 = PULLED
    solver.start(0.0, (complex(q1), complex(q2), complex(v1), complex(v2)), 0.0)
    times = np.linspace(0.0, 0.03, 30)[1:]
    found = []
    for t in times.tolist():
        solver.advance(t)
        found.append(solver.displacement(t))
    start = (q1, q2, 2.0 * math.pi * v1, 2.0 * math.pi * v2)
    full = SimpleNamespace(**p._asdict(), **cubic._asdict())
    truth = duffing_reference.motion(full, times, start, rtol=1e-9).q
    errors = np.abs(np.array(found) - truth).max(axis=0) / np.abs(truth).max(axis=0)
    assert errors.max() < 5e-5
    assert errors[1 - lone] < 1e-7


def counted(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Lengths of all steps that are tried from now on, in s."""
    lengths: list[float] = []
    attempt = EnvelopeSolver._attempt

    def counting(self: EnvelopeSolver, h: float) -> exponential.Step:
        lengths.append(h)
        return attempt(self, h)

    monkeypatch.setattr(EnvelopeSolver, "_attempt", counting)
    return lengths


@pytest.mark.parametrize("theta", [0.0, 1.9])
def test_two_tones_settle_coarsely_and_take_the_steps_of_one_period(
    monkeypatch: pytest.MonkeyPatch, theta: float
) -> None:
    """The lines of a long run are those of a fine one from rest that has settled by itself."""
    p = small(theta=theta, u1=1000.0, u2=1010.0)
    cubic = SMALL if theta else Cubic(SMALL.alpha1, 0.0, 0.0)
    lengths = counted(monkeypatch)
    solver = EnvelopeSolver(p, cubic, Settings(1e-6, False))
    solver.start(0.0, None, 0.0)
    settling = len(lengths)
    times = np.linspace(0.0, 0.1, 400)
    solver.advance(0.1 - 1e-9)
    period = len(lengths) - settling
    assert period > 10
    begin, rows = 1.0, []
    for t in (begin + times).tolist():
        solver.advance(t)
        rows.append(solver.displacement(t))
    assert len(lengths) == settling + period
    lengths.clear()
    from_rest = EnvelopeSolver(p, cubic, Settings(1e-8, False))
    from_rest.start(0.0, (0j, 0j, 0j, 0j), 0.0)
    truth = []
    for t in (begin + times).tolist():
        from_rest.advance(t)
        truth.append(from_rest.displacement(t))
    errors = np.abs(np.array(rows) - truth).max(axis=0) / np.abs(truth).max(axis=0)
    assert errors.max() < 1e-6
    lengths.clear()
    evenly = EnvelopeSolver(p, cubic, Settings(1e-6, False))
    evenly.start(0.0, (0j, 0j, 0j, 0j), 0.0)
    decay = min(-rate.real for rate in solver.model.rates)
    evenly.advance(math.log(100.0 / 1e-6) / decay)
    assert settling < 0.5 * len(lengths)


def test_a_period_of_too_many_steps_goes_on_by_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    p, settings = small(u1=1000.0, u2=1010.0), Settings(1e-6, False)
    kept = EnvelopeSolver(p, SMALL, settings)
    kept.start(0.0, None, 0.0)
    monkeypatch.setattr("fmu_src.duffing_period.MOST_STEPS", 7)
    solver = EnvelopeSolver(p, SMALL, settings)
    solver.start(0.0, None, 0.0)
    for t in (0.03, 0.25, 0.3):
        for each in (kept, solver):
            each.advance(t)
        size = max(abs(q) for q in solver.model.linear(t))
        assert solver.displacement(t) == pytest.approx(kept.displacement(t), abs=1e-6 * size)


def test_a_motion_that_repeats_is_restored_to_the_last_bit() -> None:
    p, settings = small(u1=1000.0, u2=1010.0), Settings(1e-4, False)
    solver = EnvelopeSolver(p, SMALL, settings)
    solver.start(0.0, None, 0.0)
    for stored in (0.0, 0.03, 0.47):
        solver.advance(stored)
        again = EnvelopeSolver(p, SMALL, settings)
        again.restore(solver.snapshot())
        for t in (stored, stored + 0.02, stored + 0.3):
            for each in (solver, again):
                each.advance(t)
            assert again.displacement(t) == solver.displacement(t)
            assert again.full_state(t) == solver.full_state(t)


@given(h=st.floats(1e-300, 1e300))
def test_steps_are_powers_of_the_fourth_root_of_two(h: float) -> None:
    found = exponential.notched(h)
    assert found <= h < found * 2.0**0.25 * (1.0 + 1e-15)
    assert exponential.notched(found) == found
    assert (4.0 * math.log2(found)) == pytest.approx(round(4.0 * math.log2(found)), abs=1e-9)
