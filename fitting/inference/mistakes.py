"""Mistakes of a laboratory that the data themselves show: each named, none modelled.

A sweep that is no line, peaks that changed places, a tone that nobody declared, peaks and a sweep
on two scales, a box that is a thousand times off the line. What is said is what the data show; what
made it is asked.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

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
from fitting.text.notation import hertz, number, prefixed, with_error
from fitting.text.units import convert

#: Factors between the amplitudes of a sweep and of peaks, and what makes them.
FACTORS = {
    math.sqrt(2.0): "one of them were rms, the other peak",
    math.sqrt(0.5): "one of them were rms, the other peak",
    2.0: "one of them were peak to peak, or driven twice as hard",
    0.5: "one of them were peak to peak, or driven twice as hard",
}
#: Faults that make the top of a sweep too low or too high.
BENT_TOPS = (Fault.SATURATION, Fault.CLIPPING, Fault.BACKGROUND)
BENT_SCALE = ' The scale of the peaks is taken from this sweep (scale = "free" takes none).'
#: Share of a top that is missing, at most.
MOST_MISSING = 0.9
#: Chi square of two peaks from which they may have changed places, and what is left if they did.
SWAPPED_BEYOND, SWAPPED_SHARE = 50.0, 0.1
#: Factors of a unit with a wrong prefix, in words, and ends of a box that tells where a line is.
PREFIXES = {1e3: "1000 times as high", 1e-3: "1000 times as low", 1e6: "a million times as high"}
PREFIXES |= {1e-6: "a million times as low"}
NARROW = 10.0
#: What is said of a single point.
FAR_OFF = "far off its neighbours"
#: What is asked of such a box.
SLIPPED = "is a unit wrong"
#: Highest order of mixtures of tones that explain a line of a spectrum.
MIXED_ORDER = 5


@dataclass(frozen=True, kw_only=True)
class SweepFindings:
    """What the sweeps of a problem show: each by itself, and beside the peaks of its series.

    `lines` are by series, `faults` sentences on what makes a sweep no line; `doubts` how far the
    scale that peaks take from such a sweep may be off, |ln| of its factor, by series; `agreement`
    with the peaks, a series each, none where a sweep itself is at fault; `left_out` sentences on
    points that are not fitted.
    """

    lines: Mapping[str, SweepLine] = field(default_factory=dict)
    faults: tuple[str, ...] = ()
    doubts: Mapping[str, float] = field(default_factory=dict)
    agreement: tuple[SweepAgreement, ...] = ()
    left_out: tuple[str, ...] = ()

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
    faults = tuple(_sentences(problem, found))
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
            *(s.left_out for s in sweeps.values() if s is not None and s.left_out),
            *(said for m in problem.measurements for said in m.left_out),
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


def fault_sentences(
    problem: Problem, explained: Collection[str] = (), solution: Solution | None = None
) -> list[str]:
    """What makes the sweeps of a problem no damped lines: each by its campaign's name.

    Args:
        problem: whose sweeps are looked at.
        explained: series whose sweep the fitted model explains.
        solution: end of the fit, if there is one: its model may have what one line lacks.
    """
    return _sentences(problem, _faults(problem, explained, solution))


def _faults(
    problem: Problem, explained: Collection[str], solution: Solution | None
) -> dict[str, tuple[SweepFault, ...]]:
    """What is wrong with the sweep of each campaign, by its name."""
    found = {}
    for name, bound in problem.campaigns.items():
        if bound.sweep is None or bound.sweep.background != "none" or name in explained:
            continue
        faults = sweep_faults(*bound.sweep.of_line)
        lines = [f for f in faults if _is_like_lines(f)]
        if lines and solution is not None and explained_by_model(solution, name):
            faults = tuple(f for f in faults if f not in lines)
        found[name] = faults
    return found


def _is_like_lines(found: SweepFault) -> bool:
    """Whether a model of several lines may have the shape."""
    flat = found.fault is Fault.SATURATION and found.two_lines
    return flat or found.fault is Fault.BACKGROUND


def _sentences(problem: Problem, found: Mapping[str, tuple[SweepFault, ...]]) -> list[str]:
    said = single_sentences(problem)
    for name, faults in found.items():
        for fault in faults:
            bent = fault.fault in BENT_TOPS and _gives_scale(problem, name)
            words = fault_sentence(fault) + (BENT_SCALE if bent else "")
            said.append(f"{name}: {words}" if name else words)
    return said


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


def fault_sentence(found: SweepFault) -> str:
    """What makes a sweep no damped line, in words.

    Args:
        found: the fault.
    """
    size = with_error(100.0 * found.size, 100.0 * found.std, "%")
    plain, taken = (hertz(width, digits=4) for width in found.width_hz)
    widths = f" Its width, with this taken into account, is {taken}; without, {plain}."
    if found.fault is Fault.SATURATION:  # its law is not known: two laws may fit alike
        widths = f" Its width is less than the {plain} that a line without this has."
    at = "" if math.isnan(found.frequency_hz) else hertz(found.frequency_hz)
    sentences = {
        Fault.POWER: "The points of the sweep follow a line raised to the power "
        f"{with_error(found.size, found.std)}, not a line: are their decibels, or squares, "
        "read in the right way?",
        Fault.SATURATION: "The top of the sweep is flatter than that of a line: a detector that "
        "saturates, or a nonlinear resonator.",
        Fault.CLIPPING: f"The largest points of the sweep, about {at}, are equal: it is clipped, "
        f"{size} of its top are missing.",
        Fault.OUTLIER: f"One point of the sweep, at {at}, stands off its line by {size} of the top "
        f"(scatter of the others {100.0 * found.std:.2g} %).",
        Fault.BACKGROUND: f"The sweep stands on a background of {size} of its top.",
    }
    doubt = " Two lines that overlap would look the same." if found.two_lines else ""
    return sentences[found.fault] + widths + doubt


def contradiction_sentences(agreement: Sequence[SweepAgreement]) -> list[str]:
    """Series whose peaks contradict their sweep, and what would explain it.

    Args:
        agreement: of every series, as it was found.
    """
    return [_contradiction(found) for found in agreement if found.contradicts]


def _contradiction(found: SweepAgreement) -> str:
    whose = f"{found.series}: t" if found.series else "T"
    said = (
        f"{whose}he peaks and the sweep contradict each other by {found.sigmas:.2g} standard "
        "deviations: fitted each by itself they tell different lines."
    )
    if math.isnan(found.factor):
        return f"{said} No factor between their amplitudes explains it."
    factor = with_error(found.factor, found.factor_std)
    said += f" If the sweep's amplitudes were {factor} times as large they would agree"
    known = [words for value, words in FACTORS.items() if _is(found, value)]
    return (
        f"{said}, as if {known[0]}." if known else f"{said}: is it the same gain and drive level?"
    )


def _is(found: SweepAgreement, value: float) -> bool:
    return abs(found.factor / value - 1.0) < max(0.02, 3.0 * found.factor_std / value)


def swapped_sentences(problem: Problem, solution: Solution) -> list[str]:
    """Experiments whose peaks fit far better with the places of two of them exchanged.

    Args:
        problem: its experiments name the peaks.
        solution: end of the fit.
    """
    data, point = problem.data, solution.final
    sigmas = data.peaks_of_rows(noise_of(solution.objective, point).sigma)
    scaled = iter(zip(data.peaks(point.scaled), sigmas, strict=True))
    said = []
    for e in problem.experiments:
        mine = np.array([next(scaled) for _ in e.read_hz])
        for i, k in itertools.combinations(range(len(e.read_hz)), 2):
            model, sigma = mine[[i, k], 0], mine[[i, k], 1]
            as_is, swapped = (
                float(np.sum(((model - peaks) / (peaks * sigma)) ** 2))
                for peaks in (e.peaks_v[[i, k]], e.peaks_v[[k, i]])
            )
            if as_is > SWAPPED_BEYOND and swapped < SWAPPED_SHARE * as_is:
                said.append(
                    f"{e.label}: its peaks at {hertz(e.read_hz[i])} and {hertz(e.read_hz[k])} fit "
                    "if they have changed places: were their labels exchanged?"
                )
    return said


def single_sentences(problem: Problem) -> list[str]:
    """Single points of sweeps that no line of their grid makes.

    Args:
        problem: with its sweeps.
    """
    sweeps = [bound.sweep for bound in problem.campaigns.values() if bound.sweep is not None]
    return [_single(sweep, k, there) for sweep in sweeps for k, there in sweep.far_off]


def _single(sweep: SweepData, k: int, there: float) -> str:
    size = float(sweep.amplitude_v[k])
    factor, unit = prefixed(size, sweep.unit)
    return (
        f"One point of the sweep, at {hertz(float(sweep.frequency_hz[k]))}, is "
        f"{number(size / factor, 3)} {unit}, {FAR_OFF}, which make {number(there / factor, 3)} "
        f"{unit} likely: no line that these points could tell of. It counts as every other one; "
        "without its row in the file it would not."
    )


def slipped_sentences(problem: Problem, lines: Mapping[str, SweepLine]) -> list[str]:
    """A box of a frequency that is 1000 times off the line of the sweep, which lies in none.

    A wide box tells no place, as that of a width does not; told only where every box that tells
    one is so far off.

    Args:
        problem: with its parameters.
        lines: that its sweeps show by themselves, by series.
    """
    said = []
    for name, line in lines.items():
        sweep = problem.campaigns[name].sweep
        boxes = [(p.name, *_box_hz(p)) for p in problem.parameters]
        boxes = [box for box in boxes if 0.0 < box[1] < box[2] < NARROW * box[1]]
        slips = [_slip(line.frequency_hz, low, high) for _, low, high in boxes]
        if sweep is None or not slips or not all(slips):
            continue
        (parameter, low, high), slip = boxes[0], slips[0]
        box = hertz(low, high, digits=6)
        said.append(
            f"The line of {sweep.source.name} is at {hertz(line.frequency_hz, digits=6)}, but "
            f"{parameter} may lie between {box} only, {slip}: {SLIPPED}, that of the parameter or "
            "of the file's frequencies?"
        )
    return said


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


def _slip(frequency_hz: float, low_hz: float, high_hz: float) -> str:
    """By which factor of a prefix a box is off a frequency, in words; empty without one."""
    found = (w for factor, w in PREFIXES.items() if low_hz <= factor * frequency_hz <= high_hz)
    return next(found, "")


def line_sentences_of(experiments: Sequence[Experiment]) -> list[str]:
    """A line that stands in the spectra at no tone of the drive, nor at a mixture of tones.

    Args:
        experiments: with their spectra.
    """
    found = []
    for e in experiments:
        if e.spectrum is not None:
            known = (*e.tones_hz, *e.read_hz, *mixed_hz(e.tones_hz, MIXED_ORDER))
            line = unknown_line(e.spectrum.frequency_hz, e.spectrum.amplitude_v, known)
            if line is not None:
                found.append((e.label, *line))
    if not found:
        return []
    label, place, height = max(found, key=lambda each: each[2])
    many = f"{len(found)} of the spectra hold" if len(found) > 1 else "One spectrum holds"
    unit = next(e.spectrum.unit for e in experiments if e.spectrum is not None)
    return [
        f"{many} a line at none of the declared tones, the largest {height:.3g} {unit} at "
        f"{hertz(place)} in {label}: an undeclared drive, or interference?"
    ]
