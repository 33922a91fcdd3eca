"""What a file is, for people: its layout in words, its columns, and what they seem to be."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fitting.campaign.instruments import PLAIN, foreign_kind, layout_of, read_recording
from fitting.campaign.instruments.recording import Channel, Numbers, Recording, Selection, head_of
from fitting.campaign.instruments.roles import (
    AMPLITUDE,
    PHASE,
    TIME,
    X,
    Y,
    parts_by_name,
    plain_name,
    usual,
    usual_frequency,
)
from fitting.text.errors import BadInput
from fitting.text.notation import how_many
from fitting.text.units import is_frequency, same_kind

ROLES = ("frequency", "amplitude", "phase", "re", "im", "complex", "time")
#: Those of them that are no words.
ROLE_WORDS = {"re": "real part", "im": "imaginary part", "complex": "complex values"}
#: How many times more, of its size, a column varies than one that is held.
FAR_MORE = 10.0
_PHASE_UNITS = ("deg", "rad", "°")
_AMPLITUDE_WORDS = (
    r"ampl|magn|\bmag\b|\bamp\b|level|power|gain|\bs\d\d\b|response|signal|volt|trace"
)


def recognised(path: Path, selection: Selection | None = None) -> Recording:
    """Look at a file: what wrote it, which columns it has, what they seem to be.

    Its channels have a ``role`` of `ROLES`, empty where they seem to be none, and are ``guessed``
    where it comes from the numbers or the unit, and not from a usual name.

    Args:
        path: of the file.
        selection: of one trace, where the file holds several (``trace``, ``chunk``).

    Raises:
        BadInput: no such file, not readable, a kind without columns of numbers, or a table with a
            row that is none; states which kind it is, and what to do.
    """
    selection = selection or Selection()
    layout = layout_of(path, plain_text=selection.header_row is not None)
    recording = read_recording(path, layout, selection)
    roles = _Roles(recording)
    if not recording.headed:
        roles.by_numbers()
    else:
        roles.axis()
        if not roles.complex_values():
            roles.parts()
            if "re" not in roles.given.values():
                roles.sizes()
    channels = tuple(
        replace(c, role=roles.given.get(c.name, ""), guessed=c.name in roles.guessed)
        for c in recording.channels
    )
    axis = next((c for c in channels if c.role in ("frequency", "time")), None)
    unit = f", {axis.unit}" if axis is not None and axis.unit else ""
    return replace(
        recording,
        channels=channels,
        layout=layout,
        words=f"{recording.words}, {how_many(len(recording.places), 'point')}{unit}",
        remarks=tuple(roles.remarks),
    )


class _Roles:
    """Roles of a recording's columns, one after another; each is given once."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.given: dict[str, str] = {}
        self.guessed: set[str] = set()
        self.remarks: list[str] = []

    def _free(self) -> list[Channel]:
        return [c for c in self.recording.channels if c.name not in self.given]

    def _give(self, channel: Channel | None, role: str, *, why: str = "") -> bool:
        if channel is None or channel.name in self.given:
            return False
        self.given[channel.name] = role
        if why:
            self.guessed.add(channel.name)
            self.remarks.append(
                f"column '{channel.name}' is taken for the {ROLE_WORDS.get(role, role)}: {why}"
            )
        return True

    def axis(self) -> None:
        """The frequency: by its usual name, one that rises, or the only one in hertz; or time."""
        recording = self.recording
        time, frequency = usual(recording, TIME), usual_frequency(recording)
        if time is not None and frequency is not None and _rises(time) and not frequency.varies:
            frequency = None  # what a lock-in demodulated at, beside what it recorded
        if self._give(frequency, "frequency"):
            return
        in_hertz = [c for c in recording.channels if c.unit and is_frequency(c.unit)]
        named = [c for c in recording.channels if "freq" in plain_name(c)]
        rising = next((c for c in (*named, *in_hertz) if _rises(c)), None)
        if rising is not None:
            why = "it rises" + (f", and is in {rising.unit}" if rising.unit else "")
            self._give(rising, "frequency", why=why)
            return
        in_seconds = (c for c in recording.channels if c.unit and same_kind(c.unit, "s"))
        if self._give(time or next(in_seconds, None), "time"):
            self.remarks.append("it is a recording over time, not a sweep of the frequency")
        elif len(in_hertz) == 1:  # of a map in rows: it rises anew for each value of the control
            self._give(in_hertz[0], "frequency", why=f"it is the only one in {in_hertz[0].unit}")

    def complex_values(self) -> bool:
        """Complex values, the transmission if there are several."""
        complexes = [c for c in self.recording.channels if c.is_complex]
        through = [c for c in complexes if re.fullmatch(r"[a-z]*\W*2,?1\W*", c.name.lower())]
        chosen = next(iter(through or complexes), None)
        if chosen is None or not self._give(chosen, "complex"):
            return False
        if len(complexes) > 1:
            self.guessed.add(chosen.name)
        return True

    def parts(self) -> None:
        """Real and imaginary part: by usual names, as one quantity, or as their names state."""
        pairs: list[tuple[Channel | None, Channel | None, str]] = []
        if usual(self.recording, AMPLITUDE) is None:
            pairs.append((usual(self.recording, X), usual(self.recording, Y), ""))
        for pair in filter(None, [parts_by_name(self.recording)]):
            pairs.append((*pair, f"{pair[0].name} and {pair[1].name} are parts of one quantity"))
        others = ((channel, _other_part(channel, self._free())) for channel in self._free())
        pairs += [(*pair, "its name means that") for pair in others]
        for x, y, why in pairs:
            if x is not None and y is not None:
                self._give(x, "re", why=why)
                self._give(y, "im", why=why)
                return

    def sizes(self) -> None:
        """Amplitude and phase: by usual names, by words in the name, by the unit, or the rest."""
        for role, names, pattern, units in (
            ("phase", PHASE, r"phase|theta|angle|\barg\b", _PHASE_UNITS),
            ("amplitude", AMPLITUDE, _AMPLITUDE_WORDS, None),
        ):
            lively = [c for c in self._free() if c.varies]
            known = usual(self.recording, names)
            if role == "amplitude" and lively and known is not None and not known.varies:
                known = None  # a channel that was open, next to one that was not
            if self._give(known, role):
                continue
            named = [c for c in lively if re.search(pattern, plain_name(c))]
            in_unit = [c for c in lively if (c.unit in units if units else c.unit is not None)]
            rest = "no other one is left"
            if len(lively) > 1:
                rest = f"it is the first of {len(lively)} that could be it"
            tests = [("its name", named), ("its unit", in_unit)]
            tests += [] if units else [(rest, lively)]
            any(self._give(_livelier(suitable), role, why=why) for why, suitable in tests)

    def by_numbers(self) -> None:
        """Roles of columns without names: frequency first, then what the numbers look like."""
        first, *rest = self.recording.channels
        if not _rises(first):
            self.remarks.append("the file names no columns, and the first one does not rise")
            return
        self._give(first, "frequency", why="it is the first one and rises; no unit is stated")
        if self._give(
            next((c for c in rest if c.is_complex), None), "complex", why="it is complex"
        ):
            return
        a, b = [*map(_numbers, rest[:2]), None, None][:2]
        if a is None or b is None:
            self._give(next(iter(rest), None), "amplitude", why="it is the second one")
            return
        alike = 0.05 < np.ptp(a) / max(np.ptp(b), np.finfo(float).tiny) < 20.0
        if alike and np.min(a) < 0.0 and (np.max(a) > 0.0 or np.min(b) * np.max(b) < 0.0):
            for channel, role in zip(rest, ("re", "im"), strict=False):
                self._give(channel, role, why="second and third column are alike and change sign")
            return
        self._give(rest[0], "amplitude", why="it is the second one and not like the third")
        unit = "rad" if np.max(np.abs(b)) <= 2.0 * np.pi else "deg"
        self._give(rest[1], "phase", why=f"it is the third one; it would be in {unit}")


def _numbers(channel: Channel) -> Numbers | None:
    try:
        values = channel.read()
    except BadInput:
        return None
    return values if values.size and np.all(np.isfinite(values)) else None


def _rises(channel: Channel) -> bool:
    values = None if channel.is_complex else _numbers(channel)
    return values is not None and bool(np.all(np.diff(values) > 0.0))


def _livelier(channels: Sequence[Channel]) -> Channel | None:
    """The first column, if no other one varies far more: a source's level hardly does."""
    spreads = []
    for values in map(_numbers, channels):
        size = 0.0 if values is None else float(np.max(np.abs(values)))
        spreads.append(float(np.ptp(values.real)) / size if values is not None and size else 0.0)
    best = max(spreads, default=0.0)
    lively = (c for c, spread in zip(channels, spreads, strict=True) if spread > best / FAR_MORE)
    return next(lively, None)


_REAL_WORDS = r"real|re|x|i"
_PAIRS = {"real": ("imag", "imaginary", "im"), "re": ("im", "imag"), "x": ("y",), "i": ("q",)}


def _other_part(channel: Channel, free: Sequence[Channel]) -> Channel | None:
    """The imaginary part to a real one by its name: "S21 (REAL)", "re_s21", "X1"."""
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


SUFFIX, USUAL = ".toml", "campaign.toml"
#: Campaigns of a folder that a complaint names.
MOST_NAMED = 4
_FROM_FILES = "fmu-fit init FILE writes one, of a file of measurements"


def other_kind(path: Path) -> BadInput | None:
    """The complaint of a path that is no campaign's; None: nothing shows what it is.

    Args:
        path: of a folder, or of a file that is not TOML.
    """
    if path.is_dir():
        inside = sorted(each for each in path.glob(f"*{SUFFIX}") if each.is_file())
        inside = [each for each in inside if each.name == USUAL] or inside
        names = " or ".join(map(str, inside[:MOST_NAMED])) + ", ..." * (len(inside) > MOST_NAMED)
        wanted = f" in it: {names}" if inside else f", and there is none in it; {_FROM_FILES}"
        return BadInput(f"{path}: is a folder; wanted a campaign{wanted}")
    if path.suffix.lower() == SUFFIX:
        return None
    name = shlex.quote(str(path))
    try:
        kind = foreign_kind(head_of(path)).partition("; ")[0]
        if kind == "an FMU":
            return BadInput(
                f"{path}: is an FMU, not a campaign; fmu-fit init FILE --fmu {name} writes the "
                "campaign, of a file of measurements"
            )
        if kind:
            return BadInput(f"{path}: is {kind}, not a campaign; {_FROM_FILES}")
        if layout_of(path) == PLAIN:
            recognised(path)
    except BadInput:  # no such file, or text of another kind
        return None
    return BadInput(
        f"{path}: is a file of measurements, not a campaign; fmu-fit init {name} writes the "
        "campaign"
    )
