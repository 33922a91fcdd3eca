"""A measured series of the virtual laboratory -> the files of a campaign.

Nothing here touches the disk: texts by file name come out. The campaigns of the samples are in
`campaigns/`, with numbers of an example in place of what is measured.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from importlib import resources

from fitting.lab.bench import DRIFTING, OUTPUTS, Bench, Cell, Measured, Series
from fitting.lab.benches import PUBLISHED_BEND_HZ
from fitting.lab.duffing import CubicModes
from fitting.lab.names import TRUTH_NAME
from fitting.lab.truth import truth_toml
from fitting.lines.form import LineFit, fit_resonance
from fitting.text import csv_cells
from fitting.text.arrays import FloatArray
from fitting.text.toml import Tables, inline, put, rewritten

CAMPAIGN_NAME = "campaign.toml"
EXPERIMENTS_NAME = "experiments.csv"
SWEEP_NAME = "sweep.csv"
#: What an eigenfrequency may depart from its interpolated drift by, one standard deviation.
BENT = "30 Hz"


def campaign_files(series: Series, command: str) -> dict[str, str]:
    """Texts by relative file name: campaign, experiments, sweep, the instrument's own, the truth.

    ``command`` is repeated in the head of every file, after the word "synthetic" and the seed. The
    numbers are written with 17 digits: reading them back loses nothing.

    Args:
        series: the measured series.
        command: command line that made it, for the record.
    """
    head = head_of(series, command)
    sweep = {
        "frequency (MHz)": series.sweep.frequency_hz / 1e6,
        "amplitude (uV)": series.sweep.amplitude_v * 1e6,
    }
    files = {
        CAMPAIGN_NAME: _campaign(series, head),
        EXPERIMENTS_NAME: _experiments(series, head),
        SWEEP_NAME: csv_text(sweep, head),
    }
    for reading in series.readings:
        for name, columns in series.instrument.files(reading).items():
            files[name] = csv_text(columns, head)
    files[TRUTH_NAME] = truth_toml(series, head)
    return files


def head_of(measured: Measured, command: str) -> tuple[str, ...]:
    """The first lines of every file.

    Args:
        measured: what the laboratory measured.
        command: command line that made it, for the record.
    """
    return head_lines(measured.seed, command)


def head_lines(seed: int, command: str) -> tuple[str, ...]:
    """The first lines of every synthetic file.

    Args:
        seed: of its noise.
        command: command line that made it, for the record.
    """
    return (
        f"synthetic data of a virtual laboratory, not measured; seed {seed}",
        f"made by: {command}",
    )


def csv_text(columns: Mapping[str, FloatArray | Sequence[Cell]], head: Sequence[str]) -> str:
    """Columns by header as delimited text, numbers with all their digits.

    Args:
        columns: by their heads.
        head: lines that go before, without comment signs.
    """
    lines = "".join(f"# {line}\n" for line in head)
    rows = (map(_cell, row) for row in zip(*columns.values(), strict=True))
    return lines + csv_cells.csv_text([columns, *rows])


def written_mhz(frequency_hz: float) -> str:
    """A frequency as a campaign writes it.

    Args:
        frequency_hz: frequency, Hz.
    """
    return f"{frequency_hz / 1e6!r} MHz"


def _cell(value: Cell) -> str:
    return value if isinstance(value, str) else repr(float(value))


def _experiments(series: Series, head: Sequence[str]) -> str:
    rows: list[dict[str, Cell]] = []
    for reading in series.readings:
        drive = reading.drive
        row: dict[str, Cell] = {"experiment": reading.label}
        row |= {f"u{k} (MHz)": f / 1e6 for k, f in enumerate(drive.tones_hz, 1)}
        if series.bench.levels:
            row |= {f"A{k} (m/s2)": a for k, a in enumerate(drive.amplitudes, 1)}
        rows.append(row | series.instrument.columns(reading))
    return csv_text({name: [row[name] for row in rows] for name in rows[0]}, head)


def _campaign(series: Series, head: Sequence[str]) -> str:
    """The campaign of the sample, filled in, and read as the instrument wants it."""
    cubic = isinstance(series.bench.sample, CubicModes)
    name, fill = ("duffing.toml", _cubic) if cubic else ("string.toml", _linear)
    text = (resources.files("fitting.lab") / "campaigns" / name).read_text(encoding="utf-8")

    def edit(tables: Tables) -> None:
        fill(tables, series)
        series.instrument.edit(tables)

    return rewritten(text, edit, head)


def _line(series: Series) -> LineFit:
    """The line of the sweep, as a laboratory would fit it.

    Too much noise hides it, and a drift moves it out of the sweep: both are reported.
    """
    given = ", ".join(
        f"{name} = {getattr(series.bench, name):g}"
        for name in ("noise_scale", "drift_hz", "curvature_hz")
    )
    return fit_resonance(
        series.sweep.frequency_hz,
        series.sweep.amplitude_v,
        source=f"synthesize: the sweep with {given}",
    )


def _linear(tables: Tables, series: Series) -> None:
    """Drift as measured; the observed damping starts at the width fitted to the sweep."""
    bench = series.bench
    name, _, published = bench.series.partition("-")
    as_published = " as published" if published else ""
    tables["title"] = f"String, {name} series{as_published} (synthetic)"
    tables["observe"]["output"] = OUTPUTS[bench.observed]
    ends = zip(DRIFTING, series.eta_before_hz, series.eta_after_hz, strict=True)
    for name, before, after in ends:
        tables["drift"][name]["before"] = written_mhz(before)
        tables["drift"][name]["after"] = written_mhz(after)
        tables["sweep"]["set"][name] = written_mhz(before)
    fit = _line(series)
    if bench.series in PUBLISHED_BEND_HZ:
        _start_as_published(tables, fit)
        return
    if bench.curvature_hz:  # whoever has seen it bend does not interpolate
        between = {name: inline(tables["drift"][name]) for name in DRIFTING}
        drift = {"model": "offsets", "prior": BENT, **between}
        put(tables, "drift", drift, "one offset per drive pair besides the linear drift")
    damping = tables["parameters"][1 + bench.observed]
    width = round(fit.width.value, 3)
    put(damping, "start", width, f"width of the sweep, +- {fit.width.std:.2g} Hz")
    damping["reference"] = width


def _start_as_published(tables: Tables, fit: LineFit) -> None:
    """Both dampings start at the width in Hz over 2 pi, as the paper's text has it; one start.

    The drift stays a straight line, as the paper interpolates it, although it bends.
    """
    start = round(fit.width.value / (2.0 * math.pi), 3)
    for damping in tables["parameters"][1:]:
        put(damping, "start", start, f"the sweep's width of {fit.width.value:.2f} Hz over 2 pi")
        damping["reference"] = start
    tables["continuation"]["starts"] = 1


def _cubic(tables: Tables, series: Series) -> None:
    """Line width and eigenfrequency start at those of the weak sweep."""
    bench = series.bench
    tables["fmu"]["start"]["eta_minus"] = written_mhz(bench.modes.eta_minus_hz)
    tables["drive"]["level"] = f"{bench.weak_level!r} m/s2"
    fit = _line(series)
    width, eta = round(fit.width.value, 3), round(fit.frequency.value, 3)
    alpha = _one_digit(_alpha_of_a_width(width, eta, bench))
    boxes = (
        (_one_digit(0.5 * width), _one_digit(2.0 * width), _one_digit(0.1 * width)),
        (round(eta - width), round(eta + width), _one_digit(0.1 * width)),
        (-alpha, alpha, _one_digit(alpha / 3.0)),
    )
    for parameter, box in zip(tables["parameters"], boxes, strict=True):
        parameter["lower"], parameter["upper"], parameter["scale"] = box
    put(tables["parameters"][0], "start", width, f"of the sweep, +- {fit.width.std:.2g} Hz")
    put(tables["parameters"][1], "start", eta, f"of the sweep, +- {fit.frequency.std:.2g} Hz")


def _alpha_of_a_width(width_hz: float, eta_hz: float, bench: Bench) -> float:
    """The cubic coefficient at which the strongest tone shifts the frequency by a line width.

    On resonance a = A/(4 pi^2 eta w); its eigenfrequency is 3 alpha a^2/(32 pi^2 eta) higher.
    """
    amplitude = max(bench.levels) / (4.0 * math.pi**2 * eta_hz * width_hz)
    return width_hz * 32.0 * math.pi**2 * eta_hz / (3.0 * amplitude**2)


def _one_digit(value: float) -> float:
    return float(f"{value:.0e}")
