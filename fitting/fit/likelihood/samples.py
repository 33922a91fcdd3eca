"""What is asked of a likelihood, and its answers: whitened rows and outputs."""

from __future__ import annotations

from dataclasses import dataclass

from fitting.text.arrays import FloatArray


class Exhausted(Exception):
    """The budget allows no more evaluations."""


@dataclass(frozen=True)
class Request:
    """Search vectors at which rows, outputs or both are wanted."""

    xs: tuple[FloatArray, ...]
    rows: bool = True
    outputs: bool = True


@dataclass(frozen=True)
class Sample:
    """One evaluated search vector: `rows` (m,) whitened, `outputs` (k,); empty if not wanted.

    NaN rows where the model failed; NaN outputs where the model has no value.
    """

    x: FloatArray
    rows: FloatArray
    outputs: FloatArray
