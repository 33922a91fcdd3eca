"""``fmu-fit calibrate``: the FMU with fitted start values, and parameter sets for other tools."""

from __future__ import annotations

import argparse
from pathlib import Path

import fitting as ff
from fitting.api.written import CALIBRATED_FILES
from fitting.cli.running.results import writes

NAME = "calibrate"
EXAMPLE = "fmu-fit calibrate out/string_q1/result.json --out calibrated"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "result", type=Path, metavar="RESULT.json", help="result of a reconstruction"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the files")
    parser.add_argument(
        "--fmu", type=Path, help="the FMU that was fitted (default: fmu/ next to RESULT.json)"
    )
    also = parser.add_mutually_exclusive_group()
    also.add_argument(
        "--also",
        action="append",
        default=[],
        metavar="NAME",
        help="also write this parameter, which the data do not determine; may be repeated",
    )
    also.add_argument(
        "--all", action="store_true", help="write all parameters: the best fit as a whole"
    )


@writes(NAME, *CALIBRATED_FILES)
def run(args: argparse.Namespace) -> int:
    """Write the files and print the values; returns 0.

    Raises:
        BadInput: no result, or another FMU than the one that was fitted.
    """
    from fitting.report.screens import calibration_lines
    from fitting.result.result import read_result

    result = read_result(args.result)
    also = (*result.parameters, *result.alternative) if args.all else args.also
    calibrated = ff.calibrate(args.result, args.out, fmu=args.fmu, also=also)
    files = [
        p
        for p in (calibrated.fmu, calibrated.ssv, calibrated.ssp, calibrated.table)
        if p is not None
    ]
    lines = calibration_lines(
        result.title, calibrated.calibration, files, compiled=calibrated.fmu is None
    )
    print(*lines, sep="\n")
    return 0
