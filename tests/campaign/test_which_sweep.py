"""Of a file with several sweeps the one that is named is read, or it is refused: never another."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

import fitting as ff
from fitting.draft.api import init
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

#: Frequency and full width, Hz, of the two sweeps.
LINES = {"cold": (1.000e6, 50.0), "warm": (0.990e6, 400.0)}
UNITS: dict[str, Any] = {"unit_frequency": "Hz", "unit_amplitude": "V"}


def sweep(name: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Frequencies and both parts of a line."""
    f0, width = LINES[name]
    f = f0 + np.linspace(-10.0 * width, 10.0 * width, 101)
    z = 1e-3 / (1.0 + 2j * (f - f0) / width)
    rng = np.random.default_rng(3)
    z = z + 1e-5 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
    return f, np.array(z.real, dtype=float), np.array(z.imag, dtype=float)


def hdf5_groups(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for group in LINES:
            for name, values in zip(("frequency", "X", "Y"), sweep(group), strict=True):
                unit = "Hz" if name == "frequency" else "V"
                file.create_dataset(f"{group}/{name}", data=values).attrs["unit"] = unit


def hdf5_matrices(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for group in LINES:
            file.create_dataset(f"raw/{group}/1", data=np.array(sweep(group)))


def matlab_structures(path: Path) -> None:
    savemat(path, {g: dict(zip(("f_Hz", "X_V", "Y_V"), sweep(g), strict=True)) for g in LINES})


def matlab_flat(path: Path) -> None:
    """Both sweeps beside each other, as a script saves all that it has."""
    named = {
        f"{key}_{group}_{unit}": values
        for group in LINES
        for (key, unit), values in zip(
            (("f", "Hz"), ("X", "V"), ("Y", "V")), sweep(group), strict=True
        )
    }
    savemat(path, named)


def tdms(path: Path) -> None:
    with TdmsWriter(path) as writer:
        for group in LINES:
            for name, values in zip(("Frequency", "X", "Y"), sweep(group), strict=True):
                about = {"unit_string": "Hz" if name == "Frequency" else "V"}
                writer.write_segment([ChannelObject(group, name, values, about)])


Names = tuple[str, str, str]
#: Files with two sweeps, what the columns of one are called, and what has to be told beside.
FILES: dict[str, tuple[str, Callable[[Path], None], Names, dict[str, Any]]] = {
    "groups": ("a.h5", hdf5_groups, ("{}/frequency", "{}/X", "{}/Y"), {}),
    "matrices": ("a.h5", hdf5_matrices, ("raw/{}/1 1", "raw/{}/1 2", "raw/{}/1 3"), UNITS),
    "part of the group": ("a.h5", hdf5_matrices, ("{}/1 1", "{}/1 2", "{}/1 3"), UNITS),
    "structures": ("a.mat", matlab_structures, ("{}/f_Hz", "{}/X_V", "{}/Y_V"), {}),
    "side by side": ("a.mat", matlab_flat, ("f_{}_Hz", "X_{}_V", "Y_{}_V"), {}),
    "TDMS": ("a.tdms", tdms, ("{}/Frequency", "{}/X", "{}/Y"), {}),
}


def columns(names: Names, group: str, told: dict[str, Any]) -> ff.Columns:
    frequency, real, imaginary = (name.format(group) for name in names)
    return ff.Columns(frequency=frequency, real=real, imaginary=imaginary, **told)


@pytest.mark.parametrize("name", FILES)
def test_the_sweep_that_is_named_is_read(name: str, tmp_path: Path) -> None:
    file, write, names, told = FILES[name]
    write(tmp_path / file)
    for group, (f0, width) in LINES.items():
        found = ff.line(tmp_path / file, columns=columns(names, group, told))
        assert abs(found.frequency.value - f0) < 5.0 * found.frequency.std < 0.05 * width
        assert found.width.value == pytest.approx(width, rel=0.05)


@pytest.mark.parametrize("name", FILES)
def test_a_sweep_that_is_not_there_is_no_other_one(name: str, tmp_path: Path) -> None:
    file, write, names, told = FILES[name]
    write(tmp_path / file)
    with pytest.raises(BadInput):
        ff.line(tmp_path / file, columns=columns(names, "hot", told))
    frequency, _, imaginary = (each.format("warm") for each in names)
    mixed = ff.Columns(
        frequency=frequency, real=names[1].format("hot"), imaginary=imaginary, **told
    )
    with pytest.raises(BadInput):
        ff.line(tmp_path / file, columns=mixed)


@pytest.mark.parametrize("name", FILES)
def test_none_is_chosen_where_none_is_named(name: str, tmp_path: Path) -> None:
    """The complaint names every sweep, and the option that chooses one."""
    file, write, names, told = FILES[name]
    write(tmp_path / file)
    with pytest.raises(BadInput) as caught:
        ff.line(tmp_path / file, columns=ff.Columns(**told))
    for group in LINES:
        assert names[0].format(group).removesuffix("_Hz") in str(caught.value)
    assert "--frequency" in str(caught.value)


def test_a_name_without_its_group_is_none_of_both(tmp_path: Path) -> None:
    hdf5_groups(tmp_path / "a.h5")
    with pytest.raises(BadInput, match="warm/frequency"):
        ff.line(tmp_path / "a.h5", columns=ff.Columns(frequency="frequency"))


def test_two_recordings_over_time_are_two(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 2001)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for group, f0 in (("one", 50.0), ("two", 80.0)):
            file.create_dataset(f"{group}/time", data=t).attrs["unit"] = "s"
            y = np.exp(-t / 0.2) * np.cos(2 * np.pi * f0 * t)
            file.create_dataset(f"{group}/y", data=y).attrs["unit"] = "V"
    with pytest.raises(BadInput, match=r"one/time.*two/time"):
        ff.ringdown(tmp_path / "a.h5")
    found = ff.ringdown(tmp_path / "a.h5", columns=ff.Columns(time="two/time"))
    assert found.frequency.value == pytest.approx(80.0, rel=1e-3)


def test_a_drafted_campaign_reads_the_sweep_that_was_chosen(tmp_path: Path) -> None:
    hdf5_groups(tmp_path / "a.h5")
    names = FILES["groups"][2]
    path, _ = init(tmp_path / "a.h5", out=tmp_path / "o", columns=columns(names, "warm", {}))
    [table] = tomllib.loads(path.read_text("utf-8"))["complex_sweep"]
    assert set(table["columns"].values()) == {name.format("warm") for name in names}
    [read] = cast(Any, ff.read_campaign(path).measurements["complex_sweep"]).tables
    assert float(np.mean(read.record("").u_hz)) == pytest.approx(LINES["warm"][0], rel=1e-4)


def test_a_drafted_campaign_reads_the_block_that_was_chosen(tmp_path: Path) -> None:
    """Two blocks of a network analyser: --trace 2 was looked at, and block 1 fitted."""
    blocks = []
    for k, group in enumerate(LINES, start=1):
        rows = "\n".join(",".join(f"{v:.12e}" for v in row) for row in np.array(sweep(group)).T)
        blocks.append(f"BEGIN CH{k}_DATA\nFreq(Hz),S21(REAL),S21(IMAG)\n{rows}\nEND\n\n")
    head = "!CSV A.01.01\n!Keysight Technologies,N5222A,MY1,A.10.00\n!Source: Standard\n\n"
    (tmp_path / "a.csv").write_text(head + "".join(blocks), "utf-8")
    path, _ = init(tmp_path / "a.csv", out=tmp_path / "o", columns=ff.Columns(trace=2))
    assert tomllib.loads(path.read_text("utf-8"))["complex_sweep"][0]["trace"] == 2
