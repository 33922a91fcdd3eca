"""Scenes at the edges of what a campaign may hold: written as files, fitted through an FMU.

The measurements are the virtual laboratory's closed form (`fitting.lab.string`, which shares no
code with the FMU), or mpmath's at 90 digits where the laboratory has no scene (degenerate modes).
Frequencies are written in any unit with all their digits, so that a reader must give the same
double back.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.fit.fit import Status
from fitting.fit.options import options_of
from fitting.fit.problem import problem_of
from fitting.fmu.pool import FmuWorkers
from fitting.lab.string import TwoModes, steady_state
from fitting.report.summary import detail_lines, result_lines
from fitting.result.result import Result
from fitting.text.arrays import FloatArray
from fitting.text.records import to_plain
from tests.support import reference
from tests.support.reconstruction import ReconstructionOptions, reconstruct_through

POWERS = {"Hz": 0, "kHz": 3, "MHz": 6, "GHz": 9}
ANGLE = 2.0


@dataclass(frozen=True)
class Fitted:
    """A fitted parameter as the campaign file has it."""

    lower: float
    upper: float
    start: float
    scale: float
    reference: float | None = None


@dataclass(frozen=True)
class Scene:
    """Two modes, what is measured of the first of them, and what is fitted; Hz, V, line widths.

    ``tones`` of each experiment and the ends of ``sweep`` are line widths w = D11/2 pi away from
    ``eta_plus``; ``points`` of the sweep; ``noise`` is sigma per quadrature over the crest, in the
    sweep and in spectra; ``drift`` the linear drift of both modes over the series in line widths,
    ``drift_known`` whether the campaign tells it. ``peaks``: ready peaks instead of spectra.
    ``fitted`` by name, in Hz; none: d1 from half as much again.
    """

    theta: float = ANGLE
    d1: float = 100.0
    d2: float = 120.0
    eta_plus: float = 6.94e6
    eta_minus: float = 7.03e6
    reflection: bool = False
    tones: tuple[tuple[float, ...], ...] = ((-1.0, 1.0), (-0.5, 0.5), (-0.25, 0.25))
    sweep: tuple[float, float] | None = (-3.0, 3.0)
    points: int = 41
    crest: float = 1.0
    noise: float = 0.0
    seed: int = 1
    drift: float = 0.0
    drift_known: bool = True
    peaks: bool = True
    unit: str = "Hz"
    level: float = 1.0
    use: str = "scale"
    scale: str = "maximum"
    nu: tuple[float, float, int] = (1e-3, 1e-3, 3)
    misfit: str = "slack"
    starts: int = 1
    accuracy: float = 1e-6
    fitted: Mapping[str, Fitted] = field(default_factory=dict)

    @property
    def width(self) -> float:
        """Line width of the first mode, Hz."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return c * c * self.d1 + s * s * self.d2

    def response(self, frequency_hz: FloatArray, shift_hz: float = 0.0) -> FloatArray:
        """Amplitude of the first mode (n,) per unit of drive, from outside of the FMU."""
        plus, minus = self.eta_plus + shift_hz, self.eta_minus + shift_hz
        if plus < minus and self.d1 > 0.0:
            modes = TwoModes(
                theta_rad=self.theta,
                d1_hz=self.d1,
                d2_hz=self.d2,
                eta_plus_hz=plus,
                eta_minus_hz=minus,
                reflection=self.reflection,
            )
            return np.asarray(np.abs(steady_state(modes, frequency_hz)[:, 0]))
        p = SimpleNamespace(
            theta=self.theta,
            reflection=self.reflection,
            d1=self.d1,
            d2=self.d2,
            eta_plus=plus,
            eta_minus=minus,
            g1=1.0,
            g2=1.0,
        )
        return np.array([float(abs(reference.phasors(p, float(f))[0])) for f in frequency_hz])

    def drifts(self) -> FloatArray:
        """Shift of both modes in every experiment, (n,), Hz."""
        return self.drift * self.width * (np.linspace(0.0, 1.0, max(len(self.tones), 1)) - 0.5)

    def at(self, offsets: tuple[float, ...] | FloatArray) -> FloatArray:
        """Frequencies that many line widths from the mode, to as many digits as people write."""
        return np.array([float(f"{self.eta_plus + o * self.width:.15g}") for o in offsets])


def written(value_hz: float, unit: str) -> str:
    """A frequency in a unit, with every digit of its shortest text."""
    return str(Decimal(repr(float(value_hz))).scaleb(-POWERS[unit]))


def write(scene: Scene, fmu: Path, folder: Path) -> Path:
    """Write the campaign of a scene; the path of its file."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(scene.seed)
    top = float(scene.response(scene.at((0.0,)))[0])
    text = [
        'title = "extreme (synthetic)"',
        "synthetic = true",
        "[fmu]",
        f'file = "{fmu}"',
        "[fmu.start]",
        "periodic_start = true",
        f"reflection = {str(scene.reflection).lower()}",
        *_held(scene),
        "[observe]",
        'output = "q1_hybrid"',
        "steady_start = true",
        "[drive]",
        'kind = "tones"',
        f"level = {scene.level!r}",
    ]
    count = len(scene.tones[0]) if scene.tones else 2
    text += [
        f"frequencies = {[f'u{k + 1}' for k in range(count)]}",
        f"amplitudes = {[f'A{k + 1}' for k in range(count)]}",
    ]
    if scene.tones:
        text += _experiments(scene, top, rng, folder, count)
    if scene.sweep is not None:
        text += _sweep(scene, top, rng, folder)
    text += _rest(scene)
    path = folder / "campaign.toml"
    path.write_text("\n".join(text) + "\n")
    return path


def _held(scene: Scene) -> list[str]:
    """Start values of what is neither fitted nor drifting."""
    held = {"theta": repr(scene.theta), "d1": repr(scene.d1), "d2": repr(scene.d2)}
    fitted = set(scene.fitted) or {"d1"}
    drifting = scene.drift and scene.drift_known
    for name, value in (("eta_plus", scene.eta_plus), ("eta_minus", scene.eta_minus)):
        if not drifting:
            held[name] = f'"{written(value, scene.unit)} {scene.unit}"'
    return [f"{name} = {value}" for name, value in held.items() if name not in fitted]


def _experiments(
    scene: Scene, top: float, rng: np.random.Generator, folder: Path, count: int
) -> list[str]:
    names = [f"u{k + 1} ({scene.unit})" for k in range(count)]
    names += [f"p{k + 1} (V)" for k in range(count)] if scene.peaks else []
    if scene.peaks and scene.noise:
        names += [f"s{k + 1} (V)" for k in range(count)]
    rows = [",".join(["experiment", *names])]
    for m, (offsets, shift) in enumerate(zip(scene.tones, scene.drifts(), strict=True)):
        tones = scene.at(offsets)
        lines = scene.crest * (scene.response(tones, shift) / top)
        cells = [written(f, scene.unit) for f in tones]
        if scene.peaks:
            sigma = scene.noise * scene.crest
            wave = lines + sigma * (rng.standard_normal(count) + 1j * rng.standard_normal(count))
            cells += [repr(float(a)) for a in np.abs(wave)]
            cells += [repr(sigma)] * (count if scene.noise else 0)
        else:
            _spectrum(scene, tones, lines, rng, folder / f"e{m}.csv")
        rows.append(",".join([f"e{m}", *cells]))
    (folder / "experiments.csv").write_text("\n".join(rows) + "\n")
    said = ["[experiments]", 'file = "experiments.csv"', 'amplitude = "V peak"']
    if not scene.peaks:
        return [*said, 'spectra = "{experiment}.csv"', *_drift(scene)]
    said += [f"peaks = {[f'p{k + 1}' for k in range(count)]}"]
    if scene.noise:
        said += [f"peak_sigmas = {[f's{k + 1}' for k in range(count)]}"]
    return said + _drift(scene)


def _drift(scene: Scene) -> list[str]:
    if not (scene.drift and scene.drift_known):
        return []
    ends = scene.drifts()[0], scene.drifts()[-1]
    said = ["[drift]"]
    for name, value in (("eta_plus", scene.eta_plus), ("eta_minus", scene.eta_minus)):
        before, after = (f'"{written(value + end, scene.unit)} {scene.unit}"' for end in ends)
        said.append(f"{name} = {{ before = {before}, after = {after} }}")
    return said


def _spectrum(
    scene: Scene, tones: FloatArray, lines: FloatArray, rng: np.random.Generator, path: Path
) -> None:
    """Lines of one point each among 200 points of noise."""
    apart = float(np.min(np.diff(np.sort(tones)))) if tones.size > 1 else scene.width
    step = apart / 20.0
    grid = tones[0] + step * np.arange(-100, 101)
    wave = np.zeros(grid.size, dtype=complex)
    for tone, line in zip(tones, lines, strict=True):
        nearest = int(np.argmin(np.abs(grid - tone)))
        grid[nearest] = tone
        wave[nearest] += line
    sigma = scene.noise * scene.crest
    wave += sigma * (rng.standard_normal(grid.size) + 1j * rng.standard_normal(grid.size))
    _trace(scene, grid, np.abs(wave), path)


def _sweep(scene: Scene, top: float, rng: np.random.Generator, folder: Path) -> list[str]:
    assert scene.sweep is not None
    grid = scene.at(np.linspace(*scene.sweep, scene.points))
    wave = (scene.crest * (scene.response(grid) / top)).astype(complex)
    sigma = scene.noise * scene.crest
    wave += sigma * (rng.standard_normal(grid.size) + 1j * rng.standard_normal(grid.size))
    _trace(scene, grid, np.abs(wave), folder / "sweep.csv")
    said = ["[sweep]", 'file = "sweep.csv"', 'amplitude = "V peak"', f'use = "{scene.use}"']
    said.append(f'scale = "{scene.scale}"')
    if scene.drift and scene.drift_known:
        ends = zip(("eta_plus", "eta_minus"), (scene.eta_plus, scene.eta_minus), strict=True)
        values = (f'{name} = "{written(v, scene.unit)} {scene.unit}"' for name, v in ends)
        said.append(f"set = {{ {', '.join(values)} }}")
    return said


def _trace(scene: Scene, grid: FloatArray, amplitude: FloatArray, path: Path) -> None:
    rows = [f"frequency ({scene.unit}),amplitude (V)"]
    rows += [f"{written(f, scene.unit)},{float(a)!r}" for f, a in zip(grid, amplitude, strict=True)]
    path.write_text("\n".join(rows) + "\n")


def _rest(scene: Scene) -> list[str]:
    w = scene.d1
    fitted = scene.fitted or {"d1": Fitted(0.2 * w, 5.0 * w, 1.5 * w, w)}
    text = []
    for name, f in fitted.items():
        text += ["[[parameters]]", f'name = "{name}"', f"lower = {f.lower!r}"]
        text += [f"upper = {f.upper!r}", f"start = {f.start!r}", f"scale = {f.scale!r}"]
        if f.reference is not None:
            text.append(f"reference = {f.reference!r}")
    first, beta, levels = scene.nu
    text += ["[continuation]", f"nu_start = {first!r}", f"beta = {beta!r}"]
    text += [f"iterations = {levels}", f'misfit = "{scene.misfit}"', f"starts = {scene.starts}"]
    text += ["[accuracy]", f"amplitude = {scene.accuracy!r}"]
    return [*text, "[derived]", 'outputs = ["width_plus", "lambda"]']


def bound_of(scene: Scene, workers: FmuWorkers, folder: Path) -> BoundCampaign:
    """The campaign of a scene, written, read and bound to the FMU."""
    path = write(scene, workers.description.path, folder)
    return bind(read_campaign(path), workers.description.variables)


def fit(scene: Scene, workers: FmuWorkers, folder: Path, *, profiles: bool = False) -> Result:
    """The result of a scene, and what holds for every result, whatever the scene."""
    return fit_bound(write(scene, workers.description.path, folder), workers, profiles=profiles)


def fit_bound(path: Path, workers: FmuWorkers, *, profiles: bool = False) -> Result:
    """The result of a campaign that is written, checked likewise."""
    bound = bind(read_campaign(path), workers.description.variables)
    options = options_of(bound.continuation)
    asked = ReconstructionOptions(options, profiles=profiles)
    result = reconstruct_through(workers, problem_of([bound]), asked)
    speaks_plainly(result)
    return result


def speaks_plainly(result: Result) -> None:
    """A status, a sentence, finite values, and no word that a float prints for want of a number."""
    assert result.status in list(Status)
    assert result.message.endswith(".")
    assert all(math.isfinite(p.value) for p in result.parameters.values())
    told = " ".join(" ".join([*result_lines(result), *detail_lines(result)]).split())
    told = re.sub(r"The FMU reports.*? it is NaN", "", told)  # its own words
    words = told.lower().replace(",", " ").replace("=", " ").split()
    assert not {"nan", "inf", "-inf", "+inf"} & set(words), told
    json.dumps(to_plain(result), allow_nan=False)


def no_false_success(result: Result, scene: Scene, sigmas: float = 4.0) -> None:
    """What a converged result calls determined, or linearised, is true within its own error.

    `fitting.fit.linearisation` never claims an error below the floor of 1e-6.
    """
    if result.status != "converged":
        return
    truth = {"d1": scene.d1, "d2": scene.d2, "eta_plus": scene.eta_plus}
    truth |= {"theta": scene.theta}
    found = {name: result.parameters[name] for name in scene.fitted or {"d1"} if name in truth}
    told = [(p.value, p.std, truth[name], p.status) for name, p in found.items()]
    width = result.derived["width_plus"]
    told.append((width.value, width.std, scene.width, width.status))
    for value, std, true, word in told:
        if word in ("determined", "linearised only"):
            assert abs(value - true) <= sigmas * std + 1e-6 * abs(true), (value, std, true)
