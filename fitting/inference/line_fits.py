"""The one place where inference fits lines to measurements, without the FMU; each fit once.

Amplitudes are those of one line with a background, or of a pair; complex values are lines
side by side on a background; free decays are sums of decaying lines.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from fitting.lines.decay_model import Decays, fit_decays
from fitting.lines.decay_record import SAMPLES
from fitting.lines.form import LineFit, fit_resonance
from fitting.lines.names import FLOOR, OFFSET, RICE, SLOPE
from fitting.lines.pair import Pair, bent_line, pair_of
from fitting.lines.solve import Fit
from fitting.measurements.traces.record import TraceRecord
from fitting.signal.complex_line import complex_line
from fitting.signal.lines_together import LinesTogether, lines_together
from fitting.signal.residual_tests import Structure, residual_structure
from fitting.text.arrays import ComplexArray, FloatArray, both_parts
from fitting.text.errors import BadInput

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


def pair(frequency_hz: FloatArray, amplitude: FloatArray) -> Pair | None:
    """Two lines that leave noise and whose tops the points show; None where there are none.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        amplitude: shape (n,), any unit.
    """
    two = pair_of(frequency_hz, amplitude)
    return two if two is not None and two.is_noise and two.is_seen(frequency_hz) else None


def single_lines(
    frequency_hz: FloatArray, values: FloatArray | ComplexArray
) -> Iterator[tuple[float, int]]:
    """Squares over the largest value, and unknowns, of single lines that look like a pair.

    A line that bends with its amplitude; of complex values one behind the delay of a cable.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes, or complex values, shape (n,), any unit.
    """
    yield bent_line(frequency_hz, values)
    if np.iscomplexobj(values):
        line = complex_line(frequency_hz, np.asarray(values, dtype=complex), None)
        yield line.left**2 * values.size, 7


class ComplexLines:
    """Lines side by side in complex values over the largest one, on a polynomial background."""

    def __init__(
        self, frequency_hz: FloatArray, values: ComplexArray, lines: int, columns: int
    ) -> None:
        self.frequency_hz, self.values = frequency_hz, values
        self.fit: LinesTogether = lines_together(frequency_hz, values, lines, lines + columns - 1)

    @cached_property
    def structure(self) -> Structure:
        """Of the residuals, both parts of all coefficients solved for."""
        columns = self.fit.columns
        real = np.concatenate(
            [np.hstack([columns.real, -columns.imag]), np.hstack([columns.imag, columns.real])]
        )
        return residual_structure(both_parts(self.fit.curve - self.values), real)

    @property
    def observed(self) -> int:
        """Poles that the points show as lines, all of them turning the same way; else none."""
        modes = [mode for mode in self.fit.modes if mode.is_seen(self.frequency_hz)]
        return len(modes) if len({mode.width_hz > 0.0 for mode in modes}) == 1 else 0

    @property
    def tails(self) -> int:
        """Poles beyond the points that are no lines among them."""
        low, high = self.frequency_hz[0], self.frequency_hz[-1]
        return sum(
            not (low < mode.frequency_hz < high or mode.is_seen(self.frequency_hz))
            for mode in self.fit.modes
        )

    @property
    def all_observed(self) -> bool:
        """Whether the points show every pole as a line."""
        return all(mode.is_seen(self.frequency_hz) for mode in self.fit.modes)


class DecayingLines:
    """So many decaying lines of a free decay's first samples, over the largest one."""

    def __init__(self, trace: TraceRecord, count: int) -> None:
        """Fit them.

        Raises:
            ValueError: one that hardly oscillates.
        """
        values = np.asarray(trace.y[:MOST_SAMPLES] / trace.largest)
        model = Decays(samples=values.size, kind=SAMPLES, lines=count, constant=trace.offset)
        self.fit: Fit = fit_decays(model, values)
        turns = np.sort(np.abs(self.fit.x[::2]))
        self.frequencies_hz = tuple(float(f) for f in turns / (values.size * trace.spacing_s))
        linear = self.fit.jacobian[:, model.count :]
        self.structure = residual_structure(self.fit.residuals, linear)
