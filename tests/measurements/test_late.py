"""An FMU whose output is that of the beginning of a step: named, and its coefficients right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pythonfmu

import fitting as ff
from fitting.text.finding import Kind

SLAVE = Path(__file__).parents[1] / "bench/foreign/LateOutput.py"
FIELDS = """title = "An output that is late"

[fmu]
file = "LateOutput.fmu"

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


@pytest.mark.parametrize("late", [0, 1])
def test_a_late_output_is_named_and_the_values_hold(late: int, tmp_path: Path) -> None:
    pythonfmu.FmuBuilder.build_FMU(str(SLAVE), dest=str(tmp_path))
    recorded(tmp_path)
    path = tmp_path / "campaign.toml"
    path.write_text(FIELDS.format(late=float(late)), encoding="utf-8")
    result = ff.fit(ff.Problem.of(path)).result
    told = [f for f in result.findings if f.kind is Kind.output_late]
    assert [f.subject for f in told] == ["x"] * late
    for finding in told:
        assert 0.0 < finding.numbers["step_s"] <= 0.005 * (1.0 + 1e-9)
    for name, truth in (("f0", 10.0), ("d", 0.5)):
        value = result.parameters[name]
        assert abs(value.value - truth) < 4.0 * value.std
