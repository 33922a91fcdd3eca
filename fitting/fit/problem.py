"""What is to be found, and from what: parameters, measurements, discrete alternatives.

The FMU of a problem has a plan for every series, from which the responses of the model follow.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from fitting.campaign import BoundCampaign, Drift, Experiment, SweepData
from fitting.campaign.joint import join_parameters, named_apart
from fitting.campaign.noise import Noise
from fitting.campaign.parameters import Parameter, starts
from fitting.fmu.accuracy import read_accuracy_annotation
from fitting.fmu.description import EXPERIMENT, read_description
from fitting.fmu.pool import FmuWorkers
from fitting.measurements.dataset import Dataset, measurements_of
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.fmu_response import FmuResponse
from fitting.measurements.measurement import Measurement
from fitting.measurements.plan import Plan
from fitting.measurements.planning import Series, measured_plan, plan_series
from fitting.simulate.probe import Knowledge
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.choices import INTERFACES
from fitting.text.errors import BadInput, FmuFailure, NoAnswer
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
            or any(b.sweep is not None and b.sweep.sigma_v is not None for b in bounds)
            or any(bound.measurements for bound in bounds),  # rows of unlike noise
            outliers="huber" if all(n.outliers == "huber" for n in noises) else "keep",
            names=tuple(name for name, _ in series),
        ),
        alternatives=bounds[0].alternatives,
        derived={name: bound.derived for name, bound in series},
        campaigns=dict(series),
        notes=tuple(one for i, one in enumerate(every) if one not in every[:i]),
    )


# --- the FMU of a problem -------------------------------------------------------------------------

_log = logging.getLogger(__name__)

#: Communication steps between two samples of a trace beyond which model exchange is taken instead.
MANY_STEPS = 16


@dataclass(frozen=True)
class PlannedFmu:
    """Running workers of an FMU, and how each series of a problem drives them."""

    problem: Problem
    workers: FmuWorkers
    plans: Mapping[str, Plan]

    def response(self, alternative: Mapping[str, Scalar]) -> FmuResponse:
        """The FMU as the response of one alternative.

        Args:
            alternative: discrete settings, by name.
        """
        problem = self.problem
        models = {
            m.series: DrivenModel(
                setup=m.setup,
                parameters=problem.parameters,
                plan=self.plans[m.series],
                alternative=alternative,
            )
            for m in problem.measurements
        }
        return FmuResponse(
            workers=self.workers,
            parameters=problem.parameters,
            measurements=problem.measurements,
            models=models,
            derived=problem.derived,
        )

    def reviewed(self, p: FloatArray, alternative: Mapping[str, Scalar]) -> PlannedFmu:
        """The same with what the plans can promise at further parameters, as those of a fit.

        Args:
            p: parameters (n,), each in its own unit.
            alternative: discrete settings, by name.

        Raises:
            FmuFailure: the FMU failed there.
        """
        plans, models = dict(self.plans), self.response(alternative).models
        for m in self.problem.measurements:
            plans[m.series] = m.reviewed(
                replace(models[m.series], setup=m.setup, plan=plans[m.series]), p, self.workers
            )
        if all(plan is self.plans[name] for name, plan in plans.items()):
            return self
        planned = replace(self, plans=plans)
        for sentence in planned.sentences:
            _log.info("plan, where the fit ended: %s", sentence)
        return planned

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences of the plans, with the name of the campaign where there are several."""
        return tuple(
            f"{name}: {sentence}" if name else sentence
            for name, plan in self.plans.items()
            for sentence in plan.sentences
        )


def plan_problem(problem: Problem, workers: FmuWorkers) -> PlannedFmu:
    """Plan every series of a problem with the FMU at hand.

    Where steps of co-simulation are many, or leave more than was wanted, and nobody chose the
    interface, the FMU is run by model exchange from then on, if it offers that.

    Args:
        problem: parameters, measurements and alternatives.
        workers: processes that run the FMU.

    Raises:
        FmuFailure: the FMU failed; with its words and the parameters.
        BadInput: a campaign cannot be planned, or something else than it drives the FMU.
    """
    planned, description = _planned(problem, workers), workers.description
    hard_s = max((s for plan in planned.plans.values() for s in _hard_steps_s(plan)), default=0.0)
    if hard_s and not description.is_chosen and INTERFACES[1] in description.offers:
        try:
            exchange = read_description(description.file, INTERFACES[1])
            exchange = replace(exchange, path=description.path, instead_of_s=hard_s)
            given: dict[str, Any] = {key: getattr(description, key) for key in EXPERIMENT}
            workers.go_on_by(replace(exchange, **given))
            planned = _planned(problem, workers)
        except (BadInput, FmuFailure):  # its equations cannot be had: as before
            workers.go_on_by(description)
    for sentence in planned.sentences:
        _log.info("plan: %s", sentence)
    return planned


def _hard_steps_s(plan: Plan) -> Iterator[float]:
    """Communication steps that make a trace expensive, and own ones that make it inaccurate, s."""
    for steps in plan.steps:
        if steps.per_sample > MANY_STEPS:
            yield steps.step_s
        elif steps.internal_step_s and plan.budget is not None and not plan.budget.kept:
            yield steps.internal_step_s


def _planned(problem: Problem, workers: FmuWorkers) -> PlannedFmu:
    """The plans by the interface of the workers."""
    description = workers.description
    known = Knowledge(
        read_accuracy_annotation(description),
        description.settable,
        step_s=description.step_s,
        fixed_step=description.fixed_step,
        exchange=description.exchange is not None,
    )
    series = {name: problem.planned_together(name) for name in problem.data.series}
    for each in series.values():
        refuse_other_drives(each, workers)
    plans = {
        name: measured_plan(each, workers, known, any_steps=description.any_steps)
        for name, each in series.items()
    }
    return PlannedFmu(problem, workers, plans)


def refuse_other_drives(series: Series, workers: FmuWorkers) -> None:
    """A tone that the campaign does not know of falls onto those that it reads.

    Asked before the plan is measured, which would wait for such an output to settle.

    Args:
        series: campaign, drive and measurements that share a plan.
        workers: processes that run the FMU.

    Raises:
        BadInput: the output moves with every amplitude of the campaign at zero.
    """
    draft = plan_series(series)
    setup = series.setup
    if not (setup.steady_start or draft.settle_s > 0.0):
        return  # it may move because it has not settled
    model = DrivenModel(
        setup=setup, parameters=series.parameters, plan=draft, alternative=series.alternative
    )
    zero = dict.fromkeys(setup.drive.amplitude_names, 0.0)
    share = 0.0
    try:
        for m in series.measurements:
            # the first drive at the start parameters, with every amplitude zero and as it is
            for drive in m.drives(model, starts(model.parameters))[:1]:
                off = {**drive.start_values, **zero}
                pair = (replace(drive, start_values=off, amplitude=0.0), drive)
                window = drive.window(draft.settle_s)
                answers = workers.run([each.run(window, {}) for each in pair])
                silent, driven = (float(np.ptp(answer[:, 0])) for answer in answers)
                share = max(share, silent / driven if driven > 0.0 else 0.0)
    except NoAnswer:
        raise
    except (BadInput, FmuFailure):  # an FMU that cannot be without drive cannot be asked
        return
    if share > max(100.0 * setup.accuracy, 1e-4):
        raise BadInput(
            f"{setup.source}: [drive]: '{setup.output}' moves by {share:.1e} of its response where "
            "every amplitude of the drive is zero: wanted what else drives the FMU set to zero in "
            "[fmu.start]"
        )
