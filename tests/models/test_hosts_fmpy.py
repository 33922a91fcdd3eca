"""The oscillator FMU in fmpy: valid, exact, tunable, and honest after a failure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import parse

import fmpy
import mpmath as mp
import pytest
from fmpy.validation import validate_fmu
from lxml import etree

from tests.support import reference
from tests.support.fmus import (
    DISCARD,
    LIVELY,
    OK,
    REFUSALS,
    TIMES,
    WARNING,
    Instance,
    Refusal,
    Unpacked,
    steady_state,
    worst,
)

SOLVERS = (0, 1, 2)

#: SI exponents of the units; the dimension of a variable follows from its unit alone.
DIMENSIONS = {
    "Hz": {"s": "-1"},
    "1/s": {"s": "-1"},
    "s": {"s": "1"},
    "rad": {"rad": "1"},
    "m": {"m": "1"},
    "m/s2": {"m": "1", "s": "-2"},
}
#: The Reals without a dimension: the gains of the drive.
DIMENSIONLESS = {"q1_hybrid_error", "q2_hybrid_error", "g1", "g2", "Q_plus", "Q_minus"}


# --- the modelDescription ------------------------------------------------------------------------


def test_the_validator_of_fmpy_has_nothing_to_say(oscillator_fmu: Path) -> None:
    assert validate_fmu(str(oscillator_fmu)) == []


def test_the_description_follows_the_schema_of_fmi(oscillator: Unpacked) -> None:
    schemas = Path(fmpy.__file__).parent / "schema" / "fmi2"
    schema = etree.XMLSchema(etree.parse(str(schemas / "fmi2ModelDescription.xsd")))
    described = etree.parse(str(oscillator.folder / "modelDescription.xml"))
    assert schema.validate(described), schema.error_log


def test_every_dimensional_real_has_a_defined_unit(oscillator: Unpacked) -> None:
    root = parse(oscillator.folder / "modelDescription.xml").getroot()
    defined = {}
    for unit in root.iterfind("UnitDefinitions/Unit"):
        base = unit.find("BaseUnit")
        assert base is not None
        defined[unit.get("name")] = dict(base.attrib)
    bare = set()
    for variable in root.iterfind("ModelVariables/ScalarVariable"):
        real = variable.find("Real")
        if real is not None and real.get("unit") is None:
            bare.add(variable.get("name"))
        elif real is not None:
            assert defined[real.get("unit")] == DIMENSIONS[str(real.get("unit"))]
    assert bare == DIMENSIONLESS


def test_the_description_declares_what_the_fmu_can_do(oscillator: Unpacked) -> None:
    can = oscillator.description.coSimulation
    assert can.canGetAndSetFMUstate
    assert can.canSerializeFMUstate
    assert can.canHandleVariableCommunicationStepSize
    assert not can.canBeInstantiatedOnlyOncePerProcess
    assert can.needsExecutionTool  # a Python interpreter
    assert oscillator.description.generationDateAndTime is None  # or two builds would differ


def test_every_variable_explains_itself(oscillator: Unpacked) -> None:
    variables = oscillator.description.modelVariables
    assert [v.name for v in variables if len(v.description or "") < 10] == []
    wanted = (
        "theta reflection d1 d2 eta_plus eta_minus u1 u2 A1 A2 phase1 phase2 g1 g2 periodic_start "
        "solver b q1_hybrid q2_hybrid q1 q2 lambda f1 f2 D11 D22 D12 "
        "width_plus width_minus Q_plus Q_minus status_message"
    )
    assert set(wanted.split()) <= {v.name for v in variables}


# --- numbers -------------------------------------------------------------------------------------


def displacements(p: Any) -> list[tuple[Any, ...]]:
    """Return the true q~1 and q~2 of a run from rest at TIMES."""
    return [row[:2] for row in reference.displacements(p, TIMES)]


def test_a_run_from_rest_follows_the_matrix_exponential(
    oscillator: Unpacked, instance: Instance
) -> None:
    rows = instance.start(**LIVELY).run(TIMES, "q1_hybrid", "q2_hybrid")
    truth = displacements(oscillator.parameters(**LIVELY))
    assert worst(rows, truth) < 1e-13


def test_the_periodic_start_is_the_steady_state(oscillator: Unpacked, instance: Instance) -> None:
    """The string's own numbers, up to a tenth of a second: 700,000 periods."""
    changes = {"phase1": 0.4, "A2": 0.5}
    times = [1e-5, 3.7e-4, 0.1]
    rows = instance.start(periodic_start=True, **changes).run(times, "q1_hybrid", "q2_hybrid")
    assert worst(rows, steady_state(oscillator.parameters(**changes), times)) < 1e-11


def test_the_cut_into_steps_does_not_matter(oscillator: Unpacked) -> None:
    with Instance(oscillator) as one, Instance(oscillator) as many:
        fine = many.start(**LIVELY).run(TIMES, "q1_hybrid", "q2_hybrid")
        coarse = one.start(**LIVELY).run(TIMES[-1:], "q1_hybrid", "q2_hybrid")
    assert coarse[0] == fine[-1]


def test_calculated_outputs_are_those_of_the_published_table(instance: Instance) -> None:
    """At the published angle of the first series, with d1 = 120 and d2 = 90 Hz."""
    coupling, f1, f2, d11, d22, d12 = instance.start(theta=1.9498).get(
        "lambda", "f1", "f2", "D11", "D22", "D12"
    )
    assert coupling == pytest.approx(0.6476e6, abs=100)
    assert f1 == pytest.approx(7.0157e6, abs=100)  # the paper's tables swap the labels of f1, f2
    assert f2 == pytest.approx(6.9523e6, abs=100)
    assert d11 + d22 == pytest.approx(2 * math.pi * 210.0, rel=1e-14)  # the trace of D
    assert d11 * d22 - d12**2 == pytest.approx((2 * math.pi) ** 2 * 120 * 90, rel=1e-12)


def test_a_coupling_that_is_no_real_number_is_nan_and_told(instance: Instance) -> None:
    instance.start(theta=0.3)
    assert math.isnan(instance.get("lambda")[0])
    assert any(s == WARNING and "lambda" in text and "0.3" in text for s, text in instance.messages)
    assert instance.step(0.0, 1e-5) == OK
    assert instance.status_message() == ""
    rest = {name: x for name, x in instance.outputs().items() if name != "lambda"}
    assert all(map(math.isfinite, rest.values()))


# --- parameters changed between steps ------------------------------------------------------------


def piecewise(
    stages: Sequence[tuple[Any, float, float]],
) -> list[tuple[Any, Any]]:
    """Return q~ at the end of each stage (parameters, input b, end time) in 50 digits, from rest.

    The motion and the phases of the tones carry on from stage to stage; only the generator changes.
    """
    with mp.workdps(50):
        y = reference._start(stages[0][0], periodic=False, b=0.0)
        speed, now, result = mp.mpf(stages[0][0].eta_plus), mp.mpf(0), []
        for p, b, end in stages:
            for i in (2, 3):  # the reference keeps q'/(2 pi eta_plus)
                y[i] *= speed / mp.mpf(p.eta_plus)
            speed, y[8] = mp.mpf(p.eta_plus), mp.mpf(b)
            y = mp.expm(reference._system(p) * (mp.mpf(end) - now)) * y
            now = mp.mpf(end)
            result.append((y[0], y[1]))
        return result


CHANGES: tuple[dict[str, float], ...] = (
    {},
    {"theta": 2.4, "d1": 5e3},
    {"u1": 1.02e5, "A2": 1e10},
    {"eta_plus": 1.01e5, "g2": 0.5},
    {"theta": 1.0, "A1": 0.0},
)


@pytest.mark.parametrize("solver", [0, 2])
def test_tunable_parameters_keep_motion_and_phase(
    oscillator: Unpacked, instance: Instance, solver: int
) -> None:
    values: dict[str, Any] = dict(LIVELY)
    instance.start(solver=solver, rk4_substep=2e-8, **values)
    stages, rows, end = [], [], 0.0
    for k, change in enumerate(CHANGES):
        values |= change
        b = (0.0, 3e9, -1e9, -1e9, 0.0)[k]
        instance.set(b=b, **change)
        begin, end = end, TIMES[6 * k + 5]
        assert instance.step(begin, end - begin) == OK
        rows.append(instance.get("q1_hybrid", "q2_hybrid"))
        stages.append((oscillator.parameters(**values), b, end))
    assert worst(rows, piecewise(stages)) < {0: 1e-12, 2: 1e-6}[solver]


@pytest.mark.parametrize(
    ("name", "value"), [("solver", 2), ("periodic_start", True), ("reflection", True)]
)
def test_what_is_fixed_says_so_and_is_refused_later(
    oscillator: Unpacked, instance: Instance, name: str, value: Any
) -> None:
    variability = {v.name: v.variability for v in oscillator.description.modelVariables}
    assert variability[name] == "fixed"
    instance.start().run([1e-5], "q1")
    instance.set(**{name: value})
    assert instance.step(1e-5, 1e-5) == DISCARD
    assert name in instance.status_message()


# --- failure -------------------------------------------------------------------------------------


def assert_failed(instance: Instance, refusal: Refusal) -> None:
    """The sentence is in the log and in the String output, every Real output is NaN."""
    sentence = instance.status_message()
    assert refusal.name in sentence
    assert refusal.value in sentence
    assert sentence in {text for status, text in instance.messages if status >= DISCARD}
    assert "%" not in sentence  # hosts hand it to printf
    assert all(map(math.isnan, instance.outputs().values()))


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("refusal", REFUSALS, ids=lambda r: r.label)
def test_what_cannot_be_simulated_is_refused_in_a_sentence(
    instance: Instance, refusal: Refusal, solver: int
) -> None:
    instance.start(solver=solver, **refusal.values)
    assert_failed(instance, refusal)
    assert instance.step(0.0, 1e-5) == DISCARD
    assert instance.step(1e-5, 1e-5) == DISCARD
    assert_failed(instance, refusal)


@pytest.mark.parametrize(
    "refusal", [r for r in REFUSALS if "periodic_start" not in r.values], ids=lambda r: r.label
)
def test_a_failure_in_mid_run_leaves_no_stale_number(instance: Instance, refusal: Refusal) -> None:
    instance.start().run([1e-5], "q1_hybrid")
    instance.set(**refusal.values)
    assert instance.step(1e-5, 1e-5) == DISCARD
    assert_failed(instance, refusal)


def test_a_failed_instance_stays_failed_until_it_is_reset(
    oscillator: Unpacked, instance: Instance
) -> None:
    instance.start(eta_plus=-1.0)
    assert instance.step(0.0, 1e-5) == DISCARD
    instance.set(eta_plus=7e6)  # healing a parameter must not let numbers out again
    assert all(map(math.isnan, instance.outputs().values()))
    assert instance.step(0.0, 1e-5) == DISCARD
    assert all(map(math.isnan, instance.outputs().values()))
    instance.slave.reset()
    assert instance.status_message() == ""
    after = instance.start().run(TIMES, "q1_hybrid")
    with Instance(oscillator) as fresh:
        assert fresh.start().run(TIMES, "q1_hybrid") == after


def test_negative_damping_from_rest_grows_with_a_warning(
    oscillator: Unpacked, instance: Instance
) -> None:
    values = dict(LIVELY) | {"d1": -2e3}
    rows = instance.start(**values).run(TIMES, "q1_hybrid", "q2_hybrid")
    assert any(s == WARNING and "d1" in text and "-2000" in text for s, text in instance.messages)
    assert worst(rows, displacements(oscillator.parameters(**values))) < 1e-12


def test_growth_beyond_all_numbers_is_a_failure(instance: Instance) -> None:
    instance.start(d1=-1e6, d2=-1e6)
    assert instance.step(0.0, 1.0) == DISCARD
    assert instance.status_message() != ""
    assert all(map(math.isnan, instance.outputs().values()))


@pytest.mark.parametrize("name", ["theta", "b"])
def test_a_step_that_is_refused_does_not_end_the_process(instance: Instance, name: str) -> None:
    instance.start().run([1e-5], "q1")
    instance.set(**{name: float("nan")})
    assert instance.step(1e-5, 1e-5) == DISCARD
    assert name in instance.status_message()
