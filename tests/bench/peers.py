"""The fit of bench_peers by another program, run by the Python of an environment that has it.

    PYTHON tests/bench/peers.py estim8|modestpy TASK.json

The task is written by `bench_peers`: an FMU, a table of the trace, start, bounds, truth, what is
known, and at most so many seconds. Printed as JSON: the version, and for each run that came to a
lower sum of squares than all before the processor time, the sum and the largest relative error.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pandas as pd

Simulate = Callable[..., Any]


class Enough(Exception):
    """The time is over."""


class Watch:
    """Stands for fmpy's `simulate_fmu`: what was asked, how well it fits, when."""

    def __init__(self, task: dict[str, Any], seen: np.ndarray) -> None:
        self._task, self._seen = task, seen
        self._simulate: Simulate = fmpy.simulate_fmu
        self._begun = time.process_time()
        self._least = np.inf
        self.spent = 0.0
        self.evaluations = 0
        self.steps: list[tuple[float, float, float]] = []

    def __call__(self, *args: Any, **named: Any) -> Any:
        result = self._simulate(*args, **named)
        self.evaluations += 1
        self.spent, asked = time.process_time() - self._begun, named["start_values"]
        values = np.asarray(result[self._task["output"]])
        same = values.shape == self._seen.shape
        square = float(np.sum((values - self._seen) ** 2)) if same else np.inf
        if square < self._least:
            self._least = square
            truth = self._task["truth"]
            error = max(abs(float(asked[name]) / true - 1.0) for name, true in truth.items())
            self.steps.append((self.spent, square, error))
        if self.spent > self._task["seconds"]:
            raise Enough
        return result


def by_estim8(task: dict[str, Any], table: pd.DataFrame, watch: Watch) -> None:
    """Differential evolution and what it is polished by: estim8's way to a global minimum."""
    from estim8 import Estimator
    from estim8.models import FmuModel

    class RealModel(FmuModel):  # type: ignore[misc]
        """Without parameters that are no Reals, whose start values it cannot read."""

        def retrieve_variables(self) -> None:
            variables = self._model_description.modelVariables
            reals = [v for v in variables if v.type == "Real"]
            self.parameters = {v.name: float(v.start) for v in reals if v.initial == "exact"}
            self.observables = [v.name for v in reals if v.initial != "exact"]

    fmpy.simulate_fmu = watch
    model = RealModel(task["fmu"], fmi_type="CoSimulation", default_parameters=task["known"])
    t = [0.0, float(table.index[-1]), task["step_s"]]
    estimator = Estimator(model=model, bounds=task["bounds"], data=table, t=t, metric="SS")
    estimator.estimate(method="de", max_iter=10_000)


def by_modestpy(task: dict[str, Any], table: pd.DataFrame, watch: Watch) -> None:
    """Its genetic algorithm, larger and more patient than by default, then its pattern search."""
    import modestpy.fmi.model
    from modestpy import Estimation

    modestpy.fmi.model.simulate_fmu = watch
    lower_upper = task["bounds"]
    with tempfile.TemporaryDirectory() as folder:
        Estimation(
            folder,
            task["fmu"],
            inp=pd.DataFrame({"b": np.zeros(len(table))}, index=table.index),
            known=task["known"],
            est={name: (task["start"][name], *lower_upper[name]) for name in task["start"]},
            ideal=table,
            methods=("GA_LEGACY", "PS"),
            ga_opts={"maxiter": 1000, "pop_size": 60, "tol": 1e-12, "look_back": 100},
            ps_opts={"maxiter": 100_000, "tol": 1e-12},
            ftype="RMSE",
        ).estimate()


PROGRAMS = {"estim8": by_estim8, "modestpy": by_modestpy}


def main() -> None:
    """Run one program."""
    name, path = sys.argv[1:]
    task = json.loads(Path(path).read_text())
    table = pd.read_csv(task["table"]).set_index("time")
    watch = Watch(task, table[task["output"]].to_numpy())
    ended = "by itself"
    try:
        PROGRAMS[name](task, table, watch)
    except Enough:
        ended = "time over"
    found = {"version": version(name), "ended": ended, "processor_s": watch.spent}
    print(json.dumps({**found, "evaluations": watch.evaluations, "steps": watch.steps}))


if __name__ == "__main__":
    main()
