"""What the virtual laboratory has measured -> the files of a campaign with its truth, as texts.

Nothing here touches the disk: texts by file name come out. The campaigns of samples are in
`campaigns/`, with numbers of an example in place of what is measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from importlib import resources
from typing import TYPE_CHECKING, Any

from fitting.lab.bench import DRIFTING, OUTPUTS, Cell, Measured
from fitting.lab.benches import PUBLISHED_BEND_HZ
from fitting.lab.duffing import CubicModes
from fitting.lab.instruments import Markers, put_offsets
from fitting.lab.names import TRUTH_NAME
from fitting.lines.form import LineFit, fit_resonance
from fitting.text.arrays import FloatArray
from fitting.text.records import to_plain
from fitting.text.tables import csv_text as rows_text
from fitting.text.toml import Tables, put, rewritten, toml_text

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

CAMPAIGN_NAME = "campaign.toml"
REMARK = "The truth behind this campaign. No reader of a fit opens this file."
#: Fields of a bench with a table of their own.
ELSEWHERE = ("sample", "instrument", "levels", "weak_level")
#: Columns of a file by header.
Columns = Mapping[str, FloatArray | Sequence[Cell]]


# --- any synthetic campaign


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


def synthetic_files(
    campaign: str, data: Mapping[str, Columns], truth: Mapping[str, Any], head: Sequence[str]
) -> dict[str, str]:
    """Texts by file name: the campaign, files of data, the truth.

    Args:
        campaign: text of the campaign.
        data: columns by header, by file name.
        truth: tables of truth.toml.
        head: lines that open every file, without comment signs.
    """
    texts = {name: csv_text(columns, head) for name, columns in data.items()}
    return {CAMPAIGN_NAME: campaign, **texts, TRUTH_NAME: toml_text(truth, [*head, REMARK])}


def sample_campaign(name: str, edit: Callable[[Tables], None], head: Sequence[str]) -> str:
    """A campaign of `campaigns/`, edited.

    Args:
        name: of the file, without its end.
        edit: puts what is measured in place of the example.
        head: lines that open it, without comment signs.
    """
    file = resources.files("fitting.lab") / "campaigns" / f"{name}.toml"
    return rewritten(file.read_text(encoding="utf-8"), edit, head)


def csv_text(columns: Columns, head: Sequence[str]) -> str:
    """Columns by header as delimited text, numbers with all their digits: 17 lose nothing.

    Args:
        columns: by their heads.
        head: lines that go before, without comment signs.
    """
    lines = "".join(f"# {line}\n" for line in head)
    rows = (
        [cell if isinstance(cell, str) else repr(float(cell)) for cell in row]
        for row in zip(*columns.values(), strict=True)
    )
    return lines + rows_text([columns, *rows])


def record_table(record: DataclassInstance, skip: Sequence[str] = ()) -> dict[str, Any]:
    """A record's fields as a table of TOML.

    Args:
        record: a frozen record.
        skip: names of fields that are left out.
    """
    names = [field.name for field in fields(record) if field.name not in skip]
    table: dict[str, Any] = to_plain({name: getattr(record, name) for name in names})
    return table


def written_mhz(frequency_hz: float) -> str:
    """A frequency as a campaign writes it.

    Args:
        frequency_hz: frequency, Hz.
    """
    return f"{frequency_hz / 1e6!r} MHz"


# --- a series of drive pairs


def campaign_files(series: Measured, command: str) -> dict[str, str]:
    """Texts by relative file name: campaign, experiments, sweep, the instrument's own, the truth.

    ``command`` is repeated in the head of every file, after the word "synthetic" and the seed.

    Args:
        series: the measured series.
        command: command line that made it, for the record.
    """
    bench, instrument, head = series.bench, series.instrument, head_lines(series.seed, command)
    # the line of the sweep, as a laboratory fits it: too much noise hides it, and a drift moves it
    # out of the sweep, and both are reported
    numbers = ("noise_scale", "drift_hz", "curvature_hz")
    given = ", ".join(f"{name} = {getattr(bench, name):g}" for name in numbers)
    u_hz, amplitude_v = series.sweep.frequency_hz, series.sweep.amplitude_v
    line = fit_resonance(u_hz, amplitude_v, source=f"synthesize: the sweep with {given}")
    cubic = isinstance(bench.sample, CubicModes)

    def edit(tables: Tables) -> None:
        (_edit_duffing if cubic else _edit_string)(tables, series, line)
        instrument.edit(tables)
        if bench.series in PUBLISHED_BEND_HZ:  # as the paper has it
            tables["experiments"]["noise_floor"] = "mean"

    rows: list[dict[str, Cell]] = []
    for reading in series.readings:
        drive = reading.drive
        row: dict[str, Cell] = {"experiment": reading.label}
        row |= {f"u{k} (MHz)": f / 1e6 for k, f in enumerate(drive.tones_hz, 1)}
        if bench.levels:
            row |= {f"A{k} (m/s2)": a for k, a in enumerate(drive.amplitudes, 1)}
        rows.append(row | instrument.columns(reading))
    data: dict[str, Columns] = {
        "experiments.csv": {name: [row[name] for row in rows] for name in rows[0]},
        "sweep.csv": {"frequency (MHz)": u_hz / 1e6, "amplitude (uV)": amplitude_v * 1e6},
    }
    for reading in series.readings:
        data.update(instrument.files(reading))
    campaign = sample_campaign("duffing" if cubic else "string", edit, head)
    return synthetic_files(campaign, data, truth_tables(series), head)


def truth_tables(measured: Measured) -> dict[str, Any]:
    """Everything that was put in; [bench], [modes], [cubic] and [drive] make the bench again.

    Args:
        measured: what the laboratory measured.
    """
    bench = measured.bench
    widths = bench.modes.widths_hz()
    tables = {"bench": record_table(bench, ELSEWHERE), "modes": record_table(bench.modes)}
    if isinstance(bench.sample, CubicModes):
        tables["cubic"] = record_table(bench.sample, ["modes"])
    if bench.levels:
        drive: dict[str, Any] = {"weak_level": bench.weak_level}
        if isinstance(bench.instrument, Markers):
            drive["repeatability"] = bench.instrument.repeatability
        tables["drive"] = drive | to_plain(
            {"levels": bench.levels, "lines": bench.instrument.lines}
        )
    tables["outcome"] = {
        "seed": measured.seed,
        "gain_v": measured.gain,
        "width_plus_hz": widths[0],
        "width_minus_hz": widths[1],
    }
    rows = zip(measured.answers, measured.true_modes, measured.true_peaks_v, strict=True)
    experiments = [
        {
            "label": answer.label,
            "eta_plus_hz": modes.eta_plus_hz,
            "eta_minus_hz": modes.eta_minus_hz,
            "peaks_v": peaks.tolist(),
        }
        for answer, modes, peaks in rows
    ]
    return {**tables, "experiment": experiments}


def _edit_string(tables: Tables, series: Measured, line: LineFit) -> None:
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
    if bench.series in PUBLISHED_BEND_HZ:
        # as the paper has it: simulated from rest; both dampings start at the width in Hz over
        # 2 pi, from one start; the drift stays a straight line, although it bends
        del tables["fmu"]["start"], tables["observe"]["steady_start"]
        remark = "2 ms after rest, 30 ms, every 1 us; the sweep's largest point"
        put(tables["accuracy"], "as_published", True, remark)
        start = round(line.width.value / (2.0 * math.pi), 3)
        for damping in tables["parameters"][1:]:
            put(
                damping, "start", start, f"the sweep's width of {line.width.value:.2f} Hz over 2 pi"
            )
            damping["reference"] = start
        tables["continuation"]["starts"] = 1
        return
    if bench.curvature_hz:  # whoever has seen it bend does not interpolate
        put_offsets(tables)
    damping = tables["parameters"][1 + bench.observed]
    width = round(line.width.value, 3)
    put(damping, "start", width, f"width of the sweep, +- {line.width.std:.2g} Hz")
    damping["reference"] = width


def _edit_duffing(tables: Tables, series: Measured, line: LineFit) -> None:
    """Line width and eigenfrequency start at those of the weak sweep."""

    def one_digit(value: float) -> float:
        return float(f"{value:.0e}")

    bench = series.bench
    tables["fmu"]["start"]["eta_minus"] = written_mhz(bench.modes.eta_minus_hz)
    tables["drive"]["level"] = f"{bench.weak_level!r} m/s2"
    width, eta = round(line.width.value, 3), round(line.frequency.value, 3)
    # bounds of the cubic coefficient: the strongest tone shifts the frequency by a line width. On
    # resonance a = A/(4 pi^2 eta w); its eigenfrequency is 3 alpha a^2/(32 pi^2 eta) higher
    amplitude = max(bench.levels) / (4.0 * math.pi**2 * eta * width)
    alpha = one_digit(width * 32.0 * math.pi**2 * eta / (3.0 * amplitude**2))
    bounds = (
        (one_digit(0.5 * width), one_digit(2.0 * width), one_digit(0.1 * width)),
        (round(eta - width), round(eta + width), one_digit(0.1 * width)),
        (-alpha, alpha, one_digit(alpha / 3.0)),
    )
    for parameter, numbers in zip(tables["parameters"], bounds, strict=True):
        parameter["lower"], parameter["upper"], parameter["scale"] = numbers
    put(tables["parameters"][0], "start", width, f"of the sweep, +- {line.width.std:.2g} Hz")
    put(tables["parameters"][1], "start", eta, f"of the sweep, +- {line.frequency.std:.2g} Hz")
