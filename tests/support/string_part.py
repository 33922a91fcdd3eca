"""The first shipped campaign, the string, with less asked of it: for tests that need no more."""

from __future__ import annotations

import re
import shutil
from collections.abc import Collection
from pathlib import Path

STRING = Path(__file__).parents[2] / "data" / "string_q1"
#: Numbers of the drive pairs that are measured.
PAIRS = (1, 2, 3, 4, 5)


def string_part(folder: Path, *, pairs: Collection[int] = PAIRS, **lines: str) -> Path:
    """Path of the campaign file, in a folder with all that it names.

    Args:
        folder: that is made.
        pairs: numbers of the drive pairs that stay.
        **lines: lines of the campaign file, by the key with which they begin.
    """
    shutil.copytree(STRING, folder)
    path = folder / "campaign.toml"
    text = path.read_text("utf-8")
    for key, line in lines.items():
        text, count = re.subn(rf"^{key} = .*$", line, text, flags=re.MULTILINE)
        assert count == 1, key
    path.write_text(text, "utf-8")
    table = folder / "experiments.csv"
    gone = tuple(f"pair{number}," for number in PAIRS if number not in pairs)
    rows = table.read_text("utf-8").splitlines(keepends=True)
    table.write_text("".join(row for row in rows if not row.startswith(gone)), "utf-8")
    return path
