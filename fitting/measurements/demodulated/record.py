"""Demodulated record: phasors or amplitudes at a frequency over time, as a lock-in writes them."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from functools import cached_property

import numpy as np

from fitting.fmu.runs import SampledSignal
from fitting.lines.decay_begin import decay_start
from fitting.measurements.residual_curve import ResidualCurve
from fitting.measurements.traces.record import SHIFTS
from fitting.measurements.traces.time_record import TimeRecord
from fitting.signal.rician import Scatter, scatter_of
from fitting.signal.rotating import SENSED, Reference, reference
from fitting.signal.window import Window
from fitting.text.arrays import ComplexArray, FloatArray, IntArray
from fitting.text.errors import BadInput

#: Shifts reach over this part of the record.
SHARE = 8


@dataclass(frozen=True, eq=False)
class DemodulatedRecord(TimeRecord):
    """A free decay of one output of the FMU, demodulated at a frequency.

    `fitting.DemodulatedTrace` explains its fields.

    Raises:
        BadInput: shapes that differ, times that do not rise or are not even, values that are not
            finite, are negative amplitudes or are clipped, a frequency that is not positive, fewer
            samples than a decay needs.
    """

    _: KW_ONLY
    frequency_hz: float
    input: str
    modes: int = 1
    floor: bool = True
    source: str = "demodulated trace"

    is_complex = True

    def check_statements(self) -> None:
        """Complain of fields that do not go together."""
        if not 0.0 < self.frequency_hz < np.inf:
            raise BadInput(
                f"{self.source}: demodulated at {self.frequency_hz!r} Hz; wanted a positive "
                "frequency"
            )
        if self.modes < 1:
            raise BadInput(f"{self.source}: {self.modes} modes, wanted 1 at least")
        if not self.input:
            raise BadInput(
                f"{self.source}: a decay is spanned by responses to a pulse: wanted the input of "
                "the FMU that excites it"
            )
        if self.is_amplitude and self.offset:
            raise BadInput(f"{self.source}: an offset has a meaning for phasors only")
        for k in np.flatnonzero(self.y < 0.0)[:1] if self.is_amplitude else ():
            raise BadInput(
                f"{self.source}: sample {k}: amplitude {self.y[k]:g}; wanted none below zero, or "
                "phasors X + i Y"
            )

    def check_samples(self) -> None:
        """Complain of too few samples."""
        if 4 * self.modes > self.y.size:
            raise BadInput(
                f"{self.source}: {self.modes} modes for {self.y.size} samples; wanted four samples "
                "at least for each"
            )
        if not np.any(self.y):
            raise BadInput(f"{self.source}: every value is zero; wanted a decay")

    def decay_begin(self) -> int:
        """Index of the first sample of the free decay."""
        if self.is_amplitude and self.modes > 1:
            raise BadInput(
                f'{self.source}: begin = "found" looks for exponentials, which amplitudes of '
                f"{self.modes} modes are not; wanted phasors, or the record cut"
            )
        quarter = np.exp(0.5j * np.pi * (np.arange(self.y.size) % 4 + 0.5))
        begin = decay_start((self.y * quarter).real, 2 * self.modes)
        if begin is None:
            raise BadInput(
                f"{self.source}: shows no free decay; wanted a longer record after the drive is "
                'off, or begin = "first"'
            )
        return begin

    @property
    def is_amplitude(self) -> bool:
        """Whether the values are amplitudes, without phases."""
        return not np.iscomplexobj(self.y)

    @property
    def rows(self) -> int:
        """Number of residual rows: one for an amplitude, two for a phasor."""
        return int(self.y.size) * (1 if self.is_amplitude else 2)

    @cached_property
    def largest(self) -> float:
        """The largest amplitude, in ``unit``."""
        return float(np.max(np.abs(self.y)))

    @cached_property
    def scatter(self) -> Scatter:
        """What the scatter of amplitudes tells of their noise."""
        return scatter_of(np.abs(self.y))

    @cached_property
    def weights(self) -> FloatArray:
        """Standard deviations of amplitudes over that of a quadrature, (n,): less in the noise."""
        return self.scatter.weights if self.is_amplitude else np.ones(self.y.size)

    @property
    def known_noise(self) -> float | None:
        """Noise of a quadrature below amplitudes, 0 for none; None: it is solved for.

        It is where the record reaches it. Elsewhere it would be confused with the decay itself,
        and the scatter of the samples tells it.
        """
        if not self.floor:
            return 0.0
        if self.sigma > 0.0:
            return self.sigma
        return None if self.scatter.drowns else self.scatter.noise

    @property
    def row_sigma(self) -> float:
        """Standard deviation of its rows; zero where unknown."""
        return self.sigma / self.largest

    @property
    def solved_inside(self) -> int:
        """Number of unknowns that are solved for: amplitudes have no common phase."""
        if self.is_amplitude:
            return 2 * self.modes - 1 + (self.known_noise is None)
        return 2 * (self.modes + self.offset)

    def rows_of(self, values: FloatArray | ComplexArray) -> FloatArray:
        """Rows of values (n,): over the largest, phasors as all X, then all Y.

        Args:
            values: amplitudes or phasors, in ``unit``.
        """
        if self.is_amplitude:
            return np.asarray(values.real / (self.weights * self.largest))
        return np.concatenate([values.real, values.imag]) / self.largest

    def share_left(self, rows: FloatArray) -> float:
        """What rows leave, root mean square over the largest modulus; of phasors their distance.

        Args:
            rows: of this record, (rows,).
        """
        if self.is_amplitude:
            return float(np.sqrt(np.mean((rows * self.weights) ** 2)))
        return float(np.sqrt(2.0 * np.mean(rows**2)))

    def residual_curve(self, at: slice, rows: FloatArray) -> ResidualCurve:
        """Its residuals over time; of phasors real parts, then imaginary ones.

        Args:
            at: which rows of the measurement these are.
            rows: residuals, (rows,).
        """
        return ResidualCurve(
            rows=np.arange(at.start, at.stop),
            share=self.weights if self.is_amplitude else np.full(rows.size, np.sqrt(2.0)),
            axis=np.asarray(self.spacing_s * (np.arange(rows.size) % self.y.size), dtype=float),
            name=self.label,
        )

    # --- runs of the FMU ------------------------------------------------------------------------

    @cached_property
    def reference(self) -> Reference:
        """The reference, and how many samples of a run tell its sense of rotation."""
        return reference(self.frequency_hz, self.spacing_s)

    @property
    def has_own_steps(self) -> bool:
        """A step may be many periods: what it may not be is found by halving it."""
        return False

    @property
    def run_step_s(self) -> float:
        """Spacing of the samples of its runs, s."""
        return self.reference.step_s

    @property
    def run_samples(self) -> int:
        """How many samples its runs have."""
        return (self.y.size - 1) * self.reference.between + 1 + int(self.shifts[-1])

    @cached_property
    def shifts(self) -> IntArray:
        """Samples of a run by which the responses to a pulse are shifted against each other."""
        count = 2 * SHIFTS * self.modes
        most = max(count, self.y.size * self.reference.between // SHARE)
        return np.unique(np.append(0, np.round(np.geomspace(1.0, most, count)))).astype(np.intp)

    @property
    def pulse_window(self) -> Window:
        """Samples of the response to a pulse, as long as the record and its shifts."""
        return _pulse_window(self.run_step_s, self.run_samples)

    @property
    def sensing_window(self) -> Window:
        """Samples of a second response, which tells what turns forwards."""
        return _pulse_window(self.reference.sensing_step_s, SENSED)

    def sensing_pulse(self, per_sample: int) -> SampledSignal:
        """The pulse of the second response.

        Args:
            per_sample: steps between two samples.
        """
        return self.pulse(per_sample, window=self.sensing_window)


def _pulse_window(step_s: float, samples: int) -> Window:
    return Window(tones_hz=(), settle_s=step_s, step_s=step_s, samples=samples)
