"""Complex values of two-tone drives against the closed form and plain least squares."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

import fitting as ff
from fitting.campaign import Setup
from fitting.fmu.runs import Run
from fitting.inference.agreement import sweep_agreement
from fitting.measurements.measurement import Prediction
from fitting.measurements.tones import ComplexTones
from fitting.simulate.drive import Drive
from fitting.simulate.probe import Probe, Reading
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Kind, of_kind
from tests.support.complex_data import mode, with_noise

ETA, WIDTH = 1000.0, 12.5
PAIRS = ETA + np.array([[-12.0, 9.0], [-7.0, 4.0], [-4.0, 6.0], [-2.0, 3.0], [-9.0, 2.0]])
GAIN = 3e6 * np.exp(0.7j)
SETUP = Setup(
    ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2")),
    "q1_hybrid",
    start_values={"periodic_start": True, "theta": 0.0, "d2": 10.0, "eta_minus": 2000.0},
    steady_start=True,
)
PARAMETERS = (
    ff.Parameter("d1", 20.0, bounds=(1.0, 100.0), scale=5.0),
    ff.Parameter("eta_plus", 1002.0, bounds=(980.0, 1020.0), scale=5.0),
)
METHOD = ff.Tikhonov(nu=1e-6, beta=0.01, levels=2, misfit="squares")
#: Share of every value that each quadrature is off by.
NOISE = 0.01


def measured(turns: FloatArray | float = 0.0, seed: int = 5) -> ComplexArray:
    """Values of all experiments through the gain, turned by a phase of each (5,), with noise."""
    exact = GAIN * np.exp(1j * np.broadcast_to(turns, 5))[:, None] * mode(PAIRS, ETA, WIDTH)
    relative = with_noise(np.ones(PAIRS.size, dtype=complex), NOISE, seed)
    return np.asarray(exact * relative.reshape(PAIRS.shape))


def tones_of(y: ComplexArray, unknown: str = "gain", restarted: tuple[str, ...] = ()) -> ff.Tones:
    """As a program has them, with the noise told."""
    return ff.Tones(
        SETUP,
        PAIRS,
        y,
        sigmas_v=NOISE * np.abs(y),
        unknown=unknown,
        restarted=restarted,
        amplitude_unit="m",
    )


def measurement_of(tones: ff.Tones, fmu: ff.Fmu) -> ComplexTones:
    [found] = ff.Problem(fmu, PARAMETERS, tones).record.measurements
    assert isinstance(found, ComplexTones)
    return found


TURNS = np.array([0.0, 0.0, 1.9, 1.9, -2.0])


def test_value_error_and_freedom_are_those_of_least_squares_in_all_unknowns(
    swift: ff.Fmu,
) -> None:
    """Width, eigenfrequency, modulus and three phases: the last four are solved inside."""
    y = measured(TURNS)
    problem = ff.Problem(swift, PARAMETERS, tones_of(y, restarted=("3", "5")))
    found = ff.profile(ff.fit(problem, method=METHOD, starts=1))

    def rows(q: FloatArray) -> FloatArray:
        phases = q[[3, 3, 4, 4, 5]][:, None]
        model = np.exp(q[2] + 1j * phases) * 1e6 * mode(PAIRS, q[1], q[0])
        left = (model / y - 1.0).ravel() / NOISE
        return np.concatenate([left.real, left.imag])

    best = least_squares(rows, [13.0, 1000.0, 1.0, 0.7, 2.6, -1.3], xtol=1e-15, x_scale="jac")
    errors = np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)))
    for k, name in enumerate(("d1", "eta_plus")):
        assert found[name].value == pytest.approx(best.x[k], abs=0.02 * errors[k])
        low, high = found[name].interval()
        assert 0.5 * (high - low) / 1.96 == pytest.approx(errors[k], rel=0.02)
    assert found.inferred.knowledge is not None
    assert found.inferred.knowledge.freedom == pytest.approx(20 - 2 - 4, abs=0.01)


@pytest.mark.parametrize(
    ("unknown", "restarted", "unknowns"),
    [("gain", (), 2), ("gain", ("2", "4"), 4), ("phase", (), 1), ("phase", ("3",), 2)],
)
def test_what_is_solved_inside_is_the_least_squares_solution(
    unknown: str, restarted: tuple[str, ...], unknowns: int, swift: ff.Fmu
) -> None:
    """No change of any unknown lowers the sum of squares: rows are normal to all columns."""
    m = measurement_of(tones_of(measured(TURNS), unknown, restarted), swift)
    moved = Prediction(3e6 * mode(PAIRS.ravel(), ETA + 0.3, WIDTH))
    rows, columns = m.residuals(moved, 1.0), m.solved_columns(moved)
    assert m.solved_inside == unknowns == columns.shape[1]
    assert np.abs(columns.T @ rows) == pytest.approx(0.0, abs=1e-9 * float(np.linalg.norm(rows)))
    assert np.linalg.matrix_rank(columns) == unknowns
    assert m.solved(moved, 1.0) == pytest.approx(m.scaled(moved, 1.0))


def test_amplitudes_and_phases_are_the_two_halves_of_the_rows(swift: ff.Fmu) -> None:
    m = measurement_of(tones_of(measured(), "none"), swift)
    rows = m.residuals(Prediction(m.y * 1.001 * np.exp(0.002j)), 1.0)
    assert rows == pytest.approx(np.repeat([0.001, 0.002], m.y.size), abs=3e-6)
    along = m.amplitude_rows(Prediction(m.y), np.stack([rows, rows], axis=1))
    assert along[:, 0] == pytest.approx(rows[: m.y.size])


def test_the_report_says_what_phases_gained(swift: ff.Fmu) -> None:
    """Both errors of the width against the linearised problem of the closed form."""
    y = measured()
    fit = ff.fit(ff.Problem(swift, PARAMETERS, tones_of(y)), method=METHOD, starts=1)
    [width, _] = fit.inferred.quadratures.gains
    assert width.name == "d1"

    def log_response(q: FloatArray) -> ComplexArray:
        return np.asarray(np.log(mode(PAIRS.ravel(), q[1], q[0])) + q[2] + 1j * q[3])

    q, steps = np.array([*fit.x, 0.0, 0.0]), 1e-4 * np.eye(4)
    slopes = np.stack([(log_response(q + h) - log_response(q - h)) / 2e-4 for h in steps], axis=1)
    whole = np.concatenate([slopes.real, slopes.imag]) / NOISE
    alone = slopes.real[:, :3] / NOISE
    for matrix, told in ((whole, width.phases), (alone, width.amplitudes)):
        assert told == pytest.approx(np.sqrt(np.linalg.inv(matrix.T @ matrix)[0, 0]), rel=0.01)
    assert width.amplitudes > 1.5 * width.phases


SWEPT = ETA + np.linspace(-30.0, 30.0, 21)
SWEEP = ff.Sweep(
    SETUP,
    SWEPT,
    abs(GAIN) * np.abs(mode(SWEPT, ETA, WIDTH)),
    use="scale",
    scale="fit",
    amplitude_unit="m",
)


def test_phases_of_a_sweep_scaled_series_are_compared_by_its_chi(swift: ff.Fmu) -> None:
    """With the reference phase alone unknown, the sweep's chi holds the amplitudes."""
    problem = ff.Problem(swift, PARAMETERS, [tones_of(measured(), "phase"), SWEEP])
    rows = problem.residuals(np.array([WIDTH, ETA]))
    assert np.std(rows) == pytest.approx(NOISE, rel=0.4)
    with pytest.raises(BadInput, match=r"unknown = \"gain\""):
        ff.Problem(swift, PARAMETERS, [tones_of(measured(), "gain"), SWEEP])


def test_tones_with_and_without_phases_are_fitted_together(swift: ff.Fmu) -> None:
    alone = ff.Tones(
        SETUP,
        PAIRS + 0.5,
        abs(GAIN) * np.abs(mode(PAIRS + 0.5, ETA, WIDTH)),
        labels=list("abcde"),
        sigmas_v=np.full(PAIRS.shape, 1.0),
        amplitude_unit="m",
    )
    with_phases = tones_of(measured(), "phase")
    problem = ff.Problem(swift, PARAMETERS, [with_phases, alone, SWEEP])
    assert problem.residuals(np.array([WIDTH, ETA])).size == 20 + 10
    fit = ff.fit(problem, method=METHOD, starts=1)
    assert fit.x == pytest.approx([WIDTH, ETA], abs=0.2)


@pytest.mark.parametrize(("phases", "error"), [(False, 0.0), (True, 1e-3)])
def test_a_plan_for_phases_measures_errors_of_phases(phases: bool, error: float) -> None:
    """What turns a response and leaves its amplitude is no error of amplitudes alone."""
    drive = Drive(start_values={}, tones_hz=(1.0,), outputs=("q",), phases=phases)
    full, turned = (
        Reading(
            tones=np.array([[np.exp(1j * phase)]]),
            mean=np.zeros(1),
            rest=np.zeros(1),
            largest=np.ones(1),
            condition=1.0,
        )
        for phase in (0.0, 1e-3)
    )
    probe = Probe((drive,), _NoWorkers())
    assert probe.errors([turned], [full]) == pytest.approx(error, rel=1e-3, abs=1e-12)


class _NoWorkers:
    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        raise AssertionError("nothing is to be simulated")


# --- files ----------------------------------------------------------------------------------

CAMPAIGN = """
title = "Two tones"
[fmu]
file = "{fmu}"
start = {{ periodic_start = true, theta = 0.0, d2 = "10 Hz", eta_minus = "2 kHz" }}
[observe]
output = "q1_hybrid"
steady_start = true
[drive]
kind = "tones"
frequencies = ["u1", "u2"]
amplitudes = ["A1", "A2"]
[experiments]
file = "experiments.csv"
amplitude = "V peak"
unknown = "gain"
{columns}
[noise]
relative = 0.01
[[parameters]]
name = "d1"
lower = "1 Hz"
upper = "100 Hz"
start = "20 Hz"
[[parameters]]
name = "eta_plus"
lower = "0.98 kHz"
upper = "1.02 kHz"
start = "1.002 kHz"
[continuation]
starts = 1
misfit = "squares"
"""
POLAR = 'peaks = ["R1", "R2"]\nphases = ["P1", "P2"]'
PARTS = 'x = ["X1", "X2"]\ny = ["Y1", "Y2"]'
#: Columns of the file by the way it is written: keys, header, values of a complex column.
WAYS: dict[str, tuple[str, str, Callable[[ComplexArray], tuple[FloatArray, ...]]]] = {
    "X and Y": (PARTS, "X{} (mV),Y{} (uV)", lambda v: (1e3 * v.real, 1e6 * v.imag)),
    "parts": (
        'x = ["Re 1", "Re 2"]\ny = ["Im 1", "Im 2"]',
        "Re {} (V),Im {} (V)",
        lambda v: (v.real, v.imag),
    ),
    "degrees": (POLAR, "R{} (V),P{} (deg)", lambda v: (np.abs(v), np.degrees(np.angle(v)))),
    "radians": (POLAR, "R{} (V),P{} (rad)", lambda v: (np.abs(v), np.angle(v))),
    "unwrapped": (
        POLAR,
        "R{} (V),P{} (deg)",
        lambda v: (np.abs(v), np.degrees(np.angle(v)) - 3600.0),
    ),
    "conjugate": (
        POLAR + "\nconjugate = true",
        "R{} (V),P{} (rad)",
        lambda v: (np.abs(v), -np.angle(v)),
    ),
}


def write(folder: Path, fmu: ff.Fmu, columns: str, header: str, values: list[FloatArray]) -> Path:
    """A campaign whose experiments have these columns, those of the first tone before the rest."""
    head = ",".join(["experiment", "u1 (Hz)", "u2 (Hz)", *(header.format(k, k) for k in (1, 2))])
    rows = [
        ",".join([str(k + 1), *map(repr, [*map(float, pair), *(float(v[k]) for v in values)])])
        for k, pair in enumerate(PAIRS)
    ]
    (folder / "experiments.csv").write_text("\n".join([head, *rows]))
    path = folder / "campaign.toml"
    path.write_text(CAMPAIGN.format(fmu=fmu.description.path.as_posix(), columns=columns))
    return path


def written(folder: Path, fmu: ff.Fmu, way: str, y: ComplexArray) -> Path:
    keys, header, parts = WAYS[way]
    return write(folder, fmu, keys, header, [*parts(y[:, 0]), *parts(y[:, 1])])


@pytest.mark.parametrize("way", WAYS)
def test_every_way_to_write_complex_values_is_read(way: str, swift: ff.Fmu, tmp_path: Path) -> None:
    y = measured()
    campaign = ff.read_campaign(written(tmp_path, swift, way, y))
    problem = ff.Problem.of(campaign, swift)
    [found] = problem.record.measurements
    assert isinstance(found, ComplexTones)
    assert found.y == pytest.approx(y.ravel(), rel=1e-9)
    same = ff.Problem(swift, PARAMETERS, tones_of(y))
    assert problem.residuals(problem.start) == pytest.approx(same.residuals(same.start), abs=1e-9)


def test_decibels_and_phases_are_read(swift: ff.Fmu, tmp_path: Path) -> None:
    y = measured()
    pairs = [(20.0 * np.log10(np.abs(v)), np.degrees(np.angle(v))) for v in y.T]
    path = write(tmp_path, swift, POLAR, "R{} (dB),P{} (deg)", [v for p in pairs for v in p])
    path.write_text(path.read_text().replace('"V peak"', '"dB"'))
    [found] = ff.Problem.of(ff.read_campaign(path), swift).record.measurements
    assert isinstance(found, ComplexTones)
    assert found.y == pytest.approx(y.ravel(), rel=1e-9)


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        ('phases = ["P1"]', r"\[experiments\] phases: 1 .* 2"),
        ('phases = ["P1", "P3"]', r"experiments\.csv: .*'P3' of phases"),
        ('phases = ["R1", "P2"]', r"phases: 'R1'.* twice"),
        ('phases = ["P1", "P2"]\nunknown = "delay"', r"unknown: found 'delay'"),
        ('unknown = "gain"', r"unknown: .*'phases'.*'x' and 'y'"),
        ('x = ["P1", "P2"]', r"y: .*'x'"),
        ('phases = ["P1", "P2"]\nrestarted = ["7"]', r"'7'.* \[experiments\]"),
        (
            'phases = ["P1", "P2"]\nunknown = "none"\nrestarted = ["2"]',
            r"restarted: .*unknown = \"none\"",
        ),
    ],
)
def test_a_table_that_cannot_be_meant_is_refused(
    change: str, wanted: str, swift: ff.Fmu, tmp_path: Path
) -> None:
    path = written(tmp_path, swift, "degrees", measured())
    text = (
        path.read_text()
        .replace('phases = ["P1", "P2"]', change)
        .replace('unknown = "gain"\np', "p")
    )
    path.write_text(text)
    with pytest.raises(BadInput, match=wanted) as caught:
        ff.Problem.of(ff.read_campaign(path), swift)
    assert len(caught.value.args) == 1


@pytest.mark.parametrize(
    ("header", "phase", "wanted"),
    [
        ("R{} (V),P{}", 1.0, r"column 'P1' has no unit"),
        ("R{} (V),P{} (rad)", 57.3, r"row 2, .*'P1': found 18.6\d* rad, .*5 of 5 rows"),
        ("P{} (deg),R{} (V)", -1.0, r"row 2, .*'R1': negative"),
        ("R{} (V),P{} (Hz)", 1.0, r"column 'P1'.*Hz"),
        ("R{} (V),P{} (rad)", np.nan, r"row 2, column 'P1': found 'nan'"),
    ],
)
def test_columns_that_cannot_be_meant_are_refused(
    header: str, phase: float, wanted: str, swift: ff.Fmu, tmp_path: Path
) -> None:
    """No unit, degrees as radians, exchanged columns, another quantity, a cell without number."""
    values = [v for y in measured().T for v in (np.abs(y), phase * (0.1 + np.abs(np.angle(y))))]
    path = write(tmp_path, swift, POLAR, header, values)
    with pytest.raises(BadInput, match=wanted):
        ff.read_campaign(path)


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        (lambda y: y.imag + 1j * y.real, "reversed"),
        (lambda y: np.abs(y) * np.exp(1j * np.radians(np.angle(y))), "radian"),
        (lambda y: np.abs(y) * np.exp(1j * np.degrees(np.angle(y))), "degree"),
        (lambda y: y, None),
    ],
)
def test_phases_that_are_read_wrongly_are_told(
    mistake: Callable[[ComplexArray], ComplexArray], words: str | None, swift: ff.Fmu
) -> None:
    tones = tones_of(mistake(measured()))
    fit = ff.fit(ff.Problem(swift, PARAMETERS, tones), method=METHOD, starts=1)
    found = of_kind(fit.inferred.findings, Kind.phases_misread)
    readings = [each.names["reading"][0] for each in found]
    assert (words in readings) if words else not readings


@pytest.mark.parametrize(("width", "contradicts"), [(WIDTH, False), (1.3 * WIDTH, True)])
def test_an_unknown_gain_contradicts_a_sweep_by_its_line_alone(
    width: float, contradicts: bool, swift: ff.Fmu
) -> None:
    """No factor between their amplitudes is a mistake, and none is told: each has its own scale."""
    swept = 1e6 * np.abs(mode(SWEPT, ETA, width))
    noisy = swept * (1.0 + 0.003 * np.random.default_rng(2).standard_normal(SWEPT.size))
    sweep = ff.Sweep(SETUP, SWEPT, noisy, use="fit", scale="fit", amplitude_unit="m")
    problem = ff.Problem(swift, PARAMETERS, [tones_of(7.0 * measured()), sweep])
    fit = ff.fit(problem, method=METHOD, starts=1)
    told = sweep_agreement(fit.record.solution)
    assert [t.contradicts for t in told] in ([[True]] if contradicts else ([], [False]))
    assert all(np.isnan(t.factor) for t in told)
