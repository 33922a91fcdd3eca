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

from fitting.campaign import BoundCampaign, Experiment, Setup
from fitting.campaign.noise import ENOUGH_REPEATS, Noise, repeat_scatter
from fitting.fmu.runs import Segment
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import (
    Axis,
    Figure,
    Form,
    Layer,
    Panel,
    Role,
    root_mean_square,
    worded,
)
from fitting.measurements.gain import gains_of
from fitting.measurements.measurement import (
    Measurement,
    Predicting,
    Prediction,
    Sampled,
    Values,
)
from fitting.measurements.plan import Plan
from fitting.measurements.residuals import ResidualCurve
from fitting.signal.prescribed import PrescribedWindow
from fitting.signal.window import Window
from fitting.simulate.batch import Batch, Variation
from fitting.simulate.budget import Basis, Decision
from fitting.simulate.budget import Kind as Decided
from fitting.simulate.drive import Drive
from fitting.simulate.planner import window_decision
from fitting.simulate.words import window_in_words
from fitting.text.arrays import ComplexArray, FloatArray, IntArray, Scalar, both_parts
from fitting.text.errors import BadInput
from fitting.text.finding import Kind
from fitting.text.notation import freedom_words, number, percent, prefixed

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

    @cached_property
    def sigma(self) -> FloatArray:
        """Relative standard deviation of every peak, or quadrature, (rows,); zero where unknown."""
        relative = np.nan_to_num(self.sigmas_v / self.peaks_v, nan=0.0)
        return np.tile(relative, 2 if self.has_phases else 1)

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
        if (own := self.setup.window) is not None:
            numbers = {"settle_s": own.settle, "length_s": own.length, "step_s": own.step}
            kind, basis = Decided.WINDOW, Basis.PRESCRIBED
            decision = Decision(kind, basis, 0.0, numbers=numbers, forced=True)
            return replace(plan, budget=plan.budget.with_decision(decision))
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
        if self.setup.window is not None:
            return (yield from self._prescribed(self.setup.window, model.whole, table, batch))
        requested = self._ask(model, table, batch)
        yield
        columns = [
            np.array([self._line_values(batch, k, window, output) for k in ks])[group]
            for (window, output), (ks, group) in zip(self._observed(model), requested, strict=True)
        ]
        peaks = np.concatenate(columns, axis=1) if columns else np.empty((len(table), 0))
        return [Prediction(row) for row in peaks]

    def _prescribed(
        self, window: PrescribedWindow, model: DrivenModel, table: FloatArray, batch: Batch
    ) -> Predicting:
        """Amplitudes by a prescribed window: of few samples, where the others follow from them."""
        whole = Window(
            tones_hz=(),
            settle_s=window.settle,
            step_s=window.step,
            samples=window.samples,
            longest_s=model.plan.grid.longest_s,
        )
        few = window.few if model.any_steps and not model.plan.grid.step_s else None
        shortened = Variation({}, whole)
        if few is not None:
            waits = (float(n * window.step) for n in np.diff(few.indices))
            segments = tuple(
                Segment(value=0.0, settle_s=wait, sample_step_s=window.step, samples=1)
                for wait in waits
            )
            shortened = Variation({}, replace(whole, samples=1), segments=segments)
        places = []
        for e in self.experiments:
            first, group = model.groups(table, e.label)
            starts = [(model.values(table[k], e.label, e.settings), int(k)) for k in first]
            output = e.output or self.setup.output
            runs = [batch.ask_varied(s, [shortened], output, k)[0] for s, k in starts]
            places.append((output, starts, runs, group))
        yield
        records: list[list[FloatArray]] = []
        for output, starts, runs, _ in places:
            records.append([])
            for i, (start, k) in enumerate(starts):
                samples = batch.samples(runs[i], output)
                follows = samples if few is None else window.whole(samples)
                if follows is None:  # not linear, or poles that the few do not distinguish
                    [runs[i]] = batch.ask_varied(start, [Variation({}, whole)], output, k)
                records[-1].append(np.empty(0) if follows is None else follows)
        yield
        columns = []
        for e, (output, _, runs, group), rows in zip(
            self.experiments, places, records, strict=True
        ):
            pairs = zip(rows, runs, strict=True)
            values = [row if row.size else batch.samples(k, output) for row, k in pairs]
            lines_hz = tuple(e.read_hz)
            columns.append(np.array([window.amplitudes(x, lines_hz) for x in values])[group])
        return [Prediction(row) for row in np.concatenate(columns, axis=1)]

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
        """One run per experiment; none of a prescribed window, which tones alone do not fill."""
        if self.setup.window is not None:
            return []
        requested = self._ask(model, np.atleast_2d(p), batch)
        return [
            Sampled(ks[0], window, output)
            for (window, output), (ks, _) in zip(self._observed(model), requested, strict=True)
        ]

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
        both = (np.split(np.asarray(values, dtype=float), ends) for values in (before, after))
        pairs = list(zip(*both, strict=True))
        return (spectra_figure(self.experiments, pairs, self.unit, self.series),)

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


def spectra_figure(
    experiments: Sequence[Experiment],
    simulated: Sequence[tuple[FloatArray, FloatArray]],
    unit: str,
    series: str = "",
) -> Figure:
    """Spectra as measured, and simulated amplitudes at their lines, before and after the fit.

    Args:
        experiments: with their amplitudes, spectra and floors.
        simulated: amplitudes times the scale before and after the fit, (n,) each, of every one.
        unit: of all amplitudes.
        series: name of the series.
    """
    shown = list(zip(experiments, simulated, strict=True))[:MOST_SPECTRA]
    lines = np.concatenate([e.read_hz for e, _ in shown])
    margin = max(0.2 * float(np.ptp(lines)), 1e-9 * float(np.max(lines)))
    spectra = [e.spectrum.amplitude_v for e, _ in shown if e.spectrum is not None]
    heights = np.concatenate([*(x for e, both in shown for x in (e.peaks_v, *both)), *spectra])
    top = float(np.max(heights[np.isfinite(heights)]))
    x = Axis("f", "Hz", low=float(np.min(lines)) - margin, high=float(np.max(lines)) + margin)
    y = Axis("amplitude", unit, low=0.0, high=1.12 * top)
    whens = ("before", "after")
    columns = [
        tuple(_spectrum(e, k, (x, y), *each) for each in zip(whens, both, strict=True))
        for k, (e, both) in enumerate(shown)
    ]
    rows = []
    for k in range(0, len(columns), SPECTRA_PER_ROW):
        rows += [tuple(row) for row in zip(*columns[k : k + SPECTRA_PER_ROW], strict=True)]
    peaks = np.concatenate([e.peaks_v for e in experiments])
    mean_before, mean_after = (
        float(np.mean(np.abs(np.concatenate(values) / peaks - 1.0)))
        for values in zip(*simulated, strict=True)
    )
    floors = [e.floor_v for e in experiments]
    known = [f for f in floors if np.isfinite(f) and f > 0.0]
    stated: tuple[str, ...] = ()
    if known:
        factor, prefix_unit = prefixed(max(known), unit)
        stated = (*(number(f(known) / factor, 2) for f in (min, max)), prefix_unit)
    return worded(
        "spectra",
        rows,
        series=series,
        labels=[e.label for e, _ in shown],
        count=len(experiments),
        floors=stated,
        deviations=(mean_before, mean_after),
    )


def _spectrum(
    e: Experiment, place: int, axes: tuple[Axis, Axis], when: str, simulated: FloatArray
) -> Panel:
    """One experiment, `when` before or after the fit; above it how far its peaks are off."""
    lines_hz, layers = np.array(e.read_hz), []
    if e.spectrum is not None:
        f, a = e.spectrum.frequency_hz, e.spectrum.amplitude_v
        layers.append(Layer(Role.MEASURED, Form.CURVE, f, a, label="measured spectrum"))
    peaks = "measured peak ± σ, floor removed"
    layers += [
        Layer(Role.SIMULATED, Form.STEMS, lines_hz, simulated, label="simulated × χ"),
        Layer(Role.MEASURED, Form.LEVELS, lines_hz, e.peaks_v, label=peaks, sigma=e.sigmas_v),
    ]
    words = [percent(off) for off in simulated / e.peaks_v - 1.0]
    return Panel(
        x=axes[0],
        y=axes[1],
        layers=tuple(layers),
        title="\n".join([e.label, *(", ".join(words[k : k + 2]) for k in range(0, len(words), 2))]),
        when=when,
        marked=e.read_hz,
        joined=True,
        shape=place,
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

    has_phases = True

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

    def solved_blocks(self, prediction: Prediction) -> Sequence[FloatArray]:
        """Derivatives of the rows by phases, and by the logarithm of an unknown gain."""
        ratio = self.solved(prediction, 1.0) / self.y
        columns = [both_parts(ratio)] if self.unknown == "gain" else []
        columns += [
            both_parts(np.where(self.groups == g, 1j * ratio, 0.0))
            for g in range(self.solved_inside - len(columns))
        ]
        return (np.stack(columns, axis=1),) if columns else super().solved_blocks(prediction)

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
        known = sigma if np.all(sigma > 0.0) else np.empty(0)
        shown = Panel(
            x=Axis("f", "Hz"),
            y=Axis("phase, simulated minus measured", "deg"),
            layers=(
                Layer(Role.START, Form.POINTS, f, off[0], label="start parameters"),
                Layer(
                    Role.SIMULATED, Form.POINTS, f, off[1], label="fitted parameters", sigma=known
                ),
            ),
            level=0.0,
        )
        rms = root_mean_square([off[1]])
        return worded(
            "phases",
            [[shown]],
            series=self.series,
            count=f.size,
            rms=rms,
            unknown=self.unknown,
        )

    def _line_values(self, batch: Batch, k: int, window: Window, output: str) -> Values:
        return batch.phasors(k, window, output)


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
