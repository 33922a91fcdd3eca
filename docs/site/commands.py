"""Commands with their options and exit codes, from the parsers that read them."""

from __future__ import annotations

import argparse
import inspect

from docs.site.markdown import code, escaped, table
from fitting.cli.words.parser import COMMANDS, EXIT_CODES, add_options, command_of

INTRODUCTION = """\
# Commands

`fmu-fit COMMAND --help` shows the same in a terminal; `python -m fitting` is the same program.
`FMU` is a file, or the name of a model of this project, as `CoupledOscillator`. Every command
writes only under `--out`. [Exit codes](exit-codes.md) are the same for all.

With `--json` the result stands on stdout as one document, and nothing else does, so that
`fmu-fit reconstruct CAMPAIGN.toml --json | jq .parameters` works. Progress and the lines of
`--verbose` go to stderr. `reconstruct --verbose` also prints the table of values and every
[finding](findings.md) below its first screen."""
BELOW_THE_CODES = """\
Bad input is told on stderr, a line for each complaint: file, row, column or key, what was found,
what is wanted. Where an FMU failed, its own words and the parameters are told. The traceback of a
fault is kept in `--out`, where that is there, else among the temporary files.
[Interrupt and resume](../how-to/resume.md) tells what is kept."""


def page() -> str:
    """The page: a table of all commands, then each with its options."""
    overview = [(f"[`{name}`](#{name})", does) for name, does in COMMANDS.items()]
    parts = [INTRODUCTION, table(("command", "does"), overview)]
    return "\n\n".join([*parts, *map(_command, COMMANDS)])


def exit_codes_page() -> str:
    """The page of the exit codes."""
    rows = [(str(number), meaning) for number, meaning in EXIT_CODES.items()]
    return "\n\n".join(["# Exit codes", table(("exit code", "meaning"), rows), BELOW_THE_CODES])


def _command(name: str) -> str:
    module = command_of(name)
    parser = argparse.ArgumentParser(prog=f"fmu-fit {name}", add_help=False)
    add_options(parser, module)
    told = escaped(inspect.cleandoc(module.__doc__ or "").replace("``", "`"))
    rows = [
        (_spelled(action), _meaning(action), _usual(action))
        for action in parser._actions
        if action.help is not argparse.SUPPRESS
    ]
    parts = [f"## {name}", told, f"    {module.EXAMPLE}"]
    if rows:
        parts.append(table(("argument", "meaning", "default"), rows))
    return "\n\n".join(parts)


def _spelled(action: argparse.Action) -> str:
    """An option with what follows it, or the name of an argument."""
    if action.choices is not None:
        value = f"{{{','.join(map(str, action.choices))}}}"
    elif isinstance(action.metavar, tuple):
        value = " ".join(action.metavar)
    else:
        value = action.metavar or (action.dest.upper() if action.option_strings else action.dest)
    if action.nargs == 0:
        value = ""
    elif action.nargs in ("+", "*"):
        value = f"{value} ..."
    names = ", ".join(action.option_strings)
    return code(f"{names} {value}".strip())


def _meaning(action: argparse.Action) -> str:
    values = {name: value for name, value in vars(action).items() if value is not None}
    return (action.help or "") % values if "%" in (action.help or "") else action.help or ""


def _usual(action: argparse.Action) -> str:
    usual = action.default
    if action.required or (not action.option_strings and action.nargs not in ("?", "*")):
        return "required"
    if usual is None or usual is argparse.SUPPRESS or usual in (False, (), []) or action.nargs == 0:
        return ""
    return code(str(usual))
