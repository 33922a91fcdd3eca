"""What is to be found, and from what: parameters, measurements, discrete alternatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property

from fitting.campaign import BoundCampaign, Drift, Experiment, SweepData
from fitting.campaign.joint import join_parameters, named_apart
from fitting.campaign.noise import Noise
from fitting.campaign.parameters import Parameter
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import Measurement
from fitting.measurements.of_campaign import measurements_of
from fitting.measurements.planning import Series
from fitting.text.arrays import Scalar
from fitting.text.finding import Finding


@dataclass(frozen=True)
class Problem:
    """Parameters that are looked for, and the measurements that they are looked for in.

    `alternatives` holds one mapping of start values per discrete alternative (one empty mapping
    without any); `derived` names the outputs that are reported, by series; `campaigns` are those
    that it was made of, by series, with labels and parameters as they are here.
    """

    parameters: tuple[Parameter, ...]
    data: Dataset
    _: KW_ONLY
    alternatives: tuple[Mapping[str, Scalar], ...] = ({},)
    derived: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    campaigns: Mapping[str, BoundCampaign] = field(default_factory=dict)
    notes: tuple[Finding, ...] = ()

    @property
    def title(self) -> str:
        """Those of all campaigns."""
        return " + ".join(bound.title for bound in self.campaigns.values())

    @property
    def synthetic(self) -> bool:
        """Whether one of the campaigns is."""
        return any(bound.synthetic for bound in self.campaigns.values())

    @property
    def threshold(self) -> float:
        """Beyond how many standard deviations a residual is called an outlier."""
        return next((bound.noise for bound in self.campaigns.values()), Noise()).threshold

    @property
    def measurements(self) -> tuple[Measurement, ...]:
        """All measurements: those with rows of their own first, curves last."""
        return self.data.measurements

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Names of all derived outputs."""
        return tuple(dict.fromkeys(name for names in self.derived.values() for name in names))

    @cached_property
    def experiments(self) -> tuple[Experiment, ...]:
        """Experiments of all series, in the order of their rows."""
        return tuple(e for tones in self.data.tones for e in tones.experiments)

    @property
    def is_joint(self) -> bool:
        """Whether several campaigns are fitted together."""
        return len(self.campaigns) > 1

    @property
    def sweep(self) -> SweepData | None:
        """The sweep of the only campaign; None where there is none, or where there are several."""
        own = [bound.sweep for bound in self.campaigns.values()]
        return own[0] if len(own) == 1 else None

    def planned_together(self, name: str) -> Series:
        """The measurements of one series, as they are planned; `name` of the series."""
        bound = self.campaigns.get(name)
        return Series(
            measurements=tuple(m for m in self.measurements if m.series == name),
            parameters=self.parameters,
            alternative=self.alternatives[0],
            seed=1 if bound is None or bound.continuation is None else bound.continuation.seed,
        )

    @property
    def together(self) -> BoundCampaign:
        """All campaigns as one, for pages and figures: every experiment, a sweep of one alone."""
        first = next(iter(self.campaigns.values()))
        if not self.is_joint:
            return first
        return replace(
            first,
            title=self.title,
            synthetic=self.synthetic,
            experiments=self.experiments,
            sweep=None,
            parameters=self.parameters,
            derived=self.outputs,
            drift=Drift(),
            notes=self.notes,
            measurements={},
        )

    @property
    def accuracy(self) -> float:
        """Accuracy that simulated amplitudes are wanted to: the least of all series."""
        return min(m.setup.accuracy for m in self.measurements)


def problem_of(bounds: Sequence[BoundCampaign]) -> Problem:
    """The problem of one campaign, or of several of one sample together.

    Args:
        bounds: campaigns in the units of one FMU.

    Raises:
        BadInput: campaigns that contradict each other; names both files.
    """
    series = named_apart(bounds)
    parameters, notes = join_parameters([bound for _, bound in series])
    measured = [m for name, bound in series for m in measurements_of(bound, name)]
    has_prior = any(p.prior_sigma is not None for p in parameters)
    noises = [bound.noise for bound in bounds]
    every = [*notes, *(note for bound in bounds for note in bound.notes)]
    return Problem(
        parameters=parameters,
        data=Dataset(
            tuple(sorted(measured, key=lambda m: m.is_curve)),
            weigh=has_prior
            or any(n.declared or n.outliers != "keep" for n in noises)
            or any(bound.measurements for bound in bounds),  # rows of unlike noise
            outliers="huber" if all(n.outliers == "huber" for n in noises) else "keep",
            names=tuple(name for name, _ in series),
        ),
        alternatives=bounds[0].alternatives,
        derived={name: bound.derived for name, bound in series},
        campaigns=dict(series),
        notes=tuple(one for i, one in enumerate(every) if one not in every[:i]),
    )
