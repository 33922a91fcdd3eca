"""Draws from posteriors that are known without any: in closed form, or by a sum over a grid."""

from __future__ import annotations

import builtins
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import t

import fitting as ff
from fitting.fit.problem import Problem as Record
from fitting.posterior import CHAIN_FILE, chain, summary
from fitting.posterior.figure import draw
from fitting.report.figures.style import RED
from tests.support import closed_posteriors as closed
from tests.support.datasets import dataset


def fitted(problem: ff.Problem) -> ff.Fit:
    return ff.fit(problem, ff.Tikhonov(levels=4, misfit="squares"), starts=1)


@pytest.fixture(scope="module")
def linear() -> ff.Posterior:
    problem = closed.linear()
    return ff.posterior(problem, fitted(problem), ff.Sampling(seed=1))


def close(found: ff.Posterior, mean: np.ndarray, covariance: np.ndarray) -> None:
    """Mean, standard deviation and interval within four errors of so many draws."""
    for value, truth, std in zip(
        found.values.values(), mean, np.sqrt(np.diag(covariance)), strict=True
    ):
        error = 4.0 / math.sqrt(value.effective)
        assert abs(value.mean - truth) < error * std
        assert value.std / std == pytest.approx(
            1.0, abs=error
        )  # sqrt(2) errors of its own: 4 are 6
        low, high = value.ci95
        # an end of 95 % is known to sqrt(p (1 - p))/phi = 2.67 times the error of the mean
        assert low == pytest.approx(truth - 1.96 * std, abs=2.67 * error * std)
        assert high == pytest.approx(truth + 1.96 * std, abs=2.67 * error * std)


def test_a_linear_problem_has_the_posterior_of_its_normal_equations(linear: ff.Posterior) -> None:
    assert linear.status == "converged"
    mean, covariance = closed.linear_moments()
    close(linear, mean, covariance)
    drawn = np.corrcoef(linear.draws.reshape(-1, 3).T)
    scale = np.sqrt(np.diag(covariance))
    effective = min(value.effective for value in linear.values.values())
    assert drawn == pytest.approx(
        covariance / np.outer(scale, scale), abs=4.0 / math.sqrt(effective)
    )


def test_derived_outputs_are_read_at_the_draws(linear: ff.Posterior) -> None:
    """A sum of Gaussian values is Gaussian; a root has a value where it is real."""
    mean, covariance = closed.linear_moments()
    along, found = closed.ALONG, linear.derived["sum"]
    std, error = math.sqrt(along @ covariance @ along), 4.0 / math.sqrt(found.draws)
    assert found.missing == 0.0
    assert abs(found.mean - along @ mean) < error * std
    assert found.std / std == pytest.approx(1.0, abs=error)
    assert found.ci95 == pytest.approx(
        (found.mean - 1.96 * std, found.mean + 1.96 * std), abs=2.67 * error * std
    )
    assert found.profile95 == pytest.approx(
        (along @ mean - 1.96 * std, along @ mean + 1.96 * std), abs=0.02 * std
    )
    root = linear.derived["root"]
    share = 0.5 * math.erfc(closed.REAL_FROM / math.sqrt(2.0))  # of a Gaussian beyond -0.5 sigma
    assert 1.0 - root.missing == pytest.approx(share, abs=0.5 * error)
    assert linear.outputs["sum"] == pytest.approx(linear.thinned @ along)
    assert re.search(r"root .* [23]\d\.\d %", repr(linear))  # of the draws have no value


def test_unknown_noise_makes_student_s_t() -> None:
    """Twelve values of three unknowns: t with nine degrees of freedom, wider than a Gaussian."""
    rng = np.random.default_rng(5)
    matrix = rng.standard_normal((12, 3)) + np.array([3.0, 0.0, 0.0])
    measured = matrix @ [3.0, -1.0, 2.0] + 0.1 * rng.standard_normal(12) + 40.0
    names = [closed.parameter(f"p{k}", -100.0, 100.0, 1.0) for k in (1, 2, 3)]
    formula = closed.Formula(lambda p: p @ matrix.T + 40.0)
    problem = closed.problem(formula, names, measured, np.zeros(12))
    found = ff.posterior(problem, fitted(problem))
    assert found.status == "converged"
    # rows are relative, z/z* - 1: weights 1/z*^2
    weighed, right = matrix / measured[:, None], (measured - 40.0) / measured
    centre, left, *_ = np.linalg.lstsq(weighed, right, rcond=None)
    spread = np.sqrt(np.diag(np.linalg.inv(weighed.T @ weighed)) * left[0] / 9.0)
    for value, middle, scale in zip(found.values.values(), centre, spread, strict=True):
        error = 4.0 / math.sqrt(value.effective)
        assert value.mean == pytest.approx(middle, abs=error * scale)
        assert value.std == pytest.approx(scale * math.sqrt(9.0 / 7.0), rel=1.5 * error)
        half = t.ppf(0.975, 9) * scale
        assert value.ci95[1] - value.ci95[0] == pytest.approx(2.0 * half, rel=1.5 * error)
    assert "integrated out" in repr(found)


def test_a_gaussian_prior_is_one_more_measurement() -> None:
    prior = (3.0, 0.2)
    problem = closed.linear(prior)
    found = ff.posterior(problem, fitted(problem))
    close(found, *closed.linear_moments(prior))
    assert found.values["p1"].prior_sigma == 0.2
    assert any("p1" in note for note in found.summary.notes)


def test_an_exchange_that_a_prior_favours_has_both_minima_as_often_as_they_are_likely() -> None:
    problem = closed.exchange()
    found = ff.posterior(problem, fitted(problem), truth={"p1": 7.0, "p2": 3.0})
    assert found.status == "converged"
    share = closed.exchange_share()
    assert 0.1 < 1.0 - share < 0.45
    above = found.draws[..., 0] > found.draws[..., 1]
    fewest = min(value.effective for value in found.values.values())
    error = math.sqrt(share * (1.0 - share) / fewest)
    assert float(np.mean(above)) == pytest.approx(share, abs=4.0 * error)
    here, there = found.summary.modes
    assert here.share == pytest.approx(share, abs=4.0 * here.share_error)
    assert here.share + there.share == pytest.approx(1.0)
    assert here.share_error < 0.03
    assert sorted(here.parameters.values()) == pytest.approx([3.0, 7.0], abs=0.1)
    assert re.search(r"\bshare\b", repr(found))


def test_the_most_likely_minimum_stands_first_though_a_broad_one_has_more_draws() -> None:
    """ln p is 0.5 less in the broad well, which has 0.86 of the mass."""
    problem = closed.wells(start=13.0)
    found = ff.posterior(problem, fitted(problem), ff.Sampling(seed=1))
    assert found.status == "converged"
    narrow, broad = found.summary.modes
    assert narrow.parameters["p"] == pytest.approx(closed.NARROW, abs=0.1 * closed.NARROW_WIDTH)
    assert broad.parameters["p"] == pytest.approx(closed.BROAD, abs=0.1 * closed.BROAD_WIDTH)
    assert (narrow.below, broad.below) == pytest.approx((0.0, closed.LESS), abs=0.01)
    assert broad.share == pytest.approx(closed.broad_share(), abs=4.0 * broad.share_error)
    [panel] = draw(found.summary, found.draws.reshape(-1, 1)).drawn.axes
    [starred] = [line for line in panel.lines if line.get_color() == RED]
    assert starred.get_xdata() == pytest.approx([closed.NARROW] * 2, abs=0.1 * closed.NARROW_WIDTH)
    assert re.search(r"box +0 .*\n.*fit +[-−]0\.50 ", repr(found))


def test_walkers_that_cannot_change_minima_are_not_called_converged() -> None:
    """Without the mixture each walker stays where it began: any share would come out."""
    problem = closed.exchange()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chain, "SHARES", {"mixture": 0, "image": 0, "stretch": 1, "difference": 0})
        found = ff.posterior(problem, fitted(problem), ff.Sampling(steps=1000, walkers=8))
    assert found.status == "not converged"
    assert math.isnan(found["p1"].value)
    assert all(math.isnan(end) for end in (*found["p1"].ci68, *found["p1"].ci95))
    assert all(math.isnan(mode.share) for mode in found.summary.modes)
    assert "not converged" in repr(found)
    assert found.values["p1"].rhat > 1.01


def test_a_box_that_cuts_the_posterior_cuts_the_draws() -> None:
    """z = p, measured 0.2 above the upper end of the box with noise 1: a Gaussian's lower part."""
    formula = closed.Formula(lambda p: p)
    problem = closed.problem(
        formula, [closed.parameter("p", -9.0, 11.0, 9.0)], np.array([11.2]), np.array([1.0])
    )
    found = ff.posterior(problem, fitted(problem))
    assert np.max(found.draws) <= 11.0
    below = 0.5 * math.erfc(0.2 / math.sqrt(2.0))  # Phi(-0.2)
    density = math.exp(-0.5 * 0.2**2) / math.sqrt(2.0 * math.pi)
    mean = 11.2 - density / below
    value = found.values["p"]
    assert value.mean == pytest.approx(mean, abs=4.0 * value.std / math.sqrt(value.effective))


def test_a_period_counts_once_where_the_box_holds_it() -> None:
    """z = (cos p, sin p) about p = 0.05: half of the draws lie at the other end of the box."""
    circle = closed.Formula(lambda p: np.column_stack([2.0 + np.cos(p), 2.0 + np.sin(p)]))
    angle = replace(closed.parameter("p", 0.0, 2.0 * math.pi, 0.1), period=2.0 * math.pi)
    measured = np.array([2.0 + math.cos(0.05), 2.0 + math.sin(0.05)])
    problem = closed.problem(circle, [angle], measured, np.array([0.1, 0.1]))
    found = ff.posterior(problem, fitted(problem))
    assert found.status == "converged"
    value = found.values["p"]
    error = 4.0 / math.sqrt(value.effective)
    assert value.mean == pytest.approx(0.05, abs=0.1 * error)
    assert value.std == pytest.approx(0.1, rel=error + 0.01)  # an arc is as good as straight
    assert len(found.summary.modes) == 1


def test_an_angle_is_told_in_the_turn_of_the_fit_with_all_that_stands_beside_it(
    tmp_path: Path,
) -> None:
    """z = (cos 2 p, sin 2 p) about p = 2, begun two turns off: the period is pi."""
    circle = closed.Formula(lambda p: np.column_stack([3.0 + np.cos(2 * p), 3.0 + np.sin(2 * p)]))
    box = closed.parameter("p", -2.0 * math.pi, 2.0 * math.pi, 1.9 - 2.0 * math.pi)
    angle = replace(box, period=math.pi, unit="rad")
    measured = np.array([3.0 + math.cos(4.0), 3.0 + math.sin(4.0)])
    problem = closed.problem(circle, [angle], measured, np.array([0.1, 0.1]))
    at = ff.profile(fitted(problem))
    found = ff.posterior(problem, at, truth={"p": 2.0 + math.pi})
    value, [mode] = found["p"], found.summary.modes
    assert at["p"].value == pytest.approx(2.0, abs=1e-3)
    assert value.truth == pytest.approx(2.0)
    assert mode.parameters["p"] == pytest.approx(2.0, abs=1e-3)
    assert value.most_likely == pytest.approx(2.0, abs=1e-3)
    assert np.all(np.abs(found.draws - 2.0) < 0.5 * math.pi)
    assert value.value == pytest.approx(2.0, abs=0.05)  # sigma is 0.05
    low, high = value.profile95
    assert low < 2.0 < high
    ff.write_posterior(found, tmp_path, drawn=False)
    _, *rows = (tmp_path / "draws.csv").read_text("utf-8").splitlines()
    assert np.abs(np.array(rows, dtype=float) - 2.0).max() < 0.5 * math.pi
    assert any(re.search(r"^p .*period.* 0\.4\d* .*\s3\.\d* rad\b", n) for n in found.summary.notes)


def test_where_the_model_has_no_value_nothing_is_likely() -> None:
    formula = closed.Formula(lambda p: p, fails=lambda p: p[0] > 11.0)
    problem = closed.problem(
        formula, [closed.parameter("p", -9.0, 31.0, 9.0)], np.array([10.5]), np.array([1.0])
    )
    found = ff.posterior(problem, fitted(problem))
    assert np.max(found.draws) <= 11.0
    assert found.summary.failed > 0
    assert f"{found.summary.failed} of {found.summary.evaluations}" in repr(found)


def test_the_same_seed_draws_the_same_and_another_one_others() -> None:
    problem = closed.linear()
    at = fitted(problem)
    one, again, other = (
        ff.posterior(problem, at, ff.Sampling(seed=seed, steps=200)) for seed in (1, 1, 2)
    )
    assert np.array_equal(again.draws, one.draws)
    assert not np.array_equal(other.draws[:9], one.draws[:9])


def test_an_interrupted_chain_goes_on_as_if_it_had_not_been(
    tmp_path: Path, linear: ff.Posterior
) -> None:
    problem = closed.linear()
    at = fitted(problem)

    def stop(words: str) -> None:
        if "correlation times" in words:
            raise KeyboardInterrupt

    begun = ff.posterior(problem, at, out=tmp_path, progress=stop)
    assert begun.status == "interrupted"
    assert math.isnan(begun["p1"].value)
    ended = ff.posterior(problem, at, ff.Sampling(resume=True), out=tmp_path)
    assert np.array_equal(ended.draws, linear.draws)
    assert ended.summary.evaluations >= linear.summary.evaluations
    with pytest.raises(ff.BadInput, match=re.escape(CHAIN_FILE)):
        ff.posterior(problem, at, ff.Sampling(resume=True, seed=3), out=tmp_path)
    (tmp_path / CHAIN_FILE).write_bytes(b"no chain")
    with pytest.raises(ff.BadInput, match=re.escape(CHAIN_FILE)):
        ff.posterior(problem, at, ff.Sampling(resume=True), out=tmp_path)


@pytest.mark.parametrize("early", [True, False])
def test_one_that_is_interrupted_between_two_steps_goes_on_from_them(
    early: bool,
    tmp_path: Path,
    linear: ff.Posterior,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """With too few steps for a result the chain is kept all the same."""
    problem = closed.linear()
    at = fitted(problem)
    plain, calls = ff.Problem.logp, 0

    def logp(self: ff.Problem, p: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        if calls == (100 if early else 450):
            raise KeyboardInterrupt
        return plain(self, p)

    with monkeypatch.context() as patch:
        patch.setattr(ff.Problem, "logp", logp)
        if early:
            with pytest.raises(KeyboardInterrupt, match=re.escape(CHAIN_FILE)):
                ff.posterior(problem, at, out=tmp_path)
        else:
            assert ff.posterior(problem, at, out=tmp_path).status == "interrupted"
    assert capsys.readouterr() == ("", "")
    with np.load(tmp_path / CHAIN_FILE) as kept:
        steps = len(kept["places"])
        assert steps not in (0, 200, 300, 450)
    calls = 0
    ended = ff.posterior(problem, at, ff.Sampling(resume=True), out=tmp_path)
    assert np.array_equal(ended.draws, linear.draws)


def test_while_draws_are_made_it_says_so_and_how_far_they_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The line stays until the next one: none may tell what has ended while another thing runs."""
    monkeypatch.setattr(summary, "LONG_ENOUGH", 1e9)
    problem, told = ring(), list[str]()
    ff.posterior(problem, fitted(problem), ff.Sampling(steps=220, walkers=8), progress=told.append)
    begun = next(k for k, words in enumerate(told) if words.startswith("drawing "))
    assert re.findall(r"\d+", told[begun]) == ["1", "200", "220"]
    assert told[begun + 1].startswith("160 steps ")
    further = told[begun + 2].removesuffix(told[begun + 1])
    assert re.findall(r"\d+", further) == ["201", "220", "220"]
    assert told[begun + 3].startswith("176 steps ")


def test_a_ring_is_drawn_all_round() -> None:
    """z = p1^2 + p2^2 with noise a quarter of it: any angle, as often as any other."""
    problem = ring(0.25)
    found = ff.posterior(problem, ff.profile(fitted(problem)), ff.Sampling(steps=20_000))
    assert found.status == "converged"
    assert len(found.summary.modes) == 1
    angle = np.arctan2(*np.moveaxis(found.thinned, -1, 0))
    turned = [float(np.abs(np.mean(np.exp(1j * k * angle)))) for k in (1, 2)]
    assert max(turned) < 4.0 / math.sqrt(len(angle))


def ring(noise: float = 0.1) -> ff.Problem:
    """z = p1^2 + p2^2, measured 1 with noise: any angle."""
    names = [closed.parameter("p1", -2.0, 2.0, 1.0), closed.parameter("p2", -2.0, 2.0, 0.1)]
    formula = closed.Formula(lambda p: np.sum(p**2, axis=1, keepdims=True))
    return closed.problem(formula, names, np.array([1.0]), np.array([noise]))


def test_what_is_written_says_what_was_found(tmp_path: Path, linear: ff.Posterior) -> None:
    paths = ff.write_posterior(linear, tmp_path)
    assert {p.name for p in paths} == {
        "posterior.json",
        "draws.csv",
        "1_corner.csv",
        "1_corner.svg",
        "report.html",
    }
    told = json.loads((tmp_path / "posterior.json").read_text("utf-8"))
    assert told["values"]["p2"]["value"] == linear["p2"].value
    head, *rows = (tmp_path / "draws.csv").read_text("utf-8").splitlines()
    assert head == "p1,p2,p3,sum,root"
    table = np.array([[float(cell or "nan") for cell in row.split(",")] for row in rows])
    wanted = np.column_stack([linear.thinned, linear.outputs["sum"], linear.outputs["root"]])
    assert np.array_equal(table, wanted, equal_nan=True)
    page = (tmp_path / "report.html").read_text("utf-8")
    assert "converged" in page
    assert "uniform" in page


def test_the_cost_is_known_before(linear: ff.Posterior) -> None:
    problem = closed.linear()
    cost = ff.posterior_cost(problem, fitted(problem))
    least, most = cost.evaluations
    assert cost.walkers == linear.summary.walkers
    assert cost.minima == 1
    # points outside of the box are not evaluated, of which this box knows none
    assert least <= linear.summary.evaluations <= most


def test_what_cannot_be_drawn_from_is_told(tmp_path: Path) -> None:
    problem = closed.linear()
    at = fitted(problem)
    with pytest.raises(ff.BadInput, match=r"\b4 .*\b3 .*\b6\b"):
        ff.posterior(problem, at, ff.Sampling(walkers=4))
    with pytest.raises(ff.BadInput, match="walkers is 7"):
        ff.Sampling(walkers=7)
    with pytest.raises(ff.BadInput, match=r"steps is 10, .*\b200\b"):
        ff.Sampling(steps=10)
    with pytest.raises(ff.BadInput, match="seed is -1"):
        ff.Sampling(seed=-1)
    with pytest.raises(ff.BadInput, match="p, p1, p2 and p3"):
        ff.posterior(one_of_unknown_noise(), at)
    unknown = one_of_unknown_noise()
    with pytest.raises(ff.BadInput, match="1 of 1 rows"):
        ff.posterior(unknown, fitted(unknown))
    with pytest.raises(ff.BadInput, match="at is 3"):
        ff.posterior(problem, 3)  # type: ignore[arg-type]


def one_of_unknown_noise() -> ff.Problem:
    parameters = (closed.parameter("p", 0.0, 20.0, 9.0),)
    record = Record(parameters=parameters, data=dataset(np.array([10.0]), np.array([0.0])))
    formula = closed.Formula(lambda p: p)
    return ff.Problem.answered_by(lambda alternative: formula, record)


def test_without_the_library_a_sentence_says_how_to_have_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem = closed.linear()
    at = fitted(problem)
    given = builtins.__import__

    def without(
        name: str,
        names: Mapping[str, object] | None = None,
        inside: Mapping[str, object] | None = None,
        some: Sequence[str] = (),
        level: int = 0,
    ) -> Any:
        if name == "emcee":
            raise ImportError("No module named 'emcee'")
        return given(name, names, inside, some, level)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ff.BadInput, match=r"'fmu-fit\[posterior\]'"):
        ff.posterior(problem, at)
