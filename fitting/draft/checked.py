"""A draft, and its text read and bound as `reconstruct` will do it, before it is written."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass

from fitting.campaign.binding import bind
from fitting.draft.campaign import completed
from fitting.draft.source import Source
from fitting.measurements.kinds import read_campaign
from fitting.text.errors import BadInput
from fitting.text.files import write_whole
from fitting.text.scratch import Scratch

#: A sweep, to see whether a campaign that has none yet can be read.
EXAMPLE = "frequency (Hz),amplitude (V)\n" + "".join(f"{f},{1.0 + f % 3}\n" for f in range(1, 9))


@dataclass(frozen=True)
class Draft:
    """A campaign as text, and what was found, taken and guessed, in sentences.

    ``undescribed`` says what of the measurements its FMU cannot describe, and why; empty: nothing
    that was seen.
    """

    text: str
    said: tuple[str, ...]
    undescribed: str = ""


def check_text(text: str, source: Source) -> None:
    """The draft read and bound as `reconstruct` will do it, before it is written anywhere.

    Where a measurement is missing, with one that is made up for this alone.

    Args:
        text: of the campaign, all paths absolute.
        source: the FMU.

    Raises:
        BadInput: it does not suit the FMU or its files.
    """
    tomllib.loads(text)
    with Scratch() as folder:
        path = folder / "campaign.toml"
        write_whole(path, completed(text))
        write_whole(folder / "sweep.csv", EXAMPLE)
        try:
            bind(read_campaign(path), source.workers.description.variables)
        except BadInput as error:
            said = (str(t).replace(f"{path}: ", "").replace(str(path), "draft") for t in error.args)
            raise BadInput(*(f"the draft does not suit: {text}" for text in said)) from error
