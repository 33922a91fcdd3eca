"""Every statement of a fit held against the truth of its laboratory.

The likelihood here is the laboratory's own (true noise, closed form, scale solved for): what it
calls a better fit is one for any program.
"""

from __future__ import annotations

import math
import tempfile
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

import fitting as ff
from fitting.report.summary import by_line
from fitting.signal.student import ratio95
from fitting.text.arrays import FloatArray
from fitting.text.estimate import FittedEstimate
from fitting.text.finding import Kind
from tests.support.virtual.answers import ModesResponse
from tests.support.virtual.laboratory import Laboratory, Series, amplitude_v
from tests.support.virtual.modes import derived

DETERMINED, OPEN = "determined", "unconstrained"
#: Names of values that say the same of a sample whose eigenfrequencies are known.
TWINS = (("Q_plus", "width_plus"), ("Q_minus", "width_minus"))
#: A value counts as held by the data where Fisher's bound is below this share of it.
HELD = 0.03
#: Chi square by which a fit may be above the truth.
WORSE = 10.0
#: Kinds of findings by which data contradict the model, or each other.
CONTRADICTED = frozenset({Kind.not_described, Kind.contradiction, Kind.scale_contradicted})

#: Kinds of findings that name a mistake.
NAMED: Mapping[str, frozenset[Kind]] = {
    "rms": frozenset({Kind.scale_contradicted}),
    "factor 2": frozenset({Kind.scale_contradicted}),
    "20 log": frozenset({Kind.sweep_power}),
    "saturation": frozenset({Kind.sweep_saturated, Kind.sweep_clipped}),
    "background": frozenset({Kind.sweep_background, Kind.line_background}),
    "bad point": frozenset({Kind.sweep_outlier, Kind.sweep_point, Kind.outlier}),
    "mislabelled tones": frozenset({Kind.peaks_exchanged}),
    "second drive": frozenset({Kind.unknown_line}),
}
#: Kinds that name a mistake, which an honest laboratory has not made.
ALARM = frozenset(
    {
        Kind.sweep_power,
        Kind.sweep_saturated,
        Kind.sweep_clipped,
        Kind.sweep_outlier,
        Kind.sweep_point,
        Kind.sweep_background,
        Kind.peaks_exchanged,
        Kind.unknown_line,
    }
)


@dataclass(frozen=True)
class Statement:
    """What was stated of one value, and what is true.

    `conditional`: its status holds within the bounds of some parameters alone.
    """

    name: str
    verdict: str
    value: float
    std: float
    low: float
    high: float
    truth: float
    bound: float
    conditional: bool = False

    @property
    def holds(self) -> bool:
        """Whether the interval holds the truth."""
        margin = 1e-9 * max(abs(self.low), abs(self.high))
        return self.low - margin <= self.truth <= self.high + margin


@dataclass(frozen=True)
class Judged:
    """All statements on one laboratory as plain numbers: what a line of the record holds.

    Chi square of the laboratory's own likelihood at the truth, where the fit ended (`end`) and
    where the profiles have their lowest point (`best`), and after a local descent from these two
    (`fit`, `profile`).
    """

    kind: str
    seed: int
    fault: str
    honest: bool
    notes: Mapping[str, Any]
    status: str
    statements: Sequence[Mapping[str, Any]]
    wide: Mapping[str, str]
    warnings: Sequence[str]
    kinds: Sequence[str]
    chi2_truth: float
    chi2_end: float
    chi2_fit: float
    chi2_best: float
    chi2_profile: float
    chi2_rows: int
    seconds: float
    error: str = ""

    @property
    def said(self) -> list[Statement]:
        """The statements as records."""
        return [Statement(**s) for s in self.statements]


Solve = Callable[[Laboratory, Path], ff.Inference]


def by_closed_form(
    fmu: ff.Fmu, names: Sequence[str] | None = None, method: ff.Tikhonov | None = None
) -> Solve:
    """Fit and profile with the closed form in place of the FMU, whose variables are read alone.

    Args:
        fmu: whose place is taken.
        names: values that are profiled; None: all.
        method: of the fit; None: the campaign's own.
    """

    def solve(laboratory: Laboratory, folder: Path) -> ff.Inference:
        record = ff.Problem.of(laboratory.write(folder), fmu).record
        problem = ff.Problem.answered_by(lambda chosen: ModesResponse(record, chosen), record)
        return ff.profile(ff.fit(problem, method), names)

    return solve


def by_fmu(fmu: ff.Fmu) -> Solve:
    """Fit and profile through the FMU itself."""

    def solve(laboratory: Laboratory, folder: Path) -> ff.Inference:
        return ff.profile(ff.fit(ff.Problem.of(laboratory.write(folder), fmu)))

    return solve


def judged(laboratory: Laboratory, solve: Solve, *, widened: bool = True) -> Judged:
    """All statements on one laboratory; a fault of the program is a record, too."""
    begun = time.process_time()
    try:
        with tempfile.TemporaryDirectory() as folder:
            inference = solve(laboratory, Path(folder))
        seconds = time.process_time() - begun
        wide = {}
        if widened:
            with tempfile.TemporaryDirectory() as folder:
                again = solve(laboratory.widened(10.0), Path(folder))
            wide = {name: value.status for name, value in again.values.items()}
    except Exception as error:  # whatever it is, it is a finding
        return _failed(laboratory, error, time.process_time() - begun)
    return _compared(laboratory, inference, wide, seconds)


def _failed(laboratory: Laboratory, error: Exception, seconds: float) -> Judged:
    return Judged(
        kind=laboratory.kind,
        seed=laboratory.seed,
        fault=laboratory.fault,
        honest=laboratory.honest,
        notes=laboratory.notes,
        status="failed",
        statements=(),
        wide={},
        warnings=(),
        kinds=(),
        chi2_truth=math.nan,
        chi2_end=math.nan,
        chi2_fit=math.nan,
        chi2_best=math.nan,
        chi2_profile=math.nan,
        chi2_rows=0,
        seconds=seconds,
        error=f"{type(error).__name__}: {error} ({_place(error)})",
    )


def _place(error: Exception) -> str:
    """File, line and function where it was raised."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{Path(last.filename).name}:{last.lineno} {last.name}"


def _compared(
    laboratory: Laboratory, inference: ff.Inference, wide: Mapping[str, str], seconds: float
) -> Judged:
    fit = inference.fit
    reflection = bool(fit.record.alternative.get("reflection", False))
    truth = laboratory.truth(reflection)
    judge = Likelihood(laboratory)
    bounds = judge.bounds()
    statements = []
    for name, value in inference.values.items():
        if name not in truth:
            continue
        low, high = value.interval(0.95)
        true = _nearest(truth[name], 0.5 * (low + high)) if name == "theta" else truth[name]
        statements.append(
            Statement(
                name=name,
                verdict=value.status,
                value=value.value,
                std=value.std,
                low=low,
                high=high,
                truth=true,
                bound=bounds.get(name, math.nan),
                conditional=bool(value.active_bounds or (value.scan and value.scan.held)),
            ).__dict__
        )
    statements += [each.__dict__ for each in _of_lines(inference, truth)]
    names = fit.problem.names
    at_fit = judge.vector(dict(zip(names, map(float, fit.x), strict=True)), reflection)
    best = _best(inference)
    at_best = judge.vector(best, reflection) if best else at_fit
    return Judged(
        kind=laboratory.kind,
        seed=laboratory.seed,
        fault=laboratory.fault,
        honest=laboratory.honest,
        notes=laboratory.notes,
        status=fit.status,
        statements=statements,
        wide=wide,
        warnings=inference.warnings,
        # two lines that overlap would look the same: that is said, and no false alarm
        kinds=[f.kind for f in inference.findings if not f.numbers.get("two_lines")],
        chi2_truth=judge.chi_square(judge.true),
        chi2_end=judge.chi_square(at_fit),
        chi2_fit=judge.descended(at_fit),
        chi2_best=judge.chi_square(at_best),
        chi2_profile=judge.descended(at_best),
        chi2_rows=judge.rows(judge.true).size,
        seconds=seconds,
    )


def _of_lines(inference: ff.Inference, truth: Mapping[str, float]) -> list[Statement]:
    """What the answer says is best known by the line of the sweep alone: determined, then."""
    said = []
    record = inference.record
    for line in record.sweeps.lines.values():
        every: dict[str, FittedEstimate]
        every = {**record.parameters, **record.derived}
        for name, found in every.items():
            better = by_line(name, found, line)
            if better is not None and name in truth:
                value, std = better
                half = std * ratio95(line.dof)
                said.append(
                    Statement(
                        name=f"{name} by the line",
                        verdict=DETERMINED,
                        value=value,
                        std=std,
                        low=value - half,
                        high=value + half,
                        truth=truth[name],
                        bound=math.nan,
                    )
                )
    return said


def _nearest(theta: float, middle: float) -> float:
    """The equivalent angle next to the middle of an interval."""
    return theta + math.pi * round((middle - theta) / math.pi) if math.isfinite(middle) else theta


def _best(inference: ff.Inference) -> dict[str, float]:
    """Where the profiles have their lowest point, by parameter."""
    for value in inference.values.values():
        scan = value.scan
        if scan is not None and scan.values and scan.path:
            k = int(np.argmin(np.abs(np.array(scan.delta_chi2))))
            return {name: column[k] for name, column in scan.path.items()}
    return {}


@dataclass
class Likelihood:
    """The laboratory's own chi square over its unknowns (and drift offsets, told by the truth)."""

    laboratory: Laboratory
    names: tuple[str, ...] = field(init=False)
    true: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.names = tuple(u.name for u in self.laboratory.unknowns)
        self.true = np.array([self.laboratory.values[n] for n in self.names])

    def vector(self, found: Mapping[str, float], reflection: bool) -> FloatArray:
        """Values by name as a vector of the rotation form."""
        values = dict(found)
        if reflection:
            values["theta"] = 0.5 * math.pi - found["theta"]
            values["d1"], values["d2"] = found["d2"], found["d1"]
        return np.array([values[n] for n in self.names])

    def rows(self, x: FloatArray) -> FloatArray:
        """Whitened residuals of all series, the scale of each solved for."""
        moved = dict(zip(self.names, x, strict=True))
        return np.concatenate([self._series(series, moved) for series in self.laboratory.series])

    def _series(self, series: Series, moved: Mapping[str, float]) -> FloatArray:
        gain = self.laboratory.gain
        model, data, sigma = [], [], []
        for r in series.readings:
            # what is known of the sample in this reading (its drift) stays as it is
            model.append(r.levels * amplitude_v({**r.values, **moved}, r.tones_hz, r.output, gain))
            data.append(r.peaks_v)
            sigma.append(r.sigmas_v)
        swept = series.sweep
        if swept is not None:
            values = {**swept.values, **moved}
            model.append(amplitude_v(values, swept.frequency_hz, series.output, gain))
            data.append(swept.amplitude_v)
            sigma.append(np.full(swept.amplitude_v.size, swept.sigma_v))
        a, b = (np.concatenate(v) / np.concatenate(sigma) for v in (model, data))
        rows = b - a * (a @ b) / (a @ a)
        if swept is None or swept.use == "fit":
            return np.asarray(rows)
        return self._by_scale(model, data, sigma)

    def _by_scale(
        self, model: Sequence[FloatArray], data: Sequence[FloatArray], sigma: Sequence[FloatArray]
    ) -> FloatArray:
        """A sweep that gives the scale alone: one row, its least-squares scale over its error."""
        swept, points, error = model[-1], data[-1], sigma[-1][0]
        chi = float(swept @ points) / float(swept @ swept)
        std = error / math.sqrt(float(swept @ swept))
        a, b, s = (np.concatenate(v[:-1]) for v in (model, data, sigma))
        a, b = np.append(a / s, 1.0 / std), np.append(b / s, chi / std)
        return np.asarray(b - a * (a @ b) / (a @ a))

    def chi_square(self, x: FloatArray) -> float:
        """Sum of the squares of the rows."""
        return float(np.sum(self.rows(x) ** 2))

    def descended(self, x: FloatArray) -> float:
        """Chi square after a local descent from x, inside the boxes."""
        scale = np.array([u.scale for u in self.laboratory.unknowns])
        lower = np.array([u.lower if u.name != "theta" else -np.inf for u in self.unknowns]) / scale
        upper = np.array([u.upper if u.name != "theta" else np.inf for u in self.unknowns]) / scale
        begin = np.clip(x / scale, lower, upper)
        found = least_squares(
            lambda y: self.rows(y * scale), begin, bounds=(lower, upper), max_nfev=100
        )
        return min(self.chi_square(x), 2.0 * float(found.cost))

    @property
    def unknowns(self) -> Sequence[Any]:
        """The fitted parameters."""
        return self.laboratory.unknowns

    def bounds(self) -> dict[str, float]:
        """Cramér and Rao's bound on the standard deviation of every value, at the truth.

        Very large along directions that the data do not see.
        """
        scale = np.abs([u.scale for u in self.laboratory.unknowns])
        step = 1e-5 * scale
        eye = np.eye(self.true.size)
        jacobian = np.column_stack(
            [
                (self.rows(self.true + s * e) - self.rows(self.true - s * e)) / 2e-5
                for s, e in zip(step, eye, strict=True)
            ]
        )
        _, singular, right = np.linalg.svd(jacobian, full_matrices=True)
        weights = np.zeros(self.true.size)
        weights[: singular.size] = singular
        # below 1e-7 of the largest, weights and slopes are differences of rounding errors
        spread = 1.0 / np.maximum(weights, 1e-7 * max(float(np.max(weights)), 1e-300))
        found = {}
        for name, gradient in self._gradients(step, scale).items():
            found[name] = float(np.linalg.norm((right @ gradient) * spread))
        return found

    def _gradients(self, step: FloatArray, scale: FloatArray) -> dict[str, FloatArray]:
        """Change of every value per scale of each unknown."""
        eye = np.eye(self.true.size)
        found = {n: scale * e for n, e in zip(self.names, eye, strict=True)}
        for name in self.laboratory.derived:
            found[name] = np.array(
                [
                    (self._value(name, self.true + s * e) - self._value(name, self.true - s * e))
                    / 2e-5
                    for s, e in zip(step, eye, strict=True)
                ]
            )
        return found

    def _value(self, name: str, x: FloatArray) -> float:
        values = {**self.laboratory.values, **dict(zip(self.names, x, strict=True))}
        return float(derived(values)[name])


def fits(judged: Judged) -> bool:
    """Whether the data are not against the truth: chi square within 99.9 % of what noise makes."""
    return judged.chi2_truth < float(chi2.ppf(0.999, max(judged.chi2_rows, 1)))
