"""Are draws those of the posterior? Ranks of the truth in laboratories drawn from the prior.

    python -m tests.bench.bench_posterior [--kind line] [--laboratories 200] [--workers 2]
        [--record ranks.jsonl]

Truths are drawn from the prior, data from the model at the truth: ranks of the truth among
independent draws of its posterior are then uniform (`tests.support.ranks`).

    line       one line of 9 points with 5 % of noise, in a box that cuts many posteriors
    exchange   a sum and a squared difference: two minima, alike but for a prior on one value

Laboratories whose draws have not converged are counted, and left out. Prints Markdown tables.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

import fitting as ff
from fitting.text.arrays import FloatArray
from tests.bench.records import Records
from tests.support import closed_posteriors as closed
from tests.support.ranks import rank_of, uniformity

#: Independent draws of each laboratory, and bins of the ranks.
DRAWS, BINS = 99, 10

Made = tuple[ff.Problem, FloatArray]


def line(seed: int) -> Made:
    """a = A/sqrt(1 + (2 (f - eta)/w)^2), uniform priors."""
    rng = np.random.default_rng((1, seed))
    box = [("eta", -2.0, 2.0), ("w", 1.0, 6.0), ("A", 0.5, 2.0)]
    truth = rng.uniform([b[1] for b in box], [b[2] for b in box])
    f = np.linspace(-4.0, 4.0, 9)

    def of(p: FloatArray) -> FloatArray:
        off = 2.0 * (f - p[:, :1]) / p[:, 1:2]
        return np.asarray(p[:, 2:] / np.sqrt(1.0 + off**2))

    parameters = [closed.parameter(n, low, high, 0.5 * (low + high)) for n, low, high in box]
    return _measured(of, parameters, truth, 0.05, rng)


def exchange(seed: int) -> Made:
    """z = 20 + (p1 + p2, (p1 - p2)^2), a Gaussian prior on p1, cut by its box, a uniform one on p2.

    20 keeps data with noise above zero, as measured peaks are; it is known, and changes nothing.
    """
    rng = np.random.default_rng((2, seed))
    truth = np.array([5.3 + 1.5 * rng.standard_normal(), rng.uniform(0.0, 10.0)])
    while not 0.0 <= truth[0] <= 10.0:
        truth[0] = 5.3 + 1.5 * rng.standard_normal()
    parameters = [
        closed.parameter("p1", 0.0, 10.0, 8.0, (5.3, 1.5)),
        closed.parameter("p2", 0.0, 10.0, 2.0),
    ]
    return _measured(lambda p: 20.0 + closed.exchanged(p), parameters, truth, 1.0, rng)


def _measured(
    of: Callable[[FloatArray], FloatArray],
    parameters: list[Any],
    truth: FloatArray,
    noise: float,
    rng: np.random.Generator,
) -> Made:
    exact = of(truth[None])[0]
    data = exact + noise * rng.standard_normal(exact.size)
    sigmas = np.full(exact.size, noise)
    return closed.problem(closed.Formula(of), parameters, data, sigmas), truth


KINDS: dict[str, Callable[[int], Made]] = {"line": line, "exchange": exchange}


def ranks(kind: str, seed: int) -> dict[str, Any]:
    """Ranks by name, the share of the minima, and what it cost; in a process of its own."""
    problem, truth = KINDS[kind](seed)
    at = ff.profile(ff.fit(problem, ff.Tikhonov(levels=4, misfit="squares"), starts=1))
    found = ff.posterior(problem, at, ff.Sampling(seed=seed))
    table = found.thinned
    chosen = table[np.linspace(0, len(table) - 1, DRAWS).astype(int)]
    return {
        "status": found.status,
        "evaluations": found.summary.evaluations,
        "minima": len(found.summary.modes),
        "ranks": {
            name: rank_of(float(true), chosen[:, i])
            for i, (name, true) in enumerate(zip(found.names, truth, strict=True))
        },
    }


def told(kind: str, answers: list[dict[str, Any]]) -> Iterator[str]:
    """The rows of one kind."""
    good = [a for a in answers if a["status"] == "converged"]
    several = sum(a["minima"] > 1 for a in good)
    cost = int(np.median([a["evaluations"] for a in good]))
    for name in good[0]["ranks"]:
        u = uniformity(name, [a["ranks"][name] for a in good], DRAWS, BINS)
        yield (
            f"| {kind} | {len(good)} of {len(answers)} | {several} | {cost:,} | {name} | "
            f"{' '.join(map(str, u.bins))} | {u.chi_square:.1f} | {u.p_value:.2f} | "
            f"{u.fraction_mean:.3f} | {u.fraction_std:.3f} |"
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kind", choices=list(KINDS), action="append")
    parser.add_argument("--laboratories", type=int, default=200, help="of each kind")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--record", type=Path, help="JSON lines, to resume from")
    args = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    records = Records(args.record)
    wanted = [(kind, seed) for kind in args.kind or KINDS for seed in range(args.laboratories)]
    with ProcessPoolExecutor(args.workers) as pool:
        pending = {pool.submit(ranks, *key): key for key in wanted if key not in records.known}
        for future in as_completed(pending):
            records.keep(pending[future], future.result())
    print(
        "| kind | converged | several minima | evaluations | value | ranks | χ² | P | mean | std |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for kind in args.kind or KINDS:
        for row in told(kind, [records.known[key] for key in wanted if key[0] == kind]):
            print(row, flush=True)


if __name__ == "__main__":
    main()
