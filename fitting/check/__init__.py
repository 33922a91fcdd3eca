"""A check of an FMU: `ff.check`, `fmu-fit check`."""

FILES = ("report.html", "figures/[0-9]*_*.*")
