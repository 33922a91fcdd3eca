"""How numbers and names are written: read back by plain rules, they say what they were."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from fitting.text import notation

SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def read(text: str) -> float:
    """A written number, read by the rules of typography."""
    plain = text.replace("\u00a0", "").replace("−", "-")
    match = re.fullmatch(r"(?:(-?[\d.]+)×)?10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", plain)
    if match:
        return float(match[1] or 1) * 10.0 ** int(match[2].translate(SUPERSCRIPTS))
    return float(plain)


def read_both(text: str) -> tuple[float, float]:
    """A value and its error out of "1.2 ± 0.1" or "(1.2 ± 0.1) × 10³⁰"."""
    digits, _, power = text.removeprefix("(").partition(")\u00a0×")
    value, error = (read(word) for word in digits.split("\u00a0±\u00a0"))
    factor = read(power) if power else 1.0
    return value * factor, error * factor


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("theta", ("θ", "")),
        ("lambda", ("λ", "")),
        ("eta_plus", ("η", "+")),
        ("D11", ("D", "11")),
        ("Omega_c", ("Ω", "c")),
        ("m", ("m", "")),
        ("mass", None),
        ("q1_hybrid", None),
        ("body.k", None),
        ("", None),
    ],
)
def test_only_letters_with_an_index_become_symbols(
    name: str, expected: tuple[str, str] | None
) -> None:
    assert notation.symbol(name) == expected


def test_every_greek_letter_is_known() -> None:
    letters = (
        "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi omicron pi rho "
        "sigma tau upsilon phi chi psi omega"
    )
    written = "".join((notation.symbol(name) or "?")[0] for name in letters.split())
    assert written == "αβγδεζηθικλμνξοπρστυφχψω"


def test_names_cannot_break_out_of_markup() -> None:
    assert notation.markup("<b>&") == "<code>&lt;b&gt;&amp;</code>"


@given(st.floats(-1e300, 1e300), st.integers(1, 12))
def test_a_number_reads_back_to_its_digits(value: float, digits: int) -> None:
    back = read(notation.number(value, digits))
    assert back == pytest.approx(value, rel=0.51 * 10.0 ** (1 - digits), abs=1e-300)


def test_numbers_without_a_value_are_no_numbers() -> None:
    assert [notation.number(v) for v in (math.nan, math.inf, -math.inf)] == ["–", "∞", "−∞"]


@given(st.floats(-1e9, 1e9), st.floats(1e-9, 1e5))
def test_value_and_error_are_rounded_alike(value: float, error: float) -> None:
    shown, wrong = read_both(notation.with_error(value, error, "Hz").removesuffix("\u00a0Hz"))
    assert abs(shown - value) <= 0.0501 * error + 1e-8 * abs(value)
    assert wrong == pytest.approx(error, rel=0.06)


@given(st.floats(0.1, 9.9), st.floats(0.01, 0.99), st.sampled_from([-40, -14, 9, 31, 120]))
def test_far_from_one_a_power_of_ten_stands_behind_both(
    value: float, error: float, power: int
) -> None:
    """An error of two digits, whatever the power: not "9.95626814 × 10³¹ ± 7.6 × 10²⁹"."""
    scale = 10.0**power
    shown = notation.with_error(value * scale, error * scale, "V")
    assert ")\u00a0×\u00a010" in shown
    best, wrong = read_both(shown.removesuffix("\u00a0V"))
    assert wrong == pytest.approx(error * scale, rel=0.06)
    assert abs(best - value * scale) <= 0.0501 * error * scale
    assert len(shown) < 32


def test_published_style_of_errors() -> None:
    assert notation.with_error(1.94976, 0.0123, "rad").split() == ["1.950", "±", "0.012", "rad"]
    assert notation.with_error(73690.4, 187.0).split() == ["73690", "±", "190"]
    assert notation.quantity(6940210.11, 0.113, "Hz").split() == ["6940210.11", "±", "0.11", "Hz"]
    assert notation.quantity(647412.3, 187.0, "Hz").split() == ["647.41", "±", "0.19", "kHz"]


def test_close_values_are_drawn_from_a_named_one() -> None:
    tones = [6940160.0, 6940360.0, 6940250.0]
    scaling = notation.scaling_for(tones, "Hz")
    assert scaling.label("f") == "f − 6.94026 MHz (Hz)"
    assert [scaling(tone) for tone in tones] == [-100.0, 100.0, -10.0]


@given(
    st.lists(st.floats(-1e12, 1e12), min_size=1, max_size=8),
    st.sampled_from(["Hz", "rad", "1/s", "", "V"]),
)
def test_what_is_drawn_is_what_was_given(values: list[float], unit: str) -> None:
    scaling = notation.scaling_for(values, unit)
    size = max(abs(v) for v in values)
    for value in values:
        back = scaling(value) * scaling.factor + scaling.offset
        assert back == pytest.approx(value, rel=1e-12, abs=1e-12 * size)


@given(st.floats(-1e8, 1e8), st.floats(1e-6, 1e5))
def test_the_named_origin_is_the_offset(middle: float, width: float) -> None:
    values = [middle, middle + width]
    scaling = notation.scaling_for(values, "rad")
    if scaling.origin:
        number, _, unit = scaling.origin.partition(" ")
        factor = {"rad": 1.0, "mrad": 1e-3, "µrad": 1e-6, "nrad": 1e-9}[unit]
        assert read(number) * factor == pytest.approx(scaling.offset, rel=1e-12, abs=1e-300)


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (7e6, "Hz", "MHz"),
        (3e-5, "V", "µV"),
        (1.5e-9, "m", "nm"),
        (591.0, "1/s", "1/s"),
        (7200.0, "s", "s"),
        (6.3, "rad", "rad"),
        (2e-8, "1/s", "10⁻⁹ 1/s"),
        (5.0, "1", ""),
    ],
)
def test_prefixes(value: float, unit: str, shown: str) -> None:
    factor, text = notation.prefixed(value, unit)
    assert text == shown
    assert 0.999 <= value / factor < 1e4


def test_ticks_of_a_logarithmic_axis() -> None:
    ticks = [notation.on_log_axis(v) for v in (1e-9, 0.1, 1.0, 100.0, 1e4, 3e-4)]
    assert ticks == ["10⁻⁹", "0.1", "1", "100", "10⁴", "3·10⁻⁴"]


def test_micro_is_written_in_one_way() -> None:
    assert [notation.unit_text(u) for u in ("uV", "µV", "μV", "us", "V/us")] == [
        *("µV", "µV", "µV", "µs"),
        "V/µs",
    ]
    assert [notation.unit_text(u) for u in ("lum", "unit", "mV")] == ["lum", "unit", "mV"]
    assert notation.with_error(2.0, 0.1, "uV") == notation.with_error(2.0, 0.1, "µV")


def test_signs_of_figures_are_told_where_they_are_not_the_name() -> None:
    said = notation.signs_words(["theta", "eta_plus", "d1", "width_plus"])
    assert [token in said for token in ("θ is theta", "η₊ is eta_plus", "d1", "width")] == [
        *(True, True, False, False)
    ]
    assert notation.signs_words(["d1"]) == ""


def test_a_power_of_ten_before_a_unit_multiplies_value_and_error() -> None:
    shown = notation.quantity(9.958e31, 7.6e29, "1/(m2.s2)").replace("\u00a0", " ")
    assert shown == "(99.58 ± 0.76) × 10³⁰ 1/(m2.s2)"
    assert notation.quantity(9.958e6, 7.6e3, "Hz").replace("\u00a0", " ") == "9.9580 ± 0.0076 MHz"


def test_an_index_is_low_where_it_has_such_signs() -> None:
    assert [notation.index(text) for text in ("1", "+", "−", "12", "fit")] == [
        "₁",
        "₊",
        "₋",
        "₁₂",
        "_fit",
    ]


@st.composite
def ranges(draw: st.DrawFn) -> tuple[float, float, float]:
    """Ends over many magnitudes, close together or far apart, and an error, or none."""
    size = 10.0 ** draw(st.floats(-15.0, 12.0))
    low = draw(st.floats(-1.0, 1.0)) * size
    width = 10.0 ** draw(st.floats(-10.0, 6.0)) * max(abs(low), 1e-3 * size)
    error = draw(st.sampled_from([math.nan, 1e-9, 1e-4, 0.02, 0.3, 5.0])) * width
    return low, low + width, error


def holds(low: float, value: float, high: float) -> bool:
    """Whether a value lies within bounds, which are known to 15 digits: to half of the last one."""
    slack = 5e-15 * max(abs(low), abs(high), abs(value))
    return low - slack <= value <= high + slack


@given(ranges(), st.floats(0.0, 1.0))
def test_a_printed_range_holds_the_computed_one(
    ends: tuple[float, float, float], share: float
) -> None:
    """And any value inside, to the digits of the error that gave the range its own."""
    low, high, error = ends
    first, last = map(read, notation.span(low, high, "", error).split(" to "))
    assert holds(first, low, last)
    assert holds(first, high, last)
    if not math.isnan(error):  # as verdicts print a value beside the range
        error = min(error, 0.1 * (high - low))
        first, last = map(read, notation.span(low, high, "", error).split(" to "))
        value = low + share * (high - low)
        assert holds(first, read(notation.as_known(value, error).replace(" ", "")), last)


@given(ranges())
def test_a_printed_range_is_hardly_wider(ends: tuple[float, float, float]) -> None:
    """By 1 % of its width at each end, or 1 % of the end where those lie decades apart."""
    low, high, _ = ends
    first, last = map(read, notation.span(low, high).split(" to "))
    slack = 4e-15 * max(abs(low), abs(high))
    assert first >= low - max(0.01 * (high - low), 0.01 * abs(low)) - slack
    assert last <= high + max(0.01 * (high - low), 0.01 * abs(high)) + slack


@given(st.floats(-1.0, 1.0), st.floats(-20.0, 20.0), st.integers(3, 7))
def test_printed_bounds_are_never_inside(share: float, power: float, digits: int) -> None:
    value = share * 10.0**power
    assume(value == 0.0 or abs(value) > 1e-300)  # smaller ones have no full digits
    below, above = (read(notation.bound(value, digits, up=up)) for up in (False, True))
    assert holds(below, value, above)
    assert above - below <= 2.0 * 10.0 ** (1 - digits) * abs(value) + 1e-300


@pytest.mark.parametrize(
    ("low", "high", "error", "shown"),
    [
        (49990.119968, 50000.120045, 2.57e-5, "49990.119968 to 50000.120045"),
        (49990.1199681, 50000.1200442, 2.57e-5, "49990.119968 to 50000.120045"),
        (49990.12, 50000.12, math.nan, "49990.1 to 50000.2"),
        (-0.00123, 0.00123, math.nan, "−0.00123 to 0.00123"),
        (0.2, 9.08, math.nan, "0.20 to 9.08"),
        (0.0, 780123.0, math.nan, "0 to 781000"),
        (12.34, 9876.0, math.nan, "12.3 to 9880"),
        (5.0, 5.0, math.nan, "5 to 5"),
    ],
)
def test_ranges_as_they_are_printed(low: float, high: float, error: float, shown: str) -> None:
    assert notation.span(low, high, "", error) == shown
    assert notation.span(low, high, "Hz", error) == f"{shown}\u00a0Hz"


def test_an_error_of_rounding_leaves_the_value_its_plain_digits() -> None:
    """Not "(2 ± 9.3 × 10⁻¹⁷) × 10¹": a power of ten drawn out spares no zeros there."""
    assert notation.with_error(20.0, 9.3e-16).split() == ["20", "±", "9.3", "×", "10⁻¹⁶"]
    assert notation.with_error(7e6, 0.03).split() == ["7000000.000", "±", "0.030"]


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (94.6537216, 0.67, "94.65"),
        (0.28, 0.0057, "0.2800"),
        (-62345.678, 120.0, "−62350"),
        (9.9562681e31, 7.6e29, "9.956 × 10³¹"),
        (6940249.912, 0.24, "6940249.91"),
        (2.5, math.inf, "2.5"),
        (0.0, 0.3, "0"),
    ],
)
def test_a_value_in_a_table_is_as_exact_as_its_error(
    value: float, error: float, shown: str
) -> None:
    assert notation.as_its_error(value, error, 8) == shown


@pytest.mark.parametrize(
    ("count", "words"),
    [(0, "0 points"), (1, "1 point"), (2, "2 points"), ("1", "1 point"), ("1.5", "1.5 points")],
)
def test_one_is_no_plural(count: int | str, words: str) -> None:
    assert notation.how_many(count, "point") == words


def test_a_plural_of_its_own() -> None:
    assert notation.how_many(1, "point lies", "points lie") == "1 point lies"
    assert notation.how_many(3, "point lies", "points lie") == "3 points lie"
    assert notation.freedom_words("1").startswith("1 degree ")
    assert notation.freedom_words(9).startswith("9 degrees ")


@pytest.mark.parametrize(
    ("error", "shown"),
    [
        (0.6, "0.60"),
        (0.604, "0.60"),
        (1.0, "1.0"),
        (23.0, "23"),
        (0.996, "1.00"),
        (523.0, "520"),
        (6e-9, "6.0\u00a0×\u00a010⁻⁹"),
        (0.0, "0"),
        (math.nan, "–"),
    ],
)
def test_an_error_has_two_digits(error: float, shown: str) -> None:
    """A column of errors said 0.6 where its value stood to two digits behind the point."""
    assert notation.error_number(error) == shown


@pytest.mark.parametrize(
    ("share", "text"),
    [(-4e-5, "0.00 %"), (4e-5, "0.00 %"), (-6e-5, "−0.01 %"), (0.0534, "+5.34 %")],
)
def test_a_share_that_rounds_to_zero_has_no_sign(share: float, text: str) -> None:
    assert notation.percent(share) == text


def test_ranges_next_to_each_other_have_one_prefix() -> None:
    """Not mHz beside Hz; but where three places are not enough each has its own."""
    assert notation.range_words(-0.405, 0.584, "Hz") == "−405 to 584 mHz"
    assert notation.range_words(-0.405, 0.584, "Hz", 1.37) == "−0.405 to 0.584 Hz"
    assert notation.range_words(-1.37, 0.532, "Hz", 1.37) == "−1.37 to 0.532 Hz"
    assert notation.range_words(0.4, 0.584, "Hz", 7e6) == "400–584 mHz"


@pytest.mark.parametrize(
    ("low", "high", "unit", "text"),
    [
        (999_900.0, 1_000_100.0, "Hz", "999900–1000100 Hz"),
        (7_126_408.4, 7_127_608.4, "Hz", "7.1264–7.1277 MHz"),
        (6_940_160.0, 6_940_360.0, "Hz", "6940160–6940360 Hz"),
        (7020.0, 7.03e6, "1", "7020–7030000"),
        (1.0, 1000.0, "Hz", "1 Hz–1 kHz"),
        (0.0, 781_500.0, "Hz", "0–782 kHz"),
        (6_940_260.0, 7_027_600.0, "Hz", "6.94–7.03 MHz"),
        (-206_110.0, -204_730.0, "Hz/V", "−206200 to −204700 Hz/V"),
        (2.0, 2.0, "Hz", "2–2 Hz"),
    ],
)
def test_the_ends_of_a_range_differ_as_printed(
    low: float, high: float, unit: str, text: str
) -> None:
    """Bounds 200 Hz apart at 1 MHz were "1e+06-1e+06 Hz", those of a quality "7020-7.03e+06"."""
    assert notation.range_words(low, high, unit) == text
