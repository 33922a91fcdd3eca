"""One resonance of a ringdown: frequency, width, quality and decay time, without any FMU.

A mode that is left alone falls as e^(-pi w t), w its full width at half of the power:

    decay time of the amplitude  tau = 1/(pi w),    Q = f0/w,    f0^2 = f^2 + (w/2)^2

f is the frequency at which it rings, f0 its eigenfrequency without damping, that of sweeps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fitting.lines.decay_record import PHASORS, SAMPLES, DecayRecord
from fitting.lines.ringdown import DecayFit, RingdownFit, fit_ringdown
from fitting.measurements.traces.grid import refuse_clipped
from fitting.resonance.record import MeasuredLine, Points
from fitting.signal.line_record import LineNumber, LineValues, TriedForm, fields_of, number_of_line
from fitting.text.errors import BadInput

__all__ = ["Ringdown", "ringdown_of"]


@dataclass(frozen=True, kw_only=True)
class Ringdown(MeasuredLine):
    """One resonance of a ringdown.

    The frequency is NaN where the record does not determine it: of amplitudes alone, and of phasors
    without a demodulation frequency. The quality factor of amplitudes is that of the demodulation
    frequency. ``rms_residual`` is over the amplitude at the first sample.

    Attributes:
        kind: "samples" of the motion, "phasors" of a demodulator, or "amplitudes".
        offset: of phasors, from the demodulation frequency, Hz; else None.
        decay_time: in which the amplitude falls to 1/e, s.
        amplitude: of the line at its first sample, in ``unit``.
        shift: how far the frequency is moved at the first sample, by the square of the amplitude,
            Hz; zero where that is not fitted.
        extra: by how much the FWHM at the first sample exceeds that of small amplitudes, Hz; zero
            where that is not fitted.
        reference_hz: of the demodulator, Hz; NaN: not stated.
        form: the form that was taken, see ``forms``.
        rival: another form of amplitudes that describes the samples nearly as well, for which the
            errors hold, too; mostly empty.
        background: the constant, its modulus if phases were recorded, in ``unit``; of amplitudes
            without one the noise of X, and of Y; ``background_std`` its error, zero of a noise.
        begin_s: time of the first sample that is used, s.
        left_out: samples before it: of a drive or a blow.
        spacing_s: between two samples, s.
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
    try:
        fit = fit_ringdown(record)
    except BadInput:
        _refuse_clipped(record)
        raise
    _refuse_clipped(fit.record)
    return _result(fit)


def _refuse_clipped(record: DecayRecord) -> None:
    for part in (record.values.real, record.values.imag) if record.is_complex else (record.values,):
        refuse_clipped(np.asarray(part.real), record.source)


def _result(fit: RingdownFit) -> Ringdown:
    record, best = fit.record, fit.forms[0]
    line, second = best.lines[0], best.lines[1] if len(best.lines) > 1 else None
    assert line.decay_time is not None  # noqa: S101 - every line of a decay has one
    structure = best.structure
    # of complex values both parts are rows: their samples are worth half of them
    structure = replace(structure, points=structure.points / (2.0 if record.is_complex else 1.0))
    return Ringdown(
        **fields_of(line, LineValues),
        source=record.source,
        unit=record.unit,
        kind=record.kind,
        offset=line.offset,
        decay_time=line.decay_time,
        amplitude=best.amplitude,
        shift=best.shift,
        extra=best.extra,
        reference_hz=record.reference_hz,
        form=best.name,
        forms=tuple(_tried(form, c) for form, c in zip(fit.forms, fit.criteria, strict=True)),
        rival=best.rival,
        second=second,
        background=abs(best.background) if record.kind == PHASORS else best.background.real,
        background_std=best.background_std,
        begin_s=float(record.time_s[0]),
        left_out=fit.first,
        spacing_s=record.spacing_s,
        rms_residual=best.rms_residual,
        dof=best.dof,
        structure=structure,
        chisqr=best.squares * record.top**2,
        unknowns=best.unknowns,
        correl=best.correl,
        reading=record.reading,
        points=Points.of(record.values, best.curve, time_s=record.time_s),
    )


def _tried(form: DecayFit, criterion: float) -> TriedForm:
    line = form.lines[0]
    return TriedForm(
        **fields_of(line, LineValues),
        name=form.name,
        rms_residual=form.rms_residual,
        criterion=criterion,
        structure=form.structure,
        offset=line.offset,
    )
