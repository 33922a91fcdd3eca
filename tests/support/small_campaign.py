"""A campaign that is fitted in a second or two: the shipped string, of which little is asked.

It is for runs that are disturbed many times, so every phase should be there and none take long.
"""

from __future__ import annotations

import shutil
from pathlib import Path

ROOT = Path(__file__).parents[2]

STRING = ROOT / "data" / "string_q1"
#: Texts of the campaign file and what stands in their place: one parameter, one start, few levels.
CHANGES = {
    'model = "CoupledOscillator"': 'file = "oscillator.fmu"',
    "periodic_start = true ": 'd2 = "100 Hz"\ntheta = "1.95 rad"\nperiodic_start = true ',
    'outputs = ["lambda", "f1", "f2", "width_plus", "width_minus", "Q_plus", "Q_minus"]': (
        'outputs = ["width_plus"]'
    ),
    "reflection = [false, true]": "reflection = [false]",
    "beta = 0.1": "beta = 0.01",
    "iterations = 9": "iterations = 5",
    "starts = 3": "starts = 1",
}


def small_campaign(folder: Path, fmu: Path) -> Path:
    """Path of the campaign file, in a folder with all that it names.

    Args:
        folder: that is made.
        fmu: the model `CoupledOscillator`, built.
    """
    shutil.copytree(STRING, folder)
    shutil.copy(fmu, folder / "oscillator.fmu")
    path = folder / "campaign.toml"
    head, *tables = path.read_text("utf-8").split("[[parameters]]")
    *_, rest = tables[2].partition("[derived]")
    text = f"{head}[[parameters]]{tables[1]}[derived]{rest}"
    for old, new in CHANGES.items():
        assert old in text, old
        text = text.replace(old, new)
    path.write_text(text, "utf-8")
    return path


def of_pairs(path: Path, *numbers: int) -> Path:
    """The same campaign with some of its drive pairs alone: an offset fewer for each left out.

    Args:
        path: of the campaign file, whose table of experiments is changed.
        numbers: of the pairs that stay.
    """
    table = path.parent / "experiments.csv"
    kept = tuple(f"pair{number}," for number in numbers)
    rows = table.read_text("utf-8").splitlines(keepends=True)
    measured = [row.startswith("pair") for row in rows]
    stays = [row for row, is_pair in zip(rows, measured, strict=True) if not is_pair]
    stays += [row for row in rows if row.startswith(kept)]
    table.write_text("".join(stays), "utf-8")
    return path
