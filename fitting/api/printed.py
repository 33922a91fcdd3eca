"""What a notebook shows of a result that has no table."""

from __future__ import annotations

import html
import importlib
import importlib.util
from collections.abc import Mapping, Sequence
from typing import Any

from fitting.text.errors import BadInput


class HtmlText:
    """A record that a notebook shows as it is printed."""

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(repr(self))}</pre>"


def data_frame(rows: Sequence[Mapping[str, Any]], index: str) -> Any:
    """Flat rows as a ``pandas.DataFrame``.

    Args:
        rows: by the names of their columns.
        index: the column that becomes the index.

    Raises:
        BadInput: pandas is not installed.
    """
    if importlib.util.find_spec("pandas") is None:
        raise BadInput("to_dataframe: needs pandas: pip install pandas")
    pandas = importlib.import_module("pandas")
    return pandas.DataFrame(rows).set_index(index)
