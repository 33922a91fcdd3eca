"""What was measured, as records: spectra, peaks of experiments, the frequency response.

`fitting.campaign.data` makes them of files; they are made of arrays as well, and refuse arrays that
no measurement can be. Amplitudes are peak values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from fitting.signal.peaks import MIN_SWEEP_POINTS
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, how_many
from fitting.text.numbers import as_numbers, require_size
from fitting.text.written import Written

#: Named in complaints about what comes from no file.
NO_FILE = Path("arrays")
MIN_SPECTRUM_POINTS = 3
#: What may be unknown of a detector that tells phases.
UNKNOWN = ("phase", "gain", "none")


@dataclass(frozen=True)
class Spectrum:
    """A measured spectrum: ``frequency_hz`` (n,), ``amplitude_v`` (n,) peak, in ``unit``.

    Raises:
        BadInput: arrays of different lengths or too short, frequencies that do not rise from above
            zero, amplitudes that are negative or no numbers.
    """

    frequency_hz: FloatArray
    amplitude_v: FloatArray
    _: KW_ONLY
    source: Path = NO_FILE
    unit: str = "V"

    def __post_init__(self) -> None:
        _as_arrays(self, "frequency_hz", "amplitude_v")
        _check_curve(self.frequency_hz, self.amplitude_v, MIN_SPECTRUM_POINTS, str(self.source))


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredSweep:
    """The FRF sweep: ``frequency_hz``, ``amplitude_v`` peak, ``phase_rad`` or None, (n,) each.

    ``unit`` is the detector's; ``notes`` are header entries of the instrument; ``left_out`` says
    which points of the file are not among them, and why.

    Raises:
        BadInput: as `Spectrum`, fewer than 8 points, or every amplitude zero.
    """

    frequency_hz: FloatArray
    amplitude_v: FloatArray
    phase_rad: FloatArray | None = None
    source: Path = NO_FILE
    unit: str = "V"
    notes: Mapping[str, str] = field(default_factory=dict)
    left_out: str = ""

    def __post_init__(self) -> None:
        _as_arrays(self, "frequency_hz", "amplitude_v", "phase_rad")
        _check_sweep(self.frequency_hz, self.amplitude_v, str(self.source))
        if self.phase_rad is not None:
            _check_numbers(self.phase_rad, self.frequency_hz.size, f"{self.source}: phases")


def _check_sweep(frequency_hz: FloatArray, amplitude_v: FloatArray, where: str) -> None:
    if frequency_hz.size < MIN_SWEEP_POINTS:
        raise BadInput(
            f"{where}: {how_many(frequency_hz.size, 'point is', 'points are')} too few for a "
            "sweep; "
            f"wanted at least {MIN_SWEEP_POINTS}"
        )
    _check_curve(frequency_hz, amplitude_v, MIN_SWEEP_POINTS, where)
    if not np.any(amplitude_v > 0.0):
        raise BadInput(f"{where}: every amplitude is zero; wanted a resonance")


@dataclass(frozen=True, kw_only=True)
class Phases:
    """Phases of an experiment's lines: peak i is peaks_v[i] exp(i radians[i]) exp(i 2 pi u t).

    ``radians`` (n,); ``unknown`` is what nobody knows of the detector, one for a campaign: "phase",
    "gain" (complex) or "none"; ``restarted``: from here on its phase is another one.

    Raises:
        BadInput: phases that are no numbers, another word.
    """

    radians: FloatArray
    unknown: str = "phase"
    restarted: bool = False

    def __post_init__(self) -> None:
        _as_arrays(self, "radians")
        _check_numbers(self.radians, self.radians.size, "phases")
        if self.unknown not in UNKNOWN:
            raise BadInput(
                f"phases: unknown is {self.unknown!r}, wanted one of {', '.join(UNKNOWN)}"
            )


@dataclass(frozen=True, kw_only=True)
class Peaks:
    """What was measured in one experiment.

    ``tones_hz`` are the drive frequencies; ``lines_hz`` those of the lines that were read, the
    tones where it is empty; ``peaks_v`` and ``sigmas_v`` (n,) per line: peak amplitude with the
    noise floor removed, its standard deviation (nan where it is unknown); ``floor_v`` mean noise
    magnitude; ``phases`` of the peaks, where they were measured.
    """

    label: str
    tones_hz: tuple[float, ...]
    peaks_v: FloatArray
    sigmas_v: FloatArray = field(default_factory=lambda: np.empty(0))
    lines_hz: tuple[float, ...] = ()
    floor_v: float = 0.0
    spectrum: Spectrum | None = None
    phases: Phases | None = None

    @property
    def read_hz(self) -> tuple[float, ...]:
        """Frequencies of the peaks, Hz."""
        return self.lines_hz or self.tones_hz


@dataclass(frozen=True, kw_only=True)
class MeasuredExperiment(Peaks):
    """One experiment as measured.

    ``settings`` set FMU variables, the tones' parameters among them, as they were written
    (`fitting.text.written.written_values` makes them of plain values); ``output`` the FMU output
    that this experiment observes, None for the campaign's; ``stamp`` its time, if drift asks. All
    standard deviations are unknown if nothing is said of them.

    Raises:
        BadInput: tones that are not positive and different, another number of peaks, phases or
            standard deviations than lines, peaks that are not above zero, negative standard
            deviations.
    """

    settings: Mapping[str, Written] = field(default_factory=dict)
    output: Written | None = None
    stamp: Written | None = None

    def __post_init__(self) -> None:
        where = f"experiment '{self.label}'"
        _as_arrays(self, "peaks_v", "sigmas_v")
        lines_hz = self.read_hz
        _check_frequencies(self.tones_hz, f"{where}: drive frequencies", different=True)
        _check_frequencies(lines_hz, f"{where}: lines", different=False)
        _set(self, "lines_hz", lines_hz)
        if self.sigmas_v.size == 0:
            _set(self, "sigmas_v", np.full(len(lines_hz), np.nan))
        _check_numbers(self.peaks_v, len(lines_hz), f"{where}: peaks")
        if not np.all(self.peaks_v > 0.0):
            raise BadInput(f"{where}: peaks {_shown(self.peaks_v)}; wanted positive amplitudes")
        if self.phases is not None:
            _check_numbers(self.phases.radians, len(lines_hz), f"{where}: phases")
        known = np.where(np.isnan(self.sigmas_v), 0.0, self.sigmas_v)
        _check_numbers(known, len(lines_hz), f"{where}: standard deviations")
        if np.any(known < 0.0) or not 0.0 <= self.floor_v < np.inf:
            raise BadInput(
                f"{where}: standard deviations {_shown(self.sigmas_v)}, noise floor "
                f"{self.floor_v:g}; wanted zero or more"
            )


def _set(record: object, name: str, value: object) -> None:
    """Give a field of a frozen record, while it is being made, the form that it promises."""
    object.__setattr__(record, name, value)


def _as_arrays(record: Any, *names: str) -> None:
    """Fields as arrays of doubles, (n,), None apart where that is what they are by themselves."""
    optional = {of.name for of in fields(record) if of.default is None}
    where = getattr(record, "label", None) or getattr(record, "source", "")
    for name in names:
        value = getattr(record, name)
        if value is None and name in optional:
            continue
        array = as_numbers(value, f"{where}: {name}")
        if array.ndim != 1:
            raise BadInput(f"{where}: {name} has the shape {array.shape}, wanted (n,)")
        _set(record, name, array)


def _check_numbers(values: FloatArray, size: int, where: str) -> None:
    if values.size != size:
        raise BadInput(f"{where}: {values.size} of them, wanted {size}")
    for i in np.flatnonzero(~np.isfinite(values))[:1]:
        raise BadInput(f"{where}: number {i + 1} is {values[i]}, wanted a finite number")


def _check_curve(frequency_hz: FloatArray, amplitude_v: FloatArray, least: int, where: str) -> None:
    """Frequencies that rise from above zero, and as many amplitudes that are not negative."""
    if frequency_hz.size < least:
        raise BadInput(f"{where}: {frequency_hz.size} points; wanted at least {least}")
    _check_numbers(frequency_hz, frequency_hz.size, f"{where}: frequencies")
    _check_numbers(amplitude_v, frequency_hz.size, f"{where}: amplitudes")
    require_size(frequency_hz, f"{where}: frequencies")
    if frequency_hz[0] <= 0.0 or np.any(np.diff(frequency_hz) <= 0.0):
        raise BadInput(f"{where}: wanted frequencies above zero that rise strictly")
    for i in np.flatnonzero(amplitude_v < 0.0)[:1]:
        raise BadInput(
            f"{where}: amplitude {amplitude_v[i]:.6g} at {frequency_hz[i]:.9g} Hz; wanted a "
            "magnitude"
        )


def _check_frequencies(values: Sequence[float], where: str, *, different: bool) -> None:
    twice = different and len(set(values)) < len(values)
    if not values or twice or not all(0.0 < f < np.inf for f in values):
        wanted = "positive ones that differ" if different else "positive ones"
        raise BadInput(f"{where} {hertz(*values, digits=8, joined=', ')}; wanted {wanted}")


def _shown(values: FloatArray) -> str:
    return ", ".join(f"{v:.6g}" for v in values)
