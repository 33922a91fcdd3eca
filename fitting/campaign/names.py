"""Every name and value of a campaign beside its FMU, each looked at by itself: all complaints.

Binding (`fitting.campaign.binding.bind`) needs one thing for the next and would stop at the first.
"""

from __future__ import annotations

import re
from collections import ChainMap
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import partial

from fitting.campaign.asked_parameters import bind_parameters
from fitting.campaign.binder import Binder, annotation_readers
from fitting.campaign.data import Campaign
from fitting.campaign.drift import bind_drift, drift_readers
from fitting.campaign.driving import HOLD_TONES, bind_drive
from fitting.campaign.laws import Laws
from fitting.campaign.noise import bind_noise
from fitting.campaign.places import Places
from fitting.campaign.setup import Setup
from fitting.campaign.stated import bind_sigmas
from fitting.fmu.variables import READABLE, SETTABLE, VariableLike
from fitting.text.errors import BadInput, gathered
from fitting.text.written import Written

#: A word of a formula.
WORD = re.compile(r"[A-Za-z_]\w*")
Readers = Iterator[Callable[[], object]]


def check_names(campaign: Campaign, variables: Mapping[str, VariableLike], places: Places) -> Laws:
    """Complain of all names and values that the FMU does not take, a line each; else the laws.

    Args:
        campaign: campaign as it was read.
        variables: of the FMU, by name.
        places: what complaints name its parts by.

    Raises:
        BadInput: one line for each.
    """
    file = campaign.file
    laws = Laws()
    said: list[str] = []
    try:
        laws = Laws(file.laws, file.constants, source=f"{places.top}{places.laws}")
        named: Collection[str] = laws.names
    except BadInput as error:
        said += error.args
        # what no variable is called may be meant for the law that cannot be read
        named = {*(p.name for p in file.parameters), *ChainMap(*_measured_at(campaign))}
        named = {*named, *(word for law in file.laws.values() for word in WORD.findall(law))}
    try:
        # its own binder: what is noted here is noted again
        gathered(_readers(campaign, Binder(variables, named), places))
    except BadInput as error:
        said += error.args
    if said:
        said += _of_measurements(campaign, Binder(variables, named), laws)
        raise BadInput(*dict.fromkeys(said))
    return laws


def _readers(campaign: Campaign, binder: Binder, places: Places) -> Readers:
    file, top = campaign.file, str(campaign.path)
    yield partial(
        binder.real, file.observe.output, f"{top}: [observe] output", READABLE, "observed"
    )
    yield from _of_drive(campaign, binder, f"{top}: [drive]")
    for name in file.derived.outputs:
        yield partial(binder.reported, name, f"{top}: [derived] outputs", file.laws)
    for name in file.fmu.taken:
        yield partial(binder.real, name, f"{top}: [fmu] taken", SETTABLE, "set")
    for settings in (file.fmu.start, *_measured_at(campaign)):
        yield partial(binder.settings, settings)
    for name, values in file.alternatives.items():
        for written in values:
            yield partial(binder.setting, name, written)
    for parameter in file.parameters:
        yield partial(bind_parameters, (parameter,), binder, places, ())
    yield from annotation_readers(campaign, binder)
    yield from drift_readers(campaign, binder)
    yield partial(bind_drift, campaign, binder)
    yield from _of_amplitudes(campaign, binder)


def _of_drive(campaign: Campaign, binder: Binder, where: str) -> Readers:
    choice = campaign.file.drive
    if choice is None:
        return
    if choice.kind == "tones":
        for name in choice.frequencies:
            yield partial(binder.real, name, f"{where} frequencies", HOLD_TONES, "set")
        for name in choice.amplitudes or ():
            yield partial(binder.real, name, f"{where} amplitudes", HOLD_TONES, "set")
    yield partial(bind_drive, campaign, binder)


def _of_amplitudes(campaign: Campaign, binder: Binder) -> Readers:
    """What is said of the noise of amplitudes, and of errors of what a sweep was measured at."""
    file = campaign.file
    declared = file.experiments or file.sweep
    if declared is not None:
        amplitude = declared.format.amplitude
        yield partial(bind_noise, file.noise, amplitude, campaign.amplitude_unit)
    for name, written in (file.sweep.set_sigma if file.sweep is not None else {}).items():
        yield partial(bind_sigmas, {name: written}, binder)


def _of_measurements(campaign: Campaign, binder: Binder, laws: Laws) -> list[str]:
    """What further measurements complain of, where it is known how they drive and what is seen."""
    top = str(campaign.path)
    where = f"{top}: [observe] output"
    try:
        output = binder.real(campaign.file.observe.output, where, READABLE, "observed")
        setup = Setup(bind_drive(campaign, binder), output.name, laws=laws, source=top)
    except BadInput:
        return []  # told already
    try:
        gathered(partial(m.bind, binder, setup) for m in campaign.measurements.values())
    except BadInput as error:
        return list(error.args)
    return []


def _measured_at(campaign: Campaign) -> tuple[dict[str, Written], dict[str, Written]]:
    """What the sweep sets, and what experiments do, each name where it is first written."""
    sweep = campaign.file.sweep
    columns: dict[str, Written] = {}
    for experiment in campaign.experiments:
        columns = {**experiment.settings, **columns}
    return {} if sweep is None else dict(sweep.set), columns
