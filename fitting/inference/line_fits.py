"""Lines that inference fits to measurements without the FMU: of sweeps each once, of decays."""

from __future__ import annotations

import numpy as np

from fitting.lines.decay_model import Decays, fit_decays
from fitting.lines.decay_record import SAMPLES
from fitting.lines.form import LineFit, fit_resonance
from fitting.lines.names import FLOOR, OFFSET, RICE, SLOPE
from fitting.lines.solve import Fit
from fitting.measurements.traces.record import TraceRecord
from fitting.signal.residual_tests import residual_structure
from fitting.text.arrays import FloatArray
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
