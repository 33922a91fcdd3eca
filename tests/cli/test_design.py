"""The design command: what it prints and writes, the campaign for the laboratory, refusals."""

from __future__ import annotations

import re
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign import bind, read_campaign
from fitting.cli.main import main
from fitting.design.result import Design, read_design
from fitting.fmu.description import read_description
from fitting.lab.bench import Row, measure_rows
from fitting.lab.instruments import Averaged
from fitting.lab.string import Drive, steady_state
from fitting.report.shown import shown_campaign
from fitting.text.errors import BadInput
from fitting.text.records import write_json
from tests.fit import test_swap
from tests.support.cfmu_build import build_c_fmu
from tests.support.in_process import told
from tests.support.report_records import result_for
from tests.support.string_benches import read_bench
from tests.support.string_part import string_part

pytestmark = pytest.mark.usefixtures("swift_models")

DATA = Path(__file__).parents[2] / "data"
Q1 = DATA / "string_q1"
LIMITS = """\
[design]
frequency_step = "50 Hz"
levels = [1, 100]
repeats = [1, 100]
number = 3
"""
#: Where nobody asks how good the best of them is.
COARSE = LIMITS.replace("50 Hz", "100 Hz")


@pytest.fixture(scope="module")
def proposed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the command writes for the shipped q1 series on a coarse grid."""
    folder = tmp_path_factory.mktemp("design")
    (folder / "limits.toml").write_text(LIMITS)
    words = ("design", Q1 / "campaign.toml", "--candidates", folder / "limits.toml", "--json")
    ended = told(*words, "--out", folder / "out")
    assert ended.code == 0
    assert ended.out == (folder / "out" / "design.json").read_text("utf-8")
    return folder / "out"


@pytest.fixture(scope="module")
def design(proposed: Path) -> Design:
    return read_design(proposed / "design.json")


def synthesize(*words: str | Path) -> int:
    return main(["synthesize", *(str(word) for word in words)])


def test_what_is_written(proposed: Path, design: Design) -> None:
    names = {p.relative_to(proposed).as_posix() for p in proposed.rglob("*") if p.is_file()}
    campaign = {"campaign/campaign.toml", "campaign/experiments.csv", "campaign/sweep.csv"}
    assert {"design.json", "design.csv", "report.html", *campaign} <= names
    figures = [name for name in names if name.startswith("figures/")]
    stems = ("figures/1_design_steps", "figures/2_design_candidates")
    kinds = ("csv", "svg")
    assert sorted(figures) == [f"{stem}.{kind}" for stem in stems for kind in kinds]
    page = (proposed / "report.html").read_text()
    assert "SYNTHETIC DATA" in page
    assert page.count("<figure") == 2
    assert ">nan<" not in page.lower()
    assert design.target == "lambda"
    assert design.unit == "Hz"
    assert design.improvement > 10.0
    assert [p.rank for p in design.proposals] == [1, 2, 3]
    rows = (proposed / "design.csv").read_text().splitlines()
    assert len(rows) == 1 + 1 + 3
    assert all(len(row.split(",")) == len(rows[0].split(",")) for row in rows)
    assert float(rows[-1].split(",")[-2]) == design.proposals[-1].expected.mean


def test_the_campaign_wants_peaks_and_nothing_else(proposed: Path, tmp_path: Path) -> None:
    """The reader asks for the first missing peak; filled in, it is a campaign with these rows."""
    folder = tmp_path / "filled"
    shutil.copytree(proposed / "campaign", folder)
    with pytest.raises(BadInput, match=r"row \d+, column 'peak_1'"):
        read_campaign(folder / "campaign.toml")
    rows = folder / "experiments.csv"
    rows.write_text(rows.read_text().replace(",,,", ",1.5,2.5,"))
    campaign = read_campaign(folder / "campaign.toml")
    assert [e.label for e in campaign.experiments] == ["next1", "next2", "next3"]
    assert campaign.experiments[0].peaks_v == pytest.approx([1.5e-6, 2.5e-6])


def test_the_laboratory_measures_the_plan(
    proposed: Path, design: Design, oscillator_fmu: Path, tmp_path: Path
) -> None:
    """Rows as proposed, peaks as the closed form of the bench has them, within their noise."""
    plan, truth = proposed / "campaign" / "campaign.toml", Q1 / "truth.toml"
    words: list[str | Path] = ["--plan", plan, "--truth", truth, "--out"]
    assert synthesize(*words, tmp_path / "lab", "--seed", "3") == 0
    campaign = read_campaign(tmp_path / "lab" / "campaign.toml")
    bound = bind(campaign, read_description(oscillator_fmu).variables)
    bench = read_bench(truth)
    assert read_bench(tmp_path / "lab" / "truth.toml") == bench
    told = tomllib.loads((tmp_path / "lab" / "truth.toml").read_text())["experiment"]
    assert bound.synthetic
    for e, p, t in zip(bound.experiments, design.proposals, told, strict=True):
        assert e.tones_hz == p.tones_hz
        assert e.output == p.output
        assert e.settings["A1"] == e.settings["A2"] == p.level
        assert e.settings["eta_plus"] == pytest.approx(t["eta_plus_hz"], abs=8.0)
        assert np.abs(e.peaks_v - t["peaks_v"]) == pytest.approx(0.0, abs=5.0 * np.max(e.sigmas_v))
    assert synthesize(*words, tmp_path / "twin", "--seed", "3") == 0
    for name in ("campaign.toml", "experiments.csv", "truth.toml"):
        twins = (tmp_path / folder / name for folder in ("lab", "twin"))
        assert len({twin.read_bytes() for twin in twins}) == 1
    assert "synthetic" in (tmp_path / "lab" / "experiments.csv").read_text().splitlines()[0]


def test_it_sets_out_from_a_result(
    tmp_path: Path, oscillator_fmu: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The given point is the result's, its alternative too; one of another campaign is refused."""
    bound = bind(read_campaign(Q1 / "campaign.toml"), read_description(oscillator_fmu).variables)
    base = result_for(shown_campaign(bound))
    base = replace(base, provenance=replace(base.provenance, files={}))  # of data of any kind
    values = {"theta": 2.2, "d1": 160.0, "d2": 60.0}
    known = base.parameters["d1"]
    parameters = {name: replace(known, value=value) for name, value in values.items()}
    fitted = replace(base, parameters=parameters, alternative={"reflection": True})
    write_json(tmp_path / "result.json", fitted)
    limits, result = tmp_path / "coarse.toml", tmp_path / "result.json"
    limits.write_text(COARSE)
    words = [
        "design",
        Q1 / "campaign.toml",
        "--candidates",
        limits,
        "--at",
        result,
        "--number",
        "1",
        "--target",
        "d2",
        "--criterion",
        "D",
        "--no-report",
    ]
    assert main([str(word) for word in (*words, "--out", tmp_path / "out")]) == 0
    design = read_design(tmp_path / "out" / "design.json")
    found = dict(design.places[0].parameters)
    assert {name: found.pop(name) for name in values} == pytest.approx(values)
    assert list(found.values()) == [0.0] * 5  # offsets of the drift, of which the result says none
    assert design.places[0].alternative == {"reflection": True}
    assert (design.target, design.criterion, len(design.proposals)) == ("d2", "D", 1)
    capsys.readouterr()
    write_json(tmp_path / "result.json", base)
    assert main([str(word) for word in (*words, "--out", tmp_path / "out")]) == 2
    assert "'d2'" in capsys.readouterr().err


def test_phases_determine_no_less_in_the_same_time(tmp_path: Path) -> None:
    """Beside amplitudes, in the same spectra; they take no longer."""
    table = COARSE.replace("number = 3\n", 'spectrum_time = "2 s"\n')
    campaign, means = string_part(tmp_path / "q1", reflection="reflection = [false]"), {}
    for phases in ("false", "true"):
        limits, out = tmp_path / f"{phases}.toml", tmp_path / phases
        limits.write_text(f"{table}phases = {phases}\n")
        words: list[str | Path] = ["design", campaign, "--candidates", limits, "--time", "10min"]
        words += ["--target", "theta", "--no-report", "--out", out]
        assert main([str(word) for word in words]) == 0
        design = read_design(out / "design.json")
        assert 100 <= sum(p.repeats for p in design.proposals) <= 300
        assert "--time 600.0 " in design.provenance["command"]
        assert re.findall(r"\d+ s", design.limits["time"]) == ["600 s", "2 s"]
        means[phases] = design.proposals[-1].expected.mean
    assert means["true"] < means["false"] < design.before.mean


def test_a_foreign_fmu_driven_through_its_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No mode, no angle, an FMU by its path: single tones are proposed, and the campaign binds."""
    fmu = build_c_fmu(tmp_path, reset="RESET_WORKS")
    path = test_swap.campaign(tmp_path, fmu, "squares", ["line_width"])
    text = path.read_text()
    path.write_text(text + '[design]\nnoise_floor = "2 uV"\nnumber = 2\nlevels = [1]\n')
    words = ["design", path, "--target", "line_width", "--out", tmp_path / "out", "--no-report"]
    assert main([str(word) for word in words]) == 0
    assert re.search(r"displacement .* from 3\d\d", capsys.readouterr().out)
    design = read_design(tmp_path / "out" / "design.json")
    assert design.unit == "Hz"
    assert {len(p.tones_hz) for p in design.proposals} == {1}
    folder = tmp_path / "out" / "campaign"
    rows = folder / "experiments.csv"
    rows.write_text(rows.read_text().replace(",,", ",0.5,"))
    bound = bind(read_campaign(folder / "campaign.toml"), read_description(fmu).variables)
    assert [e.tones_hz for e in bound.experiments] == [p.tones_hz for p in design.proposals]
    file = read_campaign(folder / "campaign.toml").file.fmu.file
    assert file is not None
    assert file.samefile(fmu)


def test_further_settings_are_tried_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A gain of the drive: |q2| at q1's resonance is clearer with the second mode driven less."""
    table = '[design]\nfrequency_step = "100 Hz"\nlevels = [100]\nrepeats = [100]\nnumber = 2\n'
    table += 'outputs = ["q2_hybrid"]\ncentres = ["6.9403 MHz"]\nboth_sides = true\n'
    (tmp_path / "limits.toml").write_text(table + "[design.settings]\ng2 = [0.0, 1.0]\n")
    words = [
        "design",
        string_part(tmp_path / "q1", reflection="reflection = [false]"),
        "--candidates",
        tmp_path / "limits.toml",
        "--no-report",
        "--out",
        tmp_path / "out",
    ]
    assert main([str(word) for word in words]) == 0
    design = read_design(tmp_path / "out" / "design.json")
    assert design.setups == 2
    assert {p.settings["g2"] for p in design.proposals} <= {0.0, 1.0}
    plan = tmp_path / "out" / "campaign" / "campaign.toml"
    lab = tmp_path / "lab"
    assert synthesize("--plan", plan, "--truth", Q1 / "truth.toml", "--out", lab) == 0
    for experiment, p in zip(
        read_campaign(lab / "campaign.toml").experiments, design.proposals, strict=True
    ):
        assert experiment.written["g2"].value == p.settings["g2"]


def test_noise_of_planned_peaks() -> None:
    """Mean and scatter of many rows: |A X| and the law of the floor, averaging and what stays."""
    bench = replace(read_bench(Q1 / "truth.toml"), curvature_hz=0.0)
    drive = Drive((6940300.0, 6940320.0), (1e3, 1e3), gains=(1.0, 0.5))
    row = Row(label="a", drive=drive, observed=1, averaged=25)
    noise = Averaged(1e-6, 0.02)
    series = measure_rows(bench, [row] * 4000, noise, seed=5)
    first = bench.at(0.0).modes
    top = abs(steady_state(first, np.array([first.eta_plus_hz]))[0, 0])
    end = bench.at(1.0).modes
    # one mode far off resonance, driven by its own gain, and by the other through the damping
    wave = 1e3 * steady_state(end, np.array(drive.tones_hz), (1.0, 0.5))[:, 1]
    expected = bench.crest_v / top * np.abs(wave)
    assert series.true_peaks_v[0] == pytest.approx(expected, rel=1e-12)
    sigma = np.hypot(1e-6 / 5.0, 0.02 * expected)
    peaks = series.array("peaks_v")
    assert np.mean(peaks, axis=0) == pytest.approx(expected, abs=4 * max(sigma) / 63)
    assert np.std(peaks, axis=0) == pytest.approx(sigma, rel=0.05)
    silent = measure_rows(replace(bench, noise_scale=0.0), [row], noise, seed=5)
    assert np.array_equal(silent.array("peaks_v"), silent.true_peaks_v)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--target", "nu"], "'nu'"),
        (["--at", "truth.toml"], "truth.toml: "),
        (["--candidates", "typo.toml"], "'desing'"),
        (["--candidates", "nowhere.toml"], "nowhere.toml: "),
        (["--criterion", "E"], "'E'"),
        (["--number", "0"], "--number: found '0'"),
    ],
)
def test_one_line_of_complaint(
    words: list[str],
    complaint: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    for path in (Q1 / "truth.toml", Q1 / "campaign.toml"):
        shutil.copy(path, path.name)
    for name in ("experiments.csv", "sweep.csv", "spectra"):
        Path(name).symlink_to(Q1 / name)
    Path("typo.toml").write_text("[desing]\nlevels = [1]\n")
    assert main(["design", "campaign.toml", "--out", str(tmp_path / "out"), *words]) == 2
    out, err = capsys.readouterr()
    assert complaint in err
    assert err.count("\n") == 1
    assert not out
    assert not (tmp_path / "out" / "design.json").exists()


def test_measured_peaks_are_not_written_over(
    proposed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    shutil.copytree(proposed, out)
    rows = out / "campaign" / "experiments.csv"
    filled = rows.read_text().replace(",,,", ",1.5,,", 1)
    rows.write_text(filled)
    assert main(["design", str(Q1 / "campaign.toml"), "--out", str(out)]) == 2
    told = capsys.readouterr().err
    assert f"{rows}: " in told
    assert rows.read_text() == filled


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("q2_hybrid", "q2", "row {row}, column 'output': "),
        (",A1,", ",theta,", "column 'theta': "),
        ("next3,", "# next3,", "[design] averaged: "),
    ],
)
def test_plans_that_the_laboratory_cannot_follow(
    proposed: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    old: str,
    new: str,
    complaint: str,
) -> None:
    shutil.copytree(proposed / "campaign", tmp_path / "plan")
    rows = tmp_path / "plan" / "experiments.csv"
    text = rows.read_text().split("\n")
    rows.write_text("\n".join(line if line[:1] == "#" else line.replace(old, new) for line in text))
    row = next(k for k, line in enumerate(text, 1) if old in line and line[:1] != "#")
    plan = tmp_path / "plan" / "campaign.toml"
    truth, out = Q1 / "truth.toml", tmp_path / "lab"
    assert synthesize("--plan", plan, "--truth", truth, "--out", out) == 2
    assert complaint.format(row=row) in capsys.readouterr().err
    assert not (tmp_path / "lab").exists()


def test_plan_and_truth_go_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert synthesize("--plan", tmp_path / "campaign.toml", "--out", tmp_path / "lab") == 2
    told = capsys.readouterr().err
    assert "--plan" in told
    assert "--truth" in told
    plan, truth = Q1 / "campaign.toml", Q1 / "truth.toml"
    assert synthesize("--plan", plan, "--truth", truth, "--out", tmp_path / "lab") == 2
    assert f"{plan}: " in capsys.readouterr().err
