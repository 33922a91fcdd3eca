"""Dip: the quality factors of a mode beside a line, told from a notch or a reflection.

Where one mode is seen, with loaded quality Q and the dip D = -c H(eta) at its eigenfrequency,
1 + c H the wiring (`fitting.measurements.complex.wiring`),

    notch          D = (Q/|Qc|) exp(i phi)           reflection     D = 2 (Q/|Qc|) exp(i phi)

    1/Qc = Re(1/(|Qc| exp(-i phi)))                  1/Qi = 1/Q - 1/Qc

which is the diameter correction: the real part of D counts, not its modulus.
Source: S. Probst, F. Song, P. Bushev, A. Ustinov, M. Weides, Rev. Sci. Instrum. 86 (2015) 024706.
"""

from __future__ import annotations

import numpy as np

from fitting.lines.starts import complex_line
from fitting.measurements.complex.curve import ComplexCurve
from fitting.measurements.complex.gain import Solved
from fitting.measurements.measurement import Estimated
from fitting.text.arrays import ComplexArray

#: What one mode may leave of a response that counts as that of a single one.
SINGLE = 1e-2


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
    result = {}
    for name, value in values.items():
        changes = [step.get(name, np.nan) - value for step in steps]
        result[name] = Estimated(value, float(np.linalg.norm(changes)), is_loss=True)
    return result


def _values(
    curve: ComplexCurve, response: ComplexArray, coefficients: ComplexArray
) -> dict[str, float]:
    """Losses of coupling and of the mode itself by name; nothing without a single mode's dip.

    Args:
        curve: as measured.
        response: H (n,), in the FMU's unit.
        coefficients: of the columns H, 1, x, (k,).
    """
    u_hz, wiring = curve.u_hz, curve.wiring
    line = complex_line(u_hz, response)
    alone = line.misfit < SINGLE and line.width_hz > 0.0
    if not (wiring.has_baseline and alone and u_hz[0] < line.eta_hz < u_hz[-1]):
        return {}
    baseline = coefficients[1]
    if coefficients.size > 2:
        half = 0.5 * float(np.ptp(u_hz))
        baseline = baseline + coefficients[2] * (line.eta_hz - u_hz[0] - half) / half
    depth, loaded_q = complex(-coefficients[0] / baseline * line.top), line.eta_hz / line.width_hz
    divisor = 2.0 if wiring.kind == "reflection" else 1.0
    coupling = depth.real / divisor / loaded_q  # the diameter correction: not the modulus of D
    # what is left for the mode itself is negative where the coupling takes more than all
    return {"Q_coupling": coupling, "Q_internal": 1.0 / loaded_q - coupling}


def _root(design: ComplexArray) -> ComplexArray:
    """R (k, k), R R^H = (A^H A)^-1: errors of coefficients of columns A for errors of one."""
    sizes = np.linalg.norm(design, axis=0)
    upper = np.linalg.qr(design / sizes, mode="r")
    return np.asarray(np.linalg.inv(upper) / sizes[:, None])
