"""Tones as next measurements: drive frequencies around the resonances, through the FMU."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fitting import Drive
from fitting.campaign import Experiment
from fitting.design.information import SHIFT, Place, Rows, Series
from fitting.design.limits import Limits, combinations
from fitting.design.result import DriveChoice
from fitting.extension.problem import Point, evaluate_many
from fitting.extension.records import BoundCampaign
from fitting.measurements.tones import Tones
from fitting.text.arrays import ComplexArray, FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.units import convert

#: Offsets of a tone from the middle of a resonance, at most: a finer grid is thinned to it.
MOST_OFFSETS = 24
#: Choices, at most, that are simulated.
MOST_SETUPS = 20_000
#: Relative departure from proportionality up to which a model counts as linear in the drive level.
LINEAR = 1e-6


def tone_choices(bound: BoundCampaign, limits: Limits) -> tuple[DriveChoice, ...]:
    """Every choice of tones within the limits, in a fixed order.

    Args:
        bound: the campaign that is to be continued.
        limits: of the instrument.

    Raises:
        BadInput: nothing lies within the limits, or too much does.
    """
    places = [(c, tones) for c in limits.centres_hz for tones in _tones(limits, c)]
    combined = combinations(limits.settings)
    count = len(places) * len(limits.outputs) * len(limits.levels) * len(combined)
    if not count:
        raise BadInput(
            f"{bound.path}: no drive frequencies lie within the limits: step "
            f"{limits.frequency_step_hz:g} Hz, spacing {limits.least_spacing_hz:g} Hz, farthest "
            f"{limits.farthest_hz:g} Hz; wanted a farthest detuning of several steps"
        )
    if count > MOST_SETUPS:
        raise BadInput(
            f"{bound.path}: {count} setups lie within the limits, wanted at most {MOST_SETUPS}: a "
            "coarser frequency_step, or fewer levels, outputs or settings"
        )
    every = itertools.product(places, limits.outputs, limits.levels, combined)
    return tuple(
        DriveChoice(centre_hz=centre, tones_hz=tones, output=output, level=level, settings=settings)
        for (centre, tones), output, level, settings in every
    )


def _tones(limits: Limits, centre_hz: float) -> list[tuple[float, ...]]:
    """Tones around one centre, on the instrument's grid."""
    step = limits.frequency_step_hz
    middle = round(centre_hz / step) * step
    reach = math.floor(limits.farthest_hz / step + 1e-9)
    stride = max(1, math.ceil((2 * reach + 1) / MOST_OFFSETS))
    offsets = [k for k in range(-reach, reach + 1) if k % stride == 0]
    if limits.tones == 1:
        return [(middle + k * step,) for k in offsets if middle + k * step > 0.0]
    return [
        (middle + low * step, middle + high * step)
        for low, high in itertools.combinations(offsets, 2)
        if (high - low) * step >= limits.least_spacing_hz * (1.0 - 1e-9)
        and (low < 0 < high or not limits.both_sides)
        and middle + low * step > 0.0
    ]


def levels_and_more(
    source: Drive, tones: int, level: float, settings: Mapping[str, Scalar]
) -> dict[str, Scalar]:
    """What a choice sets besides its tones: drive amplitudes (zero of tones that are not driven).

    Args:
        source: the campaign's drive.
        tones: that are driven at once.
        level: factor on the campaign's drive level.
        settings: further settings, in the FMU's units.
    """
    names = source.amplitude_names if source.kind == "tones" else ()
    amplitudes = {name: level * source.amplitude * (k < tones) for k, name in enumerate(names)}
    return {**amplitudes, **settings}


def base_settings(bound: BoundCampaign) -> dict[str, Scalar]:
    """What stays as in the last experiment, with what drifts at its latest value."""
    base: dict[str, Scalar] = {}
    if bound.experiments:
        base.update(bound.experiments[-1].settings)
    elif bound.sweep is not None:
        base.update(bound.sweep.settings)
    base.update({name: after for name, (_, after) in bound.drift.ends.items()})
    return base


class ToneCandidates:
    """Choices of tones, added to the campaign in place of its experiments.

    Where the amplitude is proportional to the drive level (`linear`), one level is simulated and
    the others follow.

    Args:
        data: the campaign that is to be continued.
        limits: of the instrument.
        place: where proportionality is tested.
    """

    noise: FloatArray | None = None

    def __init__(self, data: Series, limits: Limits, place: Place) -> None:
        self.data, self.limits = data, limits
        self.choices = tone_choices(data.bound, limits)
        low, high = limits.levels[0], limits.levels[-1]
        self._series = self.series_of([c for c in self.choices if c.level == low])
        self.linear = low == high
        if not self.linear:
            ends = (self._series, self.series_of([c for c in self.choices if c.level == high]))
            below, above = (np.abs(self._lines(s, place, [place.x])[0]) for s in ends)
            expected = high / low * below
            self.linear = bool(np.all(np.abs(above - expected) <= LINEAR * expected))
        if not self.linear:
            self._series = self.series_of(self.choices)

    def series_of(self, choices: Sequence[DriveChoice]) -> Series:
        """Choices as experiments with peaks of one; of the other data only the scale stays."""
        bound = self.data.bound
        sweep = None if bound.sweep is None else replace(bound.sweep, use="scale")
        experiments = tuple(self._experiment(c, f"setup {i + 1}") for i, c in enumerate(choices))
        made = replace(bound, experiments=experiments, sweep=sweep, measurements={})
        return Series(made, self.data.workers, steps=self.data.steps)

    def rows(self, place: Place) -> list[Rows]:
        """All choices at a place."""
        rows = self.rows_of(self._series, place)
        simulated, levels = len(rows.values), len(self.limits.levels)
        if simulated == len(self.choices):
            return [rows]
        # levels vary faster than anything but settings: see `tone_choices`
        settings = len(combinations(self.limits.settings))
        source = np.repeat(np.arange(simulated).reshape(-1, 1, settings), levels, axis=1).ravel()
        factors = np.array([c.level / self.limits.levels[0] for c in self.choices])[:, None, None]
        return [
            Rows(
                values=rows.values[source] * factors[..., 0],
                by_x=rows.by_x[source] * factors,
                shared=rows.shared[source] * factors,
                inside=rows.inside[source] * factors,
                errors=rows.errors[source] * factors,
            )
        ]

    def rows_of(self, series: Series, place: Place) -> Rows:
        """The experiments of a series at a place."""
        around = series.around(place)
        here, *nodes = self._lines(series, place, [place.x, *around.nodes])
        nothing: FloatArray | ComplexArray = np.zeros((*here.shape, 0))
        errors: list[Any] = []
        for name, sigma in self.limits.setting_sigmas.items():
            above, below = (
                self._of_tones(series, point) for point in series.moved(place, name, SHIFT * sigma)
            )
            errors.append((above - below) / (2.0 * SHIFT))
        columns = [here, 1j * here] if self.limits.phases else [here]
        return Rows(
            values=here,
            by_x=around.quotients(nodes),
            shared=np.stack(columns, axis=-1),
            inside=nothing,
            errors=np.asarray(np.stack(errors, axis=-1)) if errors else nothing,
        )

    def _lines(
        self, series: Series, place: Place, xs: Sequence[FloatArray]
    ) -> list[FloatArray | ComplexArray]:
        """Scaled values of all lines that are read, (c, lines), at search vectors."""
        points = evaluate_many(series.objective(place.alternative), xs)
        return [self._of_tones(series, point) for point in points]

    @staticmethod
    def _of_tones(series: Series, point: Point) -> FloatArray | ComplexArray:
        pairs = zip(series.data.measurements, point.scaled, strict=True)
        [values] = [values for m, values in pairs if isinstance(m, Tones)]
        return values.reshape(len(series.bound.experiments), -1)

    def _experiment(self, choice: DriveChoice, label: str) -> Experiment:
        """What is simulated for a choice."""
        bound, tones = self.data.bound, choice.tones_hz
        source = bound.setup.drive
        settings = base_settings(bound)
        settings |= levels_and_more(source, len(tones), choice.level, choice.settings)
        if source.kind == "tones":
            where = f"{bound.path}: [drive] frequencies"
            for name, tone in zip(source.frequency_names, tones, strict=False):
                settings[name] = convert(tone, "Hz", source.tone_unit, where=where)
        read = tuple(line.frequency_hz(tones) for line in self.limits.lines)
        ones = np.ones(len(read or tones))
        return Experiment(
            label=label,
            settings=settings,
            tones_hz=tones,
            peaks_v=ones,
            sigmas_v=0.0 * ones,
            floor_v=0.0,
            spectrum=None,
            lines_hz=read,
            output=choice.output,
            phases_rad=0.0 * ones if self.limits.phases else None,
            unknown="none",
        )
