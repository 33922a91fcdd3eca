"""Accuracy against cost of any campaign: rows as they come, what suffices, what fails."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import fitting as ff
from fitting.cli.main import main
from fitting.lab.tradeoff import ROWS_NAME, study
from fitting.lab.tradeoff.records import Row, Setting, Study
from fitting.text.errors import FmuFailure
from tests.support.small_campaign import small_campaign

QUICK = ff.StudyOptions(accuracies=(1e-2, 1e-4))


@pytest.fixture(scope="module")
def campaign(swift_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_campaign(tmp_path_factory.mktemp("tradeoff") / "small", swift_fmu)


@pytest.fixture(scope="module")
def fmu(swift_fmu: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(swift_fmu, workers=1) as opened:
        yield opened


def row(name: str, cost_s: float, off: float, **more: Any) -> Row:
    return Row(setting=Setting(name=name), evaluation_s=cost_s, error_sigma=off, **more)


def of(*rows: Row) -> Study:
    return Study(title="", synthetic=True, reference=row("reference", 9.0, 0.0), rows=rows)


def test_the_cheapest_sufficient_row_is_marked_and_the_plans_own() -> None:
    plan, rough, fine = row("plan", 2.0, 0.01), row("rough", 1.0, 0.2), row("fine", 4.0, 1e-6)
    cheap, failed = row("cheap", 1.5, 0.09), replace(row("failed", 0.1, 0.0), failed="refused")
    found = of(plan, rough, fine, cheap, failed)
    assert [found.mark(each) for each in found.rows] == ["plan", "", "", "cheapest", ""]
    # what costs about the same is the plan's, and a shift of a value counts more than an error
    assert of(plan, row("same", 1.9, 0.0)).mark(plan) == "as cheap as any, plan"
    assert of(replace(plan, shifts={"d1": -0.3}), fine).cheapest is fine
    assert of(rough).cheapest is None


def test_every_setting_is_a_row_and_resuming_repeats_nothing(
    campaign: Path, fmu: ff.Fmu, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that fails has a reason; an interrupt leaves what is finished."""
    whole = study._Measurements.row
    asked: list[str] = []

    def disturbed(self: Any, setting: Setting) -> Row:
        asked.append(setting.name)
        if setting.name == "no reduction" and len(asked) < 5:
            raise KeyboardInterrupt
        if setting.name.startswith("accuracy"):
            monkeypatch.setattr(self, "problem_of", failing)
        return whole(self, setting)

    def failing(_: Setting) -> ff.Problem:
        monkeypatch.undo()
        monkeypatch.setattr(study._Measurements, "row", disturbed)
        raise FmuFailure("refused", {}, Path("test.fmu"))

    monkeypatch.setattr(study._Measurements, "row", disturbed)
    first = ff.tradeoff(campaign, fmu, options=QUICK, out=tmp_path)
    assert first.status == "interrupted"
    assert [r.setting.name for r in first.rows] == ["plan", "accuracy 0.01", "accuracy 0.0001"]
    assert "refused" in first.rows[1].failed
    assert (tmp_path / ROWS_NAME).exists()
    before = len(asked)
    second = ff.tradeoff(campaign, fmu, options=QUICK, out=tmp_path, resume=True)
    assert second.status == "finished"
    assert second.rows[:3] == first.rows
    assert asked[before:] == [r.setting.name for r in second.rows[3:]]
    assert {"no reduction", "with periodic start"} <= set(asked[before:])
    done = [r for r in second.rows if not r.failed]
    assert all(r.evaluation_s > 0.0 and r.runs > 0 and r.error_sigma < 0.1 for r in done)
    # what a plan admits holds for what is measured: errors are relative to the largest datum
    assert all(r.error <= r.promised + second.reference.promised for r in done)


@pytest.mark.nightly
def test_fits_on_common_seeds_are_compared_in_standard_errors(
    campaign: Path, fmu: ff.Fmu, tmp_path: Path
) -> None:
    found = ff.tradeoff(campaign, fmu, options=replace(QUICK, fit=True), out=tmp_path)
    for each in found.rows:
        assert each.fit_s > each.evaluation_s
        assert max(map(abs, each.shifts.values())) < 0.1
    assert found.cheapest is not None


def test_a_campaign_of_traces_is_compared_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--scene", "ringdown", "--accuracies", "1e-2,1e-3", "--out", str(tmp_path)]
    assert main(["tradeoff", *words]) == 0
    assert "accuracy 0.01" in capsys.readouterr().out
    with (tmp_path / "tradeoff.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [r["setting"] for r in rows[1:4]] == ["plan", "accuracy 0.01", "accuracy 0.001"]
    assert "plan" in rows[1]["mark"]
    assert all(math.isfinite(float(r["evaluation_s"])) for r in rows if not r["failed"])
    assert (tmp_path / "tradeoff.md").read_text("utf-8").startswith("# ")
    assert list((tmp_path / "figures").glob("*.svg"))
    assert not (tmp_path / ROWS_NAME).exists()


@pytest.mark.parametrize(
    ("words", "token"), [(["--accuracies", "2"], "--accuracies"), (["--campaign", "no.toml"], "no")]
)
def test_bad_input_is_one_line(
    words: list[str], token: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["tradeoff", *words, "--out", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert token in err


def test_options_of_before_are_read_with_a_warning(tmp_path: Path) -> None:
    words = ["tradeoff", "--only", "widths", "--accuracies", "7"]
    with pytest.warns(DeprecationWarning, match="--only"):
        assert main([*words, "--out", str(tmp_path / "out")]) == 2  # 7 is no accuracy
