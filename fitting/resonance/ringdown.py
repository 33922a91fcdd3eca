"""One resonance of a ringdown: frequency, width, quality and decay time, without any FMU.

A mode that is left alone falls as e^(-pi w t), w its full width at half of the power:

    decay time of the amplitude  tau = 1/(pi w),    Q = f/w,    f^2 = f_r^2 + (w/2)^2

f_r is the frequency at which it rings, f its eigenfrequency, as of sweeps.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.measurements.traces.grid import refuse_clipped
from fitting.resonance.decay_begin import begin_of
from fitting.resonance.decay_fit import (
    ALONE,
    CONSTANT,
    FORM_WORDS,
    MOVING,
    NOISE,
    SECOND,
    FittedDecay,
    fit_amplitudes,
    fit_lines,
    gain_chance,
    least_chance,
)
from fitting.resonance.decay_record import AMPLITUDES, PHASORS, SAMPLES, DecayRecord
from fitting.resonance.reading import TIME_WAY
from fitting.signal.residual_tests import SMALLEST_RESIDUAL, STRUCTURED
from fitting.signal.student import ratio95
from fitting.text.errors import BadInput
from fitting.text.notation import number, quantity

__all__ = [
    "ALONE",
    "CONSTANT",
    "FORM_WORDS",
    "MOVING",
    "NOISE",
    "SECOND",
    "Ringdown",
    "ringdown_of",
]

#: A decay is there if noise alone were to look like one less often than this.
SEEN_P = 1e-3
#: Probability below which chance does not explain what a further line or a moving one gains.
IMPROBABLE = 1e-4
#: Samples up to which a further line is looked for where residuals seem noise.
MOST = 200_000
#: Share of the largest value below zero from which a record swings, as amplitudes do not.
SWINGS = 0.3
#: Standard errors, and decays of the amplitude over the record, that a line needs to decay.
DECAYS_SIGMA, DECAYS = 2.0, 0.02
#: Akaike's criterion by which a form that was not expected has to be better, and below which noise
#: alone may make one of two the better one.
PLAINLY, ALLOWED = 10.0, 4.0


@dataclass(frozen=True, kw_only=True)
class DecayingLine:
    """A further line of a ringdown, fitted beside the first one.

    Attributes:
        frequency_hz: eigenfrequency, Hz, and its error; NaN where the record does not tell it.
        offset_hz: from the frequency of the demodulator, Hz, and its error; NaN for samples.
        width_hz: full width at half of the power, Hz, and its error.
        q: their ratio, and its error.
        decay_time_s: in which the amplitude falls to 1/e, s, and its error.
        share: its amplitude over that of the first one, at the first sample.
        decays: whether it is seen to decay; else it is a tone that stays.
    """

    frequency_hz: float
    frequency_std_hz: float
    offset_hz: float
    offset_std_hz: float
    width_hz: float
    width_std_hz: float
    q: float
    q_std: float
    decay_time_s: float
    decay_time_std_s: float
    share: float
    decays: bool


@dataclass(frozen=True, kw_only=True)
class DecayForm:
    """A form of the decay and what it gives, NaN where the record does not tell it.

    Attributes:
        name: "alone", "constant", "second", "moving"; of amplitudes "noise" or "constant".
        residual: root mean square of what is left, over the amplitude at the first sample.
        criterion: Akaike's, over the least of all forms; 10 is plainly worse.
    """

    name: str
    frequency_hz: float
    frequency_std_hz: float
    offset_hz: float
    offset_std_hz: float
    width_hz: float
    width_std_hz: float
    q: float
    q_std: float
    residual: float
    criterion: float


@dataclass(frozen=True, kw_only=True)
class DecayPoints:
    """What was recorded and what was fitted, (n,) each; imaginary parts empty without phases."""

    time_s: tuple[float, ...]
    measured: tuple[float, ...]
    fitted: tuple[float, ...]
    measured_imaginary: tuple[float, ...] = ()
    fitted_imaginary: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Ringdown:
    """One resonance of a ringdown.

    Errors (``_std``) are half of the interval that holds the truth in 68 of 100 such records, the
    others (``_ci95``) in 95. Both are Student's, as the noise is known from the residuals alone.

    Attributes:
        source: the file, or "arrays".
        kind: "samples" of the motion, "phasors" of a demodulator, or "amplitudes".
        frequency_hz: eigenfrequency, Hz; NaN where the record does not tell it: demodulated, and
            nobody told at what, or amplitudes alone.
        offset_hz: of phasors, from what was demodulated at, Hz, and its error; else NaN.
        width_hz: full width at half of the power, Hz.
        q: their ratio; of amplitudes with the frequency that was demodulated at, where it is told.
        decay_time_s: in which the amplitude falls to 1/e, s.
        amplitude: of the line at its first sample, in ``unit``.
        shift_hz: how far the frequency is moved at the first sample, by the square of the
            amplitude, Hz, and its error; zero where that is not seen.
        reference_hz: what was demodulated at, Hz; NaN: nobody told.
        form: the form that was taken, see ``forms``.
        forms: every form that was tried, the one that was taken first.
        rival: another form of amplitudes that describes the samples nearly as well, for which the
            errors hold, too; mostly empty.
        second: a further line that was fitted beside it; None without.
        beside: the constant, its modulus if phases were recorded, in ``unit``; of "noise" the noise
            of X, and of Y; and its error.
        begin_s: time of the first sample that is used, s.
        left_out: samples before it: of a drive or a blow.
        spacing_s: between two samples, s.
        residual: root mean square of what is left, over ``amplitude``.
        describes: whether what is left is noise, by all tests.
        freedom: degrees of freedom of the noise.
        independent_samples: how many independent and equal samples the samples are worth.
        widening: factor on the errors for residuals that are no noise of one size; else 1.
        structure_p: probability that white noise leaves such residuals.
        sizes_p: probability that noise of one size leaves such residuals.
        said: how the file was read, in sentences.
        points: what was recorded and fitted.
    """

    source: str
    kind: str
    frequency_hz: float
    frequency_std_hz: float
    frequency_ci95_hz: tuple[float, float]
    offset_hz: float
    offset_std_hz: float
    width_hz: float
    width_std_hz: float
    width_ci95_hz: tuple[float, float]
    q: float
    q_std: float
    q_ci95: tuple[float, float]
    decay_time_s: float
    decay_time_std_s: float
    decay_time_ci95_s: tuple[float, float]
    amplitude: float
    amplitude_std: float
    shift_hz: float
    shift_std_hz: float
    unit: str
    reference_hz: float
    form: str
    forms: tuple[DecayForm, ...]
    rival: str
    second: DecayingLine | None
    beside: float
    beside_std: float
    begin_s: float
    left_out: int
    spacing_s: float
    residual: float
    describes: bool
    freedom: float
    independent_samples: float
    widening: float
    structure_p: float
    sizes_p: float
    said: tuple[str, ...]
    points: DecayPoints = field(repr=False)

    @property
    def is_complex(self) -> bool:
        """Whether phases were recorded."""
        return bool(self.points.measured_imaginary)


def ringdown_of(record: DecayRecord) -> Ringdown:
    """The resonance of a free decay.

    Args:
        record: what was recorded.

    Raises:
        BadInput: no free decay, one that is cut off above, or one of which too little is recorded.
    """
    if not np.any(record.values):
        raise BadInput(f"{record.source}: holds nothing but zeros, wanted a ringdown")
    told, record = record.kind, replace(record, kind=record.kind or _seen_kind(record))
    first = begin_of(record)
    used, forms = _fitted(record, first, known=bool(told))
    if len(forms[0].width_hz) > 1:  # lines that beat look like a begin, to one line
        earlier = begin_of(record, len(forms[0].width_hz))
        if earlier < first:
            first = earlier
            used, forms = _fitted(record, first, known=bool(told))
    return _told(used, forms, first)


def _fitted(
    record: DecayRecord, first: int, *, known: bool
) -> tuple[DecayRecord, list[FittedDecay]]:
    """The record from its first sample that is used on, and every form of it."""
    used = record.part(first, record.values.size)
    for part in (used.values.real, used.values.imag) if used.is_complex else (used.values,):
        refuse_clipped(np.asarray(part.real), used.source)
    if record.kind == AMPLITUDES:
        return used, _of_amplitudes(used, known=known)
    return used, _of_lines(used)


def _seen_kind(record: DecayRecord) -> str:
    """Samples or amplitudes: which of both a decay follows closer."""
    if np.min(record.values.real) < -SWINGS * record.top:
        return SAMPLES
    try:
        line = fit_lines(record, CONSTANT)
    except ValueError:
        return AMPLITUDES
    return SAMPLES if line.squares < fit_amplitudes(record, CONSTANT).squares else AMPLITUDES


def _of_amplitudes(record: DecayRecord, *, known: bool) -> list[FittedDecay]:
    """Forms of amplitudes: in Rice's noise where they are known to be such, else the closer one."""
    constant = fit_amplitudes(record, CONSTANT)
    if np.any(record.values.real < 0.0):
        return [constant]
    noise = fit_amplitudes(record, NOISE)
    there, here = _criteria([constant, noise])
    if known:
        return [constant, noise] if here - there > PLAINLY else [noise, constant]
    first, other = (noise, constant) if here <= there else (constant, noise)
    if abs(here - there) < ALLOWED:
        first = _covering(first, other)
    return [first, other]


def _covering(form: FittedDecay, rival: FittedDecay) -> FittedDecay:
    """A form with errors that hold for another one, too, which the samples do not tell from it.

    Source: `fitting.resonance.rival_forms`, of sweeps.
    """
    here, there = (np.array([*f.frequency_hz, *f.width_hz, *f.amplitude]) for f in (form, rival))
    wider = rival.errors + np.abs(there - here) / ratio95(form.freedom)
    return replace(form, errors=np.fmax(form.errors, wider), rival=rival.name)


def _of_lines(record: DecayRecord) -> list[FittedDecay]:
    """Forms of samples or phasors."""
    try:
        one = fit_lines(record, CONSTANT)
    except ValueError as error:
        raise _no_decay(record) from error
    found, closer = [one], []
    seen = one.squares > one.rows * SMALLEST_RESIDUAL**2
    structured = not _is_noise(one)
    if seen and (structured or record.values.size <= MOST):
        closer = _fits(record, one, (SECOND, MOVING) if structured else (SECOND,))
        closer = [form for form in closer if gain_chance(one, form) < IMPROBABLE]
    found += [*closer, *_fits(record, one, (ALONE,))]
    if not closer:
        return found
    criteria = _criteria(found)
    best = min(range(1, 1 + len(closer)), key=lambda k: criteria[k])
    return [found[best], *(form for k, form in enumerate(found) if k != best)]


def _fits(record: DecayRecord, one: FittedDecay, names: Sequence[str]) -> list[FittedDecay]:
    """Those of some forms that can be fitted, from one line with a constant."""
    found = []
    for name in names:
        with contextlib.suppress(ValueError):
            found.append(fit_lines(record, name, one))
    return found


def _criteria(forms: Sequence[FittedDecay]) -> list[float]:
    """Akaike's criterion of every form, samples that hang together counted as they are worth."""
    rows = forms[0].rows
    closest = min(forms, key=lambda form: form.squares)
    count = 1.0 / closest.structure.widening**2
    made = []
    for form in forms:
        squares = max(form.squares, rows * SMALLEST_RESIDUAL**2)
        likely = rows * math.log(squares / rows) + form.likely
        made.append(count * likely + 2.0 * form.unknowns)
    return made


def _is_noise(form: FittedDecay) -> bool:
    """Whether what a form leaves is noise, by all tests."""
    return min(form.structure.p_value, form.structure.sizes_p) >= STRUCTURED


def _no_decay(record: DecayRecord) -> BadInput:
    return BadInput(
        f"{record.source}: is a recording over time without a free decay: a constant describes its "
        f"samples as well; wanted a ringdown, or {TIME_WAY}"
    )


def _too_short(record: DecayRecord, line: _Numbers) -> BadInput:
    span_s = number(record.spacing_s * record.values.size, 3)
    what = f"does not fall within its {span_s} s"
    if line.width_std_hz < line.width_hz:
        width = quantity(line.width_hz, line.width_std_hz, "Hz")
        what = f"falls too little within its {span_s} s to tell how fast: its width is {width}"
    return BadInput(f"{record.source}: {what}; wanted a longer record of a free decay")


def _told(record: DecayRecord, forms: Sequence[FittedDecay], first: int) -> Ringdown:
    best = forms[0]
    if least_chance(record, best) > SEEN_P:
        raise _no_decay(record)
    lines = [_Numbers.of(record, best, k) for k in range(len(best.width_hz))]
    lines.sort(key=lambda line: not line.decays)
    line = lines[0]
    if not line.decays:
        raise _too_short(record, line)
    half = ratio95(best.freedom)
    width_ci95 = _interval(line.width_hz, line.width_std_hz, half)
    slow, fast = (max(end, 1e-300) for end in width_ci95)
    criteria = _criteria(forms)
    rms = math.sqrt(best.squares / best.curve.size) * record.top
    frequency_ci95 = _interval(line.frequency_hz, line.frequency_std_hz, half)
    return Ringdown(
        source=record.source,
        kind=record.kind,
        frequency_hz=line.frequency_hz,
        frequency_std_hz=line.frequency_std_hz,
        frequency_ci95_hz=frequency_ci95,
        offset_hz=line.offset_hz,
        offset_std_hz=line.offset_std_hz,
        width_hz=line.width_hz,
        width_std_hz=line.width_std_hz,
        width_ci95_hz=width_ci95,
        q=line.q,
        q_std=line.q_std,
        q_ci95=(line.q * line.width_hz / fast, line.q * line.width_hz / slow),
        decay_time_s=line.decay_time_s,
        decay_time_std_s=line.decay_time_std_s,
        decay_time_ci95_s=(1.0 / (math.pi * fast), 1.0 / (math.pi * slow)),
        amplitude=line.amplitude,
        amplitude_std=line.amplitude_std,
        shift_hz=best.shift_hz,
        shift_std_hz=best.shift_std_hz,
        unit=record.unit,
        reference_hz=record.reference_hz,
        form=best.name,
        forms=tuple(
            _form(record, form, criterion - min(criteria))
            for form, criterion in zip(forms, criteria, strict=True)
        ),
        rival=best.rival,
        second=_second(lines) if len(lines) > 1 else None,
        beside=best.beside.real if record.kind != PHASORS else abs(best.beside),
        beside_std=best.beside_std,
        begin_s=float(record.time_s[0]),
        left_out=first,
        spacing_s=record.spacing_s,
        residual=rms / line.amplitude,
        describes=_is_noise(best),
        freedom=best.freedom,
        independent_samples=best.structure.points / (2.0 if record.is_complex else 1.0),
        widening=best.structure.widening,
        structure_p=best.structure.p_value,
        sizes_p=best.structure.sizes_p,
        said=record.said,
        points=_points(record, best),
    )


@dataclass(frozen=True, kw_only=True)
class _Numbers:
    """One line of a form: its numbers with their errors; NaN: the record does not tell them."""

    frequency_hz: float
    frequency_std_hz: float
    offset_hz: float
    offset_std_hz: float
    width_hz: float
    width_std_hz: float
    amplitude: float
    amplitude_std: float
    rings_hz: float
    decays: bool

    @classmethod
    def of(cls, record: DecayRecord, form: FittedDecay, k: int) -> _Numbers:
        """Numbers of the k-th line."""
        count = len(form.width_hz)
        seen, seen_std = form.frequency_hz[k], float(form.errors[k])
        width, width_std = form.width_hz[k], float(form.errors[count + k])
        offset, offset_std = math.nan, math.nan
        if record.kind == PHASORS:
            offset, offset_std = seen, seen_std
            seen += record.reference_hz
        eigen = math.hypot(seen, 0.5 * width)
        span_s = record.spacing_s * record.values.size
        return cls(
            frequency_hz=eigen,
            frequency_std_hz=math.hypot(seen * seen_std, 0.25 * width * width_std) / eigen
            if eigen > 0.0
            else seen_std,
            offset_hz=offset,
            offset_std_hz=offset_std,
            width_hz=width,
            width_std_hz=width_std,
            amplitude=form.amplitude[k],
            amplitude_std=float(form.errors[2 * count + k]),
            rings_hz=record.reference_hz if record.kind == AMPLITUDES else eigen,
            decays=width > DECAYS_SIGMA * width_std and math.pi * width * span_s > DECAYS,
        )

    @property
    def q(self) -> float:
        """Frequency over width."""
        return self.rings_hz / self.width_hz

    @property
    def q_std(self) -> float:
        """Its error; that of the width but for low quality."""
        share = self.frequency_std_hz / self.frequency_hz if self.frequency_hz > 0.0 else 0.0
        return self.q * math.hypot(self.width_std_hz / self.width_hz, share)

    @property
    def decay_time_s(self) -> float:
        """In which the amplitude falls to 1/e, s."""
        return 1.0 / (math.pi * self.width_hz)

    @property
    def decay_time_std_s(self) -> float:
        """Its error, s."""
        return self.decay_time_s * self.width_std_hz / self.width_hz


def _second(lines: Sequence[_Numbers]) -> DecayingLine:
    first, line = lines[:2]
    return DecayingLine(
        frequency_hz=line.frequency_hz,
        frequency_std_hz=line.frequency_std_hz,
        offset_hz=line.offset_hz,
        offset_std_hz=line.offset_std_hz,
        width_hz=line.width_hz,
        width_std_hz=line.width_std_hz,
        q=line.q,
        q_std=line.q_std,
        decay_time_s=line.decay_time_s,
        decay_time_std_s=line.decay_time_std_s,
        share=line.amplitude / first.amplitude,
        decays=line.decays,
    )


def _form(record: DecayRecord, form: FittedDecay, criterion: float) -> DecayForm:
    line = _Numbers.of(record, form, 0)
    return DecayForm(
        name=form.name,
        frequency_hz=line.frequency_hz,
        frequency_std_hz=line.frequency_std_hz,
        offset_hz=line.offset_hz,
        offset_std_hz=line.offset_std_hz,
        width_hz=line.width_hz,
        width_std_hz=line.width_std_hz,
        q=line.q,
        q_std=line.q_std,
        residual=math.sqrt(form.squares / form.curve.size) * record.top / line.amplitude,
        criterion=criterion,
    )


def _interval(value: float, error: float, half: float) -> tuple[float, float]:
    return value - half * error, value + half * error


def _points(record: DecayRecord, best: FittedDecay) -> DecayPoints:
    points = DecayPoints(
        time_s=tuple(record.time_s.tolist()),
        measured=tuple(record.values.real.tolist()),
        fitted=tuple(best.curve.real.tolist()),
    )
    if not record.is_complex:
        return points
    return replace(
        points,
        measured_imaginary=tuple(record.values.imag.tolist()),
        fitted_imaginary=tuple(best.curve.imag.tolist()),
    )
