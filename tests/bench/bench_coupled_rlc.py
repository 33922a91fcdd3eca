"""The measured spectra of two coupled circuits by closed form: losses, noise, each C3 by itself.

    python -m tests.bench.bench_coupled_rlc

Lines of the oscilloscope's spectra (`data/coupled_rlc`) over C1 and over C2 against a matrix of two
loops and a square wave's 1/n, in dB: what each law of the loss leaves, then with the noise of the
lines weighed, what remains of every spectrum, and k of each alone. Prints Markdown.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from fitting.text.arrays import FloatArray

DATA = Path(__file__).parents[2] / "data" / "coupled_rlc"
FILES = {"C1": "square_wave_spectra.csv", "C2": "square_wave_spectra_c2.csv"}
#: Of the square wave, as the source's own evaluation has it.
FUNDAMENTAL_HZ = 14.118
C3_NF = np.arange(10.0, 101.0, 10.0)
#: Noise of a line: dB beside steps of 0.4 dB, and in each quadrature, dB.
STEPS_DB, NOISE_DB = 0.3, -50.0
#: Laws of the widths of the loops, Hz: of (first parameter, second, frequency in Hz).
LOSSES: dict[str, Callable[[float, float, FloatArray], tuple[FloatArray, FloatArray]]] = {
    "one resistance": lambda a, b, f: (a + 0.0 * f, a + 0.0 * f),
    "another in the driven loop": lambda a, b, f: (b + 0.0 * f, a + 0.0 * f),
    "growing with f": lambda a, b, f: (a + b * f / 1000.0,) * 2,
    "growing with f^2": lambda a, b, f: (a + b * (f / 1000.0) ** 2,) * 2,
    "of the capacitors, as 1/f": lambda a, b, f: (a + b * 1000.0 / f,) * 2,
}


def lines(rows: FloatArray) -> FloatArray:
    """Frequency, level in dB and number of the odd harmonics of one spectrum, (lines, 3)."""
    f, level = rows.T
    found = []
    for n in range(3, int(1500.0 / FUNDAMENTAL_HZ) + 1, 2):
        near = np.flatnonzero(np.abs(f - n * FUNDAMENTAL_HZ) < 0.8 * FUNDAMENTAL_HZ)
        j = min(max(near[np.argmax(level[near])], 1), f.size - 2)
        below, top, above = level[j - 1 : j + 2]
        bend = below - 2.0 * top + above
        off = float(np.clip(0.5 * (below - above) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0
        found.append((f[j] + off * (f[1] - f[0]), top - 0.25 * (below - above) * off, n))
    return np.array(found)


def response(
    seen: str, f: FloatArray, plus: float, square: float, widths: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Magnitude of the charge seen, of two loops of lambda^2 = `square`, driven in the first."""
    own = [plus**2 + square - f**2 + 1j * f * width for width in widths]
    above = own[1] if seen == "C1" else square
    return np.asarray(np.abs(1e6 * above / (own[0] * own[1] - square**2)))


def fitted(
    seen: str, loss: str, *, weighed: bool, own_k: bool = False
) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
    """Parameters k, eta_plus, two of the loss, floor, ten scales and factors of k; errors; rows."""
    table = np.loadtxt(DATA / FILES[seen], delimiter=",", skiprows=1)
    spectra = [lines(table[table[:, 0] == c, 1:]) for c in C3_NF]

    def parts(p: FloatArray) -> list[FloatArray]:
        rows = []
        for c, (f, level, n), scale, factor in zip(
            C3_NF, (s.T for s in spectra), p[5:15], p[15:], strict=True
        ):
            k = p[0] * (factor if own_k else 1.0)
            widths = LOSSES[loss](p[2], p[3], f)
            clean = 20.0 * np.log10(response(seen, f, p[1], k**2 / (1e-9 * c), widths) / n) + scale
            floor = NOISE_DB + 3.0 if weighed else p[4]
            error = np.hypot(STEPS_DB, 8.686 * 10.0 ** (0.05 * (NOISE_DB - clean)))
            row = 10.0 * np.log10(10.0 ** (0.1 * clean) + 10.0 ** (0.1 * floor)) - level
            rows.append(row / error if weighed else row)
        return rows

    width = 300.0 if seen == "C2" else 900.0
    second = {"one resistance": 0.0, "another in the driven loop": width}.get(loss, 1.0)
    start = np.array([0.159, 500.0, width, second, -45.0, *[7.0] * 10, *[1.0] * 10])
    free = np.ones(start.size, dtype=bool)
    free[[0, 3, 4]] = not own_k, loss != "one resistance", not weighed
    free[15:] = own_k

    def rows(x: FloatArray) -> FloatArray:
        p = start.copy()
        p[free] = x
        return np.concatenate(parts(p))

    sizes = 0.1 * np.maximum(np.abs(start[free]), 0.01)
    robust = "linear" if weighed else "soft_l1"
    found = least_squares(rows, start[free], x_scale=sizes, loss=robust)
    best, errors = start.copy(), np.zeros(start.size)
    best[free] = found.x
    left = found.fun.size - found.x.size
    covariance = np.linalg.pinv(found.jac.T @ found.jac)
    noise = 1.0 if weighed else 2.0 * found.cost / left
    errors[free] = np.sqrt(noise * np.diag(covariance))
    return best, errors, parts(best)


def main() -> None:
    """Print what each loss leaves, and what remains of every spectrum."""
    print("| seen | loss | k, Hz F^1/2 | eta_plus, Hz | first, Hz | second, Hz | left, dB rms |")
    print("|---|---|---|---|---|---|---|")
    for seen in FILES:
        for loss in LOSSES:
            p, e, rows = fitted(seen, loss, weighed=False)
            told = " | ".join(f"{p[i]:.4g} ± {e[i]:.2g}" for i in range(4))
            print(f"| {seen} | {loss} | {told} | {np.std(np.concatenate(rows)):.2f} |")
    for seen in FILES:
        p, e, rows = fitted(seen, "one resistance", weighed=True)
        q, s, _ = fitted(seen, "one resistance", weighed=True, own_k=True)
        k, plus, width = (f"{p[i]:.4g} ± {e[i]:.2g}" for i in range(3))
        every = np.mean(np.concatenate(rows) ** 2)
        print(f"\n{seen}, weighed: k {k}, eta_plus {plus} Hz, width {width} Hz, χ² {every:.2f}\n")
        print("| seen | C3, nF | χ² by line, one k | k of its own |\n|---|---|---|---|")
        for c, row, f, error in zip(C3_NF, rows, q[15:], s[15:], strict=True):
            own = f"{q[0] * f:.4f} ± {q[0] * error:.4f}"
            print(f"| {seen} | {c:g} | {np.mean(row**2):.2f} | {own} |")


if __name__ == "__main__":
    main()
