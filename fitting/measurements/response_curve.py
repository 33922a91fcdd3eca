"""The steady response of an FMU over drive frequency, complex, at many parameter vectors.

Every kind of measurement that compares the response to single tones with a curve asks for it here,
be it for amplitudes or for both quadratures. Where the plan found the FMU linear, runs at a few
frequencies give the response at all of them: it is a rational function of the frequency. Whether it
was, to the tolerance of the plan, is checked at every parameter vector, and runs are added where it
was not, up to one at every frequency.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from fitting.measurements.curve_plan import SAFETY, CurvePlan, DraftedCurve, Place
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.plan import Plan
from fitting.signal.rational import Interpolation
from fitting.signal.window import Window
from fitting.simulate.batch import Batch, Variation, Workers
from fitting.simulate.budget import Basis
from fitting.text.arrays import ComplexArray, FloatArray, IntArray, Scalar
from fitting.text.errors import FmuFailure, NoAnswer

Answer = TypeVar("Answer")
Other = TypeVar("Other")
#: Uncertainty at some parameter vectors, and the interpolation at each of them.
Stage = tuple[float, list[Interpolation]]
#: Yields whenever what it has asked of the batch is wanted; returns the response, (k, m) phasors.
Responding = Generator[None, None, ComplexArray]

#: Fewer frequencies than this are simulated one by one: interpolating saves too little.
LEAST_POINTS = 30
#: Of the wanted accuracy, what an interpolation may cost at most, and where it may not matter how
#: much that is: differences of two evaluations are then as good as those of the runs themselves.
SHARE, NOISE = 0.1, 1e-9
#: A plan adds runs until the uncertainty at its own parameters is this, or is no longer falling.
GOAL = 1e-11
#: Part of the tolerance that may be uncertain at the parameters of the plan, for those of a fit.
MARGIN = 0.1
#: Uncertainties that are this many times the least one are as good: rounding and noise.
ALIKE = 3.0
#: Rounds of two more runs, at most.
ROUNDS = 8
#: Frequencies at which a plan compares an interpolation with runs, beside its own.
SURVEYED = 12
#: Nodes to begin with, by which a curve of degree two is interpolated and checked.
FIRST_NODES = 6


@dataclass(frozen=True)
class ResponseCurve:
    """The response of one output to single tones, one after the other.

    Values are phasors P(u) in the output's unit, with the phase at the FMU's time 0:

        output(t) = mean + Re[P(u) exp(i 2 pi u t)]         in the steady state

    A linear FMU with the transfer function X(u), its answer to exp(+i 2 pi u t) (a resonance lags,
    by a quarter turn at its top), that drives itself by A cos(2 pi u t + phase) gives
    P = X(u) A exp(i phase), with the phase of its start values; a tone that is applied to an input
    has the phase 0. The amplitude A of the drive is in P.

    `settings` are those of the place; `label` is its label, None where it has none.
    """

    model: DrivenModel
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    output: str = ""
    _: KW_ONLY
    label: str | None = None

    @cached_property
    def place(self) -> Place:
        """What the plan knows it by."""
        output = self.output or self.model.setup.output
        return Place(output=output, settings=dict(self.settings), label=self.label)

    def predict(self, table: FloatArray, frequency_hz: FloatArray, batch: Batch) -> Responding:
        """Ask the batch for runs, yield for their answers as often as needed, return phasors.

            curve = ResponseCurve(model, settings, output)
            phasors = yield from curve.predict(table, frequency_hz, batch)

        Several curves share the rounds of one batch where they are stepped together (`together`).

        Args:
            table: parameter vectors, shape (k, n), in the parameters' units.
            frequency_hz: of the single tones, shape (m,), Hz.
            batch: where runs are asked for; equal runs are simulated once.

        Returns:
            Phasors, complex, shape (k, m), in the unit of the output.
        """
        first, group = self.model.groups(table, self.label)
        planned = self.model.plan.curve(self.place, frequency_hz)
        if planned is None or planned.runs >= frequency_hz.size:
            found = yield from self._simulated(table, first, frequency_hz, batch)
        else:
            points, place = np.unique(frequency_hz, return_inverse=True)
            found = yield from self._interpolated(table, first, points, batch, planned)
            found = found[:, place]
        return found[group]

    def ask(
        self,
        p: FloatArray,
        tones_hz: FloatArray,
        batch: Batch,
        owner: int = 0,
        part: float = 1.0,
    ) -> list[tuple[int, Window]]:
        """Ask for a run at each single tone: its number in the batch, and its window.

        Args:
            p: parameters (n,), each in its own unit.
            tones_hz: frequencies of the tones (m,), Hz.
            batch: where runs are asked for; equal runs are simulated once.
            owner: which evaluation pays for the runs.
            part: of the drive's amplitude.
        """
        tones = self._tones(tones_hz, part)
        return self._asked(self._start_values(p, part), tones, batch, owner)

    def _tones(self, tones_hz: FloatArray, part: float = 1.0) -> list[Variation]:
        """What runs at single tones have of their own, whatever the parameters are."""
        found = []
        for tone in map(float, tones_hz):
            window = self.model.single_tone_window(tone)
            signal = self.model.signal(window, window.tones_hz, part)
            found.append(Variation(self.model.tone_values(tone), window, signal))
        return found

    def _start_values(self, p: FloatArray, part: float = 1.0) -> dict[str, Scalar]:
        """What runs at single tones have in common."""
        values = self.model.one_tone_of(self.model.values(p, self.label, self.settings))
        return values if part == 1.0 else self.model.with_part(part, values)

    def _asked(
        self, values: dict[str, Scalar], tones: Sequence[Variation], batch: Batch, owner: int
    ) -> list[tuple[int, Window]]:
        runs = batch.ask_varied(values, tones, self.place.output, owner)
        return [(run, tone.window) for run, tone in zip(runs, tones, strict=True)]

    def read(self, batch: Batch, asked: Sequence[tuple[int, Window]]) -> ComplexArray:
        """Phasors (m,) of runs that were simulated.

        Args:
            batch: that has simulated them.
            asked: runs and windows, as `ask` gave them.
        """
        found = [batch.phasors(k, window, self.place.output) for k, window in asked]
        return np.concatenate(found) if found else np.empty(0, dtype=complex)

    def simulated(
        self, p: FloatArray, frequency_hz: FloatArray, workers: Workers, part: float = 1.0
    ) -> ComplexArray:
        """Phasors (m,) by a run each, at one parameter vector.

        Args:
            p: parameters (n,), each in its own unit.
            frequency_hz: frequencies of the tones (m,), Hz.
            workers: processes that run the FMU.
            part: of the drive's amplitude.
        """
        batch = Batch()
        asked = self.ask(p, frequency_hz, batch, part=part)
        batch.simulate(workers)
        return self.read(batch, asked)

    def planned(
        self,
        frequency_hz: FloatArray,
        points: Sequence[FloatArray],
        workers: Workers,
        top_hz: float | None = None,
    ) -> Plan:
        """The model's plan with this curve: where to simulate it for these frequencies.

        Args:
            frequency_hz: where the response will be wanted (m,), Hz.
            points: parameter vectors (n,) at which it is measured, those that the FMU takes.
            workers: processes that run the FMU.
            top_hz: where the measured response is largest, Hz; None where that is not known.
        """
        plan, wanted = self.model.plan, np.unique(frequency_hz)
        left = 0.0 if plan.budget is None else plan.budget.left
        left = min(SHARE * self.model.setup.accuracy, left)
        if wanted.size < LEAST_POINTS or left <= 0.0 or plan.curve(self.place, wanted) is not None:
            return plan
        near = wanted[wanted.size // 2] if top_hz is None else top_hz
        top = float(wanted[int(np.argmin(np.abs(wanted - near)))])
        survey = CurveSurvey(self, wanted, top, left, workers)
        try:
            return plan.with_curve(survey.curve_plan(points))
        except NoAnswer:
            raise
        except FmuFailure:  # a drive that it refuses at half its amplitude
            return plan

    def _simulated(
        self, table: FloatArray, first: IntArray, points: FloatArray, batch: Batch
    ) -> Responding:
        """By a run at each frequency."""
        asked = [self.ask(table[k], points, batch, int(k)) for k in first]
        yield
        found = [self.read(batch, each) for each in asked]
        return np.array(found).reshape(len(found), points.size)

    def _interpolated(
        self,
        table: FloatArray,
        first: IntArray,
        points: FloatArray,
        batch: Batch,
        planned: CurvePlan,
    ) -> Responding:
        """By the plan's runs, by more where a check says so, by all where that does not help."""
        nodes, half = planned.nodes_hz, np.array([planned.half_hz])
        tones, half_tones = self._tones(nodes), self._tones(half, 0.5)
        asked, halves = [], []
        for k in map(int, first):
            start = self._start_values(table[k])
            asked.append(self._asked(start, tones, batch, k))
            halves.append(self._asked(self.model.with_part(0.5, start), half_tones, batch, k))
        yield
        values = np.array([self.read(batch, runs) for runs in asked]).reshape(-1, nodes.size)
        half_values = np.array([self.read(batch, run)[0] for run in halves])
        drafted = planned.drafted(points, values, half_values)
        found, rest = drafted.values, np.flatnonzero(~drafted.known)
        if rest.size:
            drafts = [
                DraftedCurve(
                    points=points,
                    tolerance=planned.tolerance,
                    curve=planned.interpolation(values[i]),
                    half_hz=planned.half_hz,
                    half=complex(half_values[i]),
                )
                for i in rest
            ]
            found[rest] = yield from self._mended(table, first[rest], batch, drafts)
        return found

    def _mended(
        self, table: FloatArray, first: IntArray, batch: Batch, drafts: list[DraftedCurve]
    ) -> Responding:
        """Drafts that are not known: by more runs, by all where that does not help."""
        for _ in range(ROUNDS):
            open_ = [i for i, draft in enumerate(drafts) if draft.may_become_known]
            if not open_:
                break
            wanted = [drafts[i].wanted_hz for i in open_]
            more = [
                self.ask(table[first[i]], np.array(f), batch, int(first[i]), part)
                for i, (f, part) in zip(open_, wanted, strict=True)
            ]
            yield
            for i, (f, _), runs in zip(open_, wanted, more, strict=True):
                drafts[i] = drafts[i].with_values(f, self.read(batch, runs))
        rest = [i for i, draft in enumerate(drafts) if not draft.is_known]
        found = np.array([draft.values for draft in drafts])
        if rest:
            points = drafts[0].points
            found[rest] = yield from self._simulated(table, first[rest], points, batch)
        return found


@dataclass(frozen=True)
class CurveSurvey:
    """How a curve is planned: few runs are tried until all that is known agrees with them.

    `points` (m,) are the frequencies that are wanted, `top_hz` the one of the largest response as
    far as that is known, `left` the relative error that the interpolation may cost.
    """

    curve: ResponseCurve
    points: FloatArray
    top_hz: float
    left: float
    workers: Workers

    def curve_plan(self, vectors: Sequence[FloatArray]) -> CurvePlan:
        """Which runs to make, from runs at some parameter vectors.

        Args:
            vectors: parameter vectors (n,), the first in any case.
        """
        change = self._change_by_half(vectors[0])
        if change > self.left:
            return self._point_by_point(Basis.NONLINEAR, change)
        kept = [p for k, p in enumerate(vectors) if k == 0 or self._runs(p)]
        uncertainty, curves = best(self._stages(kept))
        if uncertainty > MARGIN * self.left:
            tried = curves[0].frequency_hz.size
            irregular = self._point_by_point(Basis.IRREGULAR, uncertainty, tried)
            return replace(irregular, tolerance=MARGIN * self.left)
        tolerance = min(max(NOISE, uncertainty / MARGIN), self.left)
        nonlinear = max(map(self._nonlinearity, kept, curves))
        if nonlinear > tolerance:
            return self._point_by_point(Basis.NONLINEAR, nonlinear)
        chosen = curves[0]
        loudest = int(np.argmax(np.abs(chosen.supports)))
        return replace(
            self._point_by_point(Basis.RATIONAL, uncertainty),
            tolerance=tolerance,
            supports_hz=tuple(map(float, chosen.supports_hz)),
            others_hz=tuple(map(float, chosen.others_hz)),
            half_hz=float(chosen.supports_hz[loudest]),
        )

    def _point_by_point(self, basis: Basis, found: float, tried: int = 0) -> CurvePlan:
        return CurvePlan(
            place=self.curve.place,
            low_hz=float(self.points[0]),
            high_hz=float(self.points[-1]),
            points=self.points.size,
            basis=basis,
            tolerance=self.left,
            found=min(found, 1.0),
            tried=tried,
        )

    def _change_by_half(self, p: FloatArray) -> float:
        """Relative change of the response at its measured top, but for the half, by half the drive.

        Asked first: an FMU that is not linear is to be run no more than that.
        """
        top = np.array([self.top_hz])
        [whole], [half] = (self.curve.simulated(p, top, self.workers, part) for part in (1.0, 0.5))
        return float(abs(2.0 * half / whole - 1.0)) if whole else 1.0

    def _runs(self, p: FloatArray) -> bool:
        """Whether the FMU takes these parameters: it may refuse a part of the box."""
        try:
            self.curve.simulated(p, np.array([self.top_hz]), self.workers)
        except NoAnswer:
            raise
        except FmuFailure:
            return False
        return True

    def _stages(self, vectors: Sequence[FloatArray]) -> list[Stage]:
        """Interpolations through more and more runs, the same for all parameter vectors."""
        ends = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, FIRST_NODES)))
        first = self.points[np.round(ends * (self.points.size - 1)).astype(int)]
        if self.top_hz not in first:
            inner = slice(1, FIRST_NODES - 1)
            first[inner][int(np.argmin(np.abs(first[inner] - self.top_hz)))] = self.top_hz
        spread = np.linspace(0, self.points.size - 1, SURVEYED + 2)[1:-1]
        survey_hz = self.points[np.round(spread).astype(int)]
        supports, others = first[[0, 2, 5]], first[[1, 3, 4]]
        batch = Batch()
        values = self._values(vectors, np.concatenate([supports, others, survey_hz]), batch)
        curves = [
            Interpolation(supports_hz=supports, supports=v[:3], others_hz=others, others=v[3:6])
            for v in values
        ]
        stages: list[Stage] = []
        while True:
            pairs = zip(curves, values, strict=True)
            errors = [self._errors(curve, survey_hz, seen[6:]) for curve, seen in pairs]
            stages.append((max(map(max, errors)), curves))
            full = curves[0].frequency_hz.size + 2 >= self.points.size
            if full or len(stages) > ROUNDS or self._is_enough([u for u, _ in stages]):
                return stages
            worst = int(np.argmax([max(each) for each in errors]))
            places = curves[worst].wanted_hz(self.points)
            uncertain, off = errors[worst]
            if off > uncertain:  # what runs beside it say counts more than its own uncertainty
                apart = np.abs(curves[worst].function(survey_hz) / values[worst][6:] - 1.0)
                seen = float(survey_hz[int(np.argmax(apart))])
                places = (seen, places[1] if places[1] != seen else places[0])
            more = self._values(vectors, np.array(places), batch)
            curves = [c.with_values(places, v) for c, v in zip(curves, more, strict=True)]

    def _errors(
        self, curve: Interpolation, survey_hz: FloatArray, values: ComplexArray
    ) -> tuple[float, float]:
        """What it says itself of its relative error, and what runs say at a few frequencies."""
        with np.errstate(all="ignore"):
            off = np.max(np.abs(curve.function(survey_hz) / values - 1.0))
        uncertain = SAFETY * np.max(curve.uncertainty(self.points))
        return float(uncertain), float(off) if np.isfinite(off) else np.inf

    def _is_enough(self, uncertainties: Sequence[float]) -> bool:
        """Whether more runs are not worth it: at the goal, or good enough and no longer better."""
        if uncertainties[-1] <= GOAL:
            return True
        before, last = uncertainties[:-2], uncertainties[-2:]
        if not before or min(uncertainties) > MARGIN * self.left:
            return False
        return min(last) > min(before) / ALIKE

    def _nonlinearity(self, p: FloatArray, curve: Interpolation) -> float:
        """Relative change by half the drive at the top of the interpolation, but for the half."""
        here = curve.function(self.points)
        top = int(np.argmax(np.abs(here)))
        [half] = self.curve.simulated(p, self.points[[top]], self.workers, 0.5)
        return float(abs(2.0 * half / here[top] - 1.0))

    def _values(
        self, vectors: Sequence[FloatArray], frequency_hz: FloatArray, batch: Batch
    ) -> list[ComplexArray]:
        asked = [self.curve.ask(p, frequency_hz, batch) for p in vectors]
        batch.simulate(self.workers)
        return [self.curve.read(batch, each) for each in asked]


def best(stages: Sequence[Stage]) -> Stage:
    """The first of the stages that is about as certain as the most certain one.

    Args:
        stages: uncertainty and interpolations, by the number of their runs.
    """
    least = max(GOAL, min(uncertainty for uncertainty, _ in stages))
    return next(stage for stage in stages if stage[0] <= ALIKE * least)


def together(tasks: Sequence[Generator[None, None, Answer]]) -> Generator[None, None, list[Answer]]:
    """Step several predictions of one batch side by side, so that they share its rounds.

        phasors = yield from together([c.predict(table, f, batch) for c, f in curves])

    Args:
        tasks: predictions of one kind of answer, not yet begun.

    Returns:
        What each of them returns, in their order.
    """
    found: dict[int, Answer] = {}
    while True:
        for k, task in enumerate(tasks):
            if k not in found:
                try:
                    next(task)
                except StopIteration as ended:
                    found[k] = ended.value
        if len(found) == len(tasks):
            return [found[k] for k in range(len(tasks))]
        yield


def both(
    one: Generator[None, None, Answer], other: Generator[None, None, Other]
) -> Generator[None, None, tuple[Answer, Other]]:
    """Step two predictions of different answers side by side, as `together` does.

    Args:
        one: not yet begun.
        other: likewise.
    """
    tasks: list[Generator[None, None, Any]] = [one, other]
    first, second = yield from together(tasks)
    return first, second
