"""Commands with their options and exit codes, from the parsers that read them."""

from __future__ import annotations

import argparse
import inspect
import re
from collections import Counter

from docs.site.markdown import code, escaped, table
from fitting.cli.words.parser import COMMANDS, EXIT_CODES, add_options, command_of

INTRODUCTION = """\
# Commands

`fmu-fit COMMAND --help` prints the same, with defaults in brackets; `python -m fitting` is the same
program. Commands write only under `--out`. [Exit codes](exit-codes.md) are the same for all.

With `--json` only the result is on stdout, as for
`fmu-fit reconstruct CAMPAIGN.toml --json | jq .parameters`; progress goes to stderr.
`reconstruct --verbose` also prints the table of values and every [finding](findings.md)."""
SHARED = "## Options of several commands"
BELOW_THE_CODES = """\
Bad input is reported on stderr, a line for each error: file, row, column or key, what was found,
what is required. Where an FMU failed, its own words and the parameters are printed. The traceback
of a fault is kept in `--out`, where that exists, else among the temporary files.
[Interrupt and resume](../how-to/resume.md) lists what is kept."""


def page() -> str:
    """The page: what several commands take, then each command with its own options."""
    options = {name: dict(map(_option, actions_of(name))) for name in COMMANDS}
    count = Counter(option for command in options.values() for option in command.items())
    shared = {option for option, number in count.items() if number > 1}
    everywhere = [key for (key, _), number in count.items() if number == len(COMMANDS)]
    listed = (f"- {key}{text}" for key, text in count if (key, text) in shared)
    parts = [INTRODUCTION, SHARED, "\n".join(listed)]
    parts.append(f"Every command has {', '.join(everywhere)}.")
    for name, command in options.items():
        module = command_of(name)
        doc = inspect.cleandoc(module.__doc__ or "").replace("``", "`").partition(": ")[2]
        parts += [f"## {name}", escaped(doc[0].upper() + doc[1:]), f"    {module.EXAMPLE}"]
        own = (f"- {key}{text}" for key, text in command.items() if (key, text) not in shared)
        parts.append("\n".join(own))
        more = [key for key, text in command.items() if (key, text) in shared]
        more = [re.sub(r" [^`]+", "", key) for key in more if key not in everywhere]
        parts.append(f"Also {', '.join(more)}." if more else "")
    return "\n\n".join(part for part in parts if part)


def exit_codes_page() -> str:
    """The page of the exit codes."""
    rows = [(str(number), meaning) for number, meaning in EXIT_CODES.items()]
    return "\n\n".join(["# Exit codes", table(("exit code", "meaning"), rows), BELOW_THE_CODES])


def actions_of(name: str) -> list[argparse.Action]:
    """Options and arguments of a command.

    Args:
        name: of the command.
    """
    parser = argparse.ArgumentParser(prog=f"fmu-fit {name}", add_help=False)
    add_options(parser, command_of(name))
    return [action for action in parser._actions if action.help is not argparse.SUPPRESS]


def _option(action: argparse.Action) -> tuple[str, str]:
    """An option with what follows it, or an argument; and what it means."""
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
    values = {name: value for name, value in vars(action).items() if value is not None}
    printed = action.help or ""
    text = escaped(printed % values if "%" in printed else printed)
    if action.required and action.option_strings:
        text += " (required)"
    elif action.default and str(action.default).removesuffix(".0") not in text:
        text += f" ({action.default})"
    return code(f"{', '.join(action.option_strings)} {value}".strip()), f": {text}"
