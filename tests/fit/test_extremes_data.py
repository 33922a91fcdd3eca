"""The whole chain at the edges of the data: noise, sweeps, spectra, series; what the command says.

As in `tests/fit/test_extremes.py` each case is right or says in a sentence that it is not.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fitting.campaign import read_campaign
from fitting.cli.main import main
from fitting.fmu.pool import FmuWorkers
from fitting.result.result import Result, read_result
from fitting.signal.misfit import CORRELATED
from fitting.text.errors import BadInput
from fitting.text.rendering import sentence
from tests.support.extreme_scenes import (
    Fitted,
    Scene,
    bound_of,
    fit,
    fit_bound,
    no_false_success,
    write,
)
from tests.support.reference import phasors
from tests.support.samples import cases
from tests.support.scenes import STRING

Fit = Callable[[Scene], Result]

#: In a sweep of ten points no faults are looked for: of two lines without noise that takes longer
#: than the fit.
WHOLE = Scene(scale="fit", points=10)
PAIRS = Scene().tones


@pytest.fixture(scope="module")
def workers(swift_fmu: Path) -> Iterator[FmuWorkers]:
    with FmuWorkers(swift_fmu, workers=1) as started:
        yield started


@pytest.fixture
def fitted(workers: FmuWorkers, tmp_path: Path) -> Fit:
    def run(scene: Scene) -> Result:
        result = fit(scene, workers, tmp_path)
        no_false_success(result, scene)
        return result

    return run


def said(result: Result, *words: str) -> bool:
    """Whether one of the findings is of a kind, and has all of these words."""
    kind, *rest = words
    return any(
        each.kind == kind and all(word in sentence(each) for word in rest)
        for each in result.findings
    )


def nightly(*values: object) -> Any:
    """A case of which the others of its test are a sample."""
    return pytest.param(*values, marks=pytest.mark.nightly)


@pytest.mark.parametrize(
    ("ratio", "seed"),
    [
        *((1e6, 1), (100.0, 2)),
        *(nightly(*each) for each in ((1e6, 2), (1e4, 1), (1e4, 2), (100.0, 1))),
    ],
)
def test_errors_claimed_follow_the_noise(ratio: float, seed: int, fitted: Fit) -> None:
    """Width and its error from spectra: the error is of the order of the noise, and holds."""
    scene = Scene(noise=1.0 / ratio, seed=seed, peaks=False)
    width = fitted(scene).derived["width_plus"]
    assert width.status == "linearised only"
    assert 0.3 / ratio < width.std / scene.width < 10.0 / ratio + 3e-6


@pytest.mark.parametrize(
    ("ratio", "seed"),
    [
        (3.0, 1),
        *(nightly(*each) for each in ((10.0, 1), (10.0, 2), (3.0, 2), (1.0, 1), (1.0, 2))),
    ],
)
def test_noise_of_the_order_of_the_peaks_determines_nothing(
    ratio: float, seed: int, fitted: Fit
) -> None:
    scene = Scene(noise=1.0 / ratio, seed=seed, points=15)
    result = fitted(scene)
    width = result.derived["width_plus"]
    assert width.status != "linearised only" or width.std > 0.03 * scene.width
    if ratio <= 3.0:
        assert said(result, "weak_peaks", "e0")


@pytest.mark.parametrize("ratio", [5.0, 1.0])
def test_a_peak_below_the_detection_limit_is_refused(ratio: float, fitted: Fit) -> None:
    with pytest.raises(BadInput, match=r"e0\.csv: .*tone"):
        fitted(Scene(noise=1.0 / ratio, peaks=False))


def test_data_without_any_noise(fitted: Fit) -> None:
    for scene in (Scene(peaks=False), replace(WHOLE, use="fit")):
        result = fitted(scene)
        assert result.derived["width_plus"].value == pytest.approx(scene.width, rel=1e-8)


def test_one_experiment(fitted: Fit) -> None:
    for scene in (Scene(tones=PAIRS[:1]), Scene(tones=PAIRS[:1], drift=1.0)):
        result = fitted(scene)
        assert result.derived["width_plus"].value == pytest.approx(scene.width, rel=1e-8)
        assert result.derived["width_plus"].spread == 0.0


def test_sixty_experiments(fitted: Fit) -> None:
    """Enough rows for sparse bands of the slacks; a thousand are in the benchmark."""
    tones = tuple((-0.5 - 0.01 * k, 0.4 + 0.02 * k) for k in range(60))
    scene = Scene(tones=tones, drift=20.0, noise=1e-3)
    result = fitted(scene)
    assert result.derived["width_plus"].status == "linearised only"
    assert len(result.derived["width_plus"].values) == 60


@pytest.mark.parametrize("sweep", [nightly((2.0, 8.0)), (-8.0, -2.0), nightly((20.0, 30.0))])
def test_a_sweep_that_misses_the_peak(sweep: tuple[float, float], fitted: Fit) -> None:
    """Algorithm 1 has no maximum there and says so; a scale by least squares needs none."""
    result = fitted(Scene(sweep=sweep))
    assert result.status == "not converged"
    assert said(result, "scale_at_edge")
    scene = replace(WHOLE, sweep=sweep)
    assert fitted(scene).derived["width_plus"].value == pytest.approx(scene.width, rel=1e-7)


@pytest.mark.parametrize("sweep", [nightly((0.0, 6.0)), (-6.0, 0.0), nightly((0.3, 6.0))])
def test_a_sweep_that_holds_half_of_the_peak(sweep: tuple[float, float], fitted: Fit) -> None:
    result = fitted(Scene(sweep=sweep))
    assert said(result, "scale_at_edge")
    scene = replace(WHOLE, sweep=sweep)
    assert fitted(scene).derived["width_plus"].value == pytest.approx(scene.width, rel=1e-8)


def test_a_sweep_that_holds_two_peaks(fitted: Fit) -> None:
    scene = Scene(eta_minus=6.9404e6, sweep=(-4.0, 8.0))
    result = fitted(scene)
    assert result.line is not None
    assert result.line.forms[0].structure.p_value < CORRELATED  # 6e-9 of 41 points, 1e-23 of 61
    assert said(result, "line_residuals")
    scene = replace(scene, scale="fit")
    assert fitted(scene).derived["width_plus"].value == pytest.approx(scene.width, rel=1e-8)


@pytest.mark.parametrize(
    ("sweep", "points"),
    [((-2.9, 3.1), 9), nightly((-50.3, 50.1), 8), nightly((-500.3, 500.1), 41)],
)
def test_a_sweep_coarser_than_the_line(
    sweep: tuple[float, float], points: int, fitted: Fit
) -> None:
    """The largest point is not the top: said, and counted in the error of the width."""
    scene = Scene(sweep=sweep, points=points)
    result = fitted(scene)
    assert said(result, "scale_biased")
    assert result.scale.maximum_bias < 0.0
    scene = replace(scene, scale="fit")
    assert fitted(scene).derived["width_plus"].value == pytest.approx(scene.width, rel=1e-7)


def flattened(path: Path) -> None:
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *(f"{row.split(',')[0]},1.0" for row in rows)]) + "\n")


@pytest.mark.parametrize(
    "scene",
    [Scene(), replace(WHOLE, use="fit"), nightly(WHOLE)],
    ids=["maximum", "sweep", "scale"],
)
def test_a_sweep_of_one_amplitude(scene: Scene, workers: FmuWorkers, tmp_path: Path) -> None:
    """No resonance at all: no line is found, and least squares finds no fit."""
    write(scene, workers.description.path, tmp_path)
    flattened(tmp_path / "sweep.csv")
    result = fit_bound(tmp_path / "campaign.toml", workers)
    assert result.line is not None
    assert math.isnan(result.line.width.value)
    if scene.scale == "fit":
        assert result.status == "not converged"
    else:
        assert said(result, "scale_at_edge")


def test_amplitudes_that_differ_ten_thousandfold(fitted: Fit) -> None:
    scene = Scene(tones=((0.0, 1000.0), (0.2, -3000.0), (0.5, 1e4)))
    assert fitted(scene).derived["width_plus"].value == pytest.approx(scene.width, rel=1e-8)
    # deviations count alike in Algorithm 2, however noisy their peaks; not in what is reported
    noisy = fitted(replace(scene, noise=1e-6))
    width = noisy.derived["width_plus"]
    assert abs(width.value - scene.width) < 3.0 * width.std < 0.01 * scene.width
    assert abs(width.algorithm2 - scene.width) > 2.0 * width.std
    assert not said(noisy, "Outliers")


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (Scene(points=7), r"sweep\.csv: 7 .*\b8\b"),
        (Scene(tones=((0.1, 0.1),)), r"experiments\.csv: row 2\b"),
        (Scene(tones=((-0.5,),)), r"u1.*u2.*A2 = 1"),
        (Scene(sweep=(-1e-9, 1e-9)), r"sweep\.csv: .*twice"),
    ],
    ids=["7 points", "equal tones", "a tone that is not named", "a sweep of one frequency"],
)
def test_what_is_refused(scene: Scene, words: str, fitted: Fit) -> None:
    with pytest.raises(BadInput, match=words):
        fitted(scene)


@pytest.mark.parametrize(
    ("rows", "words"),
    [(1, r"e0\.csv: 1 .*\b3\b"), (5, r"e0\.csv: .*tone")],
)
def test_a_spectrum_of_few_points_is_refused(
    rows: int, words: str, workers: FmuWorkers, tmp_path: Path
) -> None:
    path = write(Scene(noise=1e-3, peaks=False), workers.description.path, tmp_path)
    lines = (tmp_path / "e0.csv").read_text().splitlines()
    (tmp_path / "e0.csv").write_text("\n".join(lines[: 1 + rows]) + "\n")
    with pytest.raises(BadInput, match=words):
        read_campaign(path)


def test_a_mode_that_is_not_driven_is_told(workers: FmuWorkers, tmp_path: Path) -> None:
    """theta = 0 and no gain: the observed mode rests, and gives no scale."""
    path = write(Scene(theta=0.0), workers.description.path, tmp_path)
    path.write_text(path.read_text().replace("[fmu.start]", "[fmu.start]\ng1 = 0.0", 1))
    with pytest.raises(BadInput, match="drive"):
        fit_bound(path, workers)


def test_a_campaign_keeps_every_digit_of_its_tones(workers: FmuWorkers, tmp_path: Path) -> None:
    scene = Scene(eta_plus=9_999_999_999.0, d1=1e-3, d2=2e-3, eta_minus=1.5e10)
    bound = bound_of(replace(scene, unit="GHz"), workers, tmp_path)
    assert bound.experiments[0].tones_hz == tuple(scene.at(PAIRS[0]))
    assert bound.sweep is not None
    assert np.all(np.diff(bound.sweep.frequency_hz) > 0.0)


FAR = {
    "eta_plus": Fitted(4.94e6, 8.94e6, 7.04e6, 100.0),
    "d1": Fitted(10.0, 1000.0, 150.0, 100.0),
}
COMMANDS = {
    "tiny, no lambda": (
        Scene(crest=1e-300, noise=1e-3, peaks=False, theta=math.pi / 4.0),
        0,
        False,
    ),
    "tiny, with a report": nightly(
        Scene(crest=1e-300, noise=1e-3, peaks=False, theta=math.pi / 4.0), 0, True
    ),
    "far": (replace(WHOLE, tones=(), use="fit", fitted=FAR), 1, False),
    "1 Hz": (replace(WHOLE, eta_plus=1.0, eta_minus=1.5, d1=0.2, d2=0.24), 0, False),
    "huge": nightly(Scene(crest=1e290, noise=1e-3), 0, False),
    "noise": nightly(Scene(noise=1.0, points=15), 0, False),
    "10 GHz": nightly(Scene(eta_plus=1e10, eta_minus=1.5e10, d1=100.0, d2=120.0), 0, False),
}
A_LONE_NAN = re.compile(r"(?<![\w.])[-+−]?(nan|inf)(?![\w.])", re.IGNORECASE)


@pytest.mark.parametrize(("scene", "code", "report"), COMMANDS.values(), ids=COMMANDS.keys())
def test_the_command_prints_no_nan_and_no_warning(
    scene: Scene,
    code: int,
    report: bool,
    swift_fmu: Path,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    path, out = write(scene, swift_fmu, tmp_path / "campaign"), tmp_path / "out"
    words = ["reconstruct", str(path), "--out", str(out), "--workers", "1"]
    assert main(words if report else [*words, "--no-report", "--no-profiles"]) == code
    shown = capfd.readouterr()
    assert shown.err == ""
    own = re.sub(r"The FMU reports.*? it is NaN", "", " ".join(shown.out.split()))  # its words
    texts = [own, (out / "history.csv").read_text()]
    if report:
        unread = r"<svg.*?</svg>|<style.*?</style>|<script.*?</script>|data:[^\"']*"
        page = re.sub(unread, "", _page(out), flags=re.S)
        texts += [re.sub(r"[^<>]*it is NaN[^<>]*", "", page)]
        assert list((out / "figures").glob("*.png"))
    assert [found for text in texts for found in A_LONE_NAN.findall(text)] == []
    result = read_result(out / "result.json")
    assert (result.status == "converged") == (code == 0)
    no_false_success(result, scene)


def _page(out: Path) -> str:
    return (out / "report.html").read_text("utf-8")


def test_the_command_refuses_a_scale_beyond_numbers_in_one_line(
    swift_fmu: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write(Scene(crest=1e305), swift_fmu, tmp_path / "campaign")
    assert main(["reconstruct", str(path), "--out", str(tmp_path / "out"), "--workers", "1"]) == 2
    shown = capfd.readouterr()
    assert shown.out == ""
    assert len(shown.err.splitlines()) == 1
    assert "ratio" in shown.err
    assert not (tmp_path / "out" / "result.json").exists()


DRIVEN: dict[str, dict[str, float | bool]] = {
    "1 mHz apart": {"u2": 6940160.001, "periodic_start": True},
    "tiny": {"A1": 1e-290, "A2": 1e-290, "periodic_start": True},
    "huge": {"A1": 1e300, "A2": 1e300, "periodic_start": True},
    "Q = 1e8 from rest": {"d1": 0.07, "d2": 0.07},
    "10 GHz": {
        "eta_plus": 1e10,
        "eta_minus": 1.01e10,
        "u1": 10000000010.0,
        "u2": 9999999990.0,
        "periodic_start": True,
    },
    "1 Hz, Q = 5": {
        "eta_plus": 1.0,
        "eta_minus": 1.5,
        "u1": 1.0,
        "u2": 1.1,
        "d1": 0.2,
        "d2": 0.2,
    },
}


@pytest.mark.parametrize(
    "name", cases(DRIVEN, "1 mHz apart", "huge", "Q = 1e8 from rest", "10 GHz")
)
def test_simulate_reads_the_peaks_of_extreme_drives(
    name: str,
    swift_fmu: Path,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Against the phasors at 90 digits. At 10 GHz times up to 0.25 s round to 3e-7 of a period."""
    changes = DRIVEN[name]
    sets = [word for of, value in changes.items() for word in ("--set", f"{of}={value!r}")]
    assert main(["simulate", str(swift_fmu), "--out", str(tmp_path), *sets]) == 0
    shown = capfd.readouterr()
    assert shown.err == ""
    assert not A_LONE_NAN.search(shown.out)
    usual = {"eta_plus": 6.94026e6, "eta_minus": 7.0276e6}  # of the FMU
    p = SimpleNamespace(**{**STRING.parameters, **usual, **changes})
    head, *rows = (tmp_path / "peaks.csv").read_text().splitlines()
    assert head.split(",")[1].startswith("q1_hybrid")
    for row, (u, size) in zip(rows, ((p.u1, p.A1), (p.u2, p.A2)), strict=True):
        tone, peak = map(float, row.split(",")[:2])
        assert tone == u
        assert peak == pytest.approx(size * float(abs(phasors(p, u)[0])), rel=1e-6, abs=0.0)
