"""Table of the resonance that a sweep shows by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fitting.inference.sweep_line import SweepLine
from fitting.report.table import Cell, Column, Table, tabulate
from fitting.text.notation import percent, prefixed, with_error


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One number of a line with its error, and what the instrument gave (NaN: nothing)."""

    name: str
    value: float
    std: float
    unit: str
    instrument: float = math.nan

    @property
    def relative(self) -> str:
        """The instrument's against this one, in percent."""
        there = self.instrument
        return percent(there / self.value - 1.0, 3) if math.isfinite(there) else "–"


LINE: tuple[Column[Quantity], ...] = (
    Column("of the sweep by itself", lambda q: q.name, role="name"),
    Column("this fit", lambda q: Cell(with_error(q.value, q.std, q.unit), value=q.value)),
    Column("instrument", lambda q: q.instrument, digits=9),
    Column("difference", lambda q: q.instrument - q.value, digits=3),
    Column("relative", lambda q: q.relative),
)


def line_table(line: SweepLine) -> Table | None:
    """The resonance of the sweep by itself beside the instrument's own estimate.

    Args:
        line: that the sweep shows by itself.
    """
    if math.isnan(line.frequency_hz):
        return None
    factor, unit = prefixed(abs(line.amplitude), line.unit)
    own = {key: line.instrument.get(key, math.nan) for key in ("frequency_hz", "width_hz", "q")}
    quantities = (
        Quantity(
            name="eigenfrequency",
            value=line.frequency_hz,
            std=line.frequency_std_hz,
            unit="Hz",
            instrument=own["frequency_hz"],
        ),
        Quantity(
            name="full width",
            value=line.width_hz,
            std=line.width_std_hz,
            unit="Hz",
            instrument=own["width_hz"],
        ),
        Quantity(name="Q", value=line.q, std=line.q_std, unit="", instrument=own["q"]),
        Quantity(
            name="amplitude",
            value=line.amplitude / factor,
            std=line.amplitude_std / factor,
            unit=unit,
        ),
    )
    return tabulate(
        "Resonance fitted to the sweep alone, without the FMU",
        LINE if line.instrument else LINE[:2],  # the file's head may say nothing of it
        quantities,
        f"Background: {line.background}. Residual {100.0 * line.residual:.2g} % of the peak (rms).",
    )
