"""Laws of control quantities: coefficients come back through the FMU, nonsense gets one sentence.

One mode of CoupledOscillator is seen whose eigenfrequency follows a control voltage; its response
is known in closed form, so the truth of the data is.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.campaign.laws import Laws
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

#: Truth: eta = ETA + SLOPE V + BEND V^2, full width d of the line.
ETA_HZ, SLOPE, BEND, WIDTH_HZ = 1000.0, 3.0, -0.4, 12.5
VOLTS = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
AWAY_HZ = np.array([-6.0, 0.0, 4.0])

LAW = "e0 + e1*bias + e2*bias**2/V0"
CAMPAIGN = """
title = "A mode over a voltage"
synthetic = true

[fmu]
file = "{fmu}"
start = {{ periodic_start = true, theta = 0.0, d2 = 10.0, eta_minus = 2000.0, A2 = 0.0 }}

[observe]
output = "q1_hybrid"
steady_start = true

[drive]
kind = "tones"
frequencies = ["u1"]
amplitudes = ["A1"]

[experiments]
file = "peaks.csv"
amplitude = "m peak"
peaks = ["peak"]

[noise]
relative = 0.001

[laws]
eta_plus = "e0 + e1*bias + e2*bias**2/V0"

[constants]
V0 = "1000 mV"

[[parameters]]
name = "d1"
lower = "1 Hz"
upper = "100 Hz"
start = "30 Hz"

[[parameters]]
name = "e0"
lower = "0.98 kHz"
upper = "1.02 kHz"
start = "1.001 kHz"

[[parameters]]
name = "e1"
unit = "kHz/V"
lower = -0.02
upper = 0.02
start = 0.0

[[parameters]]
name = "e2"
unit = "Hz/V"
lower = -2.0
upper = 2.0
start = 0.0

[derived]
outputs = ["Q_plus"]

[continuation]
starts = 1
misfit = "squares"
"""


def amplitude(u_hz: FloatArray | float, eta_hz: FloatArray | float) -> FloatArray:
    """|X(u)| of q'' + 2 pi w q' + (2 pi eta)^2 q = cos 2 pi u t."""
    stiff = (2 * np.pi) ** 2 * (eta_hz - u_hz) * (eta_hz + u_hz)
    return np.asarray(1.0 / np.hypot(stiff, (2 * np.pi) ** 2 * u_hz * WIDTH_HZ))


def written(folder: Path, fmu: Path, campaign: str = CAMPAIGN) -> Path:
    """Peaks of the closed form without noise, voltages in mV; the campaign's path."""
    lines = ["experiment,u1 (Hz),bias (mV),peak (m)"]
    for volt in VOLTS:
        eta = ETA_HZ + SLOPE * volt + BEND * volt**2
        for away in AWAY_HZ:
            u = float(ETA_HZ + SLOPE * volt + away)
            lines.append(
                f"{volt:g}V{away:+g},{u!r},{float(1e3 * volt)!r},{float(amplitude(u, eta))!r}"
            )
    (folder / "peaks.csv").write_text("\n".join(lines))
    path = folder / "campaign.toml"
    path.write_text(campaign.format(fmu=fmu.as_posix()))
    return path


def test_coefficients_come_back_in_their_own_units(swift_fmu: Path, tmp_path: Path) -> None:
    fit = ff.fit(ff.Problem.of(ff.read_campaign(written(tmp_path, swift_fmu))))
    assert fit.success
    found = dict(zip(fit.problem.names, fit.x, strict=True))
    assert found == pytest.approx(
        {"d1": WIDTH_HZ, "e0": 1e-3 * ETA_HZ, "e1": 1e-3 * SLOPE, "e2": BEND}, rel=1e-5
    )
    # the derived output is read where each voltage puts the eigenfrequency
    etas = np.repeat(ETA_HZ + SLOPE * VOLTS + BEND * VOLTS**2, AWAY_HZ.size)
    assert fit.result.derived["Q_plus"].values == pytest.approx(etas / WIDTH_HZ, rel=1e-6)
    [note] = [note for note in fit.problem.record.notes if note.subject == "eta_plus"]
    assert note.names["formula"] == (LAW,)
    assert "V0 = 1000 mV" in note.names["constants"]


def test_a_program_says_the_same(swift_fmu: Path) -> None:
    """Rows at the truth vanish: with coefficients, and with a fitted variable that a law names."""
    u = ETA_HZ + SLOPE * VOLTS[:, None] + AWAY_HZ[None, :]
    eta = np.broadcast_to((ETA_HZ + SLOPE * VOLTS)[:, None], u.shape)
    setup = ff.Setup(
        ff.Drive(frequency_names=("u1",), amplitude_names=("A1",)),
        "q1_hybrid",
        start_values={
            "periodic_start": True,
            "theta": 0.0,
            "u2": 1500.0,
            "A2": 0.0,
            "eta_minus": 2000.0,
        },
        steady_start=True,
        laws=ff.Laws({"eta_plus": "e0 + e1*bias", "d2": "2*d1"}),
    )
    problem = ff.Problem(
        swift_fmu,
        [
            ff.Parameter("e0", "1 kHz", bounds=("980 Hz", "1020 Hz")),
            ff.Parameter("e1", 0.0, bounds=(-20.0, 20.0), unit="Hz/V"),
            ff.Parameter("d1", 30.0, bounds=(1.0, 100.0)),
        ],
        ff.Tones(
            setup,
            u.reshape(-1, 1),
            amplitude(u, eta).reshape(-1, 1),
            settings={"bias": [f"{1e3 * v} mV" for v in np.repeat(VOLTS, AWAY_HZ.size)]},
            amplitude_unit="m",
        ),
        derived="width_minus",
    )
    assert problem.residuals([1.0, SLOPE, WIDTH_HZ]) == pytest.approx(np.zeros(15), abs=1e-9)
    wrong = problem.residuals([1.0, -SLOPE, WIDTH_HZ])
    off = ETA_HZ - SLOPE * np.repeat(VOLTS, AWAY_HZ.size)
    expected = amplitude(u.ravel(), off) / amplitude(u, eta).ravel() - 1.0
    assert wrong == pytest.approx(expected, rel=1e-6)


def test_a_variable_without_unit_takes_the_value_in_base_units_and_says_so() -> None:
    known = {"parameters": {"k": "kN/m"}, "variables": {"mass": "g"}, "controls": {}}
    [law] = Laws({"w2": "k/mass"}).with_units({"w2": ""}, **known).bound
    assert law.value({"k": 2.0, "mass": 500.0}) == pytest.approx(2000.0 / 0.5)
    assert (law.note.subject, law.note.names["formula"]) == ("w2", ("k/mass",))
    assert law.note.names["unchecked"] == ("kN/g/m",)
    [plain] = Laws({"n": "k/k"}).with_units({"n": ""}, **known).bound
    assert (plain.note.names["formula"], plain.note.names["unchecked"]) == (("k/k",), ())


FAULTS = [
    (LAW, "980 + 3", "eta_plus: .*'980 \\+ 3'"),
    ("e1*bias", "e1*baas", "'baas'.*'bias'"),
    ("e1*bias", "e1*bias**2", "kHz and kHz·mV"),
    ("e0 + e1*bias", "e0/bias**1*V0 + e1*bias", "no finite .*bias .mV. = 0.0, .*'0V-6'"),
    ("eta_plus = ", "eta_plas = ", "'eta_plas'.*'eta_plus'"),
    ("eta_plus = ", "Q_plus = ", "'Q_plus' .*causality output"),
    ("eta_plus = ", "d1 = ", "'d1' .*.laws."),
    ("eta_plus = ", "theta = ", "'theta' .*.fmu.start."),
    ('eta_plus = "e0', 'theta = "e0', "'theta' "),
    ('V0 = "1000 mV"', 'V0 = "1000 Hz"', "kHz and "),
    ('V0 = "1000 mV"', 'V0 = "1 V"\nV1 = 3', "'V1'"),
    ('V0 = "1000 mV"', "V0 = true", "V0: .*True"),
    ('unit = "Hz/V"', "", "'e2'.: .*unit = "),
    ('unit = "Hz/V"', 'unit = "Hz/Vv"', "'Hz/Vv'"),
    ('"e0 + e1', '"e0 + import(e1', "eta_plus: found"),
]


@pytest.mark.parametrize(("old", "new", "wanted"), FAULTS)
def test_what_is_wrong_with_a_law_is_told_by_its_place(
    old: str, new: str, wanted: str, swift_fmu: Path, tmp_path: Path
) -> None:
    assert old in CAMPAIGN
    path = written(tmp_path, swift_fmu, CAMPAIGN.replace(old, new, 1))
    with pytest.raises(BadInput, match=wanted) as told:
        ff.Problem.of(ff.read_campaign(path))
    assert len(told.value.args) == 1
    assert "campaign.toml" in str(told.value)


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (lambda text: text.replace("bias (mV)", "bias"), "row 2, column 'bias'.*unit"),
        (lambda text: text.replace("bias (mV)", "bas (mV)"), "'bas'"),
        (
            lambda text: "\n".join(
                ",".join([*line.split(",")[:2], "5.0", line.split(",")[3]]) if k else line
                for k, line in enumerate(text.splitlines())
            ),
            "'bias' is 5 mV",
        ),
    ],
)
def test_what_is_wrong_with_the_control_column_is_told(
    change: Callable[[str], str], wanted: str, swift_fmu: Path, tmp_path: Path
) -> None:
    path = written(tmp_path, swift_fmu)
    peaks = tmp_path / "peaks.csv"
    peaks.write_text(change(peaks.read_text()))
    with pytest.raises(BadInput, match=wanted):
        ff.Problem.of(ff.read_campaign(path))


def test_a_law_names_another_and_its_derivative() -> None:
    """f = a + b V + c V^2 in Hz, depth = 2 g U f'/f: its value, its unit, and its coefficients."""
    laws = Laws({"f1": "a + b*V + c*V**2", "depth_f1": "2*g*U*d(f1, V)/f1"})
    bound = laws.with_units(
        {"f1": "Hz", "depth_f1": "1"},
        parameters={"a": "Hz", "b": "Hz/V", "c": "Hz/V**2", "g": "1"},
        variables={},
        controls={"V": "V", "U": "mV"},
    )
    values = bound.applied({"V": 3.0, "U": 20.0}, {"a": 1e6, "b": 200.0, "c": -15.0, "g": 0.5})
    f1 = 1e6 + 600.0 - 135.0
    assert values["f1"] == pytest.approx(f1, rel=1e-14)
    assert values["depth_f1"] == pytest.approx(2.0 * 0.5 * 0.02 * (200.0 - 90.0) / f1, rel=1e-13)
    assert bound.bound[1].note.names["formula"] == ("2*g*U*d(f1, V)/f1",)


def test_laws_that_name_each_other_are_refused() -> None:
    with pytest.raises(BadInput, match="f1 -> f2 -> f1"):
        Laws({"f1": "f2 + a", "f2": "2*f1"})
