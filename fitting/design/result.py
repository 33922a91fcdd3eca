"""What a design says: the proposed measurements and what they should do for the target."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fitting.text.arrays import Scalar
from fitting.text.csv_cells import csv_text
from fitting.text.records import read_json, write_json

NAME = "design.json"


@dataclass(frozen=True)
class Expected:
    """Expected standard deviation of the target at the given point and over points of equal fit.

    `mean` (geometric) and `worst` include the given point; NaN where the target has no value. None
    is more than the spread of the target over points of equal fit.
    """

    at: float
    mean: float
    worst: float


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A recording over time that begins, or is driven, as the ``trace`` of that name was.

    `length_s` from the first to the last of `samples`, which are `spacing_s` apart: it follows from
    these.
    """

    trace: str
    length_s: float = math.nan
    spacing_s: float
    samples: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "length_s", (self.samples - 1) * self.spacing_s)


@dataclass(frozen=True, kw_only=True)
class DriveChoice:
    """What tells a candidate from the others: where it is driven, what is read, how strongly.

    `tones_hz` around the resonance `centre_hz`, `level` a factor on the campaign's drive,
    `settings` of further FMU parameters or controls. With `points` it is a sweep of that many
    frequencies from the first to the second of `tones_hz`; a `recording` has no tones.
    """

    tones_hz: tuple[float, ...]
    centre_hz: float
    output: str
    level: float
    settings: Mapping[str, Scalar]
    points: int = 0
    recording: Recording | None = None


@dataclass(frozen=True, kw_only=True)
class Proposal(DriveChoice):
    """One proposed measurement: `rank` in order of use, drive, output, number of spectra averaged.

    Expected peaks `peaks_v` and their `sigmas_v` (at the given point), one per tone; `expected` of
    the target after this measurement and those before it. The largest amplitude of a sweep and the
    largest value of a recording are its only peak, with the noise of a point or sample.
    """

    rank: int
    repeats: int
    peaks_v: tuple[float, ...]
    sigmas_v: tuple[float, ...]
    expected: Expected


@dataclass(frozen=True, kw_only=True)
class Kind:
    """Candidates that share output, resonance and level, of sweeps also their controls.

    Of recordings those that repeat one `trace` with one spacing, `spacing_s`.

    Expected sigma (average over points of equal fit) of the `best` and the `worst` of them if it
    were the only measurement, and of the best beside all proposed ones but the last (`beside`).
    """

    output: str
    centre_hz: float
    level: float
    best: float
    worst: float
    beside: float
    count: int
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    trace: str = ""
    spacing_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class PlacePoint:
    """A point at which the design was judged.

    The `target` there and its `sigmas`, first with the data so far and then after every proposed
    measurement; NaN where it has no value.
    """

    alternative: Mapping[str, Scalar]
    parameters: Mapping[str, float]
    target: float
    sigmas: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Prospect:
    """What further measurements are weighed for, and by which `criterion`.

    `before` is the target's error with the data so far; `sentences` say what was assumed.
    """

    title: str
    synthetic: bool
    target: str
    unit: str
    criterion: str
    before: Expected
    sentences: tuple[str, ...]
    provenance: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Design(Prospect):
    """A proposal for the next measurements.

    `spread` is the target's standard deviation over `equal_fits` points that fit equally well (of
    which `valueless` have no value); `limits` in words.
    """

    campaign: str
    amplitude_unit: str
    spread: float
    span: tuple[float, float]
    proposals: tuple[Proposal, ...]
    kinds: tuple[Kind, ...]
    places: tuple[PlacePoint, ...]
    equal_fits: int
    valueless: int
    setups: int
    candidates: int
    limits: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_of_sweeps(self) -> bool:
        """Whether sweeps are proposed, not tones."""
        return any(p.points for p in self.proposals)

    @property
    def is_of_traces(self) -> bool:
        """Whether recordings over time are proposed."""
        return any(p.recording is not None for p in self.proposals)

    @property
    def improvement(self) -> float:
        """Ratio of the average sigma before to that after all proposed measurements."""
        return self.before.mean / self.proposals[-1].expected.mean if self.proposals else 1.0


def write_design(design: Design, folder: Path) -> Path:
    """Write `design.json` into a folder, whole or not at all.

    Args:
        design: what is written.
        folder: where it goes.
    """
    path = folder / NAME
    write_json(path, design)
    return path


def read_design(path: Path) -> Design:
    """Read it back; raises BadInput naming the key that is wrong.

    Args:
        path: of design.json.
    """
    return read_json(path, Design)


def design_csv(design: Design) -> str:
    """The proposals as CSV text, a row each, units in the header.

    Args:
        design: what is proposed.
    """
    tones = len(design.proposals[0].tones_hz) if design.proposals else 0
    peaks = len(design.proposals[0].peaks_v) if design.proposals else 0
    driven = [f"tone {i + 1} (Hz)" for i in range(tones)]
    if design.is_of_sweeps:
        driven = ["first frequency (Hz)", "last frequency (Hz)", "points"]
    if design.is_of_traces:
        return _recordings_csv(design)
    unit, volts = design.unit or "1", design.amplitude_unit or "1"
    names = list(design.proposals[0].settings) if design.proposals else []
    head = ["rank", *driven, "resonance (Hz)", "output"]
    head += ["level", *names, "spectra", *(f"peak {i + 1} ({volts})" for i in range(peaks))]
    head += [f"sigma {i + 1} ({volts})" for i in range(peaks)]
    head += [f"sigma of {design.target} {where} ({unit})" for where in ("here", "mean", "worst")]
    before = design.before
    lines = [head]
    blank = [""] * (len(head) - 4)
    lines.append(["0", *blank, *map(_number, (before.at, before.mean, before.worst))])
    for p in design.proposals:
        e = p.expected
        cells = [str(p.rank), *map(repr, p.tones_hz), *([str(p.points)] if p.points else [])]
        cells += [repr(p.centre_hz), p.output, repr(p.level)]
        cells += [str(value) for value in p.settings.values()] + [str(p.repeats)]
        cells += [*map(repr, p.peaks_v), *map(repr, p.sigmas_v)]
        lines.append([*cells, *map(_number, (e.at, e.mean, e.worst))])
    return csv_text(lines)


def _recordings_csv(design: Design) -> str:
    unit, volts = design.unit or "1", design.amplitude_unit or "1"
    head = ["rank", "trace", "output", "length (s)", "spacing (s)", "samples"]
    head += [f"largest ({volts})", f"sigma ({volts})"]
    head += [f"sigma of {design.target} {where} ({unit})" for where in ("here", "mean", "worst")]
    before = design.before
    rows = [head, ["0", *[""] * 7, *map(_number, (before.at, before.mean, before.worst))]]
    for p in design.proposals:
        if p.recording is not None:
            r, e = p.recording, p.expected
            cells = [str(p.rank), r.trace, p.output, repr(r.length_s), repr(r.spacing_s)]
            cells += [str(r.samples), *map(repr, (*p.peaks_v, *p.sigmas_v))]
            rows.append([*cells, *map(_number, (e.at, e.mean, e.worst))])
    return csv_text(rows)


def _number(value: float) -> str:
    return "" if math.isnan(value) else repr(value)
