"""Single-line faults put into source text: what a test that can fail must notice."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

#: Operators and what stands in their place.
BINARY: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.Pow: ("**", "*"),
    ast.FloorDiv: ("//", "*"),
}
COMPARE: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Lt: ("<", ">="),
    ast.LtE: ("<=", ">"),
    ast.Gt: (">", "<="),
    ast.GtE: (">=", "<"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
}
#: Names of functions and methods and what is called in their place.
NAMES = {"min": "max", "max": "min", "any": "all", "all": "any", "sin": "cos", "cos": "sin"}
NAMES |= {"minimum": "maximum", "maximum": "minimum", "argmin": "argmax", "argmax": "argmin"}


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """One fault: `before` stands at (line, column) of a file, `after` is put in its place."""

    path: str
    line: int
    column: int
    before: str
    after: str

    @property
    def name(self) -> str:
        """Where it is and what it does."""
        return f"{self.path}:{self.line}:{self.column} {self.before} -> {self.after}"


def mutants_of(root: Path, path: str) -> list[Mutant]:
    """Every fault that can be put into one file, outside docstrings and type annotations.

    Args:
        root: folder of the checkout.
        path: of the file, relative to it.
    """
    text = (root / path).read_text()
    lines = text.splitlines()
    found = {(m.line, m.column, m.after): m for m in _walk(ast.parse(text), lines, path)}
    return [found[key] for key in sorted(found)]


def mutated(text: str, mutant: Mutant) -> str:
    """Source text with the fault in it.

    Args:
        text: the file as it is.
        mutant: what to change.

    Raises:
        ValueError: the text does not hold what the mutant replaces.
    """
    lines = text.splitlines(keepends=True)
    line = lines[mutant.line - 1]
    head, tail = line[: mutant.column], line[mutant.column :]
    if not tail.startswith(mutant.before):
        raise ValueError(f"{mutant.name}: the line holds {tail!r}")
    lines[mutant.line - 1] = head + mutant.after + tail[len(mutant.before) :]
    return "".join(lines)


def _walk(tree: ast.AST, lines: list[str], path: str) -> Iterator[Mutant]:
    for node in _code(tree):
        for place, before, after in _faults(node, lines):
            line, column = place
            yield Mutant(path=path, line=line, column=column, before=before, after=after)


def _code(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes that run: no annotations, no docstrings, no text."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in {"annotation", "returns", "decorator_list"}:
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, (ast.Raise, ast.JoinedStr)):
                continue
            yield from _code(child)


def _faults(node: ast.AST, lines: list[str]) -> Iterator[tuple[tuple[int, int], str, str]]:
    if isinstance(node, ast.BinOp) and type(node.op) in BINARY:
        yield from _between(node.left, node.right, BINARY[type(node.op)], lines)
    elif isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in COMPARE:
        yield from _between(node.left, node.comparators[0], COMPARE[type(node.ops[0])], lines)
    elif isinstance(node, ast.BoolOp) and len(node.values) == 2:
        swap = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        yield from _between(node.values[0], node.values[1], swap, lines)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub)):
        sign = "not " if isinstance(node.op, ast.Not) else "-"
        yield (node.lineno, _column(node, lines)), sign, ""
    elif isinstance(node, ast.Constant) and isinstance(node.value, (bool, int, float)):
        yield from _constant(node, node.value, lines)
    elif isinstance(node, ast.Call):
        yield from _called(node.func, lines)


def _between(
    left: ast.expr, right: ast.expr, swap: tuple[str, str], lines: list[str]
) -> Iterator[tuple[tuple[int, int], str, str]]:
    """The operator between two operands that stand on one line."""
    if left.end_lineno != right.lineno or left.end_lineno is None or left.end_col_offset is None:
        return
    text = lines[left.end_lineno - 1]
    begin = len(text.encode()[: left.end_col_offset].decode())
    stop = len(text.encode()[: right.col_offset].decode())
    at = text[begin:stop].find(swap[0])
    if at >= 0:
        yield (left.end_lineno, begin + at), swap[0], swap[1]


def _constant(
    node: ast.Constant, value: bool | float, lines: list[str]
) -> Iterator[tuple[tuple[int, int], str, str]]:
    column = _column(node, lines)
    text = ast.get_source_segment("\n".join(lines), node) or ""
    if node.end_lineno != node.lineno or not lines[node.lineno - 1][column:].startswith(text):
        return
    yield (node.lineno, column), text, _another(value)


def _another(value: bool | float) -> str:
    if isinstance(value, bool):
        return repr(not value)
    if isinstance(value, int):
        return str(value + 1)
    return repr(2.0 * value or 1.0)


def _called(function: ast.expr, lines: list[str]) -> Iterator[tuple[tuple[int, int], str, str]]:
    name = function.id if isinstance(function, ast.Name) else ""
    name = function.attr if isinstance(function, ast.Attribute) else name
    if name not in NAMES or function.end_lineno is None or function.end_col_offset is None:
        return
    text = lines[function.end_lineno - 1]
    end = len(text.encode()[: function.end_col_offset].decode())
    yield (function.end_lineno, end - len(name)), name, NAMES[name]


def _column(node: ast.expr, lines: list[str]) -> int:
    """Column in characters (the syntax tree counts bytes)."""
    return len(lines[node.lineno - 1].encode()[: node.col_offset].decode())
