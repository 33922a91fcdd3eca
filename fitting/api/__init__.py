"""The front door: what `import fitting` offers, and what the command line is made of.

fmu.py        an FMU to drive: simulate, sweep            Fmu, Accuracy
check.py      what a doctor finds of an FMU               check, Check
problem.py    what is to be found, from what              Problem
cost.py       what that will cost                         cost, Cost
fitted.py     fit, and what the data determine            fit, Fit, profile, Inference, Value
jobs.py       identify, design, report
ahead.py      what begins while a command loads
examples.py   the shipped campaigns                       example
plot.py       `fitting.report.figures`, for fits and values

Each wraps the records of the rooms below and holds them as attributes; nothing is computed here.
"""
