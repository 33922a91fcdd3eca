"""National Instruments' TDMS files, as LabVIEW and DIAdem write them (npTDMS)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign.instruments.arrays import NamedArray, columns_of, recording_of
from fitting.campaign.instruments.library import needed, understood
from fitting.campaign.instruments.recording import Recording
from fitting.campaign.instruments.trace import Head, Layout, Selection

KIND = "a TDMS file"


def _read_tdms(path: Path, selection: Selection) -> Recording:
    """Channels of one length; a waveform brings its own axis, over time or over frequency."""
    with needed(path, KIND, "tdms"):
        from nptdms import TdmsFile
    found: list[NamedArray] = []
    with understood(path, KIND):
        for group in TdmsFile.read(path).groups():
            channels = [
                (f"{group.name}/{c.name.replace('/', ' per ')}", c) for c in group.channels()
            ]
            for name, channel in channels:
                found += columns_of(name, np.asarray(channel[:]), _unit(channel))
            found += _axis(group.name, [channel for _, channel in channels])
    return recording_of(path, found, "TDMS", selection)


def _unit(channel: Any) -> str | None:
    told = channel.properties.get("unit_string") or channel.properties.get("NI_UnitDescription")
    return str(told).strip() or None if told else None


def _axis(group: str, channels: list[Any]) -> list[NamedArray]:
    """The axis of a group's waveforms, by their start and step."""
    for channel in channels:
        about = channel.properties
        step = about.get("wf_increment")
        if not step or len(channel) == 0:
            continue
        axis = float(about.get("wf_start_offset", 0.0)) + float(step) * np.arange(
            float(len(channel))
        )
        over = str(about.get("wf_xunit_string") or about.get("wf_xunit") or "s").strip()
        return [NamedArray(f"{group}/{'Frequency' if over == 'Hz' else 'Time'}", axis, over)]
    return []


def _recognises(head: Head) -> bool:
    return head.data.startswith(b"TDSm")


LAYOUT = Layout(name="tdms", read=_read_tdms, recognises=_recognises)
