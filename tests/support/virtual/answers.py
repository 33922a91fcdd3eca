"""The closed form of `modes` in place of the FMU: a `Response` for any problem of the two modes.

It answers for tones and sweeps of several series, drift offsets and drive levels, for a whole table
of parameter vectors at once: a laboratory then costs seconds of processor time, not minutes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitting.campaign.parameters import Parameter
from fitting.fit.problem import Problem
from fitting.measurements.measurement import Evaluation, Measurement, Prediction
from fitting.measurements.sweep import Sweep
from fitting.measurements.tones import Tones
from fitting.signal.scale import Maximum
from fitting.text.arrays import FloatArray, Scalar
from tests.support.virtual.modes import derived, response

NAMES = ("theta", "reflection", "d1", "d2", "eta_plus", "eta_minus", "g1", "g2")
FINE = np.linspace(-1.0, 1.0, 41)


@dataclass(frozen=True)
class _Places:
    """Settings of some places (m,) by variable, and the label of each; "" where it has none."""

    settings: tuple[Mapping[str, Scalar], ...]
    labels: tuple[str, ...]

    def values(self, parameters: Sequence[Parameter], table: FloatArray) -> dict[str, FloatArray]:
        """Variables (k, m) for parameter vectors (k, n)."""
        found: dict[str, FloatArray] = {}
        for name in NAMES:
            base = [float(s.get(name, 1.0 if name in ("g1", "g2") else 0.0)) for s in self.settings]
            column = np.tile(np.array(base), (len(table), 1))
            for i, p in enumerate(parameters):
                if p.role != "model" or (name not in p.adds_to and p.target != name):
                    continue
                mine = np.array(
                    [not p.experiments or label in p.experiments for label in self.labels]
                )
                if p.adds_to:
                    column[:, mine] += table[:, i, None]
                else:
                    column[:, mine] = table[:, i, None]
            found[name] = column
        return found


@dataclass(frozen=True)
class ModesResponse:
    """`Response` of a problem whose model is the two modes, for one alternative."""

    record: Problem
    alternative: Mapping[str, Scalar]

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        table = np.array([np.asarray(p, dtype=float) for p in ps])
        columns = [self._predicted(m, table) for m in self.record.measurements]
        return [Evaluation(tuple(c[k] for c in columns), 1) for k in range(len(table))]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        table = np.array([np.asarray(p, dtype=float) for p in ps])
        answers: list[dict[str, list[FloatArray]]] = [{} for _ in ps]
        for series, places in self._reading.items():
            found = derived(places.values(self.record.parameters, table))
            for name in self.record.derived.get(series, ()):
                for k, row in enumerate(found[name]):
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
        return _Places(settings, tuple(label for _, (label, _) in of))

    def _predicted(self, measurement: Measurement, table: FloatArray) -> list[Prediction]:
        if isinstance(measurement, Tones):
            return [Prediction(row) for row in self._peaks(measurement, table)]
        assert isinstance(measurement, Sweep)
        values = self._places([(measurement, measurement.places[0])]).values(
            self.record.parameters, table
        )
        level = measurement.setup.drive.amplitude

        def swept(u: FloatArray) -> FloatArray:
            return level * np.abs(response(values, u, measurement.setup.output))

        rows = swept(measurement.frequency_hz)
        if measurement.scaled_by != "maximum":
            return [Prediction(row) for row in rows]
        tops = _maxima(swept, measurement.frequency_hz, rows)
        return [Prediction(row, top) for row, top in zip(rows, tops, strict=True)]

    def _peaks(self, tones: Tones, table: FloatArray) -> FloatArray:
        drive = tones.setup.drive
        places, lines, levels, outputs = [], [], [], []
        for e in tones.experiments:
            for line in e.read_hz:
                k = int(np.argmin(np.abs(np.array(e.tones_hz) - line)))
                named = dict(zip(drive.frequency_names, drive.amplitude_names, strict=True))
                amplitude = tuple(named.values())[k]
                places.append((tones, (e.label, e.settings)))
                lines.append(line)
                levels.append(float(e.settings.get(amplitude, drive.amplitude)))
                outputs.append(e.output or tones.setup.output)
        values = self._places(places).values(self.record.parameters, table)
        found = np.empty((len(table), len(lines)))
        for output in set(outputs):
            found_all = np.abs(response(values, np.array(lines), output))
            mine = np.array([o == output for o in outputs])
            found[:, mine] = found_all[:, mine]
        return np.asarray(found * np.array(levels))


def _maxima(swept, frequency_hz: FloatArray, rows: FloatArray) -> list[Maximum]:  # type: ignore[no-untyped-def]
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
