"""What was measured, as records: spectra, peaks of experiments, the frequency response.

`fitting.campaign.data` makes them of files; they are made of arrays as well, and refuse arrays that
no measurement can be. Amplitudes are peak values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fitting.campaign.instruments.recording import MIN_POINTS
from fitting.lines.excluded import single_points
from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.text.arrays import FloatArray, Scalar, as_numbers, require_size
from fitting.text.errors import BadInput
from fitting.text.finding import Finding
from fitting.text.notation import hertz, how_many
from fitting.text.units import Written

#: Named in errors about what comes from no file.
NO_FILE = Path("arrays")
#: What may be unknown of a detector that measures phases.
UNKNOWN = ("phase", "gain", "none")


@dataclass(frozen=True)
class Spectrum:
    """A measured spectrum: ``frequency_hz`` (n,), ``amplitude_v`` (n,) peak, in ``unit``.

    ``left_out`` states which points and columns of the file are not in it.

    Raises:
        BadInput: arrays of different lengths or too short, frequencies that do not rise from above
            zero, amplitudes that are negative or no numbers.
    """

    frequency_hz: FloatArray
    amplitude_v: FloatArray
    _: KW_ONLY
    source: Path = NO_FILE
    unit: str = "V"
    left_out: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        _set_arrays(self, "frequency_hz", "amplitude_v")
        if self.frequency_hz.size < MIN_POINTS:
            raise BadInput(
                f"{self.source}: {self.frequency_hz.size} points; wanted at least {MIN_POINTS}"
            )
        where = str(self.source)
        check_finite(self.frequency_hz, self.frequency_hz.size, f"{where}: frequencies")
        check_finite(self.amplitude_v, self.frequency_hz.size, f"{where}: amplitudes")
        check_rising(self.frequency_hz, where)
        for i in np.flatnonzero(self.amplitude_v < 0.0)[:1]:
            raise BadInput(
                f"{where}: amplitude {self.amplitude_v[i]:.6g} at {self.frequency_hz[i]:.9g} Hz; "
                "wanted a magnitude"
            )


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """What was measured in one experiment, and what it sets in the FMU.

    ``tones_hz`` are the drive frequencies; ``lines_hz`` those of the lines that were read, the
    tones where it is empty; ``peaks_v`` and ``sigmas_v`` (n,) per line: peak amplitude with the
    noise floor removed, its standard deviation (nan where it is unknown); ``floor_v`` mean noise
    magnitude. With phases, peak k is peaks_v[k] exp(i phases_rad[k]) exp(i 2 pi u t),
    ``unknown`` is what is unknown of the detector of a campaign: "phase", "gain" (complex) or
    "none"; ``restarted``: from here on its phase is another one. ``settings`` are in the FMU's
    units (tones and interpolated drift included), ``output`` is the FMU output that is observed
    (the campaign's, where empty). Before the campaign is bound these are in ``written`` and
    ``observed`` as they were written; ``stamp`` is the time, if drift asks.
    """

    label: str
    tones_hz: tuple[float, ...]
    peaks_v: FloatArray
    sigmas_v: FloatArray = field(default_factory=lambda: np.empty(0))
    lines_hz: tuple[float, ...] = ()
    floor_v: float = 0.0
    spectrum: Spectrum | None = None
    phases_rad: FloatArray | None = None
    unknown: str = UNKNOWN[0]
    restarted: bool = False
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    output: str = ""
    written: Mapping[str, Written] = field(default_factory=dict)
    observed: Written | None = None
    stamp: Written | None = None

    @property
    def read_hz(self) -> tuple[float, ...]:
        """Frequencies of the peaks, Hz."""
        return self.lines_hz or self.tones_hz


def checked_experiment(e: Experiment) -> Experiment:
    """The experiment with its arrays as doubles, unknown standard deviations as nan.

    Args:
        e: as it was measured.

    Raises:
        BadInput: tones that are not positive and different, another number of peaks, phases or
            standard deviations than lines, peaks that are not above zero, negative standard
            deviations.
    """
    where, count = f"experiment '{e.label}'", len(e.read_hz)
    peaks_v, sigmas_v = (
        _array(values, f"{e.label}: {name}")
        for name, values in (("peaks_v", e.peaks_v), ("sigmas_v", e.sigmas_v))
    )
    for values, what, wanted in (
        (e.tones_hz, "drive frequencies", "positive ones that differ"),
        (e.read_hz, "lines", "positive ones"),
    ):
        repeated = what != "lines" and len(set(values)) < len(values)
        if not values or repeated or not all(0.0 < f < np.inf for f in values):
            shown = hertz(*values, digits=8, joined=", ")
            raise BadInput(f"{where}: {what} {shown}; wanted {wanted}")
    if sigmas_v.size == 0:
        sigmas_v = np.full(count, np.nan)
    check_finite(peaks_v, count, f"{where}: peaks")
    if not np.all(peaks_v > 0.0):
        raise BadInput(f"{where}: peaks {_shown(peaks_v)}; wanted positive amplitudes")
    phases_rad = e.phases_rad
    if phases_rad is not None:
        phases_rad = _array(phases_rad, f"{where}: phases")
        check_finite(phases_rad, count, f"{where}: phases")
    if e.unknown not in UNKNOWN:
        raise BadInput(f"phases: unknown is {e.unknown!r}, wanted one of {', '.join(UNKNOWN)}")
    known = np.where(np.isnan(sigmas_v), 0.0, sigmas_v)
    check_finite(known, count, f"{where}: standard deviations")
    if np.any(known < 0.0) or not 0.0 <= e.floor_v < np.inf:
        raise BadInput(
            f"{where}: standard deviations {_shown(sigmas_v)}, noise floor {e.floor_v:g}; wanted "
            "zero or more"
        )
    return replace(e, peaks_v=peaks_v, sigmas_v=sigmas_v, phases_rad=phases_rad, lines_hz=e.read_hz)


@dataclass(frozen=True, kw_only=True, eq=False)
class SweepData(Spectrum):
    """The FRF sweep: as a spectrum, with ``phase_rad`` (n,) or None.

    ``sigma_v`` (n,) are standard errors of the amplitudes, None where they are not known. ``unit``
    is the detector's; ``notes`` are header entries of the instrument. ``use``, ``scale`` and
    ``background`` are what it serves; ``settings`` are in the FMU's units, ``setting_sigma`` their
    declared errors; ``label`` is what values of its own are named by, empty where it has none.

    Raises:
        BadInput: as `Spectrum`, fewer than 8 points, or every amplitude zero.
    """

    phase_rad: FloatArray | None = None
    sigma_v: FloatArray | None = None
    notes: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    use: str = "scale"
    scale: str = "maximum"
    background: str = "none"
    setting_sigma: Mapping[str, float] = field(default_factory=dict)
    label: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        where = str(self.source)
        _set_arrays(self, "phase_rad", "sigma_v")
        check_count(self.frequency_hz.size, where)
        if not np.any(self.amplitude_v > 0.0):
            raise BadInput(f"{where}: every amplitude is zero; wanted a resonance")
        if self.phase_rad is not None:
            check_finite(self.phase_rad, self.frequency_hz.size, f"{where}: phases")
        if self.sigma_v is not None:
            check_finite(self.sigma_v, self.frequency_hz.size, f"{where}: standard errors")
            if not np.all(self.sigma_v > 0.0):
                least = np.min(self.sigma_v)
                raise BadInput(f"{where}: standard errors from {least:.6g}; wanted positive ones")

    @cached_property
    def far_off(self) -> tuple[tuple[int, float], ...]:
        """Single points that no line of its grid makes: number, and what would be likely there."""
        single = single_points(self.frequency_hz, self.amplitude_v)
        return tuple((k, abs(there)) for k, there in single)

    @cached_property
    def of_line(self) -> tuple[FloatArray, FloatArray]:
        """Frequencies, Hz, and amplitudes, of ``unit``, of the points that may be its line's."""
        away = [k for k, _ in self.far_off]
        return np.delete(self.frequency_hz, away), np.delete(self.amplitude_v, away)


def _set_arrays(record: Any, *names: str) -> None:
    """Make fields of a frozen record arrays of doubles, (n,); an optional one may be None."""
    optional = {of.name for of in fields(record) if of.default is None}
    where = getattr(record, "source", "")
    for name in names:
        value = getattr(record, name)
        if value is not None or name not in optional:
            object.__setattr__(record, name, _array(value, f"{where}: {name}"))


def _array(value: npt.ArrayLike, where: str) -> FloatArray:
    array = as_numbers(value, where)
    if array.ndim != 1:
        raise BadInput(f"{where} has the shape {array.shape}, wanted (n,)")
    return array


def check_finite(values: FloatArray, size: int, where: str) -> None:
    """Refuse numbers that are not finite, or not as many as wanted.

    Args:
        values: (n,).
        size: n as it is wanted.
        where: file and what they are, for errors.

    Raises:
        BadInput: another count, or the first number that is not finite.
    """
    if values.size != size:
        raise BadInput(f"{where}: {values.size} of them, wanted {size}")
    for i in np.flatnonzero(~np.isfinite(values))[:1]:
        raise BadInput(f"{where}: number {i + 1} is {values[i]}, wanted a finite number")


def check_count(size: int, where: str) -> None:
    """Refuse a sweep with too few points.

    Args:
        size: number of points.
        where: file, for errors.

    Raises:
        BadInput: fewer than 8.
    """
    if size < MIN_SWEEP_POINTS:
        raise BadInput(
            f"{where}: {how_many(size, 'point is', 'points are')} too few for a sweep; wanted at "
            f"least {MIN_SWEEP_POINTS}"
        )


def check_rising(frequency_hz: FloatArray, where: str) -> None:
    """Refuse frequencies that do not rise from above zero.

    Args:
        frequency_hz: (n,), Hz.
        where: file, for errors.

    Raises:
        BadInput: not rising strictly, not positive, or too large or small to be squared.
    """
    require_size(frequency_hz, f"{where}: frequencies")
    if frequency_hz[0] <= 0.0 or np.any(np.diff(frequency_hz) <= 0.0):
        raise BadInput(f"{where}: wanted frequencies above zero that rise strictly")


def _shown(values: FloatArray) -> str:
    return ", ".join(f"{v:.6g}" for v in values)
