"""Every name and value of a campaign beside its FMU, each looked at by itself: all complaints.

Binding (`fitting.campaign.binding.bind`) needs one thing for the next and would stop at the first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

from fitting.campaign.asked_parameters import bind_parameters
from fitting.campaign.binder import Binder, bind_annotation
from fitting.campaign.data import Campaign
from fitting.campaign.laws import Laws
from fitting.campaign.places import Places
from fitting.fmu.variables import READABLE, VariableLike
from fitting.text.errors import gathered
from fitting.text.written import Written


def check_names(
    campaign: Campaign, variables: Mapping[str, VariableLike], laws: Laws, places: Places
) -> None:
    """Complain of all names and values that the FMU does not take, a line each.

    Args:
        campaign: campaign as it was read.
        variables: of the FMU, by name.
        laws: of the campaign.
        places: what complaints name its parts by.

    Raises:
        BadInput: one line for each.
    """
    binder = Binder(variables, laws.names)  # its own: what is noted here is noted again
    gathered(_readers(campaign, binder, laws, places))


def _readers(
    campaign: Campaign, binder: Binder, laws: Laws, places: Places
) -> Iterator[Callable[[], object]]:
    file, top = campaign.file, str(campaign.path)
    yield partial(
        binder.real, file.observe.output, f"{top}: [observe] output", READABLE, "observed"
    )
    yield from _of_drive(campaign, binder, f"{top}: [drive]")
    for name in file.derived.outputs:
        yield partial(binder.reported, name, f"{top}: [derived] outputs", laws.formulas)
    for name, written in _settings(campaign).items():
        yield partial(binder.setting, name, written)
    for name, values in file.alternatives.items():
        for written in values:
            yield partial(binder.setting, name, written)
    for parameter in file.parameters:
        if parameter.scope == "campaign":
            yield partial(bind_parameters, (parameter,), binder, places, ())
    yield partial(bind_annotation, campaign, binder)


def _of_drive(campaign: Campaign, binder: Binder, where: str) -> Iterator[Callable[[], object]]:
    choice = campaign.file.drive
    if choice is None:
        return
    if choice.kind == "input":
        yield partial(binder.real, choice.input or "", f"{where} input", ("input",), "driven")
        return
    drives = ("parameter", "input")
    for name in choice.frequencies:
        yield partial(binder.real, name, f"{where} frequencies", drives, "set")
    for name in choice.amplitudes or ():
        yield partial(binder.real, name, f"{where} amplitudes", drives, "set")


def _settings(campaign: Campaign) -> dict[str, Written]:
    """What start values, sweep and experiments set, each name where it is first written."""
    found: dict[str, Written] = dict(campaign.file.fmu.start)
    sweep = campaign.file.sweep
    tables = [sweep.set if sweep is not None else {}, *(e.settings for e in campaign.experiments)]
    for table in tables:
        for name, written in table.items():
            found.setdefault(name, written)
    return found
