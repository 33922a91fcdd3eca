"""What a measurement looks like with its model, as data: panels of points, curves and stems.

A kind of measurement answers with such a description (`Measurement.figures`);
`report.figures.measurements.panel` draws any of them. Nothing here depends on colours or on a
drawing library: a layer has a role, not a look.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from fitting.text.arrays import FloatArray
from fitting.text.rendering import blocks


class Role(Enum):
    """The part that a layer plays."""

    MEASURED = "measured"
    #: The model of this panel, at the fitted parameters unless the panel says otherwise.
    SIMULATED = "simulated"
    #: The model at the start parameters, beside the fitted one: the axes do not stretch for it.
    START = "start"
    #: Another description of the same data, as a line that is fitted without the FMU.
    OTHER = "other"


class Form(Enum):
    """How a layer's values are correlated."""

    POINTS = "points"
    CURVE = "curve"
    #: Values that stand on zero, one by one, as lines of a spectrum.
    STEMS = "stems"
    #: Values with their standard deviations, as short horizontal bars.
    LEVELS = "levels"
    #: Values over both axes, as colours: cells about each place.
    MAP = "map"


@dataclass(frozen=True)
class Layer:
    """Values ``y`` (n,) at ``x`` (n,), in the units of the panel's axes; ``label`` for the legend.

    ``sigma`` (n,) are standard deviations of y; empty or NaN: not known. Of a map ``z`` (n,) are
    the values at (x, y); places of equal x form a column.

    Raises:
        ValueError: arrays of different shapes.
    """

    role: Role
    form: Form
    x: FloatArray
    y: FloatArray
    _: KW_ONLY
    label: str = ""
    sigma: FloatArray = field(default_factory=lambda: np.empty(0))
    z: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        for name in ("x", "y", "sigma", "z"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=float))
        if self.x.ndim != 1 or self.x.shape != self.y.shape:
            raise ValueError(f"{self.label}: x {self.x.shape} and y {self.y.shape} differ")
        if self.sigma.size and self.sigma.shape != self.y.shape:
            raise ValueError(f"{self.label}: {self.y.size} values, but {self.sigma.size} sigmas")
        if self.z.shape != (self.y.shape if self.form is Form.MAP else (0,)):
            raise ValueError(f"{self.label}: a {self.form.value} with z {self.z.shape}")


@dataclass(frozen=True)
class Axis:
    """What stands on an axis: ``label`` and ``unit``, which may get a prefix; linear, or ``log``.

    The unit "1" is none. It goes from ``low`` to ``high``, in its unit; None: as the layers need.
    ``ticks`` are places with their own texts, where numbers mean nothing. Panels of one figure
    whose axes are equal share them.
    """

    label: str
    unit: str = ""
    _: KW_ONLY
    log: bool = False
    low: float | None = None
    high: float | None = None
    ticks: tuple[tuple[float, str], ...] = ()

    def __post_init__(self) -> None:
        if self.unit == "1":
            object.__setattr__(self, "unit", "")


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One pair of axes with its layers.

    ``title`` stands above it, ``when`` before the label of y, ``notes`` are lines of text within.
    ``marked`` are places along x with a vertical line each; ``level`` is a horizontal line (NaN:
    none), of residuals with a band of twice their ``rms`` about it (NaN: none). ``z`` are the
    values of a map's colours: about zero in both directions where it goes from -h to h.
    ``joined``: the difference of measured and simulated values is drawn as a bar between both.
    ``shape`` numbers the marker of simulated points: one for each experiment. ``height`` is
    relative to that of a full panel.
    """

    x: Axis
    y: Axis
    layers: tuple[Layer, ...]
    z: Axis | None = None
    title: str = ""
    when: str = ""
    notes: tuple[str, ...] = ()
    marked: tuple[float, ...] = ()
    level: float = float("nan")
    rms: float = float("nan")
    joined: bool = False
    shape: int = 0
    height: float = 1.0

    def of(self, role: Role) -> tuple[Layer, ...]:
        """Its layers that play a role.

        Args:
            role: which one.
        """
        return tuple(layer for layer in self.layers if layer.role is role)


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure: what is written about it, the panels of a measurement's, and what it becomes.

    Args:
        name: short, for files.
        title: above it; ``caption`` below it, ``alt`` for those who do not see it.
        caption: see ``title``.
        alt: see ``title``.
        rows: of panels, of a figure that a measurement describes.
        series: the measurement's, empty where there is one only.
        number: on the page and before the name of its files (0: none), of ``digits`` digits there,
            so that files sort as on the page.
        digits: see ``number``.
        drawn: by matplotlib, until it is saved.
        folder: of its files, once it is saved, of these ``kinds``.
        kinds: endings of its files.
        live: what makes it interactive on a page (JSON).
    """

    name: str
    title: str
    caption: str
    alt: str
    rows: tuple[tuple[Panel, ...], ...] = ()
    series: str = ""
    number: int = 0
    digits: int = 1
    drawn: Any = None
    folder: Path = Path()
    kinds: tuple[str, ...] = ()
    live: str = ""

    @property
    def stem(self) -> str:
        """Name of its files, without an ending."""
        number = f"{self.number:0{self.digits}d}" if self.number else ""
        return "_".join(filter(None, (number, self.name, self.series)))

    @property
    def files(self) -> tuple[Path, ...]:
        """All its files."""
        return tuple(map(self.file, self.kinds))

    def file(self, kind: str) -> Path:
        """Its file of a kind.

        Args:
            kind: its ending, "svg".
        """
        return self.folder / f"{self.stem}.{kind}"

    @property
    def panels(self) -> tuple[Panel, ...]:
        """All panels, row by row."""
        return tuple(panel for row in self.rows for panel in row)


def compared(
    axes: tuple[Axis, Axis],
    at: FloatArray,
    measured: FloatArray,
    before: FloatArray,
    after: FloatArray,
    sigma: FloatArray | None = None,
) -> Panel:
    """Measured points with the model before and after a fit as curves.

    Args:
        axes: x and y.
        at: places along x, (n,).
        measured: values there, (n,).
        before: of the model at the start parameters, (n,).
        after: at the fitted ones.
        sigma: standard deviations of the measured values, (n,); None: not known.
    """
    errors = np.empty(0) if sigma is None else sigma
    return Panel(
        x=axes[0],
        y=axes[1],
        layers=(
            Layer(Role.MEASURED, Form.POINTS, at, measured, label="measured", sigma=errors),
            Layer(Role.START, Form.CURVE, at, before, label="model, start parameters"),
            Layer(Role.SIMULATED, Form.CURVE, at, after, label="model, fitted parameters"),
        ),
    )


def residual_points(
    axes: tuple[Axis, Axis], at: FloatArray, parts: Sequence[tuple[str, FloatArray]]
) -> Panel:
    """Residuals as points about zero: one part, or those of two quadratures.

    Args:
        axes: x and y.
        at: places along x, (n,).
        parts: label and residuals (n,) of each.
    """
    return Panel(
        x=axes[0],
        y=axes[1],
        layers=tuple(
            Layer(role, Form.POINTS, at, part, label=label)
            for role, (label, part) in zip((Role.SIMULATED, Role.OTHER), parts, strict=False)
        ),
        level=0.0,
        rms=root_mean_square([part for _, part in parts]),
        height=0.5,
    )


def root_mean_square(parts: Sequence[FloatArray]) -> float:
    """Root mean square of all values of some arrays; NaN of none.

    Args:
        parts: of any shape.
    """
    values = np.concatenate([np.empty(0), *map(np.ravel, parts)])
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def worded(
    macro: str,
    rows: Sequence[Sequence[Panel]],
    *,
    name: str = "",
    label: str = "",
    series: str = "",
    **records: Any,
) -> Figure:
    """The figure of a measurement, with what a macro of `text/templates/captions.txt.j2` writes.

    Args:
        macro: its name.
        rows: of panels.
        name: of the figure, for files; empty: that of the macro.
        label: of one record of a kind; empty: the only one.
        series: of the measurement.
        **records: that the macro prints.
    """
    written = getattr(blocks("captions"), macro)(label, **records)
    title, caption, alt = figure_words(str(written))
    return Figure(
        name="_".join(filter(None, (name or macro, label))).replace("/", "_"),
        title=title,
        caption=caption,
        alt=alt,
        rows=tuple(map(tuple, rows)),
        series=series,
    )


def figure_words(text: str) -> tuple[str, str, str]:
    """Title, caption, and what is read to those who do not see a figure, else the caption.

    Args:
        text: as templates write it, with "¦" between.
    """
    title, caption, *alt = (part.strip() for part in re.sub(r"[ \n]+", " ", text).split("¦"))
    return title, caption, alt[0] if alt else caption


#: Points that are drawn of a layer, at most: the first and last of equal stretches.
DRAWN = 4000
#: Residuals of a record over its largest value.
OF_LARGEST = Axis("minus measured", "% of largest")
