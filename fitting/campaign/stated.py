"""Values that a fitted measurement is stated to have been made at: numbers with an error.

    v = stated + delta, delta ~ N(0, sigma^2)

The eigenfrequency that ``set`` of a sweep states was read from an instrument; the sweep itself
shows it, often far better. Taken as exact, its error would be read as knowledge: how far the line
stands from the stated place tells of the damping, by what it couples. So every fitted sweep, and
every further measurement, has an offset delta, as an experiment has (`campaign.drift`): of what
``set_sigma`` gives an error, that is sigma; of what drifts, sigma is the prior of the drift, or,
where the drift is a straight line and has none, the larger of its size and the width of the line.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from fitting.campaign.binder import Binder, is_real
from fitting.campaign.bound import BoundCampaign, SweepData
from fitting.campaign.data import Campaign
from fitting.campaign.drift import Drifting, Prior, prior_of_drift
from fitting.campaign.kind import AtStatedValues, BoundMeasurement
from fitting.campaign.parameters import Parameter
from fitting.fmu.variables import SETTABLE
from fitting.signal.scale import half_power_width
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, gathered
from fitting.text.units import convert, same_kind
from fitting.text.written import Written, difference_in

#: Label of a sweep that has values of its own.
SWEEP = "sweep"


@dataclass(frozen=True, kw_only=True)
class DriftPriors:
    """What is known beforehand of the error of drifting variables.

    `line`: that the drift is a straight line, and the `priors` are its size.
    """

    priors: tuple[Prior, ...] = ()
    line: bool = False

    def at(self, width_hz: float) -> Iterator[Prior]:
        """The priors for a measurement that shows a line.

        Args:
            width_hz: of the line, Hz; zero where it shows none.
        """
        for prior in self.priors:
            sigma = prior.sigma
            if self.line and width_hz > 0.0 and same_kind(prior.unit, "Hz"):
                sigma = max(sigma, convert(width_hz, "Hz", prior.unit, where="[drift]"))
            if sigma > 0.0:
                yield replace(prior, sigma=sigma)


def drift_priors(campaign: Campaign, binder: Binder, drifting: Drifting) -> DriftPriors:
    """Priors of what the drift table names, for measurements that are no experiments.

    Of an experiment one offset may stand for all variables that drift together; elsewhere every
    value was stated by itself, with an error of its own, unless ``share = true`` is written.

    Args:
        campaign: campaign as it was read.
        binder: of the campaign to its FMU.
        drifting: its drift, bound.

    Raises:
        BadInput: variables of different units that are to share an offset.
    """
    choice, ends = campaign.file.drift, drifting.ends
    if choice.model == "linear":
        units = {name: binder.variables[name].unit or "1" for name in ends}
        return DriftPriors(
            priors=tuple(
                _alone(name, units[name], abs(after - before))
                for name, (before, after) in ends.items()
            ),
            line=True,
        )
    if choice.share and ends:
        return DriftPriors(priors=(prior_of_drift(campaign, binder, tuple(ends), ""),))
    return DriftPriors(
        priors=tuple(prior_of_drift(campaign, binder, (name,), f" {name}") for name in ends)
    )


def _alone(name: str, unit: str, sigma: float) -> Prior:
    return Prior(variables=(name,), unit=unit, sigma=sigma, suffix=f" {name}")


def bind_sigmas(asked: Mapping[str, Written], binder: Binder) -> dict[str, float]:
    """Standard deviations of stated values in the FMU's units.

    Args:
        asked: by variable, as they were written.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: no such Real variable that can be set, another unit, a number not above zero.
    """
    values = gathered(partial(_sigma, name, written, binder) for name, written in asked.items())
    return dict(zip(asked, values, strict=True))


def _sigma(name: str, written: Written, binder: Binder) -> float:
    sigma = difference_in(written, binder.real(name, written.where, SETTABLE, "set").unit)
    if not sigma > 0.0:
        raise BadInput(f"{written.where}: found {written.value!r}, wanted more than zero")
    return sigma


def with_offsets(bound: BoundCampaign, binder: Binder, drift: DriftPriors) -> BoundCampaign:
    """The campaign with an offset for every stated value of its fitted sweep and of its others.

    What is taken as exact is told in its notes.

    Args:
        bound: campaign, bound to its FMU.
        binder: of the campaign to its FMU.
        drift: what is known beforehand of the error of drifting variables.

    Raises:
        BadInput: an error of what no value is stated of.
    """
    made = _Made(bound, binder, drift)
    sweep = bound.sweep
    if sweep is not None and sweep.use == "fit":
        sweep = made.sweep(sweep)
    measurements = {name: made.further(name, m) for name, m in bound.measurements.items()}
    return replace(
        bound,
        sweep=sweep,
        measurements=measurements,
        parameters=(*bound.parameters, *made.parameters),
        notes=(*bound.notes, *made.notes),
    )


class _Made:
    """Offsets of one campaign, as they are made."""

    def __init__(self, bound: BoundCampaign, binder: Binder, drift: DriftPriors) -> None:
        self.bound, self.binder, self.drift = bound, binder, drift
        self.parameters: list[Parameter] = []
        self.notes: list[str] = []
        self._labels = {e.label for e in bound.experiments}
        self._labels.update(label for m in bound.measurements.values() for label, _ in m.places)

    def sweep(self, sweep: SweepData) -> SweepData:
        """The sweep, with a label where it has offsets."""
        width_hz = half_power_width(sweep.frequency_hz, sweep.amplitude_v)
        priors = self._priors(sweep.settings, sweep.setting_sigma, width_hz)
        self._tell("sweep", sweep.settings, priors)
        if not priors:
            return sweep
        label = self._free(SWEEP)
        self._add(priors, label)
        return replace(sweep, label=label)

    def further(self, table: str, measurement: BoundMeasurement) -> BoundMeasurement:
        """A measurement of a further kind, whose only place has a label where it has offsets."""
        if not isinstance(measurement, AtStatedValues):
            return measurement
        width_hz, sigmas = measurement.line_width_hz or 0.0, measurement.setting_sigmas
        each = [
            (label in sigmas, settings, self._priors(settings, sigmas.get(label, {}), width_hz))
            for label, settings in measurement.places
        ]
        labels = [label for label, _ in measurement.places]
        if "" in labels and each[labels.index("")][2]:
            measurement = measurement.named(self._free(table))
            labels = [label for label, _ in measurement.places]
        for label, (declarable, settings, priors) in zip(labels, each, strict=True):
            kept = priors if label else []
            if declarable:
                self._tell(table, settings, kept)
            self._add(kept, label)
        return measurement

    def _priors(
        self, settings: Mapping[str, Scalar], sigmas: Mapping[str, float], width_hz: float
    ) -> list[Prior]:
        """Of everything that has an error where these settings hold."""
        stated = {**self.bound.setup.start_values, **settings}
        for name in sigmas:
            if name not in stated:
                raise BadInput(
                    f"{self.bound.path}: set_sigma: an error of '{name}', of which no value is "
                    "stated; wanted it in set, too"
                )
        units = self.binder.variables
        declared = [_alone(name, units[name].unit or "1", sigma) for name, sigma in sigmas.items()]
        drifting = [
            replace(prior, variables=left)
            for prior in self.drift.at(width_hz)
            if (left := tuple(n for n in prior.variables if n in stated and n not in sigmas))
        ]
        return [*declared, *drifting]

    def _free(self, label: str) -> str:
        """The label, with strokes if something else is called so."""
        while label in self._labels:
            label += "'"
        self._labels.add(label)
        return label

    def _add(self, priors: Sequence[Prior], label: str) -> None:
        self.parameters += [prior.correction([label]) for prior in priors]

    def _tell(self, table: str, settings: Mapping[str, Scalar], priors: Sequence[Prior]) -> None:
        """Note what is taken as exact."""
        moved = {name for prior in priors for name in prior.variables}
        exact = [name for name, value in settings.items() if self._may_err(name, value, moved)]
        note = (
            f"[{table}] is fitted with {', '.join(exact)} exactly as stated; set_sigma gives a "
            "stated value an error, which is then fitted."
        )
        if exact and note not in self.notes:
            self.notes.append(note)

    def _may_err(self, name: str, value: Scalar, moved: Collection[str]) -> bool:
        """Whether a setting is a measured number rather than a choice: real, with a unit."""
        variable = self.binder.variables.get(name)
        real = variable is not None and is_real(variable) and bool(variable.unit)
        return real and bool(value) and name not in moved
