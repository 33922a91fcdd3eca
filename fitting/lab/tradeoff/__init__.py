"""Accuracy against cost, measured on this machine: `ff.tradeoff`, `fmu-fit tradeoff`."""

FILES = (
    "tradeoff.csv",
    "tradeoff.md",
    "report.html",
    "tradeoff-checkpoint.json",
    "figures/1_tradeoff_*.*",
    "figures/tradeoff_*.*",
)
