"""What the plan chooses for a scene at an accuracy, measured like any other setting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fitting.lab.tradeoff.bench import SUBSTEPS, Bench, setting_values
from fitting.lab.tradeoff.records import AMPLITUDES, Setting
from fitting.lab.tradeoff.scenes import Scene, Solver
from fitting.simulate.drive import Drive
from fitting.simulate.planner import DrivePlan, knowledge_of, plan_drives
from fitting.text.arrays import FloatArray, Scalar


@dataclass(frozen=True)
class Planned:
    """The plan's choice for an accuracy: one plan per drive of the scene."""

    accuracy: float
    plans: tuple[DrivePlan, ...]

    @property
    def promised(self) -> float:
        """The largest error that the plans admit."""
        return max(plan.promised for plan in self.plans)

    @property
    def kept(self) -> bool:
        """Whether the plans promise what was wanted."""
        return all(plan.budget.kept for plan in self.plans)

    def amplitudes(self, bench: Bench) -> FloatArray:
        """Amplitudes at the tones of all drives by the runs that were planned."""
        answers = bench.run([plan.runs[0] for plan in self.plans])
        pairs = zip(self.plans, answers, strict=True)
        return np.concatenate([plan.read(values)[:, 0] for plan, values in pairs])

    def setting(self, scene: Scene) -> Setting:
        """The choice in the words of the grid, for tables: that of the first drive."""
        plan = self.plans[0]
        values = plan.runs[0].start_values
        solver = _solver_of(scene, values)
        window = plan.windows[0]
        return Setting(
            AMPLITUDES,
            solver.name,
            dict(plan.settings),
            _resolution(scene, solver, values),
            solver.kind,
            bool(scene.start) and bool(values.get(scene.start)),
            plan.settle_s,
            window_s=window.length_s,
            samples=window.samples,
        )


def plan_scene(bench: Bench, accuracy: float) -> Planned:
    """Plan every drive of a scene for an accuracy, each by itself.

    What may be left out and what sets the accuracy is known from the campaign and the FMU itself.

    Raises:
        BadInput, FmuFailure: as `fitting.simulate.planner.plan_drives`.
    """
    scene = bench.scene
    known = knowledge_of(bench.workers.description, scene.annotation)
    # the names that every setting of the grid sets, so that all runs share one layout
    every = setting_values(scene, scene.solvers[0], scene.solvers[0].resolutions[0])
    plans = []
    for driven in scene.drives:
        start = {**scene.values, **driven.values, **every}
        drive = Drive(
            start,
            driven.tones_hz,
            (driven.output or scene.output,),
            input=scene.input,
            level=scene.level,
            steps_per_period=scene.held or 100,
        )
        plans.append(plan_drives((drive,), accuracy, bench.workers, known))
    return Planned(accuracy, tuple(plans))


def _choice(scene: Scene, solver: Solver) -> dict[str, Scalar]:
    """The start values by which solvers are told apart: those that all of them have."""
    common = set.intersection(*(set(s.values) for s in scene.solvers))
    common -= {s.variable for s in scene.solvers}
    return {name: value for name, value in solver.values.items() if name in common}


def _solver_of(scene: Scene, values: Mapping[str, Scalar]) -> Solver:
    for solver in scene.solvers:
        chosen = _choice(scene, solver)
        if all(values.get(name) == value for name, value in chosen.items()):
            return solver
    return replace(scene.solvers[0], kind="", variable="")


def _resolution(scene: Scene, solver: Solver, values: Mapping[str, Scalar]) -> float:
    if not solver.variable:
        return 0.0
    value = float(values[solver.variable])
    if solver.kind != SUBSTEPS:
        return value
    return 1.0 / (value * scene.fastest_hz) if value > 0.0 else 40.0
