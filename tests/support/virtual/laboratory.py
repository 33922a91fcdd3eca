"""A virtual laboratory: what it measured as the files of campaigns, and what is true of its sample.

Everything goes through campaign files, as a user's data do: drift, spectra, several series and
declared units exist nowhere else, and a folder is what anybody can try again with `fmu-fit`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from fitting.text.arrays import FloatArray
from tests.support.virtual.modes import derived, response

#: What is asked of every laboratory beside its parameters.
DERIVED = ("lambda", "f1", "f2", "width_plus", "width_minus", "Q_plus", "Q_minus")


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """A fitted parameter as the campaign has it; `widens`: as a ratio, about its middle, or not."""

    name: str
    lower: float
    upper: float
    start: float
    scale: float
    unit: str
    period: float | None = None
    widens: str = "ratio"

    def widened(self, factor: float) -> Unknown:
        """The same with a box that many times as wide; a value that is positive stays so."""
        if self.widens == "not":
            return self
        if self.widens == "ratio":
            return replace(self, lower=self.lower / factor, upper=self.upper * factor)
        middle, half = 0.5 * (self.lower + self.upper), 0.5 * (self.upper - self.lower)
        low = middle - factor * half
        if self.period is None and self.lower > 0.0:
            low = max(low, self.lower / factor)
        return replace(self, lower=low, upper=middle + factor * half)

    @property
    def table(self) -> dict[str, Any]:
        """Its table in the campaign."""
        table = {
            "name": self.name,
            "unit": self.unit,
            "lower": self.lower,
            "upper": self.upper,
            "start": self.start,
            "scale": self.scale,
        }
        return table | ({} if self.period is None else {"period": self.period})


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One experiment: true `values` of the sample during it, tones, levels, what was read.

    `peaks_v` and `sigmas_v` (2,) as true standard deviations say; `spectrum` (2, n) instead.
    """

    label: str
    values: Mapping[str, float]
    tones_hz: FloatArray
    levels: FloatArray
    output: str
    peaks_v: FloatArray
    sigmas_v: FloatArray
    spectrum: FloatArray | None = None


@dataclass(frozen=True, kw_only=True)
class Swept:
    """A sweep: true values during it, frequencies, amplitudes, their standard deviation."""

    values: Mapping[str, float]
    frequency_hz: FloatArray
    amplitude_v: FloatArray
    sigma_v: float
    use: str = "scale"
    scale: str = "fit"
    background: str = "none"
    declared_noise: bool = False


@dataclass(frozen=True, kw_only=True)
class Series:
    """One campaign of a laboratory.

    `start` are the start values that the campaign tells of the sample, `drift` its table;
    `amplitude` and `sweep_amplitude` what the files are declared to hold, `factor` and
    `sweep_factor` what they hold per volt peak.
    """

    name: str
    output: str
    readings: tuple[Reading, ...] = ()
    sweep: Swept | None = None
    start: Mapping[str, float] = field(default_factory=dict)
    drift: Mapping[str, Any] = field(default_factory=dict)
    amplitude: str = "V peak"
    sweep_amplitude: str = "V peak"
    factor: float = 1.0
    sweep_factor: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Laboratory:
    """A sample, its series, what is fitted, and what is true of everything that is reported.

    `honest`: the campaign describes what was done (drift model, noise, units); else `fault` names
    what was done wrong. `gain` is V/m. `alternatives`: both forms of the transformation are tried.
    """

    kind: str
    seed: int
    values: Mapping[str, float]
    series: tuple[Series, ...]
    unknowns: tuple[Unknown, ...]
    gain: float
    honest: bool = True
    fault: str = ""
    alternatives: bool = False
    derived: tuple[str, ...] = DERIVED
    notes: Mapping[str, Any] = field(default_factory=dict)

    def widened(self, factor: float) -> Laboratory:
        """The same data, all boxes wider by a factor."""
        return replace(self, unknowns=tuple(u.widened(factor) for u in self.unknowns))

    def truth(self, reflection: bool = False) -> dict[str, float]:
        """True values by name, as the form of the transformation has them; NaN where there is none.

        A reflection with (pi/2 - theta, d2, d1) is the same system as a rotation with
        (theta, d1, d2): the same damping matrix, the same lambda; f1 and f2 change places.
        """
        turn = _reflected if reflection else dict
        fitted = turn(self.values)
        found = {u.name: float(fitted[u.name]) for u in self.unknowns}
        places = [turn(v) for v in self.places]
        table = {n: np.array([v[n] for v in places]) for n in places[0]}
        every = derived(table)
        return found | {name: float(np.mean(every[name])) for name in self.derived}

    @property
    def places(self) -> list[Mapping[str, float]]:
        """True values at every experiment; during the sweep, for a series that has none."""
        found: list[Mapping[str, float]] = []
        for series in self.series:
            found += [r.values for r in series.readings]
            if not series.readings and series.sweep is not None:
                found.append(series.sweep.values)
        return found

    def write(self, folder: Path) -> list[Path]:
        """Write all campaigns below a folder; their paths."""
        paths = []
        for series in self.series:
            place = folder / series.name
            place.mkdir(parents=True, exist_ok=True)
            for name, text in self._files(series).items():
                (place / name).parent.mkdir(exist_ok=True)
                (place / name).write_text(text, encoding="utf-8")
            paths.append(place / "campaign.toml")
        return paths

    def _files(self, series: Series) -> dict[str, str]:
        files: dict[str, str] = {}
        table: dict[str, Any] = {
            "title": f"virtual laboratory, {self.kind}, seed {self.seed}, {series.name}",
            "synthetic": True,
            "fmu": {
                "model": "CoupledOscillator",
                "start": {"periodic_start": True, **series.start},
            },
            "observe": {"output": series.output, "steady_start": True},
            "drive": {"kind": "tones", "frequencies": ["u1", "u2"], "amplitudes": ["A1", "A2"]},
        }
        if series.readings:
            table["experiments"], more = _experiments(series)
            files |= more
        if series.drift:
            table["drift"] = dict(series.drift)
        if series.sweep is not None:
            sweep = series.sweep
            table["sweep"] = {
                "file": "sweep.csv",
                "amplitude": series.sweep_amplitude,
                "use": sweep.use,
                "scale": sweep.scale,
                "background": sweep.background,
                "set": {n: sweep.values[n] for n in self._told(series)},
            }
            if sweep.declared_noise:
                table["noise"] = {"absolute": f"{series.sweep_factor * sweep.sigma_v!r} V"}
            files["sweep.csv"] = _csv(
                {
                    "frequency (Hz)": sweep.frequency_hz,
                    "amplitude (V)": series.sweep_factor * sweep.amplitude_v,
                }
            )
        table["parameters"] = [u.table for u in self.unknowns]
        table["derived"] = {"outputs": list(self.derived)}
        if self.alternatives:
            table["alternatives"] = {"reflection": [False, True]}
        return {"campaign.toml": tomlkit.dumps(table), **files}

    def _told(self, series: Series) -> list[str]:
        fitted = {u.name for u in self.unknowns}
        return [n for n in ("eta_plus", "eta_minus") if n not in fitted]


def _reflected(values: Mapping[str, float]) -> dict[str, float]:
    turned = dict(values)
    turned["theta"] = (0.5 * math.pi - values["theta"]) % math.pi
    turned["d1"], turned["d2"] = values["d2"], values["d1"]
    turned["reflection"] = 1.0
    return turned


def _experiments(series: Series) -> tuple[dict[str, Any], dict[str, str]]:
    """The table [experiments], and its files."""
    files: dict[str, str] = {}
    table: dict[str, Any] = {"file": "experiments.csv", "amplitude": series.amplitude}
    readings = series.readings
    unit = series.amplitude.split()[0]
    columns: dict[str, Sequence[str] | FloatArray] = {
        "experiment": [r.label for r in readings],
        "u1 (Hz)": np.array([r.tones_hz[0] for r in readings]),
        "u2 (Hz)": np.array([r.tones_hz[1] for r in readings]),
    }
    if any(np.any(r.levels != 1.0) for r in readings):
        columns["A1 (m/s2)"] = np.array([r.levels[0] for r in readings])
        columns["A2 (m/s2)"] = np.array([r.levels[1] for r in readings])
    if any(r.output != series.output for r in readings):
        columns["output"] = [r.output for r in readings]
    if readings[0].spectrum is None:
        table |= {"peaks": ["p1", "p2"], "peak_sigmas": ["s1", "s2"]}
        for k in (0, 1):
            columns[f"p{k + 1} ({unit})"] = series.factor * np.array(
                [r.peaks_v[k] for r in readings]
            )
            columns[f"s{k + 1} ({unit})"] = series.factor * np.array(
                [r.sigmas_v[k] for r in readings]
            )
    else:
        table |= {"spectra": "spectra/{experiment}.csv"}
        for r in readings:
            assert r.spectrum is not None
            files[f"spectra/{r.label}.csv"] = _csv(
                {"frequency (Hz)": r.spectrum[0], "amplitude (V)": series.factor * r.spectrum[1]}
            )
    return table, files | {"experiments.csv": _csv(columns)}


def _read(readings: Sequence[Reading]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Peaks and their standard deviations of all readings."""
    return [r.peaks_v for r in readings], [r.sigmas_v for r in readings]


def _csv(columns: Mapping[str, Sequence[str] | FloatArray]) -> str:
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns)]
    lines += [",".join(c if isinstance(c, str) else repr(float(c)) for c in row) for row in rows]
    return "\n".join(lines) + "\n"


def amplitude_v(
    values: Mapping[str, float], u_hz: FloatArray, output: str, gain: float
) -> FloatArray:
    """What a detector of this gain (V/m) would see of the steady response without noise."""
    return np.asarray(gain * np.abs(response(values, u_hz, output)))
