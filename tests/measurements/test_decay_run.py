"""Traces of free decays whose runs are few samples long: against closed forms, and where not."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fitting as ff
from fitting.campaign.parameters import Parameter
from fitting.fit.problem import plan_problem
from fitting.fmu.runs import Run, SampledSignal, row_times
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.fmu_response import FmuResponse
from fitting.measurements.measurement import Prediction
from fitting.measurements.plan import Plan
from fitting.measurements.planning import Series, plan_series
from fitting.measurements.time_record import Traces
from fitting.simulate.batch import Batch
from fitting.simulate.budget import Kind
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure
from tests.support.cfmu_build import build_c_fmu, build_lag_fmu, reworded
from tests.support.linear_traces import held_response, oscillator
from tests.support.twins import swift_model

QUICK = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
MASS, C, K = 1e-3, 5e-2, 4e3
STEP_S, N = 5e-4, 4000
T = np.arange(N) * STEP_S
FREE = held_response(oscillator(MASS, C, K), np.zeros(N), STEP_S, start=(1.0, 300.0))
BEAM = ff.Setup(ff.Drive(), "displacement")
BEAM_PARAMETERS = (
    ff.Parameter("damping", 0.04, bounds=(0.01, 0.2)),
    ff.Parameter("stiffness", 3.999e3, bounds=(3.99e3, 4.01e3)),
)
BEAM_TRACE = ff.Trace(T, FREE, setup=BEAM, input="force", start="unknown", unit="m")


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ff.Fmu]:
    with ff.Fmu(build_c_fmu(tmp_path_factory.mktemp("beam")), workers=1) as fmu:
        yield fmu


@pytest.fixture(scope="module")
def lag(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ff.Fmu]:
    with ff.Fmu(build_lag_fmu(tmp_path_factory.mktemp("lag")), workers=1) as fmu:
        yield fmu


def planned(fmu: ff.Fmu, problem: ff.Problem) -> Plan:
    [plan] = plan_problem(problem.record, fmu.workers).plans.values()
    return plan


# --- FMUs -----------------------------------------------------------------------------------


def test_a_ringdown_takes_few_steps_of_the_fmu(beam: ff.Fmu) -> None:
    """Values are those of the closed form, and the plan's promise holds for them."""
    before = beam.workers.counts
    problem = ff.Problem(beam, BEAM_PARAMETERS, BEAM_TRACE)
    fit = ff.fit(problem, method=QUICK, starts=1)
    assert fit.x == pytest.approx([C, K], rel=1e-8)
    assert fit.result.plan is not None
    [decision] = [d for d in fit.result.plan.decisions if d.kind == Kind.STEP]
    few, of = (int(decision.numbers[key]) for key in ("few", "of"))
    assert 0.0 < decision.bound <= 3.01e-8
    assert of == BEAM_TRACE.pulse_window.samples
    assert 4 * few <= of
    at_truth = problem.residuals(np.array([C, K]))
    assert float(np.max(np.abs(at_truth))) <= decision.bound
    counts = beam.workers.counts
    runs, steps = counts.runs - before.runs, counts.steps - before.steps
    whole = 20 * of  # of the plan, which compares with whole runs
    assert runs > 60
    assert steps < whole + runs * few
    assert any(f"{of} samples" in s and f" {few} of" in s for s in problem.planned.sentences)


def test_steps_of_a_solver_that_takes_one_in_each_are_not_made_long(lag: ff.Fmu) -> None:
    """Euler's method: a sample behind a long step is another one."""
    t = np.arange(1200) * 1e-3
    setup = ff.Setup(ff.Drive(), "y", start_values={"euler": 1.0}, accuracy=1e-2)
    trace = ff.Trace(t, np.exp(-t / 0.3), setup=setup, input="u", start="unknown", states=1)
    parameters = [ff.Parameter("tau", 0.25, bounds=(0.2, 2.0))]
    plan = planned(lag, ff.Problem(lag, parameters, trace))
    [steps] = plan.steps
    assert steps.per_sample == 1
    assert steps.few is None
    exactly = replace(trace, setup=replace(setup, start_values={}))
    [steps] = planned(lag, ff.Problem(lag, parameters, exactly)).steps
    assert steps.few is not None


def test_an_fmu_of_equal_steps_is_asked_for_no_others(tmp_path: Path, beam: ff.Fmu) -> None:
    same = reworded(
        build_c_fmu(tmp_path),
        {
            'canHandleVariableCommunicationStepSize="true"': (
                'canHandleVariableCommunicationStepSize="false"'
            )
        },
    )
    with ff.Fmu(same, workers=1) as fmu:
        [steps] = planned(fmu, ff.Problem(fmu, BEAM_PARAMETERS, BEAM_TRACE)).steps
    assert steps.few is None


# --- a model in this process ----------------------------------------------------------------

W, D = 2.0 * np.pi * 100.0, 5.0


class Duffing:
    """x'' + 2 D x' + W^2 (x + bend x^3/(1 um)^2) = u by DOP853, at the times that runs ask for."""

    def __init__(self) -> None:
        self.runs: list[Run] = []
        self.refuses_long_steps = self.fails = False

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        self.runs += runs
        if self.fails:
            raise FmuFailure("failed", {}, Path("duffing.fmu"))
        if self.refuses_long_steps and any(run.segments for run in runs):
            raise FmuFailure("wanted steps as short as those before", {}, Path("duffing.fmu"))
        return [self._run(run) for run in runs]

    def _run(self, run: Run) -> FloatArray:
        values: Mapping[str, Any] = run.start_values
        u, until = float(values.get("u", 0.0)), run.settle_s
        if isinstance(run.input_signal, SampledSignal):
            held = run.input_signal.values[:, 0]
            assert not held[np.arange(held.size) * run.input_signal.step_s >= until - 1e-12].any()
            u = float(held[0])
        bend, times = float(values["bend"]), np.array(row_times(run))

        def motion(push: float) -> Callable[[float, FloatArray], list[float]]:
            return lambda t, y: [
                y[1],
                push - 2.0 * D * y[1] - W**2 * (y[0] + bend * 1e12 * y[0] ** 3),
            ]

        exactly: dict[str, Any] = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-18}
        pushed = solve_ivp(motion(u), (0.0, until), [0.0, 0.0], **exactly).y[:, -1]
        if bend == 0.0:
            lower, line = -D, np.sqrt(W**2 - D**2)
            past = times - until
            a, b = pushed[0], (pushed[1] + D * pushed[0]) / line
            x = np.exp(lower * past) * (a * np.cos(line * past) + b * np.sin(line * past))
            return np.asarray(x[:, None])
        # bent runs are compared with each other alone: far better than a promise is enough
        span, enough = (until, times[-1] + 1e-9), exactly | {"rtol": 1e-9}
        free = solve_ivp(motion(0.0), span, pushed, dense_output=True, **enough)
        return np.asarray(free.sol(times)[0][:, None])


SETUP = ff.Setup(ff.Drive(), "x")
RING_T = np.arange(600) * 1.3e-3
RING = np.exp(-D * RING_T) * np.cos(W * RING_T)
TRACES = Traces(
    setup=SETUP,
    traces=(ff.Trace(RING_T, RING, setup=SETUP, input="u", start="unknown", unit="m"),),
)
BEND = Parameter(name="bend", unit="1", lower=0.0, upper=1.0, start=0.0, reference=0.0, scale=1.0)


def ready(model: Duffing) -> DrivenModel:
    """The model as it is planned where nothing bends."""
    series = Series((TRACES,), (BEND,))
    driven = DrivenModel(setup=SETUP, parameters=series.parameters, plan=plan_series(series))
    return replace(driven, plan=TRACES.refined(driven, [np.zeros(1)], model))


def predicted(model: Duffing, driven: DrivenModel, bends: Sequence[float]) -> list[Prediction]:
    batch = Batch()
    making = TRACES.predict(driven, np.array(bends)[:, None], batch)
    while True:
        try:
            next(making)
        except StopIteration as ended:
            return list(ended.value)
        batch.simulate(model)


def steps_asked(runs: Sequence[Run]) -> list[int]:
    return [run.rows for run in runs]


def test_where_a_decay_is_no_sum_of_exponentials_the_whole_run_is_made() -> None:
    """The plan is made at a linear point; another one bends the spring."""
    model = Duffing()
    driven = ready(model)
    [steps] = driven.plan.steps
    assert steps.few is not None
    whole, few = TRACES.traces[0].pulse_window.samples, steps.few.indices.size + 1
    assert 4 * few < whole + 8
    model.runs.clear()
    bends = [0.0, 0.1, 0.0, 0.02]
    found = predicted(model, driven, bends)
    assert steps_asked(model.runs) == [few, few, few, whole, whole]
    assert [run.start_values["bend"] for run in model.runs] == [0.0, 0.1, 0.02, 0.1, 0.02]
    expected = predicted(model, replace(driven, plan=replace(driven.plan, steps=())), bends)
    for each, truly, bend in zip(found, expected, bends, strict=True):
        off = np.max(np.abs(each.values - truly.values)) / np.max(np.abs(truly.values))
        assert off <= (0.0 if bend else steps.bound)


def test_an_fmu_that_refuses_long_steps_makes_whole_runs() -> None:
    model = Duffing()
    model.refuses_long_steps = True
    driven = ready(model)
    [steps] = driven.plan.steps
    assert steps.few is None
    assert np.isfinite(predicted(model, driven, [0.0])[0].values).all()


def test_long_steps_that_are_refused_elsewhere_are_not_made_there() -> None:
    model = Duffing()
    driven = ready(model)
    [steps] = driven.plan.steps
    assert steps.few is not None
    response = FmuResponse(
        workers=model, parameters=(BEND,), measurements=(TRACES,), models={"": driven}
    )
    [fine] = response.evaluate_many([np.zeros(1)])
    model.refuses_long_steps = True
    model.runs.clear()
    [refused] = response.evaluate_many([np.zeros(1)])
    assert steps_asked(model.runs)[-1] == TRACES.traces[0].pulse_window.samples
    [before], [after] = fine.predictions, refused.predictions
    assert np.max(np.abs(before.values - after.values)) <= steps.bound
    driven = replace(driven, plan=driven.plan.of_whole_runs)
    model.fails = True
    with pytest.raises(FmuFailure, match="failed"):
        replace(response, models={"": driven}).evaluate_many([np.zeros(1)])


def test_the_survey_makes_no_run_twice() -> None:
    """Whole, half a pulse, half the step, few samples of it: each once."""
    model = Duffing()
    ready(model)
    asked = [
        (run.rows, run.input_signal, run.segments, run.start_values.get("u")) for run in model.runs
    ]
    assert len(set(asked)) == len(asked) <= 7


# --- an FMU that bends ----------------------------------------------------------------------


def test_an_fmu_whose_spring_bends_makes_whole_runs_there(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Planned where its cubic term is zero; elsewhere each evaluation is one of whole runs."""
    still = {"A1": 0.0, "A2": 0.0, "solver": 2, "rk4_substep": 1e-5, "alpha2": 0.0, "theta": 0.0}
    lines = {"eta_plus": 100.0, "eta_minus": 170.0, "d1": 3.0, "d2": 3.0}
    setup = ff.Setup(ff.Drive(), "q1_hybrid", start_values={**still, **lines})
    trace = ff.Trace(RING_T, RING, setup=setup, input="b", start="unknown", states=2, unit="m")
    parameters = [ff.Parameter("alpha1", 0.0, bounds=(0.0, 1e18))]
    with ff.Fmu(swift_model("DuffingOscillator", tmp_path_factory), workers=1) as fmu:
        problem = ff.Problem(fmu, parameters, trace)
        [plan] = problem.planned.plans.values()
        [steps] = plan.steps
        assert steps.few is not None
        whole, few = trace.pulse_window.samples, steps.few.indices.size

        def taken(alpha: float) -> tuple[int, FloatArray]:
            before = fmu.workers.counts.steps
            rows = problem.residuals(np.array([alpha]))
            return fmu.workers.counts.steps - before, rows

        taken(0.0)  # and steps of derivatives are found
        assert taken(0.0)[0] == few
        steps_bent, bent = taken(1e17)
        assert steps_bent == few + whole
        series = {name: each.of_whole_runs for name, each in problem.planned.plans.items()}
        exact = replace(problem.planned, plans=series).response({})
        [answer] = exact.evaluate_many([np.array([1e17])])
        expected = (answer.predictions[0].values - RING) / trace.largest
        assert bent == pytest.approx(expected, abs=1e-12)
