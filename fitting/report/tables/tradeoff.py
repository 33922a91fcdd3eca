"""A study of accuracy against cost as tables: CSV of every setting, choices, Pareto fronts."""

from __future__ import annotations

import math

from fitting.lab.names import QUANTITIES, WIDTH_SWEEP
from fitting.lab.tradeoff.front import Choice, choices, pareto
from fitting.lab.tradeoff.records import COHERENT, TOLERANCE, Measurement, Setting, Study
from fitting.report.table import Cell, Column, Table, csv_text, tabulate
from fitting.text.notation import number, prefixed

# -- words ----------------------------------------------------------------------------------------


def words(setting: Setting) -> str:
    """A setting in words.

    Args:
        setting: of the simulation: solver, settling, samples.
    """
    parts = [setting.solver]
    if setting.resolution_kind == TOLERANCE:
        parts.append(f"tolerance {number(setting.resolution, 3)}")
    elif setting.resolution_kind:
        parts.append(f"{number(setting.resolution, 4)} {setting.resolution_kind}")
    if setting.periodic:
        parts.append("periodic start")
    if setting.settle_s:
        parts.append(f"settled {time_text(setting.settle_s)}")
    if setting.quantity != WIDTH_SWEEP:
        window = "whole periods" if setting.reader == COHERENT else f"window {setting.reader}"
        parts.append(f"{setting.samples} samples in {time_text(setting.window_s)}, {window}")
    if setting.sweep_points:
        parts.append(f"{setting.sweep_points} sweep points")
    if setting.iterations:
        parts.append(f"Jacobian step {number(setting.jacobian_step, 2)}")
        parts.append(f"{setting.iterations} iterations")
    return ", ".join(parts)


def time_text(seconds: float) -> str:
    """A time with a prefix, three digits; minutes and hours in s.

    Args:
        seconds: time, s.
    """
    if not math.isfinite(seconds):
        return "–"
    factor, unit = prefixed(seconds, "s") if seconds < 1.0 else (1.0, "s")
    return f"{number(seconds / factor, 3)}\u00a0{unit}"


def error_text(m: Measurement | None) -> str:
    """An error; one that is the reference's own as a bound.

    Args:
        m: error and cost, None where it was not measured.
    """
    return "–" if m is None else f"{'≤ ' if m.bounded else ''}{number(m.error, 2)}"


def cost_text(m: Measurement | None) -> str:
    """A cost; one that was not run is called so.

    Args:
        m: error and cost, None where it was not measured.
    """
    if m is None:
        return "–"
    return time_text(m.cost_s) + (" (extrapolated)" if m.extrapolated else "")


def reference_sentence(study: Study, quantity: str) -> str:
    """What errors of a quantity are measured from.

    Args:
        study: errors and costs of every setting.
        quantity: what is measured of a response.
    """
    for reference in study.references:
        if reference.quantity == quantity:
            return f"Errors from: {reference.source}; its own error {number(reference.error, 2)}."
    return ""


# -- tables ---------------------------------------------------------------------------------------


def csv_of(study: Study) -> str:
    """A row per setting; cells that have no number are empty.

    Args:
        study: errors and costs of every setting.
    """
    fronts = {id(m) for quantity in QUANTITIES for m in pareto(study.of(quantity))}
    columns: tuple[Column[Measurement], ...] = (
        Column("scene", lambda m: study.scene),
        Column("quantity", lambda m: m.setting.quantity),
        Column("solver", lambda m: m.setting.solver),
        Column("resolution_kind", lambda m: m.setting.resolution_kind),
        Column("resolution", lambda m: m.setting.resolution or ""),
        Column("start", lambda m: "periodic" if m.setting.periodic else "rest"),
        Column("settle_s", lambda m: m.setting.settle_s),
        Column("reader", lambda m: m.setting.reader),
        Column("window_s", lambda m: m.setting.window_s),
        Column("samples", lambda m: m.setting.samples),
        Column("sweep_points", lambda m: m.setting.sweep_points or ""),
        Column("jacobian_step", lambda m: m.setting.jacobian_step or ""),
        Column("iterations", lambda m: m.setting.iterations or ""),
        Column("error", lambda m: "" if m.failed else m.error),
        Column("error_is", _error_is),
        Column("seconds", lambda m: m.cost.seconds),
        Column("cpu_s", lambda m: m.cost.cpu_s if math.isfinite(m.cost.cpu_s) else ""),
        Column("repeats", lambda m: m.cost.repeats),
        Column("fmu_runs", lambda m: m.cost.runs),
        Column("do_step", lambda m: m.cost.steps),
        Column("get_real", lambda m: m.cost.reads),
        Column("solver_steps", lambda m: _or_empty(m.cost.solver_steps)),
        Column("cost_is", lambda m: "extrapolated" if m.extrapolated else "measured"),
        Column("planned_for", lambda m: _or_empty(m.planned_for)),
        Column("on_front", lambda m: "yes" if id(m) in fronts else ""),
        Column("note", lambda m: m.note),
    )
    order = QUANTITIES.index
    rows = sorted(study.measurements, key=lambda m: (order(m.setting.quantity), m.cost_s))
    return csv_text(tabulate("", columns, rows))


def _error_is(m: Measurement) -> str:
    return "failed" if m.failed else ("at most" if m.bounded else "measured")


def _or_empty(value: float | None) -> float | str:
    return "" if value is None else value


#: What is said where no setting has the accuracy, and where there is no plan's.
ALL_TRIED, SO_FAR = ("not reached", "no promise"), ("not yet", "none so far")
FRONT: tuple[Column[Measurement], ...] = (
    Column("error", error_text),
    Column("cost", cost_text),
    Column("wall time", lambda m: time_text(m.cost.seconds)),
    Column("FMU runs", lambda m: str(m.cost.runs)),
    Column("doStep", lambda m: str(m.cost.steps)),
    Column("getReal", lambda m: str(m.cost.reads)),
    Column("settings", lambda m: words(m.setting), role="words"),
)


def _choice_columns(unreached: str) -> tuple[Column[Choice], ...]:
    return (
        Column("accuracy", lambda c: number(c.accuracy, 2), role="name"),
        Column(
            "cheapest settings",
            lambda c: words(c.cheapest.setting) if c.cheapest else unreached,
            role="words",
        ),
        Column("error", lambda c: error_text(c.cheapest)),
        Column("cost", lambda c: cost_text(c.cheapest)),
    )


def _plan_columns(unplanned: str) -> tuple[Column[Choice], ...]:
    return (
        Column(
            "plan", lambda c: words(c.planned.setting) if c.planned else unplanned, role="words"
        ),
        Column("its error", _planned_error),
        Column("its cost", lambda c: cost_text(c.planned)),
        Column("ratio", lambda c: number(c.ratio, 2) if c.ratio is not None else "–"),
    )


def _planned_error(choice: Choice) -> Cell:
    missed = " (missed)" if choice.kept is False else ""
    mark = {None: "", True: "yes", False: "no"}[choice.kept]
    return Cell(error_text(choice.planned) + missed, mark=mark)


def choice_tables(study: Study) -> dict[str, Table]:
    """For this accuracy: these settings, by quantity; the plan's where it was asked.

    Args:
        study: errors and costs of every setting.
    """
    unreached, unplanned = SO_FAR if study.status == "interrupted" else ALL_TRIED
    columns, plans = _choice_columns(unreached), _plan_columns(unplanned)
    rows: dict[str, list[Choice]] = {}
    for choice in choices(study):
        rows.setdefault(choice.quantity, []).append(choice)
    return {
        quantity: tabulate(
            f"For this accuracy: these settings ({quantity})",
            (*columns, *plans) if any(choice.planned for choice in found) else columns,
            found,
            reference_sentence(study, quantity),
        )
        for quantity, found in rows.items()
    }


def front_tables(study: Study) -> list[Table]:
    """The Pareto front of every quantity.

    Args:
        study: errors and costs of every setting.
    """
    return [
        tabulate(f"Pareto front ({quantity})", FRONT, pareto(study.of(quantity)))
        for quantity in QUANTITIES
        if study.of(quantity)
    ]


def markdown(study: Study) -> str:
    """All tables as Markdown, a heading per quantity.

    Args:
        study: errors and costs of every setting.
    """
    lines = [f"# {study.title}: accuracy against cost", "", f"{study.description}.", ""]
    if study.synthetic:
        lines += ["Synthetic: simulated, not measured on a device.", ""]
    lines += [f"Cost: {study.cost_kind} time.", ""]
    for quantity, table in choice_tables(study).items():
        lines += [f"## {quantity[0].upper()}{quantity[1:]}", ""]
        lines += [f"| {' | '.join(h.text for h in table.heads)} |", f"|{'---|' * len(table.heads)}"]
        lines += [f"| {' | '.join(cell.text for cell in row)} |" for row in table.rows]
        lines += ["", table.note, ""]
    return "\n".join(lines)


def terminal(study: Study) -> list[str]:
    """The tables in lines of text.

    Args:
        study: errors and costs of every setting.
    """
    lines = [f"{study.title}: accuracy against cost ({study.description})", ""]
    for quantity, table in choice_tables(study).items():
        lines.append(quantity)
        for row in table.rows:
            wanted, setting, error, cost, *planned = (cell.text for cell in row)
            lines.append(f"  {wanted:>6}: {cost:>9}  error {error:9}  {setting}")
            if planned and planned[2] != "–":
                setting, error, cost, ratio = planned
                times = "" if ratio == "–" else f" ({ratio} times the cheapest)"
                lines.append(f"{'plan':>8}  {cost:>9}  error {error:9}  {setting}{times}")
        lines.append(f"  {table.note}")
    return lines
