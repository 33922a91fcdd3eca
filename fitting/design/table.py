"""The table [design] of a campaign or of a file of candidates, as it was read, and its times.

What a measurement takes of the laboratory: what [design] states, else a second each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from fitting.design.candidates import MOST_NUMBER, Limits
from fitting.extension.records import WrittenDesign

#: Keys that choose the kind of measurement, and what its limits cannot do without.
OF_KIND = ("sweeps", "traces", "noise_floor", "relative_noise")


@dataclass(frozen=True)
class DesignTable:
    """A table [design]: what it says, the file that it is in, and the keys that are written there.

    `elsewhere` are the files of keys that were taken over from another table.
    """

    path: Path
    keys: WrittenDesign
    said: frozenset[str] = frozenset()
    elsewhere: Mapping[str, Path] = field(default_factory=dict)

    def where(self, key: str) -> str:
        """The place of a key.

        Args:
            key: key of the table [design].
        """
        return f"{self.elsewhere.get(key, self.path)}: [design] {key}"

    def with_keys_of(self, other: DesignTable) -> DesignTable:
        """The table with all that the other one says; what that leaves out stays.

        Args:
            other: whose keys go before.
        """
        new = {key: getattr(other.keys, key) for key in other.said}
        for key in ("settings", "setting_sigma"):  # tables themselves, by variable
            if key in new:
                new[key] = {**getattr(self.keys, key), **new[key]}
        for asked, given_up in (("sweeps", "traces"), ("traces", "sweeps")):
            if asked in new:  # another kind of measurement
                new.setdefault(given_up, None)
        return DesignTable(
            path=self.path,
            keys=replace(self.keys, **new),
            said=self.said | other.said,
            elsewhere={**self.elsewhere, **dict.fromkeys(other.said, other.path)},
        )

    def beside(self, other: DesignTable) -> DesignTable:
        """The table, asking for sweeps or traces where the other one does, to be compared with it.

        The noise is the other's, too: it is no limit, and without it sweeps have no limits.

        Args:
            other: what holds in its place.
        """
        taken = {n: getattr(other.keys, n) for n in OF_KIND}
        return replace(self, keys=replace(self.keys, **taken))


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
