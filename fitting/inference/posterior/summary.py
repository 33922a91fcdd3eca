"""What draws say: values with intervals, shares of minima, whether there are enough of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fitting.inference.likelihood.knowledge import Values
from fitting.inference.posterior.chain import Walk
from fitting.inference.posterior.diagnostics import autocorrelation_time, split_rhat
from fitting.inference.posterior.minima import Target, about
from fitting.inference.posterior.reach import Accepted, Missed, missed_by
from fitting.inference.posterior.start import Minimum
from fitting.inference.posterior.turns import begins_of, told, told_interval, told_value
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.estimate import NOWHERE, Estimate, Interval, Method, Verdict
from fitting.text.finding import Finding, Kind
from fitting.text.notation import number
from fitting.text.records import EndedRecord

#: Steps over the longest correlation time, and R, at which there are enough draws.
LONG_ENOUGH, AGREE = 50.0, 1.01
#: Share of a chain that is left out at its beginning.
LEFT_OUT = 0.2
CONVERGED, NOT_CONVERGED, INTERRUPTED = "converged", "not converged", "interrupted"
UNCHECKED = "the posterior is bent, and the fit has no profiles that show what the draws miss"
#: Ends of the intervals as shares of the draws: half of what a Gaussian has beyond one sigma.
ENDS68, ENDS95 = (0.158655, 0.841345), (0.025, 0.975)

NONE = NOWHERE


@dataclass(frozen=True, kw_only=True)
class Drawn(Estimate):
    """What draws say of one number, beside what is said of it elsewhere.

    `value` is the median; it, `mean`, `std` and the central intervals are those of the draws, NaN
    where these have not converged; `ci95` leaves 2.5 % of them on either side. `status` is that of
    the fit, `profile95` its interval, `most_likely` its value, `truth` what is true, NaN where
    nobody knows it.
    """

    method: Method = "posterior"
    mean: float
    most_likely: float
    profile95: Interval
    truth: float


@dataclass(frozen=True, kw_only=True)
class PosteriorValue(Drawn):
    """One parameter: `Drawn`, and how it was drawn.

    `tau` is the integrated autocorrelation time in steps, `rhat` the rank-normalised split R,
    `effective` so many independent draws are worth as much as these. `lower` and `upper` are the
    box, `prior` and `prior_sigma` the Gaussian prior (NaN: uniform in the box). A value with a
    period may be told outside of its box: draws, minima, truth and what the fit says in the same
    period, which holds the value that the fit reports.
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
    """One derived output: `Drawn`, read from the model at `draws` nearly independent draws.

    `missing` is the share of these draws at which the model has no value of it (a lambda that is
    not real); the numbers are of the others.
    """

    draws: int
    missing: float


def numbers_of(draws: FloatArray) -> dict[str, Any]:
    """Median, mean, standard deviation and central intervals of draws, as `Drawn` has them.

    Args:
        draws: of one number, any shape; none of them: all is NaN.
    """
    mine = draws if draws.size else np.array([math.nan])
    ends = np.quantile(mine, [0.5, *ENDS68, *ENDS95]).tolist()
    return {
        "value": ends[0],
        "mean": float(np.mean(mine)),
        "std": float(np.std(mine)),
        "ci68": (ends[1], ends[2]),
        "ci95": (ends[3], ends[4]),
    }


@dataclass(frozen=True, kw_only=True)
class PosteriorMode:
    """One minimum: where it is, who knew of it, the share of draws nearest to it, its error.

    `below` is by how much ln of the posterior is less there than at the most likely minimum: 0 of
    that one. A broad minimum may have more draws than one that is more likely but narrow. The share
    is NaN where the draws have not converged. Draws are nearest to a minimum by the linearised
    errors there.
    """

    parameters: Mapping[str, float]
    origin: str
    below: float
    share: float
    share_error: float


@dataclass(frozen=True, kw_only=True)
class PosteriorSummary(EndedRecord):
    """What `posterior.json` holds.

    `status` is "converged", "not converged" or "interrupted", `message` says why. `steps` of
    `walkers` were taken, `discarded` of them at the beginning are left out. `evaluations` of the
    model were asked for, `failed` of them had no value, which counts as impossible; `accepted` is
    the share of proposals that were taken. `alternative` are the discrete settings. `derived` are
    outputs of the model, none where the draws have not converged; reading them is not counted.
    `findings` are what keeps draws that are enough by themselves from having converged.
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
    """How far a walk is: `draws` (steps, walkers, n) in their units, `taus` and `rhats` (n,).

    Draws of a value with a period are told in that which begins at `begins` (n,), NaN of others.
    `missed` is a value that the fit accepts and no draw is near; `unchecked` where a bent posterior
    has no profiles to be compared with, so that nothing shows what the draws miss.
    """

    draws: FloatArray
    begins: FloatArray
    discarded: int
    taus: FloatArray
    rhats: FloatArray
    missed: Missed | None = None
    unchecked: bool = False

    @property
    def converged(self) -> bool:
        """Whether there are enough draws, the walkers agree, and nothing is missed by all."""
        return self.is_enough and self.missed is None and not self.unchecked

    @property
    def is_enough(self) -> bool:
        """Whether there are enough draws, and the walkers agree."""
        enough = len(self.draws) >= LONG_ENOUGH * float(np.max(self.taus))
        return enough and float(np.max(self.rhats)) <= AGREE

    def told(self, names: Sequence[str]) -> str:
        """What is there and what is wanted, a sentence without its end.

        Args:
            names: of the parameters.
        """
        slow, apart = int(np.argmax(self.taus)), int(np.argmax(self.rhats))
        times = len(self.draws) / float(self.taus[slow])
        missed = f"; {self.missed.words}" if self.missed is not None else ""
        if self.unchecked:
            missed = f"; {UNCHECKED}"
        return (
            f"{len(self.draws)} steps are {number(times, 3)} correlation times of {names[slow]} "
            f"(wanted {LONG_ENOUGH:g}), R = {self.rhats[apart]:.3f} of {names[apart]} "
            f"(wanted {AGREE:g} at most){missed}"
        )

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What keeps the draws from having converged beside their number."""
        if self.missed is not None:
            numbers = {"value": self.missed.value, "nearest": self.missed.nearest}
            kind, subject = Kind.posterior_incomplete, self.missed.name
            return (Finding(kind=kind, severity="error", subject=subject, numbers=numbers),)
        if self.unchecked:
            return (Finding(kind=Kind.posterior_unchecked, severity="error", subject=""),)
        return ()


def reached(
    target: Target,
    minima: Sequence[Minimum],
    walk: Walk,
    likely: Mapping[str, float],
    accepted: Mapping[str, Accepted] | None = None,
) -> Reached:
    """How far a walk is.

    Args:
        target: The posterior.
        minima: The one of the largest mass first.
        walk: All its steps so far.
        likely: What the fit reports, by name: in the period of it a value is told.
        accepted: Values that the fit accepts, by name, which draws have to come near; None: the
            posterior is bent, and nobody knows them.
    """
    discarded = int(LEFT_OUT * walk.steps)
    draws = about(target, minima[0], target.in_units(walk.places[discarded:]))
    columns = [draws[..., i] for i in range(draws.shape[-1])]
    begins = begins_of(target, draws, likely)
    draws = told(target, begins, draws)
    return Reached(
        draws=draws,
        begins=begins,
        discarded=discarded,
        taus=np.array([autocorrelation_time(c) for c in columns]),
        rhats=np.array([split_rhat(c) for c in columns]),
        missed=missed_by(target, begins, draws, accepted or {}),
        unchecked=accepted is None,
    )


def values_of(
    target: Target, found: Reached, fit: Values, beside: Mapping[str, Mapping[str, float]]
) -> dict[str, PosteriorValue]:
    """Every parameter by name.

    Args:
        target: The posterior.
        found: Draws.
        fit: Whose intervals are compared with them.
        beside: ``most_likely`` and ``truth`` by name of the parameter.
    """
    made = {}
    for i, p in enumerate(target.parameters):
        column, begin = found.draws[..., i], float(found.begins[i])
        known = fit.parameters.get(p.name)
        made[p.name] = PosteriorValue(
            name=p.name,
            unit=p.unit,
            status=Verdict.UNKNOWN if known is None else known.status,
            **numbers_of(column if found.converged else np.empty(0)),
            tau=float(found.taus[i]),
            rhat=float(found.rhats[i]),
            effective=column.size / float(found.taus[i]),
            lower=p.lower,
            upper=p.upper,
            prior=p.reference if p.prior_sigma else math.nan,
            prior_sigma=p.prior_sigma or math.nan,
            most_likely=told_value(p, begin, beside["most_likely"].get(p.name, math.nan)),
            profile95=told_interval(p, begin, NONE if known is None else known.ci95),
            truth=told_value(p, begin, beside["truth"].get(p.name, math.nan)),
            shared=not p.experiments,
        )
    return made


def modes_of(
    target: Target, minima: Sequence[Minimum], walk: Walk, found: Reached
) -> tuple[PosteriorMode, ...]:
    """The minima, the most likely first, with the share of the draws that are nearest to each.

    Args:
        target: The posterior.
        minima: Those with the largest share of the mass first, copies a period off last.
        walk: All steps.
        found: What is left of them.
    """
    places = walk.places[found.discarded :]
    flat = places.reshape(-1, places.shape[-1])
    whose = np.argmin([m.distances(flat) for m in minima], axis=0)
    first = np.array([k if m.copy_of < 0 else m.copy_of for k, m in enumerate(minima)])
    nearest = first[whose].reshape(places.shape[:-1])
    made, highest = [], max(m.log for m in minima)
    for k, m in enumerate(minima):
        if m.copy_of >= 0:
            continue
        here = (nearest == k).astype(float)
        share, error = float(np.mean(here)), math.nan
        if 0.0 < share < 1.0:
            effective = here.size / autocorrelation_time(here)
            error = math.sqrt(share * (1.0 - share) / effective)
        centre = told(target, found.begins, target.in_units(m.centre)).tolist()
        made.append(
            PosteriorMode(
                parameters=dict(zip((p.name for p in target.parameters), centre, strict=True)),
                origin=m.origin,
                below=highest - m.log,
                share=share if found.converged else math.nan,
                share_error=error if found.converged else math.nan,
            )
        )
    return tuple(sorted(made, key=lambda mode: mode.below))
