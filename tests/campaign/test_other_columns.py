"""Columns that a reading does not use are named once; standard errors weigh the points of a sweep.

Truth: a line of width 50 Hz at 10 kHz, whose points have the standard errors of their column.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.campaign.instruments import read_recording, read_trace
from fitting.campaign.instruments.recording import Selection
from fitting.measurements.noise import NoiseSpectrumTable
from fitting.measurements.traces import DemodulatedTable, TraceTable
from fitting.text.errors import BadInput
from fitting.text.finding import Kind, of_kind
from fitting.text.schema import read_record

F_HZ = np.linspace(9900.0, 10100.0, 61)


def curve(f0: float, d: float, a: float) -> np.ndarray:
    """Amplitudes of an oscillator under a force of one size, one at the line for a = 1."""
    return a * f0 * d / np.abs(f0**2 - F_HZ**2 + 1j * F_HZ * d)


LINE = curve(10000.0, 50.0, 1.0)
HEAD = "Frequency (kHz),Amplitude (nm),Noise (nm),T (K),held (V),remark"
CAMPAIGN = """title = "errors"
[fmu]
model = "CoupledModes1"
start = {{ A2 = 0.0, periodic_start = true }}
[observe]
output = "readout"
steady_start = true
[drive]
kind = "tones"
frequencies = ["u1"]
amplitudes = ["A1"]
[sweep]
file = "sweep.csv"
amplitude = "{amplitude}"
use = "fit"
scale = "fit"
{columns}
[[parameters]]
name = "f1"
unit = "Hz"
lower = 9900.0
upper = 10100.0
start = 10000.0
[[parameters]]
name = "d1"
unit = "Hz"
lower = 5.0
upper = 500.0
start = 50.0
"""


def measured(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes, nm, and their standard errors: a percent, of every third point ten times that."""
    sigma = 0.01 * LINE * np.where(np.arange(F_HZ.size) % 3 == 0, 10.0, 1.0)
    return LINE + sigma * np.random.default_rng(seed).standard_normal(F_HZ.size), sigma


def write(path: Path, head: str = HEAD) -> Path:
    amplitude, sigma = measured()
    rows = [
        f"{f / 1e3:.6f},{a:.9g},{s:.9g},{300.0 + k % 5},1.5,point {k}"
        for k, (f, a, s) in enumerate(zip(F_HZ, amplitude, sigma, strict=True))
    ]
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def campaign(folder: Path, columns: str = "", amplitude: str = "nm peak") -> Path:
    write(folder / "sweep.csv")
    path = folder / "campaign.toml"
    path.write_text(CAMPAIGN.format(columns=columns, amplitude=amplitude))
    return path


def test_columns_that_vary_are_named_once(tmp_path: Path) -> None:
    recording = read_recording(write(tmp_path / "a.csv"))
    [other] = recording.unused(*recording.channels[:2], None)
    assert other.kind is Kind.other_columns
    assert other.names["columns"] == ("'Noise'", "'T'")  # held is one number, remark is no number
    assert other.names["errors"] == ("Noise",)
    assert recording.unused(*recording.channels[:4]) == ()


@pytest.mark.parametrize(
    "name",
    ["Noise (nm)", "Sigma", "std", "stderr", "std. dev.", "Standard error", "R error", "\u00b1"],
)
def test_names_of_standard_errors(tmp_path: Path, name: str) -> None:
    recording = read_recording(write(tmp_path / "a.csv", HEAD.replace("Noise (nm)", name)))
    [other] = recording.unused(*recording.channels[:2])
    assert other.names["errors"] == (name.removesuffix(" (nm)"),)


@pytest.mark.parametrize("name", ["stage", "serial", "terror", "side", "understood"])
def test_names_of_other_things(tmp_path: Path, name: str) -> None:
    recording = read_recording(write(tmp_path / "a.csv", HEAD.replace("Noise (nm)", name)))
    [other] = recording.unused(*recording.channels[:2])
    assert other.names["errors"] == ()


def test_line_lists_them(tmp_path: Path) -> None:
    line = ff.line(write(tmp_path / "a.csv"))
    assert sum("'Noise'" in text and "'T'" in text for text in line.remarks) == 1


def test_a_campaign_lists_them(tmp_path: Path) -> None:
    sweep = ff.read_campaign(campaign(tmp_path)).sweep
    assert sweep is not None
    [other] = of_kind(sweep.left_out, Kind.other_columns)
    assert other.names["columns"] == ("'Noise'", "'T'")
    assert sweep.sigma_v is None


def test_standard_errors_in_their_own_unit(tmp_path: Path) -> None:
    path = campaign(tmp_path, 'columns = { sigma = "Noise (nm)" }')
    path.write_text(path.read_text().replace("nm peak", "m rms"))
    sweep = ff.read_campaign(path).sweep
    assert sweep is not None
    assert sweep.sigma_v is not None
    np.testing.assert_allclose(sweep.sigma_v, np.sqrt(2.0) * 1e-9 * measured()[1], rtol=1e-8)
    [other] = of_kind(sweep.left_out, Kind.other_columns)
    assert other.names["columns"] == ("'T'",)


def test_standard_errors_of_levels(tmp_path: Path) -> None:
    """0.1 dB is a share of 0.1 ln(10)/20 of an amplitude."""
    rows = "".join(
        f"{f:.3f},{20.0 * np.log10(a):.9f},0.1\n" for f, a in zip(F_HZ, LINE, strict=True)
    )
    (tmp_path / "sweep.csv").write_text(f"frequency (Hz),level (dB),s (dB)\n{rows}")
    text = CAMPAIGN.format(columns='columns = { sigma = "s" }', amplitude="dB")
    (tmp_path / "campaign.toml").write_text(text)
    sweep = ff.read_campaign(tmp_path / "campaign.toml").sweep
    assert sweep is not None
    assert sweep.sigma_v is not None
    np.testing.assert_allclose(sweep.sigma_v / LINE, 0.1 * np.log(10.0) / 20.0, rtol=1e-7)


@pytest.mark.parametrize(
    ("columns", "wanted"),
    [
        ('columns = { sigma = "noise2" }', "no column 'noise2'"),
        ('columns = { sigma = "T" }', "sigma"),
        ('columns = { sigma = "remark" }', "row 2, column 'remark'"),
    ],
)
def test_what_is_no_standard_error(tmp_path: Path, columns: str, wanted: str) -> None:
    with pytest.raises(BadInput, match=re.escape(wanted)):
        ff.read_campaign(campaign(tmp_path, columns))


def test_zero_is_refused(tmp_path: Path) -> None:
    path = campaign(tmp_path, 'columns = { sigma = "Noise" }')
    file = tmp_path / "sweep.csv"
    lines = file.read_text().splitlines()
    cells = lines[4].split(",")
    lines[4] = ",".join([*cells[:2], "0.0", *cells[3:]])
    file.write_text("\n".join(lines))
    with pytest.raises(BadInput, match=r"standard errors: row 5: found 0 nm"):
        ff.read_campaign(path)


def test_a_named_column_is_selected(tmp_path: Path) -> None:
    raw = read_trace(write(tmp_path / "a.csv"), None, Selection(sigma="Noise"))
    assert raw.sigma is not None
    np.testing.assert_allclose(raw.sigma, measured()[1], rtol=1e-8)
    assert raw.sigma_unit == "nm"


def test_points_are_weighed_by_them(tmp_path: Path) -> None:
    """The error is that of weighted least squares, and the noise counts as known.

    Truth: J^T W J with the slopes of the closed form; the width and place of the line are within
    three standard errors of the truth.
    """
    problem = ff.Problem.of(campaign(tmp_path, 'columns = { sigma = "Noise" }'))
    params = ff.fit(problem, starts=1).params
    sigma = measured()[1]

    steps = (0.01, 0.01, 1e-4)
    x = np.array([10000.0, 50.0, 1.0])
    slopes = np.array(
        [
            (curve(*(x + h * e)) - curve(*(x - h * e))) / (2.0 * h)
            for h, e in zip(steps, np.eye(3), strict=True)
        ]
    ).T
    covariance = np.linalg.inv((slopes.T / sigma**2) @ slopes)
    for name, truth, std in zip(("f1", "d1"), x, np.sqrt(np.diag(covariance)), strict=False):
        assert abs(params[name].value - truth) < 3.0 * std
        assert params[name].std == pytest.approx(std, rel=0.05)


def test_records_and_noise_list_them(tmp_path: Path) -> None:
    """A recording over time, a demodulated one and a noise spectrum; constants are not listed."""
    t = np.arange(400) * 1e-5
    x = np.exp(-50.0 * t) * np.sin(2e4 * t)
    rows = zip(t, x, np.cos(2e4 * t), np.gradient(x), np.full(t.size, 1.5), strict=True)
    text = "\n".join(",".join(f"{v:.9g}" for v in row) for row in rows)
    (tmp_path / "t.csv").write_text(f"time (s),readout (V),X (V),Y (V),gain (1)\n{text}\n")
    f = np.linspace(9e3, 1.1e4, 60)
    noise = "\n".join(f"{each:.6g},{1.0 + k % 3},{k % 7}" for k, each in enumerate(f))
    (tmp_path / "n.csv").write_text(f"frequency (Hz),density (V2/Hz),drift (K)\n{noise}\n")
    where = tmp_path / "campaign.toml"
    trace = read_record(TraceTable, {"file": "t.csv"}, where, "trace").read_columns("readout")[-1]
    table = {"file": "t.csv", "frequency": "10 kHz", "input": "F"}
    demodulated = read_record(DemodulatedTable, table, where, "demodulated_trace").record("")
    spectrum = read_record(NoiseSpectrumTable, {"file": "n.csv"}, where, "noise_spectrum").record(
        ""
    )
    listed = [
        [name for finding in findings for name in finding.names["columns"]]
        for findings in (trace, demodulated.left_out, spectrum.left_out)
    ]
    assert listed == [["'X'", "'Y'"], ["'readout'"], ["'drift'"]]
