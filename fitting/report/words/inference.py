"""What the data determine, in words for terminal and report.

Never a value with a small error where the data give none.
"""

from __future__ import annotations

import math

from fitting.inference.likelihood.knowledge import Bootstrap, Determined, Knowledge, Values
from fitting.text.estimate import FittedEstimate, Verdict
from fitting.text.notation import bound, how_many, number, prefixed, span


def profile_words(value: FittedEstimate) -> str:
    """One value: its 95 % interval, or that it is not determined and what it could be.

    Args:
        value: with the interval of its profile.
    """
    name, verdict = value.name, value.status
    where = value.condition
    if verdict in (Verdict.UNKNOWN, Verdict.WITHDRAWN):
        return f"{name}: {verdict}{where} ({value.reason})"
    if verdict is Verdict.OPEN and value.is_all_round:
        return f"{name}: {verdict}{where} ({value.reason})"
    if verdict is Verdict.OPEN:
        return f"{name}: {verdict}{where}, {_range(value)} fits ({value.reason})"
    low, high = value.ci95
    factor, unit = _size(value)
    if verdict is Verdict.ABOVE:
        most = f"{bound(high / factor, 4, up=True)} {unit}".rstrip()
        return f"{name}: {verdict}{where}, {most} at most at 95 % ({value.reason})"
    if verdict is Verdict.BELOW:
        least = f"{bound(low / factor, 4, up=False)} {unit}".rstrip()
        return f"{name}: {verdict}{where}, {least} at least at 95 % ({value.reason})"
    up, down = (high - value.likely) / factor, (value.likely - low) / factor
    narrow = verdict is Verdict.DETERMINED
    word, tail = (f"{verdict} {value.reason}", "") if narrow else (verdict, f" ({value.reason})")
    return (
        f"{name}: {word}{where}, {span(low / factor, high / factor, unit)} at 95 % "
        f"(most likely {number(value.likely / factor, 7)}, +{number(up, 2)} -{number(down, 2)} to "
        "its ends)"
        f"{tail}"
    )


def _size(value: FittedEstimate) -> tuple[float, str]:
    """Prefix for an interval, none where its width would be all zeros in it."""
    low, high = value.ci95
    factor, unit = prefixed(max(abs(low), abs(high)), value.unit)
    if high - low < 1e-3 * factor or not value.unit:
        return 1.0, value.unit
    return factor, unit


def _range(value: FittedEstimate) -> str:
    low, high = value.ci95
    if not (math.isfinite(low) and math.isfinite(high)):
        return "anything"
    factor, unit = _size(value)
    return f"anything from {span(low / factor, high / factor, unit)}"


def knowledge_heading(knowledge: Knowledge) -> str:
    """What stands over all that is said of the values.

    Args:
        knowledge: what the data determine: profiles, directions, verdicts.
    """
    if knowledge.adequacy.gives_values:
        return "What the data determine"
    return f"Nothing is determined: {knowledge.adequacy.why_not}"


def knowledge_lines(found: Determined) -> list[str]:
    """Lines for a terminal: a line per value, then what was found about directions and minima.

    Args:
        found: values with their profiles, and what was found besides.
    """
    knowledge = found.knowledge
    lines = [f"{knowledge_heading(knowledge)} (profile likelihood):"]
    lines += [f"  {profile_words(value)}" for value in found.profiled.values()]
    lines += [f"  {said}" for said in knowledge.sentences]
    if knowledge.nu is not None:
        lines += [f"  {said}" for said in knowledge.nu.sentences]
    if knowledge.bootstrap is not None:
        lines += [f"  {said}" for said in bootstrap_lines(knowledge.bootstrap)]
    spent = knowledge.effort
    lines.append(
        f"  {how_many(spent.evaluations, 'evaluation')}, {how_many(spent.fmu_runs, 'FMU run')} "
        "for this"
    )
    return [line.replace("\u00a0", " ") for line in lines]


def bootstrap_lines(bootstrap: Bootstrap) -> list[str]:
    """The bootstrap's sentence and the interval of every value.

    Args:
        bootstrap: resampled fits.
    """
    lines = [bootstrap.sentence]
    for name, found in bootstrap.values.items():
        low, high = found.interval95
        lines.append(f"bootstrap of {name}: {span(low, high)} at 95 %, std {number(found.std, 2)}")
    return lines


def open_values_sentence(found: Values) -> str:
    """What the data leave open, and apart from it what nobody knows.

    Args:
        found: values with their profiles.
    """
    values = found.profiled
    unknown = [n for n, p in values.items() if p.status is Verdict.UNKNOWN]
    sure = (Verdict.DETERMINED, Verdict.UNKNOWN)
    names = [n for n, p in values.items() if p.status not in sure]
    said = [f"Not determined, or not wholly: {', '.join(names)}."] if names else []
    said += [f"Not known: {', '.join(unknown)}."] if unknown else []
    return " ".join(said) or "These data determine every value."
