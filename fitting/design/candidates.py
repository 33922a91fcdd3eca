"""Candidates: further measurements of the campaign's kinds, within the instrument's limits.

Tones are experiments in place of the campaign's. Where the amplitude is proportional to the drive
level one level is simulated, and the others follow.

A sweep is one at each combination of values of the controls. Amplitudes, `[control_sweep]`, have
one row for each point and a real scale; complex values, `[complex_control_sweep]`, a row for each
quadrature, a complex gain, a background and a cable:

    A = chi |P|                          S = e (a P + b + b' x)       e = exp(-i 2 pi (u - u0) tau)

P is the response of the FMU, wirings as in `fitting.measurements.complex_sweep`. Gains, scales and
backgrounds are unknown in a new sweep; where they enter derivatives they are taken to be those of
the sweep so far whose scale is the median.

A recording repeats a trace of the campaign, its start or its drive, over another length or with
another spacing. Where gains, offsets and free responses are solved inside (columns D, unknowns c),
the expected values y = S(p0) follow from the trace so far at the samples that both have in common,

    S = S0 + D c,      c = argmin |S - S_so_far| there

A shorter recording is the beginning of the longest with its spacing: both rest on the same runs.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
from scipy.linalg import lstsq

from fitting import Drive
from fitting.campaign import Experiment
from fitting.design.information import DataSoFar, Place, Rows
from fitting.design.limits import SWEEPS, TRACES, Limits, combinations, longest_s, required
from fitting.design.result import DriveChoice, Recording
from fitting.extension.problem import planning_points
from fitting.extension.records import BoundCampaign, Prediction, TimeRecord
from fitting.measurements.complex_sweep import DELAY, ComplexSweep
from fitting.measurements.control_sweep import ControlSweep
from fitting.measurements.dataset import Dataset, measurements_of
from fitting.measurements.measurement import Values
from fitting.measurements.plan import Plan
from fitting.measurements.response_curve import ResponseCurve, plan_curve
from fitting.signal.time_grid import LEAST_SAMPLES, ROUNDED
from fitting.simulate.batch import Batch, answered, together
from fitting.text.arrays import ComplexArray, FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.units import convert

#: Offsets of a tone from the middle of a resonance, at most: a finer grid is thinned to it.
MOST_OFFSETS = 24
#: Choices of tones, and sweeps or recordings, at most: each is simulated.
MOST_SETUPS, MOST_CANDIDATES = 20_000, 1000
#: Relative departure from proportionality up to which a model counts as linear in the drive level.
LINEAR = 1e-6
#: Prior of the logarithm of a scale, and of a phase (rad), that all new measurements share.
ANY_SCALE, ANY_PHASE = 10.0, math.pi / math.sqrt(3.0)
#: Samples for each unknown that is solved inside, at least.
OF_EACH = 4
#: Phase step of values before they are known: a tone that repeats itself at no sample.
TURN = 2.4
#: Largest denominator of the ratio of two spacings that have samples in common.
DENOMINATOR = 1000
#: Share of the largest value by which a recording may be off the trace so far; directions of what
#: is solved inside below this share of the largest do not follow from the samples in common.
OFF, ALIKE = 1e-3, 1e-8
#: A number of spacings is whole up to this.
WHOLE = 1e-6


class Candidates:
    """Choices of one kind of measurement, and their rows at any place: a base class.

    `shared` are prior standard deviations of what they have in common, of which the data so far
    know nothing. `linear`: amplitudes are proportional to the drive level. `noise` (c,) is that of
    each, None where the limits state it.

    Args:
        data: so far; the first campaign is to be continued.
        limits: of the instrument.
    """

    shared: Sequence[float] = ()
    linear = True
    noise: FloatArray | None = None

    def __init__(self, data: DataSoFar, limits: Limits) -> None:
        self.data, self.limits = data, limits
        self.choices = self.choices_of(data.bound, limits)

    @staticmethod
    def choices_of(bound: BoundCampaign, limits: Limits) -> tuple[DriveChoice, ...]:
        """Every choice within the limits, in a fixed order.

        Args:
            bound: the campaign that is to be continued.
            limits: of the instrument.

        Raises:
            BadInput: nothing lies within the limits, or too much does.
        """
        raise NotImplementedError

    def rows(self, place: Place) -> list[Rows]:
        """All of them at a place, those of one length together.

        Args:
            place: of the parameters.
        """
        raise NotImplementedError


def candidates_of(data: DataSoFar, limits: Limits, place: Place) -> Candidates:
    """The candidates within limits.

    Args:
        data: so far; the first campaign is to be continued.
        limits: of the instrument.
        place: where proportionality is tested, and noise that is not stated is estimated.

    Raises:
        BadInput: nothing lies within the limits, or too much does.
    """
    if limits.sweeps is not None:
        return SweepCandidates(data, limits)
    kind = ToneCandidates if limits.traces is None else RecordingCandidates
    return kind(data, limits, place)


# --- tones --------------------------------------------------------------------------------------


def levels_and_more(
    source: Drive, tones: int, level: float, settings: Mapping[str, Scalar]
) -> dict[str, Scalar]:
    """What a choice sets besides its tones: drive amplitudes (zero of tones that are not driven).

    Args:
        source: the campaign's drive.
        tones: that are driven at once.
        level: factor on the campaign's drive level.
        settings: further settings, in the FMU's units.
    """
    names = source.amplitude_names if source.kind == "tones" else ()
    amplitudes = {name: level * source.amplitude * (k < tones) for k, name in enumerate(names)}
    return {**amplitudes, **settings}


def base_settings(bound: BoundCampaign) -> dict[str, Scalar]:
    """What stays as in the last experiment, with what drifts at its latest value.

    Args:
        bound: the campaign that is to be continued.
    """
    base: dict[str, Scalar] = {}
    if bound.experiments:
        base.update(bound.experiments[-1].settings)
    elif bound.sweep is not None:
        base.update(bound.sweep.settings)
    return base | {name: after for name, (_, after) in bound.drift.ends.items()}


class ToneCandidates(Candidates):
    """Tones around the resonances.

    Args:
        data: so far; the first campaign is to be continued.
        limits: of the instrument.
        place: where proportionality is tested.
    """

    def __init__(self, data: DataSoFar, limits: Limits, place: Place) -> None:
        super().__init__(data, limits)
        self.shared = [ANY_PHASE] * limits.phases
        # levels vary slowest
        each, levels = len(self.choices) // len(limits.levels), limits.levels
        self._data = self.measured(self.choices[:each])
        self._factors = np.array(levels) / levels[0]
        if len(levels) > 1:
            ends = (self._data, self.measured(self.choices[-each:]))
            below, above = (np.abs(self._values(d, place)[0]) for d in ends)
            off = np.abs(above - self._factors[-1] * below)
            self.linear = bool(np.all(off <= LINEAR * self._factors[-1] * below))
        if not self.linear:
            self._data, self._factors = self.measured(self.choices), np.ones(1)

    @staticmethod
    def choices_of(bound: BoundCampaign, limits: Limits) -> tuple[DriveChoice, ...]:
        """Tones on the instrument's grid, every output, level and value of further settings."""
        step, places = limits.frequency_step_hz, []
        reach = math.floor(limits.farthest_hz / step + 1e-9)
        stride = max(1, math.ceil((2 * reach + 1) / MOST_OFFSETS))
        offsets = [k for k in range(-reach, reach + 1) if k % stride == 0]
        for centre, chosen in itertools.product(
            limits.centres_hz, itertools.combinations(offsets, limits.tones)
        ):
            low, high = chosen[0], chosen[-1]
            spaced = (high - low) * step >= limits.least_spacing_hz * (1.0 - 1e-9)
            around = low < 0 < high or not limits.both_sides
            tones = tuple((round(centre / step) + k) * step for k in chosen)
            if tones[0] > 0.0 and (limits.tones == 1 or (spaced and around)):
                places.append((centre, tones))
        combined = combinations(limits.settings)
        count = len(places) * len(limits.outputs) * len(limits.levels) * len(combined)
        if not count:
            raise BadInput(
                f"{bound.path}: no drive frequencies lie within the limits: step {step:g} Hz, "
                f"spacing {limits.least_spacing_hz:g} Hz, farthest {limits.farthest_hz:g} Hz; "
                "wanted a farthest detuning of several steps"
            )
        if count > MOST_SETUPS:
            raise BadInput(
                f"{bound.path}: {count} setups lie within the limits, wanted at most "
                f"{MOST_SETUPS}: a coarser frequency_step, or fewer levels, outputs or settings"
            )
        return tuple(
            DriveChoice(centre_hz=c, tones_hz=tones, output=output, level=level, settings=settings)
            for level, (c, tones), output, settings in itertools.product(
                limits.levels, places, limits.outputs, combined
            )
        )

    def measured(self, choices: Sequence[DriveChoice]) -> Dataset:
        """Choices as experiments with peaks of one; of the other data only the scale stays.

        Args:
            choices: of tones.
        """
        bound, source, experiments = self.data.bound, self.data.bound.setup.drive, []
        base, where = base_settings(bound), f"{bound.path}: [drive] frequencies"
        for k, choice in enumerate(choices, 1):
            tones = choice.tones_hz
            settings = base | levels_and_more(source, len(tones), choice.level, choice.settings)
            if source.kind == "tones":
                for name, tone in zip(source.frequency_names, tones, strict=False):
                    settings[name] = convert(tone, "Hz", source.tone_unit, where=where)
            read = tuple(line.frequency_hz(tones) for line in self.limits.lines)
            ones = np.ones(len(read or tones))
            experiments.append(
                Experiment(
                    label=f"setup {k}",
                    settings=settings,
                    tones_hz=tones,
                    peaks_v=ones,
                    sigmas_v=0.0 * ones,
                    floor_v=0.0,
                    spectrum=None,
                    lines_hz=read,
                    output=choice.output,
                    phases_rad=0.0 * ones if self.limits.phases else None,
                    unknown="none",
                )
            )
        sweep = None if bound.sweep is None else replace(bound.sweep, use="scale")
        made = replace(bound, experiments=tuple(experiments), sweep=sweep, measurements={})
        return Dataset(measurements_of(made, self.data.series))

    def rows(self, place: Place) -> list[Rows]:
        """All choices at a place."""
        here, derivatives = self._values(self._data, place, self.limits.setting_sigmas)
        # of a linear model the other levels follow
        values = np.concatenate([factor * here for factor in self._factors])
        moved = np.concatenate([factor * derivatives for factor in self._factors])
        n = place.x.size
        columns = [values, 1j * values] if self.limits.phases else [values]
        return [
            Rows(
                values=values,
                by_x=moved[..., :n],
                shared=np.stack(columns, axis=-1),
                inside=moved[..., :0],
                errors=moved[..., n:],
            )
        ]

    def _values(
        self, data: Dataset, place: Place, errors: Mapping[str, float] | None = None
    ) -> tuple[Values, Values]:
        """Scaled values of all lines that are read, (c, lines), and their derivatives."""
        here, around, nodes = self.data.moved(place, data, errors or {})
        shape = (len(data.tones[0].experiments), -1)
        values, *moved = (point.scaled[0].reshape(shape) for point in (here, *nodes))
        return values, around.quotients(moved)


# --- whole sweeps -------------------------------------------------------------------------------


def frequencies_hz(choice: DriveChoice) -> FloatArray:
    """Frequencies of a sweep, (points,), Hz.

    Args:
        choice: of a sweep.
    """
    first_hz, last_hz = choice.tones_hz
    return np.linspace(first_hz, last_hz, choice.points)


class SweepCandidates(Candidates):
    """Sweeps at values of the controls, all of the same frequencies."""

    def __init__(self, data: DataSoFar, limits: Limits) -> None:
        super().__init__(data, limits)
        kind = required(data.bound, SWEEPS).kind.within(data.bound.setup, data.series)
        self.kind: ControlSweep | ComplexSweep = kind
        # of the scale, or of the modulus and phase of the gain, so many are those of all
        if isinstance(kind, ControlSweep):
            self._of_all = int(kind.scaled_by == "shared")
        else:
            last = kind.records[-1]
            self._of_all = (2 - last.restarted) * last.shared
        self.shared = [ANY_SCALE, ANY_PHASE][: self._of_all]
        self.frequency_hz = frequencies_hz(self.choices[0])
        # few runs for each sweep where the FMU is linear
        model, points = data.model(data.problem.alternatives[0]), planning_points(data.parameters)
        for choice in self.choices:
            curve = ResponseCurve(model, choice.settings, choice.output)
            plan = plan_curve(curve, self.frequency_hz, points, data.planned.workers)
            model = replace(model, plan=plan)
        self.plan = model.plan

    @staticmethod
    def choices_of(bound: BoundCampaign, limits: Limits) -> tuple[DriveChoice, ...]:
        """A sweep at each combination of the controls."""
        sweeps, like = limits.sweeps, required(bound, SWEEPS)
        combined = [] if sweeps is None else combinations(sweeps.controls)
        if sweeps is None or len(combined) > MOST_CANDIDATES:
            raise BadInput(
                f"{bound.path}: {len(combined)} sweeps lie within the limits, wanted at most "
                f"{MOST_CANDIDATES}: fewer values in [design] sweeps"
            )
        [centre_hz], half = limits.centres_hz, 0.5 * sweeps.span_hz
        return tuple(
            DriveChoice(
                centre_hz=centre_hz,
                tones_hz=(centre_hz - half, centre_hz + half),
                output=limits.outputs[0],
                level=1.0,
                settings=like.with_controls(controls),
                points=sweeps.points,
            )
            for controls in combined
        )

    def rows(self, place: Place) -> list[Rows]:
        """All sweeps at a place."""
        data, kind, u = self.data, self.kind, self.frequency_hz
        around = data.around(place)
        xs = [place.x, *around.nodes]
        table, batch = data.table(xs), Batch()
        model = replace(data.model(place.alternative), plan=self.plan)
        curves = [ResponseCurve(model, c.settings, c.output) for c in self.choices]
        task = together([curve.predict(table, u, batch) for curve in curves])
        responses = np.stack(answered(task, batch, data.planned.workers), axis=1)  # (nodes, c, m)
        plan = data.planned.plans[data.series]
        [now] = data.predicted(kind, place, [place.x], plan)
        delay = [k for k, q in enumerate(data.parameters) if q.role == DELAY]
        coefficients = self._coefficients(now)

        def columns(h: ComplexArray, p: FloatArray) -> Values:
            """What the coefficients multiply, (c, m, k), of responses (c, m)."""
            if isinstance(kind, ControlSweep):
                return np.asarray(np.abs(h)[..., np.newaxis])
            curve = kind.records[-1]
            delay_s = float(p[delay[0]]) if curve.delay_s is None else curve.delay_s
            middle_hz = 0.5 * float(u[0] + u[-1])
            return np.stack([curve.wiring.design(u, each, delay_s, middle_hz) for each in h])

        made = [columns(h, p) for h, p in zip(responses, table, strict=True)]
        here, *nodes = (each @ coefficients for each in made)
        gain = coefficients[0] * made[0][..., :1]
        if isinstance(kind, ControlSweep):
            rectified = kind.rectified and not kind.logarithmic
            own = [gain] if kind.scaled_by != "none" else []
        else:
            rectified, background = False, made[0][..., 1:]
            own = [gain, 1j * gain, background, 1j * background]
        none = here[..., :0, np.newaxis].reshape(*here.shape, 0)
        nothing = np.zeros((*here.shape, 1))  # new sweeps say nothing of the scale so far
        return [
            Rows(
                values=here,
                by_x=around.quotients(nodes),
                shared=np.concatenate([nothing, *own[: self._of_all]], axis=-1),
                inside=np.concatenate([none, *own[self._of_all :]], axis=-1),
                errors=none,
                rectified=rectified,
            )
        ]

    def _coefficients(self, now: Prediction) -> Values:
        """Scale (1,), or gain and background (k,), of the sweep so far whose scale is the median.

        The slope of a background belongs to the middle and the span of its sweep: it is written for
        those of the new one.
        """
        kind, u = self.kind, self.frequency_hz
        if isinstance(kind, ControlSweep):
            shared, values = kind.scale(now), np.asarray(now.values, dtype=float)
            scaled = kind.scaled(now, 1.0 if shared is None else shared.value)
            return np.array([np.median(scaled[values > 0.0] / values[values > 0.0])])
        order = np.argsort([abs(solved.coefficients[0]) for solved in now.solved])
        k = int(order[(len(order) - 1) // 2])
        result, first = np.array(now.solved[k].coefficients), kind.records[0].u_hz
        if result.size > 2:
            by_hz = result[2] / (0.5 * float(np.ptp(kind.records[k].u_hz)))
            result[1] += by_hz * 0.5 * float(u[0] + u[-1] - first[0] - first[-1])
            result[2] = by_hz * 0.5 * float(np.ptp(u))
        return result


# --- recordings over time -----------------------------------------------------------------------


def recording_of(choice: DriveChoice) -> Recording:
    """The recording of a choice of one.

    Args:
        choice: of a recording.
    """
    if choice.recording is None:
        raise TypeError(f"no recording: {choice!r}")
    return choice.recording


class RecordingCandidates(Candidates):
    """Recordings that repeat traces of the campaign.

    The noise of a sample is the stated one, else what the traces so far leave at a place.

    Args:
        data: so far; the first campaign is to be continued.
        limits: of the instrument, with traces.
        place: where unstated noise is estimated.
    """

    def __init__(self, data: DataSoFar, limits: Limits, place: Place) -> None:
        super().__init__(data, limits)
        like = required(data.bound, TRACES)
        self.kind = like.kind.within(data.bound.setup, data.series)
        self._old = dict(zip(like.labels, self.kind.records, strict=True))
        self._plans: dict[str, Plan] = {}
        labels = [recording_of(c).trace for c in self.choices]
        sigmas = dict.fromkeys(labels, limits.noise_floor_v)
        for label in sigmas if limits.noise_floor_v == 0.0 else ():
            record = self._old[label]
            sigmas[label] = record.sigma
            if record.sigma == 0.0:
                rest = _stacked(self._predicted(record, place, [place.x])[0].values - record.y)
                dof = max(1, rest.size - record.solved_inside - place.x.size)
                sigmas[label] = math.sqrt(float(rest @ rest) / dof)
        self.noise = np.array([sigmas[label] for label in labels])

    @staticmethod
    def choices_of(bound: BoundCampaign, limits: Limits) -> tuple[DriveChoice, ...]:
        """Every trace with every length and spacing; those of one spacing follow each other."""
        traces, like, recordings = limits.traces, required(bound, TRACES), []
        if traces is None:
            return ()
        for record in like.repeatable(traces.of, "limits: traces"):
            least = max(LEAST_SAMPLES, OF_EACH * record.solved_inside)
            lengths_s = [s for s in traces.lengths_s if s <= longest_s(record) * (1.0 + WHOLE)]
            for spacing_s in traces.spacings_s[record.label]:
                counts = {math.floor(length_s / spacing_s + WHOLE) + 1 for length_s in lengths_s}
                recordings += [
                    (record, Recording(trace=record.label, spacing_s=spacing_s, samples=samples))
                    for samples in sorted(counts)
                    if least <= samples <= traces.samples
                ]
        if not recordings:
            raise BadInput(
                f"{bound.path}: [design] traces: no recording lies within the limits: wanted "
                f"lengths and spacings of {LEAST_SAMPLES} to {traces.samples} samples, of which "
                "recorded inputs allow no longer ones than they are, and a start that is solved "
                f"for no fewer than {OF_EACH} for each unknown"
            )
        if len(recordings) > MOST_CANDIDATES:
            raise BadInput(
                f"{bound.path}: [design] traces: {len(recordings)} recordings lie within the "
                f"limits, wanted at most {MOST_CANDIDATES}: fewer lengths or spacings"
            )
        return tuple(
            DriveChoice(
                centre_hz=limits.centres_hz[0],
                tones_hz=(),
                output=like.kind.output_of(record),
                level=1.0,
                settings={},
                recording=recording,
            )
            for record, recording in recordings
        )

    def rows(self, place: Place) -> list[Rows]:
        """All recordings at a place, each by itself: no value where a fit would refuse it."""
        result = []
        wanted = [recording_of(choice) for choice in self.choices]
        for _, each in itertools.groupby(wanted, key=lambda r: (r.trace, r.spacing_s)):
            mine = list(each)
            result += self._of_one_spacing(mine, max(mine, key=lambda r: r.samples), place)
        return result

    def _of_one_spacing(
        self, recordings: Sequence[Recording], longest: Recording, place: Place
    ) -> list[Rows]:
        """Recordings of one trace and spacing, of which the longest is simulated."""
        old, index = self._old[longest.trace], np.arange(longest.samples)
        # values that no fit refuses, until those that it begins with are known
        tone = np.exp(1j * TURN * index)
        record = replace(
            old,
            time_s=float(old.t[0]) + index * longest.spacing_s,
            values=tone if old.is_demodulated else tone.real,
            begin="first",
            label=f"next {longest.trace} at {longest.spacing_s!r} s",
        )
        values = self._expected(old, record, place)
        parts = dict[int, TimeRecord]()
        for each in recordings:
            n = each.samples
            with suppress(BadInput):  # of a recording that a fit would refuse
                parts[n] = replace(record, time_s=record.t[:n], values=values[:n])
        by_x: Values = np.zeros((1, place.x.size))
        inside: Values = np.zeros((1, 0))
        if parts:
            around = self.data.around(place)
            xs = [place.x, *around.nodes]
            here, *nodes = self._predicted(parts[max(parts)], place, xs)
            by_x, inside = around.quotients([node.values for node in nodes]), _design(here)
        made = []
        for each in recordings:
            n = each.samples if each.samples in parts else 1
            made.append(
                Rows(
                    values=values[None, :n] * (each.samples in parts),
                    by_x=by_x[None, :n],
                    shared=np.zeros((1, n, 1)),
                    inside=inside[None, :n],
                    errors=np.zeros((1, n, 0)),
                )
            )
        return made

    def _predicted(
        self, record: TimeRecord, place: Place, xs: Sequence[FloatArray]
    ) -> list[Prediction]:
        """Predictions by the communication step of a record, which is planned once."""
        kind: Any = self.kind.of_records((record,))
        plan = self._plans.setdefault(record.label, self.data.planned.plans[self.data.series])
        if plan.step_plan(kind.key(record)) is None:
            model = self.data.model(self.data.problem.alternatives[0])
            points = planning_points(self.data.parameters)
            plan = self._plans[record.label] = kind.refined(
                model, points, self.data.planned.workers
            )
        return self.data.predicted(kind, place, xs, plan)

    def _expected(self, old: TimeRecord, record: TimeRecord, place: Place) -> Values:
        """Values (n,) of a recording that begins as the trace so far did."""
        [new] = self._predicted(record, place, [place.x])
        design = _design(new)
        if not design.shape[1]:
            return new.values
        where = f"{self.data.bound.path}: [design] traces"
        # samples at the same times after the start, by their numbers in both
        ratio = old.spacing_s / record.spacing_s
        simple = Fraction(ratio).limit_denominator(DENOMINATOR)
        off = abs(ratio / float(simple) - 1.0) * old.y.size if simple else math.inf
        count = 0
        if off <= ROUNDED:
            ends = (old.y.size - 1) // simple.denominator, (record.y.size - 1) // simple.numerator
            count = min(ends) + 1
        if count < design.shape[1]:
            raise BadInput(
                f"{where}: samples {record.spacing_s:.9g} s apart have {count} in common with "
                f"'{old.label}', {old.spacing_s:.9g} s apart; wanted spacings that are multiples "
                "or parts of these, and a longer recording"
            )
        index = np.arange(count, dtype=np.intp)
        mine = index * simple.numerator
        [so_far] = self._predicted(old, place, [place.x])
        wanted = _stacked(so_far.values[index * simple.denominator] - new.values[mine])
        columns = _stacked(design[mine])
        c, *_, singular = lstsq(columns, wanted)
        left = float(np.max(np.abs(columns @ c - wanted)))
        largest = float(np.max(np.abs(so_far.values)))
        if singular[-1] < ALIKE * singular[0] or left > OFF * largest:
            raise BadInput(
                f"{where}: the samples that a recording every {record.spacing_s:.9g} s has in "
                f"common with '{old.label}' do not determine how it begins; wanted a spacing that "
                "is nearer to that one's, a multiple or a part of it"
            )
        return np.asarray(new.values + design @ c)


def _stacked(values: Values) -> FloatArray:
    """Real values as they are, of complex ones all real parts, then all imaginary ones."""
    flat = np.concatenate([values.real, values.imag]) if np.iscomplexobj(values) else values.real
    return np.asarray(flat, dtype=float)


def _design(prediction: Prediction) -> Values:
    """Columns of what is solved inside one recording that contain information, of length one."""
    design = prediction.solved[0].design
    sizes = np.linalg.norm(design, axis=0)
    columns = np.asarray(design[:, sizes > 0.0] / sizes[sizes > 0.0])
    n = prediction.values.size  # of complex values all real parts, then all imaginary ones
    is_complex = np.iscomplexobj(prediction.values)
    return np.asarray(columns[:n] + 1j * columns[n:]) if is_complex else columns
