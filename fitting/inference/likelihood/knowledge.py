"""What the data determine, as records: profiles, directions, equivalent minima, the choice of nu.

All values are in the units that stand beside them, `nan` (JSON null) where there is none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from fitting.fit.fit import Status
from fitting.signal.misfit import correlated_below
from fitting.signal.residual_tests import NOTABLE, Structure
from fitting.text.arrays import Scalar
from fitting.text.estimate import (
    Estimate,
    FittedEstimate,
    OffsetEstimate,
    OutputEstimate,
    ParameterEstimate,
)
from fitting.text.finding import Finding
from fitting.text.notation import number
from fitting.text.old_names import OldNames
from fitting.text.rendering import phrase

Floats = tuple[float, ...]
Interval = tuple[float, float]

#: Disagreement of campaigns, in standard deviations, that is worth a warning; and that no noise
#: explains, among as many tests as people make.
WORTH_A_WARNING, CONTRADICT = 3.0, 4.0
#: Probability from which chi square is smaller than the noise lets it be.
TOO_SMALL = 1.0 - 1e-4
#: Why a scan ended before anything closed its side: no further point was found, or chi square
#: jumps; or it had spent the budget.
STOPPED = {"failed": "search", "budget": "budget"}


@dataclass(frozen=True, kw_only=True)
class Rival:
    """Lines of another form that describe a measurement far better than the model.

    `shape` is one line, two, three, or a sum of decays; of a line and of complex values
    `background` is what is beside it, as in `fitting.signal.peaks`; `label` is the sweep's,
    `frequencies_hz` are those of the decays. `remedy` is what would describe the data so: the
    `key` of the campaign, an output that shows all lines, a coupling between the lines, or more
    states; empty where it is not known.
    """

    shape: Literal["line", "pair", "three_lines", "decays"]
    background: str = ""
    label: str = ""
    frequencies_hz: Floats = ()
    remedy: Literal["", "background", "output", "coupling", "states"] = ""
    key: str = ""


@dataclass(frozen=True, kw_only=True)
class Adequacy:
    """Whether the model describes the data, by the rule of `fitting.signal.misfit`.

    `chi_square` of the rows of known noise at the most likely point, against its degrees of
    `freedom`; `p_value` the probability that noise alone gives as much (NaN where there is nothing
    to judge by). `correlated_p` is the probability that white noise is as correlated as the
    residuals of the curve where it is least, named `curve`, and `share` their structured part over
    its largest amplitude (NaN: no curve). `describes` is False where the rule gives up the model;
    `noise_factor` is by how much uncorrelated residuals exceed the stated noise, 1 where they do
    not, and `is_uneven` where only a part of them does, which is no noise; `outliers` are the
    numbers of single rows far beyond the rest, without which the noise explains it.
    `converged` is False where the fit has not converged: then there are no values, either.
    `rival` are lines of another form by which the noise was estimated and the model refused
    (`fitting.inference.adequacy`); None where there are none.
    `scale_off` is the factor by which the scale that peaks take from a sweep may be off, where its
    top is so wrong that no value is trusted (`fitting.inference.sweeps`); else NaN. `no_line`:
    nothing exceeds the noise of the curves of some `series` (`fitting.inference.adequacy`).
    """

    chi_square: float
    freedom: float
    p_value: float
    describes: bool
    rival: Rival | None = None
    scale_off: float = math.nan
    no_line: bool = False
    series: tuple[str, ...] = ()
    correlated_p: float = math.nan
    share: float = math.nan
    curve: str = ""
    noise_factor: float = 1.0
    is_uneven: bool = False
    outliers: tuple[int, ...] = ()
    converged: bool = True

    @property
    def gives_values(self) -> bool:
        """Whether there are values: the fit has converged, and the model describes the data."""
        return self.describes and self.converged

    @property
    def is_correlated(self) -> bool:
        """Whether residuals are correlated along the axis of a curve."""
        return self.correlated_p < correlated_below(self.chi_square, self.freedom, self.p_value)

    @property
    def why_not(self) -> str:
        """Why there are no values, in a clause."""
        if not self.converged:
            return phrase("status", "unconverged")
        return phrase("status", "no_line" if self.no_line else "undescribed")


@dataclass(frozen=True, kw_only=True)
class Scan(OldNames):
    """Points of a profile likelihood, in rising order of the value that was scanned.

    `values` and `delta_chi2` are the points, `path` the parameters and outputs along them, `sigma`
    the linearised standard deviation at the most likely point. `held` names other parameters whose
    bounds are active along it; `stopped` is why the scan of a side ended before anything closed it,
    "search" or "budget", mostly empty.
    """

    sigma: float
    values: Floats
    delta_chi2: Floats
    path: Mapping[str, Floats]
    held: tuple[str, ...] = ()
    stopped: tuple[str, str] = ("", "")


#: A value with the profile that determines it.
Profile = tuple[FittedEstimate, Scan]


@dataclass(frozen=True, kw_only=True)
class Direction:
    """A right singular vector of the whitened sensitivities.

    `singular` in sigma per unit of the search vector, `share` per width of the box; `vector` by
    parameter. For a direction that the data do not see: `change` by parameter, a finite change that
    was evaluated, and `largest`, the most that any row moved by it, in sigma.
    """

    singular: float
    share: float
    vector: Mapping[str, float]
    change: Mapping[str, float]
    largest: float


@dataclass(frozen=True, kw_only=True)
class Equivalent:
    """Another point that fits as well: where it is, its origin ("start", "alternative"), Dchi^2.

    `where` names the settings of another alternative, empty where they are the same; `possible`
    says whether every output has a value there, or near by at something that fits as well.
    """

    parameters: Mapping[str, float]
    derived: Mapping[str, float]
    delta: float
    origin: str
    where: str = ""
    possible: bool = True


@dataclass(frozen=True, kw_only=True)
class NuRow:
    """One nu of the schedule: misfit, distance from the prior, chi square, where it led."""

    nu: float
    j_fit: float
    distance: float
    chi_square: float
    curvature: float
    parameters: Mapping[str, float]
    derived: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class NuChoice:
    """nu as the data would choose it, beside the schedule; NaN where a criterion chooses none.

    `corner` of the L-curve, `discrepancy` the largest nu whose chi square noise explains
    (`allowed`), `last` the schedule's. `prior` and `widths` are reference and width of the bounds
    of the parameters; `describes` is whether the model describes the data.
    """

    rows: tuple[NuRow, ...]
    corner: float
    discrepancy: float
    allowed: float
    last: float
    prior: Mapping[str, float]
    widths: Mapping[str, float]
    describes: bool = True


@dataclass(frozen=True, kw_only=True)
class Bootstrap:
    """Parametric bootstrap: refits of synthetic data drawn at the most likely point.

    `values` for what has a value by its status: median, standard deviation, 2.5 % and 97.5 %
    points; `failed` refits are not counted.
    """

    samples: int
    failed: int
    seed: int
    values: Mapping[str, Estimate]


@dataclass(frozen=True)
class Effort:
    """Evaluations of the objective, readings of derived outputs, simulation runs of the former."""

    evaluations: int
    derived: int
    fmu_runs: int


@dataclass(frozen=True, kw_only=True)
class Knowledge:
    """What was found about the values of a fit beside them.

    `chi_square` of the peaks (and sweep) at the most likely point, against `freedom`;
    `inflation` of all standard deviations for residuals beyond the noise, `adequacy` whether
    the model describes the data at all. `most_likely` are all parameters at that point, with their
    `units`; those in `of_experiments` belong to single experiments. `data` is False where the
    profiles are those of assumed data (before any measurement). `scans` are the profiles, by name
    of the value.
    """

    data: bool
    chi_square: float
    freedom: float
    inflation: float
    adequacy: Adequacy
    most_likely: Mapping[str, float]
    scans: Mapping[str, Scan]
    directions: tuple[Direction, ...]
    without_effect: tuple[str, ...]
    equivalents: tuple[Equivalent, ...]
    effort: Effort
    units: Mapping[str, str] = field(default_factory=dict)
    of_experiments: tuple[str, ...] = ()
    nu: NuChoice | None = None
    bootstrap: Bootstrap | None = None


@dataclass(frozen=True, kw_only=True)
class PairTest:
    """Test of the numbers that two sets of campaigns both determine.

    `chi_square` of their difference, against `freedom` of them; `sigmas` the same as standard
    deviations of a normal distribution (NaN where they determine nothing in common).
    """

    one: str
    other: str
    chi_square: float
    freedom: int
    p_value: float
    sigmas: float

    @property
    def level(self) -> Literal["agreement", "tension", "contradiction"]:
        """Whether both sets of campaigns agree, as far as noise explains."""
        if self.sigmas > CONTRADICT:
            return "contradiction"
        return "tension" if self.sigmas > WORTH_A_WARNING else "agreement"


@dataclass(frozen=True)
class ValueAlone:
    """A value as one campaign alone determines it (NaN where it does not), with its error."""

    value: float
    std: float


@dataclass(frozen=True, kw_only=True)
class SeriesPart:
    """One campaign of a joint fit.

    `chi` is its scale; `determined` how many numbers its data determine; `chi_square_joint` of its
    rows at the joint solution and `chi_square_alone` at its own, both linearised at the former;
    `rows` the number of its rows, `alone` what it determines by itself, by name; `swept_initial_v`
    and `swept_final_v` its sweep as simulated (scaled) before and after, at the measured points.
    """

    name: str
    campaign: str
    scale_kind: str
    chi: float
    rows: int
    determined: int
    chi_square_joint: float
    chi_square_alone: float
    inflation: float
    alone: Mapping[str, ValueAlone]
    swept_initial_v: tuple[float, ...] = ()
    swept_final_v: tuple[float, ...] = ()


@dataclass(frozen=True)
class JointResult:
    """Campaigns of a joint fit, and whether they agree."""

    series: tuple[SeriesPart, ...]
    tensions: tuple[PairTest, ...]


@dataclass(frozen=True, kw_only=True)
class ExternalTest:
    """Distance of a result from a value found elsewhere, in standard deviations (NaN: untestable).

    `std` of the external value is zero where none was given; `found`, `found_std` are the result's.
    """

    name: str
    value: float
    std: float
    unit: str
    found: float
    found_std: float
    sigmas: float


@dataclass(frozen=True, kw_only=True)
class PhaseGain:
    """Standard deviation of a value, of `amplitudes` alone and with `phases`, in `unit`.

    With phases it is the reported one, of amplitudes alone it is as many times as wide as in the
    linearised problem.
    """

    name: str
    unit: str
    amplitudes: float
    phases: float


@dataclass(frozen=True, kw_only=True)
class Quadratures:
    """Gains in precision by phases, and qualities that follow from what is solved inside.

    Both are empty without any. The interval of a quality is symmetric in its logarithm, that of a
    quality factor in 1/Q, and infinite above where no loss at all would suit the data as well; its
    value is NaN where its loss comes out negative.
    """

    gains: tuple[PhaseGain, ...] = ()
    qualities: tuple[Estimate, ...] = ()

    @property
    def alike(self) -> list[list[PhaseGain]]:
        """The gains, those of one number together: outputs of the FMU that are a parameter.

        Profiles, which are scanned for each, are the same as far as they are printed.
        """
        groups: dict[tuple[str, ...], list[PhaseGain]] = {}
        for gain in self.gains:
            ratio = f"{gain.amplitudes / gain.phases:.6g}"
            key = (gain.unit, number(gain.amplitudes, 2), number(gain.phases, 2), ratio)
            groups.setdefault(key, []).append(gain)
        return list(groups.values())


@dataclass(frozen=True, kw_only=True)
class Ending:
    """How a fit ended and what that rests on; a sentence is made of it by a template.

    `adequacy` is None where the residuals were not tested, `inflation` the factor on all errors for
    residuals beyond the noise, `structure` that of the residuals of curves, `noise` what chi square
    is compared with. `share` is the residual of the curve that is described worst, root mean
    square, over its largest amplitude, of complex values the distance from the model; it `is_part`
    where there are other rows, too. `contradictions` are those of campaigns.
    """

    kind: Literal["described", "not_described", "no_line", "contradiction", "not_converged"] = (
        "not_converged"
    )
    adequacy: Adequacy | None = None
    inflation: float = 1.0
    structure: Structure | None = None
    noise: Literal["stated", "estimated"] = "stated"
    share: float = math.nan
    is_part: bool = False
    contradictions: tuple[PairTest, ...] = ()

    @property
    def is_tested(self) -> bool:
        """Whether chi square is compared with its distribution."""
        return self.adequacy is not None and math.isfinite(self.adequacy.p_value)

    @property
    def is_small(self) -> bool:
        """Whether chi square is smaller than the noise lets it be."""
        return self.adequacy is not None and self.adequacy.p_value > TOO_SMALL

    @property
    def is_scaled(self) -> bool:
        """Whether errors are scaled for the residuals of all rows."""
        factor = 1.0 if self.adequacy is None else self.adequacy.noise_factor
        return self.inflation > NOTABLE or factor > 1.0

    @property
    def is_structured(self) -> bool:
        """Whether errors are scaled for the structure of the residuals of curves."""
        return self.structure is not None and self.structure.widening > NOTABLE

    @property
    def is_whole(self) -> bool:
        """Whether chi square is what the noise explains, so that nothing need be added."""
        scaled = self.is_scaled or self.is_structured
        return self.kind == "described" and self.is_tested and not (scaled or self.is_small)

    @property
    def shows_share(self) -> bool:
        """Whether residuals of curves are no noise of one size, or no noise was stated."""
        if self.kind != "described" or not math.isfinite(self.share):
            return False
        unstated = self.adequacy is not None and math.isnan(self.adequacy.chi_square)
        return self.is_structured or (unstated and not self.is_scaled)


@dataclass(frozen=True, kw_only=True)
class Values:
    """What data determine: every value with its interval and status, and what was found besides."""

    parameters: Mapping[str, ParameterEstimate]
    """The fitted parameters by name."""
    derived: Mapping[str, OutputEstimate]
    """Outputs of the FMU that follow from them, by name."""
    offsets: tuple[OffsetEstimate, ...] = ()
    """Fitted values of single experiments, as offsets from the drift."""
    findings: tuple[Finding, ...] = ()
    """What a reader has to know, decided once."""
    knowledge: Knowledge | None
    """What the data determine beside values: profiles, directions, other minima."""
    ending: Ending = field(default_factory=Ending)
    """Whether the model describes the data, and what that rests on."""

    @property
    def scans(self) -> Mapping[str, Scan]:
        """Profiles by name of the value; none where nothing was scanned."""
        return {} if self.knowledge is None else self.knowledge.scans

    @property
    def profiled(self) -> dict[str, FittedEstimate]:
        """Parameters and outputs whose profiles were scanned, by name."""
        both: dict[str, FittedEstimate] = {**self.parameters, **self.derived}
        return {name: value for name, value in both.items() if name in self.scans}


@dataclass(frozen=True, kw_only=True)
class Inferred(Values):
    """Values of a fit, how it ended, and what was found besides."""

    status: Status
    """How the fit ended, and whether its model describes the data."""
    message: str
    """What `status` means here, a sentence."""
    knowledge: Knowledge | None = None
    """What the data determine beside values: profiles, directions, other minima."""
    joint: JointResult | None = None
    """Several series: what they say alone, together and of each other."""
    quadratures: Quadratures = field(default_factory=Quadratures)
    """What was solved inside complex sweeps, and quality factors behind a wiring."""
    chi_square: float = math.nan
    """Of the rows of known noise at the most likely point; NaN where nothing was tested."""
    dof: float = math.nan
    """Its degrees of freedom."""


@dataclass(frozen=True, kw_only=True)
class Determined(Values):
    """What profiles of all values determine, without a fit by Algorithm 2 or around one."""

    knowledge: Knowledge


@dataclass(frozen=True, kw_only=True)
class PartAlone(Determined):
    """What the measurements at some `settings` determine without the others.

    `places` of `total` were measured there.
    """

    settings: Mapping[str, Scalar]
    places: int
    total: int


@dataclass(frozen=True, kw_only=True)
class Identification(Determined):
    """What `fmu-fit identify` writes: where it set out from (`at`), and what it found.

    `part`: what some of the measurements determine alone, if that was asked.
    """

    title: str
    synthetic: bool
    at: str
    provenance: Mapping[str, str]
    part: PartAlone | None = None
