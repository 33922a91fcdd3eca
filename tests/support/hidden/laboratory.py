"""What a hidden laboratory writes, what is true of it, and how far its model is from the data.

A mistake is seen by a fit of the campaign's model to the data without their noise, by this closed
form: what it leaves is structure that no choice of the parameters explains.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from fitting.text.arrays import FloatArray

Values = Mapping[str, float]
#: Lags over which the structured part of residuals is looked for, as the rule for a misfit says.
LAGS = 10


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """One fitted parameter: its truth, and the start, the box and the prior that are given."""

    name: str
    truth: float
    start: float
    low: float
    high: float
    unit: str = "Hz"
    prior: float = math.nan
    reference: float = math.nan

    @property
    def text(self) -> str:
        """The table of the campaign file."""
        start = min(max(self.start, self.low), self.high)
        lines = [
            "[[parameters]]",
            f'name = "{self.name}"',
            *([f'unit = "{self.unit}"'] if self.unit else []),
            f"lower = {self.low!r}",
            f"upper = {self.high!r}",
            f"start = {start!r}",
        ]
        if self.prior > 0.0:
            lines += [f"prior = {self.prior!r}", f"reference = {self.reference!r}"]
        return "\n".join(lines) + "\n"


@dataclass(frozen=True, eq=False, kw_only=True)
class Curve:
    """Points along an axis as they are without noise, and what the campaign's model has for them.

    Args:
        name: of the curve.
        exact: what was there, (n,).
        sigma: true noise of each point, (n,).
        model: from parameters to a part that is as it is (n,), and columns (n, k) whose factors the
            campaign solves for.
        axis: whether the points follow each other along an axis.
    """

    name: str
    exact: FloatArray
    sigma: FloatArray
    model: Callable[[Values], tuple[FloatArray, FloatArray]]
    axis: bool = True

    def left(self, values: Values) -> FloatArray:
        """What the best factors leave, over the noise, (n,)."""
        fixed, columns = self.model(values)
        rows = (self.exact - fixed) / self.sigma
        if not columns.size:
            return np.asarray(rows)
        white = columns / self.sigma[:, None]
        sizes = np.linalg.norm(white, axis=0)
        white = white / np.where(sizes > 0.0, sizes, 1.0)
        return np.asarray(rows - white @ np.linalg.lstsq(white, rows, rcond=1e-12)[0])


@dataclass(frozen=True, kw_only=True)
class Visible:
    """What a mistake leaves at the best parameters.

    Args:
        square: chi square of the structure alone.
        points: number of rows.
        share: structured part over the largest amplitude, of the curve where it is most.
        values: the best parameters.
    """

    square: float
    points: int
    share: float
    values: Values


@dataclass(frozen=True, eq=False, kw_only=True)
class Laboratory:
    """One hidden laboratory.

    Args:
        kind: and seed, by which it is made again.
        variant: which measurements it makes.
        mistake: what is wrong with it on purpose; empty: nothing.
        causes: kinds of findings that name it rightly.
        subject: part of the name of what such a finding must be about; empty: not asked.
        campaigns: text of each campaign file by its name, with FMU for the path of the model.
        model: of the FMU.
        tables: text of each further file by its name.
        unknowns: what is fitted.
        derived: truth of derived outputs.
        qualities: truth of what is solved inside, by a word of its name.
        curves: the data without their noise.
        noise_factor: true noise over stated noise.
        equal: parameters that may fit as well as the truth, by name.
    """

    kind: str
    seed: int
    variant: str
    mistake: str = ""
    causes: frozenset[str] = frozenset()
    subject: str = ""
    campaigns: Mapping[str, str]
    model: str
    tables: Mapping[str, str]
    unknowns: tuple[Unknown, ...]
    derived: Mapping[str, float] = field(default_factory=dict)
    qualities: Mapping[str, float] = field(default_factory=dict)
    curves: tuple[Curve, ...]
    noise_factor: float = 1.0
    equal: tuple[Values, ...] = ()

    @property
    def truth(self) -> dict[str, float]:
        """Of the parameters."""
        return {u.name: u.truth for u in self.unknowns}

    def write(self, folder: Path, fmu: Path) -> list[Path]:
        """Campaign files, with their tables beside them."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in self.tables.items():
            (folder / name).write_text(text, encoding="utf-8")
        paths = []
        for name, text in self.campaigns.items():
            paths.append(folder / f"{name}.toml")
            paths[-1].write_text(text.replace("@FMU@", fmu.as_posix()), encoding="utf-8")
        return paths

    def left_at(self, values: Values) -> FloatArray:
        """Structure of all curves at some parameters, over the noise."""
        return np.concatenate([curve.left(values) for curve in self.curves])

    @cached_property
    def visible(self) -> Visible:
        """What no parameters of the box explain: the best of descents from the truth and beside."""
        names = [u.name for u in self.unknowns]
        low, high = (np.array([getattr(u, e) for u in self.unknowns]) for e in ("low", "high"))
        width = high - low
        truth = np.clip([u.truth for u in self.unknowns], low + 1e-9 * width, high - 1e-9 * width)

        def at(x: FloatArray) -> FloatArray:
            found = self.left_at(dict(zip(names, low + x * width, strict=True)))
            return np.nan_to_num(found, nan=1e9, posinf=1e9, neginf=-1e9)

        rng = np.random.default_rng(self.seed)
        begun = [(truth - low) / width]
        begun += [np.clip(begun[0] * np.exp(0.3 * rng.standard_normal(low.size)), 1e-9, 1 - 1e-9)]
        ends = [least_squares(at, x, bounds=(0.0, 1.0), x_scale="jac") for x in begun]
        best = min(ends, key=lambda end: end.cost)
        values = dict(zip(names, map(float, low + best.x * width), strict=True))
        return Visible(
            square=2.0 * float(best.cost),
            points=int(at(best.x).size),
            share=max((_share(c, values) for c in self.curves if c.axis), default=0.0),
            values=values,
        )

    def fits_as_well(self, values: Values) -> bool:
        """Whether other parameters lie in the box and leave what the truth leaves."""
        inside = all(u.low <= values[u.name] <= u.high for u in self.unknowns)
        if not inside:
            return False
        priors = [u for u in self.unknowns if u.prior > 0.0]
        worse = sum(
            ((values[u.name] - u.reference) ** 2 - (u.truth - u.reference) ** 2) / u.prior**2
            for u in priors
        )
        there, here = (float(np.sum(self.left_at(v) ** 2)) for v in (values, self.truth))
        return worse + there - here < 1.0


def _share(curve: Curve, values: Values) -> float:
    """Root of the largest common part of neighbours, over the curve's largest amplitude."""
    rows = curve.left(values) * curve.sigma / np.max(np.abs(curve.exact))
    lags = min(LAGS, rows.size // 5)
    common = [abs(float(rows[k:] @ rows[:-k])) for k in range(1, lags + 1)]
    return math.sqrt(max(common, default=0.0) / rows.size)


# --- drawing and writing ------------------------------------------------------------------------


@dataclass(frozen=True)
class Draw:
    """Random numbers of one laboratory, by what they are for."""

    rng: np.random.Generator

    def log(self, low: float, high: float) -> float:
        """Evenly in the logarithm."""
        return float(np.exp(self.rng.uniform(math.log(low), math.log(high))))

    def even(self, low: float, high: float) -> float:
        """Evenly."""
        return float(self.rng.uniform(low, high))

    def sign(self) -> float:
        """One, or minus one."""
        return float(self.rng.choice([-1.0, 1.0]))

    def one_of(self, choices: Sequence[str]) -> str:
        """One word."""
        return str(self.rng.choice(list(choices)))

    def happens(self, chance: float) -> bool:
        """Whether it does."""
        return bool(self.rng.random() < chance)

    def points(self, low: float = 20.0, high: float = 600.0) -> int:
        """A number of points."""
        return round(self.log(low, high))

    def size(self, name: str, truth: float, far: float = 3.0) -> Unknown:
        """A width or a coupling: a start up to a factor off, a box of both, at times a prior.

        Args:
            name: of the parameter.
            truth: above zero.
            far: factor by which the start is off, at most.
        """
        start = truth * self.log(1.0 / far, far)
        low, high = min(start, truth) / self.log(2.0, 10.0), max(start, truth) * self.log(2.0, 10.0)
        found = Unknown(name=name, truth=truth, start=start, low=low, high=high)
        if not self.happens(0.15):
            return found
        prior = truth * self.log(0.1, 0.5)
        reference = truth + prior * float(np.clip(self.rng.standard_normal(), -2.0, 2.0))
        return replace(found, prior=prior, reference=min(max(reference, low), high))

    def place(self, name: str, truth: float, reach: float, off: float) -> Unknown:
        """A frequency: a box of that reach about a start that is off by so much, at most."""
        start = truth + self.even(-1.0, 1.0) * min(off, 0.6 * reach)
        return Unknown(name=name, truth=truth, start=start, low=start - reach, high=start + reach)


def generator(kind: str, seed: int) -> Draw:
    """The random numbers of one laboratory."""
    return Draw(np.random.default_rng([seed, *map(ord, kind)]))


def csv(names: Sequence[str], *columns: Sequence[float] | FloatArray | Sequence[str]) -> str:
    """A table: a head, and rows that keep all digits."""
    rows = zip(*columns, strict=True)
    lines = [",".join(names)]
    lines += [",".join(x if isinstance(x, str) else repr(float(x)) for x in row) for row in rows]
    return "\n".join(lines) + "\n"


def parameters(unknowns: Sequence[Unknown]) -> str:
    """The tables of all parameters, and a short schedule: squares, from one level of nu."""
    schedule = "[continuation]\nnu_start = 1e-6\niterations = 1\n" + 'misfit = "squares"\n'
    return "\n".join([*(u.text for u in unknowns), schedule])


def head(title: str, observe: str, start: Mapping[str, float | str], drive: str = "") -> str:
    """Title, model, start values, what is seen, and the drive."""
    values = "\n".join(f"{name} = {value}" for name, value in start.items())
    return (
        f'title = "{title}"\nsynthetic = true\n\n[fmu]\nfile = "@FMU@"\n\n[fmu.start]\n{values}\n\n'
        f'[observe]\noutput = "{observe}"\nsteady_start = true\n\n{drive}'
    )


#: One tone, or two.
TONE = '[drive]\nkind = "tones"\nfrequencies = ["u1"]\namplitudes = ["A1"]\n\n'
TONES = '[drive]\nkind = "tones"\nfrequencies = ["u1", "u2"]\namplitudes = ["A1", "A2"]\n\n'
#: What is asked of findings of noise that was stated too small.
NOISE = "noise stated 3 times too small"
