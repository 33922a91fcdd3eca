"""Where a design sets out from: the truth of a closed form, from references that lie far off it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.design.api import NextMeasurements, screen_lines
from fitting.design.limits import Limits
from fitting.text.arrays import ComplexArray, FloatArray
from tests.support import crossing_spectra

TRUTH = {"a0": 1001.0, "a1": 4.0, "f2": 1000.0, "lambda12": 100.0, "d1": 3.0, "d2": 3.0}
VOLTS, U = (-3.0, -1.5, 0.0, 1.5, 3.0), np.linspace(980.0, 1020.0, 41)
SIGMA = 0.01
LIMITS = """
[design]
target = "lambda12"
number = 2
noise_floor = "0.01 V"
sweeps = { controls = { V = [-1.0, 0.0, 1.0] } }
"""


@pytest.fixture(scope="module")
def fmu(swift_modes_fmu: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(swift_modes_fmu, workers=1) as made:
        yield made


def written(
    folder: Path,
    *,
    background: str,
    sigma: str,
    f2_start: float,
    volts: Sequence[float] = VOLTS,
) -> Path:
    """Sweeps whose largest is about 1 V over a slope five times as high, and their campaign."""
    rng = np.random.default_rng(3)
    x = (U - 1000.0) / 20.0
    lines = ["V (V),frequency (Hz),X (V),Y (V)"]
    for volt in volts:
        line = crossing_spectra.phasor(U, volt)
        s = line / np.max(np.abs(line)) + 5.0 * ((0.3 + 0.5j) + (1.0 - 0.4j) * x)
        s = s + SIGMA * (rng.standard_normal(U.size) + 1j * rng.standard_normal(U.size))
        lines += [
            f"{volt},{float(u)!r},{v.real!r},{v.imag!r}"
            for u, v in zip(U, map(complex, s), strict=True)
        ]
    made = ff.synthesize_curves("crossing", phases=True, delay_s=0.0)
    text = str(made.files["campaign.toml"])
    text = text.replace('delay = "fit"', f'background = "{background}"\n{sigma}')
    text = text.replace("start = 999.0", f"start = {f2_start}")
    folder.mkdir(exist_ok=True)
    (folder / "map.csv").write_text("\n".join(lines) + "\n")
    (folder / "design.toml").write_text(LIMITS)
    (folder / "campaign.toml").write_text(text)
    return folder / "campaign.toml"


def designed(fmu: ff.Fmu, path: Path) -> NextMeasurements:
    return ff.design(ff.Problem.of(path, fmu), limits=path.parent / "design.toml")


@pytest.mark.parametrize(
    ("sigma", "start"),
    [("", 990.0), pytest.param('sigma = "10 mV"', 985.0, marks=pytest.mark.nightly)],
)
def test_the_lowest_fit_is_found_over_a_strong_slope(
    fmu: ff.Fmu, tmp_path: Path, sigma: str, start: float
) -> None:
    """From a second mode three widths and more off: the truth within its errors, and these."""
    path = written(tmp_path / "x", background="slope", sigma=sigma, f2_start=start)
    found = designed(fmu, path).design
    here = found.places[0].parameters
    assert here["lambda12"] == pytest.approx(TRUTH["lambda12"], abs=4.0 * found.before.at)
    assert found.before.at == pytest.approx(error_at_the_truth(), rel=0.15)
    for name in ("a0", "f2"):
        assert here[name] == pytest.approx(TRUTH[name], abs=0.2)
    assert not any("--at" in sentence for sentence in found.sentences)


def error_at_the_truth() -> float:
    """Of lambda by the Fisher information of all quadratures, gains and backgrounds solved."""
    truth, steps = np.array(list(TRUTH.values())), np.array([1e-3, 1e-3, 1e-3, 1e-2, 1e-3, 1e-3])
    x = (U - 1000.0) / 20.0
    total = np.zeros((6, 6))
    for volt in VOLTS:
        here = phasor(truth, volt)
        size = np.max(np.abs(here))
        by_p = [(phasor(truth + h, volt) - phasor(truth - h, volt)) for h in np.diag(steps)]
        columns = [d / (2.0 * step) / size for d, step in zip(by_p, steps, strict=True)]
        inside = [turn * c for c in (here / size, np.ones(U.size), x) for turn in (1.0, 1j)]
        j, own = (
            np.array([np.concatenate([c.real, c.imag]) for c in m]).T for m in (columns, inside)
        )
        left = j - own @ np.linalg.lstsq(own, j, rcond=None)[0]
        total += left.T @ left / SIGMA**2
    return float(np.sqrt(np.linalg.inv(total)[3, 3]))


def phasor(p: FloatArray, volt: float) -> ComplexArray:
    """q1 of two modes: 1/(c1 - lambda^4/c2), c = f^2 - u^2 + i u d, over (2 pi)^2."""
    a0, a1, f2, coupling, d1, d2 = p
    first = (a0 + a1 * volt) ** 2 - U**2 + 1j * U * d1
    second = f2**2 - U**2 + 1j * U * d2
    return np.asarray(1.0 / (first - coupling**4 / second) / (2.0 * np.pi) ** 2)


def test_the_closed_form_of_the_test_is_that_of_the_matrix() -> None:
    exact = crossing_spectra.phasor(U, 0.5)
    assert phasor(np.array(list(TRUTH.values())), 0.5) == pytest.approx(exact, rel=1e-9)


def test_a_model_that_describes_nothing_is_said_to(fmu: ff.Fmu, tmp_path: Path) -> None:
    """The slope is there and not declared: hundreds of times the noise are left."""
    path = written(
        tmp_path / "x",
        background="none",
        sigma='sigma = "10 mV"',
        f2_start=999.0,
        volts=(-3.0, 0.0, 3.0),
    )
    made = designed(fmu, path)
    assert isinstance(made.limits, Limits)
    said = " ".join(screen_lines(made.design, verbose=True)).replace("\u00a0", " ")
    assert " times the " in said
    assert "--at " in said
