"""Campaign meets FMU: names, kinds and units checked, every number converted to the FMU's unit."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fitting.campaign.asked_parameters import bind_parameters
from fitting.campaign.assumptions import with_assumptions
from fitting.campaign.binder import Binder, bind_annotation
from fitting.campaign.bound import BoundCampaign, Drift, Experiment, SweepData
from fitting.campaign.bound_laws import with_laws
from fitting.campaign.conflicts import check_conflicts
from fitting.campaign.data import Campaign, in_other_unit
from fitting.campaign.drift import Drifting, bind_drift
from fitting.campaign.driving import bind_drive
from fitting.campaign.kind import labels_of
from fitting.campaign.measured import MeasuredExperiment
from fitting.campaign.names import check_names
from fitting.campaign.noise import (
    Noise,
    bind_noise,
    scale_parameter,
    sweep_scale_sigma,
    sweep_sigmas,
)
from fitting.campaign.parameters import Parameter
from fitting.campaign.places import places_of_file
from fitting.campaign.setup import USUAL_ACCURACY, Drive, Setup
from fitting.campaign.stated import bind_sigmas, drift_priors, with_offsets
from fitting.campaign.unnamed_tones import check_tones
from fitting.fmu.variables import READABLE, SETTABLE, VariableLike
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, gathered
from fitting.text.units import base_unit, convert
from fitting.text.written import Written

#: Each combination of alternatives is a fit of its own.
MOST_ALTERNATIVES = 100


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
    laws = check_names(campaign, variables, places)
    binder = Binder(variables, laws.names)
    output = binder.real(file.observe.output, f"{top}: [observe] output", READABLE, "observed")
    campaign = _in_unit_of_output(campaign, output, binder)
    drive = bind_drive(campaign, binder)
    drift, noise = bind_drift(campaign, binder), _bind_noise(campaign)
    experiments = _bind_experiments(campaign, binder, drive, drift, output)
    for name in file.derived.outputs:
        binder.reported(name, f"{top}: [derived] outputs", laws.formulas)
    setup = Setup(
        drive=drive,
        output=output.name,
        start_values=binder.settings(file.fmu.start),
        steady_start=file.observe.steady_start,
        line_width_hz=file.observe.line_width,
        accuracy=USUAL_ACCURACY if file.accuracy.amplitude is None else file.accuracy.amplitude,
        usual_accuracy=file.accuracy.amplitude is None,
        annotation=bind_annotation(campaign, binder),
        laws=laws,
        source=top,
    )
    sweep = _bind_sweep(campaign, binder)
    readers = (partial(m.bind, binder, setup) for m in campaign.measurements.values())
    further = dict(zip(campaign.measurements, gathered(readers), strict=True))
    labels = [*(e.label for e in experiments), *labels_of(further.values())]
    bound = BoundCampaign(
        title=file.title,
        path=campaign.path,
        synthetic=file.synthetic,
        setup=setup,
        experiments=experiments,
        sweep=sweep,
        parameters=(
            *bind_parameters(file.parameters, binder, places, labels),
            *drift.parameters,
            *free_scale(sweep, noise),
            *(p for m in further.values() for p in m.parameters),
        ),
        derived=file.derived.outputs,
        alternatives=bind_alternatives(file.alternatives, binder),
        continuation=file.continuation,
        amplitude_unit=campaign.amplitude_unit,
        notes=tuple(binder.notes),
        files=campaign.files,
        drift=Drift(drift.ends, {name: variables[name].unit or "1" for name in drift.ends}),
        noise=noise,
        measurements=further,
        taken={
            name: binder.real(name, f"{top}: [fmu] taken", SETTABLE, "set").unit or "1"
            for name in file.fmu.taken
        },
    )
    bound = with_offsets(bound, binder, drift_priors(campaign, binder, drift))
    check_conflicts(bound, places)
    check_tones(bound, variables, places)
    return with_assumptions(with_laws(bound, binder, places), file.assumptions, binder, places)


def _in_unit_of_output(campaign: Campaign, output: VariableLike, binder: Binder) -> Campaign:
    """Amplitudes in the output's unit where no scale stands between the two, else as they are."""
    if campaign.is_scaled or not (campaign.experiments or campaign.sweep):
        return campaign
    found, section = campaign.amplitude_unit, "sweep" if campaign.sweep else "experiments"
    try:
        where = f"{campaign.path}: [{section}] amplitude"
        factor = convert(1.0, found, output.unit, where=where)
    except BadInput as error:
        raise BadInput(
            f"{error}; without a scale amplitudes are compared with '{output.name}' as they are"
        ) from error
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
        label=measured.label,
        settings=_experiment_settings(measured, binder, drive),
        tones_hz=measured.tones_hz,
        peaks_v=measured.peaks_v,
        sigmas_v=measured.sigmas_v,
        floor_v=measured.floor_v,
        spectrum=measured.spectrum,
        lines_hz=measured.lines_hz,
        output=_observed(measured, binder, output),
        phases=measured.phases,
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


def _bind_sweep(campaign: Campaign, binder: Binder) -> SweepData | None:
    choice, measured = campaign.file.sweep, campaign.sweep
    if choice is None or measured is None:
        return None
    return SweepData(
        frequency_hz=measured.frequency_hz,
        amplitude_v=measured.amplitude_v,
        phase_rad=measured.phase_rad,
        settings=binder.settings(choice.set),
        setting_sigma=bind_sigmas(choice.set_sigma, binder),
        use=choice.use,
        scale=choice.scale,
        source=measured.source,
        background=choice.background,
        unit=measured.unit,
        notes=measured.notes,
        left_out=measured.left_out,
    )


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
    tried = {name: [binder.setting(name, w) for w in values] for name, values in asked.items()}
    return tuple(
        dict(zip(tried, combination, strict=True))
        for combination in itertools.product(*tried.values())
    )
