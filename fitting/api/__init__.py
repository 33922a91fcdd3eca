"""What `import fitting` offers of the core, and what the command line calls.

problem.py      parameters and measurements as a problem     Problem
fitted.py       its fit, and what the data determine         fit, Fit, profile, Inference, Value
jobs.py         identify, report
fmu.py          an FMU to drive                              Fmu, Accuracy, simulate, sweep
line.py         one resonance without an FMU                 line, ringdown, noise_line
calibration.py  a fit for other tools                        calibrate
cost.py         what a job is expected to cost               cost, Cost
examples.py     the shipped campaigns                        example
plot.py         `fitting.report.figures`, for fits and values

Each wraps the records of the packages below and holds them as attributes; nothing is computed here.
"""
