"""Causes of a misfit, end to end: a campaign file, synthetic data in closed form, what is named.

One mode of frequency f and full width w under a force of 1 N/kg answers with

    H(u) = 1/((2 pi)^2 (f^2 - u^2 + i u w))

to a tone, with (1 - exp(-pi w t)(cos + ...))/(2 pi f)^2 to a step, and in heat with the density
-4 k_B T Im H/(2 pi u m): numpy alone, no FMU. Each laboratory makes one mistake, and the fit has to
name it and no other.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.constants import Boltzmann
from scipy.optimize import least_squares

from fitting.inference.checks import mistakes
from fitting.measurements.residuals import ResidualCurve
from fitting.report.summary import summary_of
from fitting.result.result import Result, read_result
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.estimate import Verdict
from fitting.text.finding import Kind
from tests.support.in_process import told
from tests.support.samples import cases

ROOT = Path(__file__).parents[2]
F_HZ, WIDTH_HZ = 52_300.0, 31.0
U = F_HZ + np.linspace(-150.0, 150.0, 121)
CAUSES = {
    *(Kind.gain, Kind.offset, Kind.shift, Kind.noise_level, Kind.drift_exchanged, Kind.outlier),
    Kind.line_missing,
}
HEAD = """title = "One mode"
synthetic = true
[fmu]
file = "{fmu}"
[fmu.start]
periodic_start = true
theta = 0.0
g2 = 0.0
A2 = 0.0
eta_minus = "61 kHz"
u1 = "52.3 kHz"
u2 = "52.31 kHz"
{start}
[observe]
output = "q1_hybrid"
steady_start = true
[continuation]
misfit = "squares"
starts = 1
iterations = 3
nu_start = 1e-6
beta = 0.01
"""
DRIVE = """[drive]
kind = "tones"
frequencies = ["u1", "u2"]
amplitudes = ["A1", "A2"]
"""
WIDTH = """[[parameters]]
name = "d1"
unit = "Hz"
lower = 5.0
upper = 5000.0
start = 40.0
"""
CENTRE = """[[parameters]]
name = "eta_plus"
unit = "Hz"
lower = 52200.0
upper = 52400.0
start = 52310.0
"""
KNOWN_CENTRE = f'eta_plus = "{F_HZ} Hz"'
PEAKS = """[experiments]
file = "experiments.csv"
amplitude = "m peak"
peaks = ["z_u1", "z_u2"]
peak_sigmas = ["s_u1", "s_u2"]
noise_floor = "none"
[drift]
model = "linear"
eta_plus = {{ before = "{before} Hz", after = "{after} Hz" }}
[sweep]
file = "sweep.csv"
amplitude = "m peak"
use = "scale"
scale = "fit"
set = {{ eta_plus = "{centre} Hz" }}
"""


def response(u: FloatArray, f: float = F_HZ, w: float = WIDTH_HZ) -> ComplexArray:
    """Of the mode to a tone, s^2, (n,)."""
    return np.asarray(1.0 / ((2.0 * np.pi) ** 2 * (f**2 - u**2 + 1j * u * w)))


TOP = float(np.abs(response(np.array([F_HZ])))[0])
NOISE = 0.01 * TOP


def step(t: FloatArray, w: float) -> FloatArray:
    """Displacement after a force of 0.5 N/kg that begins at 0, (n,)."""
    slow, at = np.pi * w, np.clip(t, 0.0, None)
    turn = np.sqrt((2.0 * np.pi * F_HZ) ** 2 - slow**2)
    ring = np.exp(-slow * at) * (np.cos(turn * at) + slow / turn * np.sin(turn * at))
    return np.asarray(0.5 / (2.0 * np.pi * F_HZ) ** 2 * (1.0 - ring))


@dataclass(frozen=True)
class Laboratory:
    """A campaign without its head, start values of the FMU, and its tables by the file's name."""

    text: str
    tables: Mapping[str, tuple[str, FloatArray]]
    start: str = ""
    labels: Sequence[str] = field(default=())

    def reconstructed(self, fmu: Path, folder: Path, *options: str) -> tuple[int, Result, str]:
        """Exit code, result and what was printed; options: another report than none."""
        head = HEAD.format(fmu=fmu, start=self.start)
        (folder / "campaign.toml").write_text(head + self.text, "utf-8")
        for name, (columns, values) in self.tables.items():
            rows = [",".join(f"{x:.12g}" for x in row) for row in values]
            if self.labels and name == "experiments.csv":
                rows = [f"{label},{row}" for label, row in zip(self.labels, rows, strict=True)]
            (folder / name).write_text("\n".join([columns, *rows]) + "\n", "utf-8")
        words = ("--quick", "--no-profiles", "--workers", "1", *(options or ("--no-report",)))
        ended = told("reconstruct", folder / "campaign.toml", "--out", folder / "out", *words)
        assert (folder / "out" / "result.json").exists(), ended.err
        return ended.code, read_result(folder / "out" / "result.json"), ended.out


def drawn(seed: int, size: int) -> FloatArray:
    return np.asarray(NOISE * np.random.default_rng(seed).standard_normal(size))


# --- laboratories -------------------------------------------------------------------------------


def swept(amplitude: FloatArray, *, centre: bool = True) -> Laboratory:
    """Amplitudes of a calibrated detector over frequency, with noise of 1 % of the top."""
    text = f"""{DRIVE}[noise]
absolute = "{NOISE} m"
[sweep]
file = "sweep.csv"
amplitude = "m peak"
use = "fit"
scale = "none"
{WIDTH}{CENTRE if centre else ""}"""
    values = np.column_stack([U, amplitude + drawn(1, U.size)])
    tables = {"sweep.csv": ("frequency (Hz),amplitude (m)", values)}
    return Laboratory(text, tables, "" if centre else KNOWN_CENTRE)


def faint(noise: float, background: str = "none") -> Laboratory:
    """Magnitudes of two quadratures of noise (share of the top) over a line as narrow as a step."""
    u = F_HZ + np.linspace(-1600.0, 1600.0, 129)
    quadratures = np.random.default_rng(8).standard_normal((2, u.size))
    seen = np.abs(response(u) + noise * TOP * (quadratures[0] + 1j * quadratures[1]))
    text = f"""{DRIVE}[sweep]
file = "sweep.csv"
amplitude = "m peak"
use = "fit"
scale = "fit"
background = "{background}"
{WIDTH}"""
    table = ("frequency (Hz),amplitude (m)", np.column_stack([u, seen]))
    return Laboratory(text, {"sweep.csv": table}, KNOWN_CENTRE)


def thrice(shifts_hz: Sequence[float], offset: complex = 0.0) -> Laboratory:
    """Complex sweeps one after another, the axis of each shifted; an offset in the last."""
    text, tables = DRIVE + WIDTH + CENTRE, {}
    for k, shift in enumerate(shifts_hz):
        z = response(U - shift) + drawn(k, U.size) + 1j * drawn(k + 100, U.size)
        z = z + offset * TOP * (k == len(shifts_hz) - 1)
        tables[f"s{k}.csv"] = (
            "frequency (Hz),X (m),Y (m)",
            np.column_stack([U, z.real, z.imag]),
        )
        text += f'[[complex_sweep]]\nfile = "s{k}.csv"\nlabel = "s{k}"\nsigma = "{NOISE} m"\n'
    return Laboratory(text, tables)


def tuned(bend_hz: float) -> Laboratory:
    """Sweeps at five voltages that tune the mode by 20 Hz/V, and by a bend that no law has."""
    volts = np.linspace(-1.0, 1.0, 5)
    rows = []
    for k, volt in enumerate(volts):
        seen = np.abs(response(U, F_HZ + 20.0 * volt + bend_hz * volt**2)) + drawn(k, U.size)
        rows.append(np.column_stack([np.full(U.size, volt), U, seen]))
    parameter = '[[parameters]]\nname = "{}"\nlower = {}\nupper = {}\nstart = {}\n'
    text = f"""{DRIVE}[control_sweep]
file = "map.csv"
controls = ["V"]
amplitude = "m peak"
sigma = "{NOISE} m"
[laws]
eta_plus = "a0 + a1*V"
{WIDTH}{parameter.format("a0", 52200.0, 52400.0, 52305.0)}unit = "Hz"
{parameter.format("a1", 5.0, 60.0, 22.0)}unit = "Hz/V"
"""
    names = "V (V),frequency (Hz),amplitude (m)"
    return Laboratory(text, {"map.csv": (names, np.concatenate(rows))})


def warm(
    stated_k: float,
    *,
    floor: float = 0.0,
    shift_hz: float = 0.0,
    more: str = "",
    centre: bool = True,
) -> Laboratory:
    """The noise of 1 ng at 300 K as a displacement, 200 averages."""
    u = F_HZ + np.arange(-150.0, 150.0, 1.5)
    density = -4.0 * Boltzmann * 300.0 * response(u - shift_hz).imag / (2.0 * np.pi * u * 1e-12)
    density = density + floor * np.max(density)
    density = density * np.random.default_rng(5).gamma(200.0, 1.0 / 200.0, u.size)
    text = f"""{DRIVE}{WIDTH}{CENTRE if centre else ""}[[noise_spectrum]]
file = "noise.csv"
averages = 200
force = "thermal"
temperature = "{stated_k} K"
mass = "1 ng"
{more}"""
    tables = {"noise.csv": ("frequency (Hz),density (m2/Hz)", np.column_stack([u, density]))}
    return Laboratory(text, tables, "" if centre else KNOWN_CENTRE)


def struck(gain: float = 1.0, offset: float = 0.0, late_s: float = 0.0) -> Laboratory:
    """A step's answer, 0.6 ms in steps of 1 us, with noise of 1 % of its largest value."""
    count, begin, spacing_s = 600, 20, 1e-6
    t = spacing_s * np.arange(count)
    pushed = np.where(np.arange(count) >= begin, 0.5, 0.0)
    clean = step(np.asarray(t - begin * spacing_s - late_s), 900.0)
    top = float(np.max(clean))
    noise = 0.01 * top * np.random.default_rng(3).standard_normal(count)
    seen = gain * clean + offset * top + noise
    text = f"""{WIDTH.replace("start = 40.0", "start = 1000.0")}{CENTRE}[[trace]]
file = "step.csv"
input = "b"
interpolation = "held"
sigma = "{0.01 * top} m"
"""
    table = ("time (s),b (m/s2),q1_hybrid (m)", np.column_stack([t, pushed, seen]))
    return Laboratory(text, {"step.csv": table}, "A1 = 0.0")


OFFSETS_HZ = ((-40, 20), (-20, 50), (0, 70), (20, 80), (35, 95), (50, 15), (70, 30))


def drifted(
    to_hz: float = 60.0,
    *,
    exchanged: bool = False,
    gain: float = 1.0,
    bend_hz: float = 0.0,
    off: Mapping[int, float] | None = None,
    times: int = 1,
) -> Laboratory:
    """Seven pairs of tones while the mode drifts, and a sweep of before, which tells the scale."""
    rng = np.random.default_rng(4)
    tones = F_HZ + np.array(OFFSETS_HZ * times, dtype=float)
    rows = []
    for k, pair in enumerate(tones):
        part = k / (len(tones) - 1.0)
        at = F_HZ + to_hz * part + 4.0 * bend_hz * part * (1.0 - part)
        clean = gain * (off or {}).get(k, 1.0) * np.abs(response(pair, at))
        seen = clean * (1.0 + 0.01 * rng.standard_normal(2))
        rows.append([*pair, *seen, *(0.01 * clean)])
    u = F_HZ + np.linspace(-120.0, 120.0, 81)
    sweep = np.abs(response(u)) + 0.003 * TOP * rng.standard_normal(u.size)
    ends = {"before": F_HZ, "after": F_HZ + to_hz, "centre": F_HZ}
    if exchanged:
        ends |= {"before": F_HZ + to_hz, "after": F_HZ}
    columns = "experiment,u1 (Hz),u2 (Hz),z_u1 (m),z_u2 (m),s_u1 (m),s_u2 (m)"
    tables = {
        "experiments.csv": (columns, np.array(rows)),
        "sweep.csv": ("frequency (Hz),amplitude (m)", np.column_stack([u, sweep])),
    }
    labels = [f"e{k}" for k in range(len(tones))]
    return Laboratory(DRIVE + PEAKS.format(**ends) + WIDTH, tables, "", labels)


# --- what is named ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """A laboratory, the cause that has to be named, what of, how large, and within what."""

    laboratory: Laboratory
    kind: Kind
    size: float
    within: float
    subject: str = "measurement"


LINE = np.abs(response(U))
CASES = {
    "gain of a sweep": Case(swept(1.7 * LINE), Kind.gain, 0.7, 0.03),
    "gain of a step": Case(struck(gain=1.7), Kind.gain, 0.7, 0.03),
    "gain of peaks": Case(drifted(gain=1.7), Kind.gain, 0.7, 0.02, "experiments"),
    "offset of a sweep": Case(swept(LINE + 0.25 * TOP), Kind.offset, 0.25 * TOP, 0.01 * TOP),
    "offset of a small sweep": Case(swept(LINE + 0.1 * TOP), Kind.offset, 0.1 * TOP, 0.01 * TOP),
    "offset of a step": Case(struck(offset=0.15), Kind.offset, 1.37e-12, 0.05e-12),
    "offset of one sweep of three": Case(
        thrice([0.0, 0.0, 0.0], 0.2), Kind.offset, 0.2 * TOP, 0.01 * TOP, "s2"
    ),
    "floor of a spectrum": Case(warm(300.0, floor=0.1, more="floor = false\n"), Kind.offset, 0, 0),
    "shift of a sweep": Case(
        swept(np.abs(response(U - 12.0)), centre=False), Kind.shift, -12.0, 0.3
    ),
    "shift of nearly a width": Case(
        swept(np.abs(response(U - 25.0)), centre=False), Kind.shift, -25.0, 0.3
    ),
    "shift of a spectrum": Case(warm(300.0, shift_hz=8.0, centre=False), Kind.shift, -8.0, 0.3),
    "late trigger of a step": Case(struck(late_s=2e-6), Kind.shift, -2e-6, 0.05e-6),
    "shift of one sweep of three": Case(thrice([0.0, 0.0, 8.0]), Kind.shift, -8.0, 0.3, "s2"),
    "shift of one by a width": Case(thrice([0.0, 0.0, 31.0]), Kind.shift, -31.0, 0.3, "s2"),
    "temperature": Case(warm(450.0), Kind.noise_level, 300.0 / 450.0 - 1.0, 0.02),
    "temperature too low": Case(warm(200.0), Kind.noise_level, 0.5, 0.03),
    "drift exchanged": Case(drifted(exchanged=True), Kind.drift_exchanged, 0, 0, "drift"),
    "drift down exchanged": Case(
        drifted(-45.0, exchanged=True), Kind.drift_exchanged, 0, 0, "drift"
    ),
    "small drift exchanged": Case(
        drifted(12.0, exchanged=True), Kind.drift_exchanged, 0, 0, "drift"
    ),
    "experiment too high": Case(drifted(off={2: 1.5}), Kind.outlier, 0, 0, "e2"),
}


@pytest.mark.parametrize(
    "name",
    cases(
        CASES,
        "gain of a step",
        "offset of a sweep",
        "shift of a sweep",
        "temperature",
        "drift exchanged",
        "experiment too high",
    ),
)
def test_the_one_mistake_is_named_and_no_other(name: str, swift_fmu: Path, tmp_path: Path) -> None:
    case = CASES[name]
    code, result, printed = case.laboratory.reconstructed(swift_fmu, tmp_path)
    assert code in (1, 4)
    assert result.findings[0].severity == "error"
    [cause] = [f for f in result.findings if f.kind in CAUSES]
    assert (cause.kind, cause.subject) == (case.kind, case.subject)
    if case.within:
        assert cause.numbers["size"] == pytest.approx(case.size, abs=case.within)
    if "removed" in cause.numbers:
        assert cause.numbers["removed"] > 0.9
    assert f"{case.subject}: " in printed


def test_both_peaks_of_one_experiment_are_no_larger_noise(swift_fmu: Path, tmp_path: Path) -> None:
    """15 standard deviations off in one of 35: chi square is as if all noise were larger."""
    code, result, _ = drifted(off={2: 1.15}, times=5).reconstructed(swift_fmu, tmp_path)
    assert code == 0
    assert [f.subject for f in result.findings if f.kind is Kind.outlier] == ["e2", "e2"]
    assert Kind.noise_underestimated not in {f.kind for f in result.findings}


def test_values_of_a_misfit_are_told_nowhere(swift_fmu: Path, tmp_path: Path) -> None:
    """Terminal, values.csv, values.tex, result.json and Python; nor is a nearer start advised."""
    case = CASES["offset of a sweep"].laboratory
    _, result, printed = case.reconstructed(swift_fmu, tmp_path, "--formats", "svg")
    out = tmp_path / "out"
    stored = json.loads((out / "result.json").read_text("utf-8"))["parameters"]
    assert all(
        p.status is Verdict.WITHDRAWN and np.isnan(p.std) for p in result.parameters.values()
    )
    assert {p["status"] for p in stored.values()} == {Verdict.WITHDRAWN.value}
    assert {p["std"] for p in stored.values()} == {None}
    rows = (out / "values.csv").read_text("utf-8").splitlines()
    columns, *cells = [row.split(",") for row in rows]
    told = columns.index("value"), columns.index("std")
    assert not any(row[k] for row in cells for k in told)
    assert f"{result.parameters['d1'].value:.3g}" not in (out / "values.tex").read_text("utf-8")
    assert f"{result.parameters['d1'].value:.3g}" not in printed
    assert summary_of(result).values == ()
    assert "start" not in summary_of(result).advice


@pytest.mark.nightly
def test_a_drift_of_three_widths_is_a_shift_of_every_sweep(swift_fmu: Path, tmp_path: Path) -> None:
    code, result, _ = thrice([0.0, 31.0, 93.0]).reconstructed(swift_fmu, tmp_path)
    assert code == 4
    [cause] = [f for f in result.findings if f.kind in CAUSES]
    assert (cause.kind, cause.subject) == (Kind.shift, "s0, s1, s2")
    assert cause.numbers["removed"] > 0.9


RIGHT = {
    "sweep": swept(LINE),
    "three sweeps": thrice([0.0, 0.0, 0.0]),
    "spectrum": warm(300.0),
    "step": struck(),
    "drift": drifted(),
}


@pytest.mark.parametrize("name", cases(RIGHT, "three sweeps", "step"))
def test_a_right_model_has_no_cause(name: str, swift_fmu: Path, tmp_path: Path) -> None:
    code, result, _ = RIGHT[name].reconstructed(swift_fmu, tmp_path)
    assert code == 0
    assert result.findings == ()


def test_the_floor_of_magnitudes_is_an_offset_and_a_background_mends_it(
    swift_fmu: Path, tmp_path: Path
) -> None:
    """Far from the line |noise| is 1.25 of a quadrature's on average (Rice): that is in the data.

    The same least squares by scipy: a line and a constant.
    """
    laboratory = faint(0.03)
    (tmp_path / "mended").mkdir()
    _, result, _ = laboratory.reconstructed(swift_fmu, tmp_path)
    [cause] = [f for f in result.findings if f.kind in CAUSES]
    assert cause.kind is Kind.offset
    [(_, table)] = laboratory.tables.values()
    u, seen = table.T

    def left(p: FloatArray) -> FloatArray:
        return np.asarray((p[1] * np.abs(response(u, w=p[0])) + p[2] * TOP - seen) / TOP)

    offset = least_squares(left, [40.0, 1.0, 0.0]).x[2] * TOP
    assert cause.numbers["size"] == pytest.approx(offset, rel=0.02)
    _, mended, _ = faint(0.03, "offset").reconstructed(swift_fmu, tmp_path / "mended")
    assert not {f.kind for f in mended.findings} & (CAUSES | {Kind.correlated_residuals})


def test_one_point_of_a_line_is_no_offset(swift_fmu: Path, tmp_path: Path) -> None:
    """The same line far above its noise: one point of 81 stands out, and nothing is wrong."""
    _, result, _ = faint(1e-4).reconstructed(swift_fmu, tmp_path)
    assert not {f.kind for f in result.findings} & (CAUSES | {Kind.correlated_residuals})


#: What no single number mends: a second line, an amplifier's slope, a drift that bends, a law
#: without its bend.
OTHERWISE = {
    "second line": swept(np.abs(response(U) + 0.5 * response(U, F_HZ + 60.0, 25.0))),
    "slope": swept(LINE * (1.0 + 0.9 * (U - F_HZ) / 150.0)),
    "bent drift": drifted(bend_hz=40.0),
    "bent law": tuned(40.0),
}


@pytest.mark.parametrize("name", cases(OTHERWISE, "second line", "bent law"))
def test_what_no_single_number_mends_has_no_cause(
    name: str, swift_fmu: Path, tmp_path: Path
) -> None:
    code, result, _ = OTHERWISE[name].reconstructed(swift_fmu, tmp_path)
    assert code in (1, 4)
    assert Kind.not_described in [f.kind for f in result.findings]
    causes = [f for f in result.findings if f.kind in CAUSES]
    if name == "second line":  # which the model has not
        [missing] = causes
        assert missing.kind is Kind.line_missing
        assert missing.numbers["frequency_hz"] == pytest.approx(F_HZ + 60.0, abs=12.5)
        return
    assert not causes


LEFT = {
    "noise": (1.0, 0.0, True),
    "noise and a small structure": (1.0, 0.03, True),
    "noise and a structure": (1.0, 0.2, False),
    "noise of three times its size": (3.0, 0.0, False),
}


@pytest.mark.parametrize("name", LEFT)
def test_a_cause_has_to_leave_what_noise_explains(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    size, structure, explained = LEFT[name]
    sigma, rng = np.full(U.size, 0.01), np.random.default_rng(3)
    rows = size * rng.standard_normal(U.size) + structure * LINE / TOP / sigma
    curve = ResidualCurve(rows=np.arange(U.size), share=np.ones(U.size), axis=U)
    place: Any = SimpleNamespace(rows=curve.rows, curve=curve)
    search: Any = mistakes.Search.__new__(mistakes.Search)
    search.curves, search.sigma, search.known = [place], sigma, sigma > 0.0
    trial = mistakes.Trial(Kind.shift, (place,), np.zeros(1), np.zeros(2))
    left = replace(trial, rows=rows, slopes=np.zeros((U.size, 1)))
    monkeypatch.setattr(mistakes.Search, "sized", lambda *_: left)
    assert search.leaves_noise(trial) is explained


def test_a_sweep_whose_line_the_model_has_elsewhere_is_named(tmp_path: Path) -> None:
    """An eigenfrequency of the string's campaign is a digit off, its sweep sets the scale alone."""
    copied = shutil.copytree(ROOT / "data" / "string_q1", tmp_path / "string")
    file = copied / "campaign.toml"
    file.write_text(re.sub(r'"6\.94(\d+ MHz)"', r'"6.84\1"', file.read_text("utf-8")), "utf-8")
    words = ("--quick", "--no-profiles", "--no-report", "--native")
    ended = told("reconstruct", file, *words, "--out", tmp_path / "out")
    assert ended.code in (1, 4), ended.err
    result = read_result(tmp_path / "out" / "result.json")
    [missing] = [f for f in result.findings if f.kind is Kind.line_missing]
    # where lmfit has the line of the measured sweep
    assert missing.numbers["frequency_hz"] == pytest.approx(6940210.1, abs=1.0)
