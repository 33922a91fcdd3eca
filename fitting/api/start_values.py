"""Start values from elsewhere: of another fit, or of a parameter set that other tools write."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from fitting.campaign.bound import BoundCampaign
from fitting.campaign.parameters import Parameter
from fitting.fmu.parameter_set import SetValue, read_parameter_set
from fitting.text.errors import BadInput
from fitting.text.units import convert

#: Values by parameter in its unit, or the path of an .ssv file.
Starts = Mapping[str, float] | str | Path


def started(campaigns: Sequence[BoundCampaign], start: Starts) -> list[BoundCampaign]:
    """The same campaigns, whose parameters start at these values.

    A file may hold further variables of the FMU, which are left; a mapping may not.

    Args:
        campaigns: bound to their FMU.
        start: values by parameter in its unit, or the path of a parameter set (.ssv).

    Raises:
        BadInput: no parameter of the campaigns is named, or one that there is not; a value outside
            its box, or of another unit.
    """
    from_file = not isinstance(start, Mapping)
    where = f"{start}" if from_file else "start"
    given = _values(start)
    fitted = dict.fromkeys(p.name for campaign in campaigns for p in campaign.parameters)
    named = [name for name in given if name in fitted]
    unknown = [name for name in given if name not in fitted]
    if not named or (unknown and not from_file):
        result = ", ".join(unknown) or "nothing"
        raise BadInput(f"{where}: found {result}, wanted values of {', '.join(fitted)}")
    return [
        replace(campaign, parameters=tuple(_started(p, given, where) for p in campaign.parameters))
        for campaign in campaigns
    ]


def _values(start: Starts) -> dict[str, SetValue]:
    if isinstance(start, Mapping):
        return {name: SetValue(name=name, value=value) for name, value in start.items()}
    return {result.name: result for result in read_parameter_set(Path(start))}


def _started(p: Parameter, given: Mapping[str, SetValue], where: str) -> Parameter:
    if p.name not in given:
        return p
    result = given[p.name]
    if isinstance(result.value, bool | str):
        raise BadInput(f"{where}: {p.name}: found {result.value!r}, wanted a number")
    value = float(result.value)
    if result.unit and result.unit != p.unit:
        value = convert(value, result.unit, p.unit, where=f"{where}: {p.name}")
    try:
        return replace(p, start=value)
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from error
