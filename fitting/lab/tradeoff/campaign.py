"""A user's campaign as a scene in which accuracy is measured against cost, for any FMU."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fitting.campaign import VariableLike
from fitting.extension.records import BoundCampaign, WrittenFmu
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.lab.tradeoff.records import SUBSTEPS, TOLERANCE
from fitting.lab.tradeoff.scenes import Scene, Solver
from fitting.signal.scale import half_power_width
from fitting.simulate.drive import Drive
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput

#: Held steps of a drive that is none.
USUAL_STEPS = 100
#: What is tried of a solver that the campaign's [accuracy] table names.
TOLERANCES, QUICK_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8), (1e-2, 1e-4, 1e-6)
FEW_SUBSTEPS, QUICK_SUBSTEPS = (20.0, 40.0, 80.0, 160.0), (20.0, 80.0)


def scene_of_campaign(
    bound: BoundCampaign, fmu: WrittenFmu, variables: Mapping[str, VariableLike]
) -> Scene:
    """A campaign as a scene, at the reference values of its parameters.

    Its FMU is taken as it is; what [accuracy] names of tolerance, substep and reductions is tried.

    Args:
        bound: campaign, bound to its FMU.
        fmu: what the campaign says of its FMU.
        variables: of the FMU, by name.

    Raises:
        BadInput: no way to know the campaign's line width.
    """
    width = bound.setup.line_width_hz
    if width is None and bound.sweep is not None:
        width = half_power_width(bound.sweep.frequency_hz, bound.sweep.amplitude_v)
    if width is None:
        raise BadInput(
            f"{bound.path}: [observe] has no line_width; wanted it, or a sweep, to know how long "
            "the FMU takes to settle"
        )
    drive, sweep = bound.setup.drive, bound.sweep
    fitted: dict[str, Scalar] = {p.name: p.reference for p in bound.parameters}
    values: dict[str, Scalar] = {
        **bound.setup.start_values,
        **dict.fromkeys(drive.amplitude_names, drive.amplitude),
        **bound.alternatives[0],
        **fitted,
    }
    blank = Drive(
        start_values=values,
        tones_hz=(0.0,),
        outputs=(bound.setup.output,),
        input=drive.input,
        amplitude=drive.amplitude,
        steps_per_period=drive.samples_per_period if drive.kind == "input" else USUAL_STEPS,
    )
    drives = tuple(
        replace(
            blank,
            start_values={**values, **e.settings, **fitted},
            tones_hz=e.tones_hz,
            outputs=(e.output or bound.setup.output,),
        )
        for e in bound.experiments
    )
    swept = {**sweep.settings, **fitted} if sweep is not None else {}
    silent = dict.fromkeys(drive.amplitude_names[1:], 0.0) if drive.kind == "tones" else {}
    scene = Scene(
        name="campaign",
        title=bound.title,
        description=f"{bound.path.name} at the reference values of its parameters",
        fmu=fmu,
        drives=drives,
        single=replace(blank, start_values={**values, **swept, **silent}),
        width_hz=width,
        fastest_hz=max((tone for d in drives for tone in d.tones_hz), default=0.0),
        solvers=solvers_of(bound.setup.annotation, values, variables),
        steady=bound.setup.steady_start,
        tone=drive.frequency_names[0] if drive.kind == "tones" else "",
        tone_unit=drive.tone_unit,
        sweep_hz=tuple(map(float, sweep.frequency_hz)) if sweep is not None else (),
        annotation=bound.setup.annotation,
        synthetic=bound.synthetic,
    )
    if drives or sweep is None:
        return scene
    # a campaign of a sweep alone: a single tone at its maximum
    top = float(sweep.frequency_hz[int(np.argmax(sweep.amplitude_v))])
    return replace(scene, drives=(scene.single_tone(top),), fastest_hz=top)


def solvers_of(
    annotation: AccuracyAnnotation,
    values: Mapping[str, Scalar],
    variables: Mapping[str, VariableLike],
) -> tuple[Solver, ...]:
    """The full model and each reduction, with every knob that the annotation names.

    All of them set the same variables; what one does not name has the campaign's value, or the
    FMU's own.

    Args:
        annotation: what the FMU says of its own accuracy.
        values: start values, by name.
        variables: of the FMU, by name.
    """
    knobs = [
        (TOLERANCE, annotation.tolerance, TOLERANCES, QUICK_TOLERANCES),
        (SUBSTEPS, annotation.substep, FEW_SUBSTEPS, QUICK_SUBSTEPS),
    ]
    reductions = annotation.reductions
    names = [*annotation.full, *(name for r in reductions for name in r.set)]
    names += [name for _, name, _, _ in knobs if name is not None]
    defaults = {n: values[n] if n in values else _start(variables[n]) for n in names}
    full = {**defaults, **annotation.full}
    kinds = [("full model" if names else "fmu", full)]
    kinds += [(r.name, {**full, **r.set}) for r in reductions]
    found = []
    for name, chosen in kinds:
        turned = [
            Solver(name, values=chosen, kind=kind, variable=variable, resolutions=fine, quick=quick)
            for kind, variable, fine, quick in knobs
            if variable is not None
        ]
        found += turned or [Solver(name, values=chosen)]
    return tuple(found)


def _start(variable: VariableLike) -> Scalar:
    start: Scalar | None = getattr(variable, "start", None)
    if start is None:
        raise BadInput(f"[accuracy]: the FMU gives '{variable.name}' no start value; wanted one")
    return start
