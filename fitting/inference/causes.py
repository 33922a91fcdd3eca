"""Why a model does not describe the data: what one mistake in the laboratory would explain.

A number that would mend curves (`fitting.inference.curve_causes`), single points far off, an
experiment without which noise explains the rest, or a drift taken the other way round.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import inverse_priors
from fitting.fit.fit import Fit
from fitting.fit.likelihood.descent import most_likely
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator, likelihood_with
from fitting.fit.objective import Objective
from fitting.fit.solution import Solution
from fitting.inference.curve_causes import (
    causes_along_curves,
    gain_of_experiments,
    solved_inside,
)
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.measurements.measurement import DivisibleResponse, Measurement
from fitting.measurements.tones import Tones
from fitting.signal.chi_square import tail
from fitting.signal.misfit import (
    IMPROBABLE,
    NOTICED,
    excess_share,
    far_off,
    scaled_solution,
)
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.errors import FmuFailure, NoScale
from fitting.text.finding import Finding, Kind
from fitting.text.notation import hertz, number

#: Share of the misfit that the drift the other way round may leave.
MOST_LEFT_TURNED = 0.1
#: Height of a model over the data below which no factor is told.
LEAST = 1e-6
#: Standard deviation of a row that counts for nothing.
NOTHING = 1e6
#: Experiments of which one is left out in a fit, those that promise most.
TRIED = 2


def causes_of(fit: Fit, adequacy: Adequacy | None) -> tuple[Finding, ...]:
    """What may be why, as findings; none where the residuals are what they should be.

    Args:
        fit: a solved problem.
        adequacy: of its residuals; None: nobody asked.
    """
    if adequacy is None or adequacy.against or adequacy.absent:
        return ()
    found = [*_single_rows(fit, adequacy)]
    if adequacy.describes and not adequacy.is_correlated:
        return tuple(found)
    try:
        found += causes_along_curves(fit.solution)
        if not found and not adequacy.describes:
            found += _of_experiments(fit)
        if not found and not adequacy.describes:
            found += gain_of_experiments(fit.solution)
    except (FmuFailure, NoScale, np.linalg.LinAlgError):  # where the model fails nothing is known
        return tuple(found)
    return tuple(found)


def without_outliers(fit: Fit, adequacy: Adequacy) -> Adequacy:
    """The same; where single rows make up what looks like larger noise, these instead of that.

    Args:
        fit: a solved problem.
        adequacy: of its residuals.
    """
    if not adequacy.noise_factor > 1.0:
        return adequacy
    solution, data = fit.solution, fit.problem.data
    known = data.sigma > 0.0
    try:
        columns = np.column_stack(
            [solution.matrix, solved_inside(solution, solution.final.parameters)]
        )[known]
    except (FmuFailure, NoScale):
        return adequacy
    sigma = solution.noise.sigma[known]
    found = far_off(solution.final.residuals[known] / sigma, columns / sigma[:, None])
    if not found:
        return adequacy
    rows = tuple(int(k) for k in np.flatnonzero(known)[list(found)])
    return replace(adequacy, noise_factor=1.0, outliers=rows)


def cause_sentence(finding: Finding) -> str:
    """A cause, or what is far off, in words.

    Args:
        finding: of `causes_of`.
    """
    of, n = finding.subject or "The data", finding.numbers
    share = f"{number(100.0 * n.get('removed', math.nan), 2)} % of the misfit"
    removed = f"removes {share}"
    several = n.get("curves", 1.0) > 1.0
    alike = ", of each curve its own, at most" if several else ""
    factor = number(1.0 + n.get("size", math.nan), 3)
    size = number(n.get("size", math.nan), 3)
    place = (
        hertz(n["frequency_hz"]) if "frequency_hz" in n else f"{n.get('time_s', math.nan):.6g} s"
    )
    moved = (
        f"shifts of the axis that differ from curve to curve, by {place} at most, remove {share}. "
        "Wanted the frequency, or the time, of each, or a drift between them."
        if several
        else f"a shift of its axis by {place} {removed}. Wanted the frequency, or the time, of "
        "the measurement."
    )
    said = {
        Kind.gain: f"{of}: a factor of {factor} on the model's output{alike} {removed}. Wanted the "
        "unit and the gain of the read-out, or a gain that is fitted.",
        Kind.offset: f"{of}: an offset of {size}{alike} {removed}. Wanted an offset or a "
        "background that is fitted.",
        Kind.shift: f"{of}: {moved}",
        Kind.noise_level: f"{of}: {factor} times the level of the noise{alike} {removed}. Wanted "
        "the temperature, the mass and the read-out.",
        Kind.drift_exchanged: f"{of}: fits with the values before and after the series exchanged. "
        "Wanted their order.",
    }
    if finding.kind is not Kind.outlier:
        return said[finding.kind]
    if "chi_square" in n:
        return (
            f"{of}: without it χ² is {number(n['chi_square'], 3)} on {number(n['freedom'], 3)}: "
            f"its peaks are {number(n['factor'], 3)} times as high as the others make likely."
        )
    return f"{of}: the point at {place} is {number(n['sigmas'], 3)} standard deviations off."


def _single_rows(fit: Fit, adequacy: Adequacy) -> Iterator[Finding]:
    data, point = fit.problem.data, fit.solution.final
    sigma = fit.solution.noise.sigma
    for k in adequacy.outliers:
        for m, at in zip(data.measurements, data.slices, strict=True):
            if not at.start <= k < at.stop:
                continue
            curves = m.residual_curves(point.residuals[at])
            curve = next((c for c in curves if k - at.start in c.rows), None)
            numbers = {"sigmas": float(-point.residuals[k] / sigma[k])}
            name = "" if curve is None else curve.name
            if curve is not None and curve.axis.size:
                place = float(curve.axis[np.flatnonzero(curve.rows == k - at.start)[0]])
                numbers["time_s" if m.is_trace else "frequency_hz"] = place
            elif isinstance(m, Tones):
                name, numbers["frequency_hz"] = _line(m, k - at.start)
            subject = "/".join(filter(None, (m.series, name))) or "measurement"
            yield Finding(kind=Kind.outlier, severity="warning", subject=subject, numbers=numbers)


def _line(tones: Tones, row: int) -> tuple[str, float]:
    """Experiment and frequency of the line of a row."""
    lines = [(e.label, float(f)) for e in tones.experiments for f in e.read_hz]
    return lines[row % len(lines)]


# --- single peaks -------------------------------------------------------------------------------


def _of_experiments(fit: Fit) -> list[Finding]:
    """Drift the other way round, else the experiment without which the rest fits."""
    if not fit.problem.data.tones:
        return []
    exchanged = _exchanged(fit)
    return [exchanged] if exchanged is not None else [*_left_out(fit)]


@dataclass(frozen=True)
class _Refit:
    """Chi square of the rows that count, its freedom, and residuals of all rows, (m,)."""

    square: float
    freedom: float
    residuals: FloatArray

    @property
    def fits(self) -> bool:
        """Whether noise explains chi square, or nearly."""
        if self.freedom < 1.0:
            return False
        return (
            tail(self.square, self.freedom) >= IMPROBABLE or self.square <= NOTICED * self.freedom
        )

    @property
    def numbers(self) -> dict[str, float]:
        """Chi square and freedom, by name."""
        return {"chi_square": self.square, "freedom": self.freedom}


def _refitted(objective: Objective, fit: Fit, without: IntArray) -> _Refit:
    """A fit in which some rows count for nothing."""
    noise = fit.solution.noise
    sigma = noise.sigma.copy()
    sigma[without] *= NOTHING
    evaluator = LikelihoodEvaluator(likelihood_with(objective, replace(noise, sigma=sigma)))
    found = most_likely(evaluator, [fit.solution.final.x])
    rows = found.likelihood.residuals(found.expansion.sample.rows[: sigma.size])
    return _Refit(found.chi_square, found.degrees_of_freedom - without.size, rows)


def _exchanged(fit: Fit) -> Finding | None:
    """That the values before and after a series have changed places."""
    objective = fit.solution.objective
    response = objective.response
    if not isinstance(response, DivisibleResponse):
        return None
    for name, bound in fit.problem.campaigns.items():
        if not any(before != after for before, after in bound.drift.ends.values()):
            continue
        turned = tuple(
            _turned(m, bound.drift.ends) if isinstance(m, Tones) and m.series == name else m
            for m in objective.data.measurements
        )
        other = replace(
            objective,
            response=response.answering(turned),
            data=replace(objective.data, measurements=turned),
        )
        nothing = np.empty(0, dtype=np.intp)
        refit, before = _refitted(other, fit, nothing), _refitted(objective, fit, nothing)
        left = excess_share(refit.square, before.square, refit.freedom)
        if refit.fits or left < MOST_LEFT_TURNED:  # a drift that bends leaves some
            return Finding(
                kind=Kind.drift_exchanged,
                severity="warning",
                subject=name or "drift",
                numbers=refit.numbers,
            )
    return None


def _turned(tones: Tones, ends: Mapping[str, tuple[float, float]]) -> Measurement:
    """Tones under a drift from its last values to its first."""
    experiments = tuple(
        replace(
            e,
            settings={
                name: sum(ends[name]) - float(value) if name in ends else value
                for name, value in e.settings.items()
            },
        )
        for e in tones.experiments
    )
    return replace(tones, experiments=experiments)


def _left_out(fit: Fit) -> Iterator[Finding]:
    """The experiment without which noise explains the rest, if it is one alone."""
    groups = _experiment_rows(fit.solution.objective.data.measurements, fit)
    if len(groups) < 3:
        return
    promising = sorted(groups, key=lambda label: _without(fit.solution, groups[label]))[:TRIED]
    found = []
    for label in promising:
        refit = _refitted(fit.solution.objective, fit, groups[label])
        if refit.fits:
            found.append((label, refit))
    if len(found) != 1:
        return
    [(label, refit)] = found
    # rows are model/data - 1
    factor = float(np.mean(1.0 / np.maximum(1.0 + refit.residuals[groups[label]], LEAST)))
    yield Finding(
        kind=Kind.outlier,
        severity="warning",
        subject=label,
        numbers={**refit.numbers, "factor": factor},
    )


def _experiment_rows(measurements: Sequence[Measurement], fit: Fit) -> dict[str, IntArray]:
    """Rows of every experiment, by its label."""
    found: dict[str, IntArray] = {}
    for m, at in zip(measurements, fit.problem.data.slices, strict=True):
        if not isinstance(m, Tones):
            continue
        labels = np.array([e.label for e in m.experiments for _ in e.read_hz])
        halves = np.tile(labels, m.rows // max(labels.size, 1))
        for e in m.experiments:
            found[e.label] = at.start + np.flatnonzero(halves == e.label)
    return found


def _without(solution: Solution, mine: IntArray) -> float:
    """Chi square of the linearised problem without some rows."""
    sigma = solution.noise.sigma.copy()
    sigma[mine] *= NOTHING
    rows, matrix = solution.final.residuals / sigma, solution.matrix / sigma[:, None]
    held = inverse_priors(solution.parameters)
    stacked = np.vstack([matrix, np.diag(held)])
    target = np.append(rows, held * solution.final.x)
    left = target - stacked @ scaled_solution(stacked, target)
    return float(left @ left)
