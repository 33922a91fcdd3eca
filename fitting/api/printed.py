"""What a notebook shows of a result, its rows as a data frame, its files in a folder."""

from __future__ import annotations

import html
import importlib
import importlib.util
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from fitting.text.errors import BadInput
from fitting.text.results_folder import remove_earlier, results_folder

Written = TypeVar("Written")


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


def written(
    out: str | Path, command: str, names: Sequence[str], write: Callable[[Path], Written]
) -> Written:
    """What a function returns that writes into a folder, of which the files of a command remain.

    Args:
        out: the folder, made where there is none.
        command: whose files they are.
        names: names and patterns of its files: those of an earlier run that are not written go.
        write: writes into the folder.

    Raises:
        BadInput: the folder cannot be written, or holds files of these names that are not ours.
    """
    with results_folder(Path(out), command, names):
        result = write(Path(out))
        remove_earlier(Path(out), names)
    return result
