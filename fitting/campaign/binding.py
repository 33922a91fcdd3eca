"""Campaign meets FMU: names, kinds and units checked, every number converted to the FMU's unit."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial

import numpy as np

from fitting.campaign.asked_parameters import bind_parameters, of_experiments
from fitting.campaign.assumptions import with_assumptions
from fitting.campaign.binder import Binder, bind_annotation
from fitting.campaign.bound import BoundCampaign, Drift, Experiment, SweepData
from fitting.campaign.conflicts import check_conflicts, check_tones, with_laws
from fitting.campaign.data import Campaign, in_other_unit
from fitting.campaign.drift import Drifting, bind_drift
from fitting.campaign.file import SAMPLES_PER_PERIOD, CampaignHead, WrittenCampaign, WrittenDrive
from fitting.campaign.kind import labels_of
from fitting.campaign.laws import Laws
from fitting.campaign.measured import MeasuredExperiment, Peaks
from fitting.campaign.noise import (
    Noise,
    bind_noise,
    scale_parameter,
    sweep_scale_sigma,
    sweep_sigmas,
)
from fitting.campaign.parameters import Parameter
from fitting.campaign.places import Places, places_of_file
from fitting.campaign.setup import USUAL_ACCURACY, Drive, Setup
from fitting.campaign.stated import DriftPriors, bind_sigmas, drift_priors, with_offsets
from fitting.fmu.variables import READABLE, SETTABLE, VariableLike
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, Complaints, gathered
from fitting.text.units import base_unit, convert, same_kind
from fitting.text.written import Written

#: Each combination of alternatives is a fit of its own.
MOST_ALTERNATIVES = 100
#: Causalities of variables that hold a tone.
HOLD_TONES = ("parameter", "input")
#: A word of a formula.
WORD = re.compile(r"[A-Za-z_]\w*")


def bind(campaign: Campaign, variables: Mapping[str, VariableLike]) -> BoundCampaign:
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
    file, top, places = campaign.file, str(campaign.path), places_of_file(campaign.path)
    said = Complaints()  # of every table by itself, then of what rests on several
    laws, output, drive = Laws(), None, None
    with said:
        laws = Laws(file.laws, file.constants, source=f"{places.top}{places.of('laws')}")
    swept = {} if file.sweep is None else file.sweep.set
    columns: dict[str, Written] = {}  # each where it is first written
    for measured in campaign.experiments:
        columns = {**measured.settings, **columns}
    named = _may_be_named(file, {*swept, *columns}) if said.lines else laws.names
    binder = Binder(variables, named)
    with said:
        where = f"{top}: [observe] output"
        output = binder.real(file.observe.output, where, READABLE, "observed")
        campaign = _in_unit_of_output(campaign, output, binder)
    with said:
        drive = _bind_drive(file.drive, binder, f"{top}: [drive]")
    with said:
        drift = bind_drift(campaign, binder)
    with said:
        noise = _bind_noise(campaign)
    with said:
        binder.settings(columns)
    for name in file.derived.outputs:
        with said:
            binder.reported(name, f"{top}: [derived] outputs", file.laws)
    with said:
        start_values = binder.settings(file.fmu.start)
    with said:
        annotation = bind_annotation(file.accuracy, binder, f"{top}: [accuracy]")
    with said:
        settings = binder.settings(swept)
    with said:
        sigmas = bind_sigmas({} if file.sweep is None else file.sweep.set_sigma, binder)
    with said:
        parameters = bind_parameters(file.parameters, binder, places)
    with said:
        alternatives = bind_alternatives(file.alternatives, binder)
    taken = {}
    for name in file.fmu.taken:
        with said:
            variable = binder.real(name, f"{top}: [fmu] taken", SETTABLE, "set")
            taken[name] = variable.unit or "1"
    if output is None or drive is None:
        said.check()
        raise AssertionError  # pragma: no cover - one of them has complained
    setup = Setup(drive=drive, output=output.name, laws=laws, source=top)
    if not said.lines:
        accuracy = file.accuracy.amplitude
        setup = replace(
            setup,
            start_values=start_values,
            steady_start=file.observe.steady_start,
            line_width_hz=file.observe.line_width,
            accuracy=USUAL_ACCURACY if accuracy is None else accuracy,
            usual_accuracy=accuracy is None,
            annotation=annotation,
        )
        experiments = _bind_experiments(campaign, binder, drive, drift, output)
    with said:
        readers = (partial(m.bind, binder, setup) for m in campaign.measurements.values())
        further = dict(zip(campaign.measurements, gathered(readers), strict=True))
    said.check()
    sweep = None
    if file.sweep is not None and campaign.sweep is not None:
        sweep = SweepData(
            **vars(campaign.sweep),
            settings=settings,
            setting_sigma=sigmas,
            use=file.sweep.use,
            scale=file.sweep.scale,
            background=file.sweep.background,
        )
    labels = [*(e.label for e in experiments), *labels_of(further.values())]
    bound = BoundCampaign(
        **{of.name: getattr(file, of.name) for of in fields(CampaignHead)},
        path=campaign.path,
        setup=setup,
        experiments=experiments,
        sweep=sweep,
        parameters=(
            *of_experiments(parameters, labels),
            *drift.parameters,
            *free_scale(sweep, noise),
            *(p for m in further.values() for p in m.parameters),
        ),
        derived=file.derived.outputs,
        alternatives=alternatives,
        amplitude_unit=campaign.amplitude_unit,
        notes=tuple(binder.notes),
        files=campaign.files,
        drift=Drift(drift.ends, {name: variables[name].unit or "1" for name in drift.ends}),
        noise=noise,
        measurements=further,
        taken=taken,
    )
    bound = completed(bound, binder, places, drift_priors(campaign, binder, drift))
    return with_assumptions(bound, file.assumptions, binder, places)


def _may_be_named(file: WrittenCampaign, measured_at: Collection[str]) -> frozenset[str]:
    """What laws that cannot be read may name: what no variable is called may be meant for them."""
    words = [word for law in file.laws.values() for word in WORD.findall(law)]
    return frozenset([*(p.name for p in file.parameters), *measured_at, *words])


def completed(
    bound: BoundCampaign, binder: Binder, places: Places, priors: DriftPriors
) -> BoundCampaign:
    """A campaign with offsets of stated values and laws, whose parts do not contradict each other.

    Args:
        bound: campaign, bound to its FMU but for them.
        binder: of the campaign to its FMU.
        places: what complaints name its parts by.
        priors: what is known beforehand of the error of drifting variables.

    Raises:
        BadInput: a variable that is set in two ways, a tone that nobody names, a law of what there
            is not.
    """
    bound = with_offsets(bound, binder, priors)
    check_conflicts(bound, places)
    check_tones(bound, binder.variables, places)
    return with_laws(bound, binder, places)


def _bind_drive(choice: WrittenDrive | None, binder: Binder, where: str) -> Drive:
    """How the FMU is driven; not at all where the campaign says nothing of tones."""
    if choice is None:
        return Drive()
    drive = Drive(
        frequency_names=choice.frequencies,
        amplitude_names=choice.amplitudes or (),
        input=choice.input,
        samples_per_period=choice.samples_per_period or SAMPLES_PER_PERIOD,
        highest_order=choice.highest_order,
    )
    drive, driven = bind_drive(drive, binder, f"{where} {{}}", HOLD_TONES)
    amplitude = binder.number(driven, choice.level)
    if amplitude <= 0.0:
        raise BadInput(f"{choice.level.where}: found {amplitude:.6g}, wanted a positive amplitude")
    return replace(drive, amplitude=amplitude, frequency_unit=drive.tone_unit)


def bind_drive(
    drive: Drive, binder: Binder, where: str, hold: Sequence[str] = SETTABLE
) -> tuple[Drive, VariableLike]:
    """The drive with the unit of its frequencies, and the first variable that has its amplitude.

    Args:
        drive: with an input or names of tones.
        binder: of the campaign to its FMU.
        where: what complaints name its keys by, as "[drive] {}".
        hold: causalities of variables that hold a tone.

    Raises:
        BadInput: a variable that is not there or cannot be set, tones in different units.
    """
    if drive.input is not None:
        return drive, binder.real(drive.input, where.format("input"), ("input",), "driven")
    names, place = drive.frequency_names, where.format("frequencies")
    named = [
        *((name, place) for name in names),
        *((name, where.format("amplitudes")) for name in drive.amplitude_names),
    ]
    held = gathered(partial(binder.real, *each, hold, "set") for each in named)
    units = [tone.unit or drive.tone_unit for tone in held[: len(names)]]
    if len(set(units)) > 1:
        raise BadInput(f"{place}: the FMU has the frequencies in different units: {units}")
    if drive.frequency_unit not in ("", units[0]):
        raise BadInput(
            f"{place}: frequency_unit is {drive.frequency_unit!r}, but the FMU has '{names[0]}' "
            f"in {units[0]!r}; wanted that, or nothing"
        )
    if not same_kind(units[0], "Hz"):
        raise BadInput(f"{place}: the unit of '{names[0]}' is {units[0]!r}, wanted a frequency")
    return replace(drive, frequency_unit=units[0]), held[len(names)]


def _in_unit_of_output(campaign: Campaign, output: VariableLike, binder: Binder) -> Campaign:
    """Amplitudes in the output's unit where no scale stands between the two, else as they are."""
    if campaign.is_scaled or not (campaign.experiments or campaign.sweep):
        return campaign
    found, section = campaign.amplitude_unit, "sweep" if campaign.sweep else "experiments"
    factor = factor_to_output(found, output, f"{campaign.path}: [{section}] amplitude")
    if output.unit is None:
        binder.note_missing_unit(output)
    if factor == 1.0:
        return campaign
    unit = output.unit or base_unit(found)
    binder.notes.append(
        f"There is no scale: amplitudes were converted from {found} to {unit}, the unit of "
        f"'{output.name}'."
    )
    return in_other_unit(campaign, factor, unit)


def factor_to_output(unit: str, output: VariableLike, where: str) -> float:
    """By which amplitudes are multiplied that no scale compares with the output.

    Args:
        unit: of the amplitudes.
        output: of the FMU.
        where: what complaints name the amplitudes by.

    Raises:
        BadInput: units of different kinds.
    """
    try:
        return convert(1.0, unit, output.unit, where=where)
    except BadInput as error:
        raise BadInput(
            f"{error}; without a scale amplitudes are compared with '{output.name}' as they are"
        ) from error


def _bind_noise(campaign: Campaign) -> Noise:
    declared = campaign.file.experiments or campaign.file.sweep
    if declared is None:
        return Noise()
    noise = bind_noise(campaign.file.noise, declared.format.amplitude, campaign.amplitude_unit)
    unknown = [e.label for e in campaign.experiments if not np.all(e.sigmas_v > 0.0)]
    if noise.outliers == "huber" and unknown and not noise.declared:
        raise BadInput(
            f'{campaign.path}: [noise] outliers = "huber" wants the noise of every peak, unknown '
            f"for '{unknown[0]}'; wanted peak_sigmas, or relative or absolute in [noise]"
        )
    return noise


def free_scale(sweep: SweepData | None, noise: Noise) -> list[Parameter]:
    """The parameter of a scale that is fitted with the rest; none for any other scale.

    Args:
        sweep: the measured sweep, None without one.
        noise: declared noise of the amplitudes.
    """
    if sweep is None or sweep.scale != "free":
        return []
    spread = sweep_sigmas(sweep.frequency_hz, sweep.amplitude_v, noise)
    sigma = sweep_scale_sigma(sweep.amplitude_v, spread, "fit")
    return [scale_parameter(sigma, swept=sweep.use == "fit")]


def _bind_experiments(
    campaign: Campaign,
    binder: Binder,
    drive: Drive,
    drift: Drifting,
    output: VariableLike,
) -> tuple[Experiment, ...]:
    bound = []
    known = gathered(
        partial(bind_experiment, measured, binder, drive, output)
        for measured in campaign.experiments
    )
    each = zip(campaign.experiments, known, drift.positions, strict=True)
    for measured, experiment, position in each:
        settings = dict(experiment.settings)
        for name, (before, after) in drift.ends.items():
            if name in settings:
                where = measured.settings[name].where
                raise BadInput(f"{where}: '{name}' is set here and by [drift]; wanted one of them")
            settings[name] = before + position * (after - before)
        bound.append(replace(experiment, settings=settings))
    return tuple(bound)


def bind_experiment(
    measured: MeasuredExperiment, binder: Binder, drive: Drive, output: VariableLike
) -> Experiment:
    """One experiment in the names and units of the FMU.

    Args:
        measured: an experiment as it was read.
        binder: of the campaign to its FMU.
        drive: the campaign's drive.
        output: name of the output.

    Raises:
        BadInput: a variable that is not there or cannot be set, another unit of what is observed.
    """
    return Experiment(
        **{of.name: getattr(measured, of.name) for of in fields(Peaks)},
        settings=_experiment_settings(measured, binder, drive),
        output=_observed(measured, binder, output),
    )


def _observed(measured: MeasuredExperiment, binder: Binder, output: VariableLike) -> str:
    """The output that an experiment observes; all share a unit, because they share a scale."""
    if measured.output is None:
        return output.name
    name, where = str(measured.output.value), measured.output.where
    other = binder.real(name, where, READABLE, "observed")
    if other.unit != output.unit:
        raise BadInput(
            f"{where}: '{name}' is in {other.unit or 'no unit'}, [observe] output in "
            f"{output.unit or 'no unit'}; wanted one unit, because they share the scale"
        )
    return name


def _experiment_settings(
    measured: MeasuredExperiment, binder: Binder, drive: Drive
) -> dict[str, Scalar]:
    settings = binder.settings(measured.settings)
    if drive.kind == "tones":
        for name, tone in zip(drive.frequency_names, measured.tones_hz, strict=True):
            where = measured.settings[name].where
            # from the rounded hertz, so that the FMU is driven at the very frequency that is read
            settings[name] = convert(tone, "Hz", drive.tone_unit, where=where)
    return settings


def bind_alternatives(
    asked: Mapping[str, Sequence[Written]], binder: Binder
) -> tuple[Mapping[str, Scalar], ...]:
    """Every combination of the values to try; one empty mapping without any.

    Args:
        asked: values to try, by name.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: a variable that cannot be set, a value that it cannot have, or too many
            combinations.
    """
    count = math.prod(len(values) for values in asked.values())
    if count > MOST_ALTERNATIVES:
        raise BadInput(
            f"[alternatives]: {count} combinations of values, wanted {MOST_ALTERNATIVES} at most: "
            "each is a fit of its own"
        )
    each = [(name, written) for name, values in asked.items() for written in values]
    values = iter(gathered(partial(binder.setting, *one) for one in each))
    tried = {name: list(itertools.islice(values, len(written))) for name, written in asked.items()}
    return tuple(
        dict(zip(tried, combination, strict=True))
        for combination in itertools.product(*tried.values())
    )
