"""The kinds of measurements that a campaign file may contain, and campaigns with them.

A kind is one file in this folder, or two, the second with its table. It holds the table of
campaign.toml (a `MeasurementTable`), the data as arrays in a frozen record that answers to
`Measurement`, and its figure; it is found by being here. `tones` and `sweep` have their tables in
the campaign room, where drift, noise and scale rest on them.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import fitting.measurements
from fitting.campaign import Campaign
from fitting.campaign.data import read_campaign as read_with
from fitting.campaign.kind import MeasurementTable


def kinds_in(modules: Sequence[ModuleType]) -> tuple[type[MeasurementTable], ...]:
    """Kinds whose tables are defined in modules, by the name of the table.

    Args:
        modules: imported.
    """
    result = {
        value.TABLE: value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, type)
        and issubclass(value, MeasurementTable)
        and value.__module__ == module.__name__
        and hasattr(value, "TABLE")  # not what tables of several kinds are derived from
    }
    return tuple(result[name] for name in sorted(result))


def _modules() -> list[ModuleType]:
    """All files of this folder but those that need this one."""
    folder = fitting.measurements
    names = (m.name for m in pkgutil.iter_modules(folder.__path__, f"{folder.__name__}."))
    own = tuple(f"{folder.__name__}.{name}" for name in ("kinds", "schema"))
    return [importlib.import_module(name) for name in names if name not in own]


#: Kinds beside experiments and sweep.
KINDS: tuple[type[MeasurementTable], ...] = kinds_in(_modules())


def read_campaign(path: str | Path, kinds: Sequence[type[MeasurementTable]] = ()) -> Campaign:
    """Read a campaign file and every data file that it names.

    Args:
        path: Of the file.
        kinds: Further kinds of measurements.

    Raises:
        BadInput: one line with file, row, column or key, what was found, what is required.
    """
    return read_with(path, (*KINDS, *kinds))
