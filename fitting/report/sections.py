"""What a report says, in order: sections of sentences, tables and figures, as plain records."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fitting.fit.result import IDENTIFIABLE, DerivedResult, ParameterResult, Result
from fitting.fit.sweep_line import line_sentences
from fitting.inference.knowledge import Knowledge
from fitting.report import tables
from fitting.report.drift import offset_table
from fitting.report.figures.style import FigureFile
from fitting.report.joint import joint_sentences, joint_tables
from fitting.report.knowledge import FIGURES, knowledge_tables, knowledge_words
from fitting.report.plan import plan_table, remarks
from fitting.report.shown import ShownCampaign
from fitting.report.tables import Table
from fitting.report.words.values import scalar_words, settings_words
from fitting.text.notation import listed, number, plain, prefixed, quantity, span

#: Correlations from which two errors are named as tied to each other.
TIED = 0.95


@dataclass(frozen=True)
class Section:
    """One section: `id` for links, sentences, a list, tables, figures (in this order)."""

    id: str
    title: str
    paragraphs: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[FigureFile, ...] = ()


def sections_of(
    result: Result, data: ShownCampaign, figures: Sequence[FigureFile]
) -> tuple[Section, ...]:
    """All sections that this result has something for; every figure appears in one of them."""
    shelf = {figure.name: figure for figure in figures}

    def take(*names: str) -> tuple[FigureFile, ...]:
        """Figures of that name, and of that name for each campaign of a joint fit."""
        found = [n for name in names for n in shelf if n == name or n.startswith(f"{name}_")]
        return tuple(shelf.pop(name) for name in found)

    made = [
        _found(result),
        knowledge_section(result.knowledge, take(*FIGURES)),
        _agreement(result),
        _derived(result, data, take("6_derived_per_experiment")),
        _experiments(result, data, take("1_drive", "2_spectra")),
        _response(result, data, take("8_frequency_response")),
        _deviations(
            result,
            data,
            take("3_deviation_over_frequency", "4_improvement", "7_deviation_per_experiment"),
        ),
        _convergence(result, take("5_convergence")),
        _search(result),
        _settings(result, data),
        _plan(result, data),
        _provenance(result),
    ]
    if shelf:
        made.append(Section("figures", "Further figures", figures=tuple(shelf.values())))
    return tuple(section for section in made if section is not None)


def knowledge_section(
    knowledge: Knowledge | None, figures: tuple[FigureFile, ...]
) -> Section | None:
    """What the data determine; None where no profiles were walked."""
    if knowledge is None:
        return None
    return Section(
        "knowledge",
        "What the data determine",
        knowledge_words(knowledge),
        (),
        knowledge_tables(knowledge),
        figures,
    )


def _agreement(result: Result) -> Section | None:
    """Campaigns that were fitted together, and values from elsewhere."""
    said, shown = joint_sentences(result), joint_tables(result)
    if not said and not shown:
        return None
    return Section("agreement", "Do the measurements agree?", (), said, shown)


def _found(result: Result) -> Section:
    first, last = result.deviations.initial.mean, result.deviations.final.mean
    what = f"{len(result.peaks)} peaks" if result.peaks else "the sweep"
    share = f" ({number(100.0 * last / first, 3)} % of it)" if first > 0.0 else ""
    said = [
        f"The mean relative deviation between simulation and laboratory over {what} is "
        f"{number(first, 3)} with the start parameters and {number(last, 3)} with the fitted "
        f"ones{share}."
    ]
    if result.alternative:
        said.append(f"Reported alternative: {settings_words(result.alternative)}.")
    every: dict[str, ParameterResult | DerivedResult] = {**result.parameters, **result.derived}
    items = [_value_sentence(name, value) for name, value in every.items()]
    tied = _tied_sentences(result)
    shown = [tables.parameter_table(result), offset_table(result), tables.correlation_table(result)]
    return Section(
        "found",
        "What was found, and what the data do not determine",
        tuple(said),
        (*items, *tied),
        tuple(table for table in shown if table is not None),
    )


def _value_sentence(name: str, value: ParameterResult | DerivedResult) -> str:
    """One value in words: how well it is known, or that it is not, and what it could be."""
    shown = quantity(value.value, value.std, value.unit)
    if value.identifiable == IDENTIFIABLE[0]:
        return f"{plain(name)} is determined by these data: {shown}."
    if value.identifiable == IDENTIFIABLE[1]:
        return (
            f"{plain(name)} is partly determined: {shown}, of whose variance the data answer for "
            f"{number(100.0 * value.shrinkage, 2)} % and prior and box for the rest."
        )
    bare = _with_prefix(value.value, value.unit)
    return (
        f"{plain(name)} is not determined by these data: {bare} is where prior (reference "
        f"{_with_prefix(value.reference, value.unit)}) and start left it. {_could_be(value)}"
    )


def _could_be(value: ParameterResult | DerivedResult) -> str:
    if isinstance(value, ParameterResult):
        low, high = value.ci95
        size = max(abs(low), abs(high))
        words = "Data, box and prior together leave"
    else:
        low, high = value.box
        size = max(abs(low), abs(high))
        words = "Within the box of the parameters it could be anything from"
    if not (math.isfinite(low) and math.isfinite(high)):
        return "Within the box of the parameters it could be anything."
    factor, unit = prefixed(size, value.unit)
    return f"{words} {span(low / factor, high / factor, unit)}."


def _with_prefix(value: float, unit: str) -> str:
    factor, shown = prefixed(abs(value), unit)
    return f"{number(value / factor, 7)}\u00a0{shown}".strip()


def _tied_sentences(result: Result) -> list[str]:
    names = list(result.parameters)
    said = []
    for i, line in enumerate(result.correlation):
        for j in range(i):
            if abs(line[j]) >= TIED:
                said.append(
                    f"The errors of {plain(names[j])} and {plain(names[i])} are tied "
                    f"(correlation {number(line[j], 3)}): the data hold a combination of the two, "
                    "not each."
                )
    return said


def _derived(
    result: Result, data: ShownCampaign, figures: tuple[FigureFile, ...]
) -> Section | None:
    if not result.derived:
        return None
    shown = [tables.derived_table(result), tables.per_experiment_table(result, data)]
    return Section(
        "derived",
        "Derived quantities",
        ("Outputs of the FMU at the fitted parameters, read after initialisation.",),
        tables=tuple(table for table in shown if table is not None),
        figures=figures,
    )


def _experiments(
    result: Result, data: ShownCampaign, figures: tuple[FigureFile, ...]
) -> Section | None:
    if not data.tones:
        return None
    spectra = sum(1 for e in data.tones if e.trace is not None)
    read = "peaks given in the experiments file"
    if spectra:
        read = f"peaks read from {spectra} spectra, noise floor removed"
    said = f"{len(data.tones)} experiments with {len(result.peaks)} {read}."
    return Section("experiments", "Experiments and spectra", (said,), figures=figures)


def _response(
    result: Result, data: ShownCampaign, figures: tuple[FigureFile, ...]
) -> Section | None:
    if result.sweep is None:
        said = ["Every campaign has a sweep and a scale of its own."]
        title = "Frequency response and scale"
        return Section("response", title, tuple(said), figures=figures) if figures else None
    shown: list[Table] = []
    said = []
    if result.line is not None:
        table = tables.line_table(result.line)
        if table is None:
            said.append(f"No resonance could be fitted to the sweep: {result.line.message}.")
        else:
            shown.append(table)
            said += line_sentences(result.line)[1:]  # the table holds the first
    said.append(_scale_sentence(result))
    return Section(
        "response", "Frequency response and scale", tuple(said), (), tuple(shown), figures
    )


def _scale_sentence(result: Result) -> str:
    kinds = {
        "maximum": "ratio of the maxima of measured and simulated sweep (Algorithm 1)",
        "fit": "least squares over the whole sweep",
        "robust": "Huber's estimate over the whole sweep",
        "free": "fitted with the rest, the whole sweep its prior",
    }
    scale = result.scale
    if scale.kind not in kinds:
        return "Simulated amplitudes are compared as they are, without a scale."
    said = (
        f"Scale χ by {kinds[scale.kind]}: {number(scale.initial, 6)} with the start, "
        f"{number(scale.final, 6)} with the fitted parameters."
    )
    if scale.kind == "maximum":
        said += (
            " The grid of the simulated sweep biases it by no more than "
            f"{number(scale.grid_bias, 2)}, relatively; "
        )
        said += (
            "no top could be fitted to the measured sweep."
            if math.isnan(scale.maximum_bias)
            else f"the largest measured point lies {number(100.0 * scale.maximum_bias, 2)} % "
            f"(± {number(100.0 * scale.maximum_bias_std, 2)} %) off the fitted top of the measured "
            "sweep."
        )
    return said


def _deviations(result: Result, data: ShownCampaign, figures: tuple[FigureFile, ...]) -> Section:
    shown = [
        tables.mean_deviation_table(result, data),
        tables.deviation_table(result, data),
    ]
    said = (
        f"Relative deviation |χz − z*|/z* of simulated (z) from measured amplitudes (z*). "
        f"J_fit = {number(result.j_fit, 6)}, J_reg = {number(result.j_reg, 3)}.",
    )
    return Section(
        "deviations",
        "Deviations",
        said,
        (),
        tuple(table for table in shown if table is not None),
        figures,
    )


def _convergence(result: Result, figures: tuple[FigureFile, ...]) -> Section:
    return Section(
        "convergence",
        "Convergence",
        (),
        (),
        (tables.history_table(result), tables.ending_table(result)),
        figures,
    )


def _search(result: Result) -> Section | None:
    if not result.alternatives:
        return None
    equal = [a for a in result.alternatives if a.equal_to_best and not a.reported]
    said = ""
    if equal:
        others = listed(settings_words(a.settings) for a in equal)
        said = f"The data do not tell the alternatives apart: {others} reaches the same J."
    return Section(
        "search",
        "Alternatives and starts",
        (said,) if said else (),
        (),
        (tables.alternative_table(result), tables.start_table(result)),
    )


def _settings(result: Result, data: ShownCampaign) -> Section:
    campaign = dict(data.settings)
    cost = result.evaluations
    campaign["cost"] = (
        f"{cost.objective} evaluations of the objective, {cost.jacobians} Jacobians, "
        f"{cost.fmu_runs} simulation runs, {result.seconds:.1f} s"
    )
    chosen = {name: scalar_words(v) for name, v in result.provenance.settings.items()}
    return Section(
        "settings",
        "Settings",
        (),
        (),
        (
            tables.pairs_table("Campaign", ("setting", "value"), campaign),
            tables.pairs_table("Continuation", ("setting", "value"), chosen),
        ),
    )


def _plan(result: Result, data: ShownCampaign) -> Section | None:
    sentences = (*remarks(result.plan, result.provenance.plan), *data.notes)
    if not sentences and result.plan is None:
        return None
    shown = () if result.plan is None else (plan_table(result.plan),)
    return Section("plan", "What was simulated, and why so", (), sentences, shown)


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
    return Section(
        "provenance",
        "Provenance",
        (),
        (),
        (
            tables.pairs_table("Origin", ("what", "which"), origin),
            tables.pairs_table("Versions", ("program", "version"), dict(source.versions)),
            tables.pairs_table("Files read", ("file", "sha256"), dict(source.files)),
        ),
    )
