"""The two-mode oscillator in this process: its solvers by scipy's exponential, its arithmetic."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from fmu_src.coupled_oscillator import CoupledOscillator
from fmu_src.oscillator_equations import Parameters
from fmu_src.oscillator_phase import Frequency, difference, kept_phases
from fmu_src.oscillator_precise import (
    Precise,
    add,
    in_precise_arithmetic,
    multiply,
    polynomial_differences,
    rational_differences,
    upper_factor,
)
from fmu_src.oscillator_single import error
from tests.support import reference
from tests.support.linear_motion import Modes, Piece, motion
from tests.support.oscillator_runs import GRID, communication_points, relative_errors
from tests.support.scenes import Scene
from tests.support.slaves import Slave

EXACT, ENVELOPE, RK4 = 0, 1, 2
QUASI_STATIC, LEFT_OUT = 1, 2
TWO_PI = 2.0 * math.pi
BOTH = ("q1_hybrid", "q2_hybrid")
Values = dict[str, Any]

BASE: Values = {
    "theta": 1.9,
    "reflection": False,
    "d1": 9.0,
    "d2": 4.0,
    "eta_plus": 1000.0,
    "eta_minus": 1300.0,
    "u1": 990.0,
    "u2": 1310.0,
    "A1": 1.5e6,
    "A2": 2.5e6,
    "phase1": 0.3,
    "phase2": -1.1,
    "g1": 1.0,
    "g2": 0.7,
}


def modes(p: Values) -> Modes:
    """The hybridised equations, D~ = T D T^T multiplied out."""
    c, s = math.cos(p["theta"]), math.sin(p["theta"])
    t = np.array([[-c, s], [s, c]] if p["reflection"] else [[c, -s], [s, c]])
    return Modes(
        np.diag([(TWO_PI * p["eta_plus"]) ** 2, (TWO_PI * p["eta_minus"]) ** 2]),
        TWO_PI * t @ np.diag([p["d1"], p["d2"]]) @ t.T,
        np.array([p["g1"], p["g2"]]),
        tuple((p[f"u{k}"], p[f"A{k}"], p[f"phase{k}"]) for k in (1, 2)),
        0.5 * (p["eta_plus"] + p["eta_minus"]),
    )


def apart(found: Any, truth: Any) -> float:
    """The largest error of a mode over its largest displacement."""
    sizes = np.abs(truth).max(axis=0)
    return float((np.abs(np.asarray(found) - truth).max(axis=0) / sizes).max())


SCENES: dict[str, Values] = {
    "rotation": {},
    "reflection": {"reflection": True},
    "a tone on each mode": {"d1": 1.0, "d2": 2.0, "u1": 1000.0, "u2": 1300.0},
    "one tone on a mode and one far off": {"d1": 1.0, "d2": 1.2, "u1": 1000.0, "u2": 700.0},
    "one tone far off and one on a mode": {"d1": 1.0, "d2": 1.2, "u1": 1700.0, "u2": 1300.0},
    "one tone": {"A2": 0.0},
    "the other tone": {"A1": 0.0},
    "close modes": {"eta_minus": 1000.3, "u2": 1000.1, "u1": 999.9},
    "exceptional point": {
        "theta": math.pi / 4,
        "d1": 15.0,
        "d2": 5.0,
        "eta_minus": 1005.0,
        "u1": 1002.5,
        "u2": 1004.0,
    },
    "one mode twice": {"eta_minus": 1000.0, "d1": 5.0, "d2": 5.0, "u2": 1000.0},
    "equal damping": {"d1": 7.0, "d2": 7.0},
    "one damping far below": {"d1": 100.0, "d2": 1e-3},
    "one damping far above": {"d1": 1e-3, "d2": 100.0},
    "undamped": {"d1": 0.0, "d2": 0.0},
    "growing": {"d1": -20.0, "d2": 4.0},
    "the higher mode first": {"eta_plus": 1300.0, "eta_minus": 900.0},
    "gone": {"d1": 300.0, "d2": 400.0},
    "the first gone": {"theta": 0.1, "d1": 600.0, "d2": 5.0},
    "the second gone": {"theta": 0.1, "d1": 5.0, "d2": 600.0},
    "no frequency": {"u1": 0.0},
}
TIMES = (1e-5, 4e-4, 2.9e-3, 4.1e-3, 0.0204, 0.0711)


@pytest.mark.parametrize("label", SCENES)
def test_exact_motion_from_rest_is_the_exponential(label: str) -> None:
    p = BASE | SCENES[label]
    found = Slave(CoupledOscillator, **p).run(TIMES, *BOTH)
    assert apart(found, motion([Piece(modes(p), TIMES)])) <= 1e-10


def test_long_after_the_transient_the_motion_is_the_orbit() -> None:
    p = BASE | {"d1": 20.0, "d2": 30.0}
    times = (3.0001, 3.0004, 3.0007)
    found = Slave(CoupledOscillator, **p).run(times, *BOTH)
    assert apart(found, motion([Piece(modes(p), times)], periodic=True)) <= 1e-9


@pytest.mark.parametrize("solver", [EXACT, ENVELOPE])
@pytest.mark.parametrize("label", ["rotation", "reflection", "a tone on each mode", "one tone"])
def test_a_start_on_the_orbit_stays_there(solver: int, label: str) -> None:
    p = BASE | SCENES[label]
    found = Slave(CoupledOscillator, solver=solver, periodic_start=True, **p).run(TIMES, *BOTH)
    truth = motion([Piece(modes(p), TIMES)], periodic=True, envelope=solver == ENVELOPE)
    assert apart(found, truth) <= 1e-10


@pytest.mark.parametrize(
    "label", [name for name in SCENES if name not in ("no frequency", "growing")]
)
def test_the_envelope_is_the_exponential_of_the_rotating_frame(label: str) -> None:
    p = BASE | SCENES[label]
    found = Slave(CoupledOscillator, solver=ENVELOPE, **p).run(TIMES, *BOTH)
    assert apart(found, motion([Piece(modes(p), TIMES)], envelope=True)) <= 1e-10


CHANGES: tuple[Values, ...] = (
    {"u1": 1003.0, "phase2": 0.6},
    {"theta": 0.4, "d2": 30.0, "u2": 1290.0},
    {"A1": 0.0, "A2": 0.0, "eta_plus": 1011.0},
    {"A2": 1e6, "g2": -0.6},
)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize(
    ("solver", "worst"), [(EXACT, 1e-10), (ENVELOPE, 1e-10), (RK4, 2e-7)], ids=["0", "1", "2"]
)
def test_changed_parameters_keep_state_and_phase(solver: int, worst: float, periodic: bool) -> None:
    p: Values = BASE
    settings = {"solver": solver, "periodic_start": periodic, "rk4_substep": 2e-6}
    slave = Slave(CoupledOscillator, **p, **settings)
    pieces, found = [], []
    for k, changes in enumerate(({}, *CHANGES)):
        p = p | changes
        slave.set(**changes)
        times = tuple(0.004 * k + x for x in (3e-5, 0.0017, 0.004))
        pieces.append(Piece(modes(p), times))
        found += slave.run(times, *BOTH)
    assert apart(found, motion(pieces, periodic=periodic, envelope=solver == ENVELOPE)) <= worst


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize(("solver", "worst"), [(EXACT, 1e-10), (RK4, 2e-7)], ids=["0", "2"])
def test_a_held_input_drives_both_modes(solver: int, worst: float, periodic: bool) -> None:
    inputs = (3e6, -2e6, 5e6, 0.0)
    settings = {"solver": solver, "periodic_start": periodic, "rk4_substep": 2e-6}
    slave = Slave(CoupledOscillator, b=inputs[0], **BASE, **settings)
    pieces, found = [], []
    for k, b in enumerate(inputs):
        times = tuple(0.0021 * k + x for x in (3e-5, 0.0007, 0.0021))
        pieces.append(Piece(modes(BASE), times, b))
        slave.set(b=b)
        found += slave.run(times, *BOTH)
    assert apart(found, motion(pieces, periodic=periodic)) <= worst


@pytest.mark.parametrize("solver", [EXACT, RK4])
def test_a_later_start_begins_with_the_phases_reached(solver: int) -> None:
    begin, times = 7.25, (7.2503, 7.2611)
    slave = Slave(CoupledOscillator, begin, **BASE, solver=solver, rk4_substep=2e-6)
    truth = motion([Piece(modes(BASE), times)], begin=begin)
    assert apart(slave.run(times, *BOTH), truth) <= (1e-10 if solver == EXACT else 2e-7)


@pytest.mark.parametrize(
    "fast", [{"eta_minus": 4000.0}, {"eta_plus": 4000.0}, {"u1": 4000.0}, {"u2": 4000.0}], ids=str
)
def test_a_substep_left_to_rk4_follows_the_fastest_motion(fast: Values) -> None:
    """A fortieth of a period: (2 pi/40)^4/120 of each rad, 25 rad here."""
    p = BASE | fast
    times = (5e-4, 1e-3)
    found = Slave(CoupledOscillator, solver=RK4, **p).run(times, *BOTH)
    assert apart(found, motion([Piece(modes(p), times)])) <= 25.0 * (TWO_PI / 40.0) ** 4 / 120.0
    asked = Slave(CoupledOscillator, solver=RK4, rk4_substep=1.0 / (40.0 * 4000.0), **p)
    assert asked.run(times, *BOTH) == found


@pytest.mark.parametrize(
    "label",
    [
        "a tone on each mode",
        "one tone on a mode and one far off",
        "one tone far off and one on a mode",
    ],
)
@pytest.mark.parametrize("solver", [EXACT, ENVELOPE])
def test_a_change_keeps_the_state_while_a_tone_and_its_mode_are_still_in_phase(
    solver: int, label: str
) -> None:
    p = BASE | SCENES[label]
    slave = Slave(CoupledOscillator, **p, solver=solver)
    pieces, found = [], []
    for k, d2 in enumerate((p["d2"], 0.7, 1.4, 0.9)):
        times = (7.1e-4 * (k + 0.4), 7.1e-4 * (k + 1.0))
        p = p | {"d2": d2}
        slave.set(d2=d2)
        pieces.append(Piece(modes(p), times))
        found += slave.run(times, *BOTH)
    assert apart(found, motion(pieces, envelope=solver == ENVELOPE)) <= 1e-10


def test_a_frame_that_does_not_rotate_is_refused() -> None:
    p = BASE | {"u1": 0.0, "u2": 0.0}
    slave = Slave(CoupledOscillator, solver=ENVELOPE, **p)
    assert not slave.step(1e-3)
    assert "solver 1 (envelope)" in slave.message
    assert "above 0 Hz" in slave.message
    p = p | {"eta_plus": 1.1, "eta_minus": 1.2, "d1": 0.1, "d2": 0.2, "u1": 1.0, "u2": 1.0}
    slave = Slave(CoupledOscillator, solver=ENVELOPE, **p)
    truth = motion([Piece(modes(p), (0.3, 1.7))], envelope=True)
    assert apart(slave.run((0.3, 1.7), *BOTH), truth) <= 1e-10


@pytest.mark.parametrize("name", ["d1", "d2"])
def test_only_a_start_on_the_orbit_needs_damping_and_little_is_enough(name: str) -> None:
    p = BASE | {"d1": 1e-3, "d2": 1e-3}
    Slave(CoupledOscillator, periodic_start=True, **p).run((1e-3,), *BOTH)
    Slave(CoupledOscillator, **(p | {name: 0.0})).run((1e-3,), *BOTH)
    slave = Slave(CoupledOscillator, periodic_start=True, **(p | {name: 0.0}))
    assert not slave.step(1e-3)
    assert f"{name} = 0.0 Hz: " in slave.message


def test_rk4_that_leaves_the_range_of_numbers_tells_a_stable_substep() -> None:
    """Classical Runge-Kutta is stable on the imaginary axis up to sqrt(8)."""
    slave = Slave(CoupledOscillator, solver=RK4, rk4_substep=1e-3, **BASE)
    assert not slave.step(1.0)
    assert "t = 1.0 s" in slave.message
    told = float(slave.message.split("substep is below ")[1].split(" ")[0])
    assert told == pytest.approx(math.sqrt(8.0) / (TWO_PI * 1300.0), rel=0.02)


def test_a_restored_run_goes_on_as_the_run_did() -> None:
    for settings in ({"solver": EXACT}, {"solver": RK4}, {"other_mode": QUASI_STATIC}):
        slave = Slave(CoupledOscillator, **BASE, **settings)
        slave.run((1e-3,), *BOTH)
        slave.set(b=1e6, u1=1003.0)
        slave.run((2e-3,), *BOTH)
        kept = slave.state()
        whole = slave.run((3e-3, 4e-3), *BOTH)
        again = Slave(CoupledOscillator, **BASE, **settings)
        again.take(kept)
        assert again.run((3e-3, 4e-3), *BOTH) == whole


@pytest.mark.parametrize("scene", GRID[7::37], ids=lambda scene: scene.label)
def test_some_scenes_at_fifty_digits(scene: Scene) -> None:
    """Quality factors, frequencies and times that a double's exponential cannot follow."""
    times = communication_points(scene)
    slave = Slave(CoupledOscillator, **scene.parameters)
    found = []
    for k, time in enumerate(times):
        slave.set(b=scene.inputs[k] if scene.inputs else 0.0)
        found += slave.run([time], *BOTH)
    assert max(relative_errors(scene, found, times)) <= 1e-9


@pytest.mark.parametrize(
    "widths", [{"d1": 5e3, "d2": 4e3}, {"d1": 5e3, "d2": 1.0}, {"d1": 1.0, "d2": 5e3}], ids=str
)
def test_an_overdamped_mode_is_left_to_rk4(widths: Values) -> None:
    p = BASE | widths
    slave = Slave(CoupledOscillator, **p)
    assert not slave.step(1e-5)
    assert "overdamped" in slave.message
    found = Slave(CoupledOscillator, solver=RK4, rk4_substep=2e-6, **p).run(TIMES[:3], *BOTH)
    assert apart(found, motion([Piece(modes(p), TIMES[:3])])) <= 1e-7


@pytest.mark.parametrize("settings", [{}, {"solver": ENVELOPE}, {"other_mode": 1}], ids=str)
@pytest.mark.parametrize("growing", ["d1", "d2"])
def test_a_mode_that_grows_out_of_range_ends_the_run(growing: str, settings: Values) -> None:
    """exp(pi 20 t) passes the largest double at 11.3 s, whatever the other mode does."""
    own = {"d1": 40.0, "d2": 40.0, "u1": 990.0, "u2": 991.0, "theta": 0.0} | {growing: -20.0}
    if growing == "d2":
        own |= {"u1": 1302.0, "u2": 1303.0}
    slave = Slave(CoupledOscillator, **(BASE | own | settings))
    assert slave.step(10.0)
    assert all(map(math.isfinite, slave.get(*BOTH)))
    assert not slave.step(13.0)
    assert "before 13.0 s" in slave.message


@pytest.mark.parametrize("solver", [EXACT, ENVELOPE])
def test_slow_growth_out_of_range_ends_a_run_as_well(solver: int) -> None:
    """exp(pi 0.2 t) passes the largest double at 1130 s."""
    own = {"d1": -0.2, "d2": 40.0, "u1": 990.0, "u2": 991.0, "theta": 0.0}
    slave = Slave(CoupledOscillator, solver=solver, **(BASE | own))
    assert slave.step(1000.0)
    assert all(map(math.isfinite, slave.get(*BOTH)))
    assert not slave.step(1200.0)
    assert "before 1200.0 s" in slave.message


def test_a_model_that_is_given_nothing_is_the_published_string() -> None:
    """The phasors of both tones on the pair of arXiv:2412.07301, T a rotation, by mpmath."""
    slave = Slave(CoupledOscillator)
    assert slave.step(1e-6)
    string = Scene("published", eta_plus=6.94026e6, eta_minus=7.02760e6)
    for tone, u in enumerate((string.u1, string.u2), start=1):
        for mode, x in enumerate(reference.phasors(string, u), start=1):
            found = complex(*slave.get(*(f"q{mode}_hybrid_{part}_u{tone}" for part in "XY")))
            assert abs(found - complex(x)) <= 1e-13 * abs(complex(x))


@pytest.mark.parametrize("theta", [1.9, 2.9, -0.4, 0.4])
@pytest.mark.parametrize("reflection", [False, True])
def test_what_the_parameters_say_is_multiplied_out(theta: float, reflection: bool) -> None:
    """C = T^T C~ T and D~ = T D T^T; lambda is real where C_12 is not above 0."""
    p = BASE | {"theta": theta, "reflection": reflection}
    slave = Slave(CoupledOscillator, **p)
    c, s = math.cos(theta), math.sin(theta)
    t = np.array([[-c, s], [s, c]] if reflection else [[c, -s], [s, c]])
    stiffness = t.T @ np.diag([p["eta_plus"] ** 2, p["eta_minus"] ** 2]) @ t
    coupling, f1, f2, *matrix = slave.get("lambda", "f1", "f2", "D11", "D22", "D12")
    assert [f1**2, f2**2] == pytest.approx(np.diag(stiffness), rel=1e-12)
    if stiffness[0, 1] > 0.0:
        assert math.isnan(coupling)
    else:
        assert coupling**2 == pytest.approx(-stiffness[0, 1], rel=1e-12)
    truth = modes(p).damping
    assert matrix == pytest.approx([truth[0, 0], truth[1, 1], truth[0, 1]], rel=1e-12)
    slave.step(0.3e-3)
    assert slave.get("q1", "q2") == pytest.approx((t.T @ slave.get(*BOTH)).tolist(), rel=1e-12)


# --- one mode alone


def alone(p: Values, near: int) -> Modes:
    """The equation of one mode without the other."""
    full = modes(p)
    pick = slice(near, near + 1)
    return Modes(full.stiffness[pick, pick], full.damping[pick, pick], full.gains[pick], full.tones)


def beside(p: Values, near: int, times: tuple[float, ...], b: float = 0.0) -> Any:
    """The quasi-static mode: at each tone driven by its own gain and by the near mode's motion."""
    full, far = modes(p), 1 - near
    total = np.full(len(times), full.gains[far] * b / full.stiffness[far, far])
    for u, size, phase in full.tones:
        w = TWO_PI * u
        own = [full.stiffness[i, i] - w * w + 1j * w * full.damping[i, i] for i in range(2)]
        x = full.gains[near] / own[near]
        z = (full.gains[far] - 1j * w * full.damping[0, 1] * x) / own[far]
        total = total + (z * size * np.exp(1j * (w * np.array(times) + phase))).real
    return total


ALONE: dict[str, tuple[Values, int]] = {
    "near the first": ({"u1": 990.0, "u2": 1012.0, "d1": 40.0}, 0),
    "near the second": ({"u1": 1290.0, "u2": 1312.0, "d1": 40.0}, 1),
    "reflection": ({"u1": 1290.0, "u2": 1312.0, "d1": 40.0, "reflection": True}, 1),
    "lower second": ({"u1": 905.0, "u2": 895.0, "eta_minus": 900.0, "g1": -1.0}, 1),
    "growing": ({"u1": 990.0, "u2": 1012.0, "d1": -9.0, "d2": -3.0}, 0),
}


@pytest.mark.parametrize("label", ALONE)
@pytest.mark.parametrize("other", [QUASI_STATIC, LEFT_OUT])
@pytest.mark.parametrize("periodic", [False, True])
def test_one_mode_moves_by_its_own_equation(label: str, other: int, periodic: bool) -> None:
    changes, near = ALONE[label]
    p = BASE | changes
    if periodic and label == "growing":
        p = p | {"d1": 9.0}
    if periodic and p["d2"] < 0.0:
        p = p | {"d2": 3.0}
    settings = {"other_mode": other, "periodic_start": periodic}
    slave = Slave(CoupledOscillator, **p, b=4e6, **settings)
    found, pieces, wanted = [], [], []
    for k, (b, more) in enumerate(((4e6, {}), (-1e6, {}), (2e6, {"u1": p["u1"] + 3.0}))):
        times = tuple(0.003 * k + x for x in (3e-5, 0.0007, 0.003))
        slave.set(b=b, **more)
        p = p | more
        if more:  # the phase goes on: that of the new tone at time 0
            p = p | {"phase1": p["phase1"] - TWO_PI * 3.0 * 0.006}
        found += slave.run(times, *BOTH)
        kept = dict(p) | {"phase1": BASE["phase1"]}
        pieces.append(Piece(alone(kept, near), times, b))
        wanted += list(beside(p, near, times, b))
    found_near, found_far = np.array(found)[:, [near]], np.array(found)[:, 1 - near]
    assert apart(found_near, motion(pieces, periodic=periodic)) <= 1e-10
    if other == LEFT_OUT:
        assert not found_far.any()
    else:
        assert found_far == pytest.approx(np.array(wanted), abs=1e-10 * np.abs(wanted).max())


def test_a_mode_of_a_tenth_of_a_hertz_alone_is_not_overdamped() -> None:
    p = BASE | {"u1": 0.105, "u2": 0.11, "eta_plus": 0.1, "eta_minus": 0.12, "d1": 0.01, "d2": 0.02}
    times = 0.5, 3.0, 9.0
    slave = Slave(CoupledOscillator, **p, b=4.0, other_mode=LEFT_OUT)
    found = np.array(slave.run(times, *BOTH))[:, [0]]
    assert apart(found, motion([Piece(alone(p, 0), times, 4.0)], periodic=False)) <= 1e-10


@pytest.mark.parametrize("settings", [{"other_mode": 1}, {"other_mode": 2}, {"solver": 1}], ids=str)
def test_what_is_left_out_is_told(settings: Values) -> None:
    """The worse tone of each mode, against the full equations."""
    p = BASE | {"u1": 1003.0, "u2": 1060.0}
    slave = Slave(CoupledOscillator, **p, **settings, periodic_start=True)
    full = modes(p)
    for mode in (0, 1):
        errors = []
        for tone, (u, size, phase) in enumerate(full.tones, start=1):
            names = (f"q{mode + 1}_hybrid_{part}_u{tone}" for part in "XY")
            x = full.response(u)[mode] * size * np.exp(1j * phase)
            errors.append(abs(complex(*slave.get(*names)) - x) / abs(x))
        told = slave.get(f"q{mode + 1}_hybrid_error")[0]
        assert told == pytest.approx(max(errors), rel=1e-7)


def test_an_amplitude_where_there_is_none_is_wrong_by_its_whole_size() -> None:
    """And so is none where there is one: the error is 1. An undriven, uncoupled mode rests."""
    p = Parameters(**(BASE | {"theta": 0.0, "g2": 0.0}))
    x = complex(modes(BASE | {"theta": 0.0, "g2": 0.0}).response(p.u1)[0])
    assert error(p, (x, 0j), p.u1) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert error(p, (0j, 0j), p.u1) == (1.0, 0.0)
    assert error(p, (x, 1e-9j), p.u1) == pytest.approx((0.0, 1.0), abs=1e-12)


# --- phases and precise numbers


@pytest.mark.parametrize("hz", [6.94026e6, 1e10 + 0.3, 1e-3, 0.0])
@pytest.mark.parametrize("t", [1e4 + 0.1, 1.0 / 3.0, 1e-9, -2.7, 0.0])
def test_cycles_are_those_of_fractions(hz: float, t: float) -> None:
    low, t_low = hz * 3e-17, t * 2e-17
    whole = (Fraction(hz) + Fraction(low)) * (Fraction(t) + Fraction(t_low))
    rest = Fraction(Frequency(hz, low).cycles(t, t_low)) - whole
    assert abs(rest - round(rest)) < Fraction(1, 10**15)
    high, left = difference(t, hz * 1e-7)
    assert Fraction(high) + Fraction(left) == Fraction(t) - Fraction(hz * 1e-7)


def test_kept_phases_are_those_of_fractions() -> None:
    t, before, after, offsets = 1234.1, (7e6 + 0.3, 5e3), (7.1e6, 5e3), (0.2, 0.7)
    found = kept_phases(offsets, before, after, t)
    for old, u, new, kept in zip(offsets, before, after, found, strict=True):
        jump = (Fraction(old) + Fraction(u) * Fraction(t)) - (
            Fraction(kept) + Fraction(new) * Fraction(t)
        )
        assert abs(jump - round(jump)) < Fraction(1, 10**14)


def precise(z: Any) -> Precise:
    return Precise(z.real, z.imag)


def number(z: Precise) -> Any:
    return mp.mpc(str(z.re), str(z.im))


def close(found: Precise, truth: Any, digits: int = 45) -> bool:
    return bool(abs(number(found) - truth) <= mp.mpf(10) ** -digits * abs(truth))


@pytest.mark.parametrize("a", [1.5 - 2.5j, -3.0 + 1e-9j, -3.0 - 1e-9j, 1e9 + 1e-3j, -2.0 + 0j])
def test_precise_numbers_are_those_of_mpmath(a: complex) -> None:
    b = 0.3 + 7.1j
    with in_precise_arithmetic(), mp.workdps(60):
        x, y, wide, other = precise(a), precise(b), mp.mpc(a), mp.mpc(b)
        assert close(x * y, wide * other)
        assert close(x / y, wide / other)
        assert close(x + y, wide + other)
        assert close(x - y, wide - other)
        assert close(-x, -wide)
        assert close(x.conjugate(), mp.conj(wide))
        root = x.sqrt()
        assert close(root, mp.sqrt(wide))
        re, im, low = root.split()
        assert re == float(root.re)
        assert abs(mp.mpf(im) + mp.mpf(low) - mp.mpf(str(root.im))) <= 1e-31 * abs(im)


def evaluated(p: list[complex], x: Any) -> Any:
    return mp.fsum(mp.mpc(c) * x**k for k, c in enumerate(p))


@pytest.mark.parametrize(
    "nodes", [(0.3 + 1j, -0.7 + 2j, 1.1 - 1j), (0.3 + 1j, 0.3 + 1j, -2.0 + 0j)]
)
def test_divided_differences_are_contour_integrals(nodes: tuple[complex, ...]) -> None:
    """f[n0, ..., nj] = 1/(2 pi i) times the integral of f(x)/((x - n0) ... (x - nj)) around all."""
    a, b = [0.2 - 1j, 1.0 + 0.5j, 0.0j, -2.0 + 0j], [1.0 + 0j, 2.0 - 1j]
    below = [900.0 + 0j, 3.0 + 0j, 1.0 + 0j]  # roots far out
    with in_precise_arithmetic(), mp.workdps(60):
        numbers = [precise(n) for n in nodes]
        left, right = [precise(c) for c in a], [precise(c) for c in b]
        product, total = multiply(left, right), add(left, right)
        table = polynomial_differences([precise(c) for c in below], numbers)
        ratio = rational_differences(left, table, numbers)
        x0 = mp.mpc(0.4, 0.9)
        for polynomial, truth in (
            (product, evaluated(a, x0) * evaluated(b, x0)),
            (total, evaluated(a, x0) + evaluated(b, x0)),
        ):
            value = mp.fsum(number(c) * x0**k for k, c in enumerate(polynomial))
            assert abs(value - truth) <= mp.mpf(10) ** -45 * abs(truth)
        count, radius = 256, mp.mpf(6)
        circle = [radius * mp.expj(2 * mp.pi * k / count) for k in range(count)]
        for j in range(len(nodes)):
            weights = [x / mp.fprod(x - mp.mpc(n) for n in nodes[: j + 1]) for x in circle]
            values = [(evaluated(a, x), evaluated(below, x)) for x in circle]
            found = (ratio[j], table[0][j])
            functions = ([y / z for y, z in values], [z for _, z in values])
            for made, function in zip(found, functions, strict=True):
                integral = mp.fdot(function, weights) / count
                assert abs(number(made) - integral) <= mp.mpf(10) ** -40


@pytest.mark.parametrize("roots", [(-3.0 + 50j, -1.0 + 61j), (-2.0 + 50j, -2.0 + 50j)])
def test_the_upper_factor_holds_the_roots_above_the_axis(roots: tuple[complex, complex]) -> None:
    with in_precise_arithmetic(), mp.workdps(60):
        one = Precise(1)
        quartic = [one]
        for root in roots:
            x = precise(root)
            quartic = multiply(multiply(quartic, [-x, one]), [-x.conjugate(), one])
        near = [precise(root + 0.7 - 1.9j * k) for k, root in enumerate(roots, start=1)]
        e1, e2 = upper_factor(quartic, (near[0] + near[1], near[0] * near[1]))
        assert close(e1, mp.mpc(roots[0]) + mp.mpc(roots[1]), 42)
        assert close(e2, mp.mpc(roots[0]) * mp.mpc(roots[1]), 42)


def test_a_factor_is_settled_when_both_of_its_coefficients_are() -> None:
    """Roots i and 5i, from x^2 - i sqrt(32) x - 7: Newton's first step keeps the linear term.

    With U = x^2 - i E x - F it does where (26 - E^2 + 2 F)^2 = 2 (25 + F (26 - E^2 + F)).
    """
    with in_precise_arithmetic(), mp.workdps(60):
        quartic = [Precise(c) for c in (25, 0, 26, 0, 1)]
        e1, e2 = upper_factor(quartic, (Precise(-32).sqrt(), Precise(-7)))
        assert close(e1, mp.mpc(0, 6), 42)
        assert close(e2, mp.mpc(-5), 42)
