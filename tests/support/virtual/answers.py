"""The closed form of `modes` in place of the FMU: a `Response` for any problem of the two modes.

It answers for tones and sweeps of several series, drift offsets and drive levels, for a whole table
of parameter vectors at once: a laboratory then costs seconds of processor time, not minutes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitting.campaign.parameters import Parameter
from fitting.fit.problem import Problem
from fitting.measurements.measurement import Evaluation, Measurement, Prediction
from fitting.measurements.sweep import Sweep
from fitting.measurements.tones import Tones
from fitting.signal.scale import Maximum
from fitting.text.arrays import BoolArray, FloatArray, Scalar
from tests.support.virtual.modes import derived, response

NAMES = ("theta", "reflection", "d1", "d2", "eta_plus", "eta_minus", "g1", "g2")
FINE = np.linspace(-1.0, 1.0, 41)


@dataclass(frozen=True)
class _Places:
    """Settings of some places (m,) by variable, and the label of each; "" where it has none."""

    settings: tuple[Mapping[str, Scalar], ...]
    labels: tuple[str, ...]
    parameters: tuple[Parameter, ...]

    @cached_property
    def _base(self) -> dict[str, FloatArray]:
        """Every variable (m,) before the parameters act."""
        usual = {"g1": 1.0, "g2": 1.0}
        return {
            name: np.array([float(s.get(name, usual.get(name, 0.0))) for s in self.settings])
            for name in NAMES
        }

    @cached_property
    def _acting(self) -> list[tuple[int, str, BoolArray, bool]]:
        """Parameter, variable, places (m,) it acts in, and whether it is added there."""
        found = []
        for i, p in enumerate(self.parameters):
            mine = np.array([not p.experiments or e in p.experiments for e in self.labels])
            names = p.adds_to if p.adds_to else (p.target,)
            found += [(i, name, mine, bool(p.adds_to)) for name in names if p.role == "model"]
        return found

    def values(self, table: FloatArray) -> dict[str, FloatArray]:
        """Variables (k, m) for parameter vectors (k, n); (m,) where no parameter acts."""
        found = dict(self._base)
        for i, name, mine, adds in self._acting:
            old = found[name] if found[name].ndim == 2 else np.tile(found[name], (len(table), 1))
            column = table[:, i, None]
            found[name] = np.where(mine, old + column if adds else column, old)
        return found


@dataclass(frozen=True)
class _Lines:
    """What is read of some experiments: places, frequency, level and output of every line (m,)."""

    places: _Places
    u_hz: FloatArray
    levels: FloatArray
    outputs: tuple[str, ...]

    def amplitudes(self, table: FloatArray) -> FloatArray:
        """Amplitudes (k, m) for parameter vectors (k, n)."""
        values = self.places.values(table)
        found = np.empty((len(table), self.u_hz.size))
        for output in set(self.outputs):
            mine = np.array([o == output for o in self.outputs])
            found[:, mine] = np.abs(response(values, self.u_hz, output))[..., mine]
        return np.asarray(found * self.levels)


@dataclass(frozen=True)
class ModesResponse:
    """`Response` of a problem whose model is the two modes, for one alternative."""

    record: Problem
    alternative: Mapping[str, Scalar]

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        table = np.array([np.asarray(p, dtype=float) for p in ps])
        columns = [self._predicted(k, table) for k in range(len(self.record.measurements))]
        return [Evaluation(tuple(c[k] for c in columns), 1) for k in range(len(table))]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        table = np.array([np.asarray(p, dtype=float) for p in ps])
        answers: list[dict[str, list[FloatArray]]] = [{} for _ in ps]
        for series, places in self._reading.items():
            found = derived(places.values(table))
            for name in self.record.derived.get(series, ()):
                whole = np.broadcast_to(found[name], (len(table), len(places.labels)))
                for k, row in enumerate(whole):
                    answers[k].setdefault(name, []).append(row)
        return [{name: np.concatenate(v) for name, v in a.items()} for a in answers]

    @cached_property
    def _reading(self) -> dict[str, _Places]:
        """Where derived outputs are read, by series: at its experiments, else in its sweep."""
        found = {}
        for series in dict.fromkeys(m.series for m in self.record.measurements):
            mine = [m for m in self.record.measurements if m.series == series]
            single = [m for m in mine if not m.is_curve and m.places] or mine[:1]
            found[series] = self._places([(m, p) for m in single for p in m.places])
        return found

    def _places(
        self, of: Sequence[tuple[Measurement, tuple[str, Mapping[str, Scalar]]]]
    ) -> _Places:
        settings = tuple({**m.setup.start_values, **self.alternative, **own} for m, (_, own) in of)
        labels = tuple(label for _, (label, _) in of)
        return _Places(settings, labels, self.record.parameters)

    @cached_property
    def _lines(self) -> dict[int, _Lines]:
        """What is read of each measurement of tones, by its number."""
        measurements = enumerate(self.record.measurements)
        return {k: self._read(m) for k, m in measurements if isinstance(m, Tones)}

    def _read(self, tones: Tones) -> _Lines:
        drive = tones.setup.drive
        places, lines, levels, outputs = [], [], [], []
        for e in tones.experiments:
            for line in e.read_hz:
                name = drive.amplitude_names[e.tones_hz.index(line)]
                places.append((tones, (e.label, e.settings)))
                lines.append(line)
                levels.append(float(e.settings.get(name, drive.amplitude)))
                outputs.append(e.output or tones.setup.output)
        return _Lines(self._places(places), np.array(lines), np.array(levels), tuple(outputs))

    @cached_property
    def _during(self) -> dict[int, _Places]:
        """Settings of each sweep, by the number of the measurement."""
        measurements = enumerate(self.record.measurements)
        return {k: self._places([(m, m.places[0])]) for k, m in measurements if m.is_curve}

    def _predicted(self, number: int, table: FloatArray) -> list[Prediction]:
        if number in self._lines:
            return [Prediction(row) for row in self._lines[number].amplitudes(table)]
        measurement = self.record.measurements[number]
        assert isinstance(measurement, Sweep)
        values = self._during[number].values(table)
        level = measurement.setup.drive.amplitude

        def swept(u: FloatArray) -> FloatArray:
            return np.asarray(level * np.abs(response(values, u, measurement.setup.output)))

        rows = swept(measurement.frequency_hz)
        if measurement.scaled_by != "maximum":
            return [Prediction(row) for row in rows]
        tops = _maxima(swept, measurement.frequency_hz, rows)
        return [Prediction(row, top) for row, top in zip(rows, tops, strict=True)]


def _maxima(
    swept: Callable[[FloatArray], FloatArray], frequency_hz: FloatArray, rows: FloatArray
) -> list[Maximum]:
    """Tops (k,) of the curves between the points: twice a finer grid, then 1/A^2 as a parabola."""
    place = np.argmax(rows, axis=1)
    step = np.max(np.diff(frequency_hz))
    centre = frequency_hz[place]
    for _ in range(2):
        fine = centre[:, None] + step * FINE
        a = swept(fine)
        best = np.clip(np.argmax(a, axis=1), 1, FINE.size - 2)
        pick = np.arange(len(rows))
        centre, step = fine[pick, best], step * (FINE[1] - FINE[0])
    y0, y1, y2 = (a[pick, best + k] ** -2.0 for k in (-1, 0, 1))
    bend, slope = 0.5 * (y0 + y2) - y1, 0.5 * (y2 - y0)
    with np.errstate(divide="ignore", invalid="ignore"):
        low = y1 - slope**2 / (4.0 * bend)
    top = np.where((bend > 0.0) & (low > 0.5 * y1) & (low <= y1), low, y1)
    return [
        Maximum(value=float(t**-0.5), frequency_hz=float(f), bias=0.0, bracketed=True)
        for t, f in zip(top, centre, strict=True)
    ]
