"""Laboratory data: campaign file, drive series, spectra, sweeps -> checked records.

The front door of the ``campaign_*`` modules: read a campaign, then bind it to an FMU's variables.
"""

from __future__ import annotations

from fitting.campaign.binding import BoundCampaign, Drift, Drive, Experiment, Setup, SweepData, bind
from fitting.campaign.data import Campaign, read_campaign
from fitting.campaign.file import ContinuationSettings, WrittenFmu
from fitting.campaign.measured import Spectrum
from fitting.fmu.variables import VariableLike

__all__ = [
    "BoundCampaign",
    "Campaign",
    "ContinuationSettings",
    "Drift",
    "Drive",
    "Experiment",
    "Setup",
    "Spectrum",
    "SweepData",
    "VariableLike",
    "WrittenFmu",
    "bind",
    "read_campaign",
]
