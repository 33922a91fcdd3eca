"""Spectra over a control: an avoided crossing with known truth, from files and arrays."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure as Canvas

import fitting as ff
from fitting.measurements.control_sweep import ControlSpectrum, ControlSweep, odd_harmonics
from fitting.measurements.measurement import Prediction
from fitting.report.figures.measurements import draw_measurement
from fitting.report.shown import shown_fit
from fitting.report.summary import summary_of
from fitting.text.errors import BadInput
from fitting.text.finding import Kind
from tests.support import crossing_spectra as crossing

TRUTH = {
    "a0": crossing.A0,
    "a1": 1e-3 * crossing.A1,
    "b0": 1e-3 * crossing.B0,
    "k": crossing.LAMBDA,
    "d1": crossing.WIDTH,
}
NOISE = 0.01


@pytest.fixture(scope="module")
def fit(swift: ff.Fmu, swift_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> ff.Fit:
    folder = tmp_path_factory.mktemp("crossing")
    path = crossing.written(folder, swift_fmu, crossing.measured(3, NOISE))
    return ff.fit(ff.Problem.of(ff.read_campaign(path), swift))


def test_rows_at_the_truth_are_those_of_the_closed_form(
    swift: ff.Fmu, swift_fmu: Path, tmp_path: Path
) -> None:
    """From a file, in other units, and from arrays; a scale of each spectrum costs nothing."""
    exact = crossing.measured(0, 0.0)
    path = crossing.written(tmp_path, swift_fmu, exact)
    path.write_text(
        path.read_text().replace("[control_sweep]", "[control_sweep]\nrectified = false")
    )
    told = ff.Problem.of(ff.read_campaign(path), swift)
    p = [TRUTH[name] for name in told.names]
    assert told.residuals(p) == pytest.approx(np.zeros(exact.size), abs=1e-9)
    gains = np.linspace(1.0, 5.0, crossing.VOLTS.size)
    given = from_arrays(swift, gains[:, None] * exact, "each")
    q = [crossing.A0, crossing.A1, crossing.B0, crossing.LAMBDA, crossing.WIDTH]
    assert given.residuals(q) == pytest.approx(np.zeros(exact.size), abs=1e-9)
    # one scale for all cannot follow gains that differ; without any, amplitudes are as they are
    shared = from_arrays(swift, gains[:, None] * exact, "shared").residuals(q)
    weights = np.max(gains[:, None] * exact, axis=1, keepdims=True) ** -2
    chi = np.sum(weights * gains[:, None] * exact**2) / np.sum(weights * exact**2)
    apart = (chi / gains[:, None] - 1.0) * exact / np.max(exact, axis=1, keepdims=True)
    assert shared == pytest.approx(apart.ravel(), abs=1e-9)
    plain = from_arrays(swift, exact, "none").residuals(q)
    assert plain == pytest.approx(np.zeros(exact.size), abs=1e-9)


def test_a_line_that_the_model_lacks_is_named_with_its_place(
    swift: ff.Fmu, swift_fmu: Path, tmp_path: Path
) -> None:
    """A third line at 1012 Hz, half as high as the others: what to do next is about it."""
    u = crossing.SWEPT_HZ
    exact = np.array([crossing.phasor(u, v) for v in crossing.VOLTS])
    third = 0.5 * np.max(np.abs(exact)) / (1.0 + 2j * (u - 1012.0) / 2.0)
    scatter = np.random.default_rng(5).standard_normal(exact.shape)
    amplitude = np.abs(exact + third + NOISE * np.max(np.abs(exact)) * scatter)
    path = crossing.written(tmp_path, swift_fmu, amplitude)
    result = ff.fit(ff.Problem.of(ff.read_campaign(path), swift), starts=1).result
    assert result.status != "converged"
    [finding] = [f for f in result.findings if f.kind is Kind.line_missing]
    assert finding.numbers["frequency_hz"] == pytest.approx(1012.0, abs=1.0)
    assert 0.5 < finding.numbers["removed"] <= 1.0
    assert re.search(r"101[123](\.\d+)? Hz|1\.01[123]\d* kHz", summary_of(result).advice)


def test_columns_of_other_names_without_units_are_told_by_the_campaign(
    swift: ff.Fmu, swift_fmu: Path, tmp_path: Path
) -> None:
    exact = crossing.measured(0, 0.0)
    path = crossing.written(tmp_path, swift_fmu, exact)
    table = tmp_path / "map.csv"
    head, rest = table.read_text().split("\n", 1)
    assert head.count(",") == 2
    table.write_text("V (mV),u,seen\n" + rest)
    columns = '[control_sweep]\ncolumns = { frequency = "u (kHz)", amplitude = "seen (mV)" }'
    plain = path.read_text().replace("[control_sweep]", "[control_sweep]\nrectified = false")
    path.write_text(plain.replace("[control_sweep]", columns))
    told = ff.Problem.of(ff.read_campaign(path), swift)
    p = [TRUTH[name] for name in told.names]
    assert told.residuals(p) == pytest.approx(np.zeros(exact.size), abs=1e-9)
    path.write_text(plain.replace("[control_sweep]", columns.replace("seen (mV)", "sen (mV)")))
    with pytest.raises(BadInput, match="'sen"):
        ff.read_campaign(path)
    path.write_text(plain.replace("[control_sweep]", columns.replace("seen (mV)", "seen")))
    with pytest.raises(BadInput, match=r"'seen'.* unit"):
        ff.read_campaign(path)
    path.write_text(plain.replace("[control_sweep]", columns.replace("seen (mV)", "V (mV)")))
    with pytest.raises(BadInput, match="'V'"):
        ff.read_campaign(path)


def from_arrays(fmu: ff.Fmu, amplitude: np.ndarray, scale: str) -> ff.Problem:
    setup = ff.Setup(
        ff.Drive(frequency_names=("u1",), amplitude_names=("A1",)),
        "q1",
        start_values={"periodic_start": True, "A2": 0.0},
        steady_start=True,
        laws=ff.Laws(crossing.LAWS),
    )
    spectra = [
        ControlSpectrum(crossing.SWEPT_HZ, row, {"V": float(volt)})
        for volt, row in zip(crossing.VOLTS, amplitude, strict=True)
    ]
    return ff.Problem(
        fmu,
        [
            ff.Parameter("a0", "999 Hz", bounds=("990 Hz", "1010 Hz")),
            ff.Parameter("a1", 3.0, bounds=(1.0, 10.0), unit="Hz/V"),
            ff.Parameter("b0", 1002.0, bounds=(990.0, 1010.0), unit="Hz"),
            ff.Parameter("k", 80.0, bounds=(10.0, 300.0), unit="Hz"),
            ff.Parameter("d1", 5.0, bounds=(0.1, 30.0)),
        ],
        ControlSweep(
            setup=setup,
            spectra=tuple(spectra),
            units={"V": "V"},
            scaled_by=scale,
            estimated=False,
            unit="m",
        ),
    )


def test_the_coupling_is_found_with_its_error(fit: ff.Fit) -> None:
    assert fit.success
    found = fit.result.parameters
    for name, truth in TRUTH.items():
        assert abs(found[name].value - truth) < 4.0 * found[name].std
    # residuals larger than the noise, by chance, widen the error by a few per cent
    assert found["k"].std == pytest.approx(coupling_error(), rel=0.15)
    # the FMU's own output says the same at every voltage, and its f1 follows the law
    values = fit.result.derived["lambda"].values
    assert values == pytest.approx([found["k"].value] * 5, rel=2e-3)
    slopes = np.diff(fit.result.derived["f1"].values)
    assert slopes == pytest.approx(1.5 * crossing.A1 * np.ones(4), rel=0.02)


def test_magnitudes_of_noisy_quadratures_are_compared_with_their_mean() -> None:
    """At the truth rows of a noise as large as half the spectrum average to nothing."""
    sigma, gain = 0.5, 3.0
    rng = np.random.default_rng(8)
    f = np.linspace(1.0, 2.0, 401)
    lines = [np.exp(-0.5 * ((f - at) / 0.1) ** 2) for at in (1.3, 1.7)]
    noisy = []
    for a in lines:
        noise = sigma * rng.standard_normal((2, 4000, f.size))
        noisy.append(np.mean(np.abs(gain * a + noise[0] + 1j * noise[1]), axis=0))
    setup = ff.Setup(ff.Drive(frequency_names=("u1",), amplitude_names=("A1",)), "q1")
    spectra = [ff.ControlSpectrum(f, y, {"V": float(k)}, sigma=sigma) for k, y in enumerate(noisy)]
    sweep = ff.ControlSweep(setup=setup, spectra=tuple(spectra), units={"V": "V"})
    rows = sweep.residuals(Prediction(np.concatenate(lines)), 1.0)
    # 4,000 draws leave 0.5/sqrt(4000) of each point, less where it is small
    assert np.std(rows) < 1.1 * sigma / np.sqrt(4000.0) / np.max(noisy)
    assert abs(np.mean(rows)) < 0.1 * np.std(rows)
    plain = replace(sweep, rectified=False)
    assert np.std(plain.residuals(Prediction(np.concatenate(lines)), 1.0)) > 10.0 * np.std(rows)
    # a step of the scale changes the rows as they say of themselves
    scaled = sweep.scaled(Prediction(np.concatenate(lines)), 1.0)
    assert scaled == pytest.approx(gain * np.concatenate(lines), rel=2e-3)
    above, below = sweep.detected_mean(1.001 * scaled), sweep.detected_mean(0.999 * scaled)
    moved = (above - below) / 0.002 / sweep.sizes
    columns = sweep.solved_columns(Prediction(np.concatenate(lines)))
    assert np.sum(columns, axis=1) == pytest.approx(moved, rel=1e-5, abs=1e-6)


def test_noise_that_scatter_tells_too_large_is_told_by_the_squares() -> None:
    """Lines of a few points scatter like noise; the mean of magnitudes rests on the noise alone."""
    sigma = 0.1
    rng = np.random.default_rng(11)
    f = np.linspace(1.0, 2.0, 60)
    exact = sum(np.exp(-(((f - at) / 0.012) ** 2)) for at in (1.15, 1.3, 1.45, 1.6, 1.75, 1.9))
    rows, scatter = [], []
    setup = ff.Setup(ff.Drive(frequency_names=("u1",), amplitude_names=("A1",)), "q1")
    for _ in range(200):
        noise = sigma * rng.standard_normal((2, 2, f.size))
        noisy = np.abs(exact + noise[:, 0] + 1j * noise[:, 1])
        spectra = [ff.ControlSpectrum(f, y, {"V": float(k)}) for k, y in enumerate(noisy)]
        sweep = ff.ControlSweep(setup=setup, spectra=tuple(spectra), units={"V": "V"})
        rows.append(sweep.residuals(Prediction(np.tile(exact, 2)), 1.0) * sweep.sizes)
        scatter += [spectrum.sigmas[0] for spectrum in sweep.spectra]
    assert np.mean(scatter) > 1.4 * sigma
    away = np.tile(exact < 0.1 * sigma, 2)
    off = float(np.mean(np.array(rows)[:, away]))
    # by the scatter's noise the mean magnitude between the lines would be 0.05 too large
    assert abs(off) < 0.01


def coupling_error() -> float:
    """Standard deviation of the coupling: central differences of the closed form, scales free."""
    names = ("A0", "A1", "B0", "LAMBDA", "WIDTH")
    exact = np.array([crossing.response(crossing.SWEPT_HZ, v) for v in crossing.VOLTS])
    columns = []
    for name in names:
        here = getattr(crossing, name)
        sides = []
        for step in (1e-5, -1e-5):
            setattr(crossing, name, here * (1.0 + step))
            sides.append(
                np.array([crossing.response(crossing.SWEPT_HZ, v) for v in crossing.VOLTS])
            )
        setattr(crossing, name, here)
        columns.append(((sides[0] - sides[1]) / (2e-5 * here)).ravel())
    for k, row in enumerate(exact):
        alone = np.zeros_like(exact)
        alone[k] = row
        columns.append(alone.ravel())
    matrix = np.stack(columns, axis=1)
    size = np.linalg.norm(matrix, axis=0)
    covariance = np.linalg.inv((matrix / size).T @ (matrix / size)) * (NOISE * np.max(exact)) ** 2
    # declared: one standard deviation for all spectra, that of the largest
    return float(np.sqrt(covariance[3, 3]) / size[3])


def test_its_maps_are_what_a_report_shows_and_stand_in_plots(fit: ff.Fit) -> None:
    shown = shown_fit(fit.record)
    [figure] = shown.figures
    assert "5 spectra over V" in figure.alt
    assert "closest at V = " in figure.caption.replace("\u00a0", " ")
    assert any("law d1" in note for note in shown.notes)
    picture = draw_measurement(figure, shown)
    assert picture.stem == "control_sweep"
    assert [c for a in picture.drawn.axes for c in a.get_children() if isinstance(c, QuadMesh)]
    axes = Canvas().subplots()
    assert ff.plot.measurement(fit, "1_control_sweep", number=0, ax=axes) is axes
    cells = [c for c in axes.get_children() if isinstance(c, QuadMesh)]
    assert len(cells) == crossing.VOLTS.size
    amplitude = crossing.measured(3, NOISE)
    bar = cells[-1].colorbar
    assert bar is not None
    factor = {"mV": 1e-3, "V": 1.0, "µV": 1e-6}[bar.ax.get_ylabel().partition("(")[2].rstrip(")")]
    for drawn, row in zip(cells, amplitude, strict=True):
        assert factor * np.asarray(drawn.get_array()).ravel() == pytest.approx(1e6 * row, rel=1e-9)


def test_noise_is_told_by_the_scatter_of_each_spectrum() -> None:
    f = np.linspace(0.0, 1.0, 401) + 1.0
    smooth = np.exp(-((f - 1.5) ** 2) / 0.02)
    rng = np.random.default_rng(5)
    for sigma in (1e-3, 2e-2):
        found = ControlSpectrum(f, smooth + 1.0 + sigma * rng.standard_normal(401), {"V": 1.0})
        assert found.scatter() == pytest.approx(sigma, rel=0.2)
    assert ControlSpectrum(f[:20], smooth[:20], {"V": 1.0}).scatter() == 0.0


def test_harmonics_are_read_off_a_spectrum_of_a_square_wave() -> None:
    """Amplitudes 1/n of a Hann window's transform, whose lines fall between its bins."""
    step, fundamental, samples = 1e-4, 14.3, 4096
    t = step * np.arange(samples)
    wave = sum(np.cos(2 * np.pi * n * fundamental * t + n) / n for n in range(1, 200, 2))
    window = np.hanning(samples + 1)[:-1]
    amplitude = 2.0 * np.abs(np.fft.rfft(wave * window)) / np.sum(window)
    frequency_hz = np.asarray(np.fft.rfftfreq(samples, step)[:400], dtype=float)
    lines_hz, found, _ = odd_harmonics(frequency_hz, amplitude[:400], fundamental)
    n = lines_hz / fundamental
    assert n == pytest.approx(2.0 * np.arange(n.size) + 1.0)
    assert n.size > 30
    # the nearest bin alone is up to 15 % too low; the parabola leaves 2 %
    assert found * n == pytest.approx(np.ones(n.size), rel=0.03)


LINES = "V (mV),frequency (kHz),amplitude (mV)"


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (lambda t: t.replace('controls = ["V"]', 'controls = ["W"]'), "no column 'W'"),
        (lambda t: t.replace('controls = ["V"]', "controls = []"), "at least one column"),
        (lambda t: t.replace('"map.csv"', '"mop.csv"'), r"mop\.csv.*'map\.csv'"),
        (lambda t: t.replace('"V rms"', '"dBm"'), "wanted impedance"),
        (
            lambda t: t.replace("[control_sweep]", '[control_sweep]\ndrive = "1/g"'),
            "neither a column",
        ),
        (lambda t: t.replace("[control_sweep]", '[control_sweep]\ndrive = "f-2*f"'), "no positive"),
        (
            lambda t: t.replace("[control_sweep]", '[control_sweep]\nlines = "2 Hzz"'),
            "no unit 'Hzz'",
        ),
        (lambda t: t.replace("[control_sweep]", '[control_sweep]\nrange = ["1 Hz"]'), "1 value,"),
        (
            lambda t: t.replace("[control_sweep]", '[control_sweep]\nrange = ["1 Hz", "2 Hz"]'),
            "0 points .* 1 Hz to 2 Hz.* 8",
        ),
        (lambda t: t.replace("[control_sweep]", '[control_sweep]\nscale = "all"'), 'one of "each"'),
        (lambda t: t.replace("[control_sweep]", '[control_sweep]\noutput = "q9"'), "variable 'q9'"),
    ],
)
def test_what_is_wrong_with_its_table_is_told_in_a_sentence(
    change: Callable[[str], str], wanted: str, swift_fmu: Path, tmp_path: Path
) -> None:
    path = crossing.written(tmp_path, swift_fmu, crossing.measured(1, NOISE))
    before = path.read_text()
    path.write_text(change(before))
    assert path.read_text() != before
    with pytest.raises(BadInput, match=wanted) as told:
        ff.Problem.of(ff.read_campaign(path))
    assert len(told.value.args) in (1, crossing.VOLTS.size)  # one for each spectrum


@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        ("V (mV)", "V", "column 'V' has no unit"),
        ("V (mV)", "V (Hz)", "the law|adds"),
        ("amplitude (mV)", "amplitude (Hz)", "column 'amplitude'"),
        ("1.018", "0.5", "rising"),
        ("-3000.0,", "x,", "finite number"),
    ],
)
def test_what_is_wrong_with_its_file_is_told_in_a_sentence(
    old: str, new: str, wanted: str, swift_fmu: Path, tmp_path: Path
) -> None:
    path = crossing.written(tmp_path, swift_fmu, crossing.measured(1, NOISE))
    table = tmp_path / "map.csv"
    text = table.read_text()
    assert old in text
    table.write_text(text.replace(old, new, 1))
    with pytest.raises(BadInput, match=wanted):
        ff.Problem.of(ff.read_campaign(path))
