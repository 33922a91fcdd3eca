"""`[fmu] native` and `--native`: the compiled twin in place of the Python FMU."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.campaign.file import WrittenFmu
from fitting.fmu import models
from fitting.fmu.models import built_model
from fitting.text.files import shipped
from fitting.text.schema import Refused

MODEL = "CoupledOscillator"
FREQUENCY_HZ = [6.9402e6, 6.9403e6]


def swept(*, native: bool) -> tuple[list[float], str]:
    """Amplitudes of two points, and what made the binary."""
    with ff.Fmu(MODEL, 1, native=native) as fmu:
        response = fmu.sweep(FREQUENCY_HZ, accuracy=1e-3)
        return np.asarray(response.curves[0].amplitudes).tolist(), fmu.description.generation_tool


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_the_compiled_model_gives_the_same_numbers() -> None:
    python, compiled = swept(native=False), swept(native=True)
    assert python[0] == pytest.approx(compiled[0], rel=1e-11)
    assert ("PythonFMU" in python[1], "C11" in compiled[1]) == (True, True)


def test_without_a_compiler_the_model_is_that_of_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with ff.Fmu(built_model(MODEL, tmp_path, native=True), 1) as fmu:
        assert "PythonFMU" in fmu.description.generation_tool


def test_what_was_built_is_kept_by_what_it_was_built_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second build is the first one's file; other sources, and no cache at all, build anew."""
    calls: list[Sequence[str]] = []
    build, sources = models._builder, tmp_path / "sources"

    def counting(words: Sequence[str], folder: Path) -> Path:
        calls.append(words)
        return build(words, folder)

    monkeypatch.setattr(models, "_builder", counting)
    monkeypatch.setenv(models.CACHE, str(tmp_path / "cache"))
    first = built_model(MODEL, tmp_path / "one").read_bytes()
    again = built_model(MODEL, tmp_path / "two").read_bytes()
    assert (len(calls), again == first) == (1, True)
    where = shipped
    shutil.copytree(where(models.SOURCES), sources)
    (sources / "added.py").write_text("")
    monkeypatch.setattr(models, "shipped", lambda n: sources if n == models.SOURCES else where(n))
    built_model(MODEL, tmp_path / "three")
    assert len(calls) == 2
    monkeypatch.setenv(models.CACHE, "")
    built_model(MODEL, tmp_path / "four")
    assert len(calls) == 3


def test_a_file_is_not_compiled() -> None:
    with pytest.raises(Refused):
        WrittenFmu(file=Path("other.fmu"), native=True)
