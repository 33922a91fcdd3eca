"""A few of the random scenes of `tests.bench.bench_scenes`, through the commands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import build_fmu
from tests.bench.bench_scenes import MODELS, Outcome, outcome_of, report, scene_of

#: A drive of each linear model, and a sweep: of 10 transients are largest where no plan looks.
FEW = (0, 1, 9, 10)


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("models")
    return {model: build_fmu.build(model, folder) for model in MODELS[:2]}


@pytest.mark.parametrize("number", FEW)
def test_a_damped_scene_ends_with_0_and_its_promise_is_kept(
    number: int, fmus: dict[str, Path]
) -> None:
    outcome = outcome_of(scene_of(1, number), fmus)
    assert outcome.code == 0, outcome.text
    assert outcome.kept, (outcome.promised, outcome.error)
    # what is wrong is noticed
    assert not replace(outcome, error=2.0 * outcome.promised + 1e-5).kept


def test_scenes_cover_the_extremes() -> None:
    scenes = [scene_of(1, k) for k in range(300)]
    for model in MODELS:
        own = [scene for scene in scenes if scene.model == model]
        assert min(s.q for s in own if s.sweep is None) < 1e3
        assert max(s.q for s in own) > 5e7
        sizes = [s.values["A1"] for s in own]
        assert max(sizes) / min(sizes) > 1e18
        frequencies = [s.values["u1"] for s in own]
        assert min(frequencies) < 1e-2
        assert max(frequencies) > 1e11
    rows = report([Outcome(scene=scene, code=0, promised=1.0, error=0.5) for scene in scenes])
    assert len(rows) == 2 + 2 * len(MODELS)
