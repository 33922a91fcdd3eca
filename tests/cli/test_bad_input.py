"""What the command answers to wrong input and to FMUs that fail: message, exit code, files left.

One small campaign (a driven oscillator in C, two experiments with spectra, a sweep) is broken in
one place at a time. How each reader and the workers complain is tested with them; here is what a
user sees: one line on stderr, an exit code, and no half-written file.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from fitting.cli.main import main
from fitting.text.files import write_whole
from fitting.text.results_folder import RECORD_NAME, results_folder
from tests.support.cfmu_build import build_c_fmu
from tests.support.oscillator_campaign import CAMPAIGN, FILES

ROOT = Path(__file__).parents[2]


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
    words = ["reconstruct", str(folder / "campaign.toml"), "--out", str(out), "--workers", "1"]
    assert main(words) == code
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith("fmu-fit: ")
    assert told.err.endswith("\n")
    assert told.err.count("\n") == 1 + ("checkpoint.json" in left)
    assert ("--resume" in told.err) == ("checkpoint.json" in left)
    assert "Traceback" not in told.err
    assert left_in(out) == list(left)
    return told.err


def test_the_campaign_is_fitted_while_nothing_is_broken(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["reconstruct", str(folder / "campaign.toml"), "--out", str(folder / "out")]
    assert main([*words, "--workers", "1", "--no-report", "--no-profiles"]) == 0
    assert capsys.readouterr().err == ""
    assert left_in(folder / "out") == ["history.csv", "result.json"]


TOML, EXPERIMENTS, SWEEP, TWO = "campaign.toml", "experiments.csv", "sweep.csv", "two.csv"
FIRST = "frequency (Hz),amplitude (mV)\n"

WRONG = {
    # what is wrong: file, text, its replacement, words of the message
    "missing file": (TOML, "sweep.csv", "swep.csv", ["swep.csv: no such file", "'sweep.csv'"]),
    "missing spectrum": (EXPERIMENTS, "two,", "too,", ["too.csv: no such file", "'two.csv'"]),
    "missing FMU": (TOML, "oscillator.fmu", "absent.fmu", ["absent.fmu", "wanted an FMU file"]),
    "missing column": (EXPERIMENTS, "f (Hz)", "g (Hz)", ["experiments.csv", "no column 'f'"]),
    "missing unit": (SWEEP, "(mV)", "", ["sweep.csv", "'amplitude' has no unit in its header"]),
    "wrong unit": (SWEEP, "(mV)", "(kg)", ["sweep.csv", "'amplitude'", "found unit 'kg'"]),
    "NaN": (SWEEP, FIRST, FIRST + "291,NaN\n", ["sweep.csv: row 2, column 'amplitude'", "'NaN'"]),
    "text": (SWEEP, FIRST, FIRST + "291,low\n", ["sweep.csv: row 2, column 'amplitude'", "'low'"]),
    "text in a spectrum": (TWO, "\n", "\nx,1\n", ["two.csv: row 2, column 'frequency'", "'x'"]),
    "negative amplitude": (SWEEP, FIRST, FIRST + "291,-2\n", ["row 2", "negative amplitude -2 mV"]),
    "unsorted": (SWEEP, FIRST, FIRST + "400,1\n", ["row 3: frequency 292 Hz follows 400"]),
    "duplicated": (SWEEP, FIRST, FIRST + "292,1\n", ["row 3: frequency 292 Hz appears twice"]),
    "tone not in the spectrum": (
        EXPERIMENTS,
        ",330",
        ",390",
        ["two.csv: does not contain the tone", "its points run from"],
    ),
    "no line at the tone": (EXPERIMENTS, ",330", ",340", ["two.csv: no peak at the tone"]),
    "tone without a number": (EXPERIMENTS, ",330", ",fast", ["row 3, column 'f': found 'fast'"]),
    "bounds reversed": (TOML, "upper = 0.6", "upper = 0.01", ["'damping'", "lower = 0.05 is not"]),
    "start outside": (TOML, "start = 0.25", "start = 9", ["'damping'", "start = 9.0 lies outside"]),
    "unknown parameter": (
        TOML,
        '"damping"',
        '"dampning"',
        ["no variable 'dampning'", "did you mean 'damping'?"],
    ),
    "unknown output": (TOML, '"displacement"', '"position"', ["[observe] output", "'position'"]),
    "unknown start value": (TOML, "mass =", "weight =", ["[fmu.start] weight", "no variable"]),
    "unit of a parameter": (TOML, '"N/m"', '"N/s"', ["'stiffness'", "found unit 'N/s'", "'N/m'"]),
    "unit of a start value": (TOML, '"1 g"', '"1 s"', ["mass: found unit 's', wanted 'kg'"]),
    "no unit at all": (TOML, '"3 kHz"', "3000", ["[observe] line_width: 3000 has no unit"]),
    "unknown key": (TOML, "timeout_s", "time_out", ["[fmu]: unknown key 'time_out'", "timeout_s"]),
    "not TOML": (TOML, "[fmu]", "[fmu", ["campaign.toml: not valid TOML", "line 2"]),
    "decimal comma": (
        TOML,
        "start = 0.25",
        "start = 0,25",
        ["not valid TOML", "a point, not a comma: 0.25"],
    ),
    "misspelt table": (TOML, "[sweep]", "[swep]", ["unknown key 'swep'; did you mean 'sweep'?"]),
    "not an FMU": (TOML, "oscillator.fmu", "sweep.csv", ["sweep.csv: is not an FMU"]),
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
    words = ["reconstruct", str(folder / TOML), "--out", str(folder / "out")]
    assert main(words) == 2
    path = folder / TOML
    assert set(capsys.readouterr().err.splitlines()) == {
        f"fmu-fit: {path}: [fmu] timeout_s: found 'long', wanted a positive number",
        f"fmu-fit: {path}: [observe]: unknown key 'steady'; did you mean 'steady_start'?",
        f"fmu-fit: {path}: [observe] line_width: found unit 's', wanted 'Hz' or one convertible "
        "to it",
        f"fmu-fit: {path}: [parameters 'damping']: key 'upper' is missing",
        f"fmu-fit: {path}: [continuation] iterations: found 0, wanted a whole number from 1 "
        "to 1000",
    }
    path.write_text(CAMPAIGN)
    broken(folder, EXPERIMENTS, "one,", "on,")
    broken(folder, TWO, "\n", "\nx,1\n")
    broken(folder, SWEEP, FIRST, FIRST + "291,NaN\n")
    assert main(words) == 2
    told = capsys.readouterr().err.splitlines()
    places = ["on.csv: no such file", "two.csv: row 2, column 'frequency'", "sweep.csv: row 2"]
    assert len(told) == len(places)
    assert all(place in line for place, line in zip(places, told, strict=True))
    assert left_in(folder / "out") == []


def test_a_flood_of_complaints_is_counted(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "".join(f"{name},{300 + name}\n" for name in range(30))
    (folder / EXPERIMENTS).write_text(f"experiment,f (Hz)\n{rows}")
    assert main(["reconstruct", str(folder / TOML), "--out", str(folder / "out")]) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 21
    assert told[-1] == "fmu-fit: and 10 more complaints"


def test_a_missing_campaign_and_too_few_points(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sweep = (folder / SWEEP).read_text()
    (folder / SWEEP).write_text(FIRST + "300,1\n310,2\n320,1\n330,0.5\n")
    assert "sweep.csv: 4 points are too few for a sweep; wanted at least" in refused(folder, capsys)
    (folder / SWEEP).write_text(sweep)
    (folder / TWO).write_text(FIRST + "329,0.1\n330,9\n")
    assert "two.csv: 2 points; wanted at least 3" in refused(folder, capsys)
    (folder / TOML).rename(folder / "campaing.toml")
    said = refused(folder, capsys)
    assert "campaign.toml: no such file; did you mean 'campaing.toml'?" in said


def test_an_fmu_without_a_binary_for_this_platform(
    folder: Path, capsys: pytest.CaptureFixture[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    foreign = build_c_fmu(tmp_path_factory.mktemp("foreign"), platform="plan9")
    (folder / "oscillator.fmu").write_bytes(foreign.read_bytes())
    said = refused(folder, capsys)
    assert "oscillator.fmu: no binary for this platform; wanted binaries/" in said
    assert "found binaries for: plan9" in said


FAILING = {
    # values of `misbehave` in cfmus/model.h, and the FMU's words
    "hangs": (1, ["the FMU gave no answer within 1.5 s and was stopped"]),
    "segfaults": (2, ["SIGSEGV", "about to crash at 0 s"]),
    "returns NaN": (3, ["output displacement is nan", "lost the state after 0 s"]),
    "stops early": (4, ["stopped early at t = ", "fmi2DoStep returned 'discard'"]),
    "refuses to start": (5, ["fmi2EnterInitializationMode returned 'error'", "told to fail"]),
    "raises in a step": (6, ["fmi2DoStep from t = 0.0 s", "'error'", "cannot step from 0 s"]),
    "aborts": (10, ["SIGABRT", "assertion of the solver failed"]),
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


def test_a_failure_midway_keeps_finished_levels_whole(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second alternative fails: the first one's levels are there to go on from."""
    broken(folder, TOML, "[continuation]", "[alternatives]\nmisbehave = [0, 6]\n[continuation]")
    said = refused(folder, capsys, code=3, left=("checkpoint.json",))
    assert "cannot step from 0 s" in said
    saved = json.loads((folder / "out" / "checkpoint.json").read_text())
    assert [step["alternative"] for step in saved["finished"]] == [0]


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
    told = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, check=False)
    assert told.returncode == 2
    assert told.stdout == ""
    assert told.stderr == (
        f"fmu-fit: {folder}/sweep.csv: row 2, column 'amplitude': found 'NaN', "
        "wanted a finite number; where nothing was measured leave the row out, "
        "or end a sampled record before it\n"
    )
    assert not out.exists()


def test_a_value_from_elsewhere_in_a_wrong_unit_is_refused_before_the_fit(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "out"
    words = ["reconstruct", str(folder / TOML), "--out", str(out), "--external"]
    assert main([*words, "stiffness=3 kHz"]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert "--external stiffness: " in told.err
    assert "N/m" in told.err
    assert not out.exists()
