"""What was counted of hidden laboratories: a row per kind, and every false statement."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from scipy.stats import binom

from tests.support.hidden.judge import DETERMINED, FAR, Judged, Said

INSIDE = 0.95
HEAD = (
    "kind",
    "laboratories (wrong on purpose)",
    "exit codes",
    "determined values",
    "beyond 4 errors",
    "95 % intervals that hold the truth",
    "one of each laboratory: p",
    "no interval",
    "wrong models: refused, noise named, described",
    "causes named",
    "false statements",
    "runs of the native twin",
    "processor time, s",
)


def table(done: Sequence[Judged]) -> Iterator[str]:
    """Markdown: a row per kind, and one of all.

    Args:
        done: judged laboratories.
    """
    yield f"| {' | '.join(HEAD)} |"
    yield "|" + "---|" * len(HEAD)
    kinds = list(dict.fromkeys(one.kind for one in done))
    for kind in kinds:
        yield _row(kind, [one for one in done if one.kind == kind])
    if len(kinds) > 1:
        yield _row("all", done)


def _row(name: str, done: Sequence[Judged]) -> str:
    wrong = [one for one in done if one.mistake]
    right = [one for one in done if not one.mistake or _is_noise(one)]
    said = [s for one in right for s in one.said]
    judged = [s for s in said if s.is_judged]
    one_each = [s for one in right for s in _chosen(one)]
    held, each = sum(s.holds for s in judged), sum(s.holds for s in one_each)
    codes = Counter(one.code for one in done)
    false = Counter(sort for one in done for sort, _ in one.false)
    described = [one for one in wrong if one.code == 0 and not _is_noise(one)]
    cells = (
        name,
        f"{len(done)} ({len(wrong)})",
        ", ".join(f"{code}: {count}" for code, count in sorted(codes.items())),
        str(sum(s.verdict == DETERMINED for s in said)),
        str(sum(s.verdict == DETERMINED and s.pull > FAR for s in said)),
        f"{held} of {len(judged)}" + (f" ({100.0 * held / len(judged):.1f} %)" if judged else ""),
        f"{each} of {len(one_each)}: {binom.cdf(each, len(one_each), INSIDE):.2g}",
        str(sum(not one.said or not any(s.is_judged for s in one.said) for one in right)),
        f"{sum(one.code == 4 for one in wrong)}, "
        f"{sum(_is_noise(one) and one.code == 0 for one in wrong)}, {len(described)}",
        str(sum("cause named" in one.notes for one in wrong)),
        ", ".join(f"{sort}: {count}" for sort, count in false.items()) or "0",
        f"{sum(one.runs for one in done):,}",
        f"{sum(one.processor_s for one in done):.0f}",
    )
    return f"| {' | '.join(cells)} |"


def _is_noise(one: Judged) -> bool:
    """Whether the model is right and only its noise was stated wrongly."""
    return one.mistake.startswith("noise stated")


def _chosen(one: Judged) -> Sequence[Said]:
    """One quantity of a laboratory, which its seed chooses before anything is known of it."""
    if not one.said:
        return ()
    chosen = one.said[one.seed % len(one.said)]
    return (chosen,) if chosen.is_judged else ()


def listed(done: Sequence[Judged], again: str) -> Iterator[str]:
    """Every false statement, and every determined value that is far off for a wrong model.

    Args:
        done: judged laboratories.
        again: the command that makes one of them again, with KIND and SEED.
    """
    for one in done:
        words = f"{one.kind} {one.seed} ({one.variant}{', ' if one.mistake else ''}{one.mistake})"
        for sort, sentence in one.false:
            yield f"- **{sort}**, {words}: {sentence}"
        for note in one.notes:
            if note.startswith("beyond"):
                far = [s for s in one.said if s.verdict == DETERMINED and s.pull > FAR]
                values = ", ".join(f"{s.name} by {s.pull:.3g} errors" for s in far)
                yield f"- {note}, {words}: {values} ({', '.join(one.findings) or 'no finding'})"
    if any(one.false for one in done):
        yield f"\nAgain, one by one: `{again}`"


def shown(one: Judged) -> Iterator[str]:
    """Everything that was said of a laboratory, beside the truth.

    Args:
        one: judged laboratory.
    """
    yield (
        f"{one.kind} {one.seed}, {one.variant}, {one.mistake or 'right'}: exit code {one.code}, "
        f"{one.status}, {one.runs} runs, {one.processor_s:.1f} s, structure {one.seen[0]:.3g} of "
        f"chi square per row, {100.0 * one.seen[1]:.2g} % of the largest amplitude"
    )
    for s in one.said:
        yield (
            f"  {s.name:12} {s.verdict:24} {s.value:.9g} ± {s.side:.2g} in [{s.low:.9g}, "
            f"{s.high:.9g}], truth {s.truth:.9g}{'' if s.holds else ' OUTSIDE'}"
        )
    yield from (f"  finding {words}" for words in one.findings)
    yield from (f"  ! {words}" for words in one.warnings)
    yield from (f"  FALSE {sort}: {words}" for sort, words in one.false)
