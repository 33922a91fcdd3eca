"""Faults in data files: experiments, spectra, sweeps, and what instruments write."""

from __future__ import annotations

import copy
import random
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from fitting.text.toml import toml_text
from tests.campaign.test_instruments import AFM, ROHDE_SCHWARZ, ZURICH
from tests.faults.campaign_keys import COMMAND
from tests.faults.case import Case
from tests.faults.scene import CAMPAIGN, EXPERIMENTS, ONE, SWEEP, TABLES, TWO, texts

DATA, INSTRUMENTS = "data: experiments, spectra, sweep", "data: instruments' files"

Corruption = Callable[[random.Random, list[str]], str]

#: Cells that are no numbers, or none that a measurement has.
CELLS = (
    *("nan", "inf", "-inf", "1e400", "-1e300", "1e300", "1e-300", "0", "-0.0", "-1", ""),
    *("x", "1,5", "1.5.5", "1e", "0x10", "1D5", "1_000", "1'000", "--1", "+", "(1)", "=1+1", "#"),
    *('"', '"unclosed', "\0", "9" * 5000, "1" * 140_000, '"' + "a" * 140_000, "١٢٣", "∞", "1 Hz"),
)
HEADERS = (
    *("", ",", "frequency", "frequency (Hz)", "frequency (Hz),frequency (Hz)", "a,b", "(Hz),(V)"),
    *("frequency (Hz),amplitude", "frequency (s),amplitude (V)", "frequency (Hz),amplitude (kg)"),
    *("frequency [Hz],amplitude [V],", "frequency (Hz,amplitude (V", "f (Hz);amplitude (V)"),
    *("frequency (Hz**9**9**9),amplitude (V)", "frequency (Hz),amplitude (" + "V" * 5000 + ")"),
    *("frequency (Hz)" + " " * 100_000 + "x,amplitude (V)", "experiment", "experiment,u1"),
    *("experiment,u1 (kg)", "experiment,u1 (Hz),u1 (Hz)", "experiment,u2 (Hz)", "u1 (Hz)"),
    *("experiment,u1 (Hz),d1 (Hz)", "experiment,u1 (Hz),nonsense", "experiment,u1 (Hz),output"),
)
LABELS = (
    *("", " ", "two", "..", "../one", "/etc/hostname", "a\0b", "x" * 5000, "\U0001f600", "{}"),
    *("{experiment}", "one/", "-", "#", '"', "nan", "one two", "\u202e", "con", "a:b"),
)


def _cell(draw: random.Random, lines: list[str]) -> str:
    row = draw.randrange(1, len(lines))
    delimiter = next((d for d in ";\t" if d in lines[row]), ",")
    cells = lines[row].split(delimiter)
    cells[draw.randrange(len(cells))] = draw.choice(CELLS)
    return "\n".join([*lines[:row], delimiter.join(cells), *lines[row + 1 :]])


def _column(draw: random.Random, lines: list[str]) -> str:
    """One value in all of a column."""
    value = draw.choice(CELLS[:14])
    at = draw.randrange(2)
    rows = [line.split(",") for line in lines[1:]]
    made = [",".join([*row[:at], value, *row[at + 1 :]]) for row in rows]
    return "\n".join([lines[0], *made])


def _scaled(draw: random.Random, lines: list[str]) -> str:
    """All numbers of the last column times a power of ten."""
    power = draw.choice((-330, -300, -150, 150, 300, 306))
    return "\n".join([lines[0], *(f"{line}e{power}" for line in lines[1:])])


def _header(draw: random.Random, lines: list[str]) -> str:
    return "\n".join([draw.choice(HEADERS), *lines[1:]])


def _label(draw: random.Random, lines: list[str]) -> str:
    return "\n".join([lines[0], f"{draw.choice(LABELS)},{lines[-1].partition(',')[2]}", *lines[2:]])


def _rows(draw: random.Random, lines: list[str]) -> str:
    kind = draw.randrange(9)
    head, body = lines[0], lines[1:]
    at = draw.randrange(len(body))
    changed = [
        [],
        body[:1],
        body[:at],
        body[::-1],
        [*body, body[at]],
        [*body[:at], *body[at + 1 :], body[at]],
        [*body[:at], body[at] + ",1", *body[at + 1 :]],
        [*body[:at], body[at].partition(",")[0], *body[at + 1 :]],
        draw.sample(body, len(body)),
    ][kind]
    return "\n".join([head, *changed])


def _shape(draw: random.Random, lines: list[str]) -> str:
    whole = "\n".join(lines)
    return draw.choice(
        [
            "",
            "\n\n\n",
            "# only a remark\n",
            whole[: draw.randrange(len(whole))],
            whole[draw.randrange(len(whole)) :],
            whole.replace(",", ";"),
            whole.replace(",", "\t"),
            whole.replace(",", " "),
            whole.replace(",", ";").replace(".", ","),
            whole.replace("\n", "\r"),
            whole.replace("\n", "\n\n"),
            whole.replace("\n", "\u2028"),
            whole.replace("\n", '"\n"'),
            "\ufeff" + whole,
            whole.encode("utf-16").decode("latin-1"),
            "\x1f\x8b\x08" + whole,
            "PK\x03\x04" + whole,
            "<html>" + whole,
            whole + "\n" + whole,
            lines[0] + "\n" + "1,1\n" * 200_000,
        ]
    )


def _bytes(draw: random.Random, lines: list[str]) -> str:
    data = list("\n".join(lines))
    for _ in range(draw.randint(1, 6)):
        data[draw.randrange(len(data))] = chr(draw.randrange(256))
    return "".join(data)


CORRUPTIONS: Mapping[str, Corruption] = {
    "a cell": _cell,
    "a column": _column,
    "the scale": _scaled,
    "the header": _header,
    "rows": _rows,
    "the shape": _shape,
    "bytes": _bytes,
}
#: Rohde & Schwarz and LabOne count and number; these are their places.
COUNTS = ("-5", "0", "1e300", "nan", "2.5", "", "99999999999", "3;3")


def cases(count: int, seed: int) -> Iterator[Case]:
    """Corruptions of the campaign's own data files."""
    draw = random.Random(seed)
    whole = texts()
    for k in range(count):
        name = draw.choice((EXPERIMENTS, ONE, TWO, SWEEP))
        kinds = {**CORRUPTIONS, "a label": _label} if name == EXPERIMENTS else CORRUPTIONS
        what = draw.choice(sorted(kinds))
        text = kinds[what](draw, whole[name].splitlines())
        yield Case(
            kind=DATA,
            name=f"{name}: {what}, {k}",
            words=COMMAND,
            change=_writing({name: text}),
            about=(".csv", CAMPAIGN, "experiment '", "model.fmu"),
        )


def instrument_cases(count: int, seed: int) -> Iterator[Case]:
    """Corruptions of instruments' files, taken for the campaign's sweep."""
    draw = random.Random(seed)
    layouts = {"rohde-schwarz": ROHDE_SCHWARZ, "zurich": ZURICH, "afm": AFM, "csv": texts()[SWEEP]}
    for k in range(count):
        layout = draw.choice(sorted(layouts))
        told = draw.choice(sorted(layouts)) if draw.random() < 0.2 else layout
        lines = layouts[layout].splitlines()
        if layout == "rohde-schwarz" and draw.random() < 0.3:
            what = "a count"
            text = "\n".join(lines).replace("Values; 3", f"Values; {draw.choice(COUNTS)}", 1)
        else:
            what = draw.choice(("a cell", "rows", "the shape", "bytes"))
            text = CORRUPTIONS[what](draw, lines)
        yield Case(
            kind=INSTRUMENTS,
            name=f"{layout} as {told}: {what}, {k}",
            words=COMMAND,
            change=_writing({SWEEP: text, CAMPAIGN: _told(told)}),
            about=(SWEEP, CAMPAIGN, "model.fmu"),
        )


def _told(layout: str) -> str:
    tables = copy.deepcopy(dict(TABLES))
    unit = {"rohde-schwarz": "dBm", "zurich": "V rms", "afm": "m peak", "csv": "V peak"}[layout]
    tables["sweep"] |= {"layout": layout, "amplitude": unit}
    tables["sweep"] |= {"impedance": "50 ohm"} if unit == "dBm" else {}
    return toml_text(tables)


def _writing(files: Mapping[str, str]) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        for name, text in files.items():
            (folder / name).write_bytes(text.encode("utf-8", "surrogatepass"))

    return write
