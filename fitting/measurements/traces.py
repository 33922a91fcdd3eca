"""Trace: a time series of one output of the FMU, under a recorded or declared input, or none.

    S = g z + o + V c        r = (S - y)/max|y - mean y|        y measured, z simulated

One row per sample. Gain g and offset o of the read-out, and with ``start = "unknown"`` what the
state at the first sample adds, V c, enter linearly: they are solved inside. V (n, states) spans the
free responses of a linear FMU. They are those to a short pulse at its input, begun at different
times before the first sample: whatever state the input can bring about decays as a combination of
these. A ringdown is a trace without an input whose start is unknown.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fitting.campaign import Setup
from fitting.fmu.runs import SampledSignal
from fitting.lines.decay_begin import decay_start
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import (
    DRAWN,
    OF_LARGEST,
    Axis,
    Figure,
    Form,
    Layer,
    Panel,
    Role,
    compared,
    record_figure,
    residual_points,
)
from fitting.measurements.measurement import Values
from fitting.measurements.records import OfSetup
from fitting.measurements.residuals import ResidualCurve, mistakes
from fitting.measurements.steps import REFINED_STEPS, Look
from fitting.measurements.time_record import FIRST, TimeRecord, ask_decay
from fitting.measurements.trace_survey import RequestedRuns, TracesTogether
from fitting.measurements.waveform import LINEAR, Recorded, Waveform
from fitting.signal.window import Window
from fitting.simulate.batch import Batch
from fitting.text.arguments import checked
from fitting.text.arrays import ComplexArray, FloatArray, as_numbers
from fitting.text.errors import BadInput
from fitting.text.notation import number

ONE, FIT = GAINS = ("one", "fit")
REST, UNKNOWN = STARTS = ("rest", "unknown")
#: Shifts of the response to a pulse, for each state that is to be spanned.
SHIFTS = 4
#: States of one mode that decays.
STATES_OF_ONE = 2
#: Largest shift as a share of the trace: near modes are told apart by long ones. One mode needs a
#: part of its period, of which a trace holds one at least; the run is longer by the shift.
FARTHEST, FARTHEST_OF_ONE = 0.5, 0.125
#: Singular values below this share of the largest are rounding.
ROUNDING = 1e-12
#: Crossings of its mean that a trace of unknown start needs, for a period.
CROSSINGS = 2


@dataclass(frozen=True, eq=False)
class TraceRecord(TimeRecord):
    """A time series of one output of the FMU, and what is known of how it came about.

    `fitting.Trace` explains its fields.

    Raises:
        BadInput: shapes that differ, times that do not rise or are not even, values that are not
            finite or are clipped, an unknown start without an input or without a whole period.
    """

    _: KW_ONLY
    driven: tuple[npt.ArrayLike, npt.ArrayLike] | Waveform | None = None
    further: Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike] | Waveform] = field(
        default_factory=dict
    )
    interpolation: str = LINEAR
    gain: str = ONE
    lead_s: float = 0.0
    start: str = REST
    states: int = 2
    y: FloatArray = field(init=False)

    def check_statements(self) -> None:
        """Complain of fields that do not go together."""
        self._refuse_other_words("gain", GAINS)
        self._refuse_other_words("start", STARTS)
        if self.begin != FIRST and (self.start != UNKNOWN or self.driven is not None):
            raise BadInput(
                f'{self.source}: begin = "found" looks for a free decay; wanted start = "unknown" '
                "and no drive"
            )
        if self.further and (self.driven is None or self.input in self.further):
            raise BadInput(
                f"{self.source}: further inputs are driven; wanted what drives the first one, and "
                "each input once"
            )
        if self.driven is not None and not self.input:
            raise BadInput(f"{self.source}: is driven, but by no input; wanted the FMU's input")
        if self.start == UNKNOWN and not self.input:
            raise BadInput(
                f'{self.source}: start = "unknown" takes the response to a pulse: wanted the '
                "input of the FMU that excites it"
            )
        if self.start == REST and self.driven is None and self.input:
            raise BadInput(
                f"{self.source}: nothing drives the input '{self.input}'; wanted what does, or "
                'start = "unknown"'
            )
        if not self.lead_s >= 0.0:
            raise BadInput(f"{self.source}: lead_s is wanted as zero or more")

    def decay_begin(self) -> int:
        """Index of the first sample of the free decay."""
        begin = decay_start(self.y, self.states)
        if begin is None:
            raise BadInput(
                f"{self.source}: shows no free decay of {self.states} states; wanted a longer "
                'record after the drive is off, or begin = "first"'
            )
        return begin

    def check_samples(self) -> None:
        """Complain of too few samples for an unknown start."""
        if self.start != UNKNOWN:
            return
        if self.states < 1 or self.states > self.y.size // 4:
            raise BadInput(
                f"{self.source}: {self.states} states for {self.y.size} samples; wanted four "
                "samples at least for each of one state or more"
            )
        crossings = np.count_nonzero(np.diff(np.sign(self.y - np.mean(self.y))))
        if self.states > 1 and crossings < CROSSINGS:
            raise BadInput(
                f"{self.source}: crosses its mean {crossings} times, which is less than a period; "
                "wanted a longer trace"
            )

    @cached_property
    def waveforms(self) -> Mapping[str, Waveform]:
        """What drives each input; times on the clock of the trace."""
        first = {} if self.driven is None else {self.input: self.driven}
        result: dict[str, Waveform] = {}
        for name, driven in {**first, **self.further}.items():
            if isinstance(driven, tuple):
                time_s, values = (as_numbers(v, f"{self.source}: driven") for v in driven)
                driven = Recorded(time_s, values, self.interpolation, source=f"input '{name}'")
            result[name] = driven
        return result

    @cached_property
    def largest(self) -> float:
        """The largest distance from the mean, in ``unit``."""
        return float(np.max(np.abs(self.y - np.mean(self.y)))) or 1.0

    @property
    def value_share(self) -> float:
        """The largest value over the unit of its rows: of a temperature in kelvin, many times one.

        Of an unknown offset the model knows nothing.
        """
        if self.offset:
            return 1.0
        return float(np.max(np.abs(self.y))) / self.largest or 1.0  # a record of zeros has no unit

    @property
    def solved_inside(self) -> int:
        """Number of unknowns that are solved for."""
        free = self.states if self.start == UNKNOWN else 0
        return free + (self.is_driven and self.gain == FIT) + self.offset

    def rows_of(self, values: FloatArray | ComplexArray) -> FloatArray:
        """Values over the largest distance from the mean.

        Args:
            values: (n,), in ``unit``.
        """
        return np.asarray(values.real / self.largest)

    def residual_curve(self, at: slice, rows: FloatArray) -> ResidualCurve:
        """Its residuals over time.

        Args:
            at: which rows of the measurement these are.
            rows: residuals, (rows,).
        """
        time_s = np.asarray(self.spacing_s * np.arange(rows.size), dtype=float)
        return ResidualCurve(
            rows=np.arange(at.start, at.stop),
            share=np.ones(rows.size),
            axis=time_s,
            name=self.label,
            columns=mistakes(time_s, self.y + self.largest * rows, 1.0 / self.largest),
        )

    @property
    def has_unknown_start(self) -> bool:
        """Whether its state at the first sample is solved for."""
        return self.start == UNKNOWN

    @property
    def is_driven(self) -> bool:
        """Whether the FMU answers to more than its unknown start."""
        return self.driven is not None or self.start == REST

    def lead_steps(self) -> int:
        """Spacings before the first sample."""
        return round(self.lead_s / self.spacing_s)

    def window(self, samples: int | None = None, lead: int | None = None) -> Window:
        """Its samples: their times from the start of a run.

        Args:
            samples: how many; None: as many as were measured.
            lead: spacings before them; None: as many as the trace wants.
        """
        spacings = self.lead_steps() if lead is None else lead
        return Window(
            tones_hz=(),
            settle_s=spacings * self.spacing_s,
            step_s=self.spacing_s,
            samples=self.y.size if samples is None else samples,
        )

    @cached_property
    def _signals(self) -> dict[int, SampledSignal]:
        return {}

    def signal(self, per_sample: int) -> SampledSignal:
        """What is held over the communication steps of its run.

        Args:
            per_sample: steps between two samples.
        """
        if per_sample not in self._signals:
            self._signals[per_sample] = self._hold_signal(per_sample, self.y.size)
        return self._signals[per_sample]

    def _hold_signal(self, per_sample: int, count: int) -> SampledSignal:
        """What is held until the last of the first samples."""
        lead = self.lead_steps()
        steps = (lead + count - 1) * per_sample
        edges = self.t[0] + (np.arange(steps + 1) / per_sample - lead) * self.spacing_s
        times = self.t[0] + np.arange(count) * self.spacing_s
        kept, observed = np.empty((steps, 0)), np.empty((count, 0))
        names, waves = tuple(self.waveforms), self.waveforms.values()
        if names:
            kept = np.stack([wave.means(edges) for wave in waves], axis=1)
            observed = np.stack([wave.at(times) for wave in waves], axis=1)
        return SampledSignal(names, self.spacing_s / per_sample, kept, observed)

    def look(self, fine: int, most: int = REFINED_STEPS) -> Look | None:
        """A closer look at its run under the input; None: nothing but its start moves it.

        Args:
            fine: steps between two samples.
            most: steps in all.
        """
        if not self.is_driven:
            return None
        count = min(self.y.size, max(2, most // fine))
        return Look(self.window(count), self._hold_signal(fine, count), fine)

    @cached_property
    def shifts(self) -> npt.NDArray[np.intp]:
        """Samples by which the responses to a pulse are shifted against each other."""
        count = SHIFTS * self.states
        farthest = FARTHEST_OF_ONE if self.states <= STATES_OF_ONE else FARTHEST
        spread = np.geomspace(1.0, max(2.0, farthest * self.y.size), count - 1)
        return np.unique(np.concatenate([[0], np.round(spread)])).astype(np.intp)

    @property
    def pulse_window(self) -> Window:
        """Samples of the response to a pulse, as long as the trace and its shifts."""
        return self.window(self.y.size + int(self.shifts[-1]), lead=1)

    def free_responses(self, decay: FloatArray) -> FloatArray:
        """Orthonormal basis (n, states) of free responses; of fewer where the FMU has fewer.

        Args:
            decay: response to a pulse, as long as `pulse_window`.
        """
        n = self.y.size
        moved = np.stack([decay[k : k + n] for k in self.shifts], axis=1)
        sizes = np.linalg.norm(moved, axis=0)
        left, singular, _ = np.linalg.svd(
            moved / np.where(sizes > 0.0, sizes, 1.0), full_matrices=False
        )
        basis = np.array(left[:, : self.states])
        basis[:, singular[: self.states] <= ROUNDING * singular[0]] = 0.0
        return basis


#: Lags of the autocorrelation that is drawn, at most.
LAGS = 60


def trace_figure(trace: TraceRecord, before: FloatArray, after: FloatArray) -> Figure:
    """A trace with the model, its residuals, and their autocorrelation.

    Args:
        trace: as measured.
        before: as simulated with the start parameters, (n,), in the trace's unit.
        after: with the fitted ones.
    """
    x, count = Axis("time", "s"), trace.y.size
    every = slice(None, None, -(-count // DRAWN))
    t, y = trace.t[every], trace.y[every]
    sigma = np.full(t.size, trace.sigma) if trace.sigma > 0.0 else None
    shown = compared((x, Axis("output", trace.unit)), t, y, before[every], after[every], sigma)
    left = after - trace.y
    rest = residual_points((x, OF_LARGEST), t, [("", (100.0 * left / trace.largest)[every])])
    rms = number(100.0 * float(np.sqrt(np.mean(left**2))) / trace.largest, 2)
    which = f"{count} samples" if every.step == 1 else f"One of {every.step} of {count} samples"
    waves = trace.waveforms
    driven = "; ".join(
        wave.words if len(waves) == 1 else f"{name}: {wave.words}" for name, wave in waves.items()
    )
    start = "the FMU begins with its start values"
    if trace.start != REST:
        start = f"its state at {trace.first_words}, {trace.states} numbers, is solved for"
    return record_figure(
        "trace",
        "Trace",
        trace.label,
        caption=(
            f"{which} with the model before and after the fit; {driven or 'no input'}; {start}. "
            f"Below: what the fit leaves, {rms} % of the largest distance from the mean (rms), and "
            "its autocorrelation, with the band that holds 95 % of it where it is white."
        ),
        alt=f"A trace of {count} samples with the fitted model; residual {rms} % rms.",
        panels=(shown, rest, together(left)),
    )


def together(left: FloatArray) -> Panel:
    """Autocorrelation of residuals over lag, and where 95 % of white ones stay.

    Args:
        left: residuals, (n,).
    """
    lags = np.arange(1, min(LAGS, left.size // 4) + 1)
    centred = left - np.mean(left)
    power = float(centred @ centred) or 1.0
    r = np.array([float(centred[k:] @ centred[:-k]) / power for k in lags])
    white = 1.96 / np.sqrt(left.size)
    bounds = np.full(lags.size, white)
    lag = lags.astype(float)
    return Panel(
        x=Axis("lag", "samples"),
        y=Axis("autocorrelation", low=min(-1.2 * white, 1.1 * float(r.min())), high=None),
        layers=(
            Layer(Role.SIMULATED, Form.STEMS, lag, r),
            Layer(Role.OTHER, Form.CURVE, lag, bounds, label="95 % of white ones"),
            Layer(Role.OTHER, Form.CURVE, lag, -bounds),
        ),
        level=0.0,
        height=0.5,
    )


@checked
@dataclass(frozen=True, eq=False)
class Trace(TraceRecord, OfSetup):
    """A time series of one output of the FMU, under a recorded or declared input, or none.

    Args:
        time_s: Times of the samples, shape (n,), s, evenly spaced.
        values: Of the output, shape (n,), in ``unit``.
        input: The driven input of the FMU; empty: none.
        driven: Its recorded times (m,), s, on the clock of ``time_s``, and values (m,); or a
            `Pulse` or `Chirp`; None: no drive.
        further: What drives further inputs, by name, likewise.
        interpolation: Recorded inputs are "held" until the next value or joined ("linear").
        output: The observed output of the FMU; empty: the setup's.
        gain: "one", or "fit": solved for.
        offset: Whether an offset is solved for.
        sigma: Standard deviation of the values, in ``unit``; 0: from the residuals.
        lead_s: Time from the FMU's start to the first sample, s.
        start: "rest": the FMU's start values; "unknown": a state that is solved for, by free
            responses of a linear FMU.
        states: States that decay, two for each mode.
        begin: "first": at the first sample; "found": where the free decay is found to begin,
            without earlier samples.
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

    def ask(
        self, model: DrivenModel, trace: TraceRecord, p: FloatArray, batch: Batch, owner: int
    ) -> RequestedRuns:
        """Numbers of the run under the input, and of that after a pulse.

        Args:
            model: the FMU as the series drives it.
            trace: one of them.
            p: parameters (n,), each in its own unit.
            batch: where runs are asked for.
            owner: which evaluation pays for them.
        """
        values = self.start_values(model, trace, p)
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
        return RequestedRuns(driven=driven, decay=decay, coarse=coarse)

    def read(
        self, trace: TraceRecord, runs: RequestedRuns, decay: FloatArray | None, batch: Batch
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

    def figure_of(self, record: TraceRecord, before: Values, after: Values) -> Figure:
        """A trace with the model, its residuals, and their autocorrelation."""
        return trace_figure(record, before.real, after.real)


def _projected(design: FloatArray, values: FloatArray) -> FloatArray:
    """What columns (n, k) of any size make of values (n,) by least squares."""
    if design.shape[1] == 0:
        return np.zeros(values.size)
    sizes = np.linalg.norm(design, axis=0)
    scaled = design / np.where(sizes > 0.0, sizes, 1.0)
    return np.asarray(scaled @ np.linalg.lstsq(scaled, values, rcond=None)[0])
