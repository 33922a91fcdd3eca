"""Sweeps that are no line, that contradict the peaks, or that lie off a parameter's bounds."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator
from dataclasses import replace

from fitting.campaign.parameters import Parameter
from fitting.inference.solved import Solved
from fitting.inference.sweep_line import SweepLine, line_findings
from fitting.inference.sweeps import SweepAgreement
from fitting.signal.combinations import mixed_hz
from fitting.signal.peaks import unknown_line
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind, warning
from fitting.text.units import convert

#: Factors between the amplitudes of a sweep and of peaks, and what makes them.
FACTORS = {
    math.sqrt(2.0): "rms",
    math.sqrt(0.5): "rms",
    2.0: "peak_to_peak",
    0.5: "peak_to_peak",
}
#: Factors of a unit with a wrong prefix, and the ratio of bounds that imply a frequency.
PREFIXES = (1e3, 1e-3, 1e6, 1e-6)
NARROW = 10.0
#: How far lines of one experiment may be apart, relative.
NEAR = 0.2
#: Highest order of mixtures of tones that explain a line of a spectrum.
MIXED_ORDER = 5


def check_lines(solved: Solved) -> Iterator[Finding]:
    """What a reader of the lines of the sweeps must know, of one campaign."""
    if solved.problem.is_joint:
        return
    fitted = any(m.rows for m in solved.problem.measurements if m.is_curve)
    for line in solved.sweeps.lines.values():
        yield from line_findings(line, fitted=fitted)


def check_faults(solved: Solved) -> Iterator[Finding]:
    """Single points that no line makes, and tops or wings that no line has."""
    yield from solved.sweeps.faults


def check_left_out(solved: Solved) -> Iterator[Finding]:
    """Points of files that are not fitted."""
    for name, bound in solved.problem.campaigns.items():
        for finding in () if bound.sweep is None else bound.sweep.left_out:
            yield replace(finding, subject=name)
    for measurement in solved.problem.measurements:
        for finding in measurement.left_out:
            yield replace(finding, subject=measurement.series)


def check_agreement(solved: Solved) -> Iterator[Finding]:
    """Series whose peaks contradict their sweep, and the factor that would explain it."""
    for test in solved.sweeps.agreement:
        if not test.contradicts:
            continue
        numbers: dict[str, float] = {"sigmas": test.sigmas}
        if not math.isnan(test.factor):
            numbers |= {"factor": test.factor, "factor_std": test.factor_std}
        reasons = tuple(why for value, why in FACTORS.items() if _is_factor(test, value))
        names = {"reason": reasons[:1]}
        yield warning(Kind.scale_contradicted, test.series, names, **numbers)


def _is_factor(test: SweepAgreement, value: float) -> bool:
    return abs(test.factor / value - 1.0) < max(0.02, 3.0 * test.factor_std / value)


def check_frequency_bounds(solved: Solved) -> Iterator[Finding]:
    """Bounds of a frequency that are a unit's prefix off the line of the sweep."""
    for name, line in solved.sweeps.lines.items():
        sweep = solved.problem.campaigns[name].sweep
        file = "" if sweep is None else sweep.source.name
        yield from bounds_off_line(solved.problem.parameters, line, file)


def bounds_off_line(
    parameters: tuple[Parameter, ...], line: SweepLine, file: str
) -> Iterator[Finding]:
    """The first frequency whose bounds are off the line by a prefix, if all are.

    Wide bounds, as those of a width, imply no frequency and do not count.

    Args:
        parameters: of the problem.
        line: of a sweep.
        file: of the sweep.
    """
    boxes = []
    for p in parameters:
        try:
            low, high = (convert(e, p.unit, "Hz", where=p.name) for e in (p.lower, p.upper))
        except BadInput:  # no frequency
            continue
        if 0.0 < low < high < NARROW * low:
            places = (f for f in PREFIXES if low <= f * line.frequency.value <= high)
            boxes.append((p.name, low, high, next(places, 0.0)))
    if boxes and all(factor for *_, factor in boxes):
        name, low, high, factor = boxes[0]
        numbers = {"frequency_hz": line.frequency.value, "lower_hz": low, "upper_hz": high}
        names = {"file": (file,)}
        yield warning(Kind.bounds_off_line, name, names, **numbers, factor=factor)


def check_frequencies(solved: Solved) -> Iterator[Finding]:
    """Frequencies of a sweep that are a unit's prefix off those of the experiments."""
    for name, line in solved.sweeps.lines.items():
        campaign = solved.problem.campaigns[name]
        tones = [float(f) for e in campaign.experiments for f in e.tones_hz]
        if campaign.sweep is None or not tones:
            continue
        other = statistics.median(tones)
        places = (f * line.frequency.value for f in PREFIXES)
        if any(abs(other / place - 1.0) < NEAR for place in places):
            yield Finding(
                kind=Kind.frequencies_apart,
                severity="warning",
                subject=name,
                numbers={"frequency_hz": line.frequency.value, "other_hz": other},
                names={"file": (campaign.sweep.source.name,)},
            )


def check_unknown_lines(solved: Solved) -> Iterator[Finding]:
    """The largest line in the spectra at no tone of the drive, nor at a mixture of tones."""
    unknown = []
    for e in solved.problem.experiments:
        if e.spectrum is not None:
            known = (*e.tones_hz, *e.read_hz, *mixed_hz(e.tones_hz, MIXED_ORDER))
            line = unknown_line(e.spectrum.frequency_hz, e.spectrum.amplitude_v, known)
            if line is not None:
                unknown.append((e.label, e.spectrum.unit, *line))
    if unknown:
        label, unit, place, height = max(unknown, key=lambda each: each[3])
        numbers = {"count": float(len(unknown)), "frequency_hz": place, "height": height}
        yield warning(Kind.unknown_line, label, {"unit": (unit,)}, **numbers)
