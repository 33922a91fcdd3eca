"""The shipped pumped sweeps of the string and variations of them, fitted through an FMU."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import fitting as ff
from fitting.lab.subharmonic import SubharmonicBench
from fitting.lab.synthesis import synthesize

#: One level of Algorithm 2; what is reported is the likelihood's in any case.
METHOD = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
#: Starts some errors off the truth, from which a fit takes a third of the runs.
CLOSER = {
    "start = 2.1": "start = 1.97",
    "start = 1e-4": "start = 2.9e-4",
    'start = "95 Hz"': 'start = "105 Hz"',
}


def pumped_problem(
    bench: SubharmonicBench,
    fmu: ff.Fmu,
    folder: Path,
    *,
    seed: int = 1,
    campaign: Mapping[str, str] = CLOSER,
    sweeps: Mapping[str, str] | None = None,
) -> ff.Problem:
    """The campaign of a bench, with words of its files replaced.

    Args:
        bench: that is measured.
        fmu: CoupledModes2.
        folder: for its files.
        seed: of its noise.
        campaign: words of campaign.toml, by what they replace.
        sweeps: likewise of sweeps.csv.
    """
    path = synthesize(bench, seed=seed, out=folder).write(folder)
    for file, words in ((path, campaign), (folder / "sweeps.csv", sweeps or {})):
        text = file.read_text("utf-8")
        for old, new in words.items():
            assert old in text
            text = text.replace(old, new)
        file.write_text(text, "utf-8")
    return ff.Problem.of(ff.read_campaign(path), fmu)
