"""A fit of any FMU to arrays in one call: to recorded time series, or to a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fitting.api.fitted import Inference, fit, profile
from fitting.api.fmu import Fmu, opened_fmu
from fitting.api.problem import Problem
from fitting.api.progress import status_line
from fitting.campaign.arrays import Parameter, Sweep
from fitting.campaign.bound import Drive, Setup
from fitting.measurements.complex_sweep import ComplexCurve, ComplexSweep
from fitting.measurements.traces import Trace
from fitting.measurements.waveform import Chirp, Pulse
from fitting.signal.scale import half_power_width
from fitting.text.arguments import checked
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput

#: Steps in a period of the tone over which an input is held: it is scaled so that its fundamental
#: is right.
HOLD_STEPS = 28
#: Start, lower and upper bound of a parameter, in the FMU's unit or as texts with a unit.
Box = tuple[float | str, float | str, float | str]
#: What is looked for, by the FMU's names or as records.
Wanted = Mapping[str, Box] | Sequence[Parameter]


@checked
def fit_trace(  # noqa: PLR0913 - keywords that all have defaults
    fmu: Fmu | str | Path,
    time_s: npt.ArrayLike,
    inputs: Mapping[str, npt.ArrayLike | Pulse | Chirp],
    outputs: Mapping[str, npt.ArrayLike],
    parameters: Wanted,
    *,
    sigma: float | Mapping[str, float] = 0.0,
    start_values: Mapping[str, Scalar] | None = None,
    derived: Sequence[str] = (),
    starts: int | None = None,
) -> Inference:
    """Fit an FMU to time series of its outputs under recorded inputs.

        p = argmin sum_k (y_k - y(t_k; p))^2/sigma^2

    The FMU begins at the first sample with its start values, as `Trace` with ``start="rest"``.

    Args:
        fmu: The FMU, its path, or a model of this project.
        time_s: Times of all samples, shape (n,), s, evenly spaced.
        inputs: Values of each input at these times, shape (n,), in the FMU's unit, joined linearly,
            or a `Pulse` or `Chirp`; empty: no drive.
        outputs: Measured values of each output, shape (n,), in the FMU's unit.
        parameters: Start, lower and upper bound by the FMU's name, in its unit or with a unit:
            ``{"c": (0.2, 0.01, 4.0)}``; or `Parameter` records.
        sigma: Standard deviation of all values or by output, in their unit; 0: from the residuals.
        start_values: Start values of other variables.
        derived: Outputs of the FMU that are reported with errors.
        starts: See `fit`.

    Returns:
        Values with intervals, as of `profile`.

    Raises:
        BadInput: names, shapes or units that do not fit the FMU.
        FmuFailure: the FMU failed inside the bounds.
    """
    if not outputs:
        raise BadInput("fit_trace: no outputs, wanted values of one at least")
    fmu, names = opened_fmu(fmu), list(outputs)
    first, *others = inputs or ("",)
    driven = {
        name: values if isinstance(values, Pulse | Chirp) else (time_s, values)
        for name, values in inputs.items()
    }
    setup = Setup(Drive(), names[0], start_values=dict(start_values or {}))
    traces = [
        Trace(
            time_s,
            outputs[name],
            setup=setup,
            input=first,
            driven=driven.get(first),
            further={other: driven[other] for other in others},
            output=name,
            label=name if len(names) > 1 else "",
            sigma=sigma.get(name, 0.0) if isinstance(sigma, Mapping) else sigma,
            unit=fmu.variables[name].unit or "1" if name in fmu.variables else "1",
            source=f"output '{name}'",
        )
        for name in names
    ]
    problem = Problem(fmu, _records(parameters), traces, derived=derived)
    return _fitted("fit_trace", fmu, problem, starts)


@checked
def fit_sweep(  # noqa: PLR0913 - keywords that all have defaults
    fmu: Fmu | str | Path,
    frequency_hz: npt.ArrayLike,
    values: npt.ArrayLike,
    parameters: Wanted,
    *,
    input_name: str = "",
    tone_names: tuple[str, str] | None = None,
    output_name: str = "",
    start_values: Mapping[str, Scalar] | None = None,
    derived: Sequence[str] = (),
    starts: int | None = None,
) -> Inference:
    """Fit an FMU to its steady response to one tone after another.

        p = argmin sum_k |L_k - g A(f_k; p)|^2        g by least squares, complex for complex values

    Other tones of the FMU must be off: of those named like ``tone_names``, as u2 and A2 next to u1
    and A1, ``start_values`` sets the amplitude to 0; everything else has its start value.

    Args:
        fmu: The FMU, its path, or a model of this project.
        frequency_hz: Frequencies of the tone, shape (n,), Hz, rising.
        values: Peak amplitudes or complex values, Re[values exp(i 2 pi f t)], shape (n,), any unit;
            noise is estimated from the residuals.
        parameters: Start, lower and upper bound by the FMU's name, in its unit or with a unit:
            ``{"c": (0.2, 0.01, 4.0)}``; or `Parameter` records.
        input_name: The driven input; empty: the only one.
        tone_names: Parameters for frequency and amplitude of a tone of the FMU; None: an input is
            driven.
        output_name: The observed output; empty: the only one.
        start_values: Start values of other variables.
        derived: Outputs of the FMU that are reported with errors.
        starts: See `fit`.

    Returns:
        Values with intervals, as of `profile`.

    Raises:
        BadInput: names, shapes or units that do not fit the FMU; several inputs or outputs, and
            none is named.
        FmuFailure: the FMU failed inside the bounds.
    """
    fmu = opened_fmu(fmu)
    f, y = np.asarray(frequency_hz, dtype=float), np.asarray(values)
    if tone_names is None:
        # more steps than these cost time alone: the plan measures what they leave
        drive = Drive(input=input_name or _only(fmu, "input"), samples_per_period=HOLD_STEPS)
    else:
        drive = Drive(frequency_names=tone_names[:1], amplitude_names=tone_names[1:])
    setup = Setup(
        drive,
        output_name or _only(fmu, "output"),
        start_values=dict(start_values or {}),
        line_width_hz=half_power_width(f, np.abs(y)),
    )
    measured = ComplexSweep(setup, ComplexCurve(f, y)) if np.iscomplexobj(y) else Sweep(setup, f, y)
    problem = Problem(fmu, _records(parameters), [measured], derived=derived)
    return _fitted("fit_sweep", fmu, problem, starts)


def _fitted(name: str, fmu: Fmu, problem: Problem, starts: int | None) -> Inference:
    """Fit and profiles; what is under way is shown as by the commands."""
    with status_line(name, lambda: f"{fmu.workers.counts.runs} runs") as show:
        show("planning")
        fitted = fit(problem, starts=starts, progress=lambda state: show(state.stage))
        return profile(fitted, progress=lambda spent: show(spent.stage))


def _records(parameters: Wanted) -> list[Parameter]:
    if not isinstance(parameters, Mapping):
        return list(parameters)
    for name, box in parameters.items():
        if np.shape(box) != (3,):
            raise BadInput(f"parameter '{name}': found {box!r}, wanted (start, lower, upper)")
    return [Parameter(n, start, bounds=(low, high)) for n, (start, low, high) in parameters.items()]


def _only(fmu: Fmu, causality: str) -> str:
    """The only input or output of an FMU."""
    names = [n for n, variable in fmu.variables.items() if variable.causality == causality]
    if len(names) != 1:
        present = ", ".join(names[:6]) or "none"
        raise BadInput(
            f"fit_sweep: {causality}_name is empty, and the FMU has {present}; wanted one of them"
        )
    return names[0]
