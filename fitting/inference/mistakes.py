"""Mistakes of a laboratory that the data themselves show: each named, none modelled.

A sweep that is no line, peaks that changed places, a tone that nobody declared, peaks and a sweep
on two scales, a box that is a thousand times off the line. What is said is what the data show; what
made it is asked.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.campaign import Experiment, SweepData
from fitting.campaign.parameters import Parameter
from fitting.fit.noise import noise_of
from fitting.fit.problem import Problem
from fitting.fit.solution import Solution
from fitting.inference.sweep_agreement import SweepAgreement, explained_by_model, sweep_agreement
from fitting.inference.sweep_line import SweepLine, line_of_sweep
from fitting.measurements.sweep import Sweep
from fitting.signal.combinations import mixed_hz
from fitting.signal.peaks import unknown_line
from fitting.signal.sweep_faults import Fault, SweepFault, sweep_faults
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind
from fitting.text.units import convert

#: Factors between the amplitudes of a sweep and of peaks, and what one of them may be.
FACTORS = {
    math.sqrt(2.0): "rms, the other peak",
    math.sqrt(0.5): "rms, the other peak",
    2.0: "peak to peak, or driven twice as hard",
    0.5: "peak to peak, or driven twice as hard",
}
#: Kinds of findings on a sweep that is no line.
FAULTS = {
    Fault.POWER: Kind.sweep_power,
    Fault.SATURATION: Kind.sweep_saturated,
    Fault.CLIPPING: Kind.sweep_clipped,
    Fault.OUTLIER: Kind.sweep_outlier,
    Fault.BACKGROUND: Kind.sweep_background,
}
#: Faults that make the top of a sweep too low or too high.
BENT_TOPS = (Fault.SATURATION, Fault.CLIPPING, Fault.BACKGROUND)
#: Share of a top that is missing, at most.
MOST_MISSING = 0.9
#: Chi square of two peaks from which they may have changed places, and what is left if they did.
SWAPPED_BEYOND, SWAPPED_SHARE = 50.0, 0.1
#: Factors of a unit with a wrong prefix, and ends of a box that tells where a line is.
PREFIXES = (1e3, 1e-3, 1e6, 1e-6)
NARROW = 10.0
#: Highest order of mixtures of tones that explain a line of a spectrum.
MIXED_ORDER = 5


@dataclass(frozen=True, kw_only=True)
class SweepFindings:
    """What the sweeps of a problem show: each by itself, and beside the peaks of its series.

    `lines` are by series, `faults` what makes a sweep no line; `doubts` how far the scale that
    peaks take from such a sweep may be off, |ln| of its factor, by series; `agreement` with the
    peaks, a series each, none where a sweep itself is at fault; `left_out` points that are not
    fitted.
    """

    lines: Mapping[str, SweepLine] = field(default_factory=dict)
    faults: tuple[Finding, ...] = ()
    doubts: Mapping[str, float] = field(default_factory=dict)
    agreement: tuple[SweepAgreement, ...] = ()
    left_out: tuple[Finding, ...] = ()

    @property
    def scale_off(self) -> float:
        """Factor by which a scale of peaks may be off, at most; NaN where none is in doubt."""
        return math.exp(max(self.doubts.values())) if self.doubts else math.nan


def sweep_findings(problem: Problem, solution: Solution) -> SweepFindings:
    """What the sweeps show; every fit of them is made here, once.

    Args:
        problem: with its sweeps.
        solution: end of the fit.
    """
    explained = _explained(problem, solution)
    found = _faults(problem, tuple(explained), solution)
    faults = tuple(_of_faults(problem, found))
    sweeps = {name: bound.sweep for name, bound in problem.campaigns.items()}
    return SweepFindings(
        lines={
            name: line_of_sweep(sweep, explained.get(name, math.nan))
            for name, sweep in sweeps.items()
            if sweep is not None
        },
        faults=faults,
        doubts=_doubts(problem, found),
        # a sweep that is no line contradicts the peaks for that reason
        agreement=() if faults else sweep_agreement(solution),
        left_out=(
            *(
                replace(f, subject=n)
                for n, s in sweeps.items()
                if s is not None
                for f in s.left_out
            ),
            *(replace(f, subject=m.series) for m in problem.measurements for f in m.left_out),
        ),
    )


def _explained(problem: Problem, solution: Solution) -> dict[str, float]:
    """What is left (rms, over the largest) of fitted sweeps by series, where it is noise.

    The model then has the shape of the sweep, one line or not.
    """
    if solution.structure is None or solution.structure.order > 0:
        return {}
    pairs = zip(problem.measurements, solution.objective.data.slices, strict=True)
    return {
        m.series: float(np.sqrt(np.mean(solution.final.residuals[mine] ** 2)))
        for m, mine in pairs
        if isinstance(m, Sweep) and m.fitted
    }


def _faults(
    problem: Problem, explained: Collection[str], solution: Solution
) -> dict[str, tuple[SweepFault, ...]]:
    """What is wrong with the sweep of each campaign, by its name."""
    found = {}
    for name, bound in problem.campaigns.items():
        if bound.sweep is None or bound.sweep.background != "none" or name in explained:
            continue
        faults = sweep_faults(*bound.sweep.of_line)
        lines = [f for f in faults if _is_like_lines(f)]
        if lines and explained_by_model(solution, name):
            faults = tuple(f for f in faults if f not in lines)
        found[name] = faults
    return found


def _is_like_lines(found: SweepFault) -> bool:
    """Whether a model of several lines may have the shape."""
    flat = found.fault is Fault.SATURATION and found.two_lines
    return flat or found.fault is Fault.BACKGROUND


def _of_faults(problem: Problem, found: Mapping[str, tuple[SweepFault, ...]]) -> Iterator[Finding]:
    """Single points first, then what is wrong with the sweep of each campaign."""
    for name, bound in problem.campaigns.items():
        if bound.sweep is not None:
            yield from _single_points(name, bound.sweep)
    for name, faults in found.items():
        for fault in faults:
            bent = fault.fault in BENT_TOPS and _gives_scale(problem, name)
            yield fault_finding(fault, name, gives_scale=bent)


def fault_finding(fault: SweepFault, subject: str = "", *, gives_scale: bool = False) -> Finding:
    """What makes a sweep no damped line, as a finding.

    Args:
        fault: of the sweep.
        subject: name of its campaign, where there are several.
        gives_scale: whether the scale of peaks rests on the faulty top.
    """
    plain_hz, corrected_hz = fault.width_hz
    numbers = {
        "size": fault.size,
        "std": fault.std,
        "width_hz": plain_hz,
        "corrected_width_hz": corrected_hz,
        "two_lines": float(fault.two_lines),
        "gives_scale": float(gives_scale),
    }
    if not math.isnan(fault.frequency_hz):
        numbers["frequency_hz"] = fault.frequency_hz
    kind = FAULTS[fault.fault]
    return Finding(kind=kind, severity="warning", subject=subject, numbers=numbers)


def _gives_scale(problem: Problem, name: str) -> bool:
    """Whether peaks take their scale from the sweep of a campaign."""
    bound = problem.campaigns[name]
    takes = bound.sweep is not None and bound.sweep.scale not in ("none", "free")
    return takes and bool(bound.experiments)


def _doubts(problem: Problem, found: Mapping[str, tuple[SweepFault, ...]]) -> dict[str, float]:
    """How far the scale of each series may be off, |ln| of its factor, for the top of its sweep."""
    doubts = {}
    for name, faults in found.items():
        bent = [fault for fault in faults if fault.fault in BENT_TOPS]
        if bent and _gives_scale(problem, name):
            doubts[name] = max(map(_off_by, bent))
    return doubts


def _off_by(found: SweepFault) -> float:
    """|ln| of the factor by which the top may be off; the law of a saturated one is not known."""
    missing = min(abs(found.size) + 2.0 * found.std, MOST_MISSING)
    return -math.log1p(-missing) * (2.0 if found.fault is Fault.SATURATION else 1.0)


def contradiction_findings(agreement: Sequence[SweepAgreement]) -> Iterator[Finding]:
    """Series whose peaks contradict their sweep, and what would explain it.

    Args:
        agreement: of every series, as it was found.
    """
    for found in agreement:
        if not found.contradicts:
            continue
        numbers: dict[str, float] = {"sigmas": found.sigmas}
        reason: tuple[str, ...] = ()
        if not math.isnan(found.factor):
            numbers |= {"factor": found.factor, "factor_std": found.factor_std}
            reason = tuple(words for value, words in FACTORS.items() if _is(found, value))[:1]
        yield Finding(
            kind=Kind.scale_contradicted,
            severity="warning",
            subject=found.series,
            numbers=numbers,
            names={"reason": reason},
        )


def _is(found: SweepAgreement, value: float) -> bool:
    return abs(found.factor / value - 1.0) < max(0.02, 3.0 * found.factor_std / value)


def exchanged_findings(problem: Problem, solution: Solution) -> Iterator[Finding]:
    """Experiments whose peaks fit far better with the places of two of them exchanged.

    Args:
        problem: its experiments name the peaks.
        solution: end of the fit.
    """
    data, point = problem.data, solution.final
    sigmas = data.peaks_of_rows(noise_of(solution.objective, point).sigma)
    scaled = iter(zip(data.peaks(point.scaled), sigmas, strict=True))
    for e in problem.experiments:
        mine = np.array([next(scaled) for _ in e.read_hz])
        for i, k in itertools.combinations(range(len(e.read_hz)), 2):
            model, sigma = mine[[i, k], 0], mine[[i, k], 1]
            as_is, swapped = (
                float(np.sum(((model - peaks) / (peaks * sigma)) ** 2))
                for peaks in (e.peaks_v[[i, k]], e.peaks_v[[k, i]])
            )
            if as_is > SWAPPED_BEYOND and swapped < SWAPPED_SHARE * as_is:
                numbers = {"one_hz": float(e.read_hz[i]), "other_hz": float(e.read_hz[k])}
                kind = Kind.peaks_exchanged
                yield Finding(kind=kind, severity="warning", subject=e.label, numbers=numbers)


def _single_points(name: str, sweep: SweepData) -> Iterator[Finding]:
    """Single points of a sweep that no line of its grid makes."""
    for k, expected in sweep.far_off:
        yield Finding(
            kind=Kind.sweep_point,
            severity="warning",
            subject=name,
            numbers={
                "frequency_hz": float(sweep.frequency_hz[k]),
                "amplitude": float(sweep.amplitude_v[k]),
                "expected": expected,
            },
            names={"unit": (sweep.unit,)},
        )


def slipped_findings(problem: Problem, lines: Mapping[str, SweepLine]) -> Iterator[Finding]:
    """Bounds of a frequency that are 1000 times off the line of the sweep, which lies in none.

    Wide bounds tell no place, as those of a width do not; told only where all that tell one are so
    far off.

    Args:
        problem: with its parameters.
        lines: that its sweeps show by themselves, by series.
    """
    for name, line in lines.items():
        sweep = problem.campaigns[name].sweep
        boxes = [(p.name, *_box_hz(p)) for p in problem.parameters]
        boxes = [box for box in boxes if 0.0 < box[1] < box[2] < NARROW * box[1]]
        slips = [_slip(line.frequency.value, low, high) for _, low, high in boxes]
        if sweep is None or not slips or not all(slips):
            continue
        (parameter, low, high), factor = boxes[0], slips[0]
        yield Finding(
            kind=Kind.bounds_off_line,
            severity="warning",
            subject=parameter,
            numbers={
                "frequency_hz": line.frequency.value,
                "lower_hz": low,
                "upper_hz": high,
                "factor": factor,
            },
            names={"file": (sweep.source.name,)},
        )


def _box_hz(parameter: Parameter) -> tuple[float, float]:
    """Ends of a box in Hz; NaN for another unit."""
    try:
        low, high = (
            convert(end, parameter.unit, "Hz", where=parameter.name)
            for end in (parameter.lower, parameter.upper)
        )
    except BadInput:
        return math.nan, math.nan
    return low, high


def _slip(frequency_hz: float, low_hz: float, high_hz: float) -> float:
    """By which factor of a prefix a box is off a frequency; zero without one."""
    return next((f for f in PREFIXES if low_hz <= f * frequency_hz <= high_hz), 0.0)


def unknown_line_findings(experiments: Sequence[Experiment]) -> Iterator[Finding]:
    """A line in the spectra at no tone of the drive, nor at a mixture of tones: the largest.

    Args:
        experiments: with their spectra.
    """
    found = []
    for e in experiments:
        if e.spectrum is not None:
            known = (*e.tones_hz, *e.read_hz, *mixed_hz(e.tones_hz, MIXED_ORDER))
            line = unknown_line(e.spectrum.frequency_hz, e.spectrum.amplitude_v, known)
            if line is not None:
                found.append((e.label, e.spectrum.unit, *line))
    if found:
        label, unit, place, height = max(found, key=lambda each: each[3])
        yield Finding(
            kind=Kind.unknown_line,
            severity="warning",
            subject=label,
            numbers={"count": float(len(found)), "frequency_hz": place, "height": height},
            names={"unit": (unit,)},
        )
