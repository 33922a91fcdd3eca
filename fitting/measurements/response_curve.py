"""The steady response of an FMU over drive frequency, complex, at many parameter vectors.

Every kind of measurement that compares the response to single tones with a curve asks for it here,
be it for amplitudes or for both quadratures. Where the plan found the FMU linear, runs at a few
frequencies give the response at all of them: it is a rational function of the frequency. Whether it
was, to the tolerance of the plan, is checked at every parameter vector, and runs are added where it
was not, up to one at every frequency.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property

import numpy as np

from fitting.measurements.curve_plan import CurvePlan, DraftedCurve, Place
from fitting.measurements.driven_model import DrivenModel
from fitting.signal.window import Window
from fitting.simulate.batch import Batch, Variation, Workers
from fitting.text.arrays import ComplexArray, FloatArray, IntArray, Scalar

#: Yields whenever what it has asked of the batch is wanted; returns the response, (k, m) phasors.
Responding = Generator[None, None, ComplexArray]

#: Rounds of two more runs, at most.
ROUNDS = 8


@dataclass(frozen=True)
class ResponseCurve:
    """The response of one output to single tones, one after the other.

    Values are phasors P(u) in the output's unit, with the phase at the FMU's time 0:

        output(t) = mean + Re[P(u) exp(i 2 pi u t)]         in the steady state

    A linear FMU with the transfer function X(u), its answer to exp(+i 2 pi u t) (a resonance lags,
    by a quarter turn at its top), that drives itself by A cos(2 pi u t + phase) gives
    P = X(u) A exp(i phase), with the phase of its start values; a tone that is applied to an input
    has the phase 0. The amplitude A of the drive is in P.

    `settings` are those of the place; `label` is its label, None where it has none. Where the tool
    holds tones over steps, it does so as for `fastest_hz`, that what images of the steps add is a
    smooth function of the tone as well; None: as each tone itself wants it.
    """

    model: DrivenModel
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    output: str = ""
    _: KW_ONLY
    label: str | None = None
    fastest_hz: float | None = None

    @cached_property
    def place(self) -> Place:
        """What the plan knows it by."""
        output = self.output or self.model.setup.output
        return Place(output=output, settings=dict(self.settings), label=self.label)

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
        planned = self.model.plan.curve(self.place, frequency_hz)
        if planned is None or planned.runs >= frequency_hz.size:
            result = yield from self._simulated(table, first, frequency_hz, batch)
        else:
            points, place = np.unique(frequency_hz, return_inverse=True)
            curve = replace(self, fastest_hz=planned.high_hz)
            result = yield from curve._interpolated(table, first, points, batch, planned)
            result = result[:, place]
        return result[group]

    def ask(
        self,
        p: FloatArray,
        tones_hz: FloatArray,
        batch: Batch,
        owner: int = 0,
        part: float = 1.0,
    ) -> list[tuple[int, Window]]:
        """Ask for a run at each single tone: its number in the batch, and its window.

        Args:
            p: parameters (n,), each in its own unit.
            tones_hz: frequencies of the tones (m,), Hz.
            batch: where runs are asked for; equal runs are simulated once.
            owner: which evaluation pays for the runs.
            part: of the drive's amplitude.
        """
        tones = self._tones(map(self._window, tones_hz[:, np.newaxis]), part)
        return self._asked(self._start_values(p, part), tones, batch, owner)

    def windows(self, planned: CurvePlan) -> list[Window]:
        """Settling and samples of the runs of a plan at the full drive, by its `groups`.

        Args:
            planned: frequencies and tones of the runs.

        Raises:
            BadInput: no samples keep the tones of a run apart.
        """
        return [self._window(planned.nodes_hz[group]) for group in planned.groups]

    def _window(self, tones_hz: FloatArray) -> Window:
        tones = tuple(map(float, tones_hz))
        if len(tones) == 1 and not (self.fastest_hz and self.model.holds_tones):
            return self.model.single_tone_window(tones[0])
        return self.model.superposed_window(tones, self.fastest_hz or max(tones))

    def ask_nodes(self, p: FloatArray, windows: Sequence[Window], batch: Batch) -> list[int]:
        """Ask for the runs of a plan at the full drive: their numbers in the batch.

        Args:
            p: parameters (n,), each in its own unit.
            windows: of the runs, as `windows` gave them.
            batch: where runs are asked for; equal runs are simulated once.
        """
        start = self._start_values(p, count=len(windows[0].tones_hz))
        return [run for run, _ in self._asked(start, self._tones(windows), batch, 0)]

    def ask_alone(self, p: FloatArray, window: Window, batch: Batch) -> list[int]:
        """Ask for a run at each tone of a window, without the others: numbers in the batch.

        A drive that is held is so over the same steps as with all of them.

        Args:
            p: parameters (n,), each in its own unit.
            window: settling and samples of the run with all of them.
            batch: where runs are asked for; equal runs are simulated once.
        """
        tones = [
            Variation(self.model.tone_values((tone,)), window, self.model.signal(window, (tone,)))
            for tone in window.tones_hz
        ]
        return batch.ask_varied(self._start_values(p), tones, self.place.output, 0)

    def _tones(self, windows: Iterable[Window], part: float = 1.0) -> list[Variation]:
        """What runs of these windows have of their own, whatever the parameters are."""
        result = []
        for window in windows:
            signal = self.model.signal(window, window.tones_hz, part)
            result.append(Variation(self.model.tone_values(window.tones_hz), window, signal))
        return result

    def _start_values(self, p: FloatArray, part: float = 1.0, count: int = 1) -> dict[str, Scalar]:
        """What runs at so many tones have in common."""
        values = self.model.values(p, self.label, self.settings)
        if part != 1.0:
            values = self.model.with_part(part, values)
        return self.model.tones_of(values, count)

    def _asked(
        self, values: dict[str, Scalar], tones: Sequence[Variation], batch: Batch, owner: int
    ) -> list[tuple[int, Window]]:
        runs = batch.ask_varied(values, tones, self.place.output, owner)
        return [(run, tone.window) for run, tone in zip(runs, tones, strict=True)]

    def read(self, batch: Batch, requested: Sequence[tuple[int, Window]]) -> ComplexArray:
        """Phasors (m,) of runs that were simulated.

        Args:
            batch: that has simulated them.
            requested: runs and windows, as `ask` gave them.
        """
        result = [batch.phasors(k, window, self.place.output) for k, window in requested]
        return np.concatenate(result) if result else np.empty(0, dtype=complex)

    def simulated(
        self, p: FloatArray, frequency_hz: FloatArray, workers: Workers, part: float = 1.0
    ) -> ComplexArray:
        """Phasors (m,) by a run each, at one parameter vector.

        Args:
            p: parameters (n,), each in its own unit.
            frequency_hz: frequencies of the tones (m,), Hz.
            workers: processes that run the FMU.
            part: of the drive's amplitude.
        """
        batch = Batch()
        requested = self.ask(p, frequency_hz, batch, part=part)
        batch.simulate(workers)
        return self.read(batch, requested)

    def _simulated(
        self, table: FloatArray, first: IntArray, points: FloatArray, batch: Batch
    ) -> Responding:
        """By a run at each frequency."""
        requested = [self.ask(table[k], points, batch, int(k)) for k in first]
        yield
        result = [self.read(batch, each) for each in requested]
        return np.array(result).reshape(len(result), points.size)

    def _interpolated(
        self,
        table: FloatArray,
        first: IntArray,
        points: FloatArray,
        batch: Batch,
        planned: CurvePlan,
    ) -> Responding:
        """By the plan's runs, by more where a check says so, by all where that does not help."""
        count, windows = planned.tones, self.windows(planned)
        tones, half_tones = self._tones(windows), self._tones([windows[planned.half_run]], 0.5)
        requested, halves = [], []
        for k in map(int, first):
            whole, half = (self._start_values(table[k], part, count) for part in (1.0, 0.5))
            requested.append(self._asked(whole, tones, batch, k))
            halves.append(self._asked(half, half_tones, batch, k))
        yield
        values = planned.in_order(np.array([self.read(batch, runs) for runs in requested]))
        half_values = planned.at_half(np.array([self.read(batch, run) for run in halves]))
        result, known = planned.drafted(points, values, half_values)
        rest = np.flatnonzero(~known)
        if rest.size and count > 1:  # once more as if nothing were known of several tones
            alone = planned.of_single_tones
            result[rest] = yield from self._interpolated(table, first[rest], points, batch, alone)
        elif rest.size:
            drafts = [
                DraftedCurve(
                    points=points,
                    tolerance=planned.tolerance,
                    curve=planned.interpolation(values[i]),
                    half_hz=planned.half_hz,
                    half=complex(half_values[i]),
                )
                for i in rest
            ]
            result[rest] = yield from self._mended(table, first[rest], batch, drafts)
        return result

    def _mended(
        self, table: FloatArray, first: IntArray, batch: Batch, drafts: list[DraftedCurve]
    ) -> Responding:
        """Drafts that are not known: by more runs, by all where that does not help."""
        for _ in range(ROUNDS):
            open_ = [i for i, draft in enumerate(drafts) if draft.may_become_known]
            if not open_:
                break
            wanted = [drafts[i].wanted_hz for i in open_]
            more = [
                self.ask(table[first[i]], np.array(f), batch, int(first[i]), part)
                for i, (f, part) in zip(open_, wanted, strict=True)
            ]
            yield
            for i, (f, _), runs in zip(open_, wanted, more, strict=True):
                drafts[i] = drafts[i].with_values(f, self.read(batch, runs))
        rest = [i for i, draft in enumerate(drafts) if not draft.is_known]
        result = np.array([draft.values for draft in drafts])
        if rest:
            points = drafts[0].points
            result[rest] = yield from self._simulated(table, first[rest], points, batch)
        return result
