"""A map, spectra over a control in one table: told from a sweep, and drafted for two modes."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.campaign.recognised import recognised
from fitting.cli.main import main
from fitting.draft.api import init
from fitting.draft.maps import Spectra, crossing_of
from fitting.resonance.reading import Columns
from fitting.result.result import read_result
from fitting.text.arrays import ComplexArray, FloatArray
from tests.support.crossing_spectra import (
    A0,
    A1,
    B0,
    LAMBDA,
    SWEPT_HZ,
    VOLTS,
    WIDTH,
    measured,
    phasor,
)
from tests.support.lines import mode, noise, write_csv

pytestmark = pytest.mark.usefixtures("swift_models")

F = np.tile(SWEPT_HZ, VOLTS.size)
V = np.repeat(VOLTS, SWEPT_HZ.size)
#: How many spectra, over which control, of how many frequencies.
SEEN = r"5 .*\bV \(V\).* 41 "


def sized(seed: int, share: float = 0.01) -> FloatArray:
    """Amplitudes (205,) in V, with noise, a share of the largest of each spectrum."""
    return np.asarray(1e6 * measured(seed, share).ravel(), dtype=float)


def a_map(folder: Path) -> Path:
    """Five spectra of two modes that avoid each other."""
    return write_csv(folder / "map.csv", "V (V),frequency (Hz),amplitude (V)", V, F, sized(1))


def test_a_map_is_called_one_with_the_table_that_fits_it(tmp_path: Path) -> None:
    path = a_map(tmp_path)
    for look in (ff.line, lambda file: init(file, "CoupledModes1", out=tmp_path / "o")):
        with pytest.raises(
            ff.BadInput, match=rf"{SEEN}.*\[control_sweep\].*control-sweep"
        ) as caught:
            look(path)
        assert "--fmu CoupledModes2" in str(caught.value)
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
    path = write_csv(tmp_path / "map.csv", head, volt, kelvin, f, np.abs(mode(f, 1e3, 2.0)))
    with pytest.raises(ff.BadInput, match=r"4 .*\bV \(V\).*\bT \(K\).* 21 "):
        ff.line(path)


def test_spectra_of_several_lengths_and_a_column_that_is_held(tmp_path: Path) -> None:
    f = np.concatenate([np.linspace(990.0, 1010.0, n) for n in (21, 31)])
    volt = np.repeat([0.0, 1.0], [21, 31])
    head = "V (mV),T (K),frequency (Hz),amplitude (V)"
    path = write_csv(tmp_path / "map.csv", head, volt, np.full(52, 4.0), f, 1.0 + f % 3)
    with pytest.raises(ff.BadInput, match=r"2 .*V \(mV\).* 21 to 31 "):
        ff.line(path)


def test_one_sweep_with_a_column_of_few_values_is_one(tmp_path: Path) -> None:
    """The instrument changed its range in the middle: the frequencies rise all the same."""
    f = np.linspace(990.0, 1010.0, 41)
    head = "range (V),frequency (Hz),amplitude (V)"
    path = write_csv(
        tmp_path / "sweep.csv", head, np.where(f > 995.0, 1.0, 0.0), f, np.abs(mode(f, 1e3, 2.0))
    )
    assert ff.line(path).frequency.value == pytest.approx(1e3, abs=1e-3)


def test_a_sweep_up_and_down_is_no_map(tmp_path: Path) -> None:
    up = np.linspace(990.0, 1010.0, 41)
    f, way = np.concatenate([up, up[::-1]]), np.repeat([0.0, 1.0], 41)
    head = "direction (V),frequency (Hz),amplitude (V)"
    path = write_csv(tmp_path / "both.csv", head, way, f, np.abs(mode(f, 1e3, 2.0)))
    with pytest.raises(ff.BadInput, match="direction"):
        ff.line(path)


DELAY_S = 0.03
AMPLITUDES, PARTS = "V (V),frequency (Hz),amplitude (V)", "V (V),frequency (Hz),X (V),Y (V)"


def parts(seed: int, *, delay_s: float, turned: bool = False) -> ComplexArray:
    """What an analyser sees, (205,): each sweep with a phase of its own, behind one cable."""
    exact = np.array([phasor(SWEPT_HZ, v) for v in VOLTS])
    rng = np.random.default_rng(seed)
    turns = rng.uniform(size=(VOLTS.size, 1)) - (SWEPT_HZ - B0) * delay_s
    seen = np.asarray(1e6 * exact * np.exp(2j * np.pi * turns), dtype=complex)
    largest = float(np.max(np.abs(seen)))
    seen = seen.ravel() + largest * noise(seen.size, 5e-3, seed + 100)
    return np.asarray(np.conj(seen) if turned else seen, dtype=complex)


def drafted(path: Path, folder: Path, **told: str) -> tuple[dict[str, Any], str]:
    """The campaign, and what was said of it."""
    made, said = init(path, "CoupledModes2", out=folder / "drafted", told=told)
    return tomllib.loads(made.read_text("utf-8")), " ".join(said)


def starts(campaign: dict[str, Any]) -> dict[str, float]:
    """Where parameters start, each inside its box, which reaches far."""
    for box in campaign["parameters"]:
        room = box["upper"] - box["lower"]
        assert box["lower"] + 0.05 * room < box["start"] < box["upper"] - 0.05 * room
    return {box["name"]: box["start"] for box in campaign["parameters"]}


@pytest.mark.parametrize(
    ("phases", "seed"),
    [(False, 1), pytest.param(True, 2, marks=pytest.mark.nightly)],
    ids=["amplitudes", "phases"],
)
def test_the_draft_of_a_map_runs_as_it_is_and_finds_the_coupling(
    phases: bool, seed: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if phases:
        seen = parts(seed, delay_s=DELAY_S)
        path = write_csv(tmp_path / "map.csv", PARTS, V, F, seen.real, seen.imag)
    else:
        sizes = sized(seed)
        path = write_csv(tmp_path / "map.csv", AMPLITUDES, V, F, sizes)
    out = tmp_path / "drafted"
    named = ["--fmu", "CoupledModes2", "--out", str(out), "--yes"]
    assert main(["init", str(path), *named]) == 0
    assert re.search(SEEN, capsys.readouterr().out)
    campaign = tomllib.loads((out / "campaign.toml").read_text("utf-8"))
    table = campaign["complex_control_sweep" if phases else "control_sweep"]
    assert table.get("delay") == ("fit" if phases else None)
    assert campaign["laws"] == {"f1": "a0 + a1*V"}
    assert campaign["fmu"]["taken"] == ["g2"]  # that nobody drives mode 2 is a guess
    starts(campaign)
    results = tmp_path / "results"
    quick = ["--quick", "--no-report", "--no-profiles", "--workers", "1"]
    assert main(["reconstruct", str(out / "campaign.toml"), "--out", str(results), *quick]) == 0
    found = read_result(results / "result.json").parameters
    truth = {"a0": A0, "a1": A1, "f2": B0, "lambda12": LAMBDA, "d1": WIDTH, "d2": WIDTH}
    for name, value in truth.items():
        assert abs(found[name].value - value) < 4.0 * found[name].std < 0.1 * abs(value), name


def test_a_map_without_a_cable_whose_phases_are_counted_the_other_way(tmp_path: Path) -> None:
    seen = parts(3, delay_s=0.0, turned=True)
    path = write_csv(tmp_path / "map.csv", PARTS, V, F, seen.real, seen.imag)
    campaign, said = drafted(path, tmp_path)
    assert campaign["complex_control_sweep"]["conjugate"] is True
    assert "delay" not in campaign["complex_control_sweep"]
    assert "cable" not in said
    assert starts(campaign)["lambda12"] == pytest.approx(LAMBDA, rel=0.01)


def spectra_of(
    f1: Callable[[float], float], f2: Callable[[float], float], coupling: float, volts: FloatArray
) -> FloatArray:
    """|q1| of two modes in closed form, (spectra, frequencies), with 1 % of noise."""
    w2 = (2.0 * math.pi * SWEPT_HZ) ** 2
    loss = 2j * math.pi * SWEPT_HZ * 2.0 * math.pi * WIDTH
    rows = []
    for v in volts:
        one, two = ((2.0 * math.pi * f(float(v))) ** 2 - w2 + loss for f in (f1, f2))
        rows.append(np.abs(two / (one * two - (2.0 * math.pi * coupling) ** 4)))
    sizes = np.array(rows)
    rough = np.random.default_rng(5).standard_normal(sizes.shape)
    return np.asarray(np.abs(sizes + 0.01 * np.max(sizes, axis=1, keepdims=True) * rough))


def written_map(folder: Path, volts: FloatArray, sizes: FloatArray, head: str = AMPLITUDES) -> Path:
    f, v = np.tile(SWEPT_HZ, volts.size), np.repeat(volts, SWEPT_HZ.size)
    return write_csv(folder / "map.csv", head, v, f, sizes.ravel() / np.max(sizes))


def test_the_mode_that_nobody_drives_may_follow_the_control(tmp_path: Path) -> None:
    sizes = spectra_of(lambda _: 1000.0, lambda v: 1001.0 - 3.0 * v, 90.0, VOLTS)
    campaign, _ = drafted(written_map(tmp_path, VOLTS, sizes), tmp_path)
    found = starts(campaign)
    assert campaign["laws"] == {"f2": "a0 + a1*V"}
    assert found["f1"] == pytest.approx(1000.0, abs=0.2)
    assert found["a0"] == pytest.approx(1001.0, abs=0.2)
    assert found["a1"] == pytest.approx(-3.0, abs=0.1)
    assert found["lambda12"] == pytest.approx(90.0, rel=0.01)


def test_both_modes_may_follow_the_control_and_no_fmu_needs_a_name(tmp_path: Path) -> None:
    volts = np.linspace(-3.0, 3.0, 9)
    sizes = spectra_of(lambda v: 1001.0 + 3.0 * v, lambda v: 1000.0 - 2.0 * v, LAMBDA, volts)
    made, _ = init(written_map(tmp_path, volts, sizes), out=tmp_path / "o")
    campaign = tomllib.loads(made.read_text("utf-8"))
    found = starts(campaign)
    assert campaign["fmu"]["model"] == "CoupledModes2"
    assert campaign["laws"] == {"f1": "a0 + a1*V", "f2": "b0 + b1*V"}
    for name, truth in {"a0": 1001.0, "a1": 3.0, "b0": 1000.0, "b1": -2.0}.items():
        assert found[name] == pytest.approx(truth, abs=0.1), name
    assert found["lambda12"] == pytest.approx(LAMBDA, rel=0.01)


def test_a_tuning_by_the_square_of_millivolts_has_a_square_in_its_law(tmp_path: Path) -> None:
    volts = np.linspace(-4.0, 4.0, 9)
    sizes = spectra_of(lambda v: 993.0 + v * v, lambda _: 1000.0, 80.0, volts)
    path = written_map(tmp_path, 1e3 * volts, sizes, AMPLITUDES.replace("(V),f", "(mV),f"))
    campaign, _ = drafted(path, tmp_path)
    found = starts(campaign)
    assert campaign["laws"] == {"f1": "a0 + a1*V + a2*V**2"}
    [square] = [p for p in campaign["parameters"] if p["name"] == "a2"]
    assert square["unit"] == "Hz/mV**2"
    assert square["start"] == pytest.approx(1e-6, rel=0.02)
    assert found["a0"] == pytest.approx(993.0, abs=0.2)
    assert found["lambda12"] == pytest.approx(80.0, rel=0.01)


def test_a_law_counts_from_the_middle_of_a_control_that_is_far_from_zero(tmp_path: Path) -> None:
    volts = np.linspace(10.0, 12.0, 7)
    sizes = spectra_of(lambda v: 1001.0 + 10.0 * (v - 11.0), lambda _: 1000.0, LAMBDA, volts)
    campaign, said = drafted(written_map(tmp_path, volts, sizes), tmp_path)
    assert campaign["laws"] == {"f1": "a0 + a1*(V - V_middle)"}
    assert campaign["constants"] == {"V_middle": "11 V"}
    assert starts(campaign)["a0"] == pytest.approx(1001.0, abs=0.1)
    assert "meet at V = 10.9 V" in said


def test_columns_of_usual_names_are_read_by_the_campaign_too(tmp_path: Path) -> None:
    sizes = sized(1, 0.001)
    path = write_csv(tmp_path / "map.csv", "voltage (V),Freq (kHz),R (mV)", V, F / 1e3, sizes)
    campaign, said = drafted(path, tmp_path)
    assert re.search(r"5 .*voltage \(V\)", said)
    assert campaign["laws"] == {"f1": "a0 + a1*voltage"}
    assert starts(campaign)["lambda12"] == pytest.approx(LAMBDA, rel=0.01)


def test_columns_that_flags_name_stand_in_the_campaign(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "map.csv", "V (V),u (kHz),lock-in", V, F / 1e3, sized(1, 0.001))
    columns = Columns(frequency="u", amplitude="lock-in", unit_amplitude="V")
    made, _ = init(path, "CoupledModes2", out=tmp_path / "o", columns=columns)
    campaign = tomllib.loads(made.read_text("utf-8"))
    assert campaign["control_sweep"]["columns"] == {"frequency": "u", "amplitude": "lock-in (V)"}
    assert starts(campaign)["lambda12"] == pytest.approx(LAMBDA, rel=0.01)


def test_a_map_in_decibels_over_a_milliwatt(tmp_path: Path) -> None:
    head = AMPLITUDES.replace("amplitude (V)", "amplitude (dBm)")
    sizes = sized(1, 0.001)
    path = write_csv(tmp_path / "map.csv", head, V, F, 20.0 * np.log10(sizes))
    campaign, _ = drafted(path, tmp_path)
    assert campaign["control_sweep"]["amplitude"] == "dBm"
    assert starts(campaign)["lambda12"] == pytest.approx(LAMBDA, rel=0.01)


def test_rms_is_told_by_its_flag(tmp_path: Path) -> None:
    assert drafted(a_map(tmp_path), tmp_path)[0]["control_sweep"]["amplitude"] == "V peak"
    told = drafted(a_map(tmp_path), tmp_path / "other", amplitudes="rms")
    assert told[0]["control_sweep"]["amplitude"] == "V rms"


def test_a_map_of_one_line_is_not_drafted(tmp_path: Path) -> None:
    volts = np.linspace(-3.0, 3.0, 7)
    sizes = spectra_of(lambda v: 1001.0 + 4.0 * v, lambda _: 5000.0, 1.0, volts)
    with pytest.raises(ff.BadInput, match=r"7 .*V.*one line") as caught:
        drafted(written_map(tmp_path, volts, sizes), tmp_path)
    assert "--fmu" not in str(caught.value)  # it was given


def test_a_crossing_deep_in_noise_is_seen_and_one_line_in_it_is_none() -> None:
    """Noise of a fifth of each spectrum's largest amplitude."""
    volts = np.linspace(-3.0, 3.0, 7)
    for coupling, seen in ((LAMBDA, True), (0.1, False)):
        sizes = spectra_of(lambda v: 1001.0 + 4.0 * v, lambda _: 1000.0, coupling, volts)
        rough = np.random.default_rng(6).standard_normal(sizes.shape)
        noisy = np.abs(sizes + 0.2 * np.max(sizes, axis=1, keepdims=True) * rough)
        found = crossing_of(Spectra(volts, [SWEPT_HZ] * 7, list(noisy)))
        assert found.is_observed is seen


@pytest.mark.parametrize(
    ("control", "said"),
    [
        ("gate voltage (V)", "'gate voltage'"),
        ("f2 (Hz)", "'f2'"),
        ("V", r"unit of V\b"),
        ("level (V)", r"map\.csv.*amplitude"),
    ],
)
def test_a_control_that_no_law_can_name(control: str, said: str, tmp_path: Path) -> None:
    sizes = sized(1)
    seen = "lock-in" if control.startswith("level") else "amplitude (V)"
    head = f"{control},frequency (Hz),{seen}"
    with pytest.raises(ff.BadInput, match=said):
        drafted(write_csv(tmp_path / "map.csv", head, V, F, sizes), tmp_path)


def test_powers_and_other_files_and_other_choices_are_refused(tmp_path: Path) -> None:
    head = AMPLITUDES.replace("amplitude (V)", "amplitude (V**2)")
    sizes = sized(1)
    with pytest.raises(ff.BadInput, match=r"'amplitude'.*power"):
        drafted(write_csv(tmp_path / "power.csv", head, V, F, sizes**2), tmp_path)
    path = a_map(tmp_path)
    with pytest.raises(ff.BadInput, match=r"map\.csv"):
        init([path, path], "CoupledModes2", out=tmp_path / "o")
    with pytest.raises(ff.BadInput, match=r"--fit: .*lambda12"):
        drafted(path, tmp_path, fit="f1")


def test_the_only_column_in_hertz_of_a_map_in_rows_is_the_frequency(tmp_path: Path) -> None:
    """Whatever it is called: it rises anew for each value of the control."""
    f, v = np.tile(np.linspace(99.0, 101.0, 41), 3), np.repeat([-1.0, 0.0, 1.0], 41)
    r = 1.0 / np.hypot(f - 100.0 - 0.1 * v, 0.1)
    path = write_csv(tmp_path / "map.csv", "Vdc (V),f_drive (kHz),R (mV)", v, f, r)
    found = recognised(path).role("frequency")
    assert found is not None
    assert (found.name, found.unit, found.guessed) == ("f_drive", "kHz", True)
    seconds = write_csv(tmp_path / "pll.csv", "time (s),f_drive (kHz)", np.arange(9.0), f[:9] % 0.7)
    assert recognised(seconds).role("frequency") is None


PUMPED = Path(__file__).parents[2] / "data" / "string_pumped" / "sweeps.csv"


def test_of_two_columns_that_change_from_sweep_to_sweep_none_is_guessed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The pump's frequency was dropped without a word; the fit had lambda12 48.8 for 648 kHz."""
    assert main(["init", str(PUMPED), "--out", str(tmp_path / "o"), "--yes"]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert re.search(r"volts \(V\) and pump \(kHz\).*--control volts", line)
    assert not (tmp_path / "o").exists()


def test_a_column_that_varies_and_is_not_used_is_named(tmp_path: Path) -> None:
    sizes = sized(1, 0.001)
    head = "V (V),T (K),stage,frequency (Hz),amplitude (V),note"
    columns = [V, 4.0 + np.floor(0.5 * V), np.linspace(0.0, 1.0, V.size), F, sizes]
    rows = [
        ",".join([*map(repr, row), "a"]) for row in zip(*(c.tolist() for c in columns), strict=True)
    ]
    path = tmp_path / "map.csv"
    path.write_text("\n".join([head, *rows]) + "\n", "utf-8")
    with pytest.raises(ff.BadInput, match=r"V and T .*--control V"):
        drafted(path, tmp_path)
    made, said = init(path, "CoupledModes2", out=tmp_path / "o", told={"control": "V"})
    text = made.read_text("utf-8")
    assert tomllib.loads(text)["control_sweep"]["controls"] == ["V"]
    for words in (" ".join(said), text.partition("title")[0]):
        assert "'T' (K) and 'stage'" in words
        assert "'note'" not in words
    with pytest.raises(ff.BadInput, match=r"'T' alone has a value twice"):
        init(path, "CoupledModes2", out=tmp_path / "p", told={"control": "T"})
