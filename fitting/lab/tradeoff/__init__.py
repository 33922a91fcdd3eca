"""Accuracy of a campaign's simulation and fit against cost: `ff.tradeoff`, `fmu-fit tradeoff`."""

FILES = (
    "tradeoff.csv",
    "tradeoff.md",
    "tradeoff-rows.jsonl",
    "figures/1_tradeoff.*",
    "figures/tradeoff.*",
)
#: Finished rows, one a line.
ROWS_NAME = "tradeoff-rows.jsonl"
