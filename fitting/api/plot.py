"""Plots of fits, inferences, values and records, each into given axes, which it returns.

profile               the profile likelihood of a value: `profile(result, "lambda")`
parameter_path        parameters over the weight nu of the Tikhonov term
objective_path        J_fit and J_reg over nu
residuals             residuals of the peaks, in standard deviations
deviations            relative deviations of the peaks, before and after
frequency_response    a sweep, measured and simulated
line                  one resonance, measured and fitted, of `ff.line`
swept_tone            a simulated sweep, each way
amplitude_spectrum    the spectrum of a simulated drive
beating               its envelope over two beats
periods               some of its periods
measurement           a measurement next to the model's values: a panel of its own figure
drive_envelope        the envelope of an experiment's drive
drive_periods         some periods of it
candidates            the expected error of a design's target, by kinds of candidates
expected_errors       the same, measurement by measurement

They compute and save nothing, and keep any style.
"""

from __future__ import annotations

import importlib
import re
from typing import TYPE_CHECKING

from fitting.api.fitted import Inference, Value, Valued
from fitting.lines.record import MeasuredLine
from fitting.measurements.figure import Figure
from fitting.report.figures import fit, inference, measurements, tones
from fitting.report.figures.simulate import (
    amplitude_spectrum,
    beating,
    drive_envelope,
    drive_periods,
    periods,
    swept_tone,
)
from fitting.report.figures.style import Axes
from fitting.report.shown import figures_of
from fitting.resonance.figure import figure_of
from fitting.result.result import Result
from fitting.text.errors import BadInput
from fitting.text.old_names import renamed

if TYPE_CHECKING:
    from fitting.design.figure import candidates, expected_errors

__all__ = [
    "amplitude_spectrum",
    "beating",
    "candidates",
    "deviations",
    "drive_envelope",
    "drive_periods",
    "expected_errors",
    "frequency_response",
    "line",
    "measurement",
    "objective_path",
    "parameter_path",
    "periods",
    "profile",
    "residuals",
    "swept_tone",
]


#: Plots of optional packages, by the module that is loaded when they are first used.
_HOMES = {"candidates": "fitting.design.figure", "expected_errors": "fitting.design.figure"}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'fitting.plot' has no attribute '{name}'")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__


@renamed
def profile(result: Inference | Value, name: str = "", *, ax: Axes | None = None) -> Axes:
    """Draw a profile likelihood: the least Δχ² of fits at each value.

    Args:
        result: An inference, or one of its values; drawn in its unit.
        name: Which value; empty: the only one with a profile.
        ax: Where to draw; None: pyplot's current axes.

    Raises:
        BadInput: a value that there is not, or whose profile was not scanned.
    """
    if isinstance(result, Valued):
        scanned = [key for key, value in result.values.items() if value.scan is not None]
        name = scanned[0] if not name and len(scanned) == 1 else name
        if name not in scanned:
            known = f"one of {', '.join(scanned)}" if scanned else "what fitting.profile returns"
            raise BadInput(f"plot: no profile of '{name}', wanted {known}")
        result = result[name]
    if result.scan is None:
        raise BadInput(f"plot: '{result!r}' has no profile, wanted a value of fitting.profile(fit)")
    return inference.profile(result, result.scan, ax=ax)


@renamed
def parameter_path(result: Valued | Result, *names: str, ax: Axes | None = None) -> Axes:
    """Draw parameters over the weight nu of the Tikhonov term.

    Args:
        result: A fit, an inference, or a result.
        names: Of parameters of one unit; none: all that have the unit of the first.
        ax: Where to draw; None: pyplot's current axes.
    """
    record = _result(result)
    units = {name: p.unit for name, p in record.parameters.items()}
    first = next(iter(units.values()))
    alike = (name for name, unit in units.items() if unit == first)
    return fit.parameter_path(record, *(names or alike), ax=ax)


@renamed
def objective_path(result: Valued | Result, *, ax: Axes | None = None) -> Axes:
    """Draw J_fit and J_reg over the weight nu of the Tikhonov term.

    Args:
        result: A fit, an inference, or a result.
        ax: Where to draw; None: pyplot's current axes.
    """
    return fit.objective_path(_result(result), ax=ax)


def _with_peaks(fitted: Valued | Result) -> Result:
    result = _result(fitted)
    if not result.peaks:
        raise BadInput("plot: there are no peaks, only a sweep; wanted the result of Tones")
    return result


@renamed
def residuals(result: Valued | Result, *, ax: Axes | None = None) -> Axes:
    """Draw the residuals of the peaks, in standard deviations.

    Args:
        result: A fit, an inference, or a result.
        ax: Where to draw; None: pyplot's current axes.

    Raises:
        BadInput: there are no peaks.
    """
    return tones.residuals(_with_peaks(result), ax=ax)


@renamed
def deviations(result: Valued | Result, *, ax: Axes | None = None) -> Axes:
    """Draw the relative deviations of the peaks over frequency, before and after.

    Args:
        result: A fit, an inference, or a result.
        ax: Where to draw; None: pyplot's current axes.

    Raises:
        BadInput: there are no peaks.
    """
    return tones.deviations(_with_peaks(result), ax=ax)


@renamed
def measurement(result: Valued, name: str = "", *, number: int = 0, ax: Axes | None = None) -> Axes:
    """Draw a measurement next to the model's values: a panel of its own figure, as in the report.

    Args:
        result: A fit or an inference.
        name: Of the figure's file in the report, with its number or without ("spectra", with the
            series if there are several); empty: the first.
        number: Of the panel, from 0, row by row.
        ax: Where to draw; None: pyplot's current axes.

    Raises:
        BadInput: there is no such figure, or no such panel of it.
    """
    if not isinstance(result, Valued):
        raise BadInput(f"plot: a {type(result).__name__}, wanted a fit, or what was inferred of it")
    figures = {figure.stem: figure for figure in figures_of(result.source.record)}
    if name not in figures:
        name = re.sub(r"^\d+_", "", name)
    if not figures or (name and name not in figures):
        raise BadInput(f"plot: no figure '{name}', wanted one of {', '.join(figures) or 'none'}")
    return _panel(figures[name or next(iter(figures))], number, ax)


@renamed
def frequency_response(result: Valued | Result, *, ax: Axes | None = None) -> Axes:
    """Draw the sweep, measured and simulated.

    Args:
        result: A fit, an inference, or a result, with one sweep.
        ax: Where to draw; None: pyplot's current axes.

    Raises:
        BadInput: there is no sweep, or one for each of several series.
    """
    curves = _result(result).sweep
    if curves is None:
        raise BadInput("plot: the result has no sweep of its own, wanted one with a single sweep")
    return measurements.frequency_response(curves, ax=ax)


@renamed
def line(result: MeasuredLine, *, number: int = 0, ax: Axes | None = None) -> Axes:
    """Draw one resonance: measured points and the fitted line.

    Args:
        result: Of `fitting.line`, `fitting.ringdown` or `fitting.noise_line`.
        number: Of the panel: 0 the measured values, the last the residuals in % of the line's
            height, between them the phase of complex values.
        ax: Where to draw; None: pyplot's current axes.

    Raises:
        BadInput: it is no such result, or there is no such panel.
    """
    if not isinstance(result, MeasuredLine):
        raise BadInput(f"plot: found a {type(result).__name__}, wanted what fitting.line returns")
    return _panel(figure_of(result), number, ax)


def _panel(figure: Figure, number: int, ax: Axes | None) -> Axes:
    panels = figure.panels
    if not -len(panels) <= number < len(panels):
        raise BadInput(f"plot: no panel {number}, there are {len(panels)}, counted from 0")
    return measurements.panel(panels[number], among=panels, ax=ax)


def _result(result: Valued | Result) -> Result:
    return result.result if isinstance(result, Valued) else result
