"""Bokeh's models as plain data: the name of each and what it has otherwise than by default.

Bokeh's own classes check every value and look up every default, which takes longer than drawing
the figure. Its script in the page has the same defaults; a test has its classes read what is
written here.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitting.text.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Model:
    """One of Bokeh's models: the name of its class, and its attributes by Bokeh's names.

    A model that stands in several places is one: the first holds it, the others refer to it.
    """

    kind: str
    attributes: dict[str, Any]


@dataclass(frozen=True)
class Id:
    """Stands for the number by which a model is found in its document, which holds it before."""

    model: Model


def model(kind: str, **attributes: Any) -> Model:
    """A model with these attributes; others are as by default.

    Args:
        kind: name of Bokeh's class.
        **attributes: numbers, words, arrays, lists, models.
    """
    return Model(kind, attributes)


def field(name: str) -> dict[str, str]:
    """What differs from point to point: a column of the data.

    Args:
        name: of the column.
    """
    return {"type": "field", "field": name}


def every(**values: Any) -> dict[str, dict[str, Any]]:
    """Attributes that could be columns, with one value for all points.

    Args:
        **values: by attribute.
    """
    return {name: {"type": "value", "value": value} for name, value in values.items()}


def by_key(entries: Mapping[Any, Any]) -> dict[str, Any]:
    """What Bokeh keeps by keys: the columns of data, say.

    Args:
        entries: values by key.
    """
    return {"type": "map", "entries": [[key, value] for key, value in entries.items()]}


def as_text(data: object) -> str:
    """Data with models in it as JSON; models are numbered from one in the order they stand in.

    Args:
        data: records, lists, models, arrays (n,).
    """
    return json.dumps(data, separators=(",", ":"), default=_Plain())


class _Plain:
    """What JSON has no word for, in plain words; models are known by their numbers."""

    def __init__(self) -> None:
        self._ids: dict[Model, str] = {}

    def __call__(self, found: object) -> Any:
        if isinstance(found, Model):
            return self._of_model(found)
        if isinstance(found, Id):
            return self._ids[found.model]
        if isinstance(found, np.ndarray):
            return _numbers(found)
        raise TypeError(f"no JSON for {type(found).__name__}")

    def _of_model(self, found: Model) -> dict[str, Any]:
        if found in self._ids:
            return {"id": self._ids[found]}
        own = self._ids[found] = f"m{len(self._ids) + 1}"
        return {"type": "object", "name": found.kind, "id": own, "attributes": found.attributes}


def _numbers(values: FloatArray) -> list[Any]:
    """Numbers as they are; JSON has no word for what is not finite, and Bokeh one of its own."""
    plain: list[Any] = values.tolist()
    if np.all(np.isfinite(values)):
        return plain
    return [v if math.isfinite(v) else {"type": "number", "value": _odd(v)} for v in plain]


def _odd(value: float) -> str:
    return "nan" if math.isnan(value) else f"{value:+}"
