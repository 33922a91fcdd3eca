"""``fmu-fit``: finds the command, runs it, turns its ending into an exit code.

0 done; 1 ended without convergence (results are written and say so); 2 bad input; 3 the FMU failed;
130 another command than reconstruct was interrupted.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

import fitting
from fitting.text.errors import BadInput, FmuFailure

#: What each command does. It is a module of `fitting.cli` with NAME, EXAMPLE, add_arguments and
#: run, which is imported when the command is called: the list of all takes no library.
COMMANDS = {
    "example": "a shipped campaign with all its files, to try and to start from",
    "reconstruct": "the main job: Algorithms 1 and 2 through the FMU, to tables, figures and a "
    "report",
    "identify": "what these data determine, before or after a fit: directions, intervals, verdicts",
    "design": "which measurement next: proposed settings, and how well a value would then be known",
    "simulate": "one drive through an FMU: time trace with beating, spectrum with its peaks",
    "sweep": "an FRF through an FMU, upwards and downwards: hysteresis, jump frequencies",
    "synthesize": "a virtual laboratory: a campaign with known truth, noise and drift",
    "tradeoff": "accuracy against cost, measured on this machine: solvers, windows, settling, "
    "steps",
    "check": "will this FMU load, validate, run, survive a reset, and suit a campaign",
}

BAD_INPUT, FMU_FAILED, INTERRUPTED = 2, 3, 130
#: More complaints about one input are counted, not printed.
MOST_COMPLAINTS = 20


class _Parser(argparse.ArgumentParser):
    """Complains in one line, like everything else here."""

    def error(self, message: str) -> NoReturn:
        raise BadInput(f"{message} (see {self.prog} --help)")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code.

    Args:
        arguments: words of the command line, None for the process's own.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        chosen = _parser(given).parse_args(given)
        code: int = chosen.run(chosen)
        sys.stdout.flush()
    except BadInput as error:
        return _complain(error, BAD_INPUT)
    except FmuFailure as error:
        return _complain(error, FMU_FAILED)
    except KeyboardInterrupt:
        return _complain("interrupted", INTERRUPTED)
    except BrokenPipeError:
        # the reader of our output has seen enough; nothing is to be flushed into it at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return code


def _complain(error: object, code: int) -> int:
    """A line on stderr for each complaint."""
    complaints = error.args if isinstance(error, BadInput) else (error,)
    for complaint in complaints[:MOST_COMPLAINTS]:
        print(f"fmu-fit: {' '.join(str(complaint).split())}", file=sys.stderr)
    if len(complaints) > MOST_COMPLAINTS:
        print(f"fmu-fit: and {len(complaints) - MOST_COMPLAINTS} more complaints", file=sys.stderr)
    return code


def _parser(given: Sequence[str]) -> argparse.ArgumentParser:
    parser = _Parser(prog="fmu-fit", description=fitting.__doc__, epilog=__doc__.split("\n\n")[1])
    parser.add_argument("--version", action="version", version=f"fmu-fit {fitting.__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=_Parser)
    named = next((word for word in given if word in COMMANDS), None)
    for name, summary in COMMANDS.items():
        if name != named:
            commands.add_parser(name, help=summary)
            continue
        command = importlib.import_module(f"fitting.cli.{name}")
        sub = commands.add_parser(
            name,
            help=summary,
            description=(command.__doc__ or "").replace("``", "'"),
            epilog=f"example: {command.EXAMPLE}",
        )
        command.add_arguments(sub)
        sub.set_defaults(run=command.run)
    return parser
