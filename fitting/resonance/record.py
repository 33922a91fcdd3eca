"""What results of a sweep, a ringdown and a noise spectrum have in common, with their points."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from fitting.signal.line_record import LineResult, Matrix
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.finding import Finding
from fitting.text.sentences import sentence_lines

Floats = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Points:
    """What was measured and what was fitted, (n,) each; imaginary parts are empty without phases.

    One of ``frequency_hz`` and ``time_s`` is empty. Phases of a sweep are counted as
    Re[value exp(i 2 pi f t)]: they fall over a resonance. Densities are in the unit squared per Hz.
    """

    measured: Floats
    fitted: Floats
    frequency_hz: Floats = ()
    time_s: Floats = ()
    measured_imaginary: Floats = ()
    fitted_imaginary: Floats = ()

    @classmethod
    def of(
        cls,
        measured: FloatArray | ComplexArray,
        fitted: FloatArray | ComplexArray,
        *,
        frequency_hz: FloatArray | None = None,
        time_s: FloatArray | None = None,
    ) -> Points:
        """Points of arrays, (n,) each.

        Args:
            measured: values, complex ones with phases.
            fitted: at the same places.
            frequency_hz: of a sweep or a spectrum, Hz.
            time_s: of a recording over time, s.
        """
        imaginary = {}
        if np.iscomplexobj(measured):
            imaginary = {
                "measured_imaginary": tuple(measured.imag.tolist()),
                "fitted_imaginary": tuple(fitted.imag.tolist()),
            }
        return cls(
            measured=tuple(measured.real.tolist()),
            fitted=tuple(fitted.real.tolist()),
            frequency_hz=() if frequency_hz is None else tuple(frequency_hz.tolist()),
            time_s=() if time_s is None else tuple(time_s.tolist()),
            **imaginary,
        )

    @property
    def place(self) -> Floats:
        """Frequencies, Hz, or times, s."""
        return self.frequency_hz or self.time_s

    def arrays(self) -> tuple[FloatArray | ComplexArray, FloatArray | ComplexArray]:
        """Measured and fitted values, real or complex, (n,) each."""
        measured, fitted = np.array(self.measured), np.array(self.fitted)
        if not self.measured_imaginary:
            return measured, fitted
        return (
            measured + 1j * np.array(self.measured_imaginary),
            fitted + 1j * np.array(self.fitted_imaginary),
        )


@dataclass(frozen=True, kw_only=True)
class MeasuredLine(LineResult):
    """One resonance of a file or of arrays.

    Attributes:
        chisqr: sum of the squared residuals as they were weighted, in the squared unit; of a noise
            spectrum the deviance over what it is expected to be for each point.
        unknowns: real numbers that were fitted.
        correl: correlations of the numbers of ``var_names``, (k, k).
        reading: how the file was read: findings that ask nothing of the reader.
        points: what was measured and what was fitted.
    """

    chisqr: float
    unknowns: int
    correl: Matrix
    reading: tuple[Finding, ...]
    points: Points = field(repr=False)

    @property
    def var_names(self) -> tuple[str, ...]:
        """Names of the numbers that were fitted and are printed."""
        return ("frequency", "width", "amplitude")

    @property
    def rows(self) -> int:
        """Number of residuals: of complex values two at every point."""
        return len(self.points.place) * (2 if self.is_complex else 1)

    @property
    def minus_twice_likely(self) -> float:
        """Minus twice the logarithm of the likelihood of normal noise, but for a constant."""
        return self.rows * math.log(self.chisqr / self.rows) if self.chisqr > 0.0 else -math.inf

    @property
    def remarks(self) -> tuple[str, ...]:
        """How the file was read, in sentences."""
        return sentence_lines(self.reading)

    @property
    def is_complex(self) -> bool:
        """Whether phases were measured."""
        return bool(self.points.measured_imaginary)
