"""A constant beside the amplitudes of a sweep, solved inside: against numpy's least squares."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.campaign import Drive, Setup
from fitting.measurements.measurement import Prediction
from fitting.measurements.sweep import Sweep
from fitting.text.errors import BadInput
from tests.support.lines import mode, noise

F_HZ = 1e6 + np.linspace(-500.0, 500.0, 41)
SEEN = 3e-3 * np.abs(mode(F_HZ, 1e6, 200.0)) + 0.4e-3 + noise(F_HZ.size, 2e-5, 1).real
SETUP = Setup(Drive(input="b"), "q")


def sweep(scale: str = "fit", background: str = "offset") -> Sweep:
    return Sweep(
        setup=SETUP,
        frequency_hz=F_HZ,
        amplitude_v=SEEN,
        fitted=True,
        scaled_by=scale,
        background=background,
    )


@pytest.mark.parametrize(("background", "count"), [("offset", 1), ("slope", 2)])
def test_scale_and_background_are_those_of_least_squares(background: str, count: int) -> None:
    simulated = 7.0 * np.abs(mode(F_HZ, 1e6 + 10.0, 230.0))
    columns = np.column_stack([simulated, np.ones_like(F_HZ), F_HZ - 1e6])[:, : 1 + count]
    (chi, *beside), *_ = np.linalg.lstsq(columns, SEEN, rcond=None)
    measured, seen = sweep(background=background), Prediction(simulated)
    scale = measured.scale(seen)
    assert scale is not None
    assert scale.value == pytest.approx(chi, rel=1e-9)
    added = columns[:, 1:] @ beside
    np.testing.assert_allclose(measured.offset(seen, scale.value), added, rtol=1e-9)
    left = (columns @ [chi, *beside] - SEEN) / measured.maximum_v
    np.testing.assert_allclose(measured.residuals(seen, scale.value), left, atol=1e-12)
    assert measured.solved_inside == measured.solved_columns(seen).shape[1] == count


@pytest.mark.parametrize("background", ["offset", "slope"])
@pytest.mark.parametrize("factor", [1.001, 0.999])
def test_rows_follow_the_scale_as_they_say(factor: float, background: str) -> None:
    """dr/d ln chi = r + measured, with the background that follows chi: linear in chi."""
    simulated = Prediction(np.abs(mode(F_HZ, 1e6, 230.0)))
    measured, chi = sweep("free", background), 3e-3
    here, there = (measured.residuals(simulated, c) for c in (chi, factor * chi))
    slope = here + measured.measured_rows
    np.testing.assert_allclose(there - here, (factor - 1.0) * slope, atol=1e-12)


def test_a_line_elsewhere_keeps_its_scale_positive() -> None:
    elsewhere = Prediction(np.abs(mode(F_HZ, 1e6 + 5000.0, 200.0)))
    scale = sweep().scale(elsewhere)
    assert scale is not None
    assert scale.value > 0.0


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"use": "scale"}, 'use = "fit"'),
        ({"scale": "maximum"}, 'found "maximum"'),
        ({"scale": "robust"}, 'found "robust"'),
    ],
)
def test_what_a_constant_wants_is_told(keys: dict[str, str], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        ff.Sweep(SETUP, F_HZ, SEEN, background="offset", **keys)  # type: ignore[arg-type]


def test_a_campaign_that_lacks_it_names_the_key(tmp_path: Path) -> None:
    text = '[sweep]\nfile = "x.csv"\namplitude = "V peak"\nbackground = "offset"\n'
    (tmp_path / "campaign.toml").write_text(text, "utf-8")
    with pytest.raises(BadInput) as found:
        ff.read_campaign(tmp_path / "campaign.toml")
    assert any("background" in line and 'use = "fit"' in line for line in found.value.args)
