"""The campaign file as it is written: every key that it can have, each described once.

The fields of a record here are the keys of its table, with what they mean below them; what else is
to be checked is in its `__post_init__`. `read_campaign_file` reads and checks them, and
`fitting.measurements.schema` describes them to editors. No data file is opened, and what depends on
the FMU's variables (their units, whether they are there) is still as written. Tables of further
kinds of measurements are described where the kinds are (`fitting.campaign.kind`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, make_dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar

from fitting.campaign.instruments import LAYOUTS
from fitting.campaign.instruments.recording import Columns, Selection, SweepColumns
from fitting.campaign.kind import MeasurementTable
from fitting.campaign.measured import UNKNOWN
from fitting.campaign.parameters import ParameterTable
from fitting.campaign.recognised import other_kind
from fitting.fmu.accuracy import AccuracyNames, Reduction
from fitting.lines.names import ADDED, BACKGROUNDS
from fitting.signal.amplitudes import Amplitude, check_amplitude, declared_amplitude
from fitting.signal.combinations import Combination, lines_to_read
from fitting.signal.peaks import FLOOR_KINDS
from fitting.signal.prescribed import PrescribedWindow
from fitting.signal.scale import SCALES
from fitting.text.choices import CRITERIA, ESTIMATORS, INTERFACES, LIKELIHOOD, MISFITS
from fitting.text.errors import BadInput
from fitting.text.notation import how_many
from fitting.text.once import made_once
from fitting.text.schema import (
    Count,
    Counts,
    Factor,
    FileName,
    Frequencies,
    Keys,
    Missing,
    Number,
    OneOf,
    Positive,
    Positives,
    Quantity,
    Refused,
    Repeats,
    Rest,
    Share,
    Switch,
    Text,
    Texts,
    Times,
    Usually,
    Value,
    Values,
    Weight,
    WholeNumber,
    checked_by,
    listed,
    read_record,
    refusing,
)
from fitting.text.toml import read_toml
from fitting.text.units import Written, checked_accuracy

DRIFT_MODELS = ("linear", "offsets", "walk")
OUTLIERS = ("keep", "huber")
SAMPLES_PER_PERIOD = 200
#: Keys that state which part of a file is taken.
PART = ("trace", "chunk", "header_row")
#: T_trans, T and Δt of the paper, read as ms and µs.
AS_PUBLISHED = PrescribedWindow(settle=2e-3, length=30e-3, step=1e-6)
UNIT_LEVEL = Written(1.0, None, "[drive] level")


@dataclass(frozen=True, kw_only=True)
class WrittenFmu(Keys):
    """Which FMU: ``model`` of this project, built on demand, or ``file``; its start values."""

    model: Text | None = None
    """A model of this project, built on demand; either this or file."""
    file: FileName | None = None
    """An FMU (FMI 2.0 or 3.0)."""
    native: Switch = False
    """Whether the model is compiled from C, by cc or ziglang, if there is one: the same, faster."""
    interface: Annotated[Text | None, OneOf(INTERFACES)] = None
    """By which it is run; without it co-simulation if it offers that."""
    timeout_s: Positive = 60.0
    """Longest run, s; then the FMU has failed."""
    output_delay_steps: WholeNumber = 0
    """Communication steps by which outputs come late (see `fmu-fit check`); co-simulation only."""
    tolerance: Positive | None = None
    """Relative tolerance of the FMU's own solver; without it that of its DefaultExperiment."""
    start_time: Annotated[float | None, Quantity("s")] = None
    """Time of the FMU at which every run begins; without it that of its DefaultExperiment, or 0."""
    stop_time: Annotated[float | None, Quantity("s")] = None
    """Stop time that its set-up is given, or the end of a longer run; without it as declared."""
    start: Mapping[str, Value] = field(default_factory=dict)
    """Start values of the FMU."""
    taken: Texts = ()
    """Start values that were not measured; results state which values depend on them."""

    def __post_init__(self) -> None:
        if (self.model is None) == (self.file is None):
            raise Refused("wanted either 'model' or 'file'")
        if self.native and self.model is None:
            raise Refused("found true beside 'file', wanted a 'model', which is compiled", "native")
        for name in self.taken:
            if name not in self.start:
                raise Refused(f"'{name}' has no start value in [fmu.start], wanted one", "taken")


@dataclass(frozen=True, kw_only=True)
class WrittenObserve(Keys):
    """The observed FMU output, and what is known about its settling; ``line_width`` in Hz."""

    output: Text
    """The observed FMU output."""
    line_width: Annotated[float | None, Quantity("Hz")] = None
    """Rough FWHM, for the settling time; without it that of the sweep."""
    steady_start: Switch = False
    """The FMU starts on its periodic orbit, without settling."""


@dataclass(frozen=True, kw_only=True)
class WrittenDrive(Keys):
    """How the FMU is driven; ``level`` of an active tone, ``input`` for kind "input"."""

    kind: Annotated[Text, OneOf(("tones", "input"))]
    """"tones": of FMU parameters; "input": a generated signal."""
    frequencies: Texts
    """Columns of the experiments file; of kind "tones" also FMU parameters."""
    amplitudes: Texts | None = None
    """(tones) FMU parameters, one per frequency."""
    input: Text | None = None
    """(input) the driven FMU input."""
    level: Value = UNIT_LEVEL
    """Amplitude of every active tone, in the unit of its parameter or input."""
    samples_per_period: Annotated[Count | None, Usually(SAMPLES_PER_PERIOD)] = None
    """(input) held steps per period of the highest tone, at least 4."""
    read: Texts | None = None
    """Lines whose peaks are compared, as "2*u1 - u2"; without it the tones."""
    order: Count | None = None
    """Order of tone combinations that sampling separates from the lines; without it 1, or 9 if read
    has a combination."""

    def __post_init__(self) -> None:
        own = "amplitudes" if self.kind == "tones" else "input"
        others = ("input", "samples_per_period") if self.kind == "tones" else ("amplitudes",)
        self.refuse(f'has no meaning with kind = "{self.kind}"', *others)
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
            _ = self.lines_and_order

    @property
    def lines_and_order(self) -> tuple[tuple[Combination, ...], int]:
        """Lines whose peaks are compared, and the highest order that the response may hold."""
        read = self.frequencies if self.read is None else self.read
        return lines_to_read(read, self.order, self.frequencies, "")

    @property
    def lines(self) -> tuple[Combination, ...]:
        """The lines whose peaks are compared."""
        return self.lines_and_order[0]


@dataclass(frozen=True, kw_only=True)
class LayoutKeys(Keys):
    """How an instrument writes a file, and which part of it is taken."""

    layout: Annotated[Text | None, OneOf(LAYOUTS)] = None
    """Format of the instrument; without it recognised."""
    trace: Annotated[Count | None, Usually(1)] = None
    """(rohde-schwarz, keysight) trace or block of the file, from 1."""
    chunk: WholeNumber | None = None
    """(zurich) sweep of the file; without it the only one."""
    header_row: Count | None = None
    """(csv) row of the columns' names, from 1; without it the last above the numbers."""

    def selection(self, columns: Columns) -> Selection:
        """What is taken of the file.

        Args:
            columns: names of columns, where they are not the usual ones.
        """
        return Selection(
            **vars(columns),
            trace=self.trace or 1,
            chunk=self.chunk,
            header_row=self.header_row,
        )

    def check_layout(self) -> None:
        """Refuse a key that has no meaning with the layout that is stated.

        Raises:
            Refused: names the key, and the layouts with which it has a meaning.
        """
        for key in PART if self.layout is not None else ():
            known = [f'"{name}"' for name, layout in LAYOUTS.items() if key in layout.keys]
            if f'"{self.layout}"' not in known:
                wanted = " or ".join(known)
                self.refuse(
                    f'has no meaning with layout = "{self.layout}", only with layout = {wanted}',
                    key,
                )


@dataclass(frozen=True, kw_only=True)
class WrittenTrace(LayoutKeys):
    """Keys that [experiments] and [sweep] share: what the files mean, and which layout they have.

    ``impedance`` in ohm.
    """

    amplitude: Annotated[
        Text,
        checked_by(partial(check_amplitude, where="")),
        Missing('wanted "V peak", "V rms" or "dBm"; files do not state which they mean'),
    ]
    """Unit of the file's amplitudes: "V peak", "V rms", "dBm", or another as "m peak"."""
    impedance: Annotated[float | None, Quantity("ohm")] = None
    """Required with dBm, and only there."""
    columns: Columns = field(default_factory=Columns)
    """Columns of other than the usual names, with unit as "X1 (mV)" if the file states none."""

    def __post_init__(self) -> None:
        with refusing("amplitude"):
            _ = self.detector
        self.check_layout()

    @property
    def detector(self) -> Amplitude:
        """What the amplitudes mean."""
        return declared_amplitude(self.amplitude, self.impedance, "")


@dataclass(frozen=True, kw_only=True)
class WrittenExperiments(WrittenTrace):
    """The experiments file, with a pattern of ``spectra`` or columns of ready ``peaks``."""

    file: Annotated[FileName, Frequencies]
    """Table: experiment (label), a column with unit per drive frequency, and columns that set FMU
    variables, as mass (g)."""
    spectra: Text | None = None
    """A spectrum per experiment, as "spectra/{experiment}.csv"."""
    peaks: Texts = ()
    """Or columns of peak amplitudes, one per line read, unit in the header."""
    peak_sigmas: Texts = ()
    """Columns of their standard deviations, rms or peak like them."""
    noise_floor: Annotated[Text, OneOf(FLOOR_KINDS)] = "robust"
    """Corrected peak z: "robust": sqrt(z^2 - sigma^2), sigma from the median; "mean": z - mean;
    "none"."""
    phases: Texts = ()
    """Columns of phases of 'peaks', one per line read, deg or rad in the header; peak_sigmas are
    then of each quadrature."""
    x: Texts = ()
    """Or columns of X, the real part, one per line read, unit in the header."""
    y: Texts = ()
    """Columns of Y, the imaginary part."""
    unknown: Annotated[Text | None, OneOf(UNKNOWN), Usually("phase")] = None
    """(phases) solved for: one reference "phase" or complex "gain"; "none": phases are those of the
    drive."""
    restarted: Texts = ()
    """(phases) labels of experiments before which the instrument was restarted, with a new
    reference phase."""
    conjugate: Switch = False
    """(phases) they are counted as exp(-i 2 pi u t)."""

    def __post_init__(self) -> None:
        if bool(self.x) != bool(self.y):
            raise Refused(
                f"wanted together with '{'x' if self.x else 'y'}'", "y" if self.x else "x"
            )
        if (self.spectra is not None) + bool(self.peaks) + bool(self.x) != 1:
            raise Refused("wanted either 'spectra' or 'peaks', or 'x' and 'y'")
        self._check_phases()
        if self.spectra is not None and "{experiment}" not in self.spectra:
            raise Refused(f"'{self.spectra}' wanted with '{{experiment}}' in it", "spectra")
        if self.spectra is None:
            self.refuse("has no meaning with ready peaks", *PART)
        else:
            self.refuse("wanted only together with 'peaks'", "peak_sigmas")
        super().__post_init__()
        if self.x and self.detector.kind in ("dBm", "dB"):
            raise Refused(
                f"{self.detector.kind} is a magnitude, X and Y are parts of one; wanted "
                '"V peak" or "V rms", or peaks and phases',
                "amplitude",
            )
        if self.peak_sigmas and self.detector.kind in ("dBm", "dB"):
            raise Refused(
                f"a standard deviation in {self.detector.kind} is a ratio, not an "
                'amplitude; wanted peaks and sigmas in "V peak" or "V rms"',
                "peak_sigmas",
            )

    def _check_phases(self) -> None:
        for name in self.data_columns:
            if self.data_columns.count(name) > 1:
                key = "phases" if self.phases else "y" if self.x else "peak_sigmas"
                raise Refused(f"'{name}' is named twice, wanted a column for each", key)
        if not self.peaks:
            self.refuse("wanted only together with 'peaks'", "phases")
        if self.phases and len(self.phases) != len(self.peaks):
            raise Refused(
                f"{how_many(len(self.phases), 'column')}, wanted {len(self.peaks)}", "phases"
            )
        if len(self.x) != len(self.y):
            raise Refused(f"{how_many(len(self.y), 'column')}, wanted {len(self.x)}", "y")
        if not self.is_complex:
            sentence = "has a meaning together with 'phases', or 'x' and 'y', only"
            self.refuse(sentence, "unknown", "restarted", "conjugate")
        if self.restarted and self.unknown == "none":
            raise Refused('has no meaning with unknown = "none"', "restarted")

    @property
    def is_complex(self) -> bool:
        """Whether peaks have phases."""
        return bool(self.phases or self.x)

    @property
    def data_columns(self) -> tuple[str, ...]:
        """Columns that hold what was measured."""
        return (*self.peaks, *self.phases, *self.x, *self.y, *self.peak_sigmas)


@dataclass(frozen=True, kw_only=True)
class WrittenSweep(WrittenTrace):
    """The FRF sweep: its file, the FMU variables during it, what it serves."""

    elsewhere: ClassVar[Mapping[str, str]] = {
        "sigma": "; the standard deviation of its amplitudes is that of all: [noise] absolute or "
        "relative, or columns = { sigma = ... } of their standard errors (without them the points' "
        "scatter); set_sigma is of values in set"
    }

    file: FileName
    """The measured FRF, at least 8 points."""
    columns: SweepColumns = field(default_factory=SweepColumns)
    """Columns of other than the usual names, with unit as "X1 (mV)" if the file states none; and
    that of standard errors, sigma."""
    set: Mapping[str, Value] = field(default_factory=dict)
    """FMU variables during the sweep."""
    set_sigma: Mapping[str, Value] = field(default_factory=dict)
    """(use = "fit") Standard deviations of values in set: an offset of each is fitted, as of
    variables in [drift]."""
    use: Annotated[Text, OneOf(("scale", "fit"))] = "scale"
    """"scale": for the scale only; "fit": each point is a residual row, too."""
    scale: Annotated[Text, OneOf(SCALES)] = "maximum"
    """From simulated to measured amplitudes: ratio of maxima, the simulated one between points
    ("maximum") or the largest point ("grid"), least squares ("fit"), Huber's estimate ("robust"),
    fitted ln_scale ("free"), 1 ("none")."""
    background: Annotated[Text, OneOf(BACKGROUNDS)] = "none"
    """Of the line fit: "none" or a "complex" constant; with use = "fit" also of the FMU: "offset"
    of amplitudes, or "slope", linear in frequency."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.set_sigma and self.use != "fit":
            raise Refused('has a meaning with use = "fit" only', "set_sigma")
        for trouble in offset_trouble(self.background, self.use, self.scale):
            raise Refused(trouble, "background")


def offset_trouble(background: str, use: str, scale: str) -> tuple[str, ...]:
    """What a constant next to the amplitudes of a sweep wants and lacks, in words; mostly nothing.

    Args:
        background: of the sweep.
        use: of the sweep.
        scale: of the sweep.
    """
    if background not in ADDED:
        return ()
    if use != "fit":
        return (f'"{background}" has a meaning with use = "fit" only',)
    if scale in ("maximum", "grid", "robust"):
        return (f'"{background}" is solved with scale = "fit", "free" or "none", found "{scale}"',)
    return ()


@dataclass(frozen=True, kw_only=True)
class DriftEnds(Keys):
    """Values of a drifting variable before and after the series."""

    before: Value
    """Value before the series."""
    after: Value
    """Value after the series."""


@dataclass(frozen=True, kw_only=True)
class WrittenDrift(Keys):
    """How variables move over the experiments, ``ends`` by variable.

    ``model`` "linear": interpolated between the ends; "offsets": and one fitted offset per
    experiment, ``prior`` its standard deviation; "walk": and a random walk, ``prior`` the standard
    deviation of a step. ``time`` names the column of time stamps.
    """

    ends: Mapping[str, DriftEnds] = field(default_factory=dict)
    """Values before and after the series."""
    model: Annotated[Text, OneOf(DRIFT_MODELS)] = "linear"
    """"linear" between before and after; "offsets" per experiment or a random "walk" are fitted in
    addition."""
    prior: Value | None = None
    """Standard deviation of an offset, or of a step of the walk."""
    share: Annotated[Switch | None, Usually(True)] = None
    """One offset for all drifting variables; without it one in an experiment, one each in a fitted
    sweep."""
    time: Text = ""
    """Column of times (numbers with a unit, or ISO dates); without it evenly spaced."""
    before_time: Value | None = None
    """Time of the values before; without it the first experiment's."""
    after_time: Value | None = None
    """Time of the values after; without it the last experiment's."""

    def __post_init__(self) -> None:
        alone = (self.prior, self.share, self.before_time, self.after_time)
        stated = self.model != "linear" or self.time or any(value is not None for value in alone)
        if stated and not self.ends:
            raise Refused(
                "names no variable; wanted at least one that drifts, as in "
                'eta = { before = "6.94021 MHz", after = "6.94031 MHz" }'
            )
        if self.model == "linear":
            self.refuse('has no meaning with model = "linear"', "prior", "share")
        elif self.prior is None:
            what = "of an offset" if self.model == "offsets" else "of a step of the walk"
            raise Refused(
                f'is missing; model = "{self.model}" wants the standard deviation {what}, as in '
                'prior = "30 Hz"',
                "prior",
            )
        if not self.time:
            self.refuse("wanted only together with time = a column", "before_time", "after_time")


@dataclass(frozen=True, kw_only=True)
class WrittenNoise(Keys):
    """Declared noise: ``relative`` (a share of the amplitude) and ``absolute``.

    Both are standard deviations and add in quadrature to the scatter of the data.
    """

    relative: Share = 0.0
    """Standard deviation of every amplitude over it, next to the floor's."""
    absolute: Value | None = None
    """Standard deviation of every amplitude, as "0.1 uV"."""
    outliers: Annotated[Text, OneOf(OUTLIERS)] = "keep"
    """"huber": residuals beyond 1.345 standard deviations count linearly."""
    threshold: Positive = 4.0
    """Studentised residual from which a peak is named in a warning."""


@dataclass(frozen=True, kw_only=True)
class WrittenAssumption(Keys):
    """What the campaign fixes although it might be otherwise: by how much values would shift then.

    Either ``quantity`` with ``value`` or ``law``, or ``start``.
    """

    that: Text
    """The assumption, as "the pump does not modulate lambda^2"."""
    otherwise: Text
    """The alternative in words, as "a modulation of f2^2 by 5 % of that of f1^2"."""
    quantity: Text | None = None
    """A constant of the laws, or a variable of the FMU that is not fitted."""
    value: Value | None = None
    """What the quantity might be instead."""
    law: Text | None = None
    """The formula that it might follow instead; a variable with a law represents it."""
    start: Mapping[str, Text] = field(default_factory=dict)
    """Formula of fitted values by parameter, from which the fit is repeated without bounds."""

    def __post_init__(self) -> None:
        if self.quantity is None and not self.start:
            raise Refused("wanted a 'quantity' with its 'value' or 'law', or 'start'")
        if self.quantity is not None and self.start:
            raise Refused("is given together with 'quantity'; wanted one of them", "start")
        if (self.value is not None) + (self.law is not None) != (self.quantity is not None):
            raise Refused("wanted either 'value' or 'law' together with 'quantity'")


@dataclass(frozen=True, kw_only=True)
class WrittenDerived(Keys):
    """What else is reported of every experiment."""

    outputs: Texts = ()
    """FMU outputs read after initialisation, per experiment."""


@dataclass(frozen=True, kw_only=True)
class Schedule(Keys):
    """Weights ν_l = nu_start beta^l of Algorithm 2, its tolerance, starts and seed."""

    nu_start: Weight = 0.1
    """First ν, zero or more."""
    beta: Factor = 0.1
    """Factor from one ν to the next, below 1."""
    tolerance: Positive = 2.22e-16
    """Stop when ||x_(l+1) - x_l|| + |J_fit - J_reg| falls to it."""
    starts: Repeats = 3
    """Different minima to find, from the campaign's start and the lowest points of a search within
    the bounds. 1: no search."""
    seed: WholeNumber = 1
    """Of the search."""
    iterations: Repeats = 9
    """Number of ν."""

    def nu(self, level: int) -> float:
        """Regularisation of one level.

        Args:
            level: of ν, from 0.
        """
        return self.nu_start * self.beta**level


@dataclass(frozen=True, kw_only=True)
class ContinuationSettings(Schedule):
    """Algorithm 2: its weights ν, tolerance, misfit and starts; whose estimate is reported."""

    misfit: Annotated[Text, OneOf(MISFITS)] | None = None
    """"slack": |r| with slack variables; "absolute": |r|; "squares": r^2. Without it "squares" with
    a trace, else "slack"."""
    estimator: Annotated[Text, OneOf(ESTIMATORS)] = LIKELIHOOD
    """Of the reported value: "likelihood", or "algorithm2" at the last nu; errors are the
    likelihood's."""


@dataclass(frozen=True, kw_only=True)
class WrittenAccuracy(AccuracyNames):
    """How accurate amplitudes must be, and what may be left out for it.

    `fitting.fmu.accuracy.AccuracyAnnotation` states what the names mean.
    """

    amplitude: Positive | None = None
    """Relative accuracy of simulated amplitudes, below 1; without it a tenth of the data's noise,
    or the FMU's best."""
    full: Mapping[str, Value] = field(default_factory=dict)
    """Start values of the model with nothing left out."""
    reductions: Annotated[
        tuple[Reduction[Value], ...], listed("[[accuracy.reductions]] tables", least=0)
    ] = ()
    """Ways to leave something out, which a plan may take."""
    window: PrescribedWindow | None = None
    """Samples of the experiments from rest on, read by a Fourier transform at the lines. Without it
    planned."""
    as_published: Switch = False
    """As the paper ran: window = { settle = "2 ms", length = "30 ms", step = "1 us" } and [sweep]
    scale = "grid"."""

    def __post_init__(self) -> None:
        with refusing("amplitude"):
            if self.amplitude is not None:
                checked_accuracy(self.amplitude, "")
        if self.as_published:
            self.refuse("has no meaning with as_published = true, which sets it", "window")

    @property
    def prescribed(self) -> PrescribedWindow | None:
        """The window that is prescribed; None: it is planned."""
        return AS_PUBLISHED if self.as_published else self.window


@dataclass(frozen=True, kw_only=True)
class WrittenSweeps(Keys):
    """Whole sweeps over a control as next measurements, each at values of its controls."""

    controls: Annotated[
        Mapping[str, Values], Missing('wanted values to try, as controls = { "V" = [0, "1 V"] }')
    ]
    """Values of the controls to try; of others that of the last spectrum."""
    span: Annotated[float | None, Quantity("Hz")] = None
    """From first to last frequency; without it the campaign's."""
    points: Repeats | None = None
    """Frequencies of a sweep; without it the campaign's most."""


@dataclass(frozen=True, kw_only=True)
class WrittenTraces(Keys):
    """Recordings over time as next measurements, begun or driven as traces of the campaign."""

    of: Texts | None = None
    """Traces whose start or drive is repeated; without it all."""
    lengths: Times | None = None
    """From first to last sample; without it 1/4, 1/2, 1 and 2 times the longest trace."""
    spacings: Times | None = None
    """Spacings of the samples; without it that of each trace."""
    samples: Count | None = None
    """Most samples; without it twice those of the longest trace."""


@dataclass(frozen=True, kw_only=True)
class WrittenDesign(Keys):
    """Limits of the instrument for the next measurements; frequencies in Hz.

    What is not written is taken from the campaign itself (`fitting.design.limits`).
    """

    outputs: Texts | None = None
    """Observable outputs; without it those of like names and one unit."""
    centres: Frequencies | None = None
    """Resonances; without it the sweep's maximum, drifting frequencies."""
    frequency_step: Annotated[float | None, Quantity("Hz")] = None
    """Grid of the drive."""
    least_spacing: Annotated[float | None, Quantity("Hz")] = None
    """Least distance of two tones."""
    farthest: Annotated[float | None, Quantity("Hz")] = None
    """Largest detuning of a tone."""
    both_sides: Switch = True
    """Tones on both sides of the resonance."""
    tones: Repeats | None = None
    """Tones at once; 1: single tones, as in a sweep."""
    levels: Positives | None = None
    """Drive levels to try, in units of the campaign's level."""
    repeats: Positives | None = None
    """Numbers of spectra averaged with their phases to try."""
    noise_floor: Value | None = None
    """Of a peak in one spectrum, a point, a sample, or each quadrature, as "0.18 uV"; without it
    the campaign's."""
    relative_noise: Annotated[Number | None, Usually(0.01)] = None
    """Noise of a peak as a share of it, which averaging does not lower."""
    phases: Switch | None = None
    """Whether phases are measured, against an unknown reference; without it as in the campaign."""
    largest: Value | None = None
    """Largest amplitude of the detector; without it twice the largest measured."""
    number: Annotated[Repeats | None, Usually(6)] = None
    """Most measurements; with a time and without it 50."""
    time: Annotated[float | None, Quantity("s")] = None
    """For all next measurements together."""
    spectrum_time: Annotated[float | None, Quantity("s"), Usually(1.0)] = None
    """Of a spectrum, times the number of averaged ones."""
    point_time: Annotated[float | None, Quantity("s"), Usually(1.0)] = None
    """Of a point of a sweep."""
    change_time: Annotated[float | None, Quantity("s"), Usually(0.0)] = None
    """Of a change to another measurement, with settling."""
    target: Text = ""
    """The value to determine better."""
    criterion: Annotated[Text | None, OneOf(CRITERIA), Usually("target")] = None
    """Error of the target, or D or A of all parameters."""
    settings: Mapping[str, Values] = field(default_factory=dict)
    """Values of further FMU parameters to try."""
    setting_sigma: Mapping[str, Value] = field(default_factory=dict)
    """Errors of quantities that drift."""
    averaged: Counts | None = None
    """Spectra averaged in each row of a campaign that a design made."""
    sweeps: WrittenSweeps | None = None
    """Propose whole sweeps of the campaign's [control_sweep], else of its [complex_control_sweep],
    in place of tones."""
    traces: WrittenTraces | None = None
    """Propose recordings over time, like the campaign's [[trace]], else its [[demodulated_trace]],
    in place of tones."""

    def __post_init__(self) -> None:
        if self.sweeps is not None and self.traces is not None:
            raise Refused("is given together with 'sweeps'; wanted one of them", "traces")


@dataclass(frozen=True, kw_only=True)
class CampaignHead(Keys):
    """What a campaign states that holds for it in a file and next to its FMU alike."""

    title: Text
    """Heading of the report."""
    synthetic: Switch = False
    """Marks every figure and page "synthetic"."""
    continuation: ContinuationSettings | None = None
    """The sequence of fits with less and less regularisation (Algorithm 2), and the search."""


@dataclass(frozen=True, kw_only=True)
class WrittenCampaign(CampaignHead):
    """Everything the campaign file states; data files are named here, not read."""

    fmu: WrittenFmu
    """The FMU and its start values."""
    observe: WrittenObserve
    """The observed output."""
    drive: WrittenDrive | None = None
    """How the FMU is driven; wanted but for traces, which have inputs of their own."""
    experiments: WrittenExperiments | None = None
    """Measurements under a few tones."""
    drift: Annotated[WrittenDrift, Rest("ends")] = WrittenDrift()
    """Variables that move over the experiments."""
    noise: WrittenNoise = WrittenNoise()
    """Declared noise of the amplitudes."""
    sweep: WrittenSweep | None = None
    """A measured frequency response."""
    parameters: Annotated[
        tuple[ParameterTable[Value], ...], listed("one [[parameters]] table or more")
    ]
    """The FMU parameters that are fitted."""
    laws: Mapping[str, Text] = field(default_factory=dict)
    """FMU variable: the formula that it follows, of parameters, constants and control quantities
    (columns and settings that are no variable of the FMU), as f1 = "a0 + a1*V"."""
    constants: Mapping[str, Value] = field(default_factory=dict)
    """Numbers that laws name, with their units."""
    assumptions: Annotated[
        tuple[WrittenAssumption, ...], listed("[[assumptions]] tables", least=0)
    ] = ()
    """What the campaign fixes although it might be otherwise."""
    derived: WrittenDerived = WrittenDerived()
    """What else is reported."""
    alternatives: Mapping[str, Values] = field(default_factory=dict)
    """Variable: values to try, in all combinations; the best one is reported."""
    accuracy: WrittenAccuracy = WrittenAccuracy()
    """How accurately the FMU is to be simulated."""
    design: WrittenDesign = WrittenDesign()
    """The instrument's limits, for the next measurements."""

    def __post_init__(self) -> None:
        experiments, observe = self.experiments, self.observe
        swept = self.sweep is not None and self.sweep.use == "fit"
        if experiments is None and not swept and not self.further:
            raise Refused(
                'nothing to fit: wanted a table [experiments], or a [sweep] with use = "fit"'
            )
        settles = experiments is not None or self.sweep is not None
        settles |= any(not t.TRANSIENT for tables in self.further.values() for t in tables)
        if settles and self.drive is None:
            raise Refused("key 'drive' is missing")
        is_known = observe.steady_start or observe.line_width is not None or self.sweep is not None
        if settles and not is_known:
            raise Refused(
                "wanted line_width (a rough one sets the settling time), or steady_start = true if "
                "the FMU starts on its periodic orbit, or a [sweep]",
                "observe",
            )
        if self.drift.ends and experiments is None:
            raise Refused("drifts over experiments, but there are none", "drift")
        noise = self.noise
        stated = noise.relative or noise.absolute is not None or noise.outliers != OUTLIERS[0]
        if experiments is None and self.sweep is None and stated:
            raise Refused(
                "is of the amplitudes of [experiments] and [sweep], and there is neither; wanted "
                "'sigma' in the tables of further measurements, 'averages' of a noise spectrum",
                "noise",
            )
        self._check_window()
        lines = 0 if self.drive is None else len(self.drive.lines)
        keys = ("peaks", "peak_sigmas", "phases", "x", "y")
        for key in keys if experiments is not None else ():
            columns = getattr(experiments, key)
            if columns and len(columns) != lines:
                raise Refused(
                    f"{how_many(len(columns), 'column')}, wanted {lines}, one per tone",
                    "experiments",
                    key,
                )

    def _check_window(self) -> None:
        """Refuse a prescribed window with what it does not go together with."""
        if self.accuracy.prescribed is None:
            return
        key = "as_published" if self.accuracy.as_published else "window"
        experiments = self.experiments
        if experiments is None or experiments.is_complex or self.driven.kind != "tones":
            raise Refused(
                'is of amplitudes in [experiments] under [drive] kind = "tones"', "accuracy", key
            )
        if self.observe.steady_start:
            raise Refused("begins at rest; wanted no steady_start in [observe]", "accuracy", key)

    @property
    def driven(self) -> WrittenDrive:
        """How tones drive the FMU.

        Raises:
            BadInput: the campaign holds traces alone, and nothing of tones.
        """
        if self.drive is None:
            raise BadInput("the campaign has no [drive], wanted one: what is asked rests on tones")
        return self.drive

    @property
    def further(self) -> Mapping[str, tuple[MeasurementTable, ...]]:
        """Tables of further kinds of measurements, by their names."""
        result: dict[str, tuple[MeasurementTable, ...]] = {}
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            tables = value if isinstance(value, tuple) else (value,)
            if tables and all(isinstance(table, MeasurementTable) for table in tables):
                result[name] = tables
        return result


@made_once
def campaign_with(kinds: tuple[type[MeasurementTable], ...]) -> type[WrittenCampaign]:
    """The record of campaign files that may also have the tables of these kinds, each once.

    Args:
        kinds: of measurements.

    Raises:
        ValueError: two kinds with one table, or one with a table of every campaign.
    """
    if not kinds:
        return WrittenCampaign
    names = [*WrittenCampaign.__dataclass_fields__, *(kind.TABLE for kind in kinds)]
    if len(set(names)) < len(names):
        raise ValueError(f"tables {', '.join(names)}: one of them twice")
    own: list[tuple[str, Any, Any]] = []
    for kind in kinds:
        if kind.REPEATED:
            words = f"one [[{kind.TABLE}]] table or more"
            tables = Annotated[tuple[kind, ...], listed(words)]  # type: ignore[valid-type]
            own.append((kind.TABLE, tables, field(default=())))
        else:
            own.append((kind.TABLE, kind | None, field(default=None)))

    def reduce(campaign: WrittenCampaign) -> tuple[Any, ...]:
        """For a pickle, in which no class can be that has no name in a module."""
        return _unpickled, (kinds, dict(campaign.__dict__))

    return make_dataclass(
        "WrittenCampaign",
        own,
        bases=(WrittenCampaign,),
        namespace={"__reduce__": reduce},
        frozen=True,
        kw_only=True,
    )


def _unpickled(
    kinds: tuple[type[MeasurementTable], ...], fields: dict[str, Any]
) -> WrittenCampaign:
    made = object.__new__(campaign_with(kinds))
    made.__dict__.update(fields)
    return made


def read_campaign_file(path: Path, kinds: Sequence[type[MeasurementTable]] = ()) -> WrittenCampaign:
    """Read and check the TOML of a campaign.

    Args:
        path: of the file.
        kinds: of measurements that it may contain, next to experiments and a sweep.

    Raises:
        BadInput: no such file, or not TOML, then with what it is instead; or a key that is missing,
            unknown or of the wrong kind: one line for each.
    """
    try:
        tables = read_toml(path)
    except BadInput as error:
        raise other_kind(path) or error from None
    return read_record(campaign_with(tuple(kinds)), tables, path)
