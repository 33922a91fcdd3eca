"""What a laboratory says is true of itself, against the closed form that the tests have."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.lab.true_values import nearest, true_values
from tests.support.virtual import modes


def values_of(truth: dict[str, object], reflection: bool = False) -> dict[str, float]:
    return true_values(truth, reflection=reflection)


def test_values_of_a_drifting_series_are_means_over_its_drives() -> None:
    truth = ff.synthesize("q1", seed=4).truth
    rows = truth["experiment"]
    closed = modes.derived(
        {
            "theta": truth["modes"]["theta_rad"],
            "d1": truth["modes"]["d1_hz"],
            "d2": truth["modes"]["d2_hz"],
            "eta_plus": [row["eta_plus_hz"] for row in rows],
            "eta_minus": [row["eta_minus_hz"] for row in rows],
        }
    )
    found = values_of(dict(truth))
    assert len(rows) == 5
    for name, each in closed.items():
        assert found[name] == pytest.approx(float(np.mean(each)), rel=1e-14), name
    assert found["d1"] == 120.0


def test_a_reflection_that_answers_alike_has_other_parameters() -> None:
    """The response of both forms, by the closed form, is the same; so are width and coupling."""
    truth = dict(ff.synthesize("q2", seed=1).truth)
    rotation, reflection = values_of(truth), values_of(truth, reflection=True)
    u = np.linspace(6.9402e6, 6.9404e6, 7)
    one, other = (
        np.abs(modes.phasors({**v, "reflection": float(k)}, u)[0])
        for k, v in enumerate((rotation, reflection))
    )
    assert reflection["d1"] == rotation["d2"] != rotation["d1"]
    assert other == pytest.approx(one, rel=1e-9)
    for name in ("width_plus", "width_minus", "lambda", "Q_plus"):
        assert reflection[name] == pytest.approx(rotation[name], rel=1e-12)
    assert reflection["f1"] == pytest.approx(rotation["f2"], rel=1e-12)


@pytest.mark.parametrize(
    ("kind", "changes", "wanted"),
    [
        ("notch", {"width_hz": 1e5}, {"eta_plus": 5e9, "d1": 1e5, "Q_plus": 5e4}),
        ("transmission", {"delay_s": 2e-8}, {"delay": 2e-8}),
        ("crossing", {"lambda_hz": 80.0}, {"lambda12": 80.0, "a0": 1001.0, "a1": 4.0, "f2": 1e3}),
        ("crossing", {"modes": 3}, {"lambda12": 100.0, "lambda23": 110.0, "f3": 1010.0, "d3": 3.0}),
        ("ringdown", {"d1_hz": 5.0}, {"d1": 5.0, "eta_minus": 1012.0, "theta": 1.95}),
        ("lock-in", {}, {"d2": 0.8}),
    ],
)
def test_values_of_a_curve_are_those_it_was_made_of(
    kind: str, changes: dict[str, Any], wanted: dict[str, float]
) -> None:
    found = values_of(dict(ff.synthesize_curves(kind, seed=2, **changes).truth))
    assert {name: found[name] for name in wanted} == pytest.approx(wanted, rel=1e-14)


def test_where_a_drifting_crossing_is_depends_on_when() -> None:
    truth = ff.synthesize_curves("crossing", seed=2, drift_hz=3.0).truth
    assert {"a0", "f2"}.isdisjoint(values_of(dict(truth)))
    truth = ff.synthesize_curves("crossing", seed=2, modes=3, drift_hz=3.0).truth
    assert {"a0", "f2", "f3"}.isdisjoint(values_of(dict(truth)))


def test_cubic_terms_and_pumped_coupling_are_told() -> None:
    assert values_of(dict(ff.synthesize("duffing", seed=1).truth))["alpha1"] == 1e32
    pumped = dict(ff.synthesize("pumped", seed=1).truth)
    assert values_of(pumped)["lambda12"] == pumped["outcome"]["lambda_hz"]
    twice = dict(ff.synthesize("string_pumped", seed=1, depth_per_volt=5e-5).truth)
    found = values_of(twice)
    told = [twice["outcome"][f"{name}_hz"] for name in ("lambda", "f1", "f2")]
    assert [found[name] for name in ("lambda12", "f1", "f2")] == pytest.approx(told, rel=1e-12)
    assert found["gain"] == 5e-5


def test_an_angle_is_told_where_the_estimate_is() -> None:
    assert nearest("theta", 1.95, 1.95 - math.pi + 0.3) == pytest.approx(1.95 - math.pi)
    assert nearest("theta", 1.95, math.nan) == 1.95
    assert nearest("d1", 100.0, 200.0) == 100.0
