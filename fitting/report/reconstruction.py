"""The report of a reconstruction: its sections, in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from fitting.fit.fit import Status as Ended
from fitting.inference.likelihood.knowledge import Values
from fitting.inference.quadratures import quadrature_sentences
from fitting.inference.sweep_line import line_sentences
from fitting.report.figures import numbers
from fitting.report.figures.file import FigureFile
from fitting.report.figures.inference import flat_sentence
from fitting.report.figures.reconstruction import write_figures
from fitting.report.page import Line, Page, Section, Status, write_page
from fitting.report.screen import Printed, phrase, phrases
from fitting.report.shown import ShownCampaign
from fitting.report.summary import Summary, status_words, summary_of
from fitting.report.table import Table, pairs_table
from fitting.report.tables.fit import alternative_table, ending_table, history_table, start_table
from fitting.report.tables.inference import knowledge_tables
from fitting.report.tables.joint import joint_tables
from fitting.report.tables.plan import plan_table, remarks
from fitting.report.tables.published import write_values
from fitting.report.tables.sweep import line_table
from fitting.report.tables.tones import deviation_table, mean_deviation_table
from fitting.report.tables.values import (
    correlation_table,
    derived_table,
    interval_table,
    offset_table,
    parameter_table,
    per_experiment_table,
    per_place_table,
)
from fitting.result.result import Result
from fitting.text.notation import number, scalar_words, settings_words, signs_words

Figures = tuple[FigureFile, ...]
#: Figures by the section that they belong to; what is in none gets one of its own.
DATA_FIGURES = (numbers.DRIVE, numbers.SPECTRA, "phases")
DEVIATION_FIGURES = (numbers.OVER_FREQUENCY, numbers.IMPROVEMENT, numbers.PER_EXPERIMENT)
#: Sections that are not folded: what the answer rests on.
OPEN = ("values", "agreement")
#: What errors and intervals are, once for all of them.
CONVENTION = "± is 1σ, + and − those of each side; intervals are 95 % confidence intervals."
KNOWLEDGE_FIGURES = (numbers.PROFILES, numbers.TOGETHER, numbers.OUTPUTS)


def write_report(
    result: Result,
    data: ShownCampaign,
    out_dir: Path,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> Path:
    """Draw the figures (`out_dir`/figures), write `report.html`, `values.csv` and `values.tex`.

    Returns the path of the page.

    The same result gives the same bytes.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
        out_dir: where the files go.
        progress: is told how many figures are drawn, of how many.

    Raises:
        BadInput: the folder cannot be written.
    """
    return write_report_of(result, data, out_dir, write_figures(result, data, out_dir, progress))


def write_report_of(
    result: Result, data: ShownCampaign, out_dir: Path, figures: Sequence[FigureFile]
) -> Path:
    """The same of figures that are drawn already; the path of the page.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
        out_dir: where the files go.
        figures: figure files that are shown.

    Raises:
        BadInput: the folder cannot be written.
    """
    write_values(result, out_dir)
    return write_page(page_of(result, data, figures), out_dir)


def page_of(result: Result, data: ShownCampaign, figures: Sequence[FigureFile]) -> Page:
    """The report as a page.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
        figures: figure files that are shown.
    """
    lead = lead_of(figures)
    rest = [figure for figure in figures if figure is not lead]
    summary = summary_of(result)
    signs = signs_words([*result.parameters, *result.derived])
    return Page(
        title=result.title,
        kind="reconstruction",
        status=status_of(result),
        sections=sections_of(result, data, rest),
        synthetic=result.synthetic,
        warnings=summary.warnings,
        answer=answer_block(summary),
        notes=(CONVENTION, *filter(None, [signs])),
        lead=lead,
        published=True,
    )


def lead_of(figures: Sequence[FigureFile]) -> FigureFile | None:
    """The figure that shows data, fit and residual at once, if there is one: the first.

    Args:
        figures: figure files that are shown.
    """
    return next((figure for figure in figures if figure.number == 1), None)


def answer_block(summary: Summary) -> tuple[Line, ...]:
    """The first screen as the page shows it, in the same order.

    Args:
        summary: of a reconstruction.
    """
    shown = tuple(map(_named, summary.values))
    limits = ", ".join(" ".join(_named(value)) for value in summary.limits)
    rest = (
        ("Errors", summary.errors),
        ("95 % CI", limits),
        ("Unconstrained", "; ".join(summary.unconstrained)),
        ("Not known", "; ".join(summary.unknown)),
        ("Assumed", summary.assumption),
    )
    lines = [Line("Values", values=shown)] if shown else []
    lines += [Line(head, words=words) for head, words in rest if words]
    if summary.advice or summary.command:
        lines.append(Line("Next", words=summary.advice, command=summary.command))
    return tuple(lines)


def _named(value: Printed) -> tuple[str, str]:
    remark = f" ({value.remark})" if value.remark else ""
    return " = ".join(value.symbols), f"{value.text}{remark}"


def status_of(result: Result) -> Status:
    """How it ended: good only where the model describes the data, and doubtful unless wholly so.

    Args:
        result: of a reconstruction.
    """
    good = result.status == Ended.CONVERGED
    ground = result.ending.ground
    said = f"{ground[:1].upper()}{ground[1:]}." if ground[:1].isascii() else f"{ground}."
    return Status(
        status_words(result),
        said if ground else "" if good else result.message,
        good=good,
        doubtful=good and not result.ending.whole,
    )


def sections_of(
    result: Result, data: ShownCampaign, figures: Sequence[FigureFile]
) -> tuple[Section, ...]:
    """All sections that this result has something for; every figure appears in one of them.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
        figures: figure files that are shown.
    """
    shelf = list(figures)

    def take(*kinds: str) -> Figures:
        """Figures of a kind, and of that kind for each campaign of a joint fit."""
        found = tuple(figure for kind in kinds for figure in shelf if figure.kind == kind)
        shelf[:] = [figure for figure in shelf if figure not in found]
        return found

    named = {*numbers.FIRST, *numbers.LAST}
    further = take(*dict.fromkeys(f.kind for f in figures if f.kind not in named))

    made = [
        Section("values", "Values", tables=(interval_table(result, "Fitted and derived values"),)),
        _found(result),
        knowledge_section(result, take(*KNOWLEDGE_FIGURES)),
        _findings(result),
        _agreement(result),
        _quadratures(result),
        _experiments(result, data, take(*DATA_FIGURES)),
        _response(result, take(numbers.RESPONSE)),
        # what other kinds of measurements show
        Section("figures", "Measured and simulated", figures=further) if further else None,
        _deviations(result, data, take(*DEVIATION_FIGURES)),
        _convergence(result, take(numbers.CONVERGENCE, numbers.NU)),
        _derived(result, data, take(numbers.DERIVED)),
        _search(result),
        _settings(result, data),
        _plan(result, data),
        _provenance(result),
    ]
    return tuple(
        replace(section, folded=section.id not in OPEN) for section in made if section is not None
    )


def knowledge_section(found: Values, figures: Figures) -> Section | None:
    """What the data determine; None where no profiles were walked.

    Args:
        found: values, with what was found besides.
        figures: those of the report, by subject.
    """
    knowledge = found.knowledge
    if knowledge is None:
        return None
    drawn = any(figure.kind == numbers.PROFILES for figure in figures)  # its caption says it
    flat = "" if drawn else flat_sentence(found)
    return Section(
        id="knowledge",
        title=phrase("knowledge", "heading", knowledge),
        paragraphs=tuple(filter(None, (*phrases("knowledge", "about", knowledge), flat))),
        tables=knowledge_tables(found, knowledge),
        figures=figures,
    )


def _existing(*tables: Table | None) -> tuple[Table, ...]:
    return tuple(table for table in tables if table is not None)


def _found(result: Result) -> Section:
    said = [phrase("values", "deviation", result)]
    if result.alternative:
        said.append(f"Reported alternative: {settings_words(result.alternative)}.")
    return Section(
        id="found",
        title="Parameters in full: start, prior, bounds, correlations",
        paragraphs=tuple(said),
        tables=_existing(parameter_table(result), offset_table(result), correlation_table(result)),
    )


def _agreement(result: Result) -> Section | None:
    """Campaigns that were fitted together, and values from elsewhere."""
    said, shown = phrases("result", "agreement", result), joint_tables(result)
    if not said and not shown:
        return None
    return Section("agreement", "Do the measurements agree?", points=said, tables=shown)


def _findings(result: Result) -> Section | None:
    """Every finding, and what values rest on."""
    said = (*phrases("result", "findings", result), *phrases("result", "resting", result))
    return Section("findings", "Findings and assumptions", points=said) if said else None


def _quadratures(result: Result) -> Section | None:
    """What phases gained, and which qualities follow from gains and backgrounds."""
    said = quadrature_sentences(result.quadratures)
    return Section("quadratures", "What the phases determine", points=said) if said else None


def _derived(result: Result, data: ShownCampaign, figures: Figures) -> Section | None:
    if not result.derived:
        return None
    said = [
        f"Outputs of the FMU at {phrase('values', 'point', result)}, read after initialisation."
    ]
    if not figures and result.peaks:
        said.append(
            "None that the data give differs between the experiments by a tenth of its error: "
            "nothing is drawn of them."
        )
    return Section(
        id="derived",
        title="Derived quantities",
        paragraphs=tuple(said),
        tables=_existing(
            derived_table(result), per_experiment_table(result, data), per_place_table(result)
        ),
        figures=figures,
    )


def _experiments(result: Result, data: ShownCampaign, figures: Figures) -> Section | None:
    if not data.tones:
        return None
    spectra = sum(1 for tones in data.tones if tones.trace is not None)
    read = "peaks given in the experiments file"
    if spectra:
        read = f"peaks read from {spectra} spectra, noise floor removed"
    said = f"{len(data.tones)} experiments with {len(result.peaks)} {read}."
    return Section("experiments", "Experiments and spectra", paragraphs=(said,), figures=figures)


def _response(result: Result, figures: Figures) -> Section | None:
    title = "Frequency response and scale"
    if result.sweep is None:
        said = ("Every campaign has a sweep and a scale of its own.",)
        return Section("response", title, paragraphs=said, figures=figures) if figures else None
    table, paragraphs = None, []
    if result.line is not None:
        table = line_table(result.line)
        if table is None:
            paragraphs.append(f"No resonance could be fitted to the sweep: {result.line.message}.")
        else:
            paragraphs += line_sentences(result.line)[1:]  # the table holds the first
    paragraphs.append(phrase("result", "scale", result.scale))
    return Section(
        "response", title, paragraphs=tuple(paragraphs), tables=_existing(table), figures=figures
    )


def _deviations(result: Result, data: ShownCampaign, figures: Figures) -> Section:
    said = (
        f"Relative deviation |χz − z*|/z* of simulated (z) from measured amplitudes (z*). "
        f"J_fit = {number(result.j_fit, 6)}, J_reg = {number(result.j_reg, 3)}."
    )
    return Section(
        id="deviations",
        title="Deviations",
        paragraphs=(said,),
        tables=_existing(mean_deviation_table(result, data), deviation_table(result, data)),
        figures=figures,
    )


def _convergence(result: Result, figures: Figures) -> Section:
    tables = (history_table(result), ending_table(result))
    said = (result.message,)
    return Section("convergence", "Convergence", paragraphs=said, tables=tables, figures=figures)


def _search(result: Result) -> Section | None:
    if not result.alternatives:
        return None
    return Section(
        id="search",
        title="Alternatives and starts",
        tables=(alternative_table(result), start_table(result)),
    )


def _settings(result: Result, data: ShownCampaign) -> Section:
    timed = "fit, profiles" if result.knowledge is not None else "fit"
    spent = (
        f"{phrase('result', 'spent', result)} for {timed} and the plan, whose runs are not counted"
    )
    chosen = {name: scalar_words(v) for name, v in result.provenance.settings.items()}
    heads = ("setting", "value")
    tables = (
        pairs_table("Campaign", heads, {**data.settings, "cost": spent}),
        pairs_table("Continuation", heads, chosen),
    )
    return Section("settings", "Settings", tables=tables)


def _plan(result: Result, data: ShownCampaign) -> Section | None:
    sentences = (*remarks(result.plan, result.provenance.plan), *data.notes)
    if not sentences and result.plan is None:
        return None
    shown = () if result.plan is None else (plan_table(result.plan),)
    return Section("plan", "What was simulated, and why so", points=sentences, tables=shown)


def _provenance(result: Result) -> Section:
    source = result.provenance
    origin = {
        "command": source.command,
        "campaign": source.campaign,
        "seed": str(source.seed),
        "finished": source.finished,
        "FMU": source.fmu_name,
        "FMU file": source.fmu_file,
        "FMU guid": source.fmu_guid,
        "FMU sha256": source.fmu_sha256,
    }
    tables = (
        pairs_table("Origin", ("what", "which"), origin),
        pairs_table("Versions", ("program", "version"), source.versions),
        pairs_table("Files read", ("file", "sha256"), source.files),
    )
    return Section("provenance", "Provenance", tables=tables)
