"""Three modes over a voltage: both neighbouring couplings, in physical coordinates."""

from __future__ import annotations

import numpy as np
import pytest

import fitting as ff
from fitting.measurements.figure import Axis
from fitting.measurements.maps import ControlMaps, MappedSpectrum
from fitting.text.arrays import FloatArray

pytestmark = pytest.mark.usefixtures("swift_models")

#: f1 follows the voltage, f2 and f3 do not; couplings and width, all Hz.
A0, A1, F2, F3, WIDTH = 1000.0, 8.0, 1000.0, 1012.0, 2.0
COUPLINGS = {"lambda12": 90.0, "lambda23": 110.0}
VOLTS = np.array([-1.5, 0.0, 1.5])
SWEPT_HZ = np.linspace(980.0, 1032.0, 45)
NOISE = 0.01


def response(u_hz: FloatArray, volt: float) -> FloatArray:
    """|q1| under a force on the first mode, from the equations of motion."""
    square = np.diag(np.array([A0 + A1 * volt, F2, F3]) ** 2)
    square[0, 1] = square[1, 0] = -(COUPLINGS["lambda12"] ** 2)
    square[1, 2] = square[2, 1] = -(COUPLINGS["lambda23"] ** 2)
    w = 2 * np.pi * u_hz[:, None, None]
    system = (2 * np.pi) ** 2 * square - (w**2 - 2j * np.pi * WIDTH * w) * np.eye(3)
    force = np.broadcast_to(np.array([[1.0], [0.0], [0.0]]), (u_hz.size, 3, 1))
    return np.asarray(np.abs(np.linalg.solve(system, force)[:, 0, 0]))


def test_both_neighbouring_couplings_are_found() -> None:
    rng = np.random.default_rng(11)
    spectra = []
    for volt in VOLTS:
        exact = response(SWEPT_HZ, volt)
        sigma = NOISE * float(np.max(exact))
        noisy = np.abs(exact + sigma * rng.standard_normal(exact.size))
        spectra.append(ff.ControlSpectrum(SWEPT_HZ, noisy, {"V": float(volt)}, sigma=sigma))
    setup = ff.Setup(
        ff.Drive(frequency_names=("u1",), amplitude_names=("A1",)),
        "q1",
        start_values={"periodic_start": True, "A2": 0.0, "g2": 0.0, "g3": 0.0, "f3": F3},
        steady_start=True,
        laws=ff.Laws({"f1": "a0 + a1*V", "f2": "a0", "d2": "d1", "d3": "d1"}),
    )
    with ff.Fmu("CoupledModes3", 2) as fmu:
        problem = ff.Problem(
            fmu,
            [
                ff.Parameter("a0", "1000.5 Hz", bounds=("990 Hz", "1010 Hz")),
                ff.Parameter("a1", 7.0, bounds=(1.0, 20.0), unit="Hz/V"),
                ff.Parameter("lambda12", 80.0, bounds=(10.0, 200.0)),
                ff.Parameter("lambda23", 120.0, bounds=(10.0, 200.0)),
                ff.Parameter("d1", 3.0, bounds=(0.5, 20.0)),
            ],
            ff.ControlSweep(setup=setup, spectra=tuple(spectra), units={"V": "V"}, unit="m"),
        )
        fit = ff.fit(problem, ff.Tikhonov(nu=1e-3, misfit="squares", levels=1), starts=1)
        rows = problem.residuals([A0, A1, *COUPLINGS.values(), WIDTH])
    assert fit.success
    # at the truth the rows are the noise, but for the scale that each spectrum is solved for
    assert np.std(rows) == pytest.approx(NOISE, rel=0.15)
    for name, truth in COUPLINGS.items():
        found = fit.result.parameters[name]
        assert abs(found.value - truth) < 4.0 * found.std
        assert found.std < 0.05 * truth


def maps_of(lines: list[tuple[float, ...]]) -> ControlMaps:
    """Narrow lines in spectra at 0 V, 1 V and so on."""
    u = np.linspace(0.0, 60.0, 1201)
    spectra = []
    for volt, centres in enumerate(lines):
        response = np.sum([np.exp(-4.0 * (u - f) ** 2) for f in centres], axis=0)
        spectra.append(
            MappedSpectrum(
                label=f"{volt} V",
                settings={"V": float(volt)},
                frequency_hz=u,
                measured=response,
                fitted=response,
                left=0.0 * u,
                response=response,
            )
        )
    return ControlMaps(
        spectra=tuple(spectra), units={"V": "V"}, amplitude=Axis("a", ""), rest=Axis("r", "")
    )


def test_each_gap_between_neighbours_is_told_where_it_is_least() -> None:
    """The lower two lines meet at 1 V, 3 Hz apart, the upper two at 4 V: 30 Hz - 19 Hz."""
    lines = [(10.0, 13.0 + 2.0 * abs(v - 1.0), 30.0 + 3.0 * abs(v - 4.0)) for v in range(6)]
    said = maps_of([*lines]).figure.caption.replace("\u00a0", " ")
    assert "V = 1 V, 3 Hz" in said
    assert "3 Hz at V = 1 V" in said
    assert "11 Hz at V = 4 V" in said
    of_two = maps_of([each[:2] for each in lines]).figure.caption.replace("\u00a0", " ")
    assert "3 Hz at V = 1 V" not in of_two
