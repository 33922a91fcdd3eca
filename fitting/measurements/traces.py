"""Traces: time series of an output of the FMU, as samples or as a demodulator shows them.

Trace: a time series of one output of the FMU, under a recorded or declared input, or none.

    S = g z + o + V c        r = (S - y)/max|y - mean y|        y measured, z simulated

One row per sample. Gain g and offset o of the read-out, and with ``start = "unknown"`` what the
state at the first sample adds, V c, enter linearly: they are solved inside. V (n, states) spans the
free responses of a linear FMU. They are those to a short pulse at its input, begun at different
times before the first sample: whatever state the input can bring about decays as a combination of
these. A ringdown is a trace without an input whose start is unknown.

Demodulated trace: a free decay as a lock-in or an analyser at one frequency shows it over time.

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

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property, partial
from typing import Annotated, ClassVar

import numpy as np
import numpy.typing as npt
from scipy.linalg import lstsq

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.instruments import read_recording
from fitting.campaign.instruments.recording import Recording, Selection
from fitting.fmu.description import FmuVariable
from fitting.fmu.runs import SampledSignal
from fitting.lines.decay_begin import decay_start
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
    residual_points,
    root_mean_square,
    worded,
)
from fitting.measurements.measurement import Values
from fitting.measurements.records import ReadColumn, StatedTable, check_words
from fitting.measurements.residuals import ResidualCurve, mistakes
from fitting.measurements.steps import REFINED_STEPS, Look, StepPlan
from fitting.measurements.time_record import (
    BEGINS,
    DETECTED,
    FIRST,
    RequestedRuns,
    TimeRecord,
    Traces,
    ask_decay,
)
from fitting.measurements.waveform import INTERPOLATIONS, LINEAR, Chirp, Pulse, Recorded, Waveform
from fitting.signal.least_squares import damped_step
from fitting.signal.rotating import (
    SENSED,
    Reference,
    reference,
    rotating_responses,
    shifted_basis,
)
from fitting.signal.roughness import Scatter, rician, scatter_of
from fitting.signal.time_grid import spacing_s
from fitting.signal.window import Window
from fitting.simulate.batch import Batch
from fitting.text.arguments import checked
from fitting.text.arrays import ComplexArray, FloatArray, IntArray, Scalar, as_numbers, both_parts
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind, note
from fitting.text.schema import (
    Count,
    FileName,
    Keys,
    Missing,
    OneOf,
    Refused,
    Switch,
    Text,
    Texts,
    Usually,
    Value,
)
from fitting.text.units import Written, in_unit, sigma_in

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
#: Ends of steps that splines between them rest on at least, and rounding of their number.
FEWEST_ENDS, ROUNDED_STEPS = 5, 1e-9
#: Crossings of its mean that a trace of unknown start needs, for a period.
CROSSINGS = 2


@checked
@dataclass(frozen=True, eq=False)
class Trace(TimeRecord):
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
        left_out: What of its file is not used.
        setup: The observed output and start values; its tones are not used.
        series: Measurements of one series share their setup.

    Raises:
        BadInput: shapes that differ, times that do not rise or are not even, values that are not
            finite or are clipped, an unknown start without an input or without a whole period.
    """

    NOUN = "trace"
    _TOGETHER = Traces

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
        check_words(self, self.source, gain=GAINS, start=STARTS)
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

    @property
    def is_simulated_alone(self) -> bool:
        """Whether its values are those of its run, but for an offset."""
        return self.start == REST and self.gain == ONE

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
        return self._held(edges, times, self.spacing_s / per_sample)

    def _held(self, edges: FloatArray, times: FloatArray, step_s: float) -> SampledSignal:
        """What is held between the edges of steps, and observed at samples, s on its clock."""
        kept, observed = np.empty((edges.size - 1, 0)), np.empty((times.size, 0))
        names, waves = tuple(self.waveforms), self.waveforms.values()
        if names:
            kept = np.stack([wave.means(edges) for wave in waves], axis=1)
            observed = np.stack([wave.at(times) for wave in waves], axis=1)
        return SampledSignal(names, step_s, kept, observed)

    def on_grid(self, grid_s: float) -> tuple[Look, FloatArray] | None:
        """Its run under the input by steps of one length, and where samples are between these.

        Args:
            grid_s: length of a step, s.

        Returns:
            The run, and the samples' times in steps, shape (n,); None: an unknown start.
        """
        if self.start == UNKNOWN:
            return None
        if grid_s not in self._grids:
            lead = self.lead_steps()
            at = np.asarray(
                (lead + np.arange(self.y.size)) * (self.spacing_s / grid_s), dtype=float
            )
            count = max(FEWEST_ENDS, math.ceil(at[-1] * (1.0 - ROUNDED_STEPS)) + 1)
            edges = self.t[0] - lead * self.spacing_s + grid_s * np.arange(count)
            window = Window(tones_hz=(), settle_s=0.0, step_s=grid_s, samples=count)
            self._grids[grid_s] = Look(window, self._held(edges, edges, grid_s), 1), at
        return self._grids[grid_s]

    @cached_property
    def _grids(self) -> dict[float, tuple[Look, FloatArray]]:
        return {}

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
        left, singular = shifted_basis(decay, self.shifts, self.y.size)
        basis = np.array(left[:, : self.states])
        basis[:, singular[: self.states] <= ROUNDING * singular[0]] = 0.0
        return basis

    def ask(
        self,
        values: Mapping[str, Scalar],
        plan: StepPlan | None,
        batch: Batch,
        output: str,
        owner: int,
    ) -> RequestedRuns:
        """Numbers of the run under the input, and of that after a pulse."""
        driven = decay = coarse = None
        steps = 1 if plan is None else plan.per_sample
        if self.is_driven:
            # a late response to a pulse is one of another start, which is unknown anyway
            delay_steps = plan.delay_steps if plan else 0
            if plan and plan.grid_s and (gridded := self.on_grid(plan.grid_s)):
                look, at = gridded
                window = replace(look.window, delay_steps=delay_steps)
                run = batch.ask(values, window, look.signal, output, owner)
                return RequestedRuns(driven=run, at=at)
            window = replace(self.window(), delay_steps=delay_steps)
            driven = batch.ask(values, window, self.signal(steps), output, owner)
            if plan is not None and plan.extrapolated:
                half = self.signal(steps // 2)
                coarse = batch.ask(values, window, half, output, owner)
        if self.start == UNKNOWN:
            decay = ask_decay(self, values, plan, batch, output, owner)
        return RequestedRuns(driven=driven, decay=decay, coarse=coarse)

    def read(
        self, runs: RequestedRuns, decay: FloatArray | None, batch: Batch, output: str
    ) -> tuple[FloatArray, FloatArray]:
        """Values (n,) with the best gain, offset and start; derivatives (n, k)."""
        count = self.y.size
        base, columns = np.zeros(count), []
        observed = runs.under_input(batch, output)
        if observed is not None:
            if self.gain == FIT:
                columns.append(observed)
            else:
                base = observed
        if self.offset:
            columns.append(np.ones(count))
        if decay is not None:
            columns += list(self.free_responses(decay).T)
        design = np.stack(columns, axis=1) if columns else np.empty((count, 0))
        return base + _projected(design, self.y - base), design / self.largest

    def figure(self, before: Values, after: Values) -> Figure:
        """The trace with the model, its residuals, and their autocorrelation."""
        x, count = Axis("time", "s"), self.y.size
        every = slice(None, None, -(-count // DRAWN))
        t, y = self.t[every], self.y[every]
        sigma = np.full(t.size, self.sigma) if self.sigma > 0.0 else None
        shown = compared(
            (x, Axis("output", self.unit)), t, y, before.real[every], after.real[every], sigma
        )
        left = after.real - self.y
        rest = residual_points((x, OF_LARGEST), t, [("", (100.0 * left / self.largest)[every])])
        return worded(
            "trace",
            [[shown], [rest], [autocorrelation(left)]],
            label=self.label,
            trace=self,
            every=every.step,
            begins=self.start != REST,
            rms=100.0 * root_mean_square([left]) / self.largest,
        )


def _projected(design: FloatArray, values: FloatArray) -> FloatArray:
    """What columns (n, k) of any size make of values (n,) by least squares."""
    if design.shape[1] == 0:
        return np.zeros(values.size)
    sizes = np.linalg.norm(design, axis=0)
    scaled = design / np.where(sizes > 0.0, sizes, 1.0)
    return np.asarray(scaled @ np.linalg.lstsq(scaled, values, rcond=None)[0])


#: Lags of the autocorrelation that is drawn, at most.
LAGS = 60


def autocorrelation(left: FloatArray) -> Panel:
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


#: Times, output, input that was recorded, and further inputs by name.
ReadColumns = tuple[
    ReadColumn, ReadColumn, ReadColumn | None, Mapping[str, ReadColumn], tuple[Finding, ...]
]

STEP, PULSE, CHIRP = SIGNALS = ("step", "pulse", "chirp")
#: States that decay after an unknown start, where nothing is written: one mode.
ONE_MODE = 2


@dataclass(frozen=True, kw_only=True)
class WrittenTraceColumns(Keys):
    """Names of a trace's columns where they are not the usual ones (empty)."""

    time: Text = ""
    """Column of times; without it "time"."""
    input: Text = ""
    """Column of the input; without it the input's name."""
    output: Text = ""
    """Column of the output; without it the output's name."""


@dataclass(frozen=True, kw_only=True)
class WrittenSignal(Keys):
    """An input that is declared instead of recorded."""

    kind: Annotated[Text, OneOf(SIGNALS)]
    """A level from a time on ("step") or for a while ("pulse"), or a sine through frequencies
    ("chirp")."""
    level: Value
    """Height of the step or pulse, amplitude of the chirp."""
    at: Value | None = None
    """Begin, on the clock of the trace; without it 0 s."""
    length: Value | None = None
    """(pulse, chirp) duration."""
    start: Value | None = None
    """(chirp) first frequency."""
    stop: Value | None = None
    """(chirp) last frequency."""

    def __post_init__(self) -> None:
        own = {STEP: (), PULSE: ("length",), CHIRP: ("length", "start", "stop")}[self.kind]
        for key in ("length", "start", "stop"):
            if key in own and getattr(self, key) is None:
                raise Refused(f"key '{key}' is missing, wanted for a {self.kind}")
            if key not in own and getattr(self, key) is not None:
                raise Refused(f'has no meaning with kind = "{self.kind}"', key)

    def waveform(self, unit: str | None) -> Waveform:
        """The input in a unit.

        Args:
            unit: of the FMU's input; None: it has none.
        """
        level, at_s = in_unit(self.level, unit), _in(self.at, "s")
        if self.kind == STEP:
            return Pulse(level=level, at_s=at_s)
        if self.kind == PULSE:
            return Pulse(level=level, at_s=at_s, length_s=_in(self.length, "s"))
        return Chirp(
            start_hz=_in(self.start, "Hz"),
            stop_hz=_in(self.stop, "Hz"),
            length_s=_in(self.length, "s"),
            level=level,
            at_s=at_s,
        )


def _in(written: Written | None, unit: str) -> float:
    return 0.0 if written is None else in_unit(written, unit)


@dataclass(frozen=True, kw_only=True)
class TimeTable(StatedTable):
    """A table of a record over time, whose runs begin with it."""

    TRANSIENT: ClassVar[bool] = True

    input: Text | None = None
    """The driven FMU input; without it none."""
    offset: Switch = False
    """Whether an offset of the read-out is solved for, of X and Y as of a leaking reference."""
    sigma: Value | None = None
    """Standard deviation of the samples, of X and Y each, as "1 mV"; without it from the
    residuals."""
    begin: Annotated[Text, OneOf(BEGINS)] = FIRST
    """(free decay) begin at the "first" sample, or where it is "found", without earlier samples."""

    def checks(self, binder: Binder, setup: Setup) -> Iterator[Callable[[], object]]:
        """What examines each name and value by itself, the input as well."""
        yield from super().checks(binder, setup)
        if self.input is not None:
            where = f"{setup.source}: [[{self.TABLE}]] input"
            yield partial(binder.real, self.input, where, ("input",), "driven")


@dataclass(frozen=True, kw_only=True)
class TraceTable(TimeTable):
    """A time series of one output of the FMU, under a recorded or declared input, or none.

    Several of these tables are fitted together.
    """

    TABLE: ClassVar[str] = "trace"
    TOGETHER = Traces

    file: Annotated[FileName, Missing("wanted a table of times and values, each with its unit")]
    """Columns time, output and a recorded input, each with its unit."""
    columns: WrittenTraceColumns = field(default_factory=WrittenTraceColumns)
    """Columns of other than the usual names."""
    further_inputs: Texts = ()
    """Further driven FMU inputs, by columns of their names, as ["Ti2"]."""
    signal: WrittenSignal | None = None
    """A declared input, instead of a column of the file."""
    interpolation: Annotated[Text | None, OneOf(INTERPOLATIONS), Usually(LINEAR)] = None
    """Of a recorded input between samples: "linear", or "held"."""
    gain: Annotated[Text, OneOf(GAINS)] = ONE
    """Of the read-out: "one", or "fit": solved for."""
    lead: Value | None = None
    """Time from the FMU's start to the first sample."""
    start: Annotated[Text, OneOf(STARTS)] = REST
    """State at the start: "rest": the FMU's; "unknown": solved for, of a linear FMU."""
    states: Annotated[Count | None, Usually(ONE_MODE)] = None
    """(unknown start) states that decay, two for each mode."""

    def __post_init__(self) -> None:
        if self.signal is not None and self.input is None:
            raise Refused("wanted together with 'input', the FMU input that is driven", "signal")
        if self.signal is not None and (self.columns.input or self.interpolation):
            key = "columns" if self.columns.input else "interpolation"
            raise Refused("has no meaning for the input together with 'signal'", key)
        if self.further_inputs and self.input is None:
            raise Refused(
                "wanted together with 'input', the first one that is driven", "further_inputs"
            )
        if self.further_inputs and self.start == UNKNOWN:
            raise Refused('has no meaning with start = "unknown"', "further_inputs")
        if self.states is not None and self.start != UNKNOWN:
            raise Refused('has a meaning with start = "unknown" only', "states")
        if self.start == UNKNOWN and self.input is None:
            raise Refused(
                "key 'input' is missing: an unknown start takes the response to a pulse at it"
            )
        if self.begin == DETECTED and (self.start != UNKNOWN or self.signal is not None):
            raise Refused('has a meaning for a free decay, with start = "unknown", only', "begin")
        if self.start == UNKNOWN and self.lead is not None:
            raise Refused('has no meaning with start = "unknown"', "lead")

    def read_columns(self, output: str) -> ReadColumns:
        """Times, output, input and further inputs of the file as they are written; what is unused.

        Args:
            output: name of the output that is seen, where the table names none.

        Raises:
            BadInput: a column or unit that is missing, times that are not an even grid.
        """
        names = self.columns
        named = tuple(filter(None, (names.output, names.input)))
        table = read_recording(self.file, selection=Selection(time=names.time, further=named))
        observed = names.output or self.output or output
        there = map(table.find, (names.time or "time", observed, *self.further_inputs))
        table.check(channel for channel in there if channel is not None)
        time = ReadColumn.of(table, table.column(names.time or "time"), "time (s)").into("s")
        spacing_s(time.values, str(self.file), table.places)
        driven = None
        if self.input is not None and self.signal is None:
            wanted = names.input or self.input
            known = names.input or self.start != UNKNOWN or table.find(wanted) is not None
            if known and self.begin == FIRST:
                driven = ReadColumn.of(table, table.column(wanted), f"{wanted} (V)")
        values = ReadColumn.of(table, table.column(observed), f"{observed} (V)")
        further = {}
        for name in self.further_inputs:  # in that input's unit where it states none
            column = table.column(name)
            where = f"{self.file}: column '{column.name}'"
            further[name] = ReadColumn(table.numbers(column), column.unit or "", where)
        inputs = table.find(names.input or self.input or ""), *map(table.find, further)
        other = table.unused(table.column(names.time or "time"), table.column(observed), *inputs)
        return time, values, driven, further, other

    def checks(self, binder: Binder, setup: Setup) -> Iterator[Callable[[], object]]:
        """What examines each name and value by itself, those of inputs as well."""
        yield from super().checks(binder, setup)
        where = f"{setup.source}: [[{self.TABLE}]]"
        for name in self.further_inputs:
            yield partial(binder.real, name, f"{where} further_inputs", ("input",), "driven")

    def bound(self, binder: Binder, setup: Setup, label: str) -> Trace:
        """The trace in the names and units of the FMU."""
        read = partial(self.read_columns, setup.output)
        time, values, recorded, further, other = self.checked(read, binder, setup)
        variables = binder.variables
        observed = variables[self.output or setup.output]
        driven: tuple[FloatArray, FloatArray] | Waveform | None = None
        if self.input is not None and self.signal is not None:
            driven = self.signal.waveform(variables[self.input].unit)
        elif self.input is not None and recorded is not None:
            # a factor of the one input is solved for, and the FMU has to be linear in it
            if self.gain == FIT and self.start == UNKNOWN and not further:
                with suppress(BadInput):  # in proportion to the input, whatever its unit
                    recorded = recorded.into(variables[self.input].unit)
                driven = np.array(time.values), recorded.values
            else:
                driven = _on_clock(time, binder, variables[self.input], recorded)
        decays = self.start == UNKNOWN and driven is None
        if self.gain == ONE and not decays:  # a free decay has no gain of its own
            if observed.unit is None:
                binder.note_missing_unit(observed)
            try:
                values = values.into(observed.unit)
            except BadInput as error:
                raise BadInput(
                    f'{error}; values that are in proportion to the output want gain = "fit" in '
                    "[[trace]]"
                ) from error
        return Trace(
            time.values,
            values.values,
            input=self.input or "",
            driven=driven,
            further={
                name: _on_clock(time, binder, variables[name], column)
                for name, column in further.items()
            },
            interpolation=self.interpolation or LINEAR,
            gain=self.gain,
            offset=self.offset,
            sigma=sigma_in(self.sigma, values.unit),
            lead_s=_in(self.lead, "s"),
            start=self.start,
            states=self.states or ONE_MODE,
            begin=self.begin,
            label=label,
            unit=values.unit or "1",
            source=str(self.file),
            left_out=other,
            **self.known(binder, setup),
        )


def _on_clock(
    time: ReadColumn, binder: Binder, driver: FmuVariable, column: ReadColumn
) -> tuple[FloatArray, FloatArray]:
    """Times, and values of a column in the unit of its input."""
    if not column.unit:
        names = {"variable": (driver.name,), "unit": (driver.unit or "1",)}
        binder.note(note(Kind.unit_assumed, column.where, names))
    elif driver.unit is None:
        binder.note_missing_unit(driver)
    try:
        return np.array(time.values), column.into(driver.unit).values
    except BadInput as error:
        raise BadInput(
            f"{error}; an input that is in proportion to it, of a linear FMU, wants "
            'gain = "fit" and start = "unknown" in [[trace]]'
        ) from error


#: Shifts reach over this part of the record.
SHARE = 8


#: Amplitudes below this share of the largest are not drawn: the axis is logarithmic.
LOWEST = 1e-9


@checked
@dataclass(frozen=True, eq=False)
class DemodulatedTrace(TimeRecord):
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
        left_out: What of its file is not used.
        setup: The observed output and start values; its tones are not used.
        series: Measurements of one series share their setup.

    Raises:
        BadInput: shapes that differ, times that do not rise or are not even, values that are not
            finite, are negative amplitudes or are clipped, a frequency that is not positive, fewer
            samples than a decay needs.
    """

    NOUN = "demodulated trace"
    _TOGETHER = Traces
    is_demodulated = True

    _: KW_ONLY
    frequency_hz: float
    input: str
    modes: int = 1
    floor: bool = True
    source: str = "demodulated trace"

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
        return super().rows_of(values)

    def share_left(self, rows: FloatArray) -> float:
        """What rows leave, root mean square over the largest modulus; of phasors their distance.

        Args:
            rows: of this record, (rows,).
        """
        if self.is_amplitude:
            return super().share_left(rows * self.weights)
        return super().share_left(rows)

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

    def ask(
        self,
        values: Mapping[str, Scalar],
        plan: StepPlan | None,
        batch: Batch,
        output: str,
        owner: int,
    ) -> RequestedRuns:
        """Numbers of the runs after a pulse: as the record is sampled, and a little slower."""
        # of a second response, which determines what turns forwards
        step_s = self.reference.sensing_step_s
        window = Window(tones_hz=(), settle_s=step_s, step_s=step_s, samples=SENSED)
        sensing = self.pulse(1 if plan is None else plan.per_sample, window=window)
        return RequestedRuns(
            decay=ask_decay(self, values, plan, batch, output, owner),
            further=batch.ask(values, window, sensing, output, owner),
        )

    def read(
        self, runs: RequestedRuns, decay: FloatArray | None, batch: Batch, output: str
    ) -> tuple[ComplexArray, FloatArray]:
        """Values (n,) with the best factors, and derivatives (rows, k)."""
        if decay is None or runs.further is None:
            raise TypeError(f"a demodulated trace follows from two runs, not from {runs!r}")
        # the second response distinguishes what turns forwards
        sensed = batch.samples(runs.further, output)
        columns = rotating_responses(
            decay, sensed, self.shifts, self.reference, self.y.size, self.modes
        )
        if self.is_amplitude:
            size, known = self.largest, self.known_noise
            noise = None if known is None else known / size
            made, design = solved_amplitude(columns, self.y.real / size, self.weights, noise)
            return (size * made).astype(complex), design / self.weights[:, None]
        if self.offset:
            columns = np.column_stack([columns, np.ones(self.y.size)])
        sizes = np.linalg.norm(columns, axis=0)
        unit = columns / np.where(sizes > 0.0, sizes, 1.0)
        values = unit @ lstsq(unit, self.y)[0]
        factors = [both_parts(x) for column in unit.T for x in (column, 1j * column)]
        return values, np.stack(factors, axis=1) / self.largest

    def figure(self, before: Values, after: Values) -> Figure:
        """The trace with the model, its residuals, and their autocorrelation."""
        x = Axis("time", "s")
        every = slice(None, None, -(-self.t.size // DRAWN))
        t = self.t[every]

        def panel(axis: Axis, part: Callable[[Values], FloatArray]) -> Panel:
            shown = (part(values)[every] for values in (self.y, before, after))
            return compared((x, axis), t, *shown)

        floor = LOWEST * self.largest
        size = Axis("amplitude", self.unit, log=True)
        panels = [panel(size, lambda v: np.maximum(np.abs(v), floor))]
        if not self.is_amplitude:
            panels.append(panel(Axis("quadrature X", self.unit), np.real))
        left = self.rows_of(after - self.y)
        parts = [left] if self.is_amplitude else list(np.split(left, 2))
        names = ("",) if self.is_amplitude else ("X", "Y")
        shares = [100.0 * part[every] for part in parts]
        rest = residual_points((x, OF_LARGEST), t, list(zip(names, shares, strict=True)))
        rms = 100.0 * root_mean_square([left])
        rows = [[panel] for panel in (*panels, rest, autocorrelation(parts[0]))]
        return worded("demodulated", rows, label=self.label, trace=self, rms=rms)


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


#: Amplitudes in these are levels, 20 to a factor of ten, of a reference that a decay does not need.
LEVELS = ("dB", "dBm", "dBV", "dBuV", "dBu", "dBc", "dBFS")


@dataclass(frozen=True, kw_only=True)
class WrittenDemodulatedColumns(Keys):
    """Names of a demodulated trace's columns where they are not the usual ones (empty)."""

    time: Text = ""
    """Column of times; without it "time"."""
    X: Text = ""
    """Column of the in-phase part; without it "X"."""
    Y: Text = ""
    """Column of the quadrature; without it "Y"."""
    amplitude: Text = ""
    """Column of amplitudes instead of X and Y, as "R (mV)" or in dB; without it "amplitude"."""
    phase: Text = ""
    """Column of phases next to amplitudes, as "theta (deg)"; without it none."""


@dataclass(frozen=True, kw_only=True)
class DemodulatedTable(TimeTable):
    """A free decay of one output of the FMU, demodulated at a frequency.

    A lock-in amplifier records it, or a spectrum analyser with a span of zero. Several of these
    tables are fitted together.
    """

    TABLE: ClassVar[str] = "demodulated_trace"
    TOGETHER = Traces

    file: Annotated[FileName, Missing("wanted a table of times and X and Y, or of amplitudes")]
    """Columns time and X and Y, or amplitude, each with its unit."""
    frequency: Annotated[Value, Missing('wanted what was demodulated at, as "1.2 MHz"')]
    """Frequency of the demodulator, as "1.2 MHz"."""
    input: Annotated[Text, Missing("wanted the FMU input by which a pulse sets it moving")]
    """The FMU input by which a pulse starts the decay."""
    columns: WrittenDemodulatedColumns = field(default_factory=WrittenDemodulatedColumns)
    """Columns of other than the usual names."""
    modes: Count = 1
    """Number of modes, those nearest to the frequency."""
    floor: Switch = True
    """(amplitudes) whether they have a noise floor: sigma, or from their scatter, or solved for."""

    def __post_init__(self) -> None:
        named = self.columns
        if named.amplitude and (named.X or named.Y):
            raise Refused("is given together with X or Y; wanted one of them", "columns.amplitude")
        if self.modes < 1:
            raise Refused(f"found {self.modes}, wanted 1 or more", "modes")

    def record(self, label: str) -> DemodulatedTrace:
        """Times and values, phasors or amplitudes, in the unit of the file.

        Args:
            label: of the trace.

        Raises:
            BadInput: a column or unit that is missing, times that are not an even grid.
        """
        names = self.columns
        given = Selection(
            time=names.time, amplitude=names.amplitude, phase=names.phase, x=names.X, y=names.Y
        )
        table = read_recording(self.file, selection=given)
        time = ReadColumn.of(table, table.column(names.time or "time"), "time (s)")
        time_s = time.into("s").values
        spacing_s(time_s, str(self.file), table.places)
        amplitudes = names.amplitude or table.find(names.X or "X") is None
        values, unit = self._amplitudes(table) if amplitudes else self._phasors(table)
        if names.phase:
            if not amplitudes:
                raise BadInput(f"{self.file}: a column of phases is given together with X and Y")
            phase = ReadColumn.of(table, table.column(names.phase), "phase (deg)")
            values = values * np.exp(1j * phase.into("rad").values)
        taken = [names.amplitude or "amplitude"] if amplitudes else [names.X or "X", names.Y or "Y"]
        taken += [names.time or "time", names.phase]
        return DemodulatedTrace(
            time_s,
            values,
            left_out=table.unused(*map(table.find, filter(None, taken))),
            frequency_hz=in_unit(self.frequency, "Hz"),
            input=self.input,
            modes=self.modes,
            offset=self.offset,
            floor=self.floor,
            sigma=sigma_in(self.sigma, unit),
            begin=self.begin,
            label=label,
            unit=unit,
            source=str(self.file),
        )

    def _phasors(self, table: Recording) -> tuple[ComplexArray, str]:
        x = ReadColumn.of(table, table.column(self.columns.X or "X"), "X (V)")
        y = ReadColumn.of(table, table.column(self.columns.Y or "Y"), "Y (V)")
        return x.values + 1j * y.into(x.unit).values, x.unit

    def _amplitudes(self, table: Recording) -> tuple[FloatArray, str]:
        if not self.columns.amplitude and table.find("amplitude") is None:
            present = ", ".join(f"'{c.name}'" for c in table.channels)
            raise BadInput(
                f"{self.file}: no columns 'X' and 'Y', nor 'amplitude', among {present}; wanted "
                "them, or their names in columns"
            )
        column = table.column(self.columns.amplitude or "amplitude")
        read = ReadColumn.of(table, column, "amplitude (V)")
        if read.unit in LEVELS:
            return 10.0 ** ((read.values - np.max(read.values)) / 20.0), "1"
        return read.values, read.unit
