"""The names that `import fitting` offers: cheap, explained, and refusing nonsense in a sentence."""

from __future__ import annotations

import importlib.util
import inspect
import math
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import fitting as ff
from fitting.api.early import LEVELS_FILE
from fitting.cli.main import main
from fitting.design import FILES as DESIGN_FILES
from fitting.design import result as design_result
from fitting.design.api import CAMPAIGN_FOLDER, TABLE_NAME
from fitting.design.campaign import CAMPAIGN_NAME, EXPERIMENTS_NAME, SWEEP_NAME, SWEEPS_NAME
from fitting.fit import checkpoint
from fitting.lab import benches
from fitting.lab.names import BENCHES, CURVES, SCENES, SERIES
from fitting.lab.tradeoff import FILES as STUDY_FILES
from fitting.lab.tradeoff import ROWS_NAME
from fitting.result.result import write_result
from tests.support.processes import MOST_S

ROOT = Path(__file__).resolve().parents[2]
NAMES = [name for name in ff.__all__ if name != "__version__"]
DRIVE = ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2"))
SETUP = ff.Setup(DRIVE, "q1_hybrid", start_values={"periodic_start": True}, steady_start=True)
F_HZ = 6.94026e6 + np.linspace(-200.0, 200.0, 21)
A_V = 1e-5 / np.hypot(1.0, 2.0 * (F_HZ - 6.94026e6) / 95.0)


def told(script: str, *arguments: str) -> str:
    """What a fresh interpreter prints."""
    words = [sys.executable, "-c", script, *arguments]
    done = subprocess.run(
        words, capture_output=True, text=True, cwd=ROOT, timeout=MOST_S, check=True
    )
    return done.stdout.strip()


def test_importing_the_package_loads_nothing_else() -> None:
    script = (
        "import sys; before = set(sys.modules); import fitting; fitting.__version__; "
        "loaded = {name.partition('.')[0] for name in set(sys.modules) - before}; "
        "print(sorted(loaded - sys.stdlib_module_names), "
        "[n for n in sys.modules if n.startswith('fitting.')])"
    )
    assert told(script) == "['fitting'] []"


def test_names_that_stand_by_themselves_are_those_of_the_rooms() -> None:
    """Help lists them before the rooms are loaded: no job writes or knows others."""
    assert checkpoint.NAME == LEVELS_FILE
    assert {design_result.NAME, TABLE_NAME} < set(DESIGN_FILES)
    proposed = {CAMPAIGN_NAME, EXPERIMENTS_NAME, f"{SWEEP_NAME}.*", SWEEPS_NAME}
    assert {f"{CAMPAIGN_FOLDER}/{name}" for name in proposed} < set(DESIGN_FILES)
    assert ROWS_NAME in STUDY_FILES
    assert (*benches.SERIES_THETA, *benches.PUBLISHED_BEND_HZ, "duffing") == BENCHES
    assert {name for _, name in SCENES.values()} <= {*SERIES, *CURVES}


#: For each room as in an interpreter of its own: what the package had loaded is forgotten before.
IMPORTS = """
import importlib, sys
for room in sys.argv[1:]:
    for name in [n for n in sys.modules if n.partition(".")[0] == "fitting"]:
        del sys.modules[name]
    namespace = {}
    exec(f"import fitting.{room}; from fitting.fit.problem import Problem", namespace)
    first = callable(getattr(namespace["fitting"], room))
    importlib.import_module(f"fitting.{room}")
    exec(f"from fitting import {room}", namespace)
    print(room, first, callable(namespace[room]), sys.modules[f"fitting.{room}"].__name__)
"""


@pytest.mark.parametrize(
    "rooms", [("fit",), pytest.param(("simulate", "design", "report"), marks=pytest.mark.nightly)]
)
def test_a_verb_is_a_verb_whatever_was_imported_before(rooms: tuple[str, ...]) -> None:
    wanted = [[room, "True", "True", f"fitting.{room}"] for room in rooms]
    assert [line.split() for line in told(IMPORTS, *rooms).splitlines()] == wanted


def test_every_name_is_there_and_listed() -> None:
    assert len(NAMES) == len(set(NAMES))
    assert dir(ff) == ff.__all__ == sorted(ff.__all__)
    for name in NAMES:
        public = getattr(ff, name)
        assert public is not None
        assert getattr(public, "__name__", name).rpartition(".")[2] == name
    with pytest.raises(AttributeError, match="'solve'"):
        _ = ff.solve  # type: ignore[attr-defined]


def test_a_line_prints_itself_as_the_command_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    noise = 1.0 + 0.01 * np.random.default_rng(1).standard_normal(F_HZ.size)
    file = tmp_path / "sweep.csv"
    rows = zip(F_HZ.tolist(), (A_V * noise).tolist(), strict=True)
    file.write_text("frequency (Hz),amplitude (V)\n" + "".join(f"{f!r},{a!r}\n" for f, a in rows))
    found = ff.line(file)
    assert main(["line", str(file)]) == 0
    assert f"{found}\n" == capsys.readouterr().out
    assert str(found).startswith("f ")
    assert isinstance(found, ff.Line)


def callables() -> list[tuple[str, Callable[..., Any], str]]:
    """Public functions, classes, and the public methods of these, with their documentation.

    What a method's arguments are may be explained where it is declared first, in a base.
    """
    found: list[tuple[str, Callable[..., Any], str]] = []
    for name in NAMES:
        public = getattr(ff, name)
        if not callable(public):
            continue
        found.append((name, public, inspect.getdoc(public) or ""))
        if inspect.isclass(public) and not issubclass(public, Exception):
            members = inspect.getmembers(public, callable)
            for n, member in members:
                texts = (inspect.getdoc(getattr(c, n, None)) or "" for c in public.__mro__)
                if not n.startswith("_"):
                    found.append((f"{name}.{n}", member, "\n".join(texts)))
    return found


#: What the package makes, never its users.
MADE = ("Ensemble", "Fit", "Inference", "Line", "NoiseLine", "Ringdown", "Value")


@pytest.mark.parametrize(
    ("name", "public", "text"), [pytest.param(*one, id=one[0]) for one in callables()]
)
def test_every_argument_is_explained(name: str, public: Callable[..., Any], text: str) -> None:
    assert len(text.splitlines()[0]) > 20, name
    if name in MADE or issubclass_of_exception(public):
        return
    for argument in inspect.signature(public).parameters.values():
        if argument.name in ("self", "cls"):
            continue
        said = re.search(rf"(^\s*|``|\*\*){argument.name}(:|``)", text, re.MULTILINE)
        assert said, f"{name}: {argument.name} is not explained"


def issubclass_of_exception(public: object) -> bool:
    return inspect.isclass(public) and issubclass(public, Exception)


@pytest.mark.parametrize(
    ("public", "argument"),
    [
        (ff.Tones, "drive_hz"),
        (ff.Tones, "peaks_v"),
        (ff.Tones, "sigmas_v"),
        (ff.Tones, "lines_hz"),
        (ff.Sweep, "frequency_hz"),
        (ff.Sweep, "amplitude_v"),
        (ff.Sweep, "phase_rad"),
        (ff.sweep, "frequency_hz"),
        (ff.Problem.logp, "p"),
        (ff.Problem.residuals, "p"),
        (ff.Problem.jac, "p"),
    ],
)
def test_arrays_have_a_shape_and_a_unit(public: Callable[..., Any], argument: str) -> None:
    text = (inspect.getdoc(public) or "").partition("Args:")[2]
    [said] = re.findall(rf"^    {argument}: (.*(?:\n        .*)*)", text, re.MULTILINE)
    assert re.search(r"shape \([^)]*\)", said)
    assert re.search(r"Hz|rad|unit", said)


REFUSED: list[tuple[Callable[[], object], str]] = [
    (lambda: ff.Parameter("d1", 94.0, bounds=(1000.0, 1.0)), "d1"),
    (lambda: ff.Parameter("d1", 0.5, bounds=(1.0, 1000.0)), "0.5"),
    (lambda: ff.Parameter("d1", 94.0, bounds=(1.0, 1000.0), prior=0.0), "prior"),
    (lambda: ff.Parameter("d1", 94.0, bounds=(1.0, 1000.0), scope="row"), "scope is 'row'"),
    (lambda: ff.Parameter("d1", "4 Hzz", bounds=(1.0, 9.0)), "'Hzz'"),
    (
        lambda: ff.Parameter("d1", "4 Hzz", bounds=(1.0, 9.0), unit="kHz"),
        "parameter 'd1': start: found '4 Hzz'",
    ),
    (lambda: ff.Parameter("d1", "4 Hz", bounds=("9 Hz", "1 kHz")), "[9.0, 1000.0]"),
    (lambda: ff.Parameter("d1", "4 m", bounds=(1, 9), unit="Hz"), "'m', wanted 'Hz'"),
    (lambda: ff.Parameter("d1", [4.0], bounds=(1.0, 9.0)), "start is [4.0]"),  # type: ignore[arg-type]
    (lambda: ff.fit([1]), "fit: problem is [1]"),  # type: ignore[arg-type]
    (lambda: ff.profile("fit"), "profile: fit is"),  # type: ignore[arg-type]
    (lambda: ff.identify(1), "identify: problem is 1"),  # type: ignore[arg-type]
    (lambda: ff.design(1), "design: problem is 1"),  # type: ignore[arg-type]
    (lambda: ff.report(1, "out"), "report: result is 1"),  # type: ignore[arg-type]
    (lambda: ff.Sweep(SETUP, F_HZ, ["a"] * 21), "sweep: amplitude_v"),
    (lambda: ff.Drive(frequency_names=("u1",)), "0 amplitude_names"),
    (lambda: ff.Sweep(ff.Setup(ff.Drive(), "q1"), F_HZ, F_HZ), "drive"),
    (lambda: ff.Drive(frequency_names="u1", amplitude_names=("A1",)), "frequency_names"),  # type: ignore[arg-type]
    (lambda: ff.Tones(SETUP, [[1e6]], [[1e-5]]), "drive_hz has the shape (1, 1)"),
    (lambda: ff.Tones(SETUP, [[1e6, 2e6]], [[1e-5, -1e-5]]), "-1e-05"),
    (lambda: ff.Tones(SETUP, [[1e6, 2e6]], [[1e-5]]), "1 of them, wanted 2"),
    (lambda: ff.Tones(SETUP, [[1e6, 2e6]], [[1.0, 1.0]], settings={"A1": [1, 2]}), "'A1' have"),
    (lambda: ff.Sweep(SETUP, F_HZ[::-1], A_V), "rise strictly"),
    (lambda: ff.Sweep(SETUP, F_HZ, A_V[:-1]), "20 of them, wanted 21"),
    (lambda: ff.Sweep(SETUP, F_HZ, A_V, scale="top"), "scale is 'top'"),
    (lambda: ff.Sweep(SETUP, F_HZ, 1j * A_V), "amplitude_v"),
    (lambda: ff.Sweep(DRIVE, F_HZ, A_V), "setup is a Drive"),  # type: ignore[arg-type]
    (lambda: ff.Tikhonov(beta=1.0), "beta is 1.0"),
    (lambda: ff.Tikhonov(levels=0), "levels is 0"),
    (lambda: ff.Tikhonov(misfit="cubes"), "misfit is 'cubes'"),
    (lambda: ff.Tikhonov(estimator="mean"), "estimator is 'mean'"),
    (lambda: ff.Noise(relative=1.5), "relative 1.5"),
    (lambda: ff.Fmu("absent.fmu"), "absent.fmu"),
    (lambda: ff.Fmu("NoSuchModel"), "NoSuchModel"),
    (lambda: ff.example("nothing"), "wanted one of"),
]


@pytest.mark.parametrize(("make", "words"), REFUSED)
def test_nonsense_is_refused_where_it_is_made(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ff.BadInput, match=re.escape(words)) as refused:
        make()
    assert len(str(refused.value).splitlines()) == 1


@pytest.fixture(scope="module")
def fmu(swift_fmu: Path) -> ff.Fmu:
    return ff.Fmu(swift_fmu, workers=1)


def problem(fmu: ff.Fmu, *sweeps: ff.Sweep | ff.Tones, **changes: Any) -> ff.Problem:
    parameters = [
        ff.Parameter("theta", 1.9, bounds=(0.0, math.pi), unit="rad"),
        ff.Parameter("d1", 0.1, bounds=(0.001, 1.0), unit="kHz", reference=0.094),
        ff.Parameter("d2", 100.0, bounds=(1.0, 1000.0)),
    ]
    given: dict[str, Any] = {"derived": ["lambda", "width_plus"], "noise": ff.Noise(relative=0.01)}
    measured = sweeps or (ff.Sweep(SETUP, F_HZ, A_V),)
    return ff.Problem(fmu, parameters, measured, **(given | changes))


def driven(**changes: Any) -> ff.Sweep:
    return ff.Sweep(replace(SETUP, drive=replace(DRIVE, **changes)), F_HZ, A_V)


def started(**values: Any) -> ff.Sweep:
    return ff.Sweep(replace(SETUP, start_values=values), F_HZ, A_V)


TONES = partial(ff.Tones, SETUP, [[6.94e6, 6.9402e6]], [[1e-5, 1e-5]])


def test_what_only_the_fmu_can_tell_is_refused_beside_it(fmu: ff.Fmu) -> None:
    other = ff.Setup(DRIVE, "q2_hybrid", start_values={"periodic_start": True}, steady_start=True)
    sweep = ff.Sweep(SETUP, F_HZ, A_V)
    for make, words in (
        (lambda: problem(fmu, derived=["lamda"]), "'lambda'"),
        (lambda: problem(fmu, ff.Sweep(SETUP, F_HZ, A_V, settings={"theta": 1.0})), "'theta' is"),
        (lambda: problem(fmu, sweep, sweep), "2 sweeps"),
        (lambda: problem(fmu, sweep, ff.Sweep(other, F_HZ, A_V)), "different setups"),
        (lambda: problem(fmu, ff.Sweep(SETUP, F_HZ, A_V, use="scale")), "nothing to fit"),
        (lambda: problem(fmu, driven(frequency_unit="kHz")), "frequency_unit is 'kHz'"),
        (lambda: problem(fmu, driven(amplitude_names=("A1", "A3"))), "setup: drive: "),
        (lambda: problem(fmu, started(d1="3 Hz")), "'d1'"),
        (lambda: problem(fmu, started(d9=3.0)), "setup: start_values: d9: "),
        (
            lambda: problem(fmu, started(eta_plus="3 Hzz")),
            "setup: start_values: eta_plus: found '3 Hzz'",
        ),
        (
            lambda: problem(fmu, ff.Sweep(SETUP, F_HZ, A_V, settings={"dd": 1.0}, series="b")),
            "series 'b': sweep: settings: dd: ",
        ),
        (
            lambda: problem(fmu, sweep, TONES(amplitude_unit="m")),
            "sweep in 'V', tones in 'm'",
        ),
        (lambda: problem(fmu, TONES()), "tones: amplitude_unit: "),
        (
            lambda: problem(fmu, TONES(amplitude_unit="m", settings={"d2": "1 V"}, series="c")),
            "series 'c': tones: experiment '1': d2: ",
        ),
        (lambda: problem(fmu, alternatives={"g1": 1.0}), "alternatives: g1: found 1.0"),
        (lambda: problem(fmu, 1), "measurements hold a int"),  # type: ignore[arg-type]
        (lambda: fmu.simulate({"u1": "3 kg"}), "u1"),
        (lambda: fmu.simulate(tones=("theta",)), "theta"),
        (lambda: problem(fmu).logp([1.0, 2.0]), "(..., 3)"),
    ):
        with pytest.raises(ff.BadInput, match=re.escape(words)):
            make()


def test_quantities_are_numbers_in_their_own_unit(fmu: ff.Fmu) -> None:
    d1 = ff.Parameter("d1", "0.1 kHz", bounds=("1 Hz", 1000.0), reference="94 Hz", scale="0.05 kHz")
    d2 = ff.Parameter("d2", 0.1, bounds=("1 Hz", 1.0), unit="kHz")
    posed = ff.Problem(fmu, [d1, d2], ff.Sweep(SETUP, F_HZ, A_V))
    assert posed.start.tolist() == [100.0, 100.0]
    assert [end.tolist() for end in posed.bounds] == [[1.0, 1.0], [1000.0, 1000.0]]
    assert posed.from_search([0.0, 0.0]).tolist() == [94.0, 100.0]
    assert posed.from_search([1.0, 0.0])[0] == 144.0
    # a bound in the FMU's unit, which is known only there
    with pytest.raises(ff.BadInput, match=r"'d1': .*2000"):
        ff.Problem(fmu, ff.Parameter("d1", 5.0, bounds=("2 kHz", 9.0)), driven())


def test_a_variable_of_single_experiments_may_have_a_start_value_for_the_sweep(
    fmu: ff.Fmu,
) -> None:
    setup = replace(SETUP, start_values={"eta_plus": 6.94e6})
    own = ff.Parameter("eta_plus", 6.9401e6, bounds=(6.93e6, 6.95e6), scope="experiment")
    measured: list[ff.Tones | ff.Sweep] = [
        ff.Tones(setup, [[6.94e6, 6.9402e6]], [[1e-5, 1e-5]]),
        ff.Sweep(setup, F_HZ, A_V),
    ]
    assert ff.Problem(fmu, own, measured).names == ("eta_plus[1]",)


def test_an_open_value_is_nan_and_has_a_range(
    fmu: ff.Fmu, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    posed = problem(fmu)
    assert posed.start.tolist() == [1.9, 100.0, 100.0]  # in the FMU's units
    found = ff.fit(posed, ff.Tikhonov(levels=2), starts=1)
    assert found.success
    assert (found.status, found.x.shape) == ("converged", (3,))
    assert [row.nu for row in found.path][-2:] == pytest.approx([0.1, 0.01])
    assert found.fun == found.record.solution.final.j_fit
    for name, verdict in (("lambda", "not known"), ("width_plus", "linearised only")):
        assert found[name].status == verdict
    coupling, width = found["lambda"], found["width_plus"]
    assert math.isnan(coupling.value)
    assert math.isnan(coupling.std)
    # between no coupling (theta a multiple of pi/2) and f_minus^2 - f_plus^2 = 2 lambda^2 ...
    assert coupling.bounds[0] < 1e3 < 7e5 < coupling.bounds[1]
    assert math.isfinite(coupling.likely)
    # the sweep is an exact line of 95 Hz
    assert width.value == pytest.approx(95.0, abs=0.5)
    low, high = width.interval(0.68)
    assert high - low == pytest.approx(2.0 * width.std)
    assert width.interval()[0] < low < high < width.interval()[1]
    with pytest.raises(ff.BadInput, match=r"0\.68 or 0\.95"):
        width.interval(0.5)
    with pytest.raises(KeyError, match="'width_plus'"):
        _ = found["width_pluss"]
    with pytest.raises(ff.BadInput, match="'widht'"):
        ff.profile(found, ["widht"])
    rows = {row["name"]: row for row in found.to_dict()}
    assert rows["width_plus"]["value"] == width.value
    assert all(isinstance(cell, str | float) for row in rows.values() for cell in row.values())
    text = repr(found)
    assert len(text.splitlines()) < 24
    assert f"{width.std:.2g}" in text
    assert "<table" in found._repr_html_()
    assert found.result.parameters["d1"].unit == "Hz"
    check_intervals(text, *width.interval())
    check_names(found)
    check_stored(found, tmp_path)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ff.BadInput, match="pip install pandas"):
        found.to_dataframe()


def check_names(found: ff.Fit) -> None:
    """Names of scipy and lmfit."""
    assert list(found.params) == ["theta", "d1", "d2"]
    std = np.array([value.std for value in found.params.values()])
    np.testing.assert_allclose(np.sqrt(np.diag(found.covar)), std)
    np.testing.assert_allclose(np.diag(found.correl), 1.0)
    assert found.redchi == pytest.approx(found.chisqr / found.dof, nan_ok=True)
    assert found.aic == pytest.approx(found.chisqr + 6.0, nan_ok=True)
    assert [end.tolist() for end in found.bounds] == [[0.0, 1.0, 1.0], [math.pi, 1000.0, 1000.0]]
    np.testing.assert_allclose(found.best_fit + found.residual, A_V)


def check_stored(found: ff.Fit, folder: Path) -> None:
    """What is read back is the same, but for the fit."""
    path, _ = write_result(found.result, folder)
    stored = ff.read_result(path)
    assert isinstance(stored, ff.Inference)
    assert list(stored.values) == list(found.values)
    for name in ("correl", "covar", "bounds", "chisqr", "dof", "aic", "best_fit", "residual"):
        np.testing.assert_array_equal(getattr(stored, name), getattr(found, name))
    assert repr(stored["width_plus"]) == repr(found["width_plus"])
    assert stored.fit_report() == found.fit_report()
    assert "<table" in stored._repr_html_()
    for each in (stored, found):
        assert each.plot(ax=Figure().subplots()).lines
    with pytest.raises(ff.BadInput, match="no fit"):
        _ = stored.source
    with pytest.raises(ff.MissingFile, match="no such file") as missing:
        ff.read_result(folder / "absent.json")
    assert isinstance(missing.value, ff.BadInput | FileNotFoundError | ValueError)


def check_intervals(text: str, low: float, high: float) -> None:
    """The table has a column of them, a dash where the data leave a value open."""
    [row] = [line for line in text.splitlines() if line.startswith("width_plus ")]
    said = re.search(r" ([\d.]+) to ([\d.]+) ", row)
    assert "95 % interval" in text
    assert said is not None
    assert [float(end) for end in said.groups()] == pytest.approx([low, high], rel=1e-4)
    [row] = [line for line in text.splitlines() if line.startswith("lambda ")]
    assert row.split()[1:5] == ["-", "Hz", "-", "-"]


def test_tones_of_arrays_are_those_of_a_campaign(fmu: ff.Fmu) -> None:
    campaign = ff.Problem.of(ff.example("string_q1"), fmu)
    [bound] = campaign.record.campaigns.values()
    tones = ff.Tones(
        SETUP,
        [e.tones_hz for e in bound.experiments],
        [e.peaks_v for e in bound.experiments],
        sigmas_v=[e.sigmas_v for e in bound.experiments],
        settings={
            name: [e.settings[name] for e in bound.experiments]
            for name in ("eta_plus", "eta_minus")
        },
        labels=[e.label for e in bound.experiments],
    )
    assert bound.sweep is not None
    sweep = ff.Sweep(
        SETUP,
        bound.sweep.frequency_hz,
        bound.sweep.amplitude_v,
        settings=dict(bound.sweep.settings),
        use="scale",
        scale="maximum",
    )
    given = [
        ff.Parameter(p.name, p.start, bounds=(p.lower, p.upper), scale=p.scale, period=p.period)
        for p in bound.parameters
        if not p.experiments
    ]
    posed = ff.Problem(fmu, given, [tones, sweep], alternatives={"reflection": [False, True]})
    p = np.array([1.95, 120.0, 90.0])
    straight = np.concatenate([p, np.zeros(len(bound.experiments))])  # without its offsets
    assert posed.residuals(p) == pytest.approx(campaign.residuals(straight), rel=1e-12, abs=1e-15)


def test_each_alternative_has_its_own_answers(fmu: ff.Fmu) -> None:
    posed = problem(fmu, alternatives={"eta_plus": [6.94026e6, 6.94030e6]})
    rows = posed.residuals(posed.start)
    moved = posed.with_alternative(1).residuals(posed.start)
    # the second line stands two points of the sweep further up
    assert int(np.argmax(moved * np.max(A_V) + A_V)) - int(np.argmax(rows * np.max(A_V) + A_V)) == 2
    assert np.array_equal(posed.residuals(posed.start), rows)
    with pytest.raises(ff.BadInput, match="there are 2"):
        posed.with_alternative(2)


def test_an_fmu_simulates_with_units_and_ends_its_workers(oscillator_fmu: Path) -> None:
    with ff.Fmu(oscillator_fmu, workers=1) as held:
        spectrum = held.simulate(
            {"theta": 1.95, "u1": "6.94016 MHz", "periodic_start": True}, outputs="q1_hybrid"
        )
        assert spectrum.drive.tones_hz[0] == 6940160.0
        assert spectrum.peaks.shape == (2, 1)
        assert held.workers.pids
    assert not held.workers.pids
    assert "theta" in held.variables
    assert "CoupledOscillator" in repr(held)
