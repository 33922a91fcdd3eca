"""What the sweeps of a problem show: their lines, their faults, and the scale that peaks take."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fitting.fit.problem import Problem
from fitting.fit.solution import Solution
from fitting.inference.line_fits import LineFits
from fitting.inference.sweep_agreement import SweepAgreement, explained_by_model, sweep_agreement
from fitting.inference.sweep_line import SweepLine, line_of_sweep
from fitting.lines.faults import Fault, SweepFault, fault_finding, sweep_faults
from fitting.measurements.sweep import Sweep
from fitting.text.finding import Finding, Kind, warning

#: Faults that make the top of a sweep too low or too high.
BENT_TOPS = (Fault.SATURATION, Fault.CLIPPING, Fault.BACKGROUND)
#: Share of a top that is missing, at most.
MOST_MISSING = 0.9


@dataclass(frozen=True, kw_only=True)
class SweepFindings:
    """What the sweeps of a problem show: each by itself, and with the peaks of its series.

    `lines` are by series, `faults` what makes a sweep no line; `doubts` how far the scale that
    peaks take from such a sweep may be off, |ln| of its factor, by series; `agreement` with the
    peaks, a series each, none where a sweep itself is at fault; `fits` all fits of lines.
    """

    lines: Mapping[str, SweepLine] = field(default_factory=dict)
    faults: tuple[Finding, ...] = ()
    doubts: Mapping[str, float] = field(default_factory=dict)
    agreement: tuple[SweepAgreement, ...] = ()
    fits: LineFits = field(default_factory=LineFits)

    @property
    def scale_off(self) -> float:
        """Factor by which a scale of peaks may be off, at most; NaN where none is in doubt."""
        return math.exp(max(self.doubts.values())) if self.doubts else math.nan


def sweep_findings(problem: Problem, solution: Solution) -> SweepFindings:
    """Lines and faults of all sweeps.

    Args:
        problem: with its sweeps.
        solution: end of the fit.
    """
    fits = LineFits()
    sweeps = {n: b.sweep for n, b in problem.campaigns.items() if b.sweep is not None}
    # root mean square, over the largest, of what a model leaves of fitted sweeps if that is noise:
    # it then has the shape of the sweep, one line or not
    explained = {}
    if solution.structure is not None and solution.structure.order == 0:
        pairs = zip(problem.measurements, solution.objective.data.slices, strict=True)
        explained = {
            m.series: float(np.sqrt(np.mean(solution.final.residuals[rows] ** 2)))
            for m, rows in pairs
            if isinstance(m, Sweep) and m.fitted
        }
    points = [
        warning(
            Kind.sweep_point,
            name,
            {"unit": (sweep.unit,)},
            frequency_hz=float(sweep.frequency_hz[k]),
            amplitude=float(sweep.amplitude_v[k]),
            expected=expected,
        )
        for name, sweep in sweeps.items()
        for k, expected in sweep.far_off
    ]
    faults, doubts = [], {}
    for name, sweep in sweeps.items():
        if sweep.background != "none" or name in explained:
            continue
        gives_scale = sweep.scale not in ("none", "free") and bool(
            problem.campaigns[name].experiments
        )
        off = [0.0]
        for fault in _faults(sweep_faults(*sweep.of_line), solution, name):
            bent = fault.fault in BENT_TOPS and gives_scale
            faults.append(fault_finding(fault, name, gives_scale=bent))
            if bent:  # the law of a saturated top is not known
                missing = min(abs(fault.size) + 2.0 * fault.std, MOST_MISSING)
                factor = 2.0 if fault.fault is Fault.SATURATION else 1.0
                off.append(-factor * math.log1p(-missing))
        if len(off) > 1:
            doubts[name] = max(off[1:])
    return SweepFindings(
        lines={n: line_of_sweep(s, explained.get(n, math.nan), fits) for n, s in sweeps.items()},
        faults=(*points, *faults),
        doubts=doubts,
        # a sweep that is no line contradicts the peaks for that reason
        agreement=() if points or faults else sweep_agreement(solution),
        fits=fits,
    )


def _faults(
    faults: tuple[SweepFault, ...], solution: Solution, series: str
) -> tuple[SweepFault, ...]:
    """The faults; without those that a model of several lines has the shape of, if it fits."""
    like_lines = [
        fault
        for fault in faults
        if fault.fault is Fault.BACKGROUND or (fault.fault is Fault.SATURATION and fault.two_lines)
    ]
    if like_lines and explained_by_model(solution, series):
        return tuple(fault for fault in faults if fault not in like_lines)
    return faults
