"""The FMU as a `Response`: a campaign's parameters become batches of simulations.

One batch holds every run of every parameter vector that was asked for, so that the workers are
busy together and one message each way is enough. Answers depend on the parameters alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np
import numpy.typing as npt

from fitting.combinations import mixed_hz
from fitting.fmu import InputSignal, Run
from fitting.labdata import BoundCampaign
from fitting.plan import Window, plan_window, tone_amplitudes, tone_misfit
from fitting.planning import Plan
from fitting.response import Evaluation
from fitting.scaling import Maximum, nodes_around, refine_maximum
from fitting.units import convert

FloatArray = npt.NDArray[np.float64]
Scalar = float | int | bool | str

#: Batches of further sweep points, at most, to bracket a maximum or to lower its bias.
SEARCH_ROUNDS = 12


class Workers(Protocol):
    """What is needed of `fitting.fmu.FmuWorkers`."""

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Outputs of each run, shape (samples, outputs)."""
        ...


@lru_cache(maxsize=4096)
def _single_tone(tone_hz: float, settle_s: float, held: int, order: int) -> Window:
    """Window of one sweep point, planned once: the same points come back in every evaluation."""
    return plan_window(
        (tone_hz,), settle_s, samples_per_period=held, beside_hz=mixed_hz((tone_hz,), order)
    )


@lru_cache(maxsize=4096)
def _in_unit(tone_hz: float, unit: str) -> float:
    return convert(tone_hz, "Hz", unit, where="[sweep] frequency")


@dataclass(frozen=True)
class FmuResponse:
    """`fitting.response.Response` of a bound campaign through FMU workers, for one alternative."""

    bound: BoundCampaign
    workers: Workers
    plan: Plan
    alternative: Mapping[str, Scalar]

    def evaluate_many(self, ps: Sequence[FloatArray]) -> list[Evaluation]:
        """Peaks, sweep and sweep maximum of every parameter vector, in one batch."""
        nodes = self._nodes()
        whole = self._whole_sweep()
        tones = [*nodes, *whole]
        windows = [self._sweep_window(tone) for tone in tones]
        runs = [run for p in ps for run in self._runs(p, windows)]
        answers = self.workers.run(runs)
        per_p = len(self.plan.experiments) + len(windows)
        first: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        for k in range(len(ps)):
            peaks, sweep = self._read(answers[k * per_p : (k + 1) * per_p], windows)
            first.append((peaks, sweep[: len(nodes)], sweep[len(nodes) :]))
        maxima = self._maxima(ps, nodes, [f[1] for f in first])
        return [
            Evaluation(peaks, swept, found[0], per_p + found[1])
            for (peaks, _, swept), found in zip(first, maxima, strict=True)
        ]

    def peaks(self, p: FloatArray) -> FloatArray:
        """Amplitudes at the tones of all experiments, shape (n_peaks,), in the FMU's unit."""
        return self._read(self.workers.run(self._runs(p, [])), [])[0]

    def sweep(self, p: FloatArray) -> FloatArray:
        """Amplitudes at the laboratory's sweep frequencies, shape (n_sweep,), FMU's unit."""
        if self.bound.sweep is None:
            return np.empty(0)
        return self.amplitudes_at(p, self.bound.sweep.frequency_hz)

    def amplitudes_at(self, p: FloatArray, frequency_hz: FloatArray) -> FloatArray:
        """Steady amplitudes at single tones with the settings of the sweep, shape (n,)."""
        windows = [self._sweep_window(float(tone)) for tone in frequency_hz]
        answers = self.workers.run([self._sweep_run(p, window) for window in windows])
        return self._amplitudes(windows, answers)

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        """Derived outputs after initialisation, per experiment (the sweep, if there is none)."""
        names = self.bound.derived
        places: list[Mapping[str, Scalar]] = [e.settings for e in self.bound.experiments]
        if not places and self.bound.sweep is not None:
            places = [self.bound.sweep.settings]
        if not names:
            return [{} for _ in ps]
        runs = [
            Run(self._values(p, place), 0.0, 1.0, 1, names, allow_nan=True)
            for p in ps
            for place in places
        ]
        answers = self.workers.run(runs)
        table = np.array([answer[0] for answer in answers]).reshape(len(ps), len(places), -1)
        return [{name: table[k, :, i] for i, name in enumerate(names)} for k in range(len(ps))]

    def misfit(self, p: FloatArray) -> float:
        """Largest relative deviation of any sampled run from mean plus tones (see `plan`)."""
        sweep = self.bound.sweep
        windows = [] if sweep is None else [self._sweep_window(float(sweep.frequency_hz[0]))]
        answers = self.workers.run(self._runs(p, windows))
        everything = [*self.plan.experiments, *windows]
        misfits = [tone_misfit(w, a[:, 0]) for w, a in zip(everything, answers, strict=True)]
        return max(misfits, default=0.0)

    def _nodes(self) -> FloatArray:
        return np.array(self.plan.nodes_hz)

    def _whole_sweep(self) -> FloatArray:
        sweep = self.bound.sweep
        if sweep is None or (sweep.use != "fit" and sweep.scale != "fit"):
            return np.empty(0)
        return sweep.frequency_hz

    def _runs(self, p: FloatArray, sweep_windows: Sequence[Window]) -> list[Run]:
        pairs = zip(self.bound.experiments, self.plan.experiments, strict=True)
        runs = [self._run(self._values(p, e.settings), w, e.tones_hz) for e, w in pairs]
        return runs + [self._sweep_run(p, window) for window in sweep_windows]

    def _sweep_run(self, p: FloatArray, window: Window) -> Run:
        drive, sweep = self.bound.drive, self.bound.sweep
        values = self._values(p, sweep.settings if sweep is not None else {})
        if drive.kind == "tones":
            unit = drive.frequency_unit
            values[drive.frequencies[0]] = _in_unit(window.tones_hz[0], unit)
            values.update(dict.fromkeys(drive.amplitudes[1:], 0.0))
        return self._run(values, window, window.tones_hz)

    def _run(self, values: dict[str, Scalar], window: Window, tones: Sequence[float]) -> Run:
        drive = self.bound.drive
        signal = None
        if drive.kind == "input" and drive.input is not None:
            rows = tuple((tone, drive.level, 0.0) for tone in tones)
            signal = InputSignal(drive.input, rows, window.input_step_s)
        return Run(
            values, window.settle_s, window.step_s, window.samples, (self.bound.output,),
            input_signal=signal,
        )  # fmt: skip

    def _values(self, p: FloatArray, settings: Mapping[str, Scalar]) -> dict[str, Scalar]:
        """Start values: campaign's, plan's, alternative's, experiment's, then the fitted ones."""
        values: dict[str, Scalar] = {**self.bound.start_values, **self.plan.settings}
        values.update(dict.fromkeys(self.bound.drive.amplitudes, self.bound.drive.level))
        values.update(self.alternative)
        values.update(settings)
        fitted = zip(self.bound.parameters, p, strict=True)
        values.update({parameter.name: float(value) for parameter, value in fitted})
        return values

    def _sweep_window(self, tone_hz: float) -> Window:
        drive = self.bound.drive
        held = drive.samples_per_period if drive.kind == "input" else 0
        return _single_tone(tone_hz, self.plan.settle_s, held, drive.order)

    def _read(
        self, answers: Sequence[FloatArray], sweep_windows: Sequence[Window]
    ) -> tuple[FloatArray, FloatArray]:
        count = len(self.plan.experiments)
        peaks = self._amplitudes(self.plan.experiments, answers[:count])
        return peaks, self._amplitudes(sweep_windows, answers[count:])

    @staticmethod
    def _amplitudes(windows: Sequence[Window], answers: Sequence[FloatArray]) -> FloatArray:
        found = [tone_amplitudes(w, a[:, 0]) for w, a in zip(windows, answers, strict=True)]
        return np.concatenate(found) if found else np.empty(0)

    def _maxima(
        self, ps: Sequence[FloatArray], nodes: FloatArray, amplitudes: Sequence[FloatArray]
    ) -> list[tuple[Maximum | None, int]]:
        """Maximum and number of further runs of every p; nodes are added until it is good."""
        if nodes.size == 0:
            return [(None, 0) for _ in ps]
        searches = [_Search(nodes, a) for a in amplitudes]
        for _ in range(SEARCH_ROUNDS):
            more = [s.wanted(self.bound.accuracy) for s in searches]
            if not any(m.size for m in more):
                break
            windows = [[self._sweep_window(float(tone)) for tone in m] for m in more]
            runs = [self._sweep_run(p, w) for p, ws in zip(ps, windows, strict=True) for w in ws]
            answers = iter(self.workers.run(runs))
            for k, ws in enumerate(windows):
                found = self._amplitudes(ws, [next(answers) for _ in ws])
                searches[k] = searches[k].with_points(more[k], found)
        return [(s.maximum, s.added) for s in searches]


@dataclass(frozen=True)
class _Search:
    """Sweep points about a maximum that is looked for; `added` counts those beyond the first."""

    frequency_hz: FloatArray
    amplitude: FloatArray
    added: int = 0

    @cached_property
    def maximum(self) -> Maximum:
        return refine_maximum(self.frequency_hz, self.amplitude)

    def wanted(self, accuracy: float) -> FloatArray:
        """Frequencies to add: beyond the end that rises, or closer about the maximum."""
        found = self.maximum
        f = self.frequency_hz
        if not found.bracketed:
            span = float(np.ptp(f))
            centre = found.frequency_hz
            side = -1.0 if centre == f[0] else 1.0
            steps = centre + side * span * np.array([0.25, 0.5, 1.0, 2.0])
            return np.asarray(steps[steps > 0.0])
        if found.bias <= accuracy:
            return np.empty(0)
        k = int(np.argmax(self.amplitude))
        spacing = 0.25 * float(min(f[k] - f[k - 1], f[k + 1] - f[k]))
        near = nodes_around(found.frequency_hz, spacing)
        return near[~np.isin(near, f)]

    def with_points(self, frequency_hz: FloatArray, amplitude: FloatArray) -> _Search:
        f = np.concatenate([self.frequency_hz, frequency_hz])
        a = np.concatenate([self.amplitude, amplitude])
        order = np.argsort(f)
        return replace(
            self, frequency_hz=f[order], amplitude=a[order], added=self.added + frequency_hz.size
        )
