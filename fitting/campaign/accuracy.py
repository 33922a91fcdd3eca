"""The [accuracy] table of a campaign: how accurate amplitudes must be, and what may be left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fitting.campaign.section import Section, Written
from fitting.text.errors import BadInput
from fitting.text.units import checked_accuracy

KEYS = ("amplitude", "tolerance", "substep", "full", "force", "forbid", "reductions")
REDUCTION_KEYS = ("name", "set", "bound")


@dataclass(frozen=True)
class ReductionChoice:
    """A reduction as written: start values that make the FMU cheaper, the output that bounds it."""

    name: str
    set: Mapping[str, Written]
    bound: str | None
    where: str


@dataclass(frozen=True)
class AccuracyChoice:
    """The table as written; `fitting.simulate.budget.Hints` tells what it means."""

    amplitude: float = 1e-6
    tolerance: str | None = None
    substep: str | None = None
    full: Mapping[str, Written] = field(default_factory=dict)
    reductions: tuple[ReductionChoice, ...] = ()
    force: tuple[str, ...] = ()
    forbid: tuple[str, ...] = ()
    where: str = "[accuracy]"


def read_accuracy(top: Section) -> AccuracyChoice:
    """The table [accuracy], checked but for names of the FMU.

    Raises:
        BadInput: a key of the wrong kind, an accuracy that is none, names that do not exist.
    """
    section = top.sub("accuracy", KEYS)
    amplitude = section.number("amplitude", 1e-6, positive=True)
    entries = section.data.get("reductions", [])
    if not isinstance(entries, list):
        raise BadInput(
            f"{section.where('reductions')}: wanted [[accuracy.reductions]] tables, found "
            f"{entries!r}"
        )
    full = section.sub("full")
    return AccuracyChoice(
        amplitude=checked_accuracy(amplitude, section.where("amplitude")),
        tolerance=section.text("tolerance") if "tolerance" in section else None,
        substep=section.text("substep") if "substep" in section else None,
        full={name: full.written(name) for name in full.data},
        reductions=tuple(_reduction(top, k, entry) for k, entry in enumerate(entries, start=1)),
        force=section.texts("force", ()),
        forbid=section.texts("forbid", ()),
        where=section.where(),
    )


def _reduction(top: Section, index: int, entry: object) -> ReductionChoice:
    name = entry.get("name", index) if isinstance(entry, Mapping) else index
    section = Section(top.path, f"accuracy.reductions '{name}'", entry, REDUCTION_KEYS)
    settings = section.sub("set")
    if not settings.data:
        raise BadInput(f"{section.where('set')}: is empty, wanted start values of the FMU")
    return ReductionChoice(
        section.text("name"),
        {key: settings.written(key) for key in settings.data},
        section.text("bound") if "bound" in section else None,
        section.where(),
    )
