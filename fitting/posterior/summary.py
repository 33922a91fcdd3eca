"""What draws give: whether they are enough, values with intervals, shares of minima.

    R = sqrt((B/W + N - 1)/N)        B = N var(means of half walkers), W = mean(their variances)

R is taken of normal scores of the ranks, z = Phi^-1((r - 3/8)/(S + 1/4)), and of those of the
distances from the median; the larger counts.

Walkers agree as well where all of them miss the same part of a posterior. What is known apart from
them shows it: a value v of a parameter is accepted where the fit's own profile has

    Dchi^2(v) k^2 <= 3.84        k the factor by which the fit widened the noise; draws do not

and at every other minimum that fits as well. Draws are near it where one is closer than a tenth of
the width of the profile's interval.

Source: A. Vehtari, A. Gelman, D. Simpson, B. Carpenter, P. Bürkner, Bayesian Analysis 16 (2021)
667.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np
from scipy.special import ndtri
from scipy.stats import rankdata

import fitting
from fitting.extension.problem import NOTABLE, Parameter, Values, answered_apart, mean
from fitting.extension.report import phrase, phrases
from fitting.posterior.chain import Chain, autocorrelation_times
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.estimate import ALL_ROUND, NOWHERE, ROOT_95, Estimate, Interval, Method, Verdict
from fitting.text.finding import Finding, Kind
from fitting.text.notation import unit_text
from fitting.text.records import EndedRecord

#: Steps over the longest correlation time, and R, at which there are enough draws.
LONG_ENOUGH, AGREE = 50.0, 1.01
#: Share of the profile's interval within which a draw has to be.
NEAR = 0.1
CONVERGED, NOT_CONVERGED, INTERRUPTED = "converged", "not converged", "interrupted"
#: Median, and the ends of the intervals as shares of the draws: 68 % as a Gaussian has it, 95 %.
QUANTILES = (0.5, 0.158655, 0.841345, 0.025, 0.975)


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


def split_rhat(draws: FloatArray) -> float:
    """Rank-normalised split R of one quantity: 1 where walkers agree; see the module.

    Args:
        draws: Values, shape (steps, walkers), 4 steps at least.
    """
    half = draws.shape[0] // 2
    halves = np.hstack([draws[:half], draws[-half:]])
    ratios = []
    for values in (halves, np.abs(halves - np.median(halves))):
        ranks = rankdata(values).reshape(values.shape)  # equal values share theirs
        scores = ndtri((ranks - 0.375) / (values.size + 0.25))
        between = half * float(np.var(np.mean(scores, axis=0), ddof=1))
        within = float(np.mean(np.var(scores, axis=0, ddof=1)))
        ratios.append((between / within + half - 1.0) / half if within else math.inf)
    return math.sqrt(max(ratios))


def missed_value(
    fit: Values, parameters: Sequence[Parameter], draws: FloatArray, *, is_bent: bool
) -> Finding | None:
    """The accepted ``value`` that is the farthest from its ``nearest`` draw; None: all are near.

    Args:
        fit: with its profiles, if it has any.
        parameters: that are drawn.
        draws: (steps, walkers, n) in the parameters' units.
        is_bent: whether the minima alone do not show the shape of the posterior.
    """
    worst, missed, knowledge = NEAR, None, fit.knowledge
    for p, flat in zip(parameters, draws.reshape(-1, len(parameters)).T, strict=True):
        low, high = fit.parameters[p.name].ci95 if p.name in fit.parameters else NOWHERE
        scan = fit.scans.get(p.name)
        if knowledge is None or scan is None or not 0.0 < high - low < math.inf:
            if is_bent and not p.experiments:
                return Finding(kind=Kind.posterior_unchecked, severity="error", subject="")
            continue
        accepted = np.array(scan.delta_chi2) * knowledge.inflation**2 <= ROOT_95**2
        others = [e.parameters for e in knowledge.equivalents if not e.where]
        values = [place[p.name] for place in others if p.name in place]
        for value in (*np.array(scan.values)[accepted], *values):
            off = value - flat
            if p.period is not None:
                off -= p.period * np.round(off / p.period)
            nearest = int(np.argmin(np.abs(off)))
            share = float(abs(off[nearest])) / min(high - low, p.period or math.inf)
            if share > worst:
                place = float(flat[nearest])
                numbers = {"value": place + float(off[nearest]), "nearest": place}
                worst, missed = (
                    share,
                    Finding(
                        kind=Kind.posterior_incomplete,
                        severity="error",
                        subject=p.name,
                        numbers=numbers,
                    ),
                )
    return missed


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


def summary_of(
    chain: Chain, truth: Mapping[str, float], *, interrupted: bool = False
) -> PosteriorSummary:
    """The record of the draws so far, without derived outputs.

    Args:
        chain: of the draws.
        truth: what is true, by name, where it is known.
        interrupted: whether the chain was interrupted.
    """
    target, fit, problem, draws = chain.target, chain.fit, chain.problem, chain.draws
    taus = autocorrelation_times(draws)
    rhats = np.array([split_rhat(column) for column in np.moveaxis(draws, -1, 0)])
    is_enough = bool(len(draws) >= LONG_ENOUGH * np.max(taus) and np.max(rhats) <= AGREE)
    missed = missed_value(fit, target.parameters, draws, is_bent=chain.is_bent)
    converged = is_enough and missed is None and not interrupted

    # values that the fit reports, and those that are true, in the period that is drawn
    likely = target.in_period(np.array([chain.likely[name] for name in problem.names]))
    true = target.in_period(np.array([truth.get(name, math.nan) for name in problem.names]))
    values = {}
    for i, p in enumerate(target.parameters):
        known = fit.parameters.get(p.name)
        profile = NOWHERE if known is None else known.ci95
        if p.period is not None and profile[1] - profile[0] >= p.period * ALL_ROUND:
            profile = (float(target.lower[i]), float(target.lower[i]) + p.period)
        values[p.name] = PosteriorValue(
            name=p.name,
            unit=p.unit,
            status=Verdict.UNKNOWN if known is None else known.status,
            **numbers_of(draws[..., i] if converged else np.empty(0)),
            tau=float(taus[i]),
            rhat=float(rhats[i]),
            effective=draws[..., i].size / float(taus[i]),
            lower=p.lower,
            upper=p.upper,
            prior=p.reference if p.prior_sigma else math.nan,
            prior_sigma=p.prior_sigma or math.nan,
            most_likely=float(likely[i]),
            profile95=profile,
            truth=float(true[i]),
            shared=not p.experiments,
        )

    slow, apart = problem.names[np.argmax(taus)], problem.names[np.argmax(rhats)]
    return PosteriorSummary(
        title=problem.record.title,
        synthetic=problem.record.synthetic,
        status=CONVERGED if converged else INTERRUPTED if interrupted else NOT_CONVERGED,
        message=phrase(
            "posterior/text",
            "reached",
            len(draws),
            (LONG_ENOUGH, AGREE),
            (slow, float(np.max(taus))),
            (apart, float(np.max(rhats))),
            missed,
            {p.name: unit_text(p.unit) for p in target.parameters},
        ),
        values=values,
        modes=modes_of(chain, draws, converged=converged),
        alternative=chain.alternative,
        walkers=chain.walkers,
        steps=chain.sampler.iteration,
        discarded=chain.discarded,
        evaluations=target.evaluations,
        failed=target.failed,
        accepted=float(np.mean(chain.sampler.acceptance_fraction)),
        seed=chain.seed,
        findings=(missed,) if missed is not None and is_enough else (),
        notes=phrases("posterior/text", "notes", chain, NOTABLE),
        provenance={
            "FMU": problem.fmu.description.model_name if problem.has_fmu else "none",
            "versions": f"fmu-fit {fitting.__version__}, emcee {version('emcee')}, numpy "
            f"{np.__version__}",
        },
    )


def modes_of(chain: Chain, draws: FloatArray, *, converged: bool) -> tuple[PosteriorMode, ...]:
    """The minima, the most likely first, with the share of the draws that are nearest to each.

    Args:
        chain: of the draws.
        draws: (steps, walkers, n) in the parameters' units.
        converged: whether there are enough; else shares are NaN.
    """
    minima, modes = chain.minima, []
    nearest = np.argmin([chain.target.distance(m, draws) for m in minima], axis=0)
    valleys = np.array([m.valley for m in minima])
    for k in np.unique(valleys):
        # the mean over walkers, which exchange places, step by step
        shares = np.mean(valleys[nearest] == k, axis=1)
        error = math.nan
        if np.ptp(shares):
            [tau] = autocorrelation_times(shares[:, None, None])
            error = float(np.std(shares)) * math.sqrt(tau / len(shares))
        modes.append(
            PosteriorMode(
                parameters=dict(zip(chain.problem.names, minima[k].centre.tolist(), strict=True)),
                origin=minima[k].origin,
                below=minima[0].log - minima[k].log,
                share=float(np.mean(shares)) if converged else math.nan,
                share_error=error if converged else math.nan,
            )
        )
    return tuple(modes)


def outputs_of(
    chain: Chain, draws: FloatArray, truth: Mapping[str, float]
) -> tuple[dict[str, PosteriorOutput], dict[str, FloatArray]]:
    """Derived outputs by name, and their values at every draw, (k,), NaN where there is none.

    A value is the mean over experiments.

    Args:
        chain: whose model is read.
        draws: Parameters, shape (k, n), each in its own unit.
        truth: what is true, by name, where it is known.

    Raises:
        NoAnswer: the model does not answer any more.
    """
    names, response = list(chain.fit.derived), chain.problem.objective.response
    rows = answered_apart(
        lambda ps: [[mean(a[name]) for name in names] for a in response.derived_many(ps)],
        list(draws),
        lambda p, failure: [math.nan] * len(names),
    )
    outputs, derived = dict(zip(names, np.array(rows).T, strict=True)), {}
    for name, column in outputs.items():
        finite, e = column[np.isfinite(column)], chain.fit.derived[name]
        derived[name] = PosteriorOutput(
            name=e.name,
            unit=e.unit,
            status=e.status,
            **numbers_of(finite),
            draws=int(finite.size),
            missing=1.0 - finite.size / column.size,
            most_likely=e.most_likely,
            profile95=e.ci95 if all(map(math.isfinite, e.ci95)) else NOWHERE,
            truth=truth.get(name, math.nan),
        )
    return derived, outputs
