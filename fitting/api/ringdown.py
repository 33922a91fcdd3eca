"""One resonance of a ringdown, of a file or of arrays, without any FMU."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy.typing as npt

import fitting.resonance.ringdown as resonance
from fitting.report.resonance import text
from fitting.resonance.decay_reading import is_over_time, read_decay_of
from fitting.resonance.decay_record import AMPLITUDES, PHASORS, decay_record_of
from fitting.resonance.reading import Columns
from fitting.resonance.ringdown import ringdown_of
from fitting.signal.line_record import fields_of
from fitting.text.arguments import checked
from fitting.text.errors import BadInput

__all__ = ["Ringdown", "is_over_time", "ringdown"]


@dataclass(frozen=True, kw_only=True, repr=False)
class Ringdown(resonance.Ringdown):
    """One resonance of a ringdown; printed, it says what the command ``line`` says.

    Numbers are `Estimate` records: ``value``, ``std``, half of the interval that holds the truth in
    68 of 100 such records, ``ci95`` that holds it in 95, and ``unit``.

    Attributes:
        frequency: eigenfrequency, Hz; NaN where the record does not determine it.
        offset: of demodulated values, from the reference, Hz.
        width: full width at half of the power, Hz.
        q: their ratio.
        decay_time: in which the amplitude falls to 1/e, s.
        amplitude: at the first sample that is used, in ``unit``.
        is_noise: whether the residuals are noise, by all tests.
        residual: root mean square of the residuals, over ``amplitude``.
        points: what was recorded and fitted.

    `fitting.resonance.ringdown.Ringdown` has the rest.
    """

    def __repr__(self) -> str:
        return text(self)


@checked
def ringdown(
    source: str | Path | npt.ArrayLike,
    values: npt.ArrayLike | None = None,
    *,
    unit: str = "1",
    within_s: tuple[float | None, float | None] = (None, None),
    demodulated_at_hz: float | None = None,
    columns: Columns | None = None,
) -> Ringdown:
    """One resonance of a free decay: frequency, full width, quality and decay time, with errors.

    Samples of the motion, complex values of a demodulator, or amplitudes alone, which tell no
    frequency. Where the decay begins is found. A constant beside it is solved for; a second line,
    and a frequency that moves with the square of the amplitude, are looked for, see
    `fitting.resonance.decay_fit` for the formula. Errors hold for noise as it is seen in what the
    fit leaves, and are wider where neighbouring samples follow each other.

    Args:
        source: A file, whose kind is recognised; or times, evenly spaced, shape (n,), s.
        values: With times: samples or amplitudes, or complex values with phases as
            Re[value exp(i 2 pi f t)], shape (n,).
        unit: Of these values.
        within_s: First and last time that are taken, s; None: as far as there are samples.
        demodulated_at_hz: The frequency of the demodulator, Hz; None: the file tells it, or nobody.
        columns: Of a file, what it does not tell.

    Returns:
        ``width``, ``decay_time``, ``amplitude`` and, where the record determines them,
        ``frequency`` and ``q``, each with its ``std`` and ``ci95``; ``forms`` has what else was
        tried.

    Raises:
        BadInput: a file that is not read, no free decay, or too little of one.
    """
    if isinstance(source, str | PathLike):
        if values is not None:
            raise BadInput("ringdown: found a file and values, wanted times and values, or a file")
        record = read_decay_of(Path(source), columns or Columns())
    elif values is None:
        raise BadInput("ringdown: found times alone, wanted values with them, or a file")
    else:
        record = decay_record_of(source, values, unit)
    if demodulated_at_hz is not None:
        if not 0.0 < demodulated_at_hz < math.inf:
            raise BadInput(
                f"{record.source}: demodulated at {demodulated_at_hz!r} Hz, wanted a positive "
                "frequency"
            )
        if not record.is_complex and (record.values.real < 0.0).any():
            raise BadInput(
                f"{record.source}: was demodulated, and its one column of values changes sign; "
                "wanted X and Y, or amplitudes"
            )
        kind = PHASORS if record.is_complex else AMPLITUDES
        record = replace(record, reference_hz=demodulated_at_hz, kind=kind)
    found = ringdown_of(record.within(*within_s))
    return Ringdown(**fields_of(found, resonance.Ringdown))
