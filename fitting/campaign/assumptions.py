"""What a campaign fixes although it might be otherwise: `[[assumptions]]`, beside the FMU.

A result rests on quantities that no fit moves, as the direction of a pump. Each assumption says
what might be instead: another value, another law, or the same model at another place of its
parameters. What a fit would give then is worked out at its end (`fitting.inference.assumptions`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from fitting.campaign.binder import Binder
from fitting.campaign.bound import Assumption, BoundCampaign
from fitting.campaign.conflicts import bound_laws
from fitting.campaign.file import WrittenAssumption
from fitting.campaign.laws import Law, Laws
from fitting.campaign.places import Places
from fitting.campaign.setup import Setup
from fitting.text.errors import BadInput, did_you_mean, gathered
from fitting.text.formula import Formula
from fitting.text.written import Written


def with_assumptions(
    bound: BoundCampaign, asked: Sequence[WrittenAssumption], binder: Binder, places: Places
) -> BoundCampaign:
    """A campaign with its assumptions.

    Args:
        bound: campaign, bound to its FMU, with its laws.
        asked: as they are written.
        binder: of the campaign to its FMU.
        places: what complaints name its parts by.

    Raises:
        BadInput: a quantity that there is not or that is fitted, a formula or value that it cannot
            have; a line each.
    """
    readers = [partial(_bound, one, bound, binder, places) for one in asked]
    return replace(bound, assumptions=tuple(gathered(readers)))


def _bound(
    asked: WrittenAssumption, bound: BoundCampaign, binder: Binder, places: Places
) -> Assumption:
    where = f"{places.top}[assumptions '{asked.that}']"
    words = Assumption(that=asked.that, otherwise=asked.otherwise)
    if asked.quantity is None:
        return replace(words, start=_started(asked.start, bound, where))
    if asked.quantity in {p.target for p in bound.parameters}:
        raise BadInput(f"{where} quantity: '{asked.quantity}' is fitted; wanted one that is fixed")
    if asked.law is not None:
        laws = _with_law(bound.setup.laws, asked.quantity, asked.law, where)
    elif asked.value is not None and asked.quantity in bound.setup.laws.constants:
        laws = _with_constant(bound.setup.laws, asked.quantity, asked.value, where)
    else:
        return replace(words, setup=_with_start(bound, asked, binder, where))
    made = bound_laws(laws, bound, binder, replace(places, top=""))
    return replace(words, setup=replace(bound.setup, laws=made))


def _with_law(laws: Laws, name: str, text: str, where: str) -> Laws:
    """Laws with another one for a variable, in which names of laws stand for their formulas."""
    if name in laws.constants:
        raise BadInput(f"{where} law: '{name}' is a constant; wanted its 'value'")
    formula = Formula(text, f"{where} law").written_out(laws.parsed)
    return _laws({**laws.formulas, name: formula.text}, laws.constants, where)


def _with_constant(laws: Laws, name: str, value: Written, where: str) -> Laws:
    return _laws(laws.formulas, {**laws.constants, name: value}, where)


def _laws(
    formulas: Mapping[str, str], constants: Mapping[str, float | str | Written], where: str
) -> Laws:
    """Laws with the constants that one of them names: another law may do without."""
    named = {name for text in formulas.values() for name in Formula(text, where).names}
    return Laws(formulas, {n: v for n, v in constants.items() if n in named}, source=f"{where}:")


def _with_start(
    bound: BoundCampaign, asked: WrittenAssumption, binder: Binder, where: str
) -> Setup:
    """The setup with another start value of a variable that no law sets."""
    name, laws = str(asked.quantity), bound.setup.laws
    if name in laws.formulas:
        raise BadInput(f"{where} value: '{name}' follows a law; wanted another 'law'")
    if name not in binder.variables:
        known = (*laws.constants, *binder.variables)
        raise BadInput(
            f"{where} quantity: '{name}' is neither a constant nor a variable of the FMU"
            f"{did_you_mean(name, sorted(known))}"
        )
    assert asked.value is not None  # noqa: S101 - the table wants a law or a value
    changed = {**bound.setup.start_values, name: binder.setting(name, asked.value)}
    return replace(bound.setup, start_values=changed)


def _started(asked: Mapping[str, str], bound: BoundCampaign, where: str) -> dict[str, Law]:
    """Formulas of parameters in the fitted values of all of them."""
    units = {p.name: p.unit for p in bound.parameters if p.moves_model and not p.experiments}
    for name in asked:
        if name not in units:
            raise BadInput(
                f"{where} start: '{name}' is no fitted parameter of the whole campaign"
                f"{did_you_mean(name, sorted(units))}"
            )
    found = {}
    for name, text in asked.items():
        formula = Formula(text, f"{where} start.{name}")
        for other in formula.names:
            if other not in units:
                raise BadInput(
                    f"{formula.where}: '{other}' is no fitted parameter of the whole campaign"
                    f"{did_you_mean(other, sorted(units))}"
                )
        own = {other: units[other] for other in formula.names}
        found[name] = Law(name, formula, units=own, unit=units[name])
    return found
