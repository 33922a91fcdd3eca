"""The drive of a campaign in the names and units of an FMU."""

from __future__ import annotations

from fitting.campaign.binder import Binder
from fitting.campaign.data import Campaign
from fitting.campaign.file import SAMPLES_PER_PERIOD
from fitting.campaign.setup import Drive
from fitting.text.errors import BadInput

#: Causalities of variables that hold a tone.
HOLD_TONES = ("parameter", "input")


def bind_drive(campaign: Campaign, binder: Binder) -> Drive:
    """How the FMU is driven; not at all where the campaign says nothing of tones.

    Args:
        campaign: campaign as it was read.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: a variable that is not there or cannot be set, tones in different units, a level
            in another unit or not above zero.
    """
    choice, where = campaign.file.drive, f"{campaign.path}: [drive]"
    if choice is None:
        return Drive()
    if choice.kind == "input":
        target = binder.real(choice.input or "", f"{where} input", ("input",), "driven")
        units = ["Hz"]
    else:
        tones, targets = (
            [binder.real(name, f"{where} {key}", HOLD_TONES, "set") for name in names]
            for key, names in (
                ("frequencies", choice.frequencies),
                ("amplitudes", choice.amplitudes or ()),
            )
        )
        target, units = targets[0], [tone.unit or "Hz" for tone in tones]
        if len(set(units)) > 1:
            raise BadInput(f"{where} frequencies: the FMU has them in different units: {units}")
    amplitude = binder.number(target, choice.level)
    if amplitude <= 0.0:
        raise BadInput(f"{choice.level.where}: found {amplitude:.6g}, wanted a positive amplitude")
    return Drive(
        frequency_names=choice.frequencies,
        amplitude_names=choice.amplitudes or (),
        input=choice.input,
        amplitude=amplitude,
        samples_per_period=choice.samples_per_period or SAMPLES_PER_PERIOD,
        frequency_unit=units[0],
        highest_order=choice.highest_order,
    )
