"""Faults in an FMU: the archive that it is, and the modelDescription.xml in it."""

from __future__ import annotations

import io
import random
import re
import struct
import warnings
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.faults.case import HERE, Case
from tests.faults.scene import FMU

ARCHIVE, DESCRIPTION = "FMU: the archive", "FMU: modelDescription.xml"
XML = "modelDescription.xml"
COMMAND = ("check", f"{HERE}/{FMU}", "--timeout", "20 s")

Change = Callable[[Path], bytes]

#: Values that an attribute has not.
ATTRIBUTES = (
    *("", " ", "nan", "INF", "-1", "0", "1.5", "1e300", "1e400", "true", "maybe", "x", "9" * 50),
    *("9" * 5000, "4294967296", "\U0001f600", "../../x", "/", "a&#10;b", "%s%n", "x" * 70_000),
)


def _read(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def _zipped(members: dict[str, bytes], *more: tuple[str, bytes]) -> bytes:
    made = io.BytesIO()
    with (
        warnings.catch_warnings(action="ignore"),  # of names that are there twice
        zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        for name, content in [*members.items(), *more]:
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return made.getvalue()


def _with(*more: tuple[str, bytes]) -> Change:
    return lambda path: _zipped(_read(path), *more)


def _without(start: str) -> Change:
    return lambda path: _zipped({n: c for n, c in _read(path).items() if not n.startswith(start)})


def _field(signature: bytes, offset: int, form: str, value: int, which: int = 0) -> Change:
    """A field of the headers of one member, set to something."""

    def change(path: Path) -> bytes:
        data = bytearray(path.read_bytes())
        places = [m.start() for m in re.finditer(re.escape(signature), data)]
        struct.pack_into(form, data, places[which] + offset, value)
        return bytes(data)

    return change


def _bomb(path: Path) -> bytes:
    """A member that says it has 5 GB."""
    data = bytearray(_zipped(_read(path), ("bomb", bytes(1000))))
    places = [m.start() for m in re.finditer(re.escape(b"PK\x01\x02"), data)]
    struct.pack_into("<I", data, places[0] + 24, 0xFFFFFFF0)
    struct.pack_into("<I", data, places[1] + 24, 0xFFFFFFF0)
    return bytes(data)


def _damaged(path: Path) -> bytes:
    """A byte in the middle of a packed member changed: its checksum tells."""
    data = bytearray(_zipped({**_read(path), "resources/zz.txt": b"held " * 1000}))
    at = data.rindex(b"resources/zz.txt", 0, data.index(b"PK\x01\x02")) + 25
    data[at] ^= 0xFF
    return bytes(data)


CENTRAL, LOCAL = b"PK\x01\x02", b"PK\x03\x04"

WILD: dict[str, Change] = {
    "empty": lambda path: b"",
    "a text": lambda path: b"no archive",
    "an archive without anything": lambda path: _zipped({}),
    "the end is missing": lambda path: path.read_bytes()[:-100],
    "half of it": lambda path: path.read_bytes()[: path.stat().st_size // 2],
    "the head is missing": lambda path: path.read_bytes()[1000:],
    "garbage in front": lambda path: b"x" * 1000 + path.read_bytes(),
    "garbage behind": lambda path: path.read_bytes() + b"x" * 1000,
    "without a description": _without(XML),
    "without a binary": _without("binaries/"),
    "without resources": _without("resources/"),
    "the description in a folder": lambda path: _zipped(
        {f"model/{name}": content for name, content in _read(path).items()}
    ),
    "a member twice": _with((XML, b"<a/>")),
    "a file that is a folder": _with(("a", b""), ("a/b", b"")),
    "a way out": _with(("../../outside.txt", b"out")),
    "a way out of Windows": _with(("..\\outside.txt", b"out")),
    "an absolute name": _with(("/tmp/outside.txt", b"out")),
    "a drive": _with(("C:/outside.txt", b"out")),
    "a name of 300 letters": _with(("a" * 300, b"")),
    "a path of 5,000 letters": _with(("/".join(["abc"] * 1300), b"")),
    "a link": _with(("binaries/linux64/link", b"/etc/passwd")),
    "a damaged member": _damaged,
    "a bomb": _bomb,
    "encrypted": _field(CENTRAL, 8, "<H", 1),
    "packed by an unknown method": _field(CENTRAL, 10, "<H", 99),
    "packed by Deflate64": _field(CENTRAL, 10, "<H", 9),
    "said to be bzip2": _field(CENTRAL, 10, "<H", 12),
    "said to be LZMA": _field(CENTRAL, 10, "<H", 14),
    "said to be stored": _field(CENTRAL, 10, "<H", 0),
    "a wrong checksum in the list": _field(CENTRAL, 16, "<I", 0x12345678),
    "a wrong size in the list": _field(CENTRAL, 24, "<I", 3),
    "a wrong place in the list": _field(CENTRAL, 42, "<I", 0x7FFFFFFF),
    "a wrong version in the list": _field(CENTRAL, 6, "<H", 999),
    "a wrong local head": _field(LOCAL, 0, "<I", 0),
    "a wrong local name": _field(LOCAL, 30, "<H", 0x4141),
    "many members": _with(*((f"resources/{k}", b"") for k in range(3000))),
}


def archive_cases(count: int, seed: int) -> Iterator[Case]:
    """Archives that are damaged on purpose, and such with bytes changed at random."""
    for name, change in list(WILD.items())[:count]:
        yield _case(ARCHIVE, name, change)
    draw = random.Random(seed)
    for k in range(count - len(WILD)):
        yield _case(ARCHIVE, f"bytes changed at random, {k}", _noisy(draw.randrange(2**32)))


def _noisy(seed: int) -> Change:
    def change(path: Path) -> bytes:
        """Where it hurts: in the heads, and in the list at the end."""
        draw = random.Random(seed)
        data = bytearray(path.read_bytes())
        heads = [m.start() for m in re.finditer(rb"PK\x01\x02|PK\x03\x04|PK\x05\x06", data)]
        for _ in range(draw.randint(1, 4)):
            at = min(draw.choice(heads) + draw.randrange(80), len(data) - 1)
            data[at] = draw.randrange(256)
        return bytes(data)

    return change


def description_cases(count: int, seed: int) -> Iterator[Case]:
    """Descriptions with an attribute or an element changed, and such that are no XML."""
    draw = random.Random(seed)
    for name, text in list(TEXTS.items())[:count]:
        yield _case(DESCRIPTION, name, _described(text))
    for k in range(count - len(TEXTS)):
        what = draw.choice(("attribute", "attribute", "attribute", "element", "bytes"))
        change = _CHANGES[what]
        yield _case(DESCRIPTION, f"{what}, {k}", _described(_seeded(change, draw.randrange(2**32))))


def _seeded(change: Callable[[random.Random, str], str], seed: int) -> Callable[[str], str]:
    return lambda text: change(random.Random(seed), text)


def _attribute(draw: random.Random, text: str) -> str:
    """An attribute of any element removed, or set to another value."""
    found = draw.choice(list(re.finditer(r' ([\w:]+)="([^"]*)"', text)))
    others = [m[2] for m in re.finditer(r' ([\w:]+)="([^"]*)"', text) if m[1] == found[1]]
    value = draw.choice([*ATTRIBUTES, *others[:3]])
    made = "" if draw.random() < 0.2 else f' {found[1]}="{value}"'
    return text[: found.start()] + made + text[found.end() :]


def _element(draw: random.Random, text: str) -> str:
    """An element removed, doubled, or called otherwise."""
    found = draw.choice(list(re.finditer(r"<(\w+)[^<>]*?/>", text)))
    made = draw.choice(["", found[0] * 2, found[0].replace(found[1], "Binary", 1), "<x>"])
    return text[: found.start()] + made + text[found.end() :]


def _bytes(draw: random.Random, text: str) -> str:
    data = list(text)
    for _ in range(draw.randint(1, 5)):
        data[draw.randrange(len(data))] = chr(draw.choice([0, 34, 38, 60, 62, 9, 233, 0x1F600]))
    return "".join(data)


_CHANGES: dict[str, Callable[[random.Random, str], str]] = {
    "attribute": _attribute,
    "element": _element,
    "bytes": _bytes,
}
LAUGHS = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 12))
TEXTS: dict[str, Callable[[str], str]] = {
    "empty": lambda text: "",
    "no XML": lambda text: "title = 1",
    "half of it": lambda text: text[: len(text) // 2],
    "another root": lambda text: "<html><body/></html>",
    "a million laughs": lambda text: f'<!DOCTYPE x [<!ENTITY l0 "ha">{LAUGHS}]><x>&l11;</x>',
    "a file from outside": lambda text: (
        '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///dev/zero">]>'
        + re.sub(r"<\?xml.*?\?>", "", text).replace('description="', 'description="&e;', 1)
    ),
    "deep elements": lambda text: "<x>" * 100_000 + "</x>" * 100_000,
    "another alphabet": lambda text: text.replace("UTF-8", "EBCDIC-CP-US", 1),
    "an alphabet that there is not": lambda text: text.replace("UTF-8", "x-nothing", 1),
    "FMI 1.0": lambda text: text.replace('fmiVersion="2.0"', 'fmiVersion="1.0"'),
    "FMI 3.0": lambda text: text.replace('fmiVersion="2.0"', 'fmiVersion="3.0"'),
    "FMI 9.0": lambda text: text.replace('fmiVersion="2.0"', 'fmiVersion="9.0"'),
    "model exchange": lambda text: text.replace("CoSimulation", "ModelExchange"),
    "a whole number of one and a half": lambda text: re.sub(
        r'<Integer([^>]*) start="\d+"', r'<Integer\1 start="1.5"', text
    ),
    "without variables": lambda text: re.sub(
        r"<ModelVariables>.*</ModelVariables>", "<ModelVariables/>", text, flags=re.DOTALL
    ),
    "variables of one name": lambda text: text.replace('name="d2"', 'name="d1"'),
    "an annotation of nonsense": lambda text: text.replace('cost="', 'cost="x'),
    "an annotation without names": lambda text: text.replace("<Set name=", "<Set nome="),
}


def _described(change: Callable[[str], str]) -> Change:
    def made(path: Path) -> bytes:
        number = path.stat().st_ino  # all cases share one file
        if number not in _MEMBERS:
            _MEMBERS[number] = _read(path)
        members = dict(_MEMBERS[number])
        members[XML] = change(members[XML].decode("utf-8")).encode("utf-8")
        return _zipped(members)

    return made


_MEMBERS: dict[int, dict[str, bytes]] = {}


def _case(kind: str, name: str, change: Change) -> Case:
    def apply(folder: Path) -> None:
        path = folder / FMU
        data = change(path)
        path.unlink()  # the file is shared with the other cases
        path.write_bytes(data)

    return Case(kind=kind, name=name, words=COMMAND, change=apply, about=(FMU,), codes=(0, 2, 3))
