"""Variables of the environment that hold nonsense: no fault of the program, and no other result."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from tests.support.in_process import told
from tests.support.lines import mode, write_csv

ROOT = Path(__file__).parents[2]
NONSENSE = {
    "MPLBACKEND": "nonsense",
    "SOURCE_DATE_EPOCH": "abc",
    "BOKEH_LOG_LEVEL": "nonsense",
    "BOKEH_RESOURCES": "nonsense",
    "TQDM_MININTERVAL": "nonsense",
}


def contents(out: Path) -> dict[str, bytes]:
    """Of tables and figures; the record names the folder."""
    return {path.name: path.read_bytes() for path in out.iterdir() if path.suffix != ".json"}


def test_what_is_set_for_libraries_changes_nothing(tmp_path: Path) -> None:
    f = np.linspace(990.0, 1010.0, 41)
    amplitudes = np.asarray(abs(mode(f, 1e3, 4.0)), dtype=float)
    path = write_csv(tmp_path / "sweep.csv", "frequency (Hz),amplitude (V)", f, amplitudes)
    assert told("line", path, "--out", tmp_path / "plain").code == 0
    words = ["-P", "-m", "fitting", "line", str(path), "--out", str(tmp_path / "other")]
    ended = subprocess.run(
        [sys.executable, *words],
        env={**os.environ, "PYTHONPATH": str(ROOT), **NONSENSE},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    plain = contents(tmp_path / "plain")
    assert {"line.csv", "line.png", "line.svg"} <= set(plain)
    assert contents(tmp_path / "other") == plain
