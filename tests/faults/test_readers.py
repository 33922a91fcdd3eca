"""Whatever text a reader is given, it reads it or complains of it: nothing else ever comes out."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fitting.campaign.file import read_campaign_file
from fitting.campaign.instruments import LAYOUTS, read_trace
from fitting.signal.combinations import lines_to_read
from fitting.text.errors import BadInput
from fitting.text.tables import parse_number, read_table
from fitting.text.toml import read_toml
from fitting.text.units import convert, parse_quantity

MARKS = ",;\t\n\"'#=[]{}().*^+-/% "
NUMBERS = ("1", "2.5", "1e308", "-3", "nan")
HEADS = (
    *("[DATA]", "Values;", "Trace 1", "chunk", "x-Unit", "fieldname", "Frequency Shift (Hz)"),
    *("Center Frequency (Hz)", "title", "fmu", "u1"),
)
#: Texts of the pieces that the readers look for, so that they get past their first look.
PIECES = st.lists(
    st.one_of(
        st.sampled_from(
            [*MARKS, "\r\n", "Hz", "V", "frequency (Hz)", "amplitude (V)", *NUMBERS, *HEADS]
        ),
        st.text(max_size=5),
    ),
    max_size=40,
).map("".join)
WRITTEN = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)


def complaints(read: Callable[[], object]) -> tuple[str, ...]:
    try:
        read()
    except BadInput as error:
        return tuple(map(str, error.args))
    return ()


READERS: dict[str, Callable[[Path], object]] = {
    "a campaign": read_campaign_file,
    "TOML": read_toml,
    "a table": read_table,
    **{name: lambda path, name=name: read_trace(path, name) for name in LAYOUTS},  # type: ignore[misc]
}


@pytest.mark.parametrize("reader", READERS)
@WRITTEN
@given(text=PIECES)
def test_files_are_read_or_refused(reader: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    for line in complaints(partial(READERS[reader], path)):
        assert str(path) in line


WORDS: dict[str, Callable[[str], object]] = {
    "a number": lambda text: parse_number(text, "here"),
    "a quantity": lambda text: parse_quantity(text, where="here"),
    "a unit": lambda text: convert(1.0, text, "Hz", where="here"),
    "a combination": lambda text: lines_to_read((text,), None, ("u1", "u2"), "here"),
}


@pytest.mark.parametrize("reader", WORDS)
@WRITTEN
@given(text=PIECES)
def test_words_are_read_or_refused(reader: str, text: str) -> None:
    for line in complaints(partial(WORDS[reader], text)):
        assert line.startswith("here: ")
