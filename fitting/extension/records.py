"""Campaigns, records of the kinds of measurements, and the reader of instruments' tables."""

from __future__ import annotations

from fitting.campaign.binding import bind
from fitting.campaign.bound import BoundCampaign
from fitting.campaign.data import Campaign
from fitting.campaign.file import (
    WrittenCampaign,
    WrittenDesign,
    WrittenFmu,
    WrittenSweep,
    WrittenSweeps,
    WrittenTraces,
    read_campaign_file,
)
from fitting.campaign.instruments import PLAIN, read_recording
from fitting.campaign.instruments.recording import Channel, Recording, head_of
from fitting.measurements.kinds import KINDS, read_campaign
from fitting.measurements.measurement import Measurement, Prediction
from fitting.measurements.time_record import TimeRecord
from fitting.measurements.traces import Trace
from fitting.measurements.waveform import Pulse, Recorded

__all__ = [
    "KINDS",
    "PLAIN",
    "BoundCampaign",
    "Campaign",
    "Channel",
    "Measurement",
    "Prediction",
    "Pulse",
    "Recorded",
    "Recording",
    "TimeRecord",
    "Trace",
    "WrittenCampaign",
    "WrittenDesign",
    "WrittenFmu",
    "WrittenSweep",
    "WrittenSweeps",
    "WrittenTraces",
    "bind",
    "head_of",
    "read_campaign",
    "read_campaign_file",
    "read_recording",
]
