"""Spectra of Fourier transforms begin at 0 Hz, which is no response: left out, and said."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.draft.api import init
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from tests.support.in_process import told
from tests.support.lines import mode, write_csv

F0, WIDTH = 800.0, 16.0
F = np.arange(0.0, 1300.0, 2.5)


def density() -> FloatArray:
    """A mode on a floor, 60 periodograms averaged; the first point is what `welch` leaves of it.

    Far from its top, as here, at 0 Hz, a mode of Q = 50 is no Lorentzian line.
    """
    clean = 3e-9 * np.abs(mode(F, F0, WIDTH)) ** 2 + 2e-12
    made = clean * np.random.default_rng(5).gamma(60.0, 1.0 / 60.0, F.size)
    made[0] = 0.0
    return made


@pytest.fixture
def noise(tmp_path: Path) -> Path:
    return write_csv(tmp_path / "welch.csv", "frequency (Hz),PSD (V^2/Hz)", F, density())


def sweep(folder: Path, first: float = 0.0) -> Path:
    f = np.concatenate([[first], np.linspace(700.0, 900.0, 41)])
    z = mode(f, F0, WIDTH)
    return write_csv(folder / "rfft.csv", "f (Hz),X (V),Y (V)", f, z.real, z.imag)


@pytest.mark.parametrize("ends", [[], ["--from", "500", "--to", "1200"], ["--from", "500 Hz"]])
def test_a_noise_spectrum_from_zero_on(noise: Path, ends: list[str]) -> None:
    ended = told("line", noise, *ends, "--json")
    assert ended.code == 0, ended.err
    found = json.loads(ended.out)
    assert abs(found["frequency"]["value"] - F0) < 4.0 * found["frequency"]["std"] < 2.0
    assert found["width"]["value"] == pytest.approx(WIDTH, rel=0.15)


def test_what_is_left_out_is_said(noise: Path, tmp_path: Path) -> None:
    for path in (noise, sweep(tmp_path)):
        ended = told("line", path)
        assert ended.code == 0, ended.err
        assert "row 2" in ended.out


def test_no_warning_of_a_library_is_printed(noise: Path) -> None:
    ended = told("line", noise)  # where every warning is an error
    assert (ended.code, ended.err) == (0, "")


def test_arrays_from_zero_on() -> None:
    found = ff.noise_line(F, density())
    assert found.width.value == pytest.approx(WIDTH, rel=0.15)
    f = np.linspace(0.0, 2.0 * F0, 801)
    line = ff.line(f, mode(f, F0, WIDTH))
    assert line.width.value == pytest.approx(WIDTH, rel=1e-3)


def test_a_frequency_below_zero_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="-5"):
        ff.line(sweep(tmp_path, -5.0))


@pytest.mark.usefixtures("swift_models")
def test_campaigns_leave_it_out_as_well(tmp_path: Path) -> None:
    path, _ = init(sweep(tmp_path), out=tmp_path / "a")
    problem = ff.Problem.of(ff.read_campaign(path))
    starts = np.array([p.start for p in problem.record.parameters])
    assert problem.residuals(starts).size == 2 * 41
    f = np.concatenate([[0.0], np.linspace(700.0, 900.0, 41)])
    r = np.abs(mode(f, F0, WIDTH))
    made = write_csv(tmp_path / "r.csv", "f (Hz),R (V)", f, r)
    path, _ = init(made, out=tmp_path / "c", told={"kind": "sweep"})
    found = ff.read_campaign(path).sweep
    assert found is not None
    assert found.frequency_hz[0] == 700.0
    assert "row 2" in found.left_out[0].names["places"]
