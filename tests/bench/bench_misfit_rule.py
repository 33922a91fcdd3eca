"""How often the rule for a misfit is wrong, by degrees of freedom: `fitting.signal.misfit`.

    python -m tests.bench.bench_misfit_rule              # a table, in seconds
    python -m tests.bench.bench_misfit_rule --drawn 50   # fewer data sets of each cell

A damped line of three unknowns (height, frequency, width) is fitted to dof + 3 points in closed
form: no FMU. Right models: white noise of the stated size, or of 1.5, 2 and 3 times that. Wrong
ones: data with something that the fitted model does not have. Some data are twelve sweeps over one
axis, each of a twelfth of the points, as a map over a voltage has them. Per cell: shares that are
refused, that give values with a finding, that give values without a word; and of those that give
values, how often a value is more than 4 of its errors off.

A false refusal is a right model that is refused, a false acceptance a wrong model that gives values
without a word, or a value more than 4 errors off.
"""

from __future__ import annotations

import argparse
import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from fitting.signal.misfit import Correlation, Misfit, correlated_below, correlation, misfit_of
from fitting.signal.residual_tests import residual_structure
from fitting.signal.student import tail
from fitting.text.arrays import FloatArray

FREEDOM = (4, 8, 20, 100, 1000)
#: Sweeps of a map, and its degrees of freedom.
SWEEPS, FREEDOM_OF_MAP = 12, (100, 1000)
UNKNOWNS = 3
#: Noise over the height of the line.
NOISE = 0.02
#: Standard errors beyond which a value is wrong.
FAR = 4.0
DRAWN = 60


def line(x: FloatArray, height: float, centre: float, width: float) -> FloatArray:
    """|height/(1 + 2 i (x - centre)/width)|, (n,)."""
    return np.asarray(height / np.sqrt(1.0 + (2.0 * (x - centre) / width) ** 2))


TRUTH = np.array([1.0, 0.1, 1.0])
Data = Callable[[FloatArray, np.random.Generator], FloatArray]


def plus(more: Callable[[FloatArray], FloatArray], times: float = 1.0) -> Data:
    """The line, something that the model does not have, and noise so many times as stated."""

    def drawn(x: FloatArray, rng: np.random.Generator) -> FloatArray:
        return line(x, *TRUTH) + more(x) + times * NOISE * rng.standard_normal(x.size)

    return drawn


def nothing(x: FloatArray) -> FloatArray:
    """The model is right."""
    return np.zeros(x.size)


RIGHT: dict[str, Data] = {
    f"noise {times:g} times as large": plus(nothing, times) for times in (1.0, 1.5, 2.0, 3.0)
}
WRONG: dict[str, Data] = {
    "background of 25 %": plus(lambda x: np.full(x.size, 0.25)),
    "offset of 10 %": plus(lambda x: np.full(x.size, 0.1)),
    "second line of 30 %": plus(lambda x: line(x, 0.3, 1.3, 0.6)),
    "second line of 10 %": plus(lambda x: line(x, 0.1, 1.3, 0.6)),
    "drift of three widths": lambda x, rng: plus(nothing)(
        x - 3.0 * ((x - x[0]) / np.ptp(x)) ** 2 + 0.75, rng
    ),
    "slope of 20 %": plus(lambda x: 0.2 * x / np.max(np.abs(x))),
    "clipped at 80 %": plus(lambda x: np.minimum(0.8 - line(x, *TRUTH), 0.0)),
}


@dataclass(frozen=True)
class Outcome:
    """What the rule says of one data set, and how far frequency or width is off in its errors."""

    misfit: Misfit
    off: float

    @property
    def kind(self) -> str:
        """Refused, values with a finding, or values without a word."""
        if self.misfit is Misfit.REFUSED:
            return "refused"
        return "plain" if self.misfit is Misfit.NONE else "finding"


#: What is drawn as a map, too.
OF_MAPS = ("noise 1 times as large", "noise 2 times as large", "offset of 10 %", "slope of 20 %")


def judged(data: FloatArray, x: FloatArray, sweeps: int = 1) -> Outcome:
    """A fit of the line to data of the stated noise, and what the rule says of it."""
    found = least_squares(lambda p: line(x, *p) - data, TRUTH, method="lm")
    rows, matrix = np.asarray(found.fun), np.asarray(found.jac)
    freedom = float(x.size - UNKNOWNS)
    square = float(np.sum((rows / NOISE) ** 2))
    p_value = tail(square, freedom)
    parts = [rows, *np.array_split(rows, sweeps)] if sweeps > 1 else [rows]
    tests = [correlation(part / NOISE, part / np.max(data)) for part in parts]
    below = correlated_below(square, freedom, p_value)
    tests = [replace(t, p_value=min(1.0, t.p_value * len(tests)), below=below) for t in tests]
    along = max(tests, key=lambda test: (not test.misfit.describes, -test.p_value))
    misfit = along.misfit
    if misfit is Misfit.NONE:
        misfit = misfit_of(square, freedom, p_value, along.p_value)
    if misfit is Misfit.REFUSED:
        return Outcome(misfit, 0.0)
    covariance = np.linalg.inv(matrix.T @ matrix) * NOISE**2
    errors = np.sqrt(np.diag(covariance)) * _factor(rows, matrix, square / freedom, along)
    return Outcome(misfit, float(np.max((np.abs(found.x - TRUTH) / errors)[1:])))


def _factor(rows: FloatArray, matrix: FloatArray, ratio: float, along: Correlation) -> float:
    """On errors, as a fit has it: residuals as they scatter, by the effective sample size."""
    structure = residual_structure(rows, matrix).beyond(ratio)
    beyond = max(1.0, math.sqrt(ratio))
    return max(structure.widening, beyond) if along.misfit is Misfit.NONE else structure.widening


def cells(drawn: int) -> Iterator[tuple[str, bool, int, list[Outcome]]]:
    """Every case with every number of degrees of freedom."""
    for right, cases in ((True, RIGHT), (False, WRONG)):
        for name, make in cases.items():
            for freedom in FREEDOM:
                rng = np.random.default_rng(zlib.crc32(f"{name}{freedom}".encode()))
                x = np.linspace(-3.0, 3.0, freedom + UNKNOWNS)
                yield name, right, freedom, [judged(make(x, rng), x) for _ in range(drawn)]
            for freedom in FREEDOM_OF_MAP if name in OF_MAPS else ():
                rng = np.random.default_rng(zlib.crc32(f"{name}{freedom} map".encode()))
                x = np.tile(np.linspace(-3.0, 3.0, (freedom + UNKNOWNS) // SWEEPS + 1), SWEEPS)
                drawings = (make(x, rng) for _ in range(drawn))
                found = [judged(data, x, SWEEPS) for data in drawings]
                yield f"{name}, {SWEEPS} sweeps", right, x.size - UNKNOWNS, found


def share(outcomes: Sequence[Outcome], kind: str) -> float:
    """Share of the outcomes of a kind."""
    return sum(each.kind == kind for each in outcomes) / len(outcomes)


def wrong_values(outcomes: Sequence[Outcome]) -> float:
    """Share of all data sets that give a value more than 4 of its errors off."""
    return sum(each.off > FAR for each in outcomes) / len(outcomes)


def table(drawn: int = DRAWN) -> str:
    """The rates as a table in Markdown."""
    rows = ["| data | dof | refused | finding | plain | more than 4 σ off |", "|---" * 6 + "|"]
    for name, right, freedom, outcomes in cells(drawn):
        parts = [share(outcomes, kind) for kind in ("refused", "finding", "plain")]
        numbers = " | ".join(f"{100.0 * part:.3g} %" for part in (*parts, wrong_values(outcomes)))
        rows.append(f"| {'right' if right else 'wrong'}: {name} | {freedom} | {numbers} |")
    return "\n".join(rows)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--drawn", type=int, default=DRAWN, help="data sets of each cell")
    print(table(parser.parse_args().drawn))


if __name__ == "__main__":
    main()
