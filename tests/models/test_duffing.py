"""The numbers of ``DuffingOscillator``: against DOP853, mpmath and the closed forms of averaging.

Most scenes have a Q of 50 to 200 and frequencies of a kilohertz: everything that matters goes in
line widths, and the references resolve every oscillation.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import build_fmu
from fitting.text.arrays import ComplexArray, FloatArray
from fmu_src.duffing_envelope import EnvelopeSolver, Settings
from fmu_src.duffing_equations import Cubic
from fmu_src.oscillator_equations import Parameters
from tests.support import duffing_reference, reference, scenes
from tests.support.fmus import LIVELY, OK, TIMES, Instance, Unpacked, unpack, worst

MODES = ("q1_hybrid", "q2_hybrid")
ENVELOPE, RK4 = 1, 2
LINEAR = {"alpha1": 0.0, "alpha2": 0.0, "kappa": 0.0}

ETA = 1000.0


@pytest.fixture(scope="module")
def duffing(tmp_path_factory: pytest.TempPathFactory) -> Unpacked:
    folder = tmp_path_factory.mktemp("duffing")
    return unpack(build_fmu.build("DuffingOscillator", folder), folder / "unpacked")


@pytest.fixture(scope="module")
def fmu(duffing: Unpacked) -> Iterator[Instance]:
    with Instance(duffing) as made:
        yield made


def run(fmu: Instance, times: npt.ArrayLike, **values: Any) -> FloatArray:
    """Return both modes at the times, shape (n, 2), of a run that starts at 0."""
    fmu.slave.reset()
    return np.array(fmu.start(**values).run(list(np.asarray(times)), *MODES))


def two_tones(quality: float, strength: float, **changes: float) -> dict[str, float]:
    """Return a scene that looks alike at every Q, in line widths; amplitudes are about 1 m.

    ``strength`` is the shift by alpha1 of an amplitude of 1 m, in line widths.
    """
    width = ETA / quality
    force = (2 * math.pi) ** 2 * ETA * width  # moves an oscillator on resonance by 1 m
    alpha = strength * width / ETA * (2 * math.pi * ETA) ** 2 * 8.0 / 3.0
    scene = {
        "theta": 1.9498,
        "d1": width,
        "d2": 0.8 * width,
        "eta_plus": ETA,
        "eta_minus": ETA + 2.6 * width,
        "u1": ETA - 0.1 * width,
        "u2": ETA + 0.3 * width,
        "A1": 0.9 * force,
        "A2": 0.5 * force,
        "phase1": 0.3,
        "phase2": -1.1,
        "g1": 1.0,
        "g2": 0.8,
        "alpha1": alpha,
        "alpha2": -0.7 * alpha,
        "kappa": 0.3 * alpha,
    }
    return scene | changes


def one_mode(strength: float, drive: float = 1.0, quality: float = 200.0) -> dict[str, float]:
    """Return a single Duffing mode under one tone; the linear amplitude on resonance is 1 m."""
    scene = two_tones(quality, strength)
    force = drive * (2 * math.pi) ** 2 * ETA * ETA / quality
    alone = {"d2": scene["d1"], "g2": 0.0, "kappa": 0.0, "A2": 0.0, "phase1": 0.0}
    return scene | alone | {"A1": force}


def error_and_bound(
    fmu: Instance, scene: dict[str, float], rtol: float = 1e-10, **settings: float
) -> FloatArray:
    """Return the largest error and the documented bound, over the amplitude of mode 1.

    What the reference lacks grows with the number of periods: ``rtol`` per step, less for a high Q.
    """
    times = np.linspace(0.0, 0.9 / scene["d1"], 301)[1:]
    truth = duffing_reference.motion(fmu_parameters(scene), times, rtol=rtol)
    found = run(fmu, times, **scene, **settings)
    amplitudes = np.abs(truth.q).max(axis=0)
    assert truth.error < 1e-7 * amplitudes.max()
    errors = np.abs(found - truth.q).max(axis=0) / amplitudes
    eps = shift(scene, amplitudes)
    spread = max(abs(scene["u1"] - scene["u2"]), abs(scene["eta_minus"] - scene["u1"])) / ETA
    return np.array([errors.max(), eps * (3.0 * eps + spread), eps])


def shift(scene: dict[str, float], amplitudes: FloatArray) -> float:
    a, (m1, m2) = scene, amplitudes**2
    forces = (
        abs(a["alpha1"]) * m1 + abs(a["kappa"]) * m2,
        abs(a["alpha2"]) * m2 + abs(a["kappa"]) * m1,
    )
    return float(0.375 * max(forces) / (2 * math.pi * ETA) ** 2)


def fmu_parameters(scene: dict[str, float]) -> SimpleNamespace:
    return SimpleNamespace(**({"reflection": False} | scene))


# --- against the full equations ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("strength", "changes"),
    [
        (0.3, {"eta_minus": 1300.0, "u2": 1297.0}),
        (-2.0, {"kappa": 0.0}),
        pytest.param(0.3, {}, marks=pytest.mark.nightly),
        pytest.param(0.3, {"kappa": 0.0}, marks=pytest.mark.nightly),
        pytest.param(0.3, {"eta_minus": 1100.0, "u2": 1100.3}, marks=pytest.mark.nightly),
        pytest.param(-2.0, {}, marks=pytest.mark.nightly),
        pytest.param(-2.0, {"eta_minus": 1100.0, "u2": 1100.3}, marks=pytest.mark.nightly),
        pytest.param(-2.0, {"eta_minus": 1300.0, "u2": 1297.0}, marks=pytest.mark.nightly),
    ],
    ids=str,
)
def test_envelope_follows_the_full_equations_within_its_bound(
    fmu: Instance, strength: float, changes: dict[str, float]
) -> None:
    """From rest, both modes, two tones: error below eps (3 eps + spread of the frequencies)."""
    scene = two_tones(50.0, strength, **changes)
    error, bound, eps = error_and_bound(fmu, scene, tolerance=1e-9)
    assert error <= bound
    assert error > 1e-3 * eps * eps  # the scene is one that shows an error at all


def test_envelope_error_falls_as_the_square_of_the_shift(fmu: Instance) -> None:
    """Everything in line widths alike, eps = 1/Q: averaging to first order would fall as 1/Q."""
    qualities = np.array([50.0, 100.0, 200.0])  # below, the next order takes a third of it away
    found = [
        error_and_bound(fmu, two_tones(q, 1.0), rtol=2e-9 / q, tolerance=1e-10) for q in qualities
    ]
    slope = np.polyfit(np.log(qualities), np.log([error for error, *_ in found]), 1)[0]
    assert slope == pytest.approx(-2.0, abs=0.15)


def test_rk4_has_order_four(fmu: Instance) -> None:
    scene = two_tones(50.0, 3.0, A1=4e6, A2=3e6, alpha2=1e7)
    times = [0.0031]
    truth = duffing_reference.motion(fmu_parameters(scene), times, rtol=1e-13).q
    linear = run(fmu, times, solver=RK4, rk4_substep=1e-6, **(scene | LINEAR))
    assert np.abs(linear - truth).max() > 1e-3 * np.abs(truth).max()  # the cubic terms count
    substeps = [times[0] / n for n in (64, 128, 256, 512)]
    errors = [
        np.abs(run(fmu, times, solver=RK4, rk4_substep=h, **scene) - truth).max() for h in substeps
    ]
    slope = np.polyfit(np.log(substeps), np.log(errors), 1)[0]
    assert slope == pytest.approx(4.0, abs=0.15)


# --- the integrator of the envelope --------------------------------------------------------------


#: Where a mode rings far from the frame, 1e-10 is beyond the reference.
TOLERANCES: list[tuple[dict[str, float], int]] = [({}, k) for k in (-2, -4, -6, -8, -10)] + [
    ({"eta_minus": 1300.0}, k) for k in (-2, -4, -6, -8)
]
USUAL: list[tuple[dict[str, float], int]] = [({}, -2), ({}, -10), ({"eta_minus": 1300.0}, -6)]


@pytest.mark.parametrize(
    ("changes", "exponent"),
    [
        *USUAL,
        *(pytest.param(*t, marks=pytest.mark.nightly) for t in TOLERANCES if t not in USUAL),
    ],
    ids=str,
)
def test_tolerance_of_the_envelope_is_honoured(changes: dict[str, float], exponent: int) -> None:
    """The slow equations by scipy's DOP853, at times that fall between the solver's own steps."""
    scene = two_tones(200.0, 2.0, **changes)
    values = {name: scene[name] for name in Parameters._fields if name in scene}
    p = Parameters(reflection=False, **values)
    solver = EnvelopeSolver(
        p,
        Cubic(scene["alpha1"], scene["alpha2"], scene["kappa"]),
        Settings(10.0**exponent, False),
    )
    solver.start(0.0, (0j, 0j, 0j, 0j), 0.0)
    model, start = solver.model, solver._slow(0.0)

    def slope(t: float, y: ComplexArray) -> list[complex]:
        n1, n2, _, _ = model.slope((y[0], y[1]), model.linear(t))
        return [model.rates[0] * y[0] + n1, model.rates[1] * y[1] + n2]

    times = np.linspace(0.0, 5.0 / scene["d1"], 400)[1:]
    y0 = np.array(start)
    truth = solve_ivp(
        slope, (0.0, times[-1]), y0, method="DOP853", t_eval=times, rtol=1e-13, atol=1e-13
    ).y.T
    amplitudes = np.abs(
        [model.amplitudes((y[0], y[1]), model.linear(t)) for t, y in zip(times, truth, strict=True)]
    )
    found: list[Any] = []
    for t in times:
        solver.advance(float(t))
        found.append(solver._slow(float(t)))
    errors = np.abs(np.array(found) - truth).max(axis=0) / amplitudes.max(axis=0)
    assert errors.max() <= 10.0**exponent
    assert errors.max() >= 10.0 ** (exponent - 3)  # and nothing is spent for nothing


def test_the_cut_into_steps_does_not_matter_to_the_envelope(fmu: Instance) -> None:
    scene = two_tones(200.0, 2.0)
    fine = run(fmu, [0.001 * k for k in range(1, 301)], **scene)
    coarse = run(fmu, [0.3], **scene)
    assert coarse[0].tolist() == fine[-1].tolist()


def test_amplitudes_scale_by_powers_of_two_to_the_last_bit(fmu: Instance) -> None:
    scene = two_tones(200.0, 2.0)
    factor = 2.0**-100
    small = {name: scene[name] * factor for name in ("A1", "A2")}
    small |= {name: scene[name] / factor**2 for name in ("alpha1", "alpha2", "kappa")}
    times = [0.01, 0.1, 0.3]
    wanted = run(fmu, times, **scene) * factor
    assert run(fmu, times, **(scene | small)).tolist() == wanted.tolist()


# --- the linear limit ----------------------------------------------------------------------------


@pytest.mark.parametrize("reflection", [False, True])
def test_linear_limit_is_the_coupled_oscillator(
    fmu: Instance, oscillator: Unpacked, reflection: bool
) -> None:
    """The envelope's linear part is exact, so it equals the exact solver; rk4 equals rk4."""
    values = dict(LIVELY) | {"reflection": reflection}
    with Instance(oscillator) as coupled:
        exact = np.array(coupled.start(**values).run(TIMES, *MODES))
        coupled.slave.reset()
        rk4 = np.array(coupled.start(solver=RK4, **values).run(TIMES, *MODES))
    size = np.abs(exact).max()
    envelope = run(fmu, TIMES, tolerance=1e-10, **LINEAR, **values)
    assert np.abs(envelope - exact).max() <= 1e-9 * size
    assert np.abs(run(fmu, TIMES, solver=RK4, **LINEAR, **values) - rk4).max() <= 1e-13 * size
    fine = run(fmu, TIMES, solver=RK4, rk4_substep=2e-8, **LINEAR, **values)
    assert np.abs(fine - exact).max() <= 1e-6 * size


CORNERS = (
    "string theta=0 reflection=False",
    "degenerate modes",
    "exceptional point",
    "exceptional point, on it",
    "d1 far above d2",
    "equal tones",
    "one tone, shifted phase",
    "far off resonance",
    "on resonance, periodic start",
)


@pytest.mark.parametrize(
    "scene",
    [s for s in scenes.corners() if s.label in CORNERS] + [scenes.Scene("string", step_s=0.0031)],
    ids=lambda s: s.label,
)
def test_linear_limit_at_the_corners_of_the_model(fmu: Instance, scene: scenes.Scene) -> None:
    times = [scene.step_s, 2.0 * scene.step_s]
    rows = run(fmu, times, tolerance=1e-11, **LINEAR, **scene.parameters).tolist()
    truth = reference.displacements(scene, times, scene.periodic_start)
    assert worst(rows, [row[:2] for row in truth]) <= 1e-9


# --- one tone: backbone, jumps, hysteresis -------------------------------------------------------


def branches(scene: dict[str, float], u: float) -> list[float]:
    """Return the amplitudes of all orbits at ``u`` Hz by first-order averaging, ascending."""
    delta = (2 * math.pi) ** 2 * (scene["eta_plus"] - u) * (scene["eta_plus"] + u)
    loss = (2 * math.pi) ** 2 * u * scene["d1"]
    lift = 0.75 * scene["alpha1"]
    cubic = [lift**2, 2 * lift * delta, delta**2 + loss**2, -(scene["A1"] ** 2)]
    roots = np.roots(cubic)
    return sorted(math.sqrt(r.real) for r in roots if abs(r.imag) < 1e-9 * abs(r.real))


def folds(scene: dict[str, float]) -> tuple[float, float]:
    """Return the two frequencies at which an orbit of first-order averaging appears or ends."""

    def discriminant(u: float) -> float:
        delta = (2 * math.pi) ** 2 * (scene["eta_plus"] - u) * (scene["eta_plus"] + u)
        loss = (2 * math.pi) ** 2 * u * scene["d1"]
        power = 0.75 * scene["alpha1"] * scene["A1"] ** 2 / loss**3
        b, c = 2 * delta / loss, (delta / loss) ** 2 + 1.0
        cubed = 18 * b * c * -power - 4 * b**3 * -power + b * b * c * c
        return float(cubed - 4 * c**3 - 27 * power * power)

    grid = ETA + np.sign(scene["alpha1"]) * np.linspace(0.0, 8.0, 801) * scene["d1"]
    values = [discriminant(u) for u in grid]
    pairs = zip(grid, grid[1:], values, values[1:], strict=False)
    found = [brentq(discriminant, a, b) for a, b, x, y in pairs if x * y < 0.0]
    assert len(found) == 2
    return found[0], found[1]


def amplitude(fmu: Instance, scene: dict[str, float], t: float = 0.0) -> float:
    """Return the amplitude of mode 1 at the drive frequency, over one period from ``t`` s."""
    u, count = scene["u1"], 16
    begin, values = t, []
    for k in range(1, count + 1):
        end = t + k / (count * u)
        assert fmu.step(begin, end - begin) == OK, fmu.messages
        values.append(fmu.get("q1_hybrid")[0])
        begin = end
    return float(2.0 / count * abs(np.fft.fft(values)[1]))


def orbit(
    fmu: Instance, scene: dict[str, float], u: float, branch: int, **settings: float
) -> float:
    """Return the amplitude of mode 1 on a periodic orbit at ``u`` Hz."""
    fmu.slave.reset()
    there = scene | {"u1": u}
    fmu.start(periodic_start=True, branch=branch, **there, **settings)
    return amplitude(fmu, there)


@pytest.mark.parametrize("solver", [ENVELOPE, RK4])
@pytest.mark.parametrize("strength", [3.0, -3.0])
def test_both_branches_are_the_roots_of_the_averaged_equation(
    fmu: Instance, strength: float, solver: int
) -> None:
    """Amplitudes to the order of the closed form, eps; the linear part of it is exact."""
    scene = one_mode(strength)
    first, last = folds(scene)
    eps = abs(strength) / 200.0
    for u in (ETA, 0.5 * (first + last), 2 * last - first):
        wanted = branches(scene, u)
        assert len(wanted) in (1, 3)
        found = [orbit(fmu, scene, u, b, solver=solver, rk4_substep=1e-5) for b in (0, 1)]
        assert found == pytest.approx([wanted[0], wanted[-1]], rel=2 * eps)


@pytest.mark.parametrize("strength", [0.5, 2.0, -2.0])
def test_the_peaks_lie_on_the_backbone(fmu: Instance, strength: float) -> None:
    """u_peak^2 = eta^2 + 3/4 alpha a^2/(2 pi)^2, the shift itself to its relative order eps."""
    for drive in (0.6, 1.0):
        scene = one_mode(strength, drive)
        low, high = sorted((ETA, ETA * (1.0 + 1.3 * strength / 200.0)))
        golden = 0.5 * (math.sqrt(5.0) - 1.0)
        for _ in range(24):
            a, b = high - golden * (high - low), low + golden * (high - low)
            if orbit(fmu, scene, a, 1) < orbit(fmu, scene, b, 1):
                low = a
            else:
                high = b
        peak = 0.5 * (low + high)
        top = max(orbit(fmu, scene, u, 1) for u in (low, high))
        backbone = math.sqrt(ETA**2 + 0.75 * scene["alpha1"] * top**2 / (2 * math.pi) ** 2)
        eps = abs(backbone / ETA - 1.0)
        assert top == pytest.approx(drive, rel=2 * eps)
        damped = 0.5 * scene["d1"] ** 2 / ETA  # as far as damping itself moves a peak, and more
        assert peak - ETA == pytest.approx(backbone - ETA, rel=2 * eps, abs=damped)
        assert abs(backbone - ETA) > 0.15 * scene["d1"]  # the peak has moved


@pytest.mark.parametrize("strength", [3.0, -3.0])
def test_jump_frequencies_are_those_of_averaging_to_its_order(
    fmu: Instance, strength: float
) -> None:
    """Where the two branches meet, by bisection, within eps of the distance from eta."""
    scene = one_mode(strength)
    middle = 0.5 * sum(folds(scene))
    for fold in folds(scene):
        inside, outside = middle, 2.0 * fold - middle
        for _ in range(14):
            u = 0.5 * (inside + outside)
            apart = orbit(fmu, scene, u, 1) > 1.05 * orbit(fmu, scene, u, 0)
            inside, outside = (u, outside) if apart else (inside, u)
        assert inside - ETA == pytest.approx(fold - ETA, rel=2 * abs(strength) / 200.0)


@pytest.mark.parametrize(
    ("solver", "strength"),
    [
        (ENVELOPE, -3.0),
        pytest.param(ENVELOPE, 3.0, marks=pytest.mark.nightly),
        pytest.param(RK4, 3.0, marks=pytest.mark.nightly),
    ],
)
def test_upward_and_downward_sweeps_differ_between_the_jumps(
    fmu: Instance, strength: float, solver: int
) -> None:
    """From rest, u1 moved between steps; between the folds each direction keeps its branch."""
    scene = one_mode(strength, quality=50.0)
    first, last = sorted(folds(scene))
    reach = last - first
    grid = np.linspace(first - 0.5 * reach, last + 0.5 * reach, 22)
    seen = []
    for direction in (grid, grid[::-1]):
        fmu.slave.reset()
        fmu.start(solver=solver, **(scene | {"u1": direction[0]}))
        now, rows = 0.0, []
        for u in direction:
            fmu.set(u1=u)
            assert fmu.step(now, 4.0 / scene["d1"]) == OK
            now += 4.0 / scene["d1"]
            rows.append(amplitude(fmu, scene | {"u1": u}, now))
            now += 1.0 / u
        seen.append(rows)
    up, down = np.array(seen[0]), np.array(seen[1][::-1])
    larger, smaller = (up, down) if strength > 0.0 else (down, up)
    for u, low, high in zip(grid, smaller, larger, strict=True):
        if min(abs(u - first), abs(u - last)) > 0.1 * reach:  # as near the folds are known
            wanted = branches(scene, u)
            assert len(wanted) == (3 if first < u < last else 1)
            assert [low, high] == pytest.approx([wanted[0], wanted[-1]], rel=0.12)


# --- spectra -------------------------------------------------------------------------------------


def peaks(rows: FloatArray, count: int, bins: list[int]) -> FloatArray:
    spectrum = 2.0 / count * np.abs(np.fft.rfft(rows[:, 0]))
    return np.array([spectrum[k] for k in bins])


def test_intermodulation_peaks_agree_with_the_full_equations(fmu: Instance) -> None:
    """u1, u2, 2 u1 - u2 and 2 u2 - u1 of the settled motion: envelope and rk4 to 1e-3."""
    scene = two_tones(100.0, 1.0, u1=996.0, u2=1004.0)
    window, count, settle = 0.25, 1024, 0.5
    bins = [round(u * window) for u in (996.0, 1004.0, 988.0, 1012.0)]
    times = settle + window * np.arange(count) / count
    rk4 = peaks(run(fmu, times, solver=RK4, rk4_substep=1.0 / 1.2e5, **scene), count, bins)
    assert np.min(rk4[2:]) > 0.02 * rk4[0]  # there are such peaks
    assert peaks(run(fmu, times, **scene), count, bins) == pytest.approx(rk4, rel=1e-3)
    steady = peaks(run(fmu, times - settle, periodic_start=True, **scene), count, bins)
    assert steady == pytest.approx(rk4, rel=1e-3)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        pytest.param({"alpha1": 0.0}, marks=pytest.mark.nightly),
        pytest.param({"kappa": 0.0}, marks=pytest.mark.nightly),
    ],
    ids=str,
)
def test_amplitudes_of_envelope_and_rk4_agree_within_the_envelopes_bound(
    fmu: Instance, changes: dict[str, float]
) -> None:
    """Steady lines of both modes: apart by less than eps (3 eps + spread) of the largest."""
    scene = two_tones(50.0, 0.8, u1=990.0, u2=1010.0) | changes
    window, count, settle = 0.1, 1024, 0.4
    bins = [round(u * window) for u in (990.0, 1010.0, 970.0, 1030.0)]
    times = settle + window * np.arange(count) / count
    rows = [
        run(fmu, times, **settings, **scene)
        for settings in ({"tolerance": 1e-8}, {"solver": RK4, "rk4_substep": window / count / 16})
    ]
    lines = np.array([[peaks(r[:, [k]], count, bins) for k in (0, 1)] for r in rows])
    eps = shift(scene, np.abs(rows[1]).max(axis=0))
    spread = max(scene["u2"] - scene["u1"], scene["eta_minus"] - scene["u1"]) / ETA
    errors = np.abs(lines[0] - lines[1]).max(axis=1) / lines[1].max(axis=1)
    assert errors.max() <= eps * (3.0 * eps + spread)
    assert errors.max() > 1e-6  # the scene is one that shows an error at all


def test_third_harmonic_is_that_of_the_closed_form(fmu: Instance) -> None:
    """|R| = alpha a^3/(4 (2 pi)^2 (9 u^2 - eta^2)), relative order eps, and as rk4 has it."""
    scene = one_mode(2.0) | {"u1": 1005.0}
    count = 64
    times = np.arange(1, count + 1) / (count * scene["u1"])
    found = []
    for solver in (ENVELOPE, RK4):
        fmu.slave.reset()
        rows = run(
            fmu,
            times,
            periodic_start=True,
            branch=1,
            solver=solver,
            rk4_substep=times[0] / 4.0,
            **scene,
        )
        found.append(peaks(rows, count, [1, 3]))
    (top, third), wanted = found
    eps = shift(scene, np.array([top, 0.0]))
    closed = scene["alpha1"] * top**3 / 4 / (2 * math.pi) ** 2 / (9 * scene["u1"] ** 2 - ETA**2)
    assert third == pytest.approx(closed, rel=4 * eps)
    assert [top, third] == pytest.approx(wanted, rel=3 * eps)
