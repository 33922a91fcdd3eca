"""A line of amplitudes of which every point is one reading in noise, by Rice's likelihood.

    R = |A g(f) + s (n1 + i n2)|,   ln p = ln R/s^2 - (R - nu)^2/(2 s^2) + ln(e^-z I0(z))
    nu = |A g(f)|,   z = R nu/s^2

The mean of R is the line in noise of root mean square sqrt(2) s, as in averaged amplitudes; what
tells single readings is that they scatter by that same noise, by s on the line and by 0.66 s
without one (`fitting.signal.rician`). The fit has the line's three unknowns and s, which a fit of
least squares has, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import i0e, i1e

from fitting.signal.least_squares import LeastSquaresFit, damped_step, minimise_squares
from fitting.signal.peaks import (
    SINGLE,
    Resonance,
    as_resonance,
    check_count,
    first_guess,
    mode_response,
)
from fitting.signal.residual_tests import SMALLEST_RESIDUAL
from fitting.signal.rician import rician_deviation, rician_mean, rician_slope
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

#: Rounds after which likelihoods that still rise have no top, and halvings of one step.
ROUNDS, HALVINGS = 100, 30
#: Rise of the logarithm of the likelihood that is none.
RISE = 1e-10
#: Step of differences in the scaled unknowns.
STEP = 1e-5
#: Arguments z below which I1/I0 is z/2 to rounding, and beyond which a series holds its slope.
SMALL_Z, LARGE_Z = 1e-7, 1e3


@dataclass(frozen=True)
class SingleReadings:
    """The line, its noise s of X and Y each, and what noise of one size would leave of squares.

    ``squares`` are those, over the largest amplitude, with which normal noise has the likelihood
    that is found here: by them forms are compared.
    """

    resonance: Resonance
    noise: float
    squares: float


def fit_single_readings(
    frequency_hz: FloatArray, amplitude: FloatArray, *, source: str = "sweep"
) -> SingleReadings:
    """Fit a line and its noise to single readings of amplitudes.

    Args:
        frequency_hz: frequencies (n,), Hz.
        amplitude: amplitudes (n,), any unit.
        source: of the data, for complaints.

    Raises:
        BadInput: too few points, no noise, no resonance among the points, or one that they do not
            hold.

    Source: S. O. Rice, Bell Syst. Tech. J. 24 (1945) 46; J. Sijbers et al., IEEE Trans. Med.
    Imaging 17 (1998) 357, for the likelihood.
    """
    check_count(frequency_hz, SINGLE, source)
    guess = first_guess(frequency_hz, amplitude)
    found = _Readings(frequency_hz, amplitude / guess[2], guess[0], guess[1])
    start = found.begun()
    if not math.exp(start[3]) > SMALLEST_RESIDUAL:
        raise BadInput(f"{source}: its points have no noise by which to detect single readings")
    x, converged = found.likeliest(start)
    curve = guess[2] * rician_mean(found.line(x), math.exp(x[3]))
    fit = found.as_squares(x, converged=converged)
    noise = guess[2] * math.sqrt(fit.variance)
    resonance = as_resonance(frequency_hz, fit, curve, guess, source)
    resonance = replace(resonance, background=complex(noise))
    shares = amplitude / guess[2]
    n = shares.size
    exponent = -2.0 * found.log_likelihood(x) / n - 1.0 - math.log(2.0 * math.pi)
    return SingleReadings(resonance=resonance, noise=noise, squares=n * math.exp(exponent))


@dataclass(frozen=True)
class _Readings:
    """Readings as shares of the largest. Unknowns: shift, log width, height, log noise."""

    f: FloatArray
    shares: FloatArray
    eta0: float
    width0: float

    def line(self, x: FloatArray) -> FloatArray:
        """nu, (n,)."""
        width = self.width0 * math.exp(float(np.clip(x[1], -50.0, 50.0)))
        eta = self.eta0 + self.width0 * float(x[0])
        return np.asarray(np.abs(x[2] * mode_response(self.f, eta, width)))

    def begun(self) -> FloatArray:
        """Where the search begins: least squares, and the noise that they leave."""
        fit = minimise_squares(lambda x: self.line(x) - self.shares, np.array([0.0, 0.0, 1.0]))
        noise = math.sqrt(max(fit.variance, np.finfo(float).tiny))
        return np.array([*fit.values, math.log(noise)])

    def log_likelihood(self, x: FloatArray) -> float:
        """Sum of the logarithms of the densities of the shares."""
        nu, variance = self.line(x), math.exp(2.0 * x[3])
        z = self.shares * nu / variance
        readings = np.maximum(self.shares, np.finfo(float).tiny)
        each = np.log(readings / variance) - (readings - nu) ** 2 / (2.0 * variance)
        return float(np.sum(each + np.log(i0e(z))))

    def slopes(self, x: FloatArray) -> FloatArray:
        """Derivatives of nu by the line's three unknowns, (n, 3)."""
        steps = STEP * np.eye(4)[:3]
        return np.stack([(self.line(x + h) - self.line(x - h)) / (2.0 * STEP) for h in steps], 1)

    def newton(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (4,) and information (4, 4) of the likelihood, without bends of the line.

        With q = I1/I0(z), q' = 1 - q/z - q^2: both by nu and by ln s in closed form.
        """
        nu, variance, r = self.line(x), math.exp(2.0 * x[3]), self.shares
        z = np.maximum(r * nu / variance, SMALL_Z)
        q = i1e(z) / i0e(z)
        far = np.maximum(z, LARGE_Z) ** -2.0
        bend = np.where(z < LARGE_Z, 1.0 - q / z - q**2, far * (0.5 + 0.25 / z + 0.375 * far))
        by_nu = (r * q - nu) / variance
        by_noise = -2.0 + (r**2 + nu**2) / variance - 2.0 * z * q
        nu_nu = (1.0 - r**2 / variance * bend) / variance
        nu_noise = 2.0 * by_nu + 2.0 * r * z * bend / variance
        noise_noise = 2.0 * (r**2 + nu**2) / variance - 4.0 * z * q - 4.0 * z**2 * bend
        columns = self.slopes(x)
        gradient = np.append(columns.T @ by_nu, np.sum(by_noise))
        information = np.empty((4, 4))
        information[:3, :3] = columns.T @ (nu_nu[:, None] * columns)
        information[:3, 3] = information[3, :3] = columns.T @ nu_noise
        information[3, 3] = float(np.sum(noise_noise))
        return gradient, information

    def likeliest(self, x: FloatArray) -> tuple[FloatArray, bool]:
        """The unknowns at the top of the likelihood, and whether it was reached."""
        value, damping = self.log_likelihood(x), 0.0
        for _ in range(ROUNDS):
            gradient, information = self.newton(x)
            scale = np.sqrt(np.maximum(np.abs(np.diag(information)), np.finfo(float).tiny))
            matrix = information / np.outer(scale, scale)
            least = float(np.linalg.eigvalsh(matrix)[0])
            raised = matrix + max(0.0, 1e-3 - least) * np.eye(4)
            rise = 0.0
            for _ in range(HALVINGS):
                step = damped_step(raised, -gradient / scale, damping) / scale
                rise = self.log_likelihood(x + step) - value
                if rise >= 0.0:
                    break
                damping = 4.0 * max(damping, 1e-3)
            if not rise > RISE * max(1.0, abs(value)):
                return x, True
            x, value, damping = x + step, value + rise, 0.1 * damping
        return x, False

    def as_squares(self, x: FloatArray, *, converged: bool) -> LeastSquaresFit:
        """The fit as one of least squares: residuals over what each point scatters, times s."""
        noise = math.exp(x[3])
        nu = self.line(x)
        scatter = rician_deviation(nu / noise)
        residuals = (rician_mean(nu, noise) - self.shares) / scatter
        jacobian = (rician_slope(nu, noise) / scatter)[:, None] * self.slopes(x)
        _, information = self.newton(x)
        freedom = float(max(1, self.f.size - jacobian.shape[1]))  # as the noise of least squares
        return LeastSquaresFit(
            values=x,
            covariance=_inverse(information) * self.f.size / freedom,
            residuals=residuals,
            jacobian=jacobian,
            converged=converged,
            message="the likelihood rises no more" if converged else "the likelihood still rises",
            freedom=freedom,
            variance=noise**2 * self.f.size / freedom,
        )


def _inverse(information: FloatArray) -> FloatArray:
    """The covariance; infinite where the likelihood has no top."""
    scale = np.sqrt(np.abs(np.diag(information)))
    if not np.all(scale > 0.0):
        return np.full(information.shape, np.inf)
    matrix = information / np.outer(scale, scale)
    if not float(np.linalg.eigvalsh(matrix)[0]) > np.finfo(float).eps * matrix.shape[0]:
        return np.full(information.shape, np.inf)
    return np.asarray(np.linalg.inv(matrix) / np.outer(scale, scale))
