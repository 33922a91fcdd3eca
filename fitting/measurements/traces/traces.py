"""Trace: a time series of one output of the FMU, under a recorded or declared input, or none.

    S = g z + o + V c        r = (S - y)/max|y - mean y|        y measured, z simulated

One row per sample. Gain g and offset o of the read-out, and with ``start = "unknown"`` what the
state at the first sample adds, V c, enter linearly: they are solved inside. V (n, states) spans the
free responses of a linear FMU. They are those to a short pulse at its input, begun at different
times before the first sample: whatever state the input can bring about decays as a combination of
these. A ringdown is a trace without an input whose start is unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.campaign import Setup
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import Figure
from fitting.measurements.measurement import Values
from fitting.measurements.record import OfSetup
from fitting.measurements.traces.decay_run import ask_decay
from fitting.measurements.traces.figure import trace_figure
from fitting.measurements.traces.record import FIT, UNKNOWN, TraceRecord
from fitting.measurements.traces.survey import Asked
from fitting.measurements.traces.together import TracesTogether
from fitting.simulate.batch import Batch
from fitting.text.arguments import checked
from fitting.text.arrays import FloatArray


@checked
@dataclass(frozen=True, eq=False)
class Trace(TraceRecord, OfSetup):
    """A time series of one output of the FMU, under a recorded or declared input, or none.

    Args:
        time_s: Times of the samples, shape (n,), s, evenly spaced.
        values: Of the output, shape (n,), in ``unit``.
        input: The FMU's input that is driven; empty: none is.
        driven: What drives it: times (m,), s, and values (m,) that were recorded, on the clock of
            ``time_s``, or a declared `Pulse` or `Chirp`; None: nothing does.
        further: What drives further inputs, by their names, likewise.
        interpolation: Recorded inputs are "held" until the next value or joined ("linear").
        output: The FMU's output that is seen; empty: the setup's.
        gain: "one": the output as it is; "fit": times a gain that is solved for.
        offset: Whether an offset is solved for.
        sigma: Standard deviation of the values, in ``unit``; 0: the residuals tell it.
        lead_s: Time before the first sample at which the FMU starts, s.
        start: "rest": the FMU begins with its start values; "unknown": with a state that is solved
            for, by the free responses of a linear FMU.
        states: Number of states that decay, two for each mode.
        begin: "first": the trace begins with its first sample; "found": where the free decay
            begins, after a drive was switched off or a blow, and earlier samples are not used.
        settings: Start values of the FMU during the trace by variable, in the FMU's units.
        setting_sigma: Standard deviations of settings, in the FMU's units: an offset of each is
            fitted; what has none is exact.
        label: Name of the trace, for values of its own; wanted where there are several.
        unit: Of the values.
        source: What complaints name it by.
        setup: What is observed, and the FMU's start values; tones of its drive are not used.
        series: Measurements of one series share their setup.

    Raises:
        BadInput: shapes that differ, times that do not rise or are not even, values that are not
            finite or are clipped, an unknown start without an input or without a whole period.
    """

    def within(self, setup: Setup, series: str) -> Traces:
        """The measurement, as part of a series that is driven so.

        Args:
            setup: how the series drives the FMU.
            series: its name.
        """
        return Traces(setup=setup, traces=(self,)).within(setup, series)


class Traces(TracesTogether[TraceRecord]):
    """One or several traces that are fitted together, a row for each sample."""

    NOUN = "trace"

    def key(self, trace: TraceRecord) -> str:
        """What the plan knows a trace by.

        Args:
            trace: one of them.
        """
        return f"{self.series}/{trace.label}"

    def ask(
        self, model: DrivenModel, trace: TraceRecord, p: FloatArray, batch: Batch, owner: int
    ) -> Asked:
        """Numbers of the run under the input, and of that after a pulse.

        Args:
            model: the FMU as the series drives it.
            trace: one of them.
            p: parameters (n,), each in its own unit.
            batch: where runs are asked for.
            owner: which evaluation pays for them.
        """
        values = model.whole.values(p, trace.label or None, trace.settings)
        plan = model.plan.step_plan(self.key(trace))
        driven = decay = coarse = None
        output, steps = self.output_of(trace), 1 if plan is None else plan.per_sample
        if trace.is_driven:
            driven = batch.ask(values, trace.window(), trace.signal(steps), output, owner)
            if plan is not None and plan.extrapolated:
                half = trace.signal(steps // 2)
                coarse = batch.ask(values, trace.window(), half, output, owner)
        if trace.start == UNKNOWN:
            decay = ask_decay(trace, values, plan, batch, output, owner)
        return Asked(driven=driven, decay=decay, coarse=coarse)

    def read(
        self, trace: TraceRecord, runs: Asked, decay: FloatArray | None, batch: Batch
    ) -> tuple[FloatArray, FloatArray]:
        """Values (n,) of a trace, with the best gain, offset and start; derivatives (n, k)."""
        count = trace.y.size
        base, columns = np.zeros(count), []
        observed = runs.under_input(batch, self.output_of(trace))
        if observed is not None:
            if trace.gain == FIT:
                columns.append(observed)
            else:
                base = observed
        if trace.offset:
            columns.append(np.ones(count))
        if decay is not None:
            columns += list(trace.free_responses(decay).T)
        design = np.stack(columns, axis=1) if columns else np.empty((count, 0))
        return base + _projected(design, trace.y - base), design / trace.largest

    def figure_of(
        self,
        record: TraceRecord,
        before: Values,
        after: Values,
    ) -> Figure:
        """A trace with the model, its residuals, and their autocorrelation."""
        return trace_figure(record, before.real, after.real, self.series)


def _projected(design: FloatArray, values: FloatArray) -> FloatArray:
    """What columns (n, k) of any size make of values (n,) by least squares."""
    if design.shape[1] == 0:
        return np.zeros(values.size)
    sizes = np.linalg.norm(design, axis=0)
    scaled = design / np.where(sizes > 0.0, sizes, 1.0)
    return np.asarray(scaled @ np.linalg.lstsq(scaled, values, rcond=None)[0])
