"""What the instrument can do: as a table [design] states, else as the campaign kept to it."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from fitting.campaign.binder import Binder
from fitting.campaign.instruments.plain import LEAST_POINTS
from fitting.design.result import DriveChoice
from fitting.extension.records import (
    BoundCampaign,
    Recorded,
    TimeRecord,
    Trace,
    WrittenCampaign,
    WrittenDesign,
    WrittenSweeps,
    WrittenTraces,
)
from fitting.fmu.description import READABLE, SETTABLE, FmuVariable
from fitting.measurements.complex_sweep import ComplexSweep
from fitting.measurements.control_sweep import ControlSweep
from fitting.measurements.records import Together
from fitting.measurements.time_record import Traces
from fitting.measurements.traces import DemodulatedTrace
from fitting.signal.combinations import Combination
from fitting.signal.scale import half_power_width, laboratory_maximum
from fitting.signal.time_grid import LEAST_SAMPLES
from fitting.text.arguments import checked
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import listed
from fitting.text.schema import Keys, Missing, read_record
from fitting.text.toml import read_toml
from fitting.text.units import Written, convert, in_unit, positive_in, same_kind

#: Measurements that are proposed, and samples of a recording, at most: it is simulated many times.
MOST_NUMBER, MOST_SAMPLES = 50, 200_000
#: Drive levels and numbers of averaged spectra that are tried where nothing is stated; lengths of
#: recordings, in units of the longest trace; values of all controls together, at most.
LEVELS, REPEATS, LENGTHS, TRIED = (1.0, 10.0, 100.0), (1, 10, 100), (0.25, 0.5, 1.0, 2.0), 41
#: Noise of a peak in proportion to it; departure of what drifts from the line between its two
#: measured values, as a share of the drift; largest amplitude that is proposed over that observed.
RELATIVE_NOISE, OFF_THE_LINE, HEADROOM = 0.01, 0.05, 2.0
#: Relative difference of two equal limits in two units; share of noise that is none.
ROUNDING, NO_NOISE = 1e-12, 1e-6
#: Tables by which a file is known as a campaign.
OF_A_CAMPAIGN = ("fmu", "drive", "parameters")
#: Keys of [design] that place tones; that mean nothing for traces.
OF_TONES = {"outputs", "frequency_step", "least_spacing", "farthest", "both_sides", "tones"}
OF_TONES |= {"levels", "repeats", "phases", "settings", "setting_sigma"}
NOT_OF_TRACES = OF_TONES | {"centres", "relative_noise"}
#: Tables whose measurements new ones may continue, and their kinds.
SWEEPS: Mapping[str, type[Together[Any]]] = {
    "control_sweep": ControlSweep,
    "complex_control_sweep": ComplexSweep,
}
TRACES: Mapping[str, type[Together[Any]]] = {
    "trace": Traces,
    "demodulated_trace": Traces,
}


def combinations(settings: Mapping[str, Sequence[Scalar]]) -> list[dict[str, Scalar]]:
    """All combinations of values, by name."""
    values = itertools.product(*settings.values())
    return [dict(zip(settings, combination, strict=True)) for combination in values]


def are_positive(values: Sequence[float]) -> bool:
    """Whether there are numbers, all positive and finite."""
    return len(values) > 0 and all(0.0 < value < math.inf for value in values)


class BadLimit(BadInput):
    """A limit that no instrument can have: its field, and what was found and is wanted."""

    def __init__(self, name: str, words: str) -> None:
        super().__init__(f"limits: {name}: {words}")
        self.key, self.words = re.sub("_(hz|v|s)$", "", name), words


@dataclass(frozen=True, kw_only=True)
class SweepLimits:
    """Sweeps of a control sweep as candidates, instead of tones, each at values of its controls.

    Args:
        span_hz: From the first to the last frequency, Hz.
        points: Frequencies of a sweep, at least 8, evenly spaced.
        controls: Values of the controls to try, in the units of the campaign's control sweep;
            one that is not named keeps that of the last spectrum.

    Raises:
        BadInput: no span, or fewer points.
    """

    span_hz: float
    points: int
    controls: Mapping[str, tuple[Scalar, ...]]

    def __post_init__(self) -> None:
        if not 0.0 < self.span_hz < math.inf:
            raise BadLimit("sweeps", f"span_hz {self.span_hz!r}, wanted a positive number")
        if self.points < LEAST_POINTS:
            raise BadLimit("sweeps", f"{self.points} points, wanted {LEAST_POINTS} at least")
        if len(combinations(self.controls)) < 2:
            raise BadLimit(
                "sweeps",
                "one place of the controls, wanted two at least: a control sweep has several",
            )


@dataclass(frozen=True, kw_only=True)
class TraceLimits:
    """Recordings over time as candidates: each repeats a trace of the campaign.

    Args:
        of: Names of the traces whose start or drive is repeated.
        lengths_s: From the first to the last sample, s.
        spacings_s: Spacings of the samples, s, by the name of the trace.
        samples: That the recorder keeps, at most.

    Raises:
        BadInput: nothing to try, times that are not positive, fewer than 8 samples, or more than
            a design simulates.
    """

    of: tuple[str, ...]
    lengths_s: tuple[float, ...]
    spacings_s: Mapping[str, tuple[float, ...]]
    samples: int

    def __post_init__(self) -> None:
        if not self.of or set(self.spacings_s) != set(self.of):
            raise BadLimit("traces", "wanted one trace at least, and spacings of each")
        for values in (self.lengths_s, *self.spacings_s.values()):
            if not are_positive(values):
                raise BadLimit(
                    "traces", f"found times {values!r}, wanted positive ones, one at least"
                )
        if not LEAST_SAMPLES <= self.samples <= MOST_SAMPLES:
            raise BadLimit(
                "traces", f"{self.samples} samples, wanted {LEAST_SAMPLES} to {MOST_SAMPLES}"
            )


@checked
@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of the instrument.

    The error of a peak of amplitude A, averaged over n of ``repeats`` spectra:

        sigma^2 = noise_floor_v^2/n + (relative_noise A)^2

    Args:
        outputs: Outputs of the FMU that can be observed.
        centres_hz: Resonances around which tones are placed, Hz.
        frequency_step_hz: Grid of the tones, Hz.
        least_spacing_hz: Least distance of two tones, Hz.
        farthest_hz: Largest distance of a tone from a resonance, Hz.
        both_sides: Whether tones of a measurement are on both sides of the resonance.
        levels: Factors on the campaign's drive level.
        repeats: Numbers of averaged spectra.
        noise_floor_v: Of a peak in one spectrum, in the detector's unit.
        relative_noise: Share of a peak, not lowered by averaging.
        largest_v: Largest proposed amplitude, in the detector's unit.
        settings: Values of further FMU parameters to try, in their units.
        setting_sigmas: Errors of quantities that drift, in the FMU's unit, common to an experiment.
        number: Most measurements, 1 to 50.
        tones: Driven at once, 1 or 2.
        lines: Combinations of tones that are read; empty: the tones.
        phases: Whether phases are measured, against an unknown reference phase.
        sweeps: Sweeps around a single centre instead of tones; None: tones.
        traces: Recordings over time instead of tones, with noise ``noise_floor_v``, 0: that of the
            campaign's traces; None: tones.
        time_s: Of all next measurements, s; None: only their number is limited.
        spectrum_s: Of a spectrum, s.
        point_s: Of a point of a sweep, s.
        change_s: Of a change to another measurement, s.

    Raises:
        BadInput: a limit that no instrument can have.
    """

    outputs: tuple[str, ...]
    centres_hz: tuple[float, ...] = (1.0,)
    frequency_step_hz: float = 1.0
    least_spacing_hz: float = 1.0
    farthest_hz: float = 1.0
    both_sides: bool = True
    levels: tuple[float, ...] = (1.0,)
    repeats: tuple[int, ...] = (1,)
    noise_floor_v: float
    relative_noise: float = 0.0
    largest_v: float
    settings: Mapping[str, tuple[Scalar, ...]] = field(default_factory=dict)
    setting_sigmas: Mapping[str, float] = field(default_factory=dict)
    number: int = 6
    tones: int = 2
    lines: tuple[Combination, ...] = ()
    phases: bool = False
    sweeps: SweepLimits | None = None
    traces: TraceLimits | None = None
    time_s: float | None = None
    spectrum_s: float = 1.0
    point_s: float = 1.0
    change_s: float = 0.0

    def __post_init__(self) -> None:
        least = 1 if self.sweeps is None else 2
        lengths = "frequency_step_hz least_spacing_hz farthest_hz largest_v spectrum_s point_s"
        rules: tuple[tuple[str, Callable[[Any], bool], str], ...] = (
            (lengths, lambda v: bool(0.0 < v < math.inf), "a positive number"),
            ("time_s", lambda v: v is None or 0.0 < v < math.inf, "a positive number"),
            (
                "noise_floor_v relative_noise change_s",
                lambda v: bool(0.0 <= v < math.inf),
                "zero or more",
            ),
            ("centres_hz levels repeats", are_positive, "positive numbers, one at least"),
            ("repeats", lambda v: all(n == int(n) for n in v), "whole numbers"),
            ("outputs", lambda v: len(v) > 0, "one name at least"),
            ("tones", lambda v: v in (1, 2), "1 or 2"),
            ("number", lambda v: least <= v <= MOST_NUMBER, f"{least} to {MOST_NUMBER}"),
        )
        for names, is_good, wanted in rules:
            for name in names.split():
                if not is_good(getattr(self, name)):
                    raise BadLimit(name, f"found {getattr(self, name)!r}, wanted {wanted}")
        if self.sweeps is not None and len(self.centres_hz) > 1:
            raise BadLimit("centres_hz", f"found {self.centres_hz!r}, wanted the middle of sweeps")
        if self.sweeps is not None and not max(self.noise_floor_v, self.relative_noise) > 0.0:
            raise BadLimit("noise_floor_v", "found 0.0, wanted noise of the sweeps' points")
        if self.sweeps is not None and self.traces is not None:
            raise BadLimit("sweeps", "found traces, too; wanted sweeps or traces")
        for name in ("levels", "repeats"):
            object.__setattr__(self, name, tuple(sorted(set(getattr(self, name)))))

    @property
    def kind(self) -> str:
        """What is proposed: "tones", "sweeps" or "traces"."""
        return "sweeps" if self.sweeps else "tones" if self.traces is None else "traces"

    def sigmas(self, amplitudes_v: FloatArray, repeats: int) -> FloatArray:
        """Standard deviations of peaks of any shape, in the detector's unit.

        Args:
            amplitudes_v: of the peaks, in the detector's unit.
            repeats: number of spectra averaged.
        """
        floor = self.noise_floor_v / math.sqrt(repeats)
        return np.asarray(np.hypot(floor, self.relative_noise * amplitudes_v))

    def takes_s(self, choice: DriveChoice, repeats: int) -> float:
        """What a measurement takes of the laboratory, s.

        Args:
            choice: what is measured.
            repeats: number of spectra averaged.
        """
        if choice.recording is not None:
            return self.change_s + choice.recording.length_s
        points = choice.points
        return self.change_s + (points * self.point_s if points else repeats * self.spectrum_s)


# --- the table [design] -------------------------------------------------------------------------


@dataclass(frozen=True)
class DesignTable:
    """A table [design]: its keys, the file that it is in, and the keys that are written there.

    `elsewhere` are the files of keys that were taken over from another table.
    """

    path: Path
    keys: WrittenDesign
    written: frozenset[str] = frozenset()
    elsewhere: Mapping[str, Path] = field(default_factory=dict)

    def where(self, key: str) -> str:
        """The place of a key, for errors."""
        return f"{self.elsewhere.get(key, self.path)}: [design] {key}"

    def with_keys_of(self, other: DesignTable) -> DesignTable:
        """The table with all that the other one states; what that leaves out stays."""
        new = {key: getattr(other.keys, key) for key in other.written}
        for key in ("settings", "setting_sigma"):  # tables themselves, by variable
            if key in new:
                new[key] = {**getattr(self.keys, key), **new[key]}
        for requested, given_up in (("sweeps", "traces"), ("traces", "sweeps")):
            if requested in new:  # another kind of measurement
                new.setdefault(given_up, None)
        return DesignTable(
            path=self.path,
            keys=replace(self.keys, **new),
            written=self.written | other.written,
            elsewhere={**self.elsewhere, **dict.fromkeys(other.written, other.path)},
        )


@dataclass(frozen=True, kw_only=True)
class WrittenCandidates(Keys):
    """A file that holds limits and nothing else."""

    design: Annotated[WrittenDesign, Missing("wanted a table [design] with limits")]
    """The instrument's limits."""


def read_design_table(path: Path) -> DesignTable:
    """The table [design] of a campaign file, empty where there is none; may raise BadInput."""
    table = read_toml(path).get("design", {})
    return DesignTable(path, read_record(WrittenDesign, table, path, "design"), frozenset(table))


def read_candidates(path: Path) -> DesignTable:
    """The table [design] of a file that has to have one: nothing else, or a whole campaign.

    Raises:
        BadInput: no such file, not TOML, no such table, or a table or key that there is not.
    """
    tables = read_toml(path)
    if not any(name in tables for name in OF_A_CAMPAIGN):
        read_record(WrittenCandidates, tables, path)
    elif read_record(WrittenCampaign, tables, path) and "design" not in tables:
        raise BadInput(f"{path}: has no table [design], wanted one with limits")
    return read_design_table(path)


def refuse_wider(
    limits: Limits, own: DesignTable, where: Callable[[str], str], amplitude_unit: str
) -> None:
    """Refuse limits that go beyond what the campaign states of its instrument.

    Args:
        limits: that are to hold.
        own: the campaign's [design]; what it leaves out is no limit.
        where: place of a key of `limits`, for errors.
        amplitude_unit: the detector's.

    Raises:
        BadInput: one is wider.
    """
    keys = own.keys
    largest = None if keys.largest is None else positive_in(keys.largest, amplitude_unit)
    for key, value, most, unit in (
        ("levels", max(limits.levels), max(keys.levels or [math.inf]), ""),
        ("largest", limits.largest_v, largest or math.inf, amplitude_unit),
        ("farthest", limits.farthest_hz, keys.farthest or math.inf, "Hz"),
        ("least_spacing", -limits.least_spacing_hz, -(keys.least_spacing or 0.0), "Hz"),
    ):
        if value > most + ROUNDING * abs(most):
            wanted = "at most" if most > 0.0 else "at least"
            high, low = (f"{abs(v):.9g} {unit}".rstrip() for v in (value, most))
            raise BadInput(
                f"{where(key)}: found {high}, wanted {wanted} the {low} of {own.where(key)}"
            )
    if limits.phases and keys.phases is False:
        raise BadInput(
            f"{where('phases')}: found true, wanted false as in {own.where('phases')}: the "
            "detector measures none"
        )
    outputs = keys.outputs or limits.outputs
    for name in set(limits.outputs) - set(outputs):
        raise BadInput(
            f"{where('outputs')}: '{name}' is none of those of {own.where('outputs')}, wanted some "
            f"of {', '.join(outputs)}"
        )


def check_names(
    limits: Limits, variables: Mapping[str, FmuVariable], controls: Mapping[str, str]
) -> None:
    """Refuse names and values of limits made by a program that neither FMU nor laws have.

    Args:
        limits: made by a program.
        variables: of the FMU, by name.
        controls: units of the control quantities of laws, by name.

    Raises:
        BadInput: an unknown variable, or a value of the wrong kind.
    """
    binder = _binder(variables, controls)
    for name in limits.outputs:
        binder.real(name, "limits: outputs", READABLE, "observed")
    for name in limits.setting_sigmas:
        binder.real(name, "limits: setting_sigmas", SETTABLE, "set")
    for name, values in limits.settings.items():
        where = f"limits: settings '{name}'"
        _settings(binder, {name: [Written(value, None, where) for value in values]})


def _binder(
    variables: Mapping[str, FmuVariable], units: Mapping[str, str], named: Iterable[str] = ()
) -> Binder:
    """Of the FMU's variables, and of control quantities in their units."""
    binder = Binder(variables, {*units, *named})
    binder.control_units.update({name: unit for name, unit in units.items() if unit})
    return binder


def _settings(
    binder: Binder, written: Mapping[str, Sequence[Written]]
) -> dict[str, tuple[Scalar, ...]]:
    """Values to try, by name; a plain number is in the unit of the control quantity."""
    result = {}
    for name, values in written.items():
        own = binder.control_units.get(name)
        is_plain = [v.unit is None and not isinstance(v.value, str) for v in values]
        pairs = zip(values, is_plain, strict=True)
        result[name] = tuple(
            binder.setting(name, replace(v, unit=own) if plain else v) for v, plain in pairs
        )
    return result


# --- what new measurements continue -------------------------------------------------------------


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
    def unit(self) -> str:
        """Of the values of sweeps, or of the first trace."""
        is_sweep = isinstance(self.kind, ControlSweep)
        return str(self.kind.unit if is_sweep else self.records[0].unit)

    @property
    def columns(self) -> tuple[str, ...]:
        """What is measured at every point of a sweep."""
        return ("amplitude",) if isinstance(self.kind, ControlSweep) else ("X", "Y")

    def with_controls(self, controls: Mapping[str, Scalar]) -> dict[str, Scalar]:
        """Settings of the last sweep, some of them others.

        Args:
            controls: values by name.

        Raises:
            BadInput: an unknown control.
        """
        settings = dict(self.records[-1].settings)
        for name in controls:
            if name not in settings:
                raise BadInput(
                    f"[design] sweeps: '{name}' is no control of [{self.table}]; wanted some of "
                    f"{', '.join(settings)}"
                )
        return {**settings, **controls}

    def repeatable(self, labels: Sequence[str], where: str) -> list[TimeRecord]:
        """The traces of these names, of one unit, each of a kind that can be repeated.

        Args:
            labels: names, one at least.
            where: what errors name.

        Raises:
            BadInput: an unknown name, several units, a drive from an unknown start, amplitudes
                without phases.
        """
        result = []
        for label in labels:
            if label not in self.labels:
                known = ", ".join(filter(None, self.labels)) or "a single one without a name"
                raise BadInput(
                    f"{where}: '{label}' is no trace of [[{self.table}]]; wanted some of {known}"
                )
            record = self.records[self.labels.index(label)]
            name = f"trace '{label}'" if label else "the trace"
            if isinstance(record, DemodulatedTrace) and record.is_amplitude:
                raise BadInput(
                    f"{where}: {name} has amplitudes without phases, and recordings of X and Y are "
                    "proposed; wanted records with phases, by their names in 'of'"
                )
            driven = isinstance(record, Trace) and record.driven is not None
            if driven and record.has_unknown_start:
                raise BadInput(
                    f"{where}: {name} is driven from an unknown start, of which nothing is known "
                    "in a new recording; wanted ringdowns, or traces from rest, by their names in "
                    "'of'"
                )
            result.append(record)
        units = dict.fromkeys(record.unit for record in result)
        if len(units) > 1:
            raise BadInput(
                f"{where}: the traces have values in {listed(units)}; wanted traces of one unit, "
                "by their names in 'of'"
            )
        return result


def required(bound: BoundCampaign, tables: Mapping[str, type[Together[Any]]]) -> Continued:
    """What a campaign has of some kinds, of the first that it has.

    Args:
        bound: campaign, bound to its FMU.
        tables: `SWEEPS` or `TRACES`.

    Raises:
        BadInput: it has none.
    """
    for table, kind in tables.items():
        if isinstance(bound.measurements.get(table), kind):
            return Continued(table, bound.measurements[table])
    kind_name = "sweeps" if tables is SWEEPS else "traces"
    names = " or ".join(f"[[{n}]]" if tables is TRACES else f"[{n}]" for n in tables)
    raise BadInput(
        f"{bound.path}: [design] {kind_name}: has no table {names}, which could be continued; "
        f"wanted one, or no {kind_name}"
    )


def longest_s(record: TimeRecord) -> float:
    """How long a recording like a trace may be, s: as its recorded inputs, else any time.

    Args:
        record: a trace.
    """
    if not isinstance(record, Trace):
        return math.inf
    ends = [float(w.time_s[-1]) for w in record.waveforms.values() if isinstance(w, Recorded)]
    return min(ends, default=math.inf) - float(record.t[0])


def unit_of(bound: BoundCampaign, limits: Limits) -> str:
    """Of the values that would be measured.

    Args:
        bound: the campaign that is to be continued.
        limits: of the instrument.
    """
    if limits.traces is not None:
        return required(bound, TRACES).repeatable(limits.traces.of, "limits: traces")[0].unit
    return bound.amplitude_unit if limits.sweeps is None else required(bound, SWEEPS).unit


# --- from the table to limits -------------------------------------------------------------------


def limits_of(
    bound: BoundCampaign,
    variables: Mapping[str, FmuVariable],
    table: DesignTable,
    read: tuple[Combination, ...] = (),
) -> Limits:
    """Limits of a bound campaign's instrument from a table [design].

    What it leaves out is taken from the campaign: outputs like the observed one (same unit, same
    name but for digits), resonances at the sweep's maximum and at every drifting frequency, the
    grid, least spacing and largest detuning of its own drive frequencies, the noise of its peaks.
    Of a campaign of a map alone sweeps are proposed, at the values of its controls so far, of one
    of traces alone recordings like these; unless tones are asked for.

    Args:
        bound: campaign, bound to its FMU.
        variables: of the FMU, by name.
        table: [design], as it was read.
        read: lines that the instrument reads, empty for the tones themselves.

    Raises:
        BadInput: a value of the wrong kind or unit, an unknown variable, nothing to place tones by.
    """
    keys, measured = table.keys, set(bound.measurements)
    alone = not (bound.experiments or bound.sweep or table.written & {*OF_TONES, "centres"})
    by_itself = alone and keys.sweeps is None and keys.traces is None
    has_sweeps = any(isinstance(bound.measurements.get(t), kind) for t, kind in SWEEPS.items())
    try:
        if keys.sweeps is not None or (by_itself and has_sweeps):
            limits = _of_sweeps(bound, variables, table)
        elif keys.traces is not None or (by_itself and measured and measured <= set(TRACES)):
            limits = _of_traces(bound, table)
        else:
            limits = _of_tones(bound, variables, table, read)
        given: dict[str, Any] = {
            # where a time is given that counts, and the number hardly
            "number": keys.number or (None if keys.time is None else MOST_NUMBER),
            "time_s": keys.time,
            "spectrum_s": keys.spectrum_time,
            "point_s": keys.point_time,
            "change_s": keys.change_time,
        }
        return replace(limits, **{name: v for name, v in given.items() if v is not None})
    except BadLimit as error:
        raise BadInput(f"{table.where(error.key)}: {error.words}") from error


def _amplitude(written: Written | None, unit: str, default: float) -> float:
    return default if written is None else positive_in(written, unit)


def _of_tones(
    bound: BoundCampaign,
    variables: Mapping[str, FmuVariable],
    table: DesignTable,
    read: tuple[Combination, ...],
) -> Limits:
    keys, drive, sweep, unit = table.keys, bound.setup.drive, bound.sweep, bound.amplitude_unit
    if drive.kind == "none":
        raise BadInput(
            f"{bound.path}: has no [drive], wanted one: tones are proposed where [design] asks for "
            "neither sweeps nor traces"
        )
    levels = keys.levels or (LEVELS if drive.kind == "tones" else (1.0,))
    if drive.kind != "tones" and set(levels) != {1.0}:
        raise BadInput(f"{table.where('levels')}: has no meaning with a drive through the input")
    repeats = keys.repeats or REPEATS
    if any(v != int(v) for v in repeats):
        raise BadInput(f"{table.where('repeats')}: found {repeats!r}, wanted whole numbers")
    # tones at once: the campaign's, one where it has a sweep only
    driven = len(drive.frequency_names)
    tones = keys.tones or (driven if bound.experiments else 1)
    if tones > min(2, driven):
        raise BadInput(
            f"{table.where('tones')}: {tones} tones; a design places one or two, as many as "
            "[drive] has at most"
        )
    centres = _centres(bound, variables, table)
    grid = (keys.frequency_step, keys.least_spacing, keys.farthest)
    own = _own_grid(bound, centres) if None in grid else (1.0, 1.0, 1.0)
    step, spacing, farthest = (value or usual for value, usual in zip(grid, own, strict=True))
    # noise that is declared, else the peaks' median, else the scatter about the sweep's maximum
    noise = bound.noise.absolute_v
    sigmas = np.concatenate([np.zeros(0), *(e.sigmas_v for e in bound.experiments)])
    known = sigmas[np.isfinite(sigmas) & (sigmas > 0.0)]
    if noise == 0.0 and known.size:
        noise = float(np.median(known))
    elif noise == 0.0 and sweep is not None:
        top = laboratory_maximum(sweep.frequency_hz, sweep.amplitude_v)
        noise = top.scatter * top.value_v
    peaks = [e.peaks_v for e in bound.experiments] + ([] if sweep is None else [sweep.amplitude_v])
    if keys.largest is None and not peaks:
        raise BadInput(
            f"{table.where('largest')}: wanted what the detector bears: neither experiments nor a "
            "sweep show amplitudes"
        )
    largest = HEADROOM * max((float(np.max(each)) for each in peaks), default=0.0)
    relative = bound.noise.relative or RELATIVE_NOISE
    has_phases = any(e.phases_rad is not None for e in bound.experiments)
    binder = _binder(variables, bound.setup.laws.controls)
    return Limits(
        outputs=_outputs(bound, variables, table),
        centres_hz=centres,
        frequency_step_hz=step,
        least_spacing_hz=spacing,
        farthest_hz=farthest,
        both_sides=keys.both_sides,
        levels=tuple(map(float, levels)),
        repeats=tuple(map(int, repeats)),
        noise_floor_v=_amplitude(keys.noise_floor, unit, noise),
        relative_noise=relative if keys.relative_noise is None else keys.relative_noise,
        largest_v=_amplitude(keys.largest, unit, largest),
        settings=_settings(binder, keys.settings),
        setting_sigmas=_setting_sigmas(bound, binder, table),
        tones=tones,
        lines=() if all(line.order == 1 for line in read) else read,
        phases=has_phases if keys.phases is None else keys.phases,
    )


def _outputs(
    bound: BoundCampaign, variables: Mapping[str, FmuVariable], table: DesignTable
) -> tuple[str, ...]:
    """Those of the table, else the observed ones and outputs of the same unit named alike."""
    if table.keys.outputs is not None:
        for name in table.keys.outputs:
            Binder(variables).real(name, table.where("outputs"), READABLE, "observed")
        return table.keys.outputs
    observed = bound.setup.output
    alike = re.compile(re.sub(r"\d+", r"\\d+", re.escape(observed)))
    others = [
        name
        for name, v in variables.items()
        if v.causality == "output" and v.unit == variables[observed].unit and alike.fullmatch(name)
    ]
    used = [observed, *(e.output for e in bound.experiments if e.output)]
    return tuple(dict.fromkeys([*used, *others]))


def _centres(
    bound: BoundCampaign, variables: Mapping[str, FmuVariable], table: DesignTable
) -> tuple[float, ...]:
    """Resonances in Hz: as written, else what drifts, the sweep's maximum or the drive's mean."""
    sweep, ends = bound.sweep, bound.drift.ends.items()
    if table.keys.centres is not None:
        return tuple(sorted(in_unit(written, "Hz") for written in table.keys.centres))
    centres = sorted(
        convert(after, variables[name].unit or "Hz", "Hz", where="[drift]")
        for name, (_, after) in ends
        if same_kind(variables[name].unit or "1", "Hz")
    )
    if not centres and sweep is not None:
        centres = [laboratory_maximum(sweep.frequency_hz, sweep.amplitude_v).frequency_hz]
    if not centres and bound.experiments:
        centres = [float(np.mean([f for e in bound.experiments for f in e.tones_hz]))]
    if not centres:
        raise BadInput(f"{table.where('centres')}: wanted frequencies to place the tones around")
    return tuple(centres)


def _own_grid(bound: BoundCampaign, centres: tuple[float, ...]) -> tuple[float, float, float]:
    """Step, least spacing and farthest detuning of the campaign's own tones, Hz."""
    pairs = [sorted(e.tones_hz) for e in bound.experiments]
    tones, sweep = sorted({round(f) for pair in pairs for f in pair}), bound.sweep
    if len(tones) < 2:  # a tenth of a line width, down to one digit: a number that a dial shows
        width = bound.setup.line_width_hz
        if width is None and sweep is None:
            raise BadInput(
                f"{bound.path}: [design]: wanted frequency_step, least_spacing and farthest: "
                "neither drive frequencies nor a sweep determine them"
            )
        if width is None and sweep is not None:
            width = half_power_width(sweep.frequency_hz, sweep.amplitude_v)
        digit = f"{0.1 * float(width or 0.0):.17e}"
        step = float(digit[0] + digit[digit.index("e") :])
        return step, 2.0 * step, 15.0 * step
    spacings = [b - a for pair in pairs for a, b in pairwise(pair)]
    farthest = max(0.5 * (pair[-1] - pair[0]) for pair in pairs)
    if not spacings:  # single tones: how far they are from the nearest resonance
        farthest = max(min(abs(f - c) for c in centres) for f in tones)
    step = max(float(np.gcd.reduce(np.diff(tones))), farthest / 50.0)
    return step, min(spacings, default=step), max(farthest, 2.0 * step)


def _setting_sigmas(bound: BoundCampaign, binder: Binder, table: DesignTable) -> dict[str, float]:
    """Errors of what is set to the value that is assumed, by FMU variable."""
    ends = bound.drift.ends.items()
    sigmas = {name: OFF_THE_LINE * abs(after - before) for name, (before, after) in ends}
    for parameter in bound.offsets:  # that the campaign fits: their own prior
        if parameter.prior_sigma is not None:
            sigmas.update(dict.fromkeys(parameter.adds_to, parameter.prior_sigma))
    for name, written in table.keys.setting_sigma.items():
        variable = binder.real(name, written.where, SETTABLE, "set")
        sigmas[name] = in_unit(written, variable.unit, difference=True)
        if sigmas[name] < 0.0:
            raise BadInput(f"{written.where}: found {written.value!r}, wanted zero or more")
    return {name: sigma for name, sigma in sigmas.items() if sigma > 0.0}


def _refuse_keys(bound: BoundCampaign, table: DesignTable, kind: str, keys: set[str]) -> None:
    """Refuse keys that mean nothing for a kind, and what is fitted to each of its records."""
    for key in sorted(keys & table.written):
        raise BadInput(
            f"{table.where(key)}: has no meaning together with {kind}, which are proposed in place "
            "of tones"
        )
    own = next((p.name for p in bound.parameters if p.experiments), None)
    if own is not None:
        raise BadInput(
            f"{table.where(kind)}: '{own}' is fitted to single {kind}, and nothing is known of it "
            f"in a new one; wanted parameters that all {kind} share"
        )


def _of_sweeps(
    bound: BoundCampaign, variables: Mapping[str, FmuVariable], table: DesignTable
) -> Limits:
    like, keys = required(bound, SWEEPS), table.keys
    _refuse_keys(bound, table, "sweeps", OF_TONES)
    is_control = isinstance(like.kind, ControlSweep)
    if is_control and any(np.any(s.level != 1.0) for s in like.records):
        raise BadInput(
            f"{table.where('sweeps')}: the spectra of [{like.table}] have a drive of their own; "
            "wanted sweeps with one amplitude of the drive"
        )
    first = min(float(s.u_hz[0]) for s in like.records)
    last = max(float(s.u_hz[-1]) for s in like.records)
    centres: tuple[float, ...] = (0.5 * (first + last),)
    if keys.centres is not None:
        centres = tuple(in_unit(written, "Hz") for written in keys.centres)
    requested, controls = keys.sweeps or WrittenSweeps(controls={}), {}
    if keys.sweeps is None:  # values of the controls so far, some over the whole range of each
        names = like.with_controls({})
        most = max(2, round(TRIED ** (1.0 / max(1, len(names)))))
        for name in names:
            values = sorted({s.settings[name] for s in like.records}, key=float)
            some = np.unique(np.round(np.linspace(0, len(values) - 1, most)).astype(int))
            controls[name] = tuple(values[k] for k in some)
    else:
        like.with_controls(dict.fromkeys(requested.controls, 0.0))
        binder = _binder(variables, like.kind.units, bound.setup.laws.names)
        controls = _settings(binder, requested.controls)
    sweeps = SweepLimits(
        span_hz=requested.span or last - first,
        points=requested.points or max(s.u_hz.size for s in like.records),
        controls=controls,
    )
    step_hz = sweeps.span_hz / (sweeps.points - 1)
    # sigma^2 = floor^2 + (relative A)^2 over the measured points, where it is stated; the median of
    # what the sweeps' scatter shows elsewhere
    amplitude = np.concatenate([np.abs(s.y) for s in like.records])
    if is_control:
        sigma = np.concatenate([s.sigmas for s in like.records])
        is_estimated = like.kind.estimated
    else:
        each = [np.full(c.y.size, c.sigma or c.scatter()) for c in like.records]
        sigma, is_estimated = np.concatenate(each), any(c.sigma == 0.0 for c in like.records)
    largest = float(np.max(amplitude))
    parts = np.array([float(np.median(sigma / largest)), 0.0])
    if not is_estimated:
        matrix = np.column_stack([np.ones(amplitude.size), (amplitude / largest) ** 2])
        squares = np.linalg.lstsq(matrix, (sigma / largest) ** 2, rcond=None)[0]
        parts = np.sqrt(np.maximum(squares, 0.0))
        parts[parts < NO_NOISE * parts.max()] = 0.0
    floor = _amplitude(keys.noise_floor, like.unit, float(f"{largest * float(parts[0]):.9g}"))
    relative = float(parts[1]) if keys.relative_noise is None else keys.relative_noise
    if not (floor > 0.0 or relative > 0.0):
        raise BadInput(
            f"{table.where('noise_floor')}: is not there and [{like.table}] states no noise; "
            "wanted that of a point of a sweep"
        )
    return Limits(
        outputs=(like.kind.output_of(like.records[-1]),),
        centres_hz=centres,
        frequency_step_hz=step_hz,
        least_spacing_hz=step_hz,
        farthest_hz=0.5 * sweeps.span_hz,
        noise_floor_v=floor,
        relative_noise=relative,
        largest_v=_amplitude(keys.largest, like.unit, HEADROOM * largest),
        sweeps=sweeps,
    )


def _of_traces(bound: BoundCampaign, table: DesignTable) -> Limits:
    like, keys = required(bound, TRACES), table.keys
    requested = keys.traces or WrittenTraces()
    _refuse_keys(bound, table, "traces", NOT_OF_TRACES)
    of = tuple(dict.fromkeys(requested.of or like.labels))
    records = like.repeatable(of, table.where("traces"))
    unit, lengths, samples = records[0].unit, requested.lengths, requested.samples
    if lengths is None:
        longest = max((record.y.size - 1) * record.spacing_s for record in records)
        # of a recorded input no more is known than was recorded
        endless = max(map(longest_s, records)) == math.inf
        lengths = tuple(share * longest for share in LENGTHS if share <= 1.0 or endless)
    if samples is None:
        samples = min(round(HEADROOM * max(r.y.size for r in like.records)), MOST_SAMPLES)
    observed = max(float(np.max(np.abs(record.y))) for record in records)
    return Limits(
        outputs=tuple(dict.fromkeys(like.kind.output_of(record) for record in records)),
        noise_floor_v=_amplitude(keys.noise_floor, unit, 0.0),
        largest_v=_amplitude(keys.largest, unit, HEADROOM * observed),
        tones=1,
        traces=TraceLimits(
            of=of,
            lengths_s=tuple(sorted(set(lengths))),
            spacings_s={
                r.label: tuple(sorted(set(requested.spacings or (r.spacing_s,)))) for r in records
            },
            samples=samples,
        ),
    )
