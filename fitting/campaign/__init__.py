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

from fitting.campaign.binding import bind
from fitting.campaign.bound import BoundCampaign, Drift
from fitting.campaign.data import Campaign, read_campaign
from fitting.campaign.file import ContinuationSettings, WrittenFmu
from fitting.campaign.measured import Experiment, Phases, Spectrum, SweepData
from fitting.campaign.setup import Drive, Setup
from fitting.fmu.variables import VariableLike

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
