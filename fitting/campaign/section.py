"""One table of a campaign file, read key by key with complaints that name file and key."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from fitting.text.errors import BadInput
from fitting.text.tables import did_you_mean
from fitting.text.written import Written, as_written, in_unit


class Section:
    """A TOML table with the keys it may have; an unknown key is refused when it is opened."""

    def __init__(
        self, path: Path, name: str, data: Any, allowed: Collection[str] | None = None
    ) -> None:
        self.path = path
        self.name = name
        if not isinstance(data, Mapping):
            raise BadInput(f"{self.where()}: found {data!r}, wanted a table")
        self.data: Mapping[str, Any] = data
        for key in data if allowed is not None else ():
            if key not in (allowed or ()):
                hint = did_you_mean(key, sorted(allowed or ()))
                raise BadInput(f"{self.where()}: unknown key '{key}'{hint}")

    def where(self, key: str = "") -> str:
        """``file: [section] key``, the opening of a complaint."""
        parts = [f"[{self.name}]" if self.name else "", key]
        return f"{self.path}: " + (" ".join(p for p in parts if p) or "top level")

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def sub(self, key: str, allowed: Collection[str] | None = None) -> Section:
        """The table under ``key``; empty if it is not there."""
        name = f"{self.name}.{key}" if self.name else key
        return Section(self.path, name, self.data.get(key, {}), allowed)

    def required(self, key: str) -> Any:
        """The raw value under a key that must be there."""
        if key not in self.data:
            hint = did_you_mean(key, sorted(self.data), listed=False)
            raise BadInput(f"{self.where()}: key '{key}' is missing{hint}")
        return self.data[key]

    def text(self, key: str, default: str | None = None) -> str:
        """A non-empty string; without ``default`` the key is required."""
        value = self.required(key) if default is None else self.data.get(key, default)
        if not isinstance(value, str) or not (value.strip() or value == default):
            raise BadInput(f"{self.where(key)}: found {value!r}, wanted a text")
        return value

    def choice(self, key: str, allowed: Collection[str], default: str | None = None) -> str:
        """One of a few words."""
        value = self.text(key, default)
        if value not in allowed:
            wanted = ", ".join(f'"{a}"' for a in allowed)
            raise BadInput(f"{self.where(key)}: found '{value}', wanted one of {wanted}")
        return value

    def boolean(self, key: str, default: bool) -> bool:
        """True or false."""
        value = self.data.get(key, default)
        if not isinstance(value, bool):
            raise BadInput(f"{self.where(key)}: found {value!r}, wanted true or false")
        return value

    def number(self, key: str, default: float | None = None, *, positive: bool = False) -> float:
        """A finite number without a unit, optionally above zero."""
        value = self.required(key) if default is None else self.data.get(key, default)
        good = isinstance(value, int | float) and not isinstance(value, bool)
        if not good or not math.isfinite(value) or (positive and value <= 0):
            wanted = "a positive number" if positive else "a finite number"
            raise BadInput(f"{self.where(key)}: found {value!r}, wanted {wanted}")
        return float(value)

    def integer(self, key: str, default: int, *, least: int = 0) -> int:
        """A whole number not below ``least``."""
        value = self.data.get(key, default)
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise BadInput(
                f"{self.where(key)}: found {value!r}, wanted a whole number of at least {least}"
            )
        return value

    def texts(self, key: str, default: tuple[str, ...] | None = None) -> tuple[str, ...]:
        """A list of different non-empty strings."""
        value = self.required(key) if default is None else self.data.get(key, list(default))
        if not isinstance(value, list) or not all(isinstance(v, str) and v for v in value):
            raise BadInput(f"{self.where(key)}: found {value!r}, wanted a list of texts")
        if len(set(value)) < len(value):
            raise BadInput(f"{self.where(key)}: {value!r} names something twice")
        return tuple(value)

    def written(self, key: str) -> Written:
        """The value under ``key`` as written: a finite number, a Boolean or text."""
        return as_written(self.required(key), self.where(key))

    def quantity(self, key: str, unit: str, *, positive: bool = False) -> float:
        """A quantity with its unit, as "100 Hz", converted to ``unit``."""
        written = self.written(key)
        if not isinstance(written.value, str):
            raise BadInput(
                f"{written.where}: {written.value!r} has no unit, wanted a text as in "
                f'"{written.value} {unit}"'
            )
        value = in_unit(written, unit)
        if positive and value <= 0.0:
            raise BadInput(f"{written.where}: found '{written.value}', wanted more than zero")
        return value
