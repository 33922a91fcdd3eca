"""Whether the residuals of a fit are noise, and how many independent points they are worth.

A wrong model leaves residuals that hang together. A standard error that counts every point as news
is then too small, by the square root of points over independent points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import matmul_toeplitz
from scipy.special import gammaincc

from fitting.text.arrays import FloatArray

#: Residuals count as structured where white ones would look so less often than this.
STRUCTURED = 0.01
#: Root mean square, as a share of the peak, below which residuals are rounding and not tested.
SMALLEST_RESIDUAL = 1e-6
#: Longest lag that is tested, and highest order of the autoregressive model.
LAGS = 10


@dataclass(frozen=True, kw_only=True)
class Structure:
    """What the order of the residuals tells.

    `p_value` of the test against white noise; `order` of the autoregressive model (0 where it is
    white); `points` independent points they are worth, (0, m]; `widening` >= 1, the factor on
    standard errors that took all points for independent.
    """

    p_value: float
    order: int
    points: float
    widening: float


def residual_structure(residuals: FloatArray, jacobian: FloatArray) -> Structure:
    """Test residuals (m,) of a least-squares fit for structure along the sweep; count them anew.

    They are shares of the peak. Where p < 0.01 (`white_noise_p`) their correlation matrix R is
    that of an autoregressive process (`autoregression`). With U an orthonormal basis of the n
    columns of the jacobian (m, n) and lambda the largest eigenvalue of K = U^T R U, in no direction
    is the true variance (J^T J)^-1 J^T R J (J^T J)^-1 more than lambda times what (J^T J)^-1 says,
    and the residual variance, too small by (m - tr K)/(m - n), is corrected:

        widening^2 = lambda (m - n)/(m - tr K),   points = n + (m - n)/widening^2

    For AR(1) with coefficient rho, and columns smooth on its scale, lambda is
    (1 + rho)/(1 - rho). Errors are never made smaller, and points never fewer than n + 1.

    Args:
        residuals: shares of the peak, shape (m,), in the order of the sweep.
        jacobian: their derivatives by what was fitted, shape (m, n).

    Source: sandwich covariance as in Newey and West, Econometrica 55 (1987) 703, with the
    autoregressive spectrum of den Haan and Levin, Handbook of Statistics 15 (1997) 299; the
    largest generalised effect of Rao and Scott, J. Am. Stat. Assoc. 76 (1981) 221.
    """
    m, n = residuals.size, jacobian.shape[1]
    noise = math.sqrt(float(np.mean(residuals**2)))
    p_value = white_noise_p(residuals) if noise >= SMALLEST_RESIDUAL else 1.0
    if p_value >= STRUCTURED or m <= n:
        return Structure(p_value=p_value, order=0, points=float(m), widening=1.0)
    coefficients = autoregression(residuals, _lags(m))
    left, singular, _ = np.linalg.svd(jacobian, full_matrices=False)
    basis = left[:, singular > singular[0] * np.finfo(float).eps * m]
    if basis.shape[1] == 0:  # no column sees anything
        return Structure(p_value=p_value, order=0, points=float(m), widening=1.0)
    effect = basis.T @ matmul_toeplitz(autocorrelation(coefficients, m), basis)
    worst = float(np.linalg.eigvalsh(effect)[-1])
    freedom = max(m - float(np.trace(effect)), 1.0)
    square = min(max(1.0, worst * (m - n) / freedom), float(m - n))
    return Structure(
        p_value=p_value,
        order=coefficients.size,
        points=n + (m - n) / square,
        widening=math.sqrt(square),
    )


def white_noise_p(residuals: FloatArray) -> float:
    """Probability that white noise (m,) were as autocorrelated as this; 1 for less than 10 points.

    Q_h = m (m + 2) sum_k r_k^2/(m - k), k = 1..h, is chi-square with h degrees of freedom. Taken
    for h = 1, which sees weak short correlation, and for h = min(10, m/5), which sees patterns of
    several points; twice the smaller probability (Bonferroni).

    Args:
        residuals: in the order of the sweep, shape (m,), any unit.

    Source: G. Ljung and G. Box, Biometrika 65 (1978) 297.
    """
    m = residuals.size
    power = float(residuals @ residuals)
    if _lags(m) < 2 or not power > 0.0:
        return 1.0
    k = np.arange(1, _lags(m) + 1)
    r = np.array([residuals[lag:] @ residuals[:-lag] for lag in k]) / power
    q = m * (m + 2) * np.cumsum(r**2 / (m - k))
    return float(min(1.0, 2.0 * min(gammaincc(0.5 * h, 0.5 * q[h - 1]) for h in (1, k.size))))


def _lags(points: int) -> int:
    return min(LAGS, points // 5)


def autoregression(series: FloatArray, longest: int) -> FloatArray:
    """Coefficients a (order,) of e_t = sum_k a_k e_(t-k) + noise; order 0..longest by Schwarz.

    Always stationary. Source: J. Burg (1967), the recursion of Kay and Marple, Proc. IEEE 69 (1981)
    1380; G. Schwarz, Ann. Stat. 6 (1978) 461.

    Args:
        series: shape (m,), any unit.
        longest: order, at most.
    """
    m = series.size
    forward, backward = series[1:].copy(), series[:-1].copy()
    a = best = np.zeros(0)
    variance, least = 1.0, 0.0
    for order in range(1, longest + 1):
        power = float(forward @ forward + backward @ backward)
        if not power > 0.0:
            break
        k = float(np.clip(2.0 * (forward @ backward) / power, -1.0 + 1e-9, 1.0 - 1e-9))
        a = np.append(a - k * a[::-1], k)
        variance *= 1.0 - k * k
        criterion = m * math.log(variance) + order * math.log(m)
        if criterion < least:
            best, least = a, criterion
        forward, backward = (forward - k * backward)[1:], (backward - k * forward)[:-1]
    return best


def autocorrelation(coefficients: FloatArray, length: int) -> FloatArray:
    """Autocorrelation (length,) at lags 0, 1, ... of the process with these coefficients.

    r_k = sum_j a_j r_|k - j|: linear equations for the first lags (Yule and Walker), a recursion
    for the rest.

    Args:
        coefficients: a, shape (order,).
        length: number of lags.
    """
    order = coefficients.size
    equations = np.eye(order + 1)
    for k in range(order + 1):
        for j in range(1, order + 1):
            equations[k, abs(k - j)] -= coefficients[j - 1]
    r = np.zeros(max(length, order + 1))
    r[: order + 1] = np.linalg.solve(equations, np.eye(order + 1)[0])
    for k in range(order + 1, length):
        r[k] = coefficients @ r[k - order : k][::-1]
    return np.asarray(r[:length] / r[0])
