"""A line that is asked for by its shape, background, noise and delay."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from tests.support.lines import mode, noise, write_csv

F = np.linspace(9_800.0, 10_200.0, 161)
Z = mode(F, 10_000.0, 20.0) + 0.1 + noise(F.size, 0.01, 1)
SIZES = np.abs(mode(F, 10_000.0, 20.0)) + 0.1 + noise(F.size, 0.01, 1).real


@pytest.mark.parametrize(
    ("terms", "form"),
    [
        ({"background": "constant"}, "offset"),
        ({"background": "slope"}, "sloped"),
        ({"shape": "fano"}, "fano"),
        ({"noise": "power"}, "floor"),
        ({"noise": "amplitude"}, "rice"),
        ({"shape": "duffing", "background": "constant"}, "duffing_offset"),
    ],
)
def test_amplitudes_are_fitted_as_they_are_asked_for(terms: dict[str, str], form: str) -> None:
    asked, named = (ff.line(F, SIZES, **each) for each in (terms, {"wiring": form}))  # type: ignore[arg-type]
    assert asked.wiring == form
    assert asked.is_requested
    assert asked.frequency == named.frequency


def test_a_shape_alone_has_nothing_next_to_it() -> None:
    found = ff.line(F, np.abs(Z - 0.1), shape="lorentzian")
    assert (found.wiring, found.is_requested) == ("transmission", True)


def test_a_constant_is_complex_where_there_are_phases_and_a_delay_is_taken_or_left() -> None:
    assert ff.line(F, Z, background="constant").wiring == "fano"
    delayed = Z * np.exp(-2j * np.pi * F * 2e-4)
    alone, without, compared = (
        ff.line(F, delayed, delay=delay).delay for delay in (True, False, None)
    )
    assert alone is not None
    assert abs(alone.value - 2e-4) < 4.0 * alone.std
    assert without is None
    assert compared is not None


@pytest.mark.parametrize(
    "terms",
    [
        {"shape": "gauss"},
        {"shape": "fano", "noise": "power"},
        {"wiring": "fano", "background": "slope"},
        {"delay": True},
    ],
)
def test_terms_that_do_not_go_together_are_refused(terms: dict[str, str]) -> None:
    with pytest.raises(ff.BadInput, match=r"wanted|wants"):
        ff.line(F, SIZES, **terms)  # type: ignore[arg-type]


def test_the_options_of_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(write_csv(tmp_path / "s.csv", "f (Hz),A (V)", F, SIZES))
    assert main(["line", path, "--background", "constant"]) == 0
    asked = capsys.readouterr().out
    with pytest.warns(DeprecationWarning, match="--background"):
        assert main(["line", path, "--wiring", "offset"]) == 0
    assert capsys.readouterr().out == asked
    assert main(["line", path, "--delay", "yes"]) == 2
    assert "delay" in capsys.readouterr().err
