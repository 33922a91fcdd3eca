"""A campaign from files and an FMU: it runs unedited and finds what was put into the data."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from fitting.draft.api import Question, drafted, init
from fitting.draft.records import decay_of
from fitting.draft.sweeps import two_modes_of
from fitting.fit.fit import Status
from fitting.lines.trace import trace_of
from fitting.result.result import Result, read_result
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.estimate import Verdict
from tests.support.cfmu_build import (
    build_c_fmu,
    build_lag_fmu,
    build_own_step_fmu,
    build_wall_fmu,
)
from tests.support.lines import mode, noise, write_csv
from tests.support.own_step import phasor

pytestmark = pytest.mark.usefixtures("swift_models")

ETA, WIDTH = 30_000.0, 25.0
F = ETA + np.linspace(-80.0, 80.0, 41)
#: A line so wide that every point of every run settles soon.
MASS, DAMPING, STIFFNESS = 1e-3, 0.6, 4.1e3
F_LOW = np.linspace(214.0, 430.0, 9)


def told_of(file: Path, folder: Path) -> dict[str, Any]:
    """The campaign, of whose FMU is said what it does not describe, in the file as well."""
    path, made = drafted(file, out=folder)
    text = path.read_text("utf-8")
    assert made.undescribed
    assert made.undescribed in " ".join(re.sub("(?m)^# ?", "", text).split())
    return tomllib.loads(text)


@pytest.fixture(scope="module")
def cantilever(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Somebody else's FMU, in C, driven through an input."""
    return build_c_fmu(tmp_path_factory.mktemp("fmu"))


def lock_in(folder: Path, *, phases: bool) -> Path:
    """A line on crosstalk as a lock-in amplifier writes it, with 0.2 % of noise."""
    seen = 1e-3 * (mode(F, ETA, WIDTH) + noise(F.size, 2e-3, 1))
    if not phases:
        head = "frequency (kHz),R (mV)"
        return write_csv(
            folder / "lock-in.csv", head, F / 1e3, 1e3 * np.hypot(seen.real, seen.imag)
        )
    seen = seen + 1e-4 * (1.0 + 2.0j)
    angle = np.rad2deg(np.angle(seen))
    head = "frequency (kHz),R (mV),theta (deg)"
    return write_csv(
        folder / "lock-in.csv", head, F / 1e3, 1e3 * np.hypot(seen.real, seen.imag), angle
    )


def driven(folder: Path) -> Path:
    """Amplitudes of m x'' + c x' + k x = F in closed form, with a detector's gain."""
    w = 2.0 * np.pi * F_LOW
    size = 0.37 / np.abs(STIFFNESS - MASS * w**2 + 1j * DAMPING * w)
    rough = 1.0 + 1e-3 * np.random.default_rng(2).standard_normal(F_LOW.size)
    return write_csv(folder / "mine.csv", "frequency (Hz),amplitude (V)", F_LOW, size * rough)


def fitted(folder: Path, words: Sequence[str]) -> Result:
    """What `reconstruct` finds with the campaign that `init` wrote, unedited."""
    out = folder / "drafted"
    assert main(["init", *words, "--out", str(out), "--yes"]) == 0
    campaign, results = str(out / "campaign.toml"), folder / "results"
    quick = ["--quick", "--no-report", "--no-profiles", "--workers", "1"]
    assert main(["reconstruct", campaign, "--out", str(results), *quick]) == 0
    return read_result(results / "result.json")


@pytest.mark.parametrize(
    "phases", [True, pytest.param(False, marks=pytest.mark.nightly)], ids=["phases", "amplitudes"]
)
def test_a_lock_in_file_alone_becomes_a_campaign_that_finds_the_truth(
    phases: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = fitted(tmp_path, [str(lock_in(tmp_path, phases=phases))])
    f, d = found.parameters["f1"], found.parameters["d1"]
    assert abs(f.value - ETA) < 4.0 * f.std < 1.0
    assert abs(d.value - WIDTH) < 4.0 * d.std < 1.0
    written = tomllib.loads((tmp_path / "drafted" / "campaign.toml").read_text("utf-8"))
    assert ("complex_sweep" if phases else "sweep") in written
    assert written["observe"]["output"] == "readout"
    assert "  next " in capsys.readouterr().out


SPLIT, NARROW, SHARE = 60.0, 15.0, -0.7


def two_modes(folder: Path, *, phases: bool) -> Path:
    """Two modes that a detector sees with opposite signs, in closed form, with 0.2 % of noise."""
    upper = SHARE * mode(F_TWO, ETA + SPLIT, NARROW)
    seen = mode(F_TWO, ETA, WIDTH) + upper + noise(F_TWO.size, 2e-3, 4)
    if not phases:
        return write_csv(folder / "two.csv", "f (Hz),R (V)", F_TWO, np.abs(seen))
    seen = seen + (0.1 - 0.05j)
    return write_csv(folder / "two.csv", "f (Hz),X (V),Y (V)", F_TWO, seen.real, seen.imag)


F_TWO = ETA + np.linspace(-100.0, 160.0, 66)
#: g2 of the truth: heights of modes of unit mass go with g/(f d).
G2 = SHARE * (ETA + SPLIT) * NARROW / (ETA * WIDTH)


def test_two_lines_become_a_campaign_of_two_modes_that_finds_both(tmp_path: Path) -> None:
    found = fitted(tmp_path, [str(two_modes(tmp_path, phases=True))])
    truth = {"f1": ETA, "f2": ETA + SPLIT, "d1": WIDTH, "d2": NARROW, "g2": G2}
    assert set(found.parameters) == set(truth)
    for name, value in truth.items():
        each = found.parameters[name]
        assert abs(each.value - value) < 4.0 * each.std, name
        assert each.std < 0.02 * (abs(value) if name in ("d1", "d2", "g2") else WIDTH), name
    written = tomllib.loads((tmp_path / "drafted" / "campaign.toml").read_text("utf-8"))
    assert written["fmu"]["model"] == "CoupledModes2"
    assert written["fmu"]["start"]["lambda12"] == 0.0
    assert written["complex_sweep"][0]["background"] == "constant"


def hybrid(f: FloatArray, driven: float) -> ComplexArray:
    """q1 of two coupled modes of unlike damping over its top, mode 2 driven so much as mode 1."""
    one, two = (
        (ETA + at) ** 2 - f**2 + 1j * f * d for at, d in ((0.0, WIDTH), (SPLIT, 2.0 * WIDTH))
    )
    seen = (two + COUPLING**2 * driven) / (one * two - COUPLING**4)
    return np.asarray(seen / np.max(np.abs(seen)))


#: lambda of a coupling that splits like modes by 40 Hz.
COUPLING = math.sqrt(40.0 * ETA)


def test_two_lines_that_are_not_in_phase_become_coupled_modes(tmp_path: Path) -> None:
    seen = hybrid(F_TWO, 0.0) + noise(F_TWO.size, 2e-3, 3)
    file = write_csv(tmp_path / "two.csv", "f (Hz),X (V),Y (V)", F_TWO, seen.real, seen.imag)
    found = fitted(tmp_path, [str(file)])
    truth = {"f1": ETA, "f2": ETA + SPLIT, "d1": WIDTH, "d2": 2.0 * WIDTH, "lambda12": COUPLING}
    assert found.status == "converged"
    assert set(found.parameters) == set(truth)
    for name, value in truth.items():
        each = found.parameters[name]
        assert abs(each.value - value) < 4.0 * each.std < 0.2 * value, name
    # eta and width are no longer what the sweep shows
    assert not {"eta1", "eta2"} & set(found.derived)


@pytest.mark.parametrize(
    ("phases", "driven"),
    [
        *((True, 0.7), (False, 0.0)),
        pytest.param(True, 0.0, marks=pytest.mark.nightly),
        pytest.param(False, 0.7, marks=pytest.mark.nightly),
    ],
)
def test_the_model_of_two_modes_is_the_simplest_that_describes(phases: bool, driven: float) -> None:
    exact = hybrid(F_TWO, driven) + noise(F_TWO.size, 2e-4, 2)
    found = two_modes_of(trace_of(F_TWO, exact if phases else np.abs(exact), "V"))
    assert found is not None
    assert found.describes
    assert found.kind == ("driven" if driven else "coupled")
    assert found.coupling_hz == pytest.approx(COUPLING, rel=0.02)
    assert found.frequency_hz == pytest.approx((ETA, ETA + SPLIT), abs=1.0)
    assert found.width_hz == pytest.approx((WIDTH, 2.0 * WIDTH), rel=0.1)
    assert found.drive == pytest.approx(driven, abs=0.05)


@pytest.mark.parametrize(
    ("seed", "share"),
    [
        *((0, 0.7), (2, -0.7)),
        *(
            pytest.param(seed, share, marks=pytest.mark.nightly)
            for seed, share in (
                (1, 1.3),
                (0, 1.3),
                (0, -0.7),
                (1, 0.7),
                (1, -0.7),
                (2, 0.7),
                (2, 1.3),
            )
        ),
    ],
)
def test_overlapping_lines_in_phase_are_modes_of_their_own(share: float, seed: int) -> None:
    # amplitudes do not tell S from the curve with its zero mirrored, which no two such modes have
    f = 880_180.0 + np.linspace(-800.0, 800.0, 401)
    seen = np.abs(mode(f, 880_100.0, 120.0) + share * mode(f, 880_260.0, 95.0))
    seen *= 1.0 + 0.004 * np.random.default_rng(seed).standard_normal(f.size)
    found = two_modes_of(trace_of(f, seen, "V"))
    assert found is not None
    assert found.describes
    assert found.kind == "separate"
    assert found.frequency_hz == pytest.approx((880_100.0, 880_260.0), abs=3.0)
    assert found.width_hz == pytest.approx((120.0, 95.0), rel=0.05)
    assert found.drive == pytest.approx(share * 95.0 / 120.0, rel=0.05)


def test_two_lines_of_amplitudes_begin_at_both_and_keep_apart(tmp_path: Path) -> None:
    # g2 is the ratio of the heights times that of f d: the heights alone do not tell it
    found = fitted(tmp_path, [str(two_modes(tmp_path, phases=False))])
    path = tmp_path / "drafted" / "campaign.toml"
    boxes = {p["name"]: p for p in tomllib.loads(path.read_text("utf-8"))["parameters"]}
    assert boxes["f1"]["start"] == pytest.approx(ETA, abs=0.5)
    assert boxes["f2"]["start"] == pytest.approx(ETA + SPLIT, abs=0.5)
    assert boxes["d1"]["start"] == pytest.approx(WIDTH, rel=0.05)
    assert boxes["d2"]["start"] == pytest.approx(NARROW, rel=0.05)
    assert boxes["g2"]["start"] == pytest.approx(G2, rel=0.05)
    assert boxes["f1"]["upper"] == pytest.approx(boxes["f2"]["lower"], abs=0.5)
    # and nobody is told that they are one line
    assert found.line is not None
    assert math.isnan(found.line.frequency.value)
    assert found.line.values == {}


def test_amplitudes_on_a_constant_say_that_no_fmu_has_it(tmp_path: Path) -> None:
    seen = np.abs(mode(F, ETA, WIDTH) + noise(F.size, 2e-3, 1) + (0.3 - 0.2j))
    file = write_csv(tmp_path / "x.csv", "f (Hz),R (V)", F, seen)
    assert told_of(file, tmp_path / "o")["sweep"]["background"] == "complex"


def test_no_fit_is_promised_of_what_the_fmu_does_not_describe(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Averaged powers of a line in noise of half its height: `reconstruct` ends with 4."""
    power = np.abs(mode(F, ETA, WIDTH)) ** 2 + 0.25
    rough = np.sqrt(power) + noise(F.size, 1e-3, 1).real
    file = write_csv(tmp_path / "x.csv", "f (Hz),R (V)", F, rough)
    assert main(["init", str(file), "--out", str(tmp_path / "o"), "--yes"]) == 0
    assert "  next " not in capsys.readouterr().out
    campaign = str(tmp_path / "o" / "campaign.toml")
    quick = ["--quick", "--no-report", "--no-profiles", "--out", str(tmp_path / "r")]
    assert main(["reconstruct", campaign, *quick]) == 4


def test_the_campaign_of_a_line_on_a_constant_solves_for_it(tmp_path: Path) -> None:
    """The draft as it is: the truth is in the intervals, and the sweep is described."""
    rough = np.abs(mode(F, ETA, WIDTH)) + 0.3 + noise(F.size, 2e-3, 1).real
    sweep = write_csv(tmp_path / "x.csv", "f (Hz),R (V)", F, rough)
    found = fitted(tmp_path, [str(sweep)])
    assert found.status == "converged"
    for name, truth in (("f1", ETA), ("d1", WIDTH)):
        value = found.parameters[name]
        assert abs(value.value - truth) < 4.0 * value.std < 0.04 * WIDTH


@pytest.mark.parametrize("constant", ["offset", pytest.param("complex", marks=pytest.mark.nightly)])
def test_a_fit_that_leaves_a_constant_does_not_describe_its_sweep(
    constant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nobody told the noise: what the line with the constant leaves tells it."""
    line = mode(F, ETA, WIDTH)
    seen = np.abs(line + (0.3 - 0.2j)) if constant == "complex" else np.abs(line) + 0.3
    rough = seen + noise(F.size, 2e-3, 1).real
    made, _ = init(write_csv(tmp_path / "x.csv", "f (Hz),R (V)", F, rough), out=tmp_path / "o")
    assert tomllib.loads(made.read_text("utf-8"))["sweep"]["background"] == constant
    campaign = str(tmp_path / "o" / "campaign.toml")
    quick = ["--quick", "--no-report", "--no-profiles"]
    text = Path(campaign).read_text("utf-8")
    Path(campaign).write_text(re.sub(r"(?m)^background = .*$", "", text), "utf-8")
    assert main(["reconstruct", campaign, "--out", str(tmp_path / "r"), *quick]) == 4
    result = read_result(tmp_path / "r" / "result.json")
    assert result.status == Status.MISFIT.value
    assert {value.status for value in result.parameters.values()} == {Verdict.WITHDRAWN}
    told = " ".join(capsys.readouterr().out.split())
    assert "drift" not in told
    assert ('background = "offset"' in told) is (constant == "offset")


def test_parts_without_a_unit_are_read_as_line_reads_them(tmp_path: Path) -> None:
    seen = mode(F, ETA, WIDTH) + noise(F.size, 2e-3, 1)
    path = write_csv(tmp_path / "x.csv", "f (Hz),Re S21,Im S21", F, seen.real, seen.imag)
    found = fitted(tmp_path, [str(path)])
    width = found.parameters["d1"]
    assert abs(width.value - WIDTH) < 4.0 * width.std < 0.04 * WIDTH


def test_the_fmu_of_somebody_else_is_looked_at_and_fitted(tmp_path: Path, cantilever: Path) -> None:
    found = fitted(tmp_path, [str(driven(tmp_path)), "--fmu", str(cantilever)])
    assert set(found.parameters) == {"stiffness", "damping"}
    eigenfrequency = math.sqrt(STIFFNESS / MASS) / (2.0 * math.pi)
    written = tomllib.loads((tmp_path / "drafted" / "campaign.toml").read_text("utf-8"))
    assert written["drive"]["input"] == "force"
    # it starts where the FMU's eigenfrequency is the frequency of the line
    [start] = [p["start"] for p in written["parameters"] if p["name"] == "stiffness"]
    assert math.sqrt(start / MASS) / (2.0 * math.pi) == pytest.approx(eigenfrequency, rel=1e-3)
    for value, truth in (
        (found.derived["eigenfrequency"], eigenfrequency),
        (found.derived["line_width"], DAMPING / MASS / (2.0 * math.pi)),
        (found.parameters["stiffness"], STIFFNESS),
        (found.parameters["damping"], DAMPING),
    ):
        assert abs(value.value - truth) < 4.0 * value.std < 0.02 * truth


def test_remarks_say_where_every_guess_comes_from_and_paths_are_relative(tmp_path: Path) -> None:
    path, said = init(lock_in(tmp_path, phases=True), out=tmp_path / "drafts" / "one")
    text = path.read_text("utf-8")
    tables = tomllib.loads(text)
    assert tables["complex_sweep"][0]["file"] == "../../lock-in.csv"
    assert tables["complex_sweep"][0]["background"] == "constant"
    assert tables["fmu"]["start"] == {"periodic_start": True, "A2": 0.0}
    for remark in ("was not measured with", "frequency of the line in the sweep", "as they were"):
        assert remark in text
    assert ff.read_campaign(path).file.title == "lock-in"
    assert any("f = 30000.0" in sentence for sentence in said)


def table_of_tones(folder: Path) -> tuple[Path, Path, FloatArray]:
    """Two-tone drives about a line: peaks of a linear mode are those of its response."""
    tones = ETA + np.array([[-30.0, 20.0], [-10.0, 35.0], [-18.0, 8.0]])
    peaks = np.abs(mode(tones.ravel(), ETA, WIDTH)).reshape(tones.shape)
    rough = 1.0 + 2e-3 * np.random.default_rng(3).standard_normal(tones.shape)
    rows = [
        f"pair{k},{u[0]!r},{u[1]!r},{z[0]!r},{z[1]!r}\n"
        for k, (u, z) in enumerate(zip(tones.tolist(), (peaks * rough).tolist(), strict=True))
    ]
    path = folder / "pairs.csv"
    path.write_text("experiment,u1 (Hz),u2 (Hz),z1 (V),z2 (V)\n" + "".join(rows), "utf-8")
    sweep = np.abs(mode(F, ETA, WIDTH) + noise(F.size, 2e-3, 1))
    return path, write_csv(folder / "sweep.csv", "frequency (Hz),R (V)", F, sweep), peaks


def test_a_table_of_two_tone_peaks_with_its_sweep(tmp_path: Path) -> None:
    table, sweep, _ = table_of_tones(tmp_path)
    found = fitted(tmp_path, [str(table), str(sweep), "--rms"])
    f, d = found.parameters["f1"], found.parameters["d1"]
    assert abs(f.value - ETA) < 4.0 * f.std < 1.0
    assert abs(d.value - WIDTH) < 4.0 * d.std < 1.0
    written = tomllib.loads((tmp_path / "drafted" / "campaign.toml").read_text("utf-8"))
    assert written["experiments"]["amplitude"] == written["sweep"]["amplitude"] == "V rms"
    assert written["drive"]["frequencies"] == ["u1", "u2"]
    assert written["experiments"]["peaks"] == ["z1", "z2"]


def test_a_table_of_experiments_with_a_spectrum_each(tmp_path: Path) -> None:
    table, sweep, peaks = table_of_tones(tmp_path)
    rows = [row.split(",")[:3] for row in table.read_text("utf-8").splitlines()]
    table.write_text("".join(",".join(row) + "\n" for row in rows), "utf-8")
    f = ETA + np.arange(-60.0, 61.0)
    files = []
    for (label, *tones), heights in zip(rows[1:], peaks, strict=True):
        size = np.full(f.size, 1e-4)
        for u, height in zip(map(float, tones), heights, strict=True):
            size[f == u] += height
        files.append(write_csv(tmp_path / f"{label}.csv", "frequency (Hz),R (V)", f, size))
    path, _ = init([table, sweep, *files], out=tmp_path / "o")
    written = tomllib.loads(path.read_text("utf-8"))
    assert written["experiments"]["spectra"] == "../{experiment}.csv"
    assert written["sweep"]["file"] == "../sweep.csv"
    assert {p["name"]: p["start"] for p in written["parameters"]}["f1"] == pytest.approx(ETA, abs=1)
    with pytest.raises(ff.BadInput, match="pair2"):
        init([table, sweep, *files[:2]], out=tmp_path / "p")


def test_an_fmu_alone_gives_a_skeleton_that_tells_what_is_missing(
    cantilever: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "skeleton"
    assert main(["init", str(cantilever), "--out", str(out), "--yes"]) == 0
    assert "a measurement;" in capsys.readouterr().out
    path = out / "campaign.toml"
    text = path.read_text("utf-8")
    written = tomllib.loads(text)
    assert written["observe"]["output"] == "displacement"
    assert written["drive"]["input"] == "force"
    assert [p["name"] for p in written["parameters"]] == ["stiffness", "damping"]
    assert "sweep" not in written
    assert main(["reconstruct", str(path)]) == 2
    assert "[sweep]" in capsys.readouterr().err


def test_what_is_missing_is_written_beside_its_marks(cantilever: Path, tmp_path: Path) -> None:
    """The marks taken away and a file beside it: a campaign that can be read."""
    path, _ = init(cantilever, out=tmp_path)
    text = path.read_text("utf-8")
    assert "\n#: [sweep]\n" in text
    path.write_text(text.replace("\n#: ", "\n"), "utf-8")
    driven(tmp_path).rename(tmp_path / "sweep.csv")
    campaign = ff.read_campaign(path)
    assert campaign.sweep is not None


def test_an_fmu_may_stand_among_the_files(cantilever: Path, tmp_path: Path) -> None:
    path, _ = init([driven(tmp_path), cantilever], out=tmp_path)
    written = tomllib.loads(path.read_text("utf-8"))
    assert written["sweep"]["file"] == "mine.csv"
    assert written["observe"]["output"] == "displacement"
    with pytest.raises(ff.BadInput, match="2 FMUs"):
        init([cantilever], cantilever, out=tmp_path)
    with pytest.raises(ff.BadInput, match="neither"):
        init([], out=tmp_path)


def test_a_parameter_called_eigenfrequency_is_fitted_from_where_the_line_is(tmp_path: Path) -> None:
    """An FMU of somebody else that has steps of its own, and tells nothing in its descriptions."""
    f_hz = np.arange(25.0, 37.1)
    volt = 0.37 * np.array([abs(phasor(float(f), 1e-3, 31.2, 3.0)) for f in f_hz])
    write_csv(tmp_path / "mine.csv", "frequency (Hz),R (V)", f_hz, volt)
    path, _ = init(tmp_path / "mine.csv", build_own_step_fmu(tmp_path), out=tmp_path)
    drafted = {p["name"]: p for p in tomllib.loads(path.read_text("utf-8"))["parameters"]}
    assert list(drafted) == ["eigenfrequency", "line_width"]
    assert drafted["eigenfrequency"]["start"] == pytest.approx(31.2, abs=0.03)
    assert drafted["line_width"]["start"] == pytest.approx(3.0, rel=0.02)


def test_a_sweep_without_a_line_is_drafted_for_an_fmu_that_has_none(tmp_path: Path) -> None:
    f_hz = np.arange(0.1, 1.55, 0.1)
    volt = 0.37 / np.abs(1.0 + 2j * np.pi * f_hz * 0.8)
    file = write_csv(tmp_path / "lag.csv", "frequency (Hz),R (V)", f_hz, volt)
    path, _ = init(file, build_lag_fmu(tmp_path), out=tmp_path / "o")
    names = [p["name"] for p in tomllib.loads(path.read_text("utf-8"))["parameters"]]
    assert names == ["tau", "gain"]


def test_a_person_is_asked_only_what_no_file_tells(tmp_path: Path) -> None:
    asked: list[Question] = []

    def answer(question: Question) -> Sequence[str] | None:
        asked.append(question)
        return {"output": ["q1"], "fit": ["d1", "f1"]}.get(question.key)

    table, sweep, _ = table_of_tones(tmp_path)
    path, said = init([table, sweep], out=tmp_path / "o", ask=answer, told={"amplitudes": "peak"})
    assert [question.key for question in asked] == ["output", "fit"]
    written = tomllib.loads(path.read_text("utf-8"))
    assert written["observe"]["output"] == "q1"
    assert [p["name"] for p in written["parameters"]] == ["d1", "f1"]
    assert any(each.startswith("output: q1") for each in said)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["absent.csv"], r"absent\.csv"),
        (["lock-in.csv", "--output", "q2"], r"--output: .*'q2'.*readout.*q1"),
        (["lock-in.csv", "--fit", "f2"], r"--fit: .*'f2'.*f1.*d1"),
        (["lock-in.csv", "--tone", "u3"], r"--tone: .*'u3'"),
        (["lock-in.csv", "--fmu", "absent.fmu"], r"absent\.fmu"),
        (["lock-in.csv", "--from"], "'--from'"),
        (["pairs.csv"], "sweep"),
        (["pairs.csv", "pairs.csv"], r"pairs\.csv.*experiments"),
        (["lock-in.csv", "--unit-phase", "kg"], "unit 'kg'"),
        (["lock-in.csv", "--real", "R"], "real: "),
    ],
    ids=[
        *("absent", "output", "fit", "tone", "fmu", "option", "no_sweep", "tables", "unit"),
        "alone",
    ],
)
def test_bad_input_is_a_sentence_and_nothing_is_written(
    words: list[str],
    told: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lock_in(tmp_path, phases=True)
    table_of_tones(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(["init", *words, "--out", "drafted", "--yes"]) == 2
    complained = capsys.readouterr().err
    assert re.search(told, complained)
    assert complained.count("\n") == 1
    assert not (tmp_path / "drafted").exists()


def test_a_campaign_that_somebody_edited_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(lock_in(tmp_path, phases=True))
    words = ["init", file, "--out", str(tmp_path / "o"), "--yes"]
    assert main(words) == 0
    assert main(words) == 0
    path = tmp_path / "o" / "campaign.toml"
    path.write_text(path.read_text("utf-8") + "# mine\n", "utf-8")
    capsys.readouterr()
    assert main(words) == 2
    assert "campaign.toml" in capsys.readouterr().err
    assert path.read_text("utf-8").endswith("# mine\n")


# --- recordings over time -------------------------------------------------------------------


def test_one_input_one_output_and_a_recording_are_a_campaign(tmp_path: Path) -> None:
    """A step response of a lag, its columns called otherwise than the FMU's variables."""
    t = np.linspace(0.0, 1.49, 150)
    u = np.where(t >= 0.1, 1.0, 0.0)
    y = 2.0 * -np.expm1(-np.maximum(t - 0.1, 0.0) / 0.3)
    y += 0.02 * np.random.default_rng(1).standard_normal(t.size)
    head = "clock (ms),force (mV),seen (V)"
    path = write_csv(tmp_path / "step.csv", head, 1e3 * t, 1e3 * u, y)
    written, said = init(path, build_lag_fmu(tmp_path), out=tmp_path / "drafted")
    assert all(token in said[0] for token in ("step.csv", "150", "'seen'", "'force'"))
    made = tomllib.loads(written.read_text(encoding="utf-8"))
    [trace] = made["trace"]
    assert trace["interpolation"] == "held"
    assert trace["columns"] == {"time": "clock", "output": "seen", "input": "force"}
    # nothing tells the other three: they are zero, or the FMU's own way to solve
    assert [p["name"] for p in made["parameters"]] == ["tau", "gain"]
    fit = ff.fit(ff.Problem.of(written))
    assert abs(fit["tau"].value - 0.3) < 4.0 * fit["tau"].std < 0.03
    assert abs(fit["gain"].value - 2.0) < 4.0 * fit["gain"].std < 0.03


R1, R2, C = 0.5, 2.0, 3.0e4


def wall(r1: complex, r2: complex, rooms: FloatArray, step_s: float) -> ComplexArray:
    """Temperatures of a wall at the samples, from 293 K, the rooms' held over each step."""
    tau, seen = C * r1 * r2 / (r1 + r2), [293.0 + 0.0j]
    for one, two in rooms[:-1]:
        end = (one * r2 + two * r1) / (r1 + r2)
        seen.append(end + (seen[-1] - end) * np.exp(-step_s / tau))
    return np.array(seen)


def test_a_wall_between_two_rooms_is_as_sure_as_can_be(tmp_path: Path) -> None:
    """Two inputs; of R1, R2 and C a temperature tells two products: two are taken by themselves."""
    rng = np.random.default_rng(3)
    t = np.linspace(0.0, 600.0 * 199.0, 200)
    rooms = np.stack([293.0 + 5.0 * (t > 2e4), 288.0 + 3.0 * np.sin(t / 9e3)], axis=1)
    sigma = 0.05
    seen = wall(R1, R2, rooms, 600.0).real + sigma * rng.standard_normal(t.size)
    head = "time (min),Ti1 (degC),Ti2 (K),T (degC)"
    columns = [t / 60.0, rooms[:, 0] - 273.15, rooms[:, 1], seen - 273.15]
    path = write_csv(tmp_path / "wall.csv", head, *map(np.asarray, columns))
    fmu = build_wall_fmu(tmp_path)
    written, _ = init(path, fmu, out=tmp_path / "guessed")
    made = tomllib.loads(written.read_text(encoding="utf-8"))
    assert made["trace"][0]["further_inputs"] == ["Ti2"]
    assert len({p["name"] for p in made["parameters"]} & {"R1", "R2", "C"}) == 2
    setup = ff.Setup(ff.Drive(), "T", start_values={"C": C})
    trace = ff.Trace(
        t,
        seen,
        setup=setup,
        input="Ti1",
        driven=(t, rooms[:, 0]),
        further={"Ti2": (t, rooms[:, 1])},
        interpolation="held",
        sigma=sigma,
        unit="K",
    )
    parameters = [ff.Parameter(n, 1.0, bounds=(0.1, 10.0), unit="K/W") for n in ("R1", "R2")]
    quick = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
    fit = ff.fit(ff.Problem(fmu, parameters, trace), method=quick, starts=1)
    h = 1e-20
    slopes = [wall(R1 + 1j * h, R2, rooms, 600.0).imag, wall(R1, R2 + 1j * h, rooms, 600.0).imag]
    matrix = np.stack(slopes, axis=1) / (h * sigma)
    bound = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    for name, true, std in zip(("R1", "R2"), (R1, R2), bound, strict=True):
        assert fit[name].std == pytest.approx(std, rel=0.05)
        assert abs(fit[name].value - true) < 4.0 * std


def test_start_values_are_brought_to_what_a_step_shows(tmp_path: Path) -> None:
    """40 ms and a gain of 300, where the FMU comes with one second and one."""
    t = np.arange(400) / 1000.0
    u = np.where(t >= 0.05, 1.0, 0.0)
    y = 300.0 * np.where(t > 0.05, 1.0 - np.exp(-(t - 0.05) / 0.04), 0.0)
    y += 2.0 * np.random.default_rng(1).standard_normal(t.size)
    path = write_csv(tmp_path / "step.csv", "time (s),u (V),y (V)", t, u, y)
    made, _ = init(path, build_lag_fmu(tmp_path), out=tmp_path / "o")
    boxes = {p["name"]: p for p in tomllib.loads(made.read_text("utf-8"))["parameters"]}
    assert boxes["tau"]["lower"] < 0.02 < 0.08 < boxes["tau"]["upper"]
    assert boxes["gain"]["lower"] < 150.0 < 600.0 < boxes["gain"]["upper"]


def test_a_recording_without_the_output_is_told(tmp_path: Path) -> None:
    t = np.linspace(0.0, 0.19, 20)
    path = write_csv(tmp_path / "step.csv", "time (s),u (V),a (V),b (V)", t, t, t, t)
    with pytest.raises(ff.BadInput, match=r"'y'.*'u'.*'a'.*'b'"):
        init(path, build_lag_fmu(tmp_path), out=tmp_path / "drafted")
    assert not (tmp_path / "drafted").exists() or not list((tmp_path / "drafted").glob("*.toml"))


def test_a_recording_that_nothing_drives_is_said_to_be_one(tmp_path: Path) -> None:
    t = np.linspace(0.0, 0.19, 20)
    path = write_csv(tmp_path / "ring.csv", "time (s),y (V)", t, np.exp(-t))
    _, said = init(path, build_lag_fmu(tmp_path), out=tmp_path / "a", told={"fit": ["tau"]})
    assert any('start = "unknown"' in each for each in said)
    path = write_csv(tmp_path / "step.csv", "time (s),u (V),y (V)", t, np.ones(20), np.exp(-t))
    _, said = init(path, build_lag_fmu(tmp_path), out=tmp_path / "b", told={"fit": ["tau"]})
    assert not any('start = "unknown"' in each for each in said)


def test_a_narrow_dip_behind_a_cable_is_drafted(tmp_path: Path) -> None:
    """0.3 MHz of 10 MHz behind 40 ns, which `line` finds: the campaign's own reader takes it."""
    f = np.linspace(5.995e9, 6.005e9, 201)
    dip = 1.0 - 0.6j * mode(f, 6e9, 3e5)
    seen = dip * np.exp(-2j * np.pi * f * 40e-9) + noise(f.size, 3e-3, 1)
    file = write_csv(tmp_path / "dip.csv", "f (Hz),X (V),Y (V)", f, seen.real, seen.imag)
    path, _ = init(file, out=tmp_path / "o")
    written = tomllib.loads(path.read_text("utf-8"))
    assert written["complex_sweep"][0]["delay"] == "fit"
    boxes = {p["name"]: p["start"] for p in written["parameters"]}
    assert boxes["f1"] == pytest.approx(6e9, abs=3e3)
    assert boxes["d1"] == pytest.approx(3e5, rel=0.02)


def test_a_ringdown_is_drafted_with_the_drives_off(tmp_path: Path) -> None:
    """1234.5 Hz of Q 600 in millivolts: frequency and width are known, the tones play no part."""
    t = np.arange(4000) / 8000.0
    width = 1234.5 / 600.0
    y = 3.0 * np.exp(-np.pi * width * t) * np.cos(2.0 * np.pi * 1234.5 * t + 0.4)
    y += 0.02 * np.random.default_rng(11).standard_normal(t.size)
    path = write_csv(tmp_path / "ring.csv", "t [ms],U [mV]", 1e3 * t, y)
    made, _ = init(path, out=tmp_path / "o")
    written = tomllib.loads(made.read_text("utf-8"))
    assert written["fmu"]["model"] == "CoupledModes1"  # nobody named one
    assert written["fmu"]["start"] == {"A1": 0.0, "A2": 0.0}
    assert written["trace"][0]["start"] == "unknown"
    boxes = {p["name"]: p for p in written["parameters"]}
    assert set(boxes) == {"f1", "d1"}
    assert boxes["f1"]["start"] == pytest.approx(1234.5, abs=0.2)
    assert boxes["d1"]["start"] == pytest.approx(width, rel=0.2)
    assert boxes["d1"]["lower"] < width < boxes["d1"]["upper"]
    assert written["continuation"]["misfit"] == "squares"
    assert written["derived"]["outputs"] == ["Q1"]


def test_an_fmu_of_two_modes_takes_a_ringdown_of_two(swift_fmu: Path, tmp_path: Path) -> None:
    """Of its outputs q1 shows both; q1_hybrid hardly shows the upper one, and comes first."""
    t = np.arange(3000) / 50e3
    y = np.exp(-np.pi * 40.0 * t) * np.cos(2.0 * np.pi * 10e3 * t)
    y += 0.7 * np.exp(-np.pi * 60.0 * t) * np.cos(2.0 * np.pi * 10.15e3 * t + 1.0)
    y += 0.01 * np.random.default_rng(3).standard_normal(t.size)
    path = write_csv(tmp_path / "ring.csv", "t (s),U (V)", t, y)
    made, _ = init(path, swift_fmu, out=tmp_path / "o")
    written = tomllib.loads(made.read_text("utf-8"))
    assert written["observe"]["output"] == "q1"
    assert written["trace"][0]["states"] == 4
    assert "theta" in written["fmu"]["taken"]
    starts = {p["name"]: p["start"] for p in written["parameters"]}
    assert starts["eta_plus"] == pytest.approx(10e3, abs=0.5)
    assert starts["eta_minus"] == pytest.approx(10.15e3, abs=0.5)
    assert {"d1", "d2"} <= set(starts)
    made, said = init(path, "CoupledModes1", out=tmp_path / "one")
    assert any("one mode" in each for each in said)
    starts = {p["name"]: p["start"] for p in tomllib.loads(made.read_text("utf-8"))["parameters"]}
    assert starts["f1"] == pytest.approx(10e3, abs=0.5)


def test_a_record_that_does_not_decay_is_no_ringdown() -> None:
    t = np.arange(4000) / 8000.0
    assert not decay_of(t, np.cos(2.0 * np.pi * 1234.5 * t))
    assert not decay_of(t, np.exp(-20.0 * t))
    rough = np.random.default_rng(5).standard_normal(t.size)
    assert not decay_of(t, 0.2 * np.exp(-20.0 * t) + 2e-3 * rough)  # noise crosses zero


@pytest.mark.parametrize(
    ("driven", "second", "late"),
    [(0.1, 0.0, True), (0.0, 0.0, False), pytest.param(0.0, 0.6, False, marks=pytest.mark.nightly)],
)
def test_a_drive_before_a_decay_is_left_out(
    driven: float, second: float, late: bool, tmp_path: Path
) -> None:
    """1 kHz of width 5 Hz, on its drive until that is switched off; or two lines that beat."""
    t = np.arange(4000) / 8000.0
    fall = np.exp(-np.pi * 5.0 * np.maximum(t - driven, 0.0))
    y = fall * (np.cos(2e3 * np.pi * t) + second * np.cos(2e3 * np.pi * 1.013 * t + 0.5))
    y += 0.01 * np.random.default_rng(2).standard_normal(t.size)
    made, _ = init(write_csv(tmp_path / "r.csv", "t (s),U (V)", t, y), out=tmp_path / "o")
    [trace] = tomllib.loads(made.read_text("utf-8"))["trace"]
    assert trace.get("begin") == ("found" if late else None)


def test_a_recording_that_does_not_decay_wants_its_fmu(tmp_path: Path) -> None:
    t = np.arange(4000) / 8000.0
    path = write_csv(tmp_path / "steady.csv", "t (s),U (V)", t, np.cos(2.0 * np.pi * 1234.5 * t))
    with pytest.raises(ff.BadInput, match="--fmu"):
        init(path, out=tmp_path / "o")


def test_a_recording_in_volts_of_an_output_in_metres_has_a_gain(
    swift_fmu: Path, tmp_path: Path
) -> None:
    """It was drafted without one, and refused by the campaign's own reader."""
    t = np.linspace(0.0, 1e-3, 400)
    y = np.exp(-3e3 * t) * np.cos(2.0 * np.pi * 2e4 * t)
    path = write_csv(tmp_path / "ring.csv", "time (s),U (V)", t, y)
    made, _ = init(path, swift_fmu, out=tmp_path / "o", told={"fit": ["d1"]})
    [trace] = tomllib.loads(made.read_text("utf-8"))["trace"]
    assert trace["gain"] == "fit"


def test_two_lines_that_no_two_modes_have_are_told(tmp_path: Path) -> None:
    """Lines turned against each other by a detector: no modes of real shapes have such phases."""
    f = np.linspace(9.7e3, 10.55e3, 300)
    seen = mode(f, 10e3, 40.0) + 0.7 * np.exp(1.9j) * mode(f, 10.25e3, 60.0)
    seen = seen + noise(f.size, 1e-3, 4)
    path = write_csv(tmp_path / "two.csv", "f (Hz),X (V),Y (V)", f, seen.real, seen.imag)
    assert told_of(path, tmp_path / "o")["fmu"]["model"] == "CoupledModes2"


def test_columns_of_a_sweep_that_vary_and_are_not_used_are_named(tmp_path: Path) -> None:
    f = 10e3 + np.linspace(-200.0, 200.0, 81)
    seen = np.abs(mode(f, 10e3, 40.0) + noise(f.size, 1e-3, 4))
    head = "f (Hz),R (nm),T (K),shift (kHz),range (V)"
    path = write_csv(
        tmp_path / "s.csv",
        head,
        f,
        seen,
        4.0 + np.sin(0.01 * f),
        1e-3 * (f - 10e3),
        np.ones(f.size),
    )
    made, said = init(path, out=tmp_path / "o")
    for words in (" ".join(said), made.read_text("utf-8").partition("title")[0]):
        assert "column 'T' (K) of s.csv" in words
    assert "m, which suits the file's nm" in " ".join(said)


def test_an_earlier_draft_is_replaced_with_a_word(tmp_path: Path) -> None:
    f = 10e3 + np.linspace(-200.0, 200.0, 81)
    for width, replaced in ((40.0, False), (30.0, True), (30.0, False)):
        seen = np.abs(mode(f, 10e3, width))
        path = write_csv(tmp_path / "s.csv", "f (Hz),R (nm)", f, seen)
        _, said = init(path, out=tmp_path / "o")
        assert any("earlier draft" in each for each in said) is replaced


def test_a_power_among_amplitudes_is_not_drafted_as_one(tmp_path: Path) -> None:
    """It had two lines, or half of the width."""
    f = 10e3 + np.linspace(-200.0, 200.0, 81)
    power = np.abs(np.abs(mode(f, 10e3, 40.0)) ** 2 + noise(f.size, 1e-3, 4).real)
    path = write_csv(tmp_path / "s.csv", "f (Hz),R (mV)", f, power)
    with pytest.raises(ff.BadInput, match="looks like a power"):
        init(path, out=tmp_path / "o")
