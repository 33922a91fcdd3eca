"""The campaign file as it is written: every key that it can have, each described once.

The fields of a record here are the keys of its table. `read_campaign_file` reads and checks them,
`fitting.campaign.schema` tells editors of them. No data file is opened, and what depends on the
FMU's variables (their units, whether they are there) is still as written.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from fitting.campaign.instruments import LAYOUTS, Selection
from fitting.signal.amplitudes import Amplitude, declared_amplitude
from fitting.signal.combinations import Combination, lines_to_read
from fitting.signal.peaks import BACKGROUNDS, FLOOR_KINDS
from fitting.signal.scale import SCALES
from fitting.text.keys import (
    About,
    Count,
    Counts,
    FileName,
    Frequencies,
    Keys,
    Number,
    OneOf,
    Positive,
    Positives,
    Quantity,
    Refused,
    Rest,
    Share,
    Switch,
    Text,
    Texts,
    Value,
    Values,
    WholeNumber,
    refusing,
    tables_wanted,
)
from fitting.text.schema import read_record
from fitting.text.toml import read_toml
from fitting.text.units import checked_accuracy
from fitting.text.written import Written

MISFITS = ("slack", "absolute", "squares")
DRIFT_MODELS = ("linear", "offsets", "walk")
OUTLIERS = ("keep", "huber")
CRITERIA = ("target", "D", "A")
SAMPLES_PER_PERIOD = 200
UNIT_LEVEL = Written(1.0, None, "[drive] level")


@dataclass(frozen=True, kw_only=True)
class WrittenFmu(Keys):
    """Which FMU: ``model`` of this project, built on demand, or ``file``; its start values."""

    model: Annotated[
        Text | None, About("a model of this project, built on demand; either this or file")
    ] = None
    file: Annotated[FileName | None, About("an FMU (FMI 2.0 or 3.0, co-simulation)")] = None
    timeout_s: Annotated[
        Positive, About("longest simulation run, then the FMU counts as failed", "s")
    ] = 60.0
    start: Annotated[
        Mapping[str, Value], About("start value of any FMU variable that can be set")
    ] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if (self.model is None) == (self.file is None):
            raise Refused("wanted either 'model' or 'file'")


@dataclass(frozen=True, kw_only=True)
class WrittenObserve(Keys):
    """The observed FMU output, and what is known about its settling; ``line_width`` in Hz."""

    output: Annotated[Text, About("the FMU output that the detector sees")]
    line_width: Annotated[
        float | None,
        Quantity("Hz"),
        About("rough width, sets the settling time; without it the width of the sweep"),
    ] = None
    steady_start: Annotated[
        Switch, About("the FMU, started so, is on its periodic orbit: no settling")
    ] = False


@dataclass(frozen=True, kw_only=True)
class WrittenDrive(Keys):
    """How the FMU is driven; ``level`` of an active tone, ``input`` for kind "input"."""

    kind: Annotated[
        Text,
        OneOf(("tones", "input")),
        About('"tones": FMU parameters hold the tones; "input": the signal is generated'),
    ]
    frequencies: Annotated[
        Texts, About("columns of the experiments file; with tones also FMU parameters")
    ]
    amplitudes: Annotated[Texts | None, About("(tones) FMU parameters, one per frequency")] = None
    input: Annotated[Text | None, About("(input) the driven FMU input")] = None
    level: Annotated[
        Value, About("amplitude of every active tone, in the unit of the amplitude or input")
    ] = UNIT_LEVEL
    samples_per_period: Annotated[
        Count | None,
        About(
            "(input) held steps per period of the highest tone, at least 4",
            default=SAMPLES_PER_PERIOD,
        ),
    ] = None
    read: Annotated[
        Texts | None,
        About('lines whose peaks are compared, "2*u1 - u2" for example; without it the tones'),
    ] = None
    order: Annotated[
        Count | None,
        About(
            "up to this order sampling keeps combinations of the tones off the lines that are "
            "read; 1 without it, 9 if read has a combination"
        ),
    ] = None

    def __post_init__(self) -> None:
        own = "amplitudes" if self.kind == "tones" else "input"
        for key in ("input", "samples_per_period") if self.kind == "tones" else ("amplitudes",):
            if getattr(self, key) is not None:
                raise Refused(f'has no meaning with kind = "{self.kind}"', key)
        if not self.frequencies:
            raise Refused("is empty, wanted at least one name", "frequencies")
        if getattr(self, own) is None:
            raise Refused(f"key '{own}' is missing")
        if self.amplitudes is not None and len(self.amplitudes) != len(self.frequencies):
            raise Refused(
                f"{len(self.amplitudes)} names, wanted {len(self.frequencies)}, one per frequency",
                "amplitudes",
            )
        if self.samples_per_period is not None and self.samples_per_period < 4:
            raise Refused(
                f"found {self.samples_per_period}, wanted a whole number of at least 4",
                "samples_per_period",
            )
        with refusing("read"):
            self._lines()

    def _lines(self) -> tuple[tuple[Combination, ...], int]:
        read = self.frequencies if self.read is None else self.read
        return lines_to_read(read, self.order, self.frequencies, "")

    @property
    def lines(self) -> tuple[Combination, ...]:
        """The lines whose peaks are compared."""
        return self._lines()[0]

    @property
    def highest_order(self) -> int:
        """Highest order of combinations of the tones that the response may hold."""
        return self._lines()[1]


@dataclass(frozen=True, kw_only=True)
class WrittenColumns(Keys):
    """Names of a trace's columns where they are not the usual ones (empty)."""

    frequency: Annotated[Text, About("column of frequencies")] = ""
    amplitude: Annotated[Text, About("column of amplitudes")] = ""
    phase: Annotated[Text, About("column of phases")] = ""


@dataclass(frozen=True)
class TraceFormat:
    """How a trace file is read: layout, amplitude declaration, selection within the file."""

    layout: str
    amplitude: Amplitude
    selection: Selection


@dataclass(frozen=True, kw_only=True)
class WrittenTrace(Keys):
    """Keys that [experiments] and [sweep] share: what the files mean, and which layout they have.

    ``impedance`` in ohm.
    """

    amplitude: Annotated[
        Text,
        About(
            'what the file\'s amplitudes mean: "V peak", "V rms", "dBm" or another detector unit '
            'likewise, as "m peak"',
            missing='wanted "V peak", "V rms" or "dBm"; files do not tell which they mean',
        ),
    ]
    impedance: Annotated[
        float | None, Quantity("ohm"), About("with dBm only, and required there")
    ] = None
    layout: Annotated[
        Text | None, OneOf(tuple(LAYOUTS)), About("how the instrument writes", default="csv")
    ] = None
    columns: Annotated[
        WrittenColumns, About("names of columns, where they are not the usual ones")
    ] = WrittenColumns()
    trace: Annotated[Count | None, About("(rohde-schwarz only) which trace, from 1", default=1)] = (
        None
    )
    chunk: Annotated[
        WholeNumber | None,
        About("(zurich only) which sweep of the file; without it the only one there is"),
    ] = None

    def __post_init__(self) -> None:
        with refusing("amplitude"):
            declared_amplitude(self.amplitude, self.impedance, "")
        for key, only in (("trace", "rohde-schwarz"), ("chunk", "zurich")):
            if getattr(self, key) is not None and self._found() != f'layout = "{only}"':
                raise Refused(
                    f'has no meaning with {self._found()}, only with layout = "{only}"', key
                )

    def _found(self) -> str:
        """Words for what is read."""
        return f'layout = "{self.layout or "csv"}"'

    @property
    def format(self) -> TraceFormat:
        """How a file is read."""
        columns = self.columns
        return TraceFormat(
            layout=self.layout or "csv",
            amplitude=declared_amplitude(self.amplitude, self.impedance, ""),
            selection=Selection(
                frequency=columns.frequency,
                amplitude=columns.amplitude,
                phase=columns.phase,
                trace=self.trace or 1,
                chunk=self.chunk,
            ),
        )


@dataclass(frozen=True, kw_only=True)
class WrittenExperiments(WrittenTrace):
    """The experiments file, with a pattern of ``spectra`` or columns of ready ``peaks``."""

    file: Annotated[
        FileName,
        Frequencies,
        About(
            "table: experiment (label), a column per drive frequency with its unit, and any "
            "columns that set FMU variables, as mass (g)"
        ),
    ]
    spectra: Annotated[
        Text | None, About('a spectrum per experiment, as "spectra/{experiment}.csv"')
    ] = None
    peaks: Annotated[
        Texts, About("or columns of ready peak amplitudes, one per line read, unit in the header")
    ] = ()
    peak_sigmas: Annotated[
        Texts, About("columns of their standard deviations, in the same meaning (rms or peak)")
    ] = ()
    noise_floor: Annotated[
        Text,
        OneOf(FLOOR_KINDS),
        About(
            'what is taken off a peak z: "robust": sqrt(z^2 - sigma^2), sigma from the median; '
            '"mean": z - mean; "none"'
        ),
    ] = "robust"

    def __post_init__(self) -> None:
        if (self.spectra is not None) == bool(self.peaks):
            raise Refused("wanted either 'spectra' or 'peaks'")
        if self.spectra is not None and "{experiment}" not in self.spectra:
            raise Refused(f"'{self.spectra}' wanted with '{{experiment}}' in it", "spectra")
        if self.peak_sigmas and not self.peaks:
            raise Refused("wanted only beside 'peaks'", "peak_sigmas")
        super().__post_init__()
        if self.peak_sigmas and self.format.amplitude.kind == "dBm":
            raise Refused(
                "a standard deviation in dBm is a ratio, not an amplitude; wanted peaks and "
                'sigmas in "V peak" or "V rms"',
                "peak_sigmas",
            )

    def _found(self) -> str:
        return super()._found() if self.spectra is not None else "ready peaks"


@dataclass(frozen=True, kw_only=True)
class WrittenSweep(WrittenTrace):
    """The FRF sweep: its file, the FMU variables during it, what it serves."""

    file: Annotated[FileName, About("the measured FRF, at least 8 points")]
    set: Annotated[Mapping[str, Value], About("FMU variables during the sweep")] = field(
        default_factory=dict
    )
    use: Annotated[
        Text,
        OneOf(("scale", "fit")),
        About('"scale": sets the scale only; "fit": each point is a residual row too'),
    ] = "scale"
    scale: Annotated[
        Text,
        OneOf(SCALES),
        About(
            'from simulated to measured amplitudes: "maximum": ratio of maxima; "fit": least '
            'squares over the sweep; "robust": Huber\'s estimate over it; "free": a fitted '
            'ln_scale; "none": 1'
        ),
    ] = "maximum"
    background: Annotated[
        Text,
        OneOf(BACKGROUNDS),
        About('of the line fit to the sweep: "none" or one "complex" constant'),
    ] = "none"


@dataclass(frozen=True, kw_only=True)
class WrittenParameter(Keys):
    """A fitted FMU parameter; ``unit`` belongs to every bare number of the entry."""

    name: Annotated[Text, About("a Real parameter of the FMU")]
    unit: Annotated[
        Text | None, About("of the bare numbers in this table; without it the FMU's")
    ] = None
    scope: Annotated[
        Text,
        OneOf(("campaign", "experiment")),
        About('"campaign": one value; "experiment": every experiment has one of its own'),
    ] = "campaign"
    lower: Annotated[Value, About("lower end of the box")]
    upper: Annotated[Value, About("upper end of the box")]
    start: Annotated[Value, About("first start, inside the box")]
    reference: Annotated[
        Value | None, About("where the Tikhonov term pulls to; without it start")
    ] = None
    scale: Annotated[
        Value | None, About("the change that counts as 1 in x; without it half the box")
    ] = None
    period: Annotated[
        Value | None, About("values that far apart are the same system; reported in [0, period)")
    ] = None
    prior: Annotated[
        Value | None, About("standard deviation of a Gaussian prior about reference")
    ] = None

    @property
    def numbers(self) -> dict[str, Written]:
        """The numbers of the entry by their keys, as far as they are written."""
        keys = ("lower", "upper", "start", "reference", "scale", "period", "prior")
        found = {key: getattr(self, key) for key in keys}
        return {key: written for key, written in found.items() if written is not None}


@dataclass(frozen=True, kw_only=True)
class DriftEnds(Keys):
    """Values of a drifting variable before and after the series."""

    before: Annotated[Value, About("value before the series")]
    after: Annotated[Value, About("value after the series")]


@dataclass(frozen=True, kw_only=True)
class WrittenDrift(Keys):
    """How variables move over the experiments, ``ends`` by variable.

    ``model`` "linear": interpolated between the ends; "offsets": and one fitted offset per
    experiment, ``prior`` its standard deviation; "walk": and a random walk, ``prior`` the standard
    deviation of a step. ``time`` names the column of time stamps.
    """

    ends: Annotated[Mapping[str, DriftEnds], About("values before and after the series")] = field(
        default_factory=dict
    )
    model: Annotated[
        Text,
        OneOf(DRIFT_MODELS),
        About(
            '"linear" between before and after; "offsets": and one fitted offset per experiment; '
            '"walk": and a random walk'
        ),
    ] = "linear"
    prior: Annotated[
        Value | None, About("standard deviation of an offset, or of a step of the walk")
    ] = None
    share: Annotated[
        Switch | None,
        About("one offset for all drifting variables, or one each", default=True),
    ] = None
    time: Annotated[
        Text,
        About(
            "column of time stamps (numbers with a unit, or ISO dates) that place the experiments "
            "between before and after; without it the order of the rows"
        ),
    ] = ""
    before_time: Annotated[
        Value | None, About("when the values before were measured; without it the first experiment")
    ] = None
    after_time: Annotated[
        Value | None, About("when the values after were measured; without it the last experiment")
    ] = None

    def __post_init__(self) -> None:
        alone = (self.prior, self.share, self.before_time, self.after_time)
        said = self.model != "linear" or self.time or any(value is not None for value in alone)
        if said and not self.ends:
            raise Refused(
                "names no variable; wanted at least one that drifts, as in "
                'eta = { before = "6.94021 MHz", after = "6.94031 MHz" }'
            )
        if self.model == "linear":
            for key in ("prior", "share"):
                if getattr(self, key) is not None:
                    raise Refused('has no meaning with model = "linear"', key)
        elif self.prior is None:
            what = "of an offset" if self.model == "offsets" else "of a step of the walk"
            raise Refused(
                f'is missing; model = "{self.model}" wants the standard deviation {what}, as in '
                'prior = "30 Hz"',
                "prior",
            )
        for key in ("before_time", "after_time"):
            if getattr(self, key) is not None and not self.time:
                raise Refused("wanted only beside time = a column", key)


@dataclass(frozen=True, kw_only=True)
class WrittenNoise(Keys):
    """Declared noise: ``relative`` (a share of the amplitude) and ``absolute``.

    Both are standard deviations and add in quadrature to what the data tell of themselves.
    """

    relative: Annotated[
        Share, About("standard deviation of every amplitude as a share of it, beside the floor's")
    ] = 0.0
    absolute: Annotated[
        Value | None,
        About('standard deviation of every amplitude, as "0.1 uV"'),
    ] = None
    outliers: Annotated[
        Text,
        OneOf(OUTLIERS),
        About('"huber": peaks beyond 1.345 standard deviations count linearly in least squares'),
    ] = "keep"
    threshold: Annotated[
        Positive, About("peaks whose studentised residual exceeds it are named in a warning")
    ] = 4.0


@dataclass(frozen=True, kw_only=True)
class WrittenDerived(Keys):
    """What else is reported of every experiment."""

    outputs: Annotated[Texts, About("FMU outputs read after initialisation, per experiment")] = ()


@dataclass(frozen=True, kw_only=True)
class ContinuationSettings(Keys):
    """Algorithm 2: nu_start, factor beta, number of nu, tolerance, misfit form, starts, seed."""

    nu_start: Annotated[Number, About("first nu, zero or more")] = 0.1
    beta: Annotated[Positive, About("factor from one nu to the next, below 1")] = 0.1
    iterations: Annotated[Count, About("number of nu")] = 9
    tolerance: Annotated[
        Positive, About("stop when ||x_(l+1) - x_l|| + |J_fit - J_reg| falls to it")
    ] = 2.22e-16
    misfit: Annotated[
        Text,
        OneOf(MISFITS),
        About(
            '"slack": sum of |r| with slack variables; "absolute": sum of |r| as written; '
            '"squares": sum of r^2'
        ),
    ] = "slack"
    starts: Annotated[Count, About("the campaign's own start and seeded ones in the box")] = 3
    seed: Annotated[WholeNumber, About("of the further starts")] = 1

    def __post_init__(self) -> None:
        if self.nu_start < 0.0:
            raise Refused(f"found {self.nu_start}, wanted zero or more", "nu_start")
        if self.beta >= 1.0:
            raise Refused(f"found {self.beta}, wanted a factor below 1", "beta")


@dataclass(frozen=True, kw_only=True)
class WrittenReduction(Keys):
    """Start values that make the FMU cheaper, and the output that bounds what that leaves out."""

    name: Annotated[Text, About("how it is called in the plan")]
    set: Annotated[Mapping[str, Value], About("start values that make the FMU cheaper")]
    bound: Annotated[
        Text | None, About("FMU output that bounds what is left out; {output} is the observed one")
    ] = None

    def __post_init__(self) -> None:
        if not self.set:
            raise Refused("is empty, wanted start values of the FMU", "set")


@dataclass(frozen=True, kw_only=True)
class WrittenAccuracy(Keys):
    """How accurate amplitudes must be, and what may be left out for it.

    `fitting.fmu.accuracy.Hints` tells what the names mean.
    """

    amplitude: Annotated[
        Positive, About("wanted relative accuracy of simulated amplitudes, below 1")
    ] = 1e-6
    tolerance: Annotated[
        Text | None, About("FMU parameter that bounds its solver's relative error")
    ] = None
    substep: Annotated[Text | None, About("FMU parameter: longest substep", "s")] = None
    full: Annotated[
        Mapping[str, Value], About("start values of the model with nothing left out")
    ] = field(default_factory=dict)
    reductions: Annotated[
        tuple[WrittenReduction, ...],
        tables_wanted("[[accuracy.reductions]] tables", found=True),
        About("ways to leave something out, which a plan may take"),
    ] = ()
    force: Annotated[Texts, About("names of reductions to take, whatever they cost")] = ()
    forbid: Annotated[Texts, About("names of reductions not to take")] = ()

    def __post_init__(self) -> None:
        with refusing("amplitude"):
            checked_accuracy(self.amplitude, "")


@dataclass(frozen=True, kw_only=True)
class WrittenDesign(Keys):
    """Limits of the instrument for the next measurements; frequencies in Hz.

    What is not written is taken from the campaign itself (`fitting.design.limits`).
    """

    outputs: Annotated[
        Texts | None, About("what can be observed; without it outputs named alike, of one unit")
    ] = None
    centres: Annotated[
        Frequencies | None,
        About("resonances; without it the sweep's maximum, drifting frequencies"),
    ] = None
    frequency_step: Annotated[float | None, Quantity("Hz"), About("grid of the drive")] = None
    least_spacing: Annotated[float | None, Quantity("Hz"), About("least distance of two tones")] = (
        None
    )
    farthest: Annotated[float | None, Quantity("Hz"), About("largest detuning of a tone")] = None
    both_sides: Annotated[Switch, About("tones on both sides of the resonance")] = True
    tones: Annotated[Count | None, About("tones at once; 1: single tones, as in a sweep")] = None
    levels: Annotated[
        Positives | None, About("drive levels to try, in units of the campaign's level")
    ] = None
    repeats: Annotated[
        Positives | None, About("numbers of spectra averaged with their phases to try")
    ] = None
    noise_floor: Annotated[
        Value | None,
        About('of a peak in one spectrum, as "0.18 uV"; without it the median of the campaign\'s'),
    ] = None
    relative_noise: Annotated[
        Number | None,
        About("noise of a peak as a share of it, which averaging does not lower", default=0.01),
    ] = None
    largest: Annotated[
        Value | None, About("what the detector bears; without it twice the largest amplitude seen")
    ] = None
    number: Annotated[Count | None, About("measurements, at most", default=6)] = None
    target: Annotated[Text, About("the value that is to be known better")] = ""
    criterion: Annotated[
        Text | None,
        OneOf(CRITERIA),
        About("error of the target, or D or A of all parameters", default="target"),
    ] = None
    settings: Annotated[Mapping[str, Values], About("values of further FMU parameters to try")] = (
        field(default_factory=dict)
    )
    setting_sigma: Annotated[
        Mapping[str, Value], About("error of what is believed of what drifts")
    ] = field(default_factory=dict)
    averaged: Annotated[
        Counts | None, About("spectra averaged in each row of a campaign that a design made")
    ] = None


@dataclass(frozen=True, kw_only=True)
class WrittenCampaign(Keys):
    """Everything the campaign file says; data files are named here, not read."""

    title: Annotated[Text, About("heading of the report")]
    synthetic: Annotated[Switch, About('marks every figure and page "synthetic"')] = False
    fmu: Annotated[WrittenFmu, About("the FMU and its start values")]
    observe: Annotated[WrittenObserve, About("the observed output")]
    drive: Annotated[WrittenDrive, About("how the FMU is driven")]
    experiments: Annotated[WrittenExperiments | None, About("measurements under a few tones")] = (
        None
    )
    drift: Annotated[
        WrittenDrift, Rest("ends"), About("variables that move over the experiments")
    ] = WrittenDrift()
    noise: Annotated[WrittenNoise, About("declared noise of the amplitudes")] = WrittenNoise()
    sweep: Annotated[WrittenSweep | None, About("a measured frequency response")] = None
    parameters: Annotated[
        tuple[WrittenParameter, ...],
        tables_wanted("one [[parameters]] table or more", least=1),
        About("the FMU parameters that are fitted"),
    ]
    derived: Annotated[WrittenDerived, About("what else is reported")] = WrittenDerived()
    alternatives: Annotated[
        Mapping[str, Values],
        About("variable: values to try, in all combinations; the best one is reported"),
    ] = field(default_factory=dict)
    continuation: Annotated[
        ContinuationSettings, About("the sequence of fits with less and less regularisation")
    ] = ContinuationSettings()
    accuracy: Annotated[WrittenAccuracy, About("how accurately the FMU is to be simulated")] = (
        WrittenAccuracy()
    )
    design: Annotated[
        WrittenDesign, About("the instrument's limits, for the next measurements")
    ] = WrittenDesign()

    def __post_init__(self) -> None:
        experiments, observe = self.experiments, self.observe
        if experiments is None and not (self.sweep is not None and self.sweep.use == "fit"):
            raise Refused(
                'nothing to fit: wanted a table [experiments], or a [sweep] with use = "fit"'
            )
        if not observe.steady_start and observe.line_width is None and self.sweep is None:
            raise Refused(
                "wanted line_width (a rough one sets the settling time), or steady_start = true if "
                "the FMU starts on its periodic orbit, or a [sweep]",
                "observe",
            )
        if self.drift.ends and experiments is None:
            raise Refused("drifts over experiments, but there are none", "drift")
        lines = len(self.drive.lines)
        for key in ("peaks", "peak_sigmas") if experiments is not None else ():
            columns = getattr(experiments, key)
            if columns and len(columns) != lines:
                raise Refused(
                    f"{len(columns)} columns, wanted {lines}, one per tone", "experiments", key
                )


def read_campaign_file(path: Path) -> WrittenCampaign:
    """Read and check the TOML of a campaign.

    Raises:
        BadInput: no such file, not TOML; or a key that is missing, unknown or of the wrong kind:
            one line for each.
    """
    return read_record(WrittenCampaign, read_toml(path), path)
