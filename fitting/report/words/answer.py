"""The answer first: what is known, what is not, and what would settle it."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace

from fitting.inference.budget import BUDGET
from fitting.inference.conditions import is_condition, resting_of, taken_of
from fitting.inference.ending import CONTRADICTED
from fitting.inference.estimates import UNPROFILED
from fitting.inference.likelihood.knowledge import UNDESCRIBED
from fitting.inference.mistakes import FAR_OFF, SLIPPED
from fitting.inference.sampled_twins import SAMPLED
from fitting.inference.sweep_line import SweepLine, depends_on_background
from fitting.inference.values import DerivedResult, ParameterResult
from fitting.inference.verdict import Verdict
from fitting.report.table import wrapped
from fitting.report.words.assumptions import assumption_sentences, combination_sentences
from fitting.report.words.values import period_words, reported_words, told_twice
from fitting.result.result import Result
from fitting.signal.residual_tests import TOGETHER, UNEQUAL
from fitting.text.notation import bound, listed, number, prefixed, quantity, span, unit_text

Found = ParameterResult | DerivedResult

#: Said once of every error, interval and percentage.
CONVENTION = "± holds 68 %, intervals hold 95 %; “determined to” names half of a 95 % interval."
#: Said in its place where the error of a value differs from side to side.
CONVENTION_UNEVEN = CONVENTION.replace("± holds", "±, and + with −, hold")
#: Of a result that is written before the profiles are done, and stands where they never are.
NO_PROFILES = f"The command ended before the profiles were done: {UNPROFILED}."
#: The same of a budget that was spent before there was any.
CUT_SHORT = (
    "The profiles were cut for their cost before there was any: a larger --budget would tell. "
    f"{UNPROFILED[:1].upper()}{UNPROFILED[1:]}."
)
#: What a value is known by that its line knows better than the fit.
BY_SWEEP = "sweep alone"
#: Value and standard deviation of a line, by what it is of the line.
PARTS = {
    "frequency": lambda line: (line.frequency_hz, line.frequency_std_hz),
    "width": lambda line: (line.width_hz, line.width_std_hz),
    "q": lambda line: (line.q, line.q_std),
}
#: Standard errors from which sweep and fit are no two measurements of one value.
APART_SIGMA = 3.0
#: Ends of a range this far apart have a unit each.
WIDE, WIDEST = 1e-3, 1e-4
#: Share of the largest relative error from which another counts as large.
SAME = 0.99
#: Columns before what is known.
LEAD = len("not known: ")
#: Times as large a budget is asked for where one cut a search.
MORE = 10
#: Length from which what is known of a value may be broken over lines.
LONGEST = 60


@dataclass(frozen=True)
class Known:
    """One value that is known: `shown` with its error or bounds; `fitted`: what the fit says of it.

    `fitted` is empty unless the sweep by itself knows it better; `others` are names of the same
    number; `is_even`: its error is ±, or it has none. `beyond`: which number to believe where it
    lies beyond its box, mostly empty. `source` is what it is known by, or the box in which the fit
    knows it; empty: by the fit, wherever its box ends.
    """

    name: str
    shown: str
    _: KW_ONLY
    others: tuple[str, ...] = ()
    share: float
    fitted: str = ""
    apart: float = math.nan
    is_even: bool = True
    beyond: str = ""
    source: str = ""

    @property
    def told(self) -> str:
        """What is known of it, and by what or in which box: "= 94.2 Hz (sweep alone)"."""
        return f"{self.shown} ({self.source})" if self.source else self.shown

    @property
    def named(self) -> str:
        """All its names: "f1 = eta1"."""
        return " = ".join((self.name, *self.others))


@dataclass(frozen=True)
class Answer:
    """What is known, best first; what is not, with its range; what would settle it.

    `command` is what to type for it, empty where there is no such command. `condition` is what some
    of the known values hold under, which the data do not tell; mostly empty. `sweep` is what the
    sweep alone tells where the model does not describe the data; else empty. `assumed` are
    sentences on what the campaign takes for granted, `together` on what is known in combination.
    """

    known: tuple[Known, ...]
    open: tuple[str, ...]
    advice: str
    command: str = ""
    condition: str = ""
    sweep: str = ""
    assumed: tuple[str, ...] = ()
    together: tuple[str, ...] = ()

    @property
    def resting(self) -> tuple[Known, ...]:
        """What is known under the condition alone."""
        names = resting_of(self.condition) if self.condition else ()
        return tuple(each for each in self.known if each.name in names)

    @property
    def by_data(self) -> tuple[Known, ...]:
        """What the data say by themselves."""
        resting = self.resting
        return tuple(each for each in self.known if each not in resting)

    @property
    def nothing(self) -> str:
        """What is said where the data say nothing by themselves."""
        if self.sweep:
            return f"nothing by the model; {self.sweep}"
        return "nothing but what is given below" if self.resting else "nothing"

    @property
    def open_words(self) -> str:
        """All that is not known, in a line."""
        return ", ".join(self.open) or "nothing that was asked for"

    @property
    def notes(self) -> tuple[str, ...]:
        """Which number to believe, why one stands here that is not the fit's, and what ± means."""
        better = [k for k in self.known if k.fitted]
        convention = CONVENTION if all(k.is_even for k in self.known) else CONVENTION_UNEVEN
        beyond = tuple(k.beyond for k in self.known if k.beyond)
        if not better:
            return (*beyond, convention)
        names, fitted = listed(k.name for k in better), listed(k.fitted for k in better)
        verb = "is" if len(better) == 1 else "are"
        away = max(k.apart for k in better)
        far = "" if math.isnan(away) else f", {number(away, 2)} standard errors away"
        return (
            *beyond,
            f"{names} {verb} best known by the line of the sweep alone. The fit of the peaks, "
            f"which the table gives, says {fitted}{far}: it takes the scale from the sweep and "
            'nothing else (use = "fit" under [sweep] would fit both together).',
            convention,
        )


def answer_of(result: Result) -> Answer:
    """The answer of a reconstruction.

    Args:
        result: of a reconstruction.
    """
    every: dict[str, Found] = {**result.parameters, **result.derived}
    twice = told_twice(result)
    every = {name: found for name, found in every.items() if name not in twice}
    known = [_known(name, found, result.line) for name, found in every.items()]
    known = [k and replace(k, others=_others(k.name, twice)) for k in known]
    if result.status == "converged":  # of another fit nobody knows what the data say
        known = [k and _with_box(k, every[k.name]) for k in known]
    best = sorted((k for k in known if k is not None), key=lambda k: k.share)
    names = {k.name for k in best}
    left = {name: found for name, found in every.items() if name not in names}
    advice, command = _next(result, left)
    condition = next(filter(is_condition, result.warnings), "")
    return Answer(
        known=tuple(best),
        open=_ranges(left, _why_not(result)),
        advice=advice,
        command=command,
        condition=condition,
        sweep=_by_the_sweep(result),
        assumed=assumption_sentences(result),
        together=combination_sentences(result),
    )


def answer_lines(answer: Answer) -> list[str]:
    """The answer as a terminal shows it.

    Args:
        answer: of a reconstruction.
    """
    lines = wrapped(f"known:     {_values(answer.by_data) or answer.nothing}", LEAD)
    if answer.condition:
        values = f"{_values(answer.resting)}. " if answer.resting else ""
        lines += wrapped(f"given:     {values}{answer.condition}", LEAD)
    lines += wrapped(f"not known: {answer.open_words}", LEAD)
    lines += [line for said in answer.together for line in wrapped(f"together:  {said}", LEAD)]
    lines += wrapped(f"next:      {answer.advice}", LEAD) if answer.advice else []
    if answer.command:  # in one line: it is to be copied
        lines.append(f"{' ' * LEAD if answer.advice else 'next:      '}{answer.command}")
    for k, said in enumerate(answer.assumed):
        lines += wrapped(f"{'assumed:' if k == 0 else '':{LEAD}}{said}", LEAD)
    return [*lines, "", *(line for said in answer.notes for line in wrapped(said))]


def _values(known: Sequence[Known]) -> str:
    return ", ".join(_whole(f"{k.named} {k.told}") for k in known)


def _whole(text: str) -> str:
    """A name with what is known of it, so that no line breaks it; unless that is a sentence."""
    return text.replace(" ", "\u00a0") if len(text) <= LONGEST else text


def _others(name: str, twice: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(other for other, first in twice.items() if first == name)


def _known(name: str, found: Found, line: SweepLine | None) -> Known | None:
    """A value that is known, by the sweep's line where that knows it better; else None."""
    verdict = found.identifiable
    own = reported_words(found)
    better = by_line(name, found, line)
    if better is not None:
        value, std = better
        fitted, apart, is_even = "", math.nan, True
        if verdict.has_value:
            fitted, apart = own, abs(found.likely - value) / math.hypot(std, found.std)
            is_even = found.bars.is_even
        shown, share = f"= {quantity(value, std, found.unit)}", _share(value, std)
        return Known(
            name,
            shown,
            share=share,
            fitted=fitted,
            apart=apart,
            is_even=is_even,
            source=BY_SWEEP,
        )
    if verdict is Verdict.DETERMINED:
        share = _share(found.value, found.std)
        if not math.isnan(_box_end(found)):  # what Algorithm 2 says is the end of the box
            own = found.likely_words
        return Known(
            name,
            f"= {own}",
            share=share,
            is_even=found.bars.is_even,
            source=found.condition.strip(),
        )
    words = {
        Verdict.BOUNDED: f"between {_range(*found.ci95, found.unit).replace(' to ', ' and ')}",
        Verdict.ABOVE: f"at most {_one(found.ci95[1], found.unit, up=True)}",
        Verdict.BELOW: f"at least {_one(found.ci95[0], found.unit, up=False)}",
    }
    if verdict not in words:
        return None
    return Known(name, words[verdict], share=math.inf, source=found.condition.strip())


def _with_box(known: Known, found: Found) -> Known:
    """The same; of a value beyond its box where the box ends, and which number to believe."""
    end = _box_end(found)
    if math.isnan(end):
        return known
    ended, stopped = (_shown(value, found.unit) for value in (end, found.algorithm2))
    return replace(
        known,
        shown=f"{known.shown} (beyond its box, which ends at {ended})",
        beyond=(
            f"{known.name}: believe what stands here, {known.shown.removeprefix('= ')}. The data "
            f"say it, wherever the box ends. J, deviations and figures of the data are those of "
            f"{stopped} instead, where Algorithm 2 ended in the box; a wider box mends them."
        ),
    )


def _box_end(found: Found) -> float:
    """The end of the box beyond which a value lies; NaN: it lies in the box, or has none."""
    return found.box_end if isinstance(found, ParameterResult) else math.nan


def _shown(value: float, unit: str) -> str:
    factor, shown = prefixed(abs(value), unit)
    return f"{number(value / factor, 5)}\u00a0{shown}".strip()


def by_line(name: str, found: Found, line: SweepLine | None) -> tuple[float, float] | None:
    """Value and error of the sweep's line, where they are of this value and the better ones.

    Args:
        name: of the value.
        found: what the fit says of it.
        line: that the sweep shows by itself.
    """
    if line is None or name not in line.values or depends_on_background(line):
        return None
    value, std = PARTS[line.values[name]](line)
    if not (math.isfinite(value) and std > 0.0) or found.identifiable is Verdict.WITHDRAWN:
        return None
    if not found.identifiable.has_value or math.isnan(found.std):
        return value, std
    near = abs(found.likely - value) <= APART_SIGMA * math.hypot(std, found.std)
    return (value, std) if std < found.std and near else None


def _by_the_sweep(result: Result) -> str:
    """What the line of the sweep is where the model does not describe the other data; mostly empty.

    Not where the sweep may be what is wrong: then its line is not known, either.
    """
    line, knowledge = result.line, result.knowledge
    if line is None or knowledge is None or not (line.values and line.width_std_hz > 0.0):
        return ""
    values: list[Found] = [*result.parameters.values(), *result.derived.values()]
    adequacy = knowledge.adequacy
    doubtful = adequacy.against or adequacy.absent or adequacy.scale_off > 1.0
    if doubtful or depends_on_background(line) or _mistake(result):
        return ""
    if not all(found.identifiable is Verdict.WITHDRAWN for found in values):
        return ""
    width = quantity(line.width_hz, line.width_std_hz, "Hz")
    return f"the line of the sweep alone is {width} wide"


def _share(value: float, std: float) -> float:
    return std / abs(value) if value and math.isfinite(std) else math.inf


def _why_not(result: Result) -> str:
    """Why no verdict is given where the model does not describe the data."""
    if result.knowledge is None:
        return UNDESCRIBED
    return result.knowledge.adequacy.why_not


def _ranges(left: dict[str, Found], why_not: str) -> tuple[str, ...]:
    """What is not known, those of one range together: "d1 and d2 (1 Hz to 1 kHz)"."""
    groups: dict[str, list[str]] = {}
    for name, found in left.items():
        groups.setdefault(_open_words(found, why_not), []).append(name)
    return tuple(f"{listed(names)} ({words})" for words, names in groups.items())


def _open_words(found: Found, why_not: str) -> str:
    if found.identifiable is Verdict.OPEN and found.is_all_round:
        return f"may be anything: {period_words(found)} fits"
    if found.identifiable is Verdict.OPEN:
        return _range(*found.ci95, found.unit)
    if found.identifiable is Verdict.LINEARISED:
        return f"{reported_words(found)} by its linearised error alone: no profile was walked"
    if found.identifiable is Verdict.WITHDRAWN:
        return found.reason or why_not
    return found.reason or str(found.identifiable)


def _range(low: float, high: float, unit: str) -> str:
    """An interval; ends far apart have a unit each: "1 Hz to 1 kHz"."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return "any value"
    if unit and 0.0 < WIDEST * high <= low <= WIDE * high:
        return f"{_one(low, unit, up=False)} to {_one(high, unit, up=True)}"
    if not unit_text(unit):
        return f"{bound(low, 3, up=False)} to {bound(high, 3, up=True)}"
    factor, shown = prefixed(max(abs(low), abs(high)), unit)
    if high - low < WIDE * factor:
        factor, shown = 1.0, unit
    return span(low / factor, high / factor, shown)


def _one(value: float, unit: str, *, up: bool) -> str:
    """A bound of three digits, with a prefix that suits it."""
    factor, shown = prefixed(abs(float(f"{value:.3g}")), unit)
    return f"{bound(value / factor, 3, up=up)}\u00a0{shown}".strip()


def _otherwise(result: Result) -> str:
    """What may describe data that the model does not."""
    adequacy = None if result.knowledge is None else result.knowledge.adequacy
    against = "" if adequacy is None else adequacy.against
    if adequacy is not None and adequacy.scale_off > 1.0:
        return 'a sweep whose top is that of a line, or scale = "free"'
    if adequacy is not None and adequacy.absent:
        return "a stronger drive, more averaging, or points about the lines"
    if adequacy is not None and adequacy.remedy:
        return f"{adequacy.remedy}, as {against} describes the data better"
    if against:
        return f"another model, or phases, as {against} describes the data better"
    if adequacy is not None and adequacy.is_correlated:
        return "another model: the residuals are correlated, which no noise explains"
    return "more data, another model, or the noise that the data have"


def _next(result: Result, left: dict[str, Found]) -> tuple[str, str]:
    """What to do next, in words and as a command."""
    if result.status == "interrupted":
        return "the rest of this job: the same command with --resume", ""
    mistake = _mistake(result)
    if mistake:
        return mistake, ""
    if result.status == "not converged":
        return "a start nearer to the solution, or more starts (--starts N)", ""
    if result.status != "converged":
        return _otherwise(result), ""
    if result.ending.words == CONTRADICTED:
        return "what changed between the campaigns, or which is wrong: a fit of each by itself", ""
    wider = _wider(result)
    if wider:
        return wider, ""
    if result.knowledge is None:
        return _profiles(result)
    return _measurement(result, left)


def _wider(result: Result) -> str:
    """Which boxes are to be wider, as the data want a value beyond them; mostly empty."""
    out = {n: p for n, p in result.parameters.items() if not math.isnan(p.box_end)}
    told = [
        f"{name} that holds {_shown(p.likely, p.unit)}, with room (it ends at "
        f"{_shown(p.box_end, p.unit)})"
        for name, p in out.items()
    ]
    return f"a box of {listed(told)}" if told else ""


def _measurement(result: Result, left: dict[str, Found]) -> tuple[str, str]:
    """What to measure next, of a fit that is as good as it can be."""
    assert result.knowledge is not None  # noqa: S101 - asked by the caller
    if any(said.startswith(SAMPLED) for said in result.knowledge.sentences):
        return "a box that holds one of the values that the samples leave, or faster samples", ""
    condition = next(filter(is_condition, result.warnings), "")
    if condition:
        return (
            f"what tells {taken_of(condition)}: a measurement of it, or the same sample driven or "
            "read elsewhere; of coupled modes spectra over what moves one of them alone (a map); "
            "less noise would not",
            "",
        )
    target = _target(result, left)
    if not target:
        return "", ""
    left = {target: left[target]} if target in left else {}
    if left and "cost" in result.knowledge.profiles[target].ends:
        return _more_budget(result)
    head = "" if left else f"{target} is known least; for a better value"
    if not (left or result.peaks) and TOGETHER in result.ending.ground:
        return (
            "what the residuals still hold, which is not noise: a background, or another model",
            "",
        )
    if not (left or result.peaks) and UNEQUAL in result.ending.ground:
        return f"{head}: less noise, or [noise] relative where it grows with the amplitude", ""
    if not (left or result.peaks):
        return f"{head}: less noise, or more points where the model depends on it", ""
    command = _design_command(result, target)
    if not command:
        return f'{head or "which measurement settles it"}: ff.design, target "{target}"', ""
    return f"{head}:" if head else "", command


def _mistake(result: Result) -> str:
    """What to put right before anything else, where the data show it; mostly empty."""
    warnings = " ".join(result.warnings)
    if SLIPPED in warnings:
        return "a box that holds the line: its unit, or that of the file's frequencies"
    if result.status != "converged" and FAR_OFF in warnings:
        return "the file without the single point far off its neighbours"
    return ""


def _profiles(result: Result) -> tuple[str, str]:
    """That profiles come next: by the same command with them, from Python by their function.

    Where the command ended before they were done, it goes on from the levels that it has kept.
    """
    words, _ = _without_budget(result)
    if not words:
        return "profiles, which say what the data determine: ff.profile", ""
    if "--no-profiles" not in words and CUT_SHORT not in result.warnings:
        every = shlex.split(result.provenance.command)
        kept = [*(word for word in every if word != "--resume"), "--resume"]
        return "the profiles, which were not done:", shlex.join(kept)
    kept = [word for word in words if word != "--no-profiles"]
    return "profiles, which say what the data determine:", shlex.join(kept)


def _more_budget(result: Result) -> tuple[str, str]:
    """What was cut for its cost comes next: the same with ten times the budget, or the usual."""
    words, budget = _without_budget(result)
    if not words:
        return "the rest of the search, which was cut for its cost: ff.profile, a larger budget", ""
    if budget is None:  # the usual one, which it has spent
        spent = 0 if result.knowledge is None else result.knowledge.effort.fmu_runs
        budget = max(BUDGET, spent)
    more = words if MORE * budget <= BUDGET else [*words, "--budget", str(MORE * budget)]
    return "the rest of the search, which was cut for its cost:", shlex.join(more)


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


def _target(result: Result, left: dict[str, Found]) -> str:
    """What is to be known next: the first output that is open, else parameter; the worst known.

    What a measurement brings along, as a cable's delay, nobody has asked for.
    """
    asked = {name: p for name, p in result.parameters.items() if p.asked}
    for group in (result.derived, asked):
        for name in group:
            if name in left:
                return name
    every: dict[str, Found] = {**asked, **result.derived}
    shares = {n: _share(f.value, f.std) for n, f in every.items() if math.isfinite(f.std)}
    worst = max(shares.values(), default=math.nan)
    return next((name for name, share in shares.items() if share >= SAME * worst), "")


def _design_command(result: Result, target: str) -> str:
    """`fmu-fit design` for the campaigns of a `fmu-fit reconstruct`; empty where it was no such."""
    words = shlex.split(result.provenance.command)
    if words[:2] != ["fmu-fit", "reconstruct"]:
        return ""
    campaigns = _before_options(words[2:])
    made = ["fmu-fit", "design", *campaigns]
    if "--out" in words[:-1]:
        made += ["--at", f"{words[words.index('--out') + 1]}/result.json"]
    return shlex.join([*made, "--target", target])


def _before_options(words: Sequence[str]) -> list[str]:
    count = next((k for k, word in enumerate(words) if word.startswith("--")), len(words))
    return list(words[:count])
