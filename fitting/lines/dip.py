"""What a line that is a dip means for a resonator next to a feed line, or at the end of one.

With loaded quality Q = eta/w and the dip D = i a/b of the form a g + b (b at the eigenfrequency),
the losses are, by the diameter correction (DCM),

    1/Qc = (w/eta) Re D/k        1/Qi = (w/eta) (1 - Re D/k)        k = 1 notch, 2 reflection

Losses add up and are nearly linear in what is fitted, so that errors are those of the losses:
intervals are symmetric in 1/Q, and one that reaches zero loss is open above.

Source: S. Probst et al., Rev. Sci. Instrum. 86 (2015) 024706.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fitting.lines.form import LineFit
from fitting.lines.record import LineNumber, Renamed, number_of_line
from fitting.signal.student import ratio95
from fitting.text.arrays import ComplexArray, FloatArray

NOTCH, REFLECTION = DIPS = ("notch", "reflection")
#: k of 1/Qc = Re D/(k Q).
DIVISORS = {NOTCH: 1.0, REFLECTION: 2.0}


@dataclass(frozen=True, kw_only=True)
class DipReading(Renamed):
    """Meaning of a dip: next to a feed line (notch) or at its end (reflection).

    Intervals of both quality factors are symmetric in 1/Q, infinite above if no loss fits as well;
    NaN: negative loss.
    """

    wiring: str
    q_coupling: LineNumber
    q_internal: LineNumber


def dip_readings(
    frequency_hz: FloatArray, line: LineFit, wiring: str = ""
) -> tuple[DipReading, ...]:
    """What a line means in each wiring in which one mode can be such a dip; nothing without phases.

    Args:
        frequency_hz: of the points, rising, shape (n,), Hz.
        line: as it was fitted.
        wiring: "notch" or "reflection" if that was requested, another form, or empty.
    """
    requested = wiring in DIPS
    if line.coefficients.size < 2 or line.form.bent or (wiring and not requested):
        return ()
    depth, slopes = _depth(frequency_hz, line)
    if not requested and abs(1.0 - depth) >= 1.0:
        return ()
    made = [_reading(kind, depth, slopes, line) for kind in ((wiring,) if requested else DIPS)]
    return tuple(each for each in made if requested or not math.isnan(each.q_internal.value))


def _depth(f: FloatArray, line: LineFit) -> tuple[complex, ComplexArray]:
    """The dip D at the eigenfrequency, and its derivatives by all that was fitted."""
    coefficients = line.coefficients
    half = 0.5 * float(np.ptp(f))
    powers = np.array([1.0, (line.frequency.value - float(f[0]) - half) / half])
    powers = powers[: coefficients.size - 1]
    baseline = complex(coefficients[1:] @ powers)
    depth = complex(1j * coefficients[0] / baseline)  # g is -i at the eigenfrequency
    by_coefficient = np.array([1j, *(-depth * powers)]) / baseline
    slopes = np.zeros(line.covariance.shape[0], dtype=complex)
    slopes[-2 * coefficients.size :] = np.outer(by_coefficient, [1.0, 1j]).ravel()
    if coefficients.size > 2:
        slopes[0] = -depth / baseline * complex(coefficients[2]) / half
    return depth, slopes


def _reading(kind: str, depth: complex, slopes: ComplexArray, line: LineFit) -> DipReading:
    """Both qualities with the errors of their losses; `slopes` are the derivatives of the dip."""
    of_log_q = np.zeros(slopes.size)
    of_log_q[:2] = 1.0 / line.frequency.value, -1.0 / line.width.value
    share, of_share = depth.real / DIVISORS[kind], slopes.real / DIVISORS[kind]
    return DipReading(
        wiring=kind,
        q_coupling=_quality("q_coupling", share, of_share - share * of_log_q, line),
        q_internal=_quality("q_internal", 1.0 - share, -of_share - (1.0 - share) * of_log_q, line),
    )


def _quality(name: str, share: float, slopes: FloatArray, line: LineFit) -> LineNumber:
    """1/loss of the loss share/Q, its error and its 95 % interval; slopes are those of loss Q."""
    loss = share / line.q.value
    error = math.sqrt(max(0.0, float(slopes @ line.covariance @ slopes))) / line.q.value
    half = error * ratio95(line.dof)
    most, least = loss + half, loss - half
    interval = (
        1.0 / most if most > 0.0 else math.nan,
        1.0 / least if least > 0.0 else math.inf,
    )
    value, std = (1.0 / loss, error / loss**2) if loss > 0.0 else (math.nan, math.nan)
    return number_of_line(name, value, std, "1", ci95=interval)
