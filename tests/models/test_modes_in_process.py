"""N modes in this process, by the calls that a host makes, against scipy and numpy."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest

from fmu_src import coupled_modes, modes_steady, modes_tails
from fmu_src.modes_equations import SINGLE, Parameters, matrices, pairs
from fmu_src.modes_linear import ModesSolver, at_rest
from fmu_src.modes_rk4 import ModesRungeKutta
from fmu_src.modes_tails import Side
from fmu_src.oscillator_precise import in_precise_arithmetic
from fmu_src.start_values import BuildError, checked_start_values
from tests.support.linear_motion import Modes, Piece, motion
from tests.support.modes_scenes import PUMP, THREE, TONES
from tests.support.slaves import Slave

EXACT, ENVELOPE, RK4 = 0, 1, 2
TWO_PI = 2.0 * math.pi
ROWS = ("f", "d", "g", "depth_f")
Values = dict[str, Any]


def model(n: int) -> Any:
    return getattr(coupled_modes, f"CoupledModes{n}")


def started(p: Values, **settings: Any) -> Slave:
    return Slave(model(count(p)), **p, **settings)


def count(p: Values) -> int:
    return sum(name[0] == "f" for name in p)


def names(p: Values) -> list[str]:
    return [f"q{i + 1}" for i in range(count(p))]


def modes(p: Values) -> Modes:
    """The equations as they stand."""
    n = count(p)
    c, pump = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        c[i, i] = (TWO_PI * p[f"f{i + 1}"]) ** 2
        pump[i, i] = c[i, i] * p.get(f"depth_f{i + 1}", 0.0)
    for i, j in itertools.combinations(range(n), 2):
        mark = f"lambda{i + 1}{j + 1}"
        c[i, j] = c[j, i] = -((TWO_PI * p[mark]) ** 2)
        pump[i, j] = pump[j, i] = c[i, j] * p.get(f"depth_{mark}", 0.0)
    return Modes(
        c,
        TWO_PI * np.diag([p[f"d{i + 1}"] for i in range(n)]),
        np.array([p[f"g{i + 1}"] for i in range(n)]),
        tuple((p[f"u{k}"], p[f"A{k}"], p[f"phase{k}"]) for k in (1, 2)),
        float(np.mean([p[f"f{i + 1}"] for i in range(n)])),
        pump if pump.any() else None,
        p.get("pump_hz", 0.0),
        p.get("pump_phase", 0.0),
    )


def parameters(p: Values) -> Parameters:
    """The parameters without an FMU around them."""
    n = count(p)
    marks = [f"lambda{i + 1}{j + 1}" for i, j in pairs(n)]
    rows: dict[str, Any] = {
        name: tuple(p.get(f"{name}{i + 1}", 0.0) for i in range(n)) for name in ROWS
    }
    return Parameters(
        **rows,
        coupling=tuple(p[mark] for mark in marks),
        depth_coupling=tuple(p.get(f"depth_{mark}", 0.0) for mark in marks),
        **{name: p.get(name, 0.0) for name in SINGLE},
    )


def apart(found: Any, truth: Any) -> float:
    """The largest error over the largest displacement."""
    return float(np.abs(np.asarray(found) - truth).max() / np.abs(truth).max())


TWO: Values = TONES | {
    "f1": 1.0,
    "f2": 1.3,
    "d1": 0.05,
    "d2": 0.08,
    "lambda12": 0.4,
    "g1": 1.0,
    "g2": -0.5,
}
ONE: Values = TONES | {"f1": 1.1, "d1": 0.07, "g1": -0.8}
FAST_PUMP: Values = PUMP | {"pump_hz": 3.3}
SLOW_PUMP: Values = {"pump_hz": 0.0031, "pump_phase": -0.4, "depth_f2": 1e-3}
UNPUMPED: dict[str, Values] = {
    "one mode": ONE,
    "two modes": TWO,
    "three modes": THREE,
    "exceptional point": TWO
    | {"f1": 1.0, "f2": 1.0, "lambda12": math.sqrt(0.01), "d1": 0.02, "d2": 0.06},
    "one eigenvalue twice": TWO | {"f2": 1.0, "lambda12": 0.0, "d2": 0.05, "u1": 1.0},
    "overdamped": TWO | {"d1": 5.0},
    "growing": TWO | {"d1": -0.05, "d2": 0.01},
    "one tone": TWO | {"A1": 0.0},
    "one mode left alone": TWO | {"lambda12": 0.0, "g2": 0.0},
}
PUMPED: dict[str, Values] = {
    "pumped": THREE | PUMP,
    "fast pump": THREE | FAST_PUMP,
    "slow pump": THREE | SLOW_PUMP,
    "one pumped mode": ONE | {"pump_hz": 0.45, "depth_f1": 0.2, "pump_phase": 2.0},
}
SCENES = UNPUMPED | PUMPED
TIMES = (0.01, 0.13, 0.9, 4.4, 11.3)


def worst(solver: int) -> float:
    """Of the steps of rk4 here, (2 pi 1.5/2000)^4/120 of each of 200 rad, the most that counts."""
    return 1e-9 if solver == RK4 else 2e-10


@pytest.mark.parametrize(
    ("solver", "label"),
    [
        *((solver, label) for solver in (EXACT, ENVELOPE) for label in SCENES),
        *((RK4, label) for label in ("one mode", "growing")),
        *(pytest.param(RK4, x, marks=pytest.mark.nightly) for x in ("two modes", "pumped")),
    ],
)
def test_motion_from_rest_is_that_of_scipy(solver: int, label: str) -> None:
    p = SCENES[label]
    found = started(p, solver=solver, rk4_substep=5e-4 if solver == RK4 else 0.0)
    times = TIMES[: 4 if solver == RK4 else 5]
    truth = motion([Piece(modes(p), times)], envelope=solver == ENVELOPE)
    assert apart(found.run(times, *names(p)), truth) <= worst(solver)


@pytest.mark.parametrize("label", [name for name in SCENES if name != "growing"])
@pytest.mark.parametrize("solver", [EXACT, ENVELOPE])
def test_a_start_on_the_orbit_stays_there(solver: int, label: str) -> None:
    p = SCENES[label]
    found = started(p, solver=solver, periodic_start=True).run(TIMES[:4], *names(p))
    truth = motion([Piece(modes(p), TIMES[:4])], periodic=True, envelope=solver == ENVELOPE)
    assert apart(found, truth) <= worst(solver)


@pytest.mark.parametrize("solver", [EXACT, RK4])
def test_a_start_from_rest_is_at_rest(solver: int) -> None:
    """One displacement and one velocity of each mode, whoever tells them."""
    p = parameters(THREE)
    made = ModesSolver(p, False) if solver == EXACT else ModesRungeKutta(p, 0.0)
    rest = at_rest(3)
    made.start(0.4, rest, 0.0)
    if isinstance(made, ModesSolver):
        found = [float(x) for x in made.full_state(0.4)]
    else:
        found = made.snapshot()["q"] + made.snapshot()["v"]
    assert found == pytest.approx([0.0] * 6, abs=1e-15)
    assert len(rest) == len(found)


CHANGES: tuple[Values, ...] = (
    {"u1": 1.03, "phase2": 0.6},
    {"lambda12": 0.3, "d2": 0.2, "u2": 1.25},
    {"A1": 0.0, "A2": 0.0, "f1": 1.02},
    {"A2": 1.4, "g2": -0.6},
)


@pytest.mark.parametrize(
    ("solver", "periodic", "pump"),
    [
        *((solver, periodic, "no") for solver in (0, 1) for periodic in (False, True)),
        *((RK4, True, "no"), (EXACT, False, "strong"), (ENVELOPE, False, "slow")),
        *(
            pytest.param(*way, marks=pytest.mark.nightly)
            for way in (
                (RK4, False, "no"),
                (ENVELOPE, True, "strong"),
                (RK4, False, "strong"),
                (EXACT, True, "slow"),
                (RK4, True, "slow"),
            )
        ),
    ],
)
def test_changed_parameters_keep_state_and_phase(solver: int, periodic: bool, pump: str) -> None:
    pumped = {"no": {}, "strong": PUMP, "slow": SLOW_PUMP}[pump]
    p = THREE | pumped
    settings = {"solver": solver, "periodic_start": periodic, "rk4_substep": 1e-3}
    slave = started(p, **settings)
    pieces, found = [], []
    for k, changes in enumerate(({}, *CHANGES)):
        more = changes | ({"pump_hz": 0.4, "depth_f3": -0.1} if pumped and k == 2 else {})
        p = p | more
        slave.set(**more)
        times = tuple(1.7 * k + x for x in (0.02, 0.7, 1.7))
        pieces.append(Piece(modes(p), times))
        found += slave.run(times, *names(p))
    truth = motion(pieces, periodic=periodic, envelope=solver == ENVELOPE)
    assert apart(found, truth) <= (1e-8 if solver == RK4 else 3e-10)


@pytest.mark.parametrize(
    ("solver", "periodic", "pump"),
    [(EXACT, False, {}), (EXACT, True, PUMP), (RK4, False, PUMP), (RK4, True, {})],
    ids=["exact", "exact on the orbit, pumped", "rk4, pumped", "rk4 on the orbit"],
)
def test_a_held_input_drives_all_modes(solver: int, periodic: bool, pump: Values) -> None:
    p, inputs = THREE | pump, (3.0, -2.0, 5.0, 0.0)
    settings = {"solver": solver, "periodic_start": periodic, "rk4_substep": 1e-3}
    slave = started(p, b=inputs[0], **settings)
    pieces, found = [], []
    for k, b in enumerate(inputs):
        times = tuple(1.1 * k + x for x in (0.02, 0.3, 1.1))
        pieces.append(Piece(modes(p), times, b))
        slave.set(b=b)
        found += slave.run(times, *names(p))
    assert apart(found, motion(pieces, periodic=periodic)) <= (1e-8 if solver == RK4 else 3e-10)


@pytest.mark.parametrize("label", ["three modes", "pumped", "fast pump", "one pumped mode"])
@pytest.mark.parametrize("solver", [EXACT, ENVELOPE])
def test_a_later_start_leads_to_the_orbit(solver: int, label: str) -> None:
    """Hundreds of pump periods later, transients of exp(-pi 0.05 t) gone."""
    p = SCENES[label]
    begin, times = 12.7, (312.9, 313.3)
    slave = Slave(model(count(p)), begin, **p, solver=solver)
    kind = solver == ENVELOPE
    truth = []
    for t in times:
        total = np.zeros(count(p))
        for u, size, phase in modes(p).tones:
            for k, x in modes(p).sidebands(u, envelope=kind).items():
                turn = TWO_PI * (u + k * p.get("pump_hz", 0.0)) * t + phase
                total = total + (x * size * np.exp(1j * turn)).real
        truth.append(total)
    assert apart(slave.run(times, *names(p)), np.array(truth)) <= 1e-9


@pytest.mark.parametrize("solver", [EXACT, RK4])
@pytest.mark.parametrize("label", ["two modes", "pumped"])
def test_a_restored_run_goes_on_as_the_run_did(label: str, solver: int) -> None:
    p = SCENES[label]
    slave = started(p, solver=solver)
    slave.run([0.4], "q1")
    slave.set(b=1.0, u1=0.9)
    slave.run([0.9], "q1")
    slave.set(u2=1.4)  # each tone has a phase of its own to keep
    slave.run([5.0], "q1")
    kept = slave.state()
    whole = slave.run([5.5, 9.0], *names(p))
    again = started(p, solver=solver)
    again.take(kept)
    assert again.run([5.5, 9.0], *names(p)) == whole


@pytest.mark.parametrize(
    "fast", [{"f3": 4.0}, {"d1": 4.0}, {"u1": 4.0}, {"u2": 4.0}, {"pump_hz": 4.0}], ids=str
)
def test_a_substep_left_to_rk4_is_a_fortieth_of_the_shortest_period(fast: Values) -> None:
    p = THREE | {"lambda13": 0.0, "lambda23": 0.0} | PUMP | fast
    found = started(p, solver=RK4).run([0.3, 1.1], *names(p))
    asked = started(p, solver=RK4, rk4_substep=1.0 / (40.0 * 4.0))
    assert found == asked.run([0.3, 1.1], *names(p))


def test_rk4_that_leaves_the_range_of_numbers_tells_a_stable_substep() -> None:
    """Classical Runge-Kutta is stable on the imaginary axis up to sqrt(8)."""
    slave = started(ONE, solver=RK4, rk4_substep=1.0)
    assert not slave.step(500.0)
    assert "t = 500.0 s" in slave.message
    told = float(slave.message.split("substep is below ")[1].split(" ")[0])
    assert told == pytest.approx(math.sqrt(8.0) / (TWO_PI * 1.1), rel=0.02)


# --- what is told


def quadratures(slave: Slave, name: str, tone: int, side: str = "") -> complex:
    return complex(*slave.get(*(f"{name}_{part}_u{tone}{side}" for part in "XY")))


READOUT = {"readout1": 0.7, "readout2": -1.2}


@pytest.mark.parametrize("label", ["two modes", "one tone", "three modes", "pumped", "slow pump"])
@pytest.mark.parametrize("solver", [EXACT, ENVELOPE, RK4])
def test_lock_in_and_sidebands_are_those_of_a_dense_solve(solver: int, label: str) -> None:
    p = SCENES[label]
    slave = started(p, solver=solver, **READOUT)
    weights = np.array([0.7, -1.2, 0.0])[: count(p)]
    system, errors, reach = modes(p), [], 0.0
    parts = slave.run([0.7], "readout_at_u1", "readout_at_u2")[0]
    for tone, (u, size, phase) in enumerate(system.tones, start=1):
        turn = size * np.exp(1j * phase)
        found = system.sidebands(u, envelope=solver == ENVELOPE)
        full = system.sidebands(u)
        scale = np.abs(found[0]).max() * size or 1.0
        for i, x in enumerate(found[0]):
            assert abs(quadratures(slave, f"q{i + 1}", tone) - turn * x) <= 1e-11 * scale
        assert abs(quadratures(slave, "readout", tone) - turn * (weights @ found[0])) <= (
            1e-11 * scale
        )
        for k, side in ((1, "_upper"), (-1, "_lower")):
            z = turn * (weights @ found[k]) if k in found else 0.0
            assert abs(quadratures(slave, "readout", tone, side) - z) <= 1e-11 * scale
        now = (turn * (weights @ found[0]) * np.exp(1j * TWO_PI * u * 0.7)).real
        assert parts[tone - 1] == pytest.approx(now, abs=1e-11 * scale)
        if size:
            truth = np.array([weights @ full[0], *full[0]])
            seen = np.array([weights @ found[0], *found[0]])
            errors.append(np.abs(seen - truth) / np.abs(truth))
            sizes = [float(np.abs(found[k]).max()) for k in found]
            reach = max(reach, *(abs(k) for k, s in zip(found, sizes, strict=True) if s > 1e-13))
    told = slave.get(*(f"{name}_error" for name in ("readout", *names(p))))
    assert told == pytest.approx(np.max(errors, axis=0).tolist(), rel=1e-6, abs=1e-12)
    if solver != RK4 and system.pump is not None:
        assert reach <= slave.get("pump_sidebands")[0] <= 3 * reach + 5
    if system.pump is None:
        assert slave.get("pump_sidebands")[0] == 0.0


@pytest.mark.parametrize("p", [ONE, TWO, THREE], ids=["1", "2", "3"])
@pytest.mark.parametrize("solver", [EXACT, RK4])
def test_eigenfrequencies_and_widths_are_those_of_numpy(p: Values, solver: int) -> None:
    squares, shapes = np.linalg.eigh(modes(p).stiffness)
    slave = started(p, solver=solver)
    n = count(p)
    found = slave.get(*(f"eta{i + 1}" for i in range(n)))
    assert found == pytest.approx(np.sqrt(squares) / TWO_PI, rel=1e-12)
    widths = np.diag(shapes.T @ modes(p).damping @ shapes) / TWO_PI
    assert slave.get(*(f"width{i + 1}" for i in range(n))) == pytest.approx(widths, rel=1e-10)
    factors = np.sqrt(squares) / TWO_PI / widths
    assert slave.get(*(f"Q{i + 1}" for i in range(n))) == pytest.approx(factors, rel=1e-10)


def test_a_mode_that_grows_out_of_range_ends_the_run() -> None:
    """exp(pi t) passes the largest double at 226 s."""
    slave = started(TWO | {"d1": -1.0, "lambda12": 0.0})
    assert slave.step(200.0)
    assert not slave.step(260.0)
    assert "before 260.0 s" in slave.message


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"lambda12": 1.2}, "stiffness matrix"),
        ({"depth_f1": 0.1, "pump_hz": 0.0}, "pump_hz = 0.0 Hz"),
        ({"depth_f1": 0.1, "pump_hz": 0.3, "d2": 0.0}, "d2 = 0.0 Hz: a pumped"),
        ({"d2": 0.0, "periodic_start": True}, "d2 = 0.0 Hz: the damping"),
        ({"solver": 1, "b": 1.0}, "b = 1.0: "),
        ({"solver": 3}, "solver = 3"),
        ({"lambda12": 0.0, "d1": 0.0, "u1": 1.0}, "drive at 1.0 Hz"),
        ({"u2": -5.0}, "u2 = -5.0 Hz: "),
        ({"depth_f1": 0.9, "pump_hz": 1e-3}, "too deep"),
    ],
)
def test_what_cannot_be_simulated_is_refused(values: Values, words: str) -> None:
    slave = started(TWO | values)
    assert not slave.step(0.1)
    assert words in slave.message


def test_couplings_that_are_too_strong_are_named_and_others_are_not() -> None:
    slave = started(THREE | {"lambda12": 1.2})
    assert not slave.step(0.1)
    assert "f2 = 1.3 Hz and lambda12 = 1.2 Hz" in slave.message
    assert "lambda13" not in slave.message
    slave = started(THREE | {"lambda13": 0.0, "lambda23": 1.4})
    assert not slave.step(0.1)
    assert "f3 = 1.45 Hz" in slave.message
    assert "lambda12 = 0.4 Hz, lambda23 = 1.4 Hz" in slave.message


def test_a_coupling_may_be_zero_but_not_negative_when_a_model_is_built() -> None:
    assert checked_start_values(model(2), {"lambda12": 0.0}) == {"lambda12": 0.0}
    with pytest.raises(BuildError, match=r"at least 0\.0 Hz"):
        checked_start_values(model(2), {"lambda12": -0.5})


def test_sidebands_that_one_side_alone_needs_too_many_of_are_refused() -> None:
    """The pump moves the resonance by 0.2 Hz, 4000 times its own frequency."""
    p = ONE | {"f1": 1.0, "u1": 1.3, "A2": 0.0, "pump_hz": 1.0 / 20000.0, "depth_f1": 0.4}
    slave = started(p)
    assert not slave.step(0.1)
    assert "1500 sidebands" in slave.message
    assert "1.3 Hz" in slave.message


#: Drive and pump in Hz, sidebands kept below and above, depth and damping in Hz.
NEAR_RESONANCE = (
    (0.2, 0.4, (6, 1), (0.1, 0.05)),
    (0.2, 0.4, (6, 0), (0.1, 0.05)),
    (0.6, 0.4, (6, 0), (0.1, 0.05)),
    (1.4, 0.4, (0, 6), (0.1, 0.05)),
    (1.8, 0.4, (1, 6), (0.1, 0.05)),
    (2.8, 1.8, (0, 6), (0.1, 0.05)),
    (0.2, 0.6, (1, 6), (0.1, 0.05)),
    (0.2, 0.4, (1, 1), (0.1, 0.05)),
    (0.6, 0.8, (1, 6), (0.1, 0.05)),
    (0.05, 0.35, (2, 6), (0.1, 0.05)),
    (1.8, 3.0, (0, 6), (0.93, 1e-3)),
    (3.9, 2.6, (1, 6), (0.74, 1e-3)),
    (1.5, 2.7, (0, 6), (0.99, 0.1)),
)


def pumped_mode(depth: float, width: float, pump_hz: float, u: float) -> Values:
    """One mode at 1 Hz under one tone."""
    p = ONE | {"f1": 1.0, "d1": width, "g1": 1.0, "pump_hz": pump_hz, "pump_phase": 0.0}
    return p | {"depth_f1": depth, "u1": u, "A2": 0.0}


@pytest.mark.parametrize(("u", "pump_hz", "cut", "mode"), NEAR_RESONANCE)
def test_the_bound_of_a_cut_is_near_what_it_costs_where_one_mode_resounds_beyond(
    u: float,
    pump_hz: float,
    cut: tuple[int, int],
    mode: tuple[float, float],
) -> None:
    """Only one mode: no norm is larger than its number. Kept sidebands alone, then all."""
    (below, above), p = cut, pumped_mode(*mode, pump_hz, u)
    one = parameters(p)
    frame = modes_steady.Frame(matrices(one), None, pump_hz)
    tails = Side(frame, u, 1).tail(above), Side(frame, u, -1).tail(below)
    assert [tail.end for tail in tails] == [above, below]
    with in_precise_arithmetic():
        chain = modes_steady._Chain(frame, u, below, above)
        found = chain.solved(one.g)
        sizes = [abs(x[0]) for x in found]
        ends = max(sizes[0], sizes[-1])
        bound = chain.errors(one.g, found, sizes, tails)[0] * ends
        alone = tails[0]._replace(rest=0.0), tails[1]._replace(rest=0.0)
        least = chain.errors(one.g, found, sizes, alone)[0] * ends
    truth = {k: TWO_PI**2 * complex(x[0]) for k, x in modes(p).sidebands(u).items()}
    kept = range(-below, above + 1)
    error = sum(abs(found[k + below][0] - truth[k]) for k in kept)
    beyond = sum(abs(x) for k, x in truth.items() if k not in kept)
    assert error + beyond <= bound
    assert error <= least <= 1.3 * error


def chain_of(p: Values, u: float, reach: int) -> tuple[modes_steady._Chain, Parameters, Any]:
    """A chain of as many sidebands on both sides, and what is beyond it."""
    made = parameters(p)
    frame = modes_steady.Frame(matrices(made), None, p["pump_hz"])
    chain = modes_steady._Chain(frame, u, reach, reach)
    return chain, made, tuple(Side(frame, u, sign).tail(reach) for sign in (1, -1))


@pytest.mark.parametrize("place", [0, 3, 6, 7, 12])
@pytest.mark.parametrize("u", [0.97, 1.31])
def test_what_a_solution_is_off_by_is_bounded_by_its_residual(u: float, place: int) -> None:
    """One sideband moved by a millionth: the bound is no less, nor larger by what ties it."""
    with in_precise_arithmetic():
        chain, made, tails = chain_of(THREE | PUMP, u, 6)
        found = chain.solved(made.g)
        exact = chain.corrected(made.g, found)
        sizes = [float(np.linalg.norm(x)) for x in found]
        own = float(np.abs(np.array(found) - exact).sum())
        assert own <= chain.errors(made.g, found, sizes, tails)[1] <= 1e-12 * max(sizes)
        moved = [1e-6 * max(sizes) * z for z in (1.0, -0.5, 0.25j)]
        found[place] = [x + y for x, y in zip(found[place], moved, strict=True)]
        off = float(np.linalg.norm(moved))
        assert off <= chain.errors(made.g, found, sizes, tails)[1] <= 300.0 * off


@pytest.mark.parametrize(("u", "pump_hz"), [(0.97, 0.31), (0.3, 0.35), (1.9, 0.45), (1.0, 2.03)])
def test_columns_of_the_inverse_are_bounded_by_the_elimination(u: float, pump_hz: float) -> None:
    """Sums of moduli of a dense inverse of one mode's chain."""
    reach, p = 4, pumped_mode(0.3, 0.2, pump_hz, u)
    with in_precise_arithmetic():
        chain, _, _ = chain_of(p, u, reach)
    high, low = chain._spread(1, reach), chain._spread(-1, reach)
    found = np.array([*reversed(low.columns(high)), *high.columns(low)[1:]])
    v = u + pump_hz * np.arange(-reach, reach + 1)
    beside = np.full(2 * reach, 0.5 * 0.3)
    dense = np.diag(1.0 - v**2 + 0.2j * v) + np.diag(beside, 1) + np.diag(beside, -1)
    sums = np.abs(np.linalg.inv(dense)).sum(axis=0)
    assert np.all(sums <= found * (1.0 + 1e-12))
    assert np.min(sums / found) > 0.6


def test_corrections_go_on_until_doubles_hold_no_more() -> None:
    """With an inverse that is a thousandth off, so that each leaves a thousandth."""
    with in_precise_arithmetic():
        chain, made, _ = chain_of(THREE | PUMP, 0.97, 6)
        wanted = np.array(chain.corrected(made.g, chain.solved(made.g)))
        chain.inverses[0] = [[1.001 * x for x in row] for row in chain.inverses[0]]
        found = np.array(chain.corrected(made.g, chain.solved(made.g)))
    assert np.abs(found - wanted).max() <= 1e-15 * np.abs(wanted).max()


@pytest.mark.parametrize("u", [0.97, 1.31, 4.0])
def test_sidebands_do_not_depend_on_where_the_chain_is_cut_first(
    u: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It grows on both sides until its bound holds; by a dense solve."""
    p = THREE | PUMP | {"u1": u}
    monkeypatch.setattr(Side, "guess", lambda _side, _wanted, _most: 1)
    made = parameters(p)
    frame = modes_steady.Frame(matrices(made), None, p["pump_hz"])
    found = modes_steady.steady_state(frame, made.g, u)
    truth = modes(p).sidebands(u)
    size = max(float(np.abs(x).max()) for x in truth.values())
    for k, x in truth.items():
        turn = TWO_PI**-2 * np.exp(1j * k * p["pump_phase"])
        assert np.abs(turn * np.array(found.sideband(k)) - x).max() <= 1e-12 * size


#: Drive, pump, depth and damping of one mode at 1 Hz. What is beyond a cut is bounded by damping
#: at a resonance, by a gap from one frequency to its negative, by the recursion, or far out.
TAILS = (
    (1.0, 0.02, 0.2, 1e-3),
    (1.0, 0.0063, 0.03, 1e-4),
    (1.05, 0.002, 3e-4, 1e-7),
    (0.2, 0.31, 0.3, 1e-5),
    (0.0, 0.013, 0.4, 1e-3),
    (2.9, 1.96, 0.1, 0.11),
    (1.4, 0.1, 0.75, 1e-2),
    (0.83941, 0.611, 0.3, 1e-4),
    (0.9, 0.02, 0.75, 0.5),
)


@pytest.mark.parametrize("walked", [1, 4])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("centre", [None, 1.1])
@pytest.mark.parametrize("scene", TAILS)
def test_what_is_beyond_a_cut_is_bounded_by_its_continued_fraction(
    scene: tuple[float, float, float, float],
    centre: float | None,
    sign: int,
    walked: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """S_k = A(v_k) - (p/2)^2/S_(k+1) of one mode, from far out where it is A(v_k) alone."""
    monkeypatch.setattr(modes_tails, "FOLLOWED", walked)
    u, pump_hz, depth, width = scene
    made = parameters(pumped_mode(depth, width, pump_hz, u))
    side = Side(modes_steady.Frame(matrices(made), centre, pump_hz), u, sign)
    schurs, rests, schur, rest = {}, {}, complex(math.inf), 0.0
    for k in range(round(8.0 / pump_hz), 0, -1):
        v = u + sign * k * pump_hz
        own = 1.0 - v * v + 1j * v * width
        if centre is not None:
            own = 1.0 - centre * (2.0 * v - centre) + 1j * centre * width
        schurs[k - 1] = schur = own - 0.25 * depth * depth / schur
        # |X_k|/|X_(k-1)|, and the sum of all from k on over |X_(k-1)|
        rests[k - 1] = rest = 0.5 * depth / abs(schur) * (1.0 + rest)
    tight = []
    for end in range(round(3.0 / pump_hz)):
        tail = side.tail(end)
        assert tail.end <= end + round(2.5 / pump_hz)
        assert tail.schur * abs(schurs[tail.end]) >= 1.0 - 1e-12
        assert tail.rest >= (1.0 - 1e-12) * rests[tail.end]
        tight.append(tail.schur * abs(schurs[tail.end]))
    assert min(tight) <= (1.1 if walked > 1 else 2.1)


def two_pumped(seed: int) -> tuple[Values, float]:
    """Two modes and what is pumped of them, and a tone: Q to 1e6, depths to a half."""
    rng = np.random.default_rng(seed)
    p = TWO | {"f2": float(rng.uniform(1.0, 3.0)), "lambda12": float(rng.uniform(0.0, 0.9))}
    p |= {f"d{i}": float(10.0 ** rng.uniform(-6.0, -1.0)) for i in (1, 2)}
    depth = float(10.0 ** rng.uniform(-3.0, -0.3))
    depths = {f"depth_{x}": depth * float(rng.uniform(-1, 1)) for x in ("f1", "f2", "lambda12")}
    step = float(10.0 ** rng.uniform(-1.3, 0.2))
    u, near = float(rng.uniform(0.0, 3.0)), modes(p).stiffness / TWO_PI**2
    if seed % 2:  # a sideband at minus an eigenfrequency
        step = (u + math.sqrt(rng.choice(np.linalg.eigvalsh(near)))) / int(rng.integers(1, 30))
    return p | depths | {"pump_hz": step}, u


@pytest.mark.parametrize(
    "seeds", [range(16), pytest.param(range(16, 500), marks=pytest.mark.nightly)]
)
def test_what_is_beyond_a_cut_of_two_modes_is_bounded_by_its_matrices(seeds: range) -> None:
    """Schur complements from far out, and the vectors that they make of one at the cut."""
    for seed, sign in itertools.product(seeds, (1, -1)):
        p, u = two_pumped(seed)
        side = Side(modes_steady.Frame(matrices(parameters(p)), None, p["pump_hz"]), u, sign)
        ratios, leasts, far = ratios_of(p, u, sign)
        for end in range(0, far // 3, 1 + far // 40):
            tail = side.tail(end)
            assert tail.schur * leasts[tail.end + 1] >= 1.0 - 1e-9, (seed, sign, end)
            # the vector that makes most of the next sideband, as far as it counts
            x, total = np.linalg.svd(ratios[tail.end + 1])[2][0].conj(), 0.0
            for k in range(tail.end + 1, min(tail.end + 40, far)):
                x = ratios[k] @ x
                total += float(np.linalg.norm(x))
            assert tail.rest >= (1.0 - 1e-9) * total, (seed, sign, end)


def ratios_of(p: Values, u: float, sign: int) -> tuple[dict[int, Any], dict[int, float], int]:
    """R_k of X_k = R_k X_(k-1) and the least singular value of S_k, and how many."""
    system, far = modes(p), round(12.0 / p["pump_hz"])
    assert system.pump is not None
    c, d, half = system.stiffness / TWO_PI**2, system.damping / TWO_PI, system.pump / TWO_PI**2 / 2
    ratios, leasts, outer = {}, {}, np.zeros((2, 2))
    for k in range(far, 0, -1):
        v = u + sign * k * p["pump_hz"]
        schur = c - v * v * np.eye(2) + 1j * v * d + outer
        ratios[k] = -np.linalg.solve(schur, half)
        leasts[k] = float(np.linalg.svd(schur, compute_uv=False).min())
        outer = half @ ratios[k]
    return ratios, leasts, far


@pytest.mark.parametrize("damped", [0, 1])
def test_the_distance_of_a_block_from_singular_is_not_overstated(damped: int) -> None:
    """The least singular value of C - v^2 + i v D by numpy, one mode a thousand times as wide."""
    p = TWO | {"f2": 1.02, "lambda12": 0.42, "d1": 1e-3, "d2": 1e-3, f"d{damped + 1}": 0.9}
    frame = modes_steady.Frame(matrices(parameters(p)), None, 0.1)
    c = modes(p).stiffness / TWO_PI**2
    d = modes(p).damping / TWO_PI
    shares = []
    for v in np.linspace(0.0, 2.0, 201).tolist():
        least = np.linalg.svd(c - v * v * np.eye(2) + 1j * v * d, compute_uv=False).min()
        shares.append(frame.distance(v) / least)
    assert max(shares) <= 1.0 + 1e-9
    assert max(shares) > 0.9


# --- stability


def multiplier(p: Values) -> float:
    """The largest Floquet multiplier: classical Runge-Kutta for all unit states at once."""
    system, n = modes(p), count(p)
    scale = float(np.sqrt(np.max(system.stiffness)))
    still = system.generator(scale, envelope=False)[: 2 * n, : 2 * n].real
    pumped = system.modulation(scale, envelope=False)[: 2 * n, : 2 * n].real
    steps = 1000
    h, flow = 1.0 / p["pump_hz"] / steps, np.eye(2 * n)
    for k in range(steps):
        first, middle, last = (
            still + pumped * math.cos(TWO_PI * (k + x) / steps) for x in (0.0, 0.5, 1.0)
        )
        k1 = first @ flow
        k2 = middle @ (flow + 0.5 * h * k1)
        k3 = middle @ (flow + 0.5 * h * k2)
        k4 = last @ (flow + h * k3)
        flow = flow + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return float(np.abs(np.linalg.eigvals(flow)).max())


RESONANT: dict[str, tuple[Values, float]] = {
    "twice one mode": (ONE | {"pump_hz": 2.2}, 0.127),
    "one mode itself": (ONE | {"pump_hz": 1.1, "d1": 0.01}, 0.19),
    "two thirds": (ONE | {"pump_hz": 2.2 / 3.0, "d1": 0.002}, 0.29),
    "a sum": (TWO | {"pump_hz": 2.28, "d1": 0.02, "d2": 0.03}, 0.13),
    "a difference": (TWO | {"pump_hz": 0.36}, 0.3),
}


@pytest.mark.parametrize("label", RESONANT)
@pytest.mark.parametrize("part", [0.3, 0.9, 1.1, 2.0])
def test_a_pump_is_refused_where_its_floquet_multiplier_says_so(label: str, part: float) -> None:
    p, depth = RESONANT[label]
    p = p | {"depth_f1": part * depth}
    growth, slave = multiplier(p), started(p)
    assert abs(growth - 1.0) > 1e-4
    assert slave.step(1e-3) == (growth < 1.0)
    if growth > 1.0:
        told = float(slave.message.split("by the factor ")[1].split(" ")[0])
        assert told == pytest.approx(growth, rel=1e-7)


@pytest.mark.parametrize("depth", [0.46, 0.49])
@pytest.mark.parametrize("periods", [600.0, 1201.0])
def test_a_slow_pump_of_one_mode_passes_where_its_bound_shows_it(
    depth: float, periods: float
) -> None:
    """1/q + 2 + q = 2/t, r = 2 t/(2 - t (3 + q)), m = f/(sqrt 2 u_p) sidebands below C/2.

    Growth is excluded by m u_p d/C > t r q^(m-1)/4, t the depth of a single mode.
    """
    f = 1.1
    [q] = [x for x in np.roots([1.0, 2.0 - 2.0 / depth, 1.0]) if abs(x) < 1.0]
    r = 2.0 * depth / (2.0 - depth * (3.0 + q))
    m = math.floor(periods / math.sqrt(2.0))
    least = depth * r * q ** (m - 1) / 4.0 * f * periods / m
    p = ONE | {"pump_hz": f / periods, "depth_f1": depth, "A1": 0.0, "A2": 0.0}
    assert started(p | {"d1": 1.01 * least}).step(1e-3)
    slave = started(p | {"d1": 0.99 * least})
    assert not slave.step(1e-3)
    assert "too deep" in slave.message
    assert f"by {depth:.3g} of" in slave.message
