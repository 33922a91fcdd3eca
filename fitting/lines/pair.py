"""Two lines in one sweep, however near to each other: places, widths, heights, with errors.

    S(f) = h1 g1(f) + h2 g2(f) + b        complex values
    R(f) = |h1 g1(f) + h2 g2(f)|          amplitudes, h1 real

The heights are complex: two modes of the same output are in phase only where each is a normal mode
that real damping does not couple. Another form of line that is no special case of the pair is
compared with it by the extra sum of squares as one that is, the probability times all points at
which noise may look like a second line (Bonferroni). A line that bends with its amplitude looks
like a pair, too: `bent_line` is one of the forms that are compared.

Source: N. Draper and H. Smith, Applied Regression Analysis (extra sum of squares).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fitting.lines.choice import gain_p
from fitting.lines.form import AMPLITUDE_FORMS, COMPLEX_FORMS, fit_form
from fitting.lines.second import PAIRS, PHASES
from fitting.lines.solve import Fit, fit_model
from fitting.lines.starts import amplitude_starts, bent_starts
from fitting.lines.sweep_model import AmplitudeSweep, ComplexSweep, Place, Shapes
from fitting.signal.line_record import CurveFit
from fitting.signal.lines_together import lines_together
from fitting.signal.residual_tests import SMALLEST_RESIDUAL
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput

#: Fewer points do not tell two lines from one and noise.
LEAST_POINTS = 12
#: Starts from which a pair is fitted.
TRIES = 4
#: Least height of a line that counts, over the higher one.
LEAST_HEIGHT = 0.03
#: Probability from which what a pair leaves is no noise: it is held against whole models.
NO_NOISE = 1e-4


@dataclass(frozen=True, kw_only=True, eq=False)
class Pair(CurveFit):
    """Two lines, the lower one first, (2,) each: frequency and full width, Hz, complex height.

    `covariance` (4, 4) of both frequencies, then both widths, in Hz^2, with errors widened for
    correlated residuals. `curve` is over the largest value; there are so many `rows` of residuals.
    """

    frequency_hz: FloatArray
    width_hz: FloatArray
    height: ComplexArray
    covariance: FloatArray
    rows: int

    @property
    def std_hz(self) -> FloatArray:
        """Standard errors of both frequencies, then both widths, Hz, (4,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def is_noise(self) -> bool:
        """Whether what it leaves hangs together no more than noise does in one of 10,000 sweeps."""
        return self.structure.p_value > NO_NOISE

    def is_seen(self, frequency_hz: FloatArray) -> bool:
        """Whether points show both: tops among them, of widths and heights that they can tell.

        Args:
            frequency_hz: of the points (n,), Hz, rising.
        """
        spacing, span = float(np.median(np.diff(frequency_hz))), float(np.ptp(frequency_hz))
        f, w, sizes = self.frequency_hz, self.width_hz, np.abs(self.height)
        inside = np.all((frequency_hz[0] < f) & (f < frequency_hz[-1]))
        told = np.all((0.5 * spacing < w) & (w < span))
        return bool(inside and told and np.min(sizes) > LEAST_HEIGHT * np.max(sizes))

    def chance(self, squares: float, unknowns: int, points: int) -> float:
        """Probability that noise alone makes so much of what another form leaves.

        Args:
            squares: that the other form leaves, over the largest value.
            unknowns: real ones of the other form.
            points: at which noise may look like a second line; 1 for a form of two lines.
        """
        dof = (self.rows - self.unknowns) / self.structure.widening**2
        left = max(self.squares, self.rows * SMALLEST_RESIDUAL**2)
        return min(1.0, points * gain_p(squares, left, max(1, self.unknowns - unknowns), dof))


def pair_of(frequency_hz: FloatArray, values: FloatArray | ComplexArray) -> Pair | None:
    """The two lines that a sweep follows best; None where no two can be fitted.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes, or complex values, shape (n,), any unit.
    """
    f, largest = frequency_hz, float(np.max(np.abs(values)))
    if f.size < LEAST_POINTS or not largest > 0.0:
        return None
    y = values / largest
    model: ComplexSweep | AmplitudeSweep
    if np.iscomplexobj(y):
        made = _complex(f, np.asarray(y, dtype=complex))
        if made is None:
            return None
        model, starts = made
    else:
        model, starts = _amplitudes(f, np.asarray(y, dtype=float))
    try:
        fit = fit_model(model, y, starts, tries=TRIES)
    except (ValueError, np.linalg.LinAlgError):
        return None
    if isinstance(model, ComplexSweep):
        height = np.asarray(fit.coefficients[:2], dtype=complex)
    else:
        height = fit.coefficients[0] * np.array([1.0, model.heights(fit.x)[0]])
    return _pair(fit, model.shapes, height)


def _complex(f: FloatArray, y: ComplexArray) -> tuple[ComplexSweep, list[FloatArray]] | None:
    """Two lines on a complex constant, begun at the poles of a rational function."""
    modes = lines_together(f, y, 2, 3).modes
    if len(modes) < 2:
        return None
    spacing, span = float(np.median(np.diff(f))), float(np.ptp(f))
    places = [
        Place(
            float(np.clip(mode.frequency_hz, f[0], f[-1])),
            float(np.clip(abs(mode.width_hz), 0.1 * spacing, span)),
        )
        for mode in modes
    ]
    model = ComplexSweep(shapes=Shapes(frequency_hz=f, starts=places), background=1)
    return model, [np.zeros(4)]


def _amplitudes(f: FloatArray, y: FloatArray) -> tuple[AmplitudeSweep, list[FloatArray]]:
    """Two lines, begun next to each other about the middle of the top, and one in the other."""
    high = f[y >= math.sqrt(0.5) * float(np.max(y))]
    width = max(float(high[-1] - high[0]), float(np.median(np.diff(f))))
    middle = Place(0.5 * float(high[0] + high[-1]), width)
    model = AmplitudeSweep(shapes=Shapes(frequency_hz=f, starts=[middle, middle]))
    starts = [
        np.array([low, math.log(one), up, math.log(two), math.cos(phase), math.sin(phase)])
        for low, up, one, two in PAIRS
        for phase in PHASES
    ]
    return model, starts


def bent_line(frequency_hz: FloatArray, values: FloatArray | ComplexArray) -> tuple[float, int]:
    """Squares over the largest value that a line which bends leaves, and its unknowns.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes, or complex values, next to which a constant may be, shape (n,).
    """
    form = (
        COMPLEX_FORMS["duffing_offset"] if np.iscomplexobj(values) else AMPLITUDE_FORMS["duffing"]
    )
    sizes = np.abs(values)
    starts = [*amplitude_starts(frequency_hz, sizes), *bent_starts(frequency_hz, sizes)]
    try:
        fit = fit_form(frequency_hz, values, form, starts)
    except BadInput:
        return math.inf, 7 if np.iscomplexobj(values) else 4
    return fit.squares, fit.unknowns


def _pair(fit: Fit, shapes: Shapes, height: ComplexArray) -> Pair:
    """Both lines, the lower one first."""
    places = shapes.places(fit.x)
    frequencies = np.array([place.frequency_hz for place in places])
    widths = np.array([place.width_hz for place in places])
    units = np.array([*(start.width_hz for start in shapes.starts), *widths])
    at = [0, 2, 1, 3]  # both shifts, then both widths
    noise = fit.structure.widening**2 * fit.squares / fit.dof
    spread = noise * np.outer(units, units) * fit.inverse[np.ix_(at, at)]
    order = np.argsort(frequencies)
    both = np.concatenate([order, order + 2])
    return Pair(
        frequency_hz=frequencies[order],
        width_hz=widths[order],
        height=height[order],
        covariance=spread[np.ix_(both, both)],
        curve=fit.curve,
        squares=fit.squares,
        rows=fit.residuals.size,
        unknowns=fit.unknowns,
        structure=fit.structure,
    )
