"""Readings with their places, their drift or their phases taken for another."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fitting.fit.likelihood.descent import most_likely
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.inference.checks.outliers import refitted
from fitting.inference.solved import Solved
from fitting.measurements.complex.tones import ComplexTones
from fitting.measurements.measurement import DivisibleResponse
from fitting.measurements.tones import Tones
from fitting.signal.misfit import excess_share
from fitting.text.finding import Finding, Kind, warning

#: Chi square of two peaks from which they may be exchanged, and what is left if they are.
SWAPPED_BEYOND, SWAPPED_SHARE = 50.0, 0.1
#: Share of the misfit that the drift the other way round may leave.
MOST_LEFT_REVERSED = 0.1
#: Factors on phases that a mistake makes, and what their numbers are then.
READINGS = {-1.0: "reversed", 180.0 / math.pi: "radian", math.pi / 180.0: "degree"}
#: Residuals, in their noise or as a share where that is unknown, from which phases are suspected.
SUSPECT, SUSPECT_SHARE = 3.0, 0.1
#: Share of chi square that a reading may leave to be named.
LEFT = 0.1


def check_exchanged_peaks(solved: Solved) -> Iterator[Finding]:
    """Experiments whose peaks fit far better with two of them exchanged."""
    if solved.causes:
        return
    sigmas = solved.problem.data.peaks_of_rows(solved.noise.sigma)
    peaks = solved.problem.data.peaks(solved.solution.final.scaled)
    rows = iter(zip(peaks, sigmas, strict=True))
    for e in solved.problem.experiments:
        mine = np.array([next(rows) for _ in e.read_hz])
        for i, k in itertools.combinations(range(len(e.read_hz)), 2):
            model, sigma = mine[[i, k]].T
            as_is, swapped = (
                float(np.sum(((model - measured) / (measured * sigma)) ** 2))
                for measured in (e.peaks_v[[i, k]], e.peaks_v[[k, i]])
            )
            if as_is > SWAPPED_BEYOND and swapped < SWAPPED_SHARE * as_is:
                one_hz, other_hz = float(e.read_hz[i]), float(e.read_hz[k])
                yield warning(Kind.peaks_exchanged, e.label, one_hz=one_hz, other_hz=other_hz)


def exchanged_drift(solved: Solved) -> Iterator[Finding]:
    """That the values of a drift before and after its series are exchanged.

    Args:
        solved: with experiments under a drift.
    """
    solution, objective = solved.solution, solved.solution.objective
    response, everything = objective.response, np.empty(0, dtype=np.intp)
    if not isinstance(response, DivisibleResponse):
        return
    for name, bound in solved.problem.campaigns.items():
        ends = bound.drift.ends
        if not any(before != after for before, after in ends.values()):
            continue
        reversed_tones = tuple(
            replace(
                m,
                experiments=tuple(
                    replace(
                        e,
                        settings={
                            key: sum(ends[key]) - float(value) if key in ends else value
                            for key, value in e.settings.items()
                        },
                    )
                    for e in m.experiments
                ),
            )
            if isinstance(m, Tones) and m.series == name
            else m
            for m in objective.data.measurements
        )
        other = replace(
            objective,
            response=response.answering(reversed_tones),
            data=replace(objective.data, measurements=reversed_tones),
        )
        refit = refitted(solution, other, everything)
        before = refitted(solution, objective, everything)
        left = excess_share(refit.chi_square, before.chi_square, refit.freedom)
        if refit.fits or left < MOST_LEFT_REVERSED:  # a drift that bends leaves some
            yield warning(Kind.drift_exchanged, name or "drift", None, **refit.numbers)
            return


def check_phases(solved: Solved) -> Iterator[Finding]:
    """Phases that fit far better with another sign or unit: each reading is fitted."""
    solution, data = solved.solution, solved.data

    def chi_square(k: int, read: ComplexTones) -> float:
        measurements = (*data.measurements[:k], read, *data.measurements[k + 1 :])
        other = replace(solution.objective, data=replace(data, measurements=measurements))
        likelihood = likelihood_of(other, solved.noise.sigma, solved.noise.common)
        starts = [solution.final.x, solution.initial.x]
        return most_likely(LikelihoodEvaluator(likelihood), starts).chi_square

    for k, m in enumerate(data.measurements):
        if not isinstance(m, ComplexTones):
            continue
        limit = np.where(m.sigma > 0.0, SUSPECT * m.sigma, SUSPECT_SHARE)
        if float(np.mean((solution.final.residuals[data.slices[k]] / limit) ** 2)) < 1.0:
            continue
        as_is = chi_square(k, m)
        for factor, reading in READINGS.items():
            other = chi_square(k, m.read_as(factor))
            if other < LEFT * as_is:
                names = {"reading": (reading,)}
                yield warning(Kind.phases_misread, m.series, names, improvement=as_is / other)
