"""A fitted sweep is stated to have been made somewhere: the error of that is fitted, too.

Truth: `fitting.lab.string`, which shares no code with the FMU, and numbers done by hand.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.campaign import BoundCampaign, bind
from fitting.campaign.joint import named_apart
from fitting.campaign.parameters import Parameter
from fitting.fit.problem import problem_of
from fitting.fmu.description import read_description
from fitting.fmu.pool import FmuWorkers
from fitting.lab.bench import measure
from fitting.lab.benches import string_bench
from fitting.lab.writer import campaign_files
from fitting.measurements.kinds import read_campaign
from fitting.signal.scale import half_power_width
from fitting.text.errors import BadInput
from tests.bench.bench_coverage import Laboratory, ask, stated_wrongly
from tests.bench.bench_coverage import Setting as Kind
from tests.support.datasets import drafted, through
from tests.support.phasors import PhasorResponse

FIT = ('use = "scale"', 'use = "fit"')
PRIOR = ('prior = "30 Hz"\n', 'prior = "30 Hz"\nshare = {}\n')


def bound_with(
    fmu: Path, folder: Path, *changes: tuple[str, str], curvature_hz: float = 5.0
) -> BoundCampaign:
    """The q1 series with its text changed; a drift that bends is written with offsets."""
    series = measure(replace(string_bench("q1"), curvature_hz=curvature_hz), 1)
    for name, content in campaign_files(series, "test").items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    path = folder / "campaign.toml"
    text = path.read_text()
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    path.write_text(text)
    return bind(read_campaign(path), read_description(fmu).variables)


def of_sweep(bound: BoundCampaign) -> list[Parameter]:
    assert bound.sweep is not None
    return [p for p in bound.parameters if p.experiment and p.experiment == bound.sweep.label]


def test_a_sweep_that_is_fitted_has_the_offsets_of_the_drift(
    swift_fmu: Path, tmp_path: Path
) -> None:
    assert of_sweep(bound_with(swift_fmu, tmp_path)) == []
    own = of_sweep(bound_with(swift_fmu, tmp_path, FIT))
    assert [p.name for p in own] == ["offset eta_plus[sweep]", "offset eta_minus[sweep]"]
    assert [p.adds_to for p in own] == [("eta_plus",), ("eta_minus",)]
    assert [(p.prior_sigma, p.reference, p.unit) for p in own] == [(30.0, 0.0, "Hz")] * 2
    [both] = of_sweep(bound_with(swift_fmu, tmp_path, FIT, (PRIOR[0], PRIOR[1].format("true"))))
    assert (both.name, both.adds_to) == ("offset[sweep]", ("eta_plus", "eta_minus"))


def test_of_a_straight_drift_it_is_as_wide_as_the_drift_or_the_line(
    swift_fmu: Path, tmp_path: Path
) -> None:
    """100 Hz of drift beside a line of 94 Hz; what is declared counts in its place."""
    linear = ('model = "offsets"\nprior = "30 Hz"\n', "")
    bound = bound_with(swift_fmu, tmp_path, FIT, linear)
    assert bound.sweep is not None
    width = half_power_width(bound.sweep.frequency_hz, bound.sweep.amplitude_v)
    drifts = [abs(after - before) for before, after in bound.drift.ends.values()]
    expected = [max(width, drift) for drift in drifts]
    assert [p.prior_sigma for p in of_sweep(bound)] == pytest.approx(expected)
    assert bound.offsets == ()  # of the experiments: none
    told = ('use = "scale"', 'use = "fit"\nset_sigma = { eta_plus = "2e-6 MHz" }')
    own = {p.name: p.prior_sigma for p in of_sweep(bound_with(swift_fmu, tmp_path, told))}
    assert own["offset eta_plus[sweep]"] == pytest.approx(2.0)
    assert own["offset eta_minus[sweep]"] == pytest.approx(30.0)


@pytest.mark.parametrize(
    ("key", "found"),
    [
        ('use = "scale"\nset_sigma = { eta_plus = "1 Hz" }', 'set_sigma.*use = "fit"'),
        ('use = "fit"\nset_sigma = { eta_plus = "0 Hz" }', "eta_plus: .*0"),
        ('use = "fit"\nset_sigma = { eta_plus = "1 s" }', "eta_plus"),
        ('use = "fit"\nset_sigma = { g1 = 0.1 }', "g1"),
        ('use = "fit"\nset_sigma = { eta = "1 Hz" }', "'eta'"),
    ],
)
def test_an_error_that_makes_no_sense_is_refused(
    swift_fmu: Path, tmp_path: Path, key: str, found: str
) -> None:
    with pytest.raises(BadInput, match=found) as caught:
        bound_with(swift_fmu, tmp_path, ('use = "scale"', key))
    assert "\n" not in str(caught.value)


def test_what_is_exact_is_told(swift_fmu: Path, tmp_path: Path) -> None:
    """Of a program, which has no drift: stated values are exact unless an error is declared."""
    bound = bound_with(swift_fmu, tmp_path)
    assert bound.sweep is not None
    variables = read_description(swift_fmu).variables

    def made(**errors: float) -> BoundCampaign:
        assert bound.sweep is not None
        sweep = ff.Sweep(
            bound.setup,
            bound.sweep.frequency_hz,
            bound.sweep.amplitude_v,
            settings=bound.sweep.settings,
            setting_sigma=errors,
        )
        d1 = ff.Parameter("d1", 94.0, bounds=(1.0, 1000.0))
        fmu = ff.Fmu(swift_fmu, workers=1)
        problem = ff.Problem(fmu, parameters=[d1], measurements=[sweep])
        return problem.record.campaigns[""]

    assert variables["eta_plus"].unit == "Hz"
    exact = made()
    assert of_sweep(exact) == []
    assert ("eta_plus", "eta_minus") in [note.names.get("variables") for note in exact.notes]
    declared = made(eta_plus=0.5, eta_minus=3.0)
    assert [p.prior_sigma for p in of_sweep(declared)] == [0.5, 3.0]
    assert not any("eta_plus" in note.names.get("variables", ()) for note in declared.notes)


def test_series_that_are_fitted_together_have_their_own(swift_fmu: Path, tmp_path: Path) -> None:
    bounds = [bound_with(swift_fmu, tmp_path / name, FIT) for name in ("a", "b")]
    apart = named_apart(bounds)
    assert [bound.sweep.label for _, bound in apart if bound.sweep is not None] == [
        "a/sweep",
        "b/sweep",
    ]
    problem = problem_of(bounds)
    names = [p.name for p in problem.parameters if "sweep" in p.name]
    assert names == [f"offset {v}[{s}/sweep]" for s in "ab" for v in ("eta_plus", "eta_minus")]
    places = [label for m in problem.measurements for label, _ in m.places]
    assert {"a/sweep", "b/sweep"} < set(places)


def test_the_offset_moves_the_sweep_and_nothing_else(swift_fmu: Path, tmp_path: Path) -> None:
    bound = bound_with(swift_fmu, tmp_path, FIT)
    assert bound.sweep is not None
    names = [p.name for p in bound.parameters]
    p = np.array([q.start for q in bound.parameters])
    p[names.index("theta")] = 1.9498
    moved = p.copy()
    moved[names.index("offset eta_plus[sweep]")] = 20.0
    moved[names.index("offset eta_minus[sweep]")] = -7.0
    with FmuWorkers(swift_fmu, workers=1) as workers:
        response = through(workers, bound, drafted(bound), {})
        before, after = response.evaluate_many([p, moved])
    assert after.predictions[0].values == pytest.approx(before.predictions[0].values, rel=1e-12)
    closed = PhasorResponse(bound)
    for vector, evaluation in ((p, before), (moved, after)):
        assert np.abs(evaluation.predictions[1].values) == pytest.approx(
            closed.sweep(vector), rel=1e-6
        )
    top = bound.sweep.frequency_hz[np.argmax(np.abs(after.predictions[1].values))]
    assert top == bound.sweep.frequency_hz[np.argmax(np.abs(before.predictions[1].values))] + 20.0


def damping_and_misfit(laboratory: Laboratory) -> tuple[bool, float]:
    """Whether the interval of d1 holds its true value; chi square of the most likely point."""
    true = laboratory.truth["d1"]
    kind = Kind("stated", "", lambda *_: laboratory)
    found = ask(kind, replace(laboratory, truth={"d1": true}), PhasorResponse)
    low, high = found.profiled["d1"].ci95
    return low <= true <= high, found.knowledge.chi_square


def test_a_place_that_is_stated_wrongly_makes_nothing_known_that_is_not(
    swift_fmu: Path, tmp_path: Path
) -> None:
    """3.2 Hz off, 2 Hz declared; believed, the same place leaves what noise seldom does."""
    variables = read_description(swift_fmu).variables
    laboratory = stated_wrongly(40_011, variables, tmp_path, off_hz=2.0, declared=True)
    bound = laboratory.bound
    kept = tuple(p for p in bound.parameters if p.experiment != "sweep")
    declared, left = damping_and_misfit(laboratory)
    _, believed = damping_and_misfit(replace(laboratory, bound=replace(bound, parameters=kept)))
    assert declared
    assert believed > left + 25.0


COMPLEX = """
[[complex_sweep]]
file = "complex.csv"
set = { eta_plus = "6.94021 MHz", eta_minus = "7.02755 MHz" }
"""


@pytest.mark.parametrize(
    ("keys", "label", "priors"),
    [
        ("", "complex_sweep", [30.0, 30.0]),
        ('label = "cold"\n', "cold", [30.0, 30.0]),
        ('set_sigma = { eta_minus = "4 Hz" }\n', "complex_sweep", [4.0, 30.0]),
    ],
)
def test_so_has_a_complex_sweep(
    swift_fmu: Path, tmp_path: Path, keys: str, label: str, priors: list[float]
) -> None:
    f = np.linspace(6.9399e6, 6.9405e6, 41)
    h = 1e-5 / (1.0 + 2j * (f - 6.94021e6) / 94.0)
    rows = "\n".join(
        f"{a!r},{v.real!r},{v.imag!r}" for a, v in zip(f.tolist(), h.tolist(), strict=True)
    )
    (tmp_path / "complex.csv").write_text(f"frequency (Hz),x (V),y (V)\n{rows}\n")
    bound = bound_with(swift_fmu, tmp_path, ("\n[derived]", f"{COMPLEX}{keys}\n[derived]"))
    own = [p for p in bound.parameters if p.experiment == label]
    assert [p.prior_sigma for p in own] == priors
    assert {p.adds_to for p in own} == {("eta_plus",), ("eta_minus",)}
    [(place, _)] = bound.measurements["complex_sweep"].places
    assert place == label
