"""Parametric bootstrap: data drawn anew at the most likely point, and fitted anew.

    r_b(x) = r(x) - r(x^) - e,   e ~ N(0, V)      prior centres: x^_j + tau_j n

Row space holds every campaign alike, joint ones too. All refits go side by side, so that each round
is one large batch for the worker processes; or in parts through any executor that is handed in.

Source: B. Efron and R. Tibshirani, An Introduction to the Bootstrap (1993), sections 6.5 and 13.3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor

import numpy as np

from fitting.campaign.parameters import to_model
from fitting.fit.levenberg import Expansion, minimise
from fitting.fit.likelihood import Likelihood, LikelihoodEvaluator, Request, Sample, Spent
from fitting.fit.optimum import Optimum
from fitting.inference.budget import Stage
from fitting.inference.likelihood.knowledge import Bootstrap
from fitting.text.arrays import FloatArray
from fitting.text.estimate import Estimate, FittedEstimate

#: Refits handed to an executor at a time.
CHUNK = 25


def bootstrap(
    optimum: Optimum,
    known: Mapping[str, FittedEstimate],
    samples: int,
    seed: int,
    executor: Executor | None = None,
    progress: Callable[[Spent], None] = lambda spent: None,
) -> Bootstrap:
    """Percentile intervals of refits, for every value that has one by its verdict.

    Where they do not, a refit stays where it began, and its scatter would be a lie.

    Args:
        optimum: the most likely point and its likelihood, inflation included.
        known: values by name, for verdicts and where periods are counted from.
        samples: number of synthetic data sets.
        seed: of their noise; the same with and without an executor.
        executor: where the refits run, in parts; the response must then be picklable. Without one
            they run here, in the response's own batches.
        progress: is told before every batch what the refits took so far, without an executor.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    likelihood, expansion = optimum.likelihood, optimum.expansion
    generator = np.random.default_rng(seed)
    noise = generator.standard_normal((samples, expansion.sample.rows.size))
    noise[:, likelihood.data_rows :] *= likelihood.inverse_prior_sigma > 0.0
    if executor is None:
        refits = _refits(likelihood, expansion, noise, progress)
    else:
        parts = [noise[k : k + CHUNK] for k in range(0, samples, CHUNK)]
        pending = [executor.submit(_refits, likelihood, expansion, part) for part in parts]
        refits = [refit for future in pending for refit in future.result()]
    done = [refit for refit in refits if refit is not None]
    parameters, columns = likelihood.parameters, dict[str, FloatArray]()
    if len(done) > 1:
        # periods are counted from where the value is reported
        table = to_model(parameters, np.array([x for x, _ in done]))
        off = table - to_model(parameters, expansion.x)
        outputs = np.array([each for _, each in done])
        for i, p in enumerate(parameters):
            if p.name in known:
                columns[p.name] = known[p.name].likely + off[:, i]
        columns |= {name: outputs[:, k] for k, name in enumerate(likelihood.names) if name in known}
    values = {}
    for name, column in columns.items():
        if known[name].status.has_value and np.all(np.isfinite(column)):
            low, middle, high = np.percentile(column, [2.5, 50.0, 97.5])
            values[name] = Estimate(
                name=name,
                value=float(middle),
                unit=known[name].unit,
                std=float(np.std(column, ddof=1)),
                ci95=(float(low), float(high)),
                status=known[name].status,
                method="bootstrap",
            )
    return Bootstrap(samples=samples, failed=samples - len(done), seed=seed, values=values)


def _refits(
    likelihood: Likelihood,
    expansion: Expansion,
    noise: FloatArray,
    progress: Callable[[Spent], None] = lambda spent: None,
) -> list[tuple[FloatArray, FloatArray] | None]:
    """(x, outputs) of a refit per row of whitened noise; None where none was reached."""
    evaluator = LikelihoodEvaluator(likelihood, progress=progress)
    evaluator.begin(Stage.REFITS)
    offsets = expansion.sample.rows + noise
    here, slopes = expansion.sample, (expansion.matrix, expansion.outward)
    begins = [Expansion(Sample(here.x, here.rows - o, here.outputs), *slopes) for o in offsets]
    ends = minimise(evaluator, begins, offsets=list(offsets))
    reached = tuple(end.end.x for end in ends if end.reached)
    outputs = iter(evaluator([Request(reached, rows=False)])[0] if reached else ())
    return [(end.end.x, next(outputs).outputs) if end.reached else None for end in ends]
