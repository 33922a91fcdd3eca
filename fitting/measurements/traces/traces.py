"""Trace: a time series of one output of the FMU, under a recorded or declared input, or none.

    S = g z + o + V c        r = (S - y)/max|y - mean y|        y measured, z simulated

One row per sample. Gain g and offset o of the read-out, and with ``start = "unknown"`` what the
state at the first sample adds, V c, enter linearly: they are solved inside. V (n, states) spans the
free responses of a linear FMU. They are those to a short pulse at its input, begun at different
times before the first sample: whatever state the input can bring about decays as a combination of
these. A ringdown is a trace without an input whose start is unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from fitting.campaign import Setup
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import Figure
from fitting.measurements.measurement import AtOnePlace, Predicting, Prediction, Values
from fitting.measurements.residual_curve import ResidualCurve, mistakes
from fitting.measurements.traces.decay_run import ask_decay
from fitting.measurements.traces.figure import trace_figure
from fitting.measurements.traces.record import FIT, UNKNOWN, TraceRecord
from fitting.measurements.traces.survey import Asked
from fitting.measurements.traces.together import TracesTogether
from fitting.simulate.batch import Batch
from fitting.text.arguments import checked
from fitting.text.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class SolvedTraces(Prediction):
    """Traces as predicted: `designs` (n, k) of what was solved inside each, of its rows."""

    designs: tuple[FloatArray, ...] = ()


@checked
@dataclass(frozen=True, eq=False)
class Trace(TraceRecord, AtOnePlace):
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

    _: KW_ONLY
    setup: Setup
    series: str = ""

    @property
    def rows(self) -> int:
        """Number of residual rows: one for each sample."""
        return int(self.y.size)

    def within(self, setup: Setup, series: str) -> Traces:
        """The measurement, as part of a series that is driven so.

        Args:
            setup: how the series drives the FMU.
            series: its name.
        """
        return Traces(setup=setup, traces=(self,)).within(setup, series)


@dataclass(frozen=True, kw_only=True)
class Traces(TracesTogether[TraceRecord]):
    """One or several traces that are fitted together, a row for each sample.

    Raises:
        BadInput: no trace, or two of one name.
    """

    NOUN = "traces"

    @property
    def rows(self) -> int:
        """One for each sample."""
        return sum(trace.y.size for trace in self.traces)

    @cached_property
    def sigma(self) -> FloatArray:
        """Standard deviation of every row, (rows,); zero where unknown."""
        return np.concatenate([np.full(x.y.size, x.sigma / x.largest) for x in self.traces])

    def key(self, trace: TraceRecord) -> str:
        """What the plan knows a trace by.

        Args:
            trace: one of them.
        """
        return f"{self.series}/{trace.label}"

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        """Values of every trace, with the best gain, offset and start."""
        asked = [
            [self.ask(model, trace, p, batch, k) for trace in self.traces]
            for k, p in enumerate(table)
        ]
        yield
        decays = yield from self.decays(model, table, asked, batch)
        return [
            self._solved(
                [
                    self._read(trace, runs, decay, batch)
                    for trace, runs, decay in zip(self.traces, each, free, strict=True)
                ]
            )
            for each, free in zip(asked, decays, strict=True)
        ]

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
        output, steps = self.output(trace), 1 if plan is None else plan.per_sample
        if trace.is_driven:
            driven = batch.ask(values, trace.window(), trace.signal(steps), output, owner)
            if plan is not None and plan.extrapolated:
                half = trace.signal(steps // 2)
                coarse = batch.ask(values, trace.window(), half, output, owner)
        if trace.start == UNKNOWN:
            decay = ask_decay(trace, values, plan, batch, output, owner)
        return Asked(driven=driven, decay=decay, coarse=coarse)

    def followed(
        self, trace: TraceRecord, runs: Asked, decay: FloatArray | None, batch: Batch
    ) -> FloatArray:
        """Values (n,) of a trace as simulated runs and a decay have it.

        Args:
            trace: one of them.
            runs: numbers of its runs.
            decay: after a pulse, whole; None: it wants none.
            batch: that has simulated them.
        """
        return self._read(trace, runs, decay, batch)[0]

    def _read(
        self, trace: TraceRecord, runs: Asked, decay: FloatArray | None, batch: Batch
    ) -> tuple[FloatArray, FloatArray]:
        """Values (n,) of a trace as the model has it, and what is solved for, (n, k)."""
        count = trace.y.size
        base, columns = np.zeros(count), []
        seen = runs.under_input(batch, self.output(trace))
        if seen is not None:
            if trace.gain == FIT:
                columns.append(seen)
            else:
                base = seen
        if trace.offset:
            columns.append(np.ones(count))
        if decay is not None:
            columns += list(trace.free_responses(decay).T)
        design = np.stack(columns, axis=1) if columns else np.empty((count, 0))
        return base + _projected(design, trace.y - base), design

    def _solved(self, each: Sequence[tuple[FloatArray, FloatArray]]) -> SolvedTraces:
        designs = tuple(
            design / trace.largest for (_, design), trace in zip(each, self.traces, strict=True)
        )
        return SolvedTraces(np.concatenate([values for values, _ in each]), designs=designs)

    def residuals(self, prediction: Prediction, chi: float) -> FloatArray:
        """(S - y)/max|y - mean y|, (rows,)."""
        pairs = zip(self.traces, self._split(prediction.values), strict=True)
        return np.concatenate([(values - trace.y) / trace.largest for trace, values in pairs])

    def solved_columns(self, prediction: Prediction) -> FloatArray:
        """Derivatives of the rows by gains, offsets and states."""
        return np.asarray(block_diag(*self.solved_blocks(prediction)))

    def solved_blocks(self, prediction: Prediction) -> Sequence[FloatArray]:
        """A stretch for each trace."""
        if not isinstance(prediction, SolvedTraces):
            raise TypeError(f"a trace is predicted by {prediction!r}")
        return prediction.designs

    def share_left(self, residuals: FloatArray) -> float:
        """Root mean square of the worst trace over its largest deviation from its mean."""
        ends = np.cumsum([trace.y.size for trace in self.traces])[:-1]
        return max(float(np.sqrt(np.mean(r**2))) for r in np.split(residuals, ends))

    def residual_curves(self, residuals: FloatArray) -> Sequence[ResidualCurve]:
        """Every trace over time."""
        found, begin = [], 0
        for trace in self.traces:
            rows = np.arange(begin, begin + trace.y.size)
            begin += rows.size
            values = trace.y + trace.largest * residuals[rows]
            time_s = np.asarray(trace.spacing_s * np.arange(rows.size), dtype=float)
            found.append(
                ResidualCurve(
                    rows=rows,
                    share=np.ones(rows.size),
                    axis=time_s,
                    name=trace.label,
                    columns=mistakes(time_s, values, 1.0 / trace.largest),
                )
            )
        return tuple(found)

    def unexplained(self, residuals: FloatArray) -> str:
        """Traces of whose variance less than half is explained are not described."""
        y = np.concatenate([(x.y - np.mean(x.y)) / x.largest for x in self.traces])
        if self._leaves_most(y, residuals):
            return "the simulated trace does not follow the measured one"
        return ""

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """Every trace with the model, what the fit leaves, and how that hangs together."""
        trios = zip(self.traces, self._split(before), self._split(after), strict=True)
        return tuple(trace_figure(x, b, a, self.series) for x, b, a in trios)

    def _split(self, values: Values) -> list[FloatArray]:
        ends = np.cumsum([trace.y.size for trace in self.traces])[:-1]
        return list(np.split(np.asarray(values.real, dtype=float), ends))


def _projected(design: FloatArray, values: FloatArray) -> FloatArray:
    """What columns (n, k) of any size make of values (n,) by least squares."""
    if design.shape[1] == 0:
        return np.zeros(values.size)
    sizes = np.linalg.norm(design, axis=0)
    scaled = design / np.where(sizes > 0.0, sizes, 1.0)
    return np.asarray(scaled @ np.linalg.lstsq(scaled, values, rcond=None)[0])
