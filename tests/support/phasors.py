"""A bound campaign of the string answered by phasors in numpy: fast enough for many laboratories.

The same formulas as `tests.closed_form`, over all tones of a campaign at once. That the FMU answers
alike is held by tests/fit/test_reconstruction.py; a coverage benchmark needs 1e5 evaluations.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitting.campaign import BoundCampaign
from fitting.measurements.measurement import Evaluation
from fitting.signal.scale import Maximum
from fitting.text.arrays import ComplexArray, FloatArray, IntArray
from tests.support.closed_form import damping
from tests.support.datasets import answer

TWO_PI = 2.0 * math.pi
OUTPUTS = ("q1_hybrid", "q2_hybrid")


@dataclass(frozen=True)
class PhasorResponse:
    """`Response` of a campaign whose FMU is CoupledOscillator (rotation form)."""

    bound: BoundCampaign

    @cached_property
    def _rows(self) -> tuple[FloatArray, FloatArray, IntArray, list[str]]:
        """Tones (m,), eigenfrequencies (m, 2), modes (m,), label of each row."""
        tones, etas, modes, labels = [], [], [], []
        for e in self.bound.experiments:
            for tone in e.tones_hz:
                tones.append(tone)
                etas.append((float(e.settings["eta_plus"]), float(e.settings["eta_minus"])))
                modes.append(OUTPUTS.index(e.output or self.bound.setup.output))
                labels.append(e.label)
        return np.array(tones), np.array(etas), np.array(modes), labels

    @cached_property
    def _shifts(self) -> list[tuple[int, FloatArray]]:
        """(index of the parameter, (m, 2) what it adds to the eigenfrequencies of each row)."""
        labels = self._rows[3]
        found = []
        for k, p in enumerate(self.bound.parameters):
            if p.experiments:
                inside = np.array([label in p.experiments for label in labels], dtype=float)
                adds = np.array(["eta_plus" in p.adds_to, "eta_minus" in p.adds_to], dtype=float)
                found.append((k, np.outer(inside, adds)))
        return found

    def _damping(self, p: FloatArray) -> FloatArray:
        values: Mapping[str, float] = {
            q.name: float(v) for q, v in zip(self.bound.parameters, p, strict=True)
        }
        return damping(values["theta"], values["d1"], values["d2"], False)

    def peaks(self, p: FloatArray) -> FloatArray | ComplexArray:
        """Amplitudes of all lines, or complex values where the campaign has phases."""
        tones, etas, modes, _ = self._rows
        moved = etas.copy()
        for k, shift in self._shifts:
            moved = moved + p[k] * shift
        found = _phasors(tones, moved, self._damping(p), modes)
        return found if self.bound.experiments[0].phases_rad is not None else np.abs(found)

    def sweep(self, p: FloatArray) -> FloatArray:
        assert self.bound.sweep is not None
        return self._swept(p, self.bound.sweep.frequency_hz)

    def _swept(self, p: FloatArray, tones: FloatArray) -> FloatArray:
        assert self.bound.sweep is not None
        settings = self.bound.sweep.settings
        eta = np.array([[float(settings["eta_plus"]), float(settings["eta_minus"])]])
        for k, q in enumerate(self.bound.parameters):
            if self.bound.sweep.label in q.experiments:
                eta[0] += p[k] * np.array(["eta_plus" in q.adds_to, "eta_minus" in q.adds_to])
        mode = np.full(tones.size, OUTPUTS.index(self.bound.setup.output))
        swept = np.repeat(eta, tones.size, axis=0)
        return np.abs(_phasors(tones, swept, self._damping(p), mode))

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        if self.bound.sweep is None:
            return [answer(self.peaks(p), runs=1) for p in ps]
        whole = whole or self.bound.sweep.use == "fit"
        return [
            answer(self.peaks(p), self.sweep(p) if whole else None, self._maximum(p), 1) for p in ps
        ]

    def _maximum(self, p: FloatArray) -> Maximum:
        """Top of the sweep: 1/|X|^2 is a parabola there, to 1e-6 of the line width."""
        assert self.bound.sweep is not None
        mode = OUTPUTS.index(self.bound.setup.output)
        eta = float(self.bound.sweep.settings[("eta_plus", "eta_minus")[mode]])
        width = float(self._damping(p)[mode, mode])
        x = 0.05 * width * np.array([-1.0, 0.0, 1.0])
        y = self._swept(p, eta + x) ** -2.0
        a, b = 0.5 * (y[0] + y[2]) - y[1], 0.5 * (y[2] - y[0])
        top = y[1] - b * b / (4.0 * a)
        if not top > 0.0:  # far outside the box, where it is no parabola
            top = float(np.min(y))
        return Maximum(value=float(top**-0.5), frequency_hz=eta, bias=0.0, bracketed=True)

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [self._derived(p) for p in ps]

    def _derived(self, p: FloatArray) -> dict[str, FloatArray]:
        names = [q.name for q in self.bound.parameters]
        theta = float(p[names.index("theta")])
        _, etas, _, labels = self._rows
        moved = etas.copy()
        for k, shift in self._shifts:
            moved = moved + p[k] * shift
        first = [labels.index(e.label) for e in self.bound.experiments]
        plus, minus = moved[first, 0], moved[first, 1]
        d = self._damping(p)
        with np.errstate(invalid="ignore"):
            coupling = np.sqrt(-0.5 * math.sin(2.0 * theta) * (minus - plus) * (minus + plus))
        every = {
            "lambda": coupling,
            "width_plus": np.full(plus.size, d[0, 0]),
            "width_minus": np.full(plus.size, d[1, 1]),
            "Q_plus": plus / d[0, 0],
            "Q_minus": minus / d[1, 1],
        }
        return {name: every[name] for name in self.bound.derived}


def _phasors(u: FloatArray, eta: FloatArray, d: FloatArray, modes: IntArray) -> ComplexArray:
    """X_mode(u) row by row: tones (m,), eta (m, 2), damping matrix d (2, 2) in Hz, modes (m,)."""
    a = TWO_PI**2 * ((eta - u[:, None]) * (eta + u[:, None]) + 1j * u[:, None] * np.diag(d))
    off = 1j * TWO_PI**2 * u * d[0, 1]
    determinant = a[:, 0] * a[:, 1] - off * off
    other = np.where(modes == 0, a[:, 1], a[:, 0])
    return np.asarray((other - off) / determinant)
