"""What a command says of a hidden laboratory, held against what is true of it."""

from __future__ import annotations

import csv
import json
import math
import os
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fitting.signal.misfit import TESTABLE
from fitting.text.estimate import ROOT_95, error_bars
from tests.support.hidden.laboratory import Laboratory, Values
from tests.support.in_process import told

DETERMINED, SEVERAL = "determined", "one of several values"
#: Verdicts with an interval that says something of the truth.
JUDGED = (DETERMINED, SEVERAL, "bounded on both sides", "bounded above", "bounded below")
#: Verdicts with a value.
VALUED = (DETERMINED, SEVERAL, "bounded on both sides")
#: Findings that name a mistake; "correlated_residuals" says only that there is one.
NAMING = frozenset(
    [
        "noise_underestimated",
        "outlier",
        "contradiction",
        "gain",
        "offset",
        "shift",
        "noise_level",
        "drift_exchanged",
    ]
)
#: Standard deviations of the noise that hide what a mistake does to one point.
HIDDEN = 3.0
CODES = (0, 1, 4)
FAR = 4.0
#: Structured share above which the rule gives up a model, with room for what noise adds or takes
#: off; chi square of the structure per row that every test of structure sees.
SHARE, SEEN = 0.06, 1.0
#: Chi square of the structure per row below which no test sees it; of noise factors, the room.
UNSEEN, FACTOR = 0.05, 1.3


@dataclass(frozen=True, kw_only=True)
class Said:
    """What was said of one value, and its truth."""

    name: str
    verdict: str
    value: float
    std: float
    low: float
    high: float
    truth: float
    side: float

    @property
    def pull(self) -> float:
        """Distance of the truth over the printed error on its side."""
        return abs(self.value - self.truth) / self.side if self.side > 0.0 else math.nan

    @property
    def holds(self) -> bool:
        """Whether the 95 % interval holds the truth."""
        return self.low <= self.truth <= self.high

    @property
    def is_judged(self) -> bool:
        """Whether its interval counts for coverage."""
        return self.verdict in JUDGED


@dataclass(frozen=True, kw_only=True)
class Judged:
    """One laboratory as plain values: what a line of the record holds.

    Args:
        false: false statements, each with its sort.
        notes: what is no false statement, but to be counted.
        seen: what a fit of the data without noise leaves: chi square per row, share.
    """

    kind: str
    seed: int
    variant: str
    mistake: str
    code: int
    status: str
    said: tuple[Said, ...]
    findings: tuple[str, ...]
    warnings: tuple[str, ...]
    false: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    seen: tuple[float, float]
    runs: int
    processor_s: float
    error: str = ""


@dataclass(frozen=True, kw_only=True)
class _Answer:
    code: int
    result: Mapping[str, Any] = field(default_factory=dict)
    error: str = ""
    blank: tuple[str, ...] = ()


def judged(laboratory: Laboratory, fmu: Path) -> Judged:
    """Fit it by the command in this process, and judge every statement.

    Args:
        laboratory: which.
        fmu: of its model.
    """
    begun = sum(os.times()[:4])
    answer = _answered(laboratory, fmu)
    processor_s = sum(os.times()[:4]) - begun
    result = answer.result
    said = tuple(_said(laboratory, result)) if result else ()
    found = tuple(f"{f['kind']}: {f['subject']}" for f in result.get("findings", ()))
    visible = laboratory.visible if laboratory.mistake else None
    seen = (0.0, 0.0) if visible is None else (visible.square / visible.points, visible.share)
    return Judged(
        kind=laboratory.kind,
        seed=laboratory.seed,
        variant=laboratory.variant,
        mistake=laboratory.mistake,
        code=answer.code,
        status=str(result.get("status", "")),
        said=said,
        findings=found,
        warnings=tuple(result.get("warnings", ())),
        false=tuple(_false(laboratory, answer, said, seen)),
        notes=tuple(_notes(laboratory, answer, said)),
        seen=seen,
        runs=int(result.get("evaluations", {}).get("fmu_runs", 0)),
        processor_s=processor_s,
        error=answer.error,
    )


def _answered(laboratory: Laboratory, fmu: Path) -> _Answer:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = laboratory.write(folder / "campaign", fmu)
        out = folder / "out"
        options = ("--no-report", "--quiet", "--workers", "1", "--out", out)
        ended = told("reconstruct", *paths, *options)
        file = out / "result.json"
        if not file.exists():
            return _Answer(code=ended.code, error=(ended.err or ended.out)[-800:])
        result = json.loads(file.read_text(encoding="utf-8"))
        return _Answer(
            code=ended.code, result=result, error=ended.err[-800:], blank=tuple(_blank(out))
        )


def _blank(out: Path) -> Iterator[str]:
    """Values that values.csv calls determined without a number or an error."""
    file = out / "values.csv"
    if not file.exists():
        return
    with file.open(encoding="utf-8", newline="") as stream:
        for row in csv.DictReader(stream):
            if DETERMINED not in row.values():
                continue
            for column, cell in row.items():
                wanted = column in ("value", "std", "ci95_low", "ci95_high")
                if wanted and (cell or "nan").strip().lower() == "nan":
                    yield f"{next(iter(row.values()))}: no {column} in values.csv"


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float | str) else math.nan


def _said(laboratory: Laboratory, result: Mapping[str, Any]) -> Iterator[Said]:
    wanted = {**laboratory.truth, **laboratory.derived}
    for name, found in (*result["parameters"].items(), *result["derived"].items()):
        if name not in wanted:
            continue
        value, std = _number(found["value"]), _number(found["std"])
        low, high = map(_number, found["ci95"])
        ci68 = _number(found["ci68"][0]), _number(found["ci68"][1])
        # ± is printed for both sides where they differ little, else each; where twice that is not
        # the 95 % interval, this is printed, too
        bars = error_bars(value, ci68, (low, high), 0.0)
        is_above = wanted[name] > value
        side = std if bars.is_even else bars.above if is_above else bars.below
        if not bars.covers95:
            side = max(side, abs((high if is_above else low) - value) / ROOT_95)
        yield Said(
            name=name,
            verdict=found["status"],
            value=value,
            std=std,
            low=low,
            high=high,
            truth=wanted[name],
            side=side,
        )
    for quality in result["quadratures"]["qualities"]:
        for word, truth in laboratory.qualities.items():
            if word in quality["name"]:
                low, high = map(_number, quality["ci95"])
                std = _number(quality["std"])
                value = _number(quality["value"])
                described = result["status"] == "converged"
                yield Said(
                    name=quality["name"],
                    verdict=DETERMINED if described and math.isfinite(value) else "no verdict",
                    value=value,
                    std=std,
                    low=low,
                    high=high,
                    truth=truth,
                    side=std,
                )


def _false(
    laboratory: Laboratory, answer: _Answer, said: tuple[Said, ...], seen: tuple[float, float]
) -> Iterator[tuple[str, str]]:
    """Every false statement: its sort, and what it says."""
    if answer.code not in CODES:
        yield "exit code", f"exit code {answer.code} for valid data: {answer.error[:300]}"
        return
    if not answer.result:
        yield "exit code", f"no result: {answer.error[:300]}"
        return
    right = not laboratory.mistake or laboratory.noise_factor > 1.0
    refused = answer.code == 4
    if right and refused and not _is_too_few(laboratory, answer):
        yield "right model refused", str(answer.result["message"])
    square, share = seen
    if not right and not refused and answer.code == 0 and share > SHARE and square > SEEN:
        yield (
            "wrong model described",
            f"structure of {100 * share:.2g} % of the largest amplitude, "
            f"{square:.3g} of chi square per row",
        )
    yield from _of_values(laboratory, answer, said, right=right, square=square)
    yield from _of_causes(laboratory, answer)
    for name in _unlisted(laboratory, answer.result, said):
        yield "second solution hidden", name
    for s in said:
        missing = not all(map(math.isfinite, (s.value, s.std, s.low, s.high)))
        if s.verdict == DETERMINED and missing:
            yield "blank", f"{s.name} determined: {s.value} ± {s.std} in [{s.low}, {s.high}]"
    for words in answer.blank:
        yield "blank", words


def _of_values(
    laboratory: Laboratory,
    answer: _Answer,
    said: tuple[Said, ...],
    *,
    right: bool,
    square: float,
) -> Iterator[tuple[str, str]]:
    """Determined values off by four errors or more.

    Of a wrong model that the program warns of they are a note (`_notes`), and so where the data
    do not show the mistake: no program can know it.
    """
    warned = bool(answer.result.get("findings"))
    if not right and (warned or square < UNSEEN):
        return
    for s in said:
        if s.verdict == DETERMINED and s.pull > FAR:
            yield (
                "determined beyond 4 errors",
                f"{s.name} = {s.value:.9g} ± {s.side:.2g}, truth {s.truth:.9g}: {s.pull:.3g} off",
            )


def _is_too_few(laboratory: Laboratory, answer: _Answer) -> bool:
    """Whether noise is misstated and too few data distinguish it from a wrong model: rule (c)."""
    freedom = [
        finding["numbers"].get("freedom", math.inf)
        for finding in answer.result.get("findings", ())
        if finding["kind"] == "not_described"
    ]
    return laboratory.noise_factor > 1.0 and min(freedom, default=math.inf) < TESTABLE


def _shows_in_a_point(laboratory: Laboratory) -> bool:
    """Whether a mistake leaves a point that noise does not hide: that it is far off is true."""
    if not laboratory.mistake:
        return False
    left = np.abs(laboratory.left_at(laboratory.visible.values))
    return bool(np.any(left > HIDDEN))


def _of_causes(laboratory: Laboratory, answer: _Answer) -> Iterator[tuple[str, str]]:
    for finding in answer.result.get("findings", ()):
        kind, subject = finding["kind"], finding["subject"]
        if kind not in NAMING:
            continue
        if kind == "outlier" and _shows_in_a_point(laboratory):
            continue
        if kind not in laboratory.causes:
            yield (
                "cause that is not the cause",
                f"{kind} of {subject}: {finding['numbers']}; "
                f"in truth: {laboratory.mistake or 'nothing'}",
            )
        elif laboratory.subject and laboratory.subject not in subject:
            yield "cause that is not the cause", f"{kind} of {subject}, not {laboratory.subject}"
        elif kind == "noise_underestimated":
            factor = finding["numbers"]["factor"] / laboratory.noise_factor
            if not 1.0 / FACTOR < factor < FACTOR:
                yield "cause that is not the cause", f"noise factor off by {factor:.3g}"


def _unlisted(
    laboratory: Laboratory, result: Mapping[str, Any], said: tuple[Said, ...]
) -> Iterator[str]:
    """Solutions that fit as well as the truth, and are neither within intervals nor listed."""
    if result["status"] != "converged":
        return
    units = {u.name: u for u in laboratory.unknowns}
    listed = [e["parameters"] for e in (result["knowledge"] or {}).get("equivalents", ())]
    at = {s.name: s for s in said}
    for other in laboratory.equal:
        if not laboratory.fits_as_well(other):
            continue
        hidden = [
            name
            for name in units
            if name in at
            and at[name].verdict == DETERMINED
            and not at[name].low <= other[name] <= at[name].high
        ]
        if hidden and not any(_is_near(one, other, at) for one in listed):
            yield (
                f"{', '.join(f'{n} = {other[n]:.7g}' for n in units)} fits as well, but "
                f"{', '.join(hidden)} determined, and it is not listed"
            )


def _is_near(one: Values, other: Values, at: Mapping[str, Said]) -> bool:
    return all(
        abs(one[name] - value) <= max(6.0 * at[name].side, 0.02 * abs(value))
        for name, value in other.items()
        if name in one and name in at and at[name].side > 0.0
    )


def _notes(laboratory: Laboratory, answer: _Answer, said: tuple[Said, ...]) -> Iterator[str]:
    if not laboratory.mistake or not answer.result:
        return
    far = [s for s in said if s.verdict == DETERMINED and s.pull > FAR]
    if far and laboratory.noise_factor == 1.0:
        words = "warned of" if answer.result.get("findings") else "without a word"
        yield f"beyond 4 errors, wrong model {words}"
    kinds = {f["kind"] for f in answer.result.get("findings", ())}
    if laboratory.causes & kinds:
        yield "cause named"
