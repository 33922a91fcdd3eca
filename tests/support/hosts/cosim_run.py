"""Step an FMU in libcosim: ``cosim_run.py FMU STEP_NS STEPS ROWS NAME=VALUE...``.

Prints ROWS lines "row NANOSECONDS Q1 Q2 MESSAGE", one after every STEPS steps, and "end STATE WHY".
"""

from __future__ import annotations

import ast
import sys

import fmpy
from libcosimpy._internal import get_last_error_message
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

path, step_ns, steps, rows = sys.argv[1], *map(int, sys.argv[2:5])
variables = fmpy.read_model_description(path).modelVariables
references = {v.name: v.valueReference for v in variables}
execution = CosimExecution.from_step_size(step_size=step_ns)
slave = execution.add_local_slave(CosimLocalSlave(fmu_path=path, instance_name="oscillator"))
for name, text in (argument.split("=") for argument in sys.argv[5:]):
    value = ast.literal_eval(text)
    kind = {bool: "boolean", int: "integer", float: "real"}[type(value)]
    getattr(execution, f"{kind}_initial_value")(slave, references[name], value)
observer = CosimObserver.create_last_value()
execution.add_observer(observer)
for _ in range(rows):
    execution.step(step_count=steps)
    reals = [references[name] for name in ("q1_hybrid", "q2_hybrid")]
    values = [x.hex() for x in observer.last_real_values(slave, reals)]
    message = observer.last_string_values(slave, [references["status_message"]])[0].decode()
    print("row", execution.status().current_time, *values, message)
print("end", execution.status().state, get_last_error_message())
