"""Optional packages can be deleted: the core is imported, lists its commands and fits without."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from fitting import _table
from fitting.text.toml import toml_text
from tests.support.processes import MOST_S
from tests.support.small_campaign import small_campaign

ROOT = Path(__file__).resolve().parents[2]
OPTIONAL = ("check", "design", "draft", "ensembles", "lab", "posterior")


def without(folder: Path, *packages: str) -> Path:
    """A copy of the package without some of its own."""
    left = shutil.ignore_patterns("__pycache__", "*.pyc")
    shutil.copytree(ROOT / "fitting", folder / "fitting", ignore=left)
    for package in packages:
        shutil.rmtree(folder / "fitting" / package)
    return folder


def run(folder: Path, *words: str) -> str:
    """What Python prints, with the copy as the only one that it can import."""
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    done = subprocess.run(
        [sys.executable, *words],
        capture_output=True,
        text=True,
        cwd=folder,
        env=environment,
        timeout=MOST_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("package", OPTIONAL)
def test_without_one_the_core_is_imported_and_lists_its_commands(
    package: str, tmp_path: Path
) -> None:
    folder = without(tmp_path, package)
    assert run(folder, "-c", "import fitting; print(fitting.__file__)").startswith(str(folder))
    assert "reconstruct" in run(folder, "-m", "fitting", "--help")
    assert "usage" in run(folder, "-m", "fitting", "reconstruct", "--help")


def test_without_all_of_them_every_name_of_the_core_is_there_and_a_campaign_is_fitted(
    swift_fmu: Path, tmp_path: Path
) -> None:
    folder = without(tmp_path, *OPTIONAL, "extension")
    names = [n for n, home in _table().items() if home.split(".")[1] not in OPTIONAL]
    assert len(names) > 40
    run(folder, "-c", f"import fitting; [getattr(fitting, n) for n in {names!r}]; fitting.plot")
    campaign = small_campaign(tmp_path / "small", swift_fmu)
    out = tmp_path / "out"
    words = ("--quick", "--no-profiles", "--workers", "1", "--out", str(out))
    told = run(folder, "-m", "fitting", "reconstruct", str(campaign), *words)
    assert "converged" in told
    assert (out / "report.html").is_file()


@pytest.mark.nightly
def test_without_all_of_them_the_types_of_the_core_are_right(tmp_path: Path) -> None:
    """The static tables still name what is gone."""
    folder = without(tmp_path, *OPTIONAL, "extension")
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["mypy"]
    settings["files"] = ["fitting"]
    gone = [f"fitting.{name}.*" for name in OPTIONAL]
    settings["overrides"].append({"module": gone, "ignore_missing_imports": True})
    (folder / "pyproject.toml").write_text(toml_text({"tool": {"mypy": settings}}), "utf-8")
    assert "Success" in run(folder, "-m", "mypy")
