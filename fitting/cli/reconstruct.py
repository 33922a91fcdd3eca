"""``fmu-fit reconstruct``: from a laboratory campaign to the coefficients, through the FMU."""

from __future__ import annotations

import argparse
from pathlib import Path

from fitting.api.early import LEVELS_FILE, RESULT_FILES
from fitting.cli.running.output import writes
from fitting.cli.words.options import (
    ISOLATE,
    USUAL_BUDGET,
    Options,
    declare,
    folder_names,
    one_of,
    several,
    value,
)
from fitting.text.choices import ESTIMATORS, FORMATS, MISFITS, STYLES

NAME = "reconstruct"
DOCUMENT = "result.json"
EXAMPLE = "fmu-fit reconstruct string_q1/campaign.toml --out out/string_q1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    several_campaigns = "campaign file; several of one sample are fitted together"
    external = 'a value from elsewhere to test, as lambda="0.8604 MHz" or "0.8604 MHz +- 1 kHz"'
    options: Options = {
        "campaign": {"nargs": "+", "help": several_campaigns},
        "--out": "folder for results (out/<campaign's folder>)",
        "--workers": {},
        **ISOLATE,
        "--native": {},
        "--resume": "continue after the last finished level",
        "--accuracy": "relative accuracy of simulated amplitudes (the campaign's)",
        "--external": several(external, "NAME=VALUE"),
        "--misfit": one_of(MISFITS, "form of the misfit (the campaign's)"),
        "--estimator": one_of(
            ESTIMATORS, "reported estimate; errors are the likelihood's (the campaign's)"
        ),
        "--seed": "seed of the search (the campaign's)",
        "--starts": "1: search only if noise does not explain the start's fit; more: always (the "
        "campaign's)",
        "--start": value(
            "start at the values of a parameter set (the campaign's)", "SET.ssv", Path
        ),
        "--no-path": "leave out the levels of ν (Algorithm 2)",
        "--global-path": "also minimise every level of ν by a multistart within all bounds (slow)",
        "--quick": "one start, no levels of ν",
        "--no-profiles": {},
        "--budget": f"FMU runs for profiles, about; incomplete ones are marked ({USUAL_BUDGET})",
        "--bootstrap": "refit N synthetic data sets (none)",
        "--no-report": {},
        "--style": one_of(
            STYLES,
            "paper: also PDF for print, 3.4 and 7 in wide; interactive: figures can be "
            "zoomed, needs fmu-fit[interactive]",
        ),
        "--formats": one_of(
            FORMATS, "further formats of figures (SVG and CSV)", nargs="+", default=[]
        ),
        "--dry-run": "only print the expected cost: runs, seconds, memory; nothing is written",
    }
    declare(parser, options)


def _out(args: argparse.Namespace) -> Path:
    return args.out or Path("out") / folder_names(*args.campaign)


@writes(NAME, *RESULT_FILES, LEVELS_FILE, to=_out)
def run(args: argparse.Namespace) -> int:
    """Reconstruct and write; 0 if converged, 4 if the data are not described, else 1.

    Raises:
        BadInput: campaign, data or FMU are not what they should be.
        FmuFailure: the FMU failed.
    """
    # the work takes libraries along, help does not
    from fitting.api.examples import built_ahead

    with built_ahead(args.campaign, native=args.native):
        from fitting.cli.running.reconstruction import reconstruct

        return reconstruct(args, _out(args))
