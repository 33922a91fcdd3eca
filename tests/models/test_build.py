"""build_fmu.py: the same in, the same out; another in, another identity; nonsense, nothing."""

from __future__ import annotations

import ast
import math
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree.ElementTree import Element, fromstring

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pythonfmu import Fmi2Slave

import build_fmu
from build_fmu import build, main
from fmu_src.coupled_oscillator import CoupledOscillator
from fmu_src.slave import ModelSlave
from fmu_src.start_values import BuildError, checked_start_values
from fmu_src.variables import make_table
from tests.support.fmus import Instance, unpack
from tests.support.processes import MOST_S

ROOT = Path(build_fmu.__file__).parent


def description(fmu: Path) -> Element:
    with zipfile.ZipFile(fmu) as archive:
        return fromstring(archive.read("modelDescription.xml"))


def guid(fmu: Path) -> str:
    return str(description(fmu).get("guid"))


def start(fmu: Path, name: str) -> str:
    """Return the start value of a variable as it stands in the XML."""
    for variable in description(fmu).iterfind("ModelVariables/ScalarVariable"):
        if variable.get("name") == name:
            return str(variable[0].get("start"))
    raise AssertionError(f"no variable {name}")


def command(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run build_fmu.py as a user does."""
    return subprocess.run(
        [sys.executable, str(ROOT / "build_fmu.py"), *arguments],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=MOST_S,
        env={**os.environ, "PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo"},
    )


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A copy of fmu_src that a test may change."""
    copy = tmp_path / "copy" / "fmu_src"
    shutil.copytree(ROOT / "fmu_src", copy, ignore=shutil.ignore_patterns("__pycache__"))
    return copy


# --- reproducible --------------------------------------------------------------------------------


def test_another_process_elsewhere_builds_the_same_bytes(
    oscillator_fmu: Path, tmp_path: Path
) -> None:
    done = command("--out", "here", "--model", "CoupledOscillator", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    built = tmp_path / "here" / "CoupledOscillator.fmu"
    assert (tmp_path / done.stdout.strip()) == built
    assert built.read_bytes() == oscillator_fmu.read_bytes()


def test_every_model_is_built_by_default_and_its_path_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert printed.splitlines() == [
        str(tmp_path / f"{model}.fmu") for model in build_fmu.model_modules()
    ]
    assert all(zipfile.is_zipfile(path) for path in printed.split())


def test_the_archive_leaves_nothing_to_the_moment_of_building(oscillator_fmu: Path) -> None:
    with zipfile.ZipFile(oscillator_fmu) as archive:
        entries = archive.infolist()
    assert [e.filename for e in entries] == sorted(e.filename for e in entries)
    assert {e.date_time for e in entries} == {(1980, 1, 1, 0, 0, 0)}
    assert {e.external_attr >> 16 for e in entries} == {0o100644}
    assert {e.compress_type for e in entries} == {zipfile.ZIP_STORED}
    assert not any("__pycache__" in e.filename or ".pyc" in e.filename for e in entries)
    assert description(oscillator_fmu).get("generationDateAndTime") is None


def test_the_identity_follows_the_content(
    oscillator_fmu: Path, source: Path, tmp_path: Path
) -> None:
    same = build(out=tmp_path / "same", source=source)
    assert same.read_bytes() == oscillator_fmu.read_bytes()
    guids = [guid(same)]
    for name in ("oscillator_exact.py", "slave.py", "documentation/base.html.j2"):
        with (source / name).open("a", encoding="utf-8") as file:
            file.write("\n")
        guids.append(guid(build(out=tmp_path / "other", source=source)))
    guids.append(guid(build(out=tmp_path / "other", source=source, start_values={"theta": 2.0})))
    guids.append(guid(build(out=tmp_path / "other", source=source, start_values={"theta": 2.5})))
    assert len(set(guids)) == len(guids)


def test_what_a_model_does_not_import_is_not_in_its_fmu(
    oscillator_fmu: Path, source: Path, tmp_path: Path
) -> None:
    (source / "of_another_model.py").write_text("import numpy\n")
    assert build(out=tmp_path, source=source).read_bytes() == oscillator_fmu.read_bytes()


def modules(fmu: Path) -> Iterator[tuple[str, ast.Module]]:
    with zipfile.ZipFile(fmu) as archive:
        for name in archive.namelist():
            if name.endswith(".py") and "/pythonfmu/" not in name:
                yield name, ast.parse(archive.read(name))


def test_the_model_needs_nothing_but_the_standard_library(oscillator_fmu: Path) -> None:
    imported = set()
    for _, tree in modules(oscillator_fmu):
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add(str(node.module).split(".")[0])
    own = {name for name in imported if name.startswith("fmu_coupledoscillator_")}
    assert len(own) == 1  # the slave module's import of the package
    assert imported - own - {"pythonfmu"} <= sys.stdlib_module_names


def test_no_module_is_named_as_in_another_build(oscillator_fmu: Path, tmp_path: Path) -> None:
    names = {name.split("/")[1] for name, _ in modules(oscillator_fmu)}
    others = {
        name.split("/")[1] for name, _ in modules(build(out=tmp_path, start_values={"theta": 2.0}))
    }
    assert len(names) == 2  # the package and the slave module
    assert names.isdisjoint(others)


def test_a_rebuilt_fmu_runs_its_own_code_in_the_same_process(source: Path, tmp_path: Path) -> None:
    def read(folder: Path) -> float:
        with Instance(unpack(build(out=folder, source=source), folder / "unpacked")) as instance:
            return instance.start().get("D11")[0]

    before = read(tmp_path / "before")
    with (source / "coupled_oscillator.py").open("a", encoding="utf-8") as file:
        file.write(
            "\n_read = CoupledOscillator.get_real\n"
            "CoupledOscillator.get_real = lambda self, vrs: [2.0 * x for x in _read(self, vrs)]\n"
        )
    assert read(tmp_path / "after") == 2.0 * before


def test_building_leaves_no_trace_in_the_process(source: Path, tmp_path: Path) -> None:
    path, before = list(sys.path), set(sys.modules)
    build(out=tmp_path, source=source)
    assert sys.path == path
    assert {
        name for name in set(sys.modules) - before if "fmu_" in name or "slave" in name
    } == set()
    assert list(source.rglob("__pycache__")) == []
    assert [p.name for p in tmp_path.iterdir() if p.suffix != ".fmu"] == ["copy"]


# --- start values --------------------------------------------------------------------------------


def test_start_values_keep_every_digit(tmp_path: Path) -> None:
    values = {
        "theta": 0.1 + 0.2,
        "g1": 70e-6,
        "g2": 1e-300,
        "phase1": math.pi,
        "phase2": -2.0,
        "A1": 5e-324,
    }
    fmu = build(out=tmp_path, start_values=values)
    assert {name: float(start(fmu, name)) for name in values} == values
    with Instance(unpack(fmu, tmp_path / "unpacked")) as instance:
        assert instance.get(*values) == list(values.values())
        instance.slave.reset()
        assert instance.get(*values) == list(values.values())


def test_start_values_of_all_types_come_from_the_command_line(tmp_path: Path) -> None:
    words = ["--set", "theta=1.95", "reflection=true", "--set", "solver=2"]
    assert main(["--model", "CoupledOscillator", "--out", str(tmp_path / "out"), *words]) == 0
    fmu = tmp_path / "out" / "CoupledOscillator.fmu"
    assert (start(fmu, "theta"), start(fmu, "reflection"), start(fmu, "solver")) == (
        "1.95",
        "true",
        "2",
    )
    with zipfile.ZipFile(fmu) as archive:
        page = archive.read("documentation/index.html").decode()
    assert "<code>theta = 1.95</code>" in page


@pytest.mark.parametrize(
    ("assignment", "words"),
    [
        ("thetta=1", ["thetta", "no variable"]),
        ("theta=one", ["theta", "'one'", "finite number"]),
        ("theta=nan", ["theta", "'nan'", "finite number"]),
        ("theta=", ["theta", "''"]),
        ("solver=1.5", ["solver", "'1.5'", "whole number"]),
        ("solver=3", ["solver", "3", "at most 2"]),
        ("solver=99999999999", ["solver", "99999999999"]),
        ("eta_plus=-1", ["eta_plus", "-1.0 Hz", "at least"]),
        ("reflection=2", ["reflection", "'2'", "true or false"]),
        ("q1_hybrid=1", ["q1_hybrid", "not a parameter", "an output"]),
        ("b=1", ["b", "not a parameter", "an input"]),
        ("theta", ["theta", "NAME=VALUE"]),
    ],
)
def test_a_wrong_start_value_is_named_and_nothing_is_written(
    assignment: str, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "CoupledOscillator.fmu"
    kept.write_bytes(b"what was here before")
    assert main(["--out", str(tmp_path), "--set", assignment]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert all(word in err for word in words), err
    assert kept.read_bytes() == b"what was here before"
    assert list(tmp_path.iterdir()) == [kept]


@pytest.mark.parametrize(
    ("assignment", "sentence"),
    [
        ("eta_plus=1e-13", "eta_plus = 1e-13 Hz: wanted is at least 1e-12 Hz"),
        ("u1=-1", "u1 = -1.0 Hz: wanted is at least 0.0 Hz"),
        ("d1=1e8", "a mode is overdamped (d1 = 100000000.0 Hz"),
    ],
)
def test_an_fmu_that_could_never_start_is_not_built(
    assignment: str, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--model", "CoupledOscillator", "--out", str(tmp_path), "--set", assignment]
    assert main(arguments) == 2
    assert sentence in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments", [["--model", "Pendulum"], ["--out", str(Path(__file__)), "--set", "theta=1"]]
)
def test_other_bad_input_is_one_line_too(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert arguments[1] in err


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_any_finite_number_is_read_exactly(value: float) -> None:
    read = checked_start_values(CoupledOscillator, {"theta": repr(value), "g1": value})
    assert read == {"theta": value, "g1": value}


@given(st.text(max_size=8) | st.booleans() | st.just(math.inf))
def test_what_is_no_finite_number_is_refused(given_value: Any) -> None:
    try:
        number = float(given_value) if isinstance(given_value, str) else math.nan
    except ValueError:
        number = math.nan
    if math.isfinite(number):
        assert checked_start_values(CoupledOscillator, {"theta": given_value})["theta"] == number
    else:
        with pytest.raises(BuildError, match="theta"):
            checked_start_values(CoupledOscillator, {"theta": given_value})


# --- documentation and licences ------------------------------------------------------------------


class Page(HTMLParser):
    """Checks that elements are closed in order, and collects the text."""

    VOID = frozenset({"meta", "br", "hr", "img", "link"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text = ""
        self.ids: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        self.ids += [value or "" for key, value in attrs if key == "id"]
        self.links += [value or "" for key, value in attrs if key == "href"]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag, self.getpos()

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def page(oscillator_fmu: Path) -> Page:
    with zipfile.ZipFile(oscillator_fmu) as archive:
        parsed = Page()
        parsed.feed(archive.read("documentation/index.html").decode())
    assert parsed.open == []
    return parsed


def test_the_documentation_has_the_variables_as_the_description_has_them(
    page: Page, oscillator_fmu: Path
) -> None:
    text = " ".join(page.text.split())
    for variable in description(oscillator_fmu).iterfind("ModelVariables/ScalarVariable"):
        assert str(variable.get("name")) in text
        assert " ".join(str(variable.get("description")).split()) in text
        number = variable[0].get("start")
        if variable[0].tag == "Real" and number is not None:
            shown = {float(word) for word in text.split() if _is_number(word)}
            assert float(number) in shown, variable.get("name")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def test_the_documentation_says_how_to_load_it_and_how_it_fails(page: Page) -> None:
    for words in ("LD_PRELOAD", "RTLD_GLOBAL", "PYTHONHOME", "status_message", "fmi2Discard"):
        assert words in page.text
    assert len(page.ids) == len(set(page.ids))
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.ids)


def test_links_inside_the_fmu_lead_somewhere(page: Page, oscillator_fmu: Path) -> None:
    with zipfile.ZipFile(oscillator_fmu) as archive:
        files = archive.namelist()
        own = archive.read("documentation/licenses/license.txt").decode()
        bridge = archive.read("documentation/licenses/pythonfmu.txt").decode()
    local = [link for link in page.links if not link.startswith(("#", "http"))]
    assert local
    assert all(f"documentation/{link}" in files for link in local)
    assert own == (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert bridge.startswith("MIT License")
    assert "NTNU" in bridge


def test_like_builds_the_same_bytes_again_and_other_values_under_another_name(
    tmp_path: Path,
) -> None:
    first = build("CoupledOscillator", tmp_path, {"theta": 1.95})
    words = ["--like", str(first), "--out"]
    assert main([*words, str(tmp_path / "again")]) == 0
    assert (tmp_path / "again" / first.name).read_bytes() == first.read_bytes()
    named = ["--name", "String7", "--history", "Fitted & checked.", "--set", "d1=94.5"]
    assert main([*words, str(tmp_path), *named]) == 0
    other = tmp_path / "String7.fmu"
    assert (start(other, "theta"), start(other, "d1")) == ("1.95", "94.5")
    assert description(other).get("modelName") == "String7"
    assert guid(other) != guid(first)
    with zipfile.ZipFile(other) as archive:
        assert "Fitted &amp; checked." in archive.read("documentation/index.html").decode()
    assert build_fmu.built_from(other).start_values == {"theta": 1.95, "d1": 94.5}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--like", "{fmu}", "--name", "7"], "name '7': wanted letters, digits and _"),
        (["--like", "{here}/none.fmu"], "none.fmu: cannot be read: No such file"),
        (["--like", "{here}/text.fmu"], "text.fmu: is no FMU that build_fmu.py made"),
        (
            ["--like", "{fmu}", "--model", "CoupledOscillator"],
            "--model and --modes have no meaning",
        ),
        (["--name", "x"], "have a meaning with --like alone"),
    ],
    ids=["name", "absent", "text", "model", "alone"],
)
def test_like_refuses_what_it_cannot_build(
    words: list[str],
    told: str,
    oscillator_fmu: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "text.fmu").write_text("no archive")
    given = [word.format(fmu=oscillator_fmu, here=tmp_path) for word in words]
    assert main([*given, "--out", str(tmp_path / "out")]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_slave_has_all_that_pythonfmu_would_set_on_it() -> None:
    told = {"instance_name": "run", "resources": "here", "visible": True}
    ours, other = ModelSlave(**told), ModelSlave(**told)
    left = SimpleNamespace()
    Fmi2Slave.__init__(left, **told)
    theirs = vars(left)
    assert {"instance_name", "log_queue", "guid"} <= theirs.keys()  # and its names are still these
    own = {name for name in theirs if name not in ("guid", "modelName", "default_experiment")}
    assert {name: getattr(ours, name) for name in own} == {name: theirs[name] for name in own}
    assert ours.modelName == "ModelSlave"
    ours.log("of one run alone")
    assert (len(ours.log_queue), len(other.log_queue)) == (1, 0)


def test_moving_outputs_stand_side_by_side_in_their_order() -> None:
    variables, moving = CoupledOscillator.variables, CoupledOscillator.moving
    with pytest.raises(ValueError, match="follow each other"):
        make_table(variables, (moving[1], moving[0]), {})
