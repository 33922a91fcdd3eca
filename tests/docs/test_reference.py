"""The generated pages are what the generator writes of the code as it is."""

from __future__ import annotations

import pytest

from docs import build_reference


def test_the_reference_is_up_to_date(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whoever changes a key, an option or a record runs ``python docs/build_reference.py``."""
    monkeypatch.setenv("COLUMNS", "40")  # no page depends on the terminal
    monkeypatch.setattr("sys.argv", ["build_reference.py", "--check"])
    assert (build_reference.main(), capsys.readouterr().out) == (0, "")
