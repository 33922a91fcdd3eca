"""Campaign file, drive series, spectra, sweeps -> checked records in the names and units of an FMU.

file.py          every key of campaign.toml, as written        WrittenSweep, ...
instruments/     the layouts of instruments' files             Recording
recognised.py    what a file of an instrument seems to hold
measured.py      what was measured, of files or of arrays      Experiment, SweepData, ...
data.py          campaign.toml and its data files, read        Campaign
arrays.py        the same of a program's arrays                Parameter, Tones, Sweep
bound.py         the campaign in the FMU's names and units     Drive, Setup, BoundCampaign
binding.py       how it comes there from what was read
binder.py        the FMU's variables, contradictions, laws, assumptions
drift.py, noise.py, parameters.py, laws.py, joint.py           parts of the bound campaign
kind.py          what a further kind of measurement adds to all of these
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fitting.campaign.binding import bind as bind
    from fitting.campaign.bound import BoundCampaign as BoundCampaign
    from fitting.campaign.bound import Drift as Drift
    from fitting.campaign.bound import Drive as Drive
    from fitting.campaign.bound import Setup as Setup
    from fitting.campaign.data import Campaign as Campaign
    from fitting.campaign.data import read_campaign as read_campaign
    from fitting.campaign.file import ContinuationSettings as ContinuationSettings
    from fitting.campaign.file import WrittenFmu as WrittenFmu
    from fitting.campaign.measured import Experiment as Experiment
    from fitting.campaign.measured import Spectrum as Spectrum
    from fitting.campaign.measured import SweepData as SweepData
    from fitting.fmu.description import FmuVariable as FmuVariable

#: The module of each name: loaded when it is used, as most of what reads instruments needs none.
HOMES = {
    **dict.fromkeys(("BoundCampaign", "Drift", "Drive", "Setup"), "fitting.campaign.bound"),
    **dict.fromkeys(("Campaign", "read_campaign"), "fitting.campaign.data"),
    **dict.fromkeys(("ContinuationSettings", "WrittenFmu"), "fitting.campaign.file"),
    **dict.fromkeys(("Experiment", "Spectrum", "SweepData"), "fitting.campaign.measured"),
    "FmuVariable": "fitting.fmu.description",
    "bind": "fitting.campaign.binding",
}


def __getattr__(name: str) -> object:
    if name not in HOMES:
        raise AttributeError(f"module 'fitting.campaign' has no attribute '{name}'")
    value = getattr(importlib.import_module(HOMES[name]), name)
    globals()[name] = value
    return value
