"""Conflicts of a bound campaign: variables that are set in two ways."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from fitting.campaign.bound import BoundCampaign
from fitting.campaign.places import Places
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput


def check_conflicts(bound: BoundCampaign, places: Places) -> None:
    """A fitted or alternated variable must not be set in another way as well.

    A variable of which every experiment has its own value may have a start value: the sweep's.

    Args:
        bound: campaign, bound to its FMU.
        places: what complaints name its parts by.

    Raises:
        BadInput: a parameter named twice, or a variable that is fitted or tried and also set.
    """
    named = [p.name for p in bound.parameters]
    if len(set(named)) < len(named):
        raise BadInput(f"{places.top}{places.parameters} {named} names one twice")
    sweep, gains = bound.sweep, [e.phases for e in bound.experiments if e.phases is not None]
    if sweep is not None and sweep.use == "scale" and any(p.unknown == "gain" for p in gains):
        raise BadInput(
            f'{places.top}the sweep gives a scale alone, which the experiments\' unknown = "gain" '
            'does without; wanted the sweep with use = "fit", or unknown = "phase"'
        )
    own = {p.target for p in bound.parameters if p.experiments and not p.adds_to}
    everywhere = {p.name for p in bound.parameters if not p.experiments and p.moves_model}
    for name in sorted(own & everywhere):
        raise BadInput(
            f"{places.top}{places.parameters} '{name}' is fitted both with scope = \"experiment\" "
            "and for the whole campaign; wanted one of them"
        )
    fitted = [p.target for p in bound.parameters if p.role == "model" and not p.adds_to]
    tried, laws = bound.alternatives[0], bound.setup.laws.formulas
    driven = (*bound.setup.drive.frequency_names, *bound.setup.drive.amplitude_names)
    said = list(settings_by_place(bound, places))
    roles = dict.fromkeys(laws, "is given by a law")
    roles |= dict.fromkeys(tried, "is an alternative") | dict.fromkeys(fitted, "is fitted")
    for name, role in roles.items():
        also: dict[str, Mapping[str, object]] = {}
        if name in fitted or name in laws:
            also[places.alternatives] = tried
        if name in everywhere or name in laws:
            also[places.start] = bound.setup.start_values
        if name in fitted:
            also[places.laws.rstrip(":")] = laws
        if name in laws:
            also[places.drive] = dict.fromkeys(driven, 0.0)
        for place, settings in (*said, *also.items()):
            if name in settings:
                raise BadInput(
                    f"{places.top}'{name}' {role} and also set by {place}; wanted one of them"
                )


def settings_by_place(
    bound: BoundCampaign, places: Places
) -> Iterator[tuple[str, Mapping[str, Scalar]]]:
    """What everything that was measured sets, by its name in complaints.

    Args:
        bound: campaign, bound to its FMU.
        places: what complaints name its parts by.
    """
    for e in bound.experiments:
        yield f"experiment '{e.label}'", e.settings
    if bound.sweep is not None:
        yield places.sweep, bound.sweep.settings
    for table, measurement in bound.measurements.items():
        name = places.measurement.format(table)
        for label, own in measurement.places:
            yield f"{name} {label}".strip(), own
