"""A campaign of noise from a file of densities: it runs unedited and finds what made the data."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from fitting.draft.api import init
from fitting.draft.document import Answers
from fitting.draft.sweeps import sweep_of
from fitting.resonance.reading import Columns
from fitting.result.result import read_result
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.estimate import FittedEstimate
from tests.support.lines import mode, noise, write_csv

pytestmark = pytest.mark.usefixtures("swift_models")

ETA, WIDTH = 30_000.0, 25.0
F_ONE = ETA + np.linspace(-150.0, 150.0, 241)
F_TWO = ETA + np.linspace(-200.0, 500.0, 301)
COUPLING = 1300.0


def averaged(density: FloatArray, averages: int, seed: int) -> FloatArray:
    """An average of periodograms of a density: so many exponential ones."""
    scatter = np.random.default_rng(seed).gamma(averages, 1.0 / averages, density.size)
    return np.asarray(density * scatter)


def two_lines(f: FloatArray) -> FloatArray:
    """Two modes with forces of their own: their densities add up; 100 periodograms."""
    upper = 0.5 * np.abs(mode(f, ETA + 300.0, 1.5 * WIDTH)) ** 2
    density = np.abs(mode(f, ETA, WIDTH)) ** 2 + upper + 0.02
    return averaged(1e-12 * density, 100, 8)


def two_coupled() -> FloatArray:
    """What heat does to the first of two coupled coordinates, by inverting their matrix."""
    density = []
    for u in F_TWO:
        own = [e**2 - u**2 + 1j * u * w for e, w in ((ETA, WIDTH), (ETA + 100.0, 2.0 * WIDTH))]
        matrix = np.array([[own[0], COUPLING**2], [COUPLING**2, own[1]]])
        density.append(-np.linalg.inv(matrix)[0, 0].imag / u)
    return averaged(1e-12 * (np.array(density) / np.max(density) + 0.01), 300, 9)


def fitted(folder: Path, file: Path) -> tuple[dict[str, FittedEstimate], dict[str, Any]]:
    """What `reconstruct` finds with the campaign that `init` wrote, and its table of noise."""
    out, results = folder / "drafted", folder / "results"
    assert main(["init", str(file), "--out", str(out), "--yes"]) == 0
    campaign = out / "campaign.toml"
    quick = ["--quick", "--no-report", "--no-profiles", "--workers", "1"]
    assert main(["reconstruct", str(campaign), "--out", str(results), *quick]) == 0
    written = tomllib.loads(campaign.read_text("utf-8"))
    assert "sweep" not in written
    [table] = written["noise_spectrum"]
    return dict(read_result(results / "result.json").parameters), table


def test_a_density_of_one_line_becomes_a_noise_spectrum_that_finds_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    density = averaged(1e-24 * (np.abs(mode(F_ONE, ETA, WIDTH)) ** 2 + 0.01), 100, 5)
    file = write_csv(tmp_path / "psd.csv", "Frequency (Hz),PSD (m^2/Hz)", F_ONE, density)
    found, table = fitted(tmp_path, file)
    # errors by the Cramer-Rao bound of these points, by differences of the closed form
    for name, value, least in (("f1", ETA, 0.184), ("d1", WIDTH, 0.466)):
        each = found[name]
        assert abs(each.value - value) < 4.0 * each.std, name
        assert each.std == pytest.approx(least, rel=0.3), name
    assert table["columns"] == {"frequency": "Frequency", "density": "PSD"}
    told = " ".join(capsys.readouterr().out.split())
    assert "'PSD' (m^2/Hz)" in told
    assert " next " in told  # it is promised to describe them
    assert "sweep" not in told.partition("written:")[0].lower()


def test_a_density_of_two_lines_becomes_a_noise_spectrum_that_finds_both(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_csv(tmp_path / "psd.csv", "Frequency (Hz),PSD (V^2/Hz)", F_TWO, two_lines(F_TWO))
    found, table = fitted(tmp_path, file)
    # heat moves a mode by d over its weight: heights go with g2/(f^2 d)
    g2 = 0.5 * 1.5 * ((ETA + 300.0) / ETA) ** 2
    truth = {"f1": ETA, "d1": WIDTH, "f2": ETA + 300.0, "d2": 1.5 * WIDTH, "g2": g2}
    for name, value in truth.items():
        each = found[name]
        assert abs(each.value - value) < 4.0 * each.std < 0.2 * value, name
    assert table["force"] == "thermal"
    told = " ".join(capsys.readouterr().out.split())
    assert "sweep" not in told.partition("written:")[0].lower()


def test_coupled_modes_in_heat_of_which_one_is_seen_find_the_coupling(tmp_path: Path) -> None:
    root = np.sqrt(two_coupled())
    file = write_csv(tmp_path / "asd.csv", "Frequency (Hz),ASD (V/sqrt(Hz))", F_TWO, root)
    found, table = fitted(tmp_path, file)
    truth = {"f1": ETA, "d1": WIDTH, "f2": ETA + 100.0, "d2": 2.0 * WIDTH, "lambda12": COUPLING}
    for name, value in truth.items():
        each = found[name]
        assert abs(each.value - value) < 4.0 * each.std < 0.3 * value, name
    assert table["force"] == "thermal"
    assert table["columns"]["density"] == "ASD"


def nightly(*values: object) -> Any:
    """A case of which the others of its test are a sample."""
    return pytest.param(*values, marks=pytest.mark.nightly)


@pytest.mark.parametrize(
    ("header", "power", "holds", "guessed"),
    [
        nightly("ASD (V/√Hz)", 0.5, "", False),
        nightly("noise (V/sqrt(Hz))", 0.5, "", False),
        nightly("level (dBm/Hz)", 0.0, "", False),
        ("PSD", 1.0, "density", False),
        nightly("amplitude spectral density", 0.5, "root", False),
        nightly("S (V)", 0.5, "root", True),
        ("reading", 1.0, "density", True),
    ],
)
def test_unit_name_or_scatter_tell_a_noise_spectrum(
    tmp_path: Path, header: str, power: float, holds: str, guessed: bool
) -> None:
    """The same densities, their roots, or levels (power 0); a scatter that is a guess is said."""
    f = F_TWO[::2]
    numbers = two_lines(f) ** power if power else 10.0 * np.log10(two_lines(f))
    file = write_csv(tmp_path / "n.csv", f"f (Hz),{header}", f, numbers)
    answers = Answers()
    taken = sweep_of(file, Columns(), answers)
    assert taken.is_noise
    assert taken.density is not None
    assert taken.density.holds == holds
    assert taken.density.is_root is (power == 0.5)
    places = [line.frequency_hz for line in taken.shown]
    assert places == pytest.approx([ETA, ETA + 300.0], abs=2.0)
    assert any(words.startswith("kind: noise") for words in answers.notes) is guessed
    assert not sweep_of(file, Columns(), Answers(requested={"kind": ("sweep",)})).is_noise


def test_a_sweep_with_noise_of_one_size_stays_a_sweep(tmp_path: Path) -> None:
    f = ETA + np.linspace(-80.0, 80.0, 41)
    seen = np.abs(mode(f, ETA, WIDTH) + noise(f.size, 3e-2, 1))
    answers = Answers()
    taken = sweep_of(write_csv(tmp_path / "s.csv", "f (Hz),S", f, seen), Columns(), answers)
    assert not taken.is_noise
    assert not answers.notes


def test_phases_are_no_noise_spectrum(tmp_path: Path) -> None:
    f = ETA + np.linspace(-80.0, 80.0, 41)
    seen = mode(f, ETA, WIDTH) + noise(f.size, 1e-2, 1)
    file = write_csv(tmp_path / "s.csv", "f (Hz),X (V),Y (V)", f, seen.real, seen.imag)
    with pytest.raises(BadInput, match=r"s\.csv"):
        sweep_of(file, Columns(), Answers(requested={"kind": ("noise",)}))


def test_a_line_beside_crosstalk_in_dbm_is_no_noise(tmp_path: Path) -> None:
    """What another curve misses of a smooth one is no scatter; a load of 50 ohm is taken."""
    f = np.linspace(1233600.0, 1234400.0, 161)
    line = 1.0 / (1.0 - 2j * (f - 1234012.0) / 38.0) + 0.3 + 0.2j
    level = 20.0 * np.log10(np.abs(line)) - 30.0
    level += 0.005 * np.random.default_rng(7).standard_normal(f.size)
    path = tmp_path / "level.csv"
    rows = [f"{1e-3 * a:.6f},{b:.4f}" for a, b in zip(f, level, strict=True)]
    path.write_text("\n".join(["Frequency (kHz),Level (dBm)", *rows]) + "\n", "utf-8")
    made, _ = init(path, out=tmp_path / "o")
    written = tomllib.loads(made.read_text("utf-8"))
    assert "noise_spectrum" not in written
    assert written["sweep"]["impedance"] == "50 ohm"


def test_dbm_and_degrees_are_drafted_as_complex_values_and_fit(tmp_path: Path) -> None:
    f = np.linspace(1233600.0, 1234400.0, 161)
    line = 1.0 / (1.0 - 2j * (f - 1234012.0) / 38.0)
    real, imaginary = np.random.default_rng(8).standard_normal((2, f.size))
    seen = line + 1e-3 * (real + 1j * imaginary)
    rows = np.column_stack(
        [1e-3 * f, 20.0 * np.log10(np.abs(seen)) - 30.0, np.degrees(np.angle(seen))]
    )
    path = tmp_path / "lockin.csv"
    head = "Frequency (kHz),Level (dBm),Phase (deg)"
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.6f")
    made, _ = init(path, out=tmp_path / "o")
    fit = ff.fit(ff.Problem.of(made))
    assert abs(fit["f1"].value - 1234012.0) < 4.0 * fit["f1"].std
    assert abs(fit["d1"].value - 38.0) < 4.0 * fit["d1"].std


@pytest.mark.parametrize("averages", [4, 100, pytest.param(1000, marks=pytest.mark.nightly)])
def test_one_line_in_a_column_without_unit_or_name_is_one_line(
    averages: int, tmp_path: Path
) -> None:
    """It was drafted as the root of a density of two coupled modes, without a word on that."""
    f = F_ONE[::2]
    density = averaged(1e-12 * (np.abs(mode(f, ETA, WIDTH)) ** 2 + 0.01), averages, 5)
    file = write_csv(tmp_path / "n.csv", "frequency (Hz),y", f, density)
    path, told = init(file, out=tmp_path / "o", told={"kind": "noise"})
    written = tomllib.loads(path.read_text("utf-8"))
    assert written["fmu"]["model"] == "CoupledModes1"
    assert written["noise_spectrum"][0]["holds"] == "density"
    assert any(each.startswith("Assumed: 'y'") and "--unit-amplitude" in each for each in told)
