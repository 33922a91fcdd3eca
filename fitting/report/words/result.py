"""A reconstruction in lines, as a terminal shows it."""

from __future__ import annotations

from fitting.inference.quadratures import quadrature_sentences
from fitting.inference.sweep_line import line_sentences
from fitting.report.table import text_lines
from fitting.report.tables.values import values_table
from fitting.report.words.agreement import agreement_sentences
from fitting.report.words.inference import knowledge_lines
from fitting.report.words.plan import plan_line
from fitting.result.result import Result


def result_lines(result: Result) -> list[str]:
    """The result as lines of text.

    Args:
        result: of a reconstruction.
    """
    marked = result.synthetic and "synthetic" not in result.title.lower()
    lines = [result.title + (" [synthetic]" if marked else ""), ""]
    lines += text_lines(values_table(result, result.title))
    agreement = agreement_sentences(result)
    lines += ["", *agreement] if agreement else []
    before, after = result.deviations.initial.mean, result.deviations.final.mean
    lines += ["", f"mean deviation {before:.4g} -> {after:.4g}, J_fit = {result.j_fit:.6g}"]
    for other in result.alternatives:
        if not other.settings:  # the campaign names no alternatives
            continue
        shown = ", ".join(f"{k} = {v}" for k, v in other.settings.items())
        mark = "reported" if other.reported else ("equal" if other.equal_to_best else "worse")
        lines.append(f"alternative {shown}: J_fit = {other.j_fit:.6g} ({mark})")
    if result.line is not None:
        lines += line_sentences(result.line)
    if result.knowledge is not None:
        lines += ["", *knowledge_lines(result.knowledge), ""]
    told = quadrature_sentences(result.quadratures)
    lines += [*told, ""] if told else []
    cost = result.evaluations
    lines.append(
        f"{cost.objective} evaluations, {cost.jacobians} Jacobians, {cost.fmu_runs} FMU runs, "
        f"{result.seconds:.1f} s"
    )
    if result.plan is not None:
        lines.append(plan_line(result.plan))
    lines += ["", f"{result.status}: {result.message}"]
    lines += [f"warning: {text}" for text in result.warnings]
    return lines
