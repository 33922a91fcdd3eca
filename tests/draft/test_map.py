"""A map, spectra over a control in one table, where `line` and `init` look for one sweep."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.api.init import init
from tests.support.crossing_spectra import SWEPT_HZ, VOLTS, measured
from tests.support.lines import mode, write_csv

F = np.tile(SWEPT_HZ, VOLTS.size)
V = np.repeat(VOLTS, SWEPT_HZ.size)
SEEN = "5 spectra over V (V), 41 frequencies each"


def a_map(folder: Path) -> Path:
    """Five spectra of two modes that avoid each other."""
    sizes = 1e6 * measured(1, 0.01).ravel()
    return write_csv(folder / "map.csv", "V (V),frequency (Hz),amplitude (V)", V, F, sizes)


@pytest.mark.parametrize("fmu", [None, "CoupledModes1"])
def test_a_map_is_called_one_with_the_table_that_fits_it(fmu: str | None, tmp_path: Path) -> None:
    path = a_map(tmp_path)
    said = rf"a map, {SEEN[:15]}.*\[control_sweep\].*docs/how-to/control-sweep.md"
    for look in (ff.line, lambda file: init(file, fmu, out=tmp_path / "o")):
        with pytest.raises(ff.BadInput, match=said) as caught:
            look(path)
        assert SEEN in str(caught.value)
        assert "twice" not in str(caught.value)


def test_a_map_with_phases_has_the_table_for_them(tmp_path: Path) -> None:
    head = "V (V),frequency (Hz),X (V),Y (V)"
    path = write_csv(tmp_path / "map.csv", head, V, F, np.cos(F), np.sin(F))
    with pytest.raises(ff.BadInput, match=r"\[complex_control_sweep\]"):
        ff.line(path)


def test_two_controls_together_make_a_map(tmp_path: Path) -> None:
    """Neither of them alone: each value of one has the frequencies of both values of the other."""
    f = np.tile(np.linspace(990.0, 1010.0, 21), 4)
    volt, kelvin = np.repeat([0.0, 0.0, 1.0, 1.0], 21), np.repeat([4.0, 5.0, 4.0, 5.0], 21)
    head = "V (V),T (K),frequency (Hz),amplitude (V)"
    path = write_csv(tmp_path / "map.csv", head, volt, kelvin, f, 1.0 + f % 3)
    with pytest.raises(ff.BadInput, match=r"4 spectra over V \(V\) and T \(K\), 21 frequencies"):
        ff.line(path)


def test_spectra_of_several_lengths_and_a_column_that_is_held(tmp_path: Path) -> None:
    f = np.concatenate([np.linspace(990.0, 1010.0, n) for n in (21, 31)])
    volt = np.repeat([0.0, 1.0], [21, 31])
    head = "V (mV),T (K),frequency (Hz),amplitude (V)"
    path = write_csv(tmp_path / "map.csv", head, volt, np.full(52, 4.0), f, 1.0 + f % 3)
    with pytest.raises(ff.BadInput, match=r"2 spectra over V \(mV\), 21 to 31 frequencies each"):
        ff.line(path)


def test_one_sweep_with_a_column_of_few_values_is_one(tmp_path: Path) -> None:
    """The instrument changed its range in the middle: the frequencies rise all the same."""
    f = np.linspace(990.0, 1010.0, 41)
    head = "range (V),frequency (Hz),amplitude (V)"
    path = write_csv(tmp_path / "sweep.csv", head, 1.0 * (f > 995.0), f, np.abs(mode(f, 1e3, 2.0)))
    assert ff.line(path).frequency_hz == pytest.approx(1e3, abs=1e-3)


def test_a_sweep_up_and_down_is_no_map(tmp_path: Path) -> None:
    up = np.linspace(990.0, 1010.0, 41)
    f, way = np.concatenate([up, up[::-1]]), np.repeat([0.0, 1.0], 41)
    head = "direction (V),frequency (Hz),amplitude (V)"
    path = write_csv(tmp_path / "both.csv", head, way, f, np.abs(mode(f, 1e3, 2.0)))
    with pytest.raises(ff.BadInput, match="of a sweep up and down, the rows of one direction"):
        ff.line(path)
