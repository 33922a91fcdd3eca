"""Faults of complex values: quadratures, phases, wiring, tones with phases."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tests.faults import curve_scenes as scenes
from tests.faults.curve_scenes import (
    COMPLEX,
    MAP,
    Corrupted,
    Fault,
    Told,
    celled,
    renamed,
    rows_of,
    said,
    without,
)
from tests.faults.scene import EXPERIMENTS


def faults() -> Iterator[Fault]:
    """All of them."""
    yield from quadrature_faults()
    yield from phase_faults()
    yield from wiring_faults()
    yield from complex_map_faults()
    yield from tone_key_faults()
    yield from tone_phase_faults()


# --- complex sweeps --------------------------------------------------------------------------


def quadrature_faults() -> Iterator[Fault]:
    """Columns of complex sweeps."""
    xy = scenes.xy_columns()
    f, x, y = "frequency (Hz)", "X (V)", "Y (V)"
    backwards = list(range(48, -1, -1))
    columns: Corrupted = {
        "X and Y exchanged": ({**xy, x: xy[y], y: xy[x]}, ("the phase rises", "conjugate = true")),
        "Y of the other sign": ({**xy, y: [-v for v in xy[y]]}, ("the phase rises",)),
        "frequency and X exchanged": ({**xy, f: xy[x], x: xy[f]}, ("row ", "wanted", "rising")),
        "no Y": (without(xy, y), ("no column 'Y'", "wanted frequency with X and Y")),
        "no X": (without(xy, x), ("no column 'X'", "wanted frequency with X and Y")),
        "no frequency": (without(xy, f), ("no column 'frequency'",)),
        "downwards": (rows_of(xy, backwards), ("row 3", "follows", "rising")),
        "a point twice": (
            rows_of(xy, [0, 1, 1, *range(2, 49)]),
            ("row 4", "appears twice", "rising"),
        ),
        "seven points": (rows_of(xy, range(7)), ("7 points", "wanted at least 8")),
        "one point": (rows_of(xy, [0]), ("1 point;", "wanted at least 3")),
        "a hole": (celled(xy, y, 7, ""), ("row 9, column 'Y'", "''", "wanted")),
        "nan": (celled(xy, y, 7, "nan"), ("row 9, column 'Y'", "'nan'", "wanted")),
        "all zero": ({**xy, x: [0.0] * 49, y: [0.0] * 49}, ("every value is zero", "wanted")),
        "Y constant": ({**xy, y: [0.0] * 49}, ("column 'Y' is 0 V at all 49 points", "wanted")),
        "X constant": ({**xy, x: [1e-3] * 49}, ("column 'X' is 0.001 V at all 49", "wanted")),
        "Y in hertz": (renamed(xy, y, "Y (Hz)"), ("column 'Y'", "'Hz'", "wanted 'V'")),
        "Y without unit": (renamed(xy, y, "Y"), ("column 'Y' has no unit",)),
        "frequency in radians": (renamed(xy, f, "frequency (rad)"), ("'frequency'", "'rad'")),
    }
    for name, (made, says) in columns.items():
        yield Fault(f"complex sweep: {name}", scenes.sweep(None, made), (COMPLEX, *says))


def phase_faults() -> Iterator[Fault]:
    """Columns of amplitude and phase."""
    polar = scenes.polar_columns()
    a, p = "amplitude (V)", "phase (rad)"
    radians = np.array(polar[p])
    turns = np.linspace(0.0, 4000.0, 49)
    cable = scenes.response(scenes.SWEPT_HZ) * np.exp(-2j * np.pi * scenes.SWEPT_HZ * 0.05)
    columns: Corrupted = {
        "degrees called radians": (
            {**polar, p: np.degrees(radians).tolist()},
            ("declared to be in rad", "wanted radians", "deg"),
        ),
        "radians called degrees": (
            renamed(polar, p, "phase (deg)"),
            ("declared to be in deg", "wanted degrees", "rad"),
        ),
        "unwrapped over 4,000 rad": (
            {**polar, p: (radians - turns).tolist()},
            ("declared to be in rad", "4003", "wanted"),
        ),
        "a cable that nobody told": (
            scenes.polar_columns(cable),
            ("a cable of 50.", "no delay was stated", 'delay = "fit"'),
        ),
        "constant": ({**polar, p: [0.5] * 49}, ("the phase is 0.5 rad at all 49 points", "wanted")),
        "missing": (without(polar, p), ("no column 'phase'", "wanted")),
        "amplitude missing": (without(polar, a), ("no column 'amplitude'", "wanted")),
        "without unit": (renamed(polar, p, "phase"), ("column 'phase' has no unit",)),
        "in volts": (renamed(polar, p, "phase (V)"), ("phase", "'V'", "wanted 'rad'")),
        "in hertz": (renamed(polar, p, "phase (Hz)"), ("phase", "'Hz'", "wanted 'rad'")),
        "amplitude and phase exchanged": ({**polar, a: polar[p], p: polar[a]}, ("magnitude",)),
        "a negative amplitude": (celled(polar, a, 7, -1.0), ("row 9", "-1", "magnitude")),
        "decibels called volts": (
            {**polar, a: (20.0 * np.log10(polar[a])).tolist()},
            ("row 2", "magnitude", "dB"),
        ),
        "a hole": (celled(polar, p, 7, ""), ("row 9, column 'phase'", "''", "wanted")),
        "infinite": (celled(polar, p, 7, "inf"), ("row 9, column 'phase'", "'inf'", "wanted")),
        "rising": ({**polar, p: (-radians).tolist()}, ("the phase rises", "conjugate")),
    }
    for name, (made, says) in columns.items():
        yield Fault(f"phases: {name}", scenes.sweep(None, made), (COMPLEX, *says))


def wiring_faults() -> Iterator[Fault]:
    """Keys of [[complex_sweep]]."""
    keys: Told = {
        "a wiring that is none": ({"wiring": "hanger"}, ("wiring", "'hanger'", "wanted one of")),
        "a background that is none": ({"background": "linear"}, ("background", "'linear'")),
        "a constant beside a notch": (
            {"wiring": "notch", "background": "constant"},
            ("background", "passes by", 'wanted "none" or "slope"'),
        ),
        "a shared notch": ({"wiring": "notch", "scale": "shared"}, ("scale", 'wanted "own"')),
        "restarted alone": ({"restarted": True}, ("restarted", 'scale = "shared"')),
        "a delay in words": ({"delay": "long"}, ("delay", "'long'", "wanted")),
        "a delay without unit": ({"delay": "3"}, ("delay", '"3"', '"40 ns"')),
        "a delay as a number": ({"delay": 3e-9}, ("delay", "wanted")),
        "a delay in hertz": ({"delay": "3 Hz"}, ("delay", "'Hz'", "wanted 's'")),
        "a delay of another length": (
            {"delay": "50 ms"},
            (COMPLEX, "as without a cable", "50 ms were stated", 'or "none"'),
        ),
        "a delay that is infinite": ({"delay": "1e400 s"}, ("delay", "finite")),
        "sigma of hertz": ({"sigma": "1 Hz"}, ("sigma", "'Hz'", "wanted 'V'")),
        "sigma of zero": ({"sigma": "0 V"}, ("sigma", "wanted more than zero")),
        "a setting that is none": ({"set": {"eta": "1 Hz"}}, ("set", "no variable 'eta'")),
        "an output that is none": ({"output": "q9"}, ("output", "no variable 'q9'")),
        "a chunk of a table": ({"chunk": 2}, (COMPLEX, "layout 'csv'", "'chunk' has no meaning")),
        "a column that is none": ({"columns": {"x": "Re"}}, (COMPLEX, "no column 'Re'")),
        "a column twice": ({"columns": {"x": "X", "y": "X"}}, ("'X' is taken for two", "wanted")),
        "a file that is none": ({"file": "complexx.csv"}, ("no such file", "did you mean")),
    }
    for name, (told, says) in keys.items():
        made = scenes.sweep(said("complex_sweep", told))
        yield Fault(f"wiring: {name}", made, says)
    made = scenes.sweep(lambda t: t["complex_sweep"].append(dict(t["complex_sweep"][0])))
    yield Fault("wiring: data twice", made, ("again", "wanted"))


def complex_map_faults() -> Iterator[Fault]:
    """Keys of [complex_control_sweep], and its columns."""
    keys: Told = {
        "no control": ({"controls": []}, ("controls", "wanted at least one column")),
        "a quadrature as a control": (
            {"controls": ["X"]},
            ("controls", "'X'", "wanted columns of"),
        ),
        "a control that nothing names": ({"controls": ["W"]}, ("no column 'W'",)),
        "a shared notch": ({"wiring": "notch", "scale": "shared"}, ("scale", 'wanted "own"')),
        "a delay in words": ({"delay": "long"}, ("delay", "'long'", "wanted")),
        "a range outside": (
            {"range": ["1 Hz", "2 Hz"]},
            ("0 points to fit from 1 Hz to 2 Hz", "wanted at least 8"),
        ),
        "sigma of hertz": ({"sigma": "1 Hz"}, ("sigma", "'Hz'", "wanted 'V'")),
        "an output that is none": ({"output": "q9"}, ("output", "no variable 'q9'")),
        "a column that is none": ({"columns": {"x": "Re"}}, (MAP, "no column 'Re'")),
    }
    for name, (told, says) in keys.items():
        files = scenes.complex_control(said("complex_control_sweep", told))
        yield Fault(f"complex map: {name}", files, says)
    whole = scenes.complex_map_columns()
    x, f = "X (V)", "frequency (Hz)"
    columns: Corrupted = {
        "no Y": (without(whole, "Y (V)"), ("no column 'Y'",)),
        "a text": (celled(whole, x, 7, "high"), ("row 9, column 'X'", "'high'", "wanted")),
        "nan": (celled(whole, x, 7, "nan"), ("row 9, column 'X'", "'nan'", "wanted")),
        "frequency in seconds": (renamed(whole, f, "frequency (s)"), ("'frequency'", "'s'")),
        "X without unit": (renamed(whole, x, "X"), ("'X' has no unit",)),
        "a control without unit": (renamed(whole, "V (V)", "V"), ("'V' has no unit",)),
    }
    for name, (made, says) in columns.items():
        yield Fault(f"complex map: {name}", scenes.complex_control(None, made), (MAP, *says))


# --- complex tones ---------------------------------------------------------------------------


def tone_key_faults() -> Iterator[Fault]:
    """Keys of [experiments] that tell of phases."""
    keys: Told = {
        "a column of phases too many": (
            {"phases": ["phase", "phase"]},
            ("phases", "['phase', 'phase']", "wanted each once"),
        ),
        "a column of phases that is none": ({"phases": ["fase"]}, ("no column 'fase'", "'phase'")),
        "phases of peaks": ({"phases": ["peak"]}, ("phases: 'peak' is named twice", "wanted")),
        "peaks of phases": ({"peaks": ["phase"], "phases": ["peak"]}, ("'phase'", "deg", "wanted")),
        "unknown of another word": ({"unknown": "both"}, ("unknown", "'both'", "wanted one of")),
        "restarted before nothing": ({"restarted": ["z"]}, ("restarted", "'z'", "there is: a, b")),
        "restarted where nothing is unknown": (
            {"unknown": "none", "restarted": ["b"]},
            ("restarted", 'unknown = "none"'),
        ),
        "X beside peaks": ({"x": ["peak"]}, ("wanted together with 'x'",)),
    }
    for name, (told, says) in keys.items():
        made = scenes.tones(said("experiments", told))
        yield Fault(f"tones: {name}", made, says)
    of_parts: Told = {
        "Y of another number": ({"y": ["Y", "Z"]}, ("y", "2 columns, wanted 1")),
        "Y that is none": ({"y": ["Z"]}, ("no column 'Z'",)),
        "X twice": ({"y": ["X"]}, ("y: 'X' is named twice", "wanted")),
        "parts in dBm": ({"amplitude": "dBm", "impedance": "50 ohm"}, ("amplitude", "dBm")),
    }
    for name, (told, says) in of_parts.items():
        made = scenes.parts(said("experiments", told))
        yield Fault(f"tones: {name}", made, says)
    alone = scenes.tones(lambda t: t["experiments"].pop("phases"))
    yield Fault("tones: no phases", alone, ("unknown", "together with 'phases'"))


def tone_phase_faults() -> Iterator[Fault]:
    """Columns of phases, and of X and Y, of tones."""
    polar, parts = scenes.tone_columns(), scenes.part_columns()
    p, x, y = "phase (deg)", "X (V)", "Y (V)"
    degrees = np.array(polar[p], dtype=float)
    columns: Corrupted = {
        "degrees called radians": (
            renamed(polar, p, "phase (rad)"),
            ("row 2", "5 of 5 rows", "deg"),
        ),
        "unwrapped over 4,000 rad": (
            renamed({**polar, p: (degrees - np.arange(5) * 1000.0).tolist()}, p, "phase (rad)"),
            ("row 2", "5 of 5 rows", "wanted phases within one turn"),
        ),
        "missing": (without(polar, p), ("no column 'phase'",)),
        "without unit": (renamed(polar, p, "phase"), ("column 'phase' has no unit",)),
        "in volts": (renamed(polar, p, "phase (V)"), ("'phase'", "'V'", "wanted 'rad'")),
        "a hole": (celled(polar, p, 2, ""), ("row 4, column 'phase'", "''", "wanted")),
        "infinite": (celled(polar, p, 2, "inf"), ("row 4, column 'phase'", "'inf'", "wanted")),
        "constant": ({**polar, p: [30.0] * 5}, ("'phase'", "is 30 deg of every line", "wanted")),
        "an experiment twice": (rows_of(polar, [0, 1, 2, 3, 3]), ("row 6", "'d'", "wanted")),
    }
    for name, (made, says) in columns.items():
        yield Fault(f"tone phases: {name}", scenes.tones(None, made), (EXPERIMENTS, *says))
    of_parts: Corrupted = {
        "no Y": (without(parts, y), ("no column 'Y'",)),
        "a hole in Y": (celled(parts, y, 2, ""), ("row 4, column 'Y'", "''", "wanted")),
        "Y in degrees": (renamed(parts, y, "Y (deg)"), ("'Y'", "deg")),
        "Y without unit": (renamed(parts, y, "Y"), ("column 'Y' has no unit",)),
        "zero": (celled(celled(parts, y, 2, 0.0), x, 2, 0.0), ("row 4", "wanted")),
    }
    for name, (made, says) in of_parts.items():
        yield Fault(f"tone phases: {name}", scenes.parts(None, made), (EXPERIMENTS, *says))
