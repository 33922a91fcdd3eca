"""What the virtual laboratory measures: a sample that answers a drive with steady amplitudes.

A further kind of sample is a class of this protocol in a file of its own, and a campaign for it in
`fitting.lab.writer`.
"""

from __future__ import annotations

from typing import Protocol

from fitting.lab.drive import Drive
from fitting.lab.string import TwoModes
from fitting.text.arrays import ComplexArray


class Sample(Protocol):
    """Two coupled modes at some moment."""

    @property
    def modes(self) -> TwoModes:
        """Their linear part."""
        ...

    def shifted(self, shift_hz: float) -> Sample:
        """The same sample, both eigenfrequencies higher by so much.

        Args:
            shift_hz: by which both resonances move, Hz.
        """
        ...

    def amplitudes(self, drive: Drive) -> ComplexArray:
        """Complex amplitudes (lines, 2) of both modes at the lines that the drive reads.

        Args:
            drive: tones and amplitudes that drive.

        Raises:
            ValueError: no steady state.
        """
        ...
