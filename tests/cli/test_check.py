"""``fmu-fit check`` tells what is wrong with an FMU, and of what is right only that."""

from __future__ import annotations

import json
import math
import re
import zipfile
from pathlib import Path

import fmpy
import pytest

from fitting.cli.main import main
from fitting.fmu.description import read_description
from fitting.report.screen import phrases
from tests.support.cfmu_build import (
    REFERENCE,
    SOURCES,
    build_c_fmu,
    build_reference_fmu,
    reworded,
)

ROOT = Path(__file__).parents[2]


def test_a_sound_fmu(oscillator_fmu: Path, capsys: pytest.CaptureFixture[str]) -> None:
    campaign = ROOT / "data" / "string_q1" / "campaign.toml"
    assert main(["check", str(oscillator_fmu), "--campaign", str(campaign), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["sound"], found["findings"], found["failure"]) == (True, [], None)
    assert (found["model_name"], found["fmi_version"]) == ("CoupledOscillator", "2.0")
    assert found["variables"]["d1"]["unit"] == "Hz"
    assert found["suits"]["output"] == "q1_hybrid"
    assert "q1_hybrid" in found["trial"]["numbers"]
    repeats, resets = found["repeats"], found["resets"]
    assert (repeats["step_s"], repeats["again"]) == (1e-8, 0.0)
    assert repeats["halves"] <= 1e-12 < repeats["later"]  # the drive goes by the time
    assert (resets["step_s"], resets["true"]) == (1e-8, True)
    assert "rk4_substep" in resets["idle"]  # the exact solver takes none
    assert "eta_plus" not in resets["idle"]
    description = read_description(oscillator_fmu)
    assert description.usual_step_s == 1e-8
    further = phrases("check/text", "further", description)
    [needs] = [s for s in further if s.startswith("needsExecutionTool: ")]
    assert re.findall(r"\d+\.\d+", needs) == ["3.8", "3.13"]  # of libpython


def test_an_fmu_that_does_not_suit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    campaign = ROOT / "data" / "string_q1" / "campaign.toml"
    assert main(["check", str(build_c_fmu(tmp_path)), "--campaign", str(campaign)]) == 2
    assert "q1_hybrid" in capsys.readouterr().err


@pytest.mark.parametrize("reset", ["RESET_DOES_NOTHING", "RESET_KEEPS_DERIVED"])
def test_a_reset_that_lies_is_told(
    reset: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(build_c_fmu(tmp_path, reset=reset)), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["resets"]["true"] is False
    assert found["costs"]["anew"] is True


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('unit="N/m" ', 'unit="furlong" ', r"careful: The unit \"furlong\" [\s\S]* is not defined"),
        (
            '<InitialUnknowns><Unknown index="5"/>',
            "<InitialUnknowns>",
            "cosmetic: ModelStructure/InitialUnknowns",
        ),
    ],
)
def test_rules_broken_are_told_by_how_much_they_matter(
    before: str, after: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It runs all the same: no error of this command."""
    assert main(["check", str(reworded(build_c_fmu(tmp_path), {before: after})), "--verbose"]) == 0
    told = capsys.readouterr()
    assert re.search(words, told.out)
    assert told.err == ""


def test_an_fmu_without_outputs_is_seen_by_its_local_variables(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A force of 1 N at 300 Hz: |x| = 1/|k - m w^2 + i c w| by hand."""
    fmu = reworded(build_c_fmu(tmp_path), {'causality="output"': 'causality="local"'})
    assert main(["check", str(fmu), "--verbose"]) == 0
    text = capsys.readouterr().out
    assert "4 local variables" in text
    assert re.search("^ +displacement +local .*Real .* m$", text, re.MULTILINE)
    drive = ["--input", "force", "--drive", "300 Hz", "--set", "damping=0.2", "--accuracy", "1e-3"]
    assert main(["simulate", str(fmu), *drive, "--out", str(tmp_path / "out")]) == 0
    told = re.search(r"^ +displacement +(\S+) m peak", capsys.readouterr().out, re.MULTILINE)
    assert told is not None
    w = 2 * math.pi * 300.0
    assert float(told[1]) == pytest.approx(1 / abs(4e3 - 1e-3 * w**2 + 0.2j * w), rel=1e-3)


def test_a_crash_when_an_instance_is_freed_is_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One run goes well: a fit would die at the next one."""
    assert main(["check", str(build_c_fmu(tmp_path, marks={"CRASHES_WHEN_FREED": 1.0}))]) == 3
    told = capsys.readouterr()
    assert "trial run: " in told.out
    assert "SIGSEGV" in told.err


def test_what_an_fmu_says_does_not_steer_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """C1 control characters and a line break are legal in XML: names, units and descriptions."""
    steers = {"DrivenOscillator": "Driven\x9b2J", 'unit="N/m" ': 'unit="N&#10;fatal: /m" '}
    fmu = reworded(build_c_fmu(tmp_path), steers)
    assert main(["check", str(fmu)]) == 0
    text = capsys.readouterr().out
    assert "Driven\\u009b2J" in text
    assert "\x9b" not in text
    assert not re.search("^fatal: ", text, re.MULTILINE)


def test_the_page_tells_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmu = build_c_fmu(tmp_path, marks={"NOISE": 1e-3})
    out = tmp_path / "page"
    assert main(["check", str(fmu), "--report", str(out), "--verbose"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    page = (out / "report.html").read_text("utf-8")
    careful, *_ = re.findall("(outputs repeat to [^,;.]*)", told)
    for words in (careful, "per step", "DrivenOscillator", "stiffness"):
        assert words in told
        assert words in page
    assert page.count("per step,") == 1
    assert "2412.07301" not in page  # no fit was made
    assert "data:image/svg+xml" in page
    assert (out / "figures" / "1_repeats.csv").exists()
    assert main(["check", str(fmu), "--report", str(fmu)]) == 2  # a file is no folder
    assert str(fmu) in capsys.readouterr().err


def test_no_binary_for_this_platform(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(build_c_fmu(tmp_path, platform="plan9"))]) == 2
    assert "plan9" in capsys.readouterr().err


def test_failing_fmu_is_exit_code_3(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = build_c_fmu(tmp_path)
    assert (
        main(
            [
                "simulate",
                str(path),
                "--input",
                "force",
                "--drive",
                "300 Hz",
                "--set",
                "misbehave=5",
                "--out",
                str(tmp_path / "out"),
            ]
        )
        == 3
    )
    told = capsys.readouterr()
    assert "told to fail: misbehave = 5" in told.err  # the FMU's own words
    assert told.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("--step=0", "'0'"),
        ("--step=nan", "'nan'"),
        ("--step=1 mm", "'mm'"),
        ("--timeout=-1", "'-1'"),
    ],
)
def test_impossible_times_are_refused_by_name(
    option: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(tmp_path / "any.fmu"), option]) == 2
    told = capsys.readouterr().err
    assert f"{option.partition('=')[0]}: " in told
    assert words in told


def test_times_take_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmu = build_c_fmu(tmp_path)
    assert main(["check", str(fmu), "--step", "2 ms", "--timeout", "0.5 min"]) == 0
    text = capsys.readouterr().out
    assert "step of 2 ms" in text
    assert "needsExecutionTool" not in text
    once = phrases("check/text", "further", read_description(build_c_fmu(tmp_path, once=True)))
    assert any(line.startswith("canBeInstantiatedOnlyOncePerProcess: ") for line in once)


def test_a_run_out_of_time_names_the_option(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fmu = build_c_fmu(tmp_path)
    drive = ["--input", "force", "--drive", "300 Hz", "--set", "misbehave=1"]  # hangs
    arguments = [*drive, "--timeout", "300 ms", "--out", str(tmp_path / "out")]
    assert main(["simulate", str(fmu), *arguments]) == 3
    told = capsys.readouterr().err
    assert "0.3 s" in told
    assert "--timeout" in told


def test_what_the_fmu_says_comes_first(
    swift_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--set", "d1=-1e6", "--out", str(tmp_path / "out")]
    assert main(["simulate", str(swift_fmu), *arguments]) == 3
    told = capsys.readouterr().err
    assert f"{swift_fmu}: d1 = -1000000.0 Hz" in told
    assert re.search(r" t = 0\.0 s", told)


def test_a_hang_names_the_value_and_ends_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The FMU hangs at every stiffness but its own: tried once, and everything else is tried."""
    hung = tmp_path / "hung"
    fmu = build_c_fmu(tmp_path, marks={"HANGS_WHERE_VARIED": hung})
    assert main(["check", str(fmu), "--budget", "12 s", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    [failed] = found["failed"]
    assert failed["what"] == "stiffness = 4004"
    assert "2 s" in failed["message"]
    assert "--budget" in failed["message"]
    assert (found["sound"], found["failure"]) == (False, None)
    assert [f["severity"] for f in found["findings"]] == ["careful"]
    assert found["costs"] is not None
    assert found["repeats"]["again"] == 0.0
    assert [e["acts"] for e in found["effects"]] == [True]
    assert hung.read_text() == "hangs\n"


def test_what_has_no_time_left_is_listed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A microsecond is over before anything but the trial run."""
    assert main(["check", str(build_c_fmu(tmp_path)), "--budget", "1 us"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "trial run: " in text
    assert re.search(r"not tried, because the time was over \(--budget\): .*steps", text)


def test_what_a_fit_cannot_set_or_another_tool_not_load_is_listed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An alias acts as its variable; a start value outside its range; a binary of another name."""
    plain = build_c_fmu(tmp_path)
    text = (SOURCES / "oscillator2.xml").read_text("utf-8")
    [line] = re.findall('.*name="stiffness".*', text)
    alias = line.replace('name="stiffness"', 'name="k"')
    fmu = reworded(plain, {line: f"{line}\n{alias}", 'start="4e3"': 'start="4e3" max="3e3"'})
    renamed = tmp_path / "renamed.fmu"
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(renamed, "w") as target:
        for name in source.namelist():
            target.writestr(name.replace("oscillator.so", "model.so"), source.read(name))
    assert main(["check", str(renamed), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["failure"] is None
    assert {"stiffness", "k"}.isdisjoint(found["resets"]["idle"])
    sentences = "; ".join(f["sentence"] for f in found["findings"])
    assert "stiffness: its start value 4000.0 is outside its own range from 0 to 3000" in sentences
    assert "its binary is binaries/linux64/model.so" in sentences


def test_sources_are_compiled_for_this_machine(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A Reference FMU without its binary: exp(-t) by Euler's steps of its own."""
    full, bare = build_reference_fmu(tmp_path, "Dahlquist"), tmp_path / "bare.fmu"
    with zipfile.ZipFile(full) as source, zipfile.ZipFile(bare, "w") as target:
        target.writestr("modelDescription.xml", source.read("modelDescription.xml"))
        for folder in ("Dahlquist", "src", "include"):
            for path in (REFERENCE / folder).iterdir():
                target.write(path, f"sources/{path.name}")
        parts = ("fmi2Functions.c", "model.c", "cosimulation.c")
        defined = "#define FMI_VERSION 2\n#define DISABLE_PREFIX\n"
        includes = "".join(f'#include "{part}"\n' for part in parts)
        target.writestr("sources/all.c", defined + includes)
    monkeypatch.chdir(tmp_path)
    assert main(["check", str(bare)]) == 2
    assert "--compile" in capsys.readouterr().err
    assert main(["check", str(bare), "--compile", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["failure"] is None
    assert (tmp_path / f"bare_{fmpy.platform}.fmu").exists()
