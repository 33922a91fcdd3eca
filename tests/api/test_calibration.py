"""A fit handed on: the FMU with its values in hosts of others, parameter sets, what is left."""

from __future__ import annotations

import csv
import shutil
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.ssp.ssd import read_ssd, read_ssv

import fitting as ff
from fitting.cli.main import main
from fitting.draft.api import init
from fitting.fmu.description import read_description
from fitting.result.calibration import calibration, calibration_csv
from fitting.result.result import Result, read_result, write_result
from fitting.text.errors import BadInput
from fitting.text.estimate import Verdict
from tests.models.test_hosts_masters import rows
from tests.support.c_hosts import Pythonless
from tests.support.cfmu_build import build_c_fmu, reworded
from tests.support.fmus import unpack
from tests.support.twins import shipped_binary

pytestmark = pytest.mark.usefixtures("swift_models")

STEP_S, ROWS = 1e-6, 40
NAME = "CoupledOscillator_calibrated"


@pytest.fixture(scope="module")
def fitted(
    swift_models: None, oscillator_fmu: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The result of the measured sweep of a cantilever: both parameters are determined.

    The native twin has answered; what is handed on is the FMU that the campaign names.
    """
    out = tmp_path_factory.mktemp("fit")
    words = ["reconstruct", str(ff.example("afm_sensor")), "--out", str(out), "--no-report"]
    assert main([*words, "--quick", "--workers", "1"]) == 0
    shutil.copy(oscillator_fmu, out / "fmu")
    write_result(of_fmu(read_result(out / "result.json"), oscillator_fmu), out)
    return out / "result.json"


def of_fmu(result: Result, fmu: Path) -> Result:
    """The result as if this FMU had been fitted."""
    read = read_description(fmu)
    own = replace(result.provenance, fmu_guid=read.guid, fmu_sha256=read.sha256)
    return replace(result, provenance=own)


@pytest.fixture(scope="module")
def calibrated(fitted: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the command makes of it."""
    out = tmp_path_factory.mktemp("calibrated")
    assert main(["calibrate", str(fitted), "--out", str(out)]) == 0
    return out


def line(result: Result, times: np.ndarray, u_hz: float, amplitude: float) -> np.ndarray:
    """The textbook's periodic solution of q'' + 2 pi d q' + (2 pi eta)^2 q = A cos 2 pi u t."""
    eta, d = result.parameters["eta_plus"].value, result.parameters["d1"].value
    denominator = 4.0 * np.pi**2 * ((eta - u_hz) * (eta + u_hz) + 1j * u_hz * d)
    return np.asarray(np.real(amplitude / denominator * np.exp(2j * np.pi * u_hz * times)))


DRIVEN = {"u1": 30280.0, "u2": 30290.0, "A1": 1.0, "A2": 0.5}


def truth(result: Result, times: np.ndarray) -> np.ndarray:
    first = line(result, times, DRIVEN["u1"], DRIVEN["A1"])
    return np.asarray(first + line(result, times, DRIVEN["u2"], DRIVEN["A2"]))


def worst(found: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.max(np.abs(found - wanted)) / np.max(np.abs(wanted)))


def driven(fmu: Path, folder: Path) -> Path:
    """The FMU with the drive of these tests, by its own builder: hosts set nothing."""
    import build_fmu

    like = build_fmu.built_from(fmu)
    return build_fmu.build(like.model, folder, {**like.start_values, **DRIVEN})


def test_the_calibrated_fmu_answers_in_fmpy_as_the_textbook_does_at_the_fitted_values(
    calibrated: Path, fitted: Path
) -> None:
    fmu = calibrated / f"{NAME}.fmu"
    assert fmpy.read_model_description(fmu).modelName == NAME
    found = fmpy.simulate_fmu(
        fmu,
        stop_time=ROWS * STEP_S,
        output_interval=STEP_S,
        start_values=DRIVEN,
        output=["q1_hybrid"],
    )
    wanted = truth(read_result(fitted), found["time"])
    assert worst(found["q1_hybrid"], wanted) < 1e-9


def test_the_calibrated_fmu_answers_in_ecos_likewise(calibrated: Path, fitted: Path) -> None:
    words = [f"{name}={value!r}" for name, value in DRIVEN.items()]
    fmu = calibrated / f"{NAME}.fmu"
    found, _ = rows("ecospy.lib", "ecos_run.py", fmu, repr(STEP_S), 1, ROWS, *words)
    wanted = truth(read_result(fitted), np.array([float.fromhex(row.time) for row in found]))
    assert worst(np.array([row.values[0] for row in found]), wanted) < 1e-9


def test_a_native_twin_is_handed_on_as_a_native_twin(
    fitted: Path, twin_fmu: Path, tmp_path: Path, compiled: Callable[..., Path]
) -> None:
    """Its own start values are the fitted ones: the host sets those of the drive alone."""
    result = read_result(fitted)
    fitted_was = read_description(twin_fmu)
    made = ff.calibrate(of_fmu(result, twin_fmu), tmp_path / "out", fmu=twin_fmu)
    assert made.fmu is not None
    assert read_description(made.fmu).generation_tool == fitted_was.generation_tool
    assert not read_description(made.fmu).needs_execution_tool
    found = fmpy.simulate_fmu(
        made.fmu,
        stop_time=ROWS * STEP_S,
        output_interval=STEP_S,
        start_values=DRIVEN,
        apply_default_start_values=False,
        output=["q1_hybrid"],
    )
    assert worst(found["q1_hybrid"], truth(result, found["time"])) < 1e-9
    twin = unpack(made.fmu, tmp_path / "unpacked")
    host = Pythonless(compiled("replay"), twin, shipped_binary(twin.folder))
    times = [STEP_S * k for k in range(1, ROWS + 1)]
    script = ["new 0 a", *host.start(0, **DRIVEN), *host.steps(times, "q1_hybrid"), "free 0"]
    seen = np.array(host.play(script).reals())[:, 0]
    assert worst(seen, truth(result, np.array(times))) < 1e-9


def test_the_system_structure_answers_in_libcosim_likewise(
    calibrated: Path, fitted: Path, oscillator_fmu: Path, tmp_path: Path
) -> None:
    """Its FMU is exchanged for one with other values: those of the parameter set must act."""
    plain = driven(oscillator_fmu, tmp_path)
    packed = tmp_path / "system.ssp"
    with (
        zipfile.ZipFile(calibrated / f"{NAME}.ssp") as source,
        zipfile.ZipFile(packed, "w") as copy,
    ):
        for name in source.namelist():
            inside = plain.read_bytes() if name.endswith(".fmu") else source.read(name)
            copy.writestr(name, inside)
    found, last = rows("libcosimpy.CosimExecution", "cosim_ssp.py", packed, 1000, 1, ROWS)
    assert last == "end 0"
    ends = np.array([int(row.time) for row in found])
    times = (ends - 1000) / 1e9 + 1000 / 1e9
    # the set brings the frequency of the drive along, amplitudes and the second tone are the FMU's
    values = {p.name: p.value for p in read_ssv(str(calibrated / f"{NAME}.ssv")).parameters}
    result = read_result(fitted)
    wanted = line(result, times, float(values["u1"]), DRIVEN["A1"])
    wanted += line(result, times, DRIVEN["u2"], DRIVEN["A2"])
    assert worst(np.array([row.values[0] for row in found]), wanted) < 1e-9


def test_fmpy_reads_set_and_structure_by_the_standards_schemas(
    calibrated: Path, fitted: Path
) -> None:
    result = read_result(fitted)
    found = read_ssv(str(calibrated / f"{NAME}.ssv"), validate=True)
    values = {p.name: (p.type, p.value, p.unit) for p in found.parameters}
    for name in ("eta_plus", "d1"):
        assert values[name] == ("Real", repr(result.parameters[name].value), "Hz")
    assert values["periodic_start"][:2] == ("Boolean", "true")
    assert values["eta_minus"] == ("Real", "60000.0", "Hz")
    # the drive is at the top of the line, not at the FMU's own 6.94 MHz
    assert abs(float(values["u1"][1]) - result.parameters["eta_plus"].value) < 30.0
    with zipfile.ZipFile(calibrated / f"{NAME}.ssp") as archive:
        structure = archive.read("SystemStructure.ssd").decode()
    assert structure.count('unit="Hz"') > 5
    assert '<ssc:Unit name="Hz">' in structure
    text = (calibrated / f"{NAME}.ssv").read_text("utf-8")
    low, high = result.parameters["d1"].ci95
    assert f'ci95_low="{low!r}" ci95_high="{high!r}"' in text
    assert read_ssd(str(calibrated / f"{NAME}.ssp"), validate=True).name == NAME


def test_the_page_in_the_fmu_tells_where_its_values_come_from(
    calibrated: Path, fitted: Path
) -> None:
    result = read_result(fitted)
    with zipfile.ZipFile(calibrated / f"{NAME}.fmu") as archive:
        page = archive.read("documentation/index.html").decode()
    assert result.title in page
    assert result.provenance.fmu_guid in page
    assert read_description(calibrated / f"{NAME}.fmu").guid != result.provenance.fmu_guid


def with_verdict(result: Result, name: str, verdict: Verdict) -> Result:
    changed = replace(result.parameters[name], status=verdict)
    return replace(result, parameters={**result.parameters, name: changed})


@pytest.mark.parametrize(
    "verdict",
    [v for v in Verdict if v not in (Verdict.DETERMINED, Verdict.LINEARISED)],
    ids=lambda v: v.name,
)
def test_what_is_not_determined_is_left_and_named(verdict: Verdict, fitted: Path) -> None:
    description = read_description(fitted.parent / "fmu" / "CoupledOscillator.fmu")
    found = calibration(with_verdict(read_result(fitted), "d1", verdict), description, ())
    assert [p.name for p in found.handed] == ["eta_plus"]
    assert set(found.start_values) & {"d1", "eta_plus"} == {"eta_plus"}
    table = {row["name"]: row for row in csv.DictReader(calibration_csv(found).splitlines())}
    assert (table["d1"]["left"], table["eta_plus"]["left"]) == (str(verdict), "")


def test_where_nothing_is_determined_no_file_is_written(
    fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(fitted.parent / "fmu", tmp_path / "fmu")
    result = read_result(fitted)
    for name in result.parameters:
        result = with_verdict(result, name, Verdict.UNCONSTRAINED)
    write_result(result, tmp_path)
    words = ["calibrate", str(tmp_path / "result.json"), "--out", str(tmp_path / "none")]
    assert main(words) == 2
    assert "--all" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
    assert main([*words, "--all"]) == 0


def test_what_is_not_determined_is_handed_on_where_it_is_asked_for(
    fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(fitted.parent / "fmu", tmp_path / "fmu")
    write_result(with_verdict(read_result(fitted), "d1", Verdict.UNCONSTRAINED), tmp_path)
    words = ["calibrate", str(tmp_path / "result.json"), "--out", str(tmp_path / "all")]
    assert main([*words]) == 0
    assert "d1 (unconstrained: 24" in capsys.readouterr().out
    assert main([*words, "--all"]) == 0
    assert "d1 (= 24.8" in capsys.readouterr().out
    assert f'verdict="{Verdict.UNCONSTRAINED}"' in (tmp_path / "all" / f"{NAME}.ssv").read_text(
        "utf-8"
    )


def test_an_alternative_that_others_equal_is_left(fitted: Path) -> None:
    description = read_description(fitted.parent / "fmu" / "CoupledOscillator.fmu")
    result = read_result(fitted)
    one = result.alternatives[0]
    pair = tuple(replace(one, settings={"reflection": form}) for form in (False, True))
    chosen = replace(result, alternative={"reflection": False})
    alone = replace(chosen, alternatives=(pair[0], replace(pair[1], equal_to_best=False)))
    assert calibration(alone, description, ()).settings == {"reflection": False}
    tied = replace(chosen, alternatives=tuple(replace(a, equal_to_best=True) for a in pair))
    assert calibration(tied, description, ()).settings == {}
    assert calibration(tied, description, ()).open_settings == {"reflection": False}
    assert calibration(tied, description, ["reflection"]).settings == {"reflection": False}


def test_values_without_profiles_are_handed_on(fitted: Path) -> None:
    description = read_description(fitted.parent / "fmu" / "CoupledOscillator.fmu")
    result = read_result(fitted)
    for name in result.parameters:
        result = with_verdict(result, name, Verdict.LINEARISED)
    assert [p.name for p in calibration(result, description, ()).handed] == ["eta_plus", "d1"]


def test_the_fmu_that_a_campaign_names_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The driven oscillator in C: a unit that the FMU does not define is defined by SI."""
    monkeypatch.chdir(tmp_path)
    unit = '<Unit name="N/m"><BaseUnit kg="1" s="-2"/></Unit>'
    fmu = reworded(build_c_fmu(tmp_path), {unit: ""})
    f = np.linspace(286.0, 358.0, 13)
    w = 2.0 * np.pi * f
    rows = np.c_[f, 1.0 / np.abs(4100.0 - 1e-3 * w**2 + 0.2j * w)]
    np.savetxt(tmp_path / "sweep.csv", rows, delimiter=",", header="f (Hz),x (m)", comments="")
    init([tmp_path / "sweep.csv"], fmu, out="draft")
    out = Path("out")
    words = ["draft/campaign.toml", "--out", "out", "--workers", "1"]
    assert main(["reconstruct", *words, "--no-profiles", "--no-report"]) == 0
    assert main(["calibrate", str(out / "result.json"), "--out", str(tmp_path / "c")]) == 0
    [ssv] = (tmp_path / "c").glob("*.ssv")
    values = {
        p.name: (float(p.value), p.unit) for p in read_ssv(str(ssv), validate=True).parameters
    }
    k, c = values["stiffness"], values["damping"]
    assert k[0] / c[0] == pytest.approx(4100.0 / 0.2, rel=1e-3)
    assert (k[1], c[1]) == ("N/m", "N.s/m")
    text = "".join(ssv.read_text("utf-8").split())
    defined = '<ssc:Unitname="N/m"><ssc:BaseUnitkg="1"s="-2"factor="1.0"/></ssc:Unit>'
    assert defined in text


def test_an_fmu_of_others_goes_into_the_structure_as_it_is(fitted: Path, tmp_path: Path) -> None:
    """One more member in the archive: no builder here makes these bytes."""
    other = tmp_path / "fmu" / "CoupledOscillator.fmu"
    shutil.copytree(fitted.parent / "fmu", other.parent)
    with zipfile.ZipFile(other, "a") as archive:
        archive.writestr("resources/of_others.txt", "theirs")
    write_result(of_fmu(read_result(fitted), other), tmp_path)
    out = tmp_path / "c"
    assert main(["calibrate", str(tmp_path / "result.json"), "--out", str(out)]) == 0
    assert not list(out.glob("*.fmu"))
    with zipfile.ZipFile(out / f"{NAME}.ssp") as archive:
        assert archive.read("resources/CoupledOscillator.fmu") == other.read_bytes()


def test_a_fit_starts_where_another_ended(calibrated: Path, fitted: Path) -> None:
    path = ff.example("afm_sensor")
    problem = ff.Problem.of(path, start=calibrated / f"{NAME}.ssv")
    values = read_result(fitted).parameters
    assert dict(zip(problem.names, problem.start, strict=True)) == {
        name: value.value for name, value in values.items()
    }
    given = ff.Problem.of(path, start={"d1": 30.0})
    assert dict(zip(given.names, given.start, strict=True))["d1"] == 30.0


SET = (
    '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" '
    'version="1.0" name="x"><ssv:Parameters><ssv:Parameter name="{}"><ssv:{} value="{}"/>'
    "</ssv:Parameter></ssv:Parameters></ssv:ParameterSet>"
)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("no xml", "(.ssv)"),
        ("<a/>", "(.ssv)"),
        (SET.format("g1", "Real", "1"), "g1"),
        (SET.format("d1", "Boolean", "true"), "d1: found True"),
        (SET.format("d1", "Real", "1e6"), "1000000.0"),
    ],
    ids=["text", "other-xml", "not-fitted", "no-number", "outside"],
)
def test_start_values_that_do_not_fit_are_refused(text: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "set.ssv"
    path.write_text(text, "utf-8")
    with pytest.raises(BadInput) as caught:
        ff.Problem.of(ff.example("afm_sensor"), start=path)
    assert str(caught.value).startswith(str(path))
    assert told in str(caught.value)


def test_only_the_fmu_that_was_fitted_is_calibrated(
    fitted: Path, oscillator_fmu: Path, tmp_path: Path
) -> None:
    with pytest.raises(BadInput, match="sha256"):
        ff.calibrate(fitted, tmp_path / "c", fmu=driven(oscillator_fmu, tmp_path))
    write_result(read_result(fitted), tmp_path / "alone")
    with pytest.raises(BadInput, match=r"CoupledOscillator\.fmu.*--fmu"):
        ff.calibrate(tmp_path / "alone" / "result.json", tmp_path / "c")
    with pytest.raises(BadInput, match="also: 'd7'"):
        ff.calibrate(fitted, tmp_path / "c", also=["d7"])
    assert not (tmp_path / "c").exists()
