"""A script and a notebook: from arrays to a figure, in a process of their own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import nbclient
import nbformat
import pytest

from docs.site.blocks import blocks
from tests.support.processes import MOST_S

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = Path(__file__).with_name("from_arrays.py")
#: Width of the line that the script makes, Hz, and what noise of 1 % leaves of it with 25 points.
WIDTH_HZ, MOST_HZ = 95.0, 3.0


def check(told: str) -> None:
    """The table, a width near the truth, nan for what is open, and its range."""
    lines = told.splitlines()
    assert any(re.match(r"lambda +- +Hz +- ", line) for line in lines)
    [width] = [line for line in lines if line.startswith("width_plus = ")]
    found = re.fullmatch(r"width_plus = ([\d.]+) ± ([\d.]+) Hz, determined", width)
    assert found is not None, width
    assert abs(float(found[1]) - WIDTH_HZ) < MOST_HZ
    assert 0.1 < float(found[2]) < 2.0
    assert lines[-2] == "nan"
    low, high = map(float, lines[-1].strip("()").split(","))
    assert low < 1e3
    assert high > 7e5


def test_the_script_has_twenty_lines() -> None:
    lines = [line for line in SCRIPT.read_text("utf-8").splitlines()[2:] if line]
    assert len(lines) <= 20


def swiftly(fmu: Path) -> str:
    """The script with an FMU that answers sooner, of which one width fewer is asked."""
    named, source = 'ff.Fmu("CoupledOscillator")', SCRIPT.read_text("utf-8")
    widths = 'for d in ("d1", "d2")]'
    assert named in source
    assert widths in source
    source = source.replace(named, f"ff.Fmu({str(fmu)!r})")
    return source.replace(widths, 'for d in ("d1",)]')


@pytest.mark.parametrize("swift", [True, pytest.param(False, marks=pytest.mark.nightly)])
def test_a_script_without_a_guard_comes_to_its_end(
    swift: bool, swift_fmu: Path, tmp_path: Path
) -> None:
    script = tmp_path / "from_arrays.py"
    script.write_text(swiftly(swift_fmu) if swift else SCRIPT.read_text("utf-8"), "utf-8")
    told = subprocess.run(
        [sys.executable, str(script)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"},
        timeout=MOST_S,
        check=False,
    )
    assert told.returncode == 0, told.stderr
    assert told.stderr == ""
    check(told.stdout)
    assert (tmp_path / "profile.png").stat().st_size > 1000


def test_the_fit_of_the_readme_runs_on_what_the_tutorial_makes(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "tutorials" / "own-fmu.md").read_text("utf-8")
    making = next(block.text for block in blocks(page) if block.language == "python")
    fitting = SCRIPT.with_name("own_fmu.py").read_text("utf-8")
    run = subprocess.run(
        [sys.executable, "-c", making + fitting],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"},
        timeout=MOST_S,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    values = re.findall(r"^(\w+) = ([\d.]+) ± ([\d.]+), determined$", run.stdout, re.MULTILINE)
    assert [name for name, _, _ in values] == ["damping", "stiffness"]
    for (_, value, error), truth in zip(values, (0.2, 4100.0), strict=True):
        assert abs(float(value) - truth) < 4.0 * float(error)


@pytest.mark.filterwarnings("ignore")  # of the notebook's libraries
def test_a_notebook_shows_the_table(
    swift_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    # what the script prints is looked at above: of its fit the first level will do here
    source = swiftly(swift_fmu).partition("found = ")[0]
    assert "levels=4" in source
    source = source.replace("levels=4", "levels=1")
    cells = [nbformat.v4.new_code_cell(text) for text in (source, "fit", "fmu")]
    notebook = nbformat.v4.new_notebook(cells=cells)
    nbclient.NotebookClient(
        notebook, timeout=int(MOST_S), resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    outputs = [cell.outputs for cell in notebook.cells]
    assert outputs[0] == []
    for shown, word in ((outputs[1], "width_plus"), (outputs[2], "periodic_start")):
        page = shown[0].data["text/html"]
        assert page.count("<tr") > 3
        assert word in page
