"""Laboratory data: campaign file, drive series, spectra, sweeps -> checked records.

file.py          every key of campaign.toml, as written        WrittenSweep, ...
instruments/     a file per layout of instruments' files       RawTrace
measured.py      what was measured, of files or of arrays      MeasuredSweep, ...
data.py          campaign.toml and its data files, read        Campaign
binding.py       the same in the names and units of one FMU    BoundCampaign
drift.py, noise.py, parameters.py, joint.py                    parts of the bound campaign
kind.py          what a further kind of measurement adds to all of these
"""

from __future__ import annotations

from fitting.campaign.binding import BoundCampaign, Drift, Drive, Experiment, Setup, SweepData, bind
from fitting.campaign.data import Campaign, read_campaign
from fitting.campaign.file import ContinuationSettings, WrittenFmu
from fitting.campaign.measured import MeasuredExperiment, MeasuredSweep, Phases, Spectrum
from fitting.fmu.variables import VariableLike

__all__ = [
    "BoundCampaign",
    "Campaign",
    "ContinuationSettings",
    "Drift",
    "Drive",
    "Experiment",
    "MeasuredExperiment",
    "MeasuredSweep",
    "Phases",
    "Setup",
    "Spectrum",
    "SweepData",
    "VariableLike",
    "WrittenFmu",
    "bind",
    "read_campaign",
]
