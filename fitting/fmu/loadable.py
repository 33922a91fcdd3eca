"""What it takes to load an FMU: part of its description, and all that its workers are told."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Loadable:
    """An FMU as a process loads it.

    ``exchange``: numbers of states and event indicators where it is run by model exchange: its
    equations are then integrated here; None: co-simulation.
    """

    fmi_version: str
    guid: str
    model_identifier: str
    one_instance_per_process: bool
    exchange: tuple[int, int] | None = None
