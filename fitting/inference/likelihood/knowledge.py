"""What the data determine, as records: profiles, directions, equivalent minima, the choice of nu.

All values are in the units given with them, `nan` (JSON null) where there is none.
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

    `shape`: one line, two, three, or a sum of decays with `frequencies_hz`; `background` next to a
    line and complex values, as in `fitting.signal.peaks`; `label` of the sweep. `remedy`: what
    would describe the data, the `key` of the campaign, an output that shows all lines, a coupling,
    or more states; empty: unknown.
    """

    shape: Literal["line", "pair", "three_lines", "decays"]
    background: str = ""
    label: str = ""
    frequencies_hz: Floats = ()
    remedy: Literal["", "background", "output", "coupling", "states"] = ""
    key: str = ""


@dataclass(frozen=True, kw_only=True)
class Adequacy:
    """Whether the model describes the data (`fitting.signal.misfit`).

    `chi_square` of rows of known noise at the most likely point, its degrees of `freedom` and
    `p_value` (NaN: not tested). `correlated_p`: of white noise as correlated as the residuals of
    the worst `curve`, `share`: their structured part over its largest amplitude (NaN: no curve).
    `describes`: False: the model is rejected; `converged`: False: no values either. `noise_factor`
    >= 1: uncorrelated residuals over the stated noise; `is_uneven`: only of a part of them;
    `outliers`: row numbers without which the noise explains all. `rival`: lines of another form,
    for which the model is rejected. `scale_off`: factor by which the scale from a sweep may be
    wrong, if no value is trusted; else NaN. `no_line`: no line above the noise in curves of some
    `series`.
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
    """Points of a profile likelihood, in rising order of the scanned value.

    `values` and `delta_chi2`, with parameters and outputs in `path`; `sigma`: linearised standard
    deviation at the most likely point; `held`: other parameters with active bounds; `stopped`:
    "search" or "budget" for each side that ended before it was closed, else empty.
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

    `singular` in sigma per unit of the search vector, `share` per width of the bounds, `vector` by
    parameter. Of an undetermined direction: `change`, a finite change by parameter, and `largest`,
    the largest change of a row, in sigma.
    """

    singular: float
    share: float
    vector: Mapping[str, float]
    change: Mapping[str, float]
    largest: float


@dataclass(frozen=True, kw_only=True)
class Equivalent:
    """Another point that fits as well, its origin ("start", "alternative") and Δχ², `delta`.

    `where`: settings of another alternative, else empty; `possible`: whether every output has a
    value there or near by.
    """

    parameters: Mapping[str, float]
    derived: Mapping[str, float]
    delta: float
    origin: str
    where: str = ""
    possible: bool = True


@dataclass(frozen=True, kw_only=True)
class NuRow:
    """One ν of the schedule: misfit, distance from the prior, χ², and its solution."""

    nu: float
    j_fit: float
    distance: float
    chi_square: float
    curvature: float
    parameters: Mapping[str, float]
    derived: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class NuChoice:
    """ν as the data would choose it; NaN where a criterion chooses none.

    `corner` of the L-curve, `discrepancy`: the largest ν whose χ² noise explains (`allowed`),
    `last` of the schedule; `prior` and `widths`: references and distances of the bounds;
    `describes`: whether the model describes the data.
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
    """Refits of synthetic data drawn at the most likely point; `failed` ones do not count.

    `values`: median, standard deviation, 2.5 % and 97.5 % points of what has a value.
    """

    samples: int
    failed: int
    seed: int
    values: Mapping[str, Estimate]


@dataclass(frozen=True)
class Effort:
    """Evaluations of the objective, readings of derived outputs, FMU runs of the former."""

    evaluations: int
    derived: int
    fmu_runs: int


@dataclass(frozen=True, kw_only=True)
class Knowledge:
    """What the data of a fit determine besides values.

    `chi_square` at the most likely point, with its `freedom`; `inflation`: factor on errors for
    residuals beyond the noise. `most_likely`: all parameters, with `units`, those in
    `of_experiments` of single experiments. `data`: False: profiles are of expected data. `scans`:
    profiles by value.
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

    `chi_square` of their difference, `freedom`; `sigmas`: as normal deviate (NaN: nothing in
    common).
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
    """A value as one campaign alone determines it, with its error; NaN: undetermined."""

    value: float
    std: float


@dataclass(frozen=True, kw_only=True)
class SeriesPart:
    """One campaign of a joint fit.

    `chi`: its scale; `rows` of data, which determine `determined` numbers; `chi_square_joint` at
    the joint solution, `chi_square_alone` at its own, both linearised; `alone`: values that it
    determines by itself; `swept_initial_v`, `swept_final_v`: its simulated sweep before and after.
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
    """Distance from a value found elsewhere, in standard deviations `sigmas` (NaN: untestable).

    `std` of that value, 0: not given; `found`, `found_std`: the result's.
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

    With phases: as reported; alone: scaled by the ratio in the linearised problem.
    """

    name: str
    unit: str
    amplitudes: float
    phases: float


@dataclass(frozen=True, kw_only=True)
class Quadratures:
    """Gains in precision by phases, and quality factors from what is solved for; empty without.

    Intervals of quality factors are symmetric in 1/Q, infinite above if no loss fits as well; NaN:
    negative loss. Those of other qualities are symmetric in the logarithm.
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
    """How a fit ended, and why.

    `adequacy`: None: residuals were not tested; `inflation`: factor on all errors for residuals
    beyond the noise; `structure`: of the residuals of curves; `noise`: to which χ² is compared.
    `share`: rms residual of the worst curve over its largest amplitude; `is_part`: whether there
    are other rows.
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
    """What the data determine besides values: profiles, directions, other minima."""
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
    """What the data determine besides values: profiles, directions, other minima."""
    joint: JointResult | None = None
    """Several series: what they determine alone and together, and how they agree."""
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
    """What the measurements at some `settings`, `places` of `total`, determine alone."""

    settings: Mapping[str, Scalar]
    places: int
    total: int


@dataclass(frozen=True, kw_only=True)
class Identification(Determined):
    """What `fmu-fit identify` writes: its start `at`, what data determine, and what a `part`."""

    title: str
    synthetic: bool
    at: str
    provenance: Mapping[str, str]
    part: PartAlone | None = None
