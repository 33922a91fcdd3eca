"""``fmu-fit calibrate``: the FMU with fitted start values, and parameter sets for other tools."""

from __future__ import annotations

import argparse
from pathlib import Path

import fitting as ff
from fitting.api.early import CALIBRATED_FILES
from fitting.cli.running.output import writes
from fitting.cli.words.options import Options, declare, several, value

NAME = "calibrate"
EXAMPLE = "fmu-fit calibrate out/string_q1/result.json --out calibrated"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    options: Options = {
        "result": value("result of a reconstruction", "RESULT.json", Path),
        "--out": {"required": True, "help": "folder for the files"},
        "--fmu": value("the fitted FMU (fmu/ next to RESULT.json, or the campaign's)", read=Path),
    }
    declare(parser, options)
    also = "also write this undetermined parameter; may be repeated"
    options = {
        "--also": several(also, "NAME"),
        "--all": "write all parameters: the best fit as a whole",
    }
    declare(parser.add_mutually_exclusive_group(), options)


@writes(NAME, *CALIBRATED_FILES)
def run(args: argparse.Namespace) -> int:
    """Write the files and print the values; returns 0.

    Raises:
        BadInput: no result, or another FMU than the one that was fitted.
    """
    from fitting.report.screen import printed_lines
    from fitting.result.result import read_result
    from fitting.text.estimate import EVEN

    result = read_result(args.result)
    also = (*result.parameters, *result.alternative) if args.all else args.also
    calibrated = ff.calibrate(args.result, args.out, fmu=args.fmu, also=also)
    made = calibrated.fmu, calibrated.ssv, calibrated.ssp, calibrated.table
    files = [path for path in made if path is not None]
    compiled = (
        calibrated.fmu is None
    )  # start values are compiled into the FMU, which is not written
    records = result.title, calibrated.calibration, EVEN, compiled, files
    print(*printed_lines("calibration", "screen", *records), sep="\n")
    return 0
