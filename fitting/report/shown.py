"""What the report shows of a campaign: the one place that knows how a campaign is held.

Figures, tables and sentences take these records and results, never a campaign itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace

from fitting.campaign import BoundCampaign, Drive, Experiment
from fitting.fit.fit import Fit
from fitting.fit.problem import Problem
from fitting.measurements.figure import Figure
from fitting.report.screen import phrases
from fitting.result.result import DeviationSet, Result
from fitting.text.errors import BadInput
from fitting.text.rendering import sentence
from fitting.text.units import convert


@dataclass(frozen=True, kw_only=True)
class ShownTones:
    """What drove one experiment: ``tones_hz`` (t,), their amplitudes ``drive`` (t,), FMU's unit.

    ``has_spectrum``: its peaks were read from a spectrum.
    """

    label: str
    tones_hz: tuple[float, ...]
    drive: tuple[float, ...]
    has_spectrum: bool = False


@dataclass(frozen=True)
class ShownCampaign:
    """A campaign as the report shows it.

    ``unit`` is that of the amplitudes, ``drive`` the name of the drive; ``drift_hz`` the
    frequencies (before, after) through which the sample drifted, by variable; ``settings`` are
    names and words for the table of settings, ``notes`` sentences; ``series`` holds the campaigns
    that were fitted together, by name; ``figures`` are what the measurements show of themselves.
    """

    title: str
    synthetic: bool
    _: KW_ONLY
    unit: str = "V"
    drive: str = "b"
    tones: tuple[ShownTones, ...] = ()
    drift_hz: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    settings: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    series: Mapping[str, ShownCampaign] = field(default_factory=dict)
    figures: tuple[Figure, ...] = ()

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the experiments, in their order."""
        return tuple(tone.label for tone in self.tones)


def shown_fit(fit: Fit) -> ShownCampaign:
    """All that the report shows of a fit, next to its result.

    Args:
        fit: the solved problem.
    """
    return replace(shown_problem(fit.problem), figures=figures_of(fit))


def figures_of(fit: Fit) -> tuple[Figure, ...]:
    """What the measurements of a fit show next to its model, in their order.

    Args:
        fit: the solved problem.
    """
    before, after = fit.solution.initial.scaled, fit.solution.final.scaled
    answers = zip(fit.problem.measurements, before, after, strict=True)
    return tuple(figure for m, start, end in answers for figure in m.figures(start, end))


def shown_problem(problem: Problem) -> ShownCampaign:
    """All that the report shows of a problem: of its campaign, or of all together and of each.

    Args:
        problem: parameters, measurements and alternatives.
    """
    if not problem.is_joint:
        return shown_campaign(problem.together)
    series = {name: shown_campaign(bound) for name, bound in problem.campaigns.items()}
    return replace(shown_campaign(problem.together), series=series)


def shown_campaign(bound: BoundCampaign) -> ShownCampaign:
    """All that the report shows of one campaign.

    Args:
        bound: campaign, bound to its FMU.
    """
    return ShownCampaign(
        title=bound.title,
        synthetic=bound.synthetic,
        unit=bound.amplitude_unit,
        drive=bound.setup.drive.input or "b",
        tones=tuple(_shown_tones(e, bound.setup.drive) for e in bound.experiments),
        drift_hz=_drift_hz(bound),
        settings={
            name.strip(): words.strip()
            for line in phrases("settings", "campaign", bound)
            for name, _, words in [line.partition("¦")]
        },
        notes=tuple(map(sentence, bound.notes)),
    )


def _shown_tones(experiment: Experiment, drive: Drive) -> ShownTones:
    names = drive.amplitude_names or ("",) * len(experiment.tones_hz)
    return ShownTones(
        label=experiment.label,
        tones_hz=experiment.tones_hz,
        drive=tuple(
            float(experiment.settings.get(name, drive.amplitude))
            for name, _ in zip(names, experiment.tones_hz, strict=False)
        ),
        has_spectrum=experiment.spectrum is not None,
    )


def _drift_hz(bound: BoundCampaign) -> dict[str, tuple[float, float]]:
    """Drifting variables that are frequencies; where no unit is known, the drive's is theirs."""
    result = {}
    for name, (before, after) in bound.drift.ends.items():
        unit = bound.drift.units.get(name, "1")
        unit = bound.setup.drive.tone_unit if unit == "1" else unit
        try:
            result[name] = (
                convert(before, unit, "Hz", where=name),
                convert(after, unit, "Hz", where=name),
            )
        except BadInput:  # a temperature is no frequency
            continue
    return result


def shares_of(result: Result, data: ShownCampaign) -> list[tuple[str, Result, ShownCampaign]]:
    """Name, share of the result and data of every series; empty for a single campaign.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    if result.joint is None:
        return []
    shares = []
    for (name, own), series in zip(data.series.items(), result.joint.series, strict=True):
        labels = set(own.labels)
        rows = [k for k, peak in enumerate(result.peaks) if peak.experiment in labels]
        places = [k for k, label in enumerate(data.labels) if label in labels]
        share = replace(
            result,
            title=own.title,
            synthetic=own.synthetic,
            peaks=tuple(result.peaks[k] for k in rows),
            deviations=replace(
                result.deviations,
                initial=_share(result.deviations.initial, rows, places),
                final=_share(result.deviations.final, rows, places),
            ),
            scale=replace(result.scale, kind=series.scale_kind, final=series.chi),
        )
        shares.append((name, share, own))
    return shares


def _share(whole: DeviationSet, rows: Sequence[int], places: Sequence[int]) -> DeviationSet:
    peaks = tuple(whole.per_peak[k] for k in rows)
    groups = tuple(whole.per_experiment[k] for k in places)
    return DeviationSet(peaks, groups, math.fsum(peaks) / len(peaks) if peaks else math.nan)
