"""Which values are those of the sweep's own line: of its mode alone, wherever the fit ended."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import fitting as ff
from fitting.inference.sweeps import LineFits, values_of_line
from fitting.text.estimate import FittedEstimate
from tests.support.virtual.answers import ModesResponse
from tests.support.virtual.judge import by_closed_form
from tests.support.virtual.kinds import KINDS

pytestmark = pytest.mark.usefixtures("swift_models")

DATA = Path(__file__).parents[2] / "data"


@pytest.mark.parametrize(
    ("series", "mode"),
    [("q2", "minus"), pytest.param("q1", "plus", marks=pytest.mark.nightly)],
)
def test_the_line_is_that_of_the_mode_that_was_swept(series: str, mode: str) -> None:
    """Both fits end at d1 = d2, where every width is the swept line's; d1 is 120 and d2 90 Hz."""
    campaign = DATA / f"string_{series}" / "campaign.toml"
    record = ff.Problem.of(campaign, ff.Fmu("CoupledOscillator")).record
    problem = ff.Problem.answered_by(lambda chosen: ModesResponse(record, chosen), record)
    fit = ff.fit(problem, ff.Tikhonov(levels=1, misfit="squares"), starts=1)
    inferred = ff.profile(fit, [f"Q_{mode}"]).record
    widths = {n: replace(v, unit="Hz") for n, v in inferred.derived.items() if "width" in n}
    values: dict[str, FittedEstimate]
    values = {**inferred.parameters, **inferred.derived, **widths}
    found = values_of_line(inferred.fit.problem, inferred.fit.solution, values, LineFits())
    assert found == {f"width_{mode}": "width", f"Q_{mode}": "q"}


def test_a_damping_that_the_fit_has_at_the_width_is_not_the_line_s(tmp_path: Path) -> None:
    """The fit ends at d1 = d2 = width = 1.38 Hz, beside the end of d1's box; d1 is 2.8 Hz."""
    laboratory = KINDS["pairs"](6009)
    solve = by_closed_form(ff.Fmu("CoupledOscillator"), ("Q_plus",))
    [line] = solve(laboratory, tmp_path).record.sweeps.lines.values()
    assert dict(line.values) == {"Q_plus": "q"}
