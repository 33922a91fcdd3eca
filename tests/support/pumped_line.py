"""The observed line of pumped sweeps in closed form: two modes and five sidebands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.lab.pumped import PumpedBench
from fitting.measurements.measurement import Evaluation, Prediction
from fitting.text.arrays import FloatArray

REACH = 2


@dataclass(frozen=True)
class SidebandLine:
    """The observed line of a bench's sweeps, p = theta, d1, d2, at_plus, at_minus, rate.

    sum over k of A(u + k u_p) X_k + (p~/2)(X_(k-1) + X_(k+1)) = g, k = -2 to 2, over (2 pi)^2, in
    the coordinates in which the string is diagonal: p~ = f1^2 depth T e1 e1^T T^T.
    ``kept``: the sweeps that are answered for, none: all.
    """

    bench: PumpedBench
    kept: tuple[int, ...] = ()

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [Evaluation((Prediction(self.swept(p)),), runs=1) for p in ps]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        with np.errstate(invalid="ignore"):
            return [{"lambda12": np.array([self.coupling_hz(p)])} for p in ps]

    def eta_hz(self, p: FloatArray, time_h: float) -> FloatArray:
        string = self.bench.string
        shift = p[5] * time_h
        return np.array([string.eta_plus_hz + p[3] + shift, string.eta_minus_hz + p[4] + shift])

    def coupling_hz(self, p: FloatArray) -> float:
        plus, minus = self.eta_hz(p, 0.0)
        square = -0.5 * np.sin(2.0 * p[0]) * (minus - plus) * (minus + plus)
        return float(np.sqrt(square)) if square >= 0.0 else float("nan")

    def swept(self, p: FloatArray) -> FloatArray:
        return np.concatenate(
            [self._sweep(p, k) for k in self.kept or range(len(self.bench.settings))]
        )

    def _sweep(self, p: FloatArray, k: int) -> FloatArray:
        depth, detuning = self.bench.settings[k]
        at, u = self.bench.places()[k]
        eta = self.eta_hz(p, at["time"])
        c, s = np.cos(p[0]), np.sin(p[0])
        turn = np.array([[c, -s], [s, c]])
        damping = turn @ np.diag(p[1:3]) @ turn.T
        square = (c * eta[0]) ** 2 + (s * eta[1]) ** 2
        pump = 0.5 * depth * square * np.outer(turn[:, 0], turn[:, 0])
        blocks = 2 * REACH + 1 if depth else 1
        system = np.zeros((u.size, blocks, 2, blocks, 2), dtype=complex)
        for i in range(blocks):
            v = u + (i - blocks // 2) * (self.bench.apart_hz + detuning)
            system[:, i, :, i, :] = 1j * v[:, None, None] * damping
            for mode in (0, 1):
                system[:, i, mode, i, mode] += (eta[mode] - v) * (eta[mode] + v)
            for j in (i - 1, i + 1):
                if 0 <= j < blocks:
                    system[:, i, :, j, :] = pump
        force = np.zeros((u.size, blocks, 2, 1), dtype=complex)
        force[:, blocks // 2] = 1.0
        shape = (u.size, 2 * blocks)
        found = np.linalg.solve(system.reshape(*shape, 2 * blocks), force.reshape(*shape, 1))
        return np.asarray(np.abs(found[:, 2 * (blocks // 2), 0]) / (2.0 * np.pi) ** 2)
