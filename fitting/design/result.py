"""What a design proposes: the next measurements, and the error of the target that they promise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fitting.text.arrays import Scalar
from fitting.text.records import read_json, write_json

NAME = "design.json"


@dataclass(frozen=True)
class Expected:
    """Expected standard deviation of the target at the given point and over points of equal fit.

    `mean` (geometric) and `worst` include the given point, and are at most the spread of the target
    over the points; NaN: no value.
    """

    at: float
    mean: float
    worst: float


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A recording over time that begins, or is driven, as the named ``trace``.

    `length_s` from the first to the last of `samples`, which are `spacing_s` apart.
    """

    trace: str
    length_s: float = math.nan
    spacing_s: float
    samples: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "length_s", (self.samples - 1) * self.spacing_s)


@dataclass(frozen=True, kw_only=True)
class DriveChoice:
    """A candidate: where it is driven, what is observed, how strongly.

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
    """One proposed measurement: `rank` in order of use, drive, output, averaged spectra.

    Expected `peaks_v` and `sigmas_v` per tone at the given point, of a sweep or recording its
    largest amplitude or value with the noise of a point; `expected` of the target after it and
    those before.
    """

    rank: int
    repeats: int
    peaks_v: tuple[float, ...]
    sigmas_v: tuple[float, ...]
    expected: Expected


@dataclass(frozen=True, kw_only=True)
class Kind:
    """Candidates that share output, resonance and level, of sweeps also controls.

    Recordings repeat one `trace` with spacing `spacing_s`. Expected sigma, averaged over points of
    equal fit: of the `best` and `worst` as the only measurement, and of the best after all proposed
    ones but the last (`beside`).
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
    """A point at which the design was evaluated.

    `target` and its `sigmas`, first with the data so far, then after every proposed measurement;
    NaN: no value.
    """

    alternative: Mapping[str, Scalar]
    parameters: Mapping[str, float]
    target: float
    sigmas: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Design:
    """A proposal for the next measurements, compared by a `criterion`.

    `before`: the target's error with the data so far; `spread`: its standard deviation over
    `equal_fits` points that fit equally well, `valueless` of them without a value; `sentences`:
    assumptions; `limits` in words.
    """

    title: str
    synthetic: bool
    target: str
    unit: str
    criterion: str
    before: Expected
    sentences: tuple[str, ...]
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
    provenance: Mapping[str, str] = field(default_factory=dict)

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
    write_json(folder / NAME, design)
    return folder / NAME


def read_design(path: Path) -> Design:
    """Read design.json back; raises BadInput naming the key that is wrong."""
    return read_json(path, Design)
