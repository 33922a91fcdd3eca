"""What a ringdown is summed by, and what it costs: length of its runs, calls of a run."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.campaign import ContinuationSettings
from fitting.fit.options import options_of, usual_misfit
from fitting.fmu.worker import simulation
from fitting.measurements.measurement import Measurement
from fitting.measurements.time_record import Traces

SETUP = ff.Setup(ff.Drive(), "q1")
T = np.arange(400) * 1e-3


def ringdown(values: np.ndarray, states: int = 2) -> ff.Trace:
    return ff.Trace(T, values, input="b", start="unknown", states=states, setup=SETUP)


def test_squares_are_summed_where_a_trace_is_measured_and_nobody_says_otherwise() -> None:
    traces = Traces(setup=SETUP, traces=(ringdown(np.cos(300.0 * T)),))
    peaks: Any = Measurement()
    assert usual_misfit([peaks]) == "slack"
    assert usual_misfit([peaks, traces]) == "squares"
    nothing, named = ContinuationSettings(), ContinuationSettings(misfit="absolute")
    assert options_of(nothing, [traces]).misfit == "squares"
    assert options_of(nothing, [peaks]).misfit == "slack"
    assert options_of(named, [traces]).misfit == "absolute"


def test_python_sums_squares_of_traces_too() -> None:
    method = ff.Tikhonov(levels=1)
    assert method.options(1, 1, "squares").misfit == "squares"
    assert ff.Tikhonov(misfit="slack").options(1, 1, "squares").misfit == "slack"


@pytest.mark.parametrize("periods", [2.2, 3.0, 60.0])
@pytest.mark.parametrize("damping", [0.1, 5.0])
def test_one_mode_is_spanned_by_a_run_that_is_an_eighth_longer(
    periods: float, damping: float
) -> None:
    """Cosine and sine that decay, from the response sin alone."""
    w = 2.0 * np.pi * periods / T[-1]
    both = np.exp(-damping * T)[:, np.newaxis] * np.stack([np.cos(w * T), np.sin(w * T)], axis=1)
    trace = ringdown(both @ [0.4, 0.9])
    samples = trace.pulse_window.samples
    assert samples <= 1.13 * T.size
    t = np.arange(samples) * 1e-3
    basis = trace.free_responses(np.exp(-damping * t) * np.sin(w * t))
    left = both - basis @ (basis.T @ both)
    assert np.max(np.abs(left)) < 1e-10


def test_near_modes_keep_their_long_shifts() -> None:
    trace = ringdown(np.cos(300.0 * T) + np.cos(310.0 * T), states=4)
    assert trace.pulse_window.samples == 600


class _Calls:
    """An FMU that notes when an input is set and when a step is made."""

    def __init__(self) -> None:
        self.made: list[Any] = []
        self.value = float("nan")

    def set(self, access: object, values: tuple[float, ...]) -> None:
        self.made.append(values)
        [self.value] = values

    def step(self, at: float, step: float) -> None:
        self.made.append(("step", at, self.value))

    def leave_initialisation(self) -> None:
        self.made.append("left")


def test_an_input_is_set_where_it_changes_alone() -> None:
    held = np.array([[2.0], [0.0], [0.0], [3.0]])
    seen = np.array([[2.0], [0.0], [0.0], [0.0], [3.0]])
    request: Any = SimpleNamespace(
        sampled=SimpleNamespace(values=held, at_samples=seen),
        start_time_s=0.0,
        settle_s=0.0,
        sample_step_s=1.0,
        step_s=1.0,
        samples=5,
    )
    fmu, access = _Calls(), object()
    read: list[float] = []
    stride: Any = simulation._stride_in_steps
    stride(fmu, access, request, fmu.step, lambda _: read.append(fmu.value), lambda _: None)
    assert read == [2.0, 0.0, 0.0, 0.0, 3.0]
    steps = [call[2] for call in fmu.made if call[0] == "step"]
    assert steps == [2.0, 0.0, 0.0, 3.0]
    sets = [call for call in fmu.made if isinstance(call, tuple) and call[0] != "step"]
    assert sets == [(2.0,), (0.0,), (3.0,)]
