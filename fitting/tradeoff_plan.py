"""What the plan chooses for a scene at an accuracy, measured like any other setting."""

from __future__ import annotations

from fitting.tradeoff_bench import setting_values
from fitting.tradeoff_grid import period_s
from fitting.tradeoff_records import AMPLITUDES, COHERENT, Setting
from fitting.tradeoff_scenes import Scene


def planned_setting(scene: Scene, accuracy: float) -> Setting | None:
    """The plan's setting for the amplitudes of a scene, None where it makes no promise."""
    if scene.modes is None:
        return None
    solver = scene.solvers[0]
    resolution = 0.1 * accuracy if solver.kind == "tolerance" else 0.0
    return Setting(
        AMPLITUDES, solver.name, setting_values(scene, solver, resolution, True), resolution,
        solver.kind, True, 0.0, COHERENT, period_s(scene), 7 if scene.linear else 64,
    )  # fmt: skip
