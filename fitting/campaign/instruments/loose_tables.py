"""Tables of numbers as programs write them: delimiter, comments, head and unit row are found.

Blanks between cells, no head at all, lines that begin with # or %, a preamble of settings, a row of
units below the names. Rows begin right below names that have a unit or are those of an axis, so
that a cell that is no number is named with its row and column.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fitting.text.errors import BadInput, shown
from fitting.text.notation import how_many
from fitting.text.tables import Column, Table, named_column, named_columns, split_line

#: What a line begins with that is no row.
COMMENTS = ("#", "%", "!", "//")
#: Lines that end a table of numbers.
ENDS = ("end", "[end]", "end of data", "[/data]")
#: Rows of numbers one after another that are a table and not a preamble.
SURE_ROWS = 3
#: Rows of a run of which half have to be numbers.
SAMPLE = 50
#: Lines above a table among which its names are looked for.
MOST_ABOVE = 500
#: Names of axes by which a row of names is known, in small letters.
AXES = ("frequency", "freq", "f", "time", "t")
#: The column of remarks of LabVIEW, in small letters.
REMARKS = "comment"
BLANKS = " "

_REAL = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf)", re.IGNORECASE)
_COMPLEX = re.compile(r"\(?[+-]?[\d.][\d.eE+-]*[ij]?[ +-]*[\d.eE+-]*[ij]?\)?")
#: What a number begins with.
_BEGINS = frozenset("0123456789+-.(")
_NONE = ("nan", "inf")
AXIS_WORDS = {"horizontal": "x", "vertical": "y"}
_AXIS_UNITS = re.compile(
    r"(?P<axis>x|y|horizontal|vertical)[ -]*(axis)?[ -]*"
    r"(units?([ -]*labels?)?|(?P<dimension>dimension))",
    re.IGNORECASE,
)
_WORD = re.compile(r"\S*\([^)]*\)|\S*\[[^\]]*\]|\S+")

_PLAIN_UNITS = (
    *("Hz", "kHz", "MHz", "GHz", "V", "mV", "uV", "µV", "nV", "A", "mA", "uA", "nA", "m", "mm"),
    *("um", "nm", "pm", "fm", "s", "ms", "us", "ns", "deg", "rad", "dB", "dBm", "W", "mW", "N"),
    *("mN", "ohm", "m/s", "g"),
)
#: Units by their spellings in heads of columns, small letters.
UNITS = {unit.lower(): unit for unit in _PLAIN_UNITS} | {
    "μv": "uV",
    "µm": "um",
    "μm": "um",
    "µs": "us",
    "μs": "us",
    "°": "deg",
    "hertz": "Hz",
    "volt": "V",
    "volts": "V",
    "vrms": "V",
    "second": "s",
    "seconds": "s",
    "sec": "s",
    "degree": "deg",
    "degrees": "deg",
    "radian": "rad",
    "radians": "rad",
    "amp": "A",
}
_NO_UNIT = ("", "-", "1", "a.u.", "arb")
_SUFFIX = re.compile(r"(?P<name>.*[^\s/,_])(?P<mark>\s*/\s*|\s*,\s*|_|\s+)(?P<unit>[^\s/,_]+)")


def suffixed_unit(name: str) -> tuple[str, str | None]:
    """Name and unit of a column that writes it without brackets: "freq_hz", "R/uV", "time, s".

    Args:
        name: of the column, as it stands in the head.
    """
    match = _SUFFIX.fullmatch(name) if len(name) <= 100 else None
    if match is None or match["unit"].lower() not in UNITS:
        return name, None
    base = match["name"].removesuffix(" in")
    blank = not match["mark"].strip() and base == match["name"]
    if blank and len(match["unit"]) == 1 and match["unit"].isalpha():
        return name, None  # "channel A" is a name
    return base.rstrip(), UNITS[match["unit"].lower()]


def named_unit(name: str) -> str | None:
    """The unit that a column is called by, as "GHz" or "deg"; None: its name is no unit.

    A single letter is a name.

    Args:
        name: of the column, as it stands in the head.
    """
    return UNITS.get(name.strip(" .").lower()) if len(name) > 1 else None


def find_table(
    path: Path, text: str, header_row: int | None = None
) -> tuple[Table, str, bool] | None:
    """The table of numbers that a text holds, what it is in words, whether its columns are named.

    None if there is none of two columns.

    It is the longest run of rows of numbers; the last row of names above it heads it, whatever
    stands between and above.

    Args:
        path: of the file.
        text: of the file.
        header_row: row of the names, from one, below which the rows are; None: it is found.

    Raises:
        BadInput: a row that is no row of numbers below others that are, or with another number of
            cells; a row of names with another number of cells.
    """
    whole = [(n, line.strip("\r\n")) for n, line in enumerate(text.splitlines(), start=1)]
    kept = [(n, t) for n, t in whole if t.strip() and not t.lstrip().startswith(COMMENTS)]
    if header_row is not None:
        kept = [(n, t) for n, t in kept if n > header_row]
    result = _start(kept)
    if result is None:
        return None
    start, delimiter, count = result
    rows, lines = _rows(path, kept[start:], delimiter, count)
    above = [(n, t) for n, t in whole[: lines[0] - 1] if t.strip()]
    if header_row is not None:
        above = [(n, t) for n, t in above if n >= header_row]
        columns, head = _given_head(path, above, delimiter, count, header_row)
    else:
        columns, head = _head(path, above, delimiter, count)
    for n, line in above:  # a row of numbers below the names is one of the table
        cells = cells_of(line, delimiter)
        if (
            n > head > 0
            and len(cells) > 1
            and all(is_number(c) or c.lower() in _NONE for c in cells)
        ):
            raise BadInput(
                f"{path}: row {n} has {how_many(len(cells), 'cell')}, the header {count}: found "
                f"{shown(line)}"
            )
    table = Table(
        path=path,
        columns=with_units(columns, [t for _, t in above], delimiter),
        cells=tuple(rows),
        lines=tuple(lines),
        decimal_comma=delimiter != ",",
    )
    return table, words_of(delimiter, head), bool(head)


def words_of(delimiter: str, head: int) -> str:
    """What a table of text is, in words.

    Args:
        delimiter: between cells.
        head: row of the names, from one; 0: there is none.
    """
    between = {",": "a comma", ";": "a semicolon", "\t": "a tab", BLANKS: "blanks"}[delimiter]
    named = f"names in row {head}" if head else "no names"
    return f"columns of text, {between} between them, {named}"


def _start(kept: Sequence[tuple[int, str]]) -> tuple[int, str, int] | None:
    """Where the longest run of rows of numbers begins, what is between their cells, how many.

    Cells that are no numbers interrupt no run, as long as one of their row begins like a number;
    after anything else it is one that goes on, and begins where the first rows like it do.
    """
    starts: dict[tuple[str, int], int] = {}  # of the first rows with so many cells, by delimiter
    longest, kind = 0, ("", 0)
    i = 0
    while i < len(kept):
        end = i + 1
        for delimiter in (";", "\t", ",", BLANKS):
            cells = cells_of(kept[i][1], delimiter)
            # right below names the first row may have a cell that is no number
            names = cells_of(kept[i - 1][1], delimiter) if i else ()
            headed = len(names) > 1 and any(map(_heads, names)) and not any(map(is_number, names))
            headed = headed and _goes_on(kept[i][1], delimiter, len(names))
            count = len(names) if headed else len(cells) * _numeric(cells, delimiter)
            j = i
            while count and j < len(kept) and _goes_on(kept[j][1], delimiter, count):
                j += 1
            sample = (cells_of(text, delimiter, count) for _, text in kept[i : min(j, i + SAMPLE)])
            numeric = [_numeric(cells, delimiter) for cells in sample]
            # few rows are a table where nothing follows them
            ends = j == len(kept) or kept[j][1].strip().lower() in ENDS
            sure = headed or ends or j - i >= SURE_ROWS
            if numeric and sure and 2 * sum(numeric) >= len(numeric):
                starts.setdefault((delimiter, count), i)
                if j - i > longest:
                    longest, kind = j - i, (delimiter, count)
                end = j
                break
        i = end
    return (starts[kind], *kind) if longest else None


def _goes_on(text: str, delimiter: str, count: int) -> bool:
    """Whether a line may be a further row of numbers: as many cells, and one begins like it."""
    # most lines need not be parted
    plain = delimiter != BLANKS and text[:1] in _BEGINS and '"' not in text
    if plain and text.count(delimiter) == count - 1:
        return True
    cells = cells_of(text, delimiter, count)
    return len(cells) == count and any(c[:1] in _BEGINS or c.lower() in _NONE for c in cells if c)


def cells_of(text: str, delimiter: str, count: int = 0) -> tuple[str, ...]:
    """Cells of a line, without the empty ones that a delimiter at its end makes.

    Args:
        text: the line.
        delimiter: between cells; a blank means any number of blanks.
        count: of cells that a row has, empty or not.
    """
    cells = tuple(text.split()) if delimiter == BLANKS else split_line(text, delimiter)
    while len(cells) > count and not cells[-1]:
        cells = cells[:-1]
    return cells


def _numeric(cells: Sequence[str], delimiter: str) -> bool:
    """Whether a row is one of numbers; a column of dates or remarks may stand between them."""
    numbers = sum(is_number(c, decimal_comma=delimiter != ",") for c in cells)
    if delimiter == BLANKS:
        return numbers == len(cells) >= 2
    if any(len(c.split()) > 1 and all(map(is_number, c.split())) for c in cells):
        return False  # "1,5  2,5": the comma is the decimal sign
    return numbers >= 2 and 2 * numbers >= len(cells)


def is_number(cell: str, *, decimal_comma: bool = False) -> bool:
    """Whether a cell looks like a number, real or complex.

    Args:
        cell: as it stands.
        decimal_comma: whether a comma is the decimal sign.
    """
    plain = cell.replace(",", ".") if decimal_comma else cell
    if len(plain) > 100:
        return False
    return bool(_REAL.fullmatch(plain)) or (
        plain.rstrip(")").endswith(("i", "j")) and bool(_COMPLEX.fullmatch(plain))
    )


def _rows(
    path: Path, kept: Sequence[tuple[int, str]], delimiter: str, count: int
) -> tuple[list[tuple[str, ...]], list[int]]:
    rows: list[tuple[str, ...]] = []
    lines: list[int] = []
    for n, text in kept:
        if text[:1] not in _BEGINS and text.strip().lower() in ENDS:
            break
        cells = cells_of(text, delimiter, count)
        if len(cells) != count:
            comma = "; a decimal comma needs ';' or tab between cells" * (delimiter == ",")
            raise BadInput(
                f"{path}: row {n} has {how_many(len(cells), 'cell')}, the rows above it {count}: "
                f"found {shown(text)}; wanted one table of numbers in a file{comma}"
            )
        rows.append(cells)
        lines.append(n)
    return rows, lines


def _head(
    path: Path, above: Sequence[tuple[int, str]], delimiter: str, count: int
) -> tuple[tuple[Column, ...], int]:
    """Columns by the lines above them, and the row of their names (0: there is none)."""
    above = [(n, t) for n, t in above if _axis_units(t, delimiter) is None]
    # remarks below a row of names are none themselves
    named = [k for k, (_, t) in enumerate(above) if not t.lstrip().startswith(COMMENTS)]
    nearest = cells_of(above[named[-1]][1], delimiter) if named else ()
    if len(nearest) == count and not any(map(is_number, nearest)):
        above = above[: named[-1] + 1]
    last = _split(above[-1][1], delimiter, count) if above else None
    before = _split(above[-2][1], delimiter, count) if len(above) > 1 else None
    if last is not None and not are_units(last):
        numbers = any(is_number(c, decimal_comma=delimiter != ",") for c in last)
        names = before is not None and not any(map(is_number, before))
        # a row of words below one of names and units names nothing
        if names and (numbers or (any(map(_heads, before or ())) and not any(map(_heads, last)))):
            bad = next(c for c in last if not is_number(c))
            raise BadInput(f"{path}: row {above[-1][0]}: found {shown(bad)}, wanted a number")
        last = None if numbers else last
    if last is not None and are_units(last):
        return _columns(before or last, last), above[-2 if before else -1][0]
    if last is not None:
        return _columns(last, where=f"{path}: row {above[-1][0]}"), above[-1][0]
    at = _names_above(above, delimiter, count)
    if at is None:
        return tuple(Column(f"column {i + 1}", None, i) for i in range(count)), 0
    return _columns(_cells_of_names(dict(above)[at], delimiter, count) or ()), at


def _given_head(
    path: Path, above: Sequence[tuple[int, str]], delimiter: str, count: int, row: int
) -> tuple[tuple[Column, ...], int]:
    """Columns by the row of names that is given, and perhaps one of units below it."""
    text = next((t for n, t in above if n == row), "")
    names = _split(text, delimiter, count)
    if names is None:
        raise BadInput(
            f"{path}: row {row} holds no {how_many(count, 'name')} for the columns below it: found "
            f"{shown(text)}"
        )
    units = _split(above[1][1], delimiter, count) if len(above) > 1 else None
    return _columns(names, units if units is not None and are_units(units) else None), row


def _columns(
    names: Sequence[str], units: Sequence[str] | None = None, where: str = ""
) -> tuple[Column, ...]:
    """Columns of names, with the units of a row of their own, or those in brackets.

    Names are numbered where they are empty or there twice; next to a unit of its own (``where``
    opens the error) a name is there once.
    """
    if units is None:
        columns = named_columns(names)
    else:
        plain = [UNITS.get(c.strip("()[] ").lower()) for c in units]
        pairs = enumerate(zip(names, plain, strict=True))
        columns = tuple(Column(name, unit, i) for i, (name, unit) in pairs)
    taken: set[str] = set()
    following: dict[str, int] = {}  # number to be tried next: many columns may have one name
    made = []
    for column in columns:
        first = name = column.name or f"column {column.index + 1}"
        k = following.get(first.lower(), 2)
        while name.lower() in taken:
            name, k = f"{first} {k}", k + 1
        following[first.lower()] = k
        taken.add(name.lower())
        if name != first and column.unit is not None and where:
            raise BadInput(f"{where}: column '{column.name}' appears twice")
        made.append(replace(column, name=name))
    return tuple(made)


def are_units(cells: Sequence[str]) -> bool:
    """Whether a row holds units and nothing else.

    Args:
        cells: of the row.
    """
    units = [c.strip("()[] ").lower() for c in cells]
    return all(u in UNITS or u in _NO_UNIT for u in units) and any(units)


def _names_above(above: Sequence[tuple[int, str]], delimiter: str, count: int) -> int | None:
    """The number of the last line above that heads columns, by a unit or the name of an axis."""
    for n, text in reversed(above[-MOST_ABOVE:]):
        cells = _cells_of_names(text, delimiter, count)
        if cells is not None and any(map(_heads, cells)) and not any(map(is_number, cells)):
            return n
    return None


def _bare(text: str) -> str:
    """A line without the marks of a remark before it."""
    text = text.strip()
    for mark in COMMENTS:
        text = text.removeprefix(mark).lstrip(mark[0]).strip()
    return text


def _cells_of_names(text: str, delimiter: str, count: int) -> tuple[str, ...] | None:
    """Cells of a row of names; LabVIEW writes one for remarks, which few rows have."""
    cells = cells_of(_bare(text), delimiter)
    if len(cells) == count + 1 and cells[-1].lower() == REMARKS:
        cells = cells[:-1]
    return cells if len(cells) == count else None


def _heads(cell: str) -> bool:
    """Whether a cell heads a column: it has a unit, or is the name of an axis."""
    column = named_column(cell, 0)
    unit = column.unit or suffixed_unit(column.name)[1] or named_unit(column.name)
    return unit is not None or column.name.strip(" .").lower() in AXES


def _axis_units(text: str, delimiter: str) -> tuple[str, tuple[str, ...]] | None:
    """The axis, "x" or "y", whose units a line of settings declares, and these."""
    if "unit" not in text.lower() and "dimension" not in text.lower():
        return None
    plain = text.strip().lstrip("".join(COMMENTS)).strip()
    ways = (cells_of(plain, d) for d in (delimiter, ";", "\t", ",") if d != BLANKS)
    key, *values = next((cells for cells in ways if len(cells) > 1), ("",))
    match = _AXIS_UNITS.fullmatch(key.replace("_", " ").strip(" :"))
    declared = tuple(UNITS.get(value.lower(), value) for value in values if value)
    if match is None or not declared:
        return None
    if match["dimension"]:
        declared = ("s",) if declared[0].lower() == "time" else ()
    axis = match["axis"].lower()
    return (AXIS_WORDS.get(axis, axis), declared) if declared else None


def with_units(
    columns: Sequence[Column], above: Sequence[str], delimiter: str
) -> tuple[Column, ...]:
    """Columns without a unit in brackets in that which settings declare, or their names have.

    Settings are lines as "X Axis Units,Hz" and "Y Axis Units,dBm", or "Y_Unit_Label", a unit for
    each column. Names have a unit as freq_hz, or are one, as GHz.

    Args:
        columns: of a table.
        above: lines above it.
        delimiter: between their cells.
    """
    declared = dict(pair for text in above if (pair := _axis_units(text, delimiter)) is not None)
    x, y = declared.get("x", (None,))[0], declared.get("y", ())
    units = [x, *(y * (len(columns) - 1) if len(y) == 1 else y), *[None] * len(columns)]
    only_units = are_units([c.name for c in columns])

    def unit_in(name: str) -> str | None:
        if only_units:
            return UNITS.get(name.lower())
        return suffixed_unit(name)[1] or named_unit(name)

    return tuple(
        c if c.unit is not None else replace(c, unit=unit or unit_in(c.name))
        for c, unit in zip(columns, units, strict=False)
    )


def _split(line: str, delimiter: str, count: int) -> tuple[str, ...] | None:
    """Cells of a line above the numbers, if it can be parted into that many."""
    text = _bare(line)
    if not text:
        return None
    ways = (
        cells_of(text, delimiter) if delimiter != BLANKS else (),
        cells_of(text, "\t"),
        cells_of(text, ";"),
        cells_of(text, ","),
        tuple(re.split(r"\s{2,}", text)),
        tuple(text.split()),
        tuple(_WORD.findall(re.sub(r"\s+(?=[(\[])", "", text))),
    )
    return next((cells for cells in ways if len(cells) == count), None)
