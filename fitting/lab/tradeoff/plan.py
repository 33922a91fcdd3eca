"""What the plan chooses for a scene at an accuracy, measured like any other setting."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fitting.lab.names import AMPLITUDES
from fitting.lab.tradeoff.bench import Bench
from fitting.lab.tradeoff.records import SUBSTEPS, Setting
from fitting.lab.tradeoff.scenes import Scene
from fitting.simulate.drive_plan import DrivePlan
from fitting.simulate.knowledge import knowledge_of
from fitting.simulate.planner import plan_drives
from fitting.simulate.words import plan_in_words
from fitting.text.arrays import FloatArray

#: Substeps in a period where the FMU's own choice is not known.
USUAL_SUBSTEPS = 40.0


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

    @property
    def notes(self) -> list[str]:
        """The first plan in sentences."""
        if not self.kept:
            return [f"Accuracy {self.accuracy:g}: no plan; it could promise {self.promised:.1e}."]
        said = plan_in_words(self.plans[0].budget)
        return [f"Accuracy {self.accuracy:g}: {line}" for line in said]

    def amplitudes(self, bench: Bench) -> FloatArray:
        """Amplitudes at the tones of all drives by the runs that were planned.

        Args:
            bench: the laboratory: sample, drives, instrument, noise.
        """
        answers = bench.run([plan.runs[0] for plan in self.plans])
        pairs = zip(self.plans, answers, strict=True)
        return np.concatenate([plan.read(values)[:, 0] for plan, values in pairs])

    def setting(self, scene: Scene) -> Setting:
        """The choice in the words of the grid, for tables: that of the first drive.

        Args:
            scene: an FMU with start values, tones and truth.
        """
        plan, window = self.plans[0], self.plans[0].windows[0]
        values = plan.runs[0].start_values
        own = {solver.variable for solver in scene.solvers}
        common = set.intersection(*(set(solver.values) for solver in scene.solvers)) - own
        chosen = (s for s in scene.solvers if all(values[n] == s.values[n] for n in common))
        solver = next(chosen, replace(scene.solvers[0], kind="", variable=""))
        resolution = float(values[solver.variable]) if solver.variable else 0.0
        if solver.kind == SUBSTEPS:
            period = resolution * scene.fastest_hz
            resolution = 1.0 / period if period > 0.0 else USUAL_SUBSTEPS
        return Setting(
            quantity=AMPLITUDES,
            solver=solver.name,
            values=dict(plan.settings),
            resolution=resolution,
            resolution_kind=solver.kind,
            periodic=bool(scene.periodic) and bool(values.get(scene.periodic)),
            settle_s=plan.settle_s,
            window_s=window.length_s,
            samples=window.samples,
        )


def plan_scene(bench: Bench, accuracy: float) -> Planned:
    """Plan every drive of a scene for an accuracy, each by itself.

    What may be left out and what sets the accuracy is known from the campaign and the FMU itself.

    Args:
        bench: the laboratory: sample, drives, instrument, noise.
        accuracy: relative error that is wanted.

    Raises:
        BadInput, FmuFailure: as `fitting.simulate.planner.plan_drives`.
    """
    scene = bench.scene
    known = knowledge_of(bench.workers.description, scene.annotation)
    # the names that every setting of the grid sets, so that all runs share one layout
    every = scene.values_of(scene.solvers[0], scene.solvers[0].resolutions[0])
    drives = [replace(d, start_values={**d.start_values, **every}) for d in scene.drives]
    plans = [plan_drives((drive,), accuracy, bench.workers, known) for drive in drives]
    return Planned(accuracy, tuple(plans))
