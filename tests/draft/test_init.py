"""A campaign from files and an FMU: it runs unedited and finds what was put into the data."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.api.init import Question, init
from fitting.cli.main import main
from fitting.result.result import Result, read_result
from fitting.text.arrays import FloatArray
from tests.support.cfmu_build import build_c_fmu
from tests.support.lines import mode, noise, write_csv

ETA, WIDTH = 30_000.0, 25.0
F = ETA + np.linspace(-80.0, 80.0, 41)
MASS, DAMPING, STIFFNESS = 1e-3, 0.2, 4.1e3
F_LOW = np.linspace(286.0, 358.0, 9)


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
    quick = ["--no-report", "--no-profiles", "--workers", "1"]
    assert main(["reconstruct", campaign, "--out", str(results), *quick]) == 0
    return read_result(results / "result.json")


@pytest.mark.parametrize("phases", [True, False], ids=["phases", "amplitudes"])
def test_a_lock_in_file_alone_becomes_a_campaign_that_finds_the_truth(
    phases: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = fitted(tmp_path, [str(lock_in(tmp_path, phases=phases))])
    f, d = found.parameters["f1"], found.parameters["d1"]
    assert abs(f.value - ETA) < 4.0 * f.std < 1.0
    assert abs(d.value - WIDTH) < 4.0 * d.std < 1.0
    told = capsys.readouterr().out
    assert "A sweep of amplitude and phase" in told or not phases
    assert "output: readout" in told
    assert "next: fmu-fit reconstruct" in told


def test_the_fmu_of_somebody_else_is_looked_at_and_fitted(
    tmp_path: Path, cantilever: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = fitted(tmp_path, [str(driven(tmp_path)), "--fmu", str(cantilever)])
    told = capsys.readouterr().out
    assert "input: force, the only input" in told
    assert "with it eigenfrequency is the frequency of the line" in told
    assert set(found.parameters) == {"stiffness", "damping"}
    eigenfrequency = math.sqrt(STIFFNESS / MASS) / (2.0 * math.pi)
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
    for remark in ("nobody measured with", "frequency of the line in the sweep", "as they were"):
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


def test_an_fmu_alone_gives_a_skeleton_that_tells_what_is_missing(
    cantilever: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "skeleton"
    assert main(["init", str(cantilever), "--out", str(out), "--yes"]) == 0
    assert "missing: a measurement" in capsys.readouterr().out
    path = out / "campaign.toml"
    text = path.read_text("utf-8")
    written = tomllib.loads(text)
    assert written["observe"]["output"] == "displacement"
    assert written["drive"]["input"] == "force"
    assert [p["name"] for p in written["parameters"]] == ["stiffness", "damping"]
    assert "sweep" not in written
    assert main(["reconstruct", str(path)]) == 2
    assert "nothing to fit: wanted a table [experiments], or a [sweep]" in capsys.readouterr().err


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
    with pytest.raises(ff.BadInput, match="found 2 FMUs, wanted one"):
        init([cantilever], cantilever, out=tmp_path)
    with pytest.raises(ff.BadInput, match="neither an FMU nor a file"):
        init([], out=tmp_path)


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
    assert "output: q1, as asked for." in said


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["absent.csv"], "absent.csv"),
        (["lock-in.csv", "--output", "q2"], "--output: found 'q2'; there is: readout, q1"),
        (["lock-in.csv", "--fit", "f2"], "--fit: found 'f2'; there is: f1, d1"),
        (["lock-in.csv", "--tone", "u3"], "--tone: found 'u3'"),
        (["lock-in.csv", "--fmu", "absent.fmu"], "absent.fmu: no such file"),
        (["lock-in.csv", "--from"], "no option '--from'"),
        (["pairs.csv"], "wanted a sweep as well"),
        (["pairs.csv", "pairs.csv"], "are tables of experiments, wanted one"),
        (["lock-in.csv", "--unit-phase", "kg"], "found unit 'kg'"),
        (["lock-in.csv", "--real", "R"], "real: names a column alone"),
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
    assert told in complained
    assert complained.count("\n") == 1
    assert not (tmp_path / "drafted").exists()


def test_a_campaign_that_somebody_edited_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(lock_in(tmp_path, phases=False))
    words = ["init", file, "--out", str(tmp_path / "o"), "--yes"]
    assert main(words) == 0
    assert main(words) == 0
    path = tmp_path / "o" / "campaign.toml"
    path.write_text(path.read_text("utf-8") + "# mine\n", "utf-8")
    capsys.readouterr()
    assert main(words) == 2
    assert "was changed since fmu-fit init wrote it" in capsys.readouterr().err
    assert path.read_text("utf-8").endswith("# mine\n")
