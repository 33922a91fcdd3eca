"""A study: each setting planned, evaluated, compared with a reference, and fitted if asked."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

import fitting as ff
from fitting.extension.records import Campaign
from fitting.lab.tradeoff.records import Row, Setting, Study
from fitting.lab.tradeoff.settings import (
    ACCURACIES,
    QUICK_ACCURACIES,
    reference_of,
    settings_of,
    simulated_by,
)
from fitting.simulate.probe import processor_s
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.journal import Journal

#: Evaluations that are timed at least and at most, and the processor time from which no more, s.
LEAST_TIMED, MOST_TIMED, TIMED_S = 3, 25, 1.0


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """What a study of accuracy against cost compares.

    Args:
        accuracies: Of plans, in (0, 1); none: the usual ones.
        quick: Whether the usual ones are few.
        fit: Whether every setting is fitted, too.
    """

    accuracies: tuple[float, ...] = ()
    quick: bool = False
    fit: bool = False

    @property
    def compared(self) -> tuple[float, ...]:
        """The accuracies at which plans are made."""
        return self.accuracies or (QUICK_ACCURACIES if self.quick else ACCURACIES)


def run_study(
    campaign: Campaign,
    fmu: ff.Fmu,
    options: StudyOptions,
    journal: Journal[Row],
    known: dict[str, Row],
    tell: Callable[[str], None],
) -> Study:
    """Measure every setting of a campaign; what is known is not measured again.

    Args:
        campaign: that is simulated.
        fmu: its FMU, with one worker: fair times.
        options: what is compared.
        journal: where rows are kept as they come.
        known: rows that an earlier run left, by the setting's name.
        tell: is called with a line of progress.

    Raises:
        BadInput: the campaign does not fit the FMU.
        FmuFailure: the FMU failed for every reference.
    """
    study = _Measurements(campaign, fmu, options)
    tell("reference")
    planned = study.problem_of(Setting(name=""))
    settings = settings_of(campaign, fmu, planned, options.compared)
    goals = [p.budget.wanted for p in planned.planned.plans.values() if p.budget is not None]
    reference = study.reference(reference_of(campaign, fmu, min((*options.compared, *goals))))
    rows: list[Row] = []
    status, message = "finished", f"{len(settings)} settings."
    try:
        if options.fit:
            reference = known.get(reference.setting.name) or study.fitted(reference)
            journal.record(reference)
            study.against(reference)
        for k, setting in enumerate(settings):
            tell(f"setting {k + 1} of {len(settings)}: {setting.name}")
            row = known.get(setting.name)
            if row is None:
                row = study.row(setting)
                journal.record(row)
            rows.append(row)
    except KeyboardInterrupt:
        status = "interrupted"
        message = f"{len(rows)} of {len(settings)} settings; continue with --resume."
    return Study(
        title=campaign.file.title or campaign.path.parent.name,
        synthetic=campaign.file.synthetic,
        reference=reference,
        rows=tuple(rows),
        status=status,
        message=message,
    )


def noise_of(problem: ff.Problem) -> FloatArray:
    """Standard deviation of every row: stated, else estimated of its measurement; else zero.

    Args:
        problem: with its data.
    """
    data = problem.objective.data
    sigma = np.array(data.sigma)
    for measurement, place in zip(data.measurements, data.slices, strict=True):
        rows = sigma[place]
        rows[rows == 0.0] = measurement.datum_noise
    return sigma


class _Measurements:
    """Measures settings of one campaign against one reference."""

    def __init__(self, campaign: Campaign, fmu: ff.Fmu, options: StudyOptions) -> None:
        self.campaign, self.fmu, self.options = campaign, fmu, options
        self._truth: FloatArray | None = None
        self._sigma: FloatArray | None = None
        self._reference: Row | None = None

    def problem_of(self, setting: Setting) -> ff.Problem:
        """The campaign's problem, simulated by a setting."""
        return ff.Problem.of(simulated_by(self.campaign, setting), self.fmu)

    def reference(self, settings: list[Setting]) -> Row:
        """The first of some settings that runs, which all others are compared with."""
        failure: BadInput | FmuFailure | None = None
        for setting in settings:
            try:
                problem = self.problem_of(setting)
                row, self._truth = self._evaluated(setting, problem)
            except (BadInput, FmuFailure) as error:
                failure = error
                continue
            self._sigma = noise_of(problem)
            return row
        if failure is None:
            raise BadInput("tradeoff: no setting for a reference")
        raise failure

    def against(self, reference: Row) -> None:
        """Compare the values of fits with those of that row from now on."""
        self._reference = reference

    def row(self, setting: Setting) -> Row:
        """A setting, measured; one that fails is a row with the reason."""
        try:
            problem = self.problem_of(setting)
            row = self._compared(*self._evaluated(setting, problem))
            return self.fitted(row, problem) if self.options.fit else row
        except (BadInput, FmuFailure) as error:
            return Row(setting=setting, failed=str(error))

    def fitted(self, row: Row, problem: ff.Problem | None = None) -> Row:
        """The row with the fit's processor time, values and shifts; seeds are the campaign's."""
        before = self._processor_s()
        fit = ff.fit(problem or self.problem_of(row.setting))
        fit_s = self._processor_s() - before
        values = {name: value.value for name, value in fit.values.items()}
        errors = {name: value.std for name, value in fit.values.items()}
        shifts: dict[str, float] = {}
        if self._reference is not None:
            for name, truth in self._reference.values.items():
                sigma = self._reference.errors[name]
                if sigma > 0.0 and math.isfinite(sigma) and name in values:
                    shifts[name] = (values[name] - truth) / sigma
        return replace(
            row,
            fit_s=fit_s,
            values=values,
            errors=errors,
            shifts=shifts,
        )

    def _processor_s(self) -> float:
        result = processor_s(self.fmu.workers)
        return math.nan if result is None else result

    def _evaluated(self, setting: Setting, problem: ff.Problem) -> tuple[Row, FloatArray]:
        """A row and its simulated residuals (rows,): one evaluation at the start values, timed."""
        p, workers = problem.start, self.fmu.workers
        residuals = problem.residuals(p)  # plans at the first call
        counts = workers.counts
        times: list[float] = []
        while len(times) < MOST_TIMED and (len(times) < LEAST_TIMED or sum(times) < TIMED_S):
            before = self._processor_s()
            problem.residuals(p)
            times.append(self._processor_s() - before)
        done = workers.counts
        promised = [plan.promised for plan in problem.planned.plans.values()]
        row = Row(
            setting=setting,
            evaluation_s=statistics.median(times),
            runs=round((done.runs - counts.runs) / len(times)),
            steps=round((done.steps - counts.steps) / len(times)),
            promised=max(promised),
        )
        return row, residuals

    def _compared(self, row: Row, residuals: FloatArray) -> Row:
        """The row with the errors of its simulated data against the reference's."""
        truth, sigma = self._truth, self._sigma
        if truth is None or sigma is None or truth.shape != residuals.shape:
            return row
        off = np.abs(residuals - truth)
        known = sigma > 0.0
        in_sigma = float(np.max(off[known] / sigma[known])) if np.any(known) else math.nan
        return replace(row, error=float(np.max(off, initial=0.0)), error_sigma=in_sigma)
