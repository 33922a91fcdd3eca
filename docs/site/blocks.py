"""The blocks of the pages: what is run, what is not and why, and which outputs are pasted.

A block of ``sh`` or ``python`` is run where nothing else is said, in a folder of its page that has
the shipped ``data`` and the built FMUs. Remarks on the lines above it say otherwise:

    <!-- not run: REASON -->        nobody runs it
    <!-- slow: REASON -->           docs/paste_outputs.py runs it, the tests do not
    <!-- tested with: OPTIONS -->   the tests run it with these options added to each fmu-fit
    <!-- exit code: NUMBER -->      how it ends (0)

A block without a language below one of these is the output of the last block, pasted:

    <!-- output -->                 all of it
    <!-- output: lines 1-12 -->     some lines, counted from 1
    <!-- output: lines with A | ^B -->  those that hold A, or begin with B
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
#: Written by docs/build_reference.py, from code that has tests of its own.
GENERATED = "<!-- Written by docs/build_reference.py"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
REMARK = re.compile(r"<!-- ([a-z][a-z ]*?)(?:: (.*?))? -->")
REMARKS = ("not run", "slow", "tested with", "exit code", "output")
LONGEST_S = 3600.0
#: Printed between the cells of a program.
CELL = "\x1e"


@dataclass(frozen=True, kw_only=True)
class Block:
    """A fenced block: its language, text, place in the page and what is said above it."""

    language: str
    text: str
    start: int
    line: int
    remarks: dict[str, str]

    @property
    def is_run(self) -> bool:
        """Whether anybody runs it."""
        return self.language in ("sh", "python") and "not run" not in self.remarks

    @property
    def is_tested(self) -> bool:
        """Whether the tests run it."""
        return self.is_run and "slow" not in self.remarks

    @property
    def exit_code(self) -> int:
        """How it ends."""
        return int(self.remarks.get("exit code", "0"))

    def commands(self) -> list[list[str]]:
        """The words of every command of a ``sh`` block."""
        lines = self.text.replace("\\\n", " ").splitlines()
        parts = [part for line in lines for part in re.split(r" && | \|\| ", line)]
        return [words for part in parts if (words := shlex.split(part, comments=True))]


def pages() -> list[Path]:
    """The README and every page that is written by hand."""
    found = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
    return [page for page in found if GENERATED not in page.read_text("utf-8")]


def blocks(text: str) -> list[Block]:
    """The blocks of a page.

    Args:
        text: of the page.
    """
    found = []
    for match in FENCE.finditer(text):
        remarks: dict[str, str] = {}
        above = text[: match.start()].rstrip("\n").split("\n")
        while above and (remark := REMARK.fullmatch(above[-1].strip())):
            remarks[remark[1]] = remark[2] or ""
            above.pop()
        line = text.count("\n", 0, match.start()) + 1
        found.append(
            Block(
                language=match[1],
                text=match[2],
                start=match.start(),
                line=line,
                remarks=remarks,
            )
        )
    return found


def prepare(folder: Path) -> None:
    """Make a folder look like a checkout: data, tests, models and the program that builds them.

    Args:
        folder: an empty one.
    """
    for name in ("data", "tests", "fmu_src", "fitting", "docs", "build_fmu.py"):
        (folder / name).symlink_to(ROOT / name)


def run(found: Sequence[Block], folder: Path, *, tested: bool) -> Iterator[tuple[Block, str]]:
    """Run the blocks of a page one after another; each with what it prints on stdout.

    The ``python`` blocks of a page are one program, as the cells of a notebook.

    Args:
        found: blocks of the page.
        folder: where they are run.
        tested: whether only those are run that the tests run, with the options of the tests.

    Raises:
        RuntimeError: one does not end as the page says.
    """
    chosen = [block for block in found if (block.is_tested if tested else block.is_run)]
    cells = [block for block in chosen if block.language == "python"]
    printed: list[str] = []
    for block in chosen:
        if block.language == "sh":
            given = _with_options(block) if tested and "tested with" in block.remarks else block
            words = ["bash", "-euo", "pipefail", "-c", given.text]
            yield block, _printed(words, folder, given.text, block.exit_code)
            continue
        if not printed:
            program = f"print({CELL!r})\n".join(cell.text for cell in cells)
            printed = _printed([sys.executable, "-c", program], folder, program, 0).split(
                f"{CELL}\n"
            )
        yield block, printed[cells.index(block)]


def _printed(words: Sequence[str], folder: Path, text: str, exit_code: int) -> str:
    programs = str(Path(sys.executable).parent)
    told = subprocess.run(  # noqa: S603 - the blocks are this repository's own
        words,
        capture_output=True,
        text=True,
        encoding="utf-8",
        cwd=folder,
        env={
            **os.environ,
            "PATH": programs + os.pathsep + os.environ.get("PATH", ""),
            "PYTHONPATH": str(ROOT),
            "PYTHONIOENCODING": "utf-8",
            "COLUMNS": "100",
        },
        timeout=LONGEST_S,
        check=False,
    )
    if told.returncode != exit_code:
        raise RuntimeError(
            f"{text}ended with {told.returncode}, the page says {exit_code}\n"
            f"{told.stdout}{told.stderr}"
        )
    return told.stdout


def _with_options(block: Block) -> Block:
    """The block with the options of the tests added to each command of ours."""
    options = block.remarks["tested with"]
    lines = []
    for line in block.text.splitlines():
        command, sign, remark = line.partition("  #")
        if "fmu-fit " in command:
            command = f"{command.rstrip()} {options}"
        lines.append(f"{command}{sign}{remark}\n")
    return replace(block, text="".join(lines))


def pasted(block: Block, output: str) -> str:
    """The lines of an output that a page shows.

    Args:
        block: the one that they are pasted into.
        output: of the block above it.
    """
    lines = output.rstrip("\n").split("\n")
    return "".join(f"{line}\n" for line in _chosen(lines, block.remarks["output"]))


def _chosen(lines: Sequence[str], what: str) -> Iterator[str]:
    """The lines that are asked for; three dots stand for those left out between them."""
    if not what:
        yield from lines
        return
    first, last, words = 1, len(lines), [""]
    if (part := re.fullmatch(r"lines (\d+)-(\d+)", what)) is not None:
        first, last = int(part[1]), int(part[2])
    elif what.startswith("lines with "):
        words = what.removeprefix("lines with ").split(" | ")
    else:
        raise ValueError(f"output: {what}: wanted 'lines 1-12' or 'lines with A | B'")
    chosen = [
        i
        for i, line in enumerate(lines, 1)
        if first <= i <= last and any(_holds(line, word) for word in words)
    ]
    before = 0
    for i in chosen:
        if before and i > before + 1:
            yield "..."
        yield lines[i - 1]
        before = i


def _holds(line: str, word: str) -> bool:
    return line.startswith(word[1:]) if word.startswith("^") else word in line
