"""Complex tones: amplitudes and phases of a steady response at the frequencies that drive it.

    r = S/y - 1        y measured, S = chi exp(i phi_g) z of what the FMU answers, z

Two rows for each line, all real parts (along y) before all imaginary ones (across it): for small
residuals those of the amplitude, as `tones` has them, and those of the phase in rad. Lock-in
amplifiers give such values; output(t) = Re[z exp(i 2 pi u t)], a drive of phase zero.

What nobody knows of the detector is solved inside every evaluation: the phase phi_g of every group
of lines, which ends where the instrument was restarted, and with an unknown gain the modulus chi,
which else is that of the series (`fitting.measurements.complex.gain`, with h = z/y and y = 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from fitting.campaign import Experiment
from fitting.measurements.complex.gain import gains_of
from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.measurements.measurement import Prediction, Values
from fitting.measurements.tones import Tones
from fitting.signal.window import Window
from fitting.simulate.batch import Batch
from fitting.text.arrays import ComplexArray, FloatArray, IntArray, both_parts
from fitting.text.errors import BadInput
from fitting.text.notation import number


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
