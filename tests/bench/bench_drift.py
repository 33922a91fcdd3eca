"""Cost of one offset per experiment: a Jacobian over series of up to 1,000 drive pairs.

    python tests/bench/bench_drift.py [--pairs 5 50 200 1000]

Prints simulation runs and seconds of one evaluation and of one Jacobian, with an offset for every
experiment, beside the runs that a Jacobian would take if nothing were shared.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import build_fmu
from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.campaign.measured import Experiment
from fitting.campaign.parameters import Parameter
from fitting.fit.objective import Objective, evaluate_many, stencil
from fitting.fit.problem import problem_of
from fitting.fmu.description import read_description
from fitting.fmu.pool import FmuWorkers
from tests.support.datasets import drafted, through

CAMPAIGN = Path(__file__).parents[2] / "data/string_q1/campaign.toml"
COUNTS = (5, 50, 200, 1000)


def longer(bound: BoundCampaign, count: int) -> BoundCampaign:
    """The campaign's drive pairs again and again, each with a drift offset of its own."""
    pairs: list[Experiment] = []
    offsets: list[Parameter] = []
    ends = bound.drift.ends["eta_plus"]
    for k in range(count):
        label = f"pair{k + 1}"
        state = ends[0] + (ends[1] - ends[0]) * k / max(count - 1, 1)
        old = bound.experiments[k % len(bound.experiments)]
        pairs.append(replace(old, label=label, settings={**old.settings, "eta_plus": state}))
        offsets.append(
            Parameter(
                name=f"offset[{label}]",
                unit="Hz",
                lower=-180.0,
                upper=180.0,
                start=0.0,
                reference=0.0,
                scale=30.0,
                experiment=label,
                adds_to=("eta_plus", "eta_minus"),
                prior=30.0,
            )
        )
    return replace(bound, experiments=tuple(pairs), parameters=(*bound.parameters[:3], *offsets))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--pairs", type=int, nargs="+", default=COUNTS)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_fmu.build("CoupledOscillator", Path(folder))
        bound = bind(read_campaign(CAMPAIGN), read_description(fmu).variables)
        print(
            f"{'pairs':>6} {'unknowns':>8} {'runs: point':>12} {'s':>7} {'Jacobian':>9} {'s':>7} "
            f"{'unshared':>9}"
        )
        with FmuWorkers(fmu, workers=2) as workers:
            for count in args.pairs:
                _row(longer(bound, count), workers)


def _row(bound: BoundCampaign, workers: FmuWorkers) -> None:
    response = through(workers, bound, drafted(bound), bound.alternatives[0])
    objective = Objective(
        response=response,
        parameters=bound.parameters,
        data=problem_of([bound]).data,
        steps=np.full(len(bound.parameters), 1e-3),
    )
    x = np.zeros(len(bound.parameters))
    evaluate_many(objective, [x])
    begun = time.perf_counter()
    [point] = evaluate_many(objective, [x])
    middle = time.perf_counter()
    points = evaluate_many(objective, stencil(objective, x).nodes)
    end = time.perf_counter()
    shared = sum(p.runs for p in points)
    print(
        f"{len(bound.experiments):6} {x.size:8} {point.runs:12} {middle - begun:7.2f} "
        f"{shared:9} {end - middle:7.2f} {len(points) * point.runs:9}"
    )


if __name__ == "__main__":
    main()
