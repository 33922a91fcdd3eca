"""One setting of a study, as a worker does it: a function of the item alone."""

from __future__ import annotations

import threading
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path

from fitting.extension.fmu import (
    Ended,
    FmuWorkers,
    NeededFile,
    Where,
    opened,
    place_of,
    read_description,
    run,
)
from fitting.extension.problem import one_thread
from fitting.lab.tradeoff.bench import Bench, Patience
from fitting.lab.tradeoff.records import Measurement, Reference, Setting
from fitting.lab.tradeoff.ruler import Ruler
from fitting.lab.tradeoff.scenes import Scene


@dataclass(frozen=True, kw_only=True)
class Terms:
    """What all settings of a study are measured by: scene, FMU, references, patience.

    ``interface`` is the one by which the FMU is run, ``longest_s`` the longest run of a setting, s.
    """

    scene: Scene
    fmu: NeededFile
    interface: str
    references: tuple[Reference, ...]
    patience: Patience
    longest_s: float

    @classmethod
    def of(cls, ruler: Ruler) -> Terms:
        """Those by which settings are measured here.

        Args:
            ruler: that measures them.

        Raises:
            BadInput: the FMU's file cannot be read.
        """
        fmu = ruler.bench.workers.description
        return cls(
            scene=ruler.bench.scene,
            fmu=NeededFile.of(fmu.path),
            interface=fmu.interface,
            references=ruler.references,
            patience=ruler.bench.patience,
            longest_s=ruler.longest_s,
        )


@dataclass(frozen=True)
class Item:
    """A setting, and what it is measured by."""

    setting: Setting
    terms: Terms


class _Holder(threading.local):
    """The bench that a thread of a worker has: its FMU is loaded once, however many items."""

    terms: Terms | None = None
    ruler: Ruler | None = None


_HELD = _Holder()


def measured(item: Item) -> Measurement | None:
    """The row of a setting, None for one that takes too long; its FMU runs beside the worker.

    Args:
        item: the setting, with scene, FMU and references.

    Raises:
        BadInput: the FMU is not on this machine.
    """
    with one_thread():
        return _held(item.terms).measure(item.setting)


def ended(
    terms: Terms, settings: Sequence[Setting], where: Where
) -> Generator[Ended[Setting, Measurement], None, None]:
    """Settings as they end, in whatever order; what is under way is lost when nobody asks on.

    Args:
        terms: of all of them.
        settings: are begun in their order.
        where: as `fitting.engine.place.opened` takes it.

    Raises:
        BadInput: no such scheduler, no such number of processes.
        BrokenExecutor: the executor as a whole takes no more.
    """
    items = [Item(setting, terms) for setting in settings]
    with opened(where, [terms.fmu]) as place:
        for one in run(measured, items, place):
            yield Ended(one.item.setting, one.result, one.lost)


def _held(terms: Terms) -> Ruler:
    if _HELD.ruler is None or _HELD.terms != terms:
        if _HELD.ruler is not None:
            _HELD.ruler.bench.workers.close()
        path: Path = place_of(terms.fmu)
        description = read_description(path, terms.interface)
        workers = FmuWorkers(description, timeout_s=terms.scene.fmu.timeout_s)
        bench = Bench(terms.scene, workers, terms.patience)
        _HELD.ruler = Ruler(bench, terms.references, terms.longest_s)
        _HELD.terms = terms
    return _HELD.ruler
