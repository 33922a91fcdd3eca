"""Which files each job writes: nobody else's of these names is replaced.

Literal names, which the help of a command knows before any library is loaded.
"""

from __future__ import annotations

DRIVE_FILES = (
    *(f"{name}.csv" for name in ("carrier", "spectrum", "peaks", "beating", "lines")),
    *(f"{name}.{kind}" for name in ("trace", "spectrum") for kind in ("png", "svg")),
)
SWEEP_FILES = ("sweep.csv", "sweep.png", "sweep.svg")
#: What a report of a fit consists of.
RESULT_FILES = (
    "result.json",
    "history.csv",
    "values.csv",
    "values.tex",
    "report.html",
    "figures/[0-9]*_*.*",
)
#: Where the finished levels of a search are kept, in the folder of its results.
LEVELS_FILE = "checkpoint.json"
DESIGN_FILES = (
    "design.json",
    "design.csv",
    "report.html",
    *(f"campaign/{name}" for name in ("campaign.toml", "experiments.csv", "sweep.*", "sweeps.csv")),
    "campaign/next[0-9]*.csv",
    "figures/[0-9]*_*.*",
)
WAYS_FILES = ("ways.json",)
CHECK_FILES = ("report.html", "figures/[0-9]*_*.*")
CALIBRATED_FILES = ("*_calibrated.fmu", "*_calibrated.ssv", "*_calibrated.ssp", "parameters.csv")
STUDY_FILES = (
    "tradeoff.csv",
    "tradeoff.md",
    "report.html",
    "tradeoff-checkpoint.json",
    "figures/1_tradeoff_*.*",
    "figures/tradeoff_*.*",
)
#: Where finished items of an ensemble are kept, in the folder of its results.
ITEMS_FILE = "items.jsonl"
ENSEMBLE_FILES = (
    "ensemble.json",
    "ensemble.csv",
    "ensemble.md",
    "report.html",
    "figures/1_ensemble.*",
)
#: Where a chain is kept, in the folder of its results: to go on from, and for other programs.
CHAIN_FILE = "chain.npz"
POSTERIOR_FILES = (
    "posterior.json",
    "draws.csv",
    "report.html",
    "figures/1_corner.*",
)
