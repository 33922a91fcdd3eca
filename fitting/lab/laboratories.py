"""Laboratories: built in, by name; read back from their truth; with other numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from fitting.lab.bench import Bench, Sample
from fitting.lab.benches import (
    PUBLISHED_BEND_HZ,
    SERIES_THETA,
    duffing_bench,
    string_bench,
    with_level,
)
from fitting.lab.curve import Curve
from fitting.lab.curves import AvoidedCrossing, WiredResonance
from fitting.lab.duffing import CubicModes
from fitting.lab.instruments import Analyser, Markers
from fitting.lab.names import (
    CROSSING,
    CURVES,
    DEMODULATED,
    DUFFING,
    SERIES,
    TIME_SERIES,
    TRUTH_NAME,
    WIRED,
)
from fitting.lab.pumped import PumpedBench, PumpedString
from fitting.lab.string import TwoModes
from fitting.lab.subharmonic import SubharmonicBench
from fitting.lab.time_series import DECAY, LET_GO, StringRecord
from fitting.lab.voltage import VoltageBench
from fitting.lab.writer import ELSEWHERE, record_table
from fitting.text.errors import BadInput, shown
from fitting.text.records import from_plain
from fitting.text.toml import read_toml

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

#: What is measured: a bench, or a curve.
AnyBench = Bench | PumpedString | WiredResonance | AvoidedCrossing | StringRecord
#: What sweeps one line at places of its controls.
SweptBench = AvoidedCrossing | PumpedString
#: Coefficients of cubic terms, by their fields of `CubicModes`.
CUBIC = ("alpha1", "alpha2", "kappa")
PUMPED_BENCHES = {kind.kind: kind for kind in (PumpedBench, SubharmonicBench, VoltageBench)}
B = TypeVar("B", bound=AnyBench)


def bench_of(truth: AnyBench | Path | str) -> AnyBench:
    """A bench or curve as it is, by its name, or by its truth file or the campaign next to that.

    Args:
        truth: a laboratory, or the file that describes one.

    Raises:
        BadInput: no such bench or file, or one that describes no laboratory.
    """
    if isinstance(truth, AnyBench):
        return truth
    path = Path(truth)
    if path.suffix != ".toml":
        return _built_in(str(truth))
    file = path if path.name == TRUTH_NAME else path.parent / TRUTH_NAME
    try:
        return _described(read_toml(file), file)
    except BadInput:
        raise
    except (TypeError, ValueError) as error:
        raise BadInput(f"{file}: does not describe a virtual laboratory: {error}") from error


def _built_in(name: str) -> AnyBench:
    if name in SERIES_THETA:
        return string_bench(name)
    if name in PUBLISHED_BEND_HZ:
        paper = string_bench(name.removesuffix("-published"))
        return replace(paper, series=name, curvature_hz=PUBLISHED_BEND_HZ[name])
    if name == DUFFING:
        return duffing_bench()
    if name in PUMPED_BENCHES:
        return PUMPED_BENCHES[name]()
    if name in WIRED:
        return WiredResonance(kind=name)
    if name == CROSSING:
        return AvoidedCrossing()
    if name in TIME_SERIES:
        return replace(LET_GO, kind=name)
    if name in DEMODULATED:
        return replace(DECAY, kind=name)
    raise BadInput(f"bench {name!r}: wanted one of {', '.join((*SERIES, *CURVES))}")


def _described(tables: Mapping[str, Any], file: Path) -> AnyBench:
    """The laboratory of the tables of a truth file."""

    def values(table: str, names: tuple[str, ...]) -> dict[str, Any]:
        """Of a table by these names, all of which must be there."""
        given = tables.get(table, {})
        for name in names:
            if not isinstance(given, Mapping) or name not in given:
                raise BadInput(f"{file}: [{table}]: key '{name}' is missing")
        return {name: given[name] for name in names}

    def modes() -> TwoModes:
        return from_plain(TwoModes, values("modes", names_of(TwoModes)), f"{file}: [modes]")

    for table in ("curve", "trace"):
        if table in tables:
            kind = values(table, ("kind",))["kind"]
            if kind not in CURVES:
                raise BadInput(
                    f"{file}: [{table}] kind: found {shown(kind)}, wanted one of "
                    f"{', '.join(CURVES)}"
                )
            curve = _built_in(kind)
            # numbers that an earlier version did not write are those that are built in
            given = {name: tables[table][name] for name in names_of(curve) if name in tables[table]}
            return from_plain(type(curve), {**record_table(curve), **given}, f"{file}: [{table}]")
    for name, pumped in PUMPED_BENCHES.items():
        if name in tables:
            own = values(name, tuple(n for n in names_of(pumped) if n not in pumped.ELSEWHERE))
            if "sweeps" in pumped.ELSEWHERE:
                own["sweeps"] = tables.get("sweep")
            return replace(from_plain(pumped, own, f"{file}: [{name}]"), string=modes())
    bench = values("bench", tuple(name for name in names_of(Bench) if name not in ELSEWHERE))
    bench["pairs_hz"] = tuple((float(low), float(high)) for low, high in bench["pairs_hz"])
    low, high = bench["floor_v"]
    bench["floor_v"] = (float(low), float(high))
    if "cubic" not in tables:
        return Bench(sample=modes(), instrument=Analyser(), **bench)
    both = {"modes": record_table(modes()), **values("cubic", CUBIC)}
    drive = values("drive", ("weak_level", "repeatability", "levels"))
    return Bench(
        sample=from_plain(CubicModes, both, f"{file}: [cubic]"),
        instrument=Markers(float(drive["repeatability"])),
        levels=tuple(float(level) for level in drive["levels"]),
        weak_level=float(drive["weak_level"]),
        **bench,
    )


def changed(bench: B, **values: Any) -> B:
    """A bench or curve with other numbers, by the names of fields of its own and of its sample.

    ``level`` of a bench with levels is the strongest drive, m/s²; the others go in proportion.

    Args:
        bench: the laboratory: sample, drives, instrument, noise.
        **values: new values of the fields, by name.

    Raises:
        ValueError: values that are impossible.
        BadInput: a name that this bench does not have.
    """
    modes = names_of(TwoModes)
    known = {name for name in names_of(bench) if name != "kind"}
    if isinstance(bench, Bench | PumpedString):
        known |= {*modes}
    if isinstance(bench, Bench):
        known |= {*CUBIC} if isinstance(bench.sample, CubicModes) else set()
        known |= {"level"} if bench.levels else set()
    for name in values:
        if name not in known and isinstance(bench, Curve):
            wanted = ", ".join(sorted(known))
            raise BadInput(f"{name}: has no meaning for the curve {bench.kind!r}, wanted {wanted}")
        if name not in known:
            raise BadInput(f"{name}: has no meaning for the bench {bench.kind!r}")
    own = {name: value for name, value in values.items() if name in names_of(bench)}
    of_modes = {name: value for name, value in values.items() if name in modes}
    if isinstance(bench, PumpedString):
        own = {"string": replace(bench.string, **of_modes), **own}
    elif isinstance(bench, Bench):
        sample: Sample = replace(bench.modes, **of_modes)
        if isinstance(bench.sample, CubicModes):
            of_cubic = {name: value for name, value in values.items() if name in CUBIC}
            sample = replace(bench.sample, modes=sample.modes, **of_cubic)
        if "level" in values:
            own = {"levels": with_level(bench, values["level"]).levels, **own}
        own = {"sample": sample, **own}
    return replace(bench, **own)


def names_of(record: DataclassInstance | type[DataclassInstance]) -> tuple[str, ...]:
    """Names of a record's fields.

    Args:
        record: or its class.
    """
    return tuple(field.name for field in fields(record))
