"""An FMU whose output is that of the beginning of a step: named, and read a step later."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pythonfmu

import fitting as ff
from fitting.fmu.runs import InputSignal, Run, SampledSignal, Segment
from fitting.text.errors import BadInput
from fitting.text.finding import Kind

SLAVE = Path(__file__).parents[1] / "bench/foreign/LateOutput.py"
FIELDS = """title = "An output that is late"

[fmu]
file = "LateOutput.fmu"
output_delay_steps = {delay}

[fmu.start]
late = {late}

[observe]
output = "x"

[[trace]]
file = "trace.csv"
input = "force"
interpolation = "held"
sigma = 3e-5

[[parameters]]
name = "f0"
lower = 5.0
upper = 20.0
start = 9.5

[[parameters]]
name = "d"
lower = 0.05
upper = 5.0
start = 1.0
"""


def recorded(folder: Path) -> None:
    """x'' + 2 pi d x' + (2 pi 10)^2 x = F, d = 0.5, F held over samples; exact, with noise."""
    t = 0.005 * np.arange(61.0)
    rng = np.random.default_rng(3)
    force = np.repeat(rng.uniform(-1.0, 1.0, 9), 7)[:61]
    w, g = 2.0 * np.pi * 10.0, np.pi * 0.5
    pole = complex(-g, np.sqrt(w * w - g * g))
    x, v = 0.0, 0.0
    seen = [x]
    for f in force[:-1]:
        rest = f / w**2
        c = complex(x - rest, ((x - rest) * pole.real - v) / pole.imag)
        moved = c * np.exp(pole * 0.005)
        x, v = rest + moved.real, (moved * pole).real
        seen.append(x)
    noisy = np.array(seen) + 3e-5 * rng.standard_normal(t.size)
    rows = np.column_stack([t, force, noisy])
    np.savetxt(
        folder / "trace.csv",
        rows,
        delimiter=",",
        header="time (s),force (1),x (1)",
        comments="",
        fmt="%.9g",
    )


@pytest.fixture(scope="module")
def late_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("late")
    pythonfmu.FmuBuilder.build_FMU(str(SLAVE), dest=str(folder))
    return folder / "LateOutput.fmu"


@pytest.mark.parametrize(("late", "delay"), [(0, 0), (1, 0), (1, 1)])
def test_a_late_output_is_read_later_and_named_where_nobody_stated_it(
    late: int, delay: int, late_fmu: Path, tmp_path: Path
) -> None:
    shutil.copy(late_fmu, tmp_path)
    recorded(tmp_path)
    path = tmp_path / "campaign.toml"
    path.write_text(FIELDS.format(late=float(late), delay=delay), encoding="utf-8")
    problem = ff.Problem.of(path)
    result = ff.fit(problem).result
    told = [f for f in result.findings if f.kind is Kind.output_late]
    assert [f.subject for f in told] == ["x"] * (late - delay)
    for finding in told:
        assert finding.numbers["step_s"] == pytest.approx(0.005)
    for name, truth in (("f0", 10.0), ("d", 0.5)):
        value = result.parameters[name]
        assert abs(value.value - truth) < 4.0 * value.std
    # no step is shorter than the samples are apart, but for the one after the last of them
    before = problem.fmu.workers.counts
    problem.residuals(problem.start)
    spent = problem.fmu.workers.counts
    assert spent.steps - before.steps <= 61 * (spent.runs - before.runs)


def test_outputs_that_are_read_later_are_those_of_their_time(late_fmu: Path) -> None:
    """Whatever divides the time: tones, values over steps, a variable moved, short steps, none."""
    force = np.random.default_rng(1).uniform(-1.0, 1.0, (40, 1))
    held = SampledSignal(("force",), 0.0025, force, np.zeros((19, 1)))
    shared: dict[str, Any] = {"settle_s": 0.01, "sample_step_s": 0.005, "outputs": ("x",)}
    signals: list[dict[str, Any]] = [
        {"input_signal": InputSignal("force", ((7.0, 1.0, 0.3),), 0.0025), "samples": 9},
        {"input_signal": held, "samples": 19},
        {"samples": 9, "longest_step_s": 0.002},
        {"samples": 1},
        {
            "samples": 3,
            "moved": "f0",
            "segments": (Segment(value=12.0, settle_s=0.004, sample_step_s=0.003, samples=4),),
        },
    ]
    made = []
    for late in (0, 1):
        values = {"late": float(late), "f0": 10.0, "force": 1.0}
        with ff.Fmu(late_fmu, workers=1, output_delay_steps=late) as fmu:
            runs = [Run(start_values=values, **shared, **signal) for signal in signals]
            made.append(fmu.workers.run(runs))
    for prompt, later in zip(*made, strict=True):
        assert np.ptp(prompt) > 0.0 or prompt.size == 1
        assert np.array_equal(prompt, later)


def test_only_communication_steps_can_be_late(late_fmu: Path) -> None:
    with pytest.raises(BadInput, match="output_delay_steps: found -1"):
        ff.Fmu(late_fmu, output_delay_steps=-1)
