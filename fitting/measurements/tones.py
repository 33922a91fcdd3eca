"""Tones: amplitudes of a steady response at the frequencies that drive it, or at their mixtures.

r_i = (chi z_i - z*_i)/z*_i        z_i simulated, z*_i measured amplitude of line i
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property

import numpy as np

from fitting.campaign import BoundCampaign, Experiment, Setup
from fitting.campaign.noise import ENOUGH_REPEATS, Noise, repeat_scatter
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.measurement import MeasurementKind, Predicting, Prediction, Sampled
from fitting.measurements.plan import Plan
from fitting.signal.window import Window
from fitting.simulate.batch import Batch, Workers
from fitting.simulate.drive import Drive
from fitting.simulate.planner import window_decision
from fitting.simulate.words import window_in_words
from fitting.text.arrays import FloatArray, IntArray, Scalar

#: Share of the peaks that may be left, on average, where a point still counts as following them.
PLATEAU = 0.5


@dataclass(frozen=True)
class Tones(MeasurementKind):
    """Peak amplitudes of several experiments, one residual row per line that is read.

    `setup` drives the FMU; `experiments` hold tones, settings and amplitudes; `sigmas_v` (rows,)
    are the standard deviations of all amplitudes in their order, NaN where unknown (taken from the
    experiments where it is empty); `noise_origin` says in a sentence where they come from.

    Raises:
        ValueError: shapes that differ, or an amplitude that is not positive and finite.
    """

    setup: Setup
    experiments: tuple[Experiment, ...]
    _: KW_ONLY
    series: str = ""
    sigmas_v: FloatArray = field(default_factory=lambda: np.empty(0))
    noise_origin: str = ""

    def __post_init__(self) -> None:
        if not np.all(np.isfinite(self.peaks_v)) or np.any(self.peaks_v <= 0.0):
            raise ValueError("a measured peak is not positive and finite")
        if self.sigmas_v.size == 0 and self.experiments:
            own = np.concatenate([e.sigmas_v for e in self.experiments])
            object.__setattr__(self, "sigmas_v", own)
        if self.sigmas_v.shape != self.peaks_v.shape:
            raise ValueError(f"{self.peaks_v.size} peaks, but {self.sigmas_v.size} sigmas")

    @cached_property
    def peaks_v(self) -> FloatArray:
        """Measured amplitudes (rows,), V peak."""
        return np.concatenate([np.empty(0), *(e.peaks_v for e in self.experiments)])

    @property
    def rows(self) -> int:
        """One for each line that is read."""
        return int(self.peaks_v.size)

    @cached_property
    def sigma(self) -> FloatArray:
        """Relative standard deviation of every peak, (rows,); zero where unknown."""
        return np.nan_to_num(self.sigmas_v / self.peaks_v, nan=0.0)

    @cached_property
    def measured_rows(self) -> FloatArray:
        """One in every row: dr/d ln chi = 1 + r."""
        return np.ones(self.rows)

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        """Label and settings of every experiment."""
        return tuple((e.label, e.settings) for e in self.experiments)

    def drives(self, model: DrivenModel, p: FloatArray) -> list[Drive]:
        """Those of the first and of the last experiment."""
        ends = dict.fromkeys((0, len(self.experiments) - 1)) if self.experiments else ()
        found = []
        for e in (self.experiments[k] for k in ends):
            values = model.values(p, e.label, e.settings)
            drive = model.drive(values, tuple(e.tones_hz), e.output or self.setup.output)
            found.append(replace(drive, read_hz=tuple(e.read_hz)))
        return found

    def planned(self, plan: Plan) -> Plan:
        """The plan with the windows of its experiments."""
        if not self.experiments or plan.budget is None:
            return plan
        windows = tuple(
            w for w, _ in self._observed(DrivenModel(setup=self.setup, parameters=(), plan=plan))
        )
        remarks = (
            f"Experiment {e.label.removeprefix(f'{self.series}/')}: {window_in_words(w)}."
            for e, w in zip(self.experiments, windows, strict=True)
        )
        budget = plan.budget.with_decision(window_decision(windows))
        return replace(plan, budget=budget, remarks=(*plan.remarks, *remarks))

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        """Amplitudes of all lines for every row of the table; see `Measurement.predict`."""
        requested = self._ask(model, table, batch)
        yield
        columns = [
            np.array([batch.amplitudes(k, window, output) for k in ks])[group]
            for (window, output), (ks, group) in zip(self._observed(model), requested, strict=True)
        ]
        peaks = np.concatenate(columns, axis=1) if columns else np.empty((len(table), 0))
        return [Prediction(row) for row in peaks]

    def sampled(self, model: DrivenModel, p: FloatArray, batch: Batch) -> list[Sampled]:
        """One run per experiment."""
        requested = self._ask(model, np.atleast_2d(p), batch)
        return [
            Sampled(ks[0], window, output)
            for (window, output), (ks, _) in zip(self._observed(model), requested, strict=True)
        ]

    def residuals(self, prediction: Prediction, chi: float) -> FloatArray:
        """(chi z - z*)/z*, shape (rows,)."""
        return np.asarray((chi * prediction.values - self.peaks_v) / self.peaks_v)

    def unexplained(self, residuals: FloatArray) -> str:
        """Peaks that are half their size off on average are no description of the data."""
        mean = float(np.mean(np.abs(residuals))) if residuals.size else 0.0
        return f"the peaks are {100.0 * mean:.0f} % off on average" if mean > PLATEAU else ""

    def _observed(self, model: DrivenModel) -> list[tuple[Window, str]]:
        """Window and output of every experiment."""
        outputs = (e.output or self.setup.output for e in self.experiments)
        windows = (model.window(e.read_hz, e.tones_hz) for e in self.experiments)
        return list(zip(windows, outputs, strict=True))

    def _ask(
        self, model: DrivenModel, table: FloatArray, batch: Batch
    ) -> list[tuple[list[int], IntArray]]:
        """Per experiment the runs that answer it, and which of them belongs to each row."""
        requested = []
        for e, (window, output) in zip(self.experiments, self._observed(model), strict=True):
            first, group = model.groups(table, e.label)
            signal = model.signal(window, e.tones_hz)
            runs = [
                batch.ask(model.values(table[k], e.label, e.settings), window, signal, output, k)
                for k in map(int, first)
            ]
            requested.append((runs, group))
        return requested


def tones_of(bound: BoundCampaign, series: str = "") -> Tones:
    """The experiments of a campaign as a measurement, with everything known of their noise.

    Args:
        bound: campaign, bound to its FMU.
        series: name of the series.
    """
    sigmas_v, origin = peak_sigmas(bound)
    return Tones(
        bound.setup, bound.experiments, series=series, sigmas_v=sigmas_v, noise_origin=origin
    )


def peak_sigmas(bound: BoundCampaign) -> tuple[FloatArray, str]:
    """Standard deviations of all peaks (n_peaks,), NaN where unknown, and a sentence on them.

    Args:
        bound: campaign, bound to its FMU.
    """
    floors = [e.sigmas_v for e in bound.experiments]
    peaks = [e.peaks_v for e in bound.experiments]
    if not peaks:
        return np.empty(0), ""
    noise, said = bound.noise, []
    if any(np.any(np.nan_to_num(f, nan=0.0) > 0.0) for f in floors):
        said.append("the floor of the spectra, or the columns given")
    if noise.relative == 0.0:
        scatter, freedom = repeat_scatter(_repeats(bound), peaks, floors)
        if freedom >= ENOUGH_REPEATS and scatter > 0.0:
            noise = Noise(relative=scatter, absolute_v=noise.absolute_v)
            said.append(f"{100 * scatter:.3g} % from repeats ({freedom} degrees of freedom)")
    elif noise.declared:
        said.append(f"{100 * noise.relative:.3g} % as declared")
    if noise.absolute_v > 0.0:
        said.append(f"{noise.absolute_v:.3g} {bound.amplitude_unit} as declared")
    sigmas = [noise.with_floor(p, f) for p, f in zip(peaks, floors, strict=True)]
    sentence = (
        f"Standard deviations of the peaks: {', '.join(said)}, in quadrature."
        if said
        else "Standard deviations of the peaks are not known: their residuals tell them."
    )
    return np.concatenate(sigmas), sentence


def _repeats(bound: BoundCampaign) -> list[object]:
    """What tells experiments apart: settings, output, lines, and values that are theirs alone."""
    own = {
        e.label: tuple(p.name for p in bound.parameters if e.label in p.experiments)
        for e in bound.experiments
    }
    return [
        (frozenset(e.settings.items()), e.output, e.read_hz, own[e.label])
        for e in bound.experiments
    ]


def undriven(tones: Tones, model: DrivenModel, p: FloatArray, workers: Workers) -> float:
    """Range of the output without any tone of the campaign, over the range with them.

    Args:
        tones: the measured peaks.
        model: how the FMU is driven for one series, and by which plan.
        p: parameters (n,), each in its own unit.
        workers: processes that run the FMU.
    """
    if not tones.experiments:
        return 0.0
    silent, driven = (
        _range(tones, model, amplitude, p, workers)
        for amplitude in (0.0, tones.setup.drive.amplitude)
    )
    return silent / driven if driven > 0.0 else 0.0


def _range(
    tones: Tones, model: DrivenModel, amplitude: float, p: FloatArray, workers: Workers
) -> float:
    """Range of the first experiment's samples with the drive at that amplitude."""
    drive = replace(tones.setup.drive, amplitude=amplitude)
    experiment = tones.experiments[0]
    if not amplitude:  # also where the experiment has a level of its own
        own = {n: 0.0 for n in drive.amplitude_names if n in experiment.settings}
        experiment = replace(experiment, settings={**experiment.settings, **own})
    setup = replace(tones.setup, drive=drive)
    one = Tones(setup, (experiment,))
    batch = Batch()
    [found] = one.sampled(replace(model, setup=setup), p, batch)
    batch.simulate(workers)
    return float(np.ptp(batch.samples(found.run, found.output)))
