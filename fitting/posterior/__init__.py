"""Draws from the posterior of a fit: `ff.posterior`, `fmu-fit posterior`.

chain.py     where walkers start, how they move, the file; the one import of ``emcee``
summary.py   whether draws are enough, values with intervals, derived outputs, shares of minima
api.py       what ``fitting`` offers; command.py, figure.py: what a user gets of it
"""

#: Where a chain is stored, in the folder of its results: to continue it, and for other programs.
CHAIN_FILE = "chain.npz"
FILES = ("posterior.json", "draws.csv", "report.html", "figures/1_corner.*")
#: Steps of every walker at least, and walkers, an even number.
LEAST_STEPS, LEAST_WALKERS = 200, 4
