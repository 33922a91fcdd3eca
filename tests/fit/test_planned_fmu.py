"""What drives an FMU besides a campaign is refused before anything is planned with it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from fitting.campaign import Drive, Experiment, Setup
from fitting.fit.problem import refuse_other_drives
from fitting.measurements.planning import Series
from fitting.measurements.tones import Tones
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from tests.support.line_workers import LineWorkers
from tests.support.whitened import parameter

DRIVE = Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2"))
STEADY = Setup(DRIVE, "x", steady_start=True, source="campaign.toml")
SETTLING = Setup(DRIVE, "x", line_width_hz=50.0, source="campaign.toml")


def asked(setup: Setup, hum: float, settings: Mapping[str, Scalar]) -> LineWorkers:
    """Refuses, or not, an FMU that hums at 50 Hz beside its two tones; what it was asked."""

    def output(t: FloatArray, values: Mapping[str, Scalar]) -> FloatArray:
        found = hum * np.cos(2.0 * np.pi * 50.0 * t)
        for f, a in (("u1", "A1"), ("u2", "A2")):
            found = found + float(values[a]) * np.cos(2.0 * np.pi * float(values[f]) * t)
        return np.asarray(found)

    one = Experiment(
        label="all",
        settings={"u1": 100.0, "u2": 130.0, **settings},
        tones_hz=(100.0, 130.0),
        peaks_v=np.ones(2),
        sigmas_v=np.zeros(2),
        floor_v=0.0,
        spectrum=None,
    )
    workers = LineWorkers({"x": output})
    series = Series((Tones(setup, (one,)),), (parameter("p", 0.0, 2.0),))
    refuse_other_drives(series, workers)  # type: ignore[arg-type]
    return workers


@pytest.mark.parametrize("settings", [{}, {"A1": 0.5, "A2": 2.0}])
@pytest.mark.parametrize("setup", [STEADY, SETTLING], ids=["steady", "settling"])
def test_an_output_that_moves_without_its_tones_is_refused(
    setup: Setup, settings: dict[str, Scalar]
) -> None:
    """From a ten-thousandth of the response on: it begins steady, or has been given its time."""
    with pytest.raises(BadInput, match=r"\[drive\]: 'x' "):
        asked(setup, 0.01, settings)
    silent, driven = asked(setup, 1e-5, settings).asked
    assert {silent.start_values[name] for name in ("A1", "A2")} == {0.0}
    assert driven.start_values["A1"] == settings.get("A1", 1.0)
    assert silent.settle_s == driven.settle_s
    assert (driven.settle_s > 0.0) is (setup is SETTLING)
