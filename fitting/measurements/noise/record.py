"""Noise record: a power spectral density as measured, and what is known of its force."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.constants import Boltzmann
from scipy.special import digamma, gammaincinv, polygamma

from fitting.measurements.record import Curve, Record
from fitting.measurements.residual_curve import ResidualCurve, mistakes
from fitting.text.arrays import ComplexArray, FloatArray, as_numbers, require_size
from fitting.text.errors import BadInput, NoScale
from fitting.text.finding import Kind

WHITE, THERMAL, COLOURED = FORCES = ("white", "thermal", "coloured")
TAPERS = {"hann": np.hanning, "hamming": np.hamming, "blackman": np.blackman}
WINDOWS = ("none", *TAPERS)
#: Points of a spectrum, at least.
LEAST_POINTS = 8
#: Averages from which on the residuals are asked whether neighbours are correlated: of fewer, rows
#: of a right model have a mean.
SEEN = 10.0
#: Length of a window by which its power spectrum is taken, and how many points that reaches.
LENGTH, REACH = 1024, 3
#: Every second point is used beside a window: neighbours are nearly one under it (of a Hann window
#: two points are worth 1.03), those two apart nearly independent (1/36).
EVERY = 2
#: How far a spacing of frequencies may be from the usual one where a window is told, relative.
EVEN = 1e-3
#: ln P/S of the table that leads from rows back to spectra: its ends, and points.
REACHED, TABULATED = 30.0, 60_001
#: Quantiles of the mean of a power over which the mean row is taken.
QUANTILES = 2000


@dataclass(frozen=True, eq=False)
class NoiseRecord(Record, Curve):
    """A power spectral density of one output of the FMU under a random force.

    `fitting.NoiseSpectrum` explains its fields.

    Raises:
        BadInput: shapes that differ, frequencies that do not rise, densities that are not above
            zero, fewer averages than one, a negative temperature, mass or spring constant.
    """

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
    u_hz: FloatArray = field(init=False)
    pushed: FloatArray = field(init=False)
    seen_hz: FloatArray = field(init=False)
    y: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        u, y = (as_numbers(v, str(self.source)) for v in (self.frequency_hz, self.density))
        if u.ndim != 1 or u.shape != y.shape or u.size < LEAST_POINTS + 1:
            raise BadInput(
                f"{self.source}: {u.shape} frequencies and {y.shape} densities; wanted as many of "
                f"both, more than {LEAST_POINTS}"
            )
        if not (np.isfinite(u).all() and np.isfinite(y).all()):
            raise BadInput(f"{self.source}: wanted finite numbers")
        require_size(u, f"{self.source}: frequencies")
        require_size(y, f"{self.source}: densities")
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
        object.__setattr__(self, "seen_hz", u[::every])
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
        for name, known in (("force", FORCES), ("window", WINDOWS)):
            if getattr(self, name) not in known:
                raise BadInput(
                    f"{self.source}: {name} is {getattr(self, name)!r}, wanted {', '.join(known)}"
                )
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
        """Number of averages, as declared or seen."""
        return averages_seen(self.y) if self.averages is None else float(self.averages)

    @cached_property
    def sigma(self) -> float:
        """Standard deviation of a row: of the signed root of its deviance; 0: residuals tell it.

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
        return float(self.seen_hz[int(np.argmax(self.y))])

    @cached_property
    def mean_row(self) -> float:
        """Mean of the rows of a right model: few averages scatter more to one side."""
        chances = (np.arange(QUANTILES) + 0.5) / QUANTILES
        x = gammaincinv(self.count, chances) / self.count
        deviance = np.maximum(2.0 * self.count * (x - 1.0 - np.log(x)), 0.0)
        return float(np.mean(-np.sign(x - 1.0) * np.sqrt(deviance)))

    @property
    def is_curve(self) -> bool:
        """Whether its residuals may be asked how neighbours are correlated."""
        return self.count >= SEEN

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
    def known_level(self) -> float | None:
        """k_B T where it is known, J; None: the level is solved for."""
        return Boltzmann * self.temperature_k if self.is_absolute else None

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
        spectrum, root = self.spectrum_of(rows), np.sqrt(self.count)
        columns = mistakes(self.seen_hz, spectrum, root / spectrum)
        columns[Kind.noise_level] = columns.pop(Kind.gain)
        return ResidualCurve(
            rows=np.arange(at.start, at.stop),
            share=spectrum / (root * np.max(spectrum)),  # of a row near S = P
            axis=self.seen_hz,
            centre=self.mean_row,
            name=self.label,
            columns=columns,
            first_order=frozenset(columns),  # the root of a deviance bends
        )

    def spectrum_of(self, rows: FloatArray) -> FloatArray:
        """S (n,) of which `residuals` makes these rows: P/x, x the root of the deviance.

        Args:
            rows: signed roots of the deviances, (n,).
        """
        logarithm = np.linspace(-REACHED, REACHED, TABULATED)
        deviance = 2.0 * self.count * (np.expm1(logarithm) - logarithm)
        table = -np.sign(logarithm) * np.sqrt(np.maximum(deviance, 0.0))
        return np.asarray(self.y / np.exp(np.interp(-rows, -table, logarithm)))


#: Median of |x| over its standard deviation, of a normal x.
MEDIAN = 0.6744897501960817
#: Averages that are looked for.
MOST, KNOTS = 1e7, 2000


def averages_seen(density: FloatArray) -> float:
    """How many periodograms were averaged, 1 or more, from how a density scatters.

    The logarithm of an average of M periodograms has the variance psi'(M); of second differences of
    neighbours that are independent it is six times as much, whatever the spectrum does slowly. The
    median of their sizes does not see the few points at a line.

    Args:
        density: at points that scatter independently, (n,), above zero.
    """
    bent = np.diff(np.log(density), 2)
    variance = (float(np.median(np.abs(bent))) / MEDIAN) ** 2 / 6.0
    counts = np.geomspace(1.0, MOST, KNOTS)
    falling = polygamma(1, counts)
    return float(np.exp(np.interp(-variance, -falling, np.log(counts))))
