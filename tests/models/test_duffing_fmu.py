"""``DuffingOscillator`` as an FMU: valid, restorable, complete in reset, honest after a failure."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import parse

import fmpy
import pytest
from fmpy.validation import validate_fmu
from lxml import etree

import build_fmu
from fitting.text import units
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
    unpack,
)

SOLVERS = ENVELOPE, RK4 = 1, 2
#: The lively scene of the linear model with cubic terms that shift it by about a line width.
CUBIC = {"alpha1": 2.0, "alpha2": -1.5, "kappa": 1.0}
SCENE: dict[str, Any] = dict(LIVELY) | {name: 1e10 * x for name, x in CUBIC.items()}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_fmu.build("DuffingOscillator", tmp_path_factory.mktemp("duffing"))


@pytest.fixture(scope="module")
def duffing(built: Path) -> Unpacked:
    return unpack(built, built.parent / "unpacked")


@pytest.fixture
def instance(duffing: Unpacked) -> Iterator[Instance]:
    with Instance(duffing) as made:
        yield made


# --- the modelDescription ------------------------------------------------------------------------


def test_the_description_is_valid(built: Path, duffing: Unpacked) -> None:
    assert validate_fmu(str(built)) == []
    schemas = Path(fmpy.__file__).parent / "schema" / "fmi2"
    schema = etree.XMLSchema(etree.parse(str(schemas / "fmi2ModelDescription.xsd")))
    schema.assertValid(etree.parse(str(duffing.folder / "modelDescription.xml")))


def test_it_has_the_variables_of_the_linear_model_and_its_own(
    duffing: Unpacked, oscillator: Unpacked
) -> None:
    mine = {v.name: v for v in duffing.description.modelVariables}
    for variable in oscillator.description.modelVariables:
        if "_hybrid_" not in variable.name and variable.name not in ("solver", "other_mode"):
            same = mine[variable.name]
            assert (same.causality, same.variability, same.unit, same.start) == (
                variable.causality,
                variable.variability,
                variable.unit,
                variable.start,
            )
    for name in ("alpha1", "alpha2", "kappa"):
        assert (mine[name].causality, mine[name].variability) == ("parameter", "tunable")
        assert mine[name].unit == "1/(m2.s2)"
    assert [v.name for v in mine.values() if len(v.description or "") < 10] == []


def test_the_unit_of_the_cubic_coefficients_is_one(duffing: Unpacked) -> None:
    """In the XML by its exponents, and to the fitting half by its name."""
    root = parse(duffing.folder / "modelDescription.xml").getroot()
    bases = {u.get("name"): u.find("BaseUnit") for u in root.iterfind("UnitDefinitions/Unit")}
    base = bases["1/(m2.s2)"]
    assert base is not None
    assert dict(base.attrib) == {"m": "-2", "s": "-2"}
    assert units.convert(1.0, "1/(um^2 s^2)", "1/(m2.s2)", where="") == pytest.approx(1e12)


def test_the_documentation_tells_model_solvers_and_bound(duffing: Unpacked) -> None:
    page = (duffing.folder / "documentation" / "index.html").read_text("utf-8")
    for word in ("alpha1", "kappa", "nonlinear_shift", "branch", "tolerance", "third harmonic"):
        assert word in page


def test_the_bound_of_the_averaging_is_that_of_its_description(instance: Instance) -> None:
    """At least eps (3 eps + |u1 - u2|/c), c between the tones; one tone has no other."""
    for alone in (False, True):
        changes = {"A2": 0.0} if alone else {}
        instance.start(solver=ENVELOPE, **SCENE | changes)
        (_, eps, bound) = instance.run(TIMES, "q1", "nonlinear_shift", "envelope_error")[-1]
        u1, u2 = SCENE["u1"], SCENE["u2"]
        spread = 0.0 if alone else abs(u1 - u2) / (0.5 * (u1 + u2))
        assert eps > 0.0
        least = eps * (3.0 * eps + spread)
        assert (1.0 - 1e-9) * least <= bound <= 3.0 * least  # nothing cancels in this scene
        instance.slave.reset()


# --- the course of a run -------------------------------------------------------------------------


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_cubic_terms_count_in_this_scene(instance: Instance, solver: int) -> None:
    linear = instance.start(solver=solver, **SCENE | dict.fromkeys(CUBIC, 0.0)).run(TIMES, "q1")
    instance.slave.reset()
    cubic = instance.start(solver=solver, **SCENE).run(TIMES, "q1", "nonlinear_shift")
    size = max(abs(q) for (q,) in linear)
    assert max(abs(a[0] - b[0]) for a, b in zip(linear, cubic, strict=True)) > 0.01 * size
    assert 1e-4 < max(row[1] for row in cubic) < 0.1


@pytest.mark.parametrize("name", ["q1_hybrid", "q2_hybrid"])
def test_both_solvers_agree_through_changes_of_parameters(instance: Instance, name: str) -> None:
    """State and phases carry on: tone, damping, eigenfrequency, cubic terms, tones off."""
    changes: tuple[dict[str, float], ...] = (
        {},
        {"u1": 0.992e5},
        {"d1": 7e3, "theta": 2.2},
        {"eta_plus": 1.004e5, "g2": 0.5},
        {"alpha1": -3e9, "kappa": 0.0},
        {"A2": 0.0, "A1": 2e10},
        {"A1": 0.0},
    )
    rows = []
    for solver in SOLVERS:
        instance.slave.reset()
        # tones close to each other, so that the envelope's own error is small
        near = {"u1": 0.995e5, "u2": 1.005e5, "eta_minus": 1.03e5}
        near |= {name: 1e9 * x for name, x in CUBIC.items()}
        instance.start(solver=solver, rk4_substep=5e-8, **SCENE | near)
        end, found = 0.0, []
        for change in changes:
            instance.set(**change)
            for _ in range(4):
                begin, end = end, end + 7.7e-6
                assert instance.step(begin, end - begin) == OK, instance.messages
                found.append(instance.get(name)[0])
        rows.append(found)
    size = max(map(abs, rows[1]))
    assert max(abs(a - b) for a, b in zip(*rows, strict=True)) < 1e-3 * size


@pytest.mark.parametrize("solver", SOLVERS)
def test_reset_is_complete(duffing: Unpacked, instance: Instance, solver: int) -> None:
    names = duffing.names("output")
    with Instance(duffing) as fresh:
        wanted = fresh.start(solver=solver).run([2e-6, 5e-6], *names)
    instance.start(solver=solver, reflection=True, **SCENE).run([3e-6], *names)
    instance.set(theta=0.5, alpha1=-1e10, kappa=math.nan)
    instance.step(3e-6, 1e-6)
    instance.slave.reset()
    parameters = duffing.names("parameter")
    defaults = vars(duffing.parameters())
    assert instance.get(*parameters) == [defaults[name] for name in parameters]
    assert instance.start(solver=solver).run([2e-6, 5e-6], *names) == wanted


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_run_restored_from_bytes_continues_bit_for_bit(
    duffing: Unpacked, instance: Instance, solver: int
) -> None:
    names = duffing.names("output")
    instance.start(solver=solver, **SCENE).run(TIMES[:3], *names)
    instance.set(u1=1.01e5, alpha1=3e10)
    for k in (3, 4):
        instance.step(TIMES[k - 1], TIMES[k] - TIMES[k - 1])
    state = instance.slave.getFMUstate()
    content = instance.slave.serializeFMUstate(state)

    def onwards(of: Instance) -> list[list[float]]:
        rows = [of.get(*names)]
        for k in range(5, 14):
            if k == 9:
                of.set(d1=7e3, u2=1.3e5)
            assert of.step(TIMES[k - 1], TIMES[k] - TIMES[k - 1]) == OK, of.messages
            rows.append(of.get(*names))
        return rows

    wanted = onwards(instance)
    instance.slave.setFMUstate(state)
    assert onwards(instance) == wanted
    instance.slave.freeFMUstate(state)
    with Instance(duffing) as other:
        other.slave.setFMUstate(other.slave.deSerializeFMUstate(content))
        assert onwards(other) == wanted


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_start_time_is_part_of_the_drive_phase(instance: Instance, solver: int) -> None:
    """Whole periods of both tones later the same run follows, on the orbit and from rest."""
    later = 2.0**-10
    u = {"u1": 97.0 / later, "u2": 101.0 / later, "eta_plus": 99.0 / later}
    for periodic in (False, True):
        rows = []
        for begin in (0.0, 64.0 * later):
            instance.slave.reset()
            values = SCENE | u | {"eta_minus": 1.05e5}
            instance.start(begin, solver=solver, periodic_start=periodic, **values)
            assert instance.step(begin, later / 8.0) == OK, instance.messages
            rows.append(instance.get("q1_hybrid", "q2_hybrid"))
        assert rows[1] == pytest.approx(rows[0], rel=1e-6)


def test_rk4_carries_an_input(instance: Instance, oscillator: Unpacked) -> None:
    """A held input moves a slow oscillator to where its force balances: k q + alpha q^3 = b."""
    values = {
        "eta_plus": 10.0,
        "d1": 8.0,
        "d2": 8.0,
        "alpha1": 3e3,
        "A1": 0.0,
        "A2": 0.0,
        "g2": 0.0,
    }
    instance.start(solver=RK4, rk4_substep=1e-3, eta_minus=11.0, u1=10.0, u2=10.0, **values)
    instance.set(b=5e3)
    assert instance.step(0.0, 3.0) == OK, instance.messages
    (q,) = instance.get("q1_hybrid")
    assert (2 * math.pi * 10.0) ** 2 * q + 3e3 * q**3 == pytest.approx(5e3, rel=1e-9)


# --- failure -------------------------------------------------------------------------------------

TWO = {"u1": 0.99e5, "u2": 1.01e5}
ONLY_ENVELOPE = (
    Refusal("input", {"b": 1.0}, "b", "1.0"),
    Refusal("overdamped", {"d1": 5e5, "d2": 5e5}, "d1", "500000.0"),
    Refusal("tones-apart", {"u2": 2.9e5}, "u2", "290000.0"),
    Refusal("far-off", {"u1": 4e5, "A2": 0.0}, "centre", "400000.0"),
    Refusal("third-harmonic", {"eta_minus": 2.97e5, "A2": 0.0}, "eta_minus", "297000.0"),
)
MINE = (
    Refusal("cubic-nan", {"alpha1": math.nan}, "alpha1", "nan"),
    Refusal("cubic-infinite", {"kappa": -math.inf}, "kappa", "-inf"),
    Refusal("tolerance-zero", {"tolerance": 0.0}, "tolerance", "0.0"),
    Refusal("tolerance-nan", {"tolerance": math.nan}, "tolerance", "nan"),
    Refusal("substep", {"rk4_substep": -1.0}, "rk4_substep", "-1.0"),
    Refusal("branch", {"branch": 2}, "branch", "2"),
    Refusal("solver", {"solver": 0}, "solver", "0"),
    Refusal("upper-of-two", TWO | {"branch": 1, "periodic_start": True}, "branch", "1"),
)


def assert_failed(instance: Instance, refusal: Refusal) -> None:
    """The sentence is in the log and in the String output, every Real output is NaN."""
    sentence = instance.status_message()
    assert refusal.name in sentence
    assert refusal.value in sentence
    assert sentence in {text for status, text in instance.messages if status >= DISCARD}
    assert all(map(math.isnan, instance.outputs().values()))
    assert instance.step(0.0, 1e-5) == DISCARD


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("refusal", [*REFUSALS, *MINE], ids=lambda r: r.label)
def test_what_cannot_be_simulated_is_refused_in_a_sentence(
    instance: Instance, refusal: Refusal, solver: int
) -> None:
    base = {} if refusal in REFUSALS else SCENE
    instance.start(**{"solver": solver} | base | dict(refusal.values))
    assert_failed(instance, refusal)


@pytest.mark.parametrize("refusal", ONLY_ENVELOPE, ids=lambda r: r.label)
def test_what_an_envelope_cannot_hold_is_left_to_rk4(instance: Instance, refusal: Refusal) -> None:
    instance.start(**SCENE | dict(refusal.values))
    assert "rk4" in instance.status_message()
    assert_failed(instance, refusal)
    instance.slave.reset()
    instance.start(solver=RK4, **SCENE | dict(refusal.values)).run(TIMES[:3], "q1")


def test_an_amplitude_beyond_the_averaging_is_refused_when_it_comes(instance: Instance) -> None:
    instance.start(**SCENE | {"A1": 3e11})
    now = 0.0
    while now < 1e-3 and instance.step(now, 1e-5) == OK:
        assert instance.get("nonlinear_shift")[0] < 0.11
        now += 1e-5
    assert 0.0 < now < 1e-3
    assert "cubic terms" in instance.status_message()
    assert all(map(math.isnan, instance.outputs().values()))


def test_an_escape_over_the_barrier_is_a_failure_of_rk4(instance: Instance) -> None:
    """A softening spring pulled too far runs away: no number comes out."""
    instance.start(solver=RK4, **SCENE | {"alpha1": -1e12, "A1": 1e12})
    assert instance.step(0.0, 1e-3) == DISCARD
    assert instance.status_message() != ""
    assert all(map(math.isnan, instance.outputs().values()))


def test_negative_damping_grows_with_a_warning_until_the_averaging_ends(
    instance: Instance,
) -> None:
    instance.start(**SCENE | {"d1": -2e3, "d2": -1e3})
    assert any(s == WARNING and "d1" in text for s, text in instance.messages)
    assert instance.step(0.0, 1e-5) == OK
    assert instance.step(1e-5, 1.0) == DISCARD
    assert all(map(math.isnan, instance.outputs().values()))


def test_upper_branch_without_an_orbit_to_start_on_is_told(instance: Instance) -> None:
    instance.start(branch=1)
    assert any(s == WARNING and "branch" in text for s, text in instance.messages)
    assert instance.step(0.0, 1e-6) == OK
