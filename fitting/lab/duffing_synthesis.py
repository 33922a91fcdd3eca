"""A series of the string driven hard -> the files of a campaign, and back from its truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from fitting.campaign.section import Section
from fitting.lab.duffing import READ, Cubic, DuffingBench, DuffingSeries
from fitting.lab.synthesis import (
    CAMPAIGN_NAME,
    TRUTH_NAME,
    field_names,
    marked,
    mhz,
    read_bench,
    toml_lines,
    trace_csv,
    truth_toml,
)
from fitting.signal.peaks import fit_resonance
from fitting.text.errors import BadInput
from fitting.text.toml import read_toml

CAMPAIGN = """\
{mark}
title = "Duffing string, q1 driven hard (synthetic)"
synthetic = true

# What these data determine: the line width, the eigenfrequency, and alpha1 A^2, the strength of the
# cubic term under the stated drive. The weak sweep ties volts to metres by the drive as stated, so
# alpha1 is as good as A: a drive stated twice too large makes alpha1 four times too small.

[fmu]
model = "DuffingOscillator"
timeout_s = 60

# Near eta_plus only the width D11/2pi shows. At theta = 0 it is d1 itself, and the solver need not
# follow the other mode: 25 ms a run instead of 150 ms. What that leaves out, damping and cubic
# terms of and with a mode 87 kHz away, is below 1e-5 of an amplitude.
[fmu.start]
theta = 0.0
d2 = 100.0
eta_minus = "{eta_minus!r} MHz"
alpha2 = 0.0
kappa = 0.0
periodic_start = true              # the FMU begins on its periodic orbit: nothing to settle
solver = 1                         # envelope

[observe]
output = "q1_hybrid"
steady_start = true

[drive]
kind = "tones"
frequencies = ["u1", "u2"]
amplitudes = ["A1", "A2"]
level = "{weak!r} m/s2"            # of the sweep; the experiments have columns of their own
read = ["u1", "u2", "2*u1 - u2", "2*u2 - u1"]
order = 15                         # lines up to 8 u1 - 7 u2 are kept off those that are read

[experiments]
file = "experiments.csv"
peaks = ["z_u1", "z_u2", "z_low", "z_high"]
peak_sigmas = ["s_u1", "s_u2", "s_low", "s_high"]
amplitude = "V peak"

[sweep]                            # weak: its maximum is the scale
file = "sweep.csv"
layout = "csv"
amplitude = "V peak"
use = "scale"
scale = "maximum"

[[parameters]]
name = "d1"
unit = "Hz"
lower = {width_box[0]!r}
upper = {width_box[1]!r}
start = {width!r}                      # width of the sweep, +- {width_std:.2g} Hz
scale = {width_scale!r}

[[parameters]]
name = "eta_plus"
unit = "Hz"
lower = {eta_box[0]!r}
upper = {eta_box[1]!r}
start = {eta!r}                    # of the sweep, +- {eta_std:.2g} Hz
scale = {eta_scale!r}

[[parameters]]                     # the box: a shift of a line width, strongest tone on resonance
name = "alpha1"
unit = "1/(m2.s2)"
lower = {alpha_box[0]!r}
upper = {alpha_box[1]!r}
start = 0.0                        # the linear string
scale = {alpha_scale!r}

[continuation]
nu_start = 1e-6
beta = 1e-3
iterations = 2
misfit = "squares"
starts = 1

[accuracy]
amplitude = 1e-3                   # a third of what a line is repeatable
tolerance = "tolerance"            # the plan sets it
"""


def duffing_files(measured: DuffingSeries, command: str) -> dict[str, str]:
    """Texts by relative file name, as :func:`fitting.lab.synthesis.campaign_files`."""
    lab, series = measured.bench, measured.series
    mark = marked(series.seed, command)
    labels = [f"drive{m}" for m in range(1, len(lab.levels) + 1)]
    more = ["", "[cubic]                            # in 1/(m^2 s^2)", *toml_lines(lab.cubic)]
    more += [
        "",
        "[drive]                            # in m/s^2",
        f"weak_level = {lab.weak_level!r}",
    ]
    more += [f"repeatability = {lab.repeatability!r}"]
    more += [f"levels = [{', '.join(map(repr, lab.levels))}]"]
    more += [f"lines = {[list(factors) for factors in READ]}"]
    return {
        CAMPAIGN_NAME: _campaign(measured, mark),
        "experiments.csv": _experiments(measured, labels, mark),
        "sweep.csv": trace_csv(series.sweep, mark),
        TRUTH_NAME: truth_toml(series, labels, mark, more),
    }


def _campaign(measured: DuffingSeries, mark: str) -> str:
    """The campaign's TOML; line width and eigenfrequency start at those of the weak sweep."""
    lab, series = measured.bench, measured.series
    fit = fit_resonance(series.sweep.frequency_hz, series.sweep.amplitude_v)
    width, eta = round(fit.width_hz, 3), round(fit.eta_hz, 3)
    alpha = _one_digit(_alpha_of_a_width(width, eta, max(lab.levels)))
    return CAMPAIGN.format(
        mark=mark,
        eta_minus=mhz(lab.bench.modes.eta_minus_hz),
        weak=lab.weak_level,
        width=width,
        width_std=fit.width_std_hz,
        width_box=(_one_digit(0.5 * width), _one_digit(2.0 * width)),
        width_scale=_one_digit(0.1 * width),
        eta=eta,
        eta_std=fit.eta_std_hz,
        eta_box=(round(eta - width), round(eta + width)),
        eta_scale=_one_digit(0.1 * width),
        alpha_box=(-alpha, alpha),
        alpha_scale=_one_digit(alpha / 3.0),
    )


def _alpha_of_a_width(width_hz: float, eta_hz: float, level: float) -> float:
    """The cubic coefficient at which one resonant tone shifts the frequency by a line width.

    On resonance a = A/(4 pi^2 eta w); its eigenfrequency is 3 alpha a^2/(32 pi^2 eta) higher.
    """
    amplitude = level / (4.0 * math.pi**2 * eta_hz * width_hz)
    return width_hz * 32.0 * math.pi**2 * eta_hz / (3.0 * amplitude**2)


def _one_digit(value: float) -> float:
    return float(f"{value:.0e}")


def _experiments(measured: DuffingSeries, labels: Sequence[str], mark: str) -> str:
    lab = measured.bench
    head = "experiment,u1 (MHz),u2 (MHz),A1 (m/s2),A2 (m/s2),"
    head += ",".join(f"{kind}_{line} (uV)" for kind in "zs" for line in ("u1", "u2", "low", "high"))
    rows = []
    for m, (label, level) in enumerate(zip(labels, lab.levels, strict=True)):
        numbers = [*map(mhz, lab.bench.pairs_hz[m]), level, level]
        numbers += [1e6 * float(v) for v in (*measured.peaks_v[m], *measured.sigmas_v[m])]
        rows.append(",".join([label, *map(repr, numbers)]))
    return "\n".join([mark, head, *rows]) + "\n"


def is_duffing(truth: Path) -> bool:
    """Whether a truth file is that of a string driven hard."""
    return truth.is_file() and "cubic" in read_toml(truth)


def read_duffing_bench(truth: Path) -> DuffingBench:
    """The bench that a campaign was made on, from its truth file.

    Raises:
        BadInput: a file that does not describe such a bench.
    """
    bench, top = read_bench(truth), Section(truth, "", read_toml(truth))
    cubic, drive = top.sub("cubic", field_names(Cubic)), top.sub("drive")
    try:
        levels = tuple(float(level) for level in drive.required("levels"))
        coefficients = Cubic(*(float(cubic.required(name)) for name in field_names(Cubic)))
        weak, jitter = (float(drive.required(name)) for name in ("weak_level", "repeatability"))
        return DuffingBench(bench, coefficients, levels, weak, jitter)
    except (TypeError, ValueError) as error:
        raise BadInput(f"{truth}: does not describe a virtual laboratory: {error}") from error
