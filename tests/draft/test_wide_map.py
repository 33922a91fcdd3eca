"""Maps with a column or a row of amplitudes for each value of the control, as many are written."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.campaign.instruments.plain import read_spectra_table
from fitting.campaign.instruments.roles import AMPLITUDE
from fitting.draft.api import init
from fitting.measurements.control_sweep import ReadSpectra
from fitting.resonance.reading import Columns
from fitting.text.arrays import FloatArray
from tests.support.crossing_spectra import A0, A1, B0, LAMBDA, SWEPT_HZ, VOLTS, WIDTH, response
from tests.support.lines import mode

pytestmark = pytest.mark.usefixtures("swift_models")

#: Amplitudes in V by the closed form, (voltages, frequencies).
EXACT = 1e6 * np.array([response(SWEPT_HZ, volt) for volt in VOLTS])


def written(path: Path, head: str, first: FloatArray, body: FloatArray, between: str = ",") -> Path:
    """A head, and rows that begin with one of ``first`` and go on with a row of ``body``."""
    rows = (
        between.join(f"{x!r}" for x in map(float, row)) for row in np.column_stack([first, body])
    )
    path.write_text("\n".join([head.replace(",", between), *rows]) + "\n", "utf-8")
    return path


def heads(form: str) -> str:
    return ",".join(form.format(volt) for volt in VOLTS)


@pytest.mark.parametrize(
    ("head", "control", "unit"),
    [
        (f"frequency (Hz),{heads('V={:g} V')}", "V", "V"),
        (f"frequency (Hz),{heads('V = {:g} (V)')}", "V", "V"),
        (f"frequency (Hz),{heads('V (V) = {:g}')}", "V", "V"),
        (f"f/Hz,{heads('gate: {:g}')}", "gate", "1"),
        (f"freq [Hz],{heads('{:g} V')}", "control", "V"),
        (f"# f_Hz,{heads('{:g}')}", "control", "1"),
        (f"frequency (Hz) \\ V (V),{heads('{:g}')}", "V", "V"),
    ],
)
@pytest.mark.parametrize("between", [",", ";", "\t"])
def test_a_column_for_each_value_is_read(
    head: str, control: str, unit: str, between: str, tmp_path: Path
) -> None:
    path = written(tmp_path / "map.csv", head, SWEPT_HZ, EXACT.T, between)
    check_table(path, control, unit)
    with pytest.raises(ff.BadInput, match=rf"5 .*{control} \({unit}\).* 41 "):
        ff.line(path)


@pytest.mark.parametrize(
    ("head", "step"),
    [("V (V),{}", "{:.10g} Hz"), ("V (V),{}", "f={:.10g} Hz"), ("V (V) | f (Hz),{}", "{:.10g}")],
)
def test_a_row_for_each_value_is_read(head: str, step: str, tmp_path: Path) -> None:
    frequencies = ",".join(step.format(f) for f in SWEPT_HZ)
    path = written(tmp_path / "map.csv", head.format(frequencies), VOLTS, EXACT)
    check_table(path, "V", "V")


def check_table(path: Path, control: str, unit: str) -> None:
    """The long table that it means: every point by its control and frequency."""
    table = read_spectra_table(path)
    names = [(column.name, column.unit) for column in table.columns]
    assert names == [(control, unit), ("frequency", "Hz"), (AMPLITUDE[0], None)]
    volts, hertz, sizes = (table.numbers(column) for column in table.columns)
    np.testing.assert_array_equal(volts, np.repeat(VOLTS, SWEPT_HZ.size))
    np.testing.assert_allclose(hertz, np.tile(SWEPT_HZ, VOLTS.size), rtol=1e-9)
    np.testing.assert_array_equal(sizes, EXACT.ravel())


def test_frequencies_may_fall(tmp_path: Path) -> None:
    head = f"frequency (Hz),{heads('V={:g} V')}"
    check_table(written(tmp_path / "map.csv", head, SWEPT_HZ[::-1], EXACT.T[::-1]), "V", "V")


@pytest.mark.parametrize("by_row", [False, True])
def test_a_draft_of_it_starts_at_the_truth(by_row: bool, tmp_path: Path) -> None:
    """And its campaign is read, as `init` does that itself."""
    if by_row:
        head = "V (V)," + ",".join(f"{f:.10g}" for f in SWEPT_HZ)  # no unit: told by a flag
        path = written(tmp_path / "map.csv", head, VOLTS, EXACT)
    else:
        head = f"frequency (Hz),{heads('V={:g} V')}"
        path = written(tmp_path / "map.csv", head, SWEPT_HZ, EXACT.T)
    columns = Columns(unit_frequency="Hz", unit_amplitude="V")
    made, said = init(path, "CoupledModes2", out=tmp_path / "o", columns=columns)
    place = "row" if by_row else "column"
    assert place in said[0]
    assert "5 values of 'V'" in said[0]
    campaign = tomllib.loads(made.read_text("utf-8"))
    assert campaign["control_sweep"]["controls"] == ["V"]
    assert campaign["laws"] == {"f1": "a0 + a1*V"}
    found = {p["name"]: p["start"] for p in campaign["parameters"]}
    truth = {"a0": A0, "a1": A1, "f2": B0, "lambda12": LAMBDA, "d1": WIDTH, "d2": WIDTH}
    assert found == pytest.approx(truth, rel=1e-3)
    read = ff.read_campaign(made).measurements["control_sweep"]
    assert isinstance(read, ReadSpectra)
    spectra = read.spectra
    assert [s.label for s in spectra] == [f"{volt:g} V" for volt in VOLTS]
    np.testing.assert_array_equal([s.amplitude for s in spectra], EXACT)


def test_where_frequencies_stand_is_asked_where_nothing_tells(tmp_path: Path) -> None:
    said = r"map\.csv.* 41 .* 5 .*'frequency \(Hz\)'"
    path = written(tmp_path / "map.csv", f",{heads('{:g}')}", SWEPT_HZ, EXACT.T)
    for look in (ff.line, read_spectra_table):
        with pytest.raises(ff.BadInput, match=said):
            look(path)


def test_one_column_of_it_is_a_sweep(tmp_path: Path) -> None:
    widths = (1.0, 2.0, 3.0)
    sizes = np.array([np.abs(mode(SWEPT_HZ, 1e3, width)) for width in widths])
    path = written(tmp_path / "map.csv", "frequency (Hz),T=1 K,T=2 K,T=3 K", SWEPT_HZ, sizes.T)
    found = ff.line(path, columns=Columns(amplitude="T=2 K"))
    assert found.width.value == pytest.approx(2.0, rel=1e-3)
    with pytest.raises(ff.BadInput, match=r"3 .*\bT\b"):
        ff.line(path)


@pytest.mark.parametrize(
    "head",
    [
        "frequency (Hz),1 peak,2 peak,3 peak",  # no values of one control
        "frequency (Hz),V=1 V,T=2 K,V=3 V",
        "frequency (Hz),S11,S21,S12",
    ],
)
def test_other_tables_are_what_they_are(head: str, tmp_path: Path) -> None:
    path = written(tmp_path / "t.csv", head, SWEPT_HZ, EXACT.T[:, :3])
    assert [c.name for c in read_spectra_table(path).columns][1:] == head.split(",")[1:]


def test_numbers_without_a_head_are_no_head(tmp_path: Path) -> None:
    """The first row of a recording without names, whose values happen to rise."""
    path = written(tmp_path / "t.csv", "0.0,1.0,2.0,3.0,4.0", np.arange(20.0), np.ones((20, 4)))
    assert len(read_spectra_table(path).columns) == 5


def test_a_row_with_too_few_cells_is_named(tmp_path: Path) -> None:
    path = written(tmp_path / "t.csv", f"f (Hz),{heads('{:g} V')}", SWEPT_HZ, EXACT.T)
    path.write_text(path.read_text("utf-8") + "1020.0,1.0,2.0\n", "utf-8")
    with pytest.raises(ff.BadInput, match=r"row 43 .*\b3\b.*\b6\b"):
        ff.line(path)
