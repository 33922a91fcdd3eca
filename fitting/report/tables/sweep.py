"""Table of the resonance that a sweep shows by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fitting.inference.sweep_line import SweepLine
from fitting.report.table import Cell, Column, Table, tabulate
from fitting.text.estimate import Estimate
from fitting.text.notation import percent, prefixed, with_error


@dataclass(frozen=True)
class Quantity:
    """One number of a line with its name, and what the instrument gave (NaN: nothing)."""

    name: str
    found: Estimate
    instrument: float = math.nan

    @property
    def relative(self) -> str:
        """The instrument's against this one, in percent."""
        there = self.instrument
        return percent(there / self.found.value - 1.0, 3) if math.isfinite(there) else "–"

    @property
    def cell(self) -> Cell:
        """The number with its error; an amplitude under the prefix that suits it."""
        value, std, unit = self.found.value, self.found.std, self.found.unit
        factor = 1.0
        if self.found.name == "amplitude":
            factor, unit = prefixed(abs(value), unit)
        return Cell(with_error(value / factor, std / factor, unit.removeprefix("1")), value=value)


LINE: tuple[Column[Quantity], ...] = (
    Column("of the sweep by itself", lambda q: q.name, role="name"),
    Column("this fit", lambda q: q.cell),
    Column("instrument", lambda q: q.instrument, digits=9),
    Column("difference", lambda q: q.instrument - q.found.value, digits=3),
    Column("relative", lambda q: q.relative),
)


def line_table(line: SweepLine) -> Table | None:
    """The resonance of the sweep by itself beside the instrument's own estimate.

    Args:
        line: that the sweep shows by itself.
    """
    if math.isnan(line.frequency.value):
        return None
    own = {key: line.instrument.get(key, math.nan) for key in ("frequency_hz", "width_hz", "q")}
    quantities = (
        Quantity("eigenfrequency", line.frequency, own["frequency_hz"]),
        Quantity("full width", line.width, own["width_hz"]),
        Quantity("Q", line.q, own["q"]),
        Quantity("amplitude", line.amplitude),
    )
    return tabulate(
        "Resonance fitted to the sweep alone, without the FMU",
        LINE if line.instrument else LINE[:2],  # the file's head may say nothing of it
        quantities,
        f"Background: {line.background}. Residual {100.0 * line.residual:.2g} % of the peak (rms).",
    )
