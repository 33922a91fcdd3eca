"""Arguments that cannot be what is wanted: a sentence each, whichever public name takes them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from tests.support.lines import mode

F_HZ = np.linspace(990.0, 1010.0, 41)
LINE = mode(F_HZ, 1e3, 4.0)
T_S = np.arange(60) / 1e3
DRIVE = ff.Drive(frequency_names=("u1",), amplitude_names=("A1",))
SETUP = ff.Setup(DRIVE, "q1")
#: What is called, with arguments that are right.
RIGHT: Mapping[str, tuple[Callable[..., Any], Mapping[str, Any]]] = {
    "Accuracy": (ff.Accuracy, {"relative": 1e-3}),
    "Columns": (ff.Columns, {}),
    "ComplexCurve": (ff.ComplexCurve, {"frequency_hz": F_HZ, "values": LINE}),
    "Drive": (ff.Drive, {"frequency_names": ("u1",), "amplitude_names": ("A1",)}),
    "Goal": (ff.Goal, {"target": "lambda"}),
    "EnsembleOptions": (ff.EnsembleOptions, {}),
    "Isolation": (ff.Isolation, {}),
    "Laboratories": (ff.Laboratories, {}),
    "Noise": (ff.Noise, {"relative": 0.01}),
    "NoiseSpectrum": (
        ff.NoiseSpectrum,
        {"setup": SETUP, "frequency_hz": F_HZ, "density": abs(LINE) ** 2},
    ),
    "Parameter": (ff.Parameter, {"name": "d1", "start": 1.0, "bounds": (0.5, 2.0), "unit": "Hz"}),
    "Sampling": (ff.Sampling, {}),
    "Setup": (ff.Setup, {"drive": DRIVE, "output": "q1"}),
    "StudyOptions": (ff.StudyOptions, {}),
    "Sweep": (ff.Sweep, {"setup": SETUP, "frequency_hz": F_HZ, "amplitude_v": abs(LINE)}),
    "Tikhonov": (ff.Tikhonov, {}),
    "Tones": (ff.Tones, {"setup": SETUP, "drive_hz": [[1e3]], "peaks_v": [[1.0]]}),
    "Trace": (ff.Trace, {"setup": SETUP, "time_s": T_S, "values": np.cos(T_S)}),
    "Wiring": (ff.Wiring, {}),
    "line": (ff.line, {"source": F_HZ, "values": LINE}),
    "noise_line": (ff.noise_line, {"source": F_HZ, "density": abs(LINE) ** 2}),
    "ringdown": (ff.ringdown, {"source": T_S, "values": np.exp(-9.0 * T_S)}),
}
WRONG = (
    *(None, 1.5, -1, "1 %", "", ["a"], {"a": 1}, object(), float("nan"), 10**400, b"x", True),
    *((1, 2, 3), np.array([1.0, 2.0])),
)


@pytest.mark.parametrize("name", RIGHT)
def test_what_an_argument_cannot_be_is_one_sentence(name: str) -> None:
    called, right = RIGHT[name]
    others = []
    for key in inspect.signature(called).parameters:
        for value in WRONG:
            try:
                called(**{**right, key: value})
            except ff.BadInput as error:
                others += [(key, value)] if "\n" in str(error) or not str(error) else []
            except Exception as error:
                others.append((key, repr(error)))
    assert others == []


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: ff.Noise(relative="1 %"), "Noise: relative is '1 %', wanted a number"),  # type: ignore[arg-type]
        (lambda: ff.Fmu("none.fmu", workers=1.5), "workers is 1.5, wanted"),  # type: ignore[arg-type]
        (lambda: ff.line(["a"], ["b"]), r"found \['a'\], wanted an array of numbers"),
        (lambda: ff.fit("problem"), "fit: problem is 'problem', wanted a Problem"),  # type: ignore[arg-type]
        (lambda: ff.Sampling(steps=1e3), "Sampling: steps is 1000.0, wanted a whole number"),  # type: ignore[arg-type]
    ],
)
def test_slips_of_the_pen(call: Callable[[], object], said: str) -> None:
    with pytest.raises(ff.BadInput, match=said):
        call()


def test_numbers_of_numpy_and_lists_pass() -> None:
    names: Any = ["u1"]
    whole: Any = np.int64(300)
    real: Any = np.float32(0.5)
    drive = ff.Drive(frequency_names=names, amplitude_names=names, amplitude=real)
    assert (drive.amplitude, list(drive.frequency_names)) == (0.5, ["u1"])
    assert ff.Sampling(steps=whole).steps == 300
    bounds: Any = np.array([0.5, 2.0])
    assert ff.Parameter("d1", 1, bounds=bounds, unit="Hz").start == 1
    with pytest.raises(TypeError, match="nothing"):
        ff.Noise(nothing=1)  # type: ignore[call-arg]
    with pytest.raises(ff.BadInput, match="none"):
        ff.Fmu(Path("none.fmu"), workers=whole)


def test_records_with_names_of_their_own_for_arguments_are_replaced() -> None:
    """`bounds` and `amplitude_unit` stay as they were, and what is checked is checked again."""
    one = ff.Parameter("d1", "0.1 kHz", bounds=("1 Hz", 1000.0), unit="Hz", prior=3.0)
    other = replace(one, start=5.0)
    assert (other.start, other.bounds, other.prior) == (5.0, ("1 Hz", 1000.0), 3.0)
    assert (other.lower, other.upper) == other.bounds
    assert replace(other, start="0.1 kHz") == one
    with pytest.raises(ff.BadInput, match=r"start = 2000\.0 lies outside"):
        replace(one, start="2 kHz")
    with pytest.raises(ff.BadInput, match="lower"):
        replace(one, bounds=(3.0, 1.0))


def test_the_name_of_a_first_argument_in_0_2_0_works_with_a_warning() -> None:
    with pytest.warns(DeprecationWarning, match="'found' is 'result'"), pytest.raises(ff.BadInput):
        ff.report(found=1, out="out")  # type: ignore[call-arg]
