"""The tables of a report, from the records: cells in words, numbers with their exact value."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from fitting.fit.result import (
    IDENTIFIABLE,
    AlternativeResult,
    HistoryRow,
    Peak,
    Result,
    SweepLine,
)
from fitting.report.shown import ShownCampaign
from fitting.report.words.values import settings_words
from fitting.text.notation import (
    markup,
    number,
    on_log_axis,
    percent,
    prefixed,
    span,
    unit_text,
    with_error,
)


@dataclass(frozen=True)
class Cell:
    """One cell: `text` as shown (`html` if it is markup), `value` the exact number behind it.

    `head` marks a cell that names its row; `mark` is a style class.
    """

    text: str
    value: float | None = None
    html: bool = False
    head: bool = False
    mark: str = ""


@dataclass(frozen=True)
class Table:
    """A table: what it shows, the heads of its columns, rows of as many cells, a remark."""

    caption: str
    heads: tuple[Cell, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.heads):
                raise ValueError(f"{self.caption}: {len(row)} cells under {len(self.heads)} heads")


def _number(value: float, digits: int = 8, factor: float = 1.0) -> Cell:
    """A number drawn in units of `factor`, the exact value kept in its own unit."""
    exact = value if math.isfinite(value) else None
    return Cell(number(value / factor, digits), exact)


def _nu(value: float) -> Cell:
    return _number(value) if math.isnan(value) else Cell(on_log_axis(value), value)


def _name(name: str) -> Cell:
    return Cell(markup(name), html=True, head=True)


def _heads(*texts: str | Cell) -> tuple[Cell, ...]:
    return tuple(text if isinstance(text, Cell) else Cell(text) for text in texts)


def _quantity(name: str, unit: str, before: str = "") -> Cell:
    """Head of a column: a symbol with its unit."""
    shown = f" ({html.escape(unit_text(unit))})" if unit_text(unit) else ""
    return Cell(f"{before}{markup(name)}{shown}", html=True)


def _verdict(identifiable: str) -> Cell:
    marks = dict(zip(IDENTIFIABLE, ("yes", "partly", "no"), strict=True))
    return Cell(identifiable, mark=marks.get(identifiable, ""))


def _interval(bounds: tuple[float, float]) -> Cell:
    return Cell(span(*bounds)) if all(map(math.isfinite, bounds)) else Cell("–")


def parameter_table(result: Result) -> Table:
    """Fitted parameters with unit, error, interval, prior, and what the data say of them."""
    rows = tuple(
        (
            _name(name),
            _number(p.value),
            Cell(unit_text(p.unit)),
            _number(p.std, 2),
            _interval(p.ci95),
            _number(p.reference),
            _number(p.start),
            Cell(f"{number(p.lower)} to {number(p.upper)}"),
            _number(p.shrinkage, 3),
            _verdict(p.identifiable),
        )
        for name, p in result.parameters.items()
    )
    heads = _heads(
        "parameter",
        "value",
        "unit",
        "std",
        "95 % interval",
        "reference",
        "start",
        "box",
        "shrinkage",
        "by the data",
    )
    return Table(
        "Fitted parameters",
        heads,
        rows,
        "std holds for data, box and Tikhonov term together, linearised at the solution, and so "
        "does the interval where no profiles were walked. Shrinkage is the share of the variance "
        "that the data answer for: 0, the prior spoke; 1, the data spoke.",
    )


def correlation_table(result: Result) -> Table | None:
    """Correlations of the parameters' errors; None for a single parameter."""
    names = list(result.parameters)
    if len(names) < 2 or len(result.correlation) != len(names):
        return None
    rows = tuple(
        (_name(name), *(_number(value, 3) for value in line))
        for name, line in zip(names, result.correlation, strict=True)
    )
    heads = (Cell("correlation"), *(Cell(markup(name), html=True) for name in names))
    return Table("Correlations of the errors", heads, rows)


def derived_table(result: Result) -> Table:
    """Derived outputs: mean, spread over the experiments, error, prior, what the data say."""
    rows = []
    for name, d in result.derived.items():
        known = d.identifiable != IDENTIFIABLE[2]  # a small error would be a lie otherwise
        rows.append(
            (
                _name(name),
                _number(d.mean, 9),
                Cell(unit_text(d.unit)),
                _number(d.spread, 2),
                _number(d.std, 2) if known else Cell("–"),
                _interval(d.ci95) if known else Cell("–"),
                _number(d.reference, 9),
                _interval(d.box),
                _number(d.shrinkage, 3),
                _verdict(d.identifiable),
            )
        )
    heads = _heads(
        "output",
        "mean",
        "unit",
        "spread",
        "std",
        "95 % interval",
        "at the reference",
        "range over the box",
        "shrinkage",
        "by the data",
    )
    return Table(
        "Derived outputs",
        heads,
        tuple(rows),
        "Spread is the standard deviation over the experiments (drift), std the uncertainty of the "
        "mean. Where the data do not determine a value, no error is given: the range over the box "
        "of the parameters says what it could be.",
    )


def per_experiment_table(result: Result, data: ShownCampaign) -> Table | None:
    """Derived outputs of each experiment; None without experiments or outputs."""
    labels = list(data.labels)
    outputs = {n: d for n, d in result.derived.items() if len(d.values) == len(labels)}
    if not labels or not outputs:
        return None
    rows = [
        (Cell(label, head=True), *(_number(d.values[i], 10) for d in outputs.values()))
        for i, label in enumerate(labels)
    ]
    rows.append((Cell("mean", head=True), *(_number(d.mean, 10) for d in outputs.values())))
    rows.append((Cell("spread", head=True), *(_number(d.spread, 3) for d in outputs.values())))
    heads = (Cell("experiment"), *(_quantity(n, d.unit) for n, d in outputs.items()))
    return Table("Derived outputs per experiment", heads, tuple(rows))


def deviation_table(result: Result, data: ShownCampaign) -> Table | None:
    """Every peak: measured, simulated before and after, deviations; None without peaks."""
    if not result.peaks:
        return None
    along, hertz = prefixed(max(p.frequency_hz for p in result.peaks), "Hz")
    up, volts = prefixed(max(p.measured_v for p in result.peaks), data.unit)
    before, after = result.deviations.initial.per_peak, result.deviations.final.per_peak
    rows = tuple(
        _peak_row(peak, first, last, along, up)
        for peak, first, last in zip(result.peaks, before, after, strict=True)
    )
    heads = _heads(
        "experiment",
        f"tone ({hertz})",
        f"measured z* ({volts})",
        f"σ ({volts})",
        f"simulated before ({volts})",
        f"simulated after ({volts})",
        "deviation before",
        "deviation after",
        "after / before (%)",
        "residual after (σ)",
    )
    return Table("Peaks: measured and simulated amplitudes, relative deviations", heads, rows)


def _peak_row(peak: Peak, first: float, last: float, along: float, up: float) -> tuple[Cell, ...]:
    ratio = 100.0 * last / first if first > 0.0 else math.nan
    sigmas = (peak.final_v - peak.measured_v) / peak.sigma_v if peak.sigma_v > 0.0 else math.nan
    return (
        Cell(peak.experiment, head=True),
        _number(peak.frequency_hz, 10, along),
        _number(peak.measured_v, 5, up),
        _number(peak.sigma_v, 2, up),
        _number(peak.initial_v, 5, up),
        _number(peak.final_v, 5, up),
        _number(first, 3),
        _number(last, 3),
        _number(ratio, 3),
        _number(sigmas, 3),
    )


def mean_deviation_table(result: Result, data: ShownCampaign) -> Table:
    """Mean deviations per experiment and overall, before and after."""
    first, last = result.deviations.initial, result.deviations.final
    labels = list(data.labels) or ["sweep"]
    lines = [*zip(labels, first.per_experiment, last.per_experiment, strict=False)]
    if len(lines) > 1:
        lines.append(("all", first.mean, last.mean))
    rows = tuple(
        (
            Cell(label, head=True),
            _number(a, 4),
            _number(b, 4),
            _number(100.0 * b / a if a > 0.0 else math.nan, 3),
        )
        for label, a, b in lines
    )
    heads = _heads("experiment", "before", "after", "after / before (%)")
    return Table("Mean relative deviation", heads, rows)


def line_table(line: SweepLine) -> Table | None:
    """The resonance of the sweep by itself beside the instrument's own estimate."""
    if math.isnan(line.frequency_hz):
        return None
    factor, unit = prefixed(abs(line.amplitude), line.unit)
    lines = (
        ("eigenfrequency", line.frequency_hz, line.frequency_std_hz, "Hz", "frequency_hz"),
        ("full width", line.width_hz, line.width_std_hz, "Hz", "width_hz"),
        ("Q", line.q, line.q_std, "", "q"),
        ("amplitude", line.amplitude / factor, line.amplitude_std / factor, unit, ""),
    )
    rows = []
    for what, value, std, unit_name, key in lines:
        there = line.instrument.get(key, math.nan)
        rows.append(
            (
                Cell(what, head=True),
                Cell(with_error(value, std, unit_name), value),
                _number(there, 9),
                _number(there - value, 3),
                Cell(percent(there / value - 1.0, 3) if math.isfinite(there) else "–"),
            )
        )
    title = "Resonance fitted to the sweep alone, without the FMU"
    heads = _heads("of the sweep by itself", "this fit", "instrument", "difference", "relative")
    note = (
        f"Background: {line.background}. Residual {100.0 * line.residual:.2g} % of the peak (rms)."
    )
    if not line.instrument:  # the file's head says nothing of it
        return Table(title, heads[:2], tuple(row[:2] for row in rows), note)
    return Table(title, heads, tuple(rows), note)


def history_table(result: Result) -> Table:
    """A row per level of nu of the reported chain."""
    parameters = {name: p.unit for name, p in result.parameters.items()}
    outputs = {name: d.unit for name, d in result.derived.items()}

    def line(row: HistoryRow) -> tuple[Cell, ...]:
        return (
            Cell("start" if row.level < 0 else str(row.level), head=True),
            _nu(row.nu),
            *(_number(row.parameters[name]) for name in parameters),
            *(_number(row.derived.get(name, math.nan)) for name in outputs),
            _number(row.j_fit, 6),
            _number(row.j_reg, 3),
            _number(row.change, 3),
            _number(row.optimality, 2),
            Cell(row.status),
            Cell(str(row.evaluations)),
            Cell(f"{row.seconds:.1f}"),
        )

    heads = (
        *_heads("level", "ν"),
        *(_quantity(n, u) for n, u in parameters.items()),
        *(_quantity(n, u, "mean ") for n, u in outputs.items()),
        *_heads("J_fit", "J_reg", "E", "optimality", "status", "evaluations", "s"),
    )
    return Table(
        "Levels of the regularisation, reported chain",
        heads,
        tuple(map(line, result.history)),
        "E is the paper's stopping measure, optimality the decrease of J that a linearised step "
        "still promises.",
    )


def ending_table(result: Result) -> Table:
    """How the levels ended, those with the same words together."""
    groups: dict[tuple[str, str], list[str]] = {}
    for row in result.history:
        if row.level >= 0:
            groups.setdefault((row.status, row.message), []).append(str(row.level))
    rows = tuple(
        (Cell(", ".join(levels), head=True), Cell(status), Cell(message, mark="words"))
        for (status, message), levels in groups.items()
    )
    return Table("How the levels ended", _heads("level", "status", "message"), rows)


def alternative_table(result: Result) -> Table:
    """Every discrete alternative with where it ended."""
    names = list(result.parameters)
    rows = tuple(
        (
            Cell(settings_words(a.settings) or "the only one", head=True),
            *(_number(a.parameters[name]) for name in names),
            _number(a.j_fit, 8),
            _number(a.j_reg, 3),
            Cell(a.status),
            Cell(_rank(a)),
        )
        for a in result.alternatives
    )
    units = [result.parameters[name].unit for name in names]
    heads = (
        Cell("alternative"),
        *(_quantity(n, u) for n, u in zip(names, units, strict=True)),
        *_heads("J_fit", "J_reg", "status", "verdict"),
    )
    return Table("Discrete alternatives", heads, rows)


def _rank(alternative: AlternativeResult) -> str:
    if alternative.reported:
        return "reported"
    return "equal to the reported one" if alternative.equal_to_best else "worse"


def start_table(result: Result) -> Table:
    """Every start of every alternative: where it began and where it led."""
    names = list(result.parameters)
    rows = tuple(
        (
            Cell(settings_words(a.settings) or "the only one", head=True),
            Cell(str(k + 1)),
            Cell(_values(start.begun, names), html=True),
            Cell(_values(start.parameters, names), html=True),
            _number(start.j_fit, 8),
            Cell(str(start.levels)),
            Cell(start.ended, mark="words"),
        )
        for a in result.alternatives
        for k, start in enumerate(a.starts)
    )
    heads = _heads("alternative", "start", "from", "to", "J_fit", "levels", "end")
    return Table("Starts of the search", heads, rows)


def _values(values: Mapping[str, float], names: Iterable[str]) -> str:
    return ", ".join(f"{markup(name)} = {number(values[name], 6)}" for name in names)


def pairs_table(caption: str, heads: Sequence[str], pairs: Mapping[str, str]) -> Table:
    """Names and what belongs to them."""
    rows = tuple((Cell(name, head=True), Cell(text, mark="words")) for name, text in pairs.items())
    return Table(caption, _heads(*heads), rows)
