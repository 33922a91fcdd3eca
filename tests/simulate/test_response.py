"""What is read of a drive against the lines that its response was made of."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from fitting.simulate.budget import Budget
from fitting.simulate.drive import Drive
from fitting.simulate.planner import DrivePlan, plan_drives
from fitting.simulate.probe import Knowledge
from fitting.simulate.response import DriveResponse, RemainderKind, Shown, respond
from fitting.text.errors import BadInput
from tests.support.line_workers import LineWorkers, Output, line, together

TONES = (1000.0, 1010.0)
CLEAN: Output = together(line(1000.0, 3.0, 0.4), line(1010.0, 2.0))


def drive_of(tones: tuple[float, ...], *outputs: str) -> Drive:
    return Drive(start_values={"a": 1.0}, tones_hz=tones, outputs=outputs)


def plan_of(tones: tuple[float, ...], outputs: Mapping[str, Output], accuracy: float) -> DrivePlan:
    drive = drive_of(tones, *outputs)
    return plan_drives((drive,), accuracy, LineWorkers(outputs), Knowledge())


def response_to(
    outputs: Mapping[str, Output],
    *,
    tones: tuple[float, ...] = TONES,
    planned: Output = CLEAN,
    accuracy: float = 1e-6,
    shown: Shown | None = None,
) -> DriveResponse:
    """What is read of these outputs by a plan that was made where there was nothing but the tones.

    All of them were planned as that response, those that do not oscillate as they are.
    """
    own = {name: output if name == "flat" else planned for name, output in outputs.items()}
    return respond(LineWorkers(outputs), plan_of(tones, own, accuracy), shown)


def test_tones_come_back_with_what_does_not_oscillate() -> None:
    found = response_to({"x": CLEAN, "flat": lambda t, _: np.full(t.size, 7.0)})
    assert found.peaks[:, 0] == pytest.approx([3.0, 2.0], rel=1e-9)
    assert found.constants == {"flat": 7.0}
    assert found.lines == ()
    assert found.remainder.kind is RemainderKind.ROUNDING
    assert math.isnan(found.remainder.at_hz)
    assert found.steady
    assert found.accuracy == found.plan.promised <= 1e-6
    assert found.drive.start_values == {"a": 1.0, **found.plan.settings}


@pytest.mark.parametrize("shown", [Shown(), Shown(window_s=0.7), Shown(samples=3000)])
def test_the_spectrum_has_the_tones_alone_on_their_bins(shown: Shown) -> None:
    spectrum = response_to({"x": CLEAN}, shown=shown).spectrum
    f, a = spectrum.frequencies_hz, spectrum.amplitudes[:, 0]
    assert spectrum.coherent
    assert spectrum.window_s == pytest.approx(shown.window_s or 0.5)  # five beats
    assert f.size == spectrum.samples // 2 + 1
    if shown.samples:
        assert spectrum.samples == 3000
    assert np.all(np.diff(f) > 0.0)
    places = [int(np.argmin(np.abs(f - tone))) for tone in TONES]
    assert f[places] == pytest.approx(TONES, rel=1e-12)
    assert a[places] == pytest.approx([3.0, 2.0], rel=1e-9)
    assert np.max(np.delete(a, places)) < 1e-9
    settle = 0.0
    rounding = 2.0 * math.pi * 1010.0 * (settle + spectrum.window_s) * np.finfo(float).eps
    assert spectrum.rounding / rounding == pytest.approx(1.0)


@pytest.mark.parametrize("samples", [300, 240])
def test_an_odd_zone_is_shown_the_right_way_round(samples: int) -> None:
    """500 periods are in the fourth half of 300 samples and in the fifth of 240."""
    spectrum = response_to({"x": CLEAN}, shown=Shown(window_s=0.5, samples=samples)).spectrum
    f = spectrum.frequencies_hz
    assert np.all(np.diff(f) > 0.0)
    assert f[int(np.argmax(spectrum.amplitudes[:, 0]))] == pytest.approx(1000.0)


def test_a_combination_that_stands_out_is_told_with_its_factors() -> None:
    """A cubic response has 2 f1 - f2 = 990 and 2 f2 - f1 = 1020 Hz."""
    mixed = together(CLEAN, line(990.0, 3e-3), line(1020.0, 6e-3), line(980.0, 1e-7))
    found = response_to({"x": mixed})
    assert [(each.factors, each.frequency_hz) for each in found.lines] == [
        ((2, -1), 990.0),
        ((-1, 2), 1020.0),
    ]
    assert [float(each.amplitudes[0]) for each in found.lines] == pytest.approx(
        [3e-3, 6e-3], rel=1e-6
    )
    assert found.remainder.kind is RemainderKind.COMBINATION
    assert found.remainder.share == pytest.approx(6e-3 / 3.0, rel=1e-6)
    assert found.remainder.at_hz == pytest.approx(1020.0)
    assert found.remainder.explained
    assert found.steady


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize(("share", "told"), [(1.3e-6, True), (0.8e-6, False)])
def test_a_combination_is_told_from_a_millionth_of_the_largest_peak_on(
    share: float, told: bool, unit: float
) -> None:
    """Of 3, whatever the unit: neither of the smaller peak nor of one."""
    clean = together(line(1000.0, 3.0 * unit, 0.4), line(1010.0, 2.0 * unit))
    mixed = together(clean, line(990.0, 3.0 * unit * share))
    lines = response_to({"x": mixed}, planned=clean).lines
    assert [each.factors for each in lines] == ([(2, -1)] if told else [])


@pytest.mark.parametrize(
    ("share", "kind"),
    [
        (1e-3, RemainderKind.UNEXPLAINED),
        (1.2e-6, RemainderKind.UNEXPLAINED),
        (0.8e-6, RemainderKind.SMALL),
        (1.2e-8, RemainderKind.SMALL),
        (0.8e-8, RemainderKind.ROUNDING),
    ],
)
def test_a_line_elsewhere_is_told_from_a_millionth_on(share: float, kind: RemainderKind) -> None:
    """One tone of 1000 Hz, and a line at half of it, which is no harmonic."""
    one = line(1000.0, 3.0, 0.4)
    found = response_to(
        {"x": together(one, line(500.0, 3.0 * share))}, tones=(1000.0,), planned=one
    )
    assert found.remainder.kind is kind
    assert found.remainder.share == pytest.approx(share, rel=0.01)
    unexplained = kind is RemainderKind.UNEXPLAINED
    assert found.remainder.explained is not unexplained
    assert found.steady is not unexplained
    assert math.isnan(found.remainder.at_hz) is not unexplained
    if unexplained:
        assert found.remainder.at_hz == pytest.approx(500.0)
    assert found.beating is None


def test_a_plan_that_promises_less_explains_as_much() -> None:
    """What is within the promise is no surprise."""
    one = line(1000.0, 3.0)
    plan = plan_of((1000.0,), {"x": one}, 1e-6)
    loose = DrivePlan(**{**vars(plan), "budget": Budget(1e-2, plan.budget.decisions)})
    noisy = LineWorkers({"x": together(one, line(500.0, 3e-3))})
    assert respond(noisy, loose).remainder.kind is RemainderKind.UNEXPLAINED
    decisions = tuple(
        type(d)(**{**vars(d), "bound": 5e-3}) if d is plan.budget.decisions[0] else d
        for d in plan.budget.decisions
    )
    loose = DrivePlan(**{**vars(plan), "budget": Budget(1e-2, decisions)})
    assert respond(noisy, loose).remainder.kind is RemainderKind.SMALL


def test_tones_without_a_common_period_are_fitted_and_their_spectrum_is_tapered() -> None:
    tones = (1000.0, 1000.0 + 10.0 * 2.0**0.5)
    clean = together(line(tones[0], 3.0, 0.4), line(tones[1], 2.0))
    found = response_to({"x": clean}, tones=tones, planned=clean)
    spectrum = found.spectrum
    assert not spectrum.coherent
    assert spectrum.window_s == 1.0  # a power of ten, ten times what tells the tones apart or more
    assert found.peaks[:, 0] == pytest.approx([3.0, 2.0], rel=1e-6)
    assert found.lines == ()
    # a Hann window loses at most 15 % between two bins, and nothing beyond some bins
    for tone, size in zip(tones, (3.0, 2.0), strict=True):
        near = np.abs(spectrum.frequencies_hz - tone) < 1.0
        assert 0.84 * size < np.max(spectrum.amplitudes[near, 0]) < 1.01 * size
    far = np.abs(spectrum.frequencies_hz - 1007.0) > 15.0
    assert np.max(spectrum.amplitudes[far, 0]) < 1e-3
    assert found.remainder.kind in (RemainderKind.ROUNDING, RemainderKind.SMALL)
    other = response_to({"x": together(clean, line(500.0, 0.03))}, tones=tones, planned=clean)
    assert other.remainder.kind is RemainderKind.UNKNOWN
    assert other.remainder.share == pytest.approx(0.01, rel=0.2)  # a part may be combinations
    assert math.isnan(other.remainder.at_hz)


def test_a_cubic_response_is_read_and_explained_without_a_common_period() -> None:
    """Harmonics and mixtures, 3 f1 and 2 f1 - f2, are lines of it at any time."""
    f, g = 1000.0, 1000.0 + 10.0 * 2.0**0.5
    mixed = {2.0 * f - g: 0.06, 2.0 * g - f: 0.03, 3.0 * f: 0.02, 2.0 * f + g: 0.01, 2.0 * f: 3e-3}
    lines = [line(at_hz, size, 1e-3 * at_hz) for at_hz, size in mixed.items()]
    cubic = together(line(f, 3.0, 0.4), line(g, 2.0), *lines)
    response = response_to({"x": cubic}, tones=(f, g), planned=cubic)
    assert response.plan.settle_s == 0.0
    assert response.accuracy < 1e-6
    assert response.peaks[:, 0] == pytest.approx([3.0, 2.0], rel=1e-6)
    assert response.remainder.kind is RemainderKind.COMBINATION
    assert response.remainder.share == pytest.approx(0.02, rel=1e-6)
    assert response.remainder.at_hz == pytest.approx(2.0 * f - g)
    assert response.steady


def test_tones_that_no_band_holds_are_refused() -> None:
    tones = (1.0, 1e6 * 2.0**0.5)
    with pytest.raises(BadInput, match="no common period"):
        respond(LineWorkers({}), _planned_for(tones), Shown(samples=100))


def _planned_for(tones: tuple[float, ...]) -> DrivePlan:
    """A plan of other tones: what is shown fails before anything runs."""
    plan = plan_of((1000.0,), {"x": line(1000.0, 1.0)}, 1e-6)
    return DrivePlan(**{**vars(plan), "drives": (drive_of(tones, "x"),)})


def test_traces_show_two_beats_and_six_periods_about_the_largest() -> None:
    found = response_to({"x": CLEAN})
    beating, carrier = found.beating, found.carrier
    assert beating is not None
    assert float(np.ptp(beating.times_s)) >= 2.0 / 10.0
    assert float(np.ptp(beating.times_s)) < 2.0 / 10.0 + 0.01
    assert np.max(np.abs(beating.values)) == pytest.approx(5.0, rel=0.02)
    # about 400 columns of 41 samples, a period of the carrier or more from one to the next
    assert beating.times_s.size == pytest.approx(400 * 41 / 2.0, rel=0.05)
    step = float(beating.times_s[1] - beating.times_s[0])
    assert step * 1005.0 * 41 == pytest.approx(round(step * 1005.0 * 41), abs=1e-9)
    assert carrier.times_s.size == 6 * 40 + 1
    assert float(np.ptp(carrier.times_s)) == pytest.approx(6.0 / 1005.0)
    assert np.max(np.abs(carrier.values)) == pytest.approx(5.0, rel=0.02)
    at = beating.times_s[int(np.argmax(np.abs(beating.values[:, 0])))]
    assert carrier.times_s[0] <= at <= carrier.times_s[-1]
    assert at == pytest.approx(float(np.mean(carrier.times_s[[0, -1]])), abs=0.1 / 1005.0)
    truth = CLEAN(carrier.times_s, {})
    assert carrier.values[:, 0] == pytest.approx(truth)
