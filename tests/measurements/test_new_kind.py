"""A kind of measurement that the package does not have: table, data, model and figure, all here.

A lock-in amplifier gives both quadratures of one driven mode: complex values, two rows for each.
What nothing in the package knows of it stands in the first half of this file, which is what adding
a kind takes; the second half fits it from a campaign.toml and from arrays.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import jsonschema
import numpy as np
import pytest
from lxml import html
from matplotlib.figure import Figure as Canvas

import fitting as ff
from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.instruments.recording import unit_of
from fitting.campaign.kind import MeasurementTable
from fitting.fmu.description import READABLE
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.measurements.measurement import Measurement, Predicting, Prediction, Values
from fitting.measurements.schema import campaign_schema
from fitting.signal.window import Window
from fitting.simulate.batch import Batch
from fitting.text.arrays import ComplexArray, FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.schema import FileName, Quantity, Refused, Text, Texts
from fitting.text.tables import Table, read_table
from fitting.text.toml import read_toml
from fitting.text.units import convert
from tests.support.one_mode import SETUP

# --- the kind -------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class LockInTable(MeasurementTable):
    """Both quadratures of a lock-in amplifier over drive frequency."""

    TABLE: ClassVar[str] = "lock_in"

    file: FileName
    """Columns frequency, X and Y, each with its unit."""
    outputs: Texts
    """The FMU's outputs that are compared with X and Y."""
    tone: Text
    """The FMU's parameter that is the drive frequency."""
    sigma: Annotated[float, Quantity("V")]
    """Standard deviation of each quadrature."""

    def __post_init__(self) -> None:
        if len(self.outputs) != 2:
            raise Refused(f"{len(self.outputs)} names, wanted two, for X and Y", "outputs")

    def read(self) -> ReadLockIn:
        """The file, in Hz and V."""
        table = read_table(self.file)
        f, x, y = (
            self._numbers(table, name, unit)
            for name, unit in (("frequency", "Hz"), ("X", "V"), ("Y", "V"))
        )
        return ReadLockIn(self, f, x + 1j * y)

    def _numbers(self, table: Table, name: str, unit: str) -> FloatArray:
        column = table.column(name)
        own, where = unit_of(table, column, f"{name} ({unit})"), f"{self.file}: column '{name}'"
        return np.array([convert(v, own, unit, where=where) for v in table.numbers(column)])


@dataclass(frozen=True)
class ReadLockIn:
    """Complex amplitudes (n,) V at frequencies (n,) Hz, as `table` tells of them."""

    table: LockInTable
    frequency_hz: FloatArray
    amplitude_v: ComplexArray

    @property
    def files(self) -> tuple[Path, ...]:
        return (self.table.file,)

    def bind(self, binder: Binder, setup: Setup) -> LockIn:
        where = f"{self.table.file.parent}: [lock_in]"
        for output in self.table.outputs:
            binder.real(output, f"{where} outputs", READABLE, "observed")
        unit = binder.real(self.table.tone, f"{where} tone", ("parameter",), "set").unit or "Hz"
        return LockIn(
            setup=setup,
            frequency_hz=self.frequency_hz,
            amplitude_v=self.amplitude_v,
            sigma_v=self.table.sigma,
            outputs=self.table.outputs,
            tone=self.table.tone,
            per_hz=convert(1.0, "Hz", unit, where=where),
        )


@dataclass(frozen=True, kw_only=True)
class LockIn(Measurement):
    """Complex amplitudes (n,) at drive frequencies (n,), Hz, each quadrature with noise `sigma_v`.

    Rows are real and imaginary parts of (simulated - measured), over the largest modulus.
    `outputs` are those of both quadratures, `tone` the parameter that is the drive frequency,
    `per_hz` its unit over Hz.
    """

    setup: Setup
    frequency_hz: FloatArray
    amplitude_v: ComplexArray
    sigma_v: float
    outputs: tuple[str, ...]
    tone: str
    per_hz: float = 1.0
    series: str = ""

    @property
    def rows(self) -> int:
        return 2 * self.frequency_hz.size

    @property
    def sigma(self) -> FloatArray:
        return np.full(self.rows, self.sigma_v / self._largest)

    @property
    def _largest(self) -> float:
        return float(np.max(np.abs(self.amplitude_v)))

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        return tuple(("", {self.tone: self.per_hz * float(u)}) for u in self.frequency_hz)

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        window = Window(tones_hz=(), settle_s=model.plan.settle_s, step_s=1e-3, samples=1)
        asked = [
            [
                batch.ask(model.values(p, label, settings), window, None, quadrature, k)
                for label, settings in self.places
                for quadrature in self.outputs
            ]
            for k, p in enumerate(table)
        ]
        yield
        return [
            Prediction(
                np.array([batch.samples(run, self.outputs[0])[-1] for run in runs[0::2]])
                + 1j * np.array([batch.samples(run, self.outputs[1])[-1] for run in runs[1::2]])
            )
            for runs in asked
        ]

    def residuals(self, prediction: Prediction, chi: float) -> FloatArray:
        apart = (chi * prediction.values - self.amplitude_v) / self._largest
        return np.concatenate([apart.real, apart.imag])

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """A panel for each quadrature, and one for what is left in standard deviations."""
        x = Axis("drive frequency", "Hz")
        f = self.frequency_hz
        panels = [
            Panel(
                x=x,
                y=Axis(f"quadrature {name}", "V"),
                layers=(
                    Layer(
                        Role.MEASURED,
                        Form.POINTS,
                        f,
                        part(self.amplitude_v),
                        label="lock-in",
                        sigma=np.full(f.size, self.sigma_v),
                    ),
                    Layer(Role.START, Form.CURVE, f, part(before), label="model, start"),
                    Layer(Role.SIMULATED, Form.CURVE, f, part(after), label="model, fitted"),
                ),
            )
            for name, part in (("X", np.real), ("Y", np.imag))
        ]
        left = (after - self.amplitude_v) / self.sigma_v
        rest = Panel(
            x=x,
            y=Axis("residual", "σ"),
            layers=(
                Layer(Role.SIMULATED, Form.POINTS, f, left.real, label="X"),
                Layer(Role.OTHER, Form.POINTS, f, left.imag, label="Y"),
            ),
            level=0.0,
            height=0.5,
        )
        figure = Figure(
            name="lock_in",
            title="Quadratures, measured and simulated",
            caption=f"Both quadratures at {f.size} frequencies, and what the fit leaves of them.",
            alt=f"Two quadratures at {f.size} frequencies with the fitted model.",
            rows=((panels[0],), (panels[1],), (rest,)),
            series=self.series,
        )
        return (figure,)


# --- a measurement of it with known truth ---------------------------------------------------

QUADRATURES = ("q1_hybrid_X_u1", "q1_hybrid_Y_u1")
#: Truth of the synthetic measurement: eigenfrequency and width of the only mode that is seen.
ETA_HZ, WIDTH_HZ = 1000.0, 12.5
SEEN_HZ = ETA_HZ + np.linspace(-20.0, 20.0, 7)
CAMPAIGN = """
title = "One mode, seen by a lock-in"
synthetic = true

[fmu]
file = "{fmu}"
start = {{ periodic_start = true, theta = 0.0, d2 = "10 Hz", eta_minus = "2 kHz", u2 = "1.5 kHz" }}

[observe]
output = "q1_hybrid"
steady_start = true

[drive]
kind = "tones"
frequencies = ["u1", "u2"]
amplitudes = ["A1", "A2"]

[lock_in]
file = "lock_in.csv"
outputs = ["q1_hybrid_X_u1", "q1_hybrid_Y_u1"]
tone = "u1"
sigma = "{sigma!r} V"

[[parameters]]
name = "d1"
lower = "1 Hz"
upper = "100 Hz"
start = "30 Hz"
scale = "10 Hz"

[[parameters]]
name = "eta_plus"
lower = "0.98 kHz"
upper = "1.02 kHz"
start = "1.004 kHz"
scale = "5 Hz"

[derived]
outputs = ["width_plus", "Q_plus"]

[continuation]
starts = 1
"""


def closed_form(u_hz: FloatArray) -> ComplexArray:
    """X(u) of q'' + 2 pi w q' + (2 pi eta)^2 q = cos 2 pi u t, the phasor of exp(i 2 pi u t)."""
    return np.asarray(
        1.0
        / (
            (2 * np.pi) ** 2 * (ETA_HZ - u_hz) * (ETA_HZ + u_hz)
            + 1j * (2 * np.pi) ** 2 * u_hz * WIDTH_HZ
        )
    )


def errors(noise: float) -> FloatArray:
    """Standard deviations of d1 and eta_plus, from the closed form's derivatives."""
    u, x = SEEN_HZ, closed_form(SEEN_HZ)
    slopes = [-(x**2) * 1j * (2 * np.pi) ** 2 * u, -(x**2) * (2 * np.pi) ** 2 * 2 * ETA_HZ]
    matrix = np.stack([np.concatenate([s.real, s.imag]) for s in slopes], axis=1)
    covariance = np.linalg.inv(matrix.T @ matrix) * (noise * np.max(np.abs(x))) ** 2
    return np.asarray(np.sqrt(np.diag(covariance)))


def measured(seed: int, noise: float) -> LockIn:
    """The closed form with noise, a share of its largest modulus, on each quadrature."""
    exact = closed_form(SEEN_HZ)
    sigma = noise * float(np.max(np.abs(exact)))
    scatter = np.random.default_rng(seed).standard_normal((2, SEEN_HZ.size))
    return LockIn(
        setup=SETUP,
        frequency_hz=SEEN_HZ,
        amplitude_v=exact + sigma * (scatter[0] + 1j * scatter[1]),
        sigma_v=sigma,
        outputs=QUADRATURES,
        tone="u1",
    )


def written(folder: Path, fmu: Path, lock_in: LockIn, campaign: str = CAMPAIGN) -> Path:
    """The measurement as files: kHz and uV, which the FMU does not have; the campaign's path."""
    lines = ["frequency (kHz),X (uV),Y (uV)"]
    for f, v in zip(lock_in.frequency_hz, lock_in.amplitude_v, strict=True):
        lines.append(",".join(repr(float(n)) for n in (1e-3 * f, 1e6 * v.real, 1e6 * v.imag)))
    (folder / "lock_in.csv").write_text("\n".join(lines))
    path = folder / "campaign.toml"
    path.write_text(campaign.format(fmu=fmu.as_posix(), sigma=lock_in.sigma_v))
    return path


def from_arrays(lock_in: LockIn, fmu: ff.Fmu) -> ff.Problem:
    """The problem that the campaign file tells of."""
    return ff.Problem(
        fmu,
        [
            ff.Parameter("d1", 30.0, bounds=(1.0, 100.0), scale=10.0),
            ff.Parameter("eta_plus", 1004.0, bounds=(980.0, 1020.0), scale=5.0),
        ],
        lock_in,
        derived=("width_plus", "Q_plus"),
    )


def test_without_noise_the_truth_comes_back(swift: ff.Fmu) -> None:
    fit = ff.fit(from_arrays(measured(1, 0.0), swift), starts=1)
    assert fit.success
    # the regularisation of the last level still pulls by about nu = 1e-9
    assert fit.x == pytest.approx([WIDTH_HZ, ETA_HZ], rel=1e-6)


# --- from a campaign file to the report -----------------------------------------------------

NOISE = 0.01


@pytest.fixture(scope="module")
def path(swift_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("lock_in"), swift_fmu, measured(5, NOISE))


@pytest.fixture(scope="module")
def fit(path: Path, swift: ff.Fmu) -> ff.Fit:
    return ff.fit(ff.Problem.of(ff.read_campaign(path, kinds=[LockInTable]), swift))


def test_a_campaign_file_that_tells_of_it_is_fitted(fit: ff.Fit) -> None:
    """Errors are those of the linear problem, worked out here from the closed form."""
    assert fit.success
    found = ff.profile(fit)
    assert found.inferred.knowledge is not None
    truth = (WIDTH_HZ, ETA_HZ)
    for name, std, true in zip(("d1", "eta_plus"), errors(NOISE), truth, strict=True):
        value = found[name]
        assert value.status == "determined"
        assert abs(value.value - true) < 4.0 * std
        low, high = value.interval()
        # residuals larger than the noise, by chance, widen the intervals
        widened = found.inferred.knowledge.inflation * std
        assert 0.5 * (high - low) / 1.96 == pytest.approx(widened, rel=0.02)
    assert found["width_plus"].value == pytest.approx(found["d1"].value)
    # the file and its hash are in the result
    assert set(fit.result.provenance.files) == {"campaign.toml", "lock_in.csv"}


def test_its_rows_are_those_of_the_closed_form(fit: ff.Fit, swift: ff.Fmu) -> None:
    """From the file and from arrays alike, whatever units the file has."""
    lock_in = measured(5, NOISE)
    apart = (closed_form(SEEN_HZ) - lock_in.amplitude_v) / np.max(np.abs(lock_in.amplitude_v))
    expected = np.concatenate([apart.real, apart.imag])
    arrays = from_arrays(lock_in, swift)
    for problem in (fit.problem, arrays):
        rows = problem.residuals([WIDTH_HZ, ETA_HZ])
        assert rows == pytest.approx(expected, abs=1e-9)
    # -2 ln L and its constant, from the definition
    white = expected * np.max(np.abs(lock_in.amplitude_v)) / lock_in.sigma_v
    sigma = lock_in.sigma_v / np.max(np.abs(lock_in.amplitude_v))
    logl = -0.5 * white @ white - white.size * np.log(sigma * np.sqrt(2.0 * np.pi))
    assert arrays.logl([WIDTH_HZ, ETA_HZ]) == pytest.approx(logl, abs=1e-4)


def test_its_figure_stands_in_the_report(fit: ff.Fit, tmp_path: Path) -> None:
    page = html.document_fromstring(ff.report(fit, tmp_path).read_text(encoding="utf-8"))
    pictures = {image.get("alt") for image in page.iter("img")}
    assert [alt for alt in pictures if alt and f"at {SEEN_HZ.size} frequencies" in alt]
    assert "fit leaves" in page.text_content()  # its caption
    drawn = (tmp_path / "figures" / "1_lock_in.svg").read_text(encoding="utf-8")
    for words in ("quadrature X", "quadrature Y", "SYNTHETIC DATA", "model, fitted"):
        assert words in drawn
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert abs(result["parameters"]["d1"]["value"] - WIDTH_HZ) < 4.0 * errors(NOISE)[0]


def test_its_figure_is_drawn_into_given_axes(fit: ff.Fit) -> None:
    lock_in = measured(5, NOISE)
    for number, part in enumerate((lock_in.amplitude_v.real, lock_in.amplitude_v.imag)):
        axes = Canvas().subplots()
        assert ff.plot.measurement(fit, "lock_in", number=number, ax=axes) is axes
        lines = {line.get_label(): line for line in axes.get_lines()}
        unit = axes.get_ylabel().partition("(")[2].rstrip(")")
        factor = {"nV": 1e-9, "µV": 1e-6}[unit]
        y = factor * np.asarray(lines["lock-in"].get_ydata(), dtype=float)
        assert y == pytest.approx(part)
        model = factor * np.asarray(lines["model, fitted"].get_ydata(), dtype=float)
        assert np.max(np.abs(model - part)) < 4.0 * lock_in.sigma_v
    for name, number, wanted in (("tones", 0, "lock_in"), ("lock_in", 3, "there are 3")):
        with pytest.raises(BadInput, match=wanted):
            ff.plot.measurement(fit, name, number=number)


@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        ("tone =", "tones =", r"\[lock_in\]: .*'tones'.*'tone'"),
        ('"q1_hybrid_X_u1", ', "", r"\[lock_in\] outputs: 1 names"),
        ("[lock_in]", "[lock_ins]", r"'lock_ins'.*'lock_in'"),
        ('tone = "u1"', 'tone = "lambda"', r"\[lock_in\] tone: .*'lambda'"),
        ('name = "d1"', 'name = "u1"', r"'u1'.* \[lock_in\]"),
        ("lock_in.csv", "lockin.csv", r"lockin\.csv: .*'lock_in\.csv'"),
    ],
)
def test_what_is_wrong_with_its_table_is_told_as_of_any_other(
    old: str, new: str, wanted: str, swift_fmu: Path, tmp_path: Path
) -> None:
    assert old in CAMPAIGN
    wrong = written(tmp_path, swift_fmu, measured(5, NOISE), CAMPAIGN.replace(old, new))
    with pytest.raises(BadInput, match=wanted):
        ff.Problem.of(ff.read_campaign(wrong, kinds=[LockInTable]))


def test_without_the_kind_its_table_is_unknown(path: Path) -> None:
    with pytest.raises(BadInput, match="'lock_in'"):
        ff.read_campaign(path)


def test_editors_are_told_of_its_table(path: Path) -> None:
    schema = json.loads(campaign_schema([LockInTable]))
    table = schema["properties"]["lock_in"]
    assert table["description"] == LockInTable.__doc__
    assert "quadrature" in table["properties"]["sigma"]["description"]
    assert set(table["required"]) == {"file", "outputs", "tone", "sigma"}
    tables = read_toml(path)
    jsonschema.validate(tables, schema, jsonschema.Draft7Validator)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(tables, json.loads(campaign_schema([])), jsonschema.Draft7Validator)


def test_two_kinds_cannot_share_a_table(path: Path) -> None:
    with pytest.raises(ValueError, match="lock_in"):
        ff.read_campaign(path, kinds=[LockInTable, LockInTable])
