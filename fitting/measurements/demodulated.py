"""Demodulated trace: a free decay as a lock-in or an analyser at one frequency shows it over time.

    S = D c + o        r = (S - z)/max|z|                  phasors z = X + i Y
    S = rice(|D c|, s) r = (S - R)/(w max R)               amplitudes R

The columns of D (n, modes) are free responses of a linear FMU, demodulated (`signal.rotating`);
factors c, offset o and noise s are solved inside. One run answers, whose samples lie as far apart
as those of the record, a few between two, and a short one that determines which phasors turn
forwards: a decay over 1e8 periods costs as much as one over 1e2.

Factors and noise of amplitudes (`solved_amplitude`) are those of least sum ((S - R)/w)^2, up to a
phase that all factors have in common: s is the noise of each quadrature, from which amplitudes do
not fall to zero. |D c|^2 is linear in the products c_k c_l*: they give the first guess, Gauss and
Newton the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import lstsq

from fitting.campaign import Setup
from fitting.lines.decay_begin import decay_start
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import (
    DRAWN,
    OF_LARGEST,
    Axis,
    Figure,
    Panel,
    compared,
    record_figure,
    residual_points,
)
from fitting.measurements.measurement import Values
from fitting.measurements.records import OfSetup
from fitting.measurements.residuals import ResidualCurve
from fitting.measurements.time_record import TimeRecord, ask_decay
from fitting.measurements.trace_survey import RequestedRuns, TracesTogether
from fitting.measurements.traces import SHIFTS, together
from fitting.signal.least_squares import damped_step
from fitting.signal.rotating import SENSED, Reference, line_columns, reference, rotating_responses
from fitting.signal.roughness import Scatter, rician, scatter_of
from fitting.signal.window import Window
from fitting.simulate.batch import Batch
from fitting.text.arguments import checked
from fitting.text.arrays import ComplexArray, FloatArray, IntArray
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, number

#: Shifts reach over this part of the record.
SHARE = 8


@dataclass(frozen=True, eq=False)
class DemodulatedRecord(TimeRecord):
    """A free decay of one output of the FMU, demodulated at a frequency.

    `fitting.DemodulatedTrace` explains its fields.

    Raises:
        BadInput: shapes that differ, times that do not rise or are not even, values that are not
            finite, are negative amplitudes or are clipped, a frequency that is not positive, fewer
            samples than a decay needs.
    """

    _: KW_ONLY
    frequency_hz: float
    input: str
    modes: int = 1
    floor: bool = True
    source: str = "demodulated trace"

    is_demodulated = True

    def check_statements(self) -> None:
        """Complain of fields that do not go together."""
        if not 0.0 < self.frequency_hz < np.inf:
            raise BadInput(
                f"{self.source}: demodulated at {self.frequency_hz!r} Hz; wanted a positive "
                "frequency"
            )
        if self.modes < 1:
            raise BadInput(f"{self.source}: {self.modes} modes, wanted 1 at least")
        if not self.input:
            raise BadInput(
                f"{self.source}: a decay is spanned by responses to a pulse: wanted the input of "
                "the FMU that excites it"
            )
        if self.is_amplitude and self.offset:
            raise BadInput(f"{self.source}: an offset has a meaning for phasors only")
        for k in np.flatnonzero(self.y < 0.0)[:1] if self.is_amplitude else ():
            raise BadInput(
                f"{self.source}: sample {k}: amplitude {self.y[k]:g}; wanted none below zero, or "
                "phasors X + i Y"
            )

    def check_samples(self) -> None:
        """Complain of too few samples."""
        if 4 * self.modes > self.y.size:
            raise BadInput(
                f"{self.source}: {self.modes} modes for {self.y.size} samples; wanted four samples "
                "at least for each"
            )
        if not np.any(self.y):
            raise BadInput(f"{self.source}: every value is zero; wanted a decay")

    def decay_begin(self) -> int:
        """Index of the first sample of the free decay."""
        if self.is_amplitude and self.modes > 1:
            raise BadInput(
                f'{self.source}: begin = "found" looks for exponentials, which amplitudes of '
                f"{self.modes} modes are not; wanted phasors, or the record cut"
            )
        quarter = np.exp(0.5j * np.pi * (np.arange(self.y.size) % 4 + 0.5))
        begin = decay_start((self.y * quarter).real, 2 * self.modes)
        if begin is None:
            raise BadInput(
                f"{self.source}: shows no free decay; wanted a longer record after the drive is "
                'off, or begin = "first"'
            )
        return begin

    @property
    def is_amplitude(self) -> bool:
        """Whether the values are amplitudes, without phases."""
        return not np.iscomplexobj(self.y)

    @property
    def rows(self) -> int:
        """Number of residual rows: one for an amplitude, two for a phasor."""
        return int(self.y.size) * (1 if self.is_amplitude else 2)

    @cached_property
    def largest(self) -> float:
        """The largest amplitude, in ``unit``."""
        return float(np.max(np.abs(self.y)))

    @cached_property
    def scatter(self) -> Scatter:
        """The noise of amplitudes by their scatter."""
        return scatter_of(np.abs(self.y))

    @cached_property
    def weights(self) -> FloatArray:
        """Standard deviations of amplitudes over that of a quadrature, (n,): less in the noise."""
        return self.scatter.weights if self.is_amplitude else np.ones(self.y.size)

    @property
    def known_noise(self) -> float | None:
        """Noise of a quadrature below amplitudes, 0 for none; None: it is solved for.

        It is where the record reaches it. Elsewhere it would be confused with the decay itself,
        and the scatter of the samples determines it.
        """
        if not self.floor:
            return 0.0
        if self.sigma > 0.0:
            return self.sigma
        return None if self.scatter.drowns else self.scatter.noise

    @property
    def solved_inside(self) -> int:
        """Number of unknowns that are solved for: amplitudes have no common phase."""
        if self.is_amplitude:
            return 2 * self.modes - 1 + (self.known_noise is None)
        return 2 * (self.modes + self.offset)

    def rows_of(self, values: FloatArray | ComplexArray) -> FloatArray:
        """Rows of values (n,): over the largest, phasors as all X, then all Y.

        Args:
            values: amplitudes or phasors, in ``unit``.
        """
        if self.is_amplitude:
            return np.asarray(values.real / (self.weights * self.largest))
        return np.concatenate([values.real, values.imag]) / self.largest

    def share_left(self, rows: FloatArray) -> float:
        """What rows leave, root mean square over the largest modulus; of phasors their distance.

        Args:
            rows: of this record, (rows,).
        """
        if self.is_amplitude:
            return float(np.sqrt(np.mean((rows * self.weights) ** 2)))
        return float(np.sqrt(2.0 * np.mean(rows**2)))

    def residual_curve(self, at: slice, rows: FloatArray) -> ResidualCurve:
        """Its residuals over time; of phasors real parts, then imaginary ones.

        Args:
            at: which rows of the measurement these are.
            rows: residuals, (rows,).
        """
        return ResidualCurve(
            rows=np.arange(at.start, at.stop),
            share=self.weights if self.is_amplitude else np.full(rows.size, np.sqrt(2.0)),
            axis=np.asarray(self.spacing_s * (np.arange(rows.size) % self.y.size), dtype=float),
            name=self.label,
        )

    # --- runs of the FMU ------------------------------------------------------------------------

    @cached_property
    def reference(self) -> Reference:
        """The reference, and how many samples of a run determine its sense of rotation."""
        return reference(self.frequency_hz, self.spacing_s)

    @property
    def run_step_s(self) -> float:
        """Spacing of the samples of its runs, s."""
        return self.reference.step_s

    @property
    def run_samples(self) -> int:
        """How many samples its runs have."""
        return (self.y.size - 1) * self.reference.between + 1 + int(self.shifts[-1])

    @cached_property
    def shifts(self) -> IntArray:
        """Samples of a run by which the responses to a pulse are shifted against each other."""
        count = 2 * SHIFTS * self.modes
        most = max(count, self.y.size * self.reference.between // SHARE)
        return np.unique(np.append(0, np.round(np.geomspace(1.0, most, count)))).astype(np.intp)

    @property
    def pulse_window(self) -> Window:
        """Samples of the response to a pulse, as long as the record and its shifts."""
        step_s = self.run_step_s
        return Window(tones_hz=(), settle_s=step_s, step_s=step_s, samples=self.run_samples)

    @property
    def sensing_window(self) -> Window:
        """Samples of a second response, which determines what turns forwards."""
        step_s = self.reference.sensing_step_s
        return Window(tones_hz=(), settle_s=step_s, step_s=step_s, samples=SENSED)


#: Steps at most, the relative one that ends them, and the damping of the first: its factors.
STEPS, SETTLED = 100, 1e-13
DAMPING, DECREASED, INCREASED = 1e-3, 0.1, 10.0


def solved_amplitude(
    columns: ComplexArray, measured: FloatArray, weights: FloatArray, sigma: float | None
) -> tuple[FloatArray, FloatArray]:
    """Amplitudes (n,) that follow the measured ones best, and derivatives (n, m) by the unknowns.

    Args:
        columns: D, (n, k), complex.
        measured: R, (n,), of order one.
        weights: w, standard deviations of R up to a factor, (n,).
        sigma: s where it is known, 0 for none, in the unit of R; None: it is solved for.
    """
    sizes = np.max(np.abs(columns), axis=0)
    unit = columns / np.where(sizes > 0.0, sizes, 1.0)
    factors, power = _guess(unit, measured, sigma)
    count, lead = factors.size, int(np.argmax(np.abs(factors)))
    free = [k for k in range(count) if k != lead]  # the common phase is that of the largest factor
    rotated = factors * np.exp(-1j * np.angle(factors[lead]))

    def amplitude(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Of real parts x of all factors, imaginary ones, and s^2; with derivatives by x."""
        c = x[:count].astype(complex)
        c[free] += 1j * x[count : count + len(free)]
        s = float(np.sqrt(x[-1])) if sigma is None else sigma
        z = unit @ c
        length = np.abs(z)
        along = np.conj(z) / np.where(length > 0.0, length, 1.0)
        mean, slope, rise = rician(length, s)
        slopes = (along * slope)[:, None] * unit
        parts = [slopes.real, -slopes.imag[:, free]]
        if sigma is None:
            parts.append(rise[:, None])
        return mean, np.concatenate(parts, axis=1)

    begin = [*rotated.real, *rotated.imag[free], *([power] if sigma is None else [])]
    return _least(amplitude, np.array(begin), measured, weights, has_power=sigma is None)


def _least(
    amplitude: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    x: FloatArray,
    measured: FloatArray,
    weights: FloatArray,
    *,
    has_power: bool,
) -> tuple[FloatArray, FloatArray]:
    """Amplitudes of least weighted squares, from a guess x, by Levenberg's steps; s^2 >= 0."""
    damping, (values, design) = DAMPING, amplitude(x)
    for _ in range(STEPS):
        left = (values - measured) / weights
        matrix = design / weights[:, None]
        sizes = np.linalg.norm(matrix, axis=0)
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        low = np.full(x.size, -np.inf)
        if has_power:
            low[-1] = -x[-1] * sizes[-1]
        bounds = (low, np.full(x.size, np.inf))
        moved = x + damped_step(matrix / sizes, left, damping, bounds) / sizes
        if has_power:
            moved[-1] = max(moved[-1], 0.0)
        ahead = amplitude(moved)
        rest = (ahead[0] - measured) / weights
        small = float(np.max(np.abs(moved - x))) <= SETTLED * float(np.max(np.abs(x)))
        if float(rest @ rest) <= float(left @ left):
            x, (values, design), damping = moved, ahead, DECREASED * damping
        else:
            damping *= INCREASED
        if small:
            break
    return values, design


def _guess(
    columns: ComplexArray, measured: FloatArray, sigma: float | None
) -> tuple[ComplexArray, float]:
    """Factors (k,), and s^2, whose squares follow those measured."""
    count = columns.shape[1]
    upper = [(k, m) for k in range(count) for m in range(k + 1, count)]
    design = [np.abs(columns.T) ** 2]
    for k, m in upper:
        product = columns[:, k] * np.conj(columns[:, m])
        design.append(np.stack([2.0 * product.real, -2.0 * product.imag]))
    known = 0.0 if sigma is None else sigma**2
    if sigma is None:
        design.append(np.ones((1, measured.size)))
    result = lstsq(np.concatenate(design).T, measured**2 - 2.0 * known)[0]
    gram = np.diag(result[:count]).astype(complex)
    for j, (k, m) in enumerate(upper):
        gram[k, m] = complex(result[count + 2 * j], result[count + 2 * j + 1])
        gram[m, k] = np.conj(gram[k, m])
    values, shapes = np.linalg.eigh(gram)
    size = max(float(values[-1]), 0.0)
    power = known if sigma is not None else max(0.5 * float(result[-1]), 0.0)
    factors = np.asarray(np.sqrt(size) * shapes[:, -1])
    return (factors if size > 0.0 else np.full(count, np.max(measured), dtype=complex)), power


#: Amplitudes below this share of the largest are not drawn: the axis is logarithmic.
LOWEST = 1e-9


def demodulated_figure(trace: DemodulatedRecord, before: Values, after: Values) -> Figure:
    """A trace with the model, its residuals, and their autocorrelation.

    Args:
        trace: as measured.
        before: as simulated with the start parameters, (n,), in the trace's unit.
        after: with the fitted ones.
    """
    x = Axis("time", "s")
    every = slice(None, None, -(-trace.t.size // DRAWN))
    t = trace.t[every]

    def panel(axis: Axis, part: Callable[[Values], FloatArray]) -> Panel:
        shown = (part(values)[every] for values in (trace.y, before, after))
        return compared((x, axis), t, *shown)

    floor = LOWEST * trace.largest
    size = Axis("amplitude", trace.unit, log=True)
    panels = [panel(size, lambda v: np.maximum(np.abs(v), floor))]
    if not trace.is_amplitude:
        panels.append(panel(Axis("quadrature X", trace.unit), np.real))
    left = trace.rows_of(after - trace.y)
    parts = [left] if trace.is_amplitude else list(np.split(left, 2))
    names = ("",) if trace.is_amplitude else ("X", "Y")
    shares = [100.0 * part[every] for part in parts]
    rest = residual_points((x, OF_LARGEST), t, list(zip(names, shares, strict=True)))
    rms = number(100.0 * float(np.sqrt(np.mean(left**2))), 2)
    what = "amplitudes" if trace.is_amplitude else "phasors"
    factors = f"its amplitude at {trace.first_words} is"
    if trace.modes > 1:
        factors = f"the amplitudes of {trace.modes} modes at {trace.first_words} are"
    return record_figure(
        "demodulated",
        "Demodulated trace",
        trace.label,
        caption=(
            f"{trace.y.size} {what} at {hertz(trace.frequency_hz)} with the model before and after "
            f"the fit; {factors} solved for. Below: what the fit leaves, {rms} % of the largest "
            "value (rms), and its autocorrelation, with the band that holds 95 % of it where it is "
            "white."
        ),
        alt=f"A decay of {trace.y.size} {what} with the fitted model; residual {rms} % rms.",
        panels=(*panels, rest, together(parts[0])),
    )


@checked
@dataclass(frozen=True, eq=False)
class DemodulatedTrace(DemodulatedRecord, OfSetup):
    """A free decay of one output of the FMU, demodulated at a frequency.

    Args:
        time_s: Times of the samples, shape (n,), s, evenly spaced.
        values: Phasors X + i Y, phases as Re[values exp(2 pi i f t)], or real amplitudes, shape
            (n,), in ``unit``.
        frequency_hz: f, of the demodulator, Hz.
        input: The FMU's input by which a pulse starts the decay.
        output: The observed output of the FMU; empty: the setup's.
        modes: Number of lines, those nearest to the frequency.
        offset: (phasors) whether a constant phasor is solved for, as of a leaking reference.
        floor: (amplitudes) whether they have a noise floor: ``sigma``, or from their scatter, or
            solved for.
        sigma: Standard deviation of each quadrature, in ``unit``; 0: from the residuals.
        begin: "first": at the first sample; "found": where the decay is found to begin.
        settings: Start values of the FMU by variable, in the FMU's units.
        setting_sigma: Standard deviations of settings, in the FMU's units: an offset of each is
            fitted; others are exact.
        label: Name of the trace; required with several.
        unit: Of the values.
        source: Its name in errors.
        setup: The observed output and start values; its tones are not used.
        series: Measurements of one series share their setup.

    Raises:
        BadInput: shapes that differ, times that do not rise or are not even, values that are not
            finite, are negative amplitudes or are clipped, a frequency that is not positive, fewer
            samples than a decay needs.
    """

    def within(self, setup: Setup, series: str) -> DemodulatedTraces:
        """The measurement, as part of a series that is driven so.

        Args:
            setup: how the series drives the FMU.
            series: its name.
        """
        return DemodulatedTraces(setup=setup, traces=(self,)).within(setup, series)


class DemodulatedTraces(TracesTogether[DemodulatedRecord]):
    """One or several demodulated traces that are fitted together."""

    NOUN = "demodulated trace"
    GROUP = "demodulated/"

    @property
    def sampled_hz(self) -> tuple[float, ...]:
        """Rates of the samples, each once."""
        return tuple(dict.fromkeys(1.0 / trace.spacing_s for trace in self.traces))

    def ask(
        self, model: DrivenModel, trace: DemodulatedRecord, p: FloatArray, batch: Batch, owner: int
    ) -> RequestedRuns:
        """Numbers of the runs after a pulse: as the record is sampled, and a little slower.

        Args:
            model: the FMU as the series drives it.
            trace: one of them.
            p: parameters (n,), each in its own unit.
            batch: where runs are asked for.
            owner: which evaluation pays for them.
        """
        values = self.start_values(model, trace, p)
        plan, output = model.plan.step_plan(self.key(trace)), self.output_of(trace)
        window = trace.sensing_window
        sensing = trace.pulse(1 if plan is None else plan.per_sample, window=window)
        return RequestedRuns(
            decay=ask_decay(trace, values, plan, batch, output, owner),
            further=batch.ask(values, window, sensing, output, owner),
        )

    def read(
        self, trace: DemodulatedRecord, runs: RequestedRuns, decay: FloatArray | None, batch: Batch
    ) -> tuple[ComplexArray, FloatArray]:
        """Values (n,) of a trace, with the best factors, and derivatives (rows, k)."""
        if decay is None or runs.further is None:
            raise TypeError(f"a demodulated trace follows from two runs, not from {runs!r}")
        # the second response distinguishes what turns forwards
        sensed = batch.samples(runs.further, self.output_of(trace))
        columns = rotating_responses(
            decay, sensed, trace.shifts, trace.reference, trace.y.size, trace.modes
        )
        if trace.is_amplitude:
            size, known = trace.largest, trace.known_noise
            noise = None if known is None else known / size
            made, design = solved_amplitude(columns, trace.y.real / size, trace.weights, noise)
            return (size * made).astype(complex), design / trace.weights[:, None]
        if trace.offset:
            columns = np.column_stack([columns, np.ones(trace.y.size)])
        sizes = np.linalg.norm(columns, axis=0)
        unit = columns / np.where(sizes > 0.0, sizes, 1.0)
        values = unit @ lstsq(unit, trace.y)[0]
        return values, np.stack(line_columns(unit), axis=1) / trace.largest

    def figure_of(self, record: DemodulatedRecord, before: Values, after: Values) -> Figure:
        """A trace with the model, its residuals, and their autocorrelation."""
        return demodulated_figure(record, before, after)
