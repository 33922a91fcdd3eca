"""Every command keeps what it did not write, and says so before it begins to work."""

from __future__ import annotations

import os
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import pytest

from fitting.cli.main import main
from fitting.cli.running.output import writes
from fitting.text.results_folder import remove_earlier, results_folder, write_whole

Q1 = Path(__file__).parents[2] / "data" / "string_q1" / "campaign.toml"
COMMANDS = {
    "reconstruct": ([str(Q1)], "result.json"),
    "identify": ([str(Q1)], "identify.json"),
    "design": ([str(Q1)], "campaign/experiments.csv"),
    "simulate": (["no.fmu"], "peaks.csv"),
    "sweep": (["no.fmu", "--from", "6 MHz", "--to", "7 MHz"], "sweep.csv"),
    "synthesize": (["--series", "q1"], "spectra/pair3.csv"),
    "tradeoff": ([], "tradeoff.csv"),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_of_the_laboratory_is_kept(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words, name = COMMANDS[command]
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("measured")
    assert main([command, *words, "--out", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"fmu-fit: {path}: ")
    assert f"fmu-fit {command} " in err
    assert "(--out)" in err
    assert err.count("\n") == 1
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == [path]
    assert path.read_text() == "measured"


#: What stands where a command would write its figures, when its work is done.
OBSTACLES: dict[str, Callable[[Path], None]] = {
    "a file": Path.touch,
    "a link to a file": lambda path: path.symlink_to(Q1),
    "a link to nothing": lambda path: path.symlink_to("nothing"),
    "a link to itself": lambda path: path.symlink_to(path.name),
}


@pytest.mark.parametrize("obstacle", OBSTACLES)
@pytest.mark.parametrize("command", ["reconstruct", "identify", "design", "tradeoff"])
def test_what_stands_where_figures_go_is_told_before_the_work(
    command: str, obstacle: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    OBSTACLES[obstacle](path := tmp_path / "figures")
    words = COMMANDS[command][0]
    assert main([command, *words, "--out", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith(f"fmu-fit: {path}")
    assert [p.name for p in tmp_path.iterdir()] == ["figures"]


def test_a_folder_that_takes_no_files_is_told_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (path := tmp_path / "figures").mkdir()
    monkeypatch.setattr(os, "access", lambda place, mode: Path(place) != path)  # root may all
    assert main(["reconstruct", str(Q1), "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith(f"fmu-fit: {path}: ")


@pytest.mark.parametrize("command", COMMANDS)
def test_while_another_command_writes_there_it_is_refused(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Another process, or as here another thread of this one, has the folder open."""
    codes: list[int] = []
    words = [command, *COMMANDS[command][0], "--out", str(tmp_path)]
    with results_folder(tmp_path, "sweep"):
        other = Thread(target=lambda: codes.append(main(words)))
        other.start()
        other.join()
    assert codes == [2]
    err = capsys.readouterr().err
    assert err.startswith(f"fmu-fit: {tmp_path}: ")
    assert "(--out)" in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_report_that_goes_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Beside a new result it would be taken for its report; nothing is said where none was."""

    @writes("reconstruct", "result.json", "report.html", "values.csv", "figures/*.png")
    def run(args: Namespace) -> int:
        write_whole(tmp_path / "result.json", str(args.number))
        if args.report:
            write_whole(tmp_path / "report.html", "what was found")
            write_whole(tmp_path / "values.csv", "numbers")
            (tmp_path / "figures").mkdir(exist_ok=True)
            for name in ("a", "b"):
                write_whole(tmp_path / "figures" / f"{name}.png", "drawn")
        remove_earlier(tmp_path, ("report.html", "values.csv", "figures/*.png"))
        return 0

    said = []
    for number, report in enumerate((False, True, True, False, False)):
        assert run(Namespace(out=tmp_path, number=number, report=report)) == 0
        said.append(capsys.readouterr().out)
    assert str(tmp_path) in said[3]
    assert "figures/a.png, figures/b.png, report.html, values.csv" in said[3]
    assert said[3].count("\n") == 1
    assert said[:3] + said[4:] == [""] * 4
