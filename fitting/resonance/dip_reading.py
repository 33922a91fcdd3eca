"""What a line that is a dip means for a resonator beside a feed line, or at the end of one.

With loaded quality Q = eta/w and the dip D of `fitting.measurements.dip`, i a/b of the form
(b at the eigenfrequency), the losses are

    1/Qc = (w/eta) Re D/k        1/Qi = (w/eta) (1 - Re D/k)        k = 1 notch, 2 reflection

Losses add up and are nearly linear in what is fitted, so that errors are those of the losses:
intervals are symmetric in 1/Q, and one that reaches zero loss is open above.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fitting.measurements.dip import Dip
from fitting.resonance.form import SLOPED, FittedForm
from fitting.resonance.trace import Trace
from fitting.signal.line_record import LineNumber, Renamed, number_of_line
from fitting.signal.student import ratio95
from fitting.text.arrays import ComplexArray, FloatArray

NOTCH, REFLECTION = DIPS = ("notch", "reflection")


@dataclass(frozen=True, kw_only=True)
class DipReading(Renamed):
    """What a line means that is a dip: next to a feed line (notch) or at its end (reflection).

    Intervals of both quality factors are symmetric in 1/Q, and infinite above where no loss at all
    fits the points as well. A value is NaN where its loss is negative, and the lower end where it
    is negative all over the interval.
    """

    wiring: str
    q_coupling: LineNumber
    q_internal: LineNumber


def dip_readings(trace: Trace, best: FittedForm, wiring: str) -> tuple[DipReading, ...]:
    """What a line means in each wiring in which one mode can be such a dip; nothing without phases.

    Args:
        trace: what was measured.
        best: the form that was taken.
        wiring: "notch" or "reflection" if that was requested, another form, or empty.
    """
    requested = wiring in DIPS
    if not trace.is_complex or best.coefficients.size < 2 or (wiring and not requested):
        return ()
    depth, slopes = _depth(trace, best)
    if not requested and abs(1.0 - depth) >= 1.0:
        return ()
    kinds = (wiring,) if requested else DIPS
    dips = [Dip(kind=kind, loaded_q=best.q.value, depth=depth) for kind in kinds]
    made = [_reading(dip, slopes, best) for dip in dips]
    return tuple(each for each in made if requested or not math.isnan(each.q_internal.value))


def _depth(trace: Trace, best: FittedForm) -> tuple[complex, ComplexArray]:
    """The dip D at the eigenfrequency, and its derivatives by all that was fitted."""
    f, coefficients = trace.frequency_hz, best.coefficients
    half = 0.5 * float(np.ptp(f))
    powers = np.array([1.0, (best.frequency.value - float(f[0]) - half) / half])
    powers = powers[: coefficients.size - 1]
    baseline = complex(coefficients[1:] @ powers)
    depth = complex(1j * coefficients[0] / baseline)  # g is -i at the eigenfrequency
    by_coefficient = np.array([1j, *(-depth * powers)]) / baseline
    slopes = np.zeros(best.covariance.shape[0], dtype=complex)
    slopes[-2 * coefficients.size :] = np.outer(by_coefficient, [1.0, 1j]).ravel()
    if best.name == SLOPED:
        slopes[0] = -depth / baseline * complex(coefficients[2]) / half
    return depth, slopes


def _reading(dip: Dip, slopes: ComplexArray, best: FittedForm) -> DipReading:
    """Both qualities with the errors of their losses; `slopes` are the derivatives of the dip."""
    of_log_q = np.zeros(slopes.size)
    of_log_q[:2] = 1.0 / best.frequency.value, -1.0 / best.width.value
    share, of_share = dip.depth.real / dip.divisor, slopes.real / dip.divisor
    parts = {
        "q_coupling": (share, of_share - share * of_log_q),
        "q_internal": (1.0 - share, -of_share - (1.0 - share) * of_log_q),
    }
    return DipReading(
        wiring=dip.kind, **{name: _quality(name, *part, best) for name, part in parts.items()}
    )


def _quality(name: str, share: float, slopes: FloatArray, best: FittedForm) -> LineNumber:
    """1/loss of the loss share/Q, its error and its 95 % interval; slopes are those of loss Q."""
    loss = share / best.q.value
    error = math.sqrt(max(0.0, float(slopes @ best.covariance @ slopes))) / best.q.value
    half = error * ratio95(best.dof)
    most, least = loss + half, loss - half
    interval = (
        1.0 / most if most > 0.0 else math.nan,
        1.0 / least if least > 0.0 else math.inf,
    )
    value, std = (1.0 / loss, error / loss**2) if loss > 0.0 else (math.nan, math.nan)
    return number_of_line(name, value, std, "1", ci95=interval)
