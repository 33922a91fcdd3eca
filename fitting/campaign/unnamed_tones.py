"""A tone that an FMU drives with and that no campaign names: it would be in every measurement."""

from __future__ import annotations

from collections.abc import Mapping

from fitting.campaign.bound import BoundCampaign
from fitting.campaign.conflicts import settings_by_place
from fitting.campaign.places import Places
from fitting.fmu.description import FmuVariable
from fitting.fmu.tone_names import OtherTone, other_tones
from fitting.fmu.variables import VariableLike
from fitting.text.errors import BadInput
from fitting.text.notation import listed, number
from fitting.text.units import same_kind


def check_tones(
    bound: BoundCampaign, variables: Mapping[str, VariableLike], places: Places
) -> None:
    """Complain of a tone beside those that the drive names, with an amplitude that is not zero.

    Told are tones whose parameters are named like those of the drive, as u2 and A2 beside u1.

    Args:
        bound: campaign, bound to its FMU.
        variables: of the FMU, by name.
        places: what complaints name its parts by.

    Raises:
        BadInput: there is one.
    """
    drive = bound.setup.drive
    if drive.kind != "tones":
        return
    described = {n: v for n, v in variables.items() if isinstance(v, FmuVariable)}
    set_otherwise = {p.target for p in bound.parameters} | set(bound.setup.laws.formulas)
    for place, settings in (("", {}), *settings_by_place(bound, places)):
        values = {**bound.setup.start_values, **bound.alternatives[0], **settings}
        for tone in other_tones(drive.frequency_names, values, described):
            if tone.amplitude in set_otherwise or not _is_frequency(described[tone.frequency]):
                continue
            if not place and _all_set(bound, tone, places):
                continue
            raise BadInput(_sentence(bound, tone, described[tone.amplitude], places))


def _is_frequency(variable: FmuVariable) -> bool:
    return variable.unit is not None and same_kind(variable.unit, "Hz")


def _all_set(bound: BoundCampaign, tone: OtherTone, places: Places) -> bool:
    """Whether everything that was measured says the amplitude itself."""
    said = [tone.amplitude in settings for _, settings in settings_by_place(bound, places)]
    return bool(said) and all(said)


def _sentence(bound: BoundCampaign, tone: OtherTone, amplitude: FmuVariable, places: Places) -> str:
    values = {**bound.setup.start_values, **bound.alternatives[0]}
    value = values.get(amplitude.name, amplitude.start)
    size = f"{number(float(value or 0.0), 4)} {amplitude.unit or ''}".strip()
    return (
        f"{places.top}{places.drive} names {listed(bound.setup.drive.frequency_names)}, but the "
        f"FMU drives at {tone.frequency} as well, with {tone.amplitude} = {size}; wanted "
        f"{tone.frequency} and {tone.amplitude} named beside, or {tone.amplitude} = 0 in "
        f"{places.start}"
    )
