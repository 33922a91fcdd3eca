"""Directional derivatives of the native twins against differences of mpmath's truth.

Steps of 1e-20 at 50 digits and more leave some thirty digits of a central difference.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mpmath as mp
import pytest
from fmpy.fmi1 import FMICallException

from tests.support import modes_reference, reference
from tests.support.fmus import DISCARD, LIVELY, OK, Instance, unpack
from tests.support.modes_scenes import PUMP, THREE, Scene
from tests.support.twins import twin_of

STEP = "1e-20"
ENVELOPE, RK4 = 1, 2
TUNABLE = (
    *("theta", "d1", "d2", "eta_plus", "eta_minus", "u1", "u2"),
    *("A1", "A2", "phase1", "phase2", "g1", "g2"),
)
#: What a change is measured by: every parameter's own size, an angle's 1 rad.
SIZES: Mapping[str, float] = {
    name: 1.0 if name.startswith(("theta", "phase")) else abs(float(LIVELY[name]))
    for name in TUNABLE
}
#: All parameters at once, each with a weight of its own.
ALL = {name: SIZES[name] * (0.3 + 0.17 * k) * (-1.0) ** k for k, name in enumerate(TUNABLE)}
Truth = Callable[[Mapping[str, Any]], Sequence[Any]]


@pytest.fixture(scope="module")
def oscillator_twin(twin_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Instance]:
    with Instance(unpack(twin_fmu, tmp_path_factory.mktemp("twin"))) as made:
        yield made


@pytest.fixture(scope="module")
def modes_twin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Instance]:
    fmu = twin_of("CoupledModes3", tmp_path_factory)
    with Instance(unpack(fmu, tmp_path_factory.mktemp("modes"))) as made:
        yield made


def slopes(truth: Truth, values: Mapping[str, Any], along: Mapping[str, float]) -> list[Any]:
    """The derivatives of all that a function of parameters gives, along a direction."""
    with mp.workdps(90):
        sides = [
            truth(
                {k: mp.mpf(v) + sign * mp.mpf(STEP) * along.get(k, 0.0) for k, v in values.items()}
            )
            for sign in (1, -1)
        ]
        return [(a - b) / (2 * mp.mpf(STEP)) for a, b in zip(*sides, strict=True)]


def derivatives(fmu: Instance, names: Sequence[str], along: Mapping[str, float]) -> list[float]:
    """What the FMU gives for outputs, along a direction."""
    references = {name: variable.valueReference for name, variable in fmu._variables.items()}
    return list(
        fmu.slave.getDirectionalDerivative(
            [references[name] for name in names],
            [references[name] for name in along],
            list(along.values()),
        )
    )


def agree(found: Sequence[float], truth: Sequence[Any], size: float, most: float = 1e-12) -> None:
    for x, y in zip(found, truth, strict=True):
        assert abs(x - y) <= most * size, (found, [float(t) for t in truth])


def started(fmu: Instance, *times: float, **values: Any) -> Instance:
    """A new run as far as the last of the times."""
    fmu.slave.reset()
    fmu.messages.clear()
    fmu.start(**values)
    for before, time in zip((0.0, *times), times, strict=False):
        assert fmu.step(before, time - before) == OK, fmu.messages
    return fmu


# --- two modes ------------------------------------------------------------------------------------

QUADRATURES = [f"q{m}_hybrid_{part}_u{k}" for k in (1, 2) for m in (1, 2) for part in "XY"]


def quadratures(p: Mapping[str, Any], reflection: bool) -> list[Any]:
    """All lock-in outputs of steady state, in the order of their names above."""
    found = []
    for k in (1, 2):
        amplitude = p[f"A{k}"] * mp.expj(p[f"phase{k}"])
        for x in reference.phasors(SimpleNamespace(**p, reflection=reflection), p[f"u{k}"]):
            found += [mp.re(x * amplitude), mp.im(x * amplitude)]
    return found


@pytest.mark.parametrize("reflection", [False, True])
def test_steady_state_along_each_parameter(oscillator_twin: Instance, reflection: bool) -> None:
    fmu = started(oscillator_twin, 1e-5, **LIVELY, reflection=reflection)
    size = max(abs(x) for x in fmu.get(*QUADRATURES))
    for name in TUNABLE:
        along = {name: SIZES[name]}
        truth = slopes(lambda p: quadratures(p, reflection), LIVELY, along)
        agree(derivatives(fmu, QUADRATURES, along), truth, 10.0 * size, 1e-13)
        assert max(abs(x) for x in truth) > 1e-2 * size  # something depends on it


def closed_forms(p: Mapping[str, Any]) -> list[Any]:
    """lambda, f1, f2, D11, D22, D12, the line widths and quality factors of a rotation."""
    c, s = mp.cos(p["theta"]), mp.sin(p["theta"])
    plus, minus = p["eta_plus"] ** 2, p["eta_minus"] ** 2
    w11 = c * c * p["d1"] + s * s * p["d2"]
    w22 = s * s * p["d1"] + c * c * p["d2"]
    return [
        mp.sqrt(-mp.sin(2 * p["theta"]) * (minus - plus) / 2),
        mp.sqrt(c * c * plus + s * s * minus),
        mp.sqrt(s * s * plus + c * c * minus),
        *(2 * mp.pi * x for x in (w11, w22, c * s * (p["d1"] - p["d2"]))),
        *(w11, w22, p["eta_plus"] / w11, p["eta_minus"] / w22),
    ]


def test_coupling_and_damping_along_all_parameters(oscillator_twin: Instance) -> None:
    names = [*("lambda", "f1", "f2", "D11", "D22", "D12")]
    names += ["width_plus", "width_minus", "Q_plus", "Q_minus"]
    fmu = started(oscillator_twin, 1e-5, **LIVELY)
    for name in TUNABLE[:5]:
        along = {name: SIZES[name]}
        truth = slopes(closed_forms, LIVELY, along)
        for x, y in zip(derivatives(fmu, names, along), truth, strict=True):
            assert x == pytest.approx(float(y), rel=1e-11, abs=1e-9)


def moved(p: Mapping[str, Any], row: Sequence[Any]) -> list[Any]:
    """Both hybridised displacements and, of a rotation, both physical ones."""
    c, s = mp.cos(p["theta"]), mp.sin(p["theta"])
    return [row[0], row[1], c * row[0] + s * row[1], -s * row[0] + c * row[1]]


MOVED = ("q1_hybrid", "q2_hybrid", "q1", "q2")
GROUPS = [TUNABLE[:5], TUNABLE[5:9], TUNABLE[9:]]


@pytest.mark.parametrize("group", GROUPS, ids=["modes", "tones", "phases and gains"])
@pytest.mark.parametrize("periodic", [False, True], ids=["from rest", "on orbit"])
def test_displacements_since_the_start(
    oscillator_twin: Instance, group: Sequence[str], periodic: bool
) -> None:
    along = {name: ALL[name] for name in group}
    times = (1e-5, 7.3e-5)
    fmu = started(oscillator_twin, *times, **LIVELY, periodic_start=periodic)

    def truth(p: Mapping[str, Any]) -> list[Any]:
        scene = SimpleNamespace(**p, reflection=False)
        return moved(p, reference.displacements(scene, times[-1:], periodic=periodic)[-1])

    right = slopes(truth, LIVELY, along)
    agree(derivatives(fmu, MOVED, along), right, max(float(abs(x)) for x in right))


def test_displacements_since_a_change_of_parameters_keep_the_state(
    oscillator_twin: Instance,
) -> None:
    """Another tone and damping on the way: what counts is what is different from then on."""
    change, end = 3e-5, 9.1e-5
    after = dict(LIVELY) | {"u1": 1.02e5, "d1": 5e3}
    fmu = started(oscillator_twin, change, **LIVELY)
    fmu.set(u1=1.02e5, d1=5e3)
    assert fmu.step(change, 2e-5) == OK
    assert fmu.step(5e-5, end - 5e-5) == OK

    def truth(p: Mapping[str, Any]) -> list[Any]:
        before = SimpleNamespace(**LIVELY, reflection=False)
        row = reference.retuned(before, SimpleNamespace(**p, reflection=False), change, [end])[0]
        return moved(p, row)

    # the tones are states of this truth, so that it has no phases to change
    along = {name: x for name, x in ALL.items() if not name.startswith("phase")}
    right = slopes(truth, after, along)
    agree(derivatives(fmu, MOVED, along), right, max(float(abs(x)) for x in right))


@pytest.mark.parametrize("values", [{}, {"solver": ENVELOPE}], ids=["exact", "envelope"])
def test_a_held_input_and_a_start_have_their_derivatives(
    oscillator_twin: Instance, values: Mapping[str, Any]
) -> None:
    """The input counts from where it is held; in initialisation nothing has moved yet."""
    times, inputs = (4e-5, 1.1e-4), (1e9, -2e9)
    fmu = started(oscillator_twin, **LIVELY, **values)
    assert derivatives(fmu, MOVED, ALL) == [0.0] * 4
    if values:
        return
    fmu.set(b=inputs[0])
    assert fmu.step(0.0, times[0]) == OK
    fmu.set(b=inputs[1])
    assert fmu.step(times[0], times[1] - times[0]) == OK

    def truth(p: Mapping[str, Any]) -> list[Any]:
        scene = SimpleNamespace(**LIVELY, reflection=False)
        row = reference.displacements(scene, times, inputs=[inputs[0], p["b"]])[-1]
        return [row[0], row[1]]

    right = slopes(truth, {"b": inputs[1]}, {"b": 1e9})
    found = derivatives(fmu, MOVED[:2], {"b": 1e9})
    agree(found, right, max(float(abs(x)) for x in right))


def test_the_envelope_is_the_derivative_of_itself(oscillator_twin: Instance) -> None:
    """Its own runs at both sides, whose differences keep some nine digits."""
    times, step = (2e-5, 8e-5), 1e-5
    names = [*MOVED, *QUADRATURES]
    for name in TUNABLE:
        sides = [
            started(
                oscillator_twin,
                *times,
                **dict(LIVELY) | {name: LIVELY[name] + sign * step * SIZES[name]},
                solver=ENVELOPE,
            ).get(*names)
            for sign in (1.0, -1.0)
        ]
        found = derivatives(
            started(oscillator_twin, *times, **LIVELY, solver=ENVELOPE),
            names,
            {name: SIZES[name]},
        )
        size = max(map(abs, sides[0]))
        for x, a, b in zip(found, *sides, strict=True):
            assert abs(x - (a - b) / (2.0 * step)) <= 1e-4 * max(size, abs(x)), name


REFUSED: Mapping[str, tuple[Mapping[str, Any], str, str, str]] = {
    "fixed": ({}, "q1", "solver", "is neither an input nor a tunable parameter"),
    "an output": ({}, "q1", "q2", "is neither an input nor a tunable parameter"),
    "no output": ({}, "d1", "d2", "is no Real output"),
    "no number": ({"theta": 0.3}, "lambda", "theta", "lambda has no derivative in closed form"),
    "rk4": ({"solver": RK4}, "q1", "theta", "q1 has no derivative in closed form"),
    "one mode": ({"other_mode": 1}, "q2", "theta", "q2 has no derivative in closed form"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_has_no_derivative_is_told_and_the_run_goes_on(
    oscillator_twin: Instance, case: str
) -> None:
    values, output, variable, words = REFUSED[case]
    fmu = started(oscillator_twin, **{**LIVELY, **values})
    with pytest.raises(FMICallException) as raised:
        derivatives(fmu, [output], {variable: 1.0})
    assert raised.value.status == DISCARD
    assert words in fmu.messages[-1][1]
    assert fmu.step(0.0, 1e-7) == OK


# --- three modes ----------------------------------------------------------------------------------

SCENE = dict(THREE)
WEIGHTS = {"readout1": 1.0, "readout2": 0.5, "readout3": -0.2}
DIRECTION = {name: 0.2 + 0.05 * k for k, name in enumerate(SCENE)}
SEEN = ("readout", "q1", "q2", "q3")
LINES = [f"{name}_{part}_u{k}" for k in (1, 2) for name in SEEN for part in "XY"]


def read(p: Mapping[str, Any], q: Sequence[Any]) -> list[Any]:
    return [mp.fsum(p[f"readout{i}"] * x for i, x in enumerate(q, start=1)), *q]


def test_steady_state_and_displacements_of_three_modes(modes_twin: Instance) -> None:
    values = SCENE | WEIGHTS
    along = DIRECTION | {"readout1": -0.3, "readout3": 0.7}
    fmu = started(modes_twin, 0.7, 2.9, **values)

    def steady(p: Mapping[str, Any]) -> list[Any]:
        rows = [read(p, row) for _, row in modes_reference.lines(p)]
        return [part for row in rows for z in row for part in (mp.re(z), mp.im(z))]

    def transient(p: Mapping[str, Any]) -> list[Any]:
        return read(p, modes_reference.from_rest(p, [2.9])[0])

    for truth, names in ((steady, LINES), (transient, SEEN)):
        right = slopes(truth, values, along)
        agree(derivatives(fmu, names, along), right, max(float(abs(x)) for x in right))


def test_eigenfrequencies_and_widths_of_three_modes(modes_twin: Instance) -> None:
    """By mpmath's eigensystem of the stiffness matrix."""

    def truth(p: Mapping[str, Any]) -> list[Any]:
        c = mp.zeros(3)
        for i in range(3):
            c[i, i] = p[f"f{i + 1}"] ** 2
            for j in range(i):
                c[i, j] = c[j, i] = -(p[f"lambda{j + 1}{i + 1}"] ** 2)
        values, vectors = mp.eigsy(c)
        widths = [mp.fsum(p[f"d{k + 1}"] * vectors[k, i] ** 2 for k in range(3)) for i in range(3)]
        return [*(mp.sqrt(x) for x in values), *widths]

    names = [*(f"eta{i}" for i in (1, 2, 3)), *(f"width{i}" for i in (1, 2, 3))]
    fmu = started(modes_twin, **SCENE)
    right = slopes(truth, SCENE, DIRECTION)
    agree(derivatives(fmu, names, DIRECTION), right, 1.0, 1e-13)


def test_sidebands_of_a_pump_as_a_dense_solve_has_them(modes_twin: Instance) -> None:
    """Under a pump of little depth, and where one of no depth begins."""
    names = [f"readout_{part}_u1{side}" for side in ("", "_upper", "_lower") for part in "XY"]

    def truth(p: Mapping[str, Any]) -> list[Any]:
        found = modes_reference.sidebands(p, p["u1"], 4, p["pump_phase"])
        amplitude = p["A1"] * mp.expj(p["phase1"])
        seen = [amplitude * read(p, found[side])[0] for side in (0, 1, -1)]
        return [part for z in seen for part in (mp.re(z), mp.im(z))]

    shallow = {k: v * (0.02 if k.startswith("depth") else 1.0) for k, v in PUMP.items()}
    off: Scene = {k: 0.0 if k.startswith("depth") else v for k, v in PUMP.items()}
    along = DIRECTION | {name: 0.1 * (1 + k) for k, name in enumerate(PUMP)}
    for pump in (shallow, off):
        values = SCENE | WEIGHTS | pump
        fmu = started(modes_twin, 0.7, **values)
        right = slopes(truth, values, along)
        size = max(float(abs(x)) for x in right)
        agree(derivatives(fmu, names, along), right, size)
        with pytest.raises(FMICallException):
            derivatives(fmu, ["q1"], along)
        assert math.isfinite(fmu.get("q1")[0])
