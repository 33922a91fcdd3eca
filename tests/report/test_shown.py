"""What the report shows of a campaign, from a campaign that is bound to an FMU."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from fitting.campaign import BoundCampaign, Drift
from fitting.fit.problem import problem_of
from fitting.inference.likelihood.knowledge import JointResult, SeriesPart
from fitting.report.shown import shares_of, shown_campaign, shown_problem
from tests.support import closed_form
from tests.support import report_records as records
from tests.support.whitened import parameter


def campaign(folder: Path) -> BoundCampaign:
    """The closed-form string, noise-free, in a folder of its own."""
    folder.mkdir()
    response = closed_form.string_response()
    measured = closed_form.measured_by(response, noise=0.01, seed=1)
    return closed_form.string_campaign(measured, response, folder)


def test_experiments_and_sweep_are_shown_as_they_were_measured(tmp_path: Path) -> None:
    bound = campaign(tmp_path / "a")
    shown = shown_campaign(bound)
    for tones, experiment in zip(shown.tones, bound.experiments, strict=True):
        assert tones.label == experiment.label
        assert tones.tones_hz == experiment.tones_hz
        assert tones.drive == (1.0, 1.0)  # the campaign's level for every tone
    assert bound.sweep is not None
    assert shown.settings["observed output"] == "q1_hybrid"
    assert shown.settings["sweep"].startswith(f"{len(bound.sweep.frequency_hz)} points, ")


def test_what_drifts_is_shown_in_hertz_where_it_is_a_frequency(tmp_path: Path) -> None:
    ends = {"eta": (6.9, 6.8), "temperature": (300.0, 301.0), "bare": (5.0, 6.0)}
    units = {"eta": "MHz", "temperature": "K", "bare": "1"}
    shown = shown_campaign(replace(campaign(tmp_path / "a"), drift=Drift(ends, units)))
    assert shown.drift_hz == {"eta": (6.9e6, 6.8e6), "bare": (5.0, 6.0)}
    told = shown.settings["drift of temperature"]
    assert told.startswith("300 to 301 ")
    assert told.endswith(", linear")


def test_a_drift_that_is_corrected_is_not_called_linear(tmp_path: Path) -> None:
    bound = replace(
        campaign(tmp_path / "a"),
        drift=Drift({"eta": (6.9, 6.8)}, {"eta": "MHz"}),
        parameters=tuple(
            parameter(f"offset[{k}]", -180.0, 180.0, unit="Hz", prior=30.0) for k in range(3)
        ),
    )
    own = tuple(replace(p, experiment=p.name, adds_to=("eta",)) for p in bound.parameters)
    told = shown_campaign(replace(bound, parameters=own)).settings["drift of eta"]
    assert re.findall(r"linear .*?(\d+) .* (\d+ Hz)$", told) == [("3", "30 Hz")]


def test_campaigns_fitted_together_have_shares_of_their_own(tmp_path: Path) -> None:
    bounds = [campaign(tmp_path / name) for name in ("a", "b")]
    shown = shown_problem(problem_of(bounds))
    assert list(shown.series) == ["a", "b"]
    count = len(bounds[0].experiments)
    assert [own.labels for own in shown.series.values()] == [
        tuple(f"{name}/pair{m + 1}" for m in range(count)) for name in ("a", "b")
    ]
    peaks = 2 * count
    errors = [0.1] * peaks + [0.2] * peaks
    joint = JointResult(tuple(part(name, chi) for name, chi in (("a", 2.0), ("b", 3.0))), ())
    result = replace(records.result_for(shown, final=errors), joint=joint)
    shares = shares_of(result, shown)
    assert [share.deviations.final.mean for _, share, _ in shares] == pytest.approx([0.1, 0.2])
    assert [share.scale.final for _, share, _ in shares] == [2.0, 3.0]
    for name, share, own in shares:
        assert {p.experiment for p in share.peaks} == set(own.labels)
        assert all(label.startswith(f"{name}/") for label in own.labels)


def part(name: str, chi: float) -> SeriesPart:
    return SeriesPart(
        name=name,
        campaign=f"{name}/campaign.toml",
        scale_kind="maximum",
        chi=chi,
        rows=10,
        determined=3,
        chi_square_joint=9.0,
        chi_square_alone=8.0,
        inflation=1.0,
        alone={},
    )
