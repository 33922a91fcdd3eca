"""The generated pages are what the generator writes of the code as it is."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tests.support.processes import MOST_S

ROOT = Path(__file__).resolve().parents[2]


def test_the_reference_is_up_to_date() -> None:
    """Whoever changes a key, an option or a record runs ``python docs/build_reference.py``."""
    told = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "build_reference.py"), "--check"],
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": "40", "PYTHONIOENCODING": "utf-8"},
        timeout=MOST_S,
        check=False,
    )
    assert (told.returncode, told.stdout, told.stderr) == (0, "", "")
