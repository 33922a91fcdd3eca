"""A fitted sweep that another form of line describes, where the model does not.

Where the residuals of a sweep tell its noise, chi square cannot show that the model fails: bad
residuals count as much noise. Another form of k unknowns through the same m rows can: what it
leaves, S1, bounds the noise,

    chi^2 = S (m - k)/S1        P = P(F > ((S - S1)/(k - k0)) ((m - k)/w^2)/S1)

with S of the fitted model, k0 its unknowns, and w the widening for what hangs together in the
residuals of that form; F has k - k0, one at least, and (m - k)/w^2 degrees of freedom. Errors that
are widened for residuals that are correlated hold the truth where these are small beside the line;
where another form leaves a fifth of them (rms) they are no small ones. A model of several lines
leaves less than a form of fewer, and nothing is said of it. What the simulation may be off by
counts as left by every form.

A pair of lines needs leave no fifth where what it leaves is noise: errors of one line for two
that overlap, or of two whose heights are held in phase though they are not, are no
smaller than what they leave out, however wide. There P is multiplied by the number of points
(Bonferroni: at each noise may look like a line), and holds against every form of one line, too,
also one that bends with its amplitude, or stands behind a cable.
This holds where the noise is stated as well: it is what the pair leaves, if it has one size.

Of amplitudes the forms are one line with something beside it, and a pair (`fitting.signal.pair`),
of complex values one to three lines
beside what the fit solves for, or beside more (`fitting.signal.lines_together`): the simplest one
that the model fails against, and that does not fail so against another one.

Source: N. Draper and H. Smith, Applied Regression Analysis (extra sum of squares).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.special import fdtrc

from fitting.fit.solution import Solution
from fitting.inference.closer_decay import closer_decays
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.measurements.complex.sweep import ComplexSweep
from fitting.measurements.complex.wiring import BACKGROUNDS
from fitting.measurements.sweep import Sweep
from fitting.signal.complex_line import complex_line
from fitting.signal.lines_together import LinesTogether, lines_together
from fitting.signal.pair import NO_NOISE, bent_line, pair_of
from fitting.signal.peaks import (
    ADDED,
    BESIDE_WORDS,
    FLOOR,
    OFFSET,
    RICE,
    SLOPE,
    TAIL,
    UNKNOWNS,
    Resonance,
    fit_resonance,
)
from fitting.signal.residual_tests import SMALLEST_RESIDUAL, Structure, residual_structure
from fitting.text.arrays import ComplexArray, FloatArray, both_parts
from fitting.text.errors import BadInput

#: The forms that are tried.
TRIED = ("complex", OFFSET, SLOPE, FLOOR, RICE)
#: Mean squares over those of the other form, and probability, from which the model is given up.
RATIO, IMPROBABLE = 25.0, 1e-4
#: Lines side by side that are tried, in words, and rows for each unknown, at least.
LINES, ROWS = {2: "a pair of lines", 3: "three lines"}, 3
#: What would describe these, of a model that shows fewer, and of one that shows as many.
ALL_LINES = "an output that shows all lines of the sweep"
OF_ANY_PHASE = " with any heights and phases"
COUPLED = "a coupling, a drive or a readout fitted that turns its lines against each other"


def closer_form(solution: Solution) -> Adequacy | None:
    """How much more the model leaves of a sweep than a line of another form; None if it is fair.

    Of several sweeps the one that is described worst.

    Args:
        solution: the end of a fit.
    """
    if solution.structure is None or solution.structure.order == 0:  # it leaves noise
        return None
    tried = [*_amplitudes(solution), *_complex_values(solution), *closer_decays(solution)]
    worse = [each for each in tried if each is not None and not each.describes]
    return max(worse, key=lambda each: each.chi_square / each.freedom, default=None)


def _amplitudes(solution: Solution) -> Iterator[Adequacy | None]:
    """Every sweep of amplitudes whose residuals tell its noise."""
    data = solution.objective.data
    for k, (sweep, mine) in enumerate(zip(data.measurements, data.slices, strict=True)):
        if not (isinstance(sweep, Sweep) and sweep.fitted):
            continue
        seen = sweep.frequency_hz, sweep.amplitude_v, solution.final.residuals[mine]
        resolved = _resolved(solution, k)
        if not np.any(sweep.sigma > 0.0):
            yield compared(*seen, beside=sweep.added, resolved=resolved)
        if np.ptp(sweep.sigma) == 0.0:
            moving = np.count_nonzero(np.any(solution.matrix[mine] != 0.0, axis=0))
            unknowns = 1 + sweep.solved_inside + int(moving)
            yield compared_pair(*seen, unknowns=unknowns, resolved=resolved)


def _complex_values(solution: Solution) -> Iterator[Adequacy | None]:
    """Every complex sweep whose residuals tell its noise."""
    data = solution.objective.data
    names = [p.name for p in solution.parameters]
    at = dict(zip(names, map(float, solution.final.parameters), strict=True))
    for k, (sweeps, place) in enumerate(zip(data.measurements, data.slices, strict=True)):
        if not isinstance(sweeps, ComplexSweep):
            continue
        begin = place.start
        for curve in sweeps.records:
            mine = slice(begin, begin + 2 * curve.y.size)
            begin = mine.stop
            moving = np.count_nonzero(np.any(solution.matrix[mine] != 0.0, axis=0))
            yield compared_complex(
                curve.u_hz,
                sweeps.without_delay(curve, at),
                solution.final.residuals[mine],
                Fitted(
                    columns=curve.wiring.columns,
                    moving=int(moving),
                    label=curve.label,
                    table="[complex_control_sweep]" if sweeps.units else Fitted.table,
                    resolved=_resolved(solution, k),
                    noise_is_known=curve.sigma > 0.0,
                ),
            )


def _resolved(solution: Solution, measurement: int) -> float:
    """Residuals that rounding, or what the simulation may be off by, makes; over the largest."""
    promised: Mapping[int, float] = dict(enumerate(solution.final.promised))
    return max(SMALLEST_RESIDUAL, promised.get(measurement, 0.0))


def compared(
    frequency_hz: FloatArray,
    amplitude_v: FloatArray,
    residuals: FloatArray,
    *,
    beside: str = "none",
    resolved: float = SMALLEST_RESIDUAL,
) -> Adequacy | None:
    """What a model leaves of a sweep, against the form that leaves least; None without any form.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        amplitude_v: peak, shape (n,), V.
        residuals: of the model, over the largest amplitude, shape (n,).
        beside: what is solved for beside the model, "none", "offset" or "slope": forms with more
            are tried.
        resolved: residuals that say nothing, over the largest amplitude, root mean square.
    """
    largest = float(np.max(amplitude_v))
    found = [
        (float(np.sum(((form.curve - amplitude_v) / largest) ** 2)), name, form)
        for name, form in _forms(frequency_hz, amplitude_v)
        if UNKNOWNS[name] > UNKNOWNS[beside]
    ]
    if not found or residuals.size <= max(UNKNOWNS[name] for name in TRIED):
        return None
    forms = {
        name: _Form(
            squares=max(squares, residuals.size * resolved**2),
            rows=residuals.size,
            unknowns=UNKNOWNS[name],
            tested=partial(lambda each: each.structure, form),
            words=f"a line with {BESIDE_WORDS[name]}",
            remedy=f'[sweep] background = "{name}"' if name in ADDED else "",
        )
        for squares, name, form in found
    }
    slope = forms.pop(SLOPE, None)
    left = min(forms.values(), key=lambda each: each.squares, default=slope)
    if left is None:
        return None
    # every constant is a slope, too, and leaves more by what noise gains by that
    if slope is not None and slope.chance(left.squares, UNKNOWNS[OFFSET]) < IMPROBABLE:
        left = slope
    return _held(residuals, UNKNOWNS[beside], left)


def _forms(frequency_hz: FloatArray, amplitude_v: FloatArray) -> Iterator[tuple[str, Resonance]]:
    """Every form that can be fitted to the sweep by itself."""
    for name in TRIED:
        with contextlib.suppress(BadInput):
            yield name, fit_resonance(frequency_hz, amplitude_v, background=name)


def compared_pair(
    frequency_hz: FloatArray,
    amplitude_v: FloatArray,
    residuals: FloatArray,
    *,
    unknowns: int,
    resolved: float = SMALLEST_RESIDUAL,
) -> Adequacy | None:
    """What a model leaves of amplitudes, where it fails against two lines; None where it does not.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        amplitude_v: peak, shape (n,), V.
        residuals: of the model, over the largest amplitude, shape (n,).
        unknowns: of the model, its scale one of them.
        resolved: residuals that say nothing, over the largest amplitude, root mean square.
    """
    pair = pair_of(frequency_hz, amplitude_v)
    if pair is None or not (pair.is_noise and pair.is_seen(frequency_hz)):
        return None
    largest, rows = float(np.max(amplitude_v)), residuals.size
    form = _Form(
        squares=max(pair.squares, rows * resolved**2),
        rows=rows,
        unknowns=pair.unknowns,
        lines=2,
        tested=lambda: pair.structure,
        words=LINES[2],
        remedy=ALL_LINES,
    )
    fewer = _left_of(frequency_hz, amplitude_v / largest)
    if not form.tells_more(residuals, unknowns, fewer):
        return None
    if not form.tells_more(residuals, unknowns, [bent_line(frequency_hz, amplitude_v)]):
        return None
    curve = np.abs(amplitude_v / largest + residuals)
    one = min((left for left, _ in _left_of(frequency_hz, curve)), default=0.0)
    return _given_up(residuals, unknowns, form, two=one > form.squares)


def _left_of(frequency_hz: FloatArray, amplitude: FloatArray) -> list[tuple[float, int]]:
    """Squares that forms of one line leave of amplitudes over their largest, and their unknowns."""
    return [
        (float(np.sum((each.curve - amplitude) ** 2)), UNKNOWNS[name])
        for name, each in _forms(frequency_hz, amplitude)
    ]


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """What a fit did for a complex sweep: complex `columns` solved inside, parameters `moving` it.

    `label` is the sweep's, `table` that of the campaign that tells of it; residuals below
    `resolved`, over the largest value, say nothing. Where `noise_is_known` only more lines are held
    against the model.
    """

    columns: int = 1
    moving: int = 2
    label: str = ""
    table: str = "[[complex_sweep]]"
    resolved: float = SMALLEST_RESIDUAL
    noise_is_known: bool = False

    @property
    def unknowns(self) -> int:
        """Real unknowns of the fit."""
        return 2 * self.columns + self.moving


def compared_complex(
    frequency_hz: FloatArray, values: ComplexArray, residuals: FloatArray, fitted: Fitted
) -> Adequacy | None:
    """What a model leaves of complex values, against other lines; None without any.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: measured, the delay of a cable taken off, shape (n,), any unit.
        residuals: of the model over the largest modulus, real, then imaginary parts, (2 n,).
        fitted: what was solved for beside the model.
    """
    forms = _lines(frequency_hz, values, fitted)
    if not forms:
        return None
    squares, unknowns = float(residuals @ residuals), fitted.unknowns
    closer = [form for form in forms if form.refutes(squares, unknowns)]
    if not closer or fitted.noise_is_known:
        for form in forms:
            fewer = [(each.squares, each.unknowns) for each in forms if each.lines < form.lines]
            if not form.tells_more(residuals, unknowns, fewer):
                continue
            single = [_behind_a_cable(frequency_hz, values), bent_line(frequency_hz, values)]
            if form.tells_more(residuals, unknowns, single):
                curve = values / np.max(np.abs(values)) + _complex(residuals)
                one = lines_together(frequency_hz, curve, 1, 3).squares(curve)
                return _given_up(residuals, unknowns, form, two=one > form.squares)
        if fitted.noise_is_known:
            return None
    if not closer:
        return _held(residuals, unknowns, min(forms, key=lambda form: form.squares))
    chosen, *others = closer
    for form in others:
        if form.refutes(chosen.squares, chosen.unknowns):
            chosen = form
    return _held(residuals, unknowns, chosen)


def _behind_a_cable(frequency_hz: FloatArray, values: ComplexArray) -> tuple[float, int]:
    """Squares that one line behind a delay leaves over the largest value, and its unknowns."""
    line = complex_line(frequency_hz, values, None)
    return line.left**2 * values.size, 7


def _complex(parts: FloatArray) -> ComplexArray:
    """Complex values of real, then imaginary parts, (n,)."""
    real, imaginary = np.split(parts, 2)
    return np.asarray(real + 1j * imaginary)


@dataclass(frozen=True, kw_only=True)
class _Form:
    """A form of line: the `squares` that it leaves over the largest value, of so many `rows`."""

    squares: float
    rows: int
    unknowns: int
    lines: int = 1
    seen: bool = True
    tested: Callable[[], Structure]
    words: str
    remedy: str

    @cached_property
    def widening(self) -> float:
        """Of errors, for what hangs together in its residuals."""
        return self.tested().widening

    @property
    def freedom(self) -> int:
        """Rows less unknowns."""
        return self.rows - self.unknowns

    def chance(self, squares: float, unknowns: int) -> float:
        """Probability that noise alone makes so much of what another form leaves.

        Args:
            squares: that the other one leaves.
            unknowns: real ones of the other one.
        """
        more = max(1, self.unknowns - unknowns)
        freedom = self.freedom / self.widening**2
        gain = max(0.0, (squares - self.squares) / more * freedom / self.squares)
        return float(fdtrc(more, freedom, gain))

    def refutes(self, squares: float, unknowns: int) -> bool:
        """Whether it leaves so much less that the other one does not describe the sweep.

        Args:
            squares: that the other one leaves.
            unknowns: real ones of the other one.
        """
        return squares > RATIO * self.squares and self.chance(squares, unknowns) < IMPROBABLE

    def tells_more(
        self, residuals: FloatArray, unknowns: int, fewer: Sequence[tuple[float, int]]
    ) -> bool:
        """Whether it is a pair that leaves noise, as neither a model nor fewer lines do.

        Args:
            residuals: of the model, shape (rows,).
            unknowns: real ones of the model.
            fewer: squares and unknowns of the forms of fewer lines.
        """
        if not self.seen or self.lines != 2 or not self.squares < float(residuals @ residuals):
            return False
        others = [(float(residuals @ residuals), unknowns), *fewer]
        if self.tested().p_value <= NO_NOISE or not fewer:
            return False
        least = IMPROBABLE / residuals.size
        return all(self.chance(squares, known) < least for squares, known in others)


def _lines(frequency_hz: FloatArray, values: ComplexArray, fitted: Fitted) -> list[_Form]:
    """All lines side by side that the points can tell, the simplest ones first."""
    found = []
    y = np.asarray(values / np.max(np.abs(values)))
    wanted = [
        (lines, columns)
        for lines in (1, *LINES)
        for columns in range(fitted.columns, len(BACKGROUNDS) + 1)
    ]
    for lines, columns in sorted(wanted, key=lambda each: 2 * each[0] + each[1]):
        above = lines + columns - 1
        if (lines + above) * ROWS > y.size:
            continue
        form = lines_together(frequency_hz, y, lines, above)
        words = _words(form, frequency_hz, columns - fitted.columns)
        if not words:
            continue
        more = columns > fitted.columns
        key = f'{fitted.table} background = "{BACKGROUNDS[columns - 1]}"' if more else ""
        shows = ALL_LINES if lines in LINES else ""
        found.append(
            _Form(
                squares=max(form.squares(y), 2 * y.size * fitted.resolved**2),
                rows=2 * y.size,
                unknowns=form.unknowns,
                lines=lines,
                seen=all(mode.is_seen(frequency_hz) for mode in form.modes),
                tested=partial(_structure, form, y),
                words=f"{words} through sweep '{fitted.label}'" if fitted.label else words,
                remedy=shows or key,
            )
        )
    return found


def _structure(form: LinesTogether, values: ComplexArray) -> Structure:
    """What the residuals of a form tell of the noise."""
    return residual_structure(both_parts(form.curve - values), _real_columns(form))


def _words(form: LinesTogether, frequency_hz: FloatArray, more: int) -> str:
    """What a form is; empty where some of its poles are no lines that the points show.

    One of two may stand beyond the points. Of three none may: over a wide sweep the third pole is
    the mirror image of modes at negative frequencies, of which a good model leaves as little.
    """
    seen = [mode for mode in form.modes if mode.is_seen(frequency_hz)]
    tails = [
        mode
        for mode in form.modes
        if not frequency_hz[0] < mode.frequency_hz < frequency_hz[-1] and mode not in seen
    ]
    lines = form.below.size
    if not seen or len({mode.width_hz > 0.0 for mode in seen}) > 1:  # phases run one way
        return ""
    beside = ["", f" with {BESIDE_WORDS['complex']}", f" with {BESIDE_WORDS['complex slope']}"]
    if lines == 1:
        return f"a line{beside[form.above.size - lines]}" if more else "a line of its own"
    if lines == 2 and len(seen) == len(tails) == 1:
        return f"a line with {BESIDE_WORDS[TAIL]}"
    if len(seen) < lines:
        return ""
    return f"{LINES[lines]}{beside[form.above.size - lines] if more else ''}"


def _real_columns(form: LinesTogether) -> FloatArray:
    """Derivatives of both parts by both parts of all coefficients, (2 n, unknowns)."""
    columns = form.columns
    return np.concatenate(
        [np.hstack([columns.real, -columns.imag]), np.hstack([columns.imag, columns.real])]
    )


def _given_up(residuals: FloatArray, unknowns: int, form: _Form, *, two: bool) -> Adequacy:
    """What a model leaves, against more lines, or as many where it has `two` itself."""
    held = _held(residuals, unknowns, form)
    if two and form.lines == 2:
        held = replace(held, remedy=COUPLED, against=f"{held.against}{OF_ANY_PHASE}")
    return replace(held, describes=False)


def _held(residuals: FloatArray, unknowns: int, form: _Form) -> Adequacy:
    """What a model leaves, against a form of line."""
    squares = float(residuals @ residuals)
    return Adequacy(
        chi_square=squares * form.freedom / form.squares,
        freedom=float(form.freedom),
        p_value=form.chance(squares, unknowns),
        describes=not form.refutes(squares, unknowns),
        against=form.words,
        remedy=form.remedy,
    )
