"""The fit that a command sets out from: ``--at RESULT.json``, ``--changed-data``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fitting.result.result import Result


def add_at(parser: argparse.ArgumentParser, text: str, *, required: bool = False) -> None:
    """Declare both options.

    Args:
        parser: of the command.
        text: what the fit is for.
        required: whether the command does nothing without one.
    """
    parser.add_argument("--at", type=Path, required=required, metavar="RESULT.json", help=text)
    parser.add_argument(
        "--changed-data",
        action="store_true",
        help="take a fit whose data files have changed since, or are others",
    )


def fit_at(args: argparse.Namespace) -> Result | None:
    """The fit; None where none is named.

    Args:
        args: of the command.

    Raises:
        BadInput: it cannot be read.
    """
    # the work takes libraries along, help does not
    from fitting.result.result import read_result
    from fitting.result.same_data import of_any_data

    if args.at is None:
        return None
    result = read_result(args.at)
    return of_any_data(result) if args.changed_data else result
