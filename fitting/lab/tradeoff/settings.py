"""The ways to simulate a campaign that are compared: accuracies, reductions, the solver's knobs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import fitting as ff
from fitting.extension.records import Campaign
from fitting.fmu.accuracy import AccuracyAnnotation, read_accuracy_annotation
from fitting.lab.tradeoff.records import PLAN, Setting
from fitting.text.units import written_values

ACCURACIES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6)
QUICK_ACCURACIES = (1e-2, 1e-4)
#: A reference aims at so much less than the most accurate setting, and no further than this.
FINER, FINEST = 0.1, 1e-10
#: Values of a knob that is named, as parts of what the plan chose.
KNOBS = (100.0, 10.0, 0.1)


def settings_of(
    campaign: Campaign, fmu: ff.Fmu, planned: ff.Problem, accuracies: Sequence[float]
) -> list[Setting]:
    """Every setting of a campaign, the plan's own first.

    Args:
        campaign: that is simulated.
        fmu: its FMU.
        planned: the problem, with the plan's own setting.
        accuracies: at which plans are made.
    """
    annotation = annotation_of(campaign, fmu)
    names = [reduction.name for reduction in annotation.reductions]
    result = [Setting(name=PLAN)]
    result += [Setting(name=f"accuracy {a:g}", accuracy=a) for a in accuracies]
    if names:
        result.append(Setting(name="no reduction", forbid=tuple(names)))
        result += [Setting(name=f"with {name}", force=(name,)) for name in names]
    chosen = {k: v for plan in planned.planned.plans.values() for k, v in plan.settings.items()}
    for knob in (annotation.tolerance, annotation.substep):
        value = chosen.get(knob or "", 0.0)
        if knob is None or not isinstance(value, float) or not value > 0.0:
            continue
        for part in KNOBS:
            start = {knob: float(f"{part * value:.3g}")}
            result.append(Setting(name=f"{knob} = {start[knob]:g}", start=start))
    return result


def reference_of(campaign: Campaign, fmu: ff.Fmu, accuracy: float) -> list[Setting]:
    """Settings that may be the reference, the most accurate first: the first that runs is.

    Args:
        campaign: that is simulated.
        fmu: its FMU.
        accuracy: the finest of the settings that are compared.
    """
    names = tuple(r.name for r in annotation_of(campaign, fmu).reductions if not r.start)
    finest = max(FINER * accuracy, FINEST)
    return [
        Setting(name=f"reference, accuracy {a:g}", accuracy=a, forbid=forbid)
        for a in (finest, 10.0 * finest)
        for forbid in dict.fromkeys((names, ()))
    ]


def annotation_of(campaign: Campaign, fmu: ff.Fmu) -> AccuracyAnnotation:
    """What the campaign, and where it is silent the FMU, states of accuracy and reductions.

    Args:
        campaign: that is simulated.
        fmu: its FMU.
    """
    written, own = campaign.file.accuracy, read_accuracy_annotation(fmu.description)
    return replace(
        own,
        tolerance=written.tolerance or own.tolerance,
        substep=written.substep or own.substep,
    )


def simulated_by(campaign: Campaign, setting: Setting) -> Campaign:
    """The campaign with a setting of its simulation.

    Args:
        campaign: as it is.
        setting: what is different.
    """
    written, fmu = campaign.file.accuracy, campaign.file.fmu
    forbid = dict.fromkeys((*written.forbid, *setting.forbid))
    accuracy = replace(
        written,
        amplitude=setting.accuracy or written.amplitude,
        force=tuple(dict.fromkeys((*written.force, *setting.force))),
        forbid=tuple(name for name in forbid if name not in setting.force),
    )
    start = {**fmu.start, **written_values(setting.start, setting.name)}
    file = replace(campaign.file, accuracy=accuracy, fmu=replace(fmu, start=start))
    return replace(campaign, file=file)
