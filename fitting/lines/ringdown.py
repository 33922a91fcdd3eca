"""The line of a free decay: where it begins, every form that may describe it, the one that does.

A mode that is left alone falls as e^(-pi w t), w its full width at half of the power:

    decay time of the amplitude  tau = 1/(pi w),    Q = f0/w,    f0^2 = f^2 + (w/2)^2

f is the frequency at which it rings, f0 its eigenfrequency without damping, that of sweeps.

`alone` is one line, `constant` has a constant next to it, `second` a further line, too. Where
residuals are no noise the frequency follows the square of the amplitude in `moving`, the damping in
`damping`, both in `nonlinear`. Of amplitudes `noise` has the noise of X and Y, from which they do
not fall, and `constant` the zero of a detector.

A drive or a blow may come before the decay. The begin that the record suggests is taken where the
samples before it follow another decay than those behind it, or none, by the F tests of G. Chow,
Econometrica 28 (1960) 591; else the decay is that of all samples.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fitting.lines.choice import (
    BY_CHANCE,
    EQUAL,
    PLAINLY,
    PRESENT_P,
    criteria_of,
    gain_p,
    order_of,
    wider,
)
from fitting.lines.decay import Decays, fit_decays, fit_law
from fitting.lines.decay_begin import begin_of
from fitting.lines.names import TIME_WAY
from fitting.lines.record import (
    FormFit,
    LineNumber,
    LineValues,
    MeasuredLine,
    Numbers,
    SecondLine,
    common_fields,
    fields_of,
    line_numbers,
    number_of_line,
)
from fitting.lines.rice import fit_readings
from fitting.lines.solve import Array, Fit
from fitting.lines.trace import AMPLITUDES, PHASORS, SAMPLES, DecayRecord
from fitting.signal.residual_tests import SMALLEST_RESIDUAL, residual_structure
from fitting.signal.student import ratio95
from fitting.signal.time_grid import refuse_clipped
from fitting.text.errors import BadInput
from fitting.text.estimate import Interval
from fitting.text.notation import number, quantity

ALONE, CONSTANT, SECOND, MOVING, NOISE = "alone", "constant", "second", "moving", "noise"
DAMPING, NONLINEAR = "damping", "nonlinear"
#: What each form is, in words.
FORM_WORDS = {
    ALONE: "the decay alone",
    CONSTANT: "the decay and a constant",
    SECOND: "two decays and a constant",
    MOVING: "a decay whose frequency moves with the square of its amplitude, and a constant",
    DAMPING: "a decay whose damping depends on the square of its amplitude",
    NONLINEAR: "a decay whose frequency and damping depend on the square of its amplitude",
    NOISE: "the decay in the noise of X and Y (Rice)",
}
#: Terms of each form.
TERMS: dict[str, dict[str, Any]] = {
    ALONE: {"constant": False},
    CONSTANT: {},
    NOISE: {},
    SECOND: {"lines": 2},
    MOVING: {"moves": True},
    DAMPING: {"damps": True},
    NONLINEAR: {"moves": True, "damps": True},
}
#: Samples up to which a further line is looked for where residuals seem noise.
MOST = 200_000
#: Share of the largest value below zero from which a record swings, as amplitudes do not.
SWINGS = 0.3
#: Standard errors, and decays of the amplitude over the record, that a line needs to decay.
DECAYS_SIGMA, DECAYS = 2.0, 0.02
#: Times the noise of X above which amplitudes are correlated as it is, and how many at least.
ABOVE, LEAST = 2.0, 40


@dataclass(frozen=True, kw_only=True, eq=False)
class DecayFit(FormFit):
    """A form of the decay as fitted.

    Lines that decay come first, each time the highest at the first sample first; their heights are
    those there. ``correl`` is of its frequency (not of amplitudes), its FWHM, the amplitude, then
    shift and extra width where they are fitted.

    Attributes:
        offset: of phasors, from the demodulation frequency, Hz; else None.
        decay_time: in which the amplitude falls to 1/e, s.
        decays: whether the first line decays.
        shift: how far its frequency is moved at the first sample, Hz.
        extra: how much wider it is there than at small amplitudes, Hz.
        background: the constant, complex of phasors; of `noise` that of X and Y each.
        background_std: its error, of complex ones that of either part.
        model: its shapes and terms.
        fit: to the values over the largest one.
        rival: another form for which the errors hold, too; mostly empty.
    """

    offset: LineNumber | None
    decay_time: LineNumber
    decays: bool
    shift: LineNumber
    extra: LineNumber
    background: complex
    background_std: float
    model: Decays
    fit: Fit
    rival: str = ""

    @property
    def rows(self) -> int:
        """Number of residuals."""
        return self.fit.residuals.size


@dataclass(frozen=True, kw_only=True)
class Ringdown(MeasuredLine):
    """One resonance of a ringdown.

    The frequency is NaN of amplitudes alone and of phasors without a demodulation frequency; the
    quality factor of amplitudes is at that frequency. ``rms_residual`` is over the amplitude at the
    first sample.

    Attributes:
        kind: "samples" of the motion, "phasors" of a demodulator, or "amplitudes".
        offset: of phasors, from the demodulation frequency, Hz; else None.
        decay_time: of the amplitude to 1/e, s.
        amplitude: at the first sample, in ``unit``.
        shift: of the frequency at the first sample by the squared amplitude, Hz; zero: not fitted.
        extra: FWHM at the first sample beyond that of small amplitudes, Hz; zero: not fitted.
        reference_hz: of the demodulator, Hz; NaN: not stated.
        form: the chosen form.
        rival: another form of amplitudes that fits nearly as well, included in the errors; mostly
            empty.
        background: constant, of phases its modulus, in ``unit``, with error ``background_std``; of
            amplitudes without one the noise of a quadrature.
        begin_s: first used sample, s.
        left_out: samples before it.
        spacing_s: of the samples, s.
    """

    kind: str
    offset: LineNumber | None
    decay_time: LineNumber
    amplitude: LineNumber
    shift: LineNumber
    extra: LineNumber
    reference_hz: float
    form: str
    rival: str
    background: float
    background_std: float
    begin_s: float
    left_out: int
    spacing_s: float

    @property
    def var_names(self) -> tuple[str, ...]:
        """Names of the numbers that were fitted and are printed."""
        place = {PHASORS: ("offset",), SAMPLES: ("frequency",)}.get(self.kind, ())
        law = [name for name in ("shift", "extra") if getattr(self, name).value != 0.0]
        return (*place, "width", "amplitude", *law)

    @property
    def eigenfrequency(self) -> LineNumber:
        """The frequency without damping, which a sweep has, Hz."""
        f, w = self.frequency, self.width
        value = math.hypot(f.value, 0.5 * w.value)
        std = math.hypot(f.value * f.std, 0.25 * w.value * w.std) / value
        return number_of_line("eigenfrequency", value, std, half=self.ratio95)

    @property
    def alike(self) -> tuple[LineNumber, ...]:
        """The next higher frequencies that have the same samples, of samples of the motion, Hz."""
        if self.kind != SAMPLES:
            return ()
        f, rate = self.frequency, 1.0 / self.spacing_s
        half = self.ratio95 * f.std
        return tuple(
            replace(f, value=value, ci95=(value - half, value + half))
            for value in (rate - f.value, rate + f.value)
        )


def ringdown_of(record: DecayRecord) -> Ringdown:
    """The resonance of a free decay.

    Args:
        record: what was recorded.

    Raises:
        BadInput: no free decay, one that is cut off above, or one of which too little is recorded.
    """
    if not np.any(record.values):
        raise BadInput(f"{record.source}: holds nothing but zeros, wanted a ringdown")
    known = bool(record.kind)
    try:
        record = replace(record, kind=record.kind or _apparent_kind(record))
        first = begin_of(record.values, record.kind)
        used, forms = _from_start(record, first, known=known)
        best = forms[0]
        if _presence_p(used, best) > PRESENT_P:
            raise _no_decay(record)
        if not best.decays:
            raise _too_short(used, best.width)
    except BadInput:
        _refuse_clipped(record)  # names what is wrong with the samples, where that is it
        raise
    _refuse_clipped(used)
    criteria = criteria_of(forms, best.rows)
    return Ringdown(
        **common_fields(used, best, best, time_s=used.time_s),
        kind=used.kind,
        offset=best.offset,
        decay_time=best.decay_time,
        amplitude=best.amplitude,
        shift=best.shift,
        extra=best.extra,
        reference_hz=used.reference_hz,
        form=best.name,
        forms=tuple(
            form.tried(float(criterion), offset=form.offset)
            for form, criterion in zip(forms, criteria, strict=True)
        ),
        rival=best.rival,
        second=best.second,
        background=abs(best.background) if used.kind == PHASORS else best.background.real,
        background_std=best.background_std,
        begin_s=float(used.time_s[0]),
        left_out=record.values.size - used.values.size,
        spacing_s=used.spacing_s,
        rms_residual=best.rms_residual,
        chisqr=best.squares * used.top**2,
    )


def _refuse_clipped(record: DecayRecord) -> None:
    for part in (record.values.real, record.values.imag)[: 1 + record.is_complex]:
        refuse_clipped(np.asarray(part), record.source)


def _from_start(
    record: DecayRecord, first: int, *, known: bool
) -> tuple[DecayRecord, list[DecayFit]]:
    """The record from where it decays freely on, and every form of it."""
    whole: list[DecayFit] = []
    with contextlib.suppress(*([BadInput] if first else [])):
        whole = _forms(record, known=known)
        if first == 0 or (whole[0].structure.is_noise and not whole[0].others):
            return record, whole
    part = record.part(first, record.values.size)
    forms = _forms(part, known=known)
    if forms[0].others:  # lines that beat look like a begin, to one line
        earlier = begin_of(record.values, record.kind, len(forms[0].others) + 1)
        if 0 < earlier < first:
            first, part = earlier, record.part(earlier, record.values.size)
            forms = _forms(part, known=known)
    # the begin of a decay after a drive looks like a second line, too
    more = whole and len(whole[0].others) > len(forms[0].others)
    if not whole or more:
        return part, forms

    # do the samples before the first belong to the decay behind it? By F tests they are compared
    # with the decay that the others have (predictive test), and with one of their own, which a
    # drive that holds the amplitude is, too (test of equal coefficients)
    every, late = (next(form for form in each if form.model.constant) for each in (whole, forms))
    alike = late.structure.together**2
    before, behind = every.squares * record.top**2, late.squares * part.top**2
    rows = every.rows - late.rows
    chances = [gain_p(before, behind, max(1.0, rows / alike), late.dof)]
    if rows > 2 * late.unknowns:
        head = record.part(0, first)
        model = replace(late.model, samples=first, moves=False, damps=False)
        with contextlib.suppress(ValueError):
            own = fit_decays(model, _scaled(head)).squares * head.top**2
            chances.append(gain_p(before, behind + own, late.unknowns, late.dof))
    return (part, forms) if len(chances) * min(chances) < BY_CHANCE else (record, whole)


def _apparent_kind(record: DecayRecord) -> str:
    """Samples or amplitudes: which of both a decay follows closer."""
    if np.min(record.values.real) < -SWINGS * record.top:
        return SAMPLES
    y = np.asarray(record.values.real / record.top)
    try:
        line = fit_decays(Decays(samples=y.size, kind=SAMPLES), y)
    except ValueError:
        return AMPLITUDES
    size = fit_decays(Decays(samples=y.size, kind=AMPLITUDES), y)
    return SAMPLES if line.squares < size.squares else AMPLITUDES


# --- forms ---------------------------------------------------------------------------------------


def _forms(record: DecayRecord, *, known: bool) -> list[DecayFit]:
    """Every form of the record, the one that is taken first."""
    try:
        one = _form(record, CONSTANT)
    except ValueError as error:
        if record.kind == AMPLITUDES:
            raise
        raise _no_decay(record) from error
    if record.kind == AMPLITUDES:
        return _of_amplitudes(record, one, known=known)

    # where one line does not leave noise: a law of its frequency or damping, else two lines; all of
    # them have to gain more than noise lets them
    closer: list[DecayFit] = []
    is_noise = one.structure.is_noise
    if one.squares > one.rows * SMALLEST_RESIDUAL**2 and (not is_noise or one.rows <= MOST):
        if not is_noise:
            closer = [f for f in _fitted(record, (MOVING, DAMPING), one) if _gains(one, f)]
            moving = [f for f in closer if f.name == MOVING and not f.structure.is_noise]
            if moving:
                closer += _fitted(record, (NONLINEAR,), moving[0])
        if not any(form.structure.is_noise for form in closer):
            closer += _fitted(record, (SECOND,), one)
        closer = [form for form in closer if _gains(one, form)]
    rest = [one, *_fitted(record, (ALONE,), one)]
    order = order_of(closer, criteria_of(closer, one.rows)) if closer else []
    return [*(closer[k] for k in order), *rest]


def _of_amplitudes(record: DecayRecord, constant: DecayFit, *, known: bool) -> list[DecayFit]:
    """Forms of amplitudes: in Rice's noise where they are known to be such, else the closer one."""
    noise = [] if np.any(record.values < 0.0) else _fitted(record, (NOISE,), constant)
    forms = [*noise, constant]
    if noise:
        here, there = criteria_of(forms, constant.rows)
        if here - there > (PLAINLY if known else 0.0):
            forms = forms[::-1]
        if not known and abs(here - there) < EQUAL:
            forms[0] = _covering(*forms)
    best = forms[0]
    if best.structure.is_noise or best.squares <= best.rows * SMALLEST_RESIDUAL**2:
        return forms
    return [*(form for form in _fitted(record, (DAMPING,), best) if _gains(best, form)), *forms]


def _covering(form: DecayFit, rival: DecayFit) -> DecayFit:
    """A form with errors that hold for another one, too, which describes the samples as well."""
    width = wider(form.width, [rival.width], form.dof)
    factor = width.std / form.width.std
    time = form.decay_time
    return replace(
        form,
        width=width,
        q=replace(form.q, std=form.q.std * factor),  # what follows from the width alone
        decay_time=replace(time, std=time.std * factor, ci95=_times(width.ci95)),
        amplitude=wider(form.amplitude, [rival.amplitude], form.dof),
        rival=rival.name,
    )


def _fitted(record: DecayRecord, names: Sequence[str], near: DecayFit) -> list[DecayFit]:
    """Those of some forms that can be fitted, and are determined."""
    forms = []
    for name in names:
        with contextlib.suppress(ValueError, np.linalg.LinAlgError):
            forms.append(_form(record, name, near))
    return [form for form in forms if math.isfinite((form.second or form).width.std)]


def _form(record: DecayRecord, name: str, near: DecayFit | None = None) -> DecayFit:
    """A form of a record, started at one line with what is next to it.

    Raises:
        ValueError: it cannot be fitted.
    """
    y = _scaled(record)
    in_noise = name == NOISE or (near is not None and near.name == NOISE)
    terms = TERMS[name] | ({"constant": False} if in_noise else {})
    model = Decays(samples=y.size, kind=record.kind, **terms)
    start = None if near is None else near.fit
    if in_noise and start is not None:
        x = np.array([*start.x, *[start.x[-1]] * model.damps])
        fit, likely = fit_readings(model, np.asarray(y, dtype=float), [x])
        return _numbers(record, name, model, fit, likely)
    if start is not None and (model.moves or model.damps):
        fit = fit_law(model, y, start)
    else:
        fit = fit_decays(model, y, start if name == SECOND else None)
    return _numbers(record, name, model, fit, fit.squares)


def _scaled(record: DecayRecord) -> Array:
    """Values over the largest one, complex ones of phasors alone."""
    y: Array = np.asarray(record.values / record.top, dtype=complex)
    return y if record.kind == PHASORS else np.asarray(y.real)


def _numbers(record: DecayRecord, name: str, model: Decays, fit: Fit, likely: float) -> DecayFit:
    """A form with its numbers and their errors."""
    # residuals of amplitudes in noise show its correlation where they are above it
    rows, jacobian, top, span = fit.residuals, fit.jacobian, record.top, record.span_s
    if model.kind == AMPLITUDES and not model.constant:
        loud = fit.curve > ABOVE * float(fit.coefficients[-1])
        if np.count_nonzero(loud) >= LEAST:
            rows, jacobian = rows[loud], jacobian[loud]
    first = model.count
    structure = residual_structure(rows, jacobian[:, :first], jacobian[:, first:])
    numbers = Numbers(fit, structure=structure)

    # lines in their order, the height of each, and the amplitude of the first one
    parts = 1 if model.kind == AMPLITUDES else 2
    heights = fit.coefficients[: model.lines]
    if model.kind == SAMPLES:  # the real part of a + i b
        heights = fit.coefficients[: 2 * model.lines].reshape(-1, 2) @ np.array([1.0, 1j])
    lines = [_line(record, model, numbers, k) for k in range(model.lines)]
    order = sorted(range(model.lines), key=lambda k: (not lines[k].decays, -abs(heights[k])))
    size, at = float(abs(heights[order[0]])), first + parts * order[0]
    along = np.array([heights[order[0]].real, heights[order[0]].imag][:parts]) / (size or 1.0)
    slopes = [(at + k, top * float(part)) for k, part in enumerate(along)]
    line, *others = (replace(lines[j], share=float(abs(heights[j])) / size) for j in order)
    assert line.decay_time is not None  # noqa: S101 - every line of a decay has one

    # what the frequency and the damping follow; correlations in units that do not matter
    law, k = {}, model.each * model.lines
    for what, there in {"shift": model.moves, "extra": model.damps}.items():
        value = float(fit.x[k]) / span if there else 0.0
        law[what] = numbers.number(what, value, [(k, 1.0 / span)] if there else [], "Hz")
        k += there
    place = np.eye(model.each, fit.unknowns, model.each * order[0])
    law_of = np.eye(model.moves + model.damps, fit.unknowns, model.each * model.lines)
    # of amplitudes without a constant the last one is the noise of X and Y
    last = model.constant or model.kind == AMPLITUDES
    constant = [(first + parts * model.lines, 1.0)] if model.constant else []
    return DecayFit(
        **fields_of(line, LineValues),
        name=name,
        offset=line.offset,
        decay_time=line.decay_time,
        decays=line.decays,
        others=tuple(others),
        amplitude=numbers.number("amplitude", top * size, slopes, record.unit),
        correl=numbers.correl([*place, numbers.gradient(slopes), *law_of]),
        shift=law["shift"],
        extra=law["extra"],
        background=top * complex(fit.coefficients[-1]) if last else 0j,
        background_std=top * numbers.std_of(constant),
        rms_residual=math.sqrt(fit.squares / fit.curve.size) / size if size else math.inf,
        model=model,
        fit=fit,
        structure=structure,
        dof=numbers.dof,
        unknowns=fit.unknowns,
        squares=fit.squares,
        likely_squares=likely,
        curve=top * fit.curve,
    )


def _line(record: DecayRecord, model: Decays, numbers: Numbers, k: int) -> SecondLine:
    """The k-th line of a form; NaN: the record does not determine it."""
    span, at = record.span_s, model.each * k
    turns, wide, _, _ = model.at(numbers.fit.x, k)
    width, width_std = wide / span, numbers.std_of([(at + model.each - 1, 1.0 / span)])
    rings, rings_std, offset = math.nan, math.nan, None
    if model.kind != AMPLITUDES:
        rings, rings_std = turns / span, numbers.std_of([(at, 1.0 / span)])
    if model.kind == SAMPLES:
        rings = abs(rings)  # negative turns are the same
    if model.kind == PHASORS:
        offset = number_of_line("offset", rings, rings_std, half=ratio95(numbers.dof))
        rings += record.reference_hz
    eigen = math.hypot(rings, 0.5 * width)
    q = (record.reference_hz if model.kind == AMPLITUDES else eigen) / width
    # its error is that of the width but for low quality
    share = rings_std / eigen if eigen > 0.0 else 0.0
    made = line_numbers(
        (rings, rings_std),
        (width, width_std),
        (q, abs(q) * math.hypot(width_std / width, share)),
        numbers.dof,
        q_by_width=True,
    )
    time = 1.0 / (math.pi * width)
    time_std, ci95 = abs(time * width_std / width), _times(made["width"].ci95)
    return SecondLine(
        **made,
        share=1.0,
        decays=width > DECAYS_SIGMA * width_std and math.pi * width * span > DECAYS,
        offset=offset,
        decay_time=number_of_line("decay_time", time, time_std, "s", ci95=ci95),
    )


def _times(widths: Interval) -> Interval:
    """Decay times at the ends of an interval of the width, s."""
    slow, fast = (max(end, 1e-300) for end in widths)
    return 1.0 / (math.pi * fast), 1.0 / (math.pi * slow)


# --- what contradicts a decay --------------------------------------------------------------------


def _gains(before: DecayFit, after: DecayFit) -> bool:
    """Whether a larger form leaves so much less that noise at any of the samples is no reason."""
    if before.squares <= after.rows * SMALLEST_RESIDUAL**2:
        return False
    more = max(1, after.unknowns - before.unknowns)
    return after.rows * gain_p(before.squares, after.squares, more, after.dof) < BY_CHANCE


def _presence_p(record: DecayRecord, form: DecayFit) -> float:
    """Probability that noise about a constant looks as much like a decay, at any of the samples."""
    y = record.values / record.top
    squares = float(np.sum(np.abs(y - np.mean(y)) ** 2))
    if form.squares <= form.rows * SMALLEST_RESIDUAL**2:
        return 0.0 if squares > form.squares else 1.0
    more = max(1, form.unknowns - (2 if record.kind == PHASORS else 1))
    return form.rows * gain_p(squares, form.squares, more, form.dof)


def _no_decay(record: DecayRecord) -> BadInput:
    return BadInput(
        f"{record.source}: is a recording over time without a free decay: a constant describes its "
        f"samples as well; wanted a ringdown, or {TIME_WAY}"
    )


def _too_short(record: DecayRecord, width: LineNumber) -> BadInput:
    span_s = number(record.span_s, 3)
    what = f"does not fall within its {span_s} s"
    if width.std < width.value:
        size = quantity(width.value, width.std, "Hz")
        what = f"falls too little within its {span_s} s to determine how fast: its width is {size}"
    return BadInput(f"{record.source}: {what}; wanted a longer record of a free decay")
