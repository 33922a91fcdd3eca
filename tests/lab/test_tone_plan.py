"""Planned tones at values of a control, measured by the virtual laboratory of a crossing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from fitting.lab.true_values import true_values
from fitting.text.arrays import ComplexArray
from fitting.text.errors import BadInput
from tests.support import crossing_spectra

PLAN = """
[experiments]
file = "experiments.csv"
{columns}
peak_sigmas = ["sigma_1", "sigma_2"]
amplitude = "V peak"
{more}
[design]
target = "lambda12"
noise_floor = "{floor}"
relative_noise = {relative}
averaged = {averaged}
"""
AMPLITUDES = 'peaks = ["peak_1", "peak_2"]'
QUADRATURES = 'x = ["X_1", "X_2"]\ny = ["Y_1", "Y_2"]'


def planned(
    folder: Path,
    *,
    phases: bool = False,
    floor: str = "1e-12 V",
    relative: float = 0.0,
    averaged: str = "[1, 4]",
    head: str = "V (mV)",
) -> Path:
    """Two rows, at 0.5 V and -2 V, as a design writes them; the second at half the drive."""
    made = ff.synthesize_curves("crossing", reference=True)
    folder.mkdir(exist_ok=True)
    text = str(made.files["campaign.toml"])
    start, end = text.index("[control_sweep]"), text.index("[sweep]")
    columns, more = (QUADRATURES, 'unknown = "phase"') if phases else (AMPLITUDES, "")
    table = PLAN.format(
        columns=columns, more=more, floor=floor, relative=relative, averaged=averaged
    )
    (folder / "campaign.toml").write_text(text[:start] + text[end:] + table)
    (folder / "sweep.csv").write_text(str(made.files["sweep.csv"]))
    open_cells = ["X_1", "X_2", "Y_1", "Y_2"] if phases else ["peak_1", "peak_2"]
    heads = [f"{name} (mV)" for name in (*open_cells, "sigma_1", "sigma_2")]
    empty = "," * len(heads)
    lines = ["# fill in", ",".join(["experiment,u1 (Hz),u2 (kHz),output", head, "A1,A2", *heads])]
    lines += [f"next1,996,1.004,q1,500,1,1{empty}", f"next2,990,0.999,q1,-2000,0.5,0.5{empty}"]
    (folder / "experiments.csv").write_text("\n".join(lines) + "\n")
    return folder / "campaign.toml"


def exact() -> ComplexArray:
    """q1 in V at the four tones: the laboratory's gain is 1e6 V per m."""
    first = crossing_spectra.phasor(np.array([996.0, 1004.0]), 0.5)
    second = 0.5 * crossing_spectra.phasor(np.array([990.0, 999.0]), -2.0)
    return 1e6 * np.stack([first, second])


def test_peaks_are_those_of_the_closed_form_and_the_campaign_is_read(tmp_path: Path) -> None:
    made = ff.synthesize("crossing", plan=planned(tmp_path / "plan"), out=tmp_path / "lab")
    lines = (tmp_path / "lab/experiments.csv").read_text().splitlines()[-2:]
    peaks = np.array([[float(cell) for cell in line.split(",")[7:9]] for line in lines])
    assert peaks == pytest.approx(1e3 * np.abs(exact()), rel=1e-9)
    assert true_values(made.truth)["lambda12"] == crossing_spectra.LAMBDA
    read = ff.read_campaign(tmp_path / "lab/campaign.toml")
    assert [e.label for e in read.experiments] == ["next1", "next2"]


def test_quadratures_have_one_reference_phase(tmp_path: Path) -> None:
    plan = planned(tmp_path / "plan", phases=True)
    made = ff.synthesize("crossing", plan=plan, seed=4)
    x, y = np.split(np.stack([m[:4] for m in made.measured]), 2, axis=1)
    turns = (x + 1j * y) / exact()
    assert turns == pytest.approx(np.full((2, 2), turns[0, 0]), abs=1e-8)
    assert abs(turns[0, 0]) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("floor", "relative", "first", "second"),
    [("20 mV", 0.0, 0.02, 0.01), ("1e-12 V", 0.02, None, None)],
)
def test_noise_falls_with_the_spectra_that_are_averaged(
    tmp_path: Path, floor: str, relative: float, first: float | None, second: float | None
) -> None:
    """The floor by the root of one and four spectra; the relative noise not at all."""
    times, left = 15, []
    plan = planned(
        tmp_path / "plan",
        phases=True,
        floor=floor,
        relative=relative,
        averaged=str([1, 4] * times),
    )
    table = plan.with_name("experiments.csv")
    *heads, one, other = table.read_text().splitlines()
    rows = [row.replace("next", f"{k}_") for k in range(times) for row in (one, other)]
    table.write_text("\n".join([*heads, *rows]) + "\n")
    for seed in range(10):
        made = ff.synthesize("crossing", plan=plan, seed=seed)
        seen = np.stack(list(made.measured)).reshape(times, 2, -1)
        left.append(np.hypot(seen[..., :2], seen[..., 2:4]) - np.abs(exact()))
        told = seen[0, :, 4:]
    found = np.std(np.concatenate(left), axis=0)
    wanted = 0.02 * np.abs(exact())
    if first is not None:
        wanted = np.array([[first] * 2, [second] * 2])
    assert found == pytest.approx(wanted, rel=0.2)
    assert told == pytest.approx(wanted, rel=0.1)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"averaged": "[1]"}, "averaged: .* 1 .* 2"),
        ({"head": "T (K)"}, "column 'T': "),
    ],
)
def test_what_the_laboratory_cannot_do_is_said(
    tmp_path: Path, changes: dict[str, str], complaint: str
) -> None:
    plan = planned(tmp_path / "plan", **changes)  # type: ignore[arg-type]
    with pytest.raises(BadInput, match=complaint):
        ff.synthesize("crossing", plan=plan)


def test_the_command_makes_the_map_with_its_reference_and_measures_the_plan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    crossing = ["synthesize", "--series", "crossing", "--reference", "--seed", "2"]
    assert main([*crossing, "--out", str(tmp_path / "map")]) == 0
    assert ff.read_campaign(tmp_path / "map/campaign.toml").sweep is not None
    plan, truth = planned(tmp_path / "plan"), tmp_path / "map/truth.toml"
    measured = ["--plan", str(plan), "--truth", str(truth), "--out", str(tmp_path / "lab")]
    assert main(["synthesize", *measured]) == 0
    assert (tmp_path / "lab/experiments.csv").is_file()
    capsys.readouterr()
    assert main(["synthesize", "--series", "q1", "--reference", "--out", str(tmp_path / "x")]) == 2
    assert "--reference: " in capsys.readouterr().err
