"""The documentation as a site: every page in its navigation, every link leads somewhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from tests.support.processes import MOST_S

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
CONFIGURATION = ROOT / "docs" / "site" / "mkdocs.yml"
#: Lines of the README: one screen for each question of somebody who has not decided yet.
MOST_LINES = 120


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    words = ["-m", "mkdocs", "build", "--strict", "-f", str(CONFIGURATION), "-d"]
    built = subprocess.run(
        [sys.executable, *words, str(tmp_path / "site")],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        timeout=MOST_S,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    assert "WARNING" not in built.stderr
    assert (tmp_path / "site" / "tutorials" / "first-fit.html").is_file()
    page = (tmp_path / "site" / "index.html").read_text("utf-8")
    assert not re.findall(r'(?:src|href)="https?://(?!squidfunk)[^"]*\.(?:js|css|woff2?)"', page)


def test_the_readme_is_short_and_its_links_lead_somewhere() -> None:
    text = README.read_text("utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    links = re.findall(r"\]\(([^)]+)\)", text)
    inside = [link for link in links if not link.startswith("https://")]
    assert len(inside) > 20
    for link in inside:
        assert (ROOT / link).is_file(), link
    pages = {path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").glob("*/*.md")}
    assert pages <= set(inside), "the README links every page"


def test_the_readmes_python_is_the_script_that_a_test_runs() -> None:
    [block] = re.findall(r"```python\n(.*?)```", README.read_text("utf-8"), re.DOTALL)
    script = (ROOT / "tests" / "api" / "own_fmu.py").read_text("utf-8")
    assert script.partition('"""\n\n')[2] == block
