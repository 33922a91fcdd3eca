"""All measurements of a fit side by side: their rows, noise and scales.

`measurements_of` makes them of a bound campaign. It is apart from `kinds`: who has a campaign needs
only the kinds that it holds, and loading all takes time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property

import numpy as np

from fitting.campaign import BoundCampaign
from fitting.measurements.measurement import Measurement, Prediction, Scale, Values
from fitting.measurements.sweep import sweep_of
from fitting.measurements.tones import ComplexTones, Tones, peak_sigmas
from fitting.signal.misfit import leaves_noise
from fitting.signal.student import joined_freedom
from fitting.text.arrays import FloatArray, IntArray, Scalar
from fitting.text.errors import BadInput, did_you_mean

#: Residuals beyond this many standard deviations count linearly with outliers = "huber".
HUBER = 1.345


def places_of_outputs(
    measurements: Sequence[Measurement],
) -> dict[str, list[tuple[str, Mapping[str, Scalar]]]]:
    """Labels and settings at which derived outputs are read, by series.

    Those of its experiments; of a series without any, those of its first curve.

    Args:
        measurements: of all series.
    """
    places: dict[str, list[tuple[str, Mapping[str, Scalar]]]] = {}
    for series in dict.fromkeys(m.series for m in measurements):
        mine = [m for m in measurements if m.series == series]
        single = [m for m in mine if not m.is_curve and m.places] or mine[:1]
        places[series] = [place for m in single for place in m.places]
    return places


@dataclass(frozen=True)
class Dataset:
    """Measurements whose rows stand one after the other; those of one series share a scale.

    Curves stand last. `weigh` and `outliers` change the misfit "squares", see there; `names` are
    the series in their declared order, where that is not the order of their rows.

    Raises:
        ValueError: not a single row, or a curve before peaks.
    """

    measurements: tuple[Measurement, ...]
    _: KW_ONLY
    weigh: bool = False
    outliers: str = "keep"
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not any(m.rows for m in self.measurements):
            raise ValueError("neither peaks nor a fitted sweep: nothing to minimise")
        curves = [m.is_curve for m in self.measurements]
        if curves != sorted(curves):
            raise ValueError("a curve stands before other measurements; wanted curves last")

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Where the rows of each measurement stand."""
        ends = np.cumsum([m.rows for m in self.measurements])
        return tuple(
            slice(int(end) - m.rows, int(end))
            for m, end in zip(self.measurements, ends, strict=True)
        )

    @cached_property
    def series(self) -> tuple[str, ...]:
        """Names of the series: as declared, else in the order of their first measurement."""
        return tuple(dict.fromkeys([*self.names, *(m.series for m in self.measurements)]))

    @cached_property
    def sigma(self) -> FloatArray:
        """Relative standard deviation of each residual row, (m,); zero where unknown."""
        return np.concatenate([m.sigma for m in self.measurements])

    def solved_of(self, *, known: bool) -> int:
        """Number of unknowns that measurements are solved for inside their rows, scales too.

        Args:
            known: of those whose noise is known, else of those where it is not.
        """
        mine = [m for m in self.measurements if bool(np.all(m.sigma > 0)) == known]
        return sum(m.solved_inside + own_scale(m) for m in mine)

    @property
    def solved_inside(self) -> int:
        """Number of all unknowns that measurements are solved for inside their rows."""
        return self.solved_of(known=True) + self.solved_of(known=False)

    @cached_property
    def measured_rows(self) -> FloatArray:
        """What chi multiplies in each row where the model fits, (m,): dr/d ln chi = r + it."""
        return np.concatenate([m.measured_rows for m in self.measurements])

    @cached_property
    def series_of_rows(self) -> IntArray:
        """Which series each row belongs to, (m,)."""
        owners = [np.full(m.rows, self.series.index(m.series)) for m in self.measurements]
        return np.concatenate(owners).astype(np.intp)

    @cached_property
    def curve_rows(self) -> slice:
        """Rows that are points of curves; they stand last."""
        first = sum(m.rows for m in self.measurements if not m.is_curve)
        return slice(first, None)

    @cached_property
    def scale_sigmas(self) -> tuple[float, ...]:
        """Relative standard deviation of chi of each series; zero where it is fitted."""
        return tuple(
            max((m.scaling.sigma for m in self.measurements if m.series == name), default=0.0)
            for name in self.series
        )

    @property
    def tones(self) -> tuple[Tones, ...]:
        """The measurements that are peaks of tones."""
        return tuple(m for m in self.measurements if isinstance(m, Tones))

    @property
    def noise_freedom(self) -> float:
        """Degrees of freedom of the noise of the rows where it is known; infinite where stated."""
        return joined_freedom(
            (int(np.count_nonzero(m.sigma > 0.0)), m.noise_freedom) for m in self.measurements
        )

    def peaks(self, values: Sequence[Values]) -> FloatArray:
        """Amplitudes of some values at all lines of tones: (n_peaks,).

        Args:
            values: an array (n,) per measurement, real or complex.
        """
        pairs = zip(self.measurements, values, strict=True)
        mine = (
            np.abs(v) if np.iscomplexobj(v) else v.real for m, v in pairs if isinstance(m, Tones)
        )
        return np.concatenate([np.empty(0), *mine])

    def peaks_of_rows(self, sizes: FloatArray) -> FloatArray:
        """One number for each line of tones, (n_peaks,), of the sizes of all rows.

        Args:
            sizes: moduli of residuals, or standard deviations, (m,).
        """
        pairs = zip(self.measurements, self.slices, strict=True)
        mine = (m.of_lines(sizes[k]) for m, k in pairs if isinstance(m, Tones))
        return np.concatenate([np.empty(0), *mine])

    def scales(self, predictions: Sequence[Prediction], free: Sequence[float]) -> tuple[Scale, ...]:
        """Scale of every series.

        Args:
            predictions: one per measurement.
            free: fitted logarithms of factors on the scale, for the series that have one.
        """
        left = iter(free)
        result = []
        for name in self.series:
            mine = [
                (m, q)
                for m, q in zip(self.measurements, predictions, strict=True)
                if m.series == name
            ]
            stated = [scale for m, q in mine if (scale := m.scale(q)) is not None]
            scale = stated[0] if stated else Scale(1.0)
            if any(m.scaling.is_free for m, _ in mine):
                scale = Scale(scale.value * float(np.exp(next(left))), scale.bias)
            result.append(scale)
        return tuple(result)

    def unexplained(self, residuals: FloatArray) -> str:
        """Why rows (m,) count as not following the data at all; empty where they follow them.

        A fit that ends far from any solution may sit on a plateau: flat, and so stationary. What
        is no more than the noise that is stated follows the data as far as they are known.

        Args:
            residuals: rows (m,), relative.
        """
        for m, k in zip(self.measurements, self.slices, strict=True):
            stated = m.unexplained(residuals[k])
            if stated and not (
                np.all(m.sigma > 0.0) and leaves_noise(residuals[k], residuals[k], m.sigma, 1)
            ):
                return stated
        return ""

    def squares(self, residuals: FloatArray) -> tuple[float, FloatArray]:
        """Misfit "squares" of rows (m,), and the weights (m,) that its gradient 2 J^T w r has.

        sum r^2; with `weigh`, if every sigma is known, sum w r^2, w = sigma^-2/mean(sigma^-2), and
        with outliers = "huber" rows beyond 1.345 sigma count linearly (P. Huber, Robust
        Statistics, 1981).

        Args:
            residuals: rows (m,), relative.
        """
        weights = self._weights
        if weights is None:
            return float(np.dot(residuals, residuals)), np.ones(residuals.size)
        if self.outliers != "huber":
            return float(np.sum(weights * residuals**2)), weights
        far = np.maximum(np.abs(residuals) / (HUBER * self.sigma), 1.0)
        value = np.sum(weights * residuals**2 * (2.0 * far - 1.0) / far**2)
        return float(value), weights / far

    @cached_property
    def _weights(self) -> FloatArray | None:
        """Weights of the rows, (m,), one on average; None where they are not weighed."""
        if not (self.weigh and np.all(self.sigma > 0.0)):
            return None
        weights = (np.min(self.sigma) / self.sigma) ** 2  # at most one, however small the sigmas
        return np.asarray(weights / np.mean(weights))


def own_scale(measurement: Measurement) -> int:
    """One where the scale is the least-squares one over its own rows, which are then one fewer.

    Args:
        measurement: with its rows.
    """
    return int(measurement.rows > 0 and measurement.scaling.from_rows)


def part_of(data: Dataset, settings: Mapping[str, Scalar]) -> Dataset:
    """What was measured where settings have these values, alone.

    Args:
        data: all measurements.
        settings: values that places have to have, by name.

    Raises:
        BadInput: a name that no place sets, values that no place has or all have, or too little
            left of a measurement.
    """
    wanted = ", ".join(f"{name} = {value}" for name, value in settings.items())
    places = [place for m in data.measurements for place in m.places]
    known = sorted({name for _, has in places for name in has})
    for name in settings:
        if name not in known:
            raise BadInput(
                f"'{name}' is set by no measurement{did_you_mean(name, known)}; they set "
                f"{', '.join(known) or 'nothing'}"
            )
    inside = {
        label
        for label, has in places
        if all(name in has and _same(has[name], value) for name, value in settings.items())
    }
    if not inside or len(inside) == len(places):
        many = "everything" if inside else "nothing"
        raise BadInput(f"{many} was measured at {wanted}; wanted a part of the measurements")
    result = (m.part(inside) for m in data.measurements)
    return replace(data, measurements=tuple(m for m in result if m is not None))


def _same(one: Scalar, other: Scalar) -> bool:
    if isinstance(one, str | bool) or isinstance(other, str | bool):
        return str(one) == str(other)
    return math.isclose(one, other, rel_tol=1e-9, abs_tol=0.0)


def measurements_of(bound: BoundCampaign, series: str = "") -> tuple[Measurement, ...]:
    """Everything that a campaign holds, as measurements: curves last.

    Args:
        bound: campaign, bound to its FMU.
        series: name of the series.
    """
    result: list[Measurement] = list(_tones(bound, series))
    if bound.sweep is not None:
        result.append(sweep_of(bound, bound.sweep, series))
    for table, further in bound.measurements.items():
        if not isinstance(further, Measurement):
            raise TypeError(f"[{table}] is bound to {further!r}, wanted a Measurement")
        result.append(further.within(bound.setup, series))
    return tuple(sorted(result, key=lambda m: m.is_curve))


def _tones(bound: BoundCampaign, series: str) -> Iterator[Tones]:
    """The experiments without phases and those with, each with everything known of their noise."""
    for kind, with_phases in ((Tones, False), (ComplexTones, True)):
        mine = tuple(e for e in bound.experiments if (e.phases_rad is not None) == with_phases)
        if mine:
            sigmas_v, origin = peak_sigmas(replace(bound, experiments=mine))
            yield kind(
                bound.setup,
                mine,
                series=series,
                sigmas_v=sigmas_v,
                noise_origin=origin,
                unit=bound.amplitude_unit,
            )
