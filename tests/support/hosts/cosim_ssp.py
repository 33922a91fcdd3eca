"""Step a system of one component in libcosim: ``cosim_ssp.py SSP STEP_NS STEPS ROWS``.

Prints ROWS lines "row NANOSECONDS Q1 Q2", one after every STEPS steps, and "end STATE".
"""

from __future__ import annotations

import sys

from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver

path, step_ns, steps, rows = sys.argv[1], *map(int, sys.argv[2:])
execution = CosimExecution.from_ssp_file(path, step_ns)
name = execution.slave_infos()[0].name.decode()
slave = execution.slave_index_from_instance_name(name)
references = {v.name.decode(): v.reference for v in execution.slave_variables(slave)}
observer = CosimObserver.create_last_value()
execution.add_observer(observer)
for _ in range(rows):
    execution.step(step_count=steps)
    reals = [references[name] for name in ("q1_hybrid", "q2_hybrid")]
    values = [x.hex() for x in observer.last_real_values(slave, reals)]
    print("row", execution.status().current_time, *values)
print("end", execution.status().state)
