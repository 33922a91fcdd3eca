"""`fmu-fit identify` and the bootstrap: by the command, through the FMU, and on closed forms."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from fitting.cli.main import main
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import RowNoise
from fitting.fit.optimum import Optimum, most_likely
from fitting.inference.determine import InferenceOptions, determine
from fitting.inference.likelihood.identifiability import bootstrap
from fitting.inference.likelihood.knowledge import Determined, Identification
from fitting.text.estimate import Verdict
from fitting.text.records import read_json
from tests.support import single_line
from tests.support.string_part import string_part

pytestmark = pytest.mark.usefixtures("swift_models")

DATA = Path(__file__).parents[2] / "data"
SIGMA, SPAN = 0.02, 4.0


OUTPUTS = 'outputs = ["lambda", "width_plus"]'


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The command with its report; folder and what it printed."""
    out = tmp_path_factory.mktemp("identified")
    path = string_part(tmp_path_factory.mktemp("string") / "q1", pairs=(1, 3), outputs=OUTPUTS)
    with pytest.MonkeyPatch.context() as patch:
        said: list[str] = []
        patch.setattr(
            "builtins.print", lambda *words, **more: said.append(" ".join(map(str, words)))
        )
        assert main(["identify", str(path), "--out", str(out), "--workers", "2"]) == 0
    return out, "\n".join(said)


def test_the_command_says_what_the_data_determine(identified: tuple[Path, str]) -> None:
    out, said = identified
    printed = " ".join(said.split())
    assert re.search(r"λ .*782 kHz", printed), printed
    assert re.search(r"width_plus \d", printed)
    assert "--target lambda" in printed
    found = read_json(out / "identify.json", Identification)
    assert found.parameters["theta"].status is Verdict.UNCONSTRAINED
    assert found.derived["width_plus"].status is Verdict.DETERMINED
    assert found.synthetic
    assert found.knowledge.data
    assert found.derived["lambda"].status is Verdict.UNCONSTRAINED
    # three directions of five are seen: the line width of the observed mode and two offsets
    *seen, unseen, blind = (d.singular for d in found.knowledge.directions)
    assert len(seen) == 3
    assert min(seen) > 100.0 * unseen > 100.0 * blind
    [twin] = [e for e in found.knowledge.equivalents if e.origin == "alternative"]
    assert twin.where == "reflection = true"


def test_the_page_holds_tables_and_figures_and_says_synthetic(
    identified: tuple[Path, str],
) -> None:
    out, _ = identified
    text = (out / "report.html").read_text("utf-8")
    for token in ("SYNTHETIC DATA", "data:image/svg+xml;base64,", "<table"):
        assert token in text
    names = sorted(path.name for path in (out / "figures").glob("*.svg"))
    assert names == ["1_profiles.svg", "2_together.svg", "3_outputs.svg"]
    json.loads((out / "identify.json").read_text())


def test_a_result_of_other_parameters_is_refused(
    identified: tuple[Path, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = tmp_path / "none.json"
    words = ["identify", str(DATA / "string_q1" / "campaign.toml"), "--at", str(missing)]
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    assert f"{missing}: " in capsys.readouterr().err


def test_before_a_measurement_the_expected_data_say_what_it_would_determine(
    tmp_path: Path,
) -> None:
    """Expected data fit exactly; the width's interval is centred on the reference.

    Two drive pairs of five: the width is the sweep's, the coupling nobody's.
    """
    one_form = "reflection = [false]"
    path = string_part(tmp_path / "string", pairs=(1, 3), outputs=OUTPUTS, reflection=one_form)
    words = ["identify", str(path), "--expected", "--no-report", "--workers", "2"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    found = read_json(tmp_path / "out" / "identify.json", Identification)
    knowledge = found.knowledge
    assert not knowledge.data
    assert knowledge.chi_square < 1e-6
    assert knowledge.inflation == 1.0
    width = found.derived["width_plus"]
    assert width.status == "determined"
    assert width.likely == pytest.approx(94.18, abs=0.05)  # start: theta 0, d1 of the sweep
    low, high = width.ci95
    assert 0.5 * (low + high) == pytest.approx(width.likely, rel=2e-3)
    # at theta = 0 the coupling is 0 and has no slope: its range is what is left, not a zero
    coupling = found.derived["lambda"]
    assert coupling.status == "unconstrained"
    highest = math.sqrt(0.5 * (7027600.0**2 - 6940260.0**2))  # sin(2 theta) = -1
    assert coupling.ci95[1] == pytest.approx(highest, rel=1e-3)


# --- bootstrap ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def line() -> tuple[Optimum, Determined]:
    objective = single_line.line_objective(sigma=SIGMA, span=SPAN)
    sigma = objective.data.sigma
    likelihood = likelihood_of(objective, RowNoise(sigma, np.zeros((sigma.size, 0))), ("Q",))
    optimum = most_likely(LikelihoodEvaluator(likelihood), [np.zeros(3)])
    return optimum, determine(
        objective, optimum.expansion.x, RowNoise(sigma, np.zeros((sigma.size, 0)))
    )


def test_the_bootstrap_scatters_as_fisher_says(line: tuple[Optimum, Determined]) -> None:
    """Against the inverse of the information summed over these very points, in closed form."""
    optimum, knowledge = line
    found = bootstrap(optimum, knowledge.profiled, 400, 7)
    assert found.failed == 0
    response = optimum.likelihood.objective.response
    x = 2.0 * (response.tones_hz - 1000.0) / 8.0  # type: ignore[attr-defined]
    wave = 1.0 + x**2
    columns = [
        2.0 * (2.0 / 8.0) * x * wave**-1.5,
        2.0 / 8.0 * x**2 * wave**-1.5,
        wave**-0.5,
    ]
    information = np.array([[float(np.sum(a * b)) for a in columns] for b in columns]) / SIGMA**2
    bounds = np.sqrt(np.diag(np.linalg.inv(information)))
    for name, bound in zip(("eta", "w", "A"), bounds, strict=True):
        # 400 draws know a standard deviation to 3.5 %
        assert found.values[name].std == pytest.approx(bound, rel=0.12)
        low, high = found.values[name].ci95
        assert high - low == pytest.approx(2 * 1.96 * bound, rel=0.2)
    assert found.values["Q"].value == pytest.approx(125.0, rel=2e-3)


def test_nothing_is_resampled_that_the_data_do_not_determine(
    line: tuple[Optimum, Determined],
) -> None:
    objective = single_line.line_objective(sigma=50.0, span=SPAN)
    sigma = objective.data.sigma
    noise = RowNoise(sigma, np.zeros((sigma.size, 0)))
    found = determine(objective, np.zeros(3), noise, InferenceOptions(bootstrap=10))
    assert found.parameters["w"].status == "unconstrained"
    assert found.knowledge.bootstrap is not None
    assert "w" not in found.knowledge.bootstrap.values
    assert math.isfinite(found.parameters["w"].ci95[0])


@pytest.mark.parametrize("text", ["depth", "=0", "depth="])
def test_a_part_is_named_by_a_setting(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = DATA / "string_q1" / "campaign.toml"
    assert main(["identify", str(path), "--beside", text, "--out", str(tmp_path)]) == 2
    assert f"--beside {text}: wanted NAME=VALUE" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
