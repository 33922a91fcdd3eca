"""The steady response of an FMU over drive frequency, complex, at many parameter vectors.

Every kind of measurement that compares the response to single tones with a curve asks for it here,
be it for amplitudes or for both quadratures.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field

import numpy as np

from fitting.measurements.driven_model import DrivenModel
from fitting.signal.window import Window
from fitting.simulate.batch import Batch
from fitting.text.arrays import ComplexArray, FloatArray, Scalar

#: Yields whenever what it has asked of the batch is wanted; returns the response, (k, m) phasors.
Responding = Generator[None, None, ComplexArray]


@dataclass(frozen=True)
class ResponseCurve:
    """The response of one output to single tones, one after the other.

    Values are phasors P(u) in the output's unit, with the phase at the FMU's time 0:

        output(t) = mean + Re[P(u) exp(i 2 pi u t)]         in the steady state

    A linear FMU with the transfer function X(u), its answer to exp(+i 2 pi u t) (a resonance lags,
    by a quarter turn at its top), that drives itself by A cos(2 pi u t + phase) gives
    P = X(u) A exp(i phase), with the phase of its start values; a tone that is applied to an input
    has the phase 0. The amplitude A of the drive is in P.

    `settings` are those of the place; `label` is its label, None where it has none.
    """

    model: DrivenModel
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    output: str = ""
    _: KW_ONLY
    label: str | None = None

    def predict(self, table: FloatArray, frequency_hz: FloatArray, batch: Batch) -> Responding:
        """Ask the batch for runs, yield for their answers as often as needed, return phasors.

            curve = ResponseCurve(model, settings, output)
            phasors = yield from curve.predict(table, frequency_hz, batch)

        Several curves share the rounds of one batch where they are stepped together (`together`).

        Args:
            table: parameter vectors, shape (k, n), in the parameters' units.
            frequency_hz: of the single tones, shape (m,), Hz.
            batch: where runs are asked for; equal runs are simulated once.

        Returns:
            Phasors, complex, shape (k, m), in the unit of the output.
        """
        first, group = self.model.groups(table, self.label)
        asked = [self._ask(table[k], frequency_hz, batch, int(k)) for k in first]
        yield
        found = [self._read(batch, each) for each in asked]
        return np.array(found).reshape(len(first), -1)[group]

    def _ask(
        self, p: FloatArray, tones_hz: FloatArray, batch: Batch, owner: int
    ) -> list[tuple[int, Window]]:
        """Runs and windows at single tones."""
        asked = []
        for tone in map(float, tones_hz):
            window = self.model.single_tone_window(tone)
            values = self.model.single_tone_values(p, self.settings, tone, self.label)
            signal = self.model.signal(window, window.tones_hz)
            asked.append((batch.ask(values, window, signal, self._output, owner), window))
        return asked

    def _read(self, batch: Batch, asked: Sequence[tuple[int, Window]]) -> ComplexArray:
        found = [batch.phasors(k, window, self._output) for k, window in asked]
        return np.concatenate(found) if found else np.empty(0, dtype=complex)

    @property
    def _output(self) -> str:
        return self.output or self.model.setup.output


def together(tasks: Sequence[Responding]) -> Generator[None, None, list[ComplexArray]]:
    """Step several predictions of one batch side by side, so that they share its rounds.

        phasors = yield from together([c.predict(table, f, batch) for c, f in curves])

    Args:
        tasks: predictions of curves, not yet begun.

    Returns:
        What each of them returns, in their order.
    """
    found: dict[int, ComplexArray] = {}
    while True:
        for k, task in enumerate(tasks):
            if k not in found:
                try:
                    next(task)
                except StopIteration as ended:
                    found[k] = ended.value
        if len(found) == len(tasks):
            return [found[k] for k in range(len(tasks))]
        yield
