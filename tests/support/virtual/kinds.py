"""The kinds of laboratories: each makes one from a seed, with numbers of its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fitting.text.arrays import FloatArray
from tests.support.virtual.laboratory import (
    Laboratory,
    Reading,
    Series,
    Swept,
    Unknown,
    amplitude_v,
)
from tests.support.virtual.modes import damping_hz, response

Random = np.random.Generator

#: Boxes of a damping, as factors on a guess of it.
BOXES = ((0.3, 3.0), (0.01, 100.0), (0.001, 1000.0))
#: Largest amplitude at the detector, V.
TOP_V = 1e-3
DRIFTS = ("linear", "bend", "walk")
DRIFT_MODELS = ("linear", "offsets", "walk")


def _log(rng: Random, low: float, high: float) -> float:
    return float(10.0 ** rng.uniform(math.log10(low), math.log10(high)))


@dataclass(frozen=True)
class Sample:
    """True values of a sample, widths of both lines, the detector's gain, V/m."""

    values: Mapping[str, float]
    widths_hz: tuple[float, float]
    gain: float

    def moved(self, shift_hz: float) -> dict[str, float]:
        """Its values, both eigenfrequencies shifted."""
        moved = dict(self.values)
        moved["eta_plus"] += shift_hz
        moved["eta_minus"] += shift_hz
        return moved


def sample(rng: Random, *, overlap: float = 0.3, coupled: bool = False) -> Sample:
    """Two modes from kHz to GHz, Q from 50 to 1e6, lambda from zero to far beyond the line width.

    Args:
        rng: random numbers.
        overlap: share of samples whose lines are 0.5 to 5 widths apart.
        coupled: the modes are coupled, and unlike enough to see it.
    """
    eta = _log(rng, 1e3, 3e9)
    width = eta / _log(rng, 50.0, 1e6)
    apart = width * (_log(rng, 0.5, 5.0) if rng.random() < overlap else _log(rng, 5.0, 1e3))
    apart = min(apart, 0.5 * eta)
    ratio = _log(rng, 1.5 if coupled else 1.0, 3.0) ** rng.choice([-1.0, 1.0])
    theta = float(rng.uniform(0.5 * math.pi + 0.1, math.pi - 0.1))
    if not coupled and rng.random() < 0.15:
        theta = float(rng.choice([0.0, 0.5 * math.pi]))
    values = {
        "theta": theta,
        "d1": width * math.sqrt(ratio),
        "d2": width / math.sqrt(ratio),
        "eta_plus": eta,
        "eta_minus": eta + apart,
    }
    d11, d22, _ = damping_hz(values)
    top = float(amplitude_v(values, np.array([eta]), "q1_hybrid", 1.0)[0])
    return Sample(values, (float(d11), float(d22)), TOP_V / top)


def _angle(rng: Random) -> Unknown:
    lower, upper, period = [
        (0.0, math.pi, math.pi),
        (-2.0 * math.pi, 2.0 * math.pi, math.pi),
        (0.5 * math.pi, math.pi, None),
    ][rng.choice(3)]
    start = float(rng.uniform(lower, upper))
    return Unknown(
        name="theta",
        lower=lower,
        upper=upper,
        start=start,
        scale=1.0,
        unit="rad",
        period=period,
        widens="not",
    )


def _damping(rng: Random, name: str, truth: float) -> Unknown:
    guess = truth * float(np.exp(rng.uniform(-0.6, 0.6)))
    low, high = BOXES[rng.choice(3)]
    start = guess
    if rng.random() < 0.5:
        start = guess * _log(rng, max(low, 0.1), min(high, 10.0))
    return Unknown(
        name=name, lower=low * guess, upper=high * guess, start=start, scale=guess, unit="Hz"
    )


def _unknowns(rng: Random, of: Sample) -> tuple[Unknown, ...]:
    return (_angle(rng), *(_damping(rng, n, of.values[n]) for n in ("d1", "d2")))


def _eta(rng: Random, name: str, of: Sample) -> Unknown:
    """An eigenfrequency that is fitted, too: known to a few line widths."""
    width = of.widths_hz[0 if name == "eta_plus" else 1]
    truth, half = of.values[name], width * float(rng.choice([2.0, 10.0]))
    middle = truth + 0.5 * half * float(rng.uniform(-1.0, 1.0))
    start = middle + 0.5 * half * float(rng.uniform(-1.0, 1.0))
    return Unknown(
        name=name,
        lower=middle - half,
        upper=middle + half,
        start=start,
        scale=width,
        unit="Hz",
        widens="about",
    )


def _told(of: Sample, *, but: tuple[str, ...] = ()) -> dict[str, float]:
    return {n: of.values[n] for n in ("eta_plus", "eta_minus") if n not in but}


def _pair(rng: Random, eta_hz: float, width_hz: float) -> FloatArray:
    """Two tones beside a mode, on a grid of a twentieth of its width."""
    grid = width_hz / 20.0
    below, above = -rng.uniform(0.05, 1.2), rng.uniform(0.05, 1.2)
    return np.round((eta_hz + width_hz * np.array([below, above])) / grid) * grid


def _read(
    rng: Random, of: Sample, reading: Mapping[str, Any], relative: float, output: str = "q1_hybrid"
) -> Reading:
    """One reading of ready peaks with relative noise."""
    values, tones = reading["values"], reading["tones_hz"]
    levels = reading.get("levels", np.ones(2))
    exact = levels * amplitude_v(values, tones, output, of.gain)
    peaks = exact * (1.0 + relative * rng.standard_normal(2))
    return Reading(
        label=reading["label"],
        values=values,
        tones_hz=tones,
        levels=levels,
        output=output,
        peaks_v=np.abs(peaks),
        sigmas_v=relative * exact,
    )


def _sweep(
    rng: Random, of: Sample, mode: int, *, values: Mapping[str, float] | None = None
) -> Swept:
    """A sweep over one line for the scale, 0.2 to 1 % of noise."""
    values = of.values if values is None else values
    eta = values[("eta_plus", "eta_minus")[mode]]
    span = rng.uniform(2.0, 4.0) * of.widths_hz[mode]
    f = eta + np.linspace(-span, span, int(rng.integers(25, 42)))
    exact = amplitude_v(values, f, ("q1_hybrid", "q2_hybrid")[mode], of.gain)
    sigma = float(rng.choice([0.002, 0.005, 0.01])) * float(np.max(exact))
    return Swept(
        values=values,
        frequency_hz=f,
        amplitude_v=np.abs(exact + sigma * rng.standard_normal(f.size)),
        sigma_v=sigma,
        scale=str(rng.choice(["maximum", "fit", "robust"], p=[0.4, 0.55, 0.05])),
    )


def pairs(seed: int) -> Laboratory:
    """One series of 6 to 10 tone pairs near one mode, in half of them at two drive levels."""
    rng = np.random.default_rng([1, seed])
    of = sample(rng)
    relative = float(rng.choice([0.002, 0.005, 0.01, 0.03]))
    low = float(rng.choice([1.0, 0.5]))
    readings = tuple(
        _read(
            rng,
            of,
            {
                "label": f"pair{k + 1}",
                "values": of.values,
                "tones_hz": _pair(rng, of.values["eta_plus"], of.widths_hz[0]),
                "levels": np.array([1.0, 1.0]) if k % 2 else np.array([low, low]),
            },
            relative,
        )
        for k in range(int(rng.integers(6, 11)))
    )
    series = Series(
        name="q1",
        output="q1_hybrid",
        readings=readings,
        sweep=_sweep(rng, of, 0),
        start=_told(of),
    )
    return Laboratory(
        kind="pairs",
        seed=seed,
        values=of.values,
        series=(series,),
        unknowns=_unknowns(rng, of),
        gain=of.gain,
        alternatives=bool(rng.random() < 0.25),
    )


def drift(seed: int) -> Laboratory:
    """The same under drift: linear, bent or a random walk; under each of the three models of it."""
    rng = np.random.default_rng([2, seed])
    of = sample(rng, overlap=0.0)
    how, model = DRIFTS[seed % 3], DRIFT_MODELS[(seed // 3) % 3]
    count, width = int(rng.integers(6, 11)), of.widths_hz[0]
    place = np.linspace(0.0, 1.0, count)
    ends = width * float(rng.uniform(-1.5, 1.5)) * np.array([-0.5, 0.5])
    prior = width * float(rng.choice([0.1, 0.3]))
    away = {
        "linear": np.zeros(count),
        "bend": prior * float(rng.standard_normal()) * 4.0 * place * (1.0 - place),
        "walk": np.cumsum(prior * rng.standard_normal(count)),
    }[how]
    shifts = ends[0] + (ends[1] - ends[0]) * place + away
    relative = float(rng.choice([0.005, 0.01, 0.02]))
    readings = tuple(
        _read(
            rng,
            of,
            {
                "label": f"pair{k + 1}",
                "values": of.moved(float(shift)),
                "tones_hz": _pair(rng, of.values["eta_plus"], width),
            },
            relative,
        )
        for k, shift in enumerate(shifts)
    )
    before, after = (of.moved(float(end)) for end in ends)
    table: dict[str, Any] = {"model": model}
    if model != "linear":
        table["prior"] = f"{prior!r} Hz"
    for name in ("eta_plus", "eta_minus"):
        table[name] = {"before": before[name], "after": after[name]}
    series = Series(
        name="q1",
        output="q1_hybrid",
        readings=readings,
        sweep=_sweep(rng, of, 0, values=before),
        drift=table,
    )
    # offsets hold any departure of the size of their prior; a walk holds a bend as well
    honest = model != "linear" or how == "linear"
    if how == "walk" and model == "offsets":
        honest = bool(np.max(np.abs(away)) < 2.5 * prior)
    return Laboratory(
        kind="drift",
        seed=seed,
        values=of.values,
        series=(series,),
        unknowns=_unknowns(rng, of),
        gain=of.gain,
        honest=honest,
        notes={"drift": how, "model": model},
    )


def joint(seed: int) -> Laboratory:
    """Two series at the two modes, both modes recorded under each pair: lambda is determined."""
    rng = np.random.default_rng([3, seed])
    of = sample(rng, overlap=0.2, coupled=True)
    relative = float(rng.choice([0.003, 0.01]))
    outputs = ("q1_hybrid", "q2_hybrid")
    made = []
    for mode, name in ((0, "q1"), (1, "q2")):
        eta = of.values[("eta_plus", "eta_minus")[mode]]
        readings = []
        for k in range(int(rng.integers(3, 6))):
            tones = _pair(rng, eta, of.widths_hz[mode])
            readings += [
                _read(
                    rng,
                    of,
                    {"label": f"pair{k + 1}{word}", "values": of.values, "tones_hz": tones},
                    relative,
                    output,
                )
                for word, output in (("", outputs[mode]), ("_cross", outputs[1 - mode]))
            ]
        made.append(
            Series(
                name=name,
                output=outputs[mode],
                readings=tuple(readings),
                sweep=_sweep(rng, of, mode),
                start=_told(of),
            )
        )
    return Laboratory(
        kind="joint",
        seed=seed,
        values=of.values,
        series=tuple(made),
        unknowns=_unknowns(rng, of),
        gain=of.gain,
        alternatives=bool(rng.random() < 0.25),
    )


def crossing(seed: int) -> Laboratory:
    """An avoided crossing in one sweep: two overlapping lines, all five coefficients fitted."""
    rng = np.random.default_rng([4, seed])
    of = sample(rng, overlap=1.0, coupled=True)
    values, wide = of.values, max(of.widths_hz)
    f = np.linspace(
        values["eta_plus"] - 3.0 * wide,
        values["eta_minus"] + 3.0 * wide,
        int(rng.integers(41, 82)),
    )
    output = str(rng.choice(["q1_hybrid", "q1", "q2"]))
    exact = amplitude_v(values, f, output, of.gain)
    sigma = float(rng.choice([0.001, 0.003, 0.01])) * float(np.max(exact))
    sweep = Swept(
        values=values,
        frequency_hz=f,
        amplitude_v=np.abs(exact + sigma * rng.standard_normal(f.size)),
        sigma_v=sigma,
        use="fit",
        scale="fit",
        declared_noise=True,
    )
    unknowns = (
        *_unknowns(rng, of),
        _eta(rng, "eta_plus", of),
        _eta(rng, "eta_minus", of),
    )
    return Laboratory(
        kind="crossing",
        seed=seed,
        values=values,
        series=(Series(name="sweep", output=output, sweep=sweep),),
        unknowns=unknowns,
        gain=of.gain,
    )


def one_pair(seed: int) -> Laboratory:
    """Two peaks for three unknowns: none of the three may be called determined.

    Either theta, d1 and d2 beside a sweep that gives the scale; or an uncoupled mode's frequency,
    damping and modal gain without any: its frequency and half its width then lie on a circle of
    Apollonius about the tones, so that nothing but the box ends width and gain from below.
    """
    rng = np.random.default_rng([5, seed])
    of = sample(rng, overlap=0.0)
    coupled = seed % 2 == 0
    if not coupled:
        of = _uncoupled(of)
    reading = _read(
        rng,
        of,
        {
            "label": "pair1",
            "values": of.values,
            "tones_hz": _pair(rng, of.values["eta_plus"], of.widths_hz[0]),
        },
        float(rng.choice([0.002, 0.01])),
    )
    told = _told(of) if coupled else {n: of.values[n] for n in ("theta", "d2", "eta_minus")}
    series = Series(
        name="q1",
        output="q1_hybrid",
        readings=(reading,),
        sweep=_sweep(rng, of, 0) if coupled else None,
        start=told,
        amplitude="V peak" if coupled else "m peak",
    )
    return Laboratory(
        kind="one_pair",
        seed=seed,
        values=of.values,
        series=(series,),
        unknowns=_unknowns(rng, of) if coupled else _line(rng, of),
        gain=of.gain,
    )


def _uncoupled(of: Sample) -> Sample:
    """The same lines without coupling, read in metres."""
    values = {**of.values, "theta": 0.0, "g1": 1.0}
    return Sample(values, (values["d1"], values["d2"]), 1.0)


def _line(rng: Random, of: Sample) -> tuple[Unknown, ...]:
    """Frequency, damping and gain of one uncoupled line."""
    gain = replace(_damping(rng, "g1", 1.0), unit="1")
    return (_eta(rng, "eta_plus", of), _damping(rng, "d1", of.values["d1"]), gain)


def readings(seed: int) -> Laboratory:
    """Ready peaks or spectra, peak or rms, signal to noise from 10 to 1e4."""
    rng = np.random.default_rng([6, seed])
    of = sample(rng, overlap=0.1)
    sigma = TOP_V / _log(rng, 30.0, 1e4)
    spectra = bool(seed % 2)
    made = []
    for k in range(int(rng.integers(6, 11))):
        tones = _pair(rng, of.values["eta_plus"], of.widths_hz[0])
        made.append(_spectrum(rng, of, f"pair{k + 1}", tones, sigma, spectra=spectra))
    rms = bool(rng.random() < 0.5)
    series = Series(
        name="q1",
        output="q1_hybrid",
        readings=tuple(made),
        sweep=_sweep(rng, of, 0),
        start=_told(of),
        amplitude="V rms" if rms else "V peak",
        factor=math.sqrt(0.5) if rms else 1.0,
    )
    return Laboratory(
        kind="readings",
        seed=seed,
        values=of.values,
        series=(series,),
        unknowns=_unknowns(rng, of),
        gain=of.gain,
        notes={"spectra": spectra, "rms": rms},
    )


def _spectrum(
    rng: Random, of: Sample, label: str, tones_hz: FloatArray, sigma_v: float, *, spectra: bool
) -> Reading:
    """A magnitude spectrum with noise sigma per quadrature, or peaks with that noise."""
    exact = amplitude_v(of.values, tones_hz, "q1_hybrid", of.gain)
    grid = of.widths_hz[0] / 20.0
    peaks, spectrum = np.abs(exact + sigma_v * rng.standard_normal(2)), None
    if spectra:
        places = np.round(tones_hz / grid).astype(int)
        bins = np.arange(places[0] - 100, places[1] + 101)
        noise = sigma_v * (rng.standard_normal(bins.size) + 1j * rng.standard_normal(bins.size))
        noise[np.searchsorted(bins, places)] += exact
        spectrum = np.array([bins * grid, np.abs(noise)])
        read = spectrum[1, np.searchsorted(bins, places)]
        peaks = np.sqrt(np.maximum(read**2 - sigma_v**2, (0.1 * sigma_v) ** 2))
    return Reading(
        label=label,
        values=of.values,
        tones_hz=tones_hz,
        levels=np.ones(2),
        output="q1_hybrid",
        peaks_v=peaks,
        sigmas_v=np.full(2, sigma_v),
        spectrum=spectrum,
    )


FAULTS = (
    "rms",
    "factor 2",
    "20 log",
    "saturation",
    "background",
    "bad point",
    "mislabelled tones",
    "second drive",
)


def misuse(seed: int) -> Laboratory:
    """Ready peaks and a sweep with one mistake in them, `FAULTS` in turn."""
    rng = np.random.default_rng([7, seed])
    fault = FAULTS[seed % len(FAULTS)]
    of = sample(rng, overlap=0.0)
    relative = 0.005
    readings = [
        _read(
            rng,
            of,
            {
                "label": f"pair{k + 1}",
                "values": of.values,
                "tones_hz": _pair(rng, of.values["eta_plus"], of.widths_hz[0]),
            },
            relative,
        )
        for k in range(8)
    ]
    swept = replace(_sweep(rng, of, 0), scale=str(rng.choice(["maximum", "fit"])))
    series = Series(
        name="q1", output="q1_hybrid", readings=tuple(readings), sweep=swept, start=_told(of)
    )
    return Laboratory(
        kind="misuse",
        seed=seed,
        values=of.values,
        series=(MISTAKES[fault](rng, of, series),),
        unknowns=_unknowns(rng, of),
        gain=of.gain,
        honest=False,
        fault=fault,
    )


def _swept_as(series: Series, amplitude_v: FloatArray) -> Series:
    assert series.sweep is not None
    return replace(series, sweep=replace(series.sweep, amplitude_v=amplitude_v))


def _rms(rng: Random, of: Sample, series: Series) -> Series:
    """The sweep holds peak values and is declared rms."""
    return replace(series, sweep_amplitude="V rms")


def _factor(rng: Random, of: Sample, series: Series) -> Series:
    """A divider or a gain of two in the path of the sweep alone."""
    return replace(series, sweep_factor=float(rng.choice([0.5, 2.0])))


def _decibels(rng: Random, of: Sample, series: Series) -> Series:
    """dB turned into amplitudes by 10^(L/10) instead of 10^(L/20): squares, relative to the top."""
    assert series.sweep is not None
    a = series.sweep.amplitude_v
    return _swept_as(series, np.max(a) * (a / np.max(a)) ** 2)


def _saturated(rng: Random, of: Sample, series: Series) -> Series:
    """The detector clips the sweep at 60 to 80 % of its top."""
    assert series.sweep is not None
    limit = float(rng.uniform(0.6, 0.8)) * float(np.max(series.sweep.amplitude_v))
    return _swept_as(series, np.minimum(series.sweep.amplitude_v, limit))


def _crosstalk(rng: Random, of: Sample, series: Series) -> Series:
    """A complex constant of 10 to 30 % of the top under the sweep."""
    sweep = series.sweep
    assert sweep is not None
    line = _complex_line(of, sweep.frequency_hz)
    turn = np.exp(2j * math.pi * rng.uniform())
    constant = float(rng.uniform(0.1, 0.3)) * float(np.max(np.abs(line))) * turn
    noise = sweep.sigma_v * rng.standard_normal(line.size)
    return _swept_as(series, np.abs(np.abs(line + constant) + noise))


def _complex_line(of: Sample, f_hz: FloatArray) -> np.ndarray:
    return of.gain * response(of.values, f_hz, "q1_hybrid")


def _spike(rng: Random, of: Sample, series: Series) -> Series:
    """One point of the sweep, not its top, is wrong by 30 % of the top."""
    assert series.sweep is not None
    a = series.sweep.amplitude_v.copy()
    k = int(rng.integers(0, a.size))
    a[k] = abs(a[k] + float(rng.choice([-1.0, 1.0])) * 0.3 * float(np.max(a)))
    return _swept_as(series, a)


def _mislabelled(rng: Random, of: Sample, series: Series) -> Series:
    """The two peaks of some experiments have changed places."""
    swapped = rng.choice(len(series.readings), int(rng.integers(2, 5)), replace=False)
    made = [
        replace(r, peaks_v=r.peaks_v[::-1]) if k in swapped else r
        for k, r in enumerate(series.readings)
    ]
    return replace(series, readings=tuple(made))


def _driven_twice(rng: Random, of: Sample, series: Series) -> Series:
    """A tone that nobody declared, near the mode, in every spectrum."""
    grid = of.widths_hz[0] / 20.0
    place = round((of.values["eta_plus"] + 2.0 * of.widths_hz[0]) / grid) * grid
    size = float(rng.uniform(0.3, 1.0)) * TOP_V
    sigma = 2e-3 * TOP_V
    made = []
    for r in series.readings:
        read = _spectrum(rng, of, r.label, r.tones_hz, sigma, spectra=True)
        assert read.spectrum is not None
        k = int(np.argmin(np.abs(read.spectrum[0] - place)))
        read.spectrum[1, k] = size
        made.append(read)
    return replace(series, readings=tuple(made))


MISTAKES: Mapping[str, Callable[[Random, Sample, Series], Series]] = {
    "rms": _rms,
    "factor 2": _factor,
    "20 log": _decibels,
    "saturation": _saturated,
    "background": _crosstalk,
    "bad point": _spike,
    "mislabelled tones": _mislabelled,
    "second drive": _driven_twice,
}

KINDS: Mapping[str, Callable[[int], Laboratory]] = {
    "pairs": pairs,
    "drift": drift,
    "joint": joint,
    "crossing": crossing,
    "one_pair": one_pair,
    "readings": readings,
    "misuse": misuse,
}
