"""What an amplitude column means: peak, rms or dBm, only ever by the user's declaration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.units import convert, parse_quantity, same_kind

#: Units of powers, whose roots are amplitudes.
POWERS = ("W", "V**2", "A**2", "m**2")


@dataclass(frozen=True)
class Amplitude:
    """A declaration: ``kind`` "peak", "rms", "dBm" or "dB"; peak amplitudes come out in ``unit``.

    ``impedance_ohm`` is the load that dBm refers to; dB refer to an unknown level, unit "1".
    """

    kind: str
    unit: str
    impedance_ohm: float | None = None


def check_amplitude(text: str, where: str) -> None:
    """Complain of what no impedance makes an amplitude.

    Args:
        text: as it was written.
        where: file, row or key, for complaints.

    Raises:
        BadInput: any other text than `declared_amplitude` takes.
    """
    words = text.split()
    if words in (["dBm"], ["dB"]):
        return
    if len(words) != 2 or words[1] not in ("peak", "rms"):
        raise BadInput(
            f'{where}: found "{text}", wanted "V peak", "V rms" or "dBm" '
            '(another detector unit likewise, as "m peak")'
        )
    parse_quantity(f"1 {words[0]}", where=where)  # refuses a unit that does not exist
    if any(same_kind(words[0], power) for power in POWERS):
        raise BadInput(
            f'{where}: found "{text}", a power; wanted an amplitude (the root of such a column), '
            'as "V peak", or "dBm"'
        )


def declared_amplitude(text: str, impedance_ohm: float | None, where: str) -> Amplitude:
    """Read "V peak", "V rms", another detector unit likewise ("m peak"), "dBm" or "dB".

    Args:
        text: as it was written.
        impedance_ohm: of the load, Ω; None where a power is not converted.
        where: file, row or key, for complaints.

    Raises:
        BadInput: any other text; dBm without an impedance, or an impedance without dBm.
    """
    check_amplitude(text, where)
    words = text.split()
    if words == ["dBm"]:
        if impedance_ohm is None:
            raise BadInput(f'{where}: "dBm" is a power: wanted impedance = "50 ohm" with it')
        return Amplitude("dBm", "V", impedance_ohm)
    if words == ["dB"]:
        return Amplitude("dB", "1")
    if impedance_ohm is not None:
        raise BadInput(f'{where}: an impedance has a meaning with "dBm" only, found "{text}"')
    return Amplitude(words[1], words[0])


def to_peak(
    values: FloatArray,
    unit: str,
    amplitude: Amplitude,
    source: str,
    places: Sequence[str],
    column: str = "amplitude",
) -> FloatArray:
    """Peak amplitudes (n,) in ``amplitude.unit`` from values in the file's ``unit``.

    peak = sqrt(2) rms; for dBm peak = sqrt(2 R 1 mW 10^(x/10)); for dB peak = 10^(x/20).

    Args:
        values: amplitudes (n,), in `unit`.
        unit: that the file has them in.
        amplitude: how amplitudes are written: kind (peak or rms), unit and impedance.
        source: of the data, for complaints.
        places: where each value stands, for complaints.
        column: head of the column, for complaints.

    Raises:
        BadInput: a unit that contradicts the declaration, a negative amplitude, or amplitudes that
            no double holds with all its digits.
    """
    where = f"{source}: column '{column}'"
    logarithmic = ("dBm", "dB")
    if (unit if unit in logarithmic else "") != (
        amplitude.kind if amplitude.kind in logarithmic else ""
    ):
        kind = amplitude.kind
        declared = kind if kind in logarithmic else f"{amplitude.unit} {kind}"
        raise BadInput(f"{where}: is in {unit}, but the campaign declares {declared}")
    if amplitude.impedance_ohm is not None:
        with np.errstate(over="ignore"):
            watts = 1e-3 * 10.0 ** (values / 10.0)
        return _in_range(np.sqrt(2.0 * amplitude.impedance_ohm * watts), where)
    if amplitude.kind == "dB":
        with np.errstate(over="ignore"):
            return _in_range(np.asarray(10.0 ** (values / 20.0)), where)
    # multiplied, not converted one by one: one rounding, the same for every point
    factor = convert(1.0, unit, amplitude.unit, where=where)
    for i in np.flatnonzero(values < 0.0)[:1]:
        raise BadInput(
            f"{source}: {places[i]}, column '{column}': negative amplitude {values[i]:.6g} {unit}; "
            "wanted a magnitude"
        )
    with np.errstate(over="ignore"):
        peaks = values * (factor * (math.sqrt(2.0) if amplitude.kind == "rms" else 1.0))
    return _in_range(peaks, where)


def _in_range(peaks: FloatArray, where: str) -> FloatArray:
    """The peaks, if doubles hold the largest of them with all digits."""
    largest = float(np.max(peaks, initial=0.0))
    if not (largest == 0.0 or np.finfo(float).tiny <= largest <= np.finfo(float).max):
        raise BadInput(
            f"{where}: amplitudes up to {largest:.3g} are beyond the range of numbers; wanted "
            "another unit"
        )
    return peaks
