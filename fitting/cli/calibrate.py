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
    parser.add_argument("result", type=Path, metavar="RESULT.json", help="of a reconstruction")
    parser.add_argument("--out", type=Path, required=True, help="folder for the files")
    parser.add_argument(
        "--fmu", type=Path, help="the FMU that was fitted (fmu/ beside RESULT.json)"
    )
    also = parser.add_mutually_exclusive_group()
    also.add_argument(
        "--also",
        action="append",
        default=[],
        metavar="NAME",
        help="hand on this parameter although the data do not determine it; may be repeated",
    )
    also.add_argument(
        "--all", action="store_true", help="hand on all parameters: the best fit as a whole"
    )


@writes(NAME, *CALIBRATED_FILES)
def run(args: argparse.Namespace) -> int:
    """Write the files and tell what is handed on; returns 0.

    Raises:
        BadInput: no result, or another FMU than the one that was fitted.
    """
    from fitting.report.words.calibration import calibration_lines
    from fitting.result.result import read_result

    also = args.also
    if args.all:
        result = read_result(args.result)
        also = (*result.parameters, *result.alternative)
    found = ff.calibrate(args.result, args.out, fmu=args.fmu, also=also)
    print(*calibration_lines(found.calibration), sep="\n")
    if found.fmu is None:
        print(
            "no FMU is written: start values are compiled into this one, which is none of this "
            "project. The .ssp has it with the values beside it."
        )
    files = (found.fmu, found.ssv, found.ssp, found.table)
    print(f"written: {', '.join(str(path) for path in files if path is not None)}")
    return 0
