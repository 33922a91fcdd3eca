"""Data from arrays to a table, a profile and a figure: neither a guard nor anything else."""

import numpy as np
from matplotlib.figure import Figure

import fitting as ff

fmu = ff.Fmu("CoupledOscillator")
drive = ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2"))
periodic = {"periodic_start": True}
setup = ff.Setup(drive, "q1_hybrid", start_values=periodic, steady_start=True)
f_hz = 6.94026e6 + np.linspace(-300.0, 300.0, 25)
line = 40e-6 / np.sqrt(1.0 + (2.0 * (f_hz - 6.94026e6) / 95.0) ** 2)
a_v = line * (1.0 + 0.01 * np.random.default_rng(1).standard_normal(f_hz.size))
wanted = [ff.Parameter(d, 100.0, bounds=(1.0, 1000.0), unit="Hz") for d in ("d1", "d2")]
wanted.append(ff.Parameter("theta", 1.9, bounds=(0.0, np.pi), unit="rad"))
sweep, noise = ff.Sweep(setup, f_hz, a_v), ff.Noise(relative=0.01)
problem = ff.Problem(fmu, wanted, [sweep], derived=["lambda", "width_plus"], noise=noise)
fit = ff.fit(problem, ff.Tikhonov(levels=4), starts=1)
found = ff.profile(fit, ["width_plus"])
ff.plot.profile(found["width_plus"], ax=(figure := Figure()).subplots())
figure.savefig("profile.png")
print(found, found["width_plus"], found["lambda"].value, found["lambda"].bounds, sep="\n")
