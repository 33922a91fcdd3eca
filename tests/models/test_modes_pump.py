"""The pump of CoupledModes against a dense solve at 50 digits, scipy, and closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmu_src import modes_steady
from fmu_src.modes_equations import Parameters, matrices
from fmu_src.modes_tails import Side
from tests.support import modes_reference as reference
from tests.support.fmus import DISCARD, OK, Instance
from tests.support.modes_fmus import Models
from tests.support.modes_scenes import PUMP, THREE, Scene, eigenfrequencies, scenes

RK4 = 2


def line(fmu: Instance, name: str) -> complex:
    return complex(*fmu.get(name.format("X"), name.format("Y")))


def pumped(n: int, k: int, seed: int) -> Scene:
    """Return a scene with a pump on everything, at the distance of two modes or elsewhere."""
    rng = np.random.default_rng(seed)
    scene = {name: x for name, x in scenes(n, 5, seed)[k].items() if not name.startswith("readout")}
    eta = eigenfrequencies(scene)
    depth = 10.0 ** rng.uniform(-5.0, -2.5)
    between = abs(eta[1] - eta[0]) if n > 1 else 0.0
    # no more than some forty sidebands of unit size, so that the dense solve stays small
    slow = 0.2 * eta[0] * depth + 0.02 * eta[0]
    scene["pump_hz"] = float(max(between, slow) if k % 2 else eta[0] * rng.uniform(0.05, 0.4))
    for name in list(scene):
        if name[0] == "f" or name.startswith("lambda"):
            scene[f"depth_{name}"] = float(depth * rng.uniform(-1.0, 1.0))
    return scene | {
        "pump_phase": float(rng.uniform(-3.0, 3.0)),
        "A2": 0.0,
        "A1": 1.0,
        "phase1": 0.0,
    }


@pytest.mark.parametrize(
    ("n", "k"),
    [
        *((1, 0), (2, 1), (3, 1)),
        *(pytest.param(*scene, marks=pytest.mark.nightly) for scene in ((2, 0), (2, 3), (3, 0))),
    ],
)
def test_sidebands_are_those_of_a_dense_solve(models: Models, n: int, k: int) -> None:
    scene = pumped(n, k, seed=20 + n)
    fmu = models(n).start(**scene, readout1=1.0)
    assert fmu.status_message() == ""
    truth = reference.sidebands(scene, scene["u1"], 7, scene["pump_phase"])
    size = max(float(abs(x)) for x in truth[0])
    for side, name in ((0, ""), (1, "_upper"), (-1, "_lower")):
        found = line(fmu, f"readout_{{}}_u1{name}")
        assert abs(found - truth[side][0]) <= 1e-13 * size
    for i, x in enumerate(truth[0], start=1):
        assert abs(line(fmu, f"q{i}_{{}}_u1") - x) <= 1e-13 * size


STRONG: dict[str, float] = THREE | PUMP | {"depth_lambda13": 0.0}


def integrated(
    p: Scene, times: list[float], b: float = 0.0, pump: Callable[[float], float] | None = None
) -> Any:
    """Return the displacements from rest by scipy, rows by time."""
    n = reference.count(p)
    square = 4.0 * math.pi**2

    def stiffness(t: float) -> Any:
        steady = 2.0 * math.pi * p["pump_hz"] * t + p["pump_phase"]
        c = math.cos(pump(t) if pump else steady)
        k = np.zeros((n, n))
        for i in range(n):
            k[i, i] = square * p[f"f{i + 1}"] ** 2 * (1.0 + p[f"depth_f{i + 1}"] * c)
            for j in range(i):
                mark = f"{j + 1}{i + 1}"
                modulated = 1.0 + p[f"depth_lambda{mark}"] * c
                k[i, j] = k[j, i] = -square * p[f"lambda{mark}"] ** 2 * modulated
        return k

    gains = np.array([p[f"g{i + 1}"] for i in range(n)])
    damping = 2.0 * math.pi * np.array([p[f"d{i + 1}"] for i in range(n)])

    def rate(t: float, y: Any) -> Any:
        force = b + sum(
            p[f"A{k}"] * math.cos(2.0 * math.pi * p[f"u{k}"] * t + p[f"phase{k}"]) for k in (1, 2)
        )
        return np.concatenate([y[n:], gains * force - damping * y[n:] - stiffness(t) @ y[:n]])

    found = solve_ivp(
        rate,
        (0.0, times[-1]),
        np.zeros(2 * n),
        method="DOP853",
        t_eval=times,
        rtol=1e-12,
        atol=1e-14,
    )
    return found.y[:n].T


def test_strong_pump_from_rest_and_settled_as_scipy_integrates_it(models: Models) -> None:
    """From rest at all times; on the orbit once the transient is below 1e-9."""
    times = [0.13, 0.9, 4.4, 31.0, 150.0, 150.7, 153.1]
    truth = integrated(STRONG, times, b=0.3)
    size = np.abs(truth).max()
    fmu = models(3).start(**STRONG, b=0.3)
    assert np.abs(np.array(fmu.run(times, "q1", "q2", "q3")) - truth).max() <= 3e-10 * size
    fmu = models(3).start(**STRONG, b=0.3, periodic_start=True)
    late = np.array(fmu.run(times, "q1", "q2", "q3"))[4:]
    assert np.abs(late - truth[4:]).max() <= 3e-10 * size
    assert np.abs(truth[:2] - np.array(fmu_orbit(fmu, times[:2]))).max() > 0.01 * size


def fmu_orbit(fmu: Instance, times: list[float]) -> list[list[float]]:
    fmu.slave.reset()
    return fmu.start(**STRONG, b=0.3, periodic_start=True).run(times, "q1", "q2", "q3")


def test_rk4_stays_on_the_orbit_that_harmonic_balance_starts_on(models: Models) -> None:
    times = [0.4, 3.0, 11.0]
    exact = models(3).start(**STRONG, periodic_start=True).run(times, "readout", "q2", "q3")
    fmu = models(3).start(**STRONG, periodic_start=True, solver=RK4, rk4_substep=1e-3)
    # 97 rad of a 1.4 Hz motion, each at (2 pi 1.4 Hz 1 ms)^4/120
    assert np.allclose(fmu.run(times, "readout", "q2", "q3"), exact, rtol=0.0, atol=5e-9)


def test_how_a_pumped_run_is_cut_does_not_matter(models: Models) -> None:
    end = 37.3
    giant = models(3).start(**STRONG).run([end], "q1", "q2", "q3")[-1]
    small = models(3).start(**STRONG).run(list(np.linspace(0.0, end, 200)[1:]), "q1", "q2", "q3")
    assert small[-1] == pytest.approx(giant, rel=1e-11)


def test_sidebands_stand_in_the_spectrum_where_they_are_told(models: Models) -> None:
    """All frequencies are whole numbers of bins: the FFT is the Fourier series."""
    p = STRONG | {"u1": 1.0, "pump_hz": 0.3125, "A2": 0.0, "phase1": 0.0}
    fmu = models(3).start(**p, periodic_start=True, readout2=0.5)
    count, window = 512, 16.0
    times = [window * (k + 1) / count for k in range(count)]
    q = np.array(fmu.run(times, "readout"))[:, 0]
    spectrum = 2.0 / count * np.fft.fft(np.roll(q, 1))
    for name, f in (("", 1.0), ("_upper", 1.3125), ("_lower", 0.6875)):
        told = line(fmu, f"readout_{{}}_u1{name}")
        assert abs(spectrum[round(f * window)] - told) <= 1e-9 * abs(told)


def test_the_lock_in_passes_its_own_line_alone(models: Models) -> None:
    times = [0.2, 1.7, 2.9]
    fmu = models(3).start(**STRONG, readout3=-0.4)
    found = np.array(fmu.run(times, "readout_at_u1", "readout_at_u2"))
    for tone in (1, 2):
        told = line(fmu, f"readout_{{}}_u{tone}")
        turns = np.exp(2j * math.pi * STRONG[f"u{tone}"] * np.array(times))
        assert np.allclose(found[:, tone - 1], (told * turns).real, rtol=0.0, atol=1e-13)


def test_no_depth_is_no_pump_and_little_depth_little(models: Models) -> None:
    scene = scenes(3, 1, seed=3)[0]
    names = [f"q{i}_{part}_u{tone}" for i in (1, 2, 3) for part in "XY" for tone in (1, 2)]
    bare = models(3).start(**scene).get(*names)
    pump = {"pump_hz": scene["f1"] * 0.01, "pump_phase": 1.0}
    assert models(3).start(**scene, **pump).get(*names) == bare
    faint = models(3).start(**scene, **pump, depth_f1=1e-30).get(*names)
    assert faint == pytest.approx(bare, rel=1e-14)


# --- closed forms --------------------------------------------------------------------------------


def test_weak_pump_at_the_splitting_opens_the_line_as_rotating_waves_do(models: Models) -> None:
    """Two amplitudes in the rotating wave, coupled by p12/2; what it leaves out is of order d/f.

    2 eta_1 (eta_1 - v + i w1/2) a1 + p12/2 a2 = g1, and likewise a2 at v + u_p: lines apart by
    |p12|/(2 sqrt(eta_1 eta_2)), arXiv:2412.16767 and the averaging of the equations here.
    """
    eta1, eta2, w1, w2, apart = 6.94e6, 7.03e6, 20.0, 25.0, 400.0
    modulation = 2.0 * apart * math.sqrt(eta1 * eta2)
    coupling = 1e3  # lambda itself shifts the modes by lambda^4/f^2: nothing
    p = {"f1": eta1, "f2": eta2, "lambda12": coupling, "d1": w1, "d2": w2, "g1": 1.0, "g2": 0.0}
    p |= {"pump_hz": eta2 - eta1, "depth_lambda12": modulation / coupling**2}
    p |= {"A1": 1.0, "A2": 0.0, "phase1": 0.0}
    at = eta1 + np.linspace(-400.0, 400.0, 161)
    fmu = models(2)
    found = []
    for v in at:
        fmu.slave.reset()
        found.append(line(fmu.start(**p, u1=float(v)), "readout_{}_u1"))
    first = 2.0 * eta1 * (eta1 - at + 0.5j * w1)
    second = 2.0 * eta2 * (eta2 - (at + p["pump_hz"]) + 0.5j * w2)
    wanted = second / (first * second - 0.25 * modulation**2) / (4.0 * math.pi**2)
    largest = np.abs(wanted).max()
    assert np.abs(found - wanted).max() <= 2e-3 * largest
    sizes = np.abs(found)
    tops = at[1:-1][(sizes[1:-1] > sizes[:-2]) & (sizes[1:-1] > sizes[2:])]
    assert tops.size == 2
    assert tops[1] - tops[0] == pytest.approx(apart, abs=5.0)


@pytest.mark.parametrize("quality", [50.0, 1e4])
def test_parametric_resonance_begins_where_mathieu_says(models: Models, quality: float) -> None:
    """At twice the eigenfrequency a pump of depth 2/Q undoes the damping, to (1/Q)^2."""
    p = {"f1": 1e6, "d1": 1e6 / quality, "pump_hz": 2e6, "u1": 0.9e6}
    threshold = 2.0 / quality
    assert models(1).start(**p, depth_f1=0.998 * threshold).step(0.0, 1e-6) == OK
    fmu = models(1).start(**p, depth_f1=1.002 * threshold)
    assert fmu.step(0.0, 1e-6) == DISCARD
    assert "unstable" in fmu.status_message()
    assert "pump_hz = 2000000.0 Hz" in fmu.status_message()


def test_amplification_below_the_threshold(models: Models) -> None:
    """Degenerate parametric amplifier: 1/(1 -+ depth/threshold), by the pump's phase."""
    quality, part = 1e4, 0.6
    p = {"f1": 1e6, "d1": 1e6 / quality, "pump_hz": 2e6, "u1": 1e6, "A2": 0.0}
    bare = abs(line(models(1).start(**p), "q1_{}_u1"))
    gains = []
    for phase in (0.5 * math.pi, -0.5 * math.pi):
        fmu = models(1).start(**p, depth_f1=part * 2.0 / quality, pump_phase=phase)
        # the sideband at u - 2u turns as the tone does, mirrored
        total = line(fmu, "q1_{}_u1") + line(fmu, "readout_{}_u1_lower").conjugate()
        gains.append(abs(total) / bare)
    assert sorted(gains) == pytest.approx([1.0 / (1.0 + part), 1.0 / (1.0 - part)], rel=1e-3)


# --- the bound, and refusals ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "wanted", [1e-2, *(pytest.param(x, marks=pytest.mark.nightly) for x in (1e-1, 1e-4, 1e-7))]
)
def test_the_cut_costs_less_than_its_bound(wanted: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """All sidebands together against a chain cut far out, at strong pumps in many places."""
    names = [f"lambda{a}{b}" for a, b in ((1, 2), (1, 3), (2, 3))]
    checked, whole, asked = 0, Side.tail, modes_steady.Wanted(wanted)
    for pump_hz in (0.11, 0.31, 0.52):
        scene: Scene = STRONG | {"pump_hz": pump_hz}
        p = Parameters(
            f=tuple(scene[f"f{i}"] for i in (1, 2, 3)),
            d=tuple(scene[f"d{i}"] for i in (1, 2, 3)),
            coupling=tuple(scene[name] for name in names),
            g=(1.0, -0.5, 0.7),
            depth_f=tuple(scene[f"depth_f{i}"] for i in (1, 2, 3)),
            depth_coupling=tuple(scene[f"depth_{name}"] for name in names),
            **{
                name: scene[name]
                for name in ("u1", "u2", "A1", "A2", "phase1", "phase2", "pump_hz", "pump_phase")
            },
        )
        frame = modes_steady.Frame(matrices(p), None, pump_hz)
        for u in (0.0, 0.3, 0.97, 1.31, 4.0):
            full = modes_steady.steady_state(frame, p.g, u)
            cut = modes_steady.steady_state(frame, p.g, u, asked)
            reach = range(-full.below, len(full.sidebands) - full.below)
            error = sum(
                np.linalg.norm(np.array(full.sideband(k)) - np.array(cut.sideband(k)))
                for k in reach
            )
            size = max(np.linalg.norm(np.array(cut.sideband(k))) for k in reach)
            assert error <= cut.bound + full.bound
            assert cut.bound <= (wanted + 1e-14) * np.linalg.norm(np.array(cut.sideband(0)))
            checked += len(cut.sidebands) < len(full.sidebands)
            # what the cut does to the sidebands that are kept, without those that are not
            with monkeypatch.context() as patch:
                patch.setattr(Side, "tail", lambda side, end: whole(side, end)._replace(rest=0.0))
                cut = modes_steady.steady_state(frame, p.g, u, asked)
            error = sum(
                np.linalg.norm(np.array(full.sideband(k)) - np.array(cut.sideband(k)))
                for k in range(-cut.below, len(cut.sidebands) - cut.below)
            )
            assert error <= cut.bound + full.bound + 1e-15 * size
    assert checked >= 10


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"depth_f1": 0.1, "pump_hz": 2 * 6.9523e6}, "makes the modes unstable"),
        ({"depth_f1": 0.9, "pump_hz": 1e3}, "too slow and too deep"),
        ({"depth_f1": 1e-9, "pump_hz": 1e-4}, "too slow: what more than 200000 sidebands"),
    ],
)
def test_pumps_that_cannot_be_are_refused(models: Models, values: Scene, words: str) -> None:
    fmu = models(3).start(**values, periodic_start=True)
    assert fmu.step(0.0, 1e-8) == DISCARD
    assert words in fmu.status_message()
    assert math.isnan(fmu.get("readout")[0])


def test_a_pump_with_a_new_frequency_goes_on_in_phase(models: Models) -> None:
    """A run whose pump changes, against scipy with a phase that is the integral of frequency."""
    change, end, after = 5.3, 9.1, 0.37
    kept = STRONG["pump_phase"] + 2.0 * math.pi * (STRONG["pump_hz"] - after) * change

    def pump(t: float) -> float:
        before = 2.0 * math.pi * STRONG["pump_hz"] * t + STRONG["pump_phase"]
        return before if t < change else 2.0 * math.pi * after * t + kept

    truth = integrated(STRONG, [change, end], pump=pump)
    fmu = models(3).start(**STRONG)
    fmu.run([change], "q1")
    fmu.set(pump_hz=after)
    assert fmu.step(change, end - change) == OK
    error = np.abs(np.array(fmu.get("q1", "q2", "q3")) - truth[1]).max()
    assert error <= 1e-8 * np.abs(truth).max()
