"""The wheel is the whole program: installed by itself, it builds, fits and brings examples.

The wheel is built by hatchling of this environment and installed without a network into a new
environment, whose libraries are those of this one, by a path file.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import venv
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

import fitting
from fitting.result.result import read_result
from tests.cli.test_example import DATA, NAMES, files
from tests.support.processes import MOST_S

ROOT = Path(__file__).parents[2]
pytest.importorskip("hatchling", reason="builds the wheel")


def call(command: list[str | Path], folder: Path) -> str:
    """Output of a command that has to succeed, with nothing of this checkout on its path."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [str(part) for part in command],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=MOST_S,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return done.stdout


def hatch(target: str, source: Path, out: Path) -> Path:
    """The one file that hatchling makes of a source folder."""
    call([sys.executable, "-m", "hatchling", "build", "-t", target, "-d", out], source)
    [made] = out.iterdir()
    return made


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return hatch("wheel", ROOT, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of commands of a new environment with the wheel."""
    home = tmp_path_factory.mktemp("environment")
    venv.create(home, with_pip=False)
    commands = home / ("Scripts" if sys.platform == "win32" else "bin")
    python = commands / "python"
    pip: list[str | Path] = [sys.executable, "-m", "pip", "--python", python, "install"]
    call([*pip, "--no-deps", "--no-index", wheel], home)
    place = "import sysconfig; print(sysconfig.get_path('purelib'))"
    packages = Path(call([python, "-c", place], home).strip())
    libraries = [path for path in sys.path if Path(path).name in ("site-packages", "dist-packages")]
    assert libraries
    (packages / "libraries.pth").write_text("\n".join(libraries) + "\n")
    return commands


def content(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_the_wheel_holds_models_builder_and_examples(wheel: Path) -> None:
    held = content(wheel)
    home = "fitting/shipped/"
    wanted = {home + "build_fmu.py": (ROOT / "build_fmu.py").read_bytes()}
    wanted |= {
        f"{home}fmu_src/{name}": data
        for name, data in files(ROOT / "fmu_src").items()
        if "__pycache__" not in name
    }
    # templates, scripts of the page and layouts too: without them no report is written
    code = files(ROOT / "fitting")
    wanted |= {f"fitting/{n}": data for n, data in code.items() if "__pycache__" not in n}
    for name in NAMES:
        found = files(DATA / name)
        wanted |= {f"{home}data/{name}/{file}": data for file, data in found.items()}
    pages = files(ROOT / "docs")
    wanted |= {f"{home}docs/{n}": d for n, d in pages.items() if n.endswith(".md") and "/" in n}
    assert {name: held.get(name) for name in wanted} == wanted
    assert {name.split("/")[0] for name in held} == {
        "fitting",
        f"fmu_fit-{fitting.__version__}.dist-info",
    }


@pytest.mark.nightly
def test_the_source_archive_makes_the_same_wheel(wheel: Path, tmp_path: Path) -> None:
    archive = hatch("sdist", ROOT, tmp_path / "sdist")
    with tarfile.open(archive) as tar:
        tar.extractall(tmp_path / "source", filter="data")
    [source] = (tmp_path / "source").iterdir()
    assert content(hatch("wheel", source, tmp_path / "wheel")) == content(wheel)
    for name in ("tests/cli/test_wheel.py", "CITATION.cff", "CHANGELOG.md", ".ci/run"):
        assert (source / name).is_file()
    assert not list(source.glob(".*cache"))


def test_one_version_everywhere(wheel: Path) -> None:
    version = fitting.__version__
    [metadata] = [text for name, text in content(wheel).items() if name.endswith("/METADATA")]
    told = Parser().parsestr(metadata.decode())
    assert told["Version"] == version
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    assert re.findall(r"^version: (.+)$", citation, re.MULTILINE) == [version]
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    assert told["Requires-Python"] == ">=3.11"
    if python in ("3.11", "3.12", "3.13"):
        assert f"Programming Language :: Python :: {python}" in told.get_all("Classifier", [])


def test_an_installed_wheel_fits_its_example(
    installed: Path, oscillator_fmu: Path, tmp_path: Path
) -> None:
    """In an empty folder: an example, a campaign that names a model, a result."""
    command = installed / "fmu-fit"
    where = "import fitting; print(fitting.__file__, fitting.__version__)"
    place, version = call([installed / "python", "-c", where], tmp_path).rsplit(maxsplit=1)
    assert installed.parent in Path(place).parents
    assert version == fitting.__version__
    page = (ROOT / "docs" / "how-to" / "traces.md").read_text("utf-8")
    assert call([command, "help", "traces"], tmp_path).startswith(page[:100])
    call([command, "example", "afm_sensor", "--out", "d"], tmp_path)
    assert files(tmp_path / "d") == files(DATA / "afm_sensor")
    options = ["--quick", "--no-profiles", "--no-report", "--out", "o"]
    call([command, "reconstruct", "d/campaign.toml", *options], tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["d", "o"]
    for name in ("result.json", "history.csv"):
        assert (tmp_path / "o" / name).stat().st_size > 0
    assert read_result(tmp_path / "o" / "result.json").status == "converged"
    # the same bytes as from the checkout
    built = tmp_path / "o" / "fmu" / "CoupledOscillator.fmu"
    assert built.read_bytes() == oscillator_fmu.read_bytes()
