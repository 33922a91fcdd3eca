"""The truth behind a synthetic campaign: the file next to it, written and read.

No reader of a fit opens it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitting.lab.bench import Bench, Measured
from fitting.lab.duffing import Cubic, CubicModes
from fitting.lab.instruments.analyser import Analyser
from fitting.lab.instruments.markers import Markers
from fitting.lab.string import TwoModes
from fitting.text.errors import BadInput
from fitting.text.toml import read_toml, toml_text

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

REMARK = "The truth behind this campaign. No reader of a fit opens this file."
#: Fields of a bench with a table of their own.
ELSEWHERE = ("sample", "instrument", "levels", "weak_level")


def truth_tables(measured: Measured) -> dict[str, Any]:
    """Everything that was put in; [bench], [modes], [cubic] and [drive] make the bench again.

    Args:
        measured: what the laboratory measured.
    """
    bench = measured.bench
    widths = bench.modes.widths_hz()
    tables: dict[str, Any] = {"bench": plain(bench, ELSEWHERE), "modes": plain(bench.modes)}
    if isinstance(bench.sample, CubicModes):
        tables["cubic"] = plain(bench.sample.cubic)
    if bench.levels:
        tables["drive"] = {"weak_level": bench.weak_level}
        if isinstance(bench.instrument, Markers):
            tables["drive"]["repeatability"] = bench.instrument.repeatability
        tables["drive"] |= {"levels": list(bench.levels), "lines": _lists(bench.instrument.lines)}
    tables["outcome"] = {
        "seed": measured.seed,
        "gain_v": measured.gain,
        "width_plus_hz": widths[0],
        "width_minus_hz": widths[1],
    }
    rows = zip(measured.answers, measured.true_modes, measured.true_peaks_v, strict=True)
    tables["experiment"] = [
        {
            "label": answer.label,
            "eta_plus_hz": modes.eta_plus_hz,
            "eta_minus_hz": modes.eta_minus_hz,
            "peaks_v": peaks.tolist(),
        }
        for answer, modes, peaks in rows
    ]
    return tables


def truth_toml(measured: Measured, head: Sequence[str]) -> str:
    """`truth_tables` as text.

    Args:
        measured: what the laboratory measured.
        head: lines that go before, without comment signs.
    """
    return toml_text(truth_tables(measured), [*head, REMARK])


def read_bench(truth: Path) -> Bench:
    """The bench that a synthetic campaign was made on, from its truth file.

    Args:
        truth: file that holds the truth.

    Raises:
        BadInput: no such file, or one that does not describe a bench.
    """
    tables = read_toml(truth)
    names = tuple(name for name in _names(Bench) if name not in ELSEWHERE)
    bench = values_of(tables, "bench", names, truth)
    modes = values_of(tables, "modes", _names(TwoModes), truth)
    cubic, drive = None, {}
    if "cubic" in tables:
        cubic = values_of(tables, "cubic", _names(Cubic), truth)
        drive = values_of(tables, "drive", ("weak_level", "repeatability", "levels"), truth)
    try:
        bench["pairs_hz"] = tuple((float(low), float(high)) for low, high in bench["pairs_hz"])
        low, high = bench["floor_v"]
        bench["floor_v"] = (float(low), float(high))
        linear = TwoModes(**modes)
        if cubic is None:
            return Bench(sample=linear, instrument=Analyser(), **bench)
        return Bench(
            sample=CubicModes(linear, Cubic(**{n: float(v) for n, v in cubic.items()})),
            instrument=Markers(float(drive["repeatability"])),
            levels=tuple(float(level) for level in drive["levels"]),
            weak_level=float(drive["weak_level"]),
            **bench,
        )
    except BadInput:
        raise
    except (TypeError, ValueError) as error:
        raise BadInput(f"{truth}: does not describe a virtual laboratory: {error}") from error


def values_of(
    tables: Mapping[str, Any], table: str, names: Sequence[str], truth: Path
) -> dict[str, Any]:
    """The values of a table by these names, all of which must be there.

    Args:
        tables: of the file.
        table: name of the table.
        names: of its keys.
        truth: path of the file, for complaints.

    Raises:
        BadInput: one is missing.
    """
    values = tables.get(table, {})
    for name in names:
        if not isinstance(values, Mapping) or name not in values:
            raise BadInput(f"{truth}: [{table}]: key '{name}' is missing")
    return {name: values[name] for name in names}


def plain(record: DataclassInstance, skip: Sequence[str] = ()) -> dict[str, Any]:
    """A record's fields as TOML has them.

    Args:
        record: a frozen record.
        skip: names of fields that are left out.
    """
    values = {name: getattr(record, name) for name in _names(type(record)) if name not in skip}
    return {name: _lists(value) for name, value in values.items()}


def _lists(value: Any) -> Any:
    return [_lists(item) for item in value] if isinstance(value, tuple) else value


def _names(record: type[DataclassInstance]) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(record))
