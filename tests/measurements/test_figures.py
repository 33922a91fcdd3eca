"""What tones and sweeps show of themselves: as data, and as any such description is drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure as Canvas

from fitting.campaign import Drive, Experiment, Setup, Spectrum
from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.measurements.sweep import Sweep
from fitting.measurements.tones import MOST_SPECTRA, Tones
from fitting.report.figures.measurements import draw_measurement
from fitting.report.shown import ShownCampaign
from tests.support import plots as plot

SETUP = Setup(Drive(input="b"), "q")
F_HZ = np.linspace(900.0, 1100.0, 81)


def damped_mode(f_hz: np.ndarray) -> np.ndarray:
    """A damped mode at 1000 Hz, 20 Hz wide, 1 mV at resonance."""
    return np.asarray(2e4 * 1e-3 / np.hypot(1e6 - f_hz**2, 20.0 * f_hz))


def experiment(k: int, *, spectrum: bool = False) -> Experiment:
    tones = (980.0 + k, 1020.0 + k)
    f = np.arange(950.0, 1050.0)
    return Experiment(
        label=f"pair{k}",
        settings={},
        tones_hz=tones,
        peaks_v=np.array([1e-3, 2e-3]),
        sigmas_v=np.array([1e-5, np.nan]),
        floor_v=2e-6 if spectrum else 0.0,
        spectrum=Spectrum(f, np.full(f.size, 2e-6)) if spectrum else None,
    )


def tones(count: int, **more: bool) -> Tones:
    return Tones(SETUP, tuple(experiment(k, **more) for k in range(count)))


def shown_by(measured: Tones) -> Figure:
    """Its figure where the model is 10 % too large before, and half as large after the fit."""
    (figure,) = measured.figures(1.1 * measured.peaks_v, 0.5 * measured.peaks_v)
    return figure


def test_every_experiment_stands_before_above_after() -> None:
    figure = shown_by(tones(7, spectrum=True))
    assert [len(row) for row in figure.rows] == [5, 5, 2, 2]
    assert [[p.when for p in row] for row in figure.rows[2:]] == [["before"] * 2, ["after"] * 2]
    before, after = figure.rows[2][1], figure.rows[3][1]
    assert before.title.splitlines() == ["pair6", "+10.0 %, +10.0 %"]
    assert after.title.splitlines() == ["pair6", "−50.0 %, −50.0 %"]
    (simulated,) = after.of(Role.SIMULATED)
    assert simulated.x == pytest.approx([986.0, 1026.0])
    assert simulated.y == pytest.approx([0.5e-3, 1e-3])
    spectrum, peaks = after.of(Role.MEASURED)
    assert peaks.y == pytest.approx([1e-3, 2e-3])
    assert spectrum.y == pytest.approx(np.full(100, 2e-6))
    assert "2 to 2 µV" in figure.caption
    assert "from 0.1 to 0.5" in figure.alt


def test_more_experiments_than_can_be_read_are_not_all_drawn() -> None:
    figure = shown_by(tones(MOST_SPECTRA + 3))
    assert len(figure.panels) == 2 * MOST_SPECTRA
    assert "20 of 23 experiments" in figure.caption


def test_tones_without_an_experiment_show_nothing() -> None:
    assert Tones(SETUP, ()).figures(np.empty(0), np.empty(0)) == ()


def test_a_sweep_shows_its_line_and_what_is_left() -> None:
    measured = Sweep(setup=SETUP, frequency_hz=F_HZ, amplitude_v=damped_mode(F_HZ), fitted=True)
    (figure,) = measured.figures(2.0 * measured.amplitude_v, 0.99 * measured.amplitude_v)
    upper, lower = figure.panels
    assert [layer.y[40] for layer in upper.of(Role.START)] == pytest.approx([2e-3])
    (left,) = lower.of(Role.SIMULATED)
    assert left.y == pytest.approx(-1e5 * 0.01 * damped_mode(F_HZ))  # % of the maximum, 1 mV
    assert "ratio of the maxima" in figure.caption
    rms = 100.0 * np.sqrt(np.mean((10.0 * damped_mode(F_HZ)) ** 2))
    assert f" {rms:.2g} % of" in figure.caption
    (width,) = [words for words in upper.notes if words.startswith("full width = ")]
    assert float(width.removeprefix("full width = ").split()[0]) == pytest.approx(20.0, rel=1e-6)


def test_a_sweep_without_a_line_says_so() -> None:
    ramp = np.linspace(1.0, 2.0, F_HZ.size)
    measured = Sweep(setup=SETUP, frequency_hz=F_HZ, amplitude_v=ramp, scaled_by="none")
    (figure,) = measured.figures(ramp, ramp)
    assert "no resonance" in figure.caption
    assert figure.panels[0].notes == ()
    assert "χ not scaled" in figure.caption


def campaign(**series: ShownCampaign) -> ShownCampaign:
    return ShownCampaign(title="together" if series else "alone", synthetic=False, series=series)


def test_panels_with_equal_axes_share_them_and_name_them_once() -> None:
    drawn = draw_measurement(shown_by(tones(7)), campaign()).drawn
    axes = [a for a in drawn.axes if a.get_visible()]
    assert len(axes) == 14
    assert len({a.get_xlim() for a in axes}) == len({a.get_ylim() for a in axes}) == 1
    named = [a.get_ylabel() for a in axes if a.get_ylabel()]
    assert named == [f"{when}: amplitude (mV)" for when in ("before", "after")] * 2
    below = [a for a in axes if a.get_xlabel()]
    assert [a.get_title().splitlines()[0] for a in below] == [f"pair{k}" for k in (2, 3, 4, 5, 6)]


def test_panels_above_each_other_move_together() -> None:
    measured = Sweep(setup=SETUP, frequency_hz=F_HZ, amplitude_v=damped_mode(F_HZ))
    (figure,) = measured.figures(measured.amplitude_v, 0.99 * measured.amplitude_v)
    upper, lower = draw_measurement(figure, campaign()).drawn.axes
    upper.set_xlim(3.0, 4.0)
    assert lower.get_xlim() == (3.0, 4.0)
    lower.set_ylim(-7.0, 7.0)
    assert upper.get_ylim() != (-7.0, 7.0)
    assert upper.get_xlabel() == ""
    assert "minus measured" in lower.get_ylabel()


def test_highest_peaks_are_inside() -> None:
    """Also where axes are shared with panels that are lower."""
    first, *others = tones(3).experiments
    high = replace(first, peaks_v=np.array([9e-3, 8e-3]))
    drawn = draw_measurement(shown_by(Tones(SETUP, (high, *others))), campaign()).drawn
    assert min(a.get_ylim()[1] for a in drawn.axes) > 9.9  # mV: simulated, before the fit


def test_a_series_of_several_has_its_own_title() -> None:
    figure = replace(shown_by(tones(1)), series="a")
    drawn = draw_measurement(figure, campaign(a=campaign()))
    assert drawn.stem == "spectra_a"
    suptitle = drawn.drawn.get_suptitle().splitlines()
    assert suptitle == [drawn.title.removesuffix(", a"), "alone"]
    assert drawn.title.endswith(", a")


def test_logarithmic_axes_are_read_without_powers() -> None:
    f = np.logspace(2.0, 6.0, 5)
    density = Layer(Role.MEASURED, Form.CURVE, f, 1e-9 * f**-0.5, sigma=1e-10 * f**-0.5)
    shown = Panel(
        x=Axis("frequency", "Hz", log=True), y=Axis("noise", "V", log=True), layers=(density,)
    )
    axes = plot.panel(shown, ax=Canvas().subplots())
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert axes.get_xlabel() == "frequency (kHz)"
    x = np.asarray(axes.get_lines()[0].get_xdata(), dtype=float)
    assert x == pytest.approx(1e-3 * f)
    assert axes.xaxis.get_major_formatter()(100.0) == "100"


def test_layers_of_unlike_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="differ"):
        Layer(Role.MEASURED, Form.POINTS, F_HZ, F_HZ[1:])
    with pytest.raises(ValueError, match=r"81 .* 2 sigmas"):
        Layer(Role.MEASURED, Form.POINTS, F_HZ, F_HZ, sigma=np.ones(2))
