"""What a bound campaign must not contradict: settings of variables, tones, laws next to the FMU."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from fitting.campaign.binder import Binder
from fitting.campaign.bound import BoundCampaign
from fitting.campaign.laws import Laws
from fitting.fmu.description import FmuVariable
from fitting.fmu.tone_names import other_tones
from fitting.fmu.variables import SETTABLE
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import listed, number
from fitting.text.units import same_kind


def check_conflicts(bound: BoundCampaign, binder: Binder) -> None:
    """A fitted or alternated variable must not be set in another way as well.

    A variable of which every experiment has its own value may have a start value: the sweep's.

    Args:
        bound: campaign, bound to its FMU.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: a parameter named twice, or a variable that is fitted or tried and also set.
    """
    top, parameters = binder.top, binder.part("parameters")
    named = [p.name for p in bound.parameters]
    if len(set(named)) < len(named):
        raise BadInput(f"{top}{parameters} {named} names one twice")
    sweep, gains = bound.sweep, [e.phases for e in bound.experiments if e.phases is not None]
    if sweep is not None and sweep.use == "scale" and any(p.unknown == "gain" for p in gains):
        raise BadInput(
            f'{top}the sweep gives a scale alone, which the experiments\' unknown = "gain" '
            'does without; wanted the sweep with use = "fit", or unknown = "phase"'
        )
    own = {p.target for p in bound.parameters if p.experiments and not p.adds_to}
    everywhere = {p.name for p in bound.parameters if not p.experiments and p.moves_model}
    for name in sorted(own & everywhere):
        raise BadInput(
            f"{top}{parameters} '{name}' is fitted both with "
            'scope = "experiment" and for the whole campaign; wanted one of them'
        )
    fitted = [p.target for p in bound.parameters if p.role == "model" and not p.adds_to]
    tried, laws, drive = bound.alternatives[0], bound.setup.laws.formulas, bound.setup.drive
    driven = dict.fromkeys((*drive.frequency_names, *drive.amplitude_names), 0.0)
    roles = dict.fromkeys(laws, "is given by a law")
    roles |= dict.fromkeys(tried, "is an alternative") | dict.fromkeys(fitted, "is fitted")
    for name, role in roles.items():
        by_law = name in laws
        also: tuple[tuple[bool, str, Mapping[str, object]], ...] = (
            (name in fitted or by_law, "alternatives", tried),
            (name in everywhere or by_law, "start", bound.setup.start_values),
            (name in fitted, "laws", laws),
            (by_law, "drive", driven),
        )
        for place, settings in (
            *settings_by_place(bound, binder),
            *((binder.part(part), others) for applies, part, others in also if applies),
        ):
            if name in settings:
                raise BadInput(f"{top}'{name}' {role} and also set by {place}; wanted one of them")


def settings_by_place(
    bound: BoundCampaign, binder: Binder
) -> Iterator[tuple[str, Mapping[str, Scalar]]]:
    """What everything that was measured sets, by its name in errors.

    Args:
        bound: campaign, bound to its FMU.
        binder: of the campaign to its FMU.
    """
    for e in bound.experiments:
        yield f"experiment '{e.label}'", e.settings
    if bound.sweep is not None:
        yield binder.part("sweep"), bound.sweep.settings
    for table, measurement in bound.measurements.items():
        for label, own in measurement.places:
            yield f"{binder.part('measurement', table)} {label}".strip(), own


def check_tones(bound: BoundCampaign, binder: Binder) -> None:
    """Refuse a tone next to those that the drive names, with an amplitude that is not zero.

    These are tones whose parameters are named like those of the drive, as u2 and A2 next to u1.

    Args:
        bound: campaign, bound to its FMU.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: there is one.
    """
    drive = bound.setup.drive
    if drive.kind != "tones":
        return
    described = {n: v for n, v in binder.variables.items() if isinstance(v, FmuVariable)}
    set_otherwise = {p.target for p in bound.parameters} | set(bound.setup.laws.formulas)
    common = {**bound.setup.start_values, **bound.alternatives[0]}
    places = list(settings_by_place(bound, binder))
    for place, settings in (("", {}), *places):
        for tone in other_tones(drive.frequency_names, {**common, **settings}, described):
            unit = described[tone.frequency].unit
            if tone.amplitude in set_otherwise or unit is None or not same_kind(unit, "Hz"):
                continue
            if not place and places and all(tone.amplitude in own for _, own in places):
                continue  # everything that was measured sets the amplitude itself
            amplitude = described[tone.amplitude]
            value = common.get(amplitude.name, amplitude.start)
            size = f"{number(float(value or 0.0), 4)} {amplitude.unit or ''}".strip()
            raise BadInput(
                f"{binder.top}{binder.part('drive')} names {listed(drive.frequency_names)}, "
                f"but the FMU drives at {tone.frequency} as well, with {tone.amplitude} = {size}; "
                f"wanted {tone.frequency} and {tone.amplitude} named as well, or {tone.amplitude} "
                f"= 0 in {binder.part('start')}"
            )


def bound_laws(laws: Laws, bound: BoundCampaign, binder: Binder) -> Laws:
    """Laws with the units of all that they name, tried at every place of a campaign.

    Args:
        laws: as they were written.
        bound: campaign, bound to its FMU but for them.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: a law of a variable that cannot be set, that names what there is not, whose
            dimension is not that of the variable, or that has no value somewhere.
    """
    variables, controls = binder.variables, dict(binder.control_units)
    targets = {
        name: binder.real(name, f"{laws.source} {name}", SETTABLE, "set by a law").unit or ""
        for name in laws.formulas
    }
    for measurement in bound.measurements.values():
        for name, unit in measurement.control_units.items():
            if name not in variables and controls.setdefault(name, unit) != unit:
                raise BadInput(
                    f"{laws.source} the control quantity '{name}' is in {unit} and in "
                    f"{controls[name]}; wanted one unit"
                )
    made = laws.with_units(
        targets,
        parameters={p.target: p.unit for p in bound.parameters if p.moves_model},
        variables={n: variables[n].unit or "1" for n in laws.names if n in variables},
        controls=controls,
    )
    common = {**bound.setup.start_values, **bound.alternatives[0]}
    made.check(
        ((place, {**common, **own}) for place, own in settings_by_place(bound, binder)),
        {p.target: p.start for p in bound.parameters if p.moves_model and not p.adds_to},
    )
    return made


def with_laws(bound: BoundCampaign, binder: Binder) -> BoundCampaign:
    """A campaign whose laws are bound to the FMU: units of all that they name, and finite values.

    Args:
        bound: campaign, bound to its FMU.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: as `bound_laws`.
    """
    if not bound.setup.laws.formulas:
        return bound
    made = bound_laws(bound.setup.laws, bound, binder)
    notes = (*bound.notes, *(law.note for law in made.bound))
    return replace(bound, setup=replace(bound.setup, laws=made), notes=notes)
