"""Step an FMU in Ecos: ``ecos_run.py FMU STEP_S STEPS ROWS NAME=VALUE...``.

Prints ROWS lines "row SECONDS Q1 Q2 MESSAGE", one after every STEPS steps, and "end".
"""

from __future__ import annotations

import ast
import sys

from ecospy.EcosSimulation import EcosSimulation
from ecospy.EcosSimulationStructure import EcosSimulationStructure

path, step, steps, rows = sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
values = {name: ast.literal_eval(text) for name, text in (a.split("=") for a in sys.argv[5:])}
with EcosSimulationStructure() as structure:
    structure.add_model("oscillator", path)
    structure.add_parameter_set("start", {f"oscillator::{k}": v for k, v in values.items()})
    with EcosSimulation(structure=structure, step_size=step) as simulation:
        simulation.init(0, parameter_set="start")
        for _ in range(rows):
            time = simulation.step(steps)
            reals = [simulation.get_real(f"oscillator::{q}_hybrid").hex() for q in ("q1", "q2")]
            print("row", time.hex(), *reals, simulation.get_string("oscillator::status_message"))
        simulation.terminate()
print("end")
