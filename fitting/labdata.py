"""Laboratory data: campaign file, drive series, spectra, sweeps -> checked records.

The front door of the ``campaign_*`` modules: read a campaign, then bind it to an FMU's variables.
"""

from __future__ import annotations

from fitting.campaign_binding import BoundCampaign, Drive, Experiment, Sweep, bind
from fitting.campaign_data import Campaign, Spectrum, read_campaign
from fitting.campaign_schema import ContinuationSettings, FmuChoice
from fitting.variables import VariableLike

__all__ = [
    "BoundCampaign",
    "Campaign",
    "ContinuationSettings",
    "Drive",
    "Experiment",
    "FmuChoice",
    "Spectrum",
    "Sweep",
    "VariableLike",
    "bind",
    "read_campaign",
]
