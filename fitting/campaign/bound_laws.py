"""Laws beside an FMU: units of all that they name, and finite values wherever there is data."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from fitting.campaign.binder import Binder
from fitting.campaign.bound import BoundCampaign
from fitting.campaign.conflicts import settings_by_place
from fitting.campaign.laws import Known, Laws
from fitting.campaign.places import Places
from fitting.fmu.variables import SETTABLE
from fitting.text.errors import BadInput


def with_laws(bound: BoundCampaign, binder: Binder, places: Places) -> BoundCampaign:
    """A campaign whose laws are bound to the FMU: units of all that they name, and finite values.

    Args:
        bound: campaign, bound to its FMU.
        binder: of the campaign to its FMU.
        places: what complaints name its parts by.

    Raises:
        BadInput: a law of a variable that cannot be set, that names what there is not, whose
            dimension is not that of the variable, or that has no value somewhere.
    """
    laws = bound.setup.laws
    if not laws.formulas:
        return bound
    made = bound_laws(laws, bound, binder, places)
    setup = replace(bound.setup, laws=made)
    notes = (*bound.notes, *(law.words for law in made.bound))
    return replace(bound, setup=setup, notes=notes)


def bound_laws(laws: Laws, bound: BoundCampaign, binder: Binder, places: Places) -> Laws:
    """Laws with the units of all that they name, tried at every place of a campaign.

    Args:
        laws: as they were written.
        bound: campaign, bound to its FMU but for them.
        binder: of the campaign to its FMU.
        places: what complaints name its parts by.

    Raises:
        BadInput: as `with_laws` does.
    """
    targets = {
        name: binder.real(name, f"{laws.source} {name}", SETTABLE, "set by a law").unit or ""
        for name in laws.formulas
    }
    made = laws.with_units(targets, _known(laws.names, bound, binder, laws.source))
    common = {**bound.setup.start_values, **bound.alternatives[0]}
    made.check(
        ((place, {**common, **own}) for place, own in settings_by_place(bound, places)),
        {p.target: p.start for p in bound.parameters if p.moves_model and not p.adds_to},
    )
    return made


def _known(names: Collection[str], bound: BoundCampaign, binder: Binder, source: str) -> Known:
    """What names in laws stand for."""
    variables, controls = binder.variables, dict(binder.control_units)
    for measurement in bound.measurements.values():
        for name, unit in measurement.control_units.items():
            if name not in variables and controls.setdefault(name, unit) != unit:
                raise BadInput(
                    f"{source} the control quantity '{name}' is in {unit} and in "
                    f"{controls[name]}; wanted one unit"
                )
    return Known(
        parameters={p.target: p.unit for p in bound.parameters if p.moves_model},
        variables={n: variables[n].unit or "1" for n in names if n in variables},
        controls=controls,
    )
