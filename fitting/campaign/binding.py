"""Campaign meets FMU: names, kinds and units checked, every number converted to the FMU's unit."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from fitting.campaign.binder import (
    Binder,
    check_conflicts,
    check_tones,
    with_assumptions,
    with_laws,
)
from fitting.campaign.bound import USUAL_ACCURACY, BoundCampaign, Drift, Drive, Setup
from fitting.campaign.data import Campaign
from fitting.campaign.drift import Prior, bind_drift, bind_sigmas, drift_priors, with_offsets
from fitting.campaign.file import SAMPLES_PER_PERIOD, CampaignHead, WrittenAccuracy, WrittenDrive
from fitting.campaign.kind import labels_of
from fitting.campaign.laws import Laws
from fitting.campaign.measured import Experiment, Spectrum
from fitting.campaign.noise import bind_noise, scale_parameter, sweep_scale_sigma, sweep_sigmas
from fitting.campaign.parameters import SCOPES, Parameter, ParameterTable, numbers_of
from fitting.fmu.accuracy import AccuracyAnnotation, AccuracyNames, Reduction
from fitting.fmu.description import READABLE, SETTABLE, FmuVariable
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, Complaints, gathered
from fitting.text.finding import Kind, note
from fitting.text.units import (
    Written,
    base_unit,
    convert,
    dimension_of,
    in_unit,
    parse_quantity,
    same_kind,
)

if TYPE_CHECKING:  # it takes what is bound here
    from fitting.campaign.arrays import Parameter as ProgramParameter

#: A parameter as a file has it, or as a program gives it.
WrittenParameter: TypeAlias = "ParameterTable[Written] | ProgramParameter"
Curve = TypeVar("Curve", bound=Spectrum)
#: Each combination of alternatives is a fit of its own.
MOST_ALTERNATIVES = 100
#: Causalities of variables that hold a tone.
HOLD_TONES = ("parameter", "input")
#: Numbers of a parameter that are differences of its values: 1 degC of them is 1 K.
DIFFERENCES = ("scale", "period", "prior")


def bind(campaign: Campaign, variables: Mapping[str, FmuVariable]) -> BoundCampaign:
    """Check a campaign against the variables of its FMU and convert it to their units.

    Bare numbers are in the FMU's unit already. Drifting variables are interpolated linearly over
    the experiments, as the paper does, see `fitting.campaign.drift`; their offsets are parameters
    after those of the file.

    Args:
        campaign: campaign as it was read.
        variables: of the FMU, by name.

    Raises:
        BadInput: unknown variable, one that cannot be set, read or fitted, a unit or kind that does
            not match, a value outside the FMU's range, a variable set in two ways; a line each.
    """
    file, top, swept = campaign.file, str(campaign.path), campaign.file.sweep
    stated = Complaints()  # of every table by itself, then of what rests on several
    laws = stated.read(Laws, file.laws, file.constants, source=f"{top}: [laws]")
    # what columns set, each where it is first written
    columns = {k: w for e in reversed(campaign.experiments) for k, w in e.written.items()}
    columns = {k: columns[k] for e in campaign.experiments for k in e.written}
    if stated.lines:  # laws that cannot be read may mean whatever no variable is called
        words = (word for law in file.laws.values() for word in re.findall(r"[A-Za-z_]\w*", law))
        fitted = (p.name for p in file.parameters)
        named = frozenset([*fitted, *(swept.set if swept else ()), *columns, *words])
    else:
        named = laws.names
    binder = Binder(variables, named, f"{top}: ")
    where, read = f"{top}: [observe] output", stated.read
    output = read(binder.real, file.observe.output, where, READABLE, "observed")
    if output:
        campaign = read(_in_unit_of_output, campaign, output, binder) or campaign
    drive = read(_bind_drive, file.drive, binder, f"{top}: [drive]")
    drift = read(bind_drift, campaign, binder)
    noise = read(bind_noise, campaign)
    read(binder.settings, columns)
    where = f"{top}: [derived] outputs"
    read(gathered, (partial(binder.reported, n, where, file.laws) for n in file.derived.outputs))
    start_values = read(binder.settings, file.fmu.start)
    annotation = read(_bind_annotation, file.accuracy, binder, f"{top}: [accuracy]")
    settings = read(binder.settings, swept.set if swept else {})
    sigmas = read(bind_sigmas, swept.set_sigma if swept else {}, binder)
    parameters = read(bind_parameters, file.parameters, binder)
    alternatives = read(bind_alternatives, file.alternatives, binder)
    where = f"{top}: [fmu] taken"
    kept = read(gathered, (partial(binder.real, n, where, SETTABLE, "set") for n in file.fmu.taken))
    if not output or not drive:  # nothing else can be bound without them
        stated.check()
    setup = Setup(drive=drive, output=output.name, laws=laws or Laws(), source=top)
    if not stated.lines:
        accuracy = file.accuracy.amplitude
        setup = replace(
            setup,
            start_values=start_values,
            steady_start=file.observe.steady_start,
            line_width_hz=file.observe.line_width,
            accuracy=USUAL_ACCURACY if accuracy is None else accuracy,
            annotation=annotation,
            window=file.accuracy.prescribed,
        )
        experiments = _bind_experiments(campaign, binder, drive, drift, output)
    readers = [partial(m.bind, binder, setup) for m in campaign.measurements.values()]
    made = read(gathered, readers)
    stated.check()
    bound = BoundCampaign(
        **{of.name: getattr(file, of.name) for of in fields(CampaignHead)},
        path=campaign.path,
        setup=setup,
        experiments=experiments,
        sweep=campaign.sweep
        and replace(
            campaign.sweep,
            settings=settings,
            setting_sigma=sigmas,
            scale="grid" if file.accuracy.as_published else campaign.sweep.scale,
        ),
        parameters=(),
        derived=file.derived.outputs,
        alternatives=alternatives,
        amplitude_unit=campaign.amplitude_unit,
        files=campaign.files,
        drift=drift,
        noise=noise,
        measurements=dict(zip(campaign.measurements, made, strict=True)),
        taken={variable.name: variable.unit or "1" for variable in kept},
    )
    bound = completed(bound, binder, parameters, drift_priors(campaign, binder, drift))
    return with_assumptions(bound, file.assumptions, binder)


def completed(
    bound: BoundCampaign, binder: Binder, fitted: Sequence[Parameter], priors: Sequence[Prior] = ()
) -> BoundCampaign:
    """A campaign with all its parameters, notes and laws, whose parts do not contradict each other.

    Args:
        bound: campaign, bound to its FMU but for them.
        binder: of the campaign to its FMU.
        fitted: parameters in the FMU's units, those of the scope "experiment" once.
        priors: what is known beforehand of the error of drifting variables.

    Raises:
        BadInput: a variable that is set in two ways, a tone that is not named, a law of what there
            is not.
    """
    further = bound.measurements.values()
    labels = [*(e.label for e in bound.experiments), *labels_of(further)]
    parameters: list[Parameter] = []
    for p in fitted:
        if p.scope == SCOPES[0]:
            parameters.append(p)
            continue
        for label in labels:
            name = f"{p.name}[{label}]"
            own = replace(p, scope=SCOPES[0], name=name, variable=p.name, experiment=label)
            parameters.append(own)
    parameters += bound.drift.parameters
    sweep = bound.sweep
    if sweep is not None and sweep.scale == "free":
        spread = sweep_sigmas(sweep, bound.noise)
        sigma = sweep_scale_sigma(sweep.amplitude_v, spread, "fit")
        parameters.append(scale_parameter(sigma, swept=sweep.use == "fit"))
    parameters += [p for m in further for p in m.parameters]
    bound = replace(bound, parameters=tuple(parameters), notes=tuple(binder.notes))
    bound = with_offsets(bound, binder, priors)
    check_conflicts(bound, binder)
    check_tones(bound, binder)
    return with_laws(bound, binder)


def bind_parameters(written: Sequence[WrittenParameter], binder: Binder) -> list[Parameter]:
    """Parameters in the FMU's units, those of the scope "experiment" once.

    Args:
        written: as the file or the program has them.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: no such variable, or numbers that it cannot have.
    """
    return gathered(partial(_bind_parameter, each, binder) for each in written)


def _bind_parameter(choice: WrittenParameter, binder: Binder) -> Parameter:
    where = f"{binder.top}{binder.part('parameter', choice.name)}"
    written = written_numbers(choice)
    if choice.name in binder.free_names:  # a law names it, and the FMU has no such variable
        start = written["start"]
        unit = start.unit
        if isinstance(start.value, str):
            unit = choice.unit or parse_quantity(start.value, where=start.where)[1]
        if unit is None:
            raise BadInput(
                f'{where}: a coefficient of laws has no unit, wanted unit = "Hz/V", for example; a '
                'plain number has the unit "1"'
            )
        made = parameter_of(choice.name, unit, written, where)
        return replace(made, scope=choice.scope, role="coefficient")
    declared = choice.unit
    try:
        variable = binder.real(choice.name, where, ("parameter",), "fitted")
        if choice.unit and variable.unit:  # else every number that has this unit complains
            declared = variable.unit
            convert(1.0, choice.unit, variable.unit, where=f"{where} unit")
    except BadInput as error:
        misfits: Sequence[str] = ()
        try:  # what is wrong with the numbers that have units of their own besides
            if declared:
                dimension_of(declared, where=f"{where} unit")
            quantities = (each for each in written.values() if isinstance(each.value, str))
            gathered(partial(in_unit, each, declared) for each in quantities)
        except BadInput as more:
            misfits = more.args
        raise BadInput(*error.args, *misfits) from None
    made = parameter_of(choice.name, choice.unit or "1", written, where, variable, binder)
    return replace(
        made,
        scope=choice.scope,
        least=-math.inf if variable.min is None else variable.min,
        most=math.inf if variable.max is None else variable.max,
    )


def written_numbers(parameter: WrittenParameter) -> dict[str, Written]:
    """The numbers of a parameter with their places, bare ones in the unit of the entry.

    Args:
        parameter: as a file or a program has it.

    Raises:
        BadInput: what is neither a number nor a quantity with a unit.
    """
    made = {}
    for key, value in numbers_of(parameter).items():
        where, unit = f"parameter '{parameter.name}': {key}", parameter.unit
        if isinstance(value, Written):
            bare = not isinstance(value.value, str) and value.unit is None
            made[key] = replace(value, unit=unit) if bare else value
        elif isinstance(value, str):
            number, own = parse_quantity(value, where=where, wanted=unit)
            made[key] = Written(number, own or unit, where)
        else:
            try:
                made[key] = Written(float(value), unit, where)
            except (TypeError, ValueError):
                raise BadInput(
                    f'{where}: found {value!r}, wanted a number or a text as "400 Hz"'
                ) from None
    return made


def parameter_of(
    name: str,
    unit: str | None,
    written: Mapping[str, Written],
    where: str = "",
    variable: FmuVariable | None = None,
    binder: Binder | None = None,
) -> Parameter:
    """A parameter of numbers as written, all put into one unit.

    Args:
        name: of the parameter.
        unit: of the parameter where the FMU has none for it; None: numbers have none.
        written: the numbers by their keys.
        where: opens errors about the numbers together; empty: nothing does.
        variable: of the FMU, whose unit and range hold; None: there is none.
        binder: of the campaign to its FMU, if there is a variable.

    Raises:
        BadInput: another unit, or numbers that no parameter has.
    """
    own = unit if variable is None else variable.unit

    def read(key: str, each: Written) -> float:
        if key in DIFFERENCES:
            return in_unit(each, own, difference=True)
        if binder is None or variable is None or key == "reference":
            return in_unit(each, own)  # the FMU's range does not bind the prior
        return binder.number(variable, each)

    readers = (partial(read, *each) for each in written.items())
    numbers = dict(zip(written, gathered(readers), strict=True))
    lower, upper, start = (numbers[key] for key in ("lower", "upper", "start"))
    try:
        return Parameter(
            name=name,
            unit=own or unit or "",
            lower=lower,
            upper=upper,
            start=start,
            reference=numbers.get("reference", start),
            scale=numbers.get("scale", 0.5 * (upper - lower)),
            period=numbers.get("period"),
            prior=numbers.get("prior"),
        )
    except BadInput as error:
        raise BadInput(f"{where}: {error}" if where else f"{error}") from error


def _bind_drive(choice: WrittenDrive | None, binder: Binder, where: str) -> Drive:
    """How the FMU is driven; not at all where the campaign has no tones."""
    if choice is None:
        return Drive()
    drive = Drive(
        frequency_names=choice.frequencies,
        amplitude_names=choice.amplitudes or (),
        input=choice.input,
        samples_per_period=choice.samples_per_period or SAMPLES_PER_PERIOD,
        highest_order=choice.lines_and_order[1],
    )
    drive, driven = bind_drive(drive, binder, f"{where} {{}}", HOLD_TONES)
    amplitude = binder.number(driven, choice.level)
    if amplitude <= 0.0:
        raise BadInput(f"{choice.level.where}: found {amplitude:.6g}, wanted a positive amplitude")
    return replace(drive, amplitude=amplitude, frequency_unit=drive.tone_unit)


def bind_drive(
    drive: Drive, binder: Binder, where: str, hold: Sequence[str] = SETTABLE
) -> tuple[Drive, FmuVariable]:
    """The drive with the unit of its frequencies, and the first variable that has its amplitude.

    Args:
        drive: with an input or names of tones.
        binder: of the campaign to its FMU.
        where: what errors name its keys by, as "[drive] {}".
        hold: causalities of variables that hold a tone.

    Raises:
        BadInput: a variable that is not there or cannot be set, tones in different units.
    """
    if drive.input is not None:
        return drive, binder.real(drive.input, where.format("input"), ("input",), "driven")
    names, place = drive.frequency_names, where.format("frequencies")
    named = [(name, place) for name in names]
    named += [(name, where.format("amplitudes")) for name in drive.amplitude_names]
    kept = gathered(partial(binder.real, *each, hold, "set") for each in named)
    units = [tone.unit or drive.tone_unit for tone in kept[: len(names)]]
    if len(set(units)) > 1:
        raise BadInput(f"{place}: the FMU has the frequencies in different units: {units}")
    if drive.frequency_unit not in ("", units[0]):
        raise BadInput(
            f"{place}: frequency_unit is {drive.frequency_unit!r}, but the FMU has '{names[0]}' "
            f"in {units[0]!r}; wanted that, or nothing"
        )
    if not same_kind(units[0], "Hz"):
        raise BadInput(f"{place}: the unit of '{names[0]}' is {units[0]!r}, wanted a frequency")
    return replace(drive, frequency_unit=units[0]), kept[len(names)]


def _in_unit_of_output(campaign: Campaign, output: FmuVariable, binder: Binder) -> Campaign:
    """Amplitudes in the output's unit where no scale stands between the two, else as they are."""
    if campaign.is_scaled or not (campaign.experiments or campaign.sweep):
        return campaign
    own, section = campaign.amplitude_unit, "sweep" if campaign.sweep else "experiments"
    factor = factor_to_output(own, output, f"{campaign.path}: [{section}] amplitude")
    if output.unit is None:
        binder.note_missing_unit(output)
    if factor == 1.0:
        return campaign
    unit = output.unit or base_unit(own)
    binder.note(note(Kind.amplitudes_converted, output.name, {"units": (own, unit)}))

    def converted(curve: Curve) -> Curve:
        return replace(curve, amplitude_v=factor * curve.amplitude_v, unit=unit)

    experiments = tuple(
        replace(
            e,
            peaks_v=factor * e.peaks_v,
            sigmas_v=factor * e.sigmas_v,
            floor_v=factor * e.floor_v,
            spectrum=e.spectrum and converted(e.spectrum),
        )
        for e in campaign.experiments
    )
    sweep = campaign.sweep and converted(campaign.sweep)
    if sweep is not None and sweep.sigma_v is not None:
        sweep = replace(sweep, sigma_v=factor * sweep.sigma_v)
    return replace(campaign, experiments=experiments, sweep=sweep, unit=unit)


def factor_to_output(unit: str, output: FmuVariable, where: str) -> float:
    """By which amplitudes are multiplied that no scale compares with the output.

    Args:
        unit: of the amplitudes.
        output: of the FMU.
        where: what errors name the amplitudes by.

    Raises:
        BadInput: units of different kinds.
    """
    try:
        return convert(1.0, unit, output.unit, where=where)
    except BadInput as error:
        raise BadInput(
            f"{error}; without a scale amplitudes are compared with '{output.name}' as they are"
        ) from error


def _bind_annotation(choice: WrittenAccuracy, binder: Binder, where: str) -> AccuracyAnnotation:
    """The [accuracy] table in the FMU's names and units."""
    stated = Complaints()
    for name in filter(None, (choice.tolerance, choice.substep)):
        stated.read(binder.real, name, where, SETTABLE, "set")
    settings = []
    for entry in choice.reductions:
        if entry.bound is not None and "{output}" not in entry.bound:
            inside = f"{where.removesuffix(']')}.reductions '{entry.name}'] bound"
            stated.read(binder.real, entry.bound, inside, READABLE, "read")
        settings.append(stated.read(binder.settings, entry.set))
    full = stated.read(binder.settings, choice.full)
    stated.check()
    pairs = zip(choice.reductions, settings, strict=True)
    reductions = tuple(Reduction(**(vars(entry) | {"set": own})) for entry, own in pairs)
    same = {of.name: getattr(choice, of.name) for of in fields(AccuracyNames)}
    try:
        return AccuracyAnnotation(**same, full=full, reductions=reductions)
    except BadInput as error:
        raise BadInput(f"{where} {error}") from error


def _bind_experiments(
    campaign: Campaign, binder: Binder, drive: Drive, drift: Drift, output: FmuVariable
) -> tuple[Experiment, ...]:
    """All experiments, with what drifts between the ends of the series."""
    readers = (partial(bind_experiment, e, binder, drive, output) for e in campaign.experiments)
    bound = []
    for e, position in zip(gathered(readers), drift.positions, strict=True):
        for name in (name for name in drift.ends if name in e.settings):
            where = e.written[name].where
            raise BadInput(f"{where}: '{name}' is set here and by [drift]; wanted one of them")
        moved = {name: b + position * (after - b) for name, (b, after) in drift.ends.items()}
        bound.append(replace(e, settings={**e.settings, **moved}))
    return tuple(bound)


def bind_experiment(
    measured: Experiment, binder: Binder, drive: Drive, output: FmuVariable
) -> Experiment:
    """One experiment in the names and units of the FMU.

    Args:
        measured: an experiment as it was read.
        binder: of the campaign to its FMU.
        drive: the campaign's drive.
        output: that the campaign observes.

    Raises:
        BadInput: a variable that is not there or cannot be set, another unit of what is observed.
    """
    settings = binder.settings(measured.written)
    if drive.kind == "tones":
        for name, tone in zip(drive.frequency_names, measured.tones_hz, strict=True):
            # from the rounded hertz, so that the FMU is driven at the very frequency that is read
            where = measured.written[name].where
            settings[name] = convert(tone, "Hz", drive.tone_unit, where=where)
    if measured.observed is None:
        return replace(measured, settings=settings, output=output.name)
    name, where = str(measured.observed.value), measured.observed.where
    other = binder.real(name, where, READABLE, "observed")
    if other.unit != output.unit:
        raise BadInput(
            f"{where}: '{name}' is in {other.unit or 'no unit'}, [observe] output in "
            f"{output.unit or 'no unit'}; wanted one unit, because they share the scale"
        )
    return replace(measured, settings=settings, output=name)


def bind_alternatives(
    written: Mapping[str, Sequence[Written]], binder: Binder
) -> tuple[Mapping[str, Scalar], ...]:
    """Every combination of the values to try; one empty mapping without any.

    Args:
        written: values to try, by name.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: a variable that cannot be set, a value that it cannot have, or too many
            combinations.
    """
    count = math.prod(len(values) for values in written.values())
    if count > MOST_ALTERNATIVES:
        raise BadInput(
            f"[alternatives]: {count} combinations of values, wanted {MOST_ALTERNATIVES} at most: "
            "each is a fit of its own"
        )
    each = [(name, value) for name, values in written.items() for value in values]
    values = iter(gathered(partial(binder.setting, *one) for one in each))
    tried = [[(name, next(values)) for _ in own] for name, own in written.items()]
    return tuple(dict(combination) for combination in itertools.product(*tried))
