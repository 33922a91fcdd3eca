"""Which measurement next, to know a value better: `ff.design`, `fmu-fit design`."""

FILES = (
    "design.json",
    "design.csv",
    "report.html",
    *(f"campaign/{name}" for name in ("campaign.toml", "experiments.csv", "sweep.*", "sweeps.csv")),
    "campaign/next[0-9]*.csv",
    "figures/[0-9]*_*.*",
)
