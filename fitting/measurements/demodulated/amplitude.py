"""Amplitudes that columns of phasors make: their factors and the noise below them, solved inside.

    S = rician(|D c|, s)        sum ((S - R)/w)^2 least        R measured

D (n, k) are free responses as a demodulator shows them, c (k,) complex factors up to a phase that
all have in common, s the noise of each quadrature, from which amplitudes do not fall to zero.
|D c|^2 is linear in the products c_k c_l*: they give the first guess, Gauss and Newton the rest.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import lstsq

from fitting.signal.least_squares import damped_step
from fitting.signal.rician import rician
from fitting.text.arrays import ComplexArray, FloatArray

#: Steps at most, the relative one that ends them, and the damping of the first: its factors.
STEPS, SETTLED = 100, 1e-13
DAMPING, EASED, HELD = 1e-3, 0.1, 10.0


def solved_amplitude(
    columns: ComplexArray, measured: FloatArray, weights: FloatArray, sigma: float | None
) -> tuple[FloatArray, FloatArray]:
    """Amplitudes (n,) that follow the measured ones best, and derivatives (n, m) by the unknowns.

    Args:
        columns: D, (n, k), complex.
        measured: R, (n,), of order one.
        weights: w, standard deviations of R up to a factor, (n,).
        sigma: s where it is known, 0 for none, in the unit of R; None: it is solved for.
    """
    sizes = np.max(np.abs(columns), axis=0)
    unit = columns / np.where(sizes > 0.0, sizes, 1.0)
    factors, power = _guess(unit, measured, sigma)
    count, lead = factors.size, int(np.argmax(np.abs(factors)))
    free = [k for k in range(count) if k != lead]  # the common phase is that of the largest factor
    rotated = factors * np.exp(-1j * np.angle(factors[lead]))

    def amplitude(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Of real parts x of all factors, imaginary ones, and s^2; with derivatives by x."""
        c = x[:count].astype(complex)
        c[free] += 1j * x[count : count + len(free)]
        s = float(np.sqrt(x[-1])) if sigma is None else sigma
        z = unit @ c
        length = np.abs(z)
        along = np.conj(z) / np.where(length > 0.0, length, 1.0)
        mean, slope, rise = rician(length, s)
        slopes = (along * slope)[:, None] * unit
        parts = [slopes.real, -slopes.imag[:, free]]
        if sigma is None:
            parts.append(rise[:, None])
        return mean, np.concatenate(parts, axis=1)

    begin = [*rotated.real, *rotated.imag[free], *([power] if sigma is None else [])]
    return _least(amplitude, np.array(begin), measured, weights, has_power=sigma is None)


def _least(
    amplitude: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    x: FloatArray,
    measured: FloatArray,
    weights: FloatArray,
    *,
    has_power: bool,
) -> tuple[FloatArray, FloatArray]:
    """Amplitudes of least weighted squares, from a guess x, by Levenberg's steps; s^2 >= 0."""
    damping, (values, design) = DAMPING, amplitude(x)
    for _ in range(STEPS):
        left = (values - measured) / weights
        matrix = design / weights[:, None]
        sizes = np.linalg.norm(matrix, axis=0)
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        low = np.full(x.size, -np.inf)
        if has_power:
            low[-1] = -x[-1] * sizes[-1]
        bounds = (low, np.full(x.size, np.inf))
        moved = x + damped_step(matrix / sizes, left, damping, bounds) / sizes
        if has_power:
            moved[-1] = max(moved[-1], 0.0)
        ahead = amplitude(moved)
        rest = (ahead[0] - measured) / weights
        small = float(np.max(np.abs(moved - x))) <= SETTLED * float(np.max(np.abs(x)))
        if float(rest @ rest) <= float(left @ left):
            x, (values, design), damping = moved, ahead, EASED * damping
        else:
            damping *= HELD
        if small:
            break
    return values, design


def _guess(
    columns: ComplexArray, measured: FloatArray, sigma: float | None
) -> tuple[ComplexArray, float]:
    """Factors (k,), and s^2, whose squares follow those measured."""
    count = columns.shape[1]
    upper = [(k, m) for k in range(count) for m in range(k + 1, count)]
    design = [np.abs(columns.T) ** 2]
    for k, m in upper:
        product = columns[:, k] * np.conj(columns[:, m])
        design.append(np.stack([2.0 * product.real, -2.0 * product.imag]))
    known = 0.0 if sigma is None else sigma**2
    if sigma is None:
        design.append(np.ones((1, measured.size)))
    result = lstsq(np.concatenate(design).T, measured**2 - 2.0 * known)[0]
    gram = np.diag(result[:count]).astype(complex)
    for j, (k, m) in enumerate(upper):
        gram[k, m] = complex(result[count + 2 * j], result[count + 2 * j + 1])
        gram[m, k] = np.conj(gram[k, m])
    values, shapes = np.linalg.eigh(gram)
    size = max(float(values[-1]), 0.0)
    power = known if sigma is not None else max(0.5 * float(result[-1]), 0.0)
    factors = np.asarray(np.sqrt(size) * shapes[:, -1])
    return (factors if size > 0.0 else np.full(count, np.max(measured), dtype=complex)), power
