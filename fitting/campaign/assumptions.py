"""What a campaign fixes although it might be otherwise: `[[assumptions]]`, next to the FMU.

A result rests on quantities that no fit moves, as the direction of a pump. Each assumption states
what might be instead: another value, another law, or the same model at another place of its
parameters. What a fit would give then is computed at its end
(`fitting.inference.checks.assumptions`).
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
from fitting.text.errors import BadInput, did_you_mean, gathered
from fitting.text.formula import Formula


def with_assumptions(
    bound: BoundCampaign, written: Sequence[WrittenAssumption], binder: Binder
) -> BoundCampaign:
    """A campaign with its assumptions.

    Args:
        bound: campaign, bound to its FMU, with its laws.
        written: as they are written.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: a quantity that there is not or that is fitted, a formula or value that it cannot
            have; a line each.
    """
    readers = [partial(_bound, one, bound, binder) for one in written]
    return replace(bound, assumptions=tuple(gathered(readers)))


def _bound(written: WrittenAssumption, bound: BoundCampaign, binder: Binder) -> Assumption:
    where, name = f"{binder.top}[assumptions '{written.that}']", written.quantity
    words, setup = Assumption(that=written.that, otherwise=written.otherwise), bound.setup
    if name is None:
        return replace(words, start=_start(written.start, bound, where))
    if name in {p.target for p in bound.parameters}:
        raise BadInput(f"{where} quantity: '{name}' is fitted; wanted one that is fixed")
    formulas, constants = dict(setup.laws.formulas), dict(setup.laws.constants)
    if written.law is not None:
        if name in constants:
            raise BadInput(f"{where} law: '{name}' is a constant; wanted its 'value'")
        # names of laws stand for their formulas in it
        law = Formula(written.law, f"{where} law").written_out(setup.laws.parsed)
        formulas[name] = law.text
    elif written.value is not None and name in constants:
        constants[name] = written.value
    else:
        if name in formulas:
            raise BadInput(f"{where} value: '{name}' follows a law; wanted another 'law'")
        if name not in binder.variables:
            known = sorted((*constants, *binder.variables))
            raise BadInput(
                f"{where} quantity: '{name}' is neither a constant nor a variable of the FMU"
                f"{did_you_mean(name, known)}"
            )
        assert written.value is not None  # noqa: S101 - the table wants a law or a value
        changed = {**setup.start_values, name: binder.setting(name, written.value)}
        return replace(words, setup=replace(setup, start_values=changed))
    # another law may do without some constants
    named = {each for text in formulas.values() for each in Formula(text, where).names}
    constants = {n: value for n, value in constants.items() if n in named}
    laws = bound_laws(Laws(formulas, constants, source=f"{where}:"), bound, binder)
    return replace(words, setup=replace(setup, laws=laws))


def _start(formulas: Mapping[str, str], bound: BoundCampaign, where: str) -> dict[str, Law]:
    """Formulas of parameters in the fitted values of all of them."""
    units = {p.name: p.unit for p in bound.parameters if p.moves_model and not p.experiments}

    def check(name: str, place: str) -> None:
        if name not in units:
            raise BadInput(
                f"{place}: '{name}' is no fitted parameter of the whole campaign"
                f"{did_you_mean(name, sorted(units))}"
            )

    for name in formulas:
        check(name, f"{where} start")
    laws = {}
    for name, text in formulas.items():
        formula = Formula(text, f"{where} start.{name}")
        for other in formula.names:
            check(other, formula.where)
        own = {other: units[other] for other in formula.names}
        laws[name] = Law(name, formula, units=own, unit=units[name])
    return laws
