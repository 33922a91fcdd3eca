"""Few sweeps over a control are drawn as lines: points, curve, openings and residuals."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.measurements.figure import Axis, Role
from fitting.measurements.maps import ControlMaps, MappedSpectrum, lines_figure

F_HZ = 7e6 + np.linspace(-500.0, 500.0, 41)


def line(centre_hz: float) -> np.ndarray:
    return np.asarray(1.0 / np.hypot(1.0, 2.0 * (F_HZ - centre_hz) / 90.0))


def spectrum(label: str, volts: float, *centres_hz: float) -> MappedSpectrum:
    fitted = np.sum([line(7e6 + centre) for centre in centres_hz], axis=0)
    measured = fitted + 0.01
    return MappedSpectrum(
        label=label,
        settings={"volts": volts},
        frequency_hz=F_HZ,
        measured=measured,
        fitted=fitted,
        left=(fitted - measured) / 0.02,
        response=fitted,
    )


def test_each_sweep_has_a_panel_with_its_opening() -> None:
    spectra = (spectrum("0 V", 0.0, 3.0), spectrum("1 V", 1.0, -183.0, 191.0))
    rest = Axis("simulated - measured", "σ", low=-0.5, high=0.5)
    maps = ControlMaps(spectra=spectra, units={"volts": "V"}, amplitude=Axis("a", "V"), rest=rest)
    figure = lines_figure(maps)
    (still, pumped), (_, below) = figure.rows
    assert [panel.title for panel in (still, pumped)] == ["0 V", "1 V"]
    # one line is not marked; of two the maxima are, to a Hz between points 25 Hz apart
    assert not still.marked
    assert pumped.marked == pytest.approx([7e6 - 183.0, 7e6 + 191.0], abs=4.0)
    [measured], [curve] = pumped.of(Role.MEASURED), pumped.of(Role.SIMULATED)
    assert np.array_equal(measured.y, spectra[1].measured)
    assert np.interp(F_HZ, curve.x, curve.y) == pytest.approx(spectra[1].fitted, abs=1e-12)
    assert curve.x.size > 10 * F_HZ.size
    assert below.layers[0].y == pytest.approx(np.full(41, -0.5))
    assert below.y.high is not None
    assert below.y.high > 0.5
