"""Recordings over time as next measurements: how long, how finely sampled, begun as which trace.

A new recording repeats a trace of the campaign, its start or its drive, over another length or with
another spacing. Where gains, offsets and free responses are solved inside (columns D, unknowns c),
the values y = S(p0) that are expected follow from what the trace so far shows at the samples that
both have in common,

    S = S0 + D c,      c = argmin |S - S_so_far| there

and what the new rows say of the parameters is that of the rows that a fit would have,

    r(p) = (1 - D D^+)(S(p) - y),      F = (dr/dp)^T (dr/dp)/sigma^2

by central differences. A shorter recording is the beginning of the longest with its spacing: both
rest on the same runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import groupby
from typing import Any

import numpy as np
from scipy.linalg import lstsq

from fitting.design.candidates import Limits
from fitting.design.information import Place, Series
from fitting.design.result import DriveChoice, Recording
from fitting.extension.problem import (
    SMALLEST_SIGMA,
    central,
    planning_points,
    search_bounds,
    to_model,
)
from fitting.extension.records import BoundCampaign, Prediction, Recorded, TimeRecord, TraceRecord
from fitting.measurements.demodulated.record import DemodulatedRecord
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.measurement import Values
from fitting.measurements.traces.grid import LEAST_SAMPLES, ROUNDED
from fitting.measurements.traces.together import TracesTogether
from fitting.simulate.batch import Batch, Workers, answered
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.errors import BadInput
from fitting.text.notation import listed

#: Candidates at most.
MOST_RECORDINGS = 1000
#: Values before they are known: a tone that repeats itself at no sample, so that it crosses its
#: mean and is not clipped, whatever the number of samples.
TURN = 2.4
#: Largest denominator of the ratio of two spacings that have samples in common.
DENOMINATOR = 1000
#: Share of the largest value by which a recording may be off what the trace so far shows.
OFF = 1e-3
#: Directions of what is solved inside below this share of the largest are not told by the samples
#: in common: lines that look alike in them.
ALIKE = 1e-8
#: Samples for each unknown that is solved inside, at least.
OF_EACH = 4
#: A number of spacings is whole up to this.
WHOLE = 1e-6


@dataclass(frozen=True)
class TracesSoFar:
    """The traces of a campaign, of one kind, that new recordings may repeat.

    `table` of the campaign; `kind` is the measurement that they are fitted as.
    """

    table: str
    kind: TracesTogether[Any]

    @property
    def records(self) -> tuple[TimeRecord, ...]:
        """Every trace as it was measured."""
        return self.kind.traces

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the traces."""
        return tuple(record.label for record in self.records)

    def record(self, label: str) -> TimeRecord:
        """The trace of a name.

        Args:
            label: its name.
        """
        return self.records[self.labels.index(label)]

    def output(self, label: str) -> str:
        """The FMU's output that a trace shows.

        Args:
            label: its name.
        """
        return self.kind.output_of(self.record(label))


def traces_of(bound: BoundCampaign) -> TracesSoFar:
    """The traces that new recordings of a campaign repeat: samples, else demodulated ones.

    Args:
        bound: the campaign.

    Raises:
        BadInput: it has neither.
    """
    for table in ("trace", "demodulated_trace"):
        traces = bound.measurements.get(table)
        if isinstance(traces, TracesTogether):
            return TracesSoFar(table, traces)
    raise BadInput(
        f"{bound.path}: [design] traces: has no table [[trace]] or [[demodulated_trace]], whose "
        "start or drive could be repeated; wanted one, or no traces"
    )


def repeated(so_far: TracesSoFar, labels: Sequence[str], where: str) -> list[TimeRecord]:
    """The traces of these names, of one unit, each of a kind that can be repeated.

    Args:
        so_far: all traces.
        labels: names, one at least.
        where: what complaints name.

    Raises:
        BadInput: an unknown name, several units, a drive from an unknown start, amplitudes without
            phases.
    """
    for name in labels:
        if name not in so_far.labels:
            known = ", ".join(filter(None, so_far.labels)) or "a single one without a name"
            raise BadInput(
                f"{where}: '{name}' is no trace of [[{so_far.table}]]; wanted some of {known}"
            )
    records = [so_far.record(label) for label in labels]
    for record in records:
        _refuse_unknown(record, where)
    units = list(dict.fromkeys(record.unit for record in records))
    if len(units) > 1:
        raise BadInput(
            f"{where}: the traces have values in {listed(units)}; wanted traces of one unit, by "
            "their names in 'of'"
        )
    return records


def _refuse_unknown(record: TimeRecord, where: str) -> None:
    """Complain of a trace whose repetition nothing is known of."""
    name = f"trace '{record.label}'" if record.label else "the trace"
    if isinstance(record, DemodulatedRecord):
        if record.is_amplitude:
            raise BadInput(
                f"{where}: {name} has amplitudes without phases, and recordings of X and Y are "
                "proposed; wanted records with phases, by their names in 'of'"
            )
    elif isinstance(record, TraceRecord) and record.has_unknown_start and record.driven is not None:
        raise BadInput(
            f"{where}: {name} is driven from an unknown start, of which nothing is known in a new "
            "recording; wanted ringdowns, or traces from rest, by their names in 'of'"
        )


def longest_s(record: TimeRecord) -> float:
    """How long a recording like a trace may be, s: as long as its recorded inputs, else any time.

    Args:
        record: a trace so far.
    """
    if not isinstance(record, TraceRecord):
        return math.inf
    ends = [float(w.time_s[-1]) for w in record.waveforms.values() if isinstance(w, Recorded)]
    return min(ends, default=math.inf) - float(record.t[0])


def recording_choices(bound: BoundCampaign, limits: Limits) -> tuple[DriveChoice, ...]:
    """Every recording within the limits; those of one trace and spacing follow each other.

    Args:
        bound: the campaign that is to be continued.
        limits: with traces.

    Raises:
        BadInput: no recording, or too many, lie within the limits.
    """
    wanted, so_far = limits.traces, traces_of(bound)
    if wanted is None:
        return ()
    found = []
    for label, record in zip(wanted.of, repeated(so_far, wanted.of, "limits: traces"), strict=True):
        least = max(LEAST_SAMPLES, OF_EACH * record.solved_inside)
        for spacing_s in wanted.spacings_s[label]:
            lengths_s = [s for s in wanted.lengths_s if s <= longest_s(record) * (1.0 + WHOLE)]
            counts = {math.floor(length_s / spacing_s + WHOLE) + 1 for length_s in lengths_s}
            for samples in sorted(counts):
                if not least <= samples <= wanted.samples:
                    continue
                found.append(
                    DriveChoice(
                        centre_hz=limits.centres_hz[0],
                        tones_hz=(),
                        output=so_far.output(label),
                        level=1.0,
                        settings={},
                        recording=Recording(
                            trace=label,
                            spacing_s=spacing_s,
                            samples=samples,
                        ),
                    )
                )
    if not found:
        raise BadInput(
            f"{bound.path}: [design] traces: no recording lies within the limits: wanted lengths "
            f"and spacings of {LEAST_SAMPLES} to {wanted.samples} samples, of which recorded "
            "inputs allow no longer ones than they are, and a start that is solved for no fewer "
            f"than {OF_EACH} for each unknown"
        )
    if len(found) > MOST_RECORDINGS:
        raise BadInput(
            f"{bound.path}: [design] traces: {len(found)} recordings lie within the limits, wanted "
            f"at most {MOST_RECORDINGS}: fewer lengths or spacings"
        )
    return tuple(found)


@dataclass(frozen=True)
class RecordingRows:
    """Recordings at one place: largest values (c,), and J^T J (c, n, n) of their rows.

    The largest value is 0 of one that a fit would refuse, as one that is shorter than a period.
    """

    largest: FloatArray
    squares: FloatArray

    def information(self, sigmas: FloatArray, kept: Sequence[int]) -> FloatArray:
        """Information (kept, n + 1, n + 1) of recordings with white noise; none of the scale.

        Args:
            sigmas: standard deviations of a sample, of each quadrature of a demodulated one,
                shape (c,), in the unit of the values.
            kept: recordings.
        """
        index = list(kept)
        noise = np.maximum(sigmas, SMALLEST_SIGMA * self.largest)[index]
        found = self.squares[index] / noise[:, np.newaxis, np.newaxis] ** 2
        return np.pad(found, ((0, 0), (0, 1), (0, 1)))


@dataclass(frozen=True, kw_only=True)
class RecordingsToSimulate:
    """Choices of a series, with the noise of each and the difference steps in x, (n,)."""

    series: Series
    so_far: TracesSoFar
    choices: Sequence[DriveChoice]
    steps: FloatArray
    planned: dict[str, DrivenModel] = field(default_factory=dict)

    def rows(self, places: Sequence[Place]) -> list[RecordingRows]:
        """Rows of all choices at every place.

        Args:
            places: where they are wanted.
        """
        return [self._rows(place) for place in places]

    def noise(self, place: Place, labels: Iterable[str]) -> dict[str, float]:
        """Standard deviation of a sample by trace: as it is stated, else what a fit leaves there.

        Args:
            place: where the parameters are.
            labels: names of the traces.
        """
        free, found = place.x.size, {}
        for record in map(self.so_far.record, labels):
            if record.sigma > 0.0:
                found[record.label] = record.sigma
                continue
            left = _stacked(self._so_far(record, place).values - record.y)
            freedom = max(1, left.size - record.solved_inside - free)
            found[record.label] = math.sqrt(float(left @ left) / freedom)
        return found

    def _rows(self, place: Place) -> RecordingRows:
        made = [
            each
            for mine in _of_one_spacing(self.choices)
            for each in self._of_one_spacing(mine, place)
        ]
        return RecordingRows(np.array([m[0] for m in made]), np.stack([m[1] for m in made]))

    def _of_one_spacing(
        self, choices: Sequence[DriveChoice], place: Place
    ) -> list[tuple[float, FloatArray]]:
        """Largest value and J^T J (n, n) of each; the longest is simulated."""
        parameters = self.series.bound.parameters
        counts = [_recording(choice).samples for choice in choices]
        record = self._longest(choices)
        old = self.so_far.record(_recording(choices[0]).trace)
        values = self._expected(old, self._so_far(old, place), record, place)
        seen = [_beginning(record, values, count) for count in counts]
        longest = max((each for each in seen if each is not None), key=_samples, default=None)
        if longest is None:
            return [(0.0, np.zeros((place.x.size, place.x.size)))] * len(choices)
        around = central(place.x, self.steps, *search_bounds(parameters))
        table = np.array([to_model(parameters, x) for x in around.nodes])
        nodes = self._predicted(longest, place, table)
        found = []
        for each in seen:
            count = 0 if each is None else _samples(each)
            rows = [_left(node, longest.y, count) for node in nodes]
            largest = float(np.max(np.abs(values[:count]), initial=0.0))
            slopes = around.quotients(rows)
            found.append((largest, np.asarray(slopes.T @ slopes)))
        return found

    def _longest(self, choices: Sequence[DriveChoice]) -> TimeRecord:
        """The longest of the choices as a record, with values that nobody measured."""
        wanted = max((_recording(c) for c in choices), key=lambda r: r.samples)
        old = self.so_far.record(wanted.trace)
        index = np.arange(wanted.samples)
        turned = np.exp(1j * TURN * index)
        return replace(
            old,
            time_s=float(old.t[0]) + index * wanted.spacing_s,
            values=turned if old.is_complex else turned.real,
            begin="first",
            label=f"next {wanted.trace} at {wanted.spacing_s!r} s",
        )

    def _so_far(self, record: TimeRecord, place: Place) -> Prediction:
        """A trace so far as the model has it at a place."""
        p = to_model(self.series.bound.parameters, place.x)
        kind, model = self.so_far.kind.of_records((record,)), self.series.model(place.alternative)
        return _prediction(kind, model, np.array([p]), self.series.workers)[0]

    def _predicted(self, record: TimeRecord, place: Place, table: FloatArray) -> list[Prediction]:
        kind = self.so_far.kind.of_records((record,))
        model = self._model(record, place)
        return _prediction(kind, model, table, self.series.workers)

    def _model(self, record: TimeRecord, place: Place) -> DrivenModel:
        """The FMU with the communication step of a recording, which is found once."""
        series = self.series
        if record.label not in self.planned:
            points = planning_points(series.bound.parameters)
            model = series.model(series.bound.alternatives[0])
            plan = self.so_far.kind.of_records((record,)).refined(model, points, series.workers)
            self.planned[record.label] = replace(model, plan=plan)
        return replace(self.planned[record.label], alternative=place.alternative)

    def _expected(
        self,
        old: TimeRecord,
        shown: Prediction,
        record: TimeRecord,
        place: Place,
    ) -> Values:
        """Values (n,) of a recording that begins as the trace so far did."""
        p = to_model(self.series.bound.parameters, place.x)
        [new] = self._predicted(record, place, np.array([p]))
        design = _design(new)
        if not design.shape[1]:
            return new.values
        where = f"{self.series.bound.path}: [design] traces"
        mine, theirs = _in_common(old, record, where)
        if mine.size < design.shape[1]:
            raise BadInput(
                f"{where}: samples {record.spacing_s:.9g} s apart have {mine.size} in common with "
                f"'{old.label}', {old.spacing_s:.9g} s apart; wanted spacings that are multiples "
                "or parts of these, and a longer recording"
            )
        size = record.y.size
        wanted = _stacked(shown.values[mine] - new.values[theirs])
        columns = design[theirs if len(design) == size else np.append(theirs, size + theirs)]
        c, *_, singular = lstsq(columns, wanted)
        off = float(np.max(np.abs(columns @ c - wanted)))
        if singular[-1] < ALIKE * singular[0] or off > OFF * float(np.max(np.abs(shown.values))):
            raise BadInput(
                f"{where}: the samples that a recording every {record.spacing_s:.9g} s has in "
                f"common with '{old.label}' do not determine how it begins; wanted a spacing "
                f"that is "
                "nearer to that one's, a multiple or a part of it"
            )
        more = design @ c
        if len(design) > size:
            more = more[:size] + 1j * more[size:]
        return np.asarray(new.values + more)


def _samples(record: TimeRecord) -> int:
    return int(record.y.size)


def _beginning(record: TimeRecord, values: Values, count: int) -> TimeRecord | None:
    """The first samples of a recording with their values; None where a fit would refuse them."""
    try:
        return replace(record, time_s=record.t[:count], values=values[:count])
    except BadInput:
        return None


def _recording(choice: DriveChoice) -> Recording:
    if choice.recording is None:
        raise TypeError(f"no recording: {choice!r}")
    return choice.recording


def _of_one_spacing(choices: Sequence[DriveChoice]) -> Iterator[list[DriveChoice]]:
    """Neighbours that repeat one trace with one spacing."""
    for _, mine in groupby(choices, key=lambda c: (_recording(c).trace, _recording(c).spacing_s)):
        yield list(mine)


def _prediction(
    kind: TracesTogether[Any], model: DrivenModel, table: FloatArray, workers: Workers
) -> list[Prediction]:
    """A measurement at parameter vectors (k, n)."""
    batch = Batch()
    return answered(kind.predict(model, table, batch), batch, workers)


def _stacked(values: Values) -> FloatArray:
    """Real values as they are, of complex ones all real parts, then all imaginary ones."""
    both = np.concatenate([values.real, values.imag])
    return np.asarray(both if np.iscomplexobj(values) else values.real, dtype=float)


def _design(found: Prediction) -> FloatArray:
    """Columns of what is solved inside one recording that say anything, of length one."""
    design = found.solved[0].design
    sizes = np.linalg.norm(design, axis=0)
    return np.asarray(design[:, sizes > 0.0] / sizes[sizes > 0.0])


def _left(node: Prediction, values: Values, count: int) -> FloatArray:
    """Rows of the first samples of a recording, what is solved inside taken out of them."""
    rows, size = _stacked((node.values - values)[:count]), len(values)
    design = _design(node)
    parts = [design[first : first + count] for first in range(0, len(design), size)]
    if not rows.size or not design.shape[1]:
        return rows
    axes, sizes, _ = np.linalg.svd(np.concatenate(parts), full_matrices=False)
    along = axes[:, sizes > ALIKE * sizes[0]]
    return np.asarray(rows - along @ (along.T @ rows))


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
