"""One resonance of a ringdown: frequency, width, quality and decay time, without any FMU.

A mode that is left alone falls as e^(-pi w t), w its full width at half of the power:

    decay time of the amplitude  tau = 1/(pi w),    Q = f/w,    f^2 = f_r^2 + (w/2)^2

f_r is the frequency at which it rings, f its eigenfrequency, as of sweeps.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

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
from fitting.resonance.record import MeasuredLine, Points
from fitting.signal.line_record import (
    LineNumber,
    LineValues,
    SecondLine,
    TriedForm,
    fields_of,
    line_numbers,
    number_of_line,
)
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
class Ringdown(MeasuredLine):
    """One resonance of a ringdown.

    The frequency is NaN where the record does not determine it: of amplitudes alone, and of phasors
    without a demodulation frequency. The quality factor of amplitudes is that of the demodulation
    frequency. ``residual`` is over the amplitude at the first sample.

    Attributes:
        kind: "samples" of the motion, "phasors" of a demodulator, or "amplitudes".
        offset: of phasors, from the demodulation frequency, Hz; else None.
        decay_time: in which the amplitude falls to 1/e, s.
        amplitude: of the line at its first sample, in ``unit``.
        shift: how far the frequency is moved at the first sample, by the square of the amplitude,
            Hz; zero where that is not fitted.
        reference_hz: of the demodulator, Hz; NaN: not stated.
        form: the form that was taken, see ``forms``.
        rival: another form of amplitudes that describes the samples nearly as well, for which the
            errors hold, too; mostly empty.
        background: the constant, its modulus if phases were recorded, in ``unit``; of "noise" the
            noise of X, and of Y; ``background_std`` its error.
        begin_s: time of the first sample that is used, s.
        left_out: samples before it: of a drive or a blow.
        spacing_s: between two samples, s.
    """

    kind: str
    offset: LineNumber | None
    decay_time: LineNumber
    amplitude: LineNumber
    shift: LineNumber
    reference_hz: float
    form: str
    rival: str
    background: float
    background_std: float
    begin_s: float
    left_out: int
    spacing_s: float


def ringdown_of(record: DecayRecord) -> Ringdown:
    """The resonance of a free decay.

    Args:
        record: what was recorded.

    Raises:
        BadInput: no free decay, one that is cut off above, or one of which too little is recorded.
    """
    if not np.any(record.values):
        raise BadInput(f"{record.source}: holds nothing but zeros, wanted a ringdown")
    known, record = bool(record.kind), replace(record, kind=record.kind or _apparent_kind(record))
    first = begin_of(record)
    used, forms = _fitted(record, first, known=known)
    if len(forms[0].width_hz) > 1:  # lines that beat look like a begin, to one line
        earlier = begin_of(record, len(forms[0].width_hz))
        if earlier < first:
            first = earlier
            used, forms = _fitted(record, first, known=known)
    return _result(used, forms, first)


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


def _apparent_kind(record: DecayRecord) -> str:
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
    wider = rival.errors + np.abs(there - here) / ratio95(form.dof)
    return replace(form, errors=np.fmax(form.errors, wider), rival=rival.name)


def _of_lines(record: DecayRecord) -> list[FittedDecay]:
    """Forms of samples or phasors."""
    try:
        one = fit_lines(record, CONSTANT)
    except ValueError as error:
        raise _no_decay(record) from error
    forms, closer = [one], []
    has_noise = one.squares > one.rows * SMALLEST_RESIDUAL**2
    structured = not _is_noise(one)
    if has_noise and (structured or record.values.size <= MOST):
        closer = _fits(record, one, (SECOND, MOVING) if structured else (SECOND,))
        closer = [form for form in closer if gain_chance(one, form) < IMPROBABLE]
    forms += [*closer, *_fits(record, one, (ALONE,))]
    if not closer:
        return forms
    criteria = _criteria(forms)
    best = min(range(1, 1 + len(closer)), key=lambda k: criteria[k])
    return [forms[best], *(form for k, form in enumerate(forms) if k != best)]


def _fits(record: DecayRecord, one: FittedDecay, names: Sequence[str]) -> list[FittedDecay]:
    """Those of some forms that can be fitted, from one line with a constant."""
    forms = []
    for name in names:
        with contextlib.suppress(ValueError):
            forms.append(fit_lines(record, name, one))
    return forms


def _criteria(forms: Sequence[FittedDecay]) -> list[float]:
    """Akaike's criterion of every form, samples that are correlated counted as they are worth."""
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


def _too_short(record: DecayRecord, width: LineNumber) -> BadInput:
    span_s = number(record.spacing_s * record.values.size, 3)
    what = f"does not fall within its {span_s} s"
    if width.std < width.value:
        size = quantity(width.value, width.std, "Hz")
        what = f"falls too little within its {span_s} s to determine how fast: its width is {size}"
    return BadInput(f"{record.source}: {what}; wanted a longer record of a free decay")


def _result(record: DecayRecord, forms: Sequence[FittedDecay], first: int) -> Ringdown:
    best = forms[0]
    if least_chance(record, best) > SEEN_P:
        raise _no_decay(record)
    lines = [_line(record, best, k) for k in range(len(best.width_hz))]
    order = sorted(range(len(lines)), key=lambda k: not lines[k].decays)
    line, height = lines[order[0]], best.amplitude[order[0]]
    if not line.decays:
        raise _too_short(record, line.width)
    second = None
    if len(order) > 1:
        second = replace(lines[order[1]], share=best.amplitude[order[1]] / height)
    half = ratio95(best.dof)
    height_std = float(best.errors[2 * len(lines) + order[0]])
    criteria = _criteria(forms)
    rms = math.sqrt(best.squares / best.curve.size) * record.top
    structure = best.structure
    # of complex values both parts are rows: their samples are worth half of them
    structure = replace(structure, points=structure.points / (2.0 if record.is_complex else 1.0))
    return Ringdown(
        **fields_of(line, LineValues),
        source=record.source,
        unit=record.unit,
        kind=record.kind,
        offset=line.offset,
        decay_time=_decay_time(line.width),
        amplitude=number_of_line("amplitude", height, height_std, record.unit, half=half),
        shift=number_of_line("shift", best.shift_hz, best.shift_std_hz, half=half),
        reference_hz=record.reference_hz,
        form=best.name,
        forms=tuple(
            _tried(record, form, criterion - min(criteria))
            for form, criterion in zip(forms, criteria, strict=True)
        ),
        rival=best.rival,
        second=second,
        background=best.background.real if record.kind != PHASORS else abs(best.background),
        background_std=best.background_std,
        begin_s=float(record.time_s[0]),
        left_out=first,
        spacing_s=record.spacing_s,
        residual=rms / height,
        dof=best.dof,
        structure=structure,
        reading=record.reading,
        points=Points.of(record.values, best.curve, time_s=record.time_s),
    )


def _line(record: DecayRecord, form: FittedDecay, k: int) -> SecondLine:
    """The k-th line of a form; NaN: the record does not determine it."""
    count, half = len(form.width_hz), ratio95(form.dof)
    rings, rings_std = form.frequency_hz[k], float(form.errors[k])
    width, width_std = form.width_hz[k], float(form.errors[count + k])
    offset = None
    if record.kind == PHASORS:
        offset = number_of_line("offset", rings, rings_std, half=half)
        rings += record.reference_hz
    eigen, eigen_std = math.hypot(rings, 0.5 * width), rings_std
    if eigen > 0.0:
        eigen_std = math.hypot(rings * rings_std, 0.25 * width * width_std) / eigen
    q = (record.reference_hz if record.kind == AMPLITUDES else eigen) / width
    # its error is that of the width but for low quality
    share = eigen_std / eigen if eigen > 0.0 else 0.0
    numbers = line_numbers(
        (eigen, eigen_std),
        (width, width_std),
        (q, q * math.hypot(width_std / width, share)),
        form.dof,
    )
    numbers["q"] = replace(numbers["q"], ci95=_inverse(q * width, numbers["width"]))
    span_s = record.spacing_s * record.values.size
    return SecondLine(
        **numbers,
        share=1.0,
        decays=width > DECAYS_SIGMA * width_std and math.pi * width * span_s > DECAYS,
        offset=offset,
        decay_time=_decay_time(numbers["width"]),
    )


def _inverse(numerator: float, width: LineNumber) -> tuple[float, float]:
    """The 95 % interval of a number over the width."""
    slow, fast = (max(end, 1e-300) for end in width.ci95)
    return numerator / fast, numerator / slow


def _decay_time(width: LineNumber) -> LineNumber:
    """In which the amplitude falls to 1/e, s."""
    value = 1.0 / (math.pi * width.value)
    slow, fast = (max(end, 1e-300) for end in width.ci95)
    ci95 = 1.0 / (math.pi * fast), 1.0 / (math.pi * slow)
    return number_of_line("decay_time", value, value * width.std / width.value, "s", ci95=ci95)


def _tried(record: DecayRecord, form: FittedDecay, criterion: float) -> TriedForm:
    line = _line(record, form, 0)
    rms = math.sqrt(form.squares / form.curve.size) * record.top
    return TriedForm(
        **fields_of(line, LineValues),
        name=form.name,
        residual=rms / form.amplitude[0],
        criterion=criterion,
        structure=form.structure,
        offset=line.offset,
    )
