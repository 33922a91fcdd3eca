"""Options, progress and results of a command, as all commands have them; loads no library."""

from __future__ import annotations

from fitting.cli.running.campaign_fmu import fmu_for
from fitting.cli.running.output import hand_over
from fitting.cli.running.progress import reading, status_line
from fitting.cli.running.results import writes
from fitting.cli.words.again import add_at, command_again, command_line, fit_at
from fitting.cli.words.columns import add_columns, columns_of
from fitting.cli.words.drive import (
    add_fmu,
    add_interface,
    add_isolate,
    add_timeout,
    complaints_of_options,
    fmu_of,
)
from fitting.cli.words.values import (
    bounded_number,
    default_workers,
    even_number,
    folder_name,
    joint_name,
    positive_time,
    seed,
    whole_number,
    worker_count,
)

__all__ = [
    "add_at",
    "add_columns",
    "add_fmu",
    "add_interface",
    "add_isolate",
    "add_timeout",
    "bounded_number",
    "columns_of",
    "command_again",
    "command_line",
    "complaints_of_options",
    "default_workers",
    "even_number",
    "fit_at",
    "fmu_for",
    "fmu_of",
    "folder_name",
    "hand_over",
    "joint_name",
    "positive_time",
    "reading",
    "seed",
    "status_line",
    "whole_number",
    "worker_count",
    "writes",
]
