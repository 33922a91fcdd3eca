"""Ways to read a series: each a `fitting.lab.bench.Instrument`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from fitting.lab.bench import DRIFTING, OUTPUTS, Answer, Bench, Cell, Instrument
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.toml import Tables, inline, put

#: Minutes from one drive pair to the next.
PAUSE_MIN = 10.0
#: Both tones and the first intermodulation lines, which markers are put on.
READ = ((1, 0), (0, 1), (2, -1), (-1, 2))
#: Arrays of an answer, V, by the key of [experiments] that names their columns.
ARRAYS = {"peaks": "peaks_v", "x": "x_v", "y": "y_v", "peak_sigmas": "sigmas_v"}
#: Columns by that key.
Heads = Mapping[str, tuple[str, ...]]


def peak_table(tables: Tables, heads: Heads) -> dict[str, object]:
    """The table [experiments] of a campaign whose peaks are ready in columns.

    Args:
        tables: of the campaign, as it is.
        heads: columns by the key that names them.
    """
    named = {key: list(names) for key, names in heads.items()}
    return {"file": tables["experiments"]["file"], **named, "amplitude": "V peak"}


def peak_cells(answer: Answer, heads: Heads) -> dict[str, Cell]:
    """Cells of a row by header, in microvolts.

    Args:
        answer: what the instrument read.
        heads: columns by the key that names them.
    """
    return {
        f"{name} (uV)": float(value) * 1e6
        for key, names in heads.items()
        for name, value in zip(names, answer.arrays[ARRAYS[key]], strict=True)
    }


def put_offsets(tables: Tables, **more: str) -> None:
    """Ask for an offset of every drive pair besides the linear drift, 30 Hz as one sigma.

    Args:
        tables: of the campaign, changed in place.
        **more: further keys of [drift].
    """
    ends = {name: inline(tables["drift"][name]) for name in DRIFTING}
    drift = {**more, "model": "offsets", "prior": "30 Hz", **ends}
    put(tables, "drift", drift, "one offset per drive pair besides the linear drift")


@dataclass(frozen=True)
class Analyser(Instrument):
    """A spectrum analyser: arrays "frequency_hz" and "amplitude_v" (n,) about every drive pair."""

    def read(
        self, bench: Bench, answers: Sequence[Answer], rng: np.random.Generator, seed: int
    ) -> tuple[Answer, ...]:
        """All lines through a Gaussian resolution filter, plus complex noise, in magnitude."""
        half = round(bench.spectrum_span_hz / bench.resolution_hz / 2.0)
        steps = np.arange(-half, half + 1, dtype=np.float64)
        result = []
        for answer in answers:
            tones = answer.drive.tones_hz
            frequency = 0.5 * (tones[0] + tones[-1]) + bench.resolution_hz * steps
            wave = np.zeros(frequency.size, dtype=complex)
            for tone, line in zip(tones, answer.lines_v, strict=True):
                # amplitude 1/sqrt(2) half a bandwidth off: bandwidth between the 3 dB points
                offset = 2.0 * (frequency - tone) / bench.resolution_hz
                wave += line * np.exp(-0.5 * math.log(2.0) * offset**2)
            amplitude = np.abs(wave + bench.noise(rng, frequency.size))
            result.append(answer.reading({"frequency_hz": frequency, "amplitude_v": amplitude}))
        return tuple(result)

    def edit(self, tables: Tables) -> None:
        """A file per experiment, whose noise floor is its own."""
        experiments = {
            "file": tables["experiments"]["file"],
            "spectra": "spectra/{experiment}.csv",
            "layout": "csv",
            "amplitude": "V peak",
            "noise_floor": "robust",
        }
        put(tables, "experiments", experiments)

    def files(self, reading: Answer) -> dict[str, dict[str, FloatArray]]:
        """The spectrum."""
        columns = {
            "frequency (MHz)": reading.arrays["frequency_hz"] / 1e6,
            "amplitude (uV)": reading.arrays["amplitude_v"] * 1e6,
        }
        return {f"spectra/{reading.label}.csv": columns}


@dataclass(frozen=True)
class Markers(Instrument):
    """Markers of an analyser: arrays "peaks_v" and "sigmas_v" (4,), at the combinations `READ`.

    A line has the relative error ``repeatability`` next to the noise floor.

    Raises:
        ValueError: a repeatability that is none.
    """

    repeatability: float = 0.003
    lines: tuple[tuple[int, ...], ...] = READ

    heads: ClassVar[Heads] = {
        "peaks": ("z_u1", "z_u2", "z_low", "z_high"),
        "peak_sigmas": ("s_u1", "s_u2", "s_low", "s_high"),
    }

    def __post_init__(self) -> None:
        if not 0.0 <= self.repeatability < 0.1:
            raise ValueError(f"repeatability {self.repeatability}, wanted 0 to 0.1")

    def read(
        self, bench: Bench, answers: Sequence[Answer], rng: np.random.Generator, seed: int
    ) -> tuple[Answer, ...]:
        """|X (1 + r) + n|: noise n of one floor for all of them, r of the repeatability."""
        waves = np.array([answer.lines_v for answer in answers])
        floor = bench.noise(rng, waves.size).reshape(waves.shape)
        jitter = 1.0 + bench.noise_scale * self.repeatability * rng.standard_normal(waves.shape)
        peaks = np.abs(waves * jitter + floor)
        # a spectrum's mean floor, in one quadrature
        quiet = bench.noise_scale * sum(bench.floor_v) / math.sqrt(2.0 * math.pi)
        sigmas = np.hypot(quiet, bench.noise_scale * self.repeatability * np.abs(waves))
        rows = zip(answers, peaks, sigmas, strict=True)
        return tuple(a.reading({"peaks_v": peak, "sigmas_v": s}) for a, peak, s in rows)

    def edit(self, tables: Tables) -> None:
        """Ready peaks and their standard deviations, in columns."""
        put(tables, "experiments", peak_table(tables, self.heads))

    def columns(self, reading: Answer) -> dict[str, Cell]:
        """Peaks and standard deviations."""
        return peak_cells(reading, self.heads)


@dataclass(frozen=True)
class LockIns(Instrument):
    """Lock-in amplifiers, one for each mode: arrays "peaks_v", "sigmas_v" (2,), "time_min" ().

    The other mode answers 2000 times more weakly than the resonant one, far below the floor of a
    spectrum that shows both. A laboratory records it at more gain and for longer, and states
    amplitudes with standard deviations, referred to the drive and the gain of the sweep. Both modes
    of a pair are recorded at once: they share their time stamp, and with it the drift.

    ``noise`` is the relative standard deviation of every amplitude (times the bench's noise scale);
    ``both`` modes are recorded, or the observed one alone. With ``phases`` "x_v" and "y_v" (2,)
    take the place of "peaks_v", each with that noise, so that 1 % is 0.01 rad; "reference_rad" ()
    is the phase of the common reference against the drive, which is not known and another one after
    each restart: ``restarts`` are the pairs, from 0, before which the instrument is restarted.

    Raises:
        BadInput: a noise that no lock-in amplifier has.
    """

    noise: float = 0.01
    both: bool = True
    phases: bool = False
    restarts: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 < self.noise < 0.5:
            raise BadInput(f"lock-ins: noise {self.noise}, wanted a share between 0 and 0.5")

    @property
    def heads(self) -> Heads:
        """Columns of experiments.csv by the key that names them."""
        waves = {"x": ("X1", "X2"), "y": ("Y1", "Y2")} if self.phases else {"peaks": ("p1", "p2")}
        return waves | {"peak_sigmas": ("s1", "s2")}

    def read(
        self, bench: Bench, answers: Sequence[Answer], rng: np.random.Generator, seed: int
    ) -> tuple[Answer, ...]:
        """|X| (1 + r), or X exp(i reference) (1 + r) with a complex r; the observed mode first."""
        # drawn and left: a seed has the same drift whatever instrument reads the series
        Analyser().read(bench, answers, rng, seed)
        own = np.random.default_rng([seed, 2 if self.phases else 1])
        relative, reference, result = self.noise * bench.noise_scale, 0.0, []
        for place, answer in enumerate(answers):
            if self.phases and (place == 0 or place in self.restarts):
                reference = float(own.uniform(-math.pi, math.pi))
            for mode in (answer.observed, 1 - answer.observed)[: 1 + self.both]:
                waves = answer.waves_v[:, mode]
                arrays = {"time_min": np.array(PAUSE_MIN * place)}
                if self.phases:
                    draws = own.standard_normal((2, waves.size))
                    factor = 1.0 + relative * (draws[0] + 1j * draws[1])
                    values = waves * np.exp(1j * reference) * factor
                    arrays |= {"x_v": values.real, "y_v": values.imag}
                    arrays["reference_rad"] = np.array(reference)
                else:
                    values = np.abs(waves) * (1.0 + relative * own.standard_normal(waves.size))
                    arrays["peaks_v"] = values
                arrays["sigmas_v"] = self.noise * np.abs(values)
                label = answer.label + ("" if mode == answer.observed else "_cross")
                result.append(replace(answer.reading(arrays), label=label, observed=mode))
        return tuple(result)

    def edit(self, tables: Tables) -> None:
        """Ready values, an offset of every pair from the drift, least squares: noise is known."""
        title, experiments = str(tables["title"]), peak_table(tables, self.heads)
        if self.phases:
            tables["title"] = title.replace(" (", " with phases (", 1)
            experiments["unknown"] = "phase"
        else:
            tables["title"] = title.replace(" series (", " series and the other mode (")
        if self.restarts:
            experiments["restarted"] = [f"pair{k + 1}" for k in self.restarts]
        put(tables, "experiments", experiments, "referred to drive and gain of the sweep")
        put_offsets(tables, time="time")
        tables["continuation"]["misfit"] = "squares"

    def columns(self, reading: Answer) -> dict[str, Cell]:
        """Time, mode, values and their standard deviations."""
        time, output = float(reading.arrays["time_min"]), OUTPUTS[reading.observed]
        return {"time (min)": time, "output": output, **peak_cells(reading, self.heads)}


@dataclass(frozen=True)
class Averaged(Instrument):
    """Peaks of spectra that are averaged with their phases kept, as a plan asks for them.

    Arrays "peaks_v" and "sigmas_v" (tones,). Of one spectrum's peak: ``floor_v`` per quadrature,
    which falls by the root of how many are averaged, and ``relative`` to the peak, which stays.
    With ``phases`` "x_v" and "y_v" take the place of "peaks_v", both with that noise, against a
    reference phase that is not known.
    """

    floor_v: float
    relative: float
    phases: bool = False

    @property
    def arrays(self) -> tuple[str, ...]:
        """Names of the arrays in the order of the columns."""
        return ("x_v", "y_v", "sigmas_v") if self.phases else ("peaks_v", "sigmas_v")

    def read(
        self, bench: Bench, answers: Sequence[Answer], rng: np.random.Generator, seed: int
    ) -> tuple[Answer, ...]:
        """|X + n| (1 + r): complex n of the floor after averaging, r of the relative noise."""
        relative = bench.noise_scale * self.relative
        result, own = [], np.random.default_rng([seed, 3])
        reference = float(own.uniform(-math.pi, math.pi))
        for answer in answers:
            line = answer.lines_v
            floor_v = bench.noise_scale * self.floor_v / math.sqrt(answer.averaged)
            quadratures = rng.standard_normal((2, line.size)) * floor_v
            factor = 1.0 + relative * rng.standard_normal(line.size)
            waves = line + quadratures[0] + 1j * quadratures[1]
            peaks = np.abs(waves) * np.abs(factor)
            arrays = {"peaks_v": peaks, "sigmas_v": np.hypot(floor_v, relative * peaks)}
            if self.phases:
                turn = relative * own.standard_normal(line.size)
                waves = waves * (factor + 1j * turn) * np.exp(1j * reference)
                arrays |= {"x_v": waves.real, "y_v": waves.imag}
            result.append(answer.reading(arrays))
        return tuple(result)

    def edit(self, tables: Tables) -> None:
        """The plan states how its data are to be read."""
