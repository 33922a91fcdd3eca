"""Steady motions of two modes with cubic terms, and their lines by harmonic balance.

The balance is written here from the equations of motion, on its own: lines of odd order of one tone
or of two, the cubic forces on a grid of both tones' phases, Newton's method on all of them at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray
from fmu_src.duffing_oscillator import DuffingOscillator
from tests.support.slaves import Slave

TWO_PI = 2.0 * math.pi
#: Orders of lines, |k1| + |k2|, and points on each tone's phase: cubes of all lines are resolved.
ORDER, PHASES = 7, 32
#: Of the envelope's steps: with two tones its lines have this error besides that of averaging.
TOLERANCE = 1e-9
OUTPUTS = ("q1_hybrid", "q2_hybrid", "q1", "q2")
BOUND, SHIFT = "envelope_error", "nonlinear_shift"


class NotComparable(Exception):
    """The scene has no steady motion here that a balance of this order describes."""


@dataclass(frozen=True)
class Scene:
    """Start values of the FMU, and how many periods of its beat and carrier are common.

    ``beat`` is how many times the distance of two tones the lower of them is, 0 with one tone.
    """

    values: dict[str, float]
    beat: int

    @property
    def tones_hz(self) -> tuple[float, ...]:
        """Frequencies of the active tones."""
        return tuple(self.values[f"u{k}"] for k in ((1, 2) if self.beat else (1,)))


def scene(seed: int) -> Scene:
    """Two modes 1 to 10 apart in frequency, either driven, by one tone or two.

    Q from 30 to 1e4, the other mode driven (g2 = 1) or following (g2 = 0), shifts from 1e-5 to 1e-2
    of the frequency, hardening and softening, with kappa and without, on the line or beside it.

    Args:
        seed: of all that is drawn.
    """
    rng = np.random.default_rng(seed)
    ratio = float(rng.uniform(1.0, 10.0) if seed % 4 else 1.0 + 10.0 ** rng.uniform(-3.0, 0.0))
    eta = [1000.0, 1000.0 * ratio][:: rng.choice([1, -1])]
    driven = int(rng.integers(2))
    quality = 10.0 ** rng.uniform(1.5, 4.0)
    width = eta[driven] / quality
    beside = bool(rng.random() < 0.3)
    centre = eta[driven] * float(rng.uniform(0.7, 1.6)) if beside else 0.0
    centre = centre or eta[driven] + float(rng.uniform(-2.0, 2.0)) * width
    beat = int(10.0 ** rng.uniform(0.7, 2.0)) if seed % 2 else 0
    tone = centre / (beat + 0.5) if beat else centre
    stiffness = 10.0 ** rng.uniform(-5.0, -2.0) * 8.0 / 3.0 * (TWO_PI * centre) ** 2
    amplitude = TWO_PI**2 * abs(complex(eta[driven] ** 2 - centre**2, centre * width))
    second = bool(rng.integers(2))
    return Scene(
        {
            "theta": float(rng.uniform(0.0, math.pi)),
            "d1": width * float(10.0 ** rng.uniform(-0.5, 0.5)),
            "d2": width * float(10.0 ** rng.uniform(-0.5, 0.5)),
            "eta_plus": eta[0],
            "eta_minus": eta[1],
            "u1": beat * tone if beat else centre,
            "u2": (beat + 1) * tone if beat else centre,
            "A1": amplitude,
            "A2": amplitude * float(rng.uniform(0.2, 1.0)) if beat else 0.0,
            "phase1": 0.3,
            "g1": 1.0 if second or driven == 0 else 0.0,
            "g2": 1.0 if second or driven == 1 else 0.0,
            "alpha1": stiffness * float(rng.choice([1.0, -1.0, 0.1])),
            "alpha2": stiffness * float(rng.choice([1.0, 0.0, -0.7])),
            "kappa": stiffness * float(rng.choice([0.0, 0.3, -0.5, 1.0])),
            "tolerance": TOLERANCE,
            "periodic_start": True,
        },
        beat,
    )


class Balance:
    """Harmonic balance of a scene; unknowns are the lines (2 modes, n) of x = Re sum X exp.

    Lines up to ``order``, on a grid of ``phases`` of each tone.
    """

    def __init__(self, scene: Scene, order: int = ORDER, phases: int = PHASES) -> None:
        self.order = order
        v, tones = scene.values, scene.tones_hz
        c, s = math.cos(v["theta"]), math.sin(v["theta"])
        t = np.array([[c, -s], [s, c]])
        damping = TWO_PI * t @ np.diag([v["d1"], v["d2"]]) @ t.T
        eta = np.array([v["eta_plus"], v["eta_minus"]])
        self.cubic = v["alpha1"], v["alpha2"], v["kappa"]
        self.orders = _orders(len(tones), order)
        # a line next to a mode: the difference of their frequencies is exact, that of squares not
        self.linear = np.array(
            [
                np.diag(TWO_PI**2 * (eta - f) * (eta + f)) + 1j * TWO_PI * f * damping
                for f in np.array(self.orders) @ np.array(tones)
            ]
        )  # (n, 2, 2)
        turn = np.arange(phases) / phases * TWO_PI
        grid = np.stack(np.meshgrid(*[turn] * len(tones), indexing="ij")).reshape(len(tones), -1)
        self.waves = np.exp(1j * np.array(self.orders) @ grid)  # (n, grid)
        self.force = np.zeros((2, len(self.orders)), dtype=complex)
        for k in range(len(tones)):
            unit = tuple(int(i == k) for i in range(len(tones)))
            phase = np.exp(1j * v.get(f"phase{k + 1}", 0.0))
            gain = np.array([v["g1"], v["g2"]])
            self.force[:, self.orders.index(unit)] = v[f"A{k + 1}"] * phase * gain

    def residual(self, lines: ComplexArray) -> ComplexArray:
        """What is missing of the balance of every line, (2, n), m/s^2."""
        q1, q2 = (lines @ self.waves).real
        a1, a2, kappa = self.cubic
        forces = np.array([a1 * q1**3 + kappa * q1 * q2**2, a2 * q2**3 + kappa * q1**2 * q2])
        moved = np.einsum("nij,jn->in", self.linear, lines)
        missing: ComplexArray = moved + self._lines_of(forces) - self.force
        return missing

    def _lines_of(self, samples: FloatArray) -> ComplexArray:
        found: ComplexArray = 2.0 / self.waves.shape[1] * samples @ self.waves.conj().T
        return found

    def _jacobian(self, lines: ComplexArray) -> FloatArray:
        """Of the residual's real and imaginary parts along those of the lines."""
        q1, q2 = (lines @ self.waves).real
        a1, a2, kappa = self.cubic
        own = 3.0 * a1 * q1**2 + kappa * q2**2, 3.0 * a2 * q2**2 + kappa * q1**2
        cross = 2.0 * kappa * q1 * q2
        slopes = ((own[0], cross), (cross, own[1]))
        n = len(self.orders)
        found = np.zeros((2, n, 2, 2, n, 2))
        for part, unit in enumerate((1.0, 1.0j)):
            moved = (unit * self.waves).real  # (n, grid): each line's own motion
            for i in (0, 1):
                for j in (0, 1):
                    change = self._lines_of(slopes[i][j] * moved).T  # (n of force, n of line)
                    change = change + np.diag(self.linear[:, i, j] * unit)
                    found[i, :, 0, j, :, part] = change.real
                    found[i, :, 1, j, :, part] = change.imag
        return found.reshape(4 * n, 4 * n)

    def solved(self, start: ComplexArray, enough: float = 1e-9) -> ComplexArray:
        """The lines near ``start``, (2, n), to rounding; the last order below ``enough`` of all.

        Raises:
            NotComparable: Newton's method does not settle, or the last order still counts.
        """
        lines = start
        for _ in range(40):
            here = self.residual(lines)
            matrix = self._jacobian(lines)
            scale = np.linalg.norm(matrix, axis=1)
            right = np.stack([here.real, here.imag], axis=-1).reshape(-1)
            change = np.linalg.solve(matrix / scale[:, None], right / scale).reshape(2, -1, 2)
            lines = lines - (change[..., 0] + 1j * change[..., 1])
            size = np.abs(lines).max()
            if not np.abs(change).max() < 1e3 * size:
                break
            if np.abs(change).max() < 1e-13 * size:
                last = [sum(map(abs, o)) == self.order for o in self.orders]
                if np.abs(lines[:, last]).max() > enough * size:
                    raise NotComparable("the last order still counts")
                return lines
        raise NotComparable("no steady motion near this one")


def _orders(tones: int, order: int) -> list[tuple[int, ...]]:
    """Odd combinations of the tones up to the highest order, one of each with its mirror."""
    if tones == 1:
        return [(k,) for k in range(1, order + 1, 2)]
    span = range(-order, order + 1)
    return [
        (i, j)
        for i in span
        for j in span
        if abs(i) + abs(j) in range(1, order + 1, 2) and (i > 0 or (i == 0 and j > 0))
    ]


@dataclass(frozen=True)
class Compared:
    """A scene's relative errors of each displacement's largest line, and what bounds them."""

    errors: FloatArray
    bound: float
    shift: float

    @property
    def worst(self) -> float:
        """The largest error over the bound."""
        return float(np.max(self.errors)) / self.bound


def compared(scene: Scene) -> Compared:
    """What the envelope's lines are off by, beside its own bound.

    Args:
        scene: with a periodic start.

    Raises:
        NotComparable: the model refuses the scene, or the balance does.
    """
    balance = Balance(scene)
    times, fold = _times(scene, balance)
    slave = Slave(DuffingOscillator, **scene.values)
    rows = [slave.get(*OUTPUTS, BOUND, SHIFT)]
    for time in times[1:]:
        if not slave.step(float(time)):
            break
        rows.append(slave.get(*OUTPUTS, BOUND, SHIFT))
    if slave.message or len(rows) < len(times):
        raise NotComparable(slave.message)
    table = np.array(rows)
    lines: ComplexArray = (table[:, : len(OUTPUTS)].T @ fold).astype(complex)
    truth = balance.solved(lines[:2])
    theta = scene.values["theta"]
    c, s = math.cos(theta), math.sin(theta)
    physical = np.array([[c, s], [-s, c]]) @ truth
    exact = np.concatenate([truth, physical])
    largest = np.abs(exact).argmax(axis=1)
    each = np.arange(len(OUTPUTS))
    size = np.abs(exact[each, largest])
    off = np.abs(lines[each, largest] - exact[each, largest])
    counts = size > 1e-9 * size.max()
    errors = np.where(counts, off / np.where(counts, size, 1.0), 0.0)
    other = 10.0 * TOLERANCE if scene.beat else 1e-11  # steps, or rounding: not averaging
    found = np.maximum(errors - other, 0.0)
    return Compared(found, float(table[:, -2].max()), float(table[:, -1].max()))


def _times(scene: Scene, balance: Balance) -> tuple[FloatArray, Any]:
    """Times (m,) in s over a common period, and what their samples are folded with, (m, n)."""
    base = scene.values["u2"] - scene.values["u1"] if scene.beat else scene.values["u1"]
    cycles = (np.array(balance.orders) @ np.array(scene.tones_hz) / base).round()
    count = 2 * int(np.abs(cycles).max()) + 3
    times = np.arange(count) / (count * base)
    return times, 2.0 / count * np.exp(-1j * TWO_PI * np.outer(np.arange(count) / count, cycles))
