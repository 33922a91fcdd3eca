"""Where several names or values of a campaign are wrong, all of them are told at once."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

import fitting as ff
from fitting.campaign import bind
from fitting.cli.main import main
from fitting.text.toml import read_toml, toml_text
from tests.faults.scene import CAMPAIGN, EXPERIMENTS, FMU, texts


@pytest.fixture
def campaign(tmp_path: Path, swift_fmu: Path) -> Path:
    """A campaign that fits its FMU."""
    for name, text in texts().items():
        (tmp_path / name).write_text(text, "utf-8")
    (tmp_path / FMU).write_bytes(swift_fmu.read_bytes())
    return tmp_path / CAMPAIGN


def complaints(path: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    words = ["reconstruct", str(path), "--out", str(path.parent / "out"), "--no-report"]
    assert main(words) == 2
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith(f"fmu-fit: {path.parent}") for line in lines)
    return lines


def test_names_and_units_beside_the_fmu(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tables = read_toml(campaign)
    tables["observe"]["output"] = "q1_hybird"
    tables["fmu"]["start"] |= {"thet": 0.0, "d2": "30 kg"}
    tables["drive"] |= {"frequencies": ["u1"], "amplitudes": ["B1"]}
    tables["parameters"][0]["name"] = "d3"
    tables["parameters"][1]["lower"] = "310 V"
    tables["derived"]["outputs"] = ["lambda", "lamda"]
    campaign.write_text(toml_text(tables), "utf-8")
    told = complaints(campaign, capsys)
    for words in (
        "[observe] output: the FMU has no variable 'q1_hybird'; did you mean 'q1_hybrid'?",
        "no variable 'thet'; did you mean 'theta'?",
        "found unit 'kg', wanted 'Hz'",
        "[drive] amplitudes: the FMU has no variable 'B1'",
        "[parameters 'd3']: the FMU has no variable 'd3'",
        "found unit 'V', wanted 'Hz'",
        "[derived] outputs: the FMU has no variable 'lamda'",
    ):
        assert sum(words in line for line in told) == 1, words
    assert len(told) == 7


def test_columns_of_the_experiments(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tables = read_toml(campaign)
    for key in ("spectra", "noise_floor", "layout", "columns"):
        del tables["experiments"][key]
    tables["experiments"] |= {"peaks": ["z1"], "peak_sigmas": ["s1"]}
    campaign.write_text(toml_text(tables), "utf-8")
    (campaign.parent / EXPERIMENTS).write_text("experiment,v1 (Hz)\none,310\ntwo,330\n", "utf-8")
    told = complaints(campaign, capsys)
    for name in ("u1", "z1", "s1"):
        assert sum(f"no column '{name}'" in line for line in told) == 1
    assert len(told) == 3


WRONG = "3 kg K"
#: Table, or its place, and what is wrong in it; every entry is another fault.
FAULTS: tuple[tuple[tuple[str | int, ...], object], ...] = (
    (("drive", "level"), WRONG),
    (("noise", "absolute"), WRONG),
    (("drift", "eta_minus", "before"), WRONG),
    (("drift", "eta_minus", "after"), WRONG),
    (("drift", "prior"), WRONG),
    (("sweep", "set", "eta_minus"), WRONG),
    (("sweep", "set_sigma", "d2"), WRONG),
    (("parameters", 0, "lower"), WRONG),
    (("parameters", 0, "upper"), WRONG),
    (("parameters", 0, "scale"), WRONG),
    (("parameters", 1, "unit"), "kg"),
    (("parameters", 1, "start"), WRONG),
    (("accuracy", "tolerance"), "nosuch_tolerance"),
    (("accuracy", "substep"), "nosuch_substep"),
    (("accuracy", "full"), {"nosuch_full": 1}),
    (("fmu", "start", "nosuch_start"), 1),
    (("alternatives", "nosuch_try"), [1]),
    (("laws", "g1"), "1 +"),
    (("laws", "g2"), "2.0"),
    (("constants", "k"), "3 nosuchunit"),
)


def put(tables: dict[str, Any], place: tuple[str | int, ...], value: object) -> None:
    inside: Any = tables
    for step in place[:-1]:
        inside = inside.setdefault(step, {}) if isinstance(inside, dict) else inside[step]
    inside[place[-1]] = value


def told_of(campaign: Path, tables: dict[str, Any], fmu: ff.Fmu) -> list[str]:
    campaign.write_text(toml_text(tables), "utf-8")
    with pytest.raises(ff.BadInput) as refused:
        bind(ff.read_campaign(campaign), fmu.variables)
    return list(map(str, refused.value.args))


def test_what_is_told_of_a_fault_alone_is_told_beside_all_others(campaign: Path) -> None:
    """Twenty faults, each by itself and all of them together."""
    fmu = ff.Fmu(campaign.parent / FMU)
    whole = read_toml(campaign)
    put(whole, ("drift", "model"), "offsets")
    put(whole, ("drift", "prior"), "1 Hz")
    put(whole, ("sweep", "use"), "fit")
    put(whole, ("sweep", "scale"), "fit")
    campaign.write_text(toml_text(whole), "utf-8")
    bind(ff.read_campaign(campaign), fmu.variables)  # it is right without them
    every = copy.deepcopy(whole)
    alone = set()
    for place, value in FAULTS:
        tables = copy.deepcopy(whole)
        put(tables, place, value)
        alone.update(told_of(campaign, tables, fmu))
        put(every, place, value)
    assert len(alone) == len(FAULTS)
    assert set(told_of(campaign, every, fmu)) == alone


NOISE = {
    "file": "density.csv",
    "force": "thermal",
    "temperature": WRONG,
    "mass": WRONG,
    "set": {"nosuch_noise": 1},
}
LOCK_IN = {
    "file": "times.csv",
    "frequency": WRONG,
    "input": "nosuch_input",
    "set_sigma": {"nosuch_sigma": 1},
}
RECORDING = {"file": "nosuch.csv", "input": "nosuch_driver", "output": "nosuch_output"}
FILES = {
    "times.csv": "time (s),X (V),Y (V)\n"
    + "".join(f"{0.01 * k:g},{0.5**k:g},0\n" for k in range(20)),
    "density.csv": "frequency (Hz),density (V2/Hz)\n"
    + "".join(f"{300 + k},{1.0 / (1 + (k - 10) ** 2):g}\n" for k in range(20)),
}


def test_further_measurements_are_looked_at_beside_everything_else(campaign: Path) -> None:
    fmu = ff.Fmu(campaign.parent / FMU)
    for name, text in FILES.items():
        (campaign.parent / name).write_text(text, "utf-8")
    tables = read_toml(campaign)
    tables["parameters"][0]["lower"] = WRONG
    tables |= {
        "noise_spectrum": [NOISE],
        "demodulated_trace": [LOCK_IN],
        "trace": [RECORDING],
    }
    told = told_of(campaign, tables, fmu)
    for words in (
        "[parameters 'd1'] lower: found unit 'kg K', wanted 'Hz'",
        "temperature: found unit 'kg K', wanted 'K'",
        "mass: found unit 'kg K', wanted 'kg'",
        "no variable 'nosuch_noise'",
        "frequency: found unit 'kg K', wanted 'Hz'",
        "no variable 'nosuch_input'",
        "no variable 'nosuch_sigma'",
        "nosuch.csv: no such file",
        "no variable 'nosuch_driver'",
        "no variable 'nosuch_output'",
    ):
        assert sum(words in line for line in told) == 1, (words, told)
    assert len(told) == 10


def test_files_that_are_not_there_are_told_beside_wrong_keys(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tables = read_toml(campaign)
    tables["experiments"] |= {"file": "experimens.csv", "amplitude": "volts", "layout": "cvs"}
    tables["sweep"] |= {"file": "nosuch/sweep.csv", "scale": "maximal"}
    tables["continuation"] |= {"beta": 2.0, "iterations": "nine"}
    campaign.write_text(toml_text(tables), "utf-8")
    told = complaints(campaign, capsys)
    for words in (
        "experimens.csv: no such file; did you mean 'experiments.csv'?",
        "nosuch/sweep.csv: no such file",
        '[experiments] amplitude: found "volts"',
        "[experiments] layout: ",
        "[sweep] scale: ",
        "[continuation] beta: found 2.0, wanted a factor above 0 and below 1",
        "[continuation] iterations: ",
    ):
        assert sum(words in line for line in told) == 1, (words, told)
    assert len(told) == 7
