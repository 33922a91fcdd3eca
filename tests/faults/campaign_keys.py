"""Faults in the campaign file: every key of the schema with values of every wrong kind."""

from __future__ import annotations

import copy
import datetime
import json
import math
import random
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

from fitting.measurements.schema import SCHEMA_FILE
from fitting.text.toml import toml_text
from tests.faults.case import HERE, OUT, Case
from tests.faults.scene import CAMPAIGN, TABLES, texts

KEYS, TEXT = "campaign: keys and values", "campaign: the text itself"
COMMAND = (
    *("reconstruct", f"{HERE}/{CAMPAIGN}", "--out", f"{HERE}/{OUT}", "--workers", "1"),
    *("--quick", "--no-profiles", "--no-report"),
)
#: What a complaint may name.
FILES = (CAMPAIGN, ".csv", ".fmu", "campaign")

Key = str | int
Place = tuple[Key, ...]

VALUES: dict[str, Any] = {
    "a Boolean": True,
    "zero": 0,
    "minus one": -1,
    "a fraction": 1.5,
    "a large whole number": 10**400,
    "beyond 64 bits": 2**64,
    "not a number": math.nan,
    "infinite": math.inf,
    "1e300": 1e300,
    "-1e300": -1e300,
    "1e-300": 1e-300,
    "an empty text": "",
    "a blank": " ",
    "a NUL character": "a\0b",
    "a long text": "LONG",
    "many blanks": "1 BLANKS x",
    "an unknown unit": "1 parsecs per fortnight",
    "not a number with a unit": "nan Hz",
    "infinite with a unit": "1e400 Hz",
    "large with a unit": "1e300 Hz",
    "tiny with a unit": "1e-300 Hz",
    "negative with a unit": "-1 Hz",
    "zero with a unit": "0 Hz",
    "a power of a unit": "1 Hz**9**9**9",
    "a combination": "99999999*u1 - u1",
    "a folder": "../..",
    "a pattern": "{experiment}{experiment}{nothing}",
    "a smile": "\U0001f600",
    "an empty list": [],
    "a list in a list": [[[]]],
    "a list of blanks": [" ", "\t"],
    "a list twice the same": ["u1", "u1"],
    "a mixed list": [1, "a", True],
    "a long list": list(range(300)),
    "an empty table": {},
    "a table": {"a": 1, "b": {"c": 2}},
    "a list of tables": [{"name": "a"}, {}],
    "a date": datetime.date(2024, 1, 1),
}


def schema_keys() -> tuple[Place, ...]:
    """Every key that a campaign can have; of free tables one that is there."""
    return tuple(_keys(json.loads(SCHEMA_FILE.read_text("utf-8")), ()))


def _keys(table: Any, place: Place) -> Iterator[Place]:
    for key, value in table.get("properties", {}).items():
        yield (*place, key)
        yield from _keys(value, (*place, key))
        if isinstance(value.get("items"), dict):
            yield from _keys(value["items"], (*place, key, 0))
    if isinstance(table.get("additionalProperties"), dict):
        yield from _keys(table["additionalProperties"], (*place, "eta_minus"))


def cases(count: int, seed: int) -> Iterator[Case]:
    """So many cases, drawn without repeating one; every key once before one comes again."""
    draw = random.Random(seed)
    values = (*VALUES, "removed", "misspelt")
    keys = draw.sample(schema_keys(), len(schema_keys()))
    once = [(key, draw.choice(values)) for key in keys]
    others = [(key, what) for key in keys for what in values if (key, what) not in set(once)]
    for key, what in [*once, *draw.sample(others, max(0, count - len(once)))][:count]:
        name = f"{'.'.join(map(str, key))}: {what}"
        made = partial(_changed_text, key, what)
        yield _case(KEYS, name, made, (*FILES, str(key[-1])))


def text_cases(count: int, seed: int) -> Iterator[Case]:
    """Texts that are no campaign, and the campaign's with bytes changed at random."""
    whole = texts()[CAMPAIGN]
    wild = {
        "empty": "",
        "one word": "campaign",
        "deep lists": "a = " + "[" * 20_000 + "]" * 20_000,
        "deep tables": "a" + ".a" * 3000 + " = 1",
        "deep inline tables": "a = " + "{a = " * 5000 + "1" + "}" * 5000,
        "a deep list as a value": whole.replace("1.0", "[" * 60 + "]" * 60, 1),
        "a number of 5,000 digits": whole.replace("1.0", "1" * 5000, 1),
        "a hexadecimal number of 5,000 digits": whole.replace("1.0", "0x" + "f" * 5000, 1),
        "a key twice": whole + "\n[fmu]\n",
        "NUL bytes": whole.replace("\n", "\n\0", 3),
        "UTF-16": whole.encode("utf-16").decode("latin-1"),
        "carriage returns": whole.replace("\n", "\r"),
        "half of it": whole[: len(whole) // 2],
        "JSON": json.dumps({"title": "a"}),
        "a million lines": "#\n" * 1_000_000,
        "a million keys": "".join(f"k{i} = 1\n" for i in range(100_000)),
    }
    for name, text in list(wild.items())[:count]:
        yield _case(TEXT, name, partial(str, text), FILES)
    draw = random.Random(seed)
    for k in range(count - len(wild)):
        data = list(whole)
        for _ in range(draw.randint(1, 8)):
            at = draw.randrange(len(data))
            data[at] = draw.choice(["", "\0", "\x7f", '"', "[", "]", "=", "\n", "é", "9", "e", "-"])
        yield _case(TEXT, f"bytes changed at random, {k}", partial(str, "".join(data)), FILES)


def _case(kind: str, name: str, text: Callable[[], str], about: tuple[str, ...]) -> Case:
    def write(folder: Path) -> None:
        (folder / CAMPAIGN).write_bytes(text().encode("utf-8"))

    return Case(kind=kind, name=name, words=COMMAND, change=write, about=about)


def _changed_text(key: Place, what: str) -> str:
    text = toml_text(_changed(key, what))  # which takes its time over long texts
    return text.replace("LONG", "x" * 200_000).replace("BLANKS", " " * 200_000)


def _changed(key: Place, what: str) -> dict[str, Any]:
    tables = copy.deepcopy(dict(TABLES))
    table: Any = tables
    for step, following in pairwise(key):
        if isinstance(table, dict):
            table = table.setdefault(step, [{}] if following == 0 else {})
        else:
            table = table[step]
    last = key[-1]
    if what == "removed":
        table.pop(last, None)
    elif what == "misspelt":
        table[f"{last}s"] = table.pop(last, 1)
    else:
        table[last] = VALUES[what]
    return tables
