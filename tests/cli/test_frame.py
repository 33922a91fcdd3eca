"""What holds for every command: help with an example, one line of complaint, exit codes."""

from __future__ import annotations

import argparse
import errno
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import fitting
from fitting.cli.help import WIDTH
from fitting.cli.main import main
from fitting.cli.words.parser import COMMANDS, command_of, parsed

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_an_example_that_parses(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ending:
        main([name, "--help"])
    assert ending.value.code == 0
    text = " ".join(capsys.readouterr().out.split())
    example = command_of(name).EXAMPLE
    assert f"example: {example}" in text
    assert example.startswith(f"fmu-fit {name} ")
    assert "`" not in text
    for absent in ("README", "data/", "build/"):  # an installed wheel has none of them
        assert absent not in text, f"{name} --help names {absent}"
    for action in positionals(name):
        assert action.help, f"{name} {action.metavar} has no description"


def positionals(name: str) -> list[argparse.Action]:
    parser = argparse.ArgumentParser()
    command_of(name).add_arguments(parser)
    return [action for action in parser._actions if not action.option_strings]


def test_general_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    text = capsys.readouterr().out
    first_words = {line.split()[0] for line in text.splitlines() if line.strip()}
    assert first_words >= set(COMMANDS)
    told = (
        (ROOT / "docs" / "reference" / "exit-codes.md")
        .read_text("utf-8")
        .partition("| exit code | meaning |")[2]
    )
    codes = re.findall(r"^\| (\d+) \| ", told.partition("\n\n")[0], re.MULTILINE)
    assert codes == ["0", "1", "2", "3", "4", "70", "130"]
    unbroken = " ".join(text.split())
    for code in codes:
        assert re.search(rf"\b{code} [a-z]", unbroken), f"exit code {code} is not told"


def test_without_a_command_each_is_listed_with_an_example(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([]) == 0
    text = capsys.readouterr().out
    for name, summary in COMMANDS.items():
        assert f"{name} " in text
        assert summary in text
        assert command_of(name).EXAMPLE in text


@pytest.mark.parametrize(
    ("topic", "words"),
    [
        ("control-sweep", "# "),
        ("campaign", "# campaign.toml"),
        ("how-to/campaign", "# "),
        ("line", "usage: fmu-fit line"),
    ],
)
def test_help_prints_a_page(topic: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(["help", topic])
    except SystemExit as ending:  # of the options of a command
        code = int(str(ending.code))
    text = capsys.readouterr().out
    assert code == 0
    assert text.startswith(words)
    assert "<!--" not in text


def test_help_prints_tables_and_links_for_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    for path in (ROOT / "docs").glob("*/*.md"):
        assert main(["help", f"{path.parent.name}/{path.stem}"]) == 0
        text = re.sub(r"```.*?```", "", capsys.readouterr().out, flags=re.DOTALL)
        assert "](" not in text, path
        assert not re.search(r"^\|", text, re.MULTILINE), path
        assert all(len(line) <= WIDTH for line in text.splitlines() if line.startswith("- ")), path


@pytest.mark.parametrize(
    ("word", "places"),
    [
        ("laws", [r"campaign +\[laws\]", "python +ff.Laws", "findings +law_followed"]),
        ("noise", ["noise-spectra +Fit a noise spectrum", r"campaign +\[noise\]"]),
        ("slip", ["model +The paper's slips"]),
    ],
)
def test_help_finds_pages_by_a_word(
    word: str, places: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["help", word]) == 0
    lines = capsys.readouterr().out.splitlines()
    for place in places:
        assert any(re.match(place, line) for line in lines), place
    assert all(len(line) <= WIDTH for line in lines)
    assert main(["help", "xyzzy"]) == 2
    assert main(["help", ""]) == 2


@pytest.mark.parametrize(
    "words",
    [
        "design c.toml --candidates a.toml --candidates b.toml",
        "simulate CoupledOscillator --out a --samples 8 --samples=8",
        "line a.csv --shape fano --shape duffing",
    ],
)
def test_a_value_is_given_once(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words.split()) == 2
    option = re.findall(r"--\w+", words)[-1]
    assert f"{option}: is given twice, wanted once" in capsys.readouterr().err
    # what may be repeated still may
    assert parsed(["simulate", "FMU", "--set", "a=1", "--set", "b=2"]).set == ["a=1", "b=2"]


def test_help_lists_every_page(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["help"]) == 0
    rows = capsys.readouterr().out.splitlines()[2:]  # a sentence comes first
    assert len(rows) == len(list((ROOT / "docs").glob("*/*.md")))
    assert main(["help", "control-swep"]) == 2
    assert "did you mean 'control-sweep'?" in capsys.readouterr().err


def test_every_page_that_the_program_names_is_there() -> None:
    pages = {path.stem for path in (ROOT / "docs").glob("*/*.md")}
    texts = [
        path.read_text("utf-8")
        for path in (ROOT / "fitting").rglob("*.*")
        if path.suffix in (".py", ".j2")
    ]
    named = {name for text in texts for name in re.findall(r"fmu-fit help ([a-z][\w/-]*)", text)}
    assert named
    assert named <= {*pages, *COMMANDS}
    assert not [text for text in texts if "docs/how-to/" in text or "docs/reference/" in text]


def test_help_and_complaints_take_no_library() -> None:
    """In one interpreter, that of all commands: what one of them loads is loaded for all."""
    asked = [
        [],
        ["--help"],
        ["--version"],
        ["frobnicate"],
        ["help"],
        ["help", "traces"],
        *([name, "--help"] for name in COMMANDS),
    ]
    asked += [["reconstruct", "--starts", "0"], ["synthesize", "--series", "q3"]]
    script = (
        "import contextlib, sys\n"
        "before = {name.partition('.')[0] for name in sys.modules}\n"
        "from fitting.cli.main import main\n"
        f"for words in {asked!r}:\n"
        "    with contextlib.suppress(SystemExit):\n        main(words)\n"
        "    loaded = {name.partition('.')[0] for name in sys.modules} - before\n"
        "    if taken := loaded - sys.stdlib_module_names - {'fitting'}:\n"
        "        sys.exit(f'{words}: {taken}')\n"
        "sys.exit('none')"
    )
    told = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert told.stderr.splitlines()[-1] == "none"


def test_what_only_a_search_or_a_figure_needs_is_not_loaded_before() -> None:
    """Each of them takes a third of a second of processor time, and more."""
    heavy = ("scipy.stats", "matplotlib", "mpmath", "tqdm", "shtab")
    script = (
        "import sys, fitting.cli.running.reconstruction; "
        f"print([name for name in {heavy!r} if name in sys.modules])"
    )
    asked = [sys.executable, "-c", script]
    loaded = subprocess.run(asked, capture_output=True, text=True, cwd=ROOT, check=True)
    assert loaded.stdout == "[]\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["frobnicate"], "frobnicate"),
        (["reconstrct"], "'reconstrct'; did you mean 'reconstruct'?"),
        (["sweep", "a.fmu", "--form", "1"], "'--form'; did you mean '--from'?"),
        (["check", "a.fmu", "--tiemout=3 s"], "'--tiemout'; did you mean '--timeout'?"),
        (["simulate"], "FMU"),
        (["check", "absent.fmu"], "absent.fmu: "),
        (["check", "Absent"], "'Absent'"),
        (["check", "absent.fmu", "--step", "long"], "--step"),
        (["check", "absent.fmu", "--timeout", "-1"], "--timeout: found '-1'"),
        (["reconstruct", "c.toml", "--workers", "0"], "--workers: found '0'"),
        (["reconstruct", "c.toml", "--workers", "-2"], "--workers: found '-2'"),
        (["reconstruct", "c.toml", "--starts", "-3"], "--starts: found '-3'"),
        (["reconstruct", "c.toml", "--starts", "0"], "--starts: found '0'"),
        (["reconstruct", "c.toml", "--seed", "-3"], "--seed: found '-3'"),
        (["reconstruct", "c.toml", "--seed", "1.5"], "--seed: found '1.5'"),
        (["synthesize", "--series", "q1", "--out", "o", "--seed", "-3"], "--seed: found '-3'"),
        (["simulate", "absent.fmu", "--out", "o", "--timeout", "nan"], "--timeout: found 'nan'"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith("fmu-fit: ")
    assert told.err.count("\n") == 1
    assert words in told.err


def test_module_is_the_command(tmp_path: Path) -> None:
    asked = [sys.executable, "-m", "fitting", "--version"]
    told = subprocess.run(asked, capture_output=True, text=True, cwd=ROOT, check=True)
    assert told.stdout == f"fmu-fit {fitting.__version__}\n"


@pytest.mark.nightly
def test_output_into_a_closed_pipe_is_no_traceback(swift_fmu: Path) -> None:
    script = f"'{sys.executable}' -m fitting check '{swift_fmu}' | head -n 1"
    told = subprocess.run(
        ["sh", "-c", script], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert "CoupledOscillator" in told.stdout
    assert told.stderr == ""


def test_a_reader_that_has_seen_enough_does_not_stop_the_work(tmp_path: Path) -> None:
    """The pipe is closed before anything is written into it; the files are there all the same."""
    taken, given = os.pipe()
    os.close(taken)
    asked = [sys.executable, "-m", "fitting", "example", "string_q1", "--out", str(tmp_path / "o")]
    told = subprocess.run(asked, stdout=given, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    os.close(given)
    assert (told.returncode, told.stderr) == (0, "")
    assert (tmp_path / "o" / "campaign.toml").is_file()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has a device that is full")
@pytest.mark.parametrize(
    ("where", "code", "words"),
    [
        (">/dev/full", 2, "fmu-fit: standard output: .*\n"),
        pytest.param(">&-", 0, "", marks=pytest.mark.nightly),
        pytest.param("2>&-", 0, "", marks=pytest.mark.nightly),
        pytest.param("2>/dev/full", 0, "", marks=pytest.mark.nightly),
        (">&- 2>&- <&-", 0, ""),
    ],
)
def test_standard_streams_that_are_closed_or_full(
    where: str, code: int, words: str, swift_fmu: Path
) -> None:
    """The check runs a worker process, whose pipe must not become the standard output."""
    script = f"'{sys.executable}' -m fitting check '{swift_fmu}' {where}"
    told = subprocess.run(["sh", "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert told.returncode == code
    assert re.fullmatch(words, told.stderr)


def test_a_fault_of_the_program_is_a_line_and_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(args: argparse.Namespace) -> int:
        raise ZeroDivisionError("over\nnothing")

    monkeypatch.setattr("fitting.cli.example.run", fails)
    assert main(["example", "string_q1", "--out", str(tmp_path)]) == 70
    told = capsys.readouterr()
    [kept] = tmp_path.iterdir()
    assert told.out == ""
    assert "ZeroDivisionError: over nothing; " in told.err
    assert str(kept) in told.err
    assert told.err.count("\n") == 1
    first, *rest = kept.read_text("utf-8").splitlines()
    assert first.split() == ["fmu-fit", "example", "string_q1", "--out", str(tmp_path)]
    text = "\n".join(rest)
    assert "Traceback" in text
    assert "in fails" in text


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError(), "not enough memory"),
        (RuntimeError(os.strerror(errno.EAGAIN)), "not enough memory"),
        (OSError(errno.ENOSPC, "No space left on device", "/tmp/x"), "/tmp/x: No space left"),
        (OSError(errno.EMFILE, "Too many open files"), "ulimit -n"),
        (ImportError("x.so: failed to map segment from shared object"), "x.so: failed to map"),
    ],
)
def test_what_the_machine_refuses_is_no_fault_of_the_program(
    error: Exception,
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(args: argparse.Namespace) -> int:
        raise error

    monkeypatch.setattr("fitting.cli.example.run", fails)
    assert main(["example", "string_q1", "--out", str(tmp_path)]) == 2
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
