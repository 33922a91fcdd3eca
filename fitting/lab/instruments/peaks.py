"""What instruments that hand over ready peaks have in common: columns, and how they are read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fitting.lab.bench import Answer, Cell


def peak_columns(reading: Answer, peaks: Sequence[str], sigmas: Sequence[str]) -> dict[str, Cell]:
    """Cells by header, of peaks and then of their standard deviations, in microvolts.

    Args:
        reading: what the instrument read.
        peaks: column heads of the peaks.
        sigmas: column heads of the standard deviations.
    """
    pairs = [
        *zip(peaks, reading.arrays["peaks_v"], strict=True),
        *zip(sigmas, reading.arrays["sigmas_v"], strict=True),
    ]
    return {f"{name} (uV)": float(value) * 1e6 for name, value in pairs}


def peak_table(file: str, peaks: Sequence[str], sigmas: Sequence[str]) -> dict[str, Any]:
    """The table [experiments] of a campaign with these columns.

    Args:
        file: name of the file.
        peaks: column heads of the peaks.
        sigmas: column heads of the standard deviations.
    """
    return {
        "file": file,
        "peaks": list(peaks),
        "peak_sigmas": list(sigmas),
        "amplitude": "V peak",
    }
