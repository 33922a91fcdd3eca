"""What stands where a campaign was meant, a folder, an FMU, measurements; and what to do then."""

from __future__ import annotations

import shlex
from pathlib import Path

from fitting.campaign.instruments import PLAIN, foreign_kind, head_of, layout_of
from fitting.campaign.recognised import recognised
from fitting.text.errors import BadInput

SUFFIX, USUAL = ".toml", "campaign.toml"
#: Campaigns of a folder that a complaint names.
MOST_NAMED = 4
_FROM_FILES = "fmu-fit init FILE writes one, of a file of measurements"


def other_kind(path: Path) -> BadInput | None:
    """The complaint of a path that is no campaign's; None: nothing tells what it is.

    Args:
        path: of a folder, or of a file that is not TOML.
    """
    if path.is_dir():
        return BadInput(f"{path}: is a folder; {_in_folder(path)}")
    if path.suffix.lower() == SUFFIX:
        return None
    name = shlex.quote(str(path))
    try:
        kind = foreign_kind(head_of(path))
        if kind == "an FMU":
            return BadInput(
                f"{path}: is an FMU, not a campaign; fmu-fit init FILE --fmu {name} writes the "
                "campaign, of a file of measurements"
            )
        if kind:
            return BadInput(f"{path}: is {kind}, not a campaign; {_FROM_FILES}")
        if layout_of(path) == PLAIN:
            recognised(path)
    except BadInput:  # no such file, or text of another kind
        return None
    return BadInput(
        f"{path}: is a file of measurements, not a campaign; fmu-fit init {name} writes the "
        "campaign"
    )


def _in_folder(folder: Path) -> str:
    found = sorted(each for each in folder.glob(f"*{SUFFIX}") if each.is_file())
    usual = [each for each in found if each.name == USUAL]
    inside = usual or found
    if inside:
        names = " or ".join(map(str, inside[:MOST_NAMED])) + ", ..." * (len(inside) > MOST_NAMED)
        return f"wanted a campaign in it: {names}"
    return f"wanted a campaign, and there is none in it; {_FROM_FILES}"
