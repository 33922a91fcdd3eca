"""A reconstruction in lines, as a terminal shows it: the answer first."""

from __future__ import annotations

from collections.abc import Sequence

from fitting.inference.ending import UNTESTED, Ending
from fitting.inference.quadratures import quadrature_sentences
from fitting.inference.sweep_line import line_sentences
from fitting.report.summary import summary_lines, summary_of
from fitting.report.table import text_lines, wrapped
from fitting.report.tables.values import values_table
from fitting.report.words.agreement import agreement_sentences
from fitting.report.words.assumptions import assumption_sentences, combination_sentences
from fitting.report.words.inference import bootstrap_lines
from fitting.report.words.plan import plan_line
from fitting.result.result import STATUSES, Result
from fitting.text.finding import Kind
from fitting.text.notation import settings_words
from fitting.text.sentences import sentence

#: Findings whose sentences need values beside their numbers.
OWN_WORDS = (Kind.assumption, Kind.combination)


def ending_words(result: Result) -> tuple[str, str]:
    """How it ended in a word or two, and in sentences without them.

    Args:
        result: of a reconstruction.
    """
    words = result.ending.clause or result.status
    said = result.message
    if said.lower().startswith(words):
        said = said[len(words) :].lstrip(":. ")
        said = f"{said[:1].upper()}{said[1:]}" if said[:1].isascii() else said
    return words, said


def headline(result: Result) -> str:
    """How it ended, and on what ground, in one sentence.

    Args:
        result: of a reconstruction.
    """
    ending = result.ending if result.ending.words else Ending(words=result.status)
    return ending.told("").strip()


def result_lines(result: Result) -> list[str]:
    """The first screen: values, what is unconstrained, warnings, what to do next.

    Args:
        result: of a reconstruction.
    """
    return summary_lines(summary_of(result))


def detail_lines(result: Result) -> list[str]:
    """All else, as `--verbose` prints it: how the fit ended, the table, what was found, its cost.

    Args:
        result: of a reconstruction.
    """
    said = headline(result) if result.status == STATUSES[0] else result.message
    lines = [*wrapped(said), "", *text_lines(values_table(result, result.title)), ""]
    agreement = agreement_sentences(result)
    lines += [*_sentences(agreement), ""] if agreement else []
    lines += _sentences(_fit_lines(result))
    if result.line is not None:
        lines += _sentences(line_sentences(result.line))
    lines += _sentences(_knowledge_lines(result))
    lines += _sentences(quadrature_sentences(result.quadratures))
    lines += _sentences((*combination_sentences(result), *assumption_sentences(result)))
    lines += _sentences(_cost_lines(result))
    findings = [f"{f.severity}: {sentence(f)}" for f in result.findings if f.kind not in OWN_WORDS]
    lines += ["", *_sentences(findings)] if findings else []
    return [line.replace("\u00a0", " ") for line in lines]


def _sentences(said: Sequence[str]) -> list[str]:
    """Sentences as the lines of a terminal."""
    return [line for each in said for line in wrapped(each) or [""]]


def _fit_lines(result: Result) -> list[str]:
    before, after = result.deviations.initial.mean, result.deviations.final.mean
    lines = [f"mean deviation {before:.4g} -> {after:.4g}, J_fit = {result.j_fit:.6g}"]
    if result.status == STATUSES[0]:
        lines.append(result.message.removeprefix(headline(result)).strip())
    for other in result.alternatives:
        if not other.settings:  # the campaign names no alternatives
            continue
        mark = "reported" if other.reported else ("equal" if other.equal_to_best else "worse")
        shown = settings_words(other.settings)
        lines.append(f"alternative {shown}: J_fit = {other.j_fit:.6g} ({mark})")
    return lines


def _knowledge_lines(result: Result) -> list[str]:
    """What was found about residuals, directions, minima and nu; values stand in the table."""
    knowledge = result.knowledge
    if knowledge is None:
        return []
    # the first says how well the data are described, which the headline has told
    told = result.ending.ground not in ("", UNTESTED)
    lines = list(knowledge.sentences[1:] if told else knowledge.sentences)
    lines += [] if knowledge.nu is None else knowledge.nu.sentences
    lines += [] if knowledge.bootstrap is None else bootstrap_lines(knowledge.bootstrap)
    return lines


def spent_words(result: Result) -> str:
    """What a job has taken: evaluations and runs of fit and profiles, and the time of both.

    Args:
        result: of a reconstruction.
    """
    cost, knowledge = result.evaluations, result.knowledge
    said = f"{cost.objective} evaluations, {cost.jacobians} Jacobians, {cost.fmu_runs} FMU runs"
    if knowledge is None:
        return f"{said}; {result.seconds:.1f} s"
    spent = knowledge.effort
    return (
        f"{said}, and {spent.evaluations} evaluations, {spent.fmu_runs} FMU runs for profiles; "
        f"{result.seconds:.1f} s"
    )


def _cost_lines(result: Result) -> list[str]:
    lines = ["", spent_words(result)]
    return lines if result.plan is None else [*lines, plan_line(result.plan)]
