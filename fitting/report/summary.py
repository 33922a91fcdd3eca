"""The first screen of a reconstruction: values, what is unconstrained, warnings, the next step."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from fitting.campaign.laws import in_base
from fitting.inference.checks.assumptions import SHIFT
from fitting.inference.sweeps import SweepLine, depends_on_background
from fitting.report.same_values import same_values
from fitting.report.screen import Printed, phrase, phrases, printed_lines, screen
from fitting.report.table import table
from fitting.result.result import Result
from fitting.text.choices import BUDGET
from fitting.text.estimate import Estimate, FittedEstimate, Verdict
from fitting.text.finding import Finding, Kind, of_kind
from fitting.text.notation import quantity, range_words, sign, with_prefix
from fitting.text.rendering import blocks, sentence

#: Warnings on the first screen, at most.
MOST_WARNINGS = 3
#: Findings that the first screen expresses otherwise: by its status, its values, its next step.
EXPRESSED = frozenset({Kind.not_converged, Kind.not_described, Kind.profiles_missing})
#: Kinds that say best what is wrong: they come first among the warnings.
CAUSES = (
    Kind.bounds_off_line,
    Kind.frequencies_apart,
    Kind.line_missing,
    Kind.contradiction,
    Kind.outlier,
    Kind.gain,
    Kind.offset,
    Kind.shift,
    Kind.noise_level,
    Kind.drift_exchanged,
    Kind.peaks_exchanged,
    Kind.phases_misread,
    Kind.assumed_value,
    Kind.equivalent_solution,
)
#: Kinds that say that the model lacks something, though its values may be right.
STRUCTURED = (Kind.correlated_residuals, Kind.line_background, Kind.line_residuals)
#: Numbers of a line, by what a value may be of it.
PARTS: dict[str, Callable[[SweepLine], Estimate]] = {
    "frequency": lambda line: line.frequency,
    "width": lambda line: line.width,
    "q": lambda line: line.q,
}
#: Standard errors from which sweep and fit are no two measurements of one value.
APART_SIGMA = 3.0
#: Times as large a budget is proposed where one cut a search.
MORE = 10
#: Rise of χ² from which the data exclude that an assumption does not hold.
EXCLUDED = 9.0


@dataclass(frozen=True, kw_only=True)
class Summary:
    """All of the first screen.

    Args:
        title: of the campaign.
        status: how the fit ended, with χ²/dof.
        values: those with an error; ``limits``: those with a bound on one side, or a wide interval.
        unconstrained: names with the range that the data allow; ``unknown``: with the reason why
            nothing is known of them.
        errors: what all errors are, where that is one remark.
        external: how values agree with those from elsewhere.
        warnings: the most urgent ones; ``more``: how many others there are.
        assumption: what the values rest on, with the largest shift; mostly empty.
        advice: what to do next, and ``command``, by which; both may be empty.
    """

    title: str
    status: str
    values: tuple[Printed, ...] = ()
    limits: tuple[Printed, ...] = ()
    unconstrained: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    external: tuple[str, ...] = ()
    errors: str = ""
    warnings: tuple[str, ...] = ()
    more: int = 0
    assumption: str = ""
    advice: str = ""
    command: str = ""
    synthetic: bool = False


def summary_of(result: Result) -> Summary:
    """The first screen of a reconstruction.

    Args:
        result: of a reconstruction.
    """
    same = same_values(result)
    # the outputs that the campaign asks for come first
    every: dict[str, FittedEstimate] = {**result.derived, **result.parameters}
    every = {name: value for name, value in every.items() if name not in same}
    summary = Summary(title=result.title, status=phrase("next", "status", result))
    withdrawn = result.status == "converged"
    idle = () if result.knowledge is None else result.knowledge.without_effect
    summary, left = with_values(summary, every, result.line, same, idle, withdrawn=withdrawn)
    urgent = _urgent(result.findings)
    advice, command = next_step(result, left)
    return replace(
        summary,
        external=tuple(phrase("result", "external", test, result) for test in result.external),
        warnings=warnings_of(urgent, every),
        more=max(len(urgent) - MOST_WARNINGS, 0),
        assumption=_with_signs(_assumption(result), every),
        advice=advice,
        command=command,
        synthetic=result.synthetic and "synthetic" not in result.title.lower(),
    )


def with_values(
    summary: Summary,
    every: Mapping[str, FittedEstimate],
    line: SweepLine | None = None,
    same: Mapping[str, str] = MappingProxyType({}),
    idle: Sequence[str] = (),
    *,
    withdrawn: bool = True,
) -> tuple[Summary, dict[str, FittedEstimate]]:
    """A first screen with its values, and the values that are not determined.

    Args:
        summary: with its title and status.
        every: value by name, in the order in which they are printed.
        line: of the sweep alone, which may determine a value better than the fit.
        same: other names of values, with the name under which each is printed.
        idle: names of parameters without effect on the data.
        withdrawn: whether values that are withdrawn are listed with their reason.
    """
    values, limits, left = [], [], dict[str, FittedEstimate]()
    # ranges of one unit are printed with one prefix
    bounded = [v for v in every.values() if v.status is Verdict.BOUNDED]
    statuses: set[Verdict | None] = set()  # None: of a value that is not the profile's
    for name, result in every.items():
        others = (name, *(other for other, first in same.items() if first == name))
        symbols = tuple(map(sign, others))
        printed = _value(name, result, line, symbols)
        if printed is None:
            left[name] = result
            if result.status in (Verdict.BOUNDED, Verdict.ABOVE, Verdict.BELOW):
                ends = (abs(end) for v in bounded if v.unit == result.unit for end in v.ci95)
                among = max(filter(math.isfinite, ends), default=0.0)
                limit = phrase("values", "limit", result, among)
                remark = phrase("values", "remark", result)
                limits.append(Printed(name=name, symbols=symbols, text=limit, remark=remark))
            continue
        values.append(printed)
        plain = by_line(name, result, line) is None
        statuses.add(result.status if plain else None)
        if plain and result.status is Verdict.SEVERAL:
            left[name] = result
    errors = ""
    if statuses == {Verdict.LINEARISED}:
        errors = phrase("next", "no_profile", values[0].remark)
        values = [replace(value, remark="") for value in values]
    made = replace(
        summary,
        values=tuple(values),
        limits=tuple(limits),
        unconstrained=_unconstrained(left, idle),
        unknown=_unknown(left, withdrawn=withdrawn),
        errors=errors,
    )
    return made, left


def warnings_of(urgent: Iterable[Finding], names: Iterable[str]) -> tuple[str, ...]:
    """The first warnings, each once, with the symbols of values.

    Args:
        urgent: errors and warnings, the most important first.
        names: of the values.
    """
    texts = dict.fromkeys(map(sentence, urgent))
    return tuple(_with_signs(text, names) for text in texts)[:MOST_WARNINGS]


def _with_signs(text: str, names: Iterable[str]) -> str:
    """A sentence with the symbols of values in place of their names, squares as squares."""
    for name in sorted(names, key=len, reverse=True):
        named = rf"(?<![\w.]){re.escape(name)}(?![\w.]*\w)"
        text = re.sub(rf"{named}\^2\b", f"{sign(name)}²", text)
        text = re.sub(named, sign(name), text)
    return text


def _value(
    name: str, result: FittedEstimate, line: SweepLine | None, symbols: tuple[str, ...]
) -> Printed | None:
    """A value with its error: the sweep's own where it is the better one; None: it has none."""
    better = by_line(name, result, line)
    if better is not None:
        text, remark = quantity(*better, result.unit), phrase("values", "from_sweep")
        return Printed(name=name, symbols=symbols, text=text, remark=remark)
    if not result.status.has_value or result.status is Verdict.BOUNDED:
        return None
    text = phrase("values", "reported", result)
    return Printed(name=name, symbols=symbols, text=text, remark=phrase("values", "remark", result))


def by_line(
    name: str, result: FittedEstimate, line: SweepLine | None
) -> tuple[float, float] | None:
    """Value and error of the sweep's line, where they are of this value and the better ones.

    Args:
        name: of the value.
        result: the fit's value.
        line: that the sweep shows by itself.
    """
    if line is None or name not in line.values or depends_on_background(line):
        return None
    part = PARTS[line.values[name]](line)
    value, std = part.value, part.std
    if not (math.isfinite(value) and std > 0.0) or result.status is Verdict.WITHDRAWN:
        return None
    if not result.status.has_value or math.isnan(result.std):
        return value, std
    near = abs(result.likely - value) <= APART_SIGMA * math.hypot(std, result.std)
    return (value, std) if std < result.std and near else None


def _unconstrained(left: Mapping[str, FittedEstimate], idle: Sequence[str]) -> tuple[str, ...]:
    """Names of unconstrained values by the range that the data allow, parameters first.

    Those that are ``idle``, without effect on the data, come before them.
    """
    without = [sign(name) for name in left if name in idle]
    periodic, bounded, derived = [], dict[str, list[str]](), dict[str, list[str]]()
    for name, result in left.items():
        if result.status is not Verdict.UNCONSTRAINED or name in idle:
            continue
        if result.is_all_round:
            periodic.append(sign(name))
        else:
            groups = bounded if result.role == "parameter" else derived
            groups.setdefault(range_words(*result.ci95, result.unit), []).append(sign(name))
    return phrases("next", "unconstrained", without, periodic, bounded, derived)


def _unknown(left: Mapping[str, FittedEstimate], *, withdrawn: bool) -> tuple[str, ...]:
    """Names of values of which nothing is known, by the reason; those ``withdrawn`` among them."""
    verdicts = (Verdict.UNKNOWN, Verdict.WITHDRAWN) if withdrawn else (Verdict.UNKNOWN,)
    groups: dict[str, list[str]] = {}
    for name, result in left.items():
        if result.status in verdicts:
            groups.setdefault(result.reason, []).append(sign(name))
    return phrases("next", "unknown", groups)


def _urgent(findings: Iterable[Finding]) -> list[Finding]:
    """Errors and warnings that the screen does not express otherwise, causes first."""
    result = [f for f in findings if f.severity != "note" and f.kind not in EXPRESSED]
    return sorted(result, key=lambda f: f.kind not in CAUSES)


def _assumption(result: Result) -> str:
    """The assumption that shifts the first requested value most, and how many others there are."""
    # the first of what the campaign asks for: of its outputs, where it has any
    name, value = next(iter((result.derived or result.parameters).items()), ("", None))
    shifts = []
    for finding in of_kind(result.findings, Kind.assumption):
        shift = finding.numbers.get(f"{SHIFT}{name}", math.nan)
        # not what the data themselves exclude
        if value is not None and math.isfinite(shift) and finding.numbers["chi_square"] < EXCLUDED:
            shifts.append((abs(shift), finding.subject, shift / in_base(value.unit, name)[0]))
    if not shifts:
        return ""
    _, subject, shift = max(shifts)
    others = len(of_kind(result.findings, Kind.assumption)) - 1
    moved = with_prefix(shift, "" if value is None else value.unit, 2, signed=True)
    return phrase("result", "assumed", subject, name, moved, others)


# --- what to do next -----------------------------------------------------------------------------


def next_step(result: Result, left: Mapping[str, FittedEstimate]) -> tuple[str, str]:
    """What to do next, in words and as a command; both empty where nothing is needed.

    Args:
        result: of a reconstruction.
        left: values that are not determined, by name.
    """
    kinds, status = {finding.kind for finding in result.findings}, result.status
    knowledge = result.knowledge
    if status == "interrupted":
        return phrase("next", "resume"), ""
    if kinds & {Kind.bounds_off_line, Kind.frequencies_apart}:
        return phrase("next", "check_units"), ""
    # where the model lacks a line its parameters go to their bounds for it
    for missing in of_kind(result.findings, Kind.line_missing):
        return phrase("next", "missing_line", missing.numbers["frequency_hz"]), ""
    drifts = [f for f in result.findings if f.kind in (Kind.drift_wide, Kind.drift_suspected)]
    if status != "converged" and any(not f.names["offsets"] for f in drifts):
        return phrase("next", "fit_drift"), ""
    if status != "converged" and Kind.sweep_point in kinds:
        return phrase("next", "remove_point"), ""
    if status == "not converged" and not kinds & {Kind.search_unexplained, *CAUSES}:
        return phrase("next", "more_starts"), ""
    if Kind.contradiction in kinds:
        return phrase("next", "separate_fits"), ""
    adequacy = None if knowledge is None else knowledge.adequacy
    limited = _limited_by_bounds(result)
    if status != "converged":
        words = ("wider_bounds", limited, False) if limited else ("other_model", adequacy)
        return phrase("next", *words), ""
    if limited:
        return phrase("next", "wider_bounds", limited, True), ""
    if knowledge is None:
        return _with_profiles(result)
    # the fit is as good as it can be: what to measure
    if Kind.sampling_ambiguity in kinds:
        return phrase("next", "narrow_bounds"), ""
    for assumed in of_kind(result.findings, Kind.assumed_value):
        return phrase("next", "measure_assumed", list(map(sign, assumed.names["assumed"]))), ""
    target = target_of(result, left)
    if not target:
        return _where_all_is_determined(result), ""
    if "budget" in result.scans[target].stopped:
        return _larger_budget(result)
    command = _design_command(result, target)
    return phrase("next", "determine", target, not command), command


def _where_all_is_determined(result: Result) -> str:
    """What to do where every requested value is determined: about noise and structure."""
    for wider in of_kind(result.findings, Kind.noise_underestimated):
        return phrase("next", "state_noise", wider.numbers["factor"])
    structured = [f for f in of_kind(result.findings, *STRUCTURED) if f.severity != "note"]
    keys = dict.fromkeys(key for f in structured for key in f.names.get("keys", ()))
    return phrase("next", "background", [*keys]) if structured else phrase("next", "none_needed")


def _limited_by_bounds(result: Result) -> list[str]:
    """Signs of the parameters that end on a bound, but for those that the data leave open there."""
    ended = {f.subject for f in of_kind(result.findings, Kind.at_bound) if f.numbers["at_bound"]}
    open_ = (Verdict.UNCONSTRAINED, Verdict.UNKNOWN)
    return [sign(n) for n, p in result.parameters.items() if n in ended and p.status not in open_]


def _with_profiles(result: Result) -> tuple[str, str]:
    """Profiles: by the same command with them, from Python by their function.

    Where the command ended before they were done, it goes on from the levels that it has kept.
    """
    words, _ = _without_budget(result)
    if not words:
        return phrase("next", "profiles", True), ""
    spent = any(f.subject == "budget" for f in of_kind(result.findings, Kind.profiles_missing))
    if "--no-profiles" not in words and not spent:
        every = shlex.split(result.provenance.command)
        kept = [*(word for word in every if word != "--resume"), "--resume"]
        return phrase("next", "complete_profiles"), shlex.join(kept)
    kept = [word for word in words if word != "--no-profiles"]
    return phrase("next", "profiles", False), shlex.join(kept)


def _larger_budget(result: Result) -> tuple[str, str]:
    """What was cut for its cost: the same with ten times the budget, or the usual one."""
    words, budget = _without_budget(result)
    if not words:
        return phrase("next", "larger_budget", True), ""
    if budget is None:  # the usual one, which it has spent
        spent = 0 if result.knowledge is None else result.knowledge.effort.fmu_runs
        budget = max(BUDGET, spent)
    more = words if MORE * budget <= BUDGET else [*words, "--budget", str(MORE * budget)]
    return phrase("next", "larger_budget", False), shlex.join(more)


def _without_budget(result: Result) -> tuple[list[str], int | None]:
    """The command to be typed again, but for its budget, and that; none of another command."""
    words, budget = shlex.split(result.provenance.command), None
    if words[:2] != ["fmu-fit", "reconstruct"]:
        return [], None
    kept = [word for word in words if word != "--resume"]
    if "--budget" in kept:
        at = kept.index("--budget")
        budget = int(kept[at + 1])
        del kept[at : at + 2]
    return kept, budget


def target_of(result: Result, left: Mapping[str, FittedEstimate]) -> str:
    """What to determine next: the first output that is not determined, else parameter.

    Not what the measurement brings along, as the delay of a cable.

    Args:
        result: of a reconstruction.
        left: values that are not determined, by name.
    """
    requested = [name for name, p in result.parameters.items() if p.asked]
    wanted = [name for name in (*result.derived, *requested) if name in left]
    # what nothing is known of comes before what is bounded; parameters that are bounded will do
    # where outputs are what the campaign asks for
    open_ = [
        name for name in wanted if left[name].status in (Verdict.UNCONSTRAINED, Verdict.UNKNOWN)
    ]
    rest = [
        name
        for name in wanted
        if name in result.derived or not result.derived or left[name].status is not Verdict.BOUNDED
    ]
    return next(iter((*open_, *rest)), "")


def _design_command(result: Result, target: str) -> str:
    """`fmu-fit design` for the campaigns of a `fmu-fit reconstruct`; empty where it was no such."""
    words = shlex.split(result.provenance.command)
    if words[:2] != ["fmu-fit", "reconstruct"]:
        return ""
    at = f"{words[words.index('--out') + 1]}/result.json" if "--out" in words[:-1] else ""
    count = next((k for k, word in enumerate(words) if word.startswith("--")), len(words))
    return design_command(words[2:count], at, target)


def design_command(campaigns: Sequence[str], at: str, target: str) -> str:
    """`fmu-fit design` for some campaigns.

    Args:
        campaigns: their files.
        at: a fit to start from; empty: none.
        target: a value that is to be determined.
    """
    return shlex.join(
        ["fmu-fit", "design", *campaigns, *(["--at", at] if at else []), "--target", target]
    )


# --- the screen ----------------------------------------------------------------------------------


def summary_lines(summary: Summary) -> list[str]:
    """The first screen as lines of a terminal, by the template `summary.txt.j2`.

    Args:
        summary: of a reconstruction.
    """
    return printed_lines("summary", "screen", summary)


def result_lines(result: Result) -> list[str]:
    """The first screen: values, what is unconstrained, warnings, what to do next.

    Args:
        result: of a reconstruction.
    """
    return summary_lines(summary_of(result))


def detail_lines(result: Result) -> list[str]:
    """How the fit ended, the table of values, every finding, and its cost.

    Args:
        result: of a reconstruction.
    """
    return screen(
        "details",
        r=result,
        table=table("intervals", result=result, ends=False),
        plan="" if result.plan is None else str(blocks("plan").line(result.plan)),
    )
