"""Whether the residuals of a fit are noise of one size, and how many independent points they are.

A wrong model leaves residuals that are correlated. A standard error that counts every point as news
is then too small, by the square root of points over independent points. Noise that grows with the
amplitude leaves the largest residuals where the model is steepest: a standard error that takes all
points for equally good is then too small, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import matmul_toeplitz, solve_banded
from scipy.special import fdtrc, gammaincc

from fitting.text.arrays import FloatArray
from fitting.text.notation import probability

#: Residuals count as structured where white ones would look so less often than this.
STRUCTURED = 0.01
#: Root mean square, as a share of the peak, below which residuals are rounding and not tested.
SMALLEST_RESIDUAL = 1e-6
#: Longest lag that is tested, and highest order of the autoregressive model.
LAGS = 10
#: Power of the size of a residual that is close to normal, and regressors per point, at most.
NORMAL_POWER, REGRESSORS = 2.0 / 3.0, 0.2
#: Numbers in all products of slopes, at most: 240 MB.
MOST_PRODUCTS = 30_000_000
#: Leverage that a residual is taken to have at most: of one that the fit hits exactly none is left.
MOST_LEVERAGE = 1.0 - 1e-6
#: Length of a unit slope, what is solved for projected out, below which it is one of these.
MOST_EXPLAINED = 1e-7
#: Of a map, noise of one size is drawn so often for what it does to errors by chance; the seed.
DRAWS, SEED = 400, 20
#: What residuals do that are not noise of one size, as all sentences put it.
TOGETHER, UNEQUAL = "are correlated", "are heteroscedastic"
#: Widening of the errors from which it is reported: what would be printed as one is not.
NOTABLE = 1.05


@dataclass(frozen=True, kw_only=True)
class Structure:
    """Tests of the residuals for noise.

    `p_value` of white noise, `sizes_p` of noise of one size; `order` of the autoregressive model
    (0: white); `points`: effective sample size, (0, m]; factors >= 1: `widening` on standard
    errors, `together` for correlation alone, `excess`: the part of both beyond stated noise.
    """

    p_value: float
    sizes_p: float
    order: int
    points: float
    widening: float
    together: float
    excess: float = 1.0

    @property
    def is_noise(self) -> bool:
        """Whether the residuals are noise of one size, by both tests."""
        return min(self.p_value, self.sizes_p) >= STRUCTURED

    @property
    def is_unequal(self) -> bool:
        """Whether the residuals are larger at some points than at others."""
        return UNEQUAL in self.deviations

    @property
    def deviations(self) -> tuple[str, ...]:
        """What the residuals do that noise of one size does not, in words."""
        return tuple(words for words, _, _ in self._deviations)

    @property
    def departure(self) -> str:
        """The same with the probabilities of it."""
        words = (f"{words} ({probability(p)} for {noise})" for words, p, noise in self._deviations)
        return " and ".join(words)

    @property
    def _deviations(self) -> list[tuple[str, float, str]]:
        """What they do, how probably, and of which noise."""
        tests = (
            (TOGETHER, self.p_value, "white noise"),
            (UNEQUAL, self.sizes_p, "noise of one size"),
        )
        return [test for test in tests if test[1] < STRUCTURED]

    def beyond(self, square: float) -> Structure:
        """The same of residuals whose noise is stated: where correlated, they count as they are.

        The effective sample size is how many points there are, not how large the residuals are.

        Args:
            square: chi square by the stated noise over its degrees of freedom.
        """
        excess = math.sqrt(max(1.0, square)) if self.order else 1.0
        return replace(
            self,
            excess=self.excess * excess,
            widening=self.widening * excess,
            together=self.together * excess,
        )


def residual_structure(
    residuals: FloatArray,
    jacobian: FloatArray,
    nuisance: FloatArray | None = None,
    stretches: Sequence[FloatArray] = (),
    *,
    quadratures: bool = False,
) -> Structure:
    """Test residuals (m,) of a least-squares fit for structure along the sweep; count them anew.

    They are shares of the peak. Where p < 0.01 (`white_noise_p`) their correlation matrix R is
    that of an autoregressive process (`autoregression`). With U an orthonormal basis of the n
    columns of the jacobian (m, n), what is solved for besides projected out of them (of no interest
    for the error of a curve's own scale), and lambda the largest eigenvalue of K = U^T R U, in no
    direction is the true variance (J^T J)^-1 J^T R J (J^T J)^-1 more than lambda times what
    (J^T J)^-1 is, and the residual variance, too small by (m - tr K)/(m - n), is corrected:

        widening^2 = lambda (m - n)/(m - tr K),   points = n + (m - n)/widening^2

    For AR(1) with coefficient rho, and columns smooth on its scale, lambda is
    (1 + rho)/(1 - rho). Where p < 0.01 (`one_size_p`), K is that of the sizes as they are, with e
    what the autoregression leaves of the residuals r, h the leverages, and V what its inverse,
    transposed, makes of U (U itself where they are white),

        K = V^T diag(e^2/(1 - h)^2) V,   widening^2 = lambda (m - n)/sum r^2

    if that is more. The largest of several eigenvalues of squares as they are is above one for
    noise of one size, too: of a map, whose few high points decide all, lambda/sum e^2 is compared
    with 400 draws of it. Where one draw in a hundred has as much, sizes change no errors; else
    widening^2 is their ratio, the median of the draws below, unless residuals are correlated. (Of
    single curves the draws would hide what does harm: 40 points with 1 % of each as noise.) Errors
    are never made smaller, and points never fewer than n + 1.

    Args:
        residuals: shares of the peak, shape (m,), in the order of the sweep.
        jacobian: their derivatives by what was fitted, shape (m, n).
        nuisance: their derivatives by what was solved for besides, whose errors are not printed,
            shape (m, k); None: nothing.
        stretches: likewise of rows that follow each other, each with unknowns of its own, shapes
            (m_j, k_j) with all m_j together m; none: nothing.
        quadratures: whether rows are all real parts of complex residuals, then all imaginary ones.
            What both have in common, r, adds to the errors: widening^2 (1 + |r|).

    Source: sandwich covariance as in Newey and West, Econometrica 55 (1987) 703, with the
    autoregressive spectrum of den Haan and Levin, Handbook of Statistics 15 (1997) 299; HC3 of
    MacKinnon and White, J. Econometrics 29 (1985) 305; the largest generalised effect of Rao and
    Scott, J. Am. Stat. Assoc. 76 (1981) 221.
    """
    nuisance = np.empty((residuals.size, 0)) if nuisance is None else nuisance
    m, n = (
        residuals.size,
        jacobian.shape[1] + nuisance.shape[1] + sum(s.shape[1] for s in stretches),
    )
    noise = math.sqrt(float(np.mean(residuals**2)))
    plain = Structure(
        p_value=1.0, sizes_p=1.0, order=0, points=float(m), widening=1.0, together=1.0
    )
    if noise < SMALLEST_RESIDUAL:
        return plain
    p_value, slopes = white_noise_p(residuals), _Slopes.of(jacobian, nuisance, stretches)
    if m <= n or slopes.requested.shape[1] == 0:  # nothing is left, or no column sees anything
        return replace(plain, p_value=p_value)
    coefficients, news, sizes_p = _whitened(residuals, slopes, p_value)
    unequal = sizes_p < STRUCTURED or (
        slopes.of_map and p_value < STRUCTURED and one_size_p(residuals, slopes.whole) < STRUCTURED
    )
    if unequal and (robust := white_noise_p(residuals, equal=False)) >= STRUCTURED:
        p_value = robust  # a few large ones among small ones only look as if they hung together
        coefficients, news, sizes_p = _whitened(residuals, slopes, p_value)
    together = min(_correlated(coefficients, slopes, m - n), float(m - n))
    square, common = together, 1.0
    if quadratures and coefficients.size:
        # a curve that is missing in the model bends both parts alike: they are less than two
        one, other = np.split(residuals, 2)
        common = 1.0 + abs(float(one @ other)) / math.sqrt(float(one @ one) * float(other @ other))
    if sizes_p < STRUCTURED:
        part, by_chance = _unequal(residuals, news, slopes, coefficients)
        square, sizes_p = max(square, part * (m - n)), max(sizes_p, by_chance)
    square = min(square * common, float(m - n))
    return Structure(
        p_value=p_value,
        sizes_p=sizes_p,
        order=coefficients.size,
        points=n + (m - n) / square if square > 1.0 else float(m),
        widening=math.sqrt(square),
        together=math.sqrt(together),
    )


@dataclass(frozen=True)
class _Slopes:
    """Orthonormal bases: `stretches` of rows with slopes of their own, `nuisance`, `requested`.

    `nuisance` (m, k) are slopes of what is solved for besides in all rows, `requested` (m, q) those
    with errors. What comes before is projected out of each (Frisch, Waugh, Lovell): estimates
    of what is asked are sums of residuals over the last ones alone. Many stretches are never an
    array of all rows and all their unknowns.
    """

    stretches: tuple[FloatArray, ...]
    nuisance: FloatArray
    requested: FloatArray

    @classmethod
    def of(
        cls, jacobian: FloatArray, nuisance: FloatArray, stretches: Sequence[FloatArray]
    ) -> _Slopes:
        """Bases of derivatives by what was fitted and by what was solved for besides."""
        each = tuple(_basis(s) for s in stretches if s.shape[0])
        each = each if any(s.shape[1] for s in each) else ()
        if not each and not nuisance.shape[1]:
            return cls((), nuisance, _basis(jacobian))
        apart = _apart(nuisance, lambda unit: _less(each, unit)) if each else nuisance
        nuisance = _basis(apart)
        return cls(
            each,
            nuisance,
            _basis(_apart(jacobian, lambda unit: _less((nuisance,), _less(each, unit)))),
        )

    @cached_property
    def whole(self) -> FloatArray:
        """Basis of all slopes but those of stretches, (m, k + q)."""
        return np.column_stack([self.nuisance, self.requested])

    def left(self, values: FloatArray) -> FloatArray:
        """What a fit leaves of values (m,)."""
        return _less((self.whole,), _less(self.stretches, values))

    @property
    def of_map(self) -> bool:
        """Whether something is solved for whose errors are not printed."""
        return int(self.nuisance.shape[1]) > 0

    @cached_property
    def leverage(self) -> FloatArray:
        """Share of every residual that the fit takes away, (m,), below one."""
        shares = np.sum(self.whole**2, axis=1)
        if self.stretches:
            shares = shares + np.concatenate([np.sum(s**2, axis=1) for s in self.stretches])
        return np.asarray(np.minimum(shares, MOST_LEVERAGE))


def _less(bases: Sequence[FloatArray], values: FloatArray) -> FloatArray:
    """Values (m, ...) less their shares along orthonormal bases of rows that follow each other."""
    if not bases:
        return values
    ends = np.cumsum([len(basis) for basis in bases])[:-1]
    parts = zip(bases, np.split(values, ends), strict=True)
    return np.concatenate([part - basis @ (basis.T @ part) for basis, part in parts])


def _apart(columns: FloatArray, without: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Columns (m, n) of length one, what others make of them taken out, where more is left."""
    sizes = np.linalg.norm(columns, axis=0)
    left = without(columns / np.where(sizes > 0.0, sizes, 1.0))
    explained = np.linalg.norm(left, axis=0) < MOST_EXPLAINED  # what is left of it is rounding
    return left[:, ~explained]


def _unequal(
    residuals: FloatArray, news: FloatArray, slopes: _Slopes, coefficients: FloatArray
) -> tuple[float, float]:
    """Square of the widening by sizes as they are, over m - n, and the probability of as much.

    Both are zero where it may be chance, the second where nothing is drawn.

    Args:
        residuals: r, (m,).
        news: e, what an autoregression leaves of them, (m,).
        slopes: of what was fitted.
        coefficients: of the autoregression.
    """
    coloured = _coloured(coefficients, slopes.requested)
    weights = 1.0 / (1.0 - slopes.leverage)

    def worst(e: FloatArray) -> float:
        scaled = (e * weights)[:, None] * coloured
        return float(np.linalg.eigvalsh(scaled.T @ scaled)[-1])

    plain = worst(news) / float(residuals @ residuals)
    if not slopes.of_map:
        return plain, 0.0
    rng = np.random.default_rng(SEED)
    noise = (rng.standard_normal(news.size) for _ in range(DRAWS))
    left = map(slopes.left, noise)
    drawn = np.array([worst(e) / float(e @ e) for e in left])
    share = worst(news) / float(news @ news)
    by_chance = (1.0 + np.count_nonzero(drawn >= share)) / (1.0 + DRAWS)
    if by_chance >= STRUCTURED:
        return 0.0, 0.0
    freedom = news.size - slopes.whole.shape[1] - sum(s.shape[1] for s in slopes.stretches)
    beyond = share / (float(np.median(drawn)) * freedom)
    return plain if coefficients.size else beyond, float(by_chance)


def _whitened(
    residuals: FloatArray, slopes: _Slopes, p_value: float
) -> tuple[FloatArray, FloatArray, float]:
    """Autoregression of residuals that are correlated, what it leaves, and whether of one size."""
    if p_value >= STRUCTURED:
        return np.zeros(0), residuals, one_size_p(residuals, slopes.requested, slopes.leverage)
    coefficients, news = innovations(residuals)
    first = coefficients.size  # what stands before these is not known
    known = one_size_p(news[first:], slopes.requested[first:], slopes.leverage[first:])
    return coefficients, news, known


def _coloured(coefficients: FloatArray, basis: FloatArray) -> FloatArray:
    """A^-T U (m, n), A the matrix that makes of residuals what the autoregression leaves."""
    if not coefficients.size:
        return basis
    order, m = coefficients.size, basis.shape[0]
    bands = np.ones((order + 1, m))  # of A^T: the diagonal last, lag k as row order - k
    bands[:-1] = -coefficients[::-1, None]
    return np.asarray(solve_banded((0, order), bands, basis))


def _basis(jacobian: FloatArray) -> FloatArray:
    """An orthonormal basis of the columns, (m, rank)."""
    left, singular, _ = np.linalg.svd(jacobian, full_matrices=False)
    if not singular.size:
        return left
    return left[:, singular > singular[0] * np.finfo(float).eps * jacobian.shape[0]]


def _correlated(coefficients: FloatArray, slopes: _Slopes, freedom: int) -> float:
    """Square of the widening, at least 1, for residuals that follow an autoregression."""
    if not coefficients.size:
        return 1.0
    m, q = slopes.requested.shape
    lags = autocorrelation(coefficients, m)
    effect = slopes.whole.T @ matmul_toeplitz(lags, slopes.whole)
    taken = float(np.trace(effect))
    for each in slopes.stretches:
        if each.shape[1]:
            taken += float(np.sum(each * matmul_toeplitz(lags[: len(each)], each)))
    worst = float(np.linalg.eigvalsh(effect[-q:, -q:])[-1])  # those that are requested come last
    return float(max(1.0, worst * freedom / max(m - taken, 1.0)))


def one_size_p(
    residuals: FloatArray, basis: FloatArray, leverage: FloatArray | None = None
) -> float:
    """Probability that noise of one size had sizes that go so with the slopes.

    |r_i|^(2/3)/(1 - h_i)^(1/3), which is close to normal for normal noise, is regressed on the
    leverages h_i = sum_k U_ik^2, and on all products U_ik U_il if they are fewer than a fifth of
    the points, on the squares U_ik^2 alone where all are too many to be kept (`MOST_PRODUCTS`); F
    tests, twice the smaller probability (Bonferroni). These are the sizes that a standard error
    notices. 1 for less than 10 points.

    Args:
        residuals: that follow no pattern, shape (m,), any unit.
        basis: U, orthonormal, of the slopes of what was fitted, shape (m, n).
        leverage: h, shape (m,), where more was fitted than U has; None: it has all.

    Source: H. White, Econometrica 48 (1980) 817, R. Koenker, J. Econometrics 17 (1981) 107; the
    power by E. Wilson and M. Hilferty, Proc. Natl. Acad. Sci. 17 (1931) 684.
    """
    if _lags(residuals.size) < 2:
        return 1.0
    if leverage is None:
        leverage = np.minimum(np.sum(basis**2, axis=1), MOST_LEVERAGE)
    sizes = (np.abs(residuals) / np.sqrt(1.0 - leverage)) ** NORMAL_POWER
    one, two = np.tril_indices(basis.shape[1])
    if one.size * residuals.size > MOST_PRODUCTS:
        one = two = np.arange(basis.shape[1])
    tests = [leverage[:, None]]
    if one.size < REGRESSORS * residuals.size:
        tests.append(np.asarray(basis[:, one] * basis[:, two]))
    return min(1.0, len(tests) * min(_regression_p(sizes, columns) for columns in tests))


def _regression_p(values: FloatArray, columns: FloatArray) -> float:
    """Probability that values (m,) have so much to do with columns (m, q) by chance; F test."""
    spread = values - np.mean(values)
    basis = _basis(columns - np.mean(columns, axis=0))
    freedom = values.size - basis.shape[1] - 1
    if basis.shape[1] == 0 or freedom < 1:
        return 1.0
    explained = basis.T @ spread
    gained = float(explained @ explained)
    left = float(spread @ spread) - gained
    if not left > 0.0:
        return 1.0 if not gained > 0.0 else 0.0
    return float(fdtrc(basis.shape[1], freedom, gained * freedom / (basis.shape[1] * left)))


def white_noise_p(residuals: FloatArray, *, equal: bool = True) -> float:
    """Probability that white noise (m,) were as autocorrelated as this; 1 for less than 10 points.

    Q_h = m (m + 2) sum_k r_k^2/(m - k), k = 1..h, is chi-square with h degrees of freedom; where
    the sizes are not equal, Q_h = sum_k (sum_i e_i e_(i-k))^2/sum_i e_i^2 e_(i-k)^2 is. Taken
    for h = 1, which sees weak short correlation, and for h = min(10, m/5), which sees patterns of
    several points; twice the smaller probability (Bonferroni).

    Args:
        residuals: in the order of the sweep, shape (m,), any unit.
        equal: whether the noise has one size.

    Source: G. Ljung and G. Box, Biometrika 65 (1978) 297; for unequal sizes I. Lobato, J. Nankervis
    and N. Savin, Int. Econ. Rev. 42 (2001) 187.
    """
    m = residuals.size
    power = float(residuals @ residuals)
    if _lags(m) < 2 or not power > 0.0:
        return 1.0
    k = np.arange(1, _lags(m) + 1)
    pairs = [residuals[lag:] * residuals[:-lag] for lag in k]
    sums = np.array([np.sum(pair) for pair in pairs])
    if equal:
        q = m * (m + 2) * np.cumsum((sums / power) ** 2 / (m - k))
    else:
        scatter = np.array([pair @ pair for pair in pairs])
        q = np.cumsum(sums**2 / np.where(scatter > 0.0, scatter, 1.0))
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


def innovations(series: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coefficients (order,) of the autoregression of a series, and what that leaves of it, (m,).

    What stands before the first `order` values is not known: it counts as zero.

    Args:
        series: shape (m,), any unit.
    """
    coefficients = autoregression(series, _lags(series.size))
    news = series.copy()
    for lag, a in enumerate(coefficients, start=1):
        news[lag:] -= a * series[:-lag]
    return coefficients, news


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
