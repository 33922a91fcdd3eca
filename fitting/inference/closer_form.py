"""A fitted sweep or decay that lines of another form describe, where the model does not.

Where residuals estimate the noise, chi square cannot show that the model fails. Another form of k
unknowns through the same m rows can: what it leaves, S1, bounds the noise,

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

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fitting.fit.solution import Solution
from fitting.inference.likelihood.knowledge import Adequacy, Rival
from fitting.inference.line_fits import MOST_SAMPLES, TRIED, DecayingLines, LineFits
from fitting.lines.choice import FAR_MORE, chance, gain_p
from fitting.lines.form import LineFit
from fitting.lines.names import ADDED, OFFSET, SLOPE, TAIL, UNKNOWNS
from fitting.lines.several import BY_CHANCE, NOISE_P, fit_lines, not_by_chance, shows_all
from fitting.lines.sweep import single_line_fits
from fitting.measurements.complex.sweep import ComplexSweep
from fitting.measurements.complex.wiring import BACKGROUNDS
from fitting.measurements.sweep import Sweep
from fitting.measurements.traces.record import UNKNOWN, TraceRecord
from fitting.measurements.traces.traces import Traces
from fitting.signal.residual_tests import SMALLEST_RESIDUAL
from fitting.text.arrays import ComplexArray, FloatArray

#: Rows for each unknown of complex lines, at least, and most lines.
ROWS, MOST_LINES = 3, 3


def closer_form(solution: Solution, fits: LineFits) -> Adequacy | None:
    """The rival that describes a measurement best compared with the model; None if none refutes it.

    Args:
        solution: the end of a fit.
        fits: of lines, to be shared.
    """
    if solution.structure is None or solution.structure.order == 0:  # it leaves noise
        return None
    refuted = []
    data, residuals = solution.objective.data, solution.final.residuals
    at = {
        p.name: float(v)
        for p, v in zip(solution.parameters, solution.final.parameters, strict=True)
    }

    def moving(rows: slice) -> int:
        """Parameters that the rows depend on."""
        return int(np.count_nonzero(np.any(solution.matrix[rows] != 0.0, axis=0)))

    for k, (m, rows) in enumerate(zip(data.measurements, data.slices, strict=True)):
        # residuals that rounding, or what the simulation may be off by, makes; over the largest
        promised = dict(enumerate(solution.final.promised)).get(k, 0.0)
        model = Model(residuals[rows], moving(rows), max(SMALLEST_RESIDUAL, promised))
        if isinstance(m, Sweep) and m.fitted:
            sweep = m.frequency_hz, m.amplitude_v
            if not np.any(m.sigma > 0.0):
                one = replace(model, unknowns=UNKNOWNS[m.added])
                refuted.append(compared(*sweep, one, fits))
            if np.ptp(m.sigma) == 0.0:
                two = replace(model, unknowns=1 + m.solved_inside + model.unknowns)
                refuted.append(compared_pair(*sweep, two))
        elif isinstance(m, ComplexSweep):
            begin = rows.start
            for curve in m.records:
                mine = slice(begin, begin + 2 * curve.y.size)
                begin = mine.stop
                columns = curve.wiring.columns
                one = replace(model, residuals=residuals[mine], unknowns=2 * columns + moving(mine))
                fitted = Fitted(
                    columns=columns,
                    label=curve.label,
                    table="[complex_control_sweep]" if m.units else Fitted.table,
                    noise_is_known=curve.sigma > 0.0,
                )
                values = m.without_delay(curve, at)
                refuted.append(compared_complex(curve.u_hz, values, one, fitted))
        elif isinstance(m, Traces):
            begin = rows.start
            for trace in m.traces:
                mine = slice(begin, begin + trace.y.size)
                begin = mine.stop
                if trace.sigma == 0.0 and trace.start == UNKNOWN and not trace.is_driven:
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
    """

    residuals: FloatArray
    unknowns: int
    resolved: float = SMALLEST_RESIDUAL

    @property
    def squares(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)


@dataclass(frozen=True, kw_only=True)
class _Form:
    """Lines of another form: the `squares` that they leave of so many `rows`."""

    squares: float
    rows: int
    fit: LineFit
    rival: Rival
    unknowns: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "unknowns", self.unknowns or self.fit.unknowns)

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
    form = _Form(squares=squares, rows=rows, fit=two, rival=rival)
    return form.refusal_by_pair(frequency_hz, amplitude, model, np.asarray(curve, dtype=complex))


# --- complex values -------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """What a fit did for a complex sweep: complex `columns` solved inside.

    `label` is the sweep's, `table` that of the campaign with its keys. Where `noise_is_known` only
    a pair is compared with the model.
    """

    columns: int = 1
    label: str = ""
    table: str = "[[complex_sweep]]"
    noise_is_known: bool = False


def compared_complex(
    frequency_hz: FloatArray, values: ComplexArray, model: Model, fitted: Fitted
) -> Adequacy | None:
    """A model of complex values against other lines and backgrounds; None without any.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: measured, the delay of a cable taken off, shape (n,), any unit.
        model: what it leaves, real, then imaginary parts.
        fitted: what was solved for besides the model.
    """
    y = np.asarray(values / np.max(np.abs(values)))
    forms = [*_complex_forms(frequency_hz, y, model, fitted)]
    if not forms:
        return None
    refuting = [form for form in forms if form.refutes(model.squares, model.unknowns)]
    if not refuting or fitted.noise_is_known:
        real, imaginary = np.split(model.residuals, 2)
        curve = np.asarray(y + real + 1j * imaginary, dtype=complex)
        for form in (each for each in forms if len(each.fit.others) == 1):
            refusal = form.refusal_by_pair(frequency_hz, y, model, curve)
            if refusal is not None:
                return refusal
        if fitted.noise_is_known:
            return None
    if not refuting:
        return min(forms, key=lambda form: form.squares).against(model)
    simplest, *others = refuting
    for form in others:
        if form.refutes(simplest.squares, simplest.unknowns):
            simplest = form
    return simplest.against(model)


def _complex_forms(
    frequency_hz: FloatArray, y: ComplexArray, model: Model, fitted: Fitted
) -> Iterator[_Form]:
    """All lines side by side that the points can distinguish, the simplest ones first.

    One of two may lie beyond the points. Of three none may: over a wide sweep the third pole is the
    mirror image of modes at negative frequencies, of which a good model leaves as little.
    """
    sizes = [
        (lines, columns)
        for lines in range(1, MOST_LINES + 1)
        for columns in range(fitted.columns, min(fitted.columns + 1, len(BACKGROUNDS)) + 1)
    ]
    low, high = frequency_hz[0], frequency_hz[-1]
    for lines, columns in sorted(sizes, key=lambda each: 2 * each[0] + each[1]):
        if (2 * lines + columns - 1) * ROWS > y.size:
            continue
        fit = fit_lines(frequency_hz, y, lines, columns - 1)
        if fit is None:
            continue
        background = ("", "complex", "complex slope")[columns - 1]
        background = background if columns > fitted.columns else ""
        shape = ("line", "pair", "three_lines")[lines - 1]
        if not shows_all(frequency_hz, fit):
            if lines != 2 or low < fit.others[0].frequency.value < high:
                continue
            shape, background = "line", TAIL
        key = f'{fitted.table} background = "{BACKGROUNDS[columns - 1]}"'
        more = columns > fitted.columns
        remedy = "output" if lines > 1 else "background" if more else ""
        yield _Form(
            squares=max(fit.squares, 2 * y.size * model.resolved**2),
            rows=2 * y.size,
            fit=fit,
            rival=Rival(
                shape=shape,  # type: ignore[arg-type]
                background=background,
                label=fitted.label,
                remedy=remedy,  # type: ignore[arg-type]
                key=key if remedy == "background" else "",
            ),
        )


# --- free decays ----------------------------------------------------------------------------------


def compared_decay(trace: TraceRecord, model: Model) -> Adequacy | None:
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
        lines = DecayingLines(trace, count)
    except ValueError:
        return None
    fit, structure = lines.fit, lines.structure
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
        rival=Rival(shape="decays", frequencies_hz=lines.frequencies_hz, remedy="states"),
    )
