"""Formulas: what they are worth is what `math` says, and no more than arithmetic is read."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from fitting.text.errors import BadInput
from fitting.text.formula import FUNCTIONS, Formula, alike
from fitting.text.units import dimension_of


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a0 + a1*V + a2*V**2", 3.0 + 5.0 * 2.0 - 0.5 * 4.0),
        ("-a0**2", -9.0),
        ("2**3**2", 512.0),
        ("sqrt(a0)*exp(-V)/log(a1)", math.sqrt(3.0) * math.exp(-2.0) / math.log(5.0)),
        ("cos(pi/4) + sin(V) - tan(0.1)", math.cos(math.pi / 4) + math.sin(2.0) - math.tan(0.1)),
        ("acos(0.3) + asin(0.2) + atan(V)", math.acos(0.3) + math.asin(0.2) + math.atan(2.0)),
        ("1/(2*pi*sqrt(a0*a1))", 1.0 / (2.0 * math.pi * math.sqrt(15.0))),
        ("part.mass*1e3", 7000.0),
    ],
)
def test_it_is_worth_what_arithmetic_says(text: str, expected: float) -> None:
    values = {"a0": 3.0, "a1": 5.0, "a2": -0.5, "V": 2.0, "part.mass": 7.0}
    assert float(Formula(text, "law").value(values)) == pytest.approx(expected, rel=1e-15)


def test_arrays_are_worked_out_element_by_element() -> None:
    v = np.array([0.0, 1.0, 4.0])
    assert Formula("k/sqrt(V)", "law").value({"k": 6.0, "V": v}) == pytest.approx(
        [np.inf, 6.0, 3.0]
    )


@pytest.mark.parametrize("text", ["1/V", "log(-1 - V)", "9**9**9**9 + V", "sqrt(-1 + V)", "0/V"])
def test_what_has_no_value_is_not_finite_and_warns_nobody(text: str) -> None:
    assert not np.isfinite(Formula(text, "law").value({"V": 0.0}))


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("__import__('os').system('true')", "wanted a formula of numbers, names"),
        ("open(V)", "there is no function 'open'"),
        ("sqr(V)", "there is no function 'sqr'; did you mean 'sqrt'"),
        ("V[0]", r"found 'V\[0\]'"),
        ("(V).real()", "wanted a formula of"),
        ("V if V else 1", "found .V if V else 1."),
        ("2*lambda**2", "no name can be 'lambda'; wanted another name"),
        ("V ^ 2", r"found 'V \^ 2'"),
        ("sqrt(V, 2)", "wanted a formula of"),
        ("True", "found 'True'"),
        ("'V'", "wanted a formula of"),
        ("a0 +", "found 'a0 +'"),
        ("", "wanted a formula of"),
        ("V + " + "9" * 400, "wanted a number below 1e308"),
        ("V + 1e999", "wanted a number below 1e308"),
        ("V" * 20000, "20000 characters"),
    ],
)
def test_more_than_arithmetic_is_refused_in_a_sentence(text: str, wanted: str) -> None:
    with pytest.raises(BadInput, match=f"^law: .*{wanted.replace('+', '[+]')}"):
        Formula(text, "law")


@pytest.mark.parametrize(
    ("text", "units", "like"),
    [
        ("a0 + a1*V", {"a0": "MHz", "a1": "Hz/mV", "V": "V"}, "Hz"),
        ("1/(2*pi*sqrt(L*C))", {"L": "H", "C": "nF"}, "Hz"),
        ("k/sqrt(C)", {"k": "Hz*F**0.5", "C": "nF"}, "Hz"),
        ("sqrt(a**2 + 2*b**2)", {"a": "Hz", "b": "kHz"}, "1/s"),
        ("T0*exp(-V/V0)", {"T0": "K", "V": "mV", "V0": "V"}, "K"),
        ("pi/4 + a*V", {"a": "rad/V", "V": "V"}, "rad"),
        ("x**(3/2)", {"x": "m"}, "m**1.5"),
    ],
)
def test_its_dimension_follows_from_units(text: str, units: dict[str, str], like: str) -> None:
    assert alike(Formula(text, "law").dimension(units), dimension_of(like, where=""))
    assert not alike(Formula(text, "law").dimension(units), dimension_of("kg", where=""))


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("f + V", r"'f \+ V' adds Hz and V; "),
        ("f + 1", r"'f \+ 1' adds Hz and a plain number; wanted one dimension"),
        ("exp(V)", r"'V' in exp\(...\) is in V; wanted a plain number there"),
        ("f**V", "'V' as a power is in V; "),
        ("f**n", r"'f \*\* n' is a power of Hz; wanted a number as its exponent"),
    ],
)
def test_unlike_things_do_not_add(text: str, wanted: str) -> None:
    with pytest.raises(BadInput, match=wanted):
        Formula(text, "law").dimension({"f": "Hz", "V": "V", "n": "1"})


@pytest.mark.parametrize(
    "law",
    [
        "a + b*V + 3*V**2",
        "sqrt(a**2*cos(V)**2 + b**2*sin(V)**2)",
        "-exp(-V/b)/(1 + V**2) - log(V + a)",
        "V**V + atan(V)*tan(b*V)",
        "asin(V/7) - acos(V**2/9) + (a - V)**0.5",
        "2**V/b",
    ],
)
def test_the_derivative_of_a_law_is_that_of_50_digits(law: str) -> None:
    at = {"a": 2.75, "b": 1.25, "V": 1.5}
    slope = Formula("2*d(f1, V)", "x:", derivatives=True).written_out({"f1": Formula(law, "y:")})
    functions = {name: getattr(mpmath, name) for name in FUNCTIONS}
    with mpmath.workdps(50):
        known = {name: mpmath.mpf(value) for name, value in at.items()}

        def value(v: mpmath.mpf) -> mpmath.mpf:
            return eval(law, {**functions, **known, "V": v})

        exact = float(2 * mpmath.diff(value, known["V"]))
    assert float(slope.value(at)) == pytest.approx(exact, rel=1e-13)


@pytest.mark.parametrize("text", ["d(f1, V)", "d(V, f1)", "d(f1, V, V)", "d(2*f1, V)"])
def test_a_derivative_is_of_a_law_by_a_name_in_it(text: str) -> None:
    laws = {"f1": Formula("a*b", "y:")}
    with pytest.raises(BadInput):
        Formula(text, "x:", derivatives=True).written_out(laws)
    with pytest.raises(BadInput):  # and nothing of other formulas
        Formula(text, "x:")
