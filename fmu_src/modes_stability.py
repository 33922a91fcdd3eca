"""Whether pumped modes are stable: a bound that costs nothing, else the monodromy matrix.

A Floquet exponent s with Re s >= 0 would be a vector (x_k) with A(v_k) x_k + C_p/2 (x_(k-1) +
x_(k+1)) = 0 on v_k = v + k u_p (the real part of s only adds stiffness and damping). Take the real
part of sum conj(m_k) x_k* (...), m_k = r_k + i j_k, with j_k = sign(v_k) and r_k = r q^l on the
l-th sideband off 0 on either side, as far as v_k^2 <= C/2, and 0 further out. In the norm of C,
|C_p| <= t, it is positive, and so there is no such vector, if

    1/q + 2 + q < 2/t,    r = 2 t/(2 - t (3 + q)),    m u_p d/C > t r q^(m-1)/4,

m the number of such sidebands on one side: a pump between modes (u_p far below them) couples them
without loss or gain but for the m-th power of its depth. Where that does not do (u_p near a sum of
eigenfrequencies), the matrix over one pump period is integrated and its powers decide.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .model_error import ModelError
from .modes_matrices import frobenius, product
from .modes_motion import PeriodTable, PumpedPropagator, generator

if TYPE_CHECKING:
    from .modes_equations import Matrices
    from .modes_steady import Frame

#: Periods of the fastest mode in a pump period that are integrated; beyond, nobody would wait.
MOST_PERIODS = 500.0
#: Squarings of the monodromy matrix: 2^50 pump periods.
SQUARINGS = 50


def check_stable(frame: Frame, fastest_hz: float) -> None:
    """Raise ModelError where the pumped motion grows, or where that cannot be excluded."""
    m = frame.matrices
    if not m.pump_norm or frame.centre is not None or _conserves(m, frame.pump_hz):
        return  # the envelope's pump couples frequencies of one sign alone
    if fastest_hz / frame.pump_hz > MOST_PERIODS:
        raise ModelError(
            f"the pump at pump_hz = {frame.pump_hz!r} Hz is too slow and too deep (by "
            f"{m.relative_pump:.3g} of the stiffness) for its stability to be shown: less depth is "
            "wanted"
        )
    growth = _growth(frame, fastest_hz)
    if growth >= 1.0:
        raise ModelError(
            f"the pump at pump_hz = {frame.pump_hz!r} Hz makes the modes unstable: an oscillation "
            f"grows by the factor {growth:.9g} per pump period (parametric resonance at twice an "
            "eigenfrequency or a sum of two, divided by a whole number); less depth is wanted"
        )


def _conserves(m: Matrices, pump_hz: float) -> bool:
    """Return whether the bound above excludes growth."""
    t = m.relative_pump
    sidebands = math.floor(math.sqrt(0.5 * m.lowest) / pump_hz)
    middle = 2.0 / t - 2.0
    if sidebands < 1 or middle <= 2.0:
        return False
    q = 2.0 / (middle + math.sqrt(middle * middle - 4.0))
    r = 2.0 * t / (2.0 - t * (3.0 + q))
    loss = sidebands * pump_hz * m.narrowest / m.highest
    return loss > 1.000001 * 0.25 * t * r * q ** (sidebands - 1)


def _growth(frame: Frame, fastest_hz: float) -> float:
    """Return a number below 1 if the largest Floquet multiplier is, else that multiplier."""
    flow = PumpedPropagator(generator(frame), frame.pump_hz, fastest_hz)
    table = PeriodTable(flow, 2 * len(frame.matrices.eta))
    matrix = [[complex(x) for x in row] for row in table.period]
    logarithm, power = 0.0, 1.0
    for _ in range(SQUARINGS):
        size = frobenius(matrix)
        logarithm += math.log(size)
        if logarithm < 0.0:
            break  # a power of norm below 1 is the proof
        matrix = [[x / size for x in row] for row in matrix]
        matrix = product(matrix, matrix)
        logarithm, power = 2.0 * logarithm, 2.0 * power
    return math.exp(logarithm / power)
