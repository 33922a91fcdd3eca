"""Templates are compiled once, where Python keeps compiled modules, too."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from jinja2 import Environment, FileSystemBytecodeCache

from fitting.text import rendering


def _environment(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Environment:
    """The environment of texts, which looks for compiled modules in a folder."""
    monkeypatch.setattr(rendering, "__file__", str(folder / "rendering.py"))
    return rendering.environment()


def test_a_template_is_compiled_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "__pycache__").mkdir()
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    first = _environment(tmp_path, monkeypatch).get_template("status.txt.j2")

    def refused(*_: object, **__: object) -> None:
        raise AssertionError("compiled anew")

    again = _environment(tmp_path, monkeypatch)
    monkeypatch.setattr(again, "compile", refused)
    assert dir(again.get_template("status.txt.j2").module) == dir(first.module)


@pytest.mark.parametrize("keeps", [False, True], ids=["none are kept", "no folder"])
def test_nothing_is_written_where_compiled_modules_are_not(
    keeps: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not keeps:
        (tmp_path / "__pycache__").mkdir()
    monkeypatch.setattr(sys, "dont_write_bytecode", not keeps)
    _environment(tmp_path, monkeypatch).get_template("fit.txt.j2")
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_escaped_templates_are_not_those_of_a_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "name.j2").write_text("{{ name }}", encoding="utf-8")
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    plain = _environment(tmp_path, monkeypatch)
    assert isinstance(plain.bytecode_cache, FileSystemBytecodeCache)
    shown = [
        rendering.environment(tmp_path, escaped=escaped).get_template("name.j2").render(name="<b>")
        for escaped in (False, True)
    ]
    assert shown == ["<b>", "&lt;b&gt;"]
