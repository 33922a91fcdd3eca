"""Records of measured values, over frequency or over time, and their tables in a campaign.

`Measured` and `Record` are what every record has, `Together` answers for records of one kind that
are fitted together, `RecordTable` reads one of them.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar, cast

import numpy as np

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.bound import Drive as DriveBy
from fitting.campaign.drift import bind_sigmas
from fitting.campaign.instruments.recording import Channel, Recording, unit_of
from fitting.campaign.kind import MeasurementTable
from fitting.fmu.description import READABLE
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import Figure
from fitting.measurements.measurement import Measurement, Prediction, Sampled, Values
from fitting.measurements.plan import Plan
from fitting.measurements.residuals import ResidualCurve, least_noise, mistakes, white_noise
from fitting.measurements.response_curve import ResponseCurve, plan_curve
from fitting.simulate.batch import Batch, Workers, together
from fitting.simulate.drive import Drive
from fitting.text.arrays import ComplexArray, FloatArray, Scalar, both_parts, require_size
from fitting.text.errors import BadInput, gathered
from fitting.text.finding import Finding
from fitting.text.schema import FileName, Text, Value
from fitting.text.units import convert


def check_pair(where: str, axis: str, x: FloatArray, name: str, y: Values) -> None:
    """Refuse values without a place, and numbers of which nothing can be computed.

    Args:
        where: what complaints name.
        axis: what the places are.
        x: places, (n,).
        name: what the values are.
        y: values, (n,).

    Raises:
        BadInput: shapes that differ, numbers that are not finite, or too large or small a unit.
    """
    if x.ndim != 1 or x.shape != y.shape:
        raise BadInput(f"{where}: {x.shape} {axis} and {y.shape} {name}; wanted (n,) of both")
    for what, numbers in ((axis, x), (name, y)):
        for i in np.flatnonzero(~np.isfinite(numbers))[:1]:
            raise BadInput(f"{where}: {what}: found {numbers[i]}, wanted finite numbers")
        require_size(numbers, f"{where}: {what}")


def check_words(record: object, where: str, **known: Sequence[str]) -> None:
    """Refuse fields of a record that hold other words than they may.

    Args:
        record: with these fields.
        where: what complaints name.
        **known: words by field.

    Raises:
        BadInput: another word.
    """
    for name, words in known.items():
        if getattr(record, name) not in words:
            wanted = " or ".join(map(repr, words))
            raise BadInput(f"{where}: {name} is {getattr(record, name)!r}, wanted {wanted}")


class Measured:
    """Values ``y`` (n,) of one place, real or complex: a base class for their record.

    ``rows`` is their number of residual rows, ``largest`` what these are relative to.
    """

    #: What one of them is called.
    NOUN: ClassVar[str]

    label: str
    settings: Mapping[str, Scalar]
    y: Values
    sigma: Any
    largest: Any
    #: The FMU's output that is observed; empty: the setup's.
    output: str = ""
    #: Which points of the file are not here, and why.
    left_out: tuple[Finding, ...] = ()
    #: Standard deviations of settings, in the FMU's units; None: errors cannot be declared.
    setting_sigma: Mapping[str, float] | None = None

    @property
    def solved_inside(self) -> int:
        """How many real numbers are solved for inside its rows."""
        return 0

    @property
    def rows(self) -> int:
        """Number of residual rows: one for each real value, two for each complex one."""
        return int(self.y.size) * (2 if np.iscomplexobj(self.y) else 1)

    @property
    def row_sigma(self) -> float:
        """Standard deviation of its rows; zero where unknown."""
        return float(self.sigma / self.largest)

    def rows_of(self, values: Values) -> FloatArray:
        """Rows of a difference from the data over the largest: real parts, then imaginary ones.

        Args:
            values: simulated less measured, (n,), in the unit of the data.
        """
        if np.iscomplexobj(self.y):
            return np.asarray(both_parts(np.asarray(values, dtype=complex)) / self.largest)
        return np.asarray(values.real / self.largest)

    def residuals(self, simulated: Values) -> FloatArray:
        """Rows of simulated values.

        Args:
            simulated: S (n,), in the unit of the data.
        """
        return self.rows_of(simulated - self.y)

    def share_left(self, rows: FloatArray) -> float:
        """Root mean square distance from the model, over its largest amplitude.

        Args:
            rows: residuals, (rows,).
        """
        return float(np.sqrt(self.rows / self.y.size * np.mean(rows**2)))

    def residual_curve(self, at: slice, rows: FloatArray) -> ResidualCurve:
        """Its residuals along the axis of its values.

        Args:
            at: which rows of the measurement these are.
            rows: residuals, (rows,).
        """
        raise NotImplementedError

    def figure(self, before: Values, after: Values) -> Figure:
        """What was measured with the model, and its residuals.

        Args:
            before: as simulated with the start parameters, (n,), in the unit of the data.
            after: with the fitted ones.
        """
        raise NotImplementedError


class Curve(Measured):
    """Values over the frequency ``u_hz`` (n,), Hz, of a tone that drives: a base class."""

    u_hz: FloatArray

    @property
    def top_hz(self) -> float:
        """Where the response is largest, Hz."""
        return float(self.u_hz[int(np.argmax(self.y))])

    def residual_curve(self, at: slice, rows: FloatArray) -> ResidualCurve:
        """Its residuals over frequency, its real parts, then its imaginary ones.

        Args:
            at: which rows of the measurement these are.
            rows: residuals, (rows,).
        """
        left, parts = rows, self.rows // self.y.size
        if parts > 1:
            left = rows[: self.y.size] + 1j * rows[self.y.size :]
        values = self.y + self.largest * left
        return ResidualCurve(
            rows=np.arange(at.start, at.stop),
            share=np.full(rows.size, np.sqrt(float(parts))),  # of the distance from the model
            axis=np.tile(self.u_hz, parts),
            name=self.label,
            columns=mistakes(self.u_hz, values, 1.0 / self.largest),
            model=values,
            measured=self.y,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Record(Measured):
    """What is known of measured values, whatever their kind; the kinds explain the fields."""

    settings: Mapping[str, Scalar] = field(default_factory=dict)
    label: str = ""
    output: str = ""
    unit: str = "V"


@dataclass(frozen=True, eq=False, kw_only=True)
class OfSetup(Record):
    """What makes a record a measurement by itself: its setup, and the series that it belongs to."""

    setup: Setup = field(default_factory=partial(Setup, DriveBy(), ""))
    series: str = ""

    #: The measurement that records of this kind are together.
    _TOGETHER: ClassVar[type[Together[Any]]]

    def within(self, setup: Setup, series: str) -> Together[Any]:
        """The measurement, as part of a series that is driven so.

        Args:
            setup: how the series drives the FMU.
            series: its name.
        """
        alone: Any = self._TOGETHER
        result: Together[Any] = alone(setup=setup, **{alone.FIELD: (self,)})
        return result.within(setup, series)


R = TypeVar("R", bound=Measured)
C = TypeVar("C", bound=Curve)


@dataclass(frozen=True)
class Together(Measurement, Generic[R]):
    """One or several records of one kind, in a field of the name ``FIELD``.

    Their rows follow one another. What multiplies a simulation, or is added to it, is solved inside
    the rows of each.

    Raises:
        BadInput: no record, or two of one name.
    """

    FIELD: ClassVar[str]

    setup: Setup
    series: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        labels = [record.label for record in self.records]
        if not labels or len(set(labels)) < len(labels):
            noun = next((record.NOUN for record in self.records), "record")
            raise BadInput(
                f"{noun}: labels {', '.join(labels) or 'of none'}; wanted at least one {noun}, "
                "each with a name of its own"
            )

    @property
    def records(self) -> tuple[R, ...]:
        """All of them, in the order of their rows."""
        return cast("tuple[R, ...]", getattr(self, self.FIELD))

    def of_records(self, records: Iterable[R], **changes: Any) -> Self:
        """The same with other records.

        Args:
            records: instead of its own.
            **changes: of further fields.
        """
        return replace(self, **{self.FIELD: tuple(records), **changes})

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Which rows each record has."""
        ends = itertools.accumulate(record.rows for record in self.records)
        return tuple(slice(e - x.rows, e) for x, e in zip(self.records, ends, strict=True))

    @property
    def is_curve(self) -> bool:
        """Its values follow each other."""
        return True

    @property
    def left_out(self) -> tuple[Finding, ...]:
        """Points that an instrument cut off."""
        return tuple(result for record in self.records for result in record.left_out)

    @cached_property
    def sigma(self) -> FloatArray:
        """Standard deviation of every row, (rows,); zero where unknown."""
        return np.concatenate([np.full(x.rows, x.row_sigma) for x in self.records])

    @property
    def datum_noise(self) -> float:
        """Relative standard deviation of its least noisy datum, stated or estimated; else zero."""
        if stated := least_noise(self.sigma, self.measured_rows):
            return stated
        # by the scatter of the values
        pairs = ((white_noise(x.y), float(np.max(np.abs(x.y), initial=0.0))) for x in self.records)
        return min((noise / most for noise, most in pairs if min(noise, most) > 0.0), default=0.0)

    @property
    def solved_inside(self) -> int:
        """What is solved for inside the rows of all records."""
        return sum(record.solved_inside for record in self.records)

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        """Label and settings of every record."""
        return tuple((record.label, record.settings) for record in self.records)

    @property
    def setting_sigmas(self) -> Mapping[str, Mapping[str, float]]:
        """Declared standard deviations of settings, by label."""
        pairs = ((record.label, record.setting_sigma) for record in self.records)
        return {label: sigmas for label, sigmas in pairs if sigmas is not None}

    def named(self, label: str) -> Self:
        """The same with a label for the record that has none, of a kind that can declare errors.

        Args:
            label: of the record.
        """
        if not self.setting_sigmas:
            return self
        return self.of_records(_relabelled(x, x.label or label) for x in self.records)

    def output_of(self, record: R) -> str:
        """The FMU's output that a record shows.

        Args:
            record: one of them.
        """
        return record.output or self.setup.output

    def residuals(self, prediction: Prediction, chi: float) -> FloatArray:
        """Rows of all records, (rows,): what multiplies them is solved inside."""
        pairs = zip(self.records, self.split(prediction.values), strict=True)
        return np.concatenate([record.residuals(values) for record, values in pairs])

    def scaled(self, prediction: Prediction, chi: float) -> Values:
        """The prediction itself: what multiplies it is solved inside."""
        return prediction.values

    def share_left(self, residuals: FloatArray) -> float:
        """Root mean square of the worst record, over its largest amplitude."""
        pairs = zip(self.records, self.slices, strict=True)
        return max(record.share_left(residuals[mine]) for record, mine in pairs)

    def residual_curves(self, residuals: FloatArray) -> Sequence[ResidualCurve]:
        """Every record along its axis."""
        pairs = zip(self.records, self.slices, strict=True)
        return tuple(record.residual_curve(mine, residuals[mine]) for record, mine in pairs)

    def unexplained(self, residuals: FloatArray) -> str:
        """Records of whose variance less than half is explained are not described.

        Those with so much noise that it is most of their variance may be.
        """
        level: list[Any] = [x.y - np.mean(x.y) for x in self.records]  # real or complex
        pairs = zip(self.records, level, strict=True)
        flat = np.concatenate([record.rows_of(values) for record, values in pairs])
        missed = self._misses_curve(flat, residuals)
        noun = self.records[0].NOUN
        return f"the simulated {noun} does not follow the measured one" if missed else ""

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """Every record with the model, and its residuals."""
        trios = zip(self.records, self.split(before), self.split(after), strict=True)
        each = (record.figure(b, a) for record, b, a in trios)
        return tuple(replace(figure, series=self.series) for figure in each)

    def split(self, values: Values) -> list[Values]:
        """Values (n,) of all records as those of each.

        Args:
            values: predicted or measured, one after the other.
        """
        ends = np.cumsum([record.y.size for record in self.records])[:-1]
        return cast("list[Values]", np.split(values, ends))

    def within(self, setup: Setup, series: str) -> Self:
        """The same as part of a series, whose name the labels carry."""
        records: Iterable[R] = self.records
        if series and series != self.series:
            records = (_relabelled(x, x.label and f"{series}/{x.label}") for x in records)
        return self.of_records(records, setup=setup, series=series)


def _relabelled(record: R, label: str) -> R:
    changed: Any = replace(record, label=label)  # type: ignore[type-var]
    return cast(R, changed)


class CurvesTogether(Together[C]):
    """Records over the frequency of single tones: what the FMU answers to these."""

    @property
    def ends(self) -> tuple[C, ...]:
        """Records by whose drives the plan of the series is measured."""
        return self.records[:1]

    def drives(self, model: DrivenModel, p: FloatArray) -> list[Drive]:
        """Those of the first, the largest and the last point of the `ends`."""
        result = []
        for record in self.ends:
            u = record.u_hz
            top_hz = u[int(np.argmin(np.abs(u - record.top_hz)))]
            result += self.curve(model, record).drives(p, (u[0], top_hz, u[-1]))
        return result

    def curve(self, model: DrivenModel, record: C) -> ResponseCurve:
        """The response that a record shows.

        Args:
            model: the FMU as the series drives it.
            record: one of them.
        """
        output = self.output_of(record)
        return ResponseCurve(model, record.settings, output, label=record.label or None)

    def refined(self, model: DrivenModel, points: Sequence[FloatArray], workers: Workers) -> Plan:
        """The plan with few runs for each record, where the response is measured to be rational."""
        for each in self.records:
            curve = self.curve(model, each)
            plan = plan_curve(curve, each.u_hz, points, workers, each.top_hz)
            model = replace(model, plan=plan)
        return model.plan

    def responses(
        self, model: DrivenModel, table: FloatArray, batch: Batch
    ) -> Generator[None, None, list[ComplexArray]]:
        """Responses of all records, (k, n) each, at all points.

        Args:
            model: the FMU as the series drives it.
            table: parameter vectors (k, m), each in its own unit.
            batch: where runs are asked for.
        """
        tasks = [self.curve(model, x).predict(table, x.u_hz, batch) for x in self.records]
        return (yield from together(tasks))

    def sampled(self, model: DrivenModel, p: FloatArray, batch: Batch) -> list[Sampled]:
        """The run at the first point of every record."""
        return [self.sampled_at(record, model, p, batch) for record in self.records]

    def sampled_at(self, record: C, model: DrivenModel, p: FloatArray, batch: Batch) -> Sampled:
        """The run at the first point of a record.

        Args:
            record: one of them.
            model: how the FMU is driven for one series, and by which plan.
            p: parameters (n,), each in its own unit.
            batch: where runs are asked for.
        """
        [(run, window)] = self.curve(model, record).ask(p, record.u_hz[:1], batch)
        return Sampled(run, window, self.output_of(record))


@dataclass(frozen=True)
class SweepsTogether(CurvesTogether[C]):
    """Sweeps, perhaps at values of control quantities that their settings name.

    ``units`` are those of the controls; those of the FMU's own variables may be left out.
    """

    units: Mapping[str, str] = field(default_factory=dict, kw_only=True)

    @property
    def control_units(self) -> Mapping[str, str]:
        """Units of the controls."""
        return {name: unit for name, unit in self.units.items() if unit}

    def part(self, labels: Collection[str]) -> Self | None:
        """The records at the places of these labels.

        Args:
            labels: of places.
        """
        kept = tuple(x for x in self.records if x.label in labels)
        return self.of_records(kept) if kept else None


Made = TypeVar("Made")


@dataclass(frozen=True, eq=False)
class ReadColumn:
    """Values (n,) of a column in its unit; ``where`` opens complaints about it."""

    values: FloatArray
    unit: str
    where: str

    @classmethod
    def of(cls, recording: Recording, column: Channel, example: str) -> ReadColumn:
        """A column of a recording.

        Args:
            recording: that has it.
            column: with its unit.
            example: of a name with a unit, for errors.

        Raises:
            BadInput: no unit, or a cell that is no number.
        """
        where = f"{recording.path}: column '{column.name}'"
        return cls(recording.numbers(column), unit_of(recording, column, example), where)

    def into(self, unit: str | None) -> ReadColumn:
        """The column in another unit.

        Args:
            unit: wanted; None: SI base units.
        """
        if unit == self.unit or not self.unit:
            return self
        zero, one = (convert(x, self.unit, unit, where=self.where) for x in (0.0, 1.0))
        if zero != 0.0:  # a temperature
            return ReadColumn(zero + (one - zero) * self.values, unit or "", self.where)
        return ReadColumn(one * self.values, unit or "", self.where)


@dataclass(frozen=True, kw_only=True)
class RecordTable(MeasurementTable):
    """Keys of all repeated tables of records: the file, the output, the label, start values."""

    REPEATED: ClassVar[bool] = True
    #: The measurement that their records are together.
    TOGETHER: ClassVar[type[Together[Any]]]

    file: FileName
    """Columns with their units."""
    output: Text | None = None
    """The observed FMU output; without it that of [observe]."""
    label: Text = ""
    """Its name; without it "1", "2" if there are several."""
    set: Mapping[str, Value] = field(default_factory=dict)
    """Start values of the FMU."""

    def record(self, label: str) -> Record:
        """What the file holds; what depends on the FMU follows in `bound`.

        Args:
            label: of the record.

        Raises:
            BadInput: one line with file, column or key, what was found, what is wanted.
        """
        raise NotImplementedError

    def bound(self, binder: Binder, setup: Setup, label: str) -> Record:
        """What the file holds, with settings and output in the names and units of the FMU.

        Args:
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.
            label: of the record.
        """
        record = self.checked(partial(self.record, label), binder, setup)
        return replace(record, **self.known(binder, setup))

    def checked(self, read: Callable[[], Made], binder: Binder, setup: Setup) -> Made:
        """What is read of the file: what is wrong in it and in the table is reported together.

        Args:
            read: reads the file.
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.
        """
        made: list[Any] = gathered((read, *self.checks(binder, setup)))
        return cast("Made", made[0])

    def checks(self, binder: Binder, setup: Setup) -> Iterator[Callable[[], object]]:
        """What examines each name and value by itself.

        Args:
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.
        """
        if self.output or self.TRANSIENT:
            where = f"{setup.source}: [[{self.TABLE}]] output"
            yield partial(binder.real, self.output or setup.output, where, READABLE, "observed")
        yield partial(binder.settings, self.set)

    def known(self, binder: Binder, setup: Setup) -> dict[str, Any]:
        """Fields of the record that follow from the table and the FMU, by name.

        Args:
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.
        """
        return {"settings": binder.settings(self.set), "output": self.output or ""}

    @classmethod
    def read_together(cls, tables: Sequence[Self]) -> ReadRecords:
        """All tables, with the labels that distinguish them; their files are read when bound."""
        return ReadRecords(tuple(tables), labels_of(tables))


@dataclass(frozen=True, kw_only=True)
class StatedTable(RecordTable):
    """A table whose start values may have declared errors."""

    set_sigma: Mapping[str, Value] = field(default_factory=dict)
    """Standard deviations of values in set, as { eta = "0.2 Hz" }: an offset of each is fitted."""

    def checks(self, binder: Binder, setup: Setup) -> Iterator[Callable[[], object]]:
        """What examines each name and value by itself, errors of start values as well."""
        yield from super().checks(binder, setup)
        yield partial(bind_sigmas, self.set_sigma, binder)

    def known(self, binder: Binder, setup: Setup) -> dict[str, Any]:
        """Settings, their errors, and the output."""
        return super().known(binder, setup) | {"setting_sigma": bind_sigmas(self.set_sigma, binder)}


@dataclass(frozen=True)
class ReadRecords:
    """All tables of one kind; their files are read when they are bound."""

    tables: tuple[RecordTable, ...]
    labels: tuple[str, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of all tables, each once."""
        return tuple(dict.fromkeys(table.file for table in self.tables))

    def bind(self, binder: Binder, setup: Setup) -> Together[Any]:
        """All records, in the names and units of the FMU, as one measurement."""
        pairs = zip(self.tables, self.labels, strict=True)
        bound = gathered(partial(table.bound, binder, setup, label) for table, label in pairs)
        kind: Any = self.tables[0].TOGETHER
        return kind(setup=setup, **{kind.FIELD: tuple(bound)})  # type: ignore[no-any-return]


def labels_of(tables: Sequence[RecordTable]) -> tuple[str, ...]:
    """The label of every table: as written, else its number, from 1; none where it is alone.

    Args:
        tables: one or more, in the order of the file.

    Raises:
        BadInput: two of one label.
    """
    alone = len(tables) == 1
    labels = [x.label or ("" if alone else str(k)) for k, x in enumerate(tables, start=1)]
    for k, label in enumerate(labels):
        if label in labels[:k]:
            raise BadInput(
                f"{tables[k].file}: is the second {tables[k].TABLE.replace('_', ' ')} of the label "
                f"'{label}'; wanted a label of its own for every [[{tables[k].TABLE}]]"
            )
    return tuple(labels)
