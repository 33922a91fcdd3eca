"""Does the model describe the data at all? By the residuals at the most likely point.

    chi^2 = r^T V^-1 r        freedom = m - s - tr(W C W^T)

over rows of declared or measured noise, s the unknowns that are solved for inside them; where
noise is estimated from the residuals themselves, chi square tests nothing. What follows from chi
square and from how residuals are correlated along an axis is one rule for every kind of measurement
(`fitting.signal.misfit`): rows of curves whose residuals are correlated are judged by that alone,
the rest by chi square.

With few degrees of freedom noise alone reaches several times them, but a probability of 1e-4 only
once in ten thousand fits (`fitting.signal.student`: noise that was estimated apart from the fit
leaves larger ones). What the simulation may be off by (`fitting.fit.noise`) excuses what it can
explain: it is in the intervals then, and no fault of the model.

Lines of another form may describe a fitted sweep or decay where the model does not. Where residuals
estimate the noise, chi square cannot show that the model fails. Another form of k unknowns through
the same m rows can: what it leaves, S1, bounds the noise,

    chi^2 = S (m - k)/S1        P = P(F > ((S - S1)/(k - k0)) ((m - k)/w^2)/S1)

with S of the fitted model, k0 its unknowns, and w what correlated residuals of that form widen
errors by; F has k - k0, one at least, and (m - k)/w^2 degrees of freedom (`fitting.lines.choice`,
as of `fmu-fit line`). The model is refused where
the other form leaves a fifth of its residuals (rms): errors that are widened for correlated
residuals hold the truth only where these are small against the line.

A pair of lines is enough where it leaves noise: errors of one line for two that overlap, or of two
whose heights are held in phase, are no smaller than what they leave out, however wide. There P is
multiplied by the number of points (Bonferroni: noise at each may look like a line), and has to hold
against every form of one line, also one that bends with its amplitude or is behind a cable. This
holds where the noise is stated as well.

Of complex values the forms are one to three lines on the background of the fit or on the next one:
the simplest one that refutes the model and is not refuted by another one. Of a free decay it is one
line more than the model has states for. What the simulation may be off by counts as left by every
form.

Source: N. Draper and H. Smith, Applied Regression Analysis (extra sum of squares).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Literal

import numpy as np
from scipy.special import gammaincc

from fitting.fit.covariance import RowCovariance
from fitting.fit.fit import Solution, Status
from fitting.fit.optimum import Optimum
from fitting.inference.likelihood.knowledge import Adequacy, Ending, Rival
from fitting.inference.likelihood.profile import data_covariance
from fitting.inference.sweeps import MOST_SAMPLES, TRIED, LineFits, decaying_lines
from fitting.lines.choice import BY_CHANCE, FAR_MORE, chance, gain_p
from fitting.lines.form import LineFit
from fitting.lines.names import ADDED, OFFSET, SLOPE, TAIL, UNKNOWNS
from fitting.lines.several import NOISE_P, fit_lines, not_by_chance, shows_all
from fitting.lines.sweep import single_line_fits
from fitting.measurements.complex_sweep import BACKGROUNDS, ComplexSweep
from fitting.measurements.dataset import Dataset, own_scale
from fitting.measurements.sweep import Sweep
from fitting.measurements.time_record import Traces
from fitting.measurements.traces import UNKNOWN, Trace
from fitting.signal.misfit import (
    SURELY,
    Correlation,
    Misfit,
    correlated_below,
    correlation,
    misfit_of,
    of_one_size,
)
from fitting.signal.misfit import chance as chance_without_response
from fitting.signal.residual_tests import SMALLEST_RESIDUAL, STRUCTURED, Structure, innovations
from fitting.signal.student import tail
from fitting.text.arrays import BoolArray, ComplexArray, FloatArray, IntArray

#: Parts of a curve whose residuals are compared in size where their noise is not stated.
PARTS = 4
#: Chi square by stated noise below which residuals of a curve test nothing, however correlated: no
#: move of parameters gains more, and within one standard error (Dchi^2 = 1) all fit alike.
RESOLVED = 1.0
#: Share of the rows of a measurement that a fit may take away where they are tested for structure.
MOST_TAKEN = 0.25


def adequacy_of(
    optimum: Optimum,
    structure: Structure | None = None,
    closer: Adequacy | None = None,
    scale_off: float = math.nan,
) -> Adequacy:
    """Chi square of the rows of known noise at the most likely point, and the rule's decision.

    Args:
        optimum: the most likely point and its likelihood.
        structure: of the residuals of curves, by which their noise was widened: that excuses no
            model, the noise is known.
        closer: the model against lines of another form that leave far less.
        scale_off: factor by which the scale of peaks may be off, where that is beyond their noise:
            errors about one point are not enough for it; else NaN.
    """
    likelihood, m = optimum.likelihood, optimum.likelihood.data_rows
    data, noise = likelihood.objective.data, likelihood.noise
    rows = likelihood.residuals(optimum.expansion.sample.rows[:m])
    matrix = likelihood.residuals(optimum.expansion.matrix[:m])
    covariance = data_covariance(optimum, stated=True)
    slopes = noise.whitened(matrix)
    taken = np.sum((slopes @ covariance) * slopes, axis=1)

    def stated(wider: RowCovariance) -> RowCovariance:
        """The noise as it is stated, not as it was widened."""
        sigma = wider.sigma.copy()
        sigma[data.curve_rows] /= 1.0 if structure is None else structure.widening
        return replace(wider, sigma=sigma)

    def judgement(wider: RowCovariance, kept: BoolArray, least_p: float = math.nan) -> Adequacy:
        """Of some rows: unknowns solved inside count for measurements with rows among them."""
        pairs = zip(data.measurements, data.slices, strict=True)
        return chi_square_test(
            stated(wider).restricted(kept).whitened(rows[kept]),
            wider.restricted(kept).whitened(matrix[kept]),
            covariance,
            sum(m.solved_inside + own_scale(m) for m, at in pairs if np.any(kept[at])),
            data.noise_freedom,
            correlated_p=least_p,
        )

    known = data.sigma > 0.0
    every = judgement(noise, known)
    below = correlated_below(every.chi_square, every.freedom, every.p_value)
    correlated, least_p, along = _along_curves(optimum, rows, stated(noise), taken, below)
    rest = judgement(noise, known & ~correlated, least_p)
    describes = rest.describes
    if not describes and likelihood.bounded.columns:
        loosened = noise.loosened(likelihood.bounded)
        describes = judgement(loosened, known & ~correlated, least_p).describes
    result = replace(
        every,
        describes=describes and along.describes,
        noise_factor=rest.noise_factor if describes else 1.0,
        is_uneven=rest.is_uneven and not describes,
        correlated_p=along.correlated_p,
        share=along.share,
        curve=along.curve,
    )
    if closer is not None and (result.describes or result.is_correlated):
        return closer  # it names what the correlated residuals are
    if result.describes and scale_off > 1.0:
        return replace(result, describes=False, scale_off=scale_off)
    return result


def _along_curves(
    optimum: Optimum,
    rows: FloatArray,
    stated: RowCovariance,
    taken: FloatArray,
    below: float,
) -> tuple[BoolArray, float, Adequacy]:
    """Which rows (m,) are on curves with correlated residuals; least p of others; worst curve.

    The curve that is correlated worst is a record without chi square. Probabilities are of that
    many curves, NaN without any.

    Args:
        optimum: the most likely point and its likelihood.
        rows: residuals there, shape (m,).
        stated: their noise.
        taken: share of each that the fit takes away, shape (m,): where that is much, residuals of
            a right model are correlated.
        below: probability by white noise below which they are correlated.
    """
    data, bounded = optimum.likelihood.objective.data, optimum.likelihood.bounded
    off = bounded.largest if bounded.own.size else np.zeros(rows.size)
    # residuals of a curve in the order of its axis, or of all curves of a measurement in turn: its
    # name, numbers of the rows (n,), residuals over their noise, share of the largest amplitude
    curves: list[tuple[str, IntArray, FloatArray, FloatArray]] = []
    for m, at in zip(data.measurements, data.slices, strict=True):
        if m.solved_inside + np.sum(taken[at]) >= MOST_TAKEN * m.rows:
            continue
        each = []
        for curve in m.residual_curves(rows[at]):
            mine = np.asarray(at.start + curve.rows)
            name = "/".join(filter(None, (m.series, curve.name)))
            # what rows share, as the error of a scale, is no structure
            white = stated.restricted(mine).whitened(rows[mine] - curve.centre)
            each.append((name, mine, white, curve.share))
        curves += each
        # what every sweep of a map has too weakly to be seen alone; peaks have no common axis
        if len(each) > 1 and m.is_curve:
            _, rows_of, whites, shares = zip(*each, strict=True)
            joined = np.concatenate(rows_of), np.concatenate(whites), np.concatenate(shares)
            curves.append((m.series, *joined))
    correlated = np.zeros(rows.size, dtype=bool)
    worst, name, highest, others = Correlation(), "", -1.0, [1.0]
    for curve_name, mine, white, share in curves:
        known = bool(np.all(data.sigma[mine] > 0.0))
        left = white * stated.sigma[mine]
        test = Correlation()
        if not known or float(white @ white) >= RESOLVED:
            test = correlation(white, left * share, equal=known or _is_equal(left))
        excused = float(np.sqrt(np.mean((off[mine] * share) ** 2)))
        test = replace(
            test,
            p_value=min(1.0, test.p_value * len(curves)),
            excused=max(test.excused, excused),
            below=below,
        )
        if test.misfit is not Misfit.NONE:
            correlated[mine] = True
        else:
            others.append(test.p_value)
        rank = 1.0 - test.p_value if test.misfit.describes else 2.0 + test.share
        if rank > highest:
            worst, name, highest = test, curve_name, rank
    summary = Adequacy(
        chi_square=math.nan,
        freedom=0.0,
        p_value=math.nan,
        describes=worst.misfit.describes,
        correlated_p=worst.p_value if curves else math.nan,
        share=worst.share if curves else math.nan,
        curve=name,
    )
    return correlated, min(others) if curves else math.nan, summary


def _is_equal(left: FloatArray) -> bool:
    """Whether residuals of unknown noise are of one size, as far as they are no pattern."""
    _, news = innovations(left)
    ranks = np.argsort(np.argsort(np.abs(news))) + 1.0
    parts = np.array_split(ranks, PARTS)
    if min(part.size for part in parts) < 2 or not np.any(news):
        return True
    # Kruskal and Wallis, J. Am. Stat. Assoc. 47 (1952) 583: chi square of PARTS - 1
    mean, size = 0.5 * (ranks.size + 1.0), ranks.size * (ranks.size + 1.0)
    square = 12.0 / size * sum(part.size * (float(np.mean(part)) - mean) ** 2 for part in parts)
    return bool(gammaincc(0.5 * (PARTS - 1), 0.5 * square) >= STRUCTURED)


def chi_square_test(
    white: FloatArray,
    slopes: FloatArray,
    covariance: FloatArray,
    solved: int = 0,
    noise_freedom: float = np.inf,
    *,
    correlated_p: float = math.nan,
) -> Adequacy:
    """Whether residuals are what their noise explains.

    Args:
        white: residuals of known noise, of unit variance by it, shape (m,).
        slopes: their derivatives in x, by the noise that `covariance` is of, shape (m, n).
        covariance: of x, shape (n, n), from all data.
        solved: number of unknowns that the rows are solved for inside.
        noise_freedom: degrees of freedom of the noise where it is estimated, else infinite.
        correlated_p: probability that white noise is as correlated; NaN: there is no axis.
    """
    square = float(white @ white) if white.size else math.nan
    freedom = float(white.size - solved - np.sum((slopes @ covariance) * slopes))
    if not white.size or freedom < 0.5:  # as many unknowns as rows: nothing is tested
        return Adequacy(chi_square=square, freedom=0.0, p_value=np.nan, describes=True)
    p_value = tail(square, freedom, noise_freedom)
    misfit = misfit_of(square, freedom, p_value, correlated_p)
    uneven = misfit is Misfit.UNDERESTIMATED and not of_one_size(white)
    misfit = Misfit.REFUSED if uneven else misfit
    return Adequacy(
        chi_square=square,
        freedom=freedom,
        p_value=p_value,
        describes=misfit.describes,
        is_uneven=uneven,
        noise_factor=math.sqrt(square / freedom) if misfit is Misfit.UNDERESTIMATED else 1.0,
    )


def is_redundant(optimum: Optimum) -> bool:
    """Whether there are more data than unknowns: else every model fits, and none is tested.

    A Gaussian prior of a parameter counts as one more datum.

    Args:
        optimum: the most likely point and its likelihood.
    """
    likelihood = optimum.likelihood
    priors = np.count_nonzero(likelihood.inverse_prior_sigma)
    rows = likelihood.data_rows - likelihood.objective.data.solved_inside
    return bool(rows + priors > len(likelihood.parameters))


def unseen(solution: Solution) -> Adequacy | None:
    """That nothing of the response exceeds the noise of the curves; None where it does.

    Peaks of tones are a response: where any are fitted nothing is tested.

    Args:
        solution: the end of a fit.
    """
    data, residuals = solution.objective.data, solution.final.residuals
    flat = [m.rows_without_response for m in data.measurements if m.rows]
    if not flat or not all(rows.size for rows in flat):
        return None
    free = sum(p.prior_sigma is None for p in solution.parameters)
    unknowns = free + data.solved_inside
    if chance_without_response(np.concatenate(flat), residuals, data.sigma, unknowns) <= SURELY:
        return None
    return Adequacy(
        chi_square=math.nan,
        freedom=0.0,
        p_value=math.nan,
        describes=False,
        no_line=True,
        series=tuple(dict.fromkeys(m.series for m in data.measurements if m.rows and m.series)),
    )


def ending_of(
    status: Status,
    adequacy: Adequacy | None,
    *,
    inflation: float,
    structure: Structure | None,
    data: Dataset,
    residuals: FloatArray | None = None,
) -> Ending:
    """How a fit ended.

    Args:
        status: of the fit itself, or that its model does not describe the data.
        adequacy: chi square of the rows of known noise, None where it was not tested.
        inflation: of all errors, for residuals beyond the noise.
        structure: of the residuals of curves, None without any.
        data: all measurements.
        residuals: rows of all of them, (m,); None: they are not compared with the curves.
    """
    if status not in (Status.CONVERGED, Status.MISFIT):
        return Ending(kind="not_converged")
    kind: str = "described"
    if status is Status.MISFIT:
        kind = "no_line" if adequacy is not None and adequacy.no_line else "not_described"
    estimated = any(math.isfinite(m.noise_freedom) for m in data.measurements)
    fitted, shares = 0, list[float]()
    for m, rows in zip(data.measurements, data.slices, strict=True):
        fitted += m.rows > 0
        if residuals is not None and m.is_curve and m.rows:
            share = m.share_left(residuals[rows])
            shares += [share] if math.isfinite(share) else []
    return Ending(
        kind=kind,  # type: ignore[arg-type]
        adequacy=adequacy,
        inflation=inflation,
        structure=structure,
        noise="estimated" if estimated else "stated",
        share=max(shares, default=math.nan),
        is_part=len(shares) < fitted,
    )


# --- closer form ----------------------------------------------------------------------------------

#: Rows for each unknown of complex lines, at least, and most lines; and what so many are.
ROWS, MOST_LINES = 3, 3
SHAPES: tuple[Literal["line", "pair", "three_lines"], ...] = ("line", "pair", "three_lines")


def closer_form(solution: Solution, fits: LineFits) -> Adequacy | None:
    """The rival that describes a measurement best compared with the model; None if none refutes it.

    Args:
        solution: the end of a fit.
        fits: of lines, to be shared.
    """
    if solution.structure is None or solution.structure.order == 0:  # it leaves noise
        return None
    refuted: list[Adequacy | None] = []
    data, residuals = solution.objective.data, solution.final.residuals
    names = (p.name for p in solution.parameters)
    at = dict(zip(names, solution.final.parameters.tolist(), strict=True))
    promised = np.zeros(len(data.measurements))
    promised[: len(solution.final.promised)] = solution.final.promised

    def moving(rows: slice) -> int:
        """Parameters that the rows depend on."""
        return int(np.count_nonzero(np.any(solution.matrix[rows] != 0.0, axis=0)))

    for m, rows, error in zip(data.measurements, data.slices, promised, strict=True):
        # residuals that rounding, or what the simulation may be off by, makes; over the largest
        model = Model(residuals[rows], moving(rows), max(SMALLEST_RESIDUAL, float(error)))
        begin = rows.start
        if isinstance(m, Sweep) and m.fitted:
            sweep = m.frequency_hz, m.amplitude_v
            if not np.any(m.sigma > 0.0):
                one = replace(model, unknowns=UNKNOWNS[m.added])
                refuted.append(compared(*sweep, one, fits))
            if np.ptp(m.sigma) == 0.0:
                two = replace(model, unknowns=1 + m.solved_inside + model.unknowns)
                refuted.append(compared_pair(*sweep, two))
        elif isinstance(m, ComplexSweep):
            for curve in m.records:
                mine = slice(begin, begin + 2 * curve.y.size)
                begin, columns = mine.stop, curve.wiring.columns
                one = replace(
                    model,
                    residuals=residuals[mine],
                    unknowns=2 * columns + moving(mine),
                    noise_is_known=curve.sigma > 0.0,
                )
                measured = curve.u_hz, m.without_delay(curve, at)
                refuted.append(
                    compared_complex(*measured, one, columns, label=curve.label, table=m.table)
                )
        elif isinstance(m, Traces):
            for trace in m.traces:
                mine = slice(begin, begin + trace.rows)
                begin = mine.stop
                if not isinstance(trace, Trace) or trace.sigma > 0.0:
                    continue
                if trace.start == UNKNOWN and not trace.is_driven:
                    unknowns = trace.solved_inside + model.unknowns
                    one = replace(model, residuals=residuals[mine], unknowns=unknowns)
                    refuted.append(compared_decay(trace, one))
    worse = [each for each in refuted if each is not None and not each.describes]
    return max(worse, key=lambda each: each.chi_square / each.freedom, default=None)


@dataclass(frozen=True)
class Model:
    """What a fitted model leaves of a measurement.

    Args:
        residuals: over the largest value; of complex values real, then imaginary parts, (m,).
        unknowns: real ones.
        resolved: root mean square of residuals that rounding or the simulation makes.
        noise_is_known: complex values of known noise are compared with a pair of lines alone.
    """

    residuals: FloatArray
    unknowns: int
    resolved: float = SMALLEST_RESIDUAL
    noise_is_known: bool = False

    @property
    def squares(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)


@dataclass(frozen=True, kw_only=True)
class _Form:
    """Lines of another form: the `squares` that they leave of so many `rows`."""

    squares: float
    rows: int
    unknowns: int
    fit: LineFit
    rival: Rival

    def chance(self, squares: float, unknowns: int) -> float:
        """Probability that noise alone makes so much of what another form leaves."""
        return chance(squares, unknowns, self.squares, self.unknowns, self.fit.structure, self.rows)

    def refutes(self, squares: float, unknowns: int) -> bool:
        """Whether it leaves so much less that the other form does not describe the data."""
        return squares > FAR_MORE * self.squares and self.chance(squares, unknowns) < BY_CHANCE

    def against(self, model: Model) -> Adequacy:
        """The model compared with this form."""
        dof = self.rows - self.unknowns
        return Adequacy(
            chi_square=model.squares * dof / self.squares,
            freedom=float(dof),
            p_value=self.chance(model.squares, model.unknowns),
            describes=not self.refutes(model.squares, model.unknowns),
            rival=self.rival,
        )

    def refusal_by_pair(
        self, f: FloatArray, values: FloatArray | ComplexArray, model: Model, curve: ComplexArray
    ) -> Adequacy | None:
        """The model refused by a pair that leaves noise, as it and one line do not; else None.

        Where one line leaves more of the model's own curve than the pair does of the data, the
        model has two lines itself, with other phases.
        """
        pair = self.fit
        if not (shows_all(f, pair) and pair.structure.p_value > NOISE_P):
            return None
        if not self.rows * self.chance(model.squares, model.unknowns) < BY_CHANCE:
            return None
        singles = single_line_fits(f, values)
        if not (singles and not_by_chance(values, singles, pair)):
            return None
        own = curve if np.iscomplexobj(values) else np.abs(curve)
        one_line = min((fit.squares for fit in single_line_fits(f, own)), default=0.0)
        coupled = one_line * float(np.max(np.abs(own))) ** 2 > self.squares
        rival = replace(self.rival, remedy="coupling") if coupled else self.rival
        return replace(self.against(model), describes=False, rival=rival)


# --- amplitudes -----------------------------------------------------------------------------------


def compared(
    frequency_hz: FloatArray, amplitude: FloatArray, model: Model, fits: LineFits
) -> Adequacy | None:
    """A model of amplitudes against one line with more in addition; None without any.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        amplitude: peak, shape (n,), any unit.
        model: its unknowns are those of a line with what is solved for besides.
        fits: of lines, to be shared.
    """
    rows, largest = model.residuals.size, float(np.max(amplitude))
    if rows <= max(UNKNOWNS[name] for name in TRIED):
        return None
    forms = {
        name: _Form(
            squares=max(
                float(np.sum(((form.curve - amplitude) / largest) ** 2)),
                rows * model.resolved**2,
            ),
            rows=rows,
            unknowns=UNKNOWNS[name],
            fit=form,
            rival=Rival(
                shape="line",
                background=name,
                remedy="background" if name in ADDED else "",
                key=f'[sweep] background = "{name}"' if name in ADDED else "",
            ),
        )
        for name, form in fits.with_backgrounds(frequency_hz, amplitude).items()
        if UNKNOWNS[name] > model.unknowns
    }
    slope = forms.pop(SLOPE, None)
    best = min(forms.values(), key=lambda form: form.squares, default=slope)
    if best is None:
        return None
    # every constant is a slope, too, and leaves more by what noise gains by that
    if slope is not None and slope.chance(best.squares, UNKNOWNS[OFFSET]) < BY_CHANCE:
        best = slope
    return best.against(model)


def compared_pair(frequency_hz: FloatArray, amplitude: FloatArray, model: Model) -> Adequacy | None:
    """A model of amplitudes that fails against two lines; None where it does not.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        amplitude: peak, shape (n,), any unit.
        model: its scale is one of its unknowns.
    """
    two = fit_lines(frequency_hz, amplitude, 2)
    if two is None:
        return None
    rows, rival = model.residuals.size, Rival(shape="pair", remedy="output")
    squares = max(two.squares, rows * model.resolved**2)
    curve = amplitude / float(np.max(amplitude)) + model.residuals
    form = _Form(squares=squares, rows=rows, unknowns=two.unknowns, fit=two, rival=rival)
    return form.refusal_by_pair(frequency_hz, amplitude, model, np.asarray(curve, dtype=complex))


# --- complex values -------------------------------------------------------------------------------


def compared_complex(
    frequency_hz: FloatArray,
    values: ComplexArray,
    model: Model,
    columns: int = 1,
    *,
    label: str = "",
    table: str = "[[complex_sweep]]",
) -> Adequacy | None:
    """A model of complex values against other lines and backgrounds; None without any.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: measured, the delay of a cable taken off, shape (n,), any unit.
        model: what it leaves, real, then imaginary parts.
        columns: complex ones that the fit solves for inside the sweep.
        label: the sweep's.
        table: of the campaign, with the sweep's keys.
    """
    y = np.asarray(values / np.max(np.abs(values)))
    forms: list[_Form] = []
    # all lines side by side that the points can distinguish, the simplest ones first. One of two
    # may lie beyond the points. Of three none may: over a wide sweep the third pole is the mirror
    # image of modes at negative frequencies, of which a good model leaves as little
    counts = range(columns, min(columns + 1, len(BACKGROUNDS)) + 1)
    sizes = itertools.product(range(1, MOST_LINES + 1), counts)
    low, high = frequency_hz[0], frequency_hz[-1]
    for lines, count in sorted(sizes, key=lambda each: 2 * each[0] + each[1]):
        is_fitted = (2 * lines + count - 1) * ROWS <= y.size
        fit = fit_lines(frequency_hz, y, lines, count - 1) if is_fitted else None
        if fit is None:
            continue
        has_more = count > columns
        remedy = "output" if lines > 1 else "background" if has_more else ""
        rival = Rival(
            shape=SHAPES[lines - 1],
            background=("", "complex", "complex slope")[count - 1] if has_more else "",
            label=label,
            remedy=remedy,  # type: ignore[arg-type]
        )
        if remedy == "background":
            key = f'{table} background = "{BACKGROUNDS[count - 1]}"'
            rival = replace(rival, key=key)
        if not shows_all(frequency_hz, fit):
            if lines != 2 or low < fit.others[0].frequency.value < high:
                continue
            rival = replace(rival, shape="line", background=TAIL)
        squares = max(fit.squares, 2 * y.size * model.resolved**2)
        rows, unknowns = 2 * y.size, fit.unknowns
        forms.append(_Form(squares=squares, rows=rows, unknowns=unknowns, fit=fit, rival=rival))
    if not forms:
        return None

    refuting = [form for form in forms if form.refutes(model.squares, model.unknowns)]
    if not refuting or model.noise_is_known:
        real, imaginary = np.split(model.residuals, 2)
        curve = np.asarray(y + real + 1j * imaginary, dtype=complex)
        for form in forms:
            refusal = None
            if len(form.fit.others) == 1:
                refusal = form.refusal_by_pair(frequency_hz, y, model, curve)
            if refusal is not None:
                return refusal
        if model.noise_is_known:
            return None
    if not refuting:
        return min(forms, key=attrgetter("squares")).against(model)
    simplest, *others = refuting
    for form in others:
        if form.refutes(simplest.squares, simplest.unknowns):
            simplest = form
    return simplest.against(model)


# --- free decays ----------------------------------------------------------------------------------


def compared_decay(trace: Trace, model: Model) -> Adequacy | None:
    """A model of a free decay that fails against one line more; None where that is no better.

    Args:
        trace: the free decay, of unknown noise.
        model: what it leaves of all samples.
    """
    count, rows = trace.states // 2 + 1, min(trace.y.size, MOST_SAMPLES)
    if rows < 4 * (4 * count + 1):
        return None
    left = model.residuals[:MOST_SAMPLES]
    squares = float(left @ left)
    try:
        fit, frequencies_hz, structure = decaying_lines(trace, count)
    except ValueError:
        return None
    if not fit.squares < squares:
        return None
    freedom, more = rows - fit.unknowns, max(1, fit.unknowns - model.unknowns)
    by_chance = gain_p(squares, fit.squares, more, freedom)
    if structure.p_value <= NOISE_P or by_chance > BY_CHANCE / rows:
        return None
    return Adequacy(
        chi_square=squares * freedom / fit.squares,
        freedom=float(freedom),
        p_value=by_chance,
        describes=False,
        rival=Rival(shape="decays", frequencies_hz=frequencies_hz, remedy="states"),
    )
