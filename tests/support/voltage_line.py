"""The mode called 1 of a string over its bias voltage and under a pump, in closed form.

It shares no code with the FMU, nor with `fitting.lab.modes`: two modes and their sidebands in the
coordinates of the lines at V0, in which the slopes of the squares are parameters themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitting.lab.voltage import VoltageBench
from fitting.measurements.measurement import Evaluation, Prediction
from fitting.text.arrays import FloatArray


@dataclass(frozen=True)
class VoltageLine:
    """Sweeps of a bench, p = theta, d1, d2, gain, g2, at_plus, at_minus, at_11, at_22, at_12.

    sum over k of A(u + k u_p) X_k + (gain V_ac V/V0)/2 S (X_(k-1) + X_(k+1)) = T g, with
    C~ = diag(eta^2) + S (V^2 - V0^2)/(2 V0), over (2 pi)^2; mode 1 is (T^T X_0)_1.
    """

    bench: VoltageBench
    #: Sidebands on either side: of a weak pump the next ones change 1e-5 of an amplitude.
    reach: int = 4

    @cached_property
    def places(self) -> list[tuple[Mapping[str, float], FloatArray]]:
        """Settings and frequencies of all sweeps."""
        return self.bench.places()

    @cached_property
    def read(self) -> FloatArray:
        """s11, s22, s12 as the campaign states them."""
        return np.array(list(self.bench.read_slopes.values()))

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [Evaluation((Prediction(self.swept(p)),), runs=1) for p in ps]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [self.outputs(p) for p in ps]

    def outputs(self, p: FloatArray) -> dict[str, FloatArray]:
        """lambda12, f1 and f2 at every sweep, Hz."""
        turn = turned(p[0])
        squares = [turn.T @ self.squares(p, at["V"]) @ turn for at, _ in self.places]
        with np.errstate(invalid="ignore"):
            f1, f2, coupling = np.sqrt([(c[0, 0], c[1, 1], -c[0, 1]) for c in squares]).T
        return {"lambda12": coupling, "f1": f1, "f2": f2}

    def slopes(self, p: FloatArray) -> FloatArray:
        """S in the coordinates of the lines at V0, Hz^2/V."""
        s11, s22, s12 = self.read + p[7:10]
        return np.array([[s11, s12], [s12, s22]])

    def squares(self, p: FloatArray, volts: float) -> FloatArray:
        """C~ over (2 pi)^2 at a voltage, Hz^2."""
        string, bias = self.bench.string, self.bench.bias_v
        eta = np.array([string.eta_plus_hz + p[5], string.eta_minus_hz + p[6]])
        moved = self.slopes(p) * (volts**2 - bias**2) / (2.0 * bias)
        return np.asarray(np.diag(eta**2) + moved)

    def swept(self, p: FloatArray) -> FloatArray:
        """Amplitudes of all sweeps, one after the other."""
        turn, result = turned(p[0]), []
        damping = turn @ np.diag(p[1:3]) @ turn.T
        force = turn @ np.array([1.0, p[4]])
        for at, u in self.places:
            squares, reach = self.squares(p, at["V"]), self.reach if at["Vac"] else 0
            half = 0.5 * p[3] * at["Vac"] * at["V"] / self.bench.bias_v * self.slopes(p)
            blocks = 2 * reach + 1
            system = np.zeros((u.size, blocks, 2, blocks, 2), dtype=complex)
            right = np.zeros((u.size, blocks, 2), dtype=complex)
            right[:, reach] = force
            for k in range(blocks):
                v = (u + (k - reach) * at["pump"])[:, None, None]
                system[:, k, :, k, :] = squares - v**2 * np.eye(2) + 1j * v * damping
                if k:
                    system[:, k, :, k - 1, :] = system[:, k - 1, :, k, :] = half
            size = 2 * blocks
            matrix = system.reshape(u.size, size, size)
            found = np.linalg.solve(matrix, right.reshape(u.size, size, 1))
            observed = found.reshape(u.size, blocks, 2)[:, reach] @ turn[:, 0]
            result.append(np.abs(observed) / (2.0 * np.pi) ** 2)
        return np.concatenate(result)


def turned(theta: float) -> FloatArray:
    """T, from uncoupled modes to lines."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([[c, -s], [s, c]])
