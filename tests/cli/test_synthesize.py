"""The synthesize command: its files, its options, what it refuses."""

from __future__ import annotations

import argparse
import os
import shlex
import stat
from dataclasses import replace
from pathlib import Path

import pytest

from fitting.campaign import read_campaign
from fitting.cli.main import main
from fitting.lab import command as synthesize
from fitting.lab.duffing import CubicModes
from fitting.text.errors import BadInput
from fitting.text.results_folder import RECORD_NAME, write_whole
from tests.support.string_benches import read_bench

DATA = Path(__file__).parents[2] / "data"


def call(*words: str | Path) -> int:
    parser = argparse.ArgumentParser(prog="fmu-fit synthesize")
    parser.set_defaults(parser=parser)
    synthesize.add_arguments(parser)
    return synthesize.run(parser.parse_args([str(w) for w in words]))


def contents(folder: Path) -> dict[str, bytes]:
    files = (p for p in folder.rglob("*") if p.is_file() and p.name != RECORD_NAME)
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in files}


@pytest.mark.parametrize(
    ("folder", "series", "seed"),
    [
        ("string_q1", "q1", 1),
        ("string_q2", "q2", 2),
        ("duffing_string", "duffing", 3),
        ("string_q1_published", "q1-published", 4),
        ("string_pumped", "string_pumped", 1),
        ("string_vdc", "string_vdc", 1),
    ],
)
def test_shipped_campaigns_are_what_their_headers_say(
    tmp_path: Path, folder: str, series: str, seed: int
) -> None:
    shipped = contents(DATA / folder)
    command = f"fmu-fit synthesize --series {series} --seed {seed}"
    assert f"# made by: {command}\n".encode() in shipped["campaign.toml"]
    assert call(*command.split()[2:], "--out", tmp_path / "again") == 0
    again = contents(tmp_path / "again")
    assert sorted(again) == sorted(shipped)
    for name in {"campaign.toml", "truth.toml", "experiments.csv", "sweeps.csv"} & {*shipped}:
        assert again[name].splitlines()[:2] == shipped[name].splitlines()[:2]
    for name, data in again.items():
        # transcendental functions differ in the last digit between machines: numbers, not bytes
        assert numbers(data) == pytest.approx(numbers(shipped[name]), rel=1e-9, abs=1e-9), name


def numbers(data: bytes) -> list[float]:
    found = []
    for line in data.decode().splitlines():
        for word in line.replace(",", " ").replace("[", " ").replace("]", " ").split():
            try:
                found.append(float(word))
            except ValueError:
                continue
    return found


def test_two_folders_hold_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        call("--series", "q2", "--seed", "5", "--out", tmp_path / name)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")


def test_the_command_that_files_state_makes_them_again(tmp_path: Path) -> None:
    words = ["--series", "q1", "--phases", "--restart", "3", "--restart", "2", "--noise", "0.02"]
    call(*words, "--theta", "1.9", "--no-reflection", "--out", tmp_path / "a")
    command = (tmp_path / "a" / "campaign.toml").read_text("utf-8").splitlines()[1]
    assert command.startswith("# made by: fmu-fit synthesize --series q1 --seed 1 ")
    call(*shlex.split(command)[5:], "--out", tmp_path / "b")
    assert contents(tmp_path / "a") == contents(tmp_path / "b")


def test_like_keeps_the_truth_and_draws_new_noise(tmp_path: Path) -> None:
    call("--series", "q1", "--d1", "150", "--reflection", "--drift", "20", "--out", tmp_path / "a")
    call("--like", tmp_path / "a" / "campaign.toml", "--seed", "9", "--out", tmp_path / "b")
    first, second = read_bench(tmp_path / "a" / "truth.toml"), read_bench(tmp_path / "b/truth.toml")
    assert first == second
    assert second.modes.d1_hz == 150.0
    assert second.modes.reflection is True
    assert second.drift_hz == 20.0
    peaks = [read_campaign(tmp_path / n / "campaign.toml").experiments[0].peaks_v for n in "ab"]
    assert abs(peaks[0][0] - peaks[1][0]) > 1e-9


def test_a_string_driven_hard_keeps_its_truth_too(tmp_path: Path) -> None:
    call(
        "--series",
        "duffing",
        "--alpha1",
        "2e31",
        "--kappa",
        "0",
        "--level",
        "0.3",
        "--weak-level",
        "0.03",
        "--d1",
        "150",
        "--seed",
        "4",
        "--out",
        tmp_path / "a",
    )
    call("--like", tmp_path / "a" / "campaign.toml", "--alpha2", "1e31", "--out", tmp_path / "b")
    first, second = (read_bench(tmp_path / n / "truth.toml") for n in "ab")
    assert first.sample == CubicModes(first.modes, 2e31, 0.8e32, 0.0)
    assert (max(first.levels), first.weak_level, first.modes.d1_hz) == (0.3, 0.03, 150.0)
    assert second == replace(first, sample=CubicModes(first.modes, 2e31, 1e31, 0.0))
    experiments = [read_campaign(tmp_path / n / "campaign.toml").experiments[0] for n in "ab"]
    assert len(experiments[0].peaks_v) == 4
    assert experiments[0].peaks_v[0] != experiments[1].peaks_v[0]
    assert experiments[0].written["A1"].value == pytest.approx(0.3 * 0.25 / 0.35)


def test_exact_data_hold_the_true_peaks(tmp_path: Path) -> None:
    call(
        "--series",
        "q1",
        "--noise-scale",
        "0",
        "--drift",
        "0",
        "--curvature",
        "0",
        "--out",
        tmp_path,
    )
    truth = (tmp_path / "truth.toml").read_text()
    campaign = read_campaign(tmp_path / "campaign.toml")
    for experiment in campaign.experiments:
        assert experiment.floor_v == 0.0
        for peak in experiment.peaks_v:
            assert f"{peak:.13g}"[:12] in truth


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--series", "q1", "--d1", "-3"], "damping d1 = -3.0"),
        (["--series", "q1", "--eta-plus", "9e6"], "eta_plus = 9000000.0 Hz must lie"),
        (["--series", "q1", "--noise-scale", "-1"], "noise_scale = -1.0"),
        (["--series", "q1", "--alpha1", "1e32"], "alpha1: .*'q1'"),
        (["--series", "duffing", "--cross-mode"], "lock-in"),
        (["--series", "q1", "--cross-mode", "--noise", "0.7"], "lock-ins: noise 0.7"),
        (["--series", "q1", "--noise", "0.1"], "--noise: "),
        (["--series", "notch", "--theta", "1"], "--theta: .*--series notch"),
        (["--series", "pumped", "--phases"], "--phases: .*--series pumped"),
        (["--series", "string_pumped", "--phases"], "--phases: .*--series string_pumped"),
        (["--series", "notch", "--phases"], "--phases: .*--series notch"),
        (["--series", "notch", "--modes", "3"], "--modes: .*--series notch"),
        (["--series", "q1", "--modes", "3"], "--modes: "),
        (["--series", "q1", "--restart", "3"], "--restart: .*--phases"),
        (["--series", "q1", "--phases", "--restart", "6"], "pair 6.* 2 to 5"),
        (["--series", "duffing", "--level", "-1"], "-1"),
        (["--series", "duffing", "--level", "3"], "weaker drive"),
        (["--series", "duffing", "--d1", "-3"], "d1 = -3.0"),
        (["--like", DATA / "afm_sensor" / "campaign.toml"], "truth.toml: "),
    ],
)
def test_impossible_laboratories_are_refused(
    tmp_path: Path, words: list[str | Path], message: str
) -> None:
    with pytest.raises(BadInput, match=message):
        call(*words, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_negative_seed_is_refused_by_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["synthesize", "--series", "q1", "--seed", "-1", "--out", str(tmp_path / "out")]
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "--seed: found '-1'" in err
    assert not (tmp_path / "out").exists()


def test_a_measured_campaign_is_never_overwritten(tmp_path: Path) -> None:
    original = (DATA / "afm_sensor" / "campaign.toml").read_bytes()
    (tmp_path / "campaign.toml").write_bytes(original)
    with pytest.raises(BadInput, match=r"campaign.toml: .*fmu-fit synthesize"):
        call("--series", "q1", "--out", tmp_path)
    assert contents(tmp_path) == {"campaign.toml": original}


def test_measured_data_are_kept_beside_any_campaign(tmp_path: Path) -> None:
    """One file of the laboratory among those that would be written: then none is."""
    (tmp_path / "sweep.csv").write_text("frequency (Hz),amplitude (V)\n")
    with pytest.raises(BadInput, match=r"sweep.csv: "):
        call("--series", "q1", "--out", tmp_path)
    assert list(contents(tmp_path)) == ["sweep.csv"]


def test_a_broken_truth_is_named(tmp_path: Path) -> None:
    call("--series", "q1", "--out", tmp_path)
    truth = tmp_path / "truth.toml"
    whole = truth.read_text()
    for old, new, words in [
        ("d1_hz = 120.0\n", "", "'d1_hz'"),
        ("observed = 0", "observed = 7", "mode 7"),
        ("[modes]", "[modest]", "'theta_rad'"),
        ("[bench]", "[bench", "truth.toml: .*TOML"),
    ]:
        truth.write_text(whole.replace(old, new))
        with pytest.raises(BadInput, match=words):
            call("--like", tmp_path / "campaign.toml", "--out", tmp_path / "b")


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    write_whole(path, "old")
    with pytest.raises(BadInput, match="below"):
        write_whole(path / "below", "new")
    (tmp_path / "folder").mkdir()
    with pytest.raises(BadInput, match="folder"):
        write_whole(tmp_path / "folder", "new")
    assert contents(tmp_path) == {"x.txt": b"old"}
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~mask
