"""What data determine in lines, as a terminal shows it."""

from __future__ import annotations

from fitting.inference.likelihood.knowledge import Identification, PartAlone, Values
from fitting.report.table import table, text_lines
from fitting.report.words.inference import knowledge_lines
from fitting.text.estimate import FittedEstimate, Verdict
from fitting.text.notation import listed, settings_words


def identification_lines(found: Identification) -> list[str]:
    """What was found as lines of text.

    Args:
        found: what the data determine.
    """
    marked = found.synthetic and "synthetic" not in found.title.lower()
    kind = "measured data" if found.knowledge.data else "expected data"
    lines = [
        found.title + (" [synthetic]" if marked else ""),
        f"{kind}, set out from {found.at}",
        "",
    ]
    if found.knowledge.directions:  # the change along them is described below
        lines += text_lines(table("directions", knowledge=found.knowledge, tried=False))
    lines += ["", *knowledge_lines(found)]
    if found.part is None:
        return lines
    lines += ["", *part_sentences(found, found.part), ""]
    return lines + text_lines(table("part", whole=found, part=found.part))


def part_sentences(whole: Values, part: PartAlone) -> tuple[str, ...]:
    """What a part of the measurements determines alone, and what all of them determine beyond it.

    Args:
        whole: what all determine.
        part: what some of them determine.
    """
    where = settings_words(part.settings)
    before, after = _determined(part), _determined(whole)
    more, fewer = [n for n in after if n not in before], [n for n in before if n not in after]
    said = [
        f"Measured at {where} ({part.places} of {part.total} places) alone: "
        f"{listed(before.values()) or 'nothing'} determined.",
        f"All {part.total} places together determine {listed(after[n] for n in more)} beyond that."
        if more
        else f"All {part.total} places together determine nothing beyond that.",
    ]
    said += _open_sentences(part)
    if fewer:
        said.append(f"With all of them {listed(fewer)} is no longer determined.")
    return tuple(said)


def _determined(found: Values) -> dict[str, str]:
    """What is determined, by name: the name with the box that this rests on, if it does."""
    values = found.profiled
    return {n: f"{n}{p.condition}" for n, p in values.items() if p.status is Verdict.DETERMINED}


def _open_sentences(part: PartAlone) -> list[str]:
    """Why the rest is not determined by a part alone: what fits, or what was not searched."""
    values = part.profiled
    free = [n for n, p in values.items() if p.closed_by == ("bound", "bound")]
    near = [n for n, p in values.items() if p.status is Verdict.OPEN and _is_cut(p)]
    cut = [n for n, p in values.items() if "cost" in p.closed_by and n not in near]
    lost = [n for n, p in values.items() if "lost" in p.closed_by and n not in (*cut, *near)]
    said = []
    if free:
        said.append(
            f"Both ends of the range of {listed(free)} fit there, with the others adapted: these "
            "places alone do not see them."
        )
    if near:
        said.append(
            f"Values close to both ends of the range of {listed(near)} fit there, with the others "
            "adapted: these places alone do not see them."
        )
    if cut:
        said.append(
            f"For {listed(cut)} the search was cut for its cost: a larger --budget would tell."
        )
    if lost:
        said.append(f"For {listed(lost)} the search lost its way: nothing is said of them.")
    return said


def _is_cut(value: FittedEstimate) -> bool:
    return "cost" in value.closed_by or "lost" in value.closed_by
