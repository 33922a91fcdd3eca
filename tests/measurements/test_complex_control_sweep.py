"""Complex sweeps over a control: an avoided crossing behind a cable, with known truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.measurements.complex_sweep import ComplexCurve, ComplexSweep
from fitting.report.shown import figures_of
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from tests.support import crossing_spectra as crossing
from tests.support.complex_data import with_noise

TRUTH = {
    "a0": crossing.A0,
    "a1": 1e-3 * crossing.A1,
    "b0": 1e-3 * crossing.B0,
    "k": crossing.LAMBDA,
    "d1": crossing.WIDTH,
}
NOISE = 0.01
#: The cable turns the phases by 1.4 turns over a sweep.
DELAY_S = 1.4 / float(np.ptp(crossing.SWEPT_HZ))
#: Gain of every sweep, V for each m, as after a restart of the instrument before each.
GAINS = 1e6 * np.exp(1j * np.array([0.3, -1.2, 2.0, 0.9, -2.6]))
TABLE = """[complex_control_sweep]
file = "map.csv"
controls = ["V"]
delay = "fit"
sigma = "{sigma!r} V"
"""


def behind_cable(u_hz: FloatArray) -> ComplexArray:
    """What the cable does to the phases."""
    return np.asarray(np.exp(-2j * np.pi * (u_hz - np.mean(u_hz)) * DELAY_S))


def measured(noise: float, seed: int = 3) -> ComplexArray:
    """X + iY in V, (voltages, frequencies); noise a share of the largest of all."""
    u = crossing.SWEPT_HZ
    exact = np.array(
        [
            gain * crossing.phasor(u, v) * behind_cable(u)
            for v, gain in zip(crossing.VOLTS, GAINS, strict=True)
        ]
    )
    sigma = noise * float(np.max(np.abs(exact)))
    return with_noise(exact.ravel(), sigma, seed).reshape(exact.shape)


def written(folder: Path, fmu: Path, values: ComplexArray, *, files: bool = False) -> Path:
    """A campaign and its map: one long table, or a table of a file for each voltage."""
    points = [
        (volt, u, value)
        for volt, row in zip(crossing.VOLTS, values, strict=True)
        for u, value in zip(crossing.SWEPT_HZ, row, strict=True)
    ]
    if files:
        rows = ["V (mV),file"]
        for k, (volt, row) in enumerate(zip(crossing.VOLTS, values, strict=True)):
            pairs = zip(crossing.SWEPT_HZ, row, strict=True)
            own = [f"{u:.17g},{abs(v):.17g},{np.angle(v, deg=True):.17g}" for u, v in pairs]
            text = "\n".join(["frequency (Hz),amplitude (V),phase (deg)", *own])
            (folder / f"sweep{k}.csv").write_text(text)
            rows.append(f"{1e3 * volt:.17g},sweep{k}.csv")
    else:
        rows = ["V (mV),frequency (kHz),X (mV),Y (mV)"]
        rows += [
            f"{1e3 * v:.17g},{1e-3 * u:.17g},{1e3 * z.real:.17g},{1e3 * z.imag:.17g}"
            for v, u, z in points
        ]
    (folder / "map.csv").write_text("\n".join(rows))
    head, _, tail = crossing.CAMPAIGN.partition("[control_sweep]")
    laws = "\n".join(f'{name} = "{formula}"' for name, formula in crossing.LAWS.items())
    told = head + TABLE + tail[tail.index("\n[laws]") :]
    sigma = float(NOISE * np.max(np.abs(values)))
    path = folder / "campaign.toml"
    path.write_text(told.format(fmu=fmu.as_posix(), laws=laws, sigma=sigma))
    return path


@pytest.fixture(scope="module")
def problem(swift: ff.Fmu, swift_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> ff.Problem:
    folder = tmp_path_factory.mktemp("phases")
    return ff.Problem.of(ff.read_campaign(written(folder, swift_fmu, measured(NOISE))), swift)


@pytest.fixture(scope="module")
def fit(problem: ff.Problem) -> ff.Fit:
    return ff.fit(problem, starts=1)


@pytest.mark.parametrize("files", [False, True])
def test_rows_at_the_truth_are_those_of_the_closed_form(
    files: bool, swift: ff.Fmu, swift_fmu: Path, tmp_path: Path
) -> None:
    """From one table or a file for each voltage, in other units; every gain costs nothing."""
    path = written(tmp_path, swift_fmu, measured(0.0), files=files)
    told = ff.Problem.of(ff.read_campaign(path), swift)
    assert told.names == (*TRUTH, "delay")  # one cable, however many sweeps
    rows = told.residuals([*TRUTH.values(), DELAY_S])
    assert rows == pytest.approx(np.zeros(2 * measured(0.0).size), abs=1e-9)


def test_the_coupling_is_found_with_its_error(fit: ff.Fit) -> None:
    assert fit.success
    found = fit.result.parameters
    for name, truth in {**TRUTH, "delay": DELAY_S}.items():
        assert abs(found[name].value - truth) < 4.0 * found[name].std
    assert found["k"].std == pytest.approx(coupling_error(), rel=0.15)


def coupling_error() -> float:
    """Standard deviation of the coupling: central differences of the closed form."""
    u = crossing.SWEPT_HZ
    exact, columns = by_truth()
    columns.append(-2j * np.pi * (u - np.mean(u)) * exact)  # by the delay
    columns += [part * row for row in by_gain(exact) for part in (1.0, 1j)]
    return error_of_coupling([np.concatenate([c.real, c.imag]) for c in columns], exact)


def amplitude_error() -> float:
    """The same of moduli alone: what changes along the values."""
    exact, columns = by_truth()
    turn = np.exp(-1j * np.angle(exact))
    return error_of_coupling([(turn * c).real for c in (*columns, *by_gain(exact))], exact)


def by_truth() -> tuple[ComplexArray, list[ComplexArray]]:
    """Spectra without cable and gain, and their derivatives by what is fitted of the sample."""

    def spectra() -> ComplexArray:
        return np.array([crossing.phasor(crossing.SWEPT_HZ, v) for v in crossing.VOLTS])

    columns = []
    for name in ("A0", "A1", "B0", "LAMBDA", "WIDTH"):
        here = getattr(crossing, name)
        sides = []
        for step in (1e-5, -1e-5):
            setattr(crossing, name, here * (1.0 + step))
            sides.append(spectra())
        setattr(crossing, name, here)
        columns.append((sides[0] - sides[1]) / (2e-5 * here))
    return spectra(), columns


def by_gain(exact: ComplexArray) -> list[ComplexArray]:
    """Each spectrum alone, zero elsewhere."""
    return [np.where(np.arange(len(exact))[:, None] == k, exact, 0.0) for k in range(len(exact))]


def error_of_coupling(columns: Sequence[FloatArray], exact: ComplexArray) -> float:
    matrix = np.stack([column.ravel() for column in columns], axis=1)
    size = np.linalg.norm(matrix, axis=0)
    covariance = np.linalg.inv((matrix / size).T @ (matrix / size))
    return float(NOISE * np.max(np.abs(exact)) * np.sqrt(covariance[3, 3]) / size[3])


def test_phases_tell_more_than_amplitudes_alone(fit: ff.Fit) -> None:
    """Amplitudes with a gain each are half of the rows, and know neither delay nor phases."""
    [gained] = [each for each in fit.inferred.quadratures.gains if each.name == "k"]
    assert gained.phases == pytest.approx(coupling_error(), rel=0.15)
    assert gained.amplitudes == pytest.approx(amplitude_error(), rel=0.15)
    assert gained.amplitudes > 1.1 * gained.phases


def test_its_maps_are_what_a_report_shows(fit: ff.Fit) -> None:
    [figure] = figures_of(fit.record)
    assert "5 spectra over V" in figure.alt
    assert "closest at V = " in figure.caption.replace("\u00a0", " ")


def test_a_part_has_the_sweeps_of_its_labels() -> None:
    setup = ff.Setup(ff.Drive(frequency_names=("u1",), amplitude_names=("A1",)), "q1")
    volts = np.array([3.0, 0.0, 7.0, 1.0, 11.0, 5.0, 2.0, 9.0, 4.0, 10.0, 6.0, 8.0])
    curves = [
        ComplexCurve(
            crossing.SWEPT_HZ,
            crossing.phasor(crossing.SWEPT_HZ, float(v)),
            settings={"V": float(v)},
            label=f"{v:g} V",
        )
        for v in volts
    ]
    sweeps = ComplexSweep(setup=setup, curves=tuple(curves), units={"V": "V"})
    part = sweeps.part({"3 V", "8 V"})
    assert part is not None
    assert [c.label for c in part.records] == ["3 V", "8 V"]


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (lambda t: t.replace('["V"]', '["W"]'), "no column 'W'"),
        (lambda t: t.replace('["V"]', '["X"]'), "'X'"),
        (lambda t: t.replace('["V"]', "[]"), "at least one column"),
        (lambda t: t.replace('delay = "fit"', 'delay = "3 m"'), "delay"),
        (lambda t: t.replace('delay = "fit"', "restarted = true"), 'scale = "shared"'),
        (
            lambda t: t.replace('delay = "fit"', 'range = ["1 Hz", "2 Hz"]'),
            "0 points .* 1 Hz to 2 Hz.* 8",
        ),
        (
            lambda t: t.replace('delay = "fit"', 'columns = { x = "XX" }'),
            "no column 'XX'",
        ),
    ],
)
def test_what_is_wrong_with_its_table_is_told_in_a_sentence(
    change: Callable[[str], str], wanted: str, swift_fmu: Path, tmp_path: Path
) -> None:
    path = written(tmp_path, swift_fmu, measured(NOISE))
    before = path.read_text()
    path.write_text(change(before))
    assert path.read_text() != before
    with pytest.raises(BadInput, match=wanted) as told:
        ff.Problem.of(ff.read_campaign(path))
    assert len(told.value.args) == 1


@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        ("V (mV)", "V", "column 'V' has no unit"),
        (",Y (mV)", ",Z (mV)", "no column 'Y'"),
        ("1.018", "0.5", "row 42"),
        ("-3000,0.98", "x,0.98", "row 2, column 'V'"),
    ],
)
def test_what_is_wrong_with_its_file_is_told_in_a_sentence(
    old: str, new: str, wanted: str, swift_fmu: Path, tmp_path: Path
) -> None:
    path = written(tmp_path, swift_fmu, measured(NOISE))
    table = tmp_path / "map.csv"
    text = table.read_text()
    assert old in text
    table.write_text(text.replace(old, new, 1))
    with pytest.raises(BadInput, match=wanted):
        ff.Problem.of(ff.read_campaign(path))
