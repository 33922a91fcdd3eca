"""A line of amplitudes of which every point is one reading in noise, by Rice's likelihood.

    R = |a g(f) + s (n1 + i n2)|        ln p = ln R/s^2 - (R - nu)^2/(2 s^2) + ln(e^-z I0(z))
    nu = a |g(f)|                       z = R nu/s^2

Averaged readings have the same mean; single ones scatter by that same noise, by s on the line and
by 0.66 s without one (`fitting.signal.roughness`). The unknowns are those of least squares: s takes
the place of the size of the noise.

Source: S. O. Rice, Bell Syst. Tech. J. 24 (1945) 46; J. Sijbers et al., IEEE Trans. Med. Imaging 17
(1998) 357, for the likelihood.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import i0e, i1e

from fitting.lines.solve import Columns, Fit, Model, fit_model
from fitting.signal.residual_tests import SMALLEST_RESIDUAL
from fitting.signal.roughness import rician, rician_deviation
from fitting.text.arrays import FloatArray

#: Steps of Newton's method, halvings of one, and relative gain of the likelihood that is none.
STEPS, HALVINGS, GAIN = 100, 30, 1e-10
#: Arguments below which I1/I0 is z/2 to rounding, and beyond which a series has its slope.
SMALL_Z, LARGE_Z = 1e-7, 1e3
#: Least eigenvalue of the scaled information of a step.
LEAST = 1e-3


def fit_readings(
    model: Model, values: FloatArray, starts: Sequence[FloatArray]
) -> tuple[Fit, float]:
    """A line fitted to single readings, and the squares with which normal noise is as likely.

    The fit is one of least squares of the mean, with the errors of the likelihood; its coefficients
    are a and s.

    Args:
        model: of |a g|, its one column |g|.
        values: amplitudes over the largest one, (n,).
        starts: where x may begin.

    Raises:
        ValueError: there is no noise, or the likelihood has no maximum.
    """
    fit = fit_model(model, values, starts)
    noise = math.sqrt(fit.squares / fit.dof)
    if not noise > SMALLEST_RESIDUAL:
        raise ValueError("its points have no noise by which to detect single readings")
    likely = [np.array([*fit.x, *fit.coefficients, math.log(noise)])]
    # where the line drowns the squares, to which noise adds a constant, are the closer begin
    powers = fit_model(_Power(model), values**2, [*starts, fit.x])
    line, floor = np.sqrt(np.maximum(powers.coefficients, SMALLEST_RESIDUAL**2))
    likely.append(np.array([*powers.x, line, math.log(floor / math.sqrt(2.0))]))
    unknowns = max(likely, key=lambda there: _value(model, values, there))
    unknowns, information, converged = _likeliest(model, values, unknowns)
    nu, slopes = _line(model, unknowns)
    sigma = math.exp(float(unknowns[-1]))
    scatter = rician_deviation(nu / sigma)
    mean_reading, slope, _ = rician(nu, sigma)
    residuals = (values - mean_reading) / scatter
    jacobian = -(slope / scatter)[:, None] * slopes
    if not np.linalg.eigvalsh(_scaled(information)[0])[0] > 1e-13:
        raise ValueError("single readings do not determine this line")
    spread = np.linalg.inv(information)[:-1, :-1] * values.size / fit.dof
    mean = -2.0 * _log_likelihood(values, nu, sigma) / values.size - 1.0 - math.log(2.0 * math.pi)
    readings = replace(
        fit,
        x=unknowns[: fit.x.size],
        coefficients=np.array([unknowns[fit.x.size], sigma * math.sqrt(values.size / fit.dof)]),
        curve=mean_reading,
        residuals=residuals,
        jacobian=jacobian,
        converged=converged,
        message="the likelihood is at its maximum" if converged else "the likelihood still rises",
    )
    variance = readings.squares / readings.dof
    return replace(readings, folds=spread / variance), values.size * math.exp(min(mean, 700.0))


@dataclass(frozen=True, eq=False)
class _Power:
    """Squares of readings: columns |g|^2 and 1."""

    model: Model

    def columns(self, x: FloatArray) -> Columns:
        values, slopes = self.model.columns(x)
        one = np.ones_like(values)
        squares = np.concatenate([values**2, one], axis=1)
        return Columns(squares, np.concatenate([2.0 * values * slopes, 0.0 * slopes], axis=2))


def _value(model: Model, values: FloatArray, unknowns: FloatArray) -> float:
    """Logarithm of the likelihood."""
    return _log_likelihood(values, _line(model, unknowns)[0], math.exp(float(unknowns[-1])))


def _line(model: Model, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """nu (n,) and its derivatives by x and a, (n, q + 1)."""
    columns = model.columns(unknowns[:-2])
    height = float(unknowns[-2])
    slopes = np.concatenate([columns.slopes[:, :, 0] * height, columns.values.T])
    return np.asarray(height * columns.values[:, 0]), np.asarray(slopes.T)


def _log_likelihood(values: FloatArray, nu: FloatArray, sigma: float) -> float:
    z = values * nu / sigma**2
    density = np.log(np.maximum(values, np.finfo(float).tiny) / sigma**2)
    return float(np.sum(density - (values - nu) ** 2 / (2.0 * sigma**2) + np.log(i0e(z))))


def _newton(
    model: Model, values: FloatArray, unknowns: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Gradient and information of the likelihood by x, a and ln s, without bends of the line.

    With q = I1/I0(z) and q' = 1 - q/z - q^2: both by nu and by ln s in closed form.
    """
    nu, slopes = _line(model, unknowns)
    variance = math.exp(2.0 * float(unknowns[-1]))
    z = np.maximum(values * nu / variance, SMALL_Z)
    q = i1e(z) / i0e(z)
    far = np.maximum(z, LARGE_Z) ** -2.0
    bend = np.where(z < LARGE_Z, 1.0 - q / z - q**2, far * (0.5 + 0.25 / z + 0.375 * far))
    by_nu = (values * q - nu) / variance
    by_noise = -2.0 + (values**2 + nu**2) / variance - 2.0 * z * q
    nu_nu = (1.0 - values**2 / variance * bend) / variance
    nu_noise = 2.0 * by_nu + 2.0 * values * z * bend / variance
    noise_noise = 2.0 * (values**2 + nu**2) / variance - 4.0 * z * q - 4.0 * z**2 * bend
    cross = slopes.T @ nu_noise
    information = np.block(
        [
            [slopes.T @ (nu_nu[:, None] * slopes), cross[:, None]],
            [cross[None, :], np.array([[float(np.sum(noise_noise))]])],
        ]
    )
    return np.append(slopes.T @ by_nu, np.sum(by_noise)), information


def _scaled(information: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The information over its diagonal, and the roots of that."""
    scale = np.sqrt(np.maximum(np.abs(np.diag(information)), np.finfo(float).tiny))
    return information / np.outer(scale, scale), scale


def _likeliest(
    model: Model, values: FloatArray, unknowns: FloatArray
) -> tuple[FloatArray, FloatArray, bool]:
    """The unknowns of largest likelihood, the information there, and whether it was reached."""
    best = _value(model, values, unknowns)
    gradient, information = _newton(model, values, unknowns)
    for _ in range(STEPS):
        matrix, scale = _scaled(information)
        least = float(np.linalg.eigvalsh(matrix)[0])
        step = np.linalg.solve(
            matrix + max(0.0, LEAST - least) * np.eye(scale.size), gradient / scale
        )
        for part in 0.5 ** np.arange(HALVINGS):
            there = unknowns + part * step / scale
            value = _value(model, values, there)
            if value >= best:
                break
        else:
            return unknowns, information, True
        gain, unknowns, best = value - best, there, value
        gradient, information = _newton(model, values, unknowns)
        if gain <= GAIN * max(1.0, abs(best)):
            return unknowns, information, True
    return unknowns, information, False
