"""Fit the parameters of an FMU to driven measurements.

Knows FMI and a campaign file; everything about the model comes from its modelDescription.xml.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType

__version__ = "0.2.0"

_homes: dict[str, str] = {}


def _table() -> dict[str, str]:
    """The module of each public name, as ``__init__.pyi`` lists them for type checkers.

    A line of it is "from HOME import NAME as NAME".
    """
    if not _homes:
        with open(f"{__file__}i", encoding="utf-8") as file:
            lines = [line.split() for line in file if line.startswith("from ")]
        _homes.update({words[-1]: words[1] for words in lines})
    return _homes


class _LazyPackage(ModuleType):
    """The package, whose public names are loaded when they are first used.

    `fit`, `report`, `design` and others are functions with the names of subpackages. Importing a
    subpackage binds it as an attribute of its package; a public name is not rebound by that, so
    that ``fitting.fit`` does not depend on what was imported before. ``from fitting.fit.problem
    import ...`` does not go by that attribute.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (isinstance(value, ModuleType) and name in _table()):
            super().__setattr__(name, value)

    def __getattr__(self, name: str) -> object:
        if name == "__all__":
            return sorted([*_table(), "__version__"])
        if name not in _table():
            raise AttributeError(f"module 'fitting' has no attribute '{name}'")
        module = importlib.import_module(_table()[name])
        value = getattr(module, name, None) or importlib.import_module(f"{_table()[name]}.{name}")
        globals()[name] = value
        return value

    def __dir__(self) -> list[str]:
        return self.__all__


sys.modules[__name__].__class__ = _LazyPackage
