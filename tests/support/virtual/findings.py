"""What is false in the statements on a laboratory, and how often: findings and their statistics."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tests.support.virtual.judge import (
    ALARM,
    CONTRADICTED,
    DETERMINED,
    HELD,
    NAMED,
    OPEN,
    TWINS,
    WORSE,
    Judged,
    Statement,
    fits,
)

#: Verdicts that say nothing of a value: the search was lost, the model does not describe the data.
SILENT = {"not known", "no verdict"}
#: What one pair of peaks cannot determine.
UNSEEN = ("theta", "d1", "d2", "g1")


@dataclass(frozen=True)
class Finding:
    """A false statement: what it is about, of which laboratory, in a sentence."""

    about: str
    kind: str
    seed: int
    sentence: str


def findings(judged: Judged) -> Iterator[Finding]:
    """Every false statement on one laboratory.

    Where the campaign does not describe what was done, a statement is false only where nothing
    warns of it.
    """
    if judged.error:
        yield Finding("failed", judged.kind, judged.seed, judged.error)
        return
    for about, sentence in _false(judged):
        yield Finding(about, judged.kind, judged.seed, sentence)


def _false(judged: Judged) -> Iterator[tuple[str, str]]:
    warned = not CONTRADICTED.isdisjoint(judged.kinds)
    said = {s.name: s for s in judged.said}
    for s in judged.said:
        yield from _of_value(judged, s, warned=warned)
    for one, other in TWINS:
        if one in said and other in said and said[one].verdict != _mirrored(said[other].verdict):
            yield (
                "twins",
                f"{one} {said[one].verdict}, {other} {said[other].verdict}",
            )
    if judged.honest:
        yield from _wrong_minima(judged)
        if warned and fits(judged):
            named = ", ".join(kind for kind in judged.kinds if kind in CONTRADICTED)
            yield "contradicts", f"the truth fits, but: {named}"
        for kind in judged.kinds:
            if kind in ALARM:
                yield "false alarm", f"no such mistake was made: {kind}"
    if judged.fault and not NAMED[judged.fault].intersection(judged.kinds):
        yield "not named", f"{judged.fault} is not named by its kind"


def _mirrored(verdict: str) -> str:
    """The word for Q = f/width that goes with one for the width: a bound from the other side."""
    return {"bounded above": "bounded below", "bounded below": "bounded above"}.get(
        verdict, verdict
    )


def _wrong_minima(judged: Judged) -> Iterator[tuple[str, str]]:
    """Ends of the fit and lowest points of the profiles that are less likely than the truth."""
    for about, end, bottom in (
        ("minimum", judged.chi2_end, judged.chi2_fit),
        ("optimum", judged.chi2_best, judged.chi2_profile),
    ):
        what = "fit ends" if about == "minimum" else "profiles are"
        if bottom - judged.chi2_truth > WORSE:
            away = bottom - judged.chi2_truth
            yield f"wrong {about}", f"{what} {away:.4g} above chi square of the truth"
        elif end - judged.chi2_truth > WORSE:
            yield f"short of {about}", f"{what} {end - bottom:.4g} above a minimum beside"


def _of_value(judged: Judged, s: Statement, *, warned: bool) -> Iterator[tuple[str, str]]:
    shown = f"{s.name} {s.verdict}: {s.value:.7g} ± {s.std:.2g} in [{s.low:.7g}, {s.high:.7g}]"
    shown += f", truth {s.truth:.7g}"
    if s.verdict == OPEN:
        if judged.honest and _held(s) and not _uncoupled(judged):
            yield "absent", f"{shown}; the data hold it to {100 * s.bound / abs(s.truth):.2g} %"
        return
    if math.isfinite(s.value) and s.name != "theta":
        margin = 1e-9 * max(abs(s.low), abs(s.high))
        if not s.low - margin <= s.value <= s.high + margin:
            yield "outside its interval", shown
    far = not s.holds and math.isfinite(s.truth)
    if far and s.verdict == DETERMINED and (judged.honest or not warned):
        sigma = max(s.high - s.low, 1e-300) / 3.92
        away = max(s.low - s.truth, s.truth - s.high) / sigma
        yield f"truth {'far ' if away > 2.0 else ''}outside", f"{shown} ({away:.2g} sigma beyond)"
    if judged.kind == "one_pair" and s.verdict == DETERMINED and s.name in UNSEEN:
        yield "determined by two peaks", shown
    wide = judged.wide.get(s.name)
    if _changed(judged, s) and not s.conditional:
        about = "nothing said in one box" if _says_nothing(judged, s) else "changed by the box"
        yield about, f"{s.name}: {s.verdict}, with boxes 10 times as wide {wide}"


def _changed(judged: Judged, s: Statement) -> bool:
    """Whether boxes ten times as wide gave another verdict."""
    wide = judged.wide.get(s.name)
    return wide is not None and wide != s.verdict and s.name != "theta"


def _says_nothing(judged: Judged, s: Statement) -> bool:
    """Whether one of both fits says of itself that it knows nothing of a value."""
    return bool({s.verdict, judged.wide.get(s.name)} & SILENT)


def _held(s: Statement) -> bool:
    """Whether the data hold a value to a few per cent, and far inside what is left open.

    An angle, and frequencies that two others enclose, are known to a few per cent without data.
    """
    inside = 3.92 * s.bound < 0.1 * (s.high - s.low)
    return s.name != "theta" and s.bound < HELD * abs(s.truth) and inside


def _uncoupled(judged: Judged) -> bool:
    """Whether lambda is zero: the slopes at the truth then vanish, and their bound says nothing."""
    return any(s.name == "lambda" and not abs(s.truth) > 0.0 for s in judged.said)


COLUMNS = (
    "kind",
    "laboratories",
    "failed",
    "determined",
    "95 % interval holds the truth",
    "value outside its interval",
    "value ± std holds the truth",
    "verdict changed by wider boxes: untold, told before, nothing said in one",
    "Q and width differ",
    "wrong minimum: fit, profiles",
    "not at their minimum: fit, profiles",
    "“contradict” where the truth fits",
    "mistake named that was not made",
    "absent, but held (λ)",
    "seconds",
)


def table(records: Sequence[Judged]) -> list[str]:
    """Rows of a Markdown table, a kind each; faults are `faults_table`."""
    rows = [f"| {' | '.join(COLUMNS)} |", "|" + "---|" * len(COLUMNS)]
    for kind in dict.fromkeys(j.kind for j in records):
        rows.append(_row(kind, [j for j in records if j.kind == kind]))
    return rows


def _row(kind: str, mine: Sequence[Judged]) -> str:
    found = [f for j in mine for f in findings(j)]
    done = [j for j in mine if not j.error]
    right = [j for j in done if j.honest]
    # what does not depend on the unknowns is known without data
    known = [s for j in right for s in j.said if math.isfinite(s.truth) and s.high > s.low]
    values = [s for s in known if s.verdict == DETERMINED]
    inside = sum(s.holds for s in values)
    errors = [s for s in values if s.std > 0.0 and math.isfinite(s.value)]
    near = sum(abs(s.value - s.truth) <= s.std for s in errors if s.name != "theta")
    plain = sum(s.name != "theta" for s in errors)
    widened = sum(bool(j.wide) for j in done)
    told = sum(_changed(j, s) and s.conditional for j in done for s in j.said)
    absent = [f for f in found if f.about == "absent"]

    def count(*about: str) -> int:
        return len({(f.seed, f.sentence) for f in found if f.about in about})

    cells = [
        kind,
        len(mine),
        count("failed"),
        sum(s.verdict == DETERMINED for j in done for s in j.said),
        _share(inside, len(values)),
        count("outside its interval"),
        _share(near, plain),
        f"{count('changed by the box')}, {told}, {count('nothing said in one box')} in {widened}",
        count("twins"),
        f"{count('wrong minimum')}, {count('wrong optimum')}",
        f"{count('short of minimum')}, {count('short of optimum')}",
        count("contradicts"),
        count("false alarm"),
        f"{count('absent')} ({sum(f.sentence.startswith('lambda') for f in absent)})",
        f"{np.median([j.seconds for j in mine]):.1f}",
    ]
    return f"| {' | '.join(map(str, cells))} |"


def _share(part: int, whole: int) -> str:
    return f"{part}/{whole} = {100.0 * part / whole:.1f} %" if whole else "–"


def faults_table(records: Sequence[Judged]) -> list[str]:
    """Rows of a Markdown table: mistakes by kind, how often named, warned of, wrong in silence."""
    rows = ["| mistake | laboratories | named by its kind | warned of | wrong and silent |"]
    rows.append("|---|---|---|---|---|")
    faulty = [j for j in records if j.fault]
    for fault in dict.fromkeys(j.fault for j in faulty):
        mine = [j for j in faulty if j.fault == fault]
        done = [j for j in mine if not j.error]
        named = sum(bool(NAMED[fault].intersection(j.kinds)) for j in mine)
        warned = sum(not CONTRADICTED.isdisjoint(j.kinds) for j in done)
        silent = sum(any(f.about.startswith("truth") for f in findings(j)) for j in done)
        rows.append(f"| {fault} | {len(mine)} | {named} | {warned} | {silent} |")
    return rows


def counted(found: Sequence[Finding]) -> Mapping[str, int]:
    """How many findings of each sort."""
    sorts = sorted({f.about for f in found})
    return {about: sum(f.about == about for f in found) for about in sorts}
