"""The table [[complex_sweep]] of a campaign, and the curves that its files hold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from fitting.campaign.complex_trace import read_complex
from fitting.campaign.file import check_layout_keys
from fitting.campaign.instruments import LAYOUTS
from fitting.measurements.complex.curve import ComplexCurve
from fitting.measurements.complex.keys import ComplexKeys
from fitting.measurements.complex.sweep import ComplexSweep
from fitting.measurements.record_table import StatedTable
from fitting.text.keys import Count, FileName, OneOf, Text, Usually, WholeNumber


@dataclass(frozen=True, kw_only=True)
class ComplexSweepTable(StatedTable, ComplexKeys):
    """A complex frequency response: lock-in amplifier or network analyser, over drive frequency.

    Several of these tables are fitted together.
    """

    TABLE: ClassVar[str] = "complex_sweep"
    TOGETHER = ComplexSweep

    file: FileName
    """Frequency with X and Y, real and imaginary part, amplitude and phase, or dB and phase, each
    column with its unit."""
    layout: Annotated[Text | None, OneOf(LAYOUTS)] = None
    """How the instrument writes; without it the file's content tells."""
    trace: Annotated[Count | None, Usually(1)] = None
    """(rohde-schwarz, keysight) which trace or block of the file, from 1."""
    chunk: WholeNumber | None = None
    """(zurich only) which sweep of the file; without it the only one there is."""
    header_row: Count | None = None
    """(csv only) row of the names of columns, from 1; without it the one above the numbers."""

    def __post_init__(self) -> None:
        self.check()
        check_layout_keys(self)

    def record(self, label: str) -> ComplexCurve:
        """The sweep of the file.

        Args:
            label: of the sweep.
        """
        measured = read_complex(
            self.file,
            self.layout,
            self.columns,
            trace=self.trace or 1,
            chunk=self.chunk,
            header_row=self.header_row,
        )
        return self.curve_of(measured, label)
