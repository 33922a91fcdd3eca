"""The FMU CoupledModes without its pump, at 50 digits and against CoupledOscillator."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from fmpy.validation import validate_fmu

import build_fmu
from tests.support import modes_reference as reference
from tests.support.fmus import DISCARD, OK, Instance, Unpacked
from tests.support.modes_fmus import Models
from tests.support.modes_scenes import SIZES, Scene, eigenfrequencies, scenes

ENVELOPE, RK4 = 1, 2


def names(n: int) -> list[str]:
    return [f"q{i + 1}" for i in range(n)]


def quadratures(fmu: Instance, name: str, tone: int) -> complex:
    return complex(*fmu.get(f"{name}_X_u{tone}", f"{name}_Y_u{tone}"))


def readout(scene: Scene, q: list[Any]) -> tuple[Any, Any]:
    """Return the weighted sum, and the sum of its parts' sizes."""
    parts = [mp.mpf(scene[f"readout{i + 1}"]) * x for i, x in enumerate(q)]
    return mp.fsum(parts), mp.fsum(abs(x) for x in parts)


# --- against 50 digits ---------------------------------------------------------------------------


def test_there_are_two_hundred_scenes() -> None:
    assert sum(SIZES.values()) == 200


@pytest.mark.parametrize("few", [True, pytest.param(False, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("n", SIZES)
def test_lock_in_and_periodic_orbit(models: Models, n: int, few: bool) -> None:
    """1e-9 of each mode's amplitude is promised; 1e-13 and, of the orbit's phase, 1e-12 is kept."""
    worst = 0.0
    for scene in scenes(n, 15 if few else SIZES[n], seed=n):
        fmu = models(n).start(**scene, periodic_start=True)
        sizes = [mp.mpf(0)] * n
        lines = reference.lines(scene)
        for tone, (_, truth) in enumerate(lines, start=1):
            sizes = [s + abs(x) for s, x in zip(sizes, truth, strict=True)]
            for name, x in zip(names(n), truth, strict=True):
                error = float(abs(quadratures(fmu, name, tone) - x) / abs(x)) if x else 0.0
                worst = max(worst, error)
                assert error <= 1e-13, (scene, name)
            whole, size = readout(scene, truth)
            assert abs(quadratures(fmu, "readout", tone) - whole) <= 1e-13 * size
        period = 1.0 / scene["f1"]
        assert fmu.step(0.0, 7.3 * period) == OK, fmu.messages
        truth = reference.at_time(lines, 7.3 * period)
        for x, size, found in zip(truth, sizes, fmu.get(*names(n)), strict=True):
            assert abs(found - x) <= 1e-12 * size, scene
    assert worst > 0.0  # something was compared


@pytest.mark.parametrize("n", SIZES)
def test_from_rest(models: Models, n: int) -> None:
    """The first cycles, where a large orbit and a transient nearly cancel, and much later."""
    for scene in scenes(n, 4 if n < 5 else 2, seed=10 + n):
        period = 1.0 / scene["f1"]
        times = [0.3 * period, 0.6 * period, 40.0 * period, 2e4 * period]
        truth = reference.from_rest(scene, times)
        largest = [0.0] * n
        fmu, now = models(n).start(**scene), 0.0
        for time, row in zip(times, truth, strict=True):
            assert fmu.step(now, time - now) == OK, fmu.messages
            now += time - now
            largest = [max(a, abs(float(x))) for a, x in zip(largest, row, strict=True)]
            for found, x, size in zip(fmu.get(*names(n)), row, largest, strict=True):
                assert abs(found - x) <= 1e-9 * size, (scene, time)


EXCEPTIONAL = {
    "lambda12": math.sqrt(1e3 * 40.0 / 2.0) / math.sqrt(2.0),
    "f1": 1e3,
    "f2": 1e3,
    "d1": 20.0,
    "d2": 60.0,
}


@pytest.mark.parametrize(
    "changes",
    [
        EXCEPTIONAL,
        {"f1": 1e3, "f2": 1e3, "lambda12": 0.0, "d1": 5.0, "d2": 5.0},  # one eigenvalue twice
        {"f1": 1e3, "f2": 1.2e3, "lambda12": 300.0, "d1": 5e3, "d2": 1.0},  # overdamped
        {"f1": 1e3, "f2": 1.2e3, "lambda12": 300.0, "d1": -5.0, "d2": 1.0},  # growing
    ],
    ids=["exceptional point", "repeated eigenvalue", "overdamped", "growing"],
)
def test_eigenvalues_that_others_stumble_over(models: Models, changes: Scene) -> None:
    scene = {"g1": 1.0, "g2": 0.4, "u1": 990.0, "u2": 1010.0, "A1": 1.0, "A2": 0.5}
    scene |= {"phase1": 0.2, "phase2": -1.0} | changes
    times = [1e-4, 2e-3, 3.1e-2]
    fmu, now = models(2).start(**scene), 0.0
    for time, row in zip(times, reference.from_rest(scene, times), strict=True):
        assert fmu.step(now, time - now) == OK, fmu.messages
        now += time - now
        for found, x in zip(fmu.get("q1", "q2"), row, strict=True):
            assert abs(found - x) <= 1e-12 * abs(x)


def test_a_held_input_at_every_step(models: Models) -> None:
    scene = scenes(3, 2, seed=4)[1] | {"A2": 0.0}
    period = 1.0 / scene["f1"]
    rng = np.random.default_rng(1)
    times = [0.21 * period * (k + 1) for k in range(40)]
    inputs = list(rng.uniform(-3.0, 3.0, len(times)))
    fmu, now, worst = models(3).start(**scene), 0.0, 0.0
    truth = reference.from_rest(scene, times, inputs)
    largest = max(abs(float(x)) for row in truth for x in row)
    for time, b, row in zip(times, inputs, truth, strict=True):
        fmu.set(b=b)
        assert fmu.step(now, time - now) == OK
        now += time - now
        found = fmu.get("q1", "q2", "q3")
        worst = max(worst, *(abs(float(a - x)) for a, x in zip(found, row, strict=True)))
    assert worst <= 1e-12 * largest


def test_small_steps_give_the_numbers_of_one_giant_step(models: Models) -> None:
    scene = scenes(3, 1, seed=7)[0]
    end = 30.0 / scene["f1"]
    fmu = models(3).start(**scene)
    assert fmu.step(0.0, end) == OK
    giant = fmu.get("q1", "q2", "q3")
    fmu, now = models(3).start(**scene), 0.0
    for k in range(300):
        step = end * (k + 1) / 300 - now
        assert fmu.step(now, step) == OK
        now += step
    assert fmu.get("q1", "q2", "q3") == pytest.approx(giant, rel=1e-13)


def test_rk4_has_order_four(models: Models) -> None:
    scene = {"f1": 10.0, "f2": 11.0, "f3": 13.0, "d1": 0.5, "d2": 0.7, "d3": 0.2}
    scene |= {"lambda12": 3.0, "lambda13": 0.0, "lambda23": 2.0, "g1": 1.0, "g2": -1.0, "g3": 0.3}
    scene |= {"u1": 9.8, "u2": 12.9, "A1": 1.0, "A2": 1.0, "phase1": 0.0, "phase2": 0.4}
    truth = np.array(reference.from_rest(scene, [0.31])[0], dtype=float)
    substeps = [0.31 / n for n in (64, 128, 256)]
    errors = []
    for h in substeps:
        fmu = models(3).start(**scene, solver=RK4, rk4_substep=h)
        assert fmu.step(0.0, 0.31) == OK
        errors.append(np.abs(np.array(fmu.get("q1", "q2", "q3")) - truth).max())
    assert np.polyfit(np.log(substeps), np.log(errors), 1)[0] == pytest.approx(4.0, abs=0.15)


def test_the_envelope_tells_its_error(models: Models) -> None:
    """What the output says is what the phasors of the full equations differ by, and it is 1/Q."""
    errors = []
    for quality in (1e2, 1e3, 1e4):
        width = 1e6 / quality
        scene = {"f1": 1e6, "f2": 1e6 + width, "lambda12": 1e6 / math.sqrt(quality)}
        scene |= {"d1": width, "d2": 1.3 * width, "g1": 1.0, "g2": 0.5, "u1": 1e6 - 0.4 * width}
        scene |= {"u2": 1e6 + 0.7 * width, "A1": 1.0, "A2": 0.3, "phase1": 0.0, "phase2": 1.0}
        fmu = models(2).start(**scene, solver=ENVELOPE, periodic_start=True)
        for i in (0, 1):
            worst = 0.0
            for tone, (u, amplitude) in enumerate(reference.tones(scene), start=1):
                x = amplitude * reference.phasors(scene, u)[i]
                found = quadratures(fmu, f"q{i + 1}", tone)
                worst = max(worst, float(abs(found - x) / abs(x)))
            assert fmu.get(f"q{i + 1}_error")[0] == pytest.approx(worst, rel=1e-9)
        errors.append(fmu.get("q1_error")[0])
    assert np.polyfit(np.log([1e2, 1e3, 1e4]), np.log(errors), 1)[0] == pytest.approx(-1, abs=0.1)


def test_eigenfrequencies_and_widths(models: Models) -> None:
    for scene in scenes(5, 10, seed=2):
        fmu = models(5).start(**scene)
        found = fmu.get(*(f"eta{i}" for i in range(1, 6)))
        assert found == pytest.approx(list(eigenfrequencies(scene)), rel=1e-9)
        widths = fmu.get(*(f"width{i}" for i in range(1, 6)))
        # the trace of the damping matrix is the same in all coordinates
        assert sum(widths) == pytest.approx(sum(scene[f"d{i}"] for i in range(1, 6)), rel=1e-12)


# --- two modes are CoupledOscillator ------------------------------------------------------------


def as_modes(p: Scene) -> Scene:
    """Return CoupledOscillator's parameters in physical coordinates; read-out is q1_hybrid.

    Rounding f1, f2 and lambda to doubles moves eigenfrequencies by 1e-16 of them, which is Q times
    as much of the amplitude: 1e-12 asks for a Q of at most 1e3.
    """
    with mp.workdps(50):
        c, s = mp.cos(mp.mpf(p["theta"])), mp.sin(mp.mpf(p["theta"]))
        plus, minus = mp.mpf(p["eta_plus"]) ** 2, mp.mpf(p["eta_minus"]) ** 2
        t = [[-c, s], [s, c]] if p["reflection"] else [[c, -s], [s, c]]
        return {
            "f1": float(mp.sqrt(c * c * plus + s * s * minus)),
            "f2": float(mp.sqrt(s * s * plus + c * c * minus)),
            "lambda12": float(mp.sqrt(-s * c * (minus - plus))),
            "g1": float(t[0][0] * p["g1"] + t[1][0] * p["g2"]),
            "g2": float(t[0][1] * p["g1"] + t[1][1] * p["g2"]),
            "readout1": float(t[0][0]),
            "readout2": float(t[0][1]),
            **{name: p[name] for name in ("d1", "d2", *TONES)},
        }


TONES = ("u1", "u2", "A1", "A2", "phase1", "phase2")


def oscillator_scenes() -> list[Scene]:
    rng = np.random.default_rng(5)
    found = []
    for k in range(24):
        eta = 10.0 ** rng.uniform(3.0, 9.0)
        other = eta * (1.0 + 10.0 ** rng.uniform(-3.0, -0.3))
        quality = 10.0 ** rng.uniform(1.0, 3.0)
        found.append(
            {
                "theta": float(rng.uniform(math.pi / 2, math.pi)),
                "reflection": bool(k % 2),
                "eta_plus": eta,
                "eta_minus": other,
                "d1": eta / quality,
                "d2": eta / quality * float(rng.uniform(0.3, 3.0)),
                "u1": eta * (1.0 + float(rng.uniform(-1.0, 1.0)) / quality),
                "u2": other * (1.0 + float(rng.uniform(-1.0, 1.0)) / quality),
                "A1": 1.0,
                "A2": float(rng.uniform(-2.0, 2.0)),
                "phase1": 0.4,
                "phase2": float(rng.uniform(-3.0, 3.0)),
                "g1": 1.0,
                "g2": float(rng.uniform(-1.0, 1.0)),
            }
        )
    return found


@pytest.mark.parametrize("solver", [0, ENVELOPE])
def test_two_modes_reproduce_coupled_oscillator(
    models: Models, oscillator: Unpacked, solver: int
) -> None:
    with Instance(oscillator) as old:
        for scene in oscillator_scenes():
            for periodic in (False, True):
                old.slave.reset()
                settings = {"solver": solver, "periodic_start": periodic}
                old.start(**scene, **settings)
                new = models(2).start(**as_modes(scene), **settings)
                size = max(abs(quadratures(old, "q1_hybrid", tone)) for tone in (1, 2))
                for tone in (1, 2):
                    seen = quadratures(new, "readout", tone)
                    assert abs(seen - quadratures(old, "q1_hybrid", tone)) <= 1e-12 * size, scene
                step = 3.7 / scene["eta_plus"]
                assert old.step(0.0, step) == new.step(0.0, step) == OK
                for a, b in (("q1_hybrid", "readout"), ("q1", "q1"), ("q2", "q2")):
                    assert abs(old.get(a)[0] - new.get(b)[0]) <= 2e-12 * size, (scene, a)


# --- what the FMU promises as a host sees it -----------------------------------------------------


@pytest.mark.parametrize("n", [1, pytest.param(9, marks=pytest.mark.nightly)])
def test_fmpy_finds_no_problem_and_the_bytes_are_the_same(n: int, tmp_path: Path) -> None:
    first = build_fmu.build(f"CoupledModes{n}", tmp_path / "a")
    assert validate_fmu(str(first)) == []
    again = build_fmu.build(f"CoupledModes{n}", tmp_path / "b")
    assert first.read_bytes() == again.read_bytes()
    with zipfile.ZipFile(first) as archive:
        page = archive.read("documentation/index.html").decode()
        code = [archive.read(name) for name in archive.namelist() if name.endswith(".py")]
    assert "harmonic balance" in page
    assert not any(b"numpy" in text for text in code)


def test_modes_are_counted_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path)]
    assert build_fmu.main(["--model", "CoupledModes", "--modes", "4", *out]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'CoupledModes4.fmu'}\n"
    for wrong, words in (
        (["--model", "CoupledModes"], "needs --modes, a number from 1 to 9"),
        (
            ["--model", "CoupledModes", "--modes", "0"],
            "--modes 0: CoupledModes has a number of modes from 1 to 9",
        ),
        (["--model", "CoupledModes10"], "CoupledModes1 to CoupledModes9"),
        (["--modes", "2"], "--modes 2: wanted is a --model"),
    ):
        assert build_fmu.main([*wrong, *out]) == 2
        err = capsys.readouterr().err
        assert words in err
        assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"f2": 0.0}, "f2 = 0.0 Hz: an eigenfrequency"),
        ({"d1": float("nan")}, "d1 = nan is not a finite number"),
        ({"lambda12": -1.0}, "lambda12 = -1.0 Hz: a coupling must not be negative"),
        ({"lambda12": 8e6}, "the stiffness matrix is not positive definite"),
        ({"u2": -5.0}, "u2 = -5.0 Hz: a drive frequency"),
        ({"d3": 0.0, "periodic_start": True}, "d3 = 0.0 Hz: the damping matrix"),
        ({"lambda12": 0.0, "d1": 0.0, "u1": 6952300.0}, "a drive at 6952300.0 Hz has no steady"),
        ({"solver": 1, "b": 1.0}, "b = 1.0: the rotating frame"),
        ({"depth_f1": 0.1, "pump_hz": 0.0}, "pump_hz = 0.0 Hz"),
        ({"depth_f1": 0.1, "d2": 0.0}, "d2 = 0.0 Hz: a pumped system"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_a_sentence(
    models: Models, values: Scene, words: str
) -> None:
    fmu = models(3).start(**values)
    assert fmu.step(0.0, 1e-8) == DISCARD
    assert all(map(math.isnan, fmu.get("readout", "q1_X_u1", "eta1")))
    assert words in fmu.status_message()
    assert any(words in text for _, text in fmu.messages)


PUMP = {"depth_f1": 0.03, "depth_lambda12": -0.1, "pump_phase": 0.4, "pump_hz": 3.1e5}


@pytest.mark.parametrize("pump", [{}, PUMP], ids=["unpumped", "pumped"])
@pytest.mark.parametrize("solver", [0, ENVELOPE, RK4])
@pytest.mark.parametrize("periodic", [False, True])
def test_a_restored_run_continues_bit_for_bit(
    models: Models, solver: int, periodic: bool, pump: Scene
) -> None:
    def run(fmu: Instance, begin: int, end: int) -> list[list[float]]:
        rows = []
        for k in range(begin, end):
            if k == 12:
                fmu.set(u1=6.95e6, d1=140.0, **({"pump_hz": 2.9e5} if pump else {}))
            if solver != ENVELOPE:
                fmu.set(b=math.sin(k))
            assert fmu.step(k * 1e-8, 1e-8) == OK, fmu.messages
            rows.append(fmu.get("readout", "q1", "q2", "q3"))
        return rows

    start = {"solver": solver, "periodic_start": periodic} | pump
    whole = run(models(3).start(**start), 0, 20)
    fmu = models(3).start(**start)
    run(fmu, 0, 7)
    state = fmu.slave.getFMUState()
    kept = fmu.slave.serializeFMUstate(state)
    fmu.slave.freeFMUState(state)
    run(fmu, 7, 20)
    fmu = models(3)
    fmu.slave.setFMUState(fmu.slave.deSerializeFMUstate(kept))
    assert run(fmu, 7, 20) == whole[7:]


@pytest.mark.parametrize("solver", [0, ENVELOPE, RK4])
def test_a_parameter_changed_between_steps_keeps_state_and_phase(
    models: Models, solver: int
) -> None:
    """A run of two halves, the second with another tone, is continuous to what motion allows."""
    fmu = models(3).start(solver=solver, periodic_start=True)
    assert fmu.step(0.0, 1e-6) == OK
    before = fmu.get("q1", "q2", "q3")
    size = abs(quadratures(fmu, "q1", 1))
    fmu.set(u1=6.95e6, pump_hz=2e5, depth_f2=1e-3)
    assert fmu.step(1e-6, 1e-14) == OK, fmu.messages
    after = fmu.get("q1", "q2", "q3")
    assert after == pytest.approx(before, abs=1e-6 * size)
