"""Lines of sweeps: how often intervals contain the truth, and what is printed where there is none.

    python -m tests.bench.bench_lines [COUNT]

COUNT sweeps of each kind, drawn from closed forms. A row per kind: how many are refused, how many
of the others have the truth in the 95 % interval of f, FWHM and A, the largest deviation in
standard errors, and the forms that were taken. Below, kinds without a resonance: how many numbers
are printed. Some 150 s of processor time for 100.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable

import numpy as np

import fitting as ff
from fitting.text.arrays import ComplexArray, FloatArray

ETA, WIDTH = 5000.0, 20.0
WIDE, NARROW = ETA + np.linspace(-80.0, 80.0, 161), ETA + np.linspace(-30.0, 30.0, 81)
Sweep = Callable[[FloatArray, np.random.Generator], FloatArray | ComplexArray]


def line(f: FloatArray) -> ComplexArray:
    """One driven damped mode, its amplitude one at `ETA`."""
    return np.asarray(WIDTH * ETA / (ETA**2 - f**2 + 1j * f * WIDTH))


def both(rng: np.random.Generator, f: FloatArray, size: float) -> ComplexArray:
    """Noise of X and Y."""
    return np.asarray(size * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)))


def bent(f: FloatArray, shift_hz: float) -> FloatArray:
    """A sweep up of a Duffing line by the roots of its cubic, its top shifted."""
    made, half = [], (0.5 * WIDTH) ** 2
    for x in f - ETA:
        roots = np.roots([shift_hz**2, -2.0 * shift_hz * x, x * x + half, -half])
        real = np.sort(roots[np.abs(roots.imag) < 1e-6 * np.abs(roots.real)].real)
        real = real[real > 0.0]
        made.append(np.sqrt(real[-1] if x < shift_hz else real[0]))
    return np.array(made)


def phase(rng: np.random.Generator) -> complex:
    """A complex number of size one."""
    return complex(np.exp(2j * np.pi * rng.random()))


LINES: dict[str, tuple[FloatArray, Sweep]] = {
    "amplitudes": (WIDE, lambda f, r: np.abs(line(f)) + both(r, f, 0.02).real),
    "amplitudes, three widths": (NARROW, lambda f, r: np.abs(line(f)) + both(r, f, 0.01).real),
    "with a constant": (NARROW, lambda f, r: np.abs(line(f)) + 0.1 + both(r, f, 0.01).real),
    "with a slope": (
        WIDE,
        lambda f, r: np.abs(line(f)) + 0.1 + 5e-4 * (f - ETA) + both(r, f, 0.01).real,
    ),
    "single readings": (WIDE, lambda f, r: np.abs(line(f) + both(r, f, 0.1))),
    "relative noise": (
        WIDE,
        lambda f, r: np.abs(line(f)) * (1.0 + both(r, f, 0.02).real) + both(r, f, 0.002).real,
    ),
    "Duffing, leans": (WIDE, lambda f, r: bent(f, 5.0) + both(r, f, 0.01).real),
    "Duffing, jumps": (WIDE, lambda f, r: bent(f, 40.0) + both(r, f, 0.01).real),
    "complex": (WIDE, lambda f, r: line(f) + both(r, f, 0.02)),
    "complex, constant": (WIDE, lambda f, r: line(f) + 0.1 * phase(r) + both(r, f, 0.02)),
    "complex, cable": (
        WIDE,
        lambda f, r: line(f) * np.exp(-2j * np.pi * (f - ETA) * 3e-4) + both(r, f, 0.02),
    ),
    "notch": (WIDE, lambda f, r: 1.0 - 1j * line(f) * 0.6 + both(r, f, 0.01)),
}
#: Height of the line, where it is not one.
HEIGHTS = {"notch": 0.6}
NOTHING: dict[str, Sweep] = {
    "noise": lambda f, r: np.abs(1.0 + both(r, f, 0.05)),
    "noise alone": lambda f, r: np.abs(both(r, f, 1.0)),
    "complex noise": lambda f, r: 1.0 + both(r, f, 0.05),
    "drift": lambda f, r: 1.0 + 3e-3 * (f - ETA) + both(r, f, 0.02).real,
    "step": lambda f, r: 1.0 + 0.2 * (f > ETA + 8.0) + both(r, f, 0.01).real,
    "random walk": lambda f, r: 3.0 + np.cumsum(r.standard_normal(f.size)) / f.size**0.5,
    "delay": lambda f, r: np.exp(-1j * (f - ETA) / 20.0) + both(r, f, 0.02),
}


def row(kind: str, count: int) -> str:
    """Coverage of one kind of line."""
    f, sweep = LINES[kind]
    truth = {"frequency": ETA, "width": WIDTH, "amplitude": HEIGHTS.get(kind, 1.0)}
    inside, forms, farthest = Counter[str](), Counter[str](), 0.0
    for seed in range(count):
        try:
            found = ff.line(f, sweep(f, np.random.default_rng([seed, len(kind)])))
        except ff.BadInput:
            forms["refused"] += 1
            continue
        forms[found.forms[0].name + ", delay" * found.forms[0].delayed] += 1
        for name, true in truth.items():
            value = getattr(found, name)
            inside[name] += value.ci95[0] <= true <= value.ci95[1]
            farthest = max(farthest, abs(value.value - true) / value.std)
    answers = max(1, count - forms["refused"])
    shares = "  ".join(f"{100.0 * inside[name] / answers:5.1f}" for name in truth)
    taken = ", ".join(f"{name} {n}" for name, n in forms.most_common(3))
    return f"{kind:26s} {forms['refused']:3d}  {shares}  {farthest:4.1f}  {taken}"


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("count", type=int, nargs="?", default=100)
    count = parser.parse_args().count
    print("kind of line          refused  f, FWHM, A in 95 % (%)  farthest (std)  forms")
    for kind in LINES:
        print(row(kind, count), flush=True)
    print("no line                    printed")
    for kind, sweep in NOTHING.items():
        printed = 0
        for seed in range(count):
            seen = sweep(WIDE, np.random.default_rng(seed))
            try:
                ff.line(WIDE, seen if np.iscomplexobj(seen) else np.abs(seen))
            except ff.BadInput:
                continue
            printed += 1
        print(f"{kind:26s} {printed:3d} of {count}", flush=True)


if __name__ == "__main__":
    main()
