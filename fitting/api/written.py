"""Which files a drive and a sweep are written to: nobody else's of these names is replaced."""

from __future__ import annotations

DRIVE_FILES = (
    *(f"{name}.csv" for name in ("carrier", "spectrum", "peaks", "beating", "lines")),
    *(f"{name}.{kind}" for name in ("trace", "spectrum") for kind in ("png", "svg")),
)
SWEEP_FILES = ("sweep.csv", "sweep.png", "sweep.svg")
