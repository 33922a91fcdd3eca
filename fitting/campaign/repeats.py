"""The same data twice: what is fitted twice counts twice, and every error comes out too small."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from pathlib import Path

import numpy as np

from fitting.campaign.bound import BoundCampaign
from fitting.campaign.measured import Spectrum, SweepData
from fitting.text.errors import BadInput

#: Digits of all peaks of an experiment together from which equal ones are no coincidence: two
#: measurements of one setting, written with few digits, may well agree.
DIGITS = 8
#: Digits to which numbers are compared; more are lost between units.
COMPARED = 10
#: Binary digits, about as many.
BITS = 33


def refuse_repeats(bounds: Sequence[BoundCampaign]) -> None:
    """Refuse data that are listed twice, under whatever path or name.

    Compared is what was measured: spectra and sweeps point by point, ready peaks with their drive
    frequencies. Two campaigns may name one sweep if at most one of them fits it: the other takes
    its scale from there.

    Args:
        bounds: campaigns that are fitted together, or one.

    Raises:
        BadInput: names both.
    """
    known: dict[Hashable, list[tuple[str, object]]] = {}
    for bound in bounds:
        for where, key, data, is_same in (*_curves(bound), *_rows(bound)):
            alike = known.setdefault(key, [])
            for other, its_data in alike:
                if is_same(its_data, data):
                    raise BadInput(
                        f"{where}: are the data of {other} again; wanted every measurement once"
                    )
            alike.append((where, data))


#: Where data are, a key that is equal for equal ones, the data, and whether two are the same.
_Data = tuple[str, Hashable, object, Callable[..., bool]]


def _curves(bound: BoundCampaign) -> Iterator[_Data]:
    """Spectra and the sweep, by a digest of their points, amplitudes in units of the largest."""
    named: list[tuple[str, Spectrum | SweepData]] = [
        (f"{bound.path}: experiment '{e.label}' ({e.spectrum.source})", e.spectrum)
        for e in bound.experiments
        if e.spectrum is not None
    ]
    if bound.sweep is not None:
        source = bound.sweep.source
        file = f" ({source})" if source.is_file() else ""
        named.append((f"{bound.path}: sweep{file}", bound.sweep))
    for where, curve in named:
        relative = curve.amplitude_v / (np.max(curve.amplitude_v) or 1.0)
        mantissa, exponent = np.frexp(np.concatenate([curve.frequency_hz, relative]))
        rounded = np.round(np.ldexp(mantissa, BITS))
        key = hashlib.sha256(rounded.tobytes() + exponent.tobytes()).digest()
        yield where, key, curve, _is_same_curve


def _is_same_curve(one: Spectrum | SweepData, two: Spectrum | SweepData) -> bool:
    """Whether curves of one shape are of the same data, and both are fitted.

    One measurement read in two units is; a linear sample driven at two levels is not.
    """
    if any(isinstance(each, SweepData) and each.use != "fit" for each in (one, two)):
        return False
    tops = (float(np.max(each.amplitude_v)) for each in (one, two))
    return math.isclose(*tops, rel_tol=10.0**-COMPARED) or (
        _content(one.source) == _content(two.source) != b""
    )


def _content(path: Path) -> bytes:
    """Digest of a file, empty for what comes from none."""
    return hashlib.sha256(path.read_bytes()).digest() if path.is_file() else b""


def _rows(bound: BoundCampaign) -> Iterator[_Data]:
    """Experiments with ready peaks, by their numbers; the data are settings that do not drift."""
    moving = {*bound.drift.ends, *(name for p in bound.parameters for name in p.adds_to)}
    for e in bound.experiments:
        if e.spectrum is not None or not np.all(np.isfinite(e.peaks_v)):
            continue
        digits = 0
        for peak in e.peaks_v:
            # as few as it was written with: as peak, as rms, or in dBm at 50 ohm
            ways = (peak, peak / math.sqrt(2.0), 20.0 * math.log10(peak) + 10.0)
            mantissas = (f"{value:.{COMPARED - 1}e}".partition("e")[0] for value in ways)
            digits += min(len(m.strip("-0.").replace(".", "")) for m in mantissas)
        if digits >= DIGITS:
            numbers = (*e.tones_hz, *e.read_hz, *e.peaks_v.tolist())
            key = tuple(f"{value:.{COMPARED}g}" for value in numbers)
            settings = {name: value for name, value in e.settings.items() if name not in moving}
            yield (
                f"{bound.path}: experiment '{e.label}'",
                key,
                settings,
                lambda one, two: all(one[name] == two[name] for name in one.keys() & two.keys()),
            )
