"""The FMU as a `Response`: a campaign's parameters become batches of simulations.

One batch holds every run of every parameter vector that was asked for, so that the workers are
busy together and one message each way is enough. Answers depend on the parameters alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from fitting.campaign import BoundCampaign
from fitting.fmu import InputSignal, Run
from fitting.measurements.planning import Plan
from fitting.measurements.response import Evaluation
from fitting.signal.combinations import mixed_hz
from fitting.signal.scale import Maximum, nodes_around, refine_maximum
from fitting.signal.window import Window, plan_window, tone_misfit
from fitting.simulate.batch import Batch, Workers, alike
from fitting.text.arrays import FloatArray, IntArray, Scalar
from fitting.text.units import convert

#: Batches of further sweep points, at most, to bracket a maximum or to lower its bias.
SEARCH_ROUNDS = 12


@lru_cache(maxsize=4096)
def _single_tone(tone_hz: float, settle_s: float, held: int, order: int) -> Window:
    """Window of one sweep point, planned once: the same points come back in every evaluation."""
    return plan_window(
        (tone_hz,), settle_s, samples_per_period=held, mixtures_hz=mixed_hz((tone_hz,), order)
    )


@lru_cache(maxsize=4096)
def _in_unit(tone_hz: float, unit: str) -> float:
    return convert(tone_hz, "Hz", unit, where="[sweep] frequency")


@dataclass(frozen=True)
class FmuResponse:
    """`Response` of a bound campaign through FMU workers, for one alternative.

    Of one batch equal runs are simulated once: a parameter of one experiment costs a run, not a
    series, and two outputs under the same drive share one.
    """

    bound: BoundCampaign
    workers: Workers
    plan: Plan
    alternative: Mapping[str, Scalar]

    def evaluate_many(self, ps: Sequence[FloatArray]) -> list[Evaluation]:
        """Peaks, sweep and sweep maximum of every parameter vector, in one batch.

        A run that several vectors share counts for the first of them.
        """
        table = np.array([np.asarray(p, dtype=float) for p in ps])
        batch = Batch()
        asked = self._ask_experiments(batch, table)
        nodes, whole = self._nodes(), self._whole_sweep()
        first, group = alike(table[:, self._columns(None)])
        windows = [self._sweep_window(float(tone)) for tone in (*nodes, *whole)]
        swept = [[self._ask_sweep(batch, table[k], w, int(k)) for w in windows] for k in first]
        batch.simulate(self.workers)
        peaks = self._peaks(batch, asked, len(table))
        sweeps = np.array([self._read_sweep(batch, ks, windows) for ks in swept])
        sweeps = sweeps.reshape(len(first), -1)
        maxima = self._maxima(list(table[first]), nodes, list(sweeps[:, : len(nodes)]))
        runs = batch.count(len(table))
        for k, found in zip(first, maxima, strict=True):
            runs[k] += found[1]
        return [
            Evaluation(peaks[k], sweeps[g, len(nodes) :], maxima[g][0], int(runs[k]))
            for k, g in enumerate(group)
        ]

    def peaks(self, p: FloatArray) -> FloatArray:
        """Amplitudes at the tones of all experiments, shape (n_peaks,), in the FMU's unit."""
        batch, table = Batch(), np.atleast_2d(np.asarray(p, dtype=float))
        asked = self._ask_experiments(batch, table)
        batch.simulate(self.workers)
        return np.asarray(self._peaks(batch, asked, 1)[0])

    def sweep(self, p: FloatArray) -> FloatArray:
        """Amplitudes at the laboratory's sweep frequencies, shape (n_sweep,), FMU's unit."""
        if self.bound.sweep is None:
            return np.empty(0)
        return self.amplitudes_at(p, self.bound.sweep.frequency_hz)

    def amplitudes_at(self, p: FloatArray, frequency_hz: FloatArray) -> FloatArray:
        """Steady amplitudes at single tones with the settings of the sweep, shape (n,)."""
        return self._swept_many([p], [frequency_hz])[0]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        """Derived outputs after initialisation, per experiment (the sweep, if there is none)."""
        names = self.bound.derived
        places = [(e.label, e.settings) for e in self.bound.experiments]
        if not places and self.bound.sweep is not None:
            places = [("", self.bound.sweep.settings)]
        if not names:
            return [{} for _ in ps]
        table = np.array([np.asarray(p, dtype=float) for p in ps])
        groups = [alike(table[:, self._columns(label)]) for label, _ in places]
        runs = [
            Run(self.values(table[k], label, place), 0.0, 1.0, 1, names, allow_nan=True)
            for (label, place), (first, _) in zip(places, groups, strict=True)
            for k in first
        ]
        answers = iter(self.workers.run(runs))
        columns = [
            np.array([next(answers)[0] for _ in first])[group] for first, group in groups
        ]  # (p, outputs) per place
        values = np.stack(columns, axis=1)
        return [{name: values[k, :, i] for i, name in enumerate(names)} for k in range(len(table))]

    def misfit(self, p: FloatArray) -> float:
        """Largest relative deviation of any sampled run from mean plus tones (see `plan`)."""
        batch, table = Batch(), np.atleast_2d(np.asarray(p, dtype=float))
        asked = self._ask_experiments(batch, table)
        read = [(w, o, ks[0]) for (w, o), (ks, _) in zip(self._observed(), asked, strict=True)]
        if self.bound.sweep is not None:
            window = self._sweep_window(float(self.bound.sweep.frequency_hz[0]))
            read.append(
                (window, self.bound.setup.output, self._ask_sweep(batch, table[0], window, 0))
            )
        batch.simulate(self.workers)
        return max((tone_misfit(w, batch.samples(k, o)) for w, o, k in read), default=0.0)

    def undriven(self, p: FloatArray) -> float:
        """Range of the output without any tone of the campaign, over the range with them."""
        if not self.plan.experiments:
            return 0.0
        silent, driven = (self._range(p, level) for level in (0.0, self.bound.setup.drive.level))
        return silent / driven if driven > 0.0 else 0.0

    def _range(self, p: FloatArray, level: float) -> float:
        """Range of the first experiment's samples with the drive at that level."""
        drive = replace(self.bound.setup.drive, level=level)
        experiment = self.bound.experiments[0]
        if not level:  # also where the experiment has a level of its own
            own = {n: 0.0 for n in drive.amplitudes if n in experiment.settings}
            experiment = replace(experiment, settings={**experiment.settings, **own})
        bound = replace(
            self.bound,
            setup=replace(self.bound.setup, drive=drive),
            experiments=(experiment,),
        )
        one = replace(
            self, bound=bound, plan=replace(self.plan, experiments=self.plan.experiments[:1])
        )
        batch = Batch()
        ((ks, _),) = one._ask_experiments(batch, np.atleast_2d(p))
        batch.simulate(self.workers)
        return float(np.ptp(batch.samples(ks[0], one._observed()[0][1])))

    def _nodes(self) -> FloatArray:
        return np.array(self.plan.nodes_hz)

    def _whole_sweep(self) -> FloatArray:
        sweep = self.bound.sweep
        if sweep is None or (sweep.use != "fit" and sweep.scale in ("maximum", "none")):
            return np.empty(0)
        return sweep.frequency_hz

    def _observed(self) -> list[tuple[Window, str]]:
        """Window and output of every experiment."""
        outputs = (e.output or self.bound.setup.output for e in self.bound.experiments)
        return list(zip(self.plan.experiments, outputs, strict=True))

    @cached_property
    def _acting(self) -> dict[str | None, list[int]]:
        """Positions of the FMU's parameters that act in an experiment, by its label; None: all."""
        model = [(i, q) for i, q in enumerate(self.bound.parameters) if q.role == "model"]
        everywhere = [i for i, q in model if not q.experiments]
        acting: dict[str | None, list[int]] = {None: everywhere}
        for i, parameter in model:
            for label in parameter.experiments:
                acting.setdefault(label, list(everywhere)).append(i)
        return acting

    def _columns(self, label: str | None) -> list[int]:
        """Positions in p of what acts in an experiment; None: in the sweep."""
        return self._acting.get(label, self._acting[None])

    def _ask_experiments(self, batch: Batch, table: FloatArray) -> list[tuple[list[int], IntArray]]:
        """Per experiment the runs that answer it, and which of them belongs to each row."""
        asked = []
        for e, (window, output) in zip(self.bound.experiments, self._observed(), strict=True):
            first, group = alike(table[:, self._columns(e.label)])
            signal = self._signal(window, e.tones_hz)
            runs = [
                batch.ask(self.values(table[k], e.label, e.settings), window, signal, output, k)
                for k in map(int, first)
            ]
            asked.append((runs, group))
        return asked

    def _peaks(
        self, batch: Batch, asked: Sequence[tuple[list[int], IntArray]], rows: int
    ) -> FloatArray:
        """Amplitudes of all experiments for every row, shape (rows, n_peaks)."""
        columns = [
            np.array([batch.amplitudes(k, window, output) for k in ks])[group]
            for (window, output), (ks, group) in zip(self._observed(), asked, strict=True)
        ]
        return np.concatenate(columns, axis=1) if columns else np.empty((rows, 0))

    def sweep_values(self, p: FloatArray, tone_hz: float) -> dict[str, Scalar]:
        """Start values at one point of the sweep: its tone, the other amplitudes zero."""
        drive, sweep = self.bound.setup.drive, self.bound.sweep
        values = self.values(p, None, sweep.settings if sweep is not None else {})
        if drive.kind == "tones":
            values[drive.frequencies[0]] = _in_unit(tone_hz, drive.frequency_unit)
            values.update(dict.fromkeys(drive.amplitudes[1:], 0.0))
        return values

    def _ask_sweep(self, batch: Batch, p: FloatArray, window: Window, owner: int) -> int:
        values = self.sweep_values(p, window.tones_hz[0])
        return batch.ask(
            values, window, self._signal(window, window.tones_hz), self.bound.setup.output, owner
        )

    def _read_sweep(self, batch: Batch, ks: Sequence[int], windows: Sequence[Window]) -> FloatArray:
        found = [
            batch.amplitudes(k, w, self.bound.setup.output)
            for k, w in zip(ks, windows, strict=True)
        ]
        return np.concatenate(found) if found else np.empty(0)

    def _swept_many(
        self, ps: Sequence[FloatArray], frequencies: Sequence[FloatArray]
    ) -> list[FloatArray]:
        """Single-tone amplitudes of several p, each at its own frequencies, in one batch."""
        batch = Batch()
        windows = [[self._sweep_window(float(tone)) for tone in f] for f in frequencies]
        asked = [
            [self._ask_sweep(batch, p, w, 0) for w in ws] for p, ws in zip(ps, windows, strict=True)
        ]
        batch.simulate(self.workers)
        return [self._read_sweep(batch, ks, ws) for ks, ws in zip(asked, windows, strict=True)]

    def _signal(self, window: Window, tones_hz: Sequence[float]) -> InputSignal | None:
        drive = self.bound.setup.drive
        if drive.kind != "input" or drive.input is None:
            return None
        rows = tuple((tone, drive.level, 0.0) for tone in tones_hz)
        return InputSignal(drive.input, rows, window.input_step_s)

    def values(
        self, p: FloatArray, label: str | None, settings: Mapping[str, Scalar]
    ) -> dict[str, Scalar]:
        """Start values: campaign's, plan's, alternative's, experiment's, then the fitted ones."""
        values: dict[str, Scalar] = {**self.bound.setup.start_values, **self.plan.settings}
        values.update(
            dict.fromkeys(self.bound.setup.drive.amplitudes, self.bound.setup.drive.level)
        )
        values.update(self.alternative)
        values.update(settings)
        acting = [(self.bound.parameters[i], float(p[i])) for i in self._columns(label)]
        values.update({q.target: value for q, value in acting if not q.adds_to})
        for parameter, value in acting:
            for name in parameter.adds_to:
                values[name] = float(values[name]) + value
        return values

    def _sweep_window(self, tone_hz: float) -> Window:
        drive = self.bound.setup.drive
        held = drive.samples_per_period if drive.kind == "input" else 0
        return _single_tone(tone_hz, self.plan.settle_s, held, drive.order)

    def _maxima(
        self, ps: Sequence[FloatArray], nodes: FloatArray, amplitudes: Sequence[FloatArray]
    ) -> list[tuple[Maximum | None, int]]:
        """Maximum and number of further runs of every p; nodes are added until it is good."""
        if nodes.size == 0:
            return [(None, 0) for _ in ps]
        searches = [_Search(nodes, a, bend=self.plan.maximum_bend) for a in amplitudes]
        for _ in range(SEARCH_ROUNDS):
            more = [s.wanted(self.plan.maximum_bias or self.bound.setup.accuracy) for s in searches]
            if not any(m.size for m in more):
                break
            found = self._swept_many(ps, more)
            searches = [s.with_points(f, a) for s, f, a in zip(searches, more, found, strict=True)]
        return [(s.maximum, s.added) for s in searches]


@dataclass(frozen=True)
class _Search:
    """Sweep points about a maximum that is looked for; `added` counts those beyond the first."""

    frequency_hz: FloatArray
    amplitude: FloatArray
    added: int = 0
    bend: float | None = None

    @cached_property
    def maximum(self) -> Maximum:
        return refine_maximum(self.frequency_hz, self.amplitude, self.bend)

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
