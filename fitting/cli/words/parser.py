"""The words of the command line: which commands there are, and what each of them takes."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import itertools
import re
from collections.abc import Sequence
from types import ModuleType
from typing import Any, NoReturn

import fitting
from fitting.text.errors import BadInput, did_you_mean

#: What each command does. It is a module of `fitting.cli` with NAME, EXAMPLE, add_arguments and
#: run, and DOCUMENT where `--json` has something to print; it is imported when the command is
#: called: the list of all takes no library.
COMMANDS = {
    "example": "a shipped campaign with all its files, to try and to start from",
    "line": "one resonance of one file, no campaign: frequency, FWHM and Q with their errors",
    "init": "a commented campaign that runs as it is, from files of measurements and an FMU",
    "reconstruct": "the main job: Algorithms 1 and 2 through the FMU, to tables, figures and a "
    "report",
    "posterior": "draws from the posterior of a fit: intervals, minima, corner figure",
    "identify": "what these data determine, before or after a fit: directions, intervals, verdicts",
    "design": "which measurement next: proposed settings, and how well a value would then be known",
    "simulate": "one drive through an FMU: time trace with beating, spectrum with its peaks",
    "sweep": "an FRF through an FMU, upwards and downwards: hysteresis, jump frequencies",
    "synthesize": "a virtual laboratory: a campaign with known truth, noise and drift",
    "tradeoff": "accuracy against cost, measured on this machine: solvers, windows, settling, "
    "steps",
    "ensemble": "many laboratories or campaigns, on processes or a cluster: table, pulls, coverage",
    "calibrate": "a fit for other tools: the FMU with the fitted start values, .ssv, .ssp and a "
    "table",
    "check": "will this FMU load, validate, run, survive a reset, and suit a campaign",
    "completion": "completion of commands, options and file names by a shell: bash, zsh, tcsh",
    "help": "the pages of the documentation",
}
#: Modules of the commands of optional packages; that of every other is in `fitting.cli`.
HOMES = {
    "posterior": "posterior.command",
    "ensemble": "ensembles.command",
    "check": "check.command",
    "design": "design.command",
    "init": "draft.command",
    "synthesize": "lab.command",
    "tradeoff": "lab.tradeoff.command",
}
PROGRAM = "fmu-fit"
#: What the exit codes mean, for --help and the documentation.
EXIT_CODES = {
    0: "done, converged, and the model describes the data; incomplete searches are marked",
    1: "ended without convergence, or before all was done (interrupted, no profiles): results are "
    "written and marked",
    2: "bad input",
    3: "the FMU failed",
    4: "done, but the model does not describe the data",
    70: "a fault of this program: the traceback is kept in a file that is named",
    130: "interrupted before there was anything to write",
}
#: An example that reads a shipped campaign, as a campaign of one's own.
SHIPPED = re.compile(r" (\w+)/campaign\.toml")


class _Once(argparse._StoreAction):
    """An option with one value: of two the last would silently be taken, so they are refused."""

    is_given = False

    def __call__(self, parser: Any, namespace: Any, values: Any, option: str | None = None) -> None:
        if option is not None and self.is_given:
            raise argparse.ArgumentError(self, "is given twice, wanted once")
        self.is_given = True
        super().__call__(parser, namespace, values, option)


class Parser(argparse.ArgumentParser):
    """Reports errors in one line, like everything else here; made anew for every command line."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for action in (None, "store"):  # what an option does where it states nothing else
            self.register("action", action, _Once)

    def error(self, message: str) -> NoReturn:
        """Refuse the words of the command line.

        Args:
            message: of argparse.

        Raises:
            BadInput: always.
        """
        raise BadInput(f"{message} (see {self.prog} --help)")

    def _get_value(self, action: argparse.Action, arg_string: str) -> object:
        """The value of a word; argparse has words of its own for a ValueError."""
        try:
            return super()._get_value(action, arg_string)
        except argparse.ArgumentError as error:
            if isinstance(error.__context__, BadInput):
                raise error.__context__ from None
            raise


class _Help(argparse.HelpFormatter):
    """Leaves indented lines as they are, to be copied."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if "\n  " not in text:
            return super()._fill_text(text, width, indent)
        return "".join(f"{indent}{line}\n" for line in text.splitlines()).rstrip("\n")


def parsed(given: Sequence[str]) -> argparse.Namespace:
    """The arguments of a command; ``run`` and ``parser`` among them are the command's own.

    Args:
        given: words of the command line.

    Raises:
        BadInput: words that mean nothing: a line for each unknown option, with the nearest one.
    """
    named = next((word for word in given if not word.startswith("-")), None)
    if named is not None and named not in COMMANDS:
        hint = did_you_mean(named, list(COMMANDS))
        raise BadInput(f"no command {named!r}{hint} (see {PROGRAM} --help)")
    parser = parser_of(() if named is None else (named,))
    if named is not None:  # options that the command has not, before those that are missing
        actions = commands_of(parser)[named]._actions
        known = [option for action in actions for option in action.option_strings]
        words = itertools.takewhile(lambda w: w != "--", given[given.index(named) + 1 :])
        requested = [word.partition("=")[0] for word in words if word.startswith("--")]
        complaints = [
            f"no option {option!r}{did_you_mean(option, known, listed=False)} "
            f"(see {PROGRAM} {named} --help)"
            for option in dict.fromkeys(requested)
            if " " not in option and not any(name.startswith(option) for name in known)
        ]
        if complaints:
            raise BadInput(*complaints)
    return parser.parse_args(given)


def overview() -> str:
    """What ``fmu-fit`` prints by itself: every command with an example."""
    width = max(map(len, COMMANDS))
    lines = [f"fmu-fit {fitting.__version__}: {(fitting.__doc__ or '').splitlines()[0]}", ""]
    for name, summary in COMMANDS.items():
        lines.append(f"{name:{width}}  {summary}")
        with contextlib.suppress(ModuleNotFoundError):  # an optional package may be deleted
            lines.append(f"{'':{width}}    {command_of(name).EXAMPLE}")
    options = f"options of a command: {PROGRAM} COMMAND --help; documentation: {PROGRAM} help"
    copied = f"string_q1/ of the examples: {PROGRAM} example string_q1"
    return "\n".join([*lines, "", copied, options])


def parser_of(names: Sequence[str]) -> Parser:
    """The parser of the program, with the options of some commands.

    Args:
        names: of the commands that are imported; of the others it knows what they do.
    """
    codes = "; ".join(f"{number} {meaning}" for number, meaning in EXIT_CODES.items())
    parser = Parser(prog=PROGRAM, description=fitting.__doc__, epilog=f"exit codes: {codes}")
    parser.add_argument("--version", action="version", version=f"fmu-fit {fitting.__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=Parser)
    for name, summary in COMMANDS.items():
        if name not in names:
            commands.add_parser(name, help=summary)
            continue
        command = command_of(name)
        epilog = f"example:\n  {command.EXAMPLE}"
        for shipped in dict.fromkeys(SHIPPED.findall(command.EXAMPLE)):
            epilog += f"\nmake {shipped} first:\n  {PROGRAM} example {shipped}"
        sub = commands.add_parser(
            name,
            help=summary,
            description=(command.__doc__ or "").replace("``", "'"),
            epilog=epilog,
            formatter_class=_Help,
        )
        add_options(sub, command)
        sub.set_defaults(run=command.run, parser=sub)
    return parser


def command_of(name: str) -> ModuleType:
    """The module of a command.

    Args:
        name: one of COMMANDS.
    """
    return importlib.import_module(f"fitting.{HOMES.get(name, f'cli.{name}')}")


def add_options(parser: argparse.ArgumentParser, command: ModuleType) -> None:
    """Declare what a command takes, and what every command takes.

    Args:
        parser: of the command.
        command: its module.
    """
    from fitting.cli.words.options import Options, declare, value  # the program's help needs none

    command.add_arguments(parser)
    output = parser.add_argument_group("output")
    options: Options = {
        "--quiet": "only errors, neither progress nor summary",
        "--verbose": "print details, and every step on stderr",
    }
    declare(output.add_mutually_exclusive_group(), options)
    log = value("file to which every step is added with its time", "FILE")
    declare(output, {"--log": log})
    document = getattr(command, "DOCUMENT", None)
    if document is not None:
        declare(output, {"--json": f"{document} as JSON, alone on stdout"})


def commands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The parsers of all commands, by name.

    Args:
        parser: of the program.
    """
    [made] = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    return dict(made.choices)
