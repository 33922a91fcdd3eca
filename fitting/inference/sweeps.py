"""What the sweeps of a problem show: their lines, their faults, and the scale that peaks take.

The line of a sweep is fitted by itself, without the FMU; the fit of the model is compared with it.
Each sweep is fitted once (`LineFits`).
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fitting.campaign import SweepData
from fitting.campaign.instruments.recording import own_estimates
from fitting.campaign.parameters import to_search
from fitting.fit.fit import Solution
from fitting.fit.objective import evaluate_many
from fitting.fit.outputs import output_means
from fitting.fit.problem import Problem
from fitting.inference.agreement import SweepAgreement, explained_by_model, sweep_agreement
from fitting.lines.choice import chance
from fitting.lines.decay import Decays, fit_decays
from fitting.lines.faults import Fault, fault_finding, sweep_faults
from fitting.lines.form import LineFit, fit_resonance
from fitting.lines.names import ADDED, FLOOR, OFFSET, RICE, SLOPE
from fitting.lines.record import (
    LineNumber,
    LineResult,
    LineValues,
    TriedForm,
    fields_of,
    no_line,
    number_of_line,
)
from fitting.lines.solve import Fit
from fitting.lines.trace import SAMPLES
from fitting.measurements.measurement import Values
from fitting.measurements.sweep import Sweep
from fitting.measurements.traces import Trace
from fitting.signal.residual_tests import SMALLEST_RESIDUAL, Structure, residual_structure
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, FmuFailure, NoScale
from fitting.text.estimate import FittedEstimate
from fitting.text.finding import Finding, Kind, warning
from fitting.text.rendering import phrase
from fitting.text.units import convert

#: Backgrounds of one line of amplitudes that are compared with a model.
TRIED = ("complex", OFFSET, SLOPE, FLOOR, RICE)
#: Samples of a decay that are fitted, at most, the first ones.
MOST_SAMPLES = 20_000


class LineFits:
    """Fits of one line to amplitudes, remembered by their data and background."""

    def __init__(self) -> None:
        self._known: dict[tuple[bytes, bytes, str], LineFit | str] = {}

    def line(
        self,
        frequency_hz: FloatArray,
        amplitude: FloatArray,
        background: str = "none",
        source: str = "sweep",
    ) -> LineFit | str:
        """One line with a background, or why there is none.

        Args:
            frequency_hz: rising, shape (n,), Hz.
            amplitude: shape (n,), any unit.
            background: one of `fitting.lines.names.FORM_OF`.
            source: of the data, for the reason.
        """
        key = (frequency_hz.tobytes(), amplitude.tobytes(), background)
        if key not in self._known:
            try:
                line = fit_resonance(frequency_hz, amplitude, background=background, source=source)
            except BadInput as error:
                self._known[key] = str(error)
            else:
                self._known[key] = line
        return self._known[key]

    def with_backgrounds(
        self, frequency_hz: FloatArray, amplitude: FloatArray
    ) -> dict[str, LineFit]:
        """Every form of one line with a background that can be fitted, by background.

        Args:
            frequency_hz: rising, shape (n,), Hz.
            amplitude: shape (n,), any unit.
        """
        fits = {name: self.line(frequency_hz, amplitude, name) for name in TRIED}
        return {name: fit for name, fit in fits.items() if not isinstance(fit, str)}


def decaying_lines(trace: Trace, count: int) -> tuple[Fit, tuple[float, ...], Structure]:
    """Decaying lines of a free decay's first samples, over the largest one, fitted.

    Args:
        trace: the free decay.
        count: of lines.

    Returns:
        The fit, the lines' frequencies (Hz, rising), and the structure of its residuals.

    Raises:
        ValueError: one that hardly oscillates.
    """
    values = np.asarray(trace.y[:MOST_SAMPLES] / trace.largest)
    model = Decays(samples=values.size, kind=SAMPLES, lines=count, constant=trace.offset)
    fit = fit_decays(model, values)
    turns = np.sort(np.abs(fit.x[::2]))
    frequencies_hz = tuple(float(f) for f in turns / (values.size * trace.spacing_s))
    return fit, frequencies_hz, residual_structure(fit.residuals, fit.jacobian[:, model.count :])


# --- the line of a sweep --------------------------------------------------------------------------

#: Probability that noise alone gains as much, below which a background counts as observed.
BACKGROUND_P = 1e-3
#: Two fits disagree from this many standard errors of their difference.
APART_SIGMA = 3.0
#: Residual of one line over that of the model, from which the sweep shows no single line.
FAR_MORE = 2.0
#: Factor on the errors from which it is worth a warning.
WORTH_TELLING = 1.5
#: A value is the line's where both agree to this share: of the width, or of the quality.
NEAR = 1e-3
#: Other places where both have to agree: positive parameters times these factors, the next one over
#: it, and others by such a part of their scale.
ELSEWHERE = ((1.1, 0.3), (1.0 / 1.3, -0.5), (1.2, 1.0))


@dataclass(frozen=True, kw_only=True)
class SweepLine(LineResult):
    """One damped mode fitted to the sweep itself, without the FMU; NaN where there is none.

    ``forms``: without and with a complex background, and with an offset or slope if the campaign
    has it or it fits better.

    Attributes:
        amplitude: peak, in ``unit``, at the eigenfrequency.
        background: the campaign's, with which the line was fitted.
        message: why there is no line, or how the fit ended.
        notes: head of the file.
        background_p: p-value of the last form (F-test); NaN: none.
        values: names of fitted values that are "frequency", "width" or "q" of this line.
        mirrored: the other amplitude that fits as well, with a complex background; else None.
    """

    amplitude: LineNumber
    background: str
    message: str
    notes: Mapping[str, str]
    background_p: float = math.nan
    values: Mapping[str, str] = field(default_factory=dict)
    mirrored: LineNumber | None = None


def line_of_sweep(
    sweep: SweepData, left: float = math.nan, fits: LineFits | None = None
) -> SweepLine:
    """One damped mode fitted to a sweep, with the background that the campaign declares.

    Fits with other backgrounds show what depends on that choice. A sweep that shows no such line is
    no mistake here (another FMU may have two): every number is then NaN and the message gives the
    reason. See `fitting.lines.form.fit_resonance` for the formula.

    Args:
        sweep: the measured sweep.
        left: root mean square over the largest amplitude that a fitted model leaves of it, if that
            is noise; where one line leaves far more, the sweep shows no single one.
        fits: of lines, to be shared.
    """
    lines, (frequency_hz, amplitude) = fits or LineFits(), sweep.of_line
    # fits by background, and what they leave, in the sweep's unit; without a fit all of it
    every, remains = dict[str, LineFit | str](), dict[str, float]()
    for background in ("none", "complex", OFFSET, SLOPE):
        each = lines.line(frequency_hz, amplitude, background, sweep.source.name)
        every[background], remains[background] = each, math.inf
        if not isinstance(each, str):
            remains[background] = each.rms_residual * each.amplitude.value
    forms = {background: every[background] for background in ("none", "complex")}
    if sweep.background == OFFSET or remains[OFFSET] < remains["complex"]:
        forms[OFFSET] = every[OFFSET]
    gains = background_p(every[OFFSET], every[SLOPE]) < BACKGROUND_P
    if sweep.background == SLOPE or (gains and remains[SLOPE] < remains["complex"]):
        forms[SLOPE] = every[SLOPE]

    fit = forms[sweep.background]
    if not isinstance(fit, str) and not math.isnan(left) and fit.structure.order > 0:
        own = remains[sweep.background] / float(np.max(amplitude))
        if own > FAR_MORE * max(left, SMALLEST_RESIDUAL):
            fit = phrase("status", "no_single_line", own, left)
    notes = dict(sweep.notes or {})
    shared: dict[str, Any] = {
        "source": sweep.source.name,
        "unit": sweep.unit,
        "background": sweep.background,
        "instrument": own_estimates(notes),
        "notes": notes,
        "forms": tuple(
            TriedForm(**no_line(), name=background, message=each)
            if isinstance(each, str)
            else TriedForm(
                **fields_of(each, LineValues),
                name=background,
                rms_residual=each.rms_residual,
                structure=each.structure,
                message=each.message,
            )
            for background, each in forms.items()
        ),
    }
    if isinstance(fit, str):
        none = number_of_line("amplitude", math.nan, unit=sweep.unit)
        return SweepLine(**no_line(), **shared, amplitude=none, message=fit)
    return SweepLine(
        **fields_of(fit, LineValues),
        **shared,
        amplitude=replace(fit.amplitude, unit=sweep.unit),
        rms_residual=fit.rms_residual,
        message=fit.message,
        dof=fit.dof,
        structure=fit.structure,
        mirrored=None if fit.mirrored is None else replace(fit.mirrored, unit=sweep.unit),
        background_p=background_p(forms["none"], list(forms.values())[-1]),
    )


def background_p(plain: LineFit | str, full: LineFit | str) -> float:
    """Probability that noise alone lets a background gain this much; NaN if it is not known.

    Args:
        plain: line without a background, or with a simpler one.
        full: line with it.
    """
    if isinstance(plain, str) or isinstance(full, str) or plain.rms_residual < SMALLEST_RESIDUAL:
        return math.nan
    rows = full.curve.size
    return chance(plain.squares, plain.unknowns, full.squares, full.unknowns, full.structure, rows)


#: By which a campaign states the background of its sweep.
BACKGROUND_KEY = ("[sweep] background",)


def line_findings(line: SweepLine, *, fitted: bool) -> Iterator[Finding]:
    """Residuals of the line that are no noise, and a background that changes it.

    Args:
        line: of the sweep by itself.
        fitted: whether the FMU is fitted to this sweep; its structure is then reported with the
            parameters and not here.
    """
    chosen = next((form for form in line.forms if form.name == line.background), None)
    if chosen is not None and chosen.structure.widening > WORTH_TELLING and not fitted:
        structure = chosen.structure
        numbers = {"widening": structure.widening, "points": structure.points}
        names = {"tests": (structure.departure,), "keys": BACKGROUND_KEY}
        yield warning(Kind.line_residuals, "sweep", names, **numbers)
    if not depends_on_background(line):
        return
    plain, full = line.forms[0], line.forms[-1]
    numbers = {}
    for part, form in (("plain_", plain), ("full_", full)):
        numbers |= {
            f"{part}frequency_hz": form.frequency.value,
            f"{part}frequency_std_hz": form.frequency.std,
            f"{part}width_hz": form.width.value,
            f"{part}width_std_hz": form.width.std,
            f"{part}q": form.q.value,
            f"{part}q_std": form.q.std,
            f"{part}residual": form.rms_residual,
        }
    yield warning(
        Kind.line_background,
        "sweep",
        {
            "background": (full.name,),
            "key": (full.name,) if full.name in ADDED else (),
            "keys": BACKGROUND_KEY,
        },
        shift_hz=full.frequency.value - plain.frequency.value,
        sigmas=_apart(plain.frequency, full.frequency),
        width_sigmas=_apart(plain.width, full.width),
        p_value=line.background_p,
        fitted=float(fitted),
        **numbers,
    )


def depends_on_background(line: SweepLine) -> bool:
    """Whether the fits without and with a background differ clearly, in values or residuals.

    Args:
        line: of the sweep by itself.
    """
    if line.background in ADDED or math.isnan(line.background_p):
        return False
    plain, full = line.forms[0], line.forms[-1]
    apart = max(_apart(plain.width, full.width), _apart(plain.frequency, full.frequency))
    return apart > APART_SIGMA or line.background_p < BACKGROUND_P


def _apart(one: LineNumber, other: LineNumber) -> float:
    """Difference of two numbers over its standard error."""
    return abs(other.value - one.value) / math.hypot(one.std, other.std)


# --- values of the fit that are the line's --------------------------------------------------------


def values_of_line(
    problem: Problem, solution: Solution, values: Mapping[str, FittedEstimate], fits: LineFits
) -> dict[str, str]:
    """Names of values that are the line's "frequency", "width" or "q".

    The line is fitted to the sweep *as simulated*, at the end of Algorithm 2 and at some places
    elsewhere: a value that the line has at all of them is this line's, whatever its name. At one
    place it might be another's by chance, as the dampings of two modes that start alike. Empty
    where the sweep is fitted with the rest (its information is in the values), or where there is
    none, or no line in it.

    Args:
        problem: with its sweep.
        solution: end of the fit.
        values: parameters and outputs, by name.
        fits: of lines, to be shared.
    """
    sweep = problem.sweep
    if problem.is_joint or sweep is None:
        return {}
    [k] = [k for k, m in enumerate(problem.measurements) if isinstance(m, Sweep)]
    if problem.measurements[k].rows:
        return {}
    units = {name: value.unit for name, value in values.items()}
    frequency_hz = sweep.frequency_hz

    def same(there: Mapping[str, float], simulated: Values) -> dict[str, str]:
        """Which values are something that the line of a simulated sweep has, and what."""
        own = fits.line(frequency_hz, np.abs(simulated))
        if isinstance(own, str):
            return {}
        width, q, same_as = own.width.value, own.q.value, dict[str, str]()
        for name, value in there.items():
            in_hertz = _in(value, units[name], "Hz")
            if abs(in_hertz - own.frequency.value) < NEAR * width:
                same_as[name] = "frequency"
            if abs(in_hertz - width) < NEAR * width:
                same_as[name] = "width"
            if abs(_in(value, units[name], "") - q) < NEAR * q:
                same_as[name] = "q"
        return same_as

    here = {name: value.most_likely for name, value in values.items()}
    names = same(here, solution.final.scaled[k])
    if not names:
        return {}
    # a frequency that leaves the swept range would take its line with it
    low, high = float(np.min(frequency_hz)), float(np.max(frequency_hz))
    fixed = {n for n, value in here.items() if low <= _in(value, units[n], "Hz") <= high}
    xs = [_elsewhere(solution, fixed, factor, turn) for factor, turn in ELSEWHERE]
    try:
        points = evaluate_many(solution.objective, xs, whole=True)
        means = output_means(solution.objective.response, solution.parameters, xs)
    except (FmuFailure, NoScale):
        return {}
    own = [p.name for p in solution.parameters]
    table = np.column_stack([np.array([point.parameters for point in points]), *means.values()])
    for row, point in zip(table.tolist(), points, strict=True):
        there = dict(zip((*own, *means), row, strict=True))
        still = same({name: there[name] for name in names}, point.scaled[k])
        names = {name: what for name, what in names.items() if still.get(name) == what}
    return names


def _elsewhere(solution: Solution, fixed: Container[str], factor: float, turn: float) -> FloatArray:
    """The end of Algorithm 2 moved within its bounds, (n,): all but what is known or `fixed`."""
    parameters, p = solution.parameters, solution.final.parameters.copy()
    for i, parameter in enumerate(parameters):
        if parameter.prior_sigma is not None or parameter.experiments or parameter.name in fixed:
            continue
        here, low, high = float(p[i]), parameter.lower, parameter.upper
        positive = low >= 0.0 and parameter.period is None and not parameter.is_angle
        step = turn * parameter.scale
        ways = (here * factor, here / factor) if positive else (here + step, here - step)
        inside = [way for way in ways if low <= way <= high]
        p[i] = inside[0] if inside else min(max(ways[0], low), high)
        if positive:  # the next one moves the other way
            factor = here / float(p[i]) if p[i] != here else 1.0 / factor
    return to_search(parameters, p)


def _in(value: float, unit: str, wanted: str) -> float:
    """A value in hertz, or as the number that it is; NaN where it is neither."""
    if not wanted:
        return value if unit in ("", "1") else math.nan
    try:
        return convert(value, unit, wanted, where="")
    except BadInput:
        return math.nan


# --- all sweeps of a problem ----------------------------------------------------------------------

#: Faults that make the top of a sweep too low or too high.
BENT_TOPS = (Fault.SATURATION, Fault.CLIPPING, Fault.BACKGROUND)
#: Share of a top that is missing, at most.
MOST_MISSING = 0.9


@dataclass(frozen=True, kw_only=True)
class SweepFindings:
    """What the sweeps of a problem show: each by itself, and with the peaks of its series.

    `lines` are by series, `faults` what makes a sweep no line; `doubts` how far the scale that
    peaks take from such a sweep may be off, |ln| of its factor, by series; `agreement` with the
    peaks, a series each, none where a sweep itself is at fault; `fits` all fits of lines.
    """

    lines: Mapping[str, SweepLine] = field(default_factory=dict)
    faults: tuple[Finding, ...] = ()
    doubts: Mapping[str, float] = field(default_factory=dict)
    agreement: tuple[SweepAgreement, ...] = ()
    fits: LineFits = field(default_factory=LineFits)

    @property
    def scale_off(self) -> float:
        """Factor by which a scale of peaks may be off, at most; NaN where none is in doubt."""
        return math.exp(max(self.doubts.values())) if self.doubts else math.nan


def sweep_findings(problem: Problem, solution: Solution) -> SweepFindings:
    """Lines and faults of all sweeps.

    Args:
        problem: with its sweeps.
        solution: end of the fit.
    """
    fits = LineFits()
    sweeps = {n: b.sweep for n, b in problem.campaigns.items() if b.sweep is not None}
    # root mean square, over the largest, of what a model leaves of fitted sweeps if that is noise:
    # it then has the shape of the sweep, one line or not
    explained = {}
    if solution.structure is not None and solution.structure.order == 0:
        pairs = zip(problem.measurements, solution.objective.data.slices, strict=True)
        explained = {
            m.series: float(np.sqrt(np.mean(solution.final.residuals[rows] ** 2)))
            for m, rows in pairs
            if isinstance(m, Sweep) and m.fitted
        }
    points = [
        warning(
            Kind.sweep_point,
            name,
            {"unit": (sweep.unit,)},
            frequency_hz=float(sweep.frequency_hz[k]),
            amplitude=float(sweep.amplitude_v[k]),
            expected=expected,
        )
        for name, sweep in sweeps.items()
        for k, expected in sweep.far_off
    ]
    faults, doubts = [], {}
    for name, sweep in sweeps.items():
        if sweep.background != "none" or name in explained:
            continue
        gives_scale = sweep.scale not in ("none", "free") and bool(
            problem.campaigns[name].experiments
        )
        here, off = sweep_faults(*sweep.of_line), list[float]()
        like_lines = [
            fault
            for fault in here
            if fault.fault is Fault.BACKGROUND
            or (fault.fault is Fault.SATURATION and fault.two_lines)
        ]
        # a model of several lines has the shape of these
        explained_away = like_lines if like_lines and explained_by_model(solution, name) else []
        for fault in here:
            if fault in explained_away:
                continue
            bent = fault.fault in BENT_TOPS and gives_scale
            faults.append(fault_finding(fault, name, gives_scale=bent))
            if bent:  # the law of a saturated top is not known
                missing = min(abs(fault.size) + 2.0 * fault.std, MOST_MISSING)
                factor = 2.0 if fault.fault is Fault.SATURATION else 1.0
                off.append(-factor * math.log1p(-missing))
        if off:
            doubts[name] = max(off)
    return SweepFindings(
        lines={n: line_of_sweep(s, explained.get(n, math.nan), fits) for n, s in sweeps.items()},
        faults=(*points, *faults),
        doubts=doubts,
        # a sweep that is no line contradicts the peaks for that reason
        agreement=() if points or faults else sweep_agreement(solution),
        fits=fits,
    )
