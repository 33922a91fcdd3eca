"""Whole jobs through the front door: what the commands write, from a program."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import fitting as ff
from fitting.campaign import ContinuationSettings
from fitting.fit.options import options_of
from fitting.report.figures import reconstruction
from fitting.report.screen import phrase
from fitting.result.external import with_external
from fitting.result.result import read_result
from fitting.text.results_folder import results_folder, write_whole
from tests.support.string_part import string_part


@pytest.fixture(scope="module")
def fit(swift_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> ff.Fit:
    """Of the string, by two drive pairs and its sweep."""
    folder = tmp_path_factory.mktemp("string") / "string"
    asked = 'outputs = ["lambda", "width_plus", "Q_plus"]'
    path = string_part(folder, pairs=(1, 3), outputs=asked)
    problem = ff.Problem.of(path, ff.Fmu(swift_fmu))
    return ff.fit(problem, ff.Tikhonov(levels=3), starts=1)


@pytest.fixture(scope="module")
def width(fit: ff.Fit) -> ff.Inference:
    """The profile of one value alone."""
    return ff.profile(fit, ["width_plus"])


def test_a_report_is_what_the_command_writes(
    fit: ff.Fit, width: ff.Inference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # all of them are drawn in tests/report: here the first, beside those of earlier fits
    planned = reconstruction.planned_figures
    monkeypatch.setattr(
        reconstruction, "planned_figures", lambda *of: dict([*planned(*of).items()][:1])
    )
    earlier, built = tmp_path / "figures" / "99_earlier.svg", tmp_path / "fmu" / "earlier.fmu"
    with results_folder(tmp_path, "reconstruct"):
        write_whole(earlier, "of an earlier fit")
        write_whole(built, "may be in use by this very program")
    (tmp_path / "figures" / "mine.svg").write_text("somebody's own")
    page = ff.report(fit, tmp_path, external=["width_plus=94.2 Hz +- 1 Hz"])
    assert page == tmp_path / "report.html"
    assert (tmp_path / "history.csv").is_file()
    assert (tmp_path / "figures" / "01_frequency_response.svg").is_file()
    assert not earlier.exists()
    assert built.exists()
    assert (tmp_path / "figures" / "mine.svg").exists()
    result = read_result(tmp_path / "result.json")
    assert result.fitted_values == pytest.approx(fit.result.fitted_values, rel=1e-15)
    assert abs(result.external[0].sigmas) < 3.0
    assert "agrees" in phrase("result", "external", result.external[0], result)
    assert result.provenance.command == "fitting.fit"
    assert width.values["width_plus"].scan is not None
    assert width.values["theta"].scan is None
    shown = width._repr_html_()
    assert shown.count("<tr") > 3
    assert str(width["width_plus"].status) in shown


def test_the_estimate_of_algorithm_2_is_the_value_where_asked_for(fit: ff.Fit) -> None:
    method = ff.Tikhonov.of(options_of(ContinuationSettings(estimator="algorithm2")))
    assert method == ff.Tikhonov(misfit="slack", estimator="algorithm2")
    asked = replace(fit.record, options=method.options(starts=1, seed=1))
    papers = ff.Fit(fit.problem, asked, 0.0)
    for name in ("width_plus", "Q_plus"):
        own, paper = fit[name], papers[name]
        assert paper.value == paper.algorithm2 == own.algorithm2
        assert own.value != own.algorithm2
        assert paper.likely == own.value
        assert paper.std == own.std
        assert paper.interval() == own.interval()
        assert paper.interval(0.68) == own.interval(0.68)
        assert "Algorithm 2" in repr(paper)
        assert "most likely" in repr(paper)
    assert "most likely" in repr(papers)
    assert "Algorithm 2" in repr(papers)
    assert "most likely" in fit._repr_html_()
    assert "Algorithm 2" not in repr(fit)
    assert papers.result.fitted_values == pytest.approx(
        dict(zip(fit.problem.names, fit.record.paper, strict=True))
    )
    # a value from elsewhere is held against what the error is of
    tests = [
        with_external(each.result, ["width_plus=94.2 Hz +- 1 Hz"]).external[0]
        for each in (fit, papers)
    ]
    assert tests[0].sigmas == tests[1].sigmas
    assert "most likely" in phrase("result", "external", tests[1], papers.result)


def test_what_was_not_profiled_keeps_its_linearised_verdict(fit: ff.Fit) -> None:
    """Of a profile of theta nothing follows for the line that the sweep and the peaks show."""
    found = ff.profile(fit, ["theta"])
    for name in ("width_plus", "Q_plus", "lambda"):
        before, after = fit[name], found[name]
        assert after.status == before.status
        assert after.std == pytest.approx(before.std, nan_ok=True)
        assert after.value == pytest.approx(before.value, nan_ok=True, rel=1e-3)
    assert found["width_plus"].status == "linearised only"


def test_plots_take_fits_and_draw_where_they_are_told(fit: ff.Fit) -> None:
    for draw in (ff.plot.objective_path, ff.plot.residuals, ff.plot.deviations):
        ax = Figure().subplots()
        assert draw(fit, ax=ax) is ax
        assert ax.has_data()
    ax = Figure().subplots()
    assert ff.plot.frequency_response(fit, ax=ax) is ax
    with pytest.raises(ff.BadInput, match="width_plus"):
        ff.plot.profile(fit["width_plus"], ax=ax)


def test_a_profile_is_drawn_by_the_name_of_its_value(fit: ff.Fit, width: ff.Inference) -> None:
    curves = []
    for words in ((width, "width_plus"), (width,), (width["width_plus"],)):
        ax = ff.plot.profile(*words, ax=Figure().subplots())
        curves.append(np.array(ax.lines[0].get_xydata()))
        assert "width" in ax.get_xlabel()
    assert all(np.array_equal(curve, curves[0]) for curve in curves)
    with pytest.raises(ff.BadInput, match=r"'d1'.*width_plus"):
        ff.plot.profile(width, "d1", ax=Figure().subplots())
    with pytest.raises(ff.BadInput, match=r"fitting\.profile"):
        ff.plot.profile(fit, "d1", ax=Figure().subplots())  # type: ignore[arg-type]


def test_every_plot_is_in_the_list_of_its_module() -> None:
    listed = re.findall(r"^(\w+) {2,}\w", ff.plot.__doc__ or "", re.MULTILINE)
    assert sorted(listed) == ff.plot.__all__


def test_what_is_identified_sets_out_from_a_fit(fit: ff.Fit) -> None:
    found = ff.identify(fit.problem, fit, expected=True)
    verdicts = {name: p.status for name, p in found.profiled.items()}
    assert verdicts["width_plus"] == "determined"
    assert verdicts["lambda"] == "unconstrained"
    assert not found.knowledge.data
    assert found.at == "a fit"


def test_a_design_makes_the_target_better_known(fit: ff.Fit) -> None:
    few = replace(ff.limits(fit.problem), frequency_step_hz=50.0, levels=(100.0, 1.0), number=2)
    assert few.levels == (1.0, 100.0)
    design = ff.design(fit.problem, "lambda", limits=few).design
    assert (design.target, design.unit, len(design.proposals)) == ("lambda", "Hz", 2)
    errors = [design.before.mean, *(p.expected.mean for p in design.proposals)]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < errors[0]
    with pytest.raises(ff.BadInput, match="criterion 'E'"):
        ff.design(fit.problem, ff.Goal(criterion="E"))
    with pytest.raises(ff.BadInput, match="levels: found"):
        replace(few, levels=(1.0, -1.0))
    with pytest.raises(ff.BadInput, match=r"outputs.*'q3_hybrid'"):
        ff.design(fit.problem, "lambda", limits=replace(few, outputs=("q3_hybrid",)))


def test_limits_are_no_wider_than_those_of_the_campaign(swift_fmu: Path, tmp_path: Path) -> None:
    """What a file or a record leaves out is the campaign's; what goes beyond that is refused."""
    folder = tmp_path / "string"
    shutil.copytree(ff.example("string_q1").parent, folder)
    path = folder / "campaign.toml"
    own = 'levels = [1, 2]\nlargest = "80 uV"\nfarthest = "100 Hz"\nleast_spacing = "20 Hz"\n'
    own += 'outputs = ["q1_hybrid"]\nsettings = { g1 = [1] }\n'
    path.write_text(path.read_text() + "\n[design]\n" + own)
    problem = ff.Problem.of(path, ff.Fmu(swift_fmu))
    given = tmp_path / "candidates.toml"
    given.write_text('[design]\nfarthest = "0.1 kHz"\nrepeats = [1]\nsettings = { g2 = [0, 1] }\n')
    found = ff.limits(problem, given)
    assert found.levels == (1.0, 2.0)
    assert found.repeats == (1,)
    assert found.largest_v == pytest.approx(80e-6)
    assert found.settings == {"g1": (1.0,), "g2": (0.0, 1.0)}
    for text, asked, own in (
        ("levels = [1, 100]", "levels: found 100, ", " 2 "),
        ('largest = "1 mV"', "largest: found 0.001 V, ", " 8e-05 V "),
        ('farthest = "101 Hz"', "farthest: found 101 Hz, ", " 100 Hz "),
        ('least_spacing = "10 Hz"', "least_spacing: found 10 Hz, ", " 20 Hz "),
        ('outputs = ["q2_hybrid"]', "outputs: 'q2_hybrid' ", ""),
    ):
        given.write_text(f"[design]\n{text}\n")
        with pytest.raises(ff.BadInput) as refused:
            ff.limits(problem, given)
        said = str(refused.value)
        assert said.startswith(f"{given}: [design] {asked}")
        assert f"{own}of {path}: [design] " in said
    with pytest.raises(ff.BadInput, match=r"levels: .* 3, .* 2 "):
        ff.design(problem, limits=replace(found, levels=(3.0,)))


def test_rows_are_flat_and_plain(fit: ff.Fit) -> None:
    rows = fit.to_dict()
    assert [row["name"] for row in rows][:3] == ["theta", "d1", "d2"]
    assert len({tuple(row) for row in rows}) == 1
    assert json.dumps(rows)


def test_a_synthetic_campaign_can_be_read(tmp_path: Path) -> None:
    made = ff.synthesize("q1", seed=3)
    campaign = ff.read_campaign(made.write(tmp_path))
    assert len(campaign.experiments) == len(made.measured.readings)
