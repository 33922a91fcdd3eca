"""Experiments that observe another output, values of one experiment alone, shared runs.

Truth: the closed form of the two modes in `tests.closed_form`, and counting by hand.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.campaign.parameters import Parameter
from fitting.fit.objective import evaluate_many, make_objective, stencil
from fitting.fit.problem import problem_of
from fitting.fmu.description import read_description
from fitting.fmu.pool import FmuWorkers
from fitting.text.errors import BadInput
from tests.support import closed_form
from tests.support.datasets import drafted, through

ROOT = Path(__file__).parents[2]
P = np.array([1.9498, 120.0, 90.0])
ROWS = """\
experiment,u1 (MHz),u2 (MHz),output,eta_plus (MHz),eta_minus (MHz),p1 (uV),p2 (uV)
own,6.94016,6.94036,q1_hybrid,6.94021,7.02755,27.4,11.9
cross,6.94016,6.94036,q2_hybrid,6.94021,7.02755,0.02,0.02
again,6.94018,6.94034,q1_hybrid,6.94024,7.02758,25.0,16.8
"""


def campaign(folder: Path, fmu: Path, rows: str = ROWS) -> BoundCampaign:
    """The shipped campaign with ready peaks and eigenfrequencies of their own in a table."""
    text = (ROOT / "data/string_q1/campaign.toml").read_text()
    head, rest = text.split("[drift]", 1)
    rest = rest[rest.index("[sweep]") :]
    head = head.replace('spectra = "spectra/{experiment}.csv"', 'peaks = ["p1", "p2"]')
    (folder / "campaign.toml").write_text(head.replace('layout = "csv"\n', "") + rest)
    (folder / "experiments.csv").write_text(rows)
    (folder / "sweep.csv").write_text((ROOT / "data/string_q1/sweep.csv").read_text())
    return bind(read_campaign(folder / "campaign.toml"), read_description(fmu).variables)


def offset(label: str, *further: str) -> Parameter:
    return Parameter(
        name=f"offset[{label}]",
        unit="Hz",
        lower=-90.0,
        upper=90.0,
        start=0.0,
        reference=0.0,
        scale=30.0,
        experiment=label,
        further=further,
        adds_to=("eta_plus", "eta_minus"),
        prior=30.0,
    )


def expected(shifts: tuple[float, float, float]) -> np.ndarray:
    d = closed_form.damping(1.9498, 120.0, 90.0, False)
    rows = ((0, 6940160.0, 6940360.0), (1, 6940160.0, 6940360.0), (0, 6940180.0, 6940340.0))
    etas = ((6940210.0, 7027550.0), (6940210.0, 7027550.0), (6940240.0, 7027580.0))
    found = [
        closed_form.amplitude(tones, (plus + shift, minus + shift), d, mode)
        for (mode, *tones), (plus, minus), shift in zip(rows, etas, shifts, strict=True)
    ]
    return np.concatenate(found)


def test_the_other_mode_is_observed_in_the_same_run(swift_fmu: Path, tmp_path: Path) -> None:
    bound = campaign(tmp_path, swift_fmu)
    assert [e.output for e in bound.experiments] == ["q1_hybrid", "q2_hybrid", "q1_hybrid"]
    alone = replace(bound, sweep=None)
    plan = drafted(alone)
    with FmuWorkers(swift_fmu, workers=1) as workers:
        response = through(workers, alone, plan, {"reflection": False})
        answer = response.evaluate_many([P])[0]
        misfit = response.misfit(P)
    assert answer.predictions[0].values == pytest.approx(expected((0.0, 0.0, 0.0)), rel=1e-8)
    assert answer.runs == 2
    assert misfit < 1e-8


def test_values_of_one_experiment_cost_one_run_each(swift_fmu: Path, tmp_path: Path) -> None:
    bound = campaign(tmp_path, swift_fmu)
    shared = (offset("own", "cross"), offset("again"))
    bound = replace(bound, parameters=(*bound.parameters, *shared))
    with FmuWorkers(swift_fmu, workers=2) as workers:
        response = through(workers, bound, drafted(bound), {"reflection": False})
        p = np.array([*P, 7.0, -3.0])
        one = response.evaluate_many([p])[0]
        assert one.predictions[0].values == pytest.approx(expected((7.0, 7.0, -3.0)), rel=1e-8)
        fewer = replace(bound, parameters=bound.parameters[:3])
        plain = through(workers, fewer, drafted(bound), {"reflection": False})
        swept = plain.evaluate_many([P])[0]
        assert (
            one.predictions[1].maximum == swept.predictions[1].maximum
        )  # offsets leave the sweep alone
        objective = make_objective(response, bound.parameters, problem_of([bound]).data)
        x = np.array([0.0, 0.1, 0.1, 0.2, 0.3])
        points = evaluate_many(objective, stencil(objective, x).nodes)
    # the last two variables are of one experiment: both steps, both middles, one sweep of 5 points
    assert sum(point.runs for point in points[6:]) == 4 + 2 + 5
    assert all(point.runs == 7 for point in points[:6])


def test_derived_outputs_are_read_once_at_each_place(swift_fmu: Path, tmp_path: Path) -> None:
    """Three places, a run each for every vector; f1 as in the closed form."""
    bound = campaign(tmp_path, swift_fmu)
    other = P * [0.9, 1.0, 1.0]
    with FmuWorkers(swift_fmu, workers=1, reuse="never") as workers:
        response = through(workers, bound, drafted(bound), {"reflection": False})
        counted = [workers.counts.runs]
        for asked in ([P, other, P], [other], [P]):
            found = response.derived_many(asked)[-1]
            counted.append(workers.counts.runs)
        replace(response).derived_many([P])  # another response has read nothing
        counted.append(workers.counts.runs)
        ends = response.read_at(2).derived_many([P])[0]
        counted.append(workers.counts.runs)
        response.read_at(3).derived_many([P])  # that is all of them, which it has read
        counted.append(workers.counts.runs)
    assert list(np.diff(counted)) == [6, 0, 0, 3, 2, 0]
    c, s = np.cos(P[0]), np.sin(P[0])
    etas = [(6940210.0, 7027550.0), (6940210.0, 7027550.0), (6940240.0, 7027580.0)]
    f1 = [np.hypot(c * plus, s * minus) for plus, minus in etas]
    assert found["f1"] == pytest.approx(f1, rel=1e-12)
    assert ends["f1"] == pytest.approx([f1[0], f1[2]], rel=1e-12)


def test_derived_outputs_are_read_in_the_runs_of_the_peaks(swift_fmu: Path, tmp_path: Path) -> None:
    """As many runs as for the peaks alone; lambda = NaN where theta has none is no failure."""
    bound = campaign(tmp_path, swift_fmu)
    other = P * [0.1, 1.0, 1.0]  # sin(2 theta) > 0: lambda is no real number
    with FmuWorkers(swift_fmu, workers=1, reuse="never") as workers:
        plain = through(workers, bound, drafted(bound), {"reflection": False})
        counted = [workers.counts.runs]
        alone, outputs = plain.evaluate_many([P, other]), plain.derived_many([P, other])
        counted.append(workers.counts.runs)
        response = replace(plain)  # knows nothing yet
        both = response.evaluate_and_read([P, other], [0, 1])
        read = response.derived_many([P, other])
        counted.append(workers.counts.runs)
    runs = np.diff(counted)
    assert runs[0] - runs[1] == 6, "three places, a run each for two vectors, are left out"
    assert math.isnan(read[1]["lambda"][0])
    for one, same, here, there in zip(alone, both, outputs, read, strict=True):
        assert one.runs == same.runs
        assert np.array_equal(one.predictions[0].values, same.predictions[0].values)
        for name, values in here.items():
            assert np.array_equal(values, there[name], equal_nan=True)


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ("q2_hybrid", "q3_hybrid", "'q3_hybrid'"),
        ("q2_hybrid", "lambda", "one unit"),
        ("q2_hybrid", "theta", ""),
    ],
)
def test_an_output_that_cannot_be_compared_is_refused(
    swift_fmu: Path, tmp_path: Path, old: str, new: str, found: str
) -> None:
    with pytest.raises(BadInput, match=r"experiments\.csv: row 3, .*'output'.*" + found):
        campaign(tmp_path, swift_fmu, ROWS.replace(old, new))


def test_a_parameter_may_have_a_value_in_every_experiment(swift_fmu: Path, tmp_path: Path) -> None:
    """The gain of the drive on mode 1, one per experiment: its peaks follow it, no other does."""
    bound = campaign(tmp_path, swift_fmu)
    text = (tmp_path / "campaign.toml").read_text()
    more = (
        '\n[[parameters]]\nname = "g1"\nscope = "experiment"\nlower = 0.5\nupper = 2.0\n'
        "start = 1.0\nprior = 0.1\n"
    )
    (tmp_path / "campaign.toml").write_text(text + more)
    path = tmp_path / "campaign.toml"
    bound = bind(read_campaign(path), read_description(swift_fmu).variables)
    assert [p.name for p in bound.parameters[3:]] == ["g1[own]", "g1[cross]", "g1[again]"]
    assert {p.prior_sigma for p in bound.parameters[3:]} == {0.1}
    with FmuWorkers(swift_fmu, workers=1) as workers:
        response = through(workers, bound, drafted(bound), {"reflection": False})
        plain, moved = response.evaluate_many(
            [np.array([*P, 1.0, 1.0, 1.0]), np.array([*P, 1.0, 1.0, 1.5])]
        )
    peaks, louder = plain.predictions[0].values, moved.predictions[0].values
    assert peaks == pytest.approx(expected((0.0, 0.0, 0.0)), rel=1e-8)
    assert louder[:4] == pytest.approx(peaks[:4], rel=1e-12)
    # mode 1 is driven 1.5 times as hard; what mode 2 lends it is 1e-3 of that
    assert louder[4:] == pytest.approx(1.5 * peaks[4:], rel=2e-3)
    assert moved.predictions[1].maximum == plain.predictions[1].maximum
    twice = more.replace('scope = "experiment"', 'scope = "campaign"')
    path.write_text(text + more + twice)
    with pytest.raises(BadInput, match="'g1'"):
        bind(read_campaign(path), read_description(swift_fmu).variables)
