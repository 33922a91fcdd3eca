"""How names and numbers are written for people: symbols, SI prefixes, offsets, errors.

Names come from the campaign and the FMU; the rules below are typography and know none of them.
"""

from __future__ import annotations

import html
import math
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal

from fitting.text.arrays import Scalar

#: Units that take a prefix; all others are left as they are.
_TAKES_PREFIX = ("Hz", "V", "A", "m", "N", "s", "W", "J", "Pa", "F", "C", "rad")
_PREFIXES = (
    (1e9, "G"),
    (1e6, "M"),
    (1e3, "k"),
    (1.0, ""),
    (1e-3, "m"),
    (1e-6, "µ"),
    (1e-9, "n"),
    (1e-12, "p"),
    (1e-15, "f"),
)
#: Sizes beyond these have no prefix that spares zeros.
_PREFIXED = (1e-18, 1e13)
#: Units that mean a pure number.
_NO_UNIT = ("", "1", "-", "dimensionless")
_SIGNS = {"plus": "+", "minus": "−"}
_SYMBOL = re.compile(r"([A-Za-z]+?)_?(\d+|(?<=_)[A-Za-z0-9]+)?")
_SUBSCRIPT = str.maketrans("0123456789+−-", "₀₁₂₃₄₅₆₇₈₉₊₋₋")
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: A unit as `prefixed` makes it where no prefix will do.
_POWER_FIRST = re.compile("10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]")
#: A value and its error stand without a power of ten where the larger is at least this, and the
#: error less than that: a long value with a small error keeps its digits.
_PLAIN_FROM, _PLAIN_ERROR = 1e-6, 1e7
#: The largest power of ten that is drawn out of both.
_MOST_EXPONENT = 300
#: Power of ten below which a factor has no full digits, and is zero at last.
_LEAST_POWER = -306
#: Decimal digits that a float tells.
_DIGITS = 15
#: Digits of a value that is told without its error, at least.
_LEAST = 5
#: Numbers below this are written without a power of ten.
_PLAIN_BELOW = 1e9
#: Values whose range is below this share of their size are shown as differences from one of them.
_NARROW = 1e-2
#: Ranges below this share of the size are rounding, not variation.
_CONSTANT = 1e-9
#: Digits of a bound, at least; how much wider a range may be as printed.
_LIMIT, _WIDER = 3, 1.1
#: Share of the upper end of a range below which its lower end is printed as zero.
_NOTHING = 1e-6
#: Times up to so many seconds are printed in a unit of so many.
_TIMES = ((120.0, "s", 1.0), (7200.0, "min", 60.0), (math.inf, "h", 3600.0))


def symbol(name: str) -> tuple[str, str] | None:
    """Letter and index of a name that is one: "eta_plus" (η, +), "D11" (D, 11); else None.

    Args:
        name: of a quantity.
    """
    match = _SYMBOL.fullmatch(name)
    if match is None:
        return None
    letter, index = match[1], match[2] or ""
    if len(letter) > 1:
        size = "CAPITAL" if letter[0].isupper() else "SMALL"
        # Unicode writes the twelfth letter without its b
        spelled = letter.upper().replace("MBD", "MD")
        try:
            letter = unicodedata.lookup(f"GREEK {size} LETTER {spelled}")
        except KeyError:
            return None
    return letter, _SIGNS.get(index, index)


def markup(name: str) -> str:
    """A name as HTML (escaped), spelled as campaigns and commands spell it.

    Args:
        name: of a quantity.
    """
    return f"<code>{html.escape(name)}</code>"


def sign(name: str) -> str:
    """The symbol of a quantity in plain text: "λ₁₂", "f₁"; its name where it has none.

    Args:
        name: of a parameter or an output.
    """
    parts = symbol(name)
    return name if parts is None else f"{parts[0]}{index(parts[1])}"


def signs_words(names: Iterable[str]) -> str:
    """How signs are written: "In files and commands η₊ is eta_plus."; empty where all are plain.

    Args:
        names: of the quantities.
    """
    pairs = []
    for name in names:
        parts = symbol(name)
        if parts is not None and not name.startswith(parts[0] + parts[1]):
            pairs.append(f"{sign(name)} is {name}")
    return f"In files and commands {listed(pairs)}." if pairs else ""


def index(text: str) -> str:
    """An index in plain text: "1" as ₁, "+" as ₊; letters, which have no such signs, as "_fit".

    Args:
        text: the index, without what it stands at.
    """
    low = text.translate(_SUBSCRIPT)
    return f"_{text}" if any(letter.isalpha() for letter in low) else low


def unit_text(unit: str) -> str:
    """A unit in text, empty for pure numbers.

    Args:
        unit: of the values.
    """
    return "" if unit in _NO_UNIT else _MICRO.sub("µ", unit)


def with_unit(what: str, unit: str) -> str:
    """What a head or an axis is of, with its unit behind it where it has one: "f (Hz)", "r".

    Args:
        what: in words.
        unit: as it is shown.
    """
    return f"{what} ({unit_text(unit)})" if unit_text(unit) else what


def in_its_unit(text: str, unit: str) -> str:
    """A number with its unit behind it where it has one: "3.2 Hz", "0.1".

    Args:
        text: the number as it is shown.
        unit: as it is shown.
    """
    return f"{text} {unit_text(unit)}".rstrip()


#: A prefix written as the letter u, or as the Greek letter, which is another character.
_MICRO = re.compile(r"(?<![A-Za-z])u(?=(?:V|A|m|s|Hz|N|W|g|F|H|J|Pa|T|C|rad)\b)|μ")


def prefixed(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which a number of that size reads well: (7e6, "Hz") -> (1e6, "MHz").

    A power of ten stands where numbers would be long without: (2e-6, "rad"), (1e-300, "V").

    Args:
        size: a typical value, which chooses the prefix.
        unit: of the values.
    """
    if not (math.isfinite(size) and size > 0.0):
        return 1.0, unit_text(unit)
    if unit not in _TAKES_PREFIX or not _PREFIXED[0] <= size < _PREFIXED[1]:
        if 1e-3 <= size < 1e6:
            return 1.0, unit_text(unit)
        power = max(3 * math.floor(math.log10(size) / 3.0), _LEAST_POWER)
        return 10.0**power, f"{power_of_ten(power)} {unit_text(unit)}".strip()
    if unit in ("s", "rad") and size >= 1.0:
        return 1.0, unit
    for factor, prefix in _PREFIXES:
        if size >= factor:
            return factor, prefix + unit
    return _PREFIXES[-1][0], _PREFIXES[-1][1] + unit


def hertz(*values_hz: float, digits: int = 9, joined: str = " and ") -> str:
    """Frequencies in Hz, kHz, MHz or GHz, as the largest asks: "6.94016 and 6.94036 MHz".

    Args:
        values_hz: frequencies, Hz.
        digits: significant digits.
        joined: word between the last two.
    """
    factor, unit = prefixed(max([1.0, *map(abs, values_hz)]), "Hz")
    return f"{joined.join(f'{value / factor:.{digits}g}' for value in values_hz)} {unit}"


@dataclass(frozen=True, kw_only=True)
class Scaling:
    """How values are drawn: (value - offset)/factor, in `unit`; `origin` is the offset in words."""

    offset: float
    factor: float
    unit: str
    origin: str = ""

    def __call__(self, value: float) -> float:
        """A value as drawn."""
        return (value - self.offset) / self.factor

    def label(self, what: str) -> str:
        """Axis label: quantity, the named offset, unit.

        Args:
            what: name of the quantity.
        """
        shown = f"{what} − {self.origin}" if self.origin else what
        return f"{shown} ({self.unit})" if self.unit else shown


def scaling_for(values: Iterable[float], unit: str) -> Scaling:
    """Prefix, and offset where values lie close together, so that ticks stay short and readable.

    The offset is a round number within the range: 6940160 to 6940360 Hz is drawn in Hz from
    6.94026 MHz.

    Args:
        values: which share one prefix.
        unit: of the values.
    """
    finite = [v for v in values if math.isfinite(v)]
    size = max((abs(v) for v in finite), default=0.0)
    span = max(finite) - min(finite) if finite else 0.0
    if not _CONSTANT * size < span < _NARROW * size:
        factor, shown = prefixed(size, unit)
        return Scaling(offset=0.0, factor=factor, unit=shown)
    step = 10.0 ** math.floor(math.log10(span / 5.0))
    middle = round(0.5 * (max(finite) + min(finite)) / step) * step
    whole, named = prefixed(abs(middle), unit)
    digits = max(0, round(math.log10(whole / step)))
    origin = f"{middle / whole:.{digits}f}".replace("-", "−") + (f" {named}" if named else "")
    factor, shown = prefixed(span, unit)
    return Scaling(offset=middle, factor=factor, unit=shown, origin=origin)


def power_of_ten(exponent: int) -> str:
    """10⁻³ for -3, as text that needs no markup.

    Args:
        exponent: of ten.
    """
    return f"10{str(exponent).translate(_SUPERSCRIPT)}"


def on_log_axis(value: float) -> str:
    """A tick of a logarithmic axis: 0.1, 1, 10 and 100 as such, else powers of ten.

    Args:
        value: the number.
    """
    if not (math.isfinite(value) and value > 0.0):
        return number(value)
    exponent = math.floor(math.log10(value) + 1e-9)
    mantissa = value / 10.0**exponent
    if -1 <= exponent <= 2:
        return f"{value:.2g}" if value < 100.0 else f"{value:.3g}"
    power = power_of_ten(exponent)
    return power if abs(mantissa - 1.0) < 0.005 else f"{mantissa:.2g}·{power}"


def number(value: float, digits: int = 6) -> str:
    """A number for people: `digits` significant ones, a true minus, powers of ten written out.

    Powers only where the number would be long: 2.8e2 is 280, 7014832.6 to six digits 7014830.

    Args:
        value: the number.
        digits: significant digits.
    """
    if math.isnan(value):
        return "–"
    if value == 0.0:
        return "0"  # without the sign that a zero may carry
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    text = f"{value:.{digits}g}"
    if "e+" in text and abs(value) < _PLAIN_BELOW:
        text = f"{float(text):.0f}"
    mantissa, _, exponent = text.partition("e")
    mantissa = mantissa.replace("-", "−")
    if not exponent:
        return mantissa
    power = power_of_ten(int(exponent))
    return power if mantissa == "1" else f"{mantissa}\u00a0×\u00a0{power}"


def signed_number(value: float, digits: int) -> str:
    """A number with its sign: "+5.2".

    Args:
        value: any number.
        digits: significant ones.
    """
    return f"{'+' if value >= 0.0 else '−'}{number(abs(value), digits)}"


def with_error(value: float, error: float, unit: str = "") -> str:
    """Value ± error, the value rounded where the error's second digit stands, with its unit.

    A power of ten that would fill the number with zeros multiplies both, as one does with which the
    unit begins: "(1.2 ± 0.1) × 10³⁰ 1/s".

    Args:
        value: the number.
        error: standard deviation, in the same unit.
        unit: of the values.
    """
    tail = _tail(unit)
    if not (math.isfinite(error) and error > 0.0 and math.isfinite(value)):
        return number(value, 9) + tail
    size = max(abs(value), error)
    exponent, power = math.floor(math.log10(size)), ""
    plain = size >= _PLAIN_FROM and error < _PLAIN_ERROR
    if _POWER_FIRST.match(unit):
        power = "\u00a0×"
    elif not plain and abs(exponent) <= _MOST_EXPONENT:
        power = f"\u00a0×\u00a0{power_of_ten(exponent)}"
        value, error = value / 10.0**exponent, error / 10.0**exponent
    both = "\u00a0±\u00a0".join(rounded_alike(value, error, error=error))
    return f"({both}){power}{tail}" if power else f"{both}{tail}"


def _tail(unit: str) -> str:
    """A unit behind a number, empty for pure numbers."""
    return f"\u00a0{unit_text(unit)}" if unit_text(unit) else ""


def rounded_alike(value: float, *others: float, error: float) -> tuple[str, ...]:
    """A value and its errors, all rounded where the second digit of an error stands.

    Args:
        value: the number.
        others: its errors.
        error: the smallest of them.
    """
    place = math.floor(math.log10(error)) - 1 if math.isfinite(error) and error > 0.0 else -13
    if not -12 <= place < 6:
        return number(value, 9), *(number(v, 2) for v in others)
    return tuple(
        f"{round(v, -place):.{max(0, -place)}f}".replace("-", "−") for v in (value, *others)
    )


def as_its_error(value: float, error: float, digits: int) -> str:
    """A value by itself, rounded where the second digit of its error stands.

    Args:
        value: the number.
        error: standard deviation, in the same unit.
        digits: significant ones where there is no error, or one beyond all digits of the value.
    """
    if not (math.isfinite(error) and error > 0.0 and math.isfinite(value) and value != 0.0):
        return number(value, digits)
    place = math.floor(math.log10(error)) - 1
    if -12 <= place < 6:
        return rounded_alike(value, error=error)[0]
    return number(value, min(max(1, _digits_to(place, value)), digits))


def error_number(error: float) -> str:
    """An error by itself with two digits, the second one also where it is a zero: "0.60".

    Args:
        error: standard deviation.
    """
    if not (math.isfinite(error) and error > 0.0):
        return number(error, 2)
    if "e-" in f"{error:.2g}":
        mantissa, _, exponent = f"{error:.1e}".partition("e")
        return f"{mantissa}\u00a0×\u00a0{power_of_ten(int(exponent))}"
    return as_its_error(error, error, 2)


def quantity(value: float, error: float, unit: str) -> str:
    """Value ± error with a prefix that suits the value, unless the error were all zeros in it.

    Args:
        value: the number.
        error: standard deviation, in the same unit.
        unit: of the values.
    """
    factor, shown = joint_prefix(value, error, unit)
    return with_error(value / factor, error / factor, shown)


def uneven_quantity(value: float, sides: tuple[float, float], unit: str) -> str:
    """Value +above −below with a prefix that suits the value: "235 +128 −89 Hz".

    All are rounded where the second digit of the smaller side stands.

    Args:
        value: the number.
        sides: how far the error goes below and above it, both positive, in the same unit.
        unit: of the values.
    """
    factor, shown = joint_prefix(value, min(sides), unit)
    written = rounded_alike(value / factor, *(s / factor for s in sides), error=min(sides) / factor)
    best, below, above = written
    tail = _tail(shown)
    whole = f"{best}\u00a0+{above}\u00a0−{below}"
    return f"({whole})\u00a0×{tail}" if _POWER_FIRST.match(shown) else f"{whole}{tail}"


def joint_prefix(value: float, error: float, unit: str) -> tuple[float, str]:
    """Factor and unit that suit a value, unless its error were all zeros in them.

    Args:
        value: the number.
        error: its smallest one, in the same unit.
        unit: of the values.
    """
    factor, shown = prefixed(abs(value), unit)
    return (1.0, unit) if 0.0 < error < 1e-3 * factor else (factor, shown)


def bound(value: float, digits: int = 6, *, up: bool) -> str:
    """A bound for people: as `number`, but never rounded inwards.

    Args:
        value: the bound.
        digits: significant digits.
        up: whether it is an upper one: rounded up, a lower one down.
    """
    return number(_rounded_outwards(value, digits, up=up), digits)


def _rounded_outwards(value: float, digits: int, *, up: bool) -> float:
    """A value rounded up, or down, to some significant digits."""
    if value == 0.0 or not math.isfinite(value):
        return value
    place = math.floor(math.log10(abs(value))) - digits + 1
    return float(_outwards(value, place, up=up))


def _outwards(value: float, place: int, *, up: bool) -> Decimal:
    """A value rounded up, or down, at a power of ten; the 15 digits of a float are taken for it."""
    exact = Decimal(f"{value:.{_DIGITS}g}")
    least = exact.adjusted() - _DIGITS + 1  # beyond these digits nothing is to be rounded
    way = ROUND_CEILING if up else ROUND_FLOOR
    return exact.quantize(Decimal(1).scaleb(max(place, least)), way) + 0  # no sign before a zero


def _digits_to(place: int, value: float) -> int:
    """Significant digits of a value down to a power of ten, as many as a float has."""
    return min(math.floor(math.log10(abs(value))) - place + 1, _DIGITS)


def as_known(value: float, error: float, unit: str = "") -> str:
    """A value alone, with the digits that its error leaves and five at least, and plain spaces.

    Args:
        value: the number.
        error: standard deviation, in the same unit; NaN: unknown.
        unit: of the values.
    """
    digits = _LEAST
    if math.isfinite(error) and error > 0.0 and value != 0.0:
        digits = _digits_to(math.floor(math.log10(error)) - 1, value)
    is_known = digits > _LEAST
    shown = as_its_error(value, error, _DIGITS) if is_known else number(value, _LEAST)
    return f"{shown} {unit}".rstrip().replace("\u00a0", " ")


def span(low: float, high: float, unit: str = "", error: float = math.nan) -> str:
    """An interval, rounded outwards where the third digit of its width stands.

    What is printed holds the interval. Ends that are two to four powers of ten apart have three
    digits each. Ends that belong to different values are known better than the width between them:
    then they are rounded where the second digit of their own error stands.

    Args:
        low: lower end.
        high: upper end.
        unit: of the values.
        error: standard deviation of either end, in the same unit; NaN: the width decides.
    """
    tail = _tail(unit)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        return f"{bound(low, up=False)} to {bound(high, up=True)}{tail}"
    place = math.floor(math.log10(high - low)) - 2
    if math.isfinite(error) and error > 0.0:
        place = min(place, math.floor(math.log10(error)) - 1)
    elif 0.0 < 100.0 * low < high < 1e4 * low:
        return f"{bound(low, 3, up=False)} to {bound(high, 3, up=True)}{tail}"
    if not -12 <= place < 6:
        first, last = (max(_LEAST, _digits_to(place, v)) if v else _LEAST for v in (low, high))
        return f"{bound(low, first, up=False)} to {bound(high, last, up=True)}{tail}"
    ends = (f"{_outwards(v, place, up=v == high):f}" for v in (low, high))
    return f"{' to '.join(end.replace('-', '−') for end in ends)}{tail}"


def signed(value: float, decimals: int) -> str:
    """A number with its sign; what rounds to zero has none.

    Args:
        value: the value.
        decimals: behind the decimal sign.
    """
    text = f"{value:+.{decimals}f}"
    return text[1:] if float(text) == 0.0 else text.replace("-", "−")


def to_accuracy(value: float, accuracy: float) -> str:
    """A number with the digits that its accuracy leaves and one more, nine at most.

    Args:
        value: the number.
        accuracy: relative; NaN: not known.
    """
    known = 0.0 < accuracy < 1.0
    digits = min(9, math.ceil(-math.log10(accuracy)) + 1) if known else 9
    return f"{value:.{digits}g}"


def percent(share: float, digits: int = 2) -> str:
    """A share as a signed percentage.

    Args:
        share: as a part of one.
        digits: significant digits.
    """
    value = 100.0 * share
    # digits before the decimal sign, less one
    places = max(0, int(math.log10(abs(value)))) if value and math.isfinite(value) else 0
    return f"{signed(value, max(0, digits - places))} %"


def probability(p: float) -> str:
    """A probability as "p = 0.02", a tiny one as a bound.

    Args:
        p: probability, 0 to 1.
    """
    return f"p = {p:.1g}" if p >= 1e-12 else "p < 1e-12"


def listed(items: Iterable[str], most: int | None = None) -> str:
    """Words in a row: "a", "a and b", "a, b and c", "a, b and 12 others".

    Args:
        items: words to be listed.
        most: how many are named; None: all.
    """
    words = list(items)
    if most is not None and len(words) > most:
        return f"{', '.join(words[:most])} and {how_many(len(words) - most, 'other')}"
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"


def how_many(count: int | str, noun: str, plural: str = "") -> str:
    """A count with its noun: "1 point", "3 points".

    Args:
        count: or a number that is written already.
        noun: of one.
        plural: of several; empty: with an s.
    """
    return f"{count} {noun if str(count) == '1' else plural or noun + 's'}"


def freedom_words(count: int | str) -> str:
    """A number of degrees of freedom in words.

    Args:
        count: or a number that is written already.
    """
    return how_many(count, "degree of freedom", "degrees of freedom")


def settings_words(settings: Mapping[str, Scalar]) -> str:
    """Settings as "name = value, ...".

    Args:
        settings: values of FMU variables, by name.
    """
    return ", ".join(f"{name} = {scalar_words(value)}" for name, value in settings.items())


def scalar_words(value: Scalar) -> str:
    """A setting as a campaign file writes it.

    Args:
        value: the value.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    return number(value, 12) if isinstance(value, float) else str(value)


def sized(value: float, unit: str, digits: int) -> str:
    """A number in its unit, without an error: "5.2 Hz".

    Args:
        value: in the unit.
        unit: of the value; empty or "1": none.
        digits: significant ones.
    """
    return in_its_unit(number(value, digits), unit)


def with_prefix(value: float, unit: str, digits: int = 3, *, signed: bool = False) -> str:
    """A number under the prefix that suits it, or a power of ten times its unit: "66 ms".

    Args:
        value: in the unit.
        unit: of the value; empty or "1": none.
        digits: significant ones.
        signed: whether a positive one has its sign, as a shift: "+32 kHz".
    """
    factor, shown = (1.0, "") if unit == "1" else prefixed(abs(value), unit)
    times = "× " if shown.startswith("10") else ""
    text = signed_number if signed else number
    return f"{text(value / factor, digits)} {times}{shown}".rstrip()


def range_words(low: float, high: float, unit: str, among: float = 0.0) -> str:
    """An interval with one unit, or one for each end where they are far apart: "1 Hz–1 kHz".

    Args:
        low: lower end.
        high: upper end.
        unit: of both.
        among: largest end of the ranges of that unit next to it, whose prefix is taken where three
            places are enough for this one.
    """
    if not (math.isfinite(low) and math.isfinite(high)):
        return "any value"
    if 0.0 < low < _NOTHING * high:
        low = 0.0
    size = max(abs(low), abs(high))
    factor, shown = prefixed(among if 1e-3 * among < size < among else size, unit)
    if high - low < 1e-3 * factor or not unit_text(unit):
        factor, shown = 1.0, unit_text(unit)
    if 0.0 < low < 1e-2 * high and shown:
        return f"{limit_words(low, unit, up=False)}–{limit_words(high, unit, up=True)}"
    # three digits, or as many as leave the width between both ends about as it is
    first, last, digits = low / factor, high / factor, _LIMIT
    while digits < _DIGITS:
        lower, upper = (
            _rounded_outwards(x, digits, up=up) for x, up in ((first, False), (last, True))
        )
        if upper - lower <= _WIDER * (last - first):
            break
        digits += 1
    between = " to " if low < 0.0 else "–"
    return (
        f"{bound(first, digits, up=False)}{between}{bound(last, digits, up=True)} {shown}".rstrip()
    )


def limit_words(value: float, unit: str, *, up: bool = True) -> str:
    """A bound of three digits, with a prefix that suits it.

    Args:
        value: in the unit.
        unit: of the value.
        up: whether it is an upper one, which is rounded up.
    """
    factor, shown = prefixed(abs(float(f"{value:.{_LIMIT}g}")), unit)
    return f"{bound(value / factor, _LIMIT, up=up)} {shown}".strip()


def duration(seconds: tuple[float, float]) -> str:
    """A range of times in the unit that suits it: "2 to 3 min".

    Args:
        seconds: least and most, s.
    """
    low, high = seconds
    unit, size = next((unit, size) for limit, unit, size in _TIMES if high < limit)
    return f"{two_digits(low / size)} to {two_digits(high / size)} {unit}"


def two_digits(value: float) -> str:
    """A count of two significant digits, without an exponent: "1,200".

    Args:
        value: at least zero.
    """
    if value <= 0.0:
        return "0"
    place = 1 - math.floor(math.log10(value))
    return f"{round(value, place):,.{max(0, place)}f}"
