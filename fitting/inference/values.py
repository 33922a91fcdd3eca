"""Values as records: value, error, interval, and how far the data determine it."""

from __future__ import annotations

from dataclasses import dataclass

from fitting.fit.linearisation import IDENTIFIABLE

Floats = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class ParameterResult:
    """One fitted parameter.

    `value` is canonical (periodic ones in [0, period)); `std` (NaN where "not determined") from the
    linearised covariance with box and Tikhonov term as prior, `ci95` likewise and within the box,
    or from the profile likelihood where there is `Knowledge`; `shrinkage` the share of its
    variance that comes from the data, not from the prior; `identifiable` in words.
    """

    value: float
    unit: str
    std: float
    ci95: tuple[float, float]
    reference: float
    start: float
    lower: float
    upper: float
    shrinkage: float
    identifiable: str


@dataclass(frozen=True, kw_only=True)
class DerivedResult:
    """One derived output: `values` per experiment, `mean` and `spread` (standard deviation).

    `value` is the mean; `reference` the mean at the reference parameters; `box` the range of the
    mean over the box of the parameters: what it could be without any data. `ci95` is cut to it.
    Where it is "not determined", `std` is NaN, `ci95` is the range, that range is the answer and
    `value` is only where the optimiser stopped.
    """

    value: float
    unit: str
    values: Floats
    mean: float
    spread: float
    std: float
    ci95: tuple[float, float]
    reference: float
    shrinkage: float
    identifiable: str
    box: tuple[float, float]

    def text(self) -> str:
        """Value for people; never a value with a small error where the data do not give one."""
        if self.identifiable == IDENTIFIABLE[2]:
            low, high = self.box
            if low != low:
                return "has no value at any parameters tried"
            return f"not determined by these data (anything from {low:.6g} to {high:.6g})"
        return f"{self.value:.9g} ± {self.std:.2g}"


@dataclass(frozen=True, kw_only=True)
class OffsetResult:
    """A fitted value of one state of the sample, such as its offset from the interpolated drift.

    It belongs to `experiments` (those of one time share it) and is added to `variables`; `prior` is
    the standard deviation it was given (NaN: none). `fitted` is the value of `parameter` itself:
    of a random walk it is the last step, while `value` is all steps together.
    """

    parameter: str
    experiments: tuple[str, ...]
    variables: tuple[str, ...]
    value: float
    unit: str
    std: float
    ci95: tuple[float, float]
    prior: float
    shrinkage: float
    identifiable: str
    fitted: float
