"""Avoided crossings with known truth: whole spectra over a voltage, of two modes or of three.

    f1 = a0 + a1 V + a2 V^2 + c t        f2 = b0 + b1 V + c t        f3 = e0 + b1 V + c t

A force drives the first mode and its amplitude is read, at voltages in random order, while all
frequencies drift with the time t and the detector's gain wanders from spectrum to spectrum. The
spectra come from the sample of `fitting.lab.modes`, dense in hybridised coordinates, with noise on
both quadratures; `ChainResponse` answers fits in place of the FMU, by elimination along the chain
in physical ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import fitting as ff
from fitting.fit.problem import Problem as Record
from fitting.lab.modes import CoupledModes
from fitting.measurements.control_sweep import ControlSweep
from fitting.measurements.measurement import Evaluation, Measurement, Prediction
from fitting.text.arrays import ComplexArray, FloatArray, Scalar

LAWS = {"f1": "a0 + a1*V + a2*V**2 + c*t", "f2": "b0 + b1*V + c*t", "f3": "e0 + b1*V + c*t"}
UNITS = {
    "a0": "Hz",
    "a1": "Hz/V",
    "a2": "Hz/V**2",
    "b0": "Hz",
    "b1": "Hz/V",
    "e0": "Hz",
    "c": "Hz/s",
}


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """What a laboratory looks for: its truth, and the start and the box that it is given."""

    name: str
    truth: float
    start: float
    low: float
    high: float

    @property
    def parameter(self) -> ff.Parameter:
        return ff.Parameter(
            self.name, self.start, bounds=(self.low, self.high), unit=UNITS.get(self.name, "Hz")
        )


@dataclass(frozen=True, kw_only=True)
class CrossingLaboratory:
    """One sample and its map: `amplitude` (spectra, points), `sigma` (spectra,), both in V."""

    seed: int
    modes: int
    unknowns: tuple[Unknown, ...]
    volts: FloatArray
    times_s: FloatArray
    frequency_hz: FloatArray
    amplitude: FloatArray
    sigma: FloatArray
    start: Mapping[str, Scalar] = field(default_factory=dict)

    @property
    def truth(self) -> dict[str, float]:
        return {u.name: u.truth for u in self.unknowns}

    @property
    def couplings(self) -> tuple[str, ...]:
        return tuple(f"lambda{k}{k + 1}" for k in range(1, self.modes))

    @property
    def measurement(self) -> ControlSweep:
        spectra = [
            ff.ControlSpectrum(
                self.frequency_hz, row, {"V": float(volt), "t": float(time)}, sigma=float(sigma)
            )
            for row, volt, time, sigma in zip(
                self.amplitude, self.volts, self.times_s, self.sigma, strict=True
            )
        ]
        setup = ff.Setup(
            ff.Drive(frequency_names=("u1",), amplitude_names=("A1",)),
            "q1",
            start_values={"periodic_start": True, "A2": 0.0, **self.start},
            steady_start=True,
            laws=ff.Laws({f"f{k}": LAWS[f"f{k}"] for k in range(1, self.modes + 1)}),
        )
        units = {"V": "V", "t": "s"}
        return ff.ControlSweep(setup=setup, spectra=tuple(spectra), units=units, estimated=False)

    def through(self, fmu: ff.Fmu) -> ff.Problem:
        """The problem through the FMU."""
        return ff.Problem(fmu, [u.parameter for u in self.unknowns], self.measurement)

    def by_closed_form(self, fmu: ff.Fmu) -> ff.Problem:
        """The problem with the closed form in place of the FMU, whose variables are read alone."""
        record = self.through(fmu).record
        return ff.Problem.answered_by(lambda chosen: ChainResponse(record, self.modes), record)


def laboratory(
    seed: int, *, modes: int = 2, noise: float | None = None, spectra: int = 41, points: int = 401
) -> CrossingLaboratory:
    """A sample of 1 kHz to 10 MHz with Q of 100 to 1e5, lines 0.4 to 8 widths apart at the closest.

    Args:
        seed: of everything.
        modes: 2 or 3.
        noise: standard deviation as a share of each spectrum's largest amplitude; None: 0.5 to 3 %,
            drawn.
        spectra: number of voltages.
        points: of each spectrum.
    """
    rng = np.random.default_rng([seed, modes])
    centre = 10.0 ** rng.uniform(3.0, 7.0)
    width = centre / 10.0 ** rng.uniform(2.0, 5.0)
    gaps = width * np.exp(rng.uniform(np.log(0.4), np.log(8.0), modes - 1))
    widths = width * np.exp(rng.normal(0.0, 0.3, modes))
    reach = float(rng.uniform(2.0, 4.0)) * (np.max(gaps) + width)
    volt = 10.0 ** rng.uniform(-1.0, 1.5)
    truth = _sample(rng, modes, centre, volt, reach, width)
    volts = volt * np.linspace(-1.0, 1.0, spectra)
    order = rng.permutation(spectra)
    times = np.empty(spectra)
    times[order] = 60.0 * np.arange(spectra)
    truth |= {f"d{k + 1}": float(d) for k, d in enumerate(widths)}
    truth |= {f"lambda{k + 1}{k + 2}": float(np.sqrt(gap * centre)) for k, gap in enumerate(gaps)}
    u = _swept(truth, modes, volts, times, points, width)
    exact = np.array(
        [response_of(truth, modes, v, t, u) for v, t in zip(volts, times, strict=True)]
    )
    gain = np.exp(np.cumsum(0.02 * rng.standard_normal(spectra)))[np.argsort(order)]
    exact *= gain[:, None] / np.max(np.abs(exact))
    share = 10.0 ** rng.uniform(-2.3, -1.5) if noise is None else noise
    sigma = share * np.max(np.abs(exact), axis=1)
    one, other = rng.standard_normal((2, *exact.shape))
    measured = exact + sigma[:, None] * (one + 1j * other)
    return CrossingLaboratory(
        seed=seed,
        modes=modes,
        unknowns=tuple(_unknown(rng, n, v, width, volt, times) for n, v in truth.items()),
        volts=volts,
        times_s=times,
        frequency_hz=u,
        amplitude=np.abs(measured),
        sigma=sigma,
        start={f"g{k}": 0.0 for k in range(2, modes + 1)},
    )


def _sample(
    rng: np.random.Generator, modes: int, centre: float, volt: float, reach: float, width: float
) -> dict[str, float]:
    """Coefficients of the laws: the first mode is tuned through the second, beside a third."""
    slope = reach / volt * float(rng.choice([-1.0, 1.0]))
    found = {
        "a0": centre + width * rng.uniform(-1.0, 1.0),
        "a1": slope,
        "a2": slope / volt * rng.uniform(-0.15, 0.15),
        "b0": centre,
        "b1": -slope * rng.uniform(0.0, 0.2),
        "c": width * rng.uniform(-1.0, 1.0) / 2400.0,
    }
    if modes == 3:
        found["e0"] = centre + reach * rng.uniform(0.3, 0.7)
    return {name: float(value) for name, value in found.items()}


def _frequencies(truth: Mapping[str, Any], modes: int, volt: float, time: float) -> list[Any]:
    """Of every mode without coupling, Hz: numbers, or arrays of the shape of what is given."""
    drift = truth["c"] * time
    f1 = truth["a0"] + truth["a1"] * volt + truth["a2"] * volt**2 + drift
    return [f1, *(truth[n] + truth["b1"] * volt + drift for n in ("b0", "e0")[: modes - 1])]


def _sampled(truth: Mapping[str, float], modes: int, volt: float, time: float) -> CoupledModes:
    coupling = {(k, k + 1): truth[f"lambda{k + 1}{k + 2}"] for k in range(modes - 1)}
    return CoupledModes(
        f_hz=tuple(_frequencies(truth, modes, volt, time)),
        d_hz=tuple(truth[f"d{k + 1}"] for k in range(modes)),
        coupling_hz=coupling,
        gains=(1.0, *(0.0,) * (modes - 1)),
    )


def response_of(
    truth: Mapping[str, float], modes: int, volt: float, time: float, u: FloatArray
) -> ComplexArray:
    """Complex response of the first mode to a force on it at frequencies u, Hz."""
    return np.asarray(_sampled(truth, modes, volt, time).response(u)[:, 0])


def _swept(
    truth: Mapping[str, float],
    modes: int,
    volts: FloatArray,
    times: FloatArray,
    points: int,
    width: float,
) -> FloatArray:
    """Frequencies (points,) over all lines, three widths beyond them."""
    pairs = zip(volts, times, strict=True)
    lines = [_sampled(truth, modes, v, t).eigenfrequencies_hz() for v, t in pairs]
    return np.linspace(np.min(lines) - 3.0 * width, np.max(lines) + 3.0 * width, points)


def _unknown(
    rng: np.random.Generator, name: str, truth: float, width: float, volt: float, times: FloatArray
) -> Unknown:
    """A box that a laboratory would give, and a start somewhere off the truth."""
    if name.startswith(("lambda", "d")):
        start = truth * float(np.exp(rng.normal(0.0, 0.3)))
        factor = float(rng.choice([4.0, 10.0]))
        return Unknown(name=name, truth=truth, start=start, low=start / factor, high=start * factor)
    size = {"a1": width / volt, "b1": width / volt, "a2": width / volt**2, "c": width / 2400.0}
    unit = size.get(name, width)
    start = truth + unit * float(rng.uniform(-0.7, 0.7))
    half = unit * float(rng.uniform(3.0, 10.0))
    return Unknown(name=name, truth=truth, start=start, low=start - half, high=start + half)


@dataclass(frozen=True)
class ChainResponse:
    """`Response` of a problem whose model is a chain of modes, driven and read at its first.

    With a_j = (f_j - u)(f_j + u) + i u d_j, from the end of the chain to its first mode,

        c_j = a_j - lambda_j^4/c_(j+1)        x_1 = 1/((2 pi)^2 c_1)
    """

    record: Record
    modes: int
    asked: tuple[Measurement, ...] = ()

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        [measured] = self.asked or self.record.measurements
        assert isinstance(measured, ControlSweep)
        columns = np.array([np.asarray(p, dtype=float) for p in ps]).T[..., None]
        named = {q.name: column for q, column in zip(self.record.parameters, columns, strict=True)}
        found = np.concatenate([self._amplitudes(s, named) for s in measured.spectra], axis=1)
        return [Evaluation((Prediction(row),), 1) for row in found]

    def answering(self, measurements: tuple[Measurement, ...]) -> ChainResponse:
        return replace(self, asked=measurements)

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [{} for _ in ps]

    def _amplitudes(self, spectrum: ff.ControlSpectrum, p: Mapping[str, FloatArray]) -> FloatArray:
        """Amplitudes (k, points) of one spectrum for parameters (k, 1) by name."""
        volt, time = (float(spectrum.settings[name]) for name in ("V", "t"))
        f = _frequencies(p, self.modes, volt, time)
        u = spectrum.u_hz
        below: ComplexArray | float = np.inf
        for k in range(self.modes, 0, -1):
            own = (f[k - 1] - u) * (f[k - 1] + u) + 1j * (u * p[f"d{k}"])
            below = own if k == self.modes else own - p[f"lambda{k}{k + 1}"] ** 4 / below
        return np.asarray(1.0 / ((2.0 * np.pi) ** 2 * np.abs(below)))
