"""Laboratory data: campaign file, drive series, spectra, sweeps -> checked records.

file.py          every key of campaign.toml, as written        WrittenSweep, ...
instruments/     a file per layout of instruments' files       RawTrace
measured.py      what was measured, of files or of arrays      Experiment, SweepData, ...
data.py          campaign.toml and its data files, read        Campaign
setup.py         how a series drives the FMU                   Drive, Setup
bound.py         the campaign in the FMU's names and units     BoundCampaign
binding.py       how it comes there from what was read
drift.py, noise.py, parameters.py, joint.py                    parts of the bound campaign
binder.py, conflicts.py, assumptions.py                        steps of the binding
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
    from fitting.campaign.measured import Phases as Phases
    from fitting.campaign.measured import Spectrum as Spectrum
    from fitting.campaign.measured import SweepData as SweepData
    from fitting.fmu.variables import VariableLike as VariableLike

#: The module of each name: loaded when it is used, as most of what reads instruments needs none.
HOMES = {
    "BoundCampaign": "fitting.campaign.bound",
    "Campaign": "fitting.campaign.data",
    "ContinuationSettings": "fitting.campaign.file",
    "Drift": "fitting.campaign.bound",
    "Drive": "fitting.campaign.bound",
    "Experiment": "fitting.campaign.measured",
    "Phases": "fitting.campaign.measured",
    "Setup": "fitting.campaign.bound",
    "Spectrum": "fitting.campaign.measured",
    "SweepData": "fitting.campaign.measured",
    "VariableLike": "fitting.fmu.variables",
    "WrittenFmu": "fitting.campaign.file",
    "bind": "fitting.campaign.binding",
    "read_campaign": "fitting.campaign.data",
}

__all__ = [
    "BoundCampaign",
    "Campaign",
    "ContinuationSettings",
    "Drift",
    "Drive",
    "Experiment",
    "Phases",
    "Setup",
    "Spectrum",
    "SweepData",
    "VariableLike",
    "WrittenFmu",
    "bind",
    "read_campaign",
]


def __getattr__(name: str) -> object:
    if name not in HOMES:
        raise AttributeError(f"module 'fitting.campaign' has no attribute '{name}'")
    value = getattr(importlib.import_module(HOMES[name]), name)
    globals()[name] = value
    return value
