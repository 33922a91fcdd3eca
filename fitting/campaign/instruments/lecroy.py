"""The text file of LeCroy's oscilloscopes: a head of five lines, then time and amplitude.

    LECROYWR104Xi,12345,Waveform
    Segments,1,SegmentSize,1002
    Segment,TrigTime,TimeSinceSegment1
    #1,01-Jan-2010 10:00:00,0
    Time,Ampl

A line ``#k`` for every segment; the segments' rows follow each other. Times are in seconds from
the trigger. The file tells no unit of its amplitudes: they are volts, unless a probe or a function
of the oscilloscope made something else of them.
"""

from __future__ import annotations

from pathlib import Path

from fitting.campaign.instruments.recording import Recording, of_table
from fitting.campaign.instruments.trace import Head, Layout, Selection
from fitting.text.errors import BadInput
from fitting.text.notation import how_many
from fitting.text.tables import parse_table, read_text, split_line

_MARK, _SEGMENTS, _NAMES = "LECROY", "Segments", "Time"
#: Lines among which the head of the columns stands, below those of the segments.
_LINES_ABOVE = 4


def _read_lecroy(path: Path, selection: Selection) -> Recording:
    """The rows of one segment, times in s and amplitudes in V."""
    numbered = [(n, t) for n, t in enumerate(read_text(path).splitlines(), start=1) if t.strip()]
    cells = [split_line(text, ",") for _, text in numbered]
    segments, size = _segments(path, cells)
    end = _LINES_ABOVE + segments + 1
    at = next((i for i, row in enumerate(cells[:end]) if row[0] == _NAMES and i), None)
    if at is None:
        raise BadInput(f"{path}: no row 'Time,Ampl'; wanted the text file of a LeCroy oscilloscope")
    if not 0 < selection.trace <= segments:
        raise BadInput(f"{path}: {how_many(segments, 'segment')}, wanted segment {selection.trace}")
    rows = numbered[at + 1 :]
    if segments > 1:
        rows = rows[(selection.trace - 1) * size : selection.trace * size]
    names = [f"{name} (V)" for name in cells[at][1:] if name]
    table = parse_table(path, [(numbered[at][0], ",".join(["Time (s)", *names])), *rows])
    model = cells[0][0].removeprefix(_MARK).strip()
    taken = f", trace = {selection.trace} taken" if segments > 1 else ""
    words = f"LeCroy oscilloscope {model}, {how_many(segments, 'segment')}{taken}, "
    return of_table(table, words + "V taken as the unit, which the file does not tell")


def _segments(path: Path, cells: list[tuple[str, ...]]) -> tuple[int, int]:
    """How many segments there are, and the rows of each."""
    row = cells[1] if len(cells) > 1 else ()
    try:
        return int(row[1]), int(row[3])
    except (IndexError, ValueError):
        raise BadInput(
            f"{path}: row 2: found {','.join(row)!r}, wanted the segments of a LeCroy "
            "oscilloscope, as Segments,1,SegmentSize,1002"
        ) from None


def _recognises(head: Head) -> bool:
    second = head.lines[1] if len(head.lines) > 1 else ""
    return head.first_line.startswith(_MARK) and second.startswith(_SEGMENTS)


LAYOUT = Layout(name="lecroy", read=_read_lecroy, recognises=_recognises, keys=("trace",))
