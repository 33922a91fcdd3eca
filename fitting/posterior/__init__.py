"""Draws from the posterior of a fit: `ff.posterior`, `fmu-fit posterior`.

mixture.py      draws about all minima at once, by which walkers change from one to another
minima.py       where walkers start: minima, polished, with their widths and symmetries
chain.py        the sampler, the one import of ``emcee``, and its file
convergence.py  correlation of a chain with itself, agreement of its walkers, values without a draw
periods.py      the period in which values are given that have one
summary.py      values with intervals, derived outputs, shares of minima
api.py          what ``fitting`` offers; command.py, report.py, figure.py: what a user gets of it

Nothing below api.py knows an FMU: a posterior is a function of parameters.
"""

#: Where a chain is stored, in the folder of its results: to continue it, and for other programs.
CHAIN_FILE = "chain.npz"
FILES = ("posterior.json", "draws.csv", "report.html", "figures/1_corner.*")
#: Steps of every walker at least, and walkers, an even number.
LEAST_STEPS, LEAST_WALKERS = 200, 4
