"""The files that each job writes, which the help of a command knows before a library is loaded.

None of these names of files of another job is replaced.
"""

from __future__ import annotations

DRIVE_FILES = (
    *(f"{name}.csv" for name in ("carrier", "spectrum", "peaks", "beating", "lines")),
    *(f"{name}.{kind}" for name in ("trace", "spectrum") for kind in ("png", "svg")),
)
SWEEP_FILES = ("sweep.csv", "sweep.png", "sweep.svg")
#: Of one line of a file, and of the lines of many.
LINE_FILES = ("line.json", "line.csv", "line.png", "line.svg")
LINES_FILES = ("lines.csv", "lines.png", "lines.svg")
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
LEVELS_FILE = "checkpoint.jsonl"
CALIBRATED_FILES = ("*_calibrated.fmu", "*_calibrated.ssv", "*_calibrated.ssp", "parameters.csv")
