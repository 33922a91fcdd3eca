"""Which column of a recording is the frequency, the amplitude, X, Y: by usual names, or guessed.

What a campaign reads goes by the names that it gives, or else by usual ones: never by a guess. The
guesses are for people to look at: `fitting.campaign.recognised` describes them in words. The unit
of a column of a power spectral density states what it is the density of.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.instruments.loose_tables import suffixed_unit
from fitting.campaign.instruments.recording import Channel, RawTrace, Recording, Selection, unit_of
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, left_out
from fitting.text.units import COMMON, convert, is_frequency, same_kind

#: Usual names of columns, small letters; the first that is there is taken.
FREQUENCY = ("frequency", "freq", "f", "frequencies", "frequency axis", "grid")
AMPLITUDE = ("amplitude", "magnitude", "level", "r", "voltage", "mag", "amp", "db")
PHASE = ("phase", "theta", "angle")
X = ("x", "re", "real", "in-phase", "i")
Y = ("y", "im", "imag", "imaginary", "quadrature", "q")
TIME = ("time", "t", "seconds", "elapsed time", "x-axis")


#: Real and imaginary part as quantities name them: admittance, impedance, a modulus.
PARTS = (("g", "b"), ("r", "x"), ("z'", "z''"), ("z'", 'z"'), ("g'", "g''"), ("y'", "y''"))


def plain_name(channel: Channel) -> str:
    """The name of a column in small letters, without unit, dots and bars."""
    name = suffixed_unit(channel.name)[0] if channel.unit else channel.name
    return re.sub(r"\s+", " ", name.lower().strip(" .|:")).replace("_", " ")


def usual(recording: Recording, names: Sequence[str]) -> Channel | None:
    """The column of the first of these names that is there.

    Args:
        recording: what was read.
        names: small letters.
    """
    by_name: dict[str, Channel] = {}
    for channel in recording.channels:
        by_name.setdefault(plain_name(channel), channel)
    return next((by_name[name] for name in names if name in by_name), None)


def usual_frequency(recording: Recording) -> Channel | None:
    """The column of a usual name of frequencies; not "F (N)", which is a force.

    Args:
        recording: what was read.
    """
    result = usual(recording, FREQUENCY)
    return None if result is not None and result.unit and not is_frequency(result.unit) else result


def parts_by_name(recording: Recording) -> tuple[Channel, Channel] | None:
    """Columns that are the two parts of one quantity, as conductance and susceptance; else None.

    They are in units of one kind, and no phase is next to them: R next to one is an amplitude.

    Args:
        recording: what was read.
    """
    for names in PARTS:
        real, imaginary = (usual(recording, (name,)) for name in names)
        if real is None or imaginary is None or real.is_complex or imaginary.is_complex:
            continue
        polar = usual(recording, PHASE) is not None or usual(recording, Y) is not None
        alike = real.unit == imaginary.unit or same_kind(real.unit or "1", imaginary.unit or "1")
        if alike and not (polar and names[0] == "r"):
            return real, imaginary
    return None


def requested_column(recording: Recording, wanted: str, names: Sequence[str]) -> Channel | None:
    """The column of the wanted name, else of a usual one, or None.

    Args:
        recording: what was read.
        wanted: name of the campaign; empty: none.
        names: usual ones.

    Raises:
        BadInput: there is no column of the wanted name.
    """
    return recording.column(wanted) if wanted else usual(recording, names)


def frequency_of(recording: Recording, wanted: str) -> Channel:
    """The column of frequencies.

    Args:
        recording: what was read.
        wanted: name of the campaign; empty: none.

    Raises:
        BadInput: there is none; states so of a recording over time.
    """
    result = requested_column(recording, wanted, FREQUENCY)
    if result is not None:
        return result
    time = usual(recording, TIME)
    if time is not None:
        raise BadInput(
            f"{recording.path}: is a recording over time (column '{time.name}'), not a sweep of "
            "the frequency; wanted a column of frequencies"
        )
    if not recording.headed and len(recording.channels) > 1:
        first, second = (c.name for c in recording.channels[:2])
        raise BadInput(
            f"{recording.path}: does not name the column of frequencies; wanted the names of "
            f'columns in the campaign, as columns = {{ frequency = "{first} (Hz)", amplitude = '
            f'"{second} (V)" }}; there is: {", ".join(c.name for c in recording.channels)}'
        )
    return recording.column(FREQUENCY[0])


def without_zero(
    recording: Recording, frequency: Channel
) -> tuple[Recording, Channel, tuple[Finding, ...]]:
    """A recording without its rows at 0 Hz, its column of frequencies, and what is out.

    A Fourier transform begins with the mean of the record, which is no response; other frequencies
    that are not above zero are left for complaints.

    Args:
        recording: what was read.
        frequency: the column of frequencies.
    """
    if frequency.is_complex:
        return recording, frequency, ()
    try:
        at_zero = recording.numbers(frequency) == 0.0
    except BadInput:  # told with the other columns, where all are read
        return recording, frequency, ()
    count = int(np.sum(at_zero))
    if count in (0, at_zero.size):
        return recording, frequency, ()
    part = recording.part(np.flatnonzero(~at_zero))
    kept = next(c for c in part.channels if c.name == frequency.name)
    first = recording.places[int(np.argmax(at_zero))]
    result = left_out(str(recording.path), count, first)
    return part, replace(kept, unit=frequency.unit), (result,)


def amplitude_of(recording: Recording, wanted: str) -> Channel | None:
    """The column of amplitudes, or the one of complex values; None where there is neither.

    Args:
        recording: what was read.
        wanted: name of the campaign; empty: none.

    Raises:
        BadInput: several columns of complex values, and none of them named.
    """
    result = requested_column(recording, wanted, AMPLITUDE)
    if result is not None:
        return result
    complexes = [c for c in recording.channels if c.is_complex]
    if len(complexes) > 1:
        names = ", ".join(c.name for c in complexes)
        example = next((c.name for c in complexes if "21" in c.name), complexes[0].name)
        raise BadInput(
            f"{recording.path}: holds {names}; wanted one of them named in the campaign, as "
            f'columns = {{ amplitude = "{example}" }}'
        )
    return complexes[0] if complexes else None


def trace_of(recording: Recording, selection: Selection) -> RawTrace:
    """Frequency, amplitude and phase of a recording; complex values as both.

    Args:
        recording: what was read.
        selection: names of columns, where they are not the usual ones.

    Raises:
        BadInput: a column or a unit is missing, a value is no finite number.
    """
    frequency = frequency_of(recording, selection.frequency)
    recording, frequency, omitted = without_zero(recording, frequency)
    amplitude = amplitude_of(recording, selection.amplitude)
    x, y = requested_column(recording, selection.x, X), requested_column(recording, selection.y, Y)
    values: ComplexArray | None = None
    phase, phase_unit = None, ""
    errors = recording.column(selection.sigma) if selection.sigma else None
    column: Channel | None = None
    if selection.x or (amplitude is None and x is not None and y is not None):
        recording.check(c for c in (frequency, x, y) if c is not None)
        values, unit = parts_of(recording, x, y)
    else:
        x = y = None
        amplitude = amplitude or recording.column(AMPLITUDE[0])
        recording.check((frequency, amplitude))
        if amplitude.is_complex:
            values = recording.values(amplitude)
        else:
            column = requested_column(recording, selection.phase, PHASE)
            sizes = recording.numbers(amplitude)
            if column is not None:
                phase = recording.numbers(column)
                phase_unit = unit_of(recording, column, "phase (deg)")
        unit = unit_of(recording, amplitude, "amplitude (uV)")
    if values is not None:
        sizes, phase, phase_unit = np.abs(values), np.angle(values), "rad"
    return RawTrace(
        path=recording.path,
        frequency=recording.numbers(frequency),
        frequency_unit=unit_of(recording, frequency, "frequency (MHz)"),
        amplitude=sizes,
        amplitude_unit=unit,
        phase=phase,
        phase_unit=phase_unit,
        sigma=None if errors is None else recording.numbers(errors),
        sigma_unit=(errors.unit if errors is not None else None) or unit,
        places=recording.places,
        notes=recording.notes,
        left_out=(*omitted, *recording.unused(frequency, amplitude, column, x, y, errors)),
    )


def parts_of(
    recording: Recording, x: Channel | None, y: Channel | None
) -> tuple[ComplexArray, str]:
    """Complex values of two columns, and their unit, which is that of X.

    Args:
        recording: what was read.
        x: real part.
        y: imaginary part.

    Raises:
        BadInput: one is missing, has no unit, or has one that does not fit the other's.
    """
    if x is None or y is None:
        there = ", ".join(c.name for c in recording.channels)
        raise BadInput(
            f"{recording.path}: no column '{'X' if x is None else 'Y'}'; wanted frequency with X "
            f"and Y, Re and Im, amplitude and phase, or dB and phase, there is: {there}"
        )
    unit = unit_of(recording, x, f"{x.name} (uV)")
    other = unit_of(recording, y, f"{y.name} (uV)")
    factor = convert(1.0, other, unit, where=f"{recording.path}: column '{y.name}'")
    return recording.numbers(x) + 1j * factor * recording.numbers(y), unit


#: Units of what is seen whose squares per Hz a density may have.
OBSERVED_UNITS = ("m", "V", "m/s", "m/s**2", "A", "1")
#: Words for what a column holds where its unit does not tell it.
DENSITY, ROOT = HOLDS = ("density", "root")
#: Levels over a bandwidth, as "dBm/Hz" or "dBV/√Hz": ten decibels are a factor of ten in power.
LEVEL = re.compile(r"dB\w*\s*/\s*.*Hz.*")


@dataclass(frozen=True, eq=False)
class Density:
    """A power spectral density (n,) in `unit` squared per Hz, or relative; made of its root.

    ``by`` is what of a file states that it is one, its unit or its name; ``holds`` is what the
    column holds where the file's own unit does not state it, else empty.
    """

    numbers: FloatArray
    unit: str
    is_relative: bool = False
    is_root: bool = False
    by: str = ""
    holds: str = ""


def density_of(numbers: FloatArray, unit: str) -> Density | None:
    """The density that a column holds, or its root, or levels; None: none follows from the unit.

    Args:
        numbers: of the column, shape (n,).
        unit: of the column.
    """
    if LEVEL.fullmatch(unit):
        return Density(_powers(numbers), "1", is_relative=True)
    if unit in COMMON and not unit.endswith("/Hz"):
        return None
    for observed in OBSERVED_UNITS:
        for power, whole in ((1, f"({observed})**2/Hz"), (2, f"({observed})/Hz**0.5")):
            with contextlib.suppress(BadInput):
                factor = convert(1.0, unit, whole, where="")
                return Density((factor * numbers) ** power, observed, is_root=power == 2)
    return None


def relative_density(numbers: FloatArray, unit: str | None, holds: str) -> Density:
    """The density of a column whose unit does not determine it, as relative numbers.

    Args:
        numbers: of the column, shape (n,).
        unit: of the column; None: none is stated.
        holds: `DENSITY` or `ROOT`.
    """
    if (unit or "").startswith("dB"):
        return Density(_powers(numbers), "1", is_relative=True)
    is_root = holds == ROOT
    return Density(numbers ** (2 if is_root else 1), "1", is_relative=True, is_root=is_root)


def _powers(levels: FloatArray) -> FloatArray:
    return np.asarray(10.0 ** ((levels - np.max(levels)) / 10.0))
