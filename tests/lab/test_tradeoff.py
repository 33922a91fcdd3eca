"""Accuracy against cost: the parts against truth from outside, the command as a user runs it."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import build_fmu
from fitting.cli.main import main
from fitting.fmu import FmuWorkers
from fitting.lab import exact as exact_modes
from fitting.lab.names import AMPLITUDES
from fitting.lab.string import TwoModes, steady_state
from fitting.lab.tradeoff import study
from fitting.lab.tradeoff.api import write_tradeoff
from fitting.lab.tradeoff.bench import Bench, Patience, largest_lines, read, window_of
from fitting.lab.tradeoff.extrapolation import closed_orbits, stepped_setting
from fitting.lab.tradeoff.front import cheapest, pareto
from fitting.lab.tradeoff.quantities import error_of, values_of
from fitting.lab.tradeoff.records import COHERENT, Cost, Measurement, Setting, Study
from fitting.lab.tradeoff.reference import references_of
from fitting.lab.tradeoff.report import markdown, page_of, screen_lines
from fitting.lab.tradeoff.scenes import SENSOR, STRING, STRING_TONES, scene_named
from fitting.lab.tradeoff.study import Memory, StudyOptions, run_study
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from tests.support import reference

ONCE = Patience(1, 0.0, 0.0)


@pytest.fixture(scope="module", autouse=True)
def _once() -> Iterator[None]:
    """Every setting is timed once: nothing here is said of times that needs more."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "QUICK_PATIENCE", ONCE)
        patch.setattr(study, "QUICK_ROUNDS", 1)
        yield


# --- 50 digits -----------------------------------------------------------------------------------


class Parameters:
    """Parameters by the FMU's names, as ``tests.reference`` wants them."""

    def __init__(self, modes: TwoModes) -> None:
        self.theta, self.reflection = modes.theta_rad, modes.reflection
        self.d1, self.d2 = modes.d1_hz, modes.d2_hz
        self.eta_plus, self.eta_minus = modes.eta_plus_hz, modes.eta_minus_hz
        self.g1 = self.g2 = 1.0


@pytest.mark.parametrize("reflect", [False, True])
@pytest.mark.parametrize("observed", [0, 1])
def test_amplitudes_are_those_of_another_solution(observed: int, reflect: bool) -> None:
    """By numpy where Q is low; by mpmath's LU decomposition at the string's own numbers."""
    low = replace(SENSOR, reflection=reflect)
    tones = [29.0e3, 30.2e3, 30.3e3, 35.0e3, 41.0e3]
    solved = np.abs(steady_state(low, np.array(tones))[:, observed])
    np.testing.assert_allclose(exact_modes.amplitudes(low, observed, tones), solved, rtol=1e-12)
    string = replace(STRING, reflection=reflect)
    truth = [float(abs(reference.phasors(Parameters(string), u)[observed])) for u in STRING_TONES]
    found = exact_modes.amplitudes(string, observed, STRING_TONES)
    np.testing.assert_allclose(found, truth, rtol=1e-15)


def test_width_and_crest_of_modes_without_damping_between_them() -> None:
    """With d1 = d2 the modes are two plain oscillators: 1/((2 pi)^2 w sqrt(eta^2 - w^2/4))."""
    modes = TwoModes(
        theta_rad=1.1, d1_hz=600.0, d2_hz=600.0, eta_plus_hz=30.3e3, eta_minus_hz=41.0e3
    )
    assert exact_modes.line_width_hz(modes, 0) == pytest.approx(600.0, rel=1e-15)
    top = 1.0 / ((2 * math.pi) ** 2 * 600.0 * math.sqrt(30.3e3**2 - 150.0 * 600.0))
    assert exact_modes.crest(modes, 0) == pytest.approx(top, rel=1e-14)


def test_crest_is_above_every_other_point() -> None:
    f = STRING.eta_plus_hz + np.linspace(-60.0, 60.0, 41)
    near = exact_modes.amplitudes(STRING, 0, f.tolist())
    top = exact_modes.crest(STRING, 0)
    assert np.all(near <= top)
    assert np.max(near) == pytest.approx(top, rel=1e-3)


def test_the_recursions_error_is_of_order_four() -> None:
    truth = exact_modes.amplitudes(SENSOR, 0, [30.15e3])
    errors = [
        abs(exact_modes.runge_kutta_amplitudes(SENSOR, 0, [30.15e3], 1.0 / (n * 41e3)) / truth - 1)
        for n in (640.0, 1280.0, 2560.0)
    ]
    ratios = [float(a[0] / b[0]) for a, b in pairwise(errors)]
    assert ratios == pytest.approx([16.0, 16.0], rel=0.02)


# --- readers -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("flat", "decibel"), [(True, 0.01), (False, 3.93)])
def test_scalloping_is_the_textbooks(flat: bool, decibel: float) -> None:
    """Worst between two bins: 0.01 dB with the flat-top window, 3.92 dB without."""
    n, step = 128, 1e-3
    worst = 0.0
    for place in np.linspace(30.0, 31.0, 21):
        tone = float(place) / (n * step)
        values = np.cos(2 * np.pi * tone * np.arange(n) * step)
        found = float(largest_lines(values, step, [tone], flat=flat)[0])
        worst = max(worst, abs(20 * math.log10(found)))
    assert worst <= decibel
    assert flat or worst > 3.85


@pytest.mark.parametrize("reader", ["coherent", "flat-top"])
def test_readers_find_both_tones(reader: str) -> None:
    """Tones of known size, sampled far below their frequency."""
    tones, sizes = (6.94016e6, 6.94036e6), (1.0, 0.5)
    plan = window_of(tones, 0.0, reader, 12.37 / 200.0, 101)
    t = plan.settle_s + np.arange(plan.samples) * plan.step_s
    turns = [np.mod(tone * t, 1.0) for tone in tones]
    values = sum(a * np.cos(2 * np.pi * x + 0.3) for a, x in zip(sizes, turns, strict=True))
    found = read(reader, plan, np.asarray(values))
    np.testing.assert_allclose(found, sizes, rtol=1e-8 if reader == COHERENT else 3e-3)


# --- the front -----------------------------------------------------------------------------------


def measured(error: float, cost: float) -> Measurement:
    setting = Setting(quantity=AMPLITUDES, solver="exact", window_s=1.0, samples=7)
    return Measurement(setting=setting, error=error, cost=Cost(seconds=cost, cpu_s=cost))


small = st.integers(1, 6).map(float)


@given(st.lists(st.tuples(st.one_of(small, st.just(math.inf)), small), max_size=12))
def test_front_is_that_of_brute_force(pairs: list[tuple[float, float]]) -> None:
    found = [(m.error, m.cost_s) for m in pareto([measured(*pair) for pair in pairs])]
    expected = {
        (e, c)
        for e, c in pairs
        if math.isfinite(e) and not any(f <= e and d <= c and (f, d) != (e, c) for f, d in pairs)
    }
    assert set(found) == expected
    assert len(found) == len(expected)
    assert found == sorted(found, key=lambda pair: pair[1])


@given(st.lists(st.tuples(small, small), max_size=12), small)
def test_cheapest_has_the_accuracy(pairs: list[tuple[float, float]], wanted: float) -> None:
    found = cheapest([measured(*pair) for pair in pairs], wanted)
    costs = [c for e, c in pairs if e <= wanted]
    assert (None if found is None else found.cost_s) == min(costs, default=None)


# --- the FMU -------------------------------------------------------------------------------------


def richardson(coarse: FloatArray, fine: FloatArray) -> FloatArray:
    """Limit of a method of order four from two runs, the second with half the step."""
    return np.asarray(fine + (fine - coarse) / 15.0)


@pytest.fixture(scope="module")
def sensor(swift_fmu: Path) -> Iterator[Bench]:
    with FmuWorkers(swift_fmu) as workers:
        yield Bench(scene_named("low-q"), workers, ONCE)


def test_runge_kutta_settles_where_its_recursion_stands_still(sensor: Bench) -> None:
    """So an extrapolated row's error is what a run would have shown; and it falls with order 4."""
    scene = sensor.scene
    truth = references_of(sensor)[0]
    errors = []
    for count in (20.0, 40.0, 80.0):
        setting = stepped_setting(scene, count, scene.settling_s(1e-12))
        found = values_of(sensor, setting, None)
        step = sensor.window(setting, scene.drives[0]).step_s
        h = step / math.ceil(step * count * scene.fastest_hz * (1 - 1e-12))
        still = exact_modes.runge_kutta_amplitudes(SENSOR, 0, scene.drives[0].tones_hz, h)
        # settling is cut into substeps of its own, a little shorter or longer
        apart = np.abs(found - still) / np.abs(still - np.array(truth.values))
        assert np.all(apart < 0.05)
        errors.append(error_of(found, truth))
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.15)
    assert errors[2] > 1e-8


@pytest.fixture(scope="module")
def duffing_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_fmu.build("DuffingOscillator", tmp_path_factory.mktemp("duffing"))


def test_harmonic_balance_is_where_runge_kutta_settles(duffing_fmu: Path) -> None:
    """The reference takes no FMU; an FMU from rest, refined and extrapolated, agrees."""
    scene = scene_named("duffing")
    with FmuWorkers(duffing_fmu) as workers:
        bench = Bench(scene, workers, ONCE)
        settle = scene.settling_s(1e-6)
        settings = [stepped_setting(scene, count, settle) for count in (40.0, 80.0)]
        coarse, fine = (values_of(bench, setting, None) for setting in settings)
        peaks = references_of(bench)[0]
    assert peaks.error < 1e-9
    assert error_of(richardson(coarse, fine), peaks) < 1e-5  # what is left is of order five
    assert error_of(fine, peaks) > 3e-5


def test_closed_orbits_are_closed_at_the_strings_own_q(duffing_fmu: Path) -> None:
    """With next to no cubic force rk4 must stand where the linear recursion does.

    In one period a start off the orbit moves by 4e-5 of the distance only: hard to see, easy to
    take for closed.
    """
    scene = scene_named("duffing-string")
    weak = {"alpha1": 1e18, "alpha2": 1e18, "kappa": 1e18}
    single = replace(scene.single, start_values={**scene.single.start_values, **weak})
    scene = replace(scene, single=single)
    with FmuWorkers(duffing_fmu) as workers:
        bench = Bench(scene, workers, ONCE)
        found = [closed_orbits(bench, substeps) for substeps in (160.0, 320.0)]
    tones = scene.drives[0].tones_hz
    for count, orbit in zip((160, 320), found, strict=True):
        # the tone of the higher frequency has the same whole number of substeps in its period
        h = 1.0 / (count * tones[0])
        still = exact_modes.runge_kutta_amplitudes(STRING, 0, tones[:1], h)
        np.testing.assert_allclose(orbit[:1], still, rtol=1e-8)
    truth = exact_modes.amplitudes(STRING, 0, tones)
    np.testing.assert_allclose(found[0], truth, rtol=2e-3)
    np.testing.assert_allclose(richardson(*found), truth, rtol=1e-6)


@pytest.mark.parametrize("count", [1, 2])
def test_processor_time_is_told_of_one_process_only(swift_fmu: Path, count: int) -> None:
    """Of several the sum is nobody's waiting: then wall time is what costs are compared by."""
    scene = scene_named("low-q")
    setting = stepped_setting(scene, 40.0, 0.0)
    with FmuWorkers(swift_fmu, workers=count) as workers:
        bench = Bench(scene, workers, ONCE)
        bench.warm(dict(setting.values))
        _, cost = bench.timed(lambda: values_of(bench, setting, None))
    found = Measurement(setting=setting, error=0.0, cost=cost)
    told = count == 1 and Path("/proc/self/schedstat").exists()
    assert math.isfinite(cost.cpu_s) == told
    assert found.cost_s == (cost.cpu_s if told else cost.seconds)
    assert (cost.repeats, cost.runs, cost.reads) == (1, 1, 64)


def test_interrupted_and_resumed_is_the_same(swift_fmu: Path, tmp_path: Path) -> None:
    """Finished settings are kept as they are, the others give the errors of an unbroken run."""
    scene = scene_named("string")
    # whatever counts its steps is extrapolated, however fast the machine is
    options = StudyOptions(
        accuracies=(1e-3,), quick=True, quantities=(AMPLITUDES,), longest_s=1e-12
    )

    def stop(text: str) -> None:
        if text.startswith("20/"):
            raise KeyboardInterrupt

    with FmuWorkers(swift_fmu) as workers:
        broken = run_study(scene, workers, options, Memory(tmp_path, "job"), stop)
        kept = Memory(tmp_path, "job")
        assert kept.resume()
        assert len(kept) == 19
        resumed = run_study(scene, workers, options, kept)
        whole = run_study(scene, workers, options, Memory(tmp_path / "whole", "job"))
    assert broken.status == "interrupted"
    assert len(broken.measurements) == 19
    first = {m.setting.key: m.error for m in broken.measurements}
    again = {m.setting.key: m.error for m in resumed.measurements}
    assert resumed.status == whole.status == "finished"
    assert again.items() >= first.items()
    # the plan measures anew; what it finds is the same, which of two equals is cheaper is not
    resumed_grid, whole_grid = resumed.of(AMPLITUDES), whole.of(AMPLITUDES)
    assert [m.setting for m in resumed_grid] == [m.setting for m in whole_grid]
    for a, b in zip(resumed_grid, whole_grid, strict=True):
        assert a.extrapolated or a.error == b.error
    with pytest.raises(BadInput, match=r"tradeoff-checkpoint\.json"):
        Memory(tmp_path, "another job").resume()


def halfway(*measurements: Measurement, status: str = "interrupted") -> Study:
    return Study(
        scene="low-q",
        title="Sensor",
        synthetic=True,
        description="linear",
        references=(),
        measurements=measurements,
        accuracies=(1e-2, 1e-6),
        status=status,
        message="some settings.",
    )


@pytest.mark.parametrize(
    ("status", "wanted", "unwanted"),
    [
        ("interrupted", ("not yet", "none so far"), ("not reached", "no promise")),
        ("finished", ("not reached", "no promise"), ("not yet", "none so far")),
    ],
)
def test_what_may_still_come_is_not_told_as_missed(
    status: str, wanted: tuple[str, str], unwanted: tuple[str, str]
) -> None:
    setting = Setting(quantity=AMPLITUDES, solver="exact", window_s=1.0, samples=8)
    rough = Measurement(setting=setting, error=1e-3, cost=Cost(seconds=1.0, cpu_s=1.0, repeats=1))
    half = halfway(rough, replace(rough, planned_for=1e-2), status=status)
    shown = "\n".join(screen_lines(half))
    assert wanted[0] in shown
    for text in (shown, markdown(half), repr(page_of(half, ()))):
        assert not any(words in text for words in unwanted)
    for text in (markdown(half), repr(page_of(half, ()))):
        assert all(words in text for words in wanted)


def test_a_study_that_ended_before_its_first_setting_is_written(tmp_path: Path) -> None:
    names = [path.name for path in write_tradeoff(halfway(), tmp_path)]
    assert names == ["tradeoff.csv", "tradeoff.md", "report.html"]
    assert rows(tmp_path) == []
    assert "tradeoff_" not in (tmp_path / "report.html").read_text("utf-8")  # a figure's name


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"accuracies": (1e-3, 2.0)}, r"accuracies: found 2\.0"),
        ({"quantities": ("phases",)}, "quantities: found 'phases', .*amplitudes"),
    ],
)
def test_what_cannot_be_asked_of_a_study(asked: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        StudyOptions(**asked)


# --- the command ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def quick_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("tradeoff")
    asked = ["--scene", "string", "--quick", "--accuracies", "1e-3"]
    assert main(["tradeoff", *asked, "--out", str(out)]) == 0
    return out


def rows(out: Path) -> list[dict[str, str]]:
    with (out / "tradeoff.csv").open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_quick_run_writes_everything(quick_run: Path) -> None:
    names = {str(p.relative_to(quick_run)) for p in quick_run.rglob("*") if p.is_file()}
    assert {"tradeoff.csv", "tradeoff.md", "report.html"} <= names
    assert {f"figures/1_tradeoff_string.{kind}" for kind in ("csv", "svg")} <= names
    assert not any("checkpoint" in name for name in names)
    page = (quick_run / "report.html").read_text("utf-8")
    assert "SYNTHETIC DATA" in page
    assert "1_tradeoff_string" in page
    assert "nan<" not in page


def test_only_what_was_not_run_is_called_extrapolated(quick_run: Path) -> None:
    """Runge-Kutta takes minutes for the string to settle: not run, and said so, nothing else."""
    table = rows(quick_run)
    assert {row["solver"] for row in table if row["cost_is"] == "extrapolated"} == {"rk4"}
    assert {row["cost_is"] for row in table if row["solver"] != "rk4"} == {"measured"}
    for row in table:
        assert float(row["seconds"]) > 0.0
        assert (int(row["repeats"]) == 0) == (row["cost_is"] == "extrapolated")
        assert row["planned_for"] or bool(row["note"]) == (row["cost_is"] == "extrapolated")
        if row["cost_is"] == "extrapolated":
            assert float(row["seconds"]) > 1.0
            assert int(row["solver_steps"]) > 100_000


def test_exact_solver_is_nearly_free_on_the_string(quick_run: Path) -> None:
    """The coherent rows reach 1e-9; flat-top and none stay at their textbook errors."""
    table = [
        r
        for r in rows(quick_run)
        if r["solver"] == "exact" and r["quantity"] == AMPLITUDES and not r["planned_for"]
    ]
    coherent = [
        float(r["error"]) for r in table if r["reader"] == "coherent" and r["start"] == "periodic"
    ]
    assert max(coherent) < 1e-9
    flat = [float(r["error"]) for r in table if r["reader"] == "flat-top"]
    assert 1e-5 < min(flat) <= max(flat) < 3e-3
    plain = [float(r["error"]) for r in table if r["reader"] == "none"]
    assert max(plain) > 0.05


CAMPAIGN = """
title = "Cubic sensor (synthetic)"
synthetic = true
[fmu]
model = "DuffingOscillator"
[fmu.start]
theta = 0.0
d2 = 20000.0
eta_plus = 100000.0
eta_minus = 130000.0
alpha1 = 2e24
alpha2 = 0.0
[observe]
output = "q1_hybrid"
line_width = "20 kHz"
[drive]
kind = "tones"
frequencies = ["u1", "u2"]
amplitudes = ["A1", "A2"]
[experiments]
file = "experiments.csv"
peaks = ["p1", "p2"]
amplitude = "m peak"
[[parameters]]
name = "d1"
unit = "Hz"
lower = 5000
upper = 50000
start = 20000
scale = 1000
[accuracy]
tolerance = "tolerance"
substep = "rk4_substep"
full = { solver = 2 }
[[accuracy.reductions]]
name = "averaged envelope"
set = { solver = 1 }
bound = "envelope_error"
"""


def test_a_campaigns_own_knobs_are_tried(tmp_path: Path) -> None:
    """[accuracy] names solvers and what sets them; errors are from the finest of them."""
    (tmp_path / "campaign.toml").write_text(CAMPAIGN, "utf-8")
    drives = "experiment,u1 (Hz),u2 (Hz),p1 (m),p2 (m)\n1,95000,105000,1e-10,1e-10\n"
    (tmp_path / "experiments.csv").write_text(drives, "utf-8")
    out = tmp_path / "out"
    asked = ["--campaign", str(tmp_path / "campaign.toml"), "--accuracies", "1e-2"]
    assert main(["tradeoff", *asked, "--quick", "--out", str(out)]) == 0
    table = rows(out)
    kinds = {(r["solver"], r["resolution_kind"]) for r in table}
    for solver in ("full model", "averaged envelope"):
        assert {(solver, "tolerance"), (solver, "substeps per period")} <= kinds

    def least_error(substeps: float) -> float:  # of several rows, whose order is that of their cost
        return min(
            float(r["error"])
            for r in table
            if (r["solver"], r["resolution_kind"]) == ("full model", "substeps per period")
            and (r["reader"], float(r["resolution"])) == ("coherent", substeps)
        )

    assert least_error(80.0) < least_error(20.0) / 100.0
    page = (out / "tradeoff.md").read_text("utf-8")
    assert "full model" in page
    assert {r["cost_is"] for r in table} == {"measured"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--scene", "sring"], "sring"),
        (["--accuracies", "1e-3,fine"], "--accuracies: found 'fine'"),
        (["--accuracies", "2"], "--accuracies: found '2'"),
        (["--campaign", "absent.toml"], "absent.toml"),
        (["--scene", "string", "--campaign", "absent.toml"], "--campaign"),
        (["--workers", "0"], "--workers"),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["tradeoff", *arguments, "--out", str(out)]) == 2
    said = capsys.readouterr()
    assert words in said.err
    assert said.err.count("\n") == 1
    assert not out.exists()
