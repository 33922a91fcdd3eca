"""Printed text uses the words of the field: the glossary's left column is searched for."""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from fitting.cli.words.parser import COMMANDS, parser_of

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "fitting"
#: Words that this project alone used, and what is written now.
GLOSSARY = {
    r"tells?|told|telling": "prints, reports, lists; constrains, determines",
    r"says?|said|saying": "prints, reports, lists",
    r"stands?(?! still)|stood": "is printed, is listed",
    r"beside": "next to, besides",
    r"nobody": "not measured, assumed",
    r"the laboratory (?:sees|leaves)": "is measured",
    r"hangs? together": "correlated",
    r"of unequal size": "heteroscedastic",
    r"times as wide": "errors scaled by",
    r"worth \d+ independent": "effective sample size",
    r"walks?|walked|walking": "scan",
    r"box(?:es)?": "bounds",
    r"goes round|fits to the end|no data end": "periodic, reaches the bound, unconstrained",
    r"dear(?:er)?": "expensive",
    r"twins?": "equivalent solution",
    r"astray|let out|begun": "diverged, relaxed bounds, started",
    r"ends with \d": "exit code",
    r"on another way": "by a different route",
    r"complain(?:s|ts?|ed)?": "errors",
    r"honest": "nothing: errors are errors",
    r"doctor": "check",
}
#: Text that keeps such a word, and why.
EXCEPTIONS = {
    'model = "offsets" or "walk"': "a value of the key [drift] model",
    '"walk"': "a value of the key [drift] model",
    "random walk": "a term of statistics",
    "--beside": "an option of release 0.2.0",
    "'beside'": "that option's name in Python",
    "bounding box": "a term of drawing",
    "boxstyle": "an argument of matplotlib",
}
#: Packages whose string constants are searched, too; those of the others follow.
SEARCHED = ("cli",)


def offences(text: str) -> list[str]:
    """Words of the glossary's left column in a text, with their surroundings."""
    for kept in EXCEPTIONS:
        text = text.replace(kept, " ")
    return [
        f"{text[max(0, match.start() - 30) : match.end() + 30]!r}: {now}"
        for word, now in GLOSSARY.items()
        for match in re.finditer(rf"\b(?:{word})\b", text, re.IGNORECASE)
    ]


def printed(template: str) -> str:
    """What a template prints: its text, and the strings of its expressions."""
    text = re.sub(r"\{#.*?#\}", " ", template, flags=re.DOTALL)
    text = re.sub(r"<(style|script)>.*?</\1>", " ", text, flags=re.DOTALL)
    pieces = re.split(r"(\{[{%].*?[%}]\})", text, flags=re.DOTALL)
    return " ".join(
        " ".join(a or b for a, b in re.findall(r"'([^'\n]*)'|\"([^\"\n]*)\"", piece))
        if piece.startswith(("{{", "{%"))
        else piece
        for piece in pieces
    )


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.j2")), ids=lambda path: path.name)
def test_templates(path: Path) -> None:
    assert offences(printed(path.read_text("utf-8"))) == []


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "1000")
    parser = parser_of(tuple(COMMANDS))
    if command:
        [commands] = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
        parser = commands.choices[command]
    assert offences(parser.format_help()) == []


@pytest.mark.parametrize(
    "path", sorted((ROOT / "tests" / "golden").glob("*.txt")), ids=lambda path: path.name
)
def test_golden_texts(path: Path) -> None:
    assert offences(path.read_text("utf-8")) == []


def constants(tree: ast.AST) -> Iterator[ast.Constant]:
    """String constants outside docstrings."""
    holders = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docstrings = {
        id(statement.value)
        for node in ast.walk(tree)
        if isinstance(node, holders)
        for statement in node.body
        if isinstance(statement, ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and id(node) not in docstrings:
            yield node


@pytest.mark.parametrize("package", SEARCHED)
def test_string_constants(package: str) -> None:
    found = []
    for path in sorted((PACKAGE / package).rglob("*.py")):
        for node in constants(ast.parse(path.read_text("utf-8"))):
            # names of attributes, keys and options are no sentences
            if isinstance(node.value, str) and " " in node.value:
                found += [f"{path.name}:{node.lineno}: {o}" for o in offences(node.value)]
    assert found == []
