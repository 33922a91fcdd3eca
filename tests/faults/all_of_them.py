"""All kinds of faults, and the table that they make: kind x tried x survived."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from tests.faults import (
    archives,
    calls,
    campaign_keys,
    curves,
    obstacles,
    options,
    refusals,
    surroundings,
    tables,
)
from tests.faults.case import Case


@dataclass(frozen=True)
class Kind:
    """A generator of cases, and how many there are in the whole table and in the short one."""

    name: str
    make: Callable[[int, int], Iterator[Case]]
    whole: int
    short: int
    in_process: bool = True

    def __str__(self) -> str:
        return self.name

    def all_cases(self) -> list[Case]:
        """Those of the whole table."""
        return list(self.make(self.whole, SEED))

    def sample(self) -> list[Case]:
        """Those that the tests try: every second one of the short table."""
        return list(self.make(self.short, SEED))[::2]


SEED = 1
KINDS = (
    Kind(campaign_keys.KEYS, campaign_keys.cases, 900, 36),
    Kind(campaign_keys.TEXT, campaign_keys.text_cases, 70, 22),
    Kind(tables.DATA, tables.cases, 260, 24),
    Kind(tables.INSTRUMENTS, tables.instrument_cases, 120, 22),
    Kind(curves.CURVES, curves.cases, 300, 24),
    Kind(archives.ARCHIVE, archives.archive_cases, 100, 24),
    Kind(archives.DESCRIPTION, archives.description_cases, 140, 22),
    Kind(options.OPTIONS, options.cases, 260, 26),
    Kind(options.WORDS, options.word_cases, 80, 24),
    Kind(refusals.MOUNTS, refusals.mount_cases, 44, 8),
    Kind(refusals.DISKS, refusals.disk_cases, 156, 8),
    Kind(refusals.ENDINGS, refusals.ending_cases, 320, 12),
    Kind(obstacles.OBSTACLES, obstacles.cases, 186, 40),
    Kind(obstacles.RECORDS, obstacles.record_cases, 40, 40),
    Kind(calls.ARGUMENTS, calls.cases, 1500, 90),
    Kind(calls.SIZES, calls.size_cases, 200, 12),
    Kind(surroundings.FILES, surroundings.file_cases, 80, 24),
    Kind(surroundings.MACHINE, lambda count, seed: surroundings.machine_cases(), 0, 0, False),
)


def whole_table() -> list[Case]:
    """Every case."""
    return [case for kind in KINDS for case in kind.all_cases()]


@dataclass
class Count:
    """Cases of one kind."""

    tried: int = 0
    survived: int = 0


def markdown(counts: dict[str, Count]) -> str:
    """The table."""
    rows = [f"| {kind} | {c.tried} | {c.survived} |" for kind, c in counts.items()]
    tried, survived = (
        sum(getattr(c, name) for c in counts.values()) for name in ("tried", "survived")
    )
    head = ["| kind of fault | tried | survived |", "|---|---|---|"]
    return "\n".join([*head, *rows, f"| all | {tried} | {survived} |"])
