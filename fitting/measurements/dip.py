"""Dip: the quality factors of a mode beside a line, told from a notch or a reflection.

Where one mode is seen, with loaded quality Q and the dip D = -c H(eta) at its eigenfrequency,
1 + c H the wiring (`fitting.measurements.complex.wiring`),

    notch          D = (Q/|Qc|) exp(i phi)           reflection     D = 2 (Q/|Qc|) exp(i phi)

    1/Qc = Re(1/(|Qc| exp(-i phi)))                  1/Qi = 1/Q - 1/Qc

which is the diameter correction: the real part of D counts, not its modulus.
Source: S. Probst, F. Song, P. Bushev, A. Ustinov, M. Weides, Rev. Sci. Instrum. 86 (2015) 024706.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.measurements.complex.curve import ComplexCurve
from fitting.measurements.complex.gain import Solved
from fitting.measurements.complex.wiring import Wiring
from fitting.measurements.measurement import Estimated
from fitting.signal.complex_line import complex_line
from fitting.text.arrays import ComplexArray, FloatArray

#: What one mode may leave of a response that counts as that of a single one.
SINGLE = 1e-2


@dataclass(frozen=True, kw_only=True)
class Dip:
    """A mode beside a line: loaded quality `loaded_q`, its dip D = -c H(eta) at resonance."""

    kind: str
    loaded_q: float
    depth: complex

    @property
    def coupling_loss(self) -> float:
        """1/Qc, diameter corrected: Re D/(k Q), k = 1 for a notch and 2 in reflection."""
        return self.depth.real / self.divisor / self.loaded_q

    @property
    def divisor(self) -> float:
        """k of 1/Qc = Re D/(k Q)."""
        return 2.0 if self.kind == "reflection" else 1.0

    @property
    def internal_loss(self) -> float:
        """1/Qi = 1/Q - 1/Qc; negative where the coupling takes more than all."""
        return 1.0 / self.loaded_q - self.coupling_loss


def dip_of(
    wiring: Wiring, frequency_hz: FloatArray, response: ComplexArray, coefficients: ComplexArray
) -> Dip | None:
    """The dip of a single mode, None where the response is no single mode or nothing passes it by.

    Args:
        wiring: what stands beside the response.
        frequency_hz: u (n,), Hz.
        response: H (n,), in the FMU's unit.
        coefficients: of the columns H, 1, x, (k,).
    """
    line = complex_line(frequency_hz, response)
    alone = line.misfit < SINGLE and line.width_hz > 0.0
    inside = frequency_hz[0] < line.eta_hz < frequency_hz[-1]
    if not (wiring.has_baseline and alone and inside):
        return None
    baseline = coefficients[1]
    if coefficients.size > 2:
        half = 0.5 * float(np.ptp(frequency_hz))
        baseline = baseline + coefficients[2] * (line.eta_hz - frequency_hz[0] - half) / half
    return Dip(
        kind=wiring.kind,
        loaded_q=line.eta_hz / line.width_hz,
        depth=complex(-coefficients[0] / baseline * line.top),
    )


def dip_qualities(
    curve: ComplexCurve, response: ComplexArray, solved: Solved, spread: float
) -> dict[str, Estimated]:
    """Coupling and internal quality by name, as losses; nothing without a single mode's dip.

    Args:
        curve: as measured.
        response: H (n,), in the FMU's unit.
        solved: gain and backgrounds.
        spread: standard deviation of each quadrature, in ``curve.unit``.
    """
    values = _values(curve, response, solved.coefficients)
    if not values:
        return {}
    # Gaussian errors of each quadrature: those of the coefficients are circular, too
    errors = spread * _root(solved.design)
    steps = [
        _values(curve, response, solved.coefficients + factor * column)
        for column in errors.T
        for factor in (1.0, 1.0j)
    ]
    found = {}
    for name, value in values.items():
        changes = [step.get(name, np.nan) - value for step in steps]
        found[name] = Estimated(value, float(np.linalg.norm(changes)), is_loss=True)
    return found


def _values(
    curve: ComplexCurve, response: ComplexArray, coefficients: ComplexArray
) -> dict[str, float]:
    """Losses of coupling and of the mode itself by name; nothing without a single mode's dip."""
    dip = dip_of(curve.wiring, curve.u_hz, response, coefficients)
    if dip is None:
        return {}
    return {"Q_coupling": dip.coupling_loss, "Q_internal": dip.internal_loss}


def _root(design: ComplexArray) -> ComplexArray:
    """R (k, k), R R^H = (A^H A)^-1: errors of coefficients of columns A for errors of one."""
    sizes = np.linalg.norm(design, axis=0)
    upper = np.linalg.qr(design / sizes, mode="r")
    return np.asarray(np.linalg.inv(upper) / sizes[:, None])
