"""Every block of README and documentation runs as it is printed, or says why it does not."""

from __future__ import annotations

import contextlib
import io
import json
import re
import shlex
import tomllib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from docs.site import blocks as site_blocks
from docs.site.blocks import REMARKS, ROOT, blocks, pages, pasted, prepare, run
from fitting.cli.words.parser import parsed
from fitting.measurements.schema import campaign_schema
from tests.support.in_process import told

#: Programs beside Python and ours that a reader has.
PROGRAMS = (
    *(".", "bash", "cat", "cd", "echo", "export", "head", "jq", "mkdocs", "mpiexec", "pip", "sed"),
    "unzip",
)
PAGES = {page.relative_to(ROOT).as_posix(): page for page in pages()}
ALL = {name: blocks(page.read_text("utf-8")) for name, page in PAGES.items()}


def named(wanted: str) -> list[str]:
    """Names of the pages that have such blocks."""
    return [name for name, found in ALL.items() if any(b.language == wanted for b in found)]


@pytest.mark.parametrize("name", PAGES)
def test_remarks_are_known_and_have_a_reason(name: str) -> None:
    for block in ALL[name]:
        assert set(block.remarks) <= set(REMARKS), f"{name}:{block.line}"
        for remark in ("not run", "slow", "tested with"):
            assert block.remarks.get(remark, "a reason"), f"{name}:{block.line} says no reason"
    fences = re.findall(r"^\s*```", PAGES[name].read_text("utf-8"), re.MULTILINE)
    assert len(fences) == 2 * len(ALL[name]), "a fence that is indented or not closed"


in_processes = site_blocks._printed


def printed(words: Sequence[str], folder: Path, text: str, exit_code: int) -> str:
    """What a block prints, in this process where it consists of ``fmu-fit`` and Python alone.

    Raises:
        RuntimeError: it does not end as the page says.
    """
    if words[1] == "-c":
        out = io.StringIO()
        with contextlib.chdir(folder), contextlib.redirect_stdout(out):
            exec(compile(text, "the page", "exec"), {"__name__": "__main__"})
        return out.getvalue()
    lines = [shlex.split(s, comments=True) for s in text.replace("\\\n", " ").splitlines()]
    commands = [line for line in lines if line]
    if any(line[0] != "fmu-fit" or set(line) & {"|", "||", "&&", ">"} for line in commands):
        return in_processes(words, folder, text, exit_code)
    with contextlib.chdir(folder):
        endings = [told(*line[1:]) for line in commands]
    codes = [ending.code for ending in endings]
    if codes != [*[0] * (len(commands) - 1), exit_code]:
        raise RuntimeError(f"{text}ended with {codes}\n{[ending.err for ending in endings]}")
    return "".join(ending.out for ending in endings)


#: Pages whose blocks take longest; each of their commands has tests of its own.
LONG = (
    "docs/how-to/control-sweep.md",
    "docs/how-to/other-tools.md",
    "docs/tutorials/notebook.md",
)
RUN = [
    pytest.param(name, marks=[pytest.mark.nightly] if name in LONG else [])
    for name, found in ALL.items()
    if any(block.is_tested for block in found)
]


@pytest.mark.usefixtures("swift_models")
@pytest.mark.parametrize("name", RUN)
def test_the_blocks_run_and_print_what_is_pasted(
    name: str, tmp_path: Path, oscillator_fmu: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(site_blocks, "_printed", printed)
    monkeypatch.setenv("COLUMNS", "100")
    prepare(tmp_path)
    (tmp_path / "build").mkdir()
    (tmp_path / "build" / oscillator_fmu.name).symlink_to(oscillator_fmu)
    found = ALL[name]
    said = {block.start: output for block, output in run(found, tmp_path, tested=True)}
    output: str | None = None
    for block in found:
        if block.is_run:
            output = None if "tested with" in block.remarks else said.get(block.start)
        elif "output" in block.remarks and output is not None:
            again = f"run 'python docs/paste_outputs.py {name}'"
            assert shape(pasted(block, output)) == shape(block.text), again


def shape(text: str) -> str:
    """A text without its numbers, whose last digits are a processor's own, and without columns."""
    return re.sub(r"[ \t]+", " ", re.sub(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?", "#", text))


@pytest.mark.parametrize("name", named("sh"))
def test_every_command_is_one_that_can_be_given(name: str) -> None:
    for block in ALL[name]:
        if block.language != "sh":
            continue
        for words in block.commands():
            program = words[0].rpartition("/")[2]
            if program == "fmu-fit":
                assert parsed(words[1:])
            elif program.startswith("python") and words[1:2] == ["-m"]:
                place = ROOT / words[2].replace(".", "/")
                assert words[2] in ("venv", "fitting") or place.with_suffix(".py").is_file(), words
            elif program.startswith("python"):
                assert (ROOT / words[1]).is_file(), words
            else:
                assert program in PROGRAMS, f"{name}:{block.line}: {words}"


@pytest.mark.parametrize("name", named("python"))
def test_python_that_is_not_run_is_python(name: str) -> None:
    for block in ALL[name]:
        if block.language == "python":
            compile(block.text, f"{name}:{block.line}", "exec")


@cache
def schema() -> jsonschema.Draft7Validator:
    """Of a part of a campaign."""
    return jsonschema.Draft7Validator(without_required(json.loads(campaign_schema())))


@pytest.mark.parametrize("name", named("toml"))
def test_campaigns_and_parts_of_them_fit_the_schema(name: str) -> None:
    for block in ALL[name]:
        if block.language == "toml" and "not run" not in block.remarks:
            errors = [e.message for e in schema().iter_errors(tomllib.loads(block.text))]
            assert not errors, f"{name}:{block.line}: {errors}"


def without_required(schema: Any) -> Any:
    """The schema of a part of a file: no key of it has to be there."""
    if isinstance(schema, list):
        return [without_required(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    return {
        key: without_required(value)
        for key, value in schema.items()
        if not (key == "required" and isinstance(value, list))
    }


def test_remarks_and_choices_of_lines_are_read() -> None:
    page = (
        "<!-- slow: a minute -->\n<!-- exit code: 4 -->\n```sh\nfmu-fit a && fmu-fit b  # c\n```\n"
        "<!-- output: lines with x | y -->\n```\nold\n```\n```toml\na = 1\n```\n"
    )
    first, second, third = blocks(page)
    assert first.remarks == {"slow": "a minute", "exit code": "4"}
    assert first.commands() == [["fmu-fit", "a"], ["fmu-fit", "b"]]
    assert (first.is_run, first.is_tested, first.exit_code, first.line) == (True, False, 4, 3)
    assert pasted(second, "x1\nn\ny\nz\n") == "x1\n...\ny\n"
    assert not third.is_run
