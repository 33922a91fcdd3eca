"""What a file is, said to people: its layout in words, its columns, and what they seem to be."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fitting.campaign.instruments import layout_in, read_recording
from fitting.campaign.instruments.recording import Channel, Numbers, Recording
from fitting.campaign.instruments.roles import (
    AMPLITUDE,
    FREQUENCY,
    PHASE,
    TIME,
    X,
    Y,
    parts_by_name,
    plain_name,
    usual,
)
from fitting.campaign.instruments.trace import Selection
from fitting.text.errors import BadInput
from fitting.text.notation import how_many
from fitting.text.units import is_frequency, same_kind

ROLES = ("frequency", "amplitude", "phase", "re", "im", "complex", "time")
#: Those of them that are no words.
ROLE_WORDS = {"re": "real part", "im": "imaginary part", "complex": "complex values"}
#: How many times more, of its size, a column varies than one that is held.
FAR_MORE = 10.0
#: Why a column is taken for which nothing else speaks.
NO_OTHER = "no other one is left"
_PHASE_UNITS = ("deg", "rad", "°")


@dataclass(frozen=True, kw_only=True)
class FoundColumn:
    """A column: its name, its unit (None: the file tells none), and its role, one of `ROLES`.

    ``role`` is empty for a column that seems to be none of these; ``guessed`` says whether the role
    comes from the numbers or the unit, and not from a usual name.
    """

    name: str
    unit: str | None
    role: str = ""
    guessed: bool = False


@dataclass(frozen=True, kw_only=True)
class Recognised:
    """A file as it was recognised.

    ``layout`` is its name in a campaign; ``words`` say it to people, as "Touchstone, 1 port, S11,
    201 points, GHz"; ``remarks`` are sentences about what was guessed, and what else is there.
    """

    path: Path
    layout: str
    words: str
    columns: tuple[FoundColumn, ...]
    points: int
    remarks: tuple[str, ...] = ()

    def role(self, name: str) -> FoundColumn | None:
        """The column of a role, or None.

        Args:
            name: one of `ROLES`.
        """
        return next((c for c in self.columns if c.role == name), None)

    @property
    def is_sweep(self) -> bool:
        """Whether it seems to hold a response over frequency."""
        seen = any(self.role(name) for name in ("amplitude", "re", "complex"))
        return self.role("frequency") is not None and seen

    @property
    def is_complex(self) -> bool:
        """Whether it seems to hold complex values, or amplitude and phase."""
        both = self.role("amplitude") is not None and self.role("phase") is not None
        return self.role("complex") is not None or self.role("re") is not None or both

    @property
    def without_unit(self) -> tuple[str, ...]:
        """Roles whose column tells no unit: the campaign has to, as "column 1 (Hz)"."""
        return tuple(c.role for c in self.columns if c.role and c.unit is None)

    @property
    def selection(self) -> Selection:
        """Names of the columns as they seem to be, for `read_trace` and `read_complex`."""
        names = {c.role: c.name for c in self.columns}
        return Selection(
            frequency=names.get("frequency", ""),
            amplitude=names.get("complex") or names.get("amplitude", ""),
            phase=names.get("phase", ""),
            x=names.get("re", ""),
            y=names.get("im", ""),
        )


def recognised(path: Path, selection: Selection | None = None) -> Recognised:
    """Look at a file: what wrote it, which columns it has, what they seem to be.

    Args:
        path: of the file.
        selection: of one trace, where the file holds several (``trace``, ``chunk``).

    Raises:
        BadInput: no such file, not readable, a kind without columns of numbers, or a table with a
            row that is none; says which kind it is, and what to do.
    """
    selection = selection or Selection()
    layout = layout_in(path, selection)
    recording = read_recording(path, layout, selection)
    roles = _Roles(recording)
    roles.find()
    columns = tuple(
        FoundColumn(
            name=c.name,
            unit=c.unit,
            role=roles.found.get(c.name, ""),
            guessed=c.name in roles.guessed,
        )
        for c in recording.channels
    )
    axis = next((c for c in columns if c.role in ("frequency", "time")), None)
    unit = f", {axis.unit}" if axis is not None and axis.unit else ""
    points = len(recording.places)
    return Recognised(
        path=path,
        layout=layout,
        words=f"{recording.words}, {how_many(points, 'point')}{unit}",
        columns=columns,
        points=points,
        remarks=tuple(roles.remarks),
    )


class _Roles:
    """Roles of a recording's columns, one after another; each is given once."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.found: dict[str, str] = {}
        self.guessed: set[str] = set()
        self.remarks: list[str] = []

    def find(self) -> None:
        if not self.recording.headed:
            self._by_numbers()
            return
        self._axis()
        self._complex()
        if "complex" not in self.found.values():
            self._parts()
        self._sizes()

    def _free(self) -> list[Channel]:
        return [c for c in self.recording.channels if c.name not in self.found]

    def _give(self, channel: Channel | None, role: str, *, why: str = "") -> bool:
        if channel is None or channel.name in self.found:
            return False
        self.found[channel.name] = role
        if why:
            self.guessed.add(channel.name)
            self.remarks.append(
                f"column '{channel.name}' is taken for the {ROLE_WORDS.get(role, role)}: {why}"
            )
        return True

    def _axis(self) -> None:
        recording = self.recording
        time = usual(recording, TIME)
        held = usual(recording, FREQUENCY)
        if time is not None and held is not None and _rises(time) and not _varies(held):
            held = None  # what a lock-in demodulated at, beside what it recorded
        if self._give(held, "frequency"):
            return
        in_hertz = [c for c in recording.channels if c.unit and is_frequency(c.unit)]
        named = [c for c in recording.channels if "freq" in plain_name(c)]
        rising = [c for c in (*named, *in_hertz) if _rises(c)]
        if rising:
            why = "it rises" + (f", and is in {rising[0].unit}" if rising[0].unit else "")
            self._give(rising[0], "frequency", why=why)
            return
        in_seconds = [c for c in recording.channels if c.unit and same_kind(c.unit, "s")]
        time = time or next(iter(in_seconds), None)
        if self._give(time, "time"):
            self.remarks.append("it is a recording over time, not a sweep of the frequency")
        elif len(in_hertz) == 1:  # of a map in rows: it rises anew for each value of the control
            self._give(in_hertz[0], "frequency", why=f"it is the only one in {in_hertz[0].unit}")

    def _complex(self) -> None:
        complexes = [c for c in self.recording.channels if c.is_complex]
        through = [c for c in complexes if re.fullmatch(r"[a-z]*\W*2,?1\W*", c.name.lower())]
        chosen = next(iter(through or complexes), None)
        others = ", ".join(c.name for c in complexes if c is not chosen)
        if self._give(chosen, "complex") and others and chosen is not None:
            self.guessed.add(chosen.name)
            self.remarks.append(f"{chosen.name} is taken; there is also {others}")

    def _parts(self) -> None:
        x, y = usual(self.recording, X), usual(self.recording, Y)
        if x is not None and y is not None and usual(self.recording, AMPLITUDE) is None:
            self._give(x, "re")
            self._give(y, "im")
            return
        pair = parts_by_name(self.recording)
        if pair is not None:
            why = f"{pair[0].name} and {pair[1].name} are the two parts of one quantity"
            self._give(pair[0], "re", why=why)
            self._give(pair[1], "im", why=why)
            return
        for channel in self._free():
            other = _other_part(channel, self._free())
            if other is not None:
                self._give(channel, "re", why="its name means the real part")
                self._give(other, "im", why="its name means the imaginary part")
                return

    def _sizes(self) -> None:
        if "complex" in self.found.values() or "re" in self.found.values():
            return
        tests: Sequence[tuple[str, Callable[[Channel], bool]]] = (
            ("its name", lambda c: bool(re.search(r"phase|theta|angle|\barg\b", plain_name(c)))),
            ("its unit", lambda c: c.unit in _PHASE_UNITS),
        )
        if not self._give(usual(self.recording, PHASE), "phase"):
            self._first("phase", tests)
        if not self._give(usual(self.recording, AMPLITUDE), "amplitude"):
            words = (
                r"ampl|magn|\bmag\b|\bamp\b|level|power|gain|\bs\d\d\b|response|signal|volt|trace"
            )
            self._first(
                "amplitude",
                (
                    ("its name", lambda c: bool(re.search(words, plain_name(c)))),
                    ("its unit", lambda c: c.unit is not None),
                    (NO_OTHER, lambda c: True),
                ),
            )

    def _first(self, role: str, tests: Sequence[tuple[str, Callable[[Channel], bool]]]) -> None:
        for why, suits in tests:
            found = [c for c in self._free() if suits(c) and _varies(c)]
            if why == NO_OTHER and len(found) > 1:
                why = f"it is the first of {len(found)} that could be it"
            if self._give(_livelier(found), role, why=why):
                return

    def _by_numbers(self) -> None:
        """Roles of columns without names: frequency first, then what the numbers look like."""
        first, *rest = self.recording.channels
        if not _rises(first):
            self.remarks.append("the file names no columns, and the first one does not rise")
            return
        self._give(first, "frequency", why="it is the first one and rises; no unit is stated")
        complexes = [c for c in rest if c.is_complex]
        if complexes:
            self._give(complexes[0], "complex", why="its values are complex")
            return
        if len(rest) == 1:
            self._give(rest[0], "amplitude", why="it is the second one")
        elif len(rest) > 1:
            self._two(rest[0], rest[1])

    def _two(self, second: Channel, third: Channel) -> None:
        a, b = _numbers(second), _numbers(third)
        if a is None or b is None:
            self._give(second, "amplitude", why="it is the second one")
            return
        alike = 0.05 < np.ptp(a) / max(np.ptp(b), np.finfo(float).tiny) < 20.0
        if alike and np.min(a) < 0.0 and (np.max(a) > 0.0 or np.min(b) * np.max(b) < 0.0):
            self._give(second, "re", why="second and third column are alike and change sign")
            self._give(third, "im", why="second and third column are alike and change sign")
            return
        self._give(second, "amplitude", why="it is the second one and not like the third")
        unit = "rad" if np.max(np.abs(b)) <= 2.0 * np.pi else "deg"
        self._give(third, "phase", why=f"it is the third one; it would be in {unit}")


def _numbers(channel: Channel) -> Numbers | None:
    try:
        values = channel.read()
    except BadInput:
        return None
    return values if values.size and np.all(np.isfinite(values)) else None


def _rises(channel: Channel) -> bool:
    values = None if channel.is_complex else _numbers(channel)
    return values is not None and bool(np.all(np.diff(values) > 0.0))


def _varies(channel: Channel) -> bool:
    values = _numbers(channel)
    return values is not None and bool(np.any(values != values[0]))


def _livelier(channels: Sequence[Channel]) -> Channel | None:
    """The first column, if no other one varies far more: a source's level hardly does."""
    spreads = [_spread(c) for c in channels]
    best = max(spreads, default=0.0)
    lively = (c for c, spread in zip(channels, spreads, strict=True) if spread > best / FAR_MORE)
    return next(lively, None)


def _spread(channel: Channel) -> float:
    values = _numbers(channel)
    if values is None:
        return 0.0
    sizes = np.abs(values)
    return float(np.ptp(values.real) / np.max(sizes)) if np.max(sizes) > 0.0 else 0.0


_REAL_WORDS = r"real|re|x|i"
_PAIRS = {"real": ("imag", "imaginary", "im"), "re": ("im", "imag"), "x": ("y",), "i": ("q",)}


def _other_part(channel: Channel, free: Sequence[Channel]) -> Channel | None:
    """The imaginary part to a real one whose name says so: "S21 (REAL)", "re_s21", "X1"."""
    key = _letters(channel)
    for match in re.finditer(rf"(?<![a-z])({_REAL_WORDS})(?![a-z])", key):
        for partner in _PAIRS[match[1]]:
            wanted = key[: match.start(1)] + partner + key[match.end(1) :]
            other = next((c for c in free if c is not channel and _letters(c) == wanted), None)
            if other is not None:
                return other
    return None


def _letters(channel: Channel) -> str:
    unit = (channel.unit or "").lower()
    marks = unit if re.fullmatch(r"real|re|imag|imaginary|im", unit) else ""
    return re.sub(r"[^a-z0-9]+", " ", f"{channel.name} {marks}".lower()).strip()
