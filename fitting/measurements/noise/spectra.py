"""Noise spectrum: the power spectral density of an output under a random force.

    S = a N + b        r = sign(S - P) sqrt(2 M (P/S - 1 - ln(P/S)))        P measured

N is |H|^2 for a white force, |H|^2 F for one of known density F, and -4 Im H/(2 pi u m) for a
thermal one; H is the FMU's response to single tones. The squares of the rows add up to the deviance
of the Whittle likelihood: their least sum is its maximum. Level a and floor b are solved inside
(`noise.levels`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.constants import Boltzmann
from scipy.linalg import block_diag

from fitting.campaign import Setup
from fitting.measurements.complex.gain import Solved
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import Figure
from fitting.measurements.measurement import (
    Estimated,
    Predicting,
    Prediction,
    Values,
)
from fitting.measurements.noise.figure import noise_figure
from fitting.measurements.noise.levels import best_levels
from fitting.measurements.noise.record import THERMAL, NoiseRecord
from fitting.measurements.record import OfSetup
from fitting.measurements.together import CurvesTogether
from fitting.simulate.batch import Batch
from fitting.text.arguments import checked
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput

#: Deviance of a point beyond which a spectrum is not followed at all, if a constant does as well.
FAR, AS_WELL = 3.0, 0.5


@checked
@dataclass(frozen=True, eq=False)
class NoiseSpectrum(NoiseRecord, OfSetup):
    """A power spectral density of one output of the FMU under a random force.

    Args:
        frequency_hz: Frequencies, shape (n,), Hz, rising; a first one of 0 is left out.
        density: One-sided power spectral density, shape (n,), ``unit`` squared per Hz, above zero.
        averages: Number of independent periodograms that were averaged, 1 or more; None: not
            known, and the scatter of the points tells it and the errors.
        force: "white": a force of constant density, whose level is solved for; "thermal": the one
            that the damping asks for at a temperature; "coloured": one whose density is known but
            for a factor, which is solved for.
        force_density: (coloured) density of the force at the frequencies, shape (n,), in any unit,
            above zero; it is taken as exact.
        temperature_k: Of the resonator, K; 0: not known, and solved for.
        mass_kg: Where the FMU's drive is an acceleration; 0: its drive is a force.
        spring_constant: Instead of the mass, N/m; 0: not told.
        drives_force: (thermal) Whether the drive is a force, or its mass is told: else no
            temperature is told.
        floor: Whether a white floor is solved for.
        window: Of the periodograms, whose length is one over the spacing of the frequencies: it
            widens the lines, and every second point is used, as neighbours are correlated by it.
        settings: Start values of the FMU by variable, in the FMU's units.
        label: Name of the spectrum, for values of its own; wanted where there are several.
        output: The FMU's output that is seen; empty: the setup's.
        unit: Whose square per Hz the density has.
        source: What complaints name it by.
        setup: How single tones drive the FMU, and what is observed.
        series: Measurements of one series share their setup.

    Raises:
        BadInput: shapes that differ, frequencies that do not rise, densities that are not above
            zero, fewer averages than one, a negative temperature, mass or spring constant.
    """

    def within(self, setup: Setup, series: str) -> NoiseSpectra:
        """The measurement, as part of a series that is driven so.

        Args:
            setup: how the series drives the FMU.
            series: its name.
        """
        return NoiseSpectra(setup=setup, spectra=(self,)).within(setup, series)


@dataclass(frozen=True, kw_only=True)
class NoiseSpectra(CurvesTogether[NoiseRecord]):
    """One or several noise spectra that are fitted together, a row for each point.

    Raises:
        BadInput: no spectrum, two of one name, or a drive without a level.
    """

    FIELD = "spectra"
    NOUN = "noise spectrum"

    spectra: tuple[NoiseRecord, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.setup.drive.amplitude > 0.0:
            raise BadInput(
                "noise spectrum: the drive's level is zero; wanted one, for the response to tones"
            )

    @property
    def datum_noise(self) -> float:
        """Relative standard deviation of the amplitude in a bin, half of that of its density."""
        return float(0.5 / np.sqrt(max(each.count for each in self.spectra)))

    @property
    def is_curve(self) -> bool:
        """Its residuals tell how neighbours are correlated, where enough was averaged."""
        return all(each.is_curve for each in self.spectra)

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        """Spectra with the levels and floors that suit the data best."""
        result = yield from self.responses(model, table, batch)
        size = model.setup.drive.amplitude
        return [
            self.solved([responses[k] / size for responses in result]) for k in range(len(table))
        ]

    def solved(self, responses: Sequence[ComplexArray]) -> Prediction:
        """Spectra that responses make, with the best levels and floors.

        Args:
            responses: H of every spectrum, (n,), output over drive.
        """
        pairs = zip(self.spectra, responses, strict=True)
        shapes = tuple(x.widened(x.shape(h)) for x, h in pairs)
        levels = tuple(
            best_levels(shape, each.y, each.known_level, floor=each.floor)
            for each, shape in zip(self.spectra, shapes, strict=True)
        )
        values, solved = [], []
        for shape, (a, b) in zip(shapes, levels, strict=True):
            values.append(a * shape + b)
            solved.append(Solved(np.stack([shape, np.ones_like(shape)], axis=1), np.array([a, b])))
        return Prediction(np.concatenate(values), solved=tuple(solved))

    def solved_columns(self, prediction: Prediction) -> FloatArray:
        """Derivatives of the rows by levels and floors."""
        blocks = []
        for each, solved in zip(self.spectra, prediction.solved, strict=True):
            shape, (a, b) = solved.design[:, 0], solved.coefficients
            slope = np.sqrt(each.count) / (a * shape + b)  # of a row near S = P
            columns = [] if each.is_absolute else [shape * slope]
            columns += [slope] if each.floor else []
            blocks.append(np.stack(columns, axis=1) if columns else np.empty((shape.size, 0)))
        return np.asarray(block_diag(*blocks))

    def qualities(self, prediction: Prediction, sigma: FloatArray) -> Mapping[str, Estimated]:
        """Temperature, or the read-out in volts per metre, of every thermal spectrum."""
        columns, begin = self.solved_columns(prediction) / sigma[:, None], 0
        result: dict[str, Estimated] = {}
        # levels and floors have units of their own: of one size, so that none counts for nothing
        sizes = np.linalg.norm(columns, axis=0)
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        inverse = np.linalg.pinv((columns / sizes).T @ (columns / sizes)) / np.outer(sizes, sizes)
        for each, solved in zip(self.spectra, prediction.solved, strict=True):
            a = float(solved.coefficients[0])
            at, begin = begin, begin + each.solved_inside
            if each.force != THERMAL or each.is_absolute or not a > 0.0:
                continue
            tag, std = f"[{each.label}]" if each.label else "", float(np.sqrt(inverse[at, at]))
            if each.temperature_k:
                value = float(np.sqrt(a / (Boltzmann * each.temperature_k)))
                result[f"read-out in {each.unit}/m{tag}"] = Estimated(value, 0.5 * value * std / a)
            elif each.unit == "m" and each.drives_force:
                result[f"temperature in K{tag}"] = Estimated(a / Boltzmann, std / Boltzmann)
        return result

    def unexplained(self, residuals: FloatArray) -> str:
        """Spectra that a constant describes half as well, and that are far off."""
        flat = np.concatenate([x.residuals(np.full(x.y.size, np.mean(x.y))) for x in self.spectra])
        left = float(residuals @ residuals)
        if left > AS_WELL * float(flat @ flat) and left > FAR * residuals.size:
            return "the simulated spectrum does not follow the measured one"
        return ""

    def figure_of(
        self,
        record: NoiseRecord,
        before: Values,
        after: Values,
    ) -> Figure:
        """A spectrum with the model, the band of its likelihood, and the signed deviances."""
        return noise_figure(record, before.real, after.real, self.series)
