"""Runs a few scenes of every command and writes down what they print.

    python -m tests.golden.texts [COMMAND ...]

writes `tests/golden/COMMAND.txt` anew; a change of words is then read in the difference of these
files. Numbers, and how long something took, are left open: they are other tests' business, and
their last digits are a processor's own.
"""

from __future__ import annotations

import contextlib
import re
import shutil
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import build_fmu
from fitting.api import progress
from tests.faults.scene import FMU, csv, texts
from tests.support.in_process import told

HERE = Path(__file__).parent
CAMPAIGN = "campaign.toml"
#: Made once, before any scene: it is the first call of `reconstruct`, and other scenes read it.
FIT = ("reconstruct", CAMPAIGN, "--out", "fit", "--no-report", "--workers", "1")
BAND = ("--from", "6.9402 MHz", "--to", "6.9403 MHz")
#: Of each command: the words of some calls that share a folder, one after the other.
SCENES: Mapping[str, Sequence[Sequence[str]]] = {
    "calibrate": [("calibrate", "fit/result.json", "--out", "calibrated")],
    "check": [("check", FMU, "--campaign", CAMPAIGN), ("check", "line.csv")],
    "design": [
        ("design", CAMPAIGN, "--at", "fit/result.json", "--out", "next", "--no-report"),
        ("design", CAMPAIGN, "--target", "nothing"),
    ],
    "ensemble": [
        (
            "ensemble",
            CAMPAIGN,
            "--out",
            "many",
            "--workers",
            "1",
            "--value",
            "d1",
            "--no-report",
        ),
        ("ensemble", "--out", "none"),
    ],
    "example": [("example", "string_q1", "--out", "shipped"), ("example", "string_q9")],
    "identify": [
        ("identify", CAMPAIGN, "--at", "fit/result.json", "--out", "known", "--no-report"),
        ("identify", "missing.toml"),
    ],
    "init": [("init", "line.csv", "--out", "drafted", "--yes", "--peak"), ("init", "empty.csv")],
    "line": [("line", "line.csv"), ("line", "line.csv", "--to", "1 kHz"), ("line", "empty.csv")],
    "reconstruct": [FIT, ("reconstruct", "misspelt.toml")],
    "simulate": [("simulate", FMU, "--plan", "--accuracy", "1e-4"), ("simulate", "none.fmu")],
    "sweep": [
        ("sweep", FMU, "--out", "swept", *BAND, "--points", "3", "--accuracy", "1e-2"),
        ("sweep", FMU, "--from", "1 kHz"),
    ],
    "synthesize": [
        ("synthesize", "--series", "q1", "--out", "virtual"),
        ("synthesize", "--series", "q9", "--out", "virtual"),
    ],
}


@dataclass(frozen=True)
class LaidOut:
    """A folder with all that the scenes read, and what the fit in it has printed, as it is kept."""

    folder: Path
    fit: str


def golden_text(command: str, scene: LaidOut, folder: Path) -> str:
    """What the calls of a command print, as it is kept.

    Args:
        command: of `SCENES`.
        scene: as `laid_out` made it.
        folder: not there yet: the scene is copied there, and the calls write into it.
    """
    shutil.copytree(scene.folder, folder)
    parts = [scene.fit if words is FIT else _printed(words, folder) for words in SCENES[command]]
    return "".join(parts)


def _printed(words: Sequence[str], folder: Path) -> str:
    """What one call in a folder prints, and its exit code."""
    with contextlib.chdir(folder):
        ended = told(*words)
    parts = [f"$ fmu-fit {' '.join(words)}\n", ended.out]
    parts += [f"stderr: {line}\n" for line in ended.err.splitlines()]
    parts.append(f"exit code {ended.code}\n\n")
    return masked("".join(parts).replace(str(folder), "."))


def masked(text: str) -> str:
    """A text without its numbers, its columns and the lines that say how long something took."""
    lines = [line for line in text.splitlines() if not re.match(r"\s*took ", line)]
    text = "".join(f"{line}\n" for line in lines)
    # of a file, which are another compiler's own
    text = re.sub(r"\{[0-9a-f-]{36}\}|\b[0-9a-f]{64}\b", "#", text)
    text = re.sub(r"(?<!exit code )(?<![\w.])[-+]?\d[\d.,]*(?:e[-+]?\d+)?", "#", text)
    text = re.sub(r"# (?:µs|ms|min|h)\b(?: # (?:s|min)\b)?", "# s", text)
    return re.sub(r"[ \t]+", " ", text)


def laid_out(folder: Path, model: Path) -> LaidOut:
    """All that the scenes read, in an empty folder.

    Args:
        folder: an empty one.
        model: the FMU `CoupledOscillator`, or its twin.
    """
    scene = folder / "scene"
    scene.mkdir()
    shutil.copy(model, scene / FMU)
    for name, text in texts().items():
        (scene / name).write_text(text, "utf-8")
    f = np.linspace(49.9e3, 50.7e3, 81)
    shape = 1e-3 / np.hypot(1.0, 2.0 * (f - 50.3e3) / 40.0)
    noise = 1.0 + 2e-3 * np.random.default_rng(1).standard_normal(f.size)
    (scene / "line.csv").write_text(csv(f, shape * noise), "utf-8")
    (scene / "empty.csv").write_text("frequency (Hz),amplitude (V)\n", "utf-8")
    text = (scene / CAMPAIGN).read_text("utf-8")
    (scene / "misspelt.toml").write_text(text.replace("[sweep]", "[swep]"), "utf-8")
    fit = _printed(FIT, scene)
    assert (scene / "fit" / "result.json").is_file(), fit
    return LaidOut(scene, fit)


def main(commands: Sequence[str]) -> None:
    """Write the texts of some commands; of all without any."""
    progress.FIRST_S = progress.MOST_S = 1e6  # its lines come when a command takes long
    with tempfile.TemporaryDirectory() as folder:
        model = build_fmu.build("CoupledOscillator", Path(folder) / "model", native=())
        scene = laid_out(Path(folder), model)
        for command in commands or SCENES:
            text = golden_text(command, scene, Path(folder) / command)
            (HERE / f"{command}.txt").write_text(text, "utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
