"""Measurements and answers of tests that have no FMU: arrays in, records of the fit out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fitting.campaign import BoundCampaign, Drive, Experiment, Setup
from fitting.campaign.joint import is_shared
from fitting.fit.problem import problem_of
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.fmu.description import FmuVariable
from fitting.measurements.dataset import Dataset
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.fmu_response import FmuResponse
from fitting.measurements.measurement import Evaluation, Measurement, Prediction
from fitting.measurements.plan import Plan
from fitting.measurements.planning import measured_plan, plan_series
from fitting.measurements.sweep import Sweep
from fitting.measurements.tones import Tones
from fitting.signal.scale import Maximum
from fitting.simulate.batch import Workers
from fitting.simulate.probe import Knowledge
from fitting.text.arrays import ComplexArray, FloatArray, Scalar

#: Of a drive that nothing in such a test applies.
SETUP = Setup(
    Drive(
        frequency_names=("u1", "u2"),
        amplitude_names=("A1", "A2"),
    ),
    "q1_hybrid",
)


def linear(bound: BoundCampaign) -> BoundCampaign:
    """The campaign without its offsets: a drift that is interpolated, as the paper has it."""
    return replace(bound, parameters=tuple(filter(is_shared, bound.parameters)))


def peaks_measurement(
    peaks_v: FloatArray, sigmas_v: FloatArray | None = None, *, series: str = ""
) -> Tones:
    """All peaks as the lines of one experiment."""
    peaks_v = np.asarray(peaks_v, dtype=float)
    sigmas_v = np.zeros(peaks_v.size) if sigmas_v is None else np.asarray(sigmas_v, dtype=float)
    tones = tuple(float(k + 1) for k in range(peaks_v.size))
    one = Experiment(
        label="all",
        settings={},
        tones_hz=tones,
        peaks_v=peaks_v,
        sigmas_v=sigmas_v,
        floor_v=0.0,
        spectrum=None,
    )
    return Tones(SETUP, (one,), series=series)


def sweep_measurement(
    amplitude_v: FloatArray,
    *,
    scale: str = "maximum",
    fitted: bool = False,
    maximum_v: float = 0.0,
    sigmas_v: FloatArray | None = None,
    series: str = "",
) -> Sweep:
    """A sweep over frequencies 1, 2, 3 ... Hz; `sigmas_v` are known where they are given."""
    amplitude_v = np.asarray(amplitude_v, dtype=float)
    return Sweep(
        setup=SETUP,
        frequency_hz=np.arange(1.0, amplitude_v.size + 1.0),
        amplitude_v=amplitude_v,
        series=series,
        fitted=fitted,
        scaled_by=scale,
        sigmas_v=np.empty(0) if sigmas_v is None else sigmas_v,
        known=sigmas_v is not None,
        maximum_v=maximum_v,
    )


def dataset(
    peaks_v: FloatArray,
    sigmas_v: FloatArray | None = None,
    sweep: Sweep | None = None,
    *,
    weigh: bool = False,
    outliers: str = "keep",
) -> Dataset:
    """Peaks (may be empty) and a sweep, as one series."""
    made: list[Measurement] = []
    if np.size(peaks_v):
        made.append(peaks_measurement(peaks_v, sigmas_v))
    if sweep is not None:
        made.append(sweep)
    return Dataset(tuple(made), weigh=weigh, outliers=outliers)


def answer(
    peaks: FloatArray | ComplexArray | None = None,
    sweep: FloatArray | None = None,
    maximum: Maximum | None = None,
    runs: int = 0,
) -> Evaluation:
    """An answer to the measurements of `dataset`: those of peaks first, then that of the sweep."""
    predictions = [] if peaks is None else [Prediction(peaks)]
    if sweep is not None or maximum is not None:
        predictions.append(Prediction(np.empty(0) if sweep is None else sweep, maximum))
    return Evaluation(tuple(predictions), runs)


def drafted(bound: BoundCampaign) -> Plan:
    """The plan of one campaign from what it says of itself."""
    return plan_series(problem_of([bound]).planned_together(""))


def planned_with(
    bound: BoundCampaign,
    workers: Workers,
    variables: Mapping[str, FmuVariable],
    own: AccuracyAnnotation | None = None,
) -> Plan:
    """The plan of one campaign, measured with its FMU."""
    known = Knowledge(own or AccuracyAnnotation(), variables)
    return measured_plan(problem_of([bound]).planned_together(""), workers, known)


def through(
    workers: Workers, bound: BoundCampaign, plan: Plan, alternative: Mapping[str, Scalar]
) -> FmuResponse:
    """The FMU as the response of one campaign under a plan."""
    return FmuResponse(
        workers=workers,
        parameters=bound.parameters,
        measurements=problem_of([bound]).measurements,
        models={
            "": DrivenModel(
                setup=bound.setup, parameters=bound.parameters, plan=plan, alternative=alternative
            )
        },
        derived={"": bound.derived},
    )
