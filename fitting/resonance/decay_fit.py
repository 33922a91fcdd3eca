"""A free decay in one form, fitted to a record: lines, what stands beside them, and their errors.

    samples     y(t) = Re sum_k c_k e^(-pi w_k t + 2 pi i f_k t) [+ c]
    phasors     z(t) =    sum_k c_k e^(-pi w_k t + 2 pi i f_k t) [+ c]      f_k from the reference
    amplitudes  R(t) = a e^(-pi w t) + c,  or its mean in Rice's noise

``alone`` is one line, ``constant`` has c beside it, ``second`` a further line, too; in ``moving``
the frequency of the line moves with the square of its amplitude. Of amplitudes ``noise`` has the
noise of X and Y, from which they do not fall, and ``constant`` the zero of a detector.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from fitting.resonance.decay_record import DecayRecord
from fitting.signal.decaying_lines import WIDEST, DecayingLines, decaying_lines, moving_line
from fitting.signal.least_squares import LeastSquaresFit, minimise_squares
from fitting.signal.line_record import CurveFit
from fitting.signal.residual_tests import SMALLEST_RESIDUAL, Structure, residual_structure
from fitting.signal.rician import LOUD, rician_deviation, rician_mean, scatter_of
from fitting.signal.student import ROOT_68, reach
from fitting.text.arrays import BoolArray, ComplexArray, FloatArray

ALONE, CONSTANT, SECOND, MOVING, NOISE = "alone", "constant", "second", "moving", "noise"
#: What each form is, in words.
FORM_WORDS = {
    ALONE: "the decay alone",
    CONSTANT: "the decay and a constant",
    SECOND: "two decays and a constant",
    MOVING: "a decay whose frequency moves with the square of its amplitude, and a constant",
    NOISE: "the decay in the noise of X and Y (Rice)",
}
#: Logarithms of widths over the first one with which amplitudes begin.
BEGINS = np.linspace(-1.5, 6.0, 16)
#: Times the noise of X above which amplitudes tell how noise hangs together, and how many at least.
ABOVE, LEAST = 2.0, 40
#: How often noise and decay of amplitudes are taken from each other.
ROUNDS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedDecay(CurveFit):
    """A form of the decay as fitted; errors are widened by ``structure``, ``curve`` is in a unit.

    Attributes:
        name: of the form.
        frequency_hz: of each line, the highest at the first sample first, Hz; from the reference if
            it was demodulated; NaN of amplitudes.
        width_hz: full widths, Hz.
        amplitude: at the first sample, in the record's unit.
        errors: half of a 68 % interval (Student's) of each of ``frequency_hz``, ``width_hz`` and
            ``amplitude``, in this order, (3 lines,).
        shift_hz: how far the frequency is moved at the first sample, Hz, and its error; zero where
            it does not.
        background: the constant, complex if phases were recorded; of ``noise`` that of X and Y
            each; and its error, of complex ones that of either part.
        dof: degrees of freedom of the noise; correlated samples count as fewer.
        likely: twice the logarithm by which residuals of unequal sizes are less likely.
        lines: as fitted over the largest value; of amplitudes none.
        rival: another form for which the errors hold, too; mostly empty.
    """

    name: str
    frequency_hz: tuple[float, ...]
    width_hz: tuple[float, ...]
    amplitude: tuple[float, ...]
    errors: FloatArray
    shift_hz: float
    shift_std_hz: float
    background: complex
    background_std: float
    dof: float
    likely: float
    lines: DecayingLines | None = None
    rival: str = ""

    @property
    def rows(self) -> int:
        """Number of residuals."""
        return int(self.curve.size) * (2 if np.iscomplexobj(self.curve) else 1)


def fit_lines(record: DecayRecord, name: str, near: FittedDecay | None = None) -> FittedDecay:
    """A form of samples or phasors.

    Args:
        record: what was recorded.
        name: ``ALONE``, ``CONSTANT``, ``SECOND`` or ``MOVING``.
        near: one line with a constant, with which another form of this record begins.

    Raises:
        ValueError: a line that hardly oscillates.
    """
    y, step = record.values / record.top, record.spacing_s
    begin = None if near is None else near.lines
    if name == MOVING and begin is not None:
        fit = moving_line(y, step, begin, offset=True)
    elif name == SECOND:
        fit = decaying_lines(y, step, 2, offset=True, near=begin)
    else:
        fit = decaying_lines(y, step, 1, offset=name == CONSTANT)
    if fit is None:
        raise ValueError(f"{record.source}: no form {name!r}")
    return _of_lines(record, name, fit)


def _of_lines(record: DecayRecord, name: str, fit: DecayingLines) -> FittedDecay:
    count = len(fit.frequency_hz)
    structure = residual_structure(fit.left, fit.slopes, fit.columns)
    design = np.hstack([fit.slopes, fit.columns])
    covariance, dof = _spread(fit.left, design, structure)
    factors = fit.solved[0 : 2 * count : 2] + 1j * fit.solved[1 : 2 * count : 2]
    order = np.argsort(-np.abs(factors), kind="stable")
    first = fit.slopes.shape[1]
    sizes, stds = np.abs(factors), np.sqrt(np.maximum(np.diag(covariance), 0.0))
    along = np.zeros((count, design.shape[1]))
    for k, factor in enumerate(factors):
        along[k, first + 2 * k : first + 2 * k + 2] = np.array([factor.real, factor.imag]) / max(
            sizes[k], 1e-300
        )
    of_sizes = np.sqrt(np.maximum(np.sum((along @ covariance) * along, axis=1), 0.0))
    constants, of_constants = fit.solved[2 * count :], stds[first + 2 * count :]
    moved = bool(fit.shift_hz)
    rest: FloatArray | ComplexArray = fit.left
    if record.is_complex:
        rest = np.asarray(rest[: record.values.size] + 1j * rest[record.values.size :])
    return FittedDecay(
        name=name,
        frequency_hz=tuple(fit.frequency_hz[k] for k in order),
        width_hz=tuple(fit.width_hz[k] for k in order),
        amplitude=tuple(float(record.top * sizes[k]) for k in order),
        errors=np.concatenate([stds[2 * order], stds[2 * order + 1], record.top * of_sizes[order]]),
        shift_hz=fit.shift_hz[0] if moved else 0.0,
        shift_std_hz=float(stds[2 * count]) if moved else 0.0,
        background=record.top * complex(*constants) if constants.size else 0j,
        background_std=record.top * float(np.mean(of_constants)) if constants.size else 0.0,
        unknowns=fit.unknowns,
        dof=dof,
        squares=fit.squares,
        likely=0.0,
        structure=structure,
        curve=_less(record.values, record.top * rest),
        lines=fit,
    )


def _less(
    values: FloatArray | ComplexArray, rest: FloatArray | ComplexArray
) -> FloatArray | ComplexArray:
    kind = complex if np.iscomplexobj(values) else float
    return np.asarray(values - rest, dtype=kind)


def _spread(left: FloatArray, design: FloatArray, structure: Structure) -> tuple[FloatArray, float]:
    """Covariance (k, k) with Student's reach, widened for what residuals do; their freedom."""
    unknowns = design.shape[1]
    freedom = max(1, left.size - unknowns)
    independent = freedom / structure.widening**2
    sizes = np.linalg.norm(design, axis=0)
    scale = 1.0 / np.where(sizes > 0.0, sizes, 1.0)
    inverse = np.linalg.pinv((design * scale).T @ (design * scale))
    variance = structure.widening**2 * float(left @ left) / freedom
    factor = reach(ROOT_68, independent) ** 2 * variance
    return np.asarray(factor * np.outer(scale, scale) * inverse), independent


def fit_amplitudes(record: DecayRecord, name: str) -> FittedDecay:
    """A form of amplitudes.

    Args:
        record: what was recorded.
        name: `NOISE` or `CONSTANT`.
    """
    y = np.asarray(record.values.real / record.top)
    model: _Constant | _Rician
    if name == CONSTANT:
        model = _Constant(y)
        fit = minimise_squares(model.left, model.begin(), gain=1e-12)
    else:
        model, fit = _in_noise(y)
    loud = model.loud(fit.values)
    structure = residual_structure(
        fit.residuals[loud], fit.jacobian[loud, :1], fit.jacobian[loud, 1:]
    )
    covariance, dof = _spread(fit.residuals, fit.jacobian, structure)
    wide, height, *added = (float(value) for value in fit.values)
    stds, span_s = np.sqrt(np.maximum(np.diag(covariance), 0.0)), y.size * record.spacing_s
    width = math.exp(_clipped(wide)) / span_s
    return FittedDecay(
        name=name,
        frequency_hz=(math.nan,),
        width_hz=(width,),
        amplitude=(record.top * abs(height),),
        errors=np.array([math.nan, width * stds[0], record.top * stds[1]]),
        shift_hz=0.0,
        shift_std_hz=0.0,
        background=complex(record.top * model.background(added)),
        background_std=record.top * float(stds[2]) if added else 0.0,
        unknowns=fit.values.size,
        dof=dof,
        squares=float(fit.residuals @ fit.residuals),
        likely=model.likely,
        structure=structure,
        curve=np.asarray(record.top * model.curve(fit.values)),
    )


class _Constant:
    """a e^(-pi w t) + c, t from 0 to 1; x is the logarithm of w, a, and c."""

    def __init__(self, values: FloatArray) -> None:
        self.values, self.t = values, np.arange(values.size) / values.size
        self.likely = 0.0

    def begin(self) -> FloatArray:
        """Where the fit begins: the best of some widths."""
        tried = []
        for wide in BEGINS:
            columns = np.column_stack([_fall(wide, self.t), np.ones(self.t.size)])
            solved = np.linalg.lstsq(columns, self.values, rcond=None)[0]
            x = np.array([wide, *solved])
            tried.append((float(np.sum(self.left(x) ** 2)), tuple(x)))
        return np.array(min(tried)[1])

    def curve(self, x: FloatArray) -> FloatArray:
        """What it is at x, (n,)."""
        return np.asarray(x[1] * _fall(float(x[0]), self.t) + x[2])

    def left(self, x: FloatArray) -> FloatArray:
        """What it leaves, (n,)."""
        return self.values - self.curve(x)

    def loud(self, x: FloatArray) -> BoolArray:
        """Samples whose residuals are looked at, (n,): all."""
        return np.ones(x.size and self.t.size, dtype=bool)

    def background(self, solved: Sequence[float]) -> float:
        """c."""
        return solved[0]


def _in_noise(values: FloatArray) -> tuple[_Rician, LeastSquaresFit]:
    """Amplitudes in Rice's noise; it is that which the fit leaves, or solved for in what drowns.

    The scatter from sample to sample, with which it begins, is less where the noise is slow.
    """
    scatter = scatter_of(values)
    model = _Rician(values, scatter.noise, scatter.weights, scatter.drowns)
    fit = minimise_squares(model.left, model.begin(), gain=1e-12)
    for _ in range(ROUNDS):
        left = float(np.sqrt(np.mean(fit.residuals**2)))
        noise = model.background([float(each) for each in fit.values[2:]]) if model.drowns else left
        if not noise > SMALLEST_RESIDUAL:
            break
        weights = rician_deviation(np.minimum(model.lengths(fit.values) / noise, LOUD))
        model = _Rician(values, noise, weights, scatter.drowns)
        fit = minimise_squares(model.left, fit.values, gain=1e-12)
    return model, fit


class _Rician:
    """The mean of |a e^(-pi w t) + noise of X and Y|; x is the logarithm of w, a, and that noise.

    The noise is not solved for where the decay does not drown in it. ``weights`` are deviations of
    amplitudes over it.
    """

    def __init__(self, values: FloatArray, noise: float, weights: FloatArray, drowns: bool) -> None:
        self.values, self.t = values, np.arange(values.size) / values.size
        self.noise, self.weights, self.drowns = noise, weights, drowns
        self.likely = 2.0 * float(np.sum(np.log(weights)))

    def begin(self) -> FloatArray:
        """Where the fit begins: the best of some widths."""
        tried = []
        power = self.values**2 - 2.0 * self.noise**2
        for wide in BEGINS:
            fall = _fall(wide, self.t) ** 2
            height = float(fall @ power) / float(fall @ fall)
            height = math.sqrt(max(height, self.noise**2, SMALLEST_RESIDUAL**2))
            x = np.array([wide, height, self.noise][: 2 + self.drowns])
            tried.append((float(np.sum(self.left(x) ** 2)), tuple(x)))
        return np.array(min(tried)[1])

    def lengths(self, x: FloatArray) -> FloatArray:
        """a e^(-pi w t) at x, (n,)."""
        return np.asarray(np.abs(x[1] * _fall(float(x[0]), self.t)))

    def curve(self, x: FloatArray) -> FloatArray:
        """What it is at x, (n,)."""
        return rician_mean(self.lengths(x), self.background([float(each) for each in x[2:]]))

    def left(self, x: FloatArray) -> FloatArray:
        """What it leaves over the weights, (n,)."""
        return (self.values - self.curve(x)) / self.weights

    def loud(self, x: FloatArray) -> BoolArray:
        """Samples whose residuals are looked at, (n,): those above the noise, if there are some.

        In it amplitudes follow each other less than above it, where they tell the width.
        """
        above = self.lengths(x) > ABOVE * self.noise
        return above if np.count_nonzero(above) >= LEAST else np.ones(self.t.size, dtype=bool)

    def background(self, solved: Sequence[float]) -> float:
        """Noise of X, and of Y."""
        return abs(solved[0]) if solved else self.noise


def _clipped(wide: float) -> float:
    return float(np.clip(wide, -WIDEST, WIDEST))


def _fall(wide: float, t: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-math.pi * math.exp(_clipped(wide)) * t))


def gain_chance(before: FittedDecay, after: FittedDecay) -> float:
    """Probability that noise alone lets a form leave so much less than one of fewer unknowns.

    The noise hangs together as the residuals of the closer form do; at any of its samples the gain
    may stand (Bonferroni). F test.

    Args:
        before: the form of fewer unknowns.
        after: the closer one.
    """
    rows = after.rows
    if before.squares <= rows * SMALLEST_RESIDUAL**2:
        return 1.0
    if after.squares <= rows * SMALLEST_RESIDUAL**2:
        return 0.0
    more = max(1, after.unknowns - before.unknowns)
    gain = max(0.0, before.squares / after.squares - 1.0) / more * after.dof
    return min(1.0, rows * float(fdtrc(more, after.dof, gain)))


def least_chance(record: DecayRecord, form: FittedDecay) -> float:
    """Probability that noise about a constant looks as much like a decay as this.

    Args:
        record: what was recorded.
        form: a form of it.
    """
    y = record.values / record.top
    squares = float(np.sum(np.abs(y - np.mean(y)) ** 2))
    if form.squares <= form.rows * SMALLEST_RESIDUAL**2:
        return 0.0 if squares > form.squares else 1.0
    more = max(1, form.unknowns - (2 if record.is_complex else 1))
    gain = max(0.0, squares / form.squares - 1.0) / more * form.dof
    return min(1.0, form.rows * float(fdtrc(more, form.dof, gain)))
