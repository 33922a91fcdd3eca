"""The ASCII trace export of the FSV, FSW and FPL spectrum analysers of Rohde & Schwarz."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from fitting.campaign.instruments.recording import Recording, channel_of
from fitting.campaign.instruments.trace import Head, Layout, Selection
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, gathered
from fitting.text.notation import how_many
from fitting.text.tables import parse_number, parse_numbers, read_text, split_line


def _read_rohde_schwarz(path: Path, selection: Selection) -> Recording:
    """``name;value;unit`` header lines, then ``Trace n``, ``Values;N`` and N lines ``x;y[;y2]``.

    Layout after "ASCII File Export Format" in the user manuals of R&S FSV, FSW and FPL. The second
    level that the AUTOPEAK detector adds is the smaller one and is left out.
    """
    lines = [split_line(t, ";") if t.strip() else ("",) for t in read_text(path).splitlines()]
    header: dict[str, tuple[str, ...]] = {}
    found = 0
    for i, cells in enumerate(lines):
        key = cells[0].rstrip(":").lower()
        header[key] = cells[1:]
        if key != "values":
            continue
        found += 1
        if found == selection.trace:
            return _rohde_schwarz_trace(path, lines, i, header)
    raise BadInput(
        f"{path}: {how_many(found, 'trace')} ('Values;<number>' lines), wanted trace "
        f"{selection.trace}; is it the ASCII trace export of a Rohde & Schwarz analyser?"
    )


def _rohde_schwarz_trace(
    path: Path, lines: Sequence[tuple[str, ...]], start: int, header: Mapping[str, tuple[str, ...]]
) -> Recording:
    where = f"{path}: row {start + 1}, 'Values'"
    count = int(parse_number((lines[start] + ("",))[1], where))
    if count < 0:
        raise BadInput(f"{where}: found {count}, wanted a number of points")
    rows = lines[start + 1 : start + 1 + count]
    if len(rows) < count:
        raise BadInput(
            f"{where}: {how_many(count, 'point')} announced, {how_many(len(rows), 'line')} below"
        )
    places = tuple(f"row {start + 2 + j}" for j in range(count))

    def column(k: int, name: str) -> FloatArray:
        texts = [cells[k] if k < len(cells) else "" for cells in rows]
        cells_of = list(zip(places, texts, strict=True))
        return parse_numbers(path, cells_of, f", {name}", decimal_comma=True)

    names = ("frequency", "level")
    frequency, level = gathered(partial(column, k, name) for k, name in enumerate(names))
    units = []
    for key in ("x-unit", "y-unit"):
        unit = header.get(key, ("",))[0]
        if not unit:
            raise BadInput(f"{path}: no '{key}' line before the values; wanted as in 'x-Unit;Hz;'")
        units.append(unit)
    notes = {k: " ".join(header[k]).strip() for k in ("type", "rbw", "detector") if k in header}
    return Recording(
        path=path,
        channels=(
            channel_of("Time" if units[0] == "s" else "Frequency", units[0], frequency),
            channel_of("Level", units[1], level),
        ),
        places=places,
        words=", ".join(("Rohde & Schwarz, ASCII trace", *notes.values())),
        notes=notes,
    )


def _recognises(head: Head) -> bool:
    return any(line.lower().startswith(("values;", "values:;")) for line in head.lines)


LAYOUT = Layout(
    name="rohde-schwarz", read=_read_rohde_schwarz, recognises=_recognises, keys=("trace",)
)
