"""Recordings over time as next measurements: how long, how finely sampled, begun as which trace.

A new recording repeats a trace of the campaign, its start or its drive, over another length or with
another spacing. Where gains, offsets and free responses are solved inside (columns D, unknowns c),
the expected values y = S(p0) follow from the trace so far at the samples that both have in common,

    S = S0 + D c,      c = argmin |S - S_so_far| there

A shorter recording is the beginning of the longest with its spacing: both rest on the same runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import groupby

import numpy as np
from scipy.linalg import lstsq

from fitting.design.continued import MOST_CANDIDATES, TRACES, longest_s, repeatable, required
from fitting.design.information import Place, Rows, Series
from fitting.design.limits import Limits
from fitting.design.result import DriveChoice, Recording
from fitting.extension.problem import planning_points
from fitting.extension.records import BoundCampaign, Prediction, TimeRecord
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.measurement import Values
from fitting.signal.time_grid import LEAST_SAMPLES, ROUNDED
from fitting.simulate.batch import Batch, answered
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.errors import BadInput

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


def recording_of(choice: DriveChoice) -> Recording:
    """The recording of a choice of one."""
    if choice.recording is None:
        raise TypeError(f"no recording: {choice!r}")
    return choice.recording


def recording_choices(bound: BoundCampaign, limits: Limits) -> tuple[DriveChoice, ...]:
    """Every recording within the limits; those of one trace and spacing follow each other.

    Args:
        bound: the campaign that is to be continued.
        limits: with traces.

    Raises:
        BadInput: no recording, or too many, lie within the limits.
    """
    traces, like = limits.traces, required(bound, TRACES)
    if traces is None:
        return ()
    recordings = []
    for record in repeatable(like, traces.of, "limits: traces"):
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
            f"{bound.path}: [design] traces: no recording lies within the limits: wanted lengths "
            f"and spacings of {LEAST_SAMPLES} to {traces.samples} samples, of which recorded "
            "inputs allow no longer ones than they are, and a start that is solved for no fewer "
            f"than {OF_EACH} for each unknown"
        )
    if len(recordings) > MOST_CANDIDATES:
        raise BadInput(
            f"{bound.path}: [design] traces: {len(recordings)} recordings lie within the limits, "
            f"wanted at most {MOST_CANDIDATES}: fewer lengths or spacings"
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


class RecordingCandidates:
    """Recordings that repeat traces of the campaign; `noise` (c,) of a sample of each.

    It is the stated one, else what the traces so far leave at a place.

    Args:
        data: the campaign that is to be continued.
        limits: of the instrument, with traces.
        place: where unstated noise is estimated.
    """

    linear = True

    def __init__(self, data: Series, limits: Limits, place: Place) -> None:
        self.data, self.like = data, required(data.bound, TRACES)
        self.choices = recording_choices(data.bound, limits)
        self._planned: dict[str, DrivenModel] = {}
        labels = [recording_of(c).trace for c in self.choices]
        sigmas = dict.fromkeys(labels, limits.noise_floor_v)
        for label in sigmas if limits.noise_floor_v == 0.0 else ():
            record = self.like.record(label)
            sigmas[label] = record.sigma
            if record.sigma == 0.0:
                rest = _stacked(self._so_far(record, place) - record.y)
                dof = max(1, rest.size - record.solved_inside - place.x.size)
                sigmas[label] = math.sqrt(float(rest @ rest) / dof)
        self.noise: FloatArray | None = np.array([sigmas[label] for label in labels])

    def rows(self, place: Place) -> list[Rows]:
        """All recordings at a place, each by itself: no value where a fit would refuse it."""
        groups = groupby(self.choices, key=lambda c: (c.recording.trace, c.recording.spacing_s))  # type: ignore[union-attr]
        return [rows for _, mine in groups for rows in self._of_one_spacing(list(mine), place)]

    def _of_one_spacing(self, choices: Sequence[DriveChoice], place: Place) -> list[Rows]:
        """Recordings of one trace and spacing, of which the longest is simulated."""
        requested = max((recording_of(c) for c in choices), key=lambda r: r.samples)
        old = self.like.record(requested.trace)
        index = np.arange(requested.samples)
        tone = np.exp(1j * TURN * index)
        record = replace(
            old,
            time_s=float(old.t[0]) + index * requested.spacing_s,
            values=tone if old.is_demodulated else tone.real,
            begin="first",
            label=f"next {requested.trace} at {requested.spacing_s!r} s",
        )
        values = self._expected(old, record, place)
        parts: list[TimeRecord | None] = []
        for choice in choices:
            count = recording_of(choice).samples
            try:
                parts.append(replace(record, time_s=record.t[:count], values=values[:count]))
            except BadInput:  # a fit would refuse it
                parts.append(None)
        longest = max((p for p in parts if p is not None), key=lambda p: p.y.size, default=None)
        around = self.data.around(place)
        by_x: Values = np.zeros((1, place.x.size))
        inside: Values = np.zeros((1, 0))
        if longest is not None:
            table = self.data.parameters([place.x, *around.nodes])
            here, *nodes = self._predicted(longest, place, table)
            by_x, inside = around.quotients([node.values for node in nodes]), _design(here)
        sizes = [0 if part is None else part.y.size for part in parts]
        return [
            Rows(
                values=values[None, :n] if n else np.zeros((1, 1)),
                by_x=by_x[None, :n] if n else np.zeros((1, 1, place.x.size)),
                shared=np.zeros((1, n or 1, 1)),
                inside=inside[None, :n] if n else np.zeros((1, 1, 0)),
                errors=np.zeros((1, n or 1, 0)),
            )
            for n in sizes
        ]

    def _prediction(
        self, record: TimeRecord, model: DrivenModel, table: FloatArray
    ) -> list[Prediction]:
        batch = Batch()
        task = self.like.kind.of_records((record,)).predict(model, table, batch)
        return answered(task, batch, self.data.workers)

    def _so_far(self, record: TimeRecord, place: Place) -> Values:
        """A trace so far as the model has it at a place."""
        model = self.data.model(place.alternative)
        return self._prediction(record, model, self.data.parameters([place.x]))[0].values

    def _predicted(self, record: TimeRecord, place: Place, table: FloatArray) -> list[Prediction]:
        """Predictions by the communication step of a recording, which is planned once."""
        if record.label not in self._planned:
            points = planning_points(self.data.bound.parameters)
            model = self.data.model(self.data.bound.alternatives[0])
            kind = self.like.kind.of_records((record,))
            plan = kind.refined(model, points, self.data.workers)
            self._planned[record.label] = replace(model, plan=plan)
        model = replace(self._planned[record.label], alternative=place.alternative)
        return self._prediction(record, model, table)

    def _expected(self, old: TimeRecord, record: TimeRecord, place: Place) -> Values:
        """Values (n,) of a recording that begins as the trace so far did."""
        [new] = self._predicted(record, place, self.data.parameters([place.x]))
        design = _design(new)
        if not design.shape[1]:
            return new.values
        where = f"{self.data.bound.path}: [design] traces"
        theirs, mine = _in_common(old, record, where)
        if mine.size < design.shape[1]:
            raise BadInput(
                f"{where}: samples {record.spacing_s:.9g} s apart have {mine.size} in common with "
                f"'{old.label}', {old.spacing_s:.9g} s apart; wanted spacings that are multiples "
                "or parts of these, and a longer recording"
            )
        measured = self._so_far(old, place)
        columns, wanted = _stacked(design[mine]), _stacked(measured[theirs] - new.values[mine])
        c, *_, singular = lstsq(columns, wanted)
        off = float(np.max(np.abs(columns @ c - wanted)))
        if singular[-1] < ALIKE * singular[0] or off > OFF * float(np.max(np.abs(measured))):
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


def _in_common(old: TimeRecord, new: TimeRecord, where: str) -> tuple[IntArray, IntArray]:
    """Samples at the same times after the start, by their numbers in both.

    Raises:
        BadInput: the ratio of the spacings is no simple one.
    """
    ratio = old.spacing_s / new.spacing_s
    simple = Fraction(ratio).limit_denominator(DENOMINATOR)
    off = abs(ratio / float(simple) - 1.0) * old.y.size if simple else math.inf
    if off > ROUNDED:
        raise BadInput(
            f"{where}: a spacing of {new.spacing_s:.9g} s has no samples in common with that of "
            f"'{old.label}', {old.spacing_s:.9g} s; wanted a multiple or a part of it"
        )
    count = min((old.y.size - 1) // simple.denominator, (new.y.size - 1) // simple.numerator) + 1
    index = np.arange(count, dtype=np.intp)
    return index * simple.denominator, index * simple.numerator
