"""Words that people choose from, in campaigns, on the command line and in Python.

They stand by themselves, so that the help of a command knows them before any library is loaded.
"""

from __future__ import annotations

#: Forms of the misfit, see `fitting.fit.objective`.
MISFITS = ("slack", "absolute", "squares")
#: Whose estimate is reported: the likelihood's, or where Algorithm 2 ends.
LIKELIHOOD, ALGORITHM2 = ESTIMATORS = ("likelihood", "algorithm2")
#: What further measurements are to make small: the error of the target, or of all parameters.
CRITERIA = ("target", "D", "A")
#: Whether figures for print are written, too, and whether those of the page are interactive.
PAPER, INTERACTIVE = "paper", "interactive"
STYLES = ("report", PAPER, INTERACTIVE)
#: Of figures in files; a page has SVG.
FORMATS = ("svg", "png", "pdf")
#: By which an FMU can be run, in the words of FMI; the first of them where it offers both.
INTERFACES = ("co-simulation", "model-exchange")
#: Where no limit is stated: a count beyond that would take years, or all memory.
MOST, MOST_SEED = 10**6, 2**63 - 1
#: More processes than that are a slip of the pen on the machines of today.
MOST_WORKERS = 256
#: Simulation runs of an inference at most; runs that points of a batch share count once.
BUDGET = 500_000
#: Evaluations that a budget lasts for at least, where each takes many runs.
EVALUATIONS = 3_000


def usual_budget(runs_each: float) -> int:
    """Simulation runs that an inference may take, at most about, where none is given.

    Args:
        runs_each: of an evaluation.
    """
    return max(BUDGET, round(EVALUATIONS * runs_each))
