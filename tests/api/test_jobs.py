"""Whole jobs through the front door: what the commands write, from a program."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import fitting as ff
from fitting.result.result import read_result


@pytest.fixture(scope="module")
def fit(oscillator_fmu: Path) -> ff.Fit:
    problem = ff.Problem.of(ff.example("string_q1"), ff.Fmu(oscillator_fmu))
    return ff.fit(problem, ff.Tikhonov(levels=3, quick=True), starts=1)


def test_a_report_is_what_the_command_writes(fit: ff.Fit, tmp_path: Path) -> None:
    page = ff.report(fit, tmp_path, external=["width_plus=94.2 Hz +- 1 Hz"])
    assert page == tmp_path / "report.html"
    assert (tmp_path / "history.csv").is_file()
    assert any((tmp_path / "figures").iterdir())
    result = read_result(tmp_path / "result.json")
    assert result.fitted_values == pytest.approx(fit.result.fitted_values, rel=1e-15)
    assert "agrees" in result.external[0].sentence
    assert result.provenance.command == "fitting.fit"
    named = {name: ff.profile(fit, [name]).values for name in ("width_plus",)}
    assert named["width_plus"]["width_plus"].profile is not None
    assert named["width_plus"]["theta"].profile is None


def test_what_was_not_profiled_keeps_its_linearised_verdict(fit: ff.Fit) -> None:
    """Of a profile of theta nothing follows for the line that the sweep and the peaks show."""
    found = ff.profile(fit, ["theta"])
    for name in ("width_plus", "Q_plus", "lambda"):
        before, after = fit[name], found[name]
        assert after.verdict == before.verdict
        assert (after.std, after.value) == pytest.approx((before.std, before.value), nan_ok=True)
    assert found["width_plus"].verdict == "determined"


def test_plots_take_fits_and_draw_where_they_are_told(fit: ff.Fit) -> None:
    for draw in (ff.plot.objective_path, ff.plot.residuals, ff.plot.deviations):
        ax = Figure().subplots()
        assert draw(fit, ax=ax) is ax
        assert ax.has_data()
    ax = Figure().subplots()
    assert ff.plot.frequency_response(fit, ax=ax) is ax
    with pytest.raises(ff.BadInput, match="has no profile"):
        ff.plot.profile(fit["width_plus"], ax=ax)


def test_a_profile_is_drawn_by_the_name_of_its_value(fit: ff.Fit) -> None:
    found = ff.profile(fit, ["width_plus"])
    curves = []
    for words in ((found, "width_plus"), (found,), (found["width_plus"],)):
        ax = ff.plot.profile(*words, ax=Figure().subplots())
        curves.append(np.array(ax.lines[0].get_xydata()))
        assert "width" in ax.get_xlabel()
    assert all(np.array_equal(curve, curves[0]) for curve in curves)
    with pytest.raises(ff.BadInput, match="no profile of 'd1', wanted one of width_plus"):
        ff.plot.profile(found, "d1", ax=Figure().subplots())
    with pytest.raises(ff.BadInput, match=r"wanted what fitting\.profile\(fit\) returns"):
        ff.plot.profile(fit, "d1", ax=Figure().subplots())  # type: ignore[arg-type]


def test_every_plot_is_in_the_list_of_its_module() -> None:
    listed = re.findall(r"^(\w+) {2,}\w", ff.plot.__doc__ or "", re.MULTILINE)
    assert sorted(listed) == ff.plot.__all__


def test_what_is_identified_sets_out_from_a_fit(fit: ff.Fit) -> None:
    found = ff.identify(fit.problem, fit, expected=True)
    verdicts = {name: p.verdict for name, p in found.knowledge.profiles.items()}
    assert verdicts["width_plus"] == "determined"
    assert verdicts["lambda"] == "not determined"
    assert not found.knowledge.data
    assert found.at == "a fit"


def test_a_design_makes_the_target_better_known(fit: ff.Fit) -> None:
    design = ff.design(fit.problem, "lambda", number=2)
    assert (design.target, design.unit, len(design.proposals)) == ("lambda", "Hz", 2)
    errors = [design.before.mean, *(p.expected.mean for p in design.proposals)]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < errors[0]
    with pytest.raises(ff.BadInput, match="criterion 'E'"):
        ff.design(fit.problem, criterion="E")


def test_rows_are_flat_and_plain(fit: ff.Fit) -> None:
    rows = fit.to_dict()
    assert [row["name"] for row in rows][:3] == ["theta", "d1", "d2"]
    assert len({tuple(row) for row in rows}) == 1
    assert json.dumps(rows)


def test_a_synthetic_campaign_can_be_read(tmp_path: Path) -> None:
    made = ff.synthesize("q1", seed=3)
    campaign = ff.read_campaign(made.write(tmp_path))
    assert len(campaign.experiments) == len(made.measured.readings)
