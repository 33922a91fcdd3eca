"""Options, progress and results of a command, as all commands have them; loads no library."""

from __future__ import annotations

from fitting.api.progress import reading, status_line
from fitting.cli.running.campaigns import (
    command_again,
    command_line,
    complaints_of_options,
    fit_at,
    fmu_for,
    fmu_of,
)
from fitting.cli.running.output import hand_over, writes
from fitting.cli.words.options import (
    ISOLATE,
    Options,
    add_columns,
    bounded_number,
    columns_of,
    declare,
    default_workers,
    folder_names,
    positive_time,
    value,
    whole_number,
)

__all__ = [
    "ISOLATE",
    "Options",
    "add_columns",
    "bounded_number",
    "columns_of",
    "command_again",
    "command_line",
    "complaints_of_options",
    "declare",
    "default_workers",
    "fit_at",
    "fmu_for",
    "fmu_of",
    "folder_names",
    "hand_over",
    "positive_time",
    "reading",
    "status_line",
    "value",
    "whole_number",
    "writes",
]
