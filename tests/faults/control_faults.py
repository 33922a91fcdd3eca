"""Faults of laws, and of control sweeps: formulas, coefficients, columns and points of maps."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from tests.faults import curve_scenes as scenes
from tests.faults.curve_scenes import (
    MAP,
    Change,
    Corrupted,
    Fault,
    Tables,
    Told,
    celled,
    renamed,
    rows_of,
    said,
    without,
)
from tests.faults.scene import CAMPAIGN


def faults() -> Iterator[Fault]:
    """All of them."""
    yield from law_faults()
    yield from coefficient_faults()
    yield from control_column_faults()
    yield from map_faults()
    yield from control_key_faults()


# --- laws ------------------------------------------------------------------------------------


def _law(text: object, target: str = "eta_plus") -> Change:
    """Another law; what it does not name any more is kept busy by a second one."""

    def change(tables: Tables) -> None:
        tables["laws"] = {"d2": "d1 + 0*e0 + 0*e1*V/V0", target: text}
        tables["fmu"]["start"].pop("d2")

    return change


#: Formula, and what is said of it.
FORMULAS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "an unknown name": ("e0 + e1*W/V0", ("'W' is neither a parameter nor a constant",)),
    "a name misspelt": ("e0 + e1*V/V00", ("'V00'", "did you mean 'V0'")),
    "a coefficient misspelt": ("e00 + e1*V/V0", ("'e00'", "did you mean 'e0'")),
    "nothing named": ("322", ("'322' names nothing", "wanted a parameter or a control quantity")),
    "only pi": ("100*pi", ("'100*pi' names nothing", "wanted a parameter")),
    "units added": ("e0 + V", ("adds Hz and V", "wanted one dimension")),
    "units of the result": ("e0*e1*V/V0", ("is in Hz²", "wanted Hz", "'eta_plus'")),
    "volts": ("V", ("is in V", "wanted Hz", "'eta_plus'")),
    "a plain number": ("e0/e1 + V/V0", ("is a plain number", "wanted Hz")),
    "a constant without unit": ("e0 + e1*V/V0 + 3", ("adds Hz and a plain number",)),
    "a sine of volts": ("e0 + e1*sin(V)", ("'V' in sin(...) is in V", "wanted a plain number")),
    "a power of volts": ("e0*2**V", ("'V' as a power is in V", "wanted a plain number")),
    "a fitted power": ("e0**(V/V0)", ("power of Hz", "wanted a number as its exponent")),
    "division by zero": ("e0 + e1*V0/V", ("no finite value", "V (V) = 0")),
    "a root of less than zero": ("e0 + e1*sqrt(V/V0)", ("no finite value", "V (V) = -1")),
    "a logarithm of zero": ("e0 + e1*log(V/V0)", ("no finite value", "V (V) = -1")),
    "an arc of more than one": ("e0 + e1*acos(V/V0)", ("no finite value", "V (V) = 2")),
    "an exponential too large": ("e0 + e1*exp(1000*V/V0)", ("no finite value", "V (V) = 1")),
    "zero over zero": ("e0*(V/V0)/(V/V0)", ("no finite value", "V (V) = 0")),
    "nan as a name": ("e0 + nan*e1", ("'nan' is neither a parameter nor a constant",)),
    "inf as a name": ("e0 + inf*e1", ("'inf' is neither a parameter nor a constant",)),
    "1e999": ("e0 + 1e999*e1", ("found inf", "wanted a number below 1e308")),
    "a caret": ("e0 + e1*(V/V0)^2", ("(V / V0) ^ 2", "+ - * / **")),
    "an unknown function": ("e0 + e1*sine(V/V0)", ("no function 'sine'", "did you mean 'sin'")),
    "numpy's function": ("e0 + e1*np.sin(V/V0)", ("np.sin(V / V0)", "wanted a formula of")),
    "two arguments": ("e0 + e1*sqrt(V, V0)", ("sqrt(V, V0)", "wanted a formula of")),
    "no argument": ("e0 + e1*sqrt()", ("sqrt()", "wanted a formula of")),
    "an open bracket": ("e0 + (e1*V/V0", ("'e0 + (e1*V/V0'", "wanted a formula of")),
    "nothing": ("", ("''", "wanted a text")),
    "blanks": ("  ", ("' '", "wanted a text")),
    "an equation": ("eta_plus = e0", ("'eta_plus = e0'", "wanted a formula of")),
    "a comparison": ("e0 if V > V0 else e1", ("wanted a formula of",)),
    "a keyword as a name": ("e0 + e1*lambda/V0", ("no name can be 'lambda'",)),
    "a decimal comma": ("e0 + 0,5*e1", ("wanted a formula of",)),
    "a unit behind a number": ("e0 + 3 Hz", ("'e0 + 3 Hz'", "wanted a formula of")),
    "a text in it": ("e0 + 'V'", ("wanted a formula of",)),
    "an import": ("__import__('os').getcwd()", ("wanted a formula of",)),
    "an index": ("e0 + e1*V[0]/V0", ("V[0]", "wanted a formula of")),
    "a matrix product": ("e0 @ e1", ("e0 @ e1", "wanted a formula of")),
    "too long": ("e0" + " + e1*V/V0" * 200, ("characters, wanted 1000 at most",)),
    "the target itself": ("eta_plus + e1*V/V0", ("'eta_plus'", "wanted")),
}


def law_faults() -> Iterator[Fault]:
    """Formulas, and what they are given to."""
    for name, (text, says) in FORMULAS.items():
        yield Fault(
            f"law: {name}", scenes.control(_law(text)), (CAMPAIGN, "[laws] eta_plus", *says)
        )
    targets = {
        "eta_plas": ("no variable 'eta_plas'", "did you mean 'eta_plus'"),
        "q1_hybrid": ("'q1_hybrid'", "causality output", "cannot be set"),
        "d1": ("'d1' is fitted and also set by [laws]",),
        "theta": ("'theta' is given by a law and also set by [fmu.start]", "wanted one"),
        "u1": ("'u1' is given by a law and also set by [drive]", "wanted one of them"),
        "A1": ("'A1' is given by a law and also set by [drive]", "wanted one of them"),
        "reflection": ("'reflection' is a Boolean variable", "wanted a Real one"),
        "solver": ("'solver' is an Integer variable", "wanted a Real one"),
        "V": ("'V' is given by a law and also set by [control_sweep]", "wanted one of them"),
        "e0": ("no variable 'e0'", "there is: "),
    }
    for target, says in targets.items():
        made = scenes.control(_law("e0 + e1*V/V0", target))
        yield Fault(f"law: of {target}", made, (CAMPAIGN, "law", *says))
    values: Mapping[str, Any] = {
        "a number": 3.0,
        "a Boolean": True,
        "a list": ["e0"],
        "a table": {},
    }
    for name, value in values.items():
        made = scenes.control(_law(value))
        yield Fault(f"law: {name}", made, (CAMPAIGN, "laws", "eta_plus", "wanted"))


def coefficient_faults() -> Iterator[Fault]:
    """Constants and parameters that laws name."""
    constants: Mapping[str, tuple[Any, tuple[str, ...]]] = {
        "no number": ("one volt", ("'one volt'", "wanted a number")),
        "a Boolean": (True, ("True", "wanted a number")),
        "nan": (float("nan"), ("nan", "wanted a finite number")),
        "an unknown unit": ("1 Vv", ("no unit 'Vv'",)),
        "another unit": ("1 Hz", ("adds", "wanted one dimension")),
        "zero": ("0 V", ("no finite value",)),
        "without unit": (1.0, ("adds Hz and", "wanted one dimension")),
    }
    for name, (value, says) in constants.items():

        def changed(tables: Tables, value: Any = value) -> None:
            tables["constants"]["V0"] = value

        yield Fault(f"constant: {name}", scenes.control(changed), (CAMPAIGN, *says))
    further: Mapping[str, tuple[Change, tuple[str, ...]]] = {
        "a constant that no law names": (
            lambda t: t["constants"].update({"V1": "1 V"}),
            ("the constant 'V1' is named by no law", "did you mean 'V'"),
        ),
        "a constant that is a parameter": (
            lambda t: t["constants"].update({"e0": "322 Hz"}),
            ("'e0'", "wanted"),
        ),
        "a constant that is the control": (
            lambda t: t["constants"].update({"V": "1 V"}),
            ("'V'", "wanted"),
        ),
        "a coefficient that is missing": (lambda t: t["parameters"].pop(), ("'e1' is neither",)),
        "a coefficient without unit": (
            lambda t: t["parameters"][2].update({"lower": -10.0, "upper": 10.0, "start": 2.0}),
            ("parameters 'e1'", "has no unit", 'wanted unit = "Hz/V"'),
        ),
        "a coefficient of an unknown unit": (
            lambda t: t["parameters"][2].update({"start": "2 Hzz"}),
            ("parameters 'e1'", "no unit 'Hzz'"),
        ),
        "a coefficient that no law names": (
            lambda t: t["parameters"].append({**t["parameters"][2], "name": "e2"}),
            ("parameters 'e2'", "no variable 'e2', and no law names it", "there is: V, V0, e0"),
        ),
        "laws without anything": (
            lambda t: t.update({"laws": {}}),
            ("the constant 'V0' is named by no law",),
        ),
        "no laws": (
            lambda t: (t.pop("laws"), t.pop("constants"), t["parameters"].pop()),
            ("parameters 'e0'", "no variable 'e0'", "there is: A1"),
        ),
    }
    for name, (change, says) in further.items():
        without = name in ("laws without anything", "no laws")  # the control is unknown as well
        yield Fault(f"laws: {name}", scenes.control(change), says, 2 if without else 1)


# --- maps over a control ---------------------------------------------------------------------


def _map(**columns: Sequence[float | str]) -> dict[str, Sequence[float | str]]:
    """The map with columns in the place of others: V, f, a; a header after it with a colon."""
    whole: dict[str, Sequence[float | str]] = dict(scenes.map_columns())
    names = dict(zip("Vfa", whole, strict=True))
    return {header: columns.get(short, whole[header]) for short, header in names.items()}


def control_column_faults() -> Iterator[Fault]:
    """The column of the control quantity."""
    whole = _map()
    size = len(whole["V (V)"])
    columns: Corrupted = {
        "constant": (_map(V=[2.0] * size), ("one spectrum, at 2 V", "wanted several values of V")),
        "constant, one spectrum": (
            rows_of(_map(V=[2.0] * size), range(13)),
            ("one spectrum, at 2 V", "wanted several values of V"),
        ),
        "nan": (celled(whole, "V (V)", 4, "nan"), ("row 6, column 'V'", "'nan'", "wanted")),
        "a text": (celled(whole, "V (V)", 4, "high"), ("row 6, column 'V'", "'high'", "wanted")),
        "empty": (celled(whole, "V (V)", 4, ""), ("row 6, column 'V'", "''", "wanted")),
        "a decimal comma": (celled(whole, "V (V)", 4, '"1,5"'), ("row 6, column 'V'", "'1,5'")),
        "without unit": (renamed(whole, "V (V)", "V"), ("column 'V' has no unit",)),
        "in an unknown unit": (renamed(whole, "V (V)", "V (Vv)"), ("'V'", "no unit 'Vv'")),
        "in decibels": (
            renamed(whole, "V (V)", "V (dBm)"),
            ("row 2", "'V'", "'dBm'", "a linear one"),
        ),
        "missing": (without(whole, "V (V)"), ("no column 'V'",)),
        "of another name": (renamed(whole, "V (V)", "U (V)"), ("no column 'V'",)),
        "a value for each row": (
            _map(V=np.linspace(0.0, 1.0, size).tolist()),
            ("52 values of V", "1 point", "wanted at least 8"),
        ),
        "noisy": (
            _map(V=[v + 1e-4 * i for i, v in enumerate(scenes.map_columns()["V (V)"])]),
            ("52 values of V", "1 point", "wanted at least 8"),
        ),
        "exchanged with the frequency": (
            _map(V=whole["frequency (Hz)"], f=whole["V (V)"]),
            ("wanted",),
        ),
    }
    for name, (made, says) in columns.items():
        yield Fault(f"control column: {name}", scenes.control(None, made), (MAP, *says))


def map_faults() -> Iterator[Fault]:
    """Points of maps."""
    whole = _map()
    rows = list(range(52))
    f, a = "frequency (Hz)", "amplitude (V)"
    columns: Corrupted = {
        "a point twice": (
            rows_of(whole, [*rows[:5], 4, *rows[5:]]),
            ("row 7", "frequency 312 Hz follows 312 Hz", "wanted strictly rising"),
        ),
        "a spectrum twice": (
            rows_of(whole, [*rows, *rows[:13]]),
            ("row 54", "wanted strictly rising"),
        ),
        "a spectrum downwards": (
            rows_of(whole, [*rows[12::-1], *rows[13:]]),
            ("row 3", "wanted strictly rising"),
        ),
        "two points exchanged": (
            rows_of(whole, [0, 1, 3, 2, *rows[4:]]),
            ("row 5", "frequency 302", "follows 307", "wanted strictly rising"),
        ),
        "rows shuffled": (
            rows_of(whole, random.Random(1).sample(rows, 52)),
            ("wanted strictly rising",),
        ),
        "one point of a spectrum": (
            rows_of(whole, [0, *rows[13:]]),
            ("the spectrum at -1 V", "1 point", "wanted at least 8"),
        ),
        "seven points of a spectrum": (
            rows_of(whole, [*rows[:7], *rows[13:]]),
            ("the spectrum at -1 V", "7 points", "wanted at least 8"),
        ),
        "a single point": (rows_of(whole, [0]), ("one spectrum, at -1 V", "wanted several")),
        "no points": (rows_of(whole, []), ("wanted rows of numbers",)),
        "a hole": (celled(whole, a, 20, ""), ("row 22, column 'amplitude'", "''", "wanted")),
        "a hole told as nan": (celled(whole, a, 20, "nan"), ("row 22, column 'amplitude'",)),
        "a hole told as a dash": (
            celled(whole, a, 20, "-"),
            ("row 22, column 'amplitude'", "'-'"),
        ),
        "a frequency empty": (celled(whole, f, 20, ""), ("row 22, column 'frequency'", "''")),
        "a negative frequency": (
            celled(whole, f, 0, -5.0),
            ("row 2", "-5 Hz", "wanted one from zero on"),
        ),
        "a negative amplitude": (celled(whole, a, 20, -1.0), ("row 22", "-1", "wanted")),
        "amplitudes all zero": (_map(a=[0.0] * 52), ("every amplitude is zero", "wanted")),
        "a spectrum of zeros": (
            {**whole, a: [0.0] * 13 + list(whole[a][13:])},
            ("the spectrum at -1 V", "every amplitude is zero"),
        ),
        "amplitude and frequency exchanged": (_map(f=whole[a], a=whole[f]), ("rising",)),
        "no frequency": (without(whole, f), ("no column 'frequency'",)),
        "no amplitude": (without(whole, a), ("no column 'amplitude'",)),
        "amplitude in hertz": (renamed(whole, a, "amplitude (Hz)"), ("'amplitude'", "Hz")),
        "amplitude without unit": (renamed(whole, a, "amplitude"), ("'amplitude' has no unit",)),
        "frequency in seconds": (renamed(whole, f, "frequency (s)"), ("'frequency'", "'s'")),
        "frequency without unit": (renamed(whole, f, "frequency"), ("'frequency' has no unit",)),
    }
    for name, (made, says) in columns.items():
        yield Fault(f"map: {name}", scenes.control(None, made), (MAP, *says))


def control_key_faults() -> Iterator[Fault]:
    """Keys of [control_sweep]."""
    keys: Told = {
        "a control twice": ({"controls": ["V", "V"]}, ("controls", "'V'", "wanted each once")),
        "no control": ({"controls": []}, ("controls", "wanted at least one column")),
        "frequency as a control": (
            {"controls": ["V", "frequency"]},
            ("controls", "'frequency'", "wanted columns of"),
        ),
        "a control that nothing names": ({"controls": ["W"]}, ("no column 'W'",)),
        "no drive of that formula": ({"drive": "f0/g"}, ("drive", "'f0/g'", "of the frequency f")),
        "a drive of zero": ({"drive": "f - f"}, ("drive", "'f - f'", "no positive number")),
        "sigma of hertz": ({"sigma": "1 Hz"}, ("sigma", "'Hz'", "wanted 'V'")),
        "sigma of zero": ({"sigma": "0 V"}, ("sigma: found 0 V", "wanted more than zero")),
        "sigma negative": ({"sigma": "-1 V"}, ("sigma", "wanted more than zero")),
        "range exchanged": (
            {"range": ["350 Hz", "290 Hz"]},
            ("range", "350", "wanted the smaller"),
        ),
        "range outside": (
            {"range": ["1 Hz", "2 Hz"]},
            ("0 points to fit from 1 Hz to 2 Hz", "wanted at least 8"),
        ),
        "an output that is none": ({"output": "q9"}, ("output", "no variable 'q9'")),
        "a scale that is none": ({"scale": "all"}, ("scale", "'all'", "wanted one of")),
    }
    for name, (told, says) in keys.items():
        made = scenes.control(said("control_sweep", told))
        yield Fault(f"control sweep: {name}", made, says)
