"""What the command answers to wrong input and to FMUs that fail: message, exit code, files left.

One small campaign (a driven oscillator in C, two experiments with spectra, a sweep) is broken in
one place at a time. How each reader and the workers complain is tested with them; here is what a
user sees: one line on stderr, an exit code, and no half-written file.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from fitting.cli.main import main
from fitting.text.results_folder import RECORD_NAME, results_folder, write_whole
from tests.support.cfmu_build import build_c_fmu
from tests.support.oscillator_campaign import CAMPAIGN, FILES

ROOT = Path(__file__).parents[2]
QUICKLY = ("--workers", "1", "--no-report", "--no-profiles")


@pytest.fixture(scope="session")
def oscillator_c(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return build_c_fmu(tmp_path_factory.mktemp("c")).read_bytes()


@pytest.fixture
def folder(tmp_path: Path, oscillator_c: bytes) -> Path:
    """The campaign, unbroken."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "oscillator.fmu").write_bytes(oscillator_c)
    return tmp_path


def broken(folder: Path, name: str, old: str, new: str) -> None:
    """Replace a text that stands in the file."""
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new, 1))


def left_in(out: Path) -> list[str]:
    files = (p for p in out.rglob("*") if p.is_file() and p.name != RECORD_NAME)
    return sorted(str(p.relative_to(out)) for p in files)


def refused(
    folder: Path, capsys: pytest.CaptureFixture[str], code: int = 2, left: tuple[str, ...] = ()
) -> str:
    """The one line of complaint of a run that has to end with this code and leave these files.

    Where finished levels are left, a second line says how to go on.
    """
    out = folder / "out"
    words = ["reconstruct", str(folder / "campaign.toml"), "--out", str(out), *QUICKLY]
    assert main(words) == code
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith("fmu-fit: ")
    assert told.err.endswith("\n")
    assert told.err.count("\n") == 1 + ("checkpoint.jsonl" in left)
    assert ("--resume" in told.err) == ("checkpoint.jsonl" in left)
    assert "Traceback" not in told.err
    assert left_in(out) == list(left)
    return told.err


def test_the_campaign_is_fitted_while_nothing_is_broken(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["reconstruct", str(folder / "campaign.toml"), "--out", str(folder / "out")]
    assert main([*words, *QUICKLY]) == 0
    assert capsys.readouterr().err == ""
    assert left_in(folder / "out") == ["history.csv", "result.json"]


TOML, EXPERIMENTS, SWEEP, TWO = "campaign.toml", "experiments.csv", "sweep.csv", "two.csv"
FIRST = "frequency (Hz),amplitude (mV)\n"

WRONG = {
    # what is wrong: file, text, its replacement, words of the message
    "missing file": (TOML, "sweep.csv", "swep.csv", ["swep.csv", "'sweep.csv'"]),
    "missing spectrum": (EXPERIMENTS, "two,", "too,", ["too.csv", "'two.csv'"]),
    "missing FMU": (TOML, "oscillator.fmu", "absent.fmu", ["absent.fmu"]),
    "missing column": (EXPERIMENTS, "f (Hz)", "g (Hz)", ["experiments.csv", "column 'f'"]),
    "missing unit": (SWEEP, "(mV)", "", ["sweep.csv", "'amplitude'", "unit"]),
    "wrong unit": (SWEEP, "(mV)", "(kg)", ["sweep.csv", "'amplitude'", "'kg'"]),
    "NaN": (SWEEP, FIRST, FIRST + "291,NaN\n", ["sweep.csv: row 2, column 'amplitude'", "'NaN'"]),
    "text": (SWEEP, FIRST, FIRST + "291,low\n", ["sweep.csv: row 2, column 'amplitude'", "'low'"]),
    "text in a spectrum": (TWO, "\n", "\nx,1\n", ["two.csv: row 2", "'frequency'", "'x'"]),
    "negative amplitude": (SWEEP, FIRST, FIRST + "291,-2\n", ["row 2", "-2 mV"]),
    "unsorted": (SWEEP, FIRST, FIRST + "400,1\n", ["row 3", "292 Hz", "400"]),
    "duplicated": (SWEEP, FIRST, FIRST + "292,1\n", ["row 3", "292 Hz", "twice"]),
    "tone not in the spectrum": (
        EXPERIMENTS,
        ",330",
        ",390",
        ["two.csv", "tone 390 Hz", "305", "355"],
    ),
    "no line at the tone": (EXPERIMENTS, ",330", ",340", ["two.csv", "tone 340 Hz"]),
    "tone without a number": (EXPERIMENTS, ",330", ",fast", ["row 3", "column 'f'", "'fast'"]),
    "bounds reversed": (TOML, "upper = 0.6", "upper = 0.01", ["'damping'", "lower = 0.05"]),
    "start outside": (TOML, "start = 0.25", "start = 9", ["'damping'", "start = 9.0"]),
    "unknown parameter": (
        TOML,
        '"damping"',
        '"dampning"',
        ["'dampning'", "'damping'"],
    ),
    "unknown output": (TOML, '"displacement"', '"position"', ["[observe] output", "'position'"]),
    "unknown start value": (TOML, "mass =", "weight =", ["[fmu.start] weight"]),
    "unit of a parameter": (TOML, '"N/m"', '"N/s"', ["'stiffness'", "'N/s'", "'N/m'"]),
    "unit of a start value": (TOML, '"1 g"', '"1 s"', ["mass: ", "'s'", "'kg'"]),
    "no unit at all": (TOML, '"3 kHz"', "3000", ["[observe] line_width: 3000", "unit"]),
    "unknown key": (TOML, "timeout_s", "time_out", ["[fmu]: ", "'time_out'", "timeout_s"]),
    "noise of the sweep": (
        TOML,
        "[sweep]\n",
        '[sweep]\nsigma = "1 uV"\n',
        ["[sweep]: unknown key 'sigma'", "[noise] absolute or relative"],
    ),
    "not TOML": (TOML, "[fmu]", "[fmu", ["campaign.toml: ", "TOML", "line 2"]),
    "decimal comma": (
        TOML,
        "start = 0.25",
        "start = 0,25",
        ["campaign.toml: ", "TOML", "0.25"],
    ),
    "misspelt table": (TOML, "[sweep]", "[swep]", ["'swep'", "'sweep'"]),
    "not an FMU": (TOML, "oscillator.fmu", "sweep.csv", ["sweep.csv: ", "FMU"]),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_input_is_one_line_and_exit_code_2(
    what: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, old, new, words = WRONG[what]
    broken(folder, name, old, new)
    said = refused(folder, capsys)
    assert str(folder) in said
    for word in words:
        assert word in said


def test_everything_that_is_wrong_is_told_at_once(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A line for each key of the campaign; once that is right, for each of its data files."""
    for old, new in (
        ("timeout_s = 60", 'timeout_s = "long"'),
        ("[observe]\n", "[observe]\nsteady = true\n"),
        ('"3 kHz"', '"3 s"'),
        ("upper = 0.6\n", ""),
        ("iterations = 1", "iterations = 0"),
    ):
        broken(folder, TOML, old, new)
    words = ["reconstruct", str(folder / TOML), "--out", str(folder / "out"), *QUICKLY]
    assert main(words) == 2
    path = folder / TOML
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith(f"fmu-fit: {path}: ") for line in lines)
    tokens = (
        ("[fmu] timeout_s", "'long'"),
        ("[observe]", "'steady'", "'steady_start'"),
        ("[observe] line_width", "'s'", "'Hz'"),
        ("[parameters 'damping']", "'upper'"),
        ("[continuation] iterations", "0", "1000"),
    )
    assert len(lines) == len(tokens)
    for named in tokens:
        assert sum(all(token in line for token in named) for line in lines) == 1, named
    path.write_text(CAMPAIGN)
    broken(folder, EXPERIMENTS, "one,", "on,")
    broken(folder, TWO, "\n", "\nx,1\n")
    broken(folder, SWEEP, FIRST, FIRST + "291,NaN\n")
    assert main(words) == 2
    told = capsys.readouterr().err.splitlines()
    places = ["on.csv: ", "two.csv: row 2", "sweep.csv: row 2"]
    assert len(told) == len(places)
    assert all(place in line for place, line in zip(places, told, strict=True))
    assert left_in(folder / "out") == []


def test_a_flood_of_complaints_is_counted(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "".join(f"{name},{300 + name}\n" for name in range(30))
    (folder / EXPERIMENTS).write_text(f"experiment,f (Hz)\n{rows}")
    assert main(["reconstruct", str(folder / TOML), "--out", str(folder / "out"), *QUICKLY]) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 21
    assert re.findall(r"\d+", told[-1]) == ["10"]


def test_a_missing_campaign_and_too_few_points(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sweep = (folder / SWEEP).read_text()
    (folder / SWEEP).write_text(FIRST + "300,1\n310,2\n320,1\n330,0.5\n")
    assert "sweep.csv: 4 points" in refused(folder, capsys)
    (folder / SWEEP).write_text(sweep)
    (folder / TWO).write_text(FIRST + "329,0.1\n330,9\n")
    assert re.search(r"two\.csv: 2 points.* 3$", refused(folder, capsys), re.MULTILINE)
    (folder / TOML).rename(folder / "campaing.toml")
    said = refused(folder, capsys)
    assert "campaign.toml: " in said
    assert "'campaing.toml'" in said


def test_an_fmu_without_a_binary_for_this_platform(
    folder: Path, capsys: pytest.CaptureFixture[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    foreign = build_c_fmu(tmp_path_factory.mktemp("foreign"), platform="plan9")
    (folder / "oscillator.fmu").write_bytes(foreign.read_bytes())
    said = refused(folder, capsys)
    for token in ("oscillator.fmu: ", "binaries/", "plan9"):
        assert token in said


FAILING = {
    # values of `misbehave` in cfmus/model.h, and the FMU's words
    "hangs": (1, ["1.5 s"]),
    "segfaults": (2, ["SIGSEGV", "about to crash"]),
    "returns NaN": (3, ["displacement is nan", "lost the state"]),
    "stops early": (4, ["t = ", "fmi2DoStep", "'discard'"]),
    "refuses to start": (5, ["fmi2EnterInitializationMode", "'error'", "told to fail"]),
    "raises in a step": (6, ["fmi2DoStep", "t = 0.0 s", "'error'", "cannot step"]),
    "aborts": (10, ["SIGABRT", "assertion of the solver"]),
}


@pytest.mark.parametrize("how", FAILING)
def test_an_fmu_that_fails_is_exit_code_3_with_its_words(
    how: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    number, words = FAILING[how]
    if how == "hangs":  # in its first run: no other can be late on a busy machine
        broken(folder, TOML, "timeout_s = 60", "timeout_s = 1.5")
    broken(folder, TOML, 'mass = "1 g"', f'mass = "1 g"\nmisbehave = {number}')
    said = refused(folder, capsys, code=3)
    for word in ["oscillator.fmu: ", *words, "[with ", f"misbehave = {number}", "mass = 0.001"]:
        assert word in said
    found = re.search(r"damping = ([0-9.e-]+)", said)
    assert found is not None
    assert 0.05 <= float(found[1]) <= 0.6


def test_the_projects_own_model_says_why(
    folder: Path, oscillator_fmu: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Negative damping has no periodic orbit to start on."""
    (folder / "oscillator.fmu").write_bytes(oscillator_fmu.read_bytes())
    text = (folder / TOML).read_text()
    head, _, rest = text.partition("[observe]")
    _, _, rest = rest.partition("[experiments]")
    rest, _, _ = rest.partition("[[parameters]]")
    drive = '[drive]\nkind = "tones"\nfrequencies = ["u1"]\namplitudes = ["A1"]\n'
    observe = '[observe]\noutput = "q1_hybrid"\nsteady_start = true\n'
    own = '[[parameters]]\nname = "theta"\nunit = "rad"\nlower = -1.0\nupper = 1.0\nstart = 0.5\n'
    head = head.replace('mass = "1 g"', "periodic_start = true\nd1 = -5.0\neta_plus = 322.0\n")
    head += "eta_minus = 500.0\nA2 = 0.0\n"
    (folder / TOML).write_text(f"{head}{observe}{drive}[experiments]{rest}{own}")
    broken(folder, EXPERIMENTS, "f (Hz)", "u1 (Hz)")
    said = refused(folder, capsys, code=3)
    for word in ("d1 = -5.0", "theta = ", "[with "):
        assert word in said


def test_a_failure_midway_leaves_nothing_half_written(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second alternative fails; no level of Algorithm 2 was finished before."""
    broken(folder, TOML, "[continuation]", "[alternatives]\nmisbehave = [0, 6]\n[continuation]")
    assert "misbehave = 6" in refused(folder, capsys, code=3)


def test_old_results_survive_a_run_that_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "out"
    with results_folder(out, "reconstruct"):  # as if an earlier run had written it
        write_whole(out / "result.json", "{}")
    broken(folder, SWEEP, "(mV)", "(kg)")
    refused(folder, capsys, left=("result.json",))
    assert (out / "result.json").read_text() == "{}"


def test_the_program_itself_ends_so(folder: Path) -> None:
    """As a process: exit code, one line on stderr, nothing on stdout."""
    broken(folder, SWEEP, FIRST, FIRST + "291,NaN\n")
    out = folder / "out"
    words = [sys.executable, "-m", "fitting", "reconstruct", str(folder / TOML), "--out", str(out)]
    words += QUICKLY
    told = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, check=False)
    assert told.returncode == 2
    assert told.stdout == ""
    assert told.stderr.startswith(f"fmu-fit: {folder}/sweep.csv: row 2, column 'amplitude': ")
    assert "'NaN'" in told.stderr
    assert told.stderr.count("\n") == 1
    assert not out.exists()


def test_a_value_from_elsewhere_in_a_wrong_unit_is_refused_before_the_fit(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "out"
    words = ["reconstruct", str(folder / TOML), "--out", str(out), *QUICKLY, "--external"]
    assert main([*words, "stiffness=3 kHz"]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert "--external stiffness: " in told.err
    assert "N/m" in told.err
    assert not out.exists()
