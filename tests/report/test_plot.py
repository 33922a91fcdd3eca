"""Every plot, drawn into axes of somebody else's: data and labels read back, no setting touched."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.text import Annotation

import fitting as ff
from fitting.result.result import SweepCurves
from tests.support import plot_records
from tests.support import plots as plot
from tests.support import report_records as records

DATA = records.campaign()
RESULT = records.result_for(DATA)
SPECTRA = records.spectra(DATA, RESULT)
KNOWN = plot_records.determined()
DRIVE, FRF, DESIGN = plot_records.drive_result(), plot_records.frf_result(), plot_records.design()
SWEEP, RESONANCE = (
    RESULT.sweep or SweepCurves(frequency_hz=(), measured_v=(), initial_v=(), final_v=()),
    records.RESONANCE,
)
NU = plot_records.nu_choice()

Draw = Callable[[Axes | None], Axes]
#: Every plot with the labels of its axes, x then y.
PLOTS: dict[str, tuple[Draw, str, str]] = {
    "against_prior": (
        lambda ax: plot.against_prior(NU, ax=ax),
        "ν",
        "value − reference, % of the box",
    ),
    "amplitude_spectrum": (
        lambda ax: plot.amplitude_spectrum(DRIVE, "q1", unit="V", ax=ax),
        "frequency − 6.94025 MHz (Hz)",
        "amplitude of q₁ (µV, peak)",
    ),
    "beating": (
        lambda ax: plot.beating(DRIVE, "q1", unit="V", ax=ax),
        "time − 0 s (ms)",
        "q₁ (µV)",
    ),
    "candidates": (
        lambda ax: plot.candidates(DESIGN, ax=ax),
        "expected σ(λ), average over equal fits (kHz)",
        "",
    ),
    "deviations": (
        lambda ax: plot.deviations(RESULT, drift_hz=DATA.drift_hz, ax=ax),
        "drive frequency f − 6.94026 MHz (Hz)",
        "relative deviation |χz − z*| / z*",
    ),
    "deviations_by_experiment": (
        lambda ax: plot.deviations_by_experiment(RESULT, ax=ax),
        "",
        "relative deviation\n|χz − z*| / z*",
    ),
    "discrepancy": (
        lambda ax: plot.discrepancy(NU, ax=ax),
        "ν",
        "χ²(ν) (dashed: what noise explains)",
    ),
    "drive_envelope": (
        lambda ax: plot.drive_envelope(DATA.tones[0], ax=ax),
        "time t (ms)",
        "drive, in the FMU's unit",
    ),
    "drive_periods": (
        lambda ax: plot.drive_periods(DATA.tones[0], ax=ax),
        "time t (µs)",
        "drive, in the FMU's unit",
    ),
    "expected_errors": (
        lambda ax: plot.expected_errors(DESIGN, ax=ax),
        "measured one after the other",
        "σ(λ) (kHz)",
    ),
    "frequency_response": (
        lambda ax: plot.frequency_response(SWEEP, resonance=RESONANCE, ax=ax),
        "drive frequency f − 6.9403 MHz (Hz)",
        "amplitude (µV)",
    ),
    "improvement": (
        lambda ax: plot.improvement(RESULT, ax=ax),
        "drive frequency f − 6.94026 MHz (Hz)",
        "final / initial deviation (%)",
    ),
    "l_curve": (lambda ax: plot.l_curve(NU, ax=ax), "J_fit", "distance from the prior |x|"),
    "objective_path": (
        lambda ax: plot.objective_path(RESULT, ax=ax),
        "ν",
        "terms of the objective",
    ),
    "output": (
        lambda ax: plot.output(KNOWN, "lambda", "d1", ax=ax),
        "d₁ (kHz)",
        "λ (kHz)",
    ),
    "output_by_experiment": (
        lambda ax: plot.output_by_experiment(RESULT, "D11", DATA.labels, ax=ax),
        "",
        "D₁₁ (1/s)",
    ),
    "output_path": (
        lambda ax: plot.output_path(RESULT, "D11", ax=ax),
        "ν",
        "⟨D₁₁⟩ (1/s)",
    ),
    "panel": (
        lambda ax: plot.panel(SPECTRA.rows[1][0], ax=ax),
        "f − 6.94026 MHz (Hz)",
        "after: amplitude (µV)",
    ),
    "parameter_path": (
        lambda ax: plot.parameter_path(RESULT, "d1", ax=ax),
        "ν",
        "d₁ − 93.7 Hz (mHz)",
    ),
    "periods": (
        lambda ax: plot.periods(DRIVE, "q1", unit="V", ax=ax),
        "time − 0 s (ns)",
        "q₁ (µV)",
    ),
    "profile": (
        lambda ax: plot.profile(*plot_records.profile(), ax=ax),
        "d₁ (Hz)",
        "Δχ²",
    ),
    "residuals": (
        lambda ax: plot.residuals(RESULT, ax=ax),
        "",
        "residual after the fit\n(χz − z*) / σ",
    ),
    "swept_tone": (
        lambda ax: plot.swept_tone(FRF, unit="V", ax=ax),
        "frequency u₁ − 6.94030 MHz (Hz)",
        "amplitude (µV, peak)",
    ),
    "together": (
        lambda ax: plot.together(KNOWN, "d1", "d2", ax=ax),
        "d₁ (kHz)",
        "d₂ (kHz)",
    ),
}


@pytest.fixture
def axes() -> Iterator[Axes]:
    pyplot.close("all")  # what other tests of this process left open
    _, made = pyplot.subplots()
    yield made
    pyplot.close("all")


def drawn(name: str, axes: Axes) -> Axes:
    return PLOTS[name][0](axes)


def line(axes: Axes, label: str) -> tuple[np.ndarray, np.ndarray]:
    """x and y of the line with that label."""
    found = next(one for one in axes.get_lines() if one.get_label() == label)
    return np.asarray(found.get_xdata(), dtype=float), np.asarray(found.get_ydata(), dtype=float)


def test_every_plot_is_drawn_here() -> None:
    assert sorted(PLOTS) == sorted(plot.__all__)


@pytest.mark.parametrize("name", list(PLOTS))
def test_axes_that_are_given_are_drawn_into_and_labelled(name: str, axes: Axes) -> None:
    before = dict(mpl.rcParams)
    assert drawn(name, axes) is axes
    assert dict(mpl.rcParams) == before
    assert axes.has_data()
    assert (axes.get_xlabel(), axes.get_ylabel()) == PLOTS[name][1:]
    assert len(pyplot.get_fignums()) == 1
    axes.figure.canvas.draw()


@pytest.mark.parametrize("name", list(PLOTS))
def test_without_axes_the_current_ones_are_taken(name: str, axes: Axes) -> None:
    assert PLOTS[name][0](None) is axes


@pytest.mark.parametrize("name", list(PLOTS))
def test_every_plot_says_what_it_takes(name: str) -> None:
    function = getattr(plot, name)
    words = inspect.getdoc(function) or ""
    assert all(f"    {key}: " in words for key in inspect.signature(function).parameters)


@pytest.mark.parametrize("name", ["deviations", "frequency_response", "panel", "objective_path"])
def test_nothing_is_drawn_in_the_colour_of_the_paper(name: str) -> None:
    with mpl.style.context("dark_background"):
        _, axes = pyplot.subplots()
        drawn(name, axes)
        paper = to_rgb(axes.get_facecolor())
        for one in axes.get_lines():
            assert to_rgb(one.get_color()) != paper
        pyplot.close("all")


def test_spectrum_joins_measured_and_simulated(axes: Axes) -> None:
    drawn("panel", axes)
    f, a = line(axes, "measured spectrum")
    tops = records.lorentzian_v(np.array(records.PAIRS_HZ[0])) * 1e6
    assert a[np.isin(np.round(f), (-100.0, 100.0))] == pytest.approx(tops)
    simulated = [e for e in axes.get_lines() if e.get_marker() == "o" and len(e.get_xdata()) == 2]  # type: ignore[arg-type]
    assert np.asarray(simulated[0].get_ydata()) == pytest.approx(tops * (1.01, 0.99))
    assert axes.get_title() == "pair1\n+1.00 %, −1.00 %"


def test_residuals_are_in_standard_deviations(axes: Axes) -> None:
    drawn("residuals", axes)
    points = [e for e in axes.get_lines() if len(e.get_xdata()) == 1]  # type: ignore[arg-type]
    expected = [(p.final_v - p.measured_v) / records.SIGMA_V for p in RESULT.peaks]
    assert [float(np.asarray(e.get_ydata())[0]) for e in points] == pytest.approx(expected)


def test_the_response_and_what_is_left_of_it(axes: Axes) -> None:
    drawn("frequency_response", axes)
    _, measured = line(axes, "measured")
    assert measured.max() == pytest.approx(1e6 * records.TOP_V, rel=2e-3)


def test_a_profile_shows_its_interval_and_thresholds(axes: Axes) -> None:
    drawn("profile", axes)
    x, y = line(axes, "profile")
    assert x == pytest.approx([94.0 + 2.5 * s for s in (-2, -1, 0, 1, 2)])  # 3 sigma is beyond
    assert y == pytest.approx([4.0, 1.0, 0.0, 1.0, 4.0])
    (band,) = axes.patches
    extent = band.get_extents().transformed(axes.transData.inverted())
    assert (extent.x0, extent.x1) == pytest.approx((89.1, 98.9))
    assert axes.get_title(loc="left") == "d₁: determined"


def test_points_that_fit_are_told_from_those_that_do_not(axes: Axes) -> None:
    drawn("together", axes)
    x, y = line(axes, "fits (Δχ² ≤ 3.84)")
    assert 1e3 * (x + y) == pytest.approx(200.0)
    assert sorted(set(np.round(1e3 * x, 6))) == [91.5, 94.0, 96.5]
    assert len(line(axes, "does not fit")[0]) == 3 * 4  # each profile: 2 and 3 sigma, both sides


def test_one_period_of_what_goes_round_is_not_framed_as_its_box(axes: Axes) -> None:
    wide = {n: replace(p, lower=80.0, upper=120.0) for n, p in KNOWN.parameters.items()}
    plot.together(replace(KNOWN, parameters=wide), "d1", "d2", ax=axes)
    assert sorted(edges(axes)) == ["x 120", "x 80", "y 120", "y 80"]
    axes.clear()
    wide["d1"] = replace(wide["d1"], closed_by=("periodic", "periodic"))
    plot.together(replace(KNOWN, parameters=wide), "d1", "d2", ax=axes)
    assert sorted(edges(axes)) == ["y 120", "y 80"]


def edges(axes: Axes) -> list[str]:
    """Grey lines from edge to edge: the axis, and where they stand on it."""
    found = []
    for letter, whole, data in (
        ("x", axes.get_xaxis_transform(which="grid"), "get_xdata"),
        ("y", axes.get_yaxis_transform(which="grid"), "get_ydata"),
    ):
        lines = (line for line in axes.get_lines() if line.get_transform() == whole)
        found += [f"{letter} {getattr(line, data)()[0]:g}" for line in lines]
    return found


def test_a_spectrum_names_its_tones_with_their_peaks(axes: Axes) -> None:
    drawn("amplitude_spectrum", axes)
    labels = axes.get_legend_handles_labels()[1]
    assert "6.94016 MHz: 3 µV" in labels
    assert "6.94036 MHz: 2 µV" in labels


def test_a_jump_is_marked_between_the_points_where_it_happens(axes: Axes) -> None:
    drawn("swept_tone", axes)
    (note,) = axes.findobj(Annotation)
    assert note.get_text() == "upward jump"
    assert note.xy[0] == pytest.approx(50.0)
    assert line(axes, "upward")[1] == pytest.approx([1.0, 2.0, 4.0, 1.0, 0.5])


def test_a_drive_of_equal_tones_beats_between_zero_and_their_sum(axes: Axes) -> None:
    drawn("drive_envelope", axes)
    outline = np.asarray(axes.collections[0].get_paths()[0].vertices)
    assert outline[:, 1].max() == pytest.approx(2.0)
    assert axes.get_xlim() == pytest.approx((0.0, 10.0))  # ms: two beats of 200 Hz


def test_a_design_is_drawn_in_the_unit_of_its_target(axes: Axes) -> None:
    drawn("expected_errors", axes)
    assert line(axes, "average over equal fits")[1] == pytest.approx([1.1, 0.11])
    axes.clear()
    drawn("candidates", axes)
    assert line(axes, "as the last, with the other proposed ones")[0] == pytest.approx([0.11])


def test_a_single_tone_has_no_beating() -> None:
    alone = plot_records.drive_result()
    object.__setattr__(alone, "beating", None)
    with pytest.raises(ValueError, match="no beating"):
        plot.beating(alone, "q1")


def test_without_names_the_parameters_of_the_first_unit_are_drawn(axes: Axes) -> None:
    ff.plot.parameter_path(RESULT, ax=axes)
    units = [p.unit for p in RESULT.parameters.values()]
    assert len(axes.get_legend_handles_labels()[1]) == units.count(units[0])
