"""``fmu-fit sweep``: both branches and the jumps of averaging, rounding alone in a linear FMU."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest

from fitting.cli.main import main
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run, Segment, row_times
from fitting.lab.string import TwoModes, steady_state
from fitting.text.errors import BadInput
from tests.models.test_duffing import branches, folds, one_mode
from tests.support.twins import swift_model
from tests.support.undrawn import without_figures


@pytest.fixture(scope="module")
def duffing_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return swift_model("DuffingOscillator", tmp_path_factory)


@pytest.fixture(autouse=True)
def _undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    without_figures(monkeypatch)


def options(scene: dict[str, float]) -> list[str]:
    """A scene as options; the tones are the command's own."""
    given = {name: v for name, v in scene.items() if name not in ("u1", "u2", "A2")}
    return [word for name, v in given.items() for word in ("--set", f"{name}={v!r}")]


def read(path: Path) -> dict[str, np.ndarray]:
    with path.open(encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    return dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True))


@pytest.mark.parametrize("strength", [3.0, -3.0])
def test_each_way_keeps_its_branch_up_to_the_jump_of_averaging(
    duffing_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], strength: float
) -> None:
    """Amplitudes and jumps to the order of the closed form, jumps to the grid as well."""
    scene = one_mode(strength)
    ends = sorted(folds(scene))
    reach = ends[1] - ends[0]
    low, high = ends[0] - 0.6 * reach, ends[1] + 0.6 * reach
    words = ["--from", repr(low), "--to", repr(high), "--points", "51", "--direction", "both"]
    assert main(["sweep", str(duffing_fmu), *words, *options(scene), "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    jumps = {
        way: (float(at), float(within))
        for way, at, within in re.findall(r"(\w+)ward: (\S+) ± (\S+) Hz", said)
    }
    eps = abs(strength) / 200.0
    for way, fold in (("down", ends[0]), ("up", ends[1])):
        found, within = jumps[way]
        assert abs(found - fold) <= within + 2.0 * eps * abs(fold - 1000.0), way
        assert within < 0.03 * reach
    table = read(tmp_path / "sweep.csv")
    for u, up, down in zip(*table.values(), strict=True):
        if min(abs(u - end) for end in ends) < 0.1 * reach:
            continue
        wanted = branches(scene, u)
        assert len(wanted) == (3 if ends[0] < u < ends[1] else 1)
        both = [wanted[-1], wanted[0]] if strength > 0.0 else [wanted[0], wanted[-1]]
        assert [up, down] == pytest.approx(both, rel=4.0 * eps)


def test_a_linear_fmu_has_one_curve_and_it_is_the_closed_form(
    swift_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "--from",
        "6.9401 MHz",
        "--to",
        "6.9404 MHz",
        "--points",
        "13",
        "--settle",
        "0.2 s",
        "--set",
        "theta=1.9498",
        "--set",
        "d1=120",
        "--set",
        "d2=90",
        "--set",
        "eta_plus=6940260",
        "--set",
        "eta_minus=7027600",
        "--direction",
        "both",
        "--out",
        str(tmp_path),
    ]
    assert main(["sweep", str(swift_fmu), *words]) == 0
    table = read(tmp_path / "sweep.csv")
    up, down = table["q1_hybrid up (m)"], table["q1_hybrid down (m)"]
    modes = TwoModes(
        theta_rad=1.9498, d1_hz=120.0, d2_hz=90.0, eta_plus_hz=6940260.0, eta_minus_hz=7027600.0
    )
    wanted = np.abs(steady_state(modes, table["frequency (Hz)"])[:, 0])
    assert np.abs(up - down).max() <= 1e-7 * up.max()  # rounding of phases after 2 s at 7 MHz
    assert up == pytest.approx(wanted, rel=1e-7)
    said = capsys.readouterr().out
    assert "hysteresis" not in said
    assert "A2 = 0: u2 " in said
    assert "goal 1.0e-04" in said


def test_one_way_and_the_time_that_is_found(swift_fmu: Path, tmp_path: Path) -> None:
    words = ["--from", "6.9401 MHz", "--to", "6.9404 MHz", "--points", "7", "--direction", "down"]
    assert main(["sweep", str(swift_fmu), *words, "--out", str(tmp_path)]) == 0
    table = read(tmp_path / "sweep.csv")
    assert list(table) == ["frequency (Hz)", "q1_hybrid down (m)"]
    assert (
        main(
            [
                "sweep",
                str(swift_fmu),
                *words,
                "--settle",
                "0.3",
                "--out",
                str(tmp_path / "long"),
            ]
        )
        == 0
    )
    longer = read(tmp_path / "long" / "sweep.csv")["q1_hybrid down (m)"]
    assert np.abs(table["q1_hybrid down (m)"] / longer - 1.0).max() < 1e-4


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--from", "7 MHz", "--to", "6 MHz"], "--from"),
        (["--from", "6 MHz", "--to", "7 m"], "--to"),
        (["--from", "1", "--to", "2", "--tone", "theta"], "'rad'"),
        (["--from", "1", "--to", "2", "--tone", "u3"], "u3"),
        (["--from", "1", "--to", "2", "--set", "u1=3"], "u1"),
        (["--from", "1", "--to", "2", "--set", "A2=3"], "u2 "),
        (["--from", "1", "--to", "2", "--tone", "f1"], "f1"),
        (["--from", "1", "--to", "2", "--points", "1"], "--points: "),
        (["--from", "1", "--to", "2", "--settle", "-1"], "--settle: "),
        (["--from", "1", "--to", "2", "--accuracy", "2"], "--accuracy: "),
        (["--from", "1", "--to", "2", "--set", "A1=0"], "q1_hybrid is constant"),
    ],
)
def test_what_is_no_sweep_is_refused_in_one_line(
    swift_fmu: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    message: str,
) -> None:
    out = tmp_path / "out"
    assert main(["sweep", str(swift_fmu), *words, "--out", str(out)]) == 2
    line = capsys.readouterr().err
    assert message in line
    assert line.count("\n") == 1
    assert not out.exists()


# --- what a run with segments is -----------------------------------------------------------------

VALUES = {"theta": 1.9498, "d1": 120.0, "u1": 6940250.0, "A2": 0.0}


def test_segments_to_the_same_value_are_a_run_that_goes_on(swift_fmu: Path) -> None:
    with FmuWorkers(swift_fmu) as workers:
        whole = Run(
            start_values=VALUES,
            settle_s=1e-3,
            sample_step_s=1e-4,
            samples=12,
            outputs=("q1_hybrid",),
        )
        segments = (
            Segment(value=6940250.0, settle_s=1e-4, sample_step_s=1e-4, samples=3),
            Segment(value=6940250.0, settle_s=1e-4, sample_step_s=1e-4, samples=5),
        )
        parted = Run(
            start_values=VALUES,
            settle_s=1e-3,
            sample_step_s=1e-4,
            samples=4,
            outputs=("q1_hybrid",),
            moved="u1",
            segments=segments,
        )
        one, other, again = workers.run([whole, parted, parted])
    assert parted.rows == 12
    assert row_times(parted) == pytest.approx(row_times(whole), rel=1e-12)
    assert np.abs(one - other).max() < 1e-6 * np.abs(one).max()  # of times that round otherwise
    assert other.tolist() == again.tolist()


def test_a_moved_tone_is_followed_without_a_leap(swift_fmu: Path) -> None:
    """Right after a move the displacement is what it was; long after it is the other tone's."""
    modes = TwoModes(
        theta_rad=1.9498, d1_hz=120.0, d2_hz=90.0, eta_plus_hz=6940260.0, eta_minus_hz=7027600.0
    )
    values = VALUES | {"d2": 90.0, "eta_plus": 6940260.0, "eta_minus": 7027600.0}
    segments = (
        Segment(value=6940310.0, settle_s=1e-10, sample_step_s=1e-9, samples=1),
        Segment(value=6940310.0, settle_s=0.2, sample_step_s=1e-9, samples=1000),
    )
    with FmuWorkers(swift_fmu) as workers:
        run = Run(
            start_values=values,
            settle_s=0.2,
            sample_step_s=1.0,
            samples=1,
            outputs=("q1_hybrid",),
            moved="u1",
            segments=segments,
        )
        rows = workers.run([run])[0][:, 0]
    amplitudes = np.abs(steady_state(modes, np.array([6940250.0, 6940310.0]))[:, 0])
    assert abs(rows[1] - rows[0]) < 2 * math.pi * 7e6 * 1.1e-10 * amplitudes[0]
    assert np.abs(rows[2:]).max() == pytest.approx(amplitudes[1], rel=1e-4)


def test_segments_that_cannot_be_are_refused(swift_fmu: Path) -> None:
    segments = (Segment(value=1.0, settle_s=0.0, sample_step_s=1.0, samples=1),)
    with pytest.raises(BadInput, match="u1"):
        Run(
            start_values={},
            settle_s=0.0,
            sample_step_s=1.0,
            samples=1,
            outputs=("q1_hybrid",),
            moved="u1",
            segments=segments,
        )
    with pytest.raises(BadInput, match="nan"):
        Segment(value=math.nan, settle_s=0.0, sample_step_s=1.0, samples=1)
    with FmuWorkers(swift_fmu) as workers, pytest.raises(BadInput, match="reflection"):
        workers.run(
            [
                Run(
                    start_values={"reflection": True},
                    settle_s=0.0,
                    sample_step_s=1.0,
                    samples=1,
                    outputs=("q1_hybrid",),
                    moved="reflection",
                    segments=segments,
                )
            ]
        )
