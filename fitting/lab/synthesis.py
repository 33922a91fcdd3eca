"""A measured series of the virtual laboratory -> the files of a campaign, and back from its truth.

Nothing here touches the disk: texts by file name come out, the command writes them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fitting.campaign.section import Section
from fitting.lab.string import Bench, Series, Trace, TwoModes
from fitting.signal.peaks import fit_resonance
from fitting.text.errors import BadInput
from fitting.text.toml import read_toml

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

CAMPAIGN_NAME = "campaign.toml"
TRUTH_NAME = "truth.toml"
NOMINAL_WIDTH_HZ = 100.0

OUTPUTS = ("q1_hybrid", "q2_hybrid")

CAMPAIGN = """\
{mark}
title = "String, {series} series (synthetic)"
synthetic = true

[fmu]
model = "CoupledOscillator"
timeout_s = 60

[fmu.start]
periodic_start = true              # the FMU begins on its periodic orbit: nothing to settle

[observe]
output = "{output}"
steady_start = true

[drive]
kind = "tones"
frequencies = ["u1", "u2"]
amplitudes = ["A1", "A2"]
level = 1.0

[experiments]
file = "experiments.csv"
spectra = "spectra/{{experiment}}.csv"
layout = "csv"
amplitude = "V peak"
noise_floor = "robust"

[drift]                            # measured before and after the series
eta_plus = {{ before = "{before[0]!r} MHz", after = "{after[0]!r} MHz" }}
eta_minus = {{ before = "{before[1]!r} MHz", after = "{after[1]!r} MHz" }}

[sweep]                            # taken at the beginning of the series
file = "sweep.csv"
layout = "csv"
amplitude = "V peak"
set = {{ eta_plus = "{before[0]!r} MHz", eta_minus = "{before[1]!r} MHz" }}
use = "scale"
scale = "maximum"

# Start and reference of the paper: theta 0 and pi/2 + pi/8, box +-2 pi; damping from line widths.
[[parameters]]
name = "theta"
unit = "rad"
lower = -6.283185307179586
upper = 6.283185307179586
start = 0.0
reference = 1.9634954084936207
scale = 1.0
period = 3.141592653589793

[[parameters]]
name = "d1"
unit = "Hz"
lower = 1.0
upper = 1000.0
start = {damping[0]!r}{comment[0]}
reference = {damping[0]!r}
scale = 100.0

[[parameters]]
name = "d2"
unit = "Hz"
lower = 1.0
upper = 1000.0
start = {damping[1]!r}{comment[1]}
reference = {damping[1]!r}
scale = 100.0

[derived]
outputs = ["lambda", "f1", "f2", "width_plus", "width_minus", "Q_plus", "Q_minus"]

[alternatives]
reflection = [false, true]         # both forms of the orthogonal matrix

[continuation]
nu_start = 0.1
beta = 0.1
iterations = 9
tolerance = 2.22e-16
misfit = "slack"
starts = 3
seed = 1

[accuracy]
amplitude = 1e-6
"""


def campaign_files(series: Series, command: str) -> dict[str, str]:
    """Texts by relative file name: campaign, experiments, sweep, spectra and the truth.

    ``command`` is repeated in the head of every file, after the word "synthetic" and the seed. The
    numbers are written with 17 digits: reading them back loses nothing.
    """
    mark = marked(series.seed, command)
    labels = [f"pair{m}" for m in range(1, len(series.spectra) + 1)]
    files = {
        CAMPAIGN_NAME: _campaign(series, mark),
        "experiments.csv": _experiments(series, labels, mark),
        "sweep.csv": trace_csv(series.sweep, mark),
    }
    for label, spectrum in zip(labels, series.spectra, strict=True):
        files[f"spectra/{label}.csv"] = trace_csv(spectrum, mark)
    files[TRUTH_NAME] = truth_toml(series, labels, mark)
    return files


def marked(seed: int, command: str) -> str:
    """The head of every file."""
    return (
        f"# synthetic data of a virtual laboratory, not measured; seed {seed}\n# made by: {command}"
    )


def _campaign(series: Series, mark: str) -> str:
    """The campaign's TOML; the observed damping starts at the width fitted to the sweep."""
    observed = series.bench.observed
    fit = fit_resonance(series.sweep.frequency_hz, series.sweep.amplitude_v)
    damping = [NOMINAL_WIDTH_HZ, NOMINAL_WIDTH_HZ]
    damping[observed] = round(fit.width_hz, 3)
    comment = ["  # nominal", "  # nominal"]
    comment[observed] = f"  # width of the sweep, +- {fit.width_std_hz:.2g} Hz"
    return CAMPAIGN.format(
        mark=mark,
        series=series.bench.series,
        output=OUTPUTS[observed],
        before=[mhz(f) for f in series.eta_before_hz],
        after=[mhz(f) for f in series.eta_after_hz],
        damping=damping,
        comment=comment,
    )


def _experiments(series: Series, labels: Sequence[str], mark: str) -> str:
    rows = [
        f"{label},{mhz(low)!r},{mhz(high)!r}"
        for label, (low, high) in zip(labels, series.bench.pairs_hz, strict=True)
    ]
    return "\n".join([mark, "experiment,u1 (MHz),u2 (MHz)", *rows]) + "\n"


def trace_csv(trace: Trace, mark: str) -> str:
    """A measured curve as delimited text."""
    rows = [
        f"{mhz(f)!r},{float(a) * 1e6!r}"
        for f, a in zip(trace.frequency_hz, trace.amplitude_v, strict=True)
    ]
    return "\n".join([mark, "frequency (MHz),amplitude (uV)", *rows]) + "\n"


def truth_toml(series: Series, labels: Sequence[str], mark: str, more: Sequence[str] = ()) -> str:
    """Everything that was put in; :func:`read_bench` reads the first two tables back.

    ``more`` are lines of further tables.
    """
    bench = series.bench
    widths = bench.modes.widths_hz()
    lines = [mark, "# The truth behind this campaign. No reader of a fit opens this file.", ""]
    lines += ["[bench]", *toml_lines(bench, skip=("modes",)), ""]
    lines += [
        "[modes]                            # at the middle of the series",
        *toml_lines(bench.modes),
    ]
    lines += [*more, "", "[outcome]", f"seed = {series.seed}", f"gain_v = {series.gain!r}"]
    lines += [f"width_plus_hz = {widths[0]!r}", f"width_minus_hz = {widths[1]!r}"]
    for label, modes, peaks in zip(labels, series.true_modes, series.true_peaks_v, strict=True):
        lines += ["", "[[experiment]]", f'label = "{label}"']
        lines += [f"eta_plus_hz = {modes.eta_plus_hz!r}", f"eta_minus_hz = {modes.eta_minus_hz!r}"]
        lines += [f"peaks_v = [{', '.join(repr(float(p)) for p in peaks)}]"]
    return "\n".join(lines) + "\n"


def toml_lines(record: DataclassInstance, skip: Sequence[str] = ()) -> list[str]:
    """A record's fields as lines of a TOML table."""
    values = {f.name: getattr(record, f.name) for f in dataclasses.fields(record)}
    return [f"{name} = {_toml_value(v)}" for name, v in values.items() if name not in skip]


def _toml_value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml_value(v) for v in value) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


def read_bench(truth: Path) -> Bench:
    """The bench that a synthetic campaign was made on, from its truth file.

    Raises:
        BadInput: no such file, or one that does not describe a bench.
    """
    top = Section(truth, "", read_toml(truth))
    bench, modes = top.sub("bench", field_names(Bench)), top.sub("modes", field_names(TwoModes))
    values = {name: bench.required(name) for name in field_names(Bench) if name != "modes"}
    try:
        values["pairs_hz"] = tuple((float(low), float(high)) for low, high in values["pairs_hz"])
        low, high = values["floor_v"]
        values["floor_v"] = (float(low), float(high))
        return Bench(
            modes=TwoModes(**{n: modes.required(n) for n in field_names(TwoModes)}), **values
        )
    except (TypeError, ValueError) as error:
        raise BadInput(f"{truth}: does not describe a virtual laboratory: {error}") from error


def field_names(record: type[DataclassInstance]) -> tuple[str, ...]:
    """Names of a record's fields."""
    return tuple(f.name for f in dataclasses.fields(record))


def mhz(frequency_hz: float) -> float:
    """A frequency in MHz."""
    return float(frequency_hz) / 1e6
