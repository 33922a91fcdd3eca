"""Complex sweeps against the closed form, plain least squares, and measured data."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import t

import fitting as ff
from fitting.campaign.instruments import read_trace
from fitting.measurements.complex_sweep import (
    ComplexCurve,
    ComplexSweep,
    Wiring,
    check_delay,
    read_complex,
)
from fitting.report.screen import phrase
from fitting.report.summary import summary_of
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.estimate import Verdict
from fitting.text.finding import Kind, of_kind
from tests.support.coloured import coloured
from tests.support.complex_data import mode, notch, with_noise, write_xy
from tests.support.one_mode import SETUP

DATA = Path(__file__).parents[2] / "data"
ETA, WIDTH = 1000.0, 12.5
SEEN = ETA + np.linspace(-40.0, 40.0, 33)
GAIN, GROUND = 3.0 * np.exp(0.7j), 2e-7 * np.exp(-1.9j)
PARAMETERS = (
    ff.Parameter("d1", 20.0, bounds=(1.0, 100.0), scale=5.0),
    ff.Parameter("eta_plus", 1002.0, bounds=(980.0, 1020.0), scale=5.0),
)


def measured(noise: float, seed: int = 3) -> ComplexArray:
    """One mode with a gain and a constant background; noise as a share of the largest value."""
    exact = GAIN * mode(SEEN, ETA, WIDTH) + GROUND
    return with_noise(exact, noise * float(np.max(np.abs(exact))), seed)


def best(u: FloatArray, y: ComplexArray, columns: int) -> tuple[FloatArray, FloatArray, float]:
    """Width and eigenfrequency by least squares of one mode, 1 and u; errors and scatter.

    Every unknown is one of the search: nothing is solved inside.
    """
    top = np.max(np.abs(y))
    scale = np.max(np.abs(mode(u, float(np.mean(u)), WIDTH)))

    def rows(q: FloatArray) -> FloatArray:
        shapes = [mode(u, q[1], q[0]) / scale, np.ones(u.size), (u - u[0]) / np.ptp(u)]
        pairs = q[2:].reshape(-1, 2)
        model = sum(complex(*c) * shape for c, shape in zip(pairs, shapes, strict=False))
        return np.concatenate([(model - y / top).real, (model - y / top).imag])

    first = [20.0, float(np.mean(u)) + 1.0, *([0.3, 0.3] * columns)]
    found = least_squares(
        rows, first, x_scale=np.maximum(np.abs(first), 0.1), xtol=1e-15, ftol=1e-15
    )
    variance = float(found.fun @ found.fun) / (2 * u.size - len(first))
    errors = np.sqrt(variance * np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    return found.x[:2], errors[:2], float(np.sqrt(variance)) * top


def test_value_error_and_freedom_are_those_of_least_squares_in_all_unknowns(
    swift: ff.Fmu,
) -> None:
    """Gain and background are solved inside: nobody would know from value, error and freedom."""
    y = measured(0.01)
    curve = ComplexCurve(SEEN, y, wiring=Wiring(background="constant"))
    problem = ff.Problem(swift, PARAMETERS, ff.ComplexSweep(SETUP, curve))
    found = ff.profile(ff.fit(problem, method=ff.Tikhonov(misfit="squares"), starts=1))
    value, error, _ = best(SEEN, y, 2)
    for name, v, e in zip(("d1", "eta_plus"), value, error, strict=True):
        assert found[name].value == pytest.approx(v, abs=0.01 * e)
        low, high = found[name].interval()
        half = float(t.ppf(0.975, 2 * SEEN.size - 6)) * e
        assert 0.5 * (high - low) == pytest.approx(half, rel=0.02)
    assert found.inferred.knowledge is not None
    assert found.inferred.knowledge.freedom == pytest.approx(2 * SEEN.size - 4 - 2, abs=0.01)


def test_a_value_that_its_bound_holds_is_no_more_than_bounded(swift: ff.Fmu) -> None:
    """The bounds of the width end at 11 Hz; least squares without them know 12.5 Hz."""
    y = measured(0.01)
    curve = ComplexCurve(SEEN, y, wiring=Wiring(background="constant"))
    inside = (ff.Parameter("d1", 10.0, bounds=(1.0, 11.0), scale=5.0), PARAMETERS[1])
    problem = ff.Problem(swift, inside, ff.ComplexSweep(SETUP, curve))
    found = ff.profile(ff.fit(problem, method=ff.Tikhonov(misfit="squares"), starts=1), ["d1"])
    assert best(SEEN, y, 2)[0][0] > 11.0
    known = found["d1"]
    assert known.status is Verdict.BELOW
    assert known.closed_by == ("data", "bound")
    assert known.ci95[1] == 11.0
    assert [f.subject for f in of_kind(found.findings, Kind.at_bound)] == ["d1"]
    assert summary_of(found.result).advice == phrase("next", "wider_bounds", ["d₁"], True)


def test_the_measured_cantilever_is_that_of_least_squares(tmp_path: Path) -> None:
    """256 points, amplitude and phase; residuals that are correlated widen the errors."""
    campaign = ff.read_campaign(DATA / "afm_sensor" / "phases.toml")
    fit = ff.fit(ff.Problem.of(campaign))
    trace = read_trace(DATA / "afm_sensor" / "afm_sensor_sweep.dat", "afm")
    assert trace.phase is not None
    y = trace.amplitude.astype(complex) * np.exp(1j * np.deg2rad(trace.phase))
    value, error, _ = best(trace.frequency, y, 2)
    assert fit.x[::-1] == pytest.approx(value, abs=1e-3)
    assert fit.x[0] == pytest.approx(30281.215, abs=0.03)
    assert fit.x[1] == pytest.approx(24.83, abs=0.07)
    structure = fit.record.solution.structure
    assert structure is not None
    assert 1.5 < structure.widening < 3.0
    stated = fit.record.solution.errors
    widths = [
        stated.of(p.scale * row)[0]
        for p, row in zip(fit.problem.record.parameters, np.eye(2), strict=True)
    ]
    assert widths[::-1] == pytest.approx(structure.widening * error, rel=0.05)


WAYS: dict[str, tuple[str, Callable[[FloatArray, ComplexArray], tuple[FloatArray, ...]]]] = {
    "X and Y": (
        "frequency (kHz);X (mV);Y (uV)",
        lambda u, v: (1e-3 * u, 1e3 * v.real, 1e6 * v.imag),
    ),
    "parts": ("freq (Hz);Re (V);Im (V)", lambda u, v: (u, v.real, v.imag)),
    "degrees": ("f (Hz);R (V);theta (deg)", lambda u, v: (u, np.abs(v), np.degrees(np.angle(v)))),
    "radians": ("f (Hz);amplitude (V);phase (rad)", lambda u, v: (u, np.abs(v), np.angle(v))),
    "unwrapped": (
        "f (Hz);amplitude (V);phase (rad)",
        lambda u, v: (u, np.abs(v), np.unwrap(np.angle(v)) - 40.0 * np.pi),
    ),
    "decibel": (
        "f (Hz);magnitude (dB);phase (deg)",
        lambda u, v: (u, 20.0 * np.log10(np.abs(v)), np.degrees(np.angle(v))),
    ),
}


@pytest.mark.parametrize("way", WAYS)
def test_every_way_to_write_complex_values_is_read(way: str, tmp_path: Path) -> None:
    header, columns = WAYS[way]
    y = 1e6 * measured(0.01) * np.exp(-2j * np.pi * SEEN * 0.02)
    path = tmp_path / "sweep.csv"
    rows = np.column_stack(columns(SEEN, y))
    path.write_text("\n".join([header, *(";".join(map(repr, row)) for row in rows.tolist())]))
    read = read_complex(path)
    assert read.u_hz == pytest.approx(SEEN)
    factor = 1e-3 if way == "X and Y" else 1.0
    assert factor * read.y == pytest.approx(y, rel=1e-9)
    assert read.unit == {"X and Y": "mV", "decibel": "1"}.get(way, "V")


def _polar(header: str, phases: FloatArray) -> str:
    rows = zip(SEEN, np.abs(measured(0.0)), phases, strict=True)
    return "\n".join([header, *(",".join(map(repr, map(float, row))) for row in rows)])


DEGREES = np.degrees(np.angle(measured(0.0)))
XY = "frequency (Hz),X (V),Y (V)\n" + "\n".join(
    f"{u!r},{v.real!r},{v.imag!r}"
    for u, v in zip(SEEN.tolist(), measured(0.0).tolist(), strict=True)
)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (XY.replace("Y (V)", "Z (V)"), r"no column 'Y'"),
        (XY.replace("X (V),Y (V)", "R (V),Z (V)"), r"no column 'phase'"),
        (XY.replace("frequency (Hz)", "time (s)"), r"over time"),
        (XY.replace("X (V)", "X"), r"column 'X' has no unit"),
        (XY.replace("Y (V)", "Y (Hz)"), r"column 'Y'"),
        (XY.replace("960.0,", "960.0,nan,", 1).replace(",", "", 0), r"row 2 has 4 cells"),
        (_polar("f (Hz),R (V),phase", DEGREES), r"column 'phase' has no unit"),
        (_polar("f (Hz),R (V),phase (rad)", DEGREES), r"in rad\b.* radians"),
        (_polar("f (Hz),R (V),phase (deg)", np.radians(DEGREES)), r"in deg\b.* rad\b"),
        (_polar("f (Hz),phase (V),R (deg)", DEGREES), r"phase: .*V"),
    ],
)
def test_a_file_that_cannot_be_meant_is_refused(text: str, wanted: str, tmp_path: Path) -> None:
    path = tmp_path / "sweep.csv"
    path.write_text(text)
    with pytest.raises(BadInput, match=wanted) as caught:
        read_complex(path)
    assert len(caught.value.args) == 1


def test_a_cell_that_is_no_number_is_named(tmp_path: Path) -> None:
    path = tmp_path / "sweep.csv"
    lines = XY.splitlines()
    lines[3] = lines[3].split(",")[0] + ",nan,0.0"
    path.write_text("\n".join(lines))
    with pytest.raises(BadInput, match=r"row 4, .*'X'.* 'nan'"):
        read_complex(path)


TABLES = """
title = "One mode"
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
[[complex_sweep]]
file = "sweep.csv"
background = "constant"
[[parameters]]
name = "d1"
lower = "1 Hz"
upper = "100 Hz"
start = "30 Hz"
[[parameters]]
name = "eta_plus"
lower = "0.98 kHz"
upper = "1.02 kHz"
start = "1.004 kHz"
"""


def _campaign(folder: Path, fmu: Path, y: ComplexArray, table: str = "") -> Path:
    write_xy(folder / "sweep.csv", SEEN, y)
    text = TABLES.format(fmu=fmu.as_posix())
    path = folder / "campaign.toml"
    path.write_text(text.replace('background = "constant"', table) if table else text)
    return path


@pytest.mark.parametrize(
    ("table", "wanted"),
    [
        ('delay = "soon"', r"\[complex_sweep '1'\] delay: found 'soon'"),
        ('delay = "3"', r"\[complex_sweep '1'\] delay: found \"3\""),
        ('wiring = "notches"', r"wiring: found 'notches'.* \"transmission\""),
        ('wiring = "notch"\nbackground = "constant"', r"background: \"constant\""),
        ('wiring = "notch"\nscale = "shared"', r"scale: .*\"own\" with wiring"),
        ("restarted = true", r"restarted: .*scale = \"shared\""),
        ('sigma = "1 Hz"', r"sigma"),
        ('sigma = "0 V"', r"sigma: found 0"),
        ('file_name = "a"', r"unknown key 'file_name'"),
        ('output = "q9"', r"\[\[complex_sweep\]\] output: .*'q9'"),
    ],
)
def test_a_table_that_cannot_be_meant_is_refused(
    table: str, wanted: str, swift_fmu: Path, tmp_path: Path
) -> None:
    path = _campaign(tmp_path, swift_fmu, measured(0.0), table)
    with pytest.raises(BadInput, match=wanted):
        ff.Problem.of(ff.read_campaign(path))


def test_exchanged_quadratures_are_told(swift: ff.Fmu, swift_fmu: Path, tmp_path: Path) -> None:
    y = measured(0.01)
    path = _campaign(tmp_path, swift_fmu, y.imag + 1j * y.real)
    with pytest.raises(BadInput, match=r" 999\.9"):
        ff.Problem.of(ff.read_campaign(path), swift).record  # noqa: B018
    path = _campaign(tmp_path, swift_fmu, np.conj(y), "conjugate = true")
    read = ff.Problem.of(ff.read_campaign(path), swift)
    path = _campaign(tmp_path, swift_fmu, y, "scale = 'own'")
    plain = ff.Problem.of(ff.read_campaign(path), swift)
    assert read.residuals(read.start) == pytest.approx(plain.residuals(plain.start), abs=1e-12)


@pytest.mark.parametrize("told_s", [0.0, 0.02])
@pytest.mark.parametrize("cable_s", [0.0, 0.005, 0.02, 0.3])
def test_a_cable_of_more_than_a_turn_has_to_be_told(cable_s: float, told_s: float) -> None:
    """The sweep spans 80 Hz: 5 ms more or less turn its phase by less than half a turn."""
    y = with_noise(1e6 * mode(SEEN, ETA, WIDTH), 0.002, seed=3)
    y = y * np.exp(-2j * np.pi * SEEN * cable_s)
    found = ComplexCurve(frequency_hz=SEEN, values=y)
    if abs(cable_s - told_s) < 0.0125:
        return check_delay(found, told_s, "here")
    with pytest.raises(BadInput, match="here: the phases") as caught:
        check_delay(found, told_s, "here")
    [said] = re.findall(r"behind a cable of ([\d.]+) ms", str(caught.value)) or ["0"]
    assert float(said) == pytest.approx(1e3 * cable_s, abs=1.0)
    return None


def test_two_modes_are_no_cable() -> None:
    u = np.linspace(900.0, 1100.0, 401)
    y = mode(u, 960.0, 5.0) + mode(u, 1030.0, 4.0) * np.exp(1.0j)
    check_delay(ComplexCurve(frequency_hz=u, values=y), 0.0, "here")


def test_a_delay_that_the_sweep_does_not_resolve_is_refused() -> None:
    u = ETA + np.linspace(-10.0, 10.0, 41)
    with pytest.raises(BadInput, match="delay"):
        ff.ComplexSweep(SETUP, ComplexCurve(u, mode(u, ETA, WIDTH), delay_s=None))


# --- several sweeps, and what is solved inside ----------------------------------------------


def _several(*, shared: bool = False, restarted: bool = False) -> ComplexSweep:
    """Three sweeps through gains of one modulus and phases of their own, beside constants."""
    curves = []
    for k, (u, phase) in enumerate(((SEEN, 0.3), (SEEN[::2] + 1.0, 2.0), (SEEN + 3.0, -1.1))):
        y = 2.0 * np.exp(1j * phase) * mode(u, ETA, WIDTH) + (k + 1) * GROUND
        y = with_noise(y, 1e-8, seed=k)
        curves.append(
            ComplexCurve(
                u,
                y,
                label=str(k),
                sigma=1e-8,
                wiring=Wiring(background="constant"),
                shared=shared,
                restarted=restarted,
            )
        )
    return ComplexSweep(setup=SETUP, curves=tuple(curves))


@pytest.mark.parametrize(
    ("said", "unknowns"),
    [({}, 12), ({"shared": True}, 8), ({"shared": True, "restarted": True}, 10)],
)
def test_what_is_solved_inside_is_the_least_squares_solution(
    said: dict[str, bool], unknowns: int
) -> None:
    """No change of any unknown lowers the sum of squares: rows are normal to all columns."""
    sweep = _several(**said)
    responses = [mode(c.u_hz, ETA + 2.0, WIDTH) for c in sweep.records]
    found = sweep.wired(responses, (0.0, 0.0, 0.0))
    white = 1.0 / sweep.sigma
    rows = white * sweep.residuals(found, 1.0)
    columns = white[:, None] * sweep.solved_columns(found)
    assert sweep.solved_inside == unknowns == columns.shape[1]
    cosines = rows @ columns / np.linalg.norm(columns, axis=0) / np.linalg.norm(rows)
    assert np.abs(cosines) == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.matrix_rank(columns / np.linalg.norm(columns, axis=0)) == unknowns
    gains = [s.coefficients[0] for s in found.solved]
    if said:
        assert np.abs(gains) == pytest.approx(abs(gains[0]))
    if said == {"shared": True}:
        assert gains == pytest.approx([gains[0]] * 3)
    exact = sweep.wired([mode(c.u_hz, ETA, WIDTH) for c in sweep.records], (0.0, 0.0, 0.0))
    if said != {"shared": True}:
        phases = [np.angle(s.coefficients[0]) for s in exact.solved]
        assert phases == pytest.approx([0.3, 2.0, -1.1], abs=0.02)


def test_a_notch_behind_a_cable_is_followed_with_its_delay() -> None:
    """The start of the delay comes from the phases; at the true one nothing is left."""
    u, tau = 5e9 + np.linspace(-5e6, 5e6, 401), 41e-9
    exact = 0.3j * np.exp(-2j * np.pi * u * tau) * notch(u, 5e9, 12e3, 15e3 * np.exp(-0.4j))
    curve = ComplexCurve(u, exact, wiring=Wiring(kind="notch"), delay_s=None, unit="1")
    sweep = ComplexSweep(setup=SETUP, curves=(curve,))
    [delay] = sweep.parameters
    assert delay.name == "delay"
    assert delay.start == pytest.approx(tau, abs=0.1 / np.ptp(u))
    found = sweep.wired([mode(u, 5e9, 5e9 / 12e3)], [tau])
    assert np.max(np.abs(sweep.residuals(found, 1.0))) < 1e-9
    assert sweep.solved_inside == 4


def test_data_that_are_listed_twice_are_refused() -> None:
    y = measured(0.01)
    curves = [ComplexCurve(SEEN, y, label=label) for label in ("a", "b")]
    with pytest.raises(BadInput, match=r"'b' .*'a' again"):
        ff.ComplexSweep(SETUP, curves)
    with pytest.raises(BadInput, match=r"labels a, a\b"):
        ff.ComplexSweep(SETUP, [curves[0], ComplexCurve(SEEN, 2.0 * y, label="a")])


def errors_without_noise(rows: Callable[[FloatArray], FloatArray], at: FloatArray) -> FloatArray:
    """Errors of the first two unknowns per noise of a row; directions that no row sees are free."""
    steps = 1e-5 * np.maximum(np.abs(at), 1e-12) * np.eye(at.size)
    slopes = [(rows(at + s) - rows(at - s)) / (2.0 * np.sum(s)) for s in steps]
    jacobian = np.stack(slopes, axis=1)
    sizes = np.linalg.norm(jacobian, axis=0)
    covariance = np.linalg.pinv((jacobian / sizes).T @ (jacobian / sizes), rcond=1e-9)
    return np.asarray((np.sqrt(np.diag(covariance)) / sizes)[:2])


def test_what_phases_gain_is_told_of_the_errors_that_are_reported(swift: ff.Fmu) -> None:
    """Noise that drifts widens them; amplitudes alone are as many times as wide as they were."""
    rng = np.random.default_rng(8)
    exact = GAIN * mode(SEEN, ETA, WIDTH) + GROUND
    drift = 0.01 * float(np.max(np.abs(exact))) * np.array([1.0, 1.0j])
    y = exact + drift @ np.stack([coloured(0.8, SEEN.size, rng) for _ in "xy"])
    curve = ComplexCurve(SEEN, y, wiring=Wiring(background="constant"))
    problem = ff.Problem(swift, PARAMETERS, ff.ComplexSweep(SETUP, curve))
    found = ff.profile(ff.fit(problem, method=ff.Tikhonov(misfit="squares"), starts=1)).record
    structure = found.fit.solution.structure
    assert structure is not None
    assert structure.widening > 1.3

    def seen(q: FloatArray) -> ComplexArray:
        return np.asarray(complex(*q[2:4]) * mode(SEEN, q[1], q[0]) + complex(*q[4:]))

    true = np.array([WIDTH, ETA, GAIN.real, GAIN.imag, GROUND.real, GROUND.imag])
    phases = errors_without_noise(lambda q: np.concatenate([seen(q).real, seen(q).imag]), true)
    alone = errors_without_noise(lambda q: np.abs(seen(q)), true)
    gains = {gain.name: gain for gain in found.quadratures.gains}
    for name, ratio in zip(("d1", "eta_plus"), alone / phases, strict=True):
        assert gains[name].phases == found.parameters[name].std
        assert gains[name].amplitudes / gains[name].phases == pytest.approx(ratio, rel=0.1)
