"""A file over frequency as a noise spectrum: by its unit or the name of its column."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from fitting.campaign.instruments.roles import (
    DENSITY,
    ROOT,
    Density,
    density_of,
    plain_name,
    relative_density,
)
from fitting.lines.trace import NoiseRecord, noise_record_of
from fitting.resonance.reading import Columns, Roles, hertz_in, lead, map_in, roles_of
from fitting.text.errors import BadInput

#: Names of columns by what they hold, in small letters.
NAMES = {
    ROOT: re.compile(r"\b(asd|lsd|(amplitude|linear) spectral density)\b"),
    DENSITY: re.compile(r"\b(psd|pxx|s_?xx|(spectral|noise) density|noise power)\b"),
}
#: Why a file is taken for a noise spectrum.
BY_UNIT, BY_NAME = "unit", "name"


def stated_density(roles: Roles) -> Density | None:
    """The density in a file's column of sizes; None where neither unit nor name is that of one.

    Args:
        roles: of its columns.
    """
    channel = roles.sizes
    if channel is None or roles.is_complex:
        return None
    column, numbers = roles.recording.column(channel.name), roles.recording.numbers(channel)
    name = plain_name(column)
    named = next((way for way, words in NAMES.items() if words.search(name)), "")
    known = density_of(numbers, channel.unit) if channel.unit else None
    if known is not None:
        # stated by the reader, and not by the file
        holds = ROOT if known.is_root else DENSITY
        holds = "" if column.unit == channel.unit else holds
        return replace(known, by=BY_UNIT, holds=holds)
    if not named:
        return None
    return replace(relative_density(numbers, channel.unit, named), by=BY_NAME, holds=named)


def is_noise_spectrum(path: Path, columns: Columns) -> bool:
    """Whether a file is a noise spectrum by its unit or its name.

    Args:
        path: of the file.
        columns: what is stated of its columns.
    """
    try:
        roles = roles_of(path, columns)
        return stated_density(roles) is not None and map_in(roles) is None
    except BadInput:
        return False  # its reader names the error


def read_noise_of(path: Path, columns: Columns) -> NoiseRecord:
    """The noise spectrum that a file holds, and how it was read.

    Args:
        path: of the file.
        columns: what is stated of its columns.

    Raises:
        BadInput: a file that is not read, one that is no noise spectrum, a density not above zero.
    """
    roles = roles_of(path, columns)
    density = stated_density(roles)
    if density is None:
        raise BadInput(
            f"{path}: neither unit nor name shows that it is a noise spectrum; wanted its unit, as "
            '--unit-amplitude "V**2/Hz"'
        )
    unit = "1" if density.is_relative else density.unit
    made = noise_record_of(hertz_in(roles), density.numbers, unit, str(path))
    what = "root of the density" if density.is_root else "density"
    return replace(made, reading=(*lead(roles, what), *roles.recording.unused(*roles.all)))
