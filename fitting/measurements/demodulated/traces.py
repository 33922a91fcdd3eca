"""Demodulated trace: a free decay as a lock-in or an analyser at one frequency shows it over time.

    S = D c + o        r = (S - z)/max|z|                  phasors z = X + i Y
    S = rice(|D c|, s) r = (S - R)/(w max R)               amplitudes R

The columns of D (n, modes) are free responses of a linear FMU, demodulated (`signal.rotating`);
factors c, offset o and noise s are solved inside. One run answers, whose samples lie as far apart
as those of the record, a few between two, and a short one that tells what turns forwards: a decay
over 1e8 periods costs what one over 1e2 does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lstsq

from fitting.campaign import Setup
from fitting.measurements.demodulated.amplitude import solved_amplitude
from fitting.measurements.demodulated.figure import demodulated_figure
from fitting.measurements.demodulated.record import DemodulatedRecord
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import Figure
from fitting.measurements.measurement import Values
from fitting.measurements.record import OfSetup
from fitting.measurements.traces.decay_run import ask_decay
from fitting.measurements.traces.survey import Asked
from fitting.measurements.traces.together import TracesTogether
from fitting.signal.rotating import line_columns, rotating_responses
from fitting.simulate.batch import Batch
from fitting.text.arguments import checked
from fitting.text.arrays import ComplexArray, FloatArray


@checked
@dataclass(frozen=True, eq=False)
class DemodulatedTrace(DemodulatedRecord, OfSetup):
    """A free decay of one output of the FMU, demodulated at a frequency.

    Args:
        time_s: Times of the samples, shape (n,), s, evenly spaced.
        values: Phasors X + i Y, complex, phases as Re[values exp(2 pi i f t)], or amplitudes,
            real, shape (n,), in ``unit``.
        frequency_hz: f, the frequency that they were demodulated at, Hz.
        input: The FMU's input by which a pulse sets it moving.
        output: The FMU's output that is seen; empty: the setup's.
        modes: How many lines are seen, those nearest to the frequency.
        offset: (phasors) whether a constant phasor is solved for, as of a leaking reference.
        floor: (amplitudes) whether they do not fall below their noise: ``sigma``, or what their
            scatter tells, or where they drown in it what is solved for.
        sigma: Standard deviation of each quadrature, in ``unit``; 0: the residuals tell it.
        begin: "first": the decay begins with the first sample; "found": where it is found to.
        settings: Start values of the FMU by variable, in the FMU's units.
        setting_sigma: Standard deviations of settings, in the FMU's units: an offset of each is
            fitted; what has none is exact.
        label: Name of the trace, for values of its own; wanted where there are several.
        unit: Of the values.
        source: What complaints name it by.
        setup: What is observed, and the FMU's start values; tones of its drive are not used.
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

    @property
    def sampled_hz(self) -> tuple[float, ...]:
        """Rates of the samples, each once."""
        return tuple(dict.fromkeys(1.0 / trace.spacing_s for trace in self.traces))

    def key(self, trace: DemodulatedRecord) -> str:
        """What the plan knows a trace by.

        Args:
            trace: one of them.
        """
        return f"{self.series}/demodulated/{trace.label}"

    def ask(
        self, model: DrivenModel, trace: DemodulatedRecord, p: FloatArray, batch: Batch, owner: int
    ) -> Asked:
        """Numbers of the runs after a pulse: as the record is sampled, and a little slower.

        Args:
            model: the FMU as the series drives it.
            trace: one of them.
            p: parameters (n,), each in its own unit.
            batch: where runs are asked for.
            owner: which evaluation pays for them.
        """
        values = model.whole.values(p, trace.label or None, trace.settings)
        plan, output = model.plan.step_plan(self.key(trace)), self.output_of(trace)
        sensing = trace.sensing_pulse(1 if plan is None else plan.per_sample)
        return Asked(
            decay=ask_decay(trace, values, plan, batch, output, owner),
            further=batch.ask(values, trace.sensing_window, sensing, output, owner),
        )

    def read(
        self, trace: DemodulatedRecord, runs: Asked, decay: FloatArray | None, batch: Batch
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

    def figure_of(
        self,
        record: DemodulatedRecord,
        before: Values,
        after: Values,
    ) -> Figure:
        """A trace with the model, its residuals, and their autocorrelation."""
        return demodulated_figure(record, before, after, self.series)
