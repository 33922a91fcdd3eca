"""The text of a campaign of traces, and what it is made of: recordings, their columns, boxes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fitting.campaign import instruments
from fitting.campaign.instruments import Channel
from fitting.draft.campaign import Chosen, Remarks, in_file, put_remarks
from fitting.draft.model import Offer
from fitting.draft.source import relative_path
from fitting.draft.values import Box
from fitting.measurements.traces.record import FIT, STATES_OF_ONE, UNKNOWN
from fitting.measurements.traces.time_record import FOUND
from fitting.measurements.traces.waveform import HELD
from fitting.text.errors import BadInput
from fitting.text.notation import listed
from fitting.text.toml import rewritten, toml_text
from fitting.text.units import same_kind

#: Why a start value is another than the FMU's own.
CLOSER = "closer to the record than the FMU's own start value, by runs half a decade apart"
#: Why a parameter that is not fitted has its value.
OWN = "the FMU's own start value, which nobody measured"
#: Factor to either side of the FMU's own start value.
FACTOR = 10.0


@dataclass(frozen=True)
class Recording:
    """Columns over time, and which of them holds the times."""

    table: instruments.Recording
    time: Channel

    @property
    def others(self) -> tuple[Channel, ...]:
        """All columns but that of times."""
        return tuple(c for c in self.table.channels if c.name != self.time.name)

    def called(self, name: str) -> Channel | None:
        """The column that is called like a variable, capitals apart; None where none is.

        Args:
            name: of the variable; brackets in it are those of an array, and no unit.
        """
        found = [c for c in self.others if called(c, name)]
        exact = [c for c in found if c.name.lower() == name.lower()]
        return exact[0] if exact else found[0] if len(found) == 1 else None


def called(channel: Channel, name: str) -> bool:
    """Whether a column is called like a variable, alone or within a model, as "model.fmu.y".

    Args:
        channel: of a recording.
        name: of the variable.
    """
    return f".{channel.name.lower()}".endswith(f".{name.lower()}")


def in_unit_of(channel: Channel, unit: str) -> Channel:
    """A column in the unit of the FMU's variable where it tells none.

    Args:
        channel: of a recording.
        unit: of the variable.
    """
    return channel if channel.unit is not None else replace(channel, unit=unit)


@dataclass(frozen=True)
class TraceFile:
    """A recording whose columns are known: of the output, and of the input, None: none drives.

    ``further`` are columns of further inputs, by their names.
    """

    recording: Recording
    seen: Channel
    driven: Channel | None
    interpolation: str
    further: tuple[Channel, ...] = ()

    @property
    def path(self) -> Path:
        """Of the file."""
        return self.recording.table.path

    def name(self, column: Channel) -> str:
        """Name of a column as a campaign tells it, with its unit where the file does not.

        Args:
            column: of the recording.
        """
        return in_file(column) + (f" ({column.unit})" if self._is_silent(column) else "")

    @property
    def assumed(self) -> str:
        """Which columns tell no unit, and the one that is taken; empty: all tell theirs."""
        columns = [self.recording.time, self.seen, *([self.driven] if self.driven else [])]
        taken = [f"'{c.name}' in {c.unit}" for c in (*columns, *self.further) if self._is_silent(c)]
        return f"Without a unit in the file, taken in the FMU's: {listed(taken)}." if taken else ""

    def _is_silent(self, column: Channel) -> bool:
        own = next(c for c in self.recording.table.channels if c.name == column.name)
        return own.unit is None


@dataclass(frozen=True, kw_only=True)
class TimeDraft(Chosen):
    """A campaign of recordings over time; ``seen`` are sentences."""

    seen: tuple[str, ...]

    def text(self, folder: Path | None) -> str:
        """The text of the campaign.

        Args:
            folder: where it stands, to which paths are relative; None: they are absolute.
        """
        remarks: Remarks = {}
        tables: dict[str, Any] = {
            "title": ", ".join(path.stem for path in self.paths),
            "fmu": self.fmu_table(folder, remarks),
            "observe": {"output": self.output},
            **self.measured(folder, remarks),
            **self.fitted_tables(remarks),
        }
        head = (
            "A first campaign, written by fmu-fit init from these files: it runs as it is.",
            "What a remark calls a guess is one; docs/reference/campaign.md tells every key.",
        )
        return rewritten(toml_text(tables, head), lambda made: put_remarks(made, remarks))

    @property
    def paths(self) -> tuple[Path, ...]:
        """Of the files."""
        raise NotImplementedError

    def measured(self, folder: Path | None, remarks: Remarks) -> dict[str, Any]:
        """Tables of the measurements by their name; remarks on them are put beside the others.

        Args:
            folder: see `text`.
            remarks: of the campaign.
        """
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class TraceDraft(TimeDraft):
    """A campaign of traces: ``input`` is empty where nothing drives.

    With ``modes`` the traces are ringdowns of so many from a state that nobody knows, which a pulse
    at the input spans; with ``late`` they begin inside the records.
    """

    input: str
    files: tuple[TraceFile, ...]
    modes: int = 0
    late: bool = False

    @property
    def paths(self) -> tuple[Path, ...]:
        """Of the files."""
        return tuple(file.path for file in self.files)

    def measured(self, folder: Path | None, remarks: Remarks) -> dict[str, Any]:
        """Tables of the traces.

        Args:
            folder: see `text`.
            remarks: of the campaign.
        """
        files = enumerate(self.files)
        return {"trace": [self._trace(file, k, folder, remarks) for k, file in files]}

    def _trace(
        self, file: TraceFile, k: int, folder: Path | None, remarks: Remarks
    ) -> dict[str, Any]:
        made: dict[str, Any] = {"file": relative_path(file.path, folder)}
        own = {"time": (file.recording.time, "time"), "output": (file.seen, self.output)}
        if file.driven is not None:
            own["input"] = file.driven, self.input
        names = {key: (file.name(column), usual) for key, (column, usual) in own.items()}
        columns = {key: name for key, (name, usual) in names.items() if name != usual}
        if file.driven is not None:
            made |= {"input": self.input, "interpolation": file.interpolation}
            remarks["trace", k, "interpolation"] = _how(file.interpolation)
        if self.modes:
            made |= {"input": self.input, "start": UNKNOWN}
            if self.modes > 1:
                made["states"] = STATES_OF_ONE * self.modes
                remarks["trace", k, "states"] = "two for each mode"
            remarks["trace", k, "input"] = "a pulse at it spans the states that ring down"
            remarks["trace", k, "start"] = "solved for: nobody knows where a ringdown starts"
            if self.late:
                made["begin"] = FOUND
                remarks["trace", k, "begin"] = "earlier samples, of a drive or a blow, are not used"
        elif self._is_scaled(file):
            made["gain"] = FIT
            remarks["trace", k, "gain"] = f"{file.seen.unit} for the FMU's output: in proportion"
        if file.further:
            made["further_inputs"] = [column.name for column in file.further]
        if columns:
            made["columns"] = columns
        return made

    def _is_scaled(self, file: TraceFile) -> bool:
        """Whether a detector stands between the output and what was recorded, by their units."""
        unit = self.source.workers.description.variables[self.output].unit
        return bool(file.seen.unit and unit) and not same_kind(file.seen.unit or "", unit or "")


def _how(interpolation: str) -> str:
    if interpolation == HELD:
        return 'a guess: it stands still and jumps; or "linear" between samples'
    return 'a guess: it moves from sample to sample; or "held" from each to the next'


def said_of(file: TraceFile, output: str, driven: str) -> tuple[str, ...]:
    """What a file was taken for.

    Args:
        file: a recording whose columns are known.
        output: of the FMU, that was recorded.
        driven: input of the FMU; empty: none.
    """
    count = len(file.recording.table.places)
    under = "" if file.driven is None else f", under '{driven}' as '{file.driven.name}'"
    under += "".join(f" and '{column.name}'" for column in file.further)
    found = (
        f"{file.path.name}: {file.recording.table.words}, {count} samples over time of '{output}' "
        f"as '{file.seen.name}'{under}."
    )
    return (found, file.assumed) if file.assumed else (found,)


def start_box(offer: Offer, name: str, closer: float | None = None) -> Box:
    """A tenth to ten times a start value, within the FMU's range.

    Args:
        offer: what the FMU offers.
        name: of the parameter.
        closer: a start value that was found; None: the FMU's own.

    Raises:
        BadInput: the start value lies at the end of its range.
    """
    variable = offer.description.variables[name]
    start = float(f"{closer:.4g}") if closer is not None else float(variable.start or 0.0)
    low, high = sorted((start / FACTOR, start * FACTOR)) if start else (-1.0, 1.0)
    low = low if variable.min is None else max(low, variable.min)
    high = high if variable.max is None else min(high, variable.max)
    if not low < start < high:
        raise BadInput(
            f"{name}: its start value {start:g} lies at the end of its range, {low:g} to {high:g}; "
            "wanted another --fit"
        )
    digits = 3 - math.floor(math.log10(max(abs(low), abs(high))))
    return Box(
        name=name,
        unit=offer.unit(name),
        lower=low if low == variable.min else round(low, digits + 2),
        upper=high if high == variable.max else round(high, digits),
        start=start,
        scale=float(f"{0.3 * abs(start) or 0.5:.2g}"),
        why=("the FMU's own start value" if closer is None else CLOSER)
        + "; bounds are a guess"
        + (": a tenth of it to ten times" if start else ""),
    )
