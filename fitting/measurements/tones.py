"""Tones: amplitudes of a steady response at the frequencies that drive it, or at their mixtures.

    r_i = (chi z_i - z*_i)/z*_i        z_i simulated, z*_i measured amplitude of line i

`ComplexTones` are amplitudes and phases:

    r = S/y - 1        y measured, S = chi exp(i phi_g) z of what the FMU answers, z

Two rows for each line, all real parts (along y) before all imaginary ones (across it): for small
residuals those of the amplitude, as `Tones` has them, and those of the phase in rad. Lock-in
amplifiers give such values; output(t) = Re[z exp(i 2 pi u t)], a drive of phase zero.

What is unknown of the detector is solved inside every evaluation: the phase phi_g of every group
of lines, which ends where the instrument was restarted, and with an unknown gain the modulus chi,
which else is that of the series (`fitting.measurements.gain`, with h = z/y and y = 1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property

import numpy as np

from fitting.campaign import BoundCampaign, Experiment, Setup, Spectrum
from fitting.campaign.noise import ENOUGH_REPEATS, Noise, repeat_scatter
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.measurements.gain import gains_of
from fitting.measurements.measurement import (
    Measurement,
    Predicting,
    Prediction,
    Sampled,
    Values,
    without_drive,
)
from fitting.measurements.plan import Plan
from fitting.measurements.residuals import ResidualCurve
from fitting.signal.window import Window
from fitting.simulate.batch import Batch
from fitting.simulate.drive import Drive
from fitting.simulate.planner import window_decision
from fitting.simulate.words import window_in_words
from fitting.text.arrays import ComplexArray, FloatArray, IntArray, Scalar, both_parts
from fitting.text.errors import BadInput
from fitting.text.finding import Kind
from fitting.text.notation import freedom_words, listed, number, percent, prefixed

#: Spectra in a figure, and side by side: a figure is to stay readable.
MOST_SPECTRA, SPECTRA_PER_ROW = 20, 5
#: Share of the peaks that may be left, on average, where a point still counts as following them.
PLATEAU = 0.5


@dataclass(frozen=True)
class Tones(Measurement):
    """Peak amplitudes of several experiments, one residual row per line that is read.

    `setup` drives the FMU; `experiments` hold tones, settings and amplitudes; `sigmas_v` (rows,)
    are the standard deviations of all amplitudes in their order, NaN where unknown (taken from the
    experiments where it is empty); `noise_origin` is a sentence on their origin; `unit`
    is that of the amplitudes.

    Raises:
        ValueError: shapes that differ, or an amplitude that is not positive and finite.
    """

    setup: Setup
    experiments: tuple[Experiment, ...]
    _: KW_ONLY
    series: str = ""
    sigmas_v: FloatArray = field(default_factory=lambda: np.empty(0))
    noise_origin: str = ""
    unit: str = "V"

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
        result = []
        for e in (self.experiments[k] for k in ends):
            values = model.values(p, e.label, e.settings)
            drive = model.drive(values, tuple(e.tones_hz), e.output or self.setup.output)
            result.append(replace(drive, read_hz=tuple(e.read_hz)))
        return result

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
            np.array([self._line_values(batch, k, window, output) for k in ks])[group]
            for (window, output), (ks, group) in zip(self._observed(model), requested, strict=True)
        ]
        peaks = np.concatenate(columns, axis=1) if columns else np.empty((len(table), 0))
        return [Prediction(row) for row in peaks]

    def _line_values(self, batch: Batch, k: int, window: Window, output: str) -> Values:
        """Values of a run at its lines."""
        return batch.amplitudes(k, window, output)

    def of_lines(self, rows: FloatArray) -> FloatArray:
        """One number for each line (n,), of sizes of its rows (rows,).

        Args:
            rows: sizes of residuals, or standard deviations.
        """
        return rows

    def sampled(self, model: DrivenModel, p: FloatArray, batch: Batch) -> list[Sampled]:
        """One run per experiment."""
        requested = self._ask(model, np.atleast_2d(p), batch)
        return [
            Sampled(ks[0], window, output)
            for (window, output), (ks, _) in zip(self._observed(model), requested, strict=True)
        ]

    def first_drive(self, *, driven: bool) -> Tones | None:
        """Its first experiment."""
        if not self.experiments:
            return None
        setup, first = self.setup, self.experiments[0]
        if not driven:
            setup, settings = without_drive(setup, first.settings)
            first = replace(first, settings=settings)
        return Tones(setup, (first,))

    def residuals(self, prediction: Prediction, chi: float) -> FloatArray:
        """(chi z - z*)/z*, shape (rows,)."""
        return np.asarray((chi * prediction.values - self.peaks_v) / self.peaks_v)

    def residual_curves(self, residuals: FloatArray) -> Sequence[ResidualCurve]:
        """Its lines as they were measured, and by their frequency; of phasors real parts first."""
        count = self.peaks_v.size
        if not count:
            return ()
        tones = np.concatenate([np.asarray(e.read_hz, dtype=float) for e in self.experiments])
        share = self.peaks_v / np.max(self.peaks_v)
        result = []
        for order in (np.arange(count), np.argsort(tones, kind="stable")):
            rows = np.concatenate([order + begin for begin in range(0, residuals.size, count)])
            result.append(ResidualCurve(rows=rows, share=np.tile(share[order], rows.size // count)))
        gain = residuals[result[0].rows] + (result[0].rows < count)  # model/data: real parts first
        return (replace(result[0], columns={Kind.gain: gain}), result[1])

    def unexplained(self, residuals: FloatArray) -> str:
        """Peaks that are half their size off on average are no description of the data."""
        mean = float(np.mean(self.of_lines(np.abs(residuals)))) if residuals.size else 0.0
        return f"the peaks are {100.0 * mean:.0f} % off on average" if mean > PLATEAU else ""

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """A column of spectra per experiment, before above after; none where there are no peaks."""
        if not self.experiments:
            return ()
        ends = np.cumsum([e.peaks_v.size for e in self.experiments])[:-1]
        spectra = tuple(
            ShownSpectrum(
                label=e.label,
                lines_hz=np.array(e.read_hz),
                measured=e.peaks_v,
                sigmas=e.sigmas_v,
                before=start,
                after=end,
                spectrum=e.spectrum,
                unit=self.unit,
            )
            for e, start, end in zip(
                self.experiments,
                np.split(np.asarray(before, dtype=float), ends),
                np.split(np.asarray(after, dtype=float), ends),
                strict=True,
            )
        )
        floors = [e.floor_v for e in self.experiments]
        return (spectra_figure(spectra, floors, self.series),)

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


@dataclass(frozen=True, kw_only=True)
class ShownSpectrum:
    """One experiment with its model: `lines_hz`, and amplitudes (n,) peak there, in `unit`.

    `measured` with `sigmas` (NaN: not known), and simulated times the scale `before` and `after`
    the fit; `spectrum` is the whole one where it was measured.
    """

    label: str
    lines_hz: FloatArray
    measured: FloatArray
    sigmas: FloatArray
    before: FloatArray
    after: FloatArray
    spectrum: Spectrum | None = None
    unit: str = "V"

    @property
    def highest(self) -> float:
        """The largest amplitude of all."""
        heights = [self.measured, self.before, self.after]
        heights += [] if self.spectrum is None else [self.spectrum.amplitude_v]
        values = np.concatenate(heights)
        return float(np.max(values[np.isfinite(values)]))


def spectra_figure(
    spectra: Sequence[ShownSpectrum], floors: Sequence[float], series: str = ""
) -> Figure:
    """Spectra as measured, and simulated amplitudes at their lines, before and after the fit.

    Args:
        spectra: of all experiments.
        floors: mean magnitude of the noise of each, NaN or zero where it is not known.
        series: name of the series.
    """
    shown = spectra[:MOST_SPECTRA]
    lines = np.concatenate([s.lines_hz for s in shown])
    margin = max(0.2 * float(np.ptp(lines)), 1e-9 * float(np.max(lines)))
    x = Axis("f", "Hz", low=float(np.min(lines)) - margin, high=float(np.max(lines)) + margin)
    y = Axis("amplitude", shown[0].unit, low=0.0, high=1.12 * max(s.highest for s in shown))
    columns = [
        (_spectrum(s, k, x, y, "before"), _spectrum(s, k, x, y, "after"))
        for k, s in enumerate(shown)
    ]
    rows = []
    for k in range(0, len(columns), SPECTRA_PER_ROW):
        rows += [tuple(row) for row in zip(*columns[k : k + SPECTRA_PER_ROW], strict=True)]
    mean_before, mean_after = (
        float(
            np.mean(np.concatenate([np.abs(getattr(s, when) / s.measured - 1.0) for s in spectra]))
        )
        for when in ("before", "after")
    )
    return Figure(
        name="spectra",
        title="Spectra, measured and simulated",
        caption=_spectra_caption(spectra, floors),
        alt=(
            f"A column per experiment ({listed(s.label for s in shown)}), above with the start "
            "parameters, below with the fitted ones: measured spectrum, simulated line at every "
            f"drive frequency. The mean deviation goes from {number(mean_before, 3)} to "
            f"{number(mean_after, 3)}."
        ),
        rows=tuple(rows),
        series=series,
    )


def _spectrum(shown: ShownSpectrum, place: int, x: Axis, y: Axis, when: str) -> Panel:
    """One experiment, `when` before or after the fit; above it how far its peaks are off."""
    simulated = shown.before if when == "before" else shown.after
    layers = []
    if shown.spectrum is not None:
        f, a = shown.spectrum.frequency_hz, shown.spectrum.amplitude_v
        layers.append(Layer(Role.MEASURED, Form.CURVE, f, a, label="measured spectrum"))
    peaks = "measured peak ± σ, floor removed"
    layers += [
        Layer(Role.SIMULATED, Form.STEMS, shown.lines_hz, simulated, label="simulated × χ"),
        Layer(
            Role.MEASURED,
            Form.LEVELS,
            shown.lines_hz,
            shown.measured,
            label=peaks,
            sigma=shown.sigmas,
        ),
    ]
    words = [percent(off) for off in simulated / shown.measured - 1.0]
    return Panel(
        x=x,
        y=y,
        layers=tuple(layers),
        title="\n".join(
            [shown.label, *(", ".join(words[k : k + 2]) for k in range(0, len(words), 2))]
        ),
        when=when,
        marked=tuple(map(float, shown.lines_hz)),
        joined=True,
        shape=place,
    )


def _spectra_caption(spectra: Sequence[ShownSpectrum], floors: Sequence[float]) -> str:
    known = [floor for floor in floors if np.isfinite(floor) and floor > 0.0]
    stated = ""
    if known:
        factor, unit = prefixed(max(known), spectra[0].unit)
        low, high = (number(f(known) / factor, 2) for f in (min, max))
        stated = f" The noise floor (mean magnitude {low} to {high} {unit}) is in the trace."
    if len(spectra) > MOST_SPECTRA:
        stated += f" The first {MOST_SPECTRA} of {len(spectra)} experiments are shown."
    return (
        "Spectra measured (solid) and amplitudes simulated at the drive frequencies (dashed), "
        "scaled by χ of Algorithm 1: above with the start parameters, below with the fitted ones. "
        "Black bars join measured and simulated peak; the difference relative to the measured peak "
        f"stands above each panel, in the order of the tones. Vertical lines are the drive "
        f"frequencies.{stated}"
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
    noise, stated = bound.noise, []
    if any(np.any(np.nan_to_num(f, nan=0.0) > 0.0) for f in floors):
        stated.append("the floor of the spectra, or the columns given")
    if noise.relative == 0.0:
        # what distinguishes experiments: settings, output, lines, and values that are theirs alone
        repeats: list[object] = [
            (
                frozenset(e.settings.items()),
                e.output,
                e.read_hz,
                tuple(p.name for p in bound.parameters if e.label in p.experiments),
            )
            for e in bound.experiments
        ]
        scatter, freedom = repeat_scatter(repeats, peaks, floors)
        if freedom >= ENOUGH_REPEATS and scatter > 0.0:
            noise = Noise(relative=scatter, absolute_v=noise.absolute_v)
            stated.append(f"{100 * scatter:.3g} % from repeats ({freedom_words(freedom)})")
    elif noise.declared:
        stated.append(f"{100 * noise.relative:.3g} % as declared")
    if noise.absolute_v > 0.0:
        stated.append(f"{noise.absolute_v:.3g} {bound.amplitude_unit} as declared")
    sigmas = [noise.with_floor(p, f) for p, f in zip(peaks, floors, strict=True)]
    sentence = (
        f"Standard deviations of the peaks: {', '.join(stated)}, in quadrature."
        if stated
        else "Standard deviations of the peaks are not known: they are estimated from the "
        "residuals."
    )
    return np.concatenate(sigmas), sentence


class ComplexTones(Tones):
    """Complex values of several experiments, two residual rows per line that is read.

    `experiments` hold tones, settings, amplitudes and phases; `sigmas_v` (n,) are the standard
    deviations of each quadrature. The rest is as in `Tones`.

    Raises:
        ValueError: as `Tones`.
        BadInput: an experiment without phases, or experiments that know unlike things.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.y  # refuses an experiment without phases
        unknown = sorted({e.unknown for e in self.experiments})
        if len(unknown) > 1:
            raise BadInput(
                f"tones with phases: unknown is {' and '.join(unknown)}; wanted one word in a "
                "series"
            )

    @property
    def unknown(self) -> str:
        """What is solved inside: "phase", "gain" or "none"."""
        return self.experiments[0].unknown

    @cached_property
    def y(self) -> ComplexArray:
        """Measured values (n,), in the unit of the amplitudes."""
        radians = [phases_of(e) for e in self.experiments]
        return np.asarray(self.peaks_v * np.exp(1j * np.concatenate(radians)))

    @cached_property
    def groups(self) -> IntArray:
        """Which reference phase each line has, (n,)."""
        result, group = [], 0
        for k, e in enumerate(self.experiments):
            group += int(e.restarted and k > 0)
            result.append(np.full(len(e.read_hz), group))
        return np.concatenate(result).astype(np.intp)

    @property
    def has_phases(self) -> bool:
        """Two rows for each line."""
        return True

    @property
    def rows(self) -> int:
        """Two for each line that is read."""
        return 2 * int(self.peaks_v.size)

    @cached_property
    def sigma(self) -> FloatArray:
        """Relative standard deviation of each quadrature, (rows,); zero where unknown."""
        own = np.nan_to_num(self.sigmas_v / self.peaks_v, nan=0.0)
        return np.concatenate([own, own])

    @cached_property
    def measured_rows(self) -> FloatArray:
        """One along the measured value, zero across it; zero where the gain is unknown."""
        along = 0.0 if self.unknown == "gain" else 1.0
        return np.repeat([along, 0.0], self.peaks_v.size)

    @property
    def solved_inside(self) -> int:
        """Real unknowns: a phase of every group, and the modulus of an unknown gain."""
        if self.unknown == "none":
            return 0
        return int(self.groups[-1]) + 1 + int(self.unknown == "gain")

    def solved(self, prediction: Prediction, chi: float) -> ComplexArray:
        """S (n,): the prediction with the phases, or the gain, that suit the data best.

        Args:
            prediction: of the measurement, without scale.
            chi: scale, laboratory over simulation, where the gain is known.
        """
        z = np.asarray(prediction.values, dtype=complex)
        if self.unknown == "none":
            return np.asarray(chi * z)
        h, weights = z / self.y, self._weights
        lines = [self.groups == g for g in range(int(self.groups[-1]) + 1)]
        products = [complex(np.vdot(h[mine], weights[mine])) for mine in lines]
        powers = [float(weights[mine] @ np.abs(h[mine]) ** 2) for mine in lines]
        gains = gains_of(products, powers, rotated=True)
        if self.unknown == "phase":
            gains = np.asarray(chi * np.exp(1j * np.angle(gains)), dtype=complex)
        return np.asarray(gains[self.groups] * z)

    @cached_property
    def _weights(self) -> FloatArray:
        """Inverse variances of the lines' rows over the largest, one where some are unknown."""
        sigma = self.sigma[: self.peaks_v.size]
        return (np.min(sigma) / sigma) ** 2 if np.all(sigma > 0.0) else np.ones(sigma.size)

    def residuals(self, prediction: Prediction, chi: float) -> FloatArray:
        """Real and imaginary part of S/y - 1, (rows,)."""
        return both_parts(self.solved(prediction, chi) / self.y - 1.0)

    def scaled(self, prediction: Prediction, chi: float) -> Values:
        """S, complex (n,)."""
        return self.solved(prediction, chi)

    def solved_columns(self, prediction: Prediction) -> FloatArray:
        """Derivatives of the rows by phases, and by the logarithm of an unknown gain."""
        ratio = self.solved(prediction, 1.0) / self.y
        columns = [both_parts(ratio)] if self.unknown == "gain" else []
        columns += [
            both_parts(np.where(self.groups == g, 1j * ratio, 0.0))
            for g in range(self.solved_inside - len(columns))
        ]
        return np.stack(columns, axis=1) if columns else np.empty((self.rows, 0))

    def amplitude_rows(self, prediction: Prediction, rows: FloatArray) -> FloatArray:
        """Changes along S: real parts of exp(-i arg(S/y)) dr."""
        real, imaginary = np.split(rows, 2)
        turn = np.exp(-1j * np.angle(self.solved(prediction, 1.0) / self.y))[:, None]
        return np.asarray((turn * (real + 1j * imaginary)).real)

    def read_as(self, factor: float) -> ComplexTones:
        """The same with every phase multiplied.

        Args:
            factor: on the phases.
        """
        experiments = tuple(replace(e, phases_rad=factor * phases_of(e)) for e in self.experiments)
        return replace(self, experiments=experiments)

    def of_lines(self, rows: FloatArray) -> FloatArray:
        """Moduli of the rows' pairs, (n,)."""
        return np.asarray(np.hypot(*np.split(rows, 2)))

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """The amplitudes as of tones, and how far the phases are off."""
        amplitudes = super().figures(np.abs(before), np.abs(after))
        return (*amplitudes, self._phase_figure(before, after))

    def _phase_figure(self, before: Values, after: Values) -> Figure:
        f = np.concatenate([e.read_hz for e in self.experiments])
        off = [np.degrees(np.angle(s / self.y)) for s in (before, after)]
        sigma = np.degrees(self.sigma[self.peaks_v.size :])
        rms = number(float(np.sqrt(np.mean(off[1] ** 2))), 2)
        known = sigma if np.all(sigma > 0.0) else np.empty(0)
        return Figure(
            name="phases",
            title="Phases, simulated minus measured",
            caption=(
                f"How far the phases of {f.size} lines are off, with the start parameters and with "
                f"the fitted ones: {rms} degrees (rms). {_SOLVED[self.unknown]}"
            ),
            alt=f"Phases of {f.size} lines over frequency, simulated minus measured, {rms} deg.",
            rows=(
                (
                    Panel(
                        x=Axis("f", "Hz"),
                        y=Axis("phase, simulated minus measured", "deg"),
                        layers=(
                            Layer(Role.START, Form.POINTS, f, off[0], label="start parameters"),
                            Layer(
                                Role.SIMULATED,
                                Form.POINTS,
                                f,
                                off[1],
                                label="fitted parameters",
                                sigma=known,
                            ),
                        ),
                        level=0.0,
                    ),
                ),
            ),
            series=self.series,
        )

    def _line_values(self, batch: Batch, k: int, window: Window, output: str) -> Values:
        return batch.phasors(k, window, output)


_SOLVED = {
    "phase": "The reference phase is the one that suits best.",
    "gain": "The complex gain is the one that suits best.",
    "none": "Phases are those of the drive.",
}


def phases_of(experiment: Experiment) -> FloatArray:
    """The phases (n,) of an experiment that has some, rad.

    Args:
        experiment: of a campaign.

    Raises:
        BadInput: it has none.
    """
    if experiment.phases_rad is None:
        raise BadInput(f"experiment '{experiment.label}': has no phases; wanted one for each line")
    return experiment.phases_rad
