"""The FMU of the campaigns that a command is given."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from fitting.cli.words.values import default_workers

if TYPE_CHECKING:
    from fitting.api.fmu import Fmu
    from fitting.api.problem import Campaign


def fmu_for(
    campaigns: Sequence[Campaign],
    out: Path,
    workers: int | None,
    *,
    isolate: bool | Literal["strict"] = False,
) -> Fmu:
    """The FMU that campaigns name; a model of this project is built into a folder of the results.

    Args:
        campaigns: that are fitted together.
        out: folder of the results.
        workers: processes, None for one per processor, up to 8.
        isolate: whether they run isolated.

    Raises:
        BadInput: they name different ones, or one that is not there.
    """
    from fitting.api.problem import fmu_of  # takes libraries along, help does not

    return fmu_of(campaigns, out / "fmu", workers or default_workers(), isolate=isolate)
