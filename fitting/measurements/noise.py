"""Noise spectrum: the power spectral density of an output under a random force.

    S = a N + b        r = sign(S - P) sqrt(2 M (P/S - 1 - ln(P/S)))        P measured

N is |H|^2 for a white force, |H|^2 F for one of known density F, and -4 Im H/(2 pi u m) for a
thermal one; H is the FMU's response to single tones. The squares of the rows add up to the deviance
of the Whittle likelihood: their least sum is its maximum. Level a and floor b are solved inside
(`best_levels`):

    a, b >= 0, least of  L(a, b) = sum_i M (ln S_i + P_i/S_i)

the negative logarithm of the likelihood of densities P_i that are averages over M periodograms:
P_i/S_i follows a Gamma distribution of shape M and mean 1. Source: P. Whittle, Ark. Mat. 2 (1953)
423; averages as in D. Percival and A. Walden, Spectral Analysis (1993), section 4.7.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property, partial
from typing import Annotated, Any, ClassVar

import numpy as np
import numpy.typing as npt
from scipy.constants import Boltzmann
from scipy.special import digamma, gammaincinv, polygamma

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.instruments import read_recording
from fitting.campaign.instruments.recording import Channel, Recording, Selection, unit_of
from fitting.campaign.instruments.roles import HOLDS, Density, density_of, relative_density
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import (
    DRAWN,
    Axis,
    Figure,
    Form,
    Layer,
    Role,
    compared,
    residual_points,
    worded,
)
from fitting.measurements.gain import Solved
from fitting.measurements.measurement import Estimated, Predicting, Prediction, Values
from fitting.measurements.records import (
    Curve,
    CurvesTogether,
    OfSetup,
    ReadColumn,
    RecordTable,
    check_pair,
    check_words,
)
from fitting.measurements.residuals import ResidualCurve, mistakes
from fitting.signal.roughness import MEDIAN_OF_NORMAL
from fitting.simulate.batch import Batch
from fitting.text.arguments import checked
from fitting.text.arrays import ComplexArray, FloatArray, as_numbers
from fitting.text.errors import BadInput, NoScale
from fitting.text.finding import Finding, Kind
from fitting.text.schema import (
    FileName,
    Keys,
    Missing,
    OneOf,
    Positive,
    Refused,
    Switch,
    Text,
    Value,
)
from fitting.text.units import above_zero, same_kind

WHITE, THERMAL, COLOURED = FORCES = ("white", "thermal", "coloured")
TAPERS = {"hann": np.hanning, "hamming": np.hamming, "blackman": np.blackman}
WINDOWS = ("none", *TAPERS)
#: Points of a spectrum, at least.
LEAST_POINTS = 8
#: Averages from which on the residuals are tested for correlated neighbours: of fewer, rows of a
#: right model have a mean.
TESTED_AVERAGES = 10.0
#: Length of a window by which its power spectrum is taken, and how many points that reaches.
LENGTH, REACH = 1024, 3
#: Every second point is used beside a window: neighbours are nearly one under it (of a Hann window
#: two points are worth 1.03), those two apart nearly independent (1/36).
EVERY = 2
#: How far a spacing of frequencies may be from the usual one where a window is told, relative.
EVEN = 1e-3
#: ln P/S of the table that leads from rows back to spectra: its ends, and points.
REACHED, TABULATED = 30.0, 60_001
#: Averages that are looked for where none are declared.
MOST, KNOTS = 1e7, 2000
#: Quantiles of the mean of a power over which the mean row is taken.
QUANTILES = 2000


#: Deviance of a point beyond which a spectrum is not followed at all, if a constant does as well.
FAR, AS_WELL = 3.0, 0.5


@dataclass(frozen=True, kw_only=True)
class NoiseSpectra(CurvesTogether["NoiseSpectrum"]):
    """One or several noise spectra that are fitted together, a row for each point.

    Raises:
        BadInput: no spectrum, two of one name, or a drive without a level.
    """

    FIELD = "spectra"

    spectra: tuple[NoiseSpectrum, ...] = ()

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
        """Its residuals show how neighbours are correlated, where enough was averaged."""
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
        values, solved = [], []
        for each, response in zip(self.spectra, responses, strict=True):
            shape = each.widened(each.shape(response))
            known = Boltzmann * each.temperature_k if each.is_absolute else None
            a, b = best_levels(shape, each.y, known, floor=each.floor)
            values.append(a * shape + b)
            solved.append(Solved(np.stack([shape, np.ones_like(shape)], axis=1), np.array([a, b])))
        return Prediction(np.concatenate(values), solved=tuple(solved))

    def solved_blocks(self, prediction: Prediction) -> Sequence[FloatArray]:
        """Derivatives of the rows by levels and floors."""
        blocks = []
        for each, solved in zip(self.spectra, prediction.solved, strict=True):
            shape, (a, b) = solved.design[:, 0], solved.coefficients
            slope = np.sqrt(each.count) / (a * shape + b)  # of a row near S = P
            columns = [] if each.is_absolute else [shape * slope]
            columns += [slope] if each.floor else []
            blocks.append(np.stack(columns, axis=1) if columns else np.empty((shape.size, 0)))
        return blocks

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


#: Share of the points that the band about the model holds.
INSIDE = 0.95


@checked
@dataclass(frozen=True, eq=False)
class NoiseSpectrum(OfSetup, Curve):
    """A power spectral density of one output of the FMU under a random force.

    Args:
        frequency_hz: Frequencies, shape (n,), Hz, rising; a first one of 0 is left out.
        density: One-sided power spectral density, shape (n,), ``unit`` squared per Hz, above zero.
        averages: Independent periodograms that were averaged, at least 1; None: estimated from the
            scatter.
        force: "white": constant density, level solved for; "thermal": as damping and temperature
            require; "coloured": known density, factor solved for.
        force_density: (coloured) density of the force, shape (n,), any unit, above zero.
        temperature_k: Of the resonator, K; 0: unknown, solved for.
        mass_kg: Where the FMU's drive is an acceleration, kg; 0: its drive is a force.
        spring_constant: Instead of the mass, N/m; 0: not used.
        drives_force: (thermal) whether there is a force or mass, for the temperature.
        floor: Whether a white floor is solved for.
        window: Of the periodograms, each one over the spacing of the frequencies long: widens the
            lines; every second point is used.
        settings: Start values of the FMU by variable, in the FMU's units.
        label: Name of the spectrum; required with several.
        output: The observed output of the FMU; empty: the setup's.
        unit: Whose square per Hz the density has.
        source: Its name in errors.
        left_out: What of its file is not used.
        setup: How tones drive the FMU, and the observed output.
        series: Measurements of one series share their setup.

    Raises:
        BadInput: shapes that differ, frequencies that do not rise, densities that are not above
            zero, fewer averages than one, a negative temperature, mass or spring constant.
    """

    NOUN = "noise spectrum"
    _TOGETHER = NoiseSpectra

    frequency_hz: npt.ArrayLike
    density: npt.ArrayLike
    _: KW_ONLY
    averages: float | None = None
    force: str = WHITE
    force_density: npt.ArrayLike | None = None
    temperature_k: float = 0.0
    mass_kg: float = 0.0
    spring_constant: float = 0.0
    drives_force: bool = True
    floor: bool = True
    window: str = "none"
    source: str = "noise spectrum"
    left_out: tuple[Finding, ...] = ()
    u_hz: FloatArray = field(init=False)
    pushed: FloatArray = field(init=False)
    observed_hz: FloatArray = field(init=False)
    y: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        u, y = (as_numbers(v, str(self.source)) for v in (self.frequency_hz, self.density))
        check_pair(str(self.source), "frequencies", u, "densities", y)
        if u.size <= LEAST_POINTS:
            raise BadInput(f"{self.source}: {u.size} densities; wanted more than {LEAST_POINTS}")
        for k in np.flatnonzero(np.diff(u) <= 0.0)[:1]:
            raise BadInput(
                f"{self.source}: point {k + 2}: frequency {u[k + 1]:.9g} Hz after {u[k]:.9g} Hz; "
                "wanted frequencies that rise"
            )
        if u[0] < 0.0:
            raise BadInput(f"{self.source}: frequency {u[0]:g} Hz; wanted none below zero")
        first = int(u[0] == 0.0)  # the mean is no noise
        u, y = u[first:], y[first:]
        for k in np.flatnonzero(y <= 0.0)[:1]:
            raise BadInput(
                f"{self.source}: density {y[k]:g} at {u[k]:.9g} Hz; wanted densities above zero, "
                "as they are, not in dB"
            )
        object.__setattr__(self, "u_hz", u)
        object.__setattr__(self, "pushed", self._pushed(first))
        every = 1 if self.window == "none" else EVERY
        object.__setattr__(self, "observed_hz", u[::every])
        object.__setattr__(self, "y", y[::every])
        self._check_numbers()

    def _pushed(self, first: int) -> FloatArray:
        """Density of the force (n,), its mean one, without what lies below the first point."""
        if (self.force == COLOURED) != (self.force_density is not None):
            raise BadInput(
                f'{self.source}: the density of a force goes with force = "{COLOURED}"; wanted '
                "both, or neither"
            )
        if self.force_density is None:
            return np.ones(self.u_hz.size)
        density = as_numbers(self.force_density, f"{self.source}: force_density")
        if density.shape != np.shape(self.density):
            raise BadInput(
                f"{self.source}: {density.shape} densities of the force and "
                f"{np.shape(self.density)} of the answer; wanted as many"
            )
        density = density[first:]
        for k in np.flatnonzero(~((density > 0.0) & np.isfinite(density)))[:1]:
            raise BadInput(
                f"{self.source}: density {density[k]:g} of the force at {self.u_hz[k]:.9g} Hz; "
                "wanted densities above zero, as they are, not in dB"
            )
        return np.asarray(density / np.mean(density))

    def _check_numbers(self) -> None:
        if self.averages is not None and not 1.0 <= self.averages < np.inf:
            raise BadInput(f"{self.source}: averages: found {self.averages:g}, wanted 1 or more")
        check_words(self, str(self.source), force=FORCES, window=WINDOWS)
        for name in ("temperature_k", "mass_kg", "spring_constant"):
            value = getattr(self, name)
            if not 0.0 <= value < np.inf:
                raise BadInput(f"{self.source}: {name}: found {value:g}, wanted more than zero")
            if value and self.force != THERMAL:
                raise BadInput(f'{self.source}: {name} has a meaning with force = "thermal" only')
        steps = np.diff(self.u_hz)
        if self.window != "none" and np.ptp(steps) > EVEN * float(np.median(steps)):
            raise BadInput(
                f"{self.source}: frequencies are {np.min(steps):.4g} to {np.max(steps):.4g} Hz "
                "apart; wanted even ones together with a window"
            )
        if self.mass_kg and self.spring_constant:
            raise BadInput(f"{self.source}: mass and spring constant; wanted one of them")

    @cached_property
    def count(self) -> float:
        """Number of averages, as declared, or from how the densities scatter.

        The logarithm of an average of M periodograms has the variance psi'(M); of second
        differences of neighbours that are independent it is six times as much, whatever the
        spectrum does slowly. The median of their sizes does not depend on the few points at a line.
        """
        if self.averages is not None:
            return float(self.averages)
        bent = np.diff(np.log(self.y), 2)
        variance = (float(np.median(np.abs(bent))) / MEDIAN_OF_NORMAL) ** 2 / 6.0
        counts = np.geomspace(1.0, MOST, KNOTS)
        falling = polygamma(1, counts)
        return float(np.exp(np.interp(-variance, -falling, np.log(counts))))

    @cached_property
    def sigma(self) -> float:
        """Standard deviation of a row, the signed root of its deviance; 0: by the residuals.

        The mean of the deviance is 2 M (ln M - psi(M)), near 1 + 1/(6 M).
        """
        if self.averages is None:
            return 0.0
        m = self.count
        return float(np.sqrt(2.0 * m * (np.log(m) - float(digamma(m)))))

    @property
    def row_sigma(self) -> float:
        """Standard deviation of its rows; zero where unknown."""
        return self.sigma

    @property
    def top_hz(self) -> float:
        """Where the density is largest, Hz."""
        return float(self.observed_hz[int(np.argmax(self.y))])

    @cached_property
    def mean_row(self) -> float:
        """Mean of the rows of a right model: few averages scatter more to one side."""
        chances = (np.arange(QUANTILES) + 0.5) / QUANTILES
        x = gammaincinv(self.count, chances) / self.count
        deviance = np.maximum(2.0 * self.count * (x - 1.0 - np.log(x)), 0.0)
        return float(np.mean(-np.sign(x - 1.0) * np.sqrt(deviance)))

    @property
    def is_curve(self) -> bool:
        """Whether its residuals may be tested for correlated neighbours."""
        return self.count >= TESTED_AVERAGES

    def widened(self, shape: FloatArray) -> FloatArray:
        """A density (n,) as periodograms under the window show it, at the points that are used.

        That of each point is shared among its neighbours by the window's own power spectrum, as
        1/6, 2/3, 1/6 for a Hann window.

        Args:
            shape: without a window, (n,).
        """
        if self.window == "none":
            return shape
        power = np.abs(np.fft.fft(TAPERS[self.window](LENGTH + 1)[:-1])) ** 2
        kernel = np.concatenate([power[-REACH:], power[: REACH + 1]])
        longer = np.pad(shape, REACH, mode="reflect", reflect_type="odd")
        observed = np.convolve(np.maximum(longer, 0.0), kernel / np.sum(kernel), "valid")
        return np.asarray(observed[::EVERY])

    @property
    def is_absolute(self) -> bool:
        """Whether the level is known: a temperature, of a displacement."""
        return bool(self.force == THERMAL and self.temperature_k and self.unit == "m")

    @property
    def solved_inside(self) -> int:
        """Level and floor, where they are not known."""
        return int(not self.is_absolute) + int(self.floor)

    def shape(self, response: ComplexArray) -> FloatArray:
        """Density N (n,) of a unit level.

            white      |H|^2                        level: that of the force
            coloured   |H|^2 F                      level: that of the force on average
            thermal    -4 Im H/(2 pi u m)           level: k_B T (times the square of a read-out)

        F is the density of the force over its mean. The thermal one is the fluctuation-dissipation
        theorem: the output has to be the coordinate that the drive pushes. Source: H. Callen and
        T. Welton, Phys. Rev. 83 (1951) 34.

        Args:
            response: H, (n,), output over drive.

        Raises:
            NoScale: a response that is zero, or gives energy back.
        """
        if self.force != THERMAL:
            return np.asarray(np.abs(response) ** 2 * self.pushed)
        w = 2.0 * np.pi * self.u_hz
        top = int(np.argmax(np.abs(response)))
        if response[top].imag >= 0.0:
            raise NoScale(
                f"{self.source}: the response does not lag its drive at its top, "
                f'{self.u_hz[top]:.6g} Hz; force = "thermal" wants the output that the drive '
                "pushes, and a drive without a phase"
            )
        share = 1.0 / self.mass_kg if self.mass_kg else 1.0
        if self.spring_constant:
            share = float((1.0 / response[top]).real + w[top] ** 2) / self.spring_constant
        return np.asarray(np.maximum(-4.0 * response.imag / w * share, 0.0))

    def residuals(self, simulated: FloatArray | ComplexArray) -> FloatArray:
        """Signed roots of the deviances, (n,).

            r = sign(S - P) sqrt(2 M (P/S - 1 - ln(P/S)))

        Args:
            simulated: S, (n,), as the model has it.
        """
        x = self.y / simulated.real
        apart = x - 1.0
        near = np.abs(apart) < 1e-4  # by its series: the difference would cancel
        deviance = np.where(near, 0.5 * apart**2 - apart**3 / 3.0, apart - np.log(x))
        return np.asarray(-np.sign(apart) * np.sqrt(2.0 * self.count * np.maximum(deviance, 0)))

    def share_left(self, rows: FloatArray) -> float:
        """NaN: its rows are no shares of an amplitude.

        Args:
            rows: residuals, (rows,).
        """
        return math.nan

    def residual_curve(self, at: slice, rows: FloatArray) -> ResidualCurve:
        """Its residuals over frequency; a share is one of the largest density.

        Args:
            at: which rows of the measurement these are.
            rows: residuals, (rows,).
        """
        # the spectrum S of which `residuals` makes these rows: P/x, x the root of the deviance
        logarithm = np.linspace(-REACHED, REACHED, TABULATED)
        deviance = 2.0 * self.count * (np.expm1(logarithm) - logarithm)
        table = -np.sign(logarithm) * np.sqrt(np.maximum(deviance, 0.0))
        spectrum = self.y / np.exp(np.interp(-rows, -table, logarithm))
        root = np.sqrt(self.count)
        columns = mistakes(self.observed_hz, spectrum, root / spectrum)
        columns[Kind.noise_level] = columns.pop(Kind.gain)
        return ResidualCurve(
            rows=np.arange(at.start, at.stop),
            share=spectrum / (root * np.max(spectrum)),  # of a row near S = P
            axis=self.observed_hz,
            centre=self.mean_row,
            name=self.label,
            columns=columns,
            first_order=frozenset(columns),  # the root of a deviance bends
        )

    def figure(self, before: Values, after: Values) -> Figure:
        """The model with the band that holds 95 % of the points; signed deviances below.

        Args:
            before: as simulated with the start parameters, (n,), in the spectrum's unit.
            after: with the fitted ones.
        """
        start, fitted = before.real, after.real
        every = slice(None, None, -(-self.observed_hz.size // DRAWN))
        u, x = self.observed_hz[every], Axis("frequency", "Hz")
        tails = 0.5 * (1.0 - INSIDE)
        low, high = gammaincinv(self.count, [tails, 1.0 - tails]) / self.count
        y = Axis("density" if self.unit == "1" else f"density ({self.unit}²/Hz)", log=True)
        band = "95 % of the points, if the model is right"
        shown = compared((x, y), u, self.y[every], start[every], fitted[every])
        bounds = (
            Layer(Role.OTHER, Form.CURVE, u, low * fitted[every], label=band),
            Layer(Role.OTHER, Form.CURVE, u, high * fitted[every]),
        )
        shown = replace(shown, layers=(*shown.layers, *bounds))
        rows = self.residuals(fitted)
        rest = residual_points((x, Axis("signed root of deviance")), u, [("", rows[every])])
        share = float(np.mean((self.y >= low * fitted) & (self.y <= high * fitted)))
        panels = [[shown], [rest]]
        return worded("noise", panels, label=self.label, spectrum=self, share=share)


#: Steps at most, and the relative change that ends them.
STEPS, SETTLED = 60, 1e-13
#: Halvings of a step that does not lead down.
HALVINGS = 30


def best_levels(
    shape: FloatArray, density: FloatArray, known: float | None, *, floor: bool = True
) -> FloatArray:
    """Levels a and b (2,) of the largest likelihood.

    Args:
        shape: N, (n,), zero or more.
        density: P, (n,), above zero.
        known: a where it is known; None: it is solved for.
        floor: whether b is solved for; else it is zero.
    """
    sizes = np.array([np.max(density) / (np.max(shape) or 1.0), np.max(density)])
    columns = np.stack([shape * sizes[0], np.full(shape.size, sizes[1])], axis=1)
    low = float(np.quantile(density, 0.25)) / sizes[1]
    levels = np.array([1.0 if known is None else known / sizes[0], low if floor else 0.0])
    free = np.array([known is None, floor])
    for _ in range(STEPS):
        step, before = _step(columns, density, levels, free), _loss(columns, density, levels)
        halved = (np.maximum(levels + 0.5**k * step, 0.0) for k in range(HALVINGS))
        downhill = (each for each in halved if _loss(columns, density, each) <= before)
        moved = next(downhill, levels)
        done = bool(np.all(np.abs(moved - levels) <= SETTLED * np.max(levels)))
        levels = moved
        if done:
            break
    return np.asarray(levels * sizes)


def _loss(columns: FloatArray, density: FloatArray, levels: FloatArray) -> float:
    s = columns @ levels
    if not np.all(s > 0.0):
        return np.inf
    return float(np.sum(np.log(s) + density / s))


def _step(
    columns: FloatArray, density: FloatArray, levels: FloatArray, free: npt.NDArray[np.bool_]
) -> FloatArray:
    """Newton's step of those that are free and not held at zero, or Fisher's."""
    s = columns @ levels
    slope = columns.T @ ((s - density) / s**2)
    moving = free & ~((levels <= 0.0) & (slope > 0.0))
    if not np.any(moving):
        return np.zeros(2)
    mine = columns[:, moving]
    for weights in ((2.0 * density - s) / s**3, 1.0 / s**2):
        curved = (mine * weights[:, None]).T @ mine
        if np.all(np.linalg.eigvalsh(curved) > 0.0):
            step = np.zeros(2)
            step[moving] = -np.linalg.solve(curved, slope[moving])
            return step
    return np.asarray(np.where(moving, -np.sign(slope) * 0.1 * np.max(levels), 0.0))


#: What a campaign may state of the resonator: by key the field of a record, and its unit.
STATED = {
    "temperature": ("temperature_k", "K"),
    "mass": ("mass_kg", "kg"),
    "spring_constant": ("spring_constant", "N/m"),
}


@dataclass(frozen=True, kw_only=True)
class WrittenNoiseColumns(Keys):
    """Names of a noise spectrum's columns where they are not the usual ones (empty)."""

    frequency: Text = ""
    """Column of frequencies; without it "frequency"."""
    density: Text = ""
    """Column of the power spectral density; without it "density"."""
    force: Text = ""
    """(coloured) column of the force's density, in any unit; without it "force"."""


@dataclass(frozen=True, kw_only=True)
class NoiseSpectrumTable(RecordTable):
    """A power spectral density of one output of the FMU under a random force.

    Several of these tables are fitted together.
    """

    TABLE: ClassVar[str] = "noise_spectrum"
    TOGETHER = NoiseSpectra

    file: Annotated[FileName, Missing("wanted a table of frequencies and densities with units")]
    """Columns frequency and density, each with its unit, as "density (V2/Hz)"; one-sided."""
    averages: Positive | None = None
    """Independent periodograms that were averaged; without it from the scatter."""
    columns: WrittenNoiseColumns = field(default_factory=WrittenNoiseColumns)
    """Columns of other than the usual names."""
    holds: Annotated[Text | None, OneOf(HOLDS)] = None
    """"density" or its "root", of a column whose unit does not state it: then relative numbers."""
    force: Annotated[Text, OneOf(FORCES)] = WHITE
    """"white": of constant density; "thermal": as the damping requires; "coloured": with a density
    in a column."""
    temperature: Value | None = None
    """(thermal) of the resonator, as "300 K"; without it solved for, of a displacement."""
    mass: Value | None = None
    """(thermal) of the mode, if the FMU's drive is an acceleration; without it a force."""
    spring_constant: Value | None = None
    """(thermal) instead of the mass."""
    floor: Switch = True
    """Whether a white floor is solved for."""
    window: Annotated[Text, OneOf(WINDOWS)] = "none"
    """Of the periodograms, each one over the spacing of the frequencies long."""

    def __post_init__(self) -> None:
        if self.averages is not None and self.averages < 1.0:
            raise Refused(f"found {self.averages:g}, wanted 1 or more", "averages")
        for key in ("temperature", "mass", "spring_constant"):
            if getattr(self, key) is not None and self.force != THERMAL:
                raise Refused('has a meaning with force = "thermal" only', key)
        if self.mass is not None and self.spring_constant is not None:
            raise Refused("is given together with mass; wanted one of them", "spring_constant")

    def record(self, label: str) -> NoiseSpectrum:
        """The columns of the file, in SI units.

        Args:
            label: of the spectrum.

        Raises:
            BadInput: a column or unit that is missing, or no unit of a power spectral density.
        """
        names = self.columns
        given = Selection(
            frequency=names.frequency,
            amplitude=names.density,
            further=(names.force,) if names.force else (),
        )
        table = read_recording(self.file, selection=given)
        frequency = self._column(table, names.frequency, "frequency")
        density = self._column(table, names.density, "density")
        f = ReadColumn.of(table, frequency, "frequency (Hz)").into("Hz")
        read = self._density(table, density)
        force, column = None, None
        if self.force == COLOURED:
            column = self._column(table, names.force, "force")
            force = table.numbers(column)
        elif names.force:
            raise BadInput(f'{self.file}: columns.force has a meaning with force = "{COLOURED}"')
        return NoiseSpectrum(
            f.values,
            read.numbers,
            averages=self.averages,
            force=self.force,
            force_density=force,
            floor=self.floor,
            window=self.window,
            label=label,
            unit=read.unit,
            source=str(self.file),
            left_out=table.unused(frequency, density, column),
        )

    def checks(self, binder: Binder, setup: Setup) -> Iterator[Callable[[], object]]:
        """What examines each name and value by itself, what is stated of the resonator as well."""
        yield from super().checks(binder, setup)
        for key, (_, unit) in STATED.items():
            yield partial(above_zero, getattr(self, key), unit)

    def known(self, binder: Binder, setup: Setup) -> dict[str, Any]:
        """Settings, output, what is stated of the resonator, whether the drive is a force."""
        stated = {
            name: above_zero(getattr(self, key), unit) for key, (name, unit) in STATED.items()
        }
        drives_force = self._drives_force(binder, setup)
        return super().known(binder, setup) | stated | {"drives_force": drives_force}

    def _density(self, table: Recording, column: Channel) -> Density:
        """The column as a density, by its unit or by the campaign's declaration of its content."""
        where = f"{self.file}: column '{column.name}'"
        result = None if column.unit is None else density_of(table.numbers(column), column.unit)
        if result is None and self.holds is not None:
            result = relative_density(table.numbers(column), column.unit, self.holds)
        if result is None:
            unit = unit_of(table, column, "density (V2/Hz)")
            raise BadInput(
                f"{where}: found unit '{unit}', wanted that of a power spectral density, as V2/Hz "
                'or nm2/Hz, or of its root, as V/√Hz; or holds = "density" or "root" in '
                f"[[{self.TABLE}]], of relative numbers"
            )
        if result.is_relative and self.temperature is not None:
            raise BadInput(
                f"{where}: its numbers are relative ones; wanted a unit, as V2/Hz, with a "
                "temperature"
            )
        return result

    def _column(self, table: Recording, name: str, usual: str) -> Channel:
        """A column by its name in the campaign, else by its usual one."""
        if name or table.find(usual) is not None:
            return table.column(name or usual)
        there = ", ".join(column.name for column in table.channels)
        raise BadInput(
            f"{self.file}: no column '{usual}'; there is: {there}; wanted its name in "
            f'[[{self.TABLE}]], as columns = {{ {usual} = "NAME" }}'
        )

    def _drives_force(self, binder: Binder, setup: Setup) -> bool:
        """Whether the drive is a force, or an acceleration of a mass that is given.

        Raises:
            BadInput: a temperature is given, and the mass of an acceleration is not.
        """
        drive = setup.drive
        names = [n for n in (*drive.amplitude_names, drive.input) if n in binder.variables]
        units = [binder.variables[n].unit or "" for n in names if n is not None]
        accelerates = any(same_kind(unit, "m/s**2") for unit in units if unit)
        if not accelerates or self.mass is not None or self.spring_constant is not None:
            return True
        if self.temperature is not None:
            raise BadInput(
                f"{setup.source}: [[{self.TABLE}]] temperature: the FMU's drive is an "
                "acceleration; wanted mass or spring_constant with it"
            )
        return False
