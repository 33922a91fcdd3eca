"""What a bound campaign must not contradict: settings of variables, tones, laws beside the FMU."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

from fitting.campaign.binder import Binder
from fitting.campaign.bound import BoundCampaign
from fitting.campaign.laws import Known, Laws
from fitting.campaign.places import Places
from fitting.fmu.description import FmuVariable
from fitting.fmu.tone_names import OtherTone, other_tones
from fitting.fmu.variables import SETTABLE, VariableLike
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import listed, number
from fitting.text.units import same_kind


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
        raise BadInput(f"{places.top}{places.of('parameters')} {named} names one twice")
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
            f"{places.top}{places.of('parameters')} '{name}' is fitted both with "
            'scope = "experiment" and for the whole campaign; wanted one of them'
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
            also[places.of("alternatives")] = tried
        if name in everywhere or name in laws:
            also[places.of("start")] = bound.setup.start_values
        if name in fitted:
            also[places.of("laws")] = laws
        if name in laws:
            also[places.of("drive")] = dict.fromkeys(driven, 0.0)
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
        yield places.of("sweep"), bound.sweep.settings
    for table, measurement in bound.measurements.items():
        name = places.of("measurement", table)
        for label, own in measurement.places:
            yield f"{name} {label}".strip(), own


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
        f"{places.top}{places.of('drive')} names {listed(bound.setup.drive.frequency_names)}, "
        f"but the FMU drives at {tone.frequency} as well, with {tone.amplitude} = {size}; wanted "
        f"{tone.frequency} and {tone.amplitude} named as well, or {tone.amplitude} = 0 in "
        f"{places.of('start')}"
    )


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
