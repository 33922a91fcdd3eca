"""Single-line faults put into source text: what a test that can fail must notice."""

from __future__ import annotations

import ast
import tomllib
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


@dataclass(frozen=True, kw_only=True)
class Argued:
    """Faults of one line that change nothing which a test could see, and why.

    `line` is the line's text, by which it is found again; `faults` are those meant, "2.0 -> 4.0",
    all of the line where there are none.
    """

    path: str
    line: str
    reason: str
    faults: tuple[str, ...] = ()

    def says(self, root: Path, mutant: Mutant) -> bool:
        """Whether that is said of a fault.

        Args:
            root: folder of the checkout.
            mutant: what was changed.
        """
        if mutant.path != self.path:
            return False
        if self.faults and f"{mutant.before} -> {mutant.after}" not in self.faults:
            return False
        lines = self._lines(root)
        return mutant.line <= len(lines) and lines[mutant.line - 1] == self.line.strip()

    def stands(self, root: Path) -> bool:
        """Whether the line is there still.

        Args:
            root: folder of the checkout.
        """
        return self.line.strip() in self._lines(root)

    def _lines(self, root: Path) -> list[str]:
        file = root / self.path
        text = file.read_text() if file.is_file() else ""
        return [line.strip() for line in text.splitlines()]


def argued_in(file: Path) -> tuple[Argued, ...]:
    """What a file argues: `[[argued]]` with path, line, reason and, if not all, faults.

    Args:
        file: TOML.
    """
    rows = tomllib.loads(file.read_text()).get("argued", [])
    return tuple(
        Argued(
            path=row["path"],
            line=row["line"],
            reason=row["reason"],
            faults=tuple(row.get("faults", ())),
        )
        for row in rows
    )


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
    """All nodes that run: no annotations, docstrings, text, nor what only asserts."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in {"annotation", "returns", "decorator_list"}:
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, (ast.Raise, ast.JoinedStr)):
                continue
            if isinstance(child, ast.keyword) and child.arg == "strict":
                continue  # zip(strict=True) asserts what holds: without it nothing changes
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
    if node.end_lineno != node.lineno:
        return
    column = _column(node, lines)
    # not `ast.get_source_segment`, which splits the whole file into lines anew for every number
    text = lines[node.lineno - 1].encode()[node.col_offset : node.end_col_offset].decode()
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
