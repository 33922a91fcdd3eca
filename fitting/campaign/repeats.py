"""The same data twice: what is fitted twice counts twice, and every error comes out too small."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fitting.campaign.bound import BoundCampaign, Experiment
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput

#: Digits of all peaks of an experiment together from which equal ones are no coincidence: two
#: measurements of one setting, written with few digits, may well agree.
DIGITS = 8
#: Digits to which numbers are compared; more are lost between units.
COMPARED = 10
#: Binary digits, about as many.
BITS = 33


def refuse_repeats(bounds: Sequence[BoundCampaign]) -> None:
    """Complain of data that are listed twice, under whatever path or name.

    Compared is what was measured: spectra and sweeps point by point, ready peaks with their drive
    frequencies. Two campaigns may name one sweep if at most one of them fits it: the other takes
    its scale from there.

    Args:
        bounds: campaigns that are fitted together, or one.

    Raises:
        BadInput: names both.
    """
    curves: dict[bytes, list[_Curve]] = {}
    rows: dict[tuple[str, ...], list[_Row]] = {}
    for bound in bounds:
        for curve in _curves(bound):
            alike = curves.setdefault(curve.shape, [])
            _refuse(curve.where, [known.where for known in alike if known.is_that_of(curve)])
            alike.append(curve)
        for row in _rows(bound):
            others = rows.setdefault(row.numbers, [])
            _refuse(row.where, [known.where for known in others if known.is_that_of(row)])
            others.append(row)


def _refuse(where: str, known: Sequence[str]) -> None:
    if known:
        raise BadInput(f"{where}: are the data of {known[0]} again; wanted every measurement once")


@dataclass(frozen=True, kw_only=True)
class _Curve:
    """A spectrum or a sweep; ``fitted`` unless it only gives a scale."""

    where: str
    frequency_hz: FloatArray
    amplitude_v: FloatArray
    source: Path
    fitted: bool = True

    @property
    def top_v(self) -> float:
        return float(np.max(self.amplitude_v))

    @property
    def shape(self) -> bytes:
        """Digest of the points, amplitudes in units of the largest."""
        relative = self.amplitude_v / (self.top_v or 1.0)
        values = np.concatenate([self.frequency_hz, relative])
        mantissa, exponent = np.frexp(values)
        rounded = np.round(np.ldexp(mantissa, BITS))
        return hashlib.sha256(rounded.tobytes() + exponent.tobytes()).digest()

    def is_that_of(self, other: _Curve) -> bool:
        """Whether another curve of this shape is of the same data.

        One measurement read in two units is; a linear sample driven at two levels is not.
        """
        if not (self.fitted and other.fitted):
            return False
        alike = math.isclose(self.top_v, other.top_v, rel_tol=10.0**-COMPARED)
        return alike or _content(self.source) == _content(other.source) != b""


def _content(path: Path) -> bytes:
    """Digest of a file, empty for what comes from none."""
    return hashlib.sha256(path.read_bytes()).digest() if path.is_file() else b""


def _curves(bound: BoundCampaign) -> Iterator[_Curve]:
    for e in bound.experiments:
        if e.spectrum is not None:
            yield _Curve(
                where=f"{bound.path}: experiment '{e.label}' ({e.spectrum.source})",
                frequency_hz=e.spectrum.frequency_hz,
                amplitude_v=e.spectrum.amplitude_v,
                source=e.spectrum.source,
            )
    sweep = bound.sweep
    if sweep is not None:
        named = f" ({sweep.source})" if sweep.source.is_file() else ""
        yield _Curve(
            where=f"{bound.path}: sweep{named}",
            frequency_hz=sweep.frequency_hz,
            amplitude_v=sweep.amplitude_v,
            source=sweep.source,
            fitted=sweep.use == "fit",
        )


@dataclass(frozen=True)
class _Row:
    """The numbers of an experiment with ready peaks, and what was set that does not drift."""

    where: str
    numbers: tuple[str, ...]
    settings: Mapping[str, Scalar]

    def is_that_of(self, other: _Row) -> bool:
        """Whether another experiment of these numbers is the same one."""
        both = self.settings.keys() & other.settings.keys()
        return all(self.settings[name] == other.settings[name] for name in both)


def _rows(bound: BoundCampaign) -> Iterator[_Row]:
    moving = {*bound.drift.ends, *(name for p in bound.parameters for name in p.adds_to)}
    for e in bound.experiments:
        known = e.spectrum is None and bool(np.all(np.isfinite(e.peaks_v)))
        if known and sum(map(_digits, e.peaks_v)) >= DIGITS:
            yield _Row(
                where=f"{bound.path}: experiment '{e.label}'",
                numbers=_numbers(e),
                settings={k: v for k, v in e.settings.items() if k not in moving},
            )


def _numbers(e: Experiment) -> tuple[str, ...]:
    return tuple(f"{v:.{COMPARED}g}" for v in (*e.tones_hz, *e.read_hz, *e.peaks_v.tolist()))


def _digits(peak: float) -> int:
    """Digits with which an amplitude was written at least: as peak, as rms, or in dBm at 50 ohm."""
    ways = (peak, peak / math.sqrt(2.0), 20.0 * math.log10(peak) + 10.0)
    mantissas = (f"{value:.{COMPARED - 1}e}".partition("e")[0] for value in ways)
    return min(len(m.strip("-0.").replace(".", "")) for m in mantissas)
