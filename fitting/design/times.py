"""What next measurements take of the laboratory's time: what [design] says, else a second each."""

from __future__ import annotations

from dataclasses import replace

from fitting.design.candidates import MOST_NUMBER, Limits
from fitting.extension.records import WrittenDesign


def timed(limits: Limits, said: WrittenDesign) -> Limits:
    """The limits with the times of a table.

    Args:
        limits: of the instrument.
        said: table [design].

    Raises:
        BadInput: a time that nothing takes.
    """
    return replace(
        limits,
        time_s=limits.time_s if said.time is None else said.time,
        spectrum_s=limits.spectrum_s if said.spectrum_time is None else said.spectrum_time,
        point_s=limits.point_s if said.point_time is None else said.point_time,
        change_s=limits.change_s if said.change_time is None else said.change_time,
    )


def written_times(limits: Limits) -> dict[str, str]:
    """Keys of a table that tell the times of limits; without a time for all of them none counts.

    Args:
        limits: of the instrument.
    """
    if limits.time_s is None:
        return {}
    taken = {
        "time": limits.time_s,
        "spectrum_time": limits.spectrum_s,
        "point_time": limits.point_s,
        "change_time": limits.change_s,
    }
    return {key: f"{seconds!r} s" for key, seconds in taken.items()}


def most_of(said: WrittenDesign) -> int:
    """Measurements at most; where a time is given that counts, and their number hardly.

    Args:
        said: table [design].
    """
    return said.number or (Limits.number if said.time is None else MOST_NUMBER)
