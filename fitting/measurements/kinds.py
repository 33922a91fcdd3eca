"""The kinds of measurements that a campaign file may contain, and campaigns with them.

A kind is one file in this folder. It holds the table of campaign.toml (a `MeasurementTable`), the
data as arrays in a frozen record that answers to `Measurement`, and its figure; it is named here.
`tones` and `sweep` have their tables in the campaign room, where drift, noise and scale rest on
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fitting.campaign import Campaign
from fitting.campaign.data import read_campaign as read_with
from fitting.campaign.kind import MeasurementTable
from fitting.measurements.complex_sweep import ComplexControlSweepTable, ComplexSweepTable
from fitting.measurements.control_sweep import ControlSweepTable
from fitting.measurements.noise import NoiseSpectrumTable
from fitting.measurements.traces import DemodulatedTable, TraceTable

#: Kinds beside experiments and sweep, by the names of their tables.
KINDS: tuple[type[MeasurementTable], ...] = (
    ComplexControlSweepTable,
    ComplexSweepTable,
    ControlSweepTable,
    DemodulatedTable,
    NoiseSpectrumTable,
    TraceTable,
)


def read_campaign(path: str | Path, kinds: Sequence[type[MeasurementTable]] = ()) -> Campaign:
    """Read a campaign file and every data file that it names.

    Args:
        path: Of the file.
        kinds: Further kinds of measurements.

    Raises:
        BadInput: one line with file, row, column or key, what was found, what is required.
    """
    return read_with(path, (*KINDS, *kinds))
