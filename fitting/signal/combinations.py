"""Lines at combinations of the drive tones, as a nonlinear response has them: 2 u1 - u2."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from fitting.signal.tones import exact
from fitting.text.errors import BadInput, did_you_mean, shown

TERM = re.compile(r"([+-]?)\s*(?:(\d+)\s*\*?\s*)?([^\W\d]\w*)\s*")


#: Highest order of lines of a nonlinear response that sampling keeps off those that are read.
USUAL_ORDER = 9
#: Highest order of harmonics and mixtures that are fitted with tones without whole periods.
HARMONICS = 5
MOST_DIGITS = 3
#: Lines besides those that are read: more cannot be kept off them in any time.
MOST_MIXED = 10**6


@dataclass(frozen=True)
class Combination:
    """A line at sum_i factors[i] f_i of the drive tones f_i; ``text`` as it was written."""

    factors: tuple[int, ...]
    text: str

    @property
    def order(self) -> int:
        """sum_i |factors[i]|: 1 for a tone itself."""
        return sum(map(abs, self.factors))

    def frequency_hz(self, tones_hz: Sequence[float]) -> float:
        """The line's frequency from the tones as they were written, rounded once.

        Args:
            tones_hz: frequencies of the tones, Hz.
        """
        total = sum(k * exact(f) for k, f in zip(self.factors, tones_hz, strict=True))
        return float(total)


def parse_combination(text: str, names: Sequence[str], where: str) -> Combination:
    """Read "2*u1 - u2", whole multiples of the named tones.

    Args:
        text: as it was written.
        names: as they are declared, in their order.
        where: file, row or key, for complaints.

    Raises:
        BadInput: something else, a name that is no tone, or a combination that is nothing.
    """
    factors = dict.fromkeys(names, 0)
    rest = text.strip()
    while rest:
        match = TERM.match(rest)
        if match is None or not (match[1] or rest == text.strip()):
            raise BadInput(f"{where}: found '{text}', wanted a sum of tones as '2*u1 - u2'")
        sign, count, name = match.groups()
        if len(count or "") > MOST_DIGITS:
            raise BadInput(f"{where}: found {shown(text)}, wanted multiples of fewer digits")
        if name not in factors:
            hint = did_you_mean(name, list(names))
            raise BadInput(f"{where}: '{text}' holds '{name}', which is no tone of the drive{hint}")
        factors[name] += (-1 if sign == "-" else 1) * int(count or 1)
        rest = rest[match.end() :]
    if not any(factors.values()):
        raise BadInput(f"{where}: found '{text}', wanted a sum of tones as '2*u1 - u2'")
    return Combination(tuple(factors.values()), text)


def lines_to_read(
    texts: Sequence[str], order: int | None, tones: tuple[str, ...], where: str
) -> tuple[tuple[Combination, ...], int]:
    """Lines to read, and the highest order of lines that the response may hold besides them.

    Without an ``order`` that is 1, a linear response, where only tones are read.

    Args:
        texts: as they were written.
        order: up to which combinations are expected, None for the usual one.
        tones: names of the tones.
        where: file, row or key, for complaints.

    Raises:
        BadInput: no line, one line twice, one beyond the order, or too many in all.
    """
    own = {
        t: Combination(tuple(int(i == k) for i in range(len(tones))), t)
        for k, t in enumerate(tones)
    }
    read = tuple(own[t] if t in own else parse_combination(t, tones, where) for t in texts)
    if not read or len({line.factors for line in read}) < len(read):
        raise BadInput(f"{where}: found {list(texts)}, wanted different lines, one at least")
    highest = max(line.order for line in read)
    if order is None:
        order = 1 if highest == 1 else max(USUAL_ORDER, highest)
    if order < highest:
        raise BadInput(f"{where}: a line of order {highest}, but order = {order}")
    if (2 * order + 1) ** len(tones) > MOST_MIXED:
        raise BadInput(
            f"{where}: order = {order} with {len(tones)} tones is too many lines; wanted "
            f"(2 order + 1)^tones of {MOST_MIXED} at most"
        )
    return read, order


def mixed_lines(tones: int, order: int) -> tuple[tuple[int, ...], ...]:
    """Factors of all lines with sum |k_i| <= ``order``, one of each pair k, -k, without zero.

    Args:
        tones: number of tones.
        order: highest sum of the absolute factors.
    """
    span = range(-order, order + 1)
    return tuple(
        k
        for k in itertools.product(span, repeat=tones)
        if 0 < sum(map(abs, k)) <= order and next(x for x in k if x) > 0
    )


def mixed_hz(tones_hz: Sequence[float], order: int) -> tuple[float, ...]:
    """Positive frequencies of all lines with 2 <= sum |k_i| <= ``order``.

    Args:
        tones_hz: frequencies of the tones, Hz.
        order: highest sum of the absolute factors.
    """
    if order < 2:
        return ()
    mixed = (k for k in mixed_lines(len(tones_hz), order) if sum(map(abs, k)) > 1)
    return tuple(sorted(_positive_hz(tones_hz, mixed)))


def expected_hz(tones_hz: Sequence[float], order: int) -> tuple[float, ...]:
    """Positive frequencies of the lines that a nonlinear response has apart from its tones.

    Of tones close to each other those next to them, sum k_i = 1 as 2 u1 - u2, fall off slowly with
    their order; harmonics and all other mixtures are taken up to order 5 at most.

    Args:
        tones_hz: frequencies of the tones, Hz.
        order: highest sum of the absolute factors of lines next to the tones.
    """
    others = min(order // 2 + 1, HARMONICS)
    lines = (
        k
        for k in mixed_lines(len(tones_hz), order)
        if sum(map(abs, k)) <= others or abs(sum(k)) == 1
    )
    return tuple(sorted(_positive_hz(tones_hz, lines) - set(tones_hz)))


def _positive_hz(tones_hz: Sequence[float], factors: Iterable[tuple[int, ...]]) -> set[float]:
    """Frequencies of lines with these factors of the tones as they were written; none at zero."""
    tones = [exact(f) for f in tones_hz]
    lines = (sum(a * f for a, f in zip(k, tones, strict=True)) for k in factors)
    return {float(abs(f)) for f in lines if f}


def combination_name(factors: Sequence[int], names: Sequence[str]) -> str:
    """Words for factors, positive terms first: "2 u1 - u2" for (2, -1) and (u1, u2).

    Args:
        factors: of the tones, one integer each.
        names: as they are declared, in their order.
    """
    words = ""
    terms = [(k, n) for k, n in zip(factors, names, strict=True) if k]
    for k, name in sorted(terms, key=lambda term: term[0] < 0):
        sign = ("- " if k < 0 else "+ ") if words else ("-" if k < 0 else "")
        words += f"{' ' if words else ''}{sign}{f'{abs(k)} ' if abs(k) > 1 else ''}{name}"
    return words
