"""The bench of the virtual laboratory: drift and noise from a seed, a sweep, a series of drives.

A sample gives the truth, an instrument (`fitting.lab.instruments`) reads it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from fitting.lab.string import Drive, TwoModes
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.toml import Tables

Cell = float | str
#: What the FMUs call the modes.
OUTPUTS = ("q1_hybrid", "q2_hybrid")
#: What the FMUs call what drifts, in the order of the modes.
DRIFTING = ("eta_plus", "eta_minus")


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Everything that the virtual laboratory does: the truth and how it is measured.

    ``sample`` is as it is at the middle of the series, ``observed`` one of its modes, 0 or 1.
    ``pairs_hz`` are driven one after the other, each tone with the level of its pair (m/s^2, 1
    without ``levels``). ``drift_hz`` is the linear change of both eigenfrequencies over the series,
    ``curvature_hz`` the departure from linear at its middle. The sweep is driven with
    ``weak_level``, ``crest_v`` is the height of its maximum in volts. ``noise_scale`` multiplies
    every source of randomness (0: exact), ``floor_v`` is the range of the mean noise magnitude,
    ``eta_error_hz`` the error of a measured eigenfrequency. ``resolution_hz`` is the spectrum
    analyser's bandwidth and point distance; spans are full spans.

    Raises:
        ValueError: no such mode, nothing that is driven, or numbers that are no bench.
    """

    series: str
    sample: Sample
    observed: int
    pairs_hz: tuple[tuple[float, float], ...]
    instrument: Instrument
    drift_hz: float = 100.0
    curvature_hz: float = 5.0
    crest_v: float = 40e-6
    floor_v: tuple[float, float] = (0.2e-6, 0.3e-6)
    eta_error_hz: float = 0.2
    noise_scale: float = 1.0
    resolution_hz: float = 1.0
    spectrum_span_hz: float = 500.0
    sweep_span_hz: float = 600.0
    sweep_step_hz: float = 5.0
    levels: tuple[float, ...] = ()
    weak_level: float = 1.0

    def __post_init__(self) -> None:
        if self.observed not in (0, 1):
            raise ValueError(f"observed mode {self.observed}, wanted 0 or 1")
        if self.noise_scale < 0.0:
            raise ValueError(f"noise_scale = {self.noise_scale} must not be negative")
        if self.crest_v <= 0.0:
            raise ValueError(f"crest_v = {self.crest_v} V must be positive")
        if not self.pairs_hz:
            raise ValueError("a series wants at least one drive pair")
        if self.levels and len(self.levels) != len(self.pairs_hz):
            raise ValueError(f"{len(self.levels)} levels for {len(self.pairs_hz)} pairs")
        if not all(level > 0.0 for level in (*self.levels, self.weak_level)):
            raise ValueError(f"drive levels {self.levels}, {self.weak_level} must be positive")
        moved = abs(self.drift_hz) / 2.0 + abs(self.curvature_hz)
        if moved >= self.modes.eta_plus_hz:
            raise ValueError(
                f"drift_hz = {self.drift_hz:g} Hz and curvature_hz = {self.curvature_hz:g} Hz move "
                f"the sample by {moved:g} Hz, wanted less than eta_plus_hz = "
                f"{self.modes.eta_plus_hz:.10g} Hz"
            )

    @property
    def kind(self) -> str:
        """What the bench is called."""
        return self.series

    @property
    def modes(self) -> TwoModes:
        """The linear part of the sample, at the middle of the series."""
        return self.sample.modes

    def at(self, position: float) -> Sample:
        """The sample at ``position`` in [0, 1] of the series, drifted."""
        bow = self.curvature_hz * 4.0 * position * (1 - position)
        return self.sample.shifted(self.drift_hz * (position - 0.5) + bow)

    def eta_hz(self, sample: Sample) -> float:
        """The eigenfrequency of the observed mode.

        Args:
            sample: the oscillators.
        """
        return (sample.modes.eta_plus_hz, sample.modes.eta_minus_hz)[self.observed]

    @cached_property
    def gain(self) -> float:
        """Volts per unit of the sample's amplitudes, by the sweep's maximum."""
        first = self.at(0.0)
        return self.crest_v / float(np.abs(self._swept(first, [self.eta_hz(first)])[0]))

    def sweep_hz(self) -> FloatArray:
        """Points around the undrifted mode, as many on either side."""
        half = round(self.sweep_span_hz / self.sweep_step_hz / 2.0)
        steps = np.arange(-half, half + 1, dtype=np.float64)
        return np.asarray(self.eta_hz(self.sample) + self.sweep_step_hz * steps)

    def sweep(self, rng: np.random.Generator) -> Trace:
        """The sweep with one weak tone, at the start of the series.

        Args:
            rng: source of random numbers.
        """
        grid = self.sweep_hz()
        wave = self.gain * self._swept(self.at(0.0), grid)
        return Trace(grid, np.abs(wave + self.noise(rng, grid.size)))

    def noise(self, rng: np.random.Generator, size: int) -> ComplexArray:
        """Complex Gaussian noise whose magnitude averages to a level drawn from ``floor_v``.

        Args:
            rng: source of random numbers.
            size: how many values.
        """
        level = self.noise_scale * rng.uniform(*self.floor_v)
        sigma = level / math.sqrt(math.pi / 2.0)
        quadratures = rng.standard_normal((2, size))
        return np.asarray(sigma * (quadratures[0] + 1j * quadratures[1]))

    def _swept(self, sample: Sample, frequency_hz: Sequence[float] | FloatArray) -> ComplexArray:
        drives = [Drive((float(f),), (self.weak_level,)) for f in frequency_hz]
        return np.array([sample.amplitudes(drive)[0, self.observed] for drive in drives])


@dataclass(frozen=True)
class Trace:
    """A measured curve: ``frequency_hz`` (n,) and ``amplitude_v`` (n,), V peak."""

    frequency_hz: FloatArray
    amplitude_v: FloatArray


@dataclass(frozen=True, kw_only=True)
class Row:
    """A drive, the mode that is observed, how many spectra are averaged.

    Raises:
        ValueError: no such mode, or no spectrum.
    """

    label: str
    drive: Drive
    observed: int
    averaged: int = 1

    def __post_init__(self) -> None:
        if self.observed not in (0, 1):
            raise ValueError(f"observed mode {self.observed}, wanted 0 or 1")
        if self.averaged < 1:
            raise ValueError(f"{self.label}: {self.averaged} spectra, wanted at least one")


@dataclass(frozen=True, kw_only=True)
class Answer(Row):
    """The truth about a row: the sample as it was then, its waves (lines, 2) in V peak.

    ``arrays`` are what an instrument has read of it, by name; none before.
    """

    sample: Sample
    waves_v: ComplexArray
    arrays: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def lines_v(self) -> ComplexArray:
        """The lines (n,) of the observed mode."""
        return self.waves_v[:, self.observed]

    def reading(self, arrays: Mapping[str, FloatArray]) -> Answer:
        """The same with what an instrument hands over of it.

        Args:
            arrays: columns by name, each (n,).
        """
        return replace(self, arrays=dict(arrays))


class Instrument(ABC):
    """A way to read a series, and what a campaign states of it: one file per kind.

    ``lines`` are the combinations of the tones that it reads; () the tones themselves.
    """

    lines: tuple[tuple[int, ...], ...] = ()

    @abstractmethod
    def read(
        self, bench: Bench, answers: Sequence[Answer], rng: np.random.Generator, seed: int
    ) -> tuple[Answer, ...]:
        """Read the answers in turn. ``rng`` is the series' own; ``seed`` is for another one.

        Args:
            bench: the laboratory: sample, drives, instrument, noise.
            answers: of the sample to every drive of the row.
            rng: source of random numbers.
            seed: of the random numbers.
        """

    @abstractmethod
    def edit(self, tables: Tables) -> None:
        """Write into the tables of a campaign how its data are to be read.

        Args:
            tables: of the TOML file.
        """

    def columns(self, reading: Answer) -> dict[str, Cell]:
        """Cells of a row of experiments.csv by header, behind label and drive.

        Args:
            reading: what the instrument read.
        """
        return {}

    def files(self, reading: Answer) -> dict[str, dict[str, FloatArray]]:
        """Columns by header, by file name, of what has no place in that row.

        Args:
            reading: what the instrument read.
        """
        return {}


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What the laboratory hands over, ``readings``, and the truth next to it, ``answers``.

    ``eta_before_hz`` and ``eta_after_hz`` are the measured (plus, minus) eigenfrequencies,
    ``gain`` is in volts per unit of the sample's amplitudes, ``sweep`` what a series of the bench
    itself begins with, empty of rows of a plan.
    """

    bench: Bench
    seed: int
    gain: float
    instrument: Instrument
    answers: tuple[Answer, ...]
    readings: tuple[Answer, ...]
    eta_before_hz: tuple[float, float] = (math.nan, math.nan)
    eta_after_hz: tuple[float, float] = (math.nan, math.nan)
    sweep: Trace = Trace(np.empty(0), np.empty(0))

    def array(self, name: str) -> FloatArray:
        """An array of all readings, (m, ...).

        Args:
            name: of the array.
        """
        return np.array([reading.arrays[name] for reading in self.readings])

    @property
    def true_modes(self) -> tuple[TwoModes, ...]:
        """The modes at every drive."""
        return tuple(answer.sample.modes for answer in self.answers)

    @property
    def true_peaks_v(self) -> FloatArray:
        """The observed mode's amplitudes, (m, lines)."""
        return np.array([np.abs(answer.lines_v) for answer in self.answers])


def measure(bench: Bench, seed: int) -> Measured:
    """Run one measurement series: sweep, every drive pair, eigenfrequencies around it.

    The sweep is taken at the start of the series. The same ``bench`` and ``seed`` give the same
    numbers bit by bit.

    Raises:
        ValueError: a drive under which the sample has no steady state.
    """
    rng = np.random.default_rng(seed)
    sweep = bench.sweep(rng)
    count = len(bench.pairs_hz)
    requested = []
    for index, pair in enumerate(bench.pairs_hz):
        level = bench.levels[index] if bench.levels else 1.0
        drive = replace(Drive.equal(pair, level), lines=bench.instrument.lines)
        label = f"{'drive' if bench.levels else 'pair'}{index + 1}"
        sample = bench.at(0.5 if count == 1 else index / (count - 1))
        requested.append((Row(label=label, drive=drive, observed=bench.observed), sample))
    ends = (bench.at(0.0), bench.at(1.0))
    return replace(_measured(bench, requested, ends, bench.instrument, seed, rng), sweep=sweep)


def measure_rows(bench: Bench, rows: Sequence[Row], instrument: Instrument, seed: int) -> Measured:
    """Measure the rows of a plan one after the other; the same arguments give the same numbers.

    It comes after the bench's own series: the modes are where that series left them. The laboratory
    follows the resonances, so that they drift no further, but for the departure from a straight
    line that the bench has.

    Args:
        bench: the laboratory: sample, drives, instrument, noise.
        rows: to be measured.
        instrument: that reads the answers.
        seed: of the random numbers.

    Raises:
        ValueError: a drive under which the sample has no steady state.
    """
    rng = np.random.default_rng(seed)
    end = bench.at(1.0)
    requested = []
    for index, row in enumerate(rows):
        position = 0.5 if len(rows) == 1 else index / (len(rows) - 1)
        sample = end.shifted(4.0 * bench.curvature_hz * position * (1.0 - position))
        requested.append((row, sample))
    return _measured(bench, requested, (end, end), instrument, seed, rng)


def _measured(
    bench: Bench,
    requested: Sequence[tuple[Row, Sample]],
    ends: tuple[Sample, Sample],
    instrument: Instrument,
    seed: int,
    rng: np.random.Generator,
) -> Measured:
    """Rows of which each has its sample, with the eigenfrequencies before and after."""
    answers = tuple(
        Answer(sample=sample, waves_v=bench.gain * sample.amplitudes(row.drive), **vars(row))
        for row, sample in requested
    )
    readings = instrument.read(bench, answers, rng, seed)
    error = (bench.noise_scale * bench.eta_error_hz * rng.standard_normal(4)).tolist()
    before, after = (sample.modes for sample in ends)
    return Measured(
        bench=bench,
        seed=seed,
        gain=bench.gain,
        instrument=instrument,
        answers=answers,
        readings=readings,
        eta_before_hz=(before.eta_plus_hz + error[0], before.eta_minus_hz + error[1]),
        eta_after_hz=(after.eta_plus_hz + error[2], after.eta_minus_hz + error[3]),
    )


class Sample(Protocol):
    """Two coupled modes at some moment."""

    @property
    def modes(self) -> TwoModes:
        """Their linear part."""
        ...

    def shifted(self, shift_hz: float) -> Sample:
        """The same sample, both eigenfrequencies higher by so much.

        Args:
            shift_hz: by which both resonances move, Hz.
        """
        ...

    def amplitudes(self, drive: Drive) -> ComplexArray:
        """Complex amplitudes (lines, 2) of both modes at the lines that the drive reads.

        Args:
            drive: tones and amplitudes that drive.

        Raises:
            ValueError: no steady state.
        """
        ...
