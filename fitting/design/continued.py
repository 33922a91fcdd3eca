"""What new sweeps continue: the sweeps over a control that a campaign has, of either kind.

Amplitudes, `[control_sweep]`, have one row for each point and a real scale; complex values,
`[complex_control_sweep]`, a row for each quadrature, a complex gain, a background and a cable:

    A = chi |P|                          dA/d ln chi = A
    S = e (a P + b + b' x)               dS/d(a, b, b') = e (P, 1, x)
    e = exp(-i 2 pi (u - u0) tau)        dS/d tau = -i 2 pi (u - u0) S

P is the response of the FMU, wirings as in `fitting.measurements.complex.wiring`. Gains, scales and
backgrounds are unknown in a new sweep; where they stand in derivatives they are taken to be those
of the sweep so far whose scale is the median.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from fitting.campaign.kind import BoundMeasurement
from fitting.extension.problem import Parameter
from fitting.extension.records import BoundCampaign, Measurement, Prediction
from fitting.measurements.complex.sweep import DELAY, ComplexSweep
from fitting.measurements.control.sweep import ControlSweep
from fitting.text.arrays import ComplexArray, FloatArray, Scalar, both_parts
from fitting.text.errors import BadInput

#: Prior of the logarithm of a scale that all new sweeps share: nothing is known of it.
ANY_SCALE = 10.0
#: Standard deviation of a phase that may be any, rad.
ANY_PHASE = math.pi / math.sqrt(3.0)


@dataclass(frozen=True, kw_only=True)
class Responses:
    """The FMU's responses at one place, over one set of frequencies (m,) in Hz.

    Phasors `values` (sweeps, m) and their derivatives `by_x` (sweeps, m, n) in the search vector;
    `p` (n,) are the values of the `parameters` there.
    """

    frequency_hz: FloatArray
    values: ComplexArray
    by_x: ComplexArray
    parameters: Sequence[Parameter]
    p: FloatArray


@dataclass(frozen=True, kw_only=True)
class SweepRows:
    """Sweeps at one place, in the detector's unit: (sweeps, m) points, (sweeps, r) rows.

    `amplitude` (sweeps, m) are moduli. Rows are the amplitudes, or all real parts before all
    imaginary ones: their derivatives by the search vector `by_x` (sweeps, r, n), by what each sweep
    has of its own and is solved `inside` (sweeps, r, k), and by what all new ones have in common,
    `shared` (sweeps, r, l). `rectified`: amplitudes are magnitudes of noisy quadratures.
    """

    amplitude: FloatArray
    by_x: FloatArray
    inside: FloatArray
    shared: FloatArray
    rectified: bool

    @property
    def largest(self) -> FloatArray:
        """Largest amplitude of every sweep, (sweeps, 1)."""
        return np.asarray(np.max(self.amplitude, axis=1, keepdims=True))


@dataclass(frozen=True, kw_only=True)
class SweepSoFar:
    """One sweep so far: `settings`, and moduli and noise (n,) at its frequencies (n,) in Hz.

    `sigma` is of an amplitude or of each quadrature, 0 where nothing tells it.
    """

    settings: Mapping[str, Scalar]
    frequency_hz: FloatArray
    amplitude: FloatArray
    sigma: FloatArray


@dataclass(frozen=True, kw_only=True)
class Continued:
    """Sweeps of a campaign that new ones continue.

    `table` of the campaign, with its `measurement` and `sweeps`; `units` of the controls, `unit` of
    the values, the `output` that is seen. `estimated`: their noise is told by their scatter.
    `of_files` are keys of the table that tell of the files so far, `columns` what is measured at
    every point. `nuisances` are prior standard deviations of what all new sweeps have in common,
    `scale` what is taken of it, in words, and `rows` makes rows of the prediction of the sweeps so
    far and of responses.
    """

    table: str
    measurement: BoundMeasurement
    sweeps: tuple[SweepSoFar, ...]
    units: Mapping[str, str]
    unit: str
    output: str
    estimated: bool
    of_files: tuple[str, ...]
    columns: tuple[str, ...]
    nuisances: tuple[float, ...]
    scale: str
    rows: Callable[[Prediction, Responses], SweepRows]
    has_own_drive: bool = False

    @property
    def last(self) -> Mapping[str, Scalar]:
        """Settings of the last sweep."""
        return self.sweeps[-1].settings

    @property
    def largest(self) -> float:
        """The largest amplitude that was seen."""
        return max(float(np.max(s.amplitude)) for s in self.sweeps)

    def is_made_of(self, measurement: Measurement) -> bool:
        """Whether a measurement of a fit is that of these sweeps.

        Args:
            measurement: one of those of the campaign.
        """
        own = self.measurement
        return type(measurement) is type(own) and list(measurement.places) == list(own.places)

    def heads(self, table: Mapping[str, object]) -> list[str]:
        """Heads of the columns that are measured, each with its unit.

        Args:
            table: of the campaign, as it is written; amplitudes keep their unit.
        """
        unit = str(table.get("amplitude", self.unit)).split()[0]
        return [f"{name} ({unit})" for name in self.columns]


def continued_of(bound: BoundCampaign) -> Continued:
    """What new sweeps of a campaign continue: its control sweep, else its complex one.

    Args:
        bound: the campaign.

    Raises:
        BadInput: it has neither.
    """
    found = bound.measurements
    amplitudes = found.get("control_sweep")
    if isinstance(amplitudes, ControlSweep):
        return _of_amplitudes(amplitudes)
    quadratures = found.get("complex_control_sweep")
    if isinstance(quadratures, ComplexSweep):
        return _of_quadratures(quadratures)
    raise BadInput(
        f"{bound.path}: [design] sweeps: has no table [control_sweep] or [complex_control_sweep], "
        "whose sweeps could be continued; wanted one, or no sweeps"
    )


def _of_amplitudes(sweep: ControlSweep) -> Continued:
    words = {
        "each": "each has a scale of its own, of which nothing is known",
        "shared": "they share one scale, of which nothing is known",
        "none": "their scale is known to be 1",
    }
    return Continued(
        table="control_sweep",
        measurement=sweep,
        sweeps=tuple(
            SweepSoFar(settings=s.settings, frequency_hz=s.u_hz, amplitude=s.y, sigma=s.sigmas)
            for s in sweep.spectra
        ),
        units=sweep.units,
        unit=sweep.unit,
        output=sweep.output or sweep.setup.output,
        estimated=sweep.estimated,
        of_files=("layout", "range", "columns"),
        columns=("amplitude",),
        nuisances=(ANY_SCALE,) if sweep.scaled_by == "shared" else (),
        scale=words[sweep.scaled_by],
        rows=partial(_amplitude_rows, sweep),
        has_own_drive=any(bool(np.any(s.level != 1.0)) for s in sweep.spectra),
    )


def _amplitude_rows(sweep: ControlSweep, seen: Prediction, responses: Responses) -> SweepRows:
    chi = _scale(sweep, seen)
    amplitude = chi * np.abs(responses.values)
    turn = np.exp(-1j * np.angle(responses.values))[..., np.newaxis]
    scale, none = amplitude[..., np.newaxis], np.zeros((*amplitude.shape, 0))
    return SweepRows(
        amplitude=amplitude,
        by_x=chi * (turn * responses.by_x).real,
        inside=scale if sweep.scaled_by == "each" else none,
        shared=scale if sweep.scaled_by == "shared" else none,
        rectified=sweep.rectified and not sweep.logarithmic,
    )


def _scale(sweep: ControlSweep, seen: Prediction) -> float:
    """From simulated to measured amplitudes, the median of all measured spectra's."""
    shared = sweep.scale(seen)
    values = np.asarray(seen.values, dtype=float)
    scaled = sweep.scaled(seen, 1.0 if shared is None else shared.value)
    return float(np.median(scaled[values > 0.0] / values[values > 0.0]))


def _of_quadratures(sweeps: ComplexSweep) -> Continued:
    last = sweeps.records[-1]
    words = "each has a complex gain of its own, of which nothing is known"
    nuisances: tuple[float, ...] = ()
    if last.shared:
        words = "they share one complex gain, of which nothing is known"
        nuisances = (ANY_SCALE, ANY_PHASE)
    if last.restarted:
        words = "they share the modulus of their gains, of which nothing is known"
        nuisances = (ANY_SCALE,)
    if last.wiring.columns > 1:
        words += ", and each a background of its own"
    return Continued(
        table="complex_control_sweep",
        measurement=sweeps,
        sweeps=tuple(
            SweepSoFar(
                settings=c.settings,
                frequency_hz=c.u_hz,
                amplitude=np.abs(c.y),
                sigma=np.full(c.y.size, c.sigma or c.scatter()),
            )
            for c in sweeps.records
        ),
        units=sweeps.units,
        unit=last.unit,
        output=last.output or sweeps.setup.output,
        estimated=any(c.sigma == 0.0 for c in sweeps.records),
        of_files=("layout", "range", "columns"),
        columns=("X", "Y"),
        nuisances=nuisances,
        scale=words,
        rows=partial(_quadrature_rows, sweeps),
    )


def _quadrature_rows(sweeps: ComplexSweep, seen: Prediction, responses: Responses) -> SweepRows:
    """Rows of complex sweeps; all derivatives are complex ones until the last line."""
    u, curve = responses.frequency_hz, sweeps.records[-1]
    middle_hz = 0.5 * float(u[0] + u[-1])
    name = sweeps.delay_name(curve)
    names = [q.name if q.role == DELAY else "" for q in responses.parameters]
    at = names.index(name) if curve.delay_s is None else None
    delay_s = float(responses.p[at]) if at is not None else float(curve.delay_s or 0.0)
    coefficients = _coefficients(sweeps, seen, u)
    columns = np.stack(
        [curve.wiring.design(u, h, delay_s, middle_hz) for h in responses.values]
    )  # (sweeps, m, k)
    values = columns @ coefficients
    gain = coefficients[0] * columns[..., :1]
    turn = np.exp(-2j * np.pi * (u - middle_hz) * delay_s)
    by_x = coefficients[0] * turn[:, np.newaxis] * responses.by_x
    if at is not None:
        by_delay = -2j * np.pi * (u - middle_hz) * values
        by_x[..., at] = by_delay * responses.parameters[at].scale
    own, shared = [columns[..., 1:], 1j * columns[..., 1:]], [gain[..., :0]]
    (shared if curve.shared else own).append(gain)
    (shared if curve.shared and not curve.restarted else own).append(1j * gain)
    return SweepRows(
        amplitude=np.abs(values),
        by_x=both_parts(by_x, axis=1),
        inside=both_parts(np.concatenate(own, axis=-1), axis=1),
        shared=both_parts(np.concatenate(shared, axis=-1), axis=1),
        rectified=False,
    )


def _coefficients(sweeps: ComplexSweep, seen: Prediction, u_hz: FloatArray) -> ComplexArray:
    """Gain and background (k,) for a sweep over u, those of the one whose gain is the median.

    A slope belongs to the middle and the span of its sweep: it is written for those of the new one.
    """
    order = np.argsort([abs(solved.coefficients[0]) for solved in seen.solved])
    k = int(order[(len(order) - 1) // 2])
    found, old = np.array(seen.solved[k].coefficients), sweeps.records[k].u_hz
    if found.size > 2:
        first = sweeps.records[0].u_hz
        old_middle, new_middle = (0.5 * float(v[0] + v[-1]) for v in (first, u_hz))
        by_hz = found[2] / (0.5 * float(np.ptp(old)))
        found[1] += by_hz * (new_middle - old_middle)
        found[2] = by_hz * 0.5 * float(np.ptp(u_hz))
    return found
