"""What could be measured next: an instrument's limits, and every setup within them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitting import Drive
from fitting.campaign import Experiment, Phases
from fitting.campaign.control_table import LEAST_POINTS
from fitting.design.result import DriveChoice
from fitting.extension.records import BoundCampaign
from fitting.measurements.traces.grid import LEAST_SAMPLES
from fitting.signal.combinations import Combination
from fitting.text.arguments import checked
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import hertz
from fitting.text.units import convert

#: Offsets of a tone from the middle of a resonance, at most; a finer grid is thinned to it.
MOST_OFFSETS = 24
#: Measurements, at most, that are proposed.
MOST_NUMBER = 50
#: Samples of a recording, at most: a design simulates it many times.
MOST_SAMPLES = 200_000
#: Setups, at most, that are simulated.
MOST_SETUPS = 20_000


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
            raise BadInput(f"limits: sweeps: span_hz {self.span_hz!r}, wanted a positive number")
        if self.points < LEAST_POINTS:
            raise BadInput(f"limits: sweeps: {self.points} points, wanted {LEAST_POINTS} at least")
        if len(combinations(self.controls)) < 2:
            raise BadInput(
                "limits: sweeps: one place of the controls, wanted two at least: a control sweep "
                "has several"
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
            a design looks at.
    """

    of: tuple[str, ...]
    lengths_s: tuple[float, ...]
    spacings_s: Mapping[str, tuple[float, ...]]
    samples: int

    def __post_init__(self) -> None:
        if not self.of or set(self.spacings_s) != set(self.of):
            raise BadInput("limits: traces: wanted one trace at least, and spacings of each")
        for values in (self.lengths_s, *self.spacings_s.values()):
            if not values or not all(0.0 < v < math.inf for v in values):
                raise BadInput(
                    f"limits: traces: found times {values!r}, wanted positive ones, one at least"
                )
        if not LEAST_SAMPLES <= self.samples <= MOST_SAMPLES:
            raise BadInput(
                f"limits: traces: {self.samples} samples, wanted {LEAST_SAMPLES} to {MOST_SAMPLES}"
            )


@checked
@dataclass(frozen=True, kw_only=True)
class Limits:
    """What the instrument can do.

    A peak of amplitude A, averaged over n of ``repeats`` spectra, is known to

        sigma^2 = noise_floor_v^2/n + (relative_noise A)^2

    Args:
        outputs: FMU outputs that can be observed.
        centres_hz: Resonances, Hz, around which the tones are placed.
        frequency_step_hz: Of the grid on which tones lie, Hz.
        least_spacing_hz: Least distance of two tones, Hz.
        farthest_hz: Largest distance of a tone from a resonance, Hz.
        both_sides: Tones of one measurement lie on both sides of the resonance.
        levels: Factors on the campaign's drive level.
        repeats: Numbers of spectra that are averaged.
        noise_floor_v: Of a peak in one spectrum, in the detector's unit.
        relative_noise: Of a peak as a share of it; averaging does not lower it.
        largest_v: Largest amplitude that is proposed, in the detector's unit.
        settings: Values of further FMU parameters to try, in their units.
        setting_sigmas: Errors, in the FMU's unit, of what the laboratory believes of quantities
            that drift: common to the tones of one experiment, new in the next.
        number: Measurements, at most, 1 to 50.
        tones: That are driven at once, 1 or 2.
        lines: Read at combinations of the tones; empty: at the tones.
        phases: The detector tells phases as well, against a reference phase that is unknown.
        sweeps: Whole sweeps are measured instead of tones, around the only one of the centres.
        traces: Recordings over time are made instead of tones, which have a noise of
            ``noise_floor_v``, 0 for that of the traces so far; what places tones is not used.
        time_s: Of the laboratory for all next measurements, s; None: their number alone counts.
        spectrum_s: What a spectrum takes, s.
        point_s: What a point of a sweep takes, s.
        change_s: What the change to another measurement takes, s.

    Raises:
        BadInput: a limit that no instrument can have.
    """

    outputs: tuple[str, ...]
    centres_hz: tuple[float, ...]
    frequency_step_hz: float
    least_spacing_hz: float
    farthest_hz: float
    both_sides: bool
    levels: tuple[float, ...]
    repeats: tuple[int, ...]
    noise_floor_v: float
    relative_noise: float
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
        above = ("frequency_step_hz", "least_spacing_hz", "farthest_hz", "largest_v")
        for name in (*above, "spectrum_s", "point_s"):
            self._check(name, getattr(self, name) > 0.0, "a positive number")
        self._check("time_s", self.time_s is None or self.time_s > 0.0, "a positive number")
        for name in ("noise_floor_v", "relative_noise", "change_s"):
            self._check(name, getattr(self, name) >= 0.0, "zero or more")
        for name in ("centres_hz", "levels", "repeats"):
            values = getattr(self, name)
            good = len(values) > 0 and all(0.0 < v < math.inf for v in values)
            self._check(name, good, "positive numbers, one at least")
        self._check("outputs", len(self.outputs) > 0, "one name at least")
        whole = all(v == int(v) for v in self.repeats)
        self._check("repeats", whole, "whole numbers")
        self._check("tones", self.tones in (1, 2), "1 or 2")
        self._check("number", 1 <= self.number <= MOST_NUMBER, f"1 to {MOST_NUMBER}")
        if self.sweeps is not None:
            self._check("number", self.number >= 2, f"2 to {MOST_NUMBER} sweeps")
            self._check("centres_hz", len(self.centres_hz) == 1, "one, the middle of the sweeps")
            self._check("noise_floor_v", self.sigma(1.0, 1) > 0.0, "noise of the sweeps' points")
            self._check("sweeps", self.traces is None, "sweeps or traces, not both")
        for name in ("levels", "repeats"):
            object.__setattr__(self, name, tuple(sorted(set(getattr(self, name)))))

    def _check(self, name: str, good: bool, wanted: str) -> None:
        value = getattr(self, name)
        if not good or (isinstance(value, float) and not math.isfinite(value)):
            raise BadInput(f"limits: {name}: found {value!r}, wanted {wanted}")

    def sigma(self, amplitude_v: float, repeats: int) -> float:
        """Standard deviation of a peak, see the class; in the detector's unit.

        Args:
            amplitude_v: of the peak, in the detector's unit.
            repeats: number of spectra averaged.
        """
        return float(self.sigmas(np.array(amplitude_v), repeats))

    def sigmas(self, amplitudes_v: FloatArray, repeats: int) -> FloatArray:
        """Standard deviations of peaks, in the detector's unit.

        Args:
            amplitudes_v: any shape, in the detector's unit.
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


@dataclass(frozen=True, kw_only=True)
class Setup(DriveChoice):
    """Tones to measure; `experiment` is what is simulated for them."""

    experiment: Experiment

    @property
    def words(self) -> str:
        """The setup in words."""
        said = f"{self.output} at {hertz(*self.tones_hz, digits=9)}"
        if self.level != 1.0:
            said += f", {self.level:g} times the drive level"
        return said + "".join(f", {name} = {value}" for name, value in self.settings.items())


def setups_of(bound: BoundCampaign, limits: Limits) -> tuple[Setup, ...]:
    """Every setup within the limits, in a fixed order.

    Args:
        bound: the campaign that is to be continued.
        limits: of the instrument.

    Raises:
        BadInput: nothing lies within the limits, too much does, or a drive of more than two tones.
    """
    places = [(c, tones) for c in limits.centres_hz for tones in _tones(bound, limits, c)]
    combined = combinations(limits.settings)
    count = len(places) * len(limits.outputs) * len(limits.levels) * len(combined)
    if not count:
        raise BadInput(
            f"{bound.path}: no drive frequencies lie within the limits: step "
            f"{limits.frequency_step_hz:g} Hz, spacing {limits.least_spacing_hz:g} Hz, farthest "
            f"{limits.farthest_hz:g} Hz; wanted a farthest detuning of several steps"
        )
    if count > MOST_SETUPS:
        raise BadInput(
            f"{bound.path}: {count} setups lie within the limits, wanted at most {MOST_SETUPS}: a "
            "coarser frequency_step, or fewer levels, outputs or settings"
        )
    base = base_settings(bound)
    drives = itertools.product(places, limits.outputs, limits.levels, combined)
    return tuple(
        _setup(
            bound,
            limits,
            base,
            DriveChoice(
                centre_hz=centre, tones_hz=tones, output=output, level=level, settings=chosen
            ),
        )
        for (centre, tones), output, level, chosen in drives
    )


def combinations(settings: Mapping[str, Sequence[Scalar]]) -> list[dict[str, Scalar]]:
    """All combinations of values, by name.

    Args:
        settings: values to try of each.
    """
    values = itertools.product(*settings.values())
    return [dict(zip(settings, combination, strict=True)) for combination in values]


def _tones(bound: BoundCampaign, limits: Limits, centre_hz: float) -> list[tuple[float, ...]]:
    """Tones around one centre, on the instrument's grid."""
    step = limits.frequency_step_hz
    middle = round(centre_hz / step) * step
    reach = math.floor(limits.farthest_hz / step + 1e-9)
    stride = max(1, math.ceil((2 * reach + 1) / MOST_OFFSETS))
    offsets = [k for k in range(-reach, reach + 1) if k % stride == 0]
    if limits.tones == 1:
        return [(middle + k * step,) for k in offsets if middle + k * step > 0.0]
    pairs = [
        (middle + low * step, middle + high * step)
        for low, high in itertools.combinations(offsets, 2)
        if (high - low) * step >= limits.least_spacing_hz * (1.0 - 1e-9)
        and (low < 0 < high or not limits.both_sides)
    ]
    return [pair for pair in pairs if pair[0] > 0.0]


def levels_and_more(
    source: Drive, tones: int, level: float, chosen: Mapping[str, Scalar]
) -> dict[str, Scalar]:
    """What a setup sets beside its tones: drive amplitudes (zero of tones that are not driven).

    Args:
        source: the campaign's drive.
        tones: that are driven at once.
        level: factor on the campaign's drive level.
        chosen: further settings, in the FMU's units.
    """
    names = source.amplitude_names if source.kind == "tones" else ()
    amplitudes = {name: level * source.amplitude * (k < tones) for k, name in enumerate(names)}
    return {**amplitudes, **chosen}


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
    base.update({name: after for name, (_, after) in bound.drift.ends.items()})
    return base


def _setup(
    bound: BoundCampaign, limits: Limits, base: Mapping[str, Scalar], drive: DriveChoice
) -> Setup:
    """A setup with what is simulated for it: `base` is set besides, the limits' lines are read."""
    tones, source = drive.tones_hz, bound.setup.drive
    settings = {**base, **levels_and_more(source, len(tones), drive.level, drive.settings)}
    if source.kind == "tones":
        for name, tone in zip(source.frequency_names, tones, strict=False):
            where = f"{bound.path}: [drive] frequencies"
            settings[name] = convert(tone, "Hz", source.tone_unit, where=where)
    read = tuple(line.frequency_hz(tones) for line in limits.lines)
    blank = np.full(len(read or tones), np.nan)
    return Setup(
        tones_hz=tones,
        centre_hz=drive.centre_hz,
        output=drive.output,
        level=drive.level,
        settings=dict(drive.settings),
        experiment=Experiment(
            label="",
            settings=settings,
            tones_hz=tones,
            peaks_v=blank,
            sigmas_v=blank,
            floor_v=0.0,
            spectrum=None,
            lines_hz=read,
            output=drive.output,
            phases=Phases(radians=np.zeros(blank.size), unknown="none") if limits.phases else None,
        ),
    )


def as_campaign(bound: BoundCampaign, setups: Sequence[Setup]) -> BoundCampaign:
    """The campaign with these setups as its experiments, to be planned and simulated alike.

    Args:
        bound: the campaign that is to be continued.
        setups: not measured yet.
    """
    named = [replace(s.experiment, label=f"setup {i + 1}") for i, s in enumerate(setups)]
    return replace(bound, experiments=tuple(named))
