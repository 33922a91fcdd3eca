"""What new measurements continue: the sweeps over a control, or the traces, of a campaign."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitting.extension.records import BoundCampaign, Recorded, TimeRecord, TraceRecord
from fitting.measurements.complex_sweep import ComplexSweep
from fitting.measurements.control_sweep import ControlSweep
from fitting.measurements.demodulated import DemodulatedRecord
from fitting.measurements.records import Together
from fitting.measurements.trace_survey import TracesTogether
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import listed

#: Sweeps or recordings that are tried, at most: each is simulated.
MOST_CANDIDATES = 1000
#: Tables whose measurements new ones may continue, and their kinds.
SWEEPS: Mapping[str, type[Together[Any]]] = {
    "control_sweep": ControlSweep,
    "complex_control_sweep": ComplexSweep,
}
TRACES: Mapping[str, type[Together[Any]]] = {
    "trace": TracesTogether,
    "demodulated_trace": TracesTogether,
}


@dataclass(frozen=True)
class Continued:
    """The measurement of a `table` of the campaign, whose records new ones are like."""

    table: str
    kind: Any

    @property
    def records(self) -> Sequence[Any]:
        """All of them, as they were measured."""
        return tuple(self.kind.records)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the records."""
        return tuple(record.label for record in self.records)

    @property
    def last(self) -> Mapping[str, Scalar]:
        """Settings of the last record."""
        settings: Mapping[str, Scalar] = self.records[-1].settings
        return settings

    @property
    def unit(self) -> str:
        """Of the values of sweeps."""
        owner = self.kind if isinstance(self.kind, ControlSweep) else self.records[-1]
        return str(owner.unit)

    @property
    def columns(self) -> tuple[str, ...]:
        """What is measured at every point."""
        return ("amplitude",) if isinstance(self.kind, ControlSweep) else ("X", "Y")

    @property
    def is_estimated(self) -> bool:
        """Whether the noise of sweeps follows from their scatter."""
        if isinstance(self.kind, ControlSweep):
            return self.kind.estimated
        return any(c.sigma == 0.0 for c in self.records)

    def record(self, label: str) -> TimeRecord:
        """The trace of a name."""
        trace: TimeRecord = self.records[self.labels.index(label)]
        return trace

    def require_controls(self, names: Iterable[str], where: str) -> None:
        """Refuse controls that the sweeps have no column for.

        Args:
            names: of controls.
            where: what errors name.

        Raises:
            BadInput: an unknown control.
        """
        for name in names:
            if name not in self.last:
                raise BadInput(
                    f"{where}: '{name}' is no control of [{self.table}]; wanted some of "
                    f"{', '.join(self.last)}"
                )

    def sigmas(self) -> FloatArray:
        """Noise of all points of sweeps, of each quadrature of complex ones; 0: unknown."""
        if isinstance(self.kind, ControlSweep):
            return np.concatenate([s.sigmas for s in self.records])
        return np.concatenate([np.full(c.y.size, c.sigma or c.scatter()) for c in self.records])


def continued(bound: BoundCampaign, tables: Mapping[str, type[Together[Any]]]) -> Continued | None:
    """What a campaign has of some kinds, of the first that it has; None where it has none."""
    for table, kind in tables.items():
        if isinstance(bound.measurements.get(table), kind):
            return Continued(table, bound.measurements[table])
    return None


def required(bound: BoundCampaign, tables: Mapping[str, type[Together[Any]]]) -> Continued:
    """The same.

    Raises:
        BadInput: it has none.
    """
    like = continued(bound, tables)
    if like is None:
        kind = "sweeps" if tables is SWEEPS else "traces"
        names = " or ".join(f"[[{n}]]" if kind == "traces" else f"[{n}]" for n in tables)
        raise BadInput(
            f"{bound.path}: [design] {kind}: has no table {names}, which could be continued; "
            f"wanted one, or no {kind}"
        )
    return like


def repeatable(like: Continued, labels: Sequence[str], where: str) -> list[TimeRecord]:
    """The traces of these names, of one unit, each of a kind that can be repeated.

    Args:
        like: all traces.
        labels: names, one at least.
        where: what errors name.

    Raises:
        BadInput: an unknown name, several units, a drive from an unknown start, amplitudes without
            phases.
    """
    for name in labels:
        if name not in like.labels:
            known = ", ".join(filter(None, like.labels)) or "a single one without a name"
            raise BadInput(
                f"{where}: '{name}' is no trace of [[{like.table}]]; wanted some of {known}"
            )
    records = [like.record(label) for label in labels]
    for record in records:
        name = f"trace '{record.label}'" if record.label else "the trace"
        if isinstance(record, DemodulatedRecord) and record.is_amplitude:
            raise BadInput(
                f"{where}: {name} has amplitudes without phases, and recordings of X and Y are "
                "proposed; wanted records with phases, by their names in 'of'"
            )
        driven = isinstance(record, TraceRecord) and record.driven is not None
        if driven and record.has_unknown_start:
            raise BadInput(
                f"{where}: {name} is driven from an unknown start, of which nothing is known in a "
                "new recording; wanted ringdowns, or traces from rest, by their names in 'of'"
            )
    units = list(dict.fromkeys(record.unit for record in records))
    if len(units) > 1:
        raise BadInput(
            f"{where}: the traces have values in {listed(units)}; wanted traces of one unit, by "
            "their names in 'of'"
        )
    return records


def longest_s(record: TimeRecord) -> float:
    """How long a recording like a trace may be, s: as its recorded inputs, else any time."""
    if not isinstance(record, TraceRecord):
        return math.inf
    ends = [float(w.time_s[-1]) for w in record.waveforms.values() if isinstance(w, Recorded)]
    return min(ends, default=math.inf) - float(record.t[0])
