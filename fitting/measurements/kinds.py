"""The kinds of measurements that a campaign file can tell of, and campaigns with them.

A kind is one file in this folder, or one for each of its nouns. It holds the table of campaign.toml
(a `MeasurementTable`), the data as arrays in a frozen record that answers to `Measurement`, and its
figure; it is found by being here. `tones` and `sweep` have their tables in the campaign room, where
drift, noise and scale rest on them.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import cast

import fitting.measurements
from fitting.campaign import BoundCampaign, Campaign
from fitting.campaign.data import read_campaign as read_with
from fitting.campaign.kind import MeasurementTable
from fitting.measurements.complex.tones import ComplexTones
from fitting.measurements.measurement import Measurement, MeasurementKind
from fitting.measurements.sweep import sweep_of
from fitting.measurements.tones import Tones, peak_sigmas


def kinds_in(modules: Sequence[ModuleType]) -> tuple[type[MeasurementTable], ...]:
    """Kinds whose tables are defined in modules, by the name of the table.

    Args:
        modules: imported.
    """
    found = {
        value.TABLE: value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, type)
        and issubclass(value, MeasurementTable)
        and value.__module__ == module.__name__
    }
    return tuple(found[name] for name in sorted(found))


def _modules() -> list[ModuleType]:
    """All files of this folder, and of those in it, but those that need this one."""
    folder = fitting.measurements
    names = (m.name for m in pkgutil.walk_packages(folder.__path__, f"{folder.__name__}."))
    own = tuple(f"{folder.__name__}.{name}" for name in ("kinds", "schema"))
    return [importlib.import_module(name) for name in names if name not in own]


#: Kinds beside experiments and sweep.
KINDS: tuple[type[MeasurementTable], ...] = kinds_in(_modules())


def read_campaign(path: str | Path, kinds: Sequence[type[MeasurementTable]] = ()) -> Campaign:
    """Read a campaign file and every data file that it names.

    Args:
        path: Of the file.
        kinds: Of measurements that it may tell of, beside those of this program.

    Raises:
        BadInput: one line with file, row, column or key, what was found, what is wanted.
    """
    return read_with(path, (*KINDS, *kinds))


def measurements_of(bound: BoundCampaign, series: str = "") -> tuple[Measurement, ...]:
    """Everything that a campaign holds, as measurements: curves last.

    Args:
        bound: campaign, bound to its FMU.
        series: name of the series.
    """
    found: list[Measurement] = list(_tones(bound, series))
    if bound.sweep is not None:
        found.append(sweep_of(bound, bound.sweep, series))
    for table, further in bound.measurements.items():
        if not isinstance(further, MeasurementKind):
            raise TypeError(f"[{table}] is bound to {further!r}, wanted a MeasurementKind")
        found.append(cast(Measurement, further.within(bound.setup, series)))
    return tuple(sorted(found, key=lambda m: m.is_curve))


def _tones(bound: BoundCampaign, series: str) -> Iterator[Tones]:
    """The experiments without phases and those with, each with everything known of their noise."""
    for kind, with_phases in ((Tones, False), (ComplexTones, True)):
        mine = tuple(e for e in bound.experiments if (e.phases is not None) == with_phases)
        if mine:
            sigmas_v, origin = peak_sigmas(replace(bound, experiments=mine))
            yield kind(
                bound.setup,
                mine,
                series=series,
                sigmas_v=sigmas_v,
                noise_origin=origin,
                unit=bound.amplitude_unit,
            )
