"""Parameters and measurements as a problem, whose functions other programs may take."""

from __future__ import annotations

import filecmp
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fitting.api.fmu import Fmu, opened_fmu
from fitting.campaign import Campaign as Campaign
from fitting.campaign import WrittenFmu, bind
from fitting.campaign.arrays import Parameter, Sweep, Tones, bind_arrays
from fitting.campaign.bound import BoundCampaign
from fitting.campaign.joint import refuse_repeats
from fitting.campaign.noise import Noise
from fitting.campaign.parameters import Parameter as BoundParameter
from fitting.campaign.parameters import bounds, names, scales, starts, to_model, to_search
from fitting.fit.density import Density
from fitting.fit.objective import Objective, evaluate_many, jacobian_of, make_objective, stencil
from fitting.fit.options import Options, options_of
from fitting.fit.problem import PlannedFmu, plan_problem, problem_of
from fitting.fit.problem import Problem as Record
from fitting.fmu.isolation import Isolate
from fitting.fmu.models import built_model
from fitting.fmu.parameter_set import SetValue, read_parameter_set
from fitting.measurements.complex_sweep import ComplexSweep
from fitting.measurements.dataset import part_of
from fitting.measurements.kinds import read_campaign
from fitting.measurements.measurement import Measurement, Response
from fitting.measurements.noise import NoiseSpectrum
from fitting.measurements.traces import DemodulatedTrace, Trace
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, shown
from fitting.text.units import checked_accuracy, convert

#: What a program gives as measured.
Measured = Tones | Sweep | ComplexSweep | Trace | DemodulatedTrace | NoiseSpectrum | Measurement
#: Where a search starts: values by parameter in its unit, or the path of an .ssv file.
Starts = Mapping[str, float] | str | Path
#: Makes the model of one discrete alternative.
Respond = Callable[[Mapping[str, Scalar]], Response]


class Problem:
    """Fitted parameters of an FMU, and the measurements to which they are fitted.

    Its functions take parameters p, shape (n,) or (..., n), in their units and in the order of
    ``names``; they are those of the first of the ``alternatives``, or of `with_alternative`.

    Args:
        fmu: The FMU, its path, or a model of this project.
        parameters: One or several.
        measurements: `Tones`, `Sweep`, `ComplexSweep`, `ControlSweep`, `Trace`, `DemodulatedTrace`,
            `NoiseSpectrum`, or a further kind (`fitting.measurements.measurement.Measurement`), one
            or several.
        derived: Outputs of the FMU that are reported with errors.
        alternatives: Values to try by variable, in all combinations; the best is reported.
        noise: Noise of amplitudes, next to ``sigmas_v``.
        accuracy: Relative accuracy of simulated amplitudes, in (0, 1); None: the setups', or a
            tenth of the data's noise.

    Raises:
        BadInput: nothing to fit, or names, units or shapes that fit neither FMU nor each other.
    """

    def __init__(  # noqa: PLR0913 - keywords that all have defaults
        self,
        fmu: Fmu | str | Path,
        parameters: Sequence[Parameter] | Parameter,
        measurements: Sequence[Measured] | Measured,
        *,
        derived: Sequence[str] | str = (),
        alternatives: Mapping[str, Sequence[Scalar]] | None = None,
        noise: Noise | None = None,
        accuracy: float | None = None,
    ) -> None:
        if accuracy is not None:
            checked_accuracy(accuracy, "accuracy")
        if noise is not None and not isinstance(noise, Noise):
            raise BadInput(f"problem: noise is {shown(noise)}, wanted a Noise")
        fmu = opened_fmu(fmu)
        bound = bind_arrays(
            [parameters] if isinstance(parameters, Parameter) else parameters,
            measurements if isinstance(measurements, Sequence) else [measurements],
            fmu.variables,
            derived=[derived] if isinstance(derived, str) else derived,
            alternatives=alternatives,
            noise=noise,
        )
        if accuracy is not None:
            bound = tuple(replace(b, setup=replace(b.setup, accuracy=accuracy)) for b in bound)
        refuse_repeats(bound)
        record = problem_of(bound)
        self._take(record, options_of(None, record.measurements), fmu)

    @classmethod
    def of(
        cls,
        campaigns: str | Path | Campaign | Sequence[str | Path | Campaign],
        fmu: Fmu | None = None,
        *,
        accuracy: float | None = None,
        start: Starts | None = None,
    ) -> Problem:
        """The problem of one campaign, or of several of one sample together.

        Args:
            campaigns: Campaigns or their paths.
            fmu: The FMU; None: the campaigns'.
            accuracy: Relative accuracy of simulated amplitudes, in (0, 1); None: the campaigns'.
            start: Start of the search: values by parameter in its unit, or the path of a parameter
                set (.ssv); None: the campaigns'.

        Raises:
            BadInput: campaigns that cannot be read, contradict each other or do not fit the FMU.
        """
        given = [campaigns] if isinstance(campaigns, str | Path | Campaign) else campaigns
        read = [c if isinstance(c, Campaign) else read_campaign(c) for c in given]
        if not read:
            raise BadInput("problem: no campaigns, wanted at least one")
        if fmu is None:
            fmu = fmu_of(read)
        bound = [bind(campaign, fmu.variables) for campaign in read]
        if accuracy is not None:
            accuracy = checked_accuracy(accuracy, "accuracy")
            bound = [replace(b, setup=replace(b.setup, accuracy=accuracy)) for b in bound]
        if start is not None:
            bound = started(bound, start)
        record = problem_of(bound)
        refuse_repeats(bound)
        made = cls.__new__(cls)
        made._take(record, options_of(read[0].file.continuation, record.measurements), fmu, read)
        return made

    @classmethod
    def answered_by(cls, respond: Respond, record: Record) -> Problem:
        """A problem whose model is no FMU.

        Args:
            respond: Makes the `fitting.measurements.measurement.Response` of one alternative.
            record: Parameters and measurements, a `fitting.fit.problem.Problem`.
        """
        made = cls.__new__(cls)
        options = options_of(None, record.measurements)
        made._take(record, options, None, respond=respond)
        return made

    def _take(
        self,
        record: Record,
        options: Options,
        fmu: Fmu | None,
        campaigns: Sequence[Campaign] = (),
        respond: Respond | None = None,
    ) -> None:
        self.record, self.options, self.campaigns = record, options, tuple(campaigns)
        self._fmu, self._respond = fmu, respond
        self._alternative = 0
        self.density = Density(record.parameters, record.data)

    def with_alternative(self, number: int) -> Problem:
        """The same problem with the functions of another alternative.

        Args:
            number: In ``record.alternatives``, from 0.

        Raises:
            BadInput: there is no such alternative.
        """
        count = len(self.record.alternatives)
        if not 0 <= number < count:
            raise BadInput(f"alternative {number}: there are {count}, counted from 0")
        return self._changed("objective", _alternative=number)

    def widened(self, factor: float, p: npt.ArrayLike) -> Problem:
        """The same problem, whose rows of unknown noise constrain the parameters less.

            S(p) -> S(p0) + (S(p) - S(p0))/factor^2

        Args:
            factor: On errors, as for correlated residuals, at least 1.
            p: p0, the best fit, shape (n,).

        Raises:
            BadInput: a factor below 1.
            FmuFailure: the FMU failed there.
        """
        if not factor >= 1.0:
            raise BadInput(f"problem: the factor is {factor!r}, wanted at least 1")
        density = replace(self.density, share=1.0, least=0.0)
        least = float(np.sum(self.residuals(p)[~density.known] ** 2))
        return self._changed(density=replace(density, share=factor**-2, least=least))

    @property
    def unknown_noise(self) -> int:
        """Number of rows of unknown noise."""
        return int(np.sum(~self.density.known))

    def part(self, settings: Mapping[str, Scalar]) -> Problem:
        """The same problem with only the measurements at these settings.

        Args:
            settings: Values of control quantities or FMU variables by name, in the unit in which
                they are bound.

        Raises:
            BadInput: a name that no measurement sets, values that nothing was measured at or
                everything, or too little left of a measurement.
        """
        data = part_of(self.record.data, settings)
        record, density = replace(self.record, data=data), replace(self.density, data=data)
        return self._changed("objective", "planned", record=record, density=density)

    @property
    def has_fmu(self) -> bool:
        """Whether the model is an FMU."""
        return self._fmu is not None

    @property
    def fmu(self) -> Fmu:
        """The FMU.

        Raises:
            BadInput: the model is another program.
        """
        if self._fmu is None:
            raise BadInput("problem: its model is another program, wanted one with an FMU")
        return self._fmu

    @cached_property
    def planned(self) -> PlannedFmu:
        """The FMU with its plan, made at the first use."""
        return plan_problem(self.record, self.fmu.workers)

    def planned_as(self, planned: PlannedFmu) -> Problem:
        """The same problem by another plan.

        Args:
            planned: The FMU with that plan.
        """
        return self._changed("objective", planned=planned)

    def _changed(self, *without: str, **attributes: Any) -> Problem:
        """The same problem with other attributes, and without some that were computed before."""
        other = copy(self)
        for name in without:
            other.__dict__.pop(name, None)
        other.__dict__.update(attributes)
        return other

    def respond(self, alternative: Mapping[str, Scalar]) -> Response:
        """The model of one alternative.

        Args:
            alternative: One of ``record.alternatives``.
        """
        if self._respond is not None:
            return self._respond(alternative)
        return self.planned.response(alternative)

    @cached_property
    def objective(self) -> Objective:
        """The model next to the data."""
        record = self.record
        response = self.respond(record.alternatives[self._alternative])
        return make_objective(response, record.parameters, record.data)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters, in the order of p."""
        return names(self.record.parameters)

    @property
    def start(self) -> FloatArray:
        """Start of the search, shape (n,), in the parameters' units."""
        return starts(self.record.parameters)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds, shape (n,) each, in the parameters' units."""
        return bounds(self.record.parameters)

    def to_search(self, p: npt.ArrayLike) -> FloatArray:
        """Search vectors x = (p - reference)/scale.

        Args:
            p: Parameters, shape (..., n), in their units.
        """
        return to_search(self.record.parameters, self._checked(p))

    def from_search(self, x: npt.ArrayLike) -> FloatArray:
        """Parameters p = reference + scale x, in their units.

        Args:
            x: Search vectors, shape (..., n), without unit.
        """
        return to_model(self.record.parameters, self._checked(x))

    def residuals(self, p: npt.ArrayLike) -> FloatArray:
        """Residual rows r, shape (..., m), over the peak, or a sweep's maximum.

        Args:
            p: Parameters, shape (..., n), in their units.

        Raises:
            FmuFailure: the FMU failed at one of them.
        """
        table = self._checked(p)
        rows = self._rows(table.reshape(-1, table.shape[-1]))
        return rows.reshape(*table.shape[:-1], rows.shape[-1])

    def jac(self, p: npt.ArrayLike) -> FloatArray:
        """dr/dp, shape (..., m, n), by central differences.

        Args:
            p: Parameters, shape (..., n), in their units, within bounds.

        Raises:
            FmuFailure: the FMU failed at one of them.
        """
        table = self._checked(p)
        xs = to_search(self.record.parameters, table.reshape(-1, table.shape[-1]))
        around = [stencil(self.objective, x) for x in xs]
        nodes = [node for each in around for node in each.nodes]
        points = iter(evaluate_many(self.objective, nodes))
        result = [jacobian_of(each, [next(points) for _ in each.nodes]) for each in around]
        scaled = np.array(result) / scales(self.record.parameters)
        return np.asarray(scaled.reshape(*table.shape[:-1], *scaled.shape[-2:]))

    def logl(self, p: npt.ArrayLike) -> FloatArray:
        """ln L, shape (...): Gaussian for known noise, Student's t for unknown.

        Args:
            p: Parameters, shape (..., n), in their units.

        Raises:
            BadInput: the noise of some rows is not known, and they are too few to estimate it, or
                share the error of a scale.
            FmuFailure: the FMU failed at one of them.
        """
        _ = self.density.noise, self.density.dof  # what they refuse is not simulated
        rows = self.residuals(p)
        return self.density.logl(rows.reshape(-1, rows.shape[-1])).reshape(rows.shape[:-1])

    def logp(self, p: npt.ArrayLike) -> FloatArray:
        """ln of the posterior but for a constant, shape (...): ln L plus ln of the prior.

        The prior is uniform within the bounds, or a parameter's Gaussian there; -inf outside,
        without simulation.

        Args:
            p: Parameters, shape (..., n), in their units.

        Raises:
            BadInput: as `logl`.
            FmuFailure: the FMU failed inside the box.
        """
        table = self._checked(p)
        lower, upper = self.bounds
        flat = table.reshape(-1, table.shape[-1])
        inside = np.all((flat >= lower) & (flat <= upper), axis=1)
        result = np.full(len(flat), -np.inf)
        if np.any(inside):
            result[inside] = self.logl(flat[inside]) + self.density.logprior(flat[inside])
        return result.reshape(table.shape[:-1])

    def white_rows(self, p: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Rows of unit variance and their derivatives: r^T dr/dp = -d ln(posterior)/dp.

        Gaussian priors are rows, too: (p - reference)/prior_sigma. Shapes (m + k,), (m + k, n).
        Unknown noise is the scatter at p, sqrt(S/nu).

        Args:
            p: Parameters, shape (n,), in their units, within bounds.

        Raises:
            BadInput: as `logl`.
            FmuFailure: the FMU failed at one of them.
        """
        place = self._checked(p)
        return self.density.white(place, self.residuals(place), self.jac(place))

    def _rows(self, table: FloatArray) -> FloatArray:
        xs = list(to_search(self.record.parameters, table))
        points = evaluate_many(self.objective, xs)
        return np.array([point.residuals for point in points])

    def _checked(self, p: npt.ArrayLike) -> FloatArray:
        table, n = np.asarray(p, dtype=float), len(self.record.parameters)
        if table.ndim == 0 or table.shape[-1] != n:
            raise BadInput(
                f"problem: parameters have the shape {table.shape}, wanted (..., {n}) for "
                f"{', '.join(self.names)}"
            )
        return table

    def __repr__(self) -> str:
        rows = self.record.data.sigma.size
        return f"<Problem {self.record.title}: {', '.join(self.names)} from {rows} rows>"


def fmu_of(
    campaigns: Sequence[Campaign],
    folder: Path | None = None,
    workers: int = 2,
    *,
    isolate: Isolate = False,
    native: bool = False,
) -> Fmu:
    """The FMU that campaigns name.

    Args:
        campaigns: One or more that are fitted together.
        folder: Where a model of this project is built; None: where it goes with the FMU.
        workers: Number of processes, at least 1.
        isolate: Whether they run isolated, see `Fmu`.
        native: Whether a model is compiled, whatever the campaigns state.

    Raises:
        BadInput: they name different ones, or one that is not there, or that this machine cannot
            run.
    """
    named = one_fmu(campaigns)
    named = replace(named, native=named.native or (native and named.model is not None))
    source: str | Path = named.file or str(named.model)
    if folder is not None and named.file is None:
        source = built_model(str(named.model), folder, native=named.native)
    return Fmu(
        source,
        workers,
        named.timeout_s,
        isolate=isolate,
        interface=named.interface,
        native=named.native and folder is None,  # else it is compiled already
        output_delay_steps=named.output_delay_steps,
        tolerance=named.tolerance,
        start_time_s=named.start_time,
        stop_time_s=named.stop_time,
    )


def one_fmu(campaigns: Sequence[Campaign]) -> WrittenFmu:
    """The FMU that campaigns name.

    Args:
        campaigns: One or more that are fitted together.

    Raises:
        BadInput: they name different ones, or one that is not there.
    """
    first = campaigns[0]
    for other in campaigns[1:]:
        one, two = first.file.fmu, other.file.fmu
        pairs = {"": (one.model or one.file, two.model or two.file)}
        pairs |= {
            f" {key}": (getattr(one, key), getattr(two, key))
            for key in (
                "interface",
                "output_delay_steps",
                "tolerance",
                "start_time",
                "stop_time",
            )
        }
        for key, (here, there) in pairs.items():
            if here != there and not (key == "" and _is_one_file(one.file, two.file)):
                raise BadInput(
                    f"{other.path}: [fmu]{key}: {there or 'none'}, but {first.path} has "
                    f"{here or 'none'}; wanted the same in campaigns that are fitted together"
                )
    return first.file.fmu


def _is_one_file(one: Path | None, other: Path | None) -> bool:
    """Whether two paths lead to one content, however they are written."""
    try:
        return one is not None and other is not None and filecmp.cmp(one, other, shallow=False)
    except OSError:  # complained of where it is opened
        return False


def started(campaigns: Sequence[BoundCampaign], start: Starts) -> list[BoundCampaign]:
    """The same campaigns, whose parameters start at these values.

    A file may hold further variables of the FMU, which are left; a mapping may not.

    Args:
        campaigns: bound to their FMU.
        start: values by parameter in its unit, or the path of a parameter set (.ssv).

    Raises:
        BadInput: no parameter of the campaigns is named, or one that there is not; a value outside
            its box, or of another unit.
    """
    if isinstance(start, Mapping):
        where, given = "start", {n: SetValue(name=n, value=v) for n, v in start.items()}
    else:
        where, given = f"{start}", {v.name: v for v in read_parameter_set(Path(start))}
    fitted = dict.fromkeys(p.name for campaign in campaigns for p in campaign.parameters)
    unknown = [name for name in given if name not in fitted]
    if len(unknown) == len(given) or (unknown and isinstance(start, Mapping)):
        named = ", ".join(unknown) or "nothing"
        raise BadInput(f"{where}: found {named}, wanted values of {', '.join(fitted)}")

    def at_start(p: BoundParameter) -> BoundParameter:
        if p.name not in given:
            return p
        value, unit = given[p.name].value, given[p.name].unit
        if isinstance(value, bool | str):
            raise BadInput(f"{where}: {p.name}: found {value!r}, wanted a number")
        value = float(value)
        if unit and unit != p.unit:
            value = convert(value, unit, p.unit, where=f"{where}: {p.name}")
        try:
            return replace(p, start=value)
        except BadInput as error:
            raise BadInput(f"{where}: {error}") from error

    return [replace(c, parameters=tuple(map(at_start, c.parameters))) for c in campaigns]
