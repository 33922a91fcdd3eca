"""A fit and what its data determine, with values by name; thin around the records that hold them.

A value that the data leave open is nan here: the number at which the optimiser stopped would be
taken for one.
"""

from __future__ import annotations

import importlib
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fitting.api.printed import HtmlText, data_frame
from fitting.api.problem import Problem
from fitting.engine.threads import one_thread
from fitting.fit.checkpoint import Checkpoint as KeptLevels
from fitting.fit.fit import Fit as FitRecord
from fitting.fit.fit import Status, promised_anew, solve_problem, with_path
from fitting.fit.likelihood import Spent as Spent
from fitting.fit.options import Options, Schedule, usual_misfit
from fitting.fit.path import HistoryRow, Hooks, Memory
from fitting.fit.path import Progress as Progress
from fitting.fit.problem import Problem as Record
from fitting.inference.determine import InferenceOptions
from fitting.inference.infer import Inference as InferenceRecord
from fitting.inference.infer import infer
from fitting.inference.likelihood.knowledge import Inferred, Knowledge, Scan
from fitting.inference.sweeps import SweepFindings, sweep_findings
from fitting.report.summary import detail_lines, result_lines
from fitting.report.table import Table, html_table, table, terminal_text, text_lines, wrapped
from fitting.result.assembly import correlation_of, result_through
from fitting.result.provenance import job_of
from fitting.result.result import Result
from fitting.result.result import read_result as read_record
from fitting.text.arguments import checked
from fitting.text.arrays import FloatArray
from fitting.text.choices import ESTIMATORS, LIKELIHOOD, MISFITS
from fitting.text.errors import BadInput, did_you_mean
from fitting.text.estimate import FittedEstimate, Verdict
from fitting.text.finding import Finding, Kind
from fitting.text.notation import number, span
from fitting.text.rendering import warning_sentences

#: Levels at which intervals are known.
LEVELS = (0.68, 0.95)
#: How often a fit is made anew by a plan that was looked at where it ended.
REVIEWS = 2


@checked
@dataclass(frozen=True)
class Tikhonov:
    """Algorithm 2: a sum of |r| and nu/2 |x|^2, nu lowered level by level.

        nu_l = nu beta^l,  l < levels        x = (p - reference)/scale

    Args:
        nu: First weight of the Tikhonov term, at least 0, without unit.
        beta: Factor between weights, in (0, 1).
        levels: Number of weights, at least 1.
        tolerance: Levels end early where |x_(l+1) - x_l| + |J_fit - J_reg| is not above it.
        misfit: "slack" (as "absolute"): |r| with slack variables; "squares": r^2; None: "squares"
            with a trace, else "slack".
        estimator: Of the reported value: "likelihood", or "algorithm2": the end of the last level.
            Errors are the likelihood's.
        path: Whether levels are computed (`Fit.path`); the likelihood's values do not need them.
        global_path: Whether each level is also minimised within all bounds by a multistart
            (`Fit.global_path`).
        quick: The same as ``path=False``.

    Raises:
        BadInput: a number out of its range, an unknown misfit or estimator.

    Source: the paper, Algorithm 2.
    """

    nu: float = 0.1
    beta: float = 0.1
    levels: int = 9
    tolerance: float = 2.22e-16
    misfit: str | None = None
    estimator: str = LIKELIHOOD
    path: bool = True
    global_path: bool = False
    quick: bool = False

    def __post_init__(self) -> None:
        for name, is_allowed, wanted in (
            ("nu", 0.0 <= self.nu < math.inf, "zero or more"),
            ("beta", 0.0 < self.beta < 1.0, "a factor between 0 and 1"),
            ("levels", self.levels >= 1, "at least 1"),
            ("tolerance", self.tolerance > 0.0, "more than zero"),
            ("misfit", self.misfit in (None, *MISFITS), f"one of {', '.join(MISFITS)}"),
            ("estimator", self.estimator in ESTIMATORS, f"one of {', '.join(ESTIMATORS)}"),
        ):
            if not is_allowed:
                value = getattr(self, name)
                raise BadInput(f"Tikhonov: {name} is {value!r}, wanted {wanted}")

    @classmethod
    def of(cls, options: Options) -> Tikhonov:
        """The method that a problem brings with it.

        Args:
            options: As a campaign has them.
        """
        s = options.schedule
        return cls(
            nu=s.nu_start,
            beta=s.beta,
            levels=s.iterations,
            tolerance=s.tolerance,
            misfit=options.misfit,
            estimator=options.estimator,
            path=options.path,
            global_path=options.global_path,
        )

    def options(self, starts: int, seed: int, usual: str = MISFITS[0]) -> Options:
        """All settings of a search.

        Args:
            starts: How many starts, at least 1.
            seed: Of the search, at least 0.
            usual: The misfit where none is named.
        """
        if starts < 1 or seed < 0:
            raise BadInput(f"starts = {starts}, seed = {seed}: wanted at least 1 and at least 0")
        schedule = Schedule(
            nu_start=self.nu,
            beta=self.beta,
            iterations=self.levels,
            tolerance=self.tolerance,
            starts=starts,
            seed=seed,
        )
        return Options(
            schedule=schedule,
            misfit=self.misfit or usual,
            estimator=self.estimator,
            path=self.path and not self.quick,
            global_path=self.global_path,
        )


@dataclass(frozen=True, kw_only=True, repr=False)
class Value(HtmlText, FittedEstimate):
    """One parameter or derived output with what the data determine, in ``unit``.

    ``value`` is the most likely one, or that of `Tikhonov.estimator`; it and ``std`` are nan where
    the data leave a side open, ``likely`` is not. Errors are the likelihood's. ``status`` is a
    `Verdict` with a ``reason``, ``bounds`` the allowed values, ``algorithm2`` the end of Algorithm
    2, ``scan`` the profile or None. Names of 0.2.0 work with a warning until 0.4.
    """

    scan: Scan | None = None

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Lower and upper end of what the data allow, in ``unit``.

        Args:
            level: 0.95 or 0.68.

        Raises:
            BadInput: any other level.
        """
        if level not in LEVELS:
            raise BadInput(f"interval: level is {level!r}, wanted 0.68 or 0.95")
        low, high = self.ci95
        if self.method == "profile":
            return self.ci95 if level == LEVELS[1] else self.ci68
        if level == LEVELS[1] or math.isnan(self.std):
            return low, high
        return max(low, self.likely - self.std), min(high, self.likely + self.std)

    def to_dict(self) -> dict[str, str | float]:
        """The value as a flat row."""
        low, high = self.interval()
        return {
            "name": self.name,
            "kind": self.role,
            "value": self.value,
            "unit": self.unit,
            "std": self.std,
            "low95": low,
            "high95": high,
            "range_low": self.bounds[0],
            "range_high": self.bounds[1],
            "reference": self.reference,
            "algorithm2": self.algorithm2,
            "verdict": str(self.status),
        }

    def __repr__(self) -> str:
        if math.isnan(self.value):
            open_ = self.ci95 if math.isfinite(self.ci95[0]) else self.bounds
            all_round = self.scan is not None and self.is_all_round
            text = f"{self.name}: {self.status}, "
            text += self.reason if all_round else span(*open_, self.unit)
        else:
            text = f"{self.name} = {self._reported()}, {self.status}{self.condition}"
        return text.replace("\u00a0", " ")

    def _reported(self) -> str:
        """The value with its error; of two estimators, each by its own name."""
        if self.is_most_likely:
            return self.likely_words
        return f"{number(self.value, 7)} {self.unit}".rstrip() + (
            f" by Algorithm 2 (most likely {self.likely_words})"
        )


class Valued(HtmlText, ABC):
    """What has values by name: a fit with its linearised errors, or an inference.

    Names are those of scipy and lmfit. A value that the data leave open is nan, with its error and
    its row of ``covar``; arrays over the parameters are in the order of ``params``.
    """

    @property
    @abstractmethod
    def inferred(self) -> Inferred:
        """All values with intervals, verdicts and warnings, as records."""

    @property
    @abstractmethod
    def source(self) -> Fit:
        """The fit that they are of."""

    @property
    @abstractmethod
    def seconds(self) -> float:
        """How long it took, s."""

    @property
    def is_stored(self) -> bool:
        """Whether it was read from a file."""
        return not isinstance(self.inferred, InferenceRecord)

    @cached_property
    def values(self) -> dict[str, Value]:
        """Every value by name, those of single experiments, too."""
        record = self.inferred
        every = (*record.parameters.values(), *record.derived.values(), *record.offsets)
        return {e.name: _value(e, record.scans.get(e.name)) for e in every}

    def __getitem__(self, name: str) -> Value:
        if name not in self.values:
            raise KeyError(f"no value '{name}'{did_you_mean(name, sorted(self.values))}")
        return self.values[name]

    @property
    def params(self) -> dict[str, Value]:
        """The n fitted parameters by name."""
        return {name: self.values[name] for name in self.inferred.parameters}

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of ``params``, shape (n,) each."""
        lower, upper = np.array([value.bounds for value in self.params.values()]).T
        return lower, upper

    @property
    def correl(self) -> FloatArray:
        """Correlations of ``params``, shape (n, n), linearised."""
        if self.is_stored:
            return np.array(self.result.correlation)
        return np.array(correlation_of(self.source.record.solution))

    @property
    def covar(self) -> FloatArray:
        """Covariance of ``params``, shape (n, n): ``correl`` with each ``std``."""
        std = np.array([value.std for value in self.params.values()])
        return np.asarray(self.correl * np.outer(std, std))

    @property
    def chisqr(self) -> float:
        """χ² of rows of known noise at the most likely point; nan: none."""
        return self.inferred.chi_square

    @property
    def dof(self) -> float:
        """Degrees of freedom of ``chisqr``."""
        return self.inferred.dof

    @property
    def redchi(self) -> float:
        """``chisqr``/``dof``, expected to be 1."""
        return self.chisqr / self.dof if self.dof else math.nan

    @property
    def aic(self) -> float:
        """``chisqr`` + 2 (number of fitted parameters)."""
        return self.chisqr + 2.0 * (len(self.inferred.parameters) + len(self.inferred.offsets))

    @property
    def best_fit(self) -> FloatArray:
        """The model's values, shape (k,), V: all peaks, then the points of the sweep."""
        return self._compared(1)

    @property
    def residual(self) -> FloatArray:
        """Data minus ``best_fit``, shape (k,), V."""
        return self._compared(0) - self._compared(1)

    def _compared(self, which: int) -> FloatArray:
        peaks, sweep = self.result.peaks, self.result.sweep
        pairs = [(peak.measured_v, peak.final_v) for peak in peaks]
        if sweep is not None:
            pairs += zip(sweep.measured_v, sweep.final_v, strict=True)
        return np.array([pair[which] for pair in pairs])

    @property
    def fitted_values(self) -> dict[str, float]:
        """Values of all parameters by name, also undetermined and single experiments' ones."""
        record = self.inferred
        if not isinstance(record, InferenceRecord):  # of a file
            return self.result.fitted_values
        names = (p.name for p in record.fit.problem.parameters)
        return dict(zip(names, record.reported.tolist(), strict=True))

    @property
    def status(self) -> str:
        """How it ended: "converged", or another `fitting.fit.fit.Status`."""
        return self.inferred.status

    @property
    def message(self) -> str:
        """How it ended, in a sentence."""
        return self.inferred.message

    @property
    def warnings(self) -> tuple[str, ...]:
        """Findings that require action, in sentences."""
        return warning_sentences(self.inferred.findings)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings as records: kind, severity, subject, numbers."""
        return self.inferred.findings

    @cached_property
    def result(self) -> Result:
        """The record that `result.json` holds.

        Raises:
            BadInput: the model is no FMU.
            FmuFailure: the FMU failed at the solution.
        """
        fit, record = self.source, self.inferred
        if not isinstance(record, InferenceRecord):
            raise BadInput("result: the values are of a file, wanted those of a fit")
        return result_through(fit.problem.planned, fit.record, record, fit.command, self.seconds)

    def fit_report(self) -> str:
        """What ``fmu-fit reconstruct --verbose`` prints: values, findings, how the fit ended."""
        return "\n".join([*result_lines(self.result), "", *detail_lines(self.result)])

    def plot(self, *, ax: Any = None) -> Any:
        """Draw data and model: the sweep, the peaks without one, else the first measurement.

        Args:
            ax: Where to draw; None: pyplot's current axes.

        Returns:
            The axes. `fitting.plot` has every plot.
        """
        plots = importlib.import_module("fitting.api.plot")  # it takes these classes
        if not self.is_stored and not self.source.record.problem.data.tones:
            return plots.measurement(self, ax=ax)
        draw = plots.residuals if self.result.sweep is None else plots.frequency_response
        return draw(self, ax=ax)

    def to_dict(self) -> list[dict[str, str | float]]:
        """A flat row per value, as ``pandas.DataFrame`` takes them."""
        return [value.to_dict() for value in self.values.values()]

    def to_dataframe(self) -> Any:
        """A row per value as a ``pandas.DataFrame``, with the names as its index.

        Raises:
            BadInput: pandas is not installed.
        """
        return data_frame(self.to_dict(), "name")

    @property
    def table(self) -> Table:
        """The values as a table."""
        record = self.result if self.is_stored else self.source.problem.record
        return table("intervals", result=self.inferred, title=record.title)

    def __repr__(self) -> str:
        lines = [
            self.table.caption,
            "",
            *text_lines(self.table),
            "",
            *wrapped(self._estimator_words()),
            self.message,
        ]
        return terminal_text("\n".join(lines))

    def _repr_html_(self) -> str:
        return html_table(replace(self.table, note=self._estimator_words()))

    def _estimator_words(self) -> str:
        """Whose the values are, and what `Fit.x` is."""
        if self.is_stored:
            return f"Read from a file; made by: {self.result.provenance.command}"
        if self.source.record.options.estimator != LIKELIHOOD:
            return "Values are those of Algorithm 2; errors, and fit.x, are the likelihood's."
        return "Values are the most likely ones, as fit.x is."


class Fit(Valued):
    """A solved problem; its values have linearised errors.

    ``record`` is the search's result, ``problem`` what was solved, ``command`` its origin.
    """

    command = "fitting.fit"

    def __init__(self, problem: Problem, record: FitRecord, taken: float) -> None:
        self.problem, self.record = problem, record
        self._taken = taken

    @property
    def _units(self) -> dict[str, str]:
        """Units of the FMU's variables, by name."""
        variables = self.problem.fmu.variables if self.problem.has_fmu else {}
        return {name: variable.unit or "" for name, variable in variables.items()}

    @cached_property
    def inferred(self) -> InferenceRecord:
        """Values with linearised errors, as records."""
        options = InferenceOptions(units=self._units)
        return infer(self.record, options, profiles=False, sweeps=self._sweeps)

    @cached_property
    def _sweeps(self) -> SweepFindings:
        """What the sweeps show by themselves, and next to the peaks of their series."""
        return sweep_findings(self.record.problem, self.record.solution)

    @property
    def source(self) -> Fit:
        """The fit itself."""
        return self

    @property
    def seconds(self) -> float:
        """Duration of planning and search, s."""
        return self._taken

    @property
    def success(self) -> bool:
        """Whether no linearised step decreases χ²."""
        return self.record.status is Status.CONVERGED

    @property
    def x(self) -> FloatArray:
        """The most likely parameters, shape (n,), in their units."""
        return self.record.x

    @property
    def fun(self) -> float:
        """J_fit, the sum of |r|, there."""
        return self.record.solution.final.j_fit

    @property
    def nfev(self) -> int:
        """Evaluations of the objective."""
        return self.record.cost.evaluations

    @property
    def njev(self) -> int:
        """Jacobians."""
        return self.record.cost.jacobians

    @property
    def path(self) -> tuple[HistoryRow, ...]:
        """Algorithm 2: its start (level -1), then a row for every ν; empty without it."""
        return self.record.path

    @property
    def global_path(self) -> tuple[HistoryRow, ...]:
        """The same with the least J of a multistart at every ν."""
        return self.record.global_path


class Inference(Valued):
    """What the data of a fit determine: values with intervals of profile likelihoods.

    ``fit`` was examined, ``record`` is the result.
    """

    _fit: Fit | None
    _inferred: InferenceRecord | Result

    def __init__(self, fit: Fit, record: InferenceRecord, taken: float) -> None:
        self._fit, self._inferred, self._seconds = fit, record, fit.seconds + taken

    @classmethod
    def _stored(cls, result: Result) -> Inference:
        """An inference of a file: all but its fit."""
        made = cls.__new__(cls)
        made._fit, made._inferred, made._seconds = None, result, result.seconds
        made.__dict__["result"] = result
        return made

    @property
    def fit(self) -> Fit:
        """The fit."""
        if self._fit is None:
            title = self.result.title
            raise BadInput(f"{title}: a result of a file has no fit, wanted fitting.fit")
        return self._fit

    @property
    def record(self) -> InferenceRecord:
        """The inference as a record."""
        return self.fit.inferred if isinstance(self._inferred, Result) else self._inferred

    @property
    def inferred(self) -> Inferred:
        """Values with intervals, statuses and findings, as records."""
        return self._inferred

    @property
    def source(self) -> Fit:
        """The fit."""
        return self.fit

    @property
    def seconds(self) -> float:
        """Duration of planning, search and profiles, s."""
        return self._seconds

    @property
    def profiled(self) -> bool:
        """Whether every requested profile was scanned; else see `warnings`."""
        return all(finding.kind is not Kind.profiles_missing for finding in self.findings)

    @property
    def knowledge(self) -> Knowledge | None:
        """Profiles, directions, other minima; None: profiles failed, see `warnings`."""
        return self.inferred.knowledge


def read_result(path: str | Path) -> Inference:
    """Read a ``result.json``: values as of `profile`, for plots and other commands.

    Args:
        path: Of the file, of schema 1 (release 0.2.0) or 2.

    Returns:
        An inference with ``result`` and without ``fit``.

    Raises:
        BadInput: it is no such file; names the key.
        MissingFile: there is no file of that name.
    """
    return Inference._stored(read_record(Path(path)))


@checked
@one_thread()
def fit(
    problem: Problem,
    method: Tikhonov | None = None,
    *,
    starts: int | None = None,
    seed: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    memory: Memory | None = None,
) -> Fit:
    """The most likely parameters of a problem, for every alternative, and Algorithm 2.

    Args:
        problem: The problem.
        method: Algorithm 2; None: as the campaign states, none without its table [continuation].
        starts: 1: the problem's start, and a search within the bounds only if noise does not
            explain that fit; more: always a search; None: the campaign's, else 3.
        seed: Of the search; None: the campaign's, else 1.
        progress: Called before every alternative and level.
        memory: Where finished levels are kept for a later run, by `kept_levels`.

    Returns:
        The best fit; ``fit["name"]`` is a value with error and status.

    Raises:
        BadInput: the problem cannot be planned, or settings out of their range.
        FmuFailure: the FMU failed inside the box.
    """
    started = time.perf_counter()
    options = search_options(problem, method, starts, seed)
    hooks = Hooks(progress=progress or (lambda state: None), memory=memory)
    record = solve_problem(problem.record, problem.respond, options, hooks)
    if problem.has_fmu and record.status is not Status.INTERRUPTED:
        problem, record = _reviewed(problem, record, hooks)
    record = with_path(record, hooks)
    return Fit(problem, record, time.perf_counter() - started)


def _reviewed(problem: Problem, record: FitRecord, hooks: Hooks) -> tuple[Problem, FitRecord]:
    """Problem and fit with the plan looked at again where the fit ended.

    What it promises was seen at the start. Where it promises less there, errors are wider for it;
    where it then takes shorter steps, the problem is solved again with these.
    """
    for _ in range(REVIEWS):
        before = problem.planned
        planned = before.reviewed(record.x, record.alternative)
        if planned is before:
            break
        problem = problem.planned_as(planned)
        if all(planned.plans[name].runs_as(plan) for name, plan in before.plans.items()):
            return problem, promised_anew(record, problem.respond)
        record = solve_problem(problem.record, problem.respond, record.options, hooks)
    return problem, record


def search_options(
    problem: Problem, method: Tikhonov | None, starts: int | None, seed: int | None
) -> Options:
    """All settings of a search: what is given, else what the problem brings; see `fit`."""
    own = problem.options.schedule
    return (method or Tikhonov.of(problem.options)).options(
        own.starts if starts is None else starts,
        own.seed if seed is None else seed,
        usual_misfit(problem.record.measurements),
    )


def kept_levels(
    folder: str | Path, problem: Problem, options: Options, *, resume: bool = False
) -> KeptLevels:
    """Finished levels of a search, kept in a folder: those of an interrupted one, or none yet.

    Args:
        folder: Where they are kept.
        problem: What is looked for, and from what.
        options: As `search_options` makes them.
        resume: Whether those that are there count.

    Raises:
        BadInput: what is there is of another search.
    """
    sha256 = problem.fmu.description.sha256 if problem.has_fmu else ""
    job = job_of(problem.record, sha256, options)
    return KeptLevels(Path(folder), job, resume=resume)


@checked
@one_thread()
def profile(
    fit: Fit,
    names: str | Sequence[str] | None = None,
    *,
    budget: int | None = None,
    bootstrap: int = 0,
    progress: Callable[[Spent], None] | None = None,
) -> Inference:
    """Scan profile likelihoods: intervals and statuses without a linearisation.

        Dchi^2(c) = min { chi^2(p) : g(p) = c } - min chi^2        <= 1 (68 %), <= 3.84 (95 %)

    If profiles fail, the values remain and `Inference.warnings` states why. If they lead to a lower
    minimum, `Inference.fit` is the fit there.

    Args:
        fit: A solved problem.
        names: Parameters and derived outputs; None: all. Others keep linearised errors.
        budget: Runs of the FMU, about; incomplete searches are marked. None: 500,000, or 3,000
            evaluations if that is more.
        bootstrap: Synthetic data sets to refit; 0: none.
        progress: Called before every stage and batch with the stage and its evaluations.

    Raises:
        BadInput: a name that the fit has not, or a budget that was spent before there was any.
        FmuFailure: the FMU failed at the solution.

    Source: D. Venzon and S. Moolgavkar, Applied Statistics 37 (1988) 87.
    """
    started = time.perf_counter()
    requested = (names,) if isinstance(names, str) else tuple(names or ())
    record = fit.problem.record
    require_values(
        requested, known_values(record) if record.campaigns else list(fit.values), "profile"
    )
    options = InferenceOptions(
        units=fit._units,
        budget=budget,
        bootstrap=bootstrap,
        only=requested,
        progress=progress or (lambda spent: None),
    )
    earlier = fit.__dict__.get("inferred")  # where values were read before
    result = infer(fit.record, options, sweeps=fit._sweeps, earlier=earlier)
    if result.fit is not fit.record:  # profiles came by a lower minimum
        again = Fit(fit.problem, result.fit, fit.seconds)
        again.command, fit = fit.command, again
    return Inference(fit, result, time.perf_counter() - started)


def known_values(record: Record) -> list[str]:
    """Names of the values that a fit of campaigns will have: those of the whole sample.

    Args:
        record: of the problem.
    """
    own = [p.name for p in record.parameters if not p.experiments]
    return [*own, *record.outputs]


def require_values(names: Sequence[str], known: Sequence[str], where: str) -> None:
    """Refuse a name of a value that there will not be.

    Args:
        names: that were asked for.
        known: of the values.
        where: what complaints begin with.

    Raises:
        BadInput: there is no such value.
    """
    for name in names:
        if name not in known:
            raise BadInput(f"{where}: no value '{name}'{did_you_mean(name, sorted(known))}")


def _value(result: FittedEstimate, scan: Scan | None) -> Value:
    is_open = not result.status.has_value
    if result.role == "offset":  # its prior gives it a value, where the model is right
        is_open = result.status is Verdict.WITHDRAWN
    shared = {each.name: getattr(result, each.name) for each in fields(FittedEstimate)}
    shared["most_likely"] = result.likely
    if is_open:
        shared |= {"value": math.nan, "std": math.nan}
    return Value(**shared, scan=scan)
