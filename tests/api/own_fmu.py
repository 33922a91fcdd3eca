"""An FMU of one's own and a recorded step, to values with intervals."""

import numpy as np

import fitting as ff

t_ms, _, x_nm = np.loadtxt("step.csv", delimiter=",", skiprows=1, unpack=True)
step = ff.Pulse(level=1e-3, at_s=5e-3, length_s=1.0)  # of the force, N
bounds = {"damping": (0.1, 0.01, 4.0), "stiffness": (4000.0, 2050.0, 6150.0)}  # start, bounds
values = {"displacement": 1e-9 * x_nm}
found = ff.fit_trace("Oscillator.fmu", 1e-3 * t_ms, {"force": step}, values, bounds)
print(found["damping"], found["stiffness"], sep="\n")
