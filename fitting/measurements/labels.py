"""Labels that tables of one kind are told apart by, where a campaign has several of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from fitting.text.errors import BadInput


class Labelled(Protocol):
    """A repeated table of a campaign."""

    @property
    def file(self) -> Path:
        """What it is read from."""

    @property
    def label(self) -> str:
        """Its name, empty where it tells none."""


def labels_of(tables: Sequence[Labelled], noun: str, table: str) -> list[str]:
    """The label of every table: as written, else its number, from 1; none where it is alone.

    Args:
        tables: one or more, in the order of the file.
        noun: what one of them is, for complaints.
        table: name of the table in the file.

    Raises:
        BadInput: two of one label.
    """
    alone = len(tables) == 1
    labels = [x.label or ("" if alone else str(k)) for k, x in enumerate(tables, start=1)]
    for k, label in enumerate(labels):
        if label in labels[:k]:
            raise BadInput(
                f"{tables[k].file}: is the second {noun} of the label '{label}'; wanted a label of "
                f"its own for every [[{table}]]"
            )
    return labels
