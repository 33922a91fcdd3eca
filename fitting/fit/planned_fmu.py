"""The FMU of a problem, planned: a plan for every series, and the responses that follow from it."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import starts
from fitting.fit.problem import Problem
from fitting.fmu import FmuWorkers, read_accuracy_annotation
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.fmu_response import FmuResponse
from fitting.measurements.plan import Plan
from fitting.measurements.planning import Series, measured_plan, plan_series
from fitting.simulate.batch import Batch
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer

_log = logging.getLogger(__name__)


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
        """What the plans say, of every campaign by its name where there are several."""
        return tuple(
            f"{name}: {sentence}" if name else sentence
            for name, plan in self.plans.items()
            for sentence in plan.sentences
        )


def plan_problem(problem: Problem, workers: FmuWorkers) -> PlannedFmu:
    """Plan every series of a problem with the FMU at hand.

    Args:
        problem: parameters, measurements and alternatives.
        workers: processes that run the FMU.

    Raises:
        FmuFailure: the FMU failed; with its words and the parameters.
        BadInput: a campaign cannot be planned, or something else than it drives the FMU.
    """
    description = workers.description
    series = {
        name: replace(
            problem.planned_together(name),
            own_step_s=description.step_s,
            fixed_step=description.fixed_step,
            any_steps=description.any_steps,
            exchange=description.exchange is not None,
        )
        for name in problem.data.series
    }
    for each in series.values():
        refuse_other_drives(each, workers)
    variables, own = description.settable, read_accuracy_annotation(description)
    plans = {name: measured_plan(each, workers, variables, own) for name, each in series.items()}
    planned = PlannedFmu(problem, workers, plans)
    for sentence in planned.sentences:
        _log.info("plan: %s", sentence)
    return planned


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
    share = 0.0
    try:
        for m in series.measurements:
            ranges = []
            for driven in (False, True):
                # the first run at the start parameters, with the tones of the campaign or without
                drive, batch = m.first_drive(driven=driven), Batch()
                if drive is None:
                    sampled = []
                else:
                    own = replace(model, setup=drive.setup)
                    sampled = drive.sampled(own, starts(model.parameters), batch)
                if sampled:
                    batch.simulate(workers)
                samples = batch.samples(sampled[0].run, sampled[0].output) if sampled else [0.0]
                ranges.append(float(np.ptp(samples)))
            share = max(share, ranges[0] / ranges[1] if ranges[1] > 0.0 else 0.0)
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
