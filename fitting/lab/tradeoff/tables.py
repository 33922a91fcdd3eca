"""A study as text: the CSV of every setting, the table "for this accuracy: these settings"."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence

from fitting.lab.tradeoff.front import Choice, choices, pareto
from fitting.lab.tradeoff.records import (
    COHERENT,
    QUANTITIES,
    WIDTH_SWEEP,
    Measurement,
    Setting,
    Study,
)
from fitting.text.notation import number, prefixed

COLUMNS = (
    "scene",
    "quantity",
    "solver",
    "resolution_kind",
    "resolution",
    "start",
    "settle_s",
    "reader",
    "window_s",
    "samples",
    "sweep_points",
    "jacobian_step",
    "iterations",
    "error",
    "error_is",
    "seconds",
    "cpu_s",
    "repeats",
    "fmu_runs",
    "do_step",
    "get_real",
    "solver_steps",
    "cost_is",
    "planned_for",
    "on_front",
    "note",
)


def csv_of(study: Study) -> str:
    """A row per setting; cells that have no number are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    fronts = {id(m) for quantity in QUANTITIES for m in pareto(study.of(quantity))}
    order = {quantity: place for place, quantity in enumerate(QUANTITIES)}
    for m in sorted(study.measurements, key=lambda m: (order[m.setting.quantity], m.cost_s)):
        writer.writerow(_row(study, m, id(m) in fronts))
    return text.getvalue()


def _row(study: Study, m: Measurement, on_front: bool) -> list[object]:
    s = m.setting
    error_is = "failed" if math.isinf(m.error) else ("at most" if m.bounded else "measured")
    return [
        study.scene,
        s.quantity,
        s.solver,
        s.resolution_kind,
        s.resolution or "",
        "periodic" if s.periodic else "rest",
        s.settle_s,
        s.reader,
        s.window_s,
        s.samples,
        s.sweep_points or "",
        s.jacobian_step or "",
        s.iterations or "",
        _known(m.error),
        error_is,
        m.seconds,
        _known(m.cpu_s),
        m.repeats,
        m.runs,
        m.steps,
        m.reads,
        "" if m.solver_steps is None else m.solver_steps,
        "extrapolated" if m.extrapolated else "measured",
        "" if m.planned_for is None else m.planned_for,
        "yes" if on_front else "",
        m.note,
    ]


def _known(value: float) -> object:
    return value if math.isfinite(value) else ""


def words(setting: Setting) -> str:
    """A setting in words."""
    parts = [setting.solver]
    if setting.resolution_kind == "tolerance":
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
    """A time with a prefix, three digits; minutes and hours in s."""
    if not math.isfinite(seconds):
        return "–"
    factor, unit = prefixed(seconds, "s") if seconds < 1.0 else (1.0, "s")
    return f"{number(seconds / factor, 3)}\u00a0{unit}"


def error_text(m: Measurement) -> str:
    """An error; one that is the reference's own as a bound."""
    return f"{'≤ ' if m.bounded else ''}{number(m.error, 2)}"


def cost_text(m: Measurement) -> str:
    """A cost; one that was not run is called so."""
    return time_text(m.cost_s) + (" (extrapolated)" if m.extrapolated else "")


HEADS = ("accuracy", "cheapest settings", "error", "cost", "plan", "its error", "its cost", "ratio")


def choice_cells(choice: Choice) -> tuple[str, ...]:
    """Cells of a row under `HEADS`."""
    best, plan = choice.cheapest, choice.planned
    ratio = choice.ratio
    return (
        number(choice.accuracy, 2),
        words(best.setting) if best else "not reached",
        error_text(best) if best else "–",
        cost_text(best) if best else "–",
        words(plan.setting) if plan else "no promise",
        error_text(plan) + ("" if choice.kept is not False else " (missed)") if plan else "–",
        cost_text(plan) if plan else "–",
        number(ratio, 2) if ratio is not None else "–",
    )


def markdown(study: Study) -> str:
    """All tables as Markdown, a heading per quantity."""
    lines = [f"# {study.title}: accuracy against cost", "", f"{study.description}.", ""]
    if study.synthetic:
        lines += ["Synthetic: simulated, not measured on a device.", ""]
    for quantity, rows in by_quantity(study).items():
        lines += [f"## {quantity[0].upper()}{quantity[1:]}", ""]
        planned = any(choice.planned for choice in rows)
        heads = HEADS if planned else HEADS[:4]
        lines += [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}"]
        lines += [f"| {' | '.join(choice_cells(row)[: len(heads)])} |" for row in rows]
        lines += ["", reference_sentence(study, quantity), ""]
    return "\n".join(lines)


def by_quantity(study: Study) -> dict[str, list[Choice]]:
    """Rows of the table by quantity."""
    found: dict[str, list[Choice]] = {}
    for choice in choices(study):
        found.setdefault(choice.quantity, []).append(choice)
    return found


def reference_sentence(study: Study, quantity: str) -> str:
    """What errors of a quantity are measured from."""
    for reference in study.references:
        if reference.quantity == quantity:
            return f"Errors from: {reference.source}; its own error {number(reference.error, 2)}."
    return ""


def terminal(study: Study) -> list[str]:
    """The table in lines of text."""
    lines = [f"{study.title}: accuracy against cost ({study.description})", ""]
    for quantity, rows in by_quantity(study).items():
        lines.append(quantity)
        for row in rows:
            cells = choice_cells(row)
            lines.append(f"  {cells[0]:>6}: {cells[3]:>9}  error {cells[2]:9}  {cells[1]}")
            if row.planned is not None:
                times = "" if row.ratio is None else f" ({cells[7]} times the cheapest)"
                lines.append(f"{'plan':>8}  {cells[6]:>9}  error {cells[5]:9}  {cells[4]}{times}")
        lines.append(f"  {reference_sentence(study, quantity)}")
    return lines


def failures(found: Sequence[Measurement]) -> list[str]:
    """What failed, each reason once."""
    return list(dict.fromkeys(m.note for m in found if math.isinf(m.error) and m.note))
