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
    """The complaint of a path that is no campaign's; None: nothing shows what it is.

    Args:
        path: of a folder, or of a file that is not TOML.
    """
    if path.is_dir():
        inside = sorted(each for each in path.glob(f"*{SUFFIX}") if each.is_file())
        inside = [each for each in inside if each.name == USUAL] or inside
        names = " or ".join(map(str, inside[:MOST_NAMED])) + ", ..." * (len(inside) > MOST_NAMED)
        wanted = f" in it: {names}" if inside else f", and there is none in it; {_FROM_FILES}"
        return BadInput(f"{path}: is a folder; wanted a campaign{wanted}")
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
