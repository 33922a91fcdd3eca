"""The steady response of an FMU over drive frequency, complex, at many parameter vectors.

Every kind of measurement that compares the response to single tones with a curve asks for it here,
be it for amplitudes or for both quadratures. Where the plan found the FMU linear, runs at a few
frequencies give the response at all of them: it is a rational function of the frequency. Whether it
was, to the tolerance of the plan, is checked at every parameter vector, and runs are added where it
was not, up to one at every frequency.

`CurveSurvey` plans it: few runs, until all that is known agrees with them.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property

import numpy as np

from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.plan import SAFETY, CurvePlan, DraftedCurve, Place, Plan
from fitting.signal.rational import Interpolation
from fitting.signal.window import Window
from fitting.simulate.batch import Batch, Variation, Workers
from fitting.simulate.budget import Basis
from fitting.simulate.drive import Drive
from fitting.text.arrays import ComplexArray, FloatArray, IntArray, Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer

#: Yields whenever what it has asked of the batch is wanted; returns the response, (k, m) phasors.
Responding = Generator[None, None, ComplexArray]

#: Rounds of two more runs, at most.
ROUNDS = 8


@dataclass(frozen=True)
class ResponseCurve:
    """The response of one output to single tones, one after the other.

    Values are phasors P(u) in the output's unit, with the phase at the FMU's time 0:

        output(t) = mean + Re[P(u) exp(i 2 pi u t)]         in the steady state

    A linear FMU with the transfer function X(u), its answer to exp(+i 2 pi u t) (a resonance lags,
    by a quarter turn at its top), that drives itself by A cos(2 pi u t + phase) gives
    P = X(u) A exp(i phase), with the phase of its start values; a tone that is applied to an input
    has the phase 0. The amplitude A of the drive is in P.

    `settings` are those of the place; `label` is its label, None where it has none. Where the tool
    holds tones over steps, it does so as for `fastest_hz`, that what images of the steps add is a
    smooth function of the tone as well; None: as each tone itself wants it.
    """

    model: DrivenModel
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    output: str = ""
    _: KW_ONLY
    label: str | None = None
    fastest_hz: float | None = None

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
            result = yield from self._simulated(table, first, frequency_hz, batch)
        else:
            points, place = np.unique(frequency_hz, return_inverse=True)
            curve = replace(self, fastest_hz=planned.high_hz)
            result = yield from curve._interpolated(table, first, points, batch, planned)
            result = result[:, place]
        return result[group]

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
        tones = self._tones(map(self._window, tones_hz[:, np.newaxis]), part)
        return self._request(self._start_values(p, part), tones, batch, owner)

    def drives(self, p: FloatArray, tones_hz: Iterable[float]) -> list[Drive]:
        """Drives by single tones, each once, by which a plan is measured.

        Args:
            p: parameters (n,), each in its own unit.
            tones_hz: frequencies of the tones (m,), Hz.
        """
        values = self._start_values(p)
        return [
            self.model.drive(values | self.model.tone_values((tone,)), (tone,), self.place.output)
            for tone in dict.fromkeys(map(float, tones_hz))
        ]

    def windows(self, planned: CurvePlan) -> list[Window]:
        """Settling and samples of the runs of a plan at the full drive, by its `groups`.

        Args:
            planned: frequencies and tones of the runs.

        Raises:
            BadInput: no samples keep the tones of a run apart.
        """
        return [self._window(planned.nodes_hz[group]) for group in planned.groups]

    def _window(self, tones_hz: FloatArray) -> Window:
        tones = tuple(map(float, tones_hz))
        if len(tones) == 1 and not (self.fastest_hz and self.model.hold_steps):
            return self.model.single_tone_window(tones[0])
        return self.model.superposed_window(tones, self.fastest_hz or max(tones))

    def ask_nodes(self, p: FloatArray, windows: Sequence[Window], batch: Batch) -> list[int]:
        """Ask for the runs of a plan at the full drive: their numbers in the batch.

        Args:
            p: parameters (n,), each in its own unit.
            windows: of the runs, as `windows` gave them.
            batch: where runs are asked for; equal runs are simulated once.
        """
        start = self._start_values(p, count=len(windows[0].tones_hz))
        return [run for run, _ in self._request(start, self._tones(windows), batch, 0)]

    def ask_alone(self, p: FloatArray, window: Window, batch: Batch) -> list[int]:
        """Ask for a run at each tone of a window, without the others: numbers in the batch.

        A drive that is held is so over the same steps as with all of them.

        Args:
            p: parameters (n,), each in its own unit.
            window: settling and samples of the run with all of them.
            batch: where runs are asked for; equal runs are simulated once.
        """
        tones = [
            Variation(self.model.tone_values((tone,)), window, self.model.signal(window, (tone,)))
            for tone in window.tones_hz
        ]
        return batch.ask_varied(self._start_values(p), tones, self.place.output, 0)

    def _tones(self, windows: Iterable[Window], part: float = 1.0) -> list[Variation]:
        """What runs of these windows have of their own, whatever the parameters are."""
        result = []
        for window in windows:
            signal = self.model.signal(window, window.tones_hz, part)
            result.append(Variation(self.model.tone_values(window.tones_hz), window, signal))
        return result

    def _start_values(self, p: FloatArray, part: float = 1.0, count: int = 1) -> dict[str, Scalar]:
        """What runs at so many tones have in common."""
        values = self.model.values(p, self.label, self.settings)
        if part != 1.0:
            values = self.model.with_part(part, values)
        return self.model.tones_of(values, count)

    def _request(
        self, values: dict[str, Scalar], tones: Sequence[Variation], batch: Batch, owner: int
    ) -> list[tuple[int, Window]]:
        runs = batch.ask_varied(values, tones, self.place.output, owner)
        return [(run, tone.window) for run, tone in zip(runs, tones, strict=True)]

    def read(self, batch: Batch, requested: Sequence[tuple[int, Window]]) -> ComplexArray:
        """Phasors (m,) of runs that were simulated.

        Args:
            batch: that has simulated them.
            requested: runs and windows, as `ask` gave them.
        """
        result = [batch.phasors(k, window, self.place.output) for k, window in requested]
        return np.concatenate(result) if result else np.empty(0, dtype=complex)

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
        requested = self.ask(p, frequency_hz, batch, part=part)
        batch.simulate(workers)
        return self.read(batch, requested)

    def _simulated(
        self, table: FloatArray, first: IntArray, points: FloatArray, batch: Batch
    ) -> Responding:
        """By a run at each frequency."""
        requested = [self.ask(table[k], points, batch, int(k)) for k in first]
        yield
        result = [self.read(batch, each) for each in requested]
        return np.array(result).reshape(len(result), points.size)

    def _interpolated(
        self,
        table: FloatArray,
        first: IntArray,
        points: FloatArray,
        batch: Batch,
        planned: CurvePlan,
    ) -> Responding:
        """By the plan's runs, by more where a check requires them, else by all."""
        count, windows = planned.tones, self.windows(planned)
        tones, half_tones = self._tones(windows), self._tones([windows[planned.half_run]], 0.5)
        requested, halves = [], []
        for k in map(int, first):
            whole, half = (self._start_values(table[k], part, count) for part in (1.0, 0.5))
            requested.append(self._request(whole, tones, batch, k))
            halves.append(self._request(half, half_tones, batch, k))
        yield
        # the runs have their tones in the order of `groups`, the plan has them in that of its nodes
        order = np.argsort(np.concatenate(planned.groups))
        values = np.array([self.read(batch, runs) for runs in requested])[:, order]
        at_half = planned.nodes_hz[planned.groups[planned.half_run]] == planned.half_hz
        half_values = np.array([self.read(batch, run) for run in halves])[:, at_half][:, 0]
        result, known = planned.drafted(points, values, half_values)
        rest = np.flatnonzero(~known)
        if rest.size and count > 1:  # once more as if nothing were known of several tones
            alone = replace(planned, tones=1, superposed=0.0)
            result[rest] = yield from self._interpolated(table, first[rest], points, batch, alone)
        elif rest.size:
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
            result[rest] = yield from self._mended(table, first[rest], batch, drafts)
        return result

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
        result = np.array([draft.values for draft in drafts])
        if rest:
            points = drafts[0].points
            result[rest] = yield from self._simulated(table, first[rest], points, batch)
        return result


#: Uncertainty at some parameter vectors, and the interpolation at each of them.
Stage = tuple[float, list[Interpolation]]

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
#: Several tones share a run where that simulates no more than this part of the time.
WORTH = 0.7
#: Frequencies at which a plan compares an interpolation with runs, beside its own.
SURVEYED = 12
#: Nodes to begin with, by which a curve of degree two is interpolated and checked.
FIRST_NODES = 6


def plan_curve(
    curve: ResponseCurve,
    frequency_hz: FloatArray,
    points: Sequence[FloatArray],
    workers: Workers,
    top_hz: float | None = None,
) -> Plan:
    """The plan of a curve's model with that curve: where to simulate it for these frequencies.

    Args:
        curve: of the model that is planned.
        frequency_hz: where the response will be wanted (m,), Hz.
        points: parameter vectors (n,) at which it is measured, those that the FMU takes.
        workers: processes that run the FMU.
        top_hz: where the measured response is largest, Hz; None where that is not known.
    """
    plan, wanted = curve.model.plan, np.unique(frequency_hz)
    left = _left(plan)
    if wanted.size < LEAST_POINTS or left <= 0.0 or plan.curve(curve.place, wanted) is not None:
        return plan
    near = wanted[wanted.size // 2] if top_hz is None else top_hz
    top = float(wanted[int(np.argmin(np.abs(wanted - near)))])
    alike = replace(curve, fastest_hz=float(wanted[-1]))
    survey = CurveSurvey(alike, wanted, top, left, workers)
    try:
        return plan.with_curve(survey.curve_plan(points))
    except NoAnswer:
        raise
    except FmuFailure:  # a drive that it refuses at half its amplitude
        return plan


def _left(plan: Plan) -> float:
    """What an interpolation may cost: of the accuracy that is wanted, or, beyond it, promised."""
    if plan.budget is None:
        return 0.0
    wanted, left = plan.budget.wanted, plan.budget.remaining()
    if left <= 0.0:  # a run at every point would not bring the promise back either
        return SHARE * plan.budget.promised
    return min(SHARE * wanted, left)


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
        result = replace(
            self._point_by_point(Basis.RATIONAL, uncertainty),
            tolerance=tolerance,
            supports_hz=tuple(map(float, chosen.supports_hz)),
            others_hz=tuple(map(float, chosen.others_hz)),
            half_hz=float(chosen.supports_hz[loudest]),
        )
        return self._superposed(result, kept)

    def _superposed(self, plan: CurvePlan, vectors: Sequence[FloatArray]) -> CurvePlan:
        """The plan with several tones in a run, where that is shorter and changes little enough."""
        if not self.curve.model.plan.settle_s:  # there is no time to be saved
            return plan
        most, nodes = self.curve.model.most_tones or plan.nodes_hz.size, plan.nodes_hz.size
        counts = [n for n in range(2, most + 1) if nodes % n == 0]
        tried = [
            (self._simulated_s(each), each) for each in (replace(plan, tones=n) for n in counts)
        ]
        worth_s = WORTH * self._simulated_s(plan)
        for length_s, candidate in sorted(tried, key=lambda each: each[0]):
            if length_s > worth_s:
                break
            change = SAFETY * self._change(candidate, vectors)
            if plan.tolerance + change <= self.left:  # false where it is not known
                return replace(candidate, superposed=change)
        return plan

    def _simulated_s(self, plan: CurvePlan) -> float:
        """Time that the runs at the full drive simulate, s; infinite: tones are not separated."""
        try:
            windows = self.curve.windows(plan)
        except BadInput:
            return np.inf
        return sum(window.settle_s + window.length_s for window in windows)

    def _change(self, plan: CurvePlan, vectors: Sequence[FloatArray]) -> float:
        """Largest relative change of a response by the other tones of its run."""
        batch, output = Batch(), self.curve.place.output
        windows = self.curve.windows(plan)
        requested = [
            (run, window, self.curve.ask_alone(p, window, batch))
            for p in vectors
            for run, window in zip(self.curve.ask_nodes(p, windows, batch), windows, strict=True)
        ]
        batch.simulate(self.workers)
        changes = []
        for run, window, runs in requested:
            together = batch.phasors(run, window, output)
            alone = [batch.phasors(own, window, output)[i] for i, own in enumerate(runs)]
            with np.errstate(all="ignore"):
                changes.append(float(np.max(np.abs(together / np.array(alone) - 1.0))))
        return float(np.nan_to_num(max(changes), nan=np.inf))

    def _point_by_point(self, basis: Basis, result: float, tried: int = 0) -> CurvePlan:
        return CurvePlan(
            place=self.curve.place,
            low_hz=float(self.points[0]),
            high_hz=float(self.points[-1]),
            points=self.points.size,
            basis=basis,
            tolerance=self.left,
            error=min(result, 1.0),
            tried=tried,
        )

    def _change_by_half(self, p: FloatArray) -> float:
        """Relative change of the response at its measured top, but for the half, by half the drive.

        Requested first: an FMU that is not linear is to be run no more than that.
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
            errors = [self._errors(curve, survey_hz, observed[6:]) for curve, observed in pairs]
            stages.append((max(map(max, errors)), curves))
            full = curves[0].frequency_hz.size + 2 >= self.points.size
            if full or len(stages) > ROUNDS or self._is_enough([u for u, _ in stages]):
                return stages
            worst = int(np.argmax([max(each) for each in errors]))
            places = curves[worst].wanted_hz(self.points)
            uncertain, off = errors[worst]
            if off > uncertain:  # what runs beside it say counts more than its own uncertainty
                apart = np.abs(curves[worst].function(survey_hz) / values[worst][6:] - 1.0)
                observed = float(survey_hz[int(np.argmax(apart))])
                places = (observed, places[1] if places[1] != observed else places[0])
            more = self._values(vectors, np.array(places), batch)
            curves = [c.with_values(places, v) for c, v in zip(curves, more, strict=True)]

    def _errors(
        self, curve: Interpolation, survey_hz: FloatArray, values: ComplexArray
    ) -> tuple[float, float]:
        """Its relative error by its own estimate, and by runs at a few frequencies."""
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
        requested = [self.curve.ask(p, frequency_hz, batch) for p in vectors]
        batch.simulate(self.workers)
        return [self.curve.read(batch, each) for each in requested]


def best(stages: Sequence[Stage]) -> Stage:
    """The first of the stages that is about as certain as the most certain one.

    Args:
        stages: uncertainty and interpolations, by the number of their runs.
    """
    least = max(GOAL, min(uncertainty for uncertainty, _ in stages))
    return next(stage for stage in stages if stage[0] <= ALIKE * least)
