"""The whole chain at the edges of the model: each case is right, or says in a sentence that not.

Files as a user has them, the real reader, the FMU by its native twin, Algorithms 1 and 2. Truth is
the virtual laboratory's closed form, or mpmath's. `tests/fit/test_extremes_data.py` has the edges
of the data, and `python tests/bench/bench_extremes.py` measures where each of them stops.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fitting.fmu.pool import FmuWorkers
from fitting.result.result import Result
from fitting.text.errors import BadInput
from fitting.text.estimate import Verdict
from fitting.text.finding import Kind, of_kind
from fitting.text.rendering import sentence
from tests.support.extreme_scenes import Fitted, Scene, fit, no_false_success
from tests.support.samples import cases

EPS = 2.0**-52
Fit = Callable[[Scene], Result]

#: A sweep that is fitted as a whole needs no maximum on its grid. In one of ten points no faults
#: are looked for: of two lines without noise that takes longer than the fit.
WHOLE = Scene(scale="fit", points=10)


@pytest.fixture(scope="module")
def workers(swift_fmu: Path) -> Iterator[FmuWorkers]:
    with FmuWorkers(swift_fmu, workers=1) as started:
        yield started


@pytest.fixture
def fitted(workers: FmuWorkers, tmp_path: Path) -> Fit:
    def run(scene: Scene) -> Result:
        result = fit(scene, workers, tmp_path)
        no_false_success(result, scene)
        return result

    return run


def width_error(result: Result, scene: Scene) -> float:
    """Relative error of the line width, of a fit that says it is done and knows."""
    found = result.derived["width_plus"]
    assert (result.status, found.status) == ("converged", "linearised only")
    return abs(found.value / scene.width - 1.0)


def nightly(*values: float | str | bool) -> Any:
    """A case of which the others of its test are a sample."""
    return pytest.param(*values, marks=pytest.mark.nightly)


@pytest.mark.parametrize(
    ("q", "eta"),
    [
        *((5.0, 1.0), (1e8, 1e10)),
        *(nightly(q, eta) for q, eta in ((1e4, 7e6), (5.0, 7e6), (5.0, 1e10), (1e4, 1.0))),
        *(nightly(q, eta) for q, eta in ((1e4, 1e10), (1e8, 1.0), (1e8, 7e6))),
    ],
)
def test_quality_factors_and_frequencies(q: float, eta: float, fitted: Fit) -> None:
    """Rounding of a frequency is Q eps of a line width; the rest is the optimiser's 1e-8."""
    scene = replace(WHOLE, eta_plus=eta, eta_minus=1.5 * eta, d1=eta / q, d2=1.2 * eta / q)
    assert width_error(fitted(scene), scene) < 1e-8 + 10.0 * q * EPS


@pytest.mark.parametrize(
    ("apart_hz", "bound"), [(1e-3, 1e-5), nightly(1.0, 1e-7), nightly(1e3, 1e-8)]
)
def test_tones_from_a_millihertz_to_ten_line_widths_apart(
    apart_hz: float, bound: float, fitted: Fit
) -> None:
    near = apart_hz / Scene().width
    scene = Scene(tones=((0.0, near), (0.5, 0.5 + near)))
    assert width_error(fitted(scene), scene) < bound


@pytest.mark.parametrize("drift", [nightly(0.5), nightly(50.0), 500.0])
def test_a_drift_that_is_told_may_be_any_number_of_line_widths(drift: float, fitted: Fit) -> None:
    scene = Scene(drift=drift)
    assert width_error(fitted(scene), scene) < 1e-8


def test_a_drift_that_is_not_told_is_no_success(fitted: Fit) -> None:
    little = fitted(Scene(drift=0.5, drift_known=False))
    assert little.derived["width_plus"].status != "determined"
    lost = fitted(Scene(drift=5.0, drift_known=False))
    assert lost.status == "not converged"
    assert "peaks" in lost.message


@pytest.mark.parametrize("misfit", [nightly("slack"), "squares"])
def test_the_scale_of_the_amplitudes_changes_no_bit(misfit: str, fitted: Fit) -> None:
    """Powers of two from 1e-285 to 1e285: the same x, chi scaled."""
    scene = Scene(noise=1e-3, peaks=False, misfit=misfit, points=15, nu=(1e-3, 1e-3, 2))
    one = fitted(scene)
    for power in (-945, 945):
        other = fitted(replace(scene, crest=2.0**power))
        assert other.parameters == one.parameters
        assert other.scale.final == math.ldexp(one.scale.final, power)
        assert [r.parameters for r in other.history] == [r.parameters for r in one.history]
        assert [r.j_fit for r in other.history] == [r.j_fit for r in one.history]
        assert other.deviations == one.deviations
        assert other.warnings == one.warnings


FITTED = replace(WHOLE, use="fit")


@pytest.mark.parametrize(
    ("scene", "crest"),
    [
        *((Scene(), 1e290), (FITTED, 1e-300)),
        *(
            pytest.param(*each, marks=pytest.mark.nightly)
            for each in ((Scene(), 1e-300), (FITTED, 1e290))
        ),
    ],
)
def test_amplitudes_from_1e_300_to_1e290(scene: Scene, crest: float, fitted: Fit) -> None:
    scene = replace(scene, crest=crest)
    assert width_error(fitted(scene), scene) < 1e-8


def test_a_drive_of_any_size(fitted: Fit) -> None:
    for level in (1e-290, 1e300):
        scene = Scene(level=level)
        assert width_error(fitted(scene), scene) < 1e-8


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (Scene(crest=1e300), "ratio"),
        (Scene(crest=1e-310), "unit"),
        (Scene(level=1e-300), "positive"),
        (replace(WHOLE, level=1e-300), "zero"),
    ],
)
def test_amplitudes_beyond_the_range_of_numbers_are_told(
    scene: Scene, words: str, fitted: Fit
) -> None:
    with pytest.raises(BadInput, match=words):
        fitted(scene)


@pytest.mark.parametrize("unit", ["GHz", nightly("kHz")])
def test_the_unit_of_a_frequency_changes_no_bit(unit: str, fitted: Fit) -> None:
    scene = Scene(noise=1e-3, peaks=False, drift=3.0, points=15, nu=(1e-3, 1e-3, 1))
    one, other = (fitted(replace(scene, unit=each)) for each in ("Hz", unit))
    assert other.parameters == one.parameters
    assert other.derived == one.derived
    assert other.peaks == one.peaks
    assert other.warnings == one.warnings


@pytest.mark.parametrize("factor", [1e-6, nightly(100.0)])
def test_a_scene_scales_with_its_frequencies(factor: float, fitted: Fit) -> None:
    """A hundred times and a millionth: the same Q, the same noise, the same relative width."""
    scene = Scene(noise=1e-3, eta_plus=6.4e6, d1=64.0, d2=96.0, eta_minus=6.5e6, theta=1.75)
    one = fitted(scene).derived["width_plus"].value / scene.width
    names = ("d1", "d2", "eta_plus", "eta_minus")
    other = replace(scene, **{name: factor * getattr(scene, name) for name in names})
    found = fitted(other).derived["width_plus"].value / other.width
    assert found == pytest.approx(one, rel=1e-7)


POINT = replace(WHOLE, theta=3.0 * math.pi / 4.0, d1=150.0, d2=50.0)
DEGENERATE = {
    "equal eigenfrequencies": replace(WHOLE, eta_minus=6.94e6),
    "equal eigenfrequencies and dampings": replace(WHOLE, eta_minus=6.94e6, d2=100.0),
    "apart by 1e-12": replace(WHOLE, eta_minus=6.94e6 * (1.0 + 1e-12)),
    "exceptional point": replace(POINT, eta_minus=6.94005e6),
    "1 mHz beside it": replace(POINT, eta_minus=6.940050001e6),
    "one damping 1e4 times the other": replace(WHOLE, d1=1e4, d2=1.0),
}


#: Cases that others are harder than, for the night: equal dampings too, and the point itself.
EASIER = ("equal eigenfrequencies", "1 mHz beside it")


@pytest.mark.parametrize(
    "name", cases(DEGENERATE, *(name for name in DEGENERATE if name not in EASIER))
)
def test_degenerate_modes_and_the_exceptional_point(name: str, fitted: Fit) -> None:
    """Eigenfrequencies apart by half the difference of the dampings, at 45 degrees: one mode."""
    scene = DEGENERATE[name]
    assert width_error(fitted(scene), scene) < 1e-7


@pytest.mark.parametrize(
    ("eighths", "reflection"),
    [
        *((0, False), (2, True), (6, False)),
        *(nightly(*each) for each in ((0, True), (2, False), (6, True), (8, False), (8, True))),
    ],
)
def test_angles_of_symmetry(eighths: int, reflection: bool, fitted: Fit) -> None:
    scene = Scene(theta=eighths * math.pi / 8.0, reflection=reflection)
    result = fitted(scene)
    assert width_error(result, scene) < 1e-8
    real = math.sin(2.0 * scene.theta) <= 0.0
    assert math.isnan(result.derived["lambda"].value) != real
    assert bool(of_kind(result.findings, Kind.fmu_warning)) != real


def test_at_a_right_angle_the_other_damping_is_seen(fitted: Fit) -> None:
    """theta = pi/2: the first mode is damped by d2 alone, and d1 is said to be unknown."""
    blind = fitted(Scene(theta=math.pi / 2.0))
    assert blind.parameters["d1"].status == "not known"
    assert math.isnan(blind.parameters["d1"].std)
    seen = fitted(Scene(theta=math.pi / 2.0, fitted={"d2": Fitted(20.0, 500.0, 180.0, 100.0)}))
    assert seen.parameters["d2"].value == pytest.approx(120.0, rel=1e-8)


def test_a_start_at_a_symmetric_angle_invents_no_angle(workers: FmuWorkers, tmp_path: Path) -> None:
    """There the data see the angle to second order alone: only profiles can tell."""
    box = {"theta": Fitted(-2.0 * math.pi, 2.0 * math.pi, 0.0, 1.0)}
    scene = Scene(fitted=box, nu=(0.1, 0.1, 3), points=9)
    result = fit(scene, workers, tmp_path, profiles=True)
    angle = result.parameters["theta"]
    assert angle.status == "one of several values"
    assert abs(math.cos(angle.value)) == pytest.approx(abs(math.cos(scene.theta)), abs=1e-6)
    assert angle.ci95[0] < scene.theta < angle.ci95[1]


@pytest.mark.parametrize("nu", [nightly(1.0), nightly(1e-6), 1e-16])
def test_a_small_prior_moves_nothing(nu: float, fitted: Fit) -> None:
    scene = Scene(nu=(nu, 0.1, 2))
    assert width_error(fitted(scene), scene) < 1e-8


def test_a_prior_stronger_than_the_data_is_told(fitted: Fit) -> None:
    result = fitted(Scene(nu=(1e6, 0.1, 2)))
    d1 = result.parameters["d1"]
    assert d1.algorithm2 == pytest.approx(150.0, abs=0.01)
    assert d1.value == pytest.approx(100.0, abs=0.01)  # of the likelihood, which knows no nu
    assert d1.status is Verdict.LINEARISED  # and so is its error


def test_nu_through_22_decades(fitted: Fit) -> None:
    scene = Scene(nu=(1e6, 1e-11, 3))
    result = fitted(scene)
    assert result.history[-1].nu == pytest.approx(1e-16)
    assert width_error(result, scene) < 1e-8


def on_bound(result: Result, end: str) -> bool:
    """Whether Algorithm 2 is said to have ended with d1 on or next to such an end of its box."""
    found = of_kind(result.findings, Kind.at_bound)
    return any("d1 " in sentence(each) and f"({end})" in sentence(each) for each in found)


@pytest.mark.parametrize(
    "box", [pytest.param((50.0, 100.0), marks=pytest.mark.nightly), (100.0, 200.0)]
)
def test_a_solution_on_a_bound_is_reached_and_told(box: tuple[float, float], fitted: Fit) -> None:
    for start in box:
        scene = Scene(fitted={"d1": Fitted(*box, start, 100.0)})
        result = fitted(scene)
        assert width_error(result, scene) < 1e-8
        assert on_bound(result, "100 Hz")


def test_a_solution_next_to_a_bound_is_not_told_to_be_on_it(fitted: Fit) -> None:
    result = fitted(Scene(fitted={"d1": Fitted(99.97, 200.0, 150.0, 100.0)}))
    assert on_bound(result, "99.97 Hz")
    assert not on_bound(result, "100 Hz")


@pytest.mark.parametrize("box", [(150.0, 200.0), (20.0, 80.0)])
def test_a_solution_outside_the_box_ends_on_its_bound(
    box: tuple[float, float], fitted: Fit
) -> None:
    result = fitted(Scene(fitted={"d1": Fitted(*box, sum(box) / 2.0, 100.0)}))
    assert on_bound(result, f"{min(box, key=lambda end: abs(end - 100.0)):g} Hz")
    # the barrier of the interior point keeps the last level inside
    end = min(box, key=lambda bound: abs(bound - 100.0))
    assert result.parameters["d1"].algorithm2 == pytest.approx(end, rel=1e-4)
    assert min(box) <= result.parameters["d1"].algorithm2 <= max(box)
    assert result.parameters["d1"].value == pytest.approx(end, rel=1e-6)
    assert math.isnan(result.parameters["d1"].std)


def free_line(off: float, width: float = 100.0) -> dict[str, Fitted]:
    """Frequency and damping free, the start that many line widths off."""
    start = 6.94e6 + off * width
    return {
        "eta_plus": Fitted(6.94e6 - 2e6, 6.94e6 + 2e6, start, 100.0),
        "d1": Fitted(10.0, 1000.0, 150.0, 100.0),
    }


def test_a_start_within_the_line_finds_it(fitted: Fit) -> None:
    scene = replace(WHOLE, use="fit", fitted=free_line(1.0))
    result = fitted(scene)
    assert width_error(result, scene) < 1e-7
    assert result.parameters["eta_plus"].value == pytest.approx(6.94e6, abs=1e-5)


@pytest.mark.parametrize(
    ("off", "misfit"),
    [
        *((30.0, "slack"), (10000.0, "squares")),
        *(nightly(*each) for each in ((30.0, "squares"), (10000.0, "slack"))),
        *(nightly(1000.0, misfit) for misfit in ("slack", "squares")),
    ],
)
def test_a_start_far_off_is_no_success(off: float, misfit: str, fitted: Fit) -> None:
    """There the response is flat in all parameters, and any point looks stationary."""
    scene = replace(WHOLE, tones=(), use="fit", fitted=free_line(off), misfit=misfit)
    result = fitted(scene)
    assert result.status == "not converged"
    assert "start" in result.message
