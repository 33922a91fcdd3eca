"""A budget of runs: what it cuts is called that, and more of it extends what was cut."""

from __future__ import annotations

import math
import re
import shlex
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign.parameters import to_search
from fitting.cli.main import main
from fitting.fit.objective import Objective
from fitting.inference.likelihood.knowledge import Determined
from fitting.measurements.measurement import Evaluation, Response
from fitting.report.screen import phrase
from fitting.result.result import Result, read_result
from fitting.text.arrays import FloatArray
from fitting.text.errors import OutOfBudget
from fitting.text.estimate import Verdict
from tests.support.small_campaign import STRING, small_campaign
from tests.support.whitened import Z95, learnt, parameter, whitened

ALONG = np.linspace(-1.0, 1.0, 9)


def decays(x: FloatArray) -> FloatArray:
    """a e^(k t) against 5 e^(0.7 t), and s, which begins in a valley that is worse by a little."""
    own = x[0] * np.exp(x[1] * ALONG) - 5.0 * np.exp(0.7 * ALONG)
    return np.asarray(np.append(own / 0.2, 1.5 * np.tanh(4.0 * (x[2] - 0.4)) * (x[2] + 0.4)))


def test_whatever_a_budget_cuts_is_known_or_called_cut() -> None:
    """The product a k is 3.5: by any budget it is that, or cut; never open, and never a fault."""
    own = (
        parameter("a", 1.0, 20.0, start=6.0),
        parameter("k", 0.1, 3.0, start=1.0),
        parameter("s", -2.0, 2.0, start=1.5),
    )
    objective = whitened(decays, *own, both=lambda x: float(x[0] * x[1]))
    seen = set()
    for budget in [*range(4, 60, 5), 80, 120, 180, 270, 400, 600, 900, 1400, 5000]:
        try:
            both = learnt(objective, budget=budget).derived["both"]
        except OutOfBudget:
            assert budget < 60
            continue
        seen.add(both.status)
        if both.status is Verdict.UNKNOWN:
            assert "cut for its cost" in both.reason
        else:
            assert both.status is Verdict.DETERMINED
            assert both.ci95[0] < 3.5 < both.ci95[1]
    assert seen == {Verdict.UNKNOWN, Verdict.DETERMINED}


@dataclass(frozen=True)
class _Costly:
    """Another response whose every evaluation takes 20,000 runs, as that of many pairs does."""

    own: Response

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [replace(e, runs=20_000) for e in self.own.evaluate_many(ps, whole=whole)]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return self.own.derived_many(ps)


def test_the_usual_budget_is_enough_where_every_evaluation_takes_many_runs() -> None:
    """400,000 runs are 20 evaluations there, by which nothing is known."""
    own = (parameter("a", 1.0, 20.0, start=6.0), parameter("k", 0.1, 3.0, start=1.0))
    plain = whitened(lambda x: decays(np.append(x, 0.4)), *own, both=lambda x: float(x[0] * x[1]))
    costly = replace(plain, response=_Costly(plain.response))
    cut = learnt(costly, budget=400_000).derived["both"]
    assert cut.status is Verdict.UNKNOWN
    both = learnt(costly).derived["both"]
    assert both.status is Verdict.DETERMINED
    assert both.ci95[0] < 3.5 < both.ci95[1]


def of_a_long_series(s: Callable[[float], list[float]]) -> Objective:
    """a = 5, k = 0.7, s by its rows, and fourteen offsets of single experiments, all of them 0."""
    shared = (
        parameter("a", 1.0, 20.0, start=6.0),
        parameter("k", 0.1, 3.0, start=1.0),
        parameter("s", -2.0, 2.0, start=1.0),
    )
    single = [parameter(f"o{k}", -3.0, 3.0, start=0.5, experiment=f"e{k}") for k in range(14)]

    def rows(x: FloatArray) -> FloatArray:
        return np.concatenate([decays(np.append(x[:2], 0.4)), s(x[2]), x[3:] / 0.5])

    return whitened(
        rows, *shared, *single, both=lambda x: float(x[0] * x[1]), place=lambda x: float(x[2])
    )


def known_of_a_long_series(found: Determined) -> set[str]:
    """What is known besides the offsets; each holds its truth."""
    profiles = {**found.derived, **found.parameters}
    known = {n for n, p in profiles.items() if p.status is not Verdict.UNKNOWN and n[0] != "o"}
    for name, truth in (("a", 5.0), ("k", 0.7), ("both", 3.5), ("s", -1.0), ("place", -1.0)):
        low, high = profiles[name].ci95
        assert low < truth < high
    return known


def test_more_of_a_budget_takes_back_nothing_that_was_known() -> None:
    objective = of_a_long_series(lambda s: [(s + 1.0) / 0.5])
    told = [known_of_a_long_series(learnt(objective, budget=n)) for n in (60, 220, 300, 3000)]
    assert told[0] <= told[1] <= told[2] <= told[3] == {"a", "k", "both", "s", "place"}


def test_a_better_point_ends_dear_walks_and_the_budget_is_for_those_around_it() -> None:
    """s begins in a valley of chi square 3.1; on its way out is that of none, at -1."""
    objective = of_a_long_series(lambda s: [2.0 * (s**2 - 1.0), 0.9 * (s + 1.0)])
    begin = [to_search(objective.parameters, np.array([p.start for p in objective.parameters]))]
    found = learnt(objective, budget=1500, minima=begin)
    assert found.knowledge.chi_square < 0.01
    assert known_of_a_long_series(found) == {"a", "k", "both", "s", "place"}


def test_a_budget_without_a_best_fit_says_so_and_does_not_blame_the_model() -> None:
    """Far off the start chi square is no word on the model, which describes these data exactly."""
    objective = whitened(decays, *(parameter(n, 0.1, 20.0, start=19.0) for n in "aks"))
    with pytest.raises(OutOfBudget):
        learnt(objective, budget=6)


def test_what_is_not_known_is_not_told_with_what_is_not_determined() -> None:
    own = parameter("a", 1.0, 20.0, start=6.0)
    found = learnt(whitened(lambda x: np.full(3, (x[0] - 5.0) / (0.3 * math.sqrt(3.0))), own))
    assert found.parameters["a"].ci95 == pytest.approx((5.0 - 0.3 * Z95, 5.0 + 0.3 * Z95), rel=1e-3)
    assert not re.search(r"\ba\b", phrase("knowledge", "left", found))
    cut = {"a": replace(found.parameters["a"], status=Verdict.UNKNOWN)}
    said = phrase("knowledge", "left", replace(found, parameters=cut))
    assert re.search(r"[Kk]nown.*\ba\b", said)
    assert "determine" not in said


def small(folder: Path, fmu: Path) -> tuple[list[str], Path]:
    """The command on a small campaign, and where its results go."""
    campaign, out = small_campaign(folder / "small", fmu), folder / "out"
    words = ["reconstruct", str(campaign), "--out", str(out), "--workers", "1", "--no-report"]
    return words, out


def reconstructed(words: list[str], out: Path, text: pytest.CaptureFixture[str]) -> Result:
    """The result of the command, which has ended well."""
    assert main(words) == 0, text.readouterr().err
    return read_result(out / "result.json")


def test_the_command_says_what_was_cut_and_which_budget_tells(
    swift_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What stands under "next" is typed, the usual budget: the width is in its interval."""
    words, out = small(tmp_path, swift_fmu)
    little = reconstructed([*words, "--budget", "60"], out, capsys)
    said = " ".join(capsys.readouterr().out.split())
    assert little.derived["width_plus"].status is Verdict.UNKNOWN
    assert "cut for its cost" in said
    assert "budget" in said
    assert "unconstrained" not in said.partition(" next ")[0].lower()
    next_words = shlex.split(said.partition(" next ")[2].partition("fmu-fit ")[2])
    assert next_words[: len(words)] == words
    assert next_words[len(words) :][:1] != ["--budget"]
    more = reconstructed(words, out, capsys)
    width = more.derived["width_plus"]
    assert width.status is Verdict.DETERMINED
    low, high = width.ci95
    truth = tomllib.loads((STRING / "truth.toml").read_text("utf-8"))
    assert low < truth["outcome"]["width_plus_hz"] < high


def test_a_budget_that_ends_before_any_profile_leaves_the_fit(
    swift_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words, out = small(tmp_path, swift_fmu)
    result = reconstructed([*words, "--budget", "3"], out, capsys)
    assert any("--budget" in said for said in result.warnings)
    assert result.derived["width_plus"].status is Verdict.LINEARISED
    assert (
        "--budget" not in capsys.readouterr().out.partition("  next ")[2].partition("  results")[0]
    )
