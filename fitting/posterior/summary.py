"""What draws give: values with intervals, derived outputs, shares of minima."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fitting.extension.problem import Values, answered_apart, mean
from fitting.extension.report import phrase
from fitting.posterior.chain import Samples
from fitting.posterior.convergence import Accepted, autocorrelation_time, missed_by, split_rhat
from fitting.posterior.minima import Target, about
from fitting.posterior.mixture import Minimum
from fitting.posterior.periods import (
    in_period,
    interval_in_period,
    period_begins,
    value_in_period,
)
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.estimate import (
    NOWHERE,
    Estimate,
    FittedEstimate,
    Interval,
    Method,
    Verdict,
)
from fitting.text.finding import Finding, Kind
from fitting.text.notation import unit_text
from fitting.text.records import EndedRecord

#: Steps over the longest correlation time, and R, at which there are enough draws.
LONG_ENOUGH, AGREE = 50.0, 1.01
#: Share of a chain that is left out at its beginning.
LEFT_OUT = 0.2
CONVERGED, NOT_CONVERGED, INTERRUPTED = "converged", "not converged", "interrupted"
#: Median, and the ends of the intervals as shares of the draws: 68 % as a Gaussian has it, 95 %.
QUANTILES = (0.5, 0.158655, 0.841345, 0.025, 0.975)
#: Draws at which derived outputs are read in one batch.
BATCH = 500


@dataclass(frozen=True, kw_only=True)
class Drawn(Estimate):
    """One number by its draws, next to what the fit reports.

    `value`: median; it, `mean`, `std` and central intervals are NaN if the draws have not
    converged. `status`, `profile95` and `most_likely` are the fit's; `truth` NaN: unknown.
    """

    method: Method = "posterior"
    mean: float
    most_likely: float
    profile95: Interval
    truth: float


@dataclass(frozen=True, kw_only=True)
class PosteriorValue(Drawn):
    """One parameter, and how it was drawn.

    `tau`: integrated autocorrelation time in steps; `rhat`: rank-normalised split R; `effective`
    number of independent draws; `lower` and `upper` bounds, `prior` and `prior_sigma` of a Gaussian
    (NaN: uniform). Values with a period are in the period of the fit's value.
    """

    tau: float
    rhat: float
    effective: float
    lower: float
    upper: float
    prior: float
    prior_sigma: float
    shared: bool


@dataclass(frozen=True, kw_only=True)
class PosteriorOutput(Drawn):
    """One derived output at `draws` nearly independent draws.

    `missing`: share of these without a value of it (a lambda that is not real), which are left out.
    """

    draws: int
    missing: float


@dataclass(frozen=True, kw_only=True)
class PosteriorMode:
    """One minimum: its place and origin, the `share` of nearest draws with its error.

    `below`: ln of the posterior at the most likely minimum less that here. A draw is nearest to a
    minimum by the linearised errors there; NaN: the draws have not converged.
    """

    parameters: Mapping[str, float]
    origin: str
    below: float
    share: float
    share_error: float


@dataclass(frozen=True, kw_only=True)
class PosteriorSummary(EndedRecord):
    """What `posterior.json` holds.

    `status`: "converged", "not converged" or "interrupted", with `message`. `steps` of `walkers`,
    of which the first `discarded` are left out; `evaluations` of the model, `failed` ones count as
    impossible; `accepted` share of proposals; `alternative`: discrete settings; `derived` outputs
    only of converged draws; `findings`: why enough draws have not converged.
    """

    values: Mapping[str, PosteriorValue]
    modes: tuple[PosteriorMode, ...]
    alternative: Mapping[str, Scalar]
    walkers: int
    steps: int
    discarded: int
    evaluations: int
    failed: int
    accepted: float
    seed: int
    notes: tuple[str, ...]
    findings: tuple[Finding, ...] = ()
    derived: Mapping[str, PosteriorOutput] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Reached:
    """How far samples are: `draws` (steps, walkers, n) in their units, `taus` and `rhats` (n,).

    Draws of a value with a period are given in that which begins at `begins` (n,), NaN of others.
    `missed` is a value that the fit accepts and no draw is near, or that nothing shows which these
    are. `message` is what is there and what is wanted, a sentence without its end.
    """

    draws: FloatArray
    begins: FloatArray
    discarded: int
    taus: FloatArray
    rhats: FloatArray
    missed: Finding | None
    message: str

    @property
    def is_enough(self) -> bool:
        """Whether there are enough draws, and the walkers agree."""
        enough = len(self.draws) >= LONG_ENOUGH * float(np.max(self.taus))
        return enough and float(np.max(self.rhats)) <= AGREE

    @property
    def converged(self) -> bool:
        """Whether there are enough draws, the walkers agree, and nothing is missed by all."""
        return self.is_enough and self.missed is None


def reached(
    target: Target,
    minima: Sequence[Minimum],
    samples: Samples,
    likely: Mapping[str, float],
    accepted: Mapping[str, Accepted] | None = None,
) -> Reached:
    """How far samples are.

    Args:
        target: The posterior.
        minima: The one of the largest mass first.
        samples: All its steps so far.
        likely: What the fit reports, by name: in the period of it a value is given.
        accepted: Values that the fit accepts, by name, which draws have to come near; None: the
            posterior is bent, and these are not known.
    """
    discarded = int(LEFT_OUT * samples.steps)
    draws = about(target, minima[0], target.in_units(samples.places[discarded:]))
    columns = [draws[..., i] for i in range(draws.shape[-1])]
    taus = np.array([autocorrelation_time(c) for c in columns])
    rhats = np.array([split_rhat(c) for c in columns])
    begins = period_begins(target, draws, likely)
    draws = in_period(target, begins, draws)
    names = [p.name for p in target.parameters]
    slow, apart = int(np.argmax(taus)), int(np.argmax(rhats))
    missed = missed_by(target, begins, draws, accepted or {})
    if accepted is None:
        missed = Finding(kind=Kind.posterior_unchecked, severity="error", subject="")
    units = {p.name: unit_text(p.unit) for p in target.parameters}
    message = phrase(
        "posterior/text",
        "reached",
        len(draws),
        (LONG_ENOUGH, AGREE),
        (names[slow], float(taus[slow])),
        (names[apart], float(rhats[apart])),
        missed,
        units,
    )
    return Reached(
        draws=draws,
        begins=begins,
        discarded=discarded,
        taus=taus,
        rhats=rhats,
        missed=missed,
        message=message,
    )


def numbers_of(draws: FloatArray) -> dict[str, Any]:
    """Median, mean, standard deviation and central intervals of draws, as `Drawn` has them.

    Args:
        draws: of one number, any shape; none of them: all is NaN.
    """
    mine = draws if draws.size else np.array([math.nan])
    median, *ends = np.quantile(mine, QUANTILES).tolist()
    return {
        "value": median,
        "mean": float(np.mean(mine)),
        "std": float(np.std(mine)),
        "ci68": tuple(ends[:2]),
        "ci95": tuple(ends[2:]),
    }


def values_of(
    target: Target,
    at: Reached,
    fit: Values,
    likely: Mapping[str, float],
    truth: Mapping[str, float],
) -> dict[str, PosteriorValue]:
    """Every parameter by name.

    Args:
        target: The posterior.
        at: Draws.
        fit: Whose intervals are compared with them.
        likely: What the fit reports, by name.
        truth: What is true, by name, where it is known.
    """
    values = {}
    for i, p in enumerate(target.parameters):
        column, begin = at.draws[..., i], float(at.begins[i])
        known = fit.parameters.get(p.name)
        values[p.name] = PosteriorValue(
            name=p.name,
            unit=p.unit,
            status=Verdict.UNKNOWN if known is None else known.status,
            **numbers_of(column if at.converged else np.empty(0)),
            tau=float(at.taus[i]),
            rhat=float(at.rhats[i]),
            effective=column.size / float(at.taus[i]),
            lower=p.lower,
            upper=p.upper,
            prior=p.reference if p.prior_sigma else math.nan,
            prior_sigma=p.prior_sigma or math.nan,
            most_likely=value_in_period(p, begin, likely.get(p.name, math.nan)),
            profile95=interval_in_period(p, begin, NOWHERE if known is None else known.ci95),
            truth=value_in_period(p, begin, truth.get(p.name, math.nan)),
            shared=not p.experiments,
        )
    return values


def modes_of(
    target: Target, minima: Sequence[Minimum], samples: Samples, at: Reached
) -> tuple[PosteriorMode, ...]:
    """The minima, the most likely first, with the share of the draws that are nearest to each.

    Args:
        target: The posterior.
        minima: Those with the largest share of the mass first, copies a period off last.
        samples: All steps.
        at: What is left of them.
    """
    places = samples.places[at.discarded :]
    flat = places.reshape(-1, places.shape[-1])
    whose = np.argmin([m.distances(flat) for m in minima], axis=0)
    first = np.array([k if m.copy_of < 0 else m.copy_of for k, m in enumerate(minima)])
    nearest = first[whose].reshape(places.shape[:-1])
    modes, highest = [], max(m.log for m in minima)
    for k, m in enumerate(minima):
        if m.copy_of >= 0:
            continue
        here = (nearest == k).astype(float)
        share, error = float(np.mean(here)), math.nan
        if 0.0 < share < 1.0:
            effective = here.size / autocorrelation_time(here)
            error = math.sqrt(share * (1.0 - share) / effective)
        centre = in_period(target, at.begins, target.in_units(m.centre)).tolist()
        modes.append(
            PosteriorMode(
                parameters=dict(zip((p.name for p in target.parameters), centre, strict=True)),
                origin=m.origin,
                below=highest - m.log,
                share=share if at.converged else math.nan,
                share_error=error if at.converged else math.nan,
            )
        )
    return tuple(sorted(modes, key=lambda mode: mode.below))


def read_outputs(
    read: Callable[[Sequence[FloatArray]], Sequence[Mapping[str, FloatArray]]],
    draws: FloatArray,
    names: Sequence[str],
) -> dict[str, FloatArray]:
    """Outputs at every draw, (k,), the mean over experiments; NaN where the model has no value.

    Args:
        read: The model: derived outputs at each of many parameters (n,), each in its own unit.
        draws: Parameters, shape (k, n), each in its own unit.
        names: Of the outputs.

    Raises:
        NoAnswer: the model does not answer any more.
    """

    def means(ps: Sequence[FloatArray]) -> list[dict[str, float]]:
        return [{name: mean(answer[name]) for name in names} for answer in read(ps)]

    def missing(p: FloatArray, failure: Exception) -> dict[str, float]:
        return dict.fromkeys(names, math.nan)

    rows: list[dict[str, float]] = []
    for begin in range(0, len(draws), BATCH):
        rows += answered_apart(means, list(draws[begin : begin + BATCH]), missing)
    return {name: np.array([row[name] for row in rows]) for name in names}


def outputs_of(
    table: Mapping[str, FloatArray],
    fit: Mapping[str, FittedEstimate],
    truth: Mapping[str, float],
) -> dict[str, PosteriorOutput]:
    """Every derived output by name.

    Args:
        table: Its values at the draws, (k,).
        fit: What the fit reports of it.
        truth: What is true, by name, where it is known.
    """
    outputs = {}
    for name, values in table.items():
        there, e = values[np.isfinite(values)], fit[name]
        outputs[name] = PosteriorOutput(
            name=e.name,
            unit=e.unit,
            status=e.status,
            **numbers_of(there),
            draws=int(there.size),
            missing=1.0 - there.size / values.size if values.size else math.nan,
            most_likely=e.most_likely,
            profile95=e.ci95 if all(map(math.isfinite, e.ci95)) else NOWHERE,
            truth=truth.get(name, math.nan),
        )
    return outputs
