"""Traces through FMUs that integrate by Euler's method in steps of their own, the data exact."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.simulate.budget import Decision, Kind
from fitting.simulate.words import decision_in_words
from fitting.text.arrays import FloatArray
from tests.support.cfmu_build import build_euler_lag_fmu, build_lag_fmu

QUICK = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
TAU, GAIN, SIGMA = 0.3, 2.0, 0.002
T = np.arange(200) * 0.01
U = np.where(T >= 0.1, 1.0, 0.0)
PARAMETERS = (
    ff.Parameter("tau", 0.5, bounds=(0.05, 2.0)),
    ff.Parameter("gain", 1.0, bounds=(0.1, 10.0)),
)


@pytest.fixture(scope="module")
def lag(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ff.Fmu]:
    """That of which nothing but the communication step is a step."""
    with ff.Fmu(build_lag_fmu(tmp_path_factory.mktemp("lag")), workers=1) as fmu:
        yield fmu


def fitted(path: Path | ff.Fmu, seed: int, **start_values: float) -> tuple[ff.Fit, Decision]:
    """The fit of a step response by the closed form, and what was decided on its steps."""
    noise: FloatArray = SIGMA * np.random.default_rng(seed).standard_normal(T.size)
    y = GAIN * -np.expm1(-np.maximum(T - 0.1, 0.0) / TAU) + noise
    setup = ff.Setup(ff.Drive(), "y", start_values=start_values, accuracy=1e-3)
    trace = ff.Trace(T, y, setup=setup, input="u", driven=(T, U), interpolation="held")
    if isinstance(path, ff.Fmu):
        fit = ff.fit(ff.Problem(path, PARAMETERS, trace), method=QUICK, starts=1)
    else:
        with ff.Fmu(path, workers=1) as fmu:
            fit = ff.fit(ff.Problem(fmu, PARAMETERS, trace), method=QUICK, starts=1)
    assert fit.result.plan is not None
    [decision] = [d for d in fit.result.plan.decisions if d.kind == Kind.STEP]
    return fit, decision


def euler(step_s: float, tau: float) -> FloatArray:
    """The step response by Euler's method, as it stands at the samples."""
    steps = np.floor(np.maximum(T - 0.1, 0.0) / step_s + 1e-6)
    return np.asarray(GAIN * (1.0 - (1.0 - step_s / tau) ** steps))


@pytest.mark.parametrize(
    "step_s",
    [
        pytest.param(0.002, id="five in a sample"),
        pytest.param(0.01, id="a sample", marks=pytest.mark.nightly),
        pytest.param(0.05, id="five samples"),
    ],
)
def test_steps_that_nothing_shortens_widen_the_errors_to_the_truth(
    tmp_path: Path, step_s: float
) -> None:
    """Half a communication step changes nothing: seven errors off, and not a word."""
    fit, decision = fitted(build_euler_lag_fmu(tmp_path, step_s), 1)
    assert float(decision.numbers["change"]) < 1e-12
    assert decision.numbers["stands_s"] == pytest.approx(step_s, rel=0.02)
    assert "its own" in decision_in_words(decision)
    exact = GAIN * -np.expm1(-np.maximum(T - 0.1, 0.0) / TAU)
    assert decision.bound > float(np.max(np.abs(euler(step_s, TAU) - exact))) / GAIN
    for name, true in (("tau", TAU), ("gain", GAIN)):
        low, high = fit[name].interval()
        assert low <= true <= high


@pytest.mark.parametrize("step_s", [0.05, pytest.param(0.01, marks=pytest.mark.nightly)])
def test_steps_that_are_the_model_widen_nothing(tmp_path: Path, step_s: float) -> None:
    """Data of Euler's difference equation: its parameters, with the errors of the noise alone."""
    noise = SIGMA * np.random.default_rng(2).standard_normal(T.size)
    setup = ff.Setup(
        ff.Drive(), "y", accuracy=1e-3, annotation=AccuracyAnnotation(own_step="model")
    )
    y = euler(step_s, TAU) + noise
    trace = ff.Trace(T, y, setup=setup, input="u", driven=(T, U), interpolation="held")
    with ff.Fmu(build_euler_lag_fmu(tmp_path, step_s), workers=1) as fmu:
        fit = ff.fit(ff.Problem(fmu, PARAMETERS, trace), method=QUICK, starts=1)
    assert fit.result.plan is not None
    [decision] = [d for d in fit.result.plan.decisions if d.kind == Kind.STEP]
    assert decision.numbers["stands_s"] == pytest.approx(step_s, rel=0.02)
    assert "belong to the model" in decision_in_words(decision)
    assert decision.bound < 1e-12
    slopes = np.stack(
        [(euler(step_s, TAU + 1e-6) - euler(step_s, TAU - 1e-6)) / 2e-6, euler(step_s, TAU) / GAIN]
    )
    least = SIGMA * np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T)))
    for k, (name, true) in enumerate((("tau", TAU), ("gain", GAIN))):
        assert abs(fit[name].value - true) < 4.0 * fit[name].std
        assert fit[name].std == pytest.approx(least[k], rel=0.2)


@pytest.mark.parametrize(
    ("step_s", "told"),
    [
        pytest.param(0.01, False, id="a sample, undeclared"),
        pytest.param(0.005, True, id="two in a sample", marks=pytest.mark.nightly),
        pytest.param(0.004, True, id="two and a half in a sample"),
        pytest.param(0.025, True, id="two and a half samples"),
    ],
)
@pytest.mark.parametrize("own_step", ["error", "model"])
def test_the_only_steps_that_an_fmu_takes_are_kept_to(
    tmp_path: Path, step_s: float, told: bool, own_step: str
) -> None:
    """Others are refused; between their ends samples are interpolated.

    The truth is that of Euler's method over these steps, a power at any time, where they belong to
    the model, else the closed form.
    """
    since = np.maximum(T - 0.1, 0.0)
    true = -np.expm1(-since / TAU)
    if own_step == "model":
        true = 1.0 - (1.0 - step_s / TAU) ** (since / step_s)
    y = GAIN * true + SIGMA * np.random.default_rng(3).standard_normal(T.size)
    annotation = AccuracyAnnotation(own_step=own_step)
    setup = ff.Setup(ff.Drive(), "y", accuracy=1e-3, annotation=annotation)
    trace = ff.Trace(T, y, setup=setup, input="u", driven=(T, U), interpolation="held")
    path = build_euler_lag_fmu(tmp_path, step_s, told=told, refuses=True)
    with ff.Fmu(path, workers=1) as fmu:
        fit = ff.fit(ff.Problem(fmu, PARAMETERS, trace), method=QUICK, starts=1)
    assert fit.result.plan is not None
    [decision] = [d for d in fit.result.plan.decisions if d.kind == Kind.STEP]
    assert decision.numbers["step_s"] == pytest.approx(step_s)
    assert "refuses other steps" in decision_in_words(decision)
    for name, value in (("tau", TAU), ("gain", GAIN)):
        low, high = fit[name].interval()
        assert low <= value <= high


@pytest.mark.parametrize("step_s", [0.05, pytest.param(0.002, marks=pytest.mark.nightly)])
def test_a_better_method_leaves_less_than_is_told(tmp_path: Path, step_s: float) -> None:
    """Heun's, of second order, which nothing tells from outside."""
    fit, decision = fitted(build_euler_lag_fmu(tmp_path, step_s, heun=True), 1)
    assert decision.numbers["stands_s"] == pytest.approx(step_s, rel=0.02)
    for name, true in (("tau", TAU), ("gain", GAIN)):
        low, high = fit[name].interval()
        assert low <= true <= high


def test_steps_are_shortened_where_the_fit_ended(lag: ff.Fmu) -> None:
    """Communication steps are Euler's: 10 ms do for the 2 s of the start, not for 0.05 s."""
    tau, accuracy = 0.05, 5e-3
    noise = 5e-4 * np.random.default_rng(1).standard_normal(T.size)
    y = GAIN * -np.expm1(-np.maximum(T - 0.1, 0.0) / tau) + noise
    setup = ff.Setup(ff.Drive(), "y", start_values={"euler": 1.0}, accuracy=accuracy)
    trace = ff.Trace(T, y, setup=setup, input="u", driven=(T, U), interpolation="held")
    begun = (ff.Parameter("tau", 2.0, bounds=(0.02, 3.0)), PARAMETERS[1])
    fit = ff.fit(ff.Problem(lag, begun, trace), method=QUICK, starts=1)
    assert fit.result.plan is not None
    [decision] = [d for d in fit.result.plan.decisions if d.kind == Kind.STEP]
    assert float(decision.numbers["step_s"]) < 0.002
    assert decision.bound < accuracy
    low, high = fit["tau"].interval()
    assert low <= tau <= high


@pytest.mark.parametrize("accuracy", [2e-2, 2e-3])
def test_errors_are_those_of_the_noise_and_of_what_the_steps_shift(
    lag: ff.Fmu, accuracy: float
) -> None:
    """Communication steps are Euler's, whatever is wanted: their shift has a closed form.

    A bound of every sample whatever its sign is five to twenty times as large.
    """
    y = GAIN * -np.expm1(-np.maximum(T - 0.1, 0.0) / TAU)
    y += SIGMA * np.random.default_rng(1).standard_normal(T.size)
    setup = ff.Setup(ff.Drive(), "y", start_values={"euler": 1.0}, accuracy=accuracy)
    trace = ff.Trace(T, y, setup=setup, input="u", driven=(T, U), interpolation="held", sigma=SIGMA)
    fit = ff.fit(ff.Problem(lag, PARAMETERS, trace), method=QUICK, starts=1)
    assert fit.result.plan is not None
    [decision] = [d for d in fit.result.plan.decisions if d.kind == Kind.STEP]
    step_s = float(decision.numbers["step_s"])
    slopes = np.stack(
        [(euler(step_s, TAU + 1e-6) - euler(step_s, TAU - 1e-6)) / 2e-6, euler(step_s, TAU) / GAIN]
    )
    pull = np.linalg.pinv(slopes.T)
    shift = np.abs(pull @ (euler(step_s, TAU) - GAIN * -np.expm1(-np.maximum(T - 0.1, 0.0) / TAU)))
    noise = SIGMA * np.linalg.norm(pull, axis=1)
    for k, (name, true) in enumerate((("tau", TAU), ("gain", GAIN))):
        low, high = fit[name].interval()
        assert low <= true <= high
        assert 0.8 * (noise[k] + shift[k]) < fit[name].std < 2.0 * (noise[k] + shift[k]), name


def test_steps_that_shorter_ones_divide_are_shortened(tmp_path: Path) -> None:
    """Of 5 ms, which 10 ms and 5 ms hold whole."""
    fit, decision = fitted(build_euler_lag_fmu(tmp_path, 5e-3, divides=True), 1)
    assert float(decision.numbers["step_s"]) < 1e-3
    assert "stands_s" not in decision.numbers
    assert decision.bound < 1e-3
    for name, true in (("tau", TAU), ("gain", GAIN)):
        assert abs(fit[name].value - true) < 4.0 * fit[name].std


def test_steps_shorter_than_those_of_the_first_look_are_seen(tmp_path: Path) -> None:
    """Of 200 samples the whole is looked at by steps of a fortieth, which are the FMU's own.

    Euler's leave h/(2 e tau) of the largest value, 1.5e-4, where half of that is wanted.
    """
    t = 0.01 * np.arange(200)
    u = np.where(t >= 0.1, 1.0, 0.0)
    y = GAIN * -np.expm1(-np.maximum(t - 0.1, 0.0) / TAU)
    y += 1e-4 * np.random.default_rng(1).standard_normal(t.size)
    setup = ff.Setup(ff.Drive(), "y", accuracy=8e-5)
    trace = ff.Trace(t, y, setup=setup, input="u", driven=(t, u), interpolation="held")
    with ff.Fmu(build_euler_lag_fmu(tmp_path, 0.01 / 40.0, divides=True), workers=1) as fmu:
        fit = ff.fit(ff.Problem(fmu, PARAMETERS, trace), method=QUICK, starts=1)
    assert fit.result.plan is not None
    [decision] = [d for d in fit.result.plan.decisions if d.kind == Kind.STEP]
    step_s = float(decision.numbers["step_s"])
    assert step_s < 1.3e-4
    assert decision.bound > 0.99 * step_s / (2.0 * np.e * TAU)
    for name, true in (("tau", TAU), ("gain", GAIN)):
        low, high = fit[name].interval()
        assert low <= true <= high


@pytest.mark.parametrize("through", [0.0, 0.25])
def test_an_exact_fmu_stands_nowhere(lag: ff.Fmu, through: float) -> None:
    _, decision = fitted(lag, 1, through=through)
    assert "stands_s" not in decision.numbers
    assert decision.bound < 1e-12


def test_what_follows_its_input_at_once_has_no_steps_of_its_own(lag: ff.Fmu) -> None:
    """An output that moves with each recorded value, and not in between."""
    u: FloatArray = np.random.default_rng(3).standard_normal(T.size)
    setup = ff.Setup(ff.Drive(), "y", start_values={"gain": 0.0})
    trace = ff.Trace(T, 0.4 * u, setup=setup, input="u", driven=(T, u), interpolation="held")
    through = ff.Parameter("through", 0.3, bounds=(0.1, 1.0))
    fit = ff.fit(ff.Problem(lag, [through], trace), method=QUICK, starts=1)
    assert fit.result.plan is not None
    [decision] = [d for d in fit.result.plan.decisions if d.kind == Kind.STEP]
    assert "stands_s" not in decision.numbers
    assert fit["through"].value == pytest.approx(0.4, rel=1e-6)
