"""Campaign files: what is read, what the FMU makes of it, and a complaint for every wrong line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.campaign.binder import Binder
from fitting.fmu.description import FmuVariable, Kind, read_description
from fitting.lab.bench import measure
from fitting.lab.benches import string_bench
from fitting.lab.writer import campaign_files
from fitting.text.errors import BadInput
from fitting.text.finding import Kind as FindingKind

DATA = Path(__file__).parents[2] / "data"


def variable(
    name: str,
    kind: Kind = "Real",
    *,
    unit: str | None = None,
    causality: str = "parameter",
    initial: str | None = None,
    variability: str = "continuous",
) -> FmuVariable:
    """A variable as a modelDescription.xml would declare it."""
    return FmuVariable(
        name=name,
        kind=kind,
        causality=causality,
        variability=variability,
        initial=initial,
        unit=unit,
        start=None,
        min=0.0 if unit == "Hz" and causality == "parameter" else None,
        max=None,
        description="",
        value_reference=0,
        fmi_type=kind,
    )


def oscillator() -> dict[str, FmuVariable]:
    """The variables of the CoupledOscillator that the campaigns name, with their units."""
    hz = ["d1", "d2", "eta_plus", "eta_minus", "u1", "u2"]
    table = [variable(n, unit="Hz") for n in hz]
    table += [variable(n, unit="rad") for n in ("theta", "phase1", "phase2")]
    table += [variable(n) for n in ("A1", "A2", "g1", "g2")]
    table += [variable(n, "Boolean") for n in ("reflection", "periodic_start")]
    table += [variable("solver", "Integer"), variable("note", "String")]
    table += [variable(n, causality="output") for n in ("q1_hybrid", "q2_hybrid")]
    table += [variable(n, unit="Hz", causality="output") for n in ("lambda", "f1", "f2")]
    table += [variable(n, unit="1/s", causality="output") for n in ("D11", "D22", "D12")]
    table += [variable(n, unit="Hz", causality="output") for n in ("width_plus", "width_minus")]
    table += [variable(n, causality="output") for n in ("Q_plus", "Q_minus")]
    table += [variable("b", causality="input")]
    return {v.name: v for v in table}


@pytest.fixture(scope="module")
def texts() -> dict[str, str]:
    """A synthetic campaign with noise."""
    return campaign_files(measure(string_bench("q1"), 1), "cmd")


def lay(folder: Path, texts: Mapping[str, str], *edits: tuple[str, str, str]) -> Path:
    """Write the campaign with some text replaced; the campaign file's path."""
    changed = dict(texts)
    for name, old, new in edits:
        assert old in changed[name], f"{old!r} is not in {name}"
        changed[name] = changed[name].replace(old, new)
    for name, text in changed.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder / "campaign.toml"


def bound(path: Path, variables: Mapping[str, FmuVariable] | None = None) -> BoundCampaign:
    return bind(read_campaign(path), variables or oscillator())


def test_the_string_campaign_in_the_fmus_units(tmp_path: Path, texts: dict[str, str]) -> None:
    campaign = bound(lay(tmp_path, texts))
    assert campaign.synthetic
    assert campaign.setup.steady_start
    assert campaign.setup.output == "q1_hybrid"
    assert campaign.setup.start_values == {"periodic_start": True}
    assert campaign.alternatives == ({"reflection": False}, {"reflection": True})
    assert campaign.setup.drive.amplitude == 1.0
    assert campaign.setup.drive.frequency_names == ("u1", "u2")
    first, last = campaign.experiments[0], campaign.experiments[4]
    assert first.tones_hz == (6940160.0, 6940360.0)
    assert (first.settings["u1"], first.settings["u2"]) == first.tones_hz
    before, after = campaign.drift.ends["eta_plus"]
    assert first.settings["eta_plus"] == before
    assert last.settings["eta_plus"] == after
    middle = campaign.experiments[2].settings["eta_plus"]
    assert middle == pytest.approx(0.5 * (before + after), abs=1e-6)
    assert first.spectrum is not None
    assert first.spectrum.frequency_hz.size == 501
    assert 0.1e-6 < first.sigmas_v[0] < 0.3e-6
    assert 0.15e-6 < first.floor_v < 0.35e-6
    sweep = campaign.sweep
    assert sweep is not None
    assert sweep.settings["eta_plus"] == before
    assert np.max(sweep.amplitude_v) == pytest.approx(40e-6, rel=0.03)
    theta, d1, *_ = campaign.parameters
    assert theta.start == 0.0
    assert theta.reference == pytest.approx(math.pi / 2 + math.pi / 8)
    assert theta.period == pytest.approx(math.pi, rel=1e-15)
    assert d1.start == pytest.approx(94.1, abs=1.5)
    assert (d1.lower, d1.upper) == (1.0, 1000.0)
    assert campaign.continuation is not None
    assert campaign.continuation.iterations == 9
    assert campaign.continuation.nu_start == 0.1
    assert [p.name for p in campaign.files[:2]] == ["campaign.toml", "experiments.csv"]
    assert len(campaign.files) == 8
    assert campaign.notes == ()


@pytest.mark.parametrize("name", ["string_q1", "string_q2", "afm_sensor"])
def test_shipped_campaigns_are_readable(name: str) -> None:
    campaign = bound(DATA / name / "campaign.toml")
    assert campaign.synthetic == name.startswith("string")
    assert len(campaign.experiments) == (5 if campaign.synthetic else 0)


@pytest.mark.parametrize("name", ["string_q1", "string_q2", "afm_sensor"])
def test_shipped_campaigns_suit_the_built_fmu(oscillator_fmu: Path, name: str) -> None:
    variables = read_description(oscillator_fmu).variables
    campaign = bind(read_campaign(DATA / name / "campaign.toml"), variables)
    assert campaign.notes == ()
    assert {p.unit for p in campaign.parameters} <= {"rad", "Hz"}


def test_afm_campaign_is_a_sweep_alone() -> None:
    campaign = bound(DATA / "afm_sensor" / "campaign.toml")
    sweep = campaign.sweep
    assert sweep is not None
    assert (sweep.use, sweep.scale, sweep.unit) == ("fit", "fit", "m")
    assert sweep.frequency_hz[0] == 30282.9 - 38.1
    assert sweep.amplitude_v[0] == 520.545e-12
    assert sweep.phase_rad is not None
    assert sweep.phase_rad[0] == pytest.approx(math.radians(90.306), rel=1e-12)
    assert sweep.notes is not None
    assert sweep.notes["Q"] == "1161"
    assert campaign.setup.start_values["eta_minus"] == 60000.0
    assert campaign.alternatives == ({},)
    assert campaign.amplitude_unit == "m"


READY = (
    "experiment;u1 (MHz);u2 (kHz);solver;reflection;phase1 (deg);note;"
    "p (uV);q (uV);sp (nV);sq (nV)\n"
    "a;6,94016;6940,36;2;true;180;hot;10,5;20;100;200\n"
    "b;6,94018;6940,34;0;false;0;cold;11,5;21;100;200\n"
)


def ready(folder: Path, texts: dict[str, str], *edits: tuple[str, str, str]) -> Path:
    spectra = 'spectra = "spectra/{experiment}.csv"\nlayout = "csv"\namplitude = "V peak"'
    columns = 'peaks = ["p", "q"]\npeak_sigmas = ["sp", "sq"]\namplitude = "V rms"'
    small = {**texts, "experiments.csv": READY}
    alternatives = ("campaign.toml", "reflection = [false, true]", "")
    return lay(folder, small, ("campaign.toml", spectra, columns), alternatives, *edits)


def test_ready_peaks_and_columns_of_any_kind(tmp_path: Path, texts: dict[str, str]) -> None:
    campaign = bound(ready(tmp_path, texts))
    a, b = campaign.experiments
    np.testing.assert_allclose(a.peaks_v, math.sqrt(2) * np.array([10.5e-6, 20e-6]), rtol=1e-15)
    np.testing.assert_allclose(b.sigmas_v, math.sqrt(2) * np.array([1e-7, 2e-7]), rtol=1e-15)
    assert a.tones_hz == (6940160.0, 6940360.0)
    assert a.spectrum is None
    assert (a.settings["solver"], a.settings["reflection"], a.settings["note"]) == (2, True, "hot")
    assert (b.settings["solver"], b.settings["reflection"]) == (0, False)
    assert a.settings["phase1"] == pytest.approx(math.pi, rel=1e-15)
    assert "p" not in a.settings
    assert "experiment" not in a.settings


def test_peaks_without_sigmas_have_unknown_ones(tmp_path: Path, texts: dict[str, str]) -> None:
    path = ready(
        tmp_path,
        texts,
        ("campaign.toml", 'peak_sigmas = ["sp", "sq"]\n', ""),
        ("experiments.csv", ";sp (nV);sq (nV)", ""),
        ("experiments.csv", ";100;200", ""),
    )
    assert np.all(np.isnan(bound(path).experiments[0].sigmas_v))


FREE = (
    'kind = "input"\nfrequencies = ["f"]\ninput = "force"\nlevel = "2 mN"\nsamples_per_period = 64'
)


def test_a_generated_input_of_a_foreign_fmu(tmp_path: Path, texts: dict[str, str]) -> None:
    tones = 'kind = "tones"\nfrequencies = ["u1", "u2"]\namplitudes = ["A1", "A2"]\nlevel = 1.0'
    toml = texts["campaign.toml"].replace(tones, FREE).replace('model = "Cou', 'file = "x/Cou')
    toml = toml.replace("periodic_start = true ", "mass = 1e-3 ").replace("q1_hybrid", "x")
    toml = toml[: toml.index("[drift]")] + (
        '[[parameters]]\nname = "k"\nunit = "N/m"\nlower = 1\nupper = 2\nstart = 1.5\n'
    )
    toml = toml.replace('spectra = "spectra/{experiment}.csv"', 'peaks = ["p"]')
    files = {
        "campaign.toml": toml.replace('layout = "csv"\n', ""),
        "experiments.csv": "experiment,f (Hz),p (V)\n1,10,1\n",
    }
    variables = [
        variable("force", unit="N", causality="input"),
        variable("x", causality="output"),
        variable("mass"),
        variable("k"),
    ]
    campaign = bound(lay(tmp_path, files), {v.name: v for v in variables})
    assert campaign.setup.drive.amplitude == 0.002
    assert campaign.setup.drive.input == "force"
    assert campaign.setup.drive.samples_per_period == 64
    assert campaign.experiments[0].tones_hz == (10.0,)
    assert campaign.experiments[0].settings == {}
    assert campaign.sweep is None
    assert campaign.parameters[0].reference == 1.5
    assert [(n.kind, n.subject) for n in campaign.notes] == [
        (FindingKind.unit_undeclared, "x"),
        (FindingKind.unit_undeclared, "k"),
    ]
    assert (
        read_campaign(tmp_path / "campaign.toml").file.fmu.file == tmp_path / "x/CoupledOscillator"
    )


TOML, EXP, SWEEP, PAIR = "campaign.toml", "experiments.csv", "sweep.csv", "spectra/pair2.csv"
TOP_LINE = "frequency (MHz),amplitude (uV)\n"

READING = [
    # files
    (
        TOML,
        'file = "sweep.csv"',
        'file = "swep.csv"',
        "swep.csv: no such file; did you mean 'sweep.csv'?",
    ),
    (EXP, "pair2,", "pair9,", "spectra/pair9.csv: no such file"),
    (SWEEP, "amplitude (uV)", "height (uV)", "sweep.csv: no column 'amplitude'"),
    (SWEEP, "amplitude (uV)", "amplitude", "column 'amplitude' has no unit in its header"),
    (SWEEP, "amplitude (uV)", "amplitude (kg)", "sweep.csv: column 'amplitude': found unit 'kg'"),
    (SWEEP, "frequency (MHz)", "frequency (s)", "sweep.csv: column 'frequency': found unit 's'"),
    (SWEEP, TOP_LINE, TOP_LINE + "6.9,nan\n", "sweep.csv: row 4, column 'amplitude': found 'nan'"),
    (
        SWEEP,
        TOP_LINE,
        TOP_LINE + "6.9,much\n",
        "sweep.csv: row 4, column 'amplitude': found 'much'",
    ),
    (SWEEP, TOP_LINE, TOP_LINE + "6.9,-1\n", "row 4, column 'amplitude': negative amplitude -1 uV"),
    (SWEEP, TOP_LINE, TOP_LINE + "-6.9,1\n", "row 4: frequency -6.9 MHz; wanted a positive one"),
    (SWEEP, TOP_LINE, TOP_LINE + "7.9,1\n", "sweep.csv: row 5: frequency 6.93996 MHz follows 7.9"),
    (SWEEP, TOP_LINE, TOP_LINE + "6.93996,1\n", "row 5: frequency 6.93996 MHz appears twice"),
    (
        PAIR,
        TOP_LINE,
        TOP_LINE + "9,1\n",
        "spectra/pair2.csv: row 5: frequency 6.94001 MHz follows 9",
    ),
    (
        EXP,
        "6.94034",
        "6.96",
        "pair2.csv: does not contain the tone 6.96 MHz; its points run from 6.94001",
    ),
    (EXP, "6.94034", "6.94044", "pair2.csv: no peak at the tone 6.94044 MHz"),
    # experiments
    (EXP, "experiment,", "name,", "no column 'experiment'"),
    (EXP, "u2 (MHz)", "v2 (MHz)", "no column 'u2'; there is: experiment, u1, v2"),
    (EXP, "u2 (MHz)", "u2", "column 'u2' has no unit in its header; wanted it in brackets"),
    (EXP, "u2 (MHz)", "u2 (m)", "experiments.csv: column 'u2': found unit 'm'"),
    (EXP, "pair2,", "pair1,", "row 5, column 'experiment': 'pair1' appears twice"),
    (EXP, "6.94034", "fast", "row 5, column 'u2': found 'fast', wanted a finite number"),
    (
        EXP,
        "6.94034",
        "NaN",
        "row 5, column 'u2': found 'NaN', wanted a finite number; where nothing was measured "
        "leave the row out, or end a sampled record before it",
    ),
    (EXP, "6.94034", "6.94018", "row 5: drive frequencies 6.94018, 6.94018 MHz; wanted positive"),
    (EXP, "6.94034", "-6.94034", "wanted positive ones that differ"),
    # keys
    (TOML, 'title = "Str', 'titel = "Str', "top level: unknown key 'titel'; did you mean 'title'?"),
    (TOML, 'title = "Str', "title = 3 #", "title: found 3, wanted a text"),
    (TOML, "synthetic = true", 'synthetic = "yes"', "synthetic: found 'yes', wanted true or false"),
    (TOML, "[observe]", "[observed]", "unknown key 'observed'; did you mean 'observe'?"),
    (TOML, "[observe]\n", "[[observe]]\n", "wanted a table"),
    (TOML, "title =", "title ==", "campaign.toml: not valid TOML"),
    (TOML, 'model = "CoupledOscillator"', "", "[fmu]: wanted either 'model' or 'file'"),
    (TOML, "timeout_s = 60", "timeout_s = 0", "[fmu] timeout_s: found 0, wanted a positive number"),
    (TOML, "steady_start = true", 'line_width = "-9 Hz"', "[observe] line_width: found '-9 Hz'"),
    (TOML, "steady_start = true", "line_width = 100", "[observe] line_width: 100 has no unit"),
    (TOML, "steady_start = true", 'line_width = "9 s"', "[observe] line_width: found unit 's'"),
    (
        TOML,
        'kind = "tones"',
        'kind = "tone"',
        "[drive] kind: found 'tone', wanted one of \"tones\"",
    ),
    (TOML, 'kind = "tones"', 'kind = "input"', "[drive] amplitudes: has no meaning with kind"),
    (TOML, '["A1", "A2"]', '["A1"]', "[drive] amplitudes: 1 names, wanted 2, one per frequency"),
    (TOML, '["A1", "A2"]', '["A1", "A1"]', "names something twice"),
    (TOML, "level = 1.0", "level = nan", "[drive] level: found nan, wanted a finite number"),
    (TOML, '/{experiment}.csv"', '/1.csv"', "'spectra/1.csv' wanted with '{experiment}' in it"),
    (TOML, 'amplitude = "V peak"', "", "key 'amplitude' is missing: wanted \"V peak\""),
    (
        TOML,
        '"V peak"',
        '"V"',
        '[experiments] amplitude: found "V", wanted "V peak", "V rms" or "dBm"',
    ),
    (TOML, '"V peak"', '"dBm"', '"dBm" is a power: wanted impedance = "50 ohm"'),
    (TOML, 'layout = "csv"', 'layout = "xls"', "[experiments] layout: found 'xls', wanted one of"),
    (
        TOML,
        'layout = "csv"',
        'layout = "csv"\ntrace = 2',
        '[experiments] trace: has no meaning with layout = "csv", only with layout = "keysight" or',
    ),
    (
        TOML,
        'layout = "csv"\namplitude = "V peak"\nset',
        'layout = "csv"\nchunk = 1\namplitude = "V peak"\nset',
        '[sweep] chunk: has no meaning with layout = "csv", only with layout = "zurich"',
    ),
    (
        TOML,
        'layout = "csv"',
        'layout = "zurich"\ntrace = 2',
        '[experiments] trace: has no meaning with layout = "zurich"',
    ),
    (TOML, '"robust"', '"median"', "noise_floor: found 'median', wanted one of"),
    (TOML, "before =", "befor =", "[drift.eta_plus]: unknown key 'befor'; did you mean 'before'?"),
    (TOML, 'use = "scale"', 'use = "both"', "[sweep] use: found 'both'"),
    (
        TOML,
        "[continuation]\n",
        "[continuation]\nbetta = 1\n",
        "unknown key 'betta'; did you mean 'beta'?",
    ),
    (
        TOML,
        "beta = 0.1",
        "beta = 1.5",
        "[continuation] beta: found 1.5, wanted a factor above 0 and below 1",
    ),
    (
        TOML,
        "nu_start = 0.1",
        'estimator = "mean"',
        "[continuation] estimator: found 'mean', wanted one of \"likelihood\"",
    ),
    (TOML, "nu_start = 0.1", "nu_start = -1", "[continuation] nu_start: found -1"),
    (TOML, "starts = 3", "starts = 0", "starts: found 0, wanted a whole number from 1 to 1000"),
    (TOML, "reflection = [false, true]", "reflection = true", "wanted a list of values to try"),
    (
        TOML,
        'name = "d1"\nunit = "Hz"\nlower',
        'name = "d1"\nunit = "Hz"\nlow',
        "[parameters 'd1']: unknown key 'low'",
    ),
    (TOML, 'name = "d1"\n', "", "[parameters '2']: key 'name' is missing"),
    (TOML, "outputs = [", "output = [", "[derived]: unknown key 'output'; did you mean 'outputs'?"),
]


@pytest.mark.parametrize(("name", "old", "new", "words"), READING)
def test_wrong_campaigns_and_files_are_refused(
    tmp_path: Path, texts: dict[str, str], name: str, old: str, new: str, words: str
) -> None:
    path = lay(tmp_path, texts, (name, old, new))
    with pytest.raises(BadInput) as caught:
        read_campaign(path)
    lines = str(caught.value).split("\n")
    assert words in lines[0]
    assert len(lines) <= texts[name].count(old)  # one complaint for each place that is wrong
    assert all(str(tmp_path) in line for line in lines)


BINDING = [
    (
        "lower = 1.0",
        "lower = 2000.0",
        "[parameters 'd1']: parameter 'd1': lower = 2000.0 is not below",
    ),
    ("start = 0.0", "start = 7.0", "start = 7.0 lies outside its bounds"),
    ("lower = 1.0", "lower = -1.0", "outside the range [0.0, None] that the FMU declares for 'd1'"),
    ('name = "d1"', 'name = "d_1"', "the FMU has no variable 'd_1'; did you mean 'd1'?"),
    (
        'name = "d1"',
        'name = "f1"',
        "'f1' is a variable of causality output, which cannot be fitted",
    ),
    (
        'name = "d1"',
        'name = "solver"',
        "'solver' is an Integer variable of the FMU, wanted a Real one",
    ),
    ('name = "d1"', 'name = "d2"', "names one twice"),
    ('name = "d1"', 'name = "u1"', "'u1' is fitted and also set by experiment 'pair1'"),
    ('name = "d1"\nunit = "Hz"', 'name = "d1"\nunit = "rad/s"', "found unit 'rad/s', wanted 'Hz'"),
    ('name = "d1"\nunit = "Hz"', 'name = "d1"\nunit = "Hertzz"', "there is no unit 'Hertzz'"),
    (
        'output = "q1_hybrid"',
        'output = "q1_hybird"',
        "[observe] output: the FMU has no variable 'q1_hybird'; did you mean 'q1_hybrid'?",
    ),
    ('output = "q1_hybrid"', 'output = "theta"', "causality parameter, which cannot be observed"),
    ('"Q_minus"]', '"Q_mines"]', "[derived] outputs: the FMU has no variable 'Q_mines'"),
    ('"Q_minus"]', '"d1"]', "causality parameter, which cannot be reported"),
    ('"Q_minus"]', '"b"]', "causality input, which cannot be reported"),
    ("periodic_start = true ", "periodic_start = 2 ", "[fmu.start] periodic_start: found 2, but"),
    (
        "periodic_start = true ",
        'theta = "1 Hz" ',
        "[fmu.start] theta: found unit 'Hz', wanted 'rad'",
    ),
    ("periodic_start = true ", "f1 = 1.0 ", "causality output, which cannot be set"),
    ("periodic_start = true ", "d1 = 1.0 ", "'d1' is fitted and also set by [fmu.start]"),
    (
        "reflection = [false, true]",
        "theta = [0.0, 1.0]",
        "'theta' is fitted and also set by [alternatives]",
    ),
    (
        "reflection = [false, true]",
        "u1 = [0.0, 1.0]",
        "'u1' is an alternative and also set by experiment",
    ),
    ("level = 1.0", "level = -1.0", "[drive] level: found -1, wanted a positive amplitude"),
    ('["A1", "A2"]', '["A1", "A9"]', "[drive] amplitudes: the FMU has no variable 'A9'"),
    (
        "[drift] ",
        "[drift]\nd3 = { before = 1.0, after = 2.0 }\n#",
        "[drift.d3] before: the FMU has no variable",
    ),
    (
        "[drift] ",
        "[drift]\nu1 = { before = 1.0, after = 2.0 }\n#",
        "'u1' is set here and by [drift]",
    ),
]


@pytest.mark.parametrize(("old", "new", "words"), BINDING)
def test_campaigns_that_do_not_suit_the_fmu_are_refused(
    tmp_path: Path, texts: dict[str, str], old: str, new: str, words: str
) -> None:
    toml = texts["campaign.toml"]
    assert old in toml
    path = lay(tmp_path, {**texts, "campaign.toml": toml.replace(old, new, 1)})
    campaign = read_campaign(path)
    with pytest.raises(BadInput) as caught:
        bind(campaign, oscillator())
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (("experiments.csv", "10,5;20", "10,5;-20"), "row 2, column 'q': negative amplitude"),
        (("experiments.csv", "10,5;20", "10,5;0"), "row 2, column 'q': the peak is zero"),
        (("experiments.csv", "q (uV)", "q"), "column 'q' has no unit"),
        (("campaign.toml", '["p", "q"]', '["p", "r"]'), "no column 'r' of ready peaks"),
        (("campaign.toml", '["p", "q"]', '["p"]'), "[experiments] peaks: 1 column, wanted 2"),
        (
            ("campaign.toml", '"V rms"', '"dBm"\nimpedance = "50 ohm"'),
            "deviation in dBm is a ratio",
        ),
        (
            ("campaign.toml", '"V rms"', '"V rms"\ntrace = 2'),
            "[experiments] trace: has no meaning with ready peaks",
        ),
        (
            ("experiments.csv", ";solver;", ";sloth;"),
            "row 2, column 'sloth': the FMU has no variable",
        ),
        (
            ("experiments.csv", ";2;true", ";2,5;true"),
            "column 'solver': found 2.5, but 'solver' is",
        ),
    ],
)
def test_wrong_ready_peaks_are_refused(
    tmp_path: Path, texts: dict[str, str], edit: tuple[str, str, str], words: str
) -> None:
    with pytest.raises(BadInput) as caught:
        bound(ready(tmp_path, texts, edit))
    assert words in str(caught.value)


def test_the_start_value_of_a_state_may_be_fitted() -> None:
    """FMI counts it among outputs and locals; one that is calculated, or constant, is none."""
    states = [variable(n, causality=n, initial="exact") for n in ("output", "local")]
    others = [
        variable("constant", causality="local", initial="exact", variability="constant"),
        variable("calculated", causality="local", initial="calculated"),
    ]
    binder = Binder({v.name: v for v in (*states, *others)})
    for v in states:
        assert binder.real(v.name, "here", ("parameter",), "fitted") is v
    for v in others:
        with pytest.raises(BadInput, match=rf"here.*'{v.name}'"):
            binder.real(v.name, "here", ("parameter",), "fitted")


def test_nothing_to_fit_is_refused(tmp_path: Path, texts: dict[str, str]) -> None:
    toml = texts["campaign.toml"]
    start, end = toml.index("[experiments]"), toml.index("[sweep]")
    path = lay(tmp_path, {**texts, "campaign.toml": toml[:start] + toml[end:]})
    with pytest.raises(BadInput, match=r"campaign\.toml: .*\[experiments\]"):
        read_campaign(path)


def test_without_a_sweep_the_settling_must_be_told(tmp_path: Path, texts: dict[str, str]) -> None:
    toml = texts["campaign.toml"]
    start, end = toml.index("[sweep]"), toml.index("# Start and reference")
    short = toml[:start] + toml[end:]
    assert bound(lay(tmp_path, {**texts, "campaign.toml": short})).sweep is None
    path = lay(tmp_path, {**texts, "campaign.toml": short.replace("steady_start = true", "")})
    with pytest.raises(BadInput, match=r"observe.*line_width"):
        read_campaign(path)
    told = short.replace("steady_start = true", 'line_width = "0.1 kHz"')
    assert bound(lay(tmp_path, {**texts, "campaign.toml": told})).setup.line_width_hz == 100.0


def test_sweep_and_peaks_must_share_a_unit(tmp_path: Path, texts: dict[str, str]) -> None:
    toml = texts["campaign.toml"]
    at = toml.index("[sweep]")
    changed = toml[:at] + toml[at:].replace('"V peak"', '"m peak"')
    sweep = texts["sweep.csv"].replace("(uV)", "(nm)")
    path = lay(tmp_path, {**texts, "campaign.toml": changed, "sweep.csv": sweep})
    with pytest.raises(BadInput, match=r"\[sweep\] amplitude .* m, \[experiments\] .* V"):
        read_campaign(path)


def metres(unit: str | None) -> dict[str, FmuVariable]:
    """The oscillator's variables with the observed output in that unit."""
    return oscillator() | {"q1_hybrid": variable("q1_hybrid", unit=unit, causality="output")}


def in_nanometres(texts: dict[str, str], *, scale: str) -> dict[str, str]:
    """The campaign of a detector calibrated in nm, its files in um."""
    changed = {name: text.replace("(uV)", "(um)") for name, text in texts.items()}
    toml = changed["campaign.toml"].replace('"V peak"', '"nm peak"')
    if scale == "no sweep":
        toml = toml[: toml.index("[sweep]")] + toml[toml.index("# Start and reference") :]
    else:
        toml = toml.replace('scale = "maximum"', f'scale = "{scale}"')
    return changed | {"campaign.toml": toml}


@pytest.mark.parametrize("scale", ["none", "no sweep", "maximum"])
def test_without_a_scale_amplitudes_are_in_the_unit_of_the_output(
    tmp_path: Path, texts: dict[str, str], scale: str
) -> None:
    volts = bound(lay(tmp_path, texts))
    campaign = bound(lay(tmp_path, in_nanometres(texts, scale=scale)), metres("m"))
    unit, per_volt = ("nm", 1e9) if scale == "maximum" else ("m", 1.0)
    assert campaign.amplitude_unit == unit
    for found, there in zip(campaign.experiments, volts.experiments, strict=True):
        assert found.peaks_v == pytest.approx(per_volt * there.peaks_v, rel=1e-12)
        assert found.sigmas_v == pytest.approx(per_volt * there.sigmas_v, rel=1e-12)
        assert found.floor_v == pytest.approx(per_volt * there.floor_v, rel=1e-12)
        assert found.spectrum is not None
        assert there.spectrum is not None
        assert found.spectrum.unit == unit
        assert found.spectrum.amplitude_v == pytest.approx(per_volt * there.spectrum.amplitude_v)
    assert (campaign.sweep is None) == (scale == "no sweep")
    if campaign.sweep is not None and volts.sweep is not None:
        assert campaign.sweep.unit == unit
        assert campaign.sweep.amplitude_v == pytest.approx(per_volt * volts.sweep.amplitude_v)
    assert len(campaign.notes) == (scale != "maximum")
    for note in campaign.notes:
        assert (note.kind, note.subject) == (FindingKind.amplitudes_converted, "q1_hybrid")
        assert note.names["units"] == ("nm", "m")


@pytest.mark.parametrize(("scale", "section"), [("none", "sweep"), ("no sweep", "experiments")])
def test_without_a_scale_the_units_must_be_of_one_kind(
    tmp_path: Path, texts: dict[str, str], scale: str, section: str
) -> None:
    campaign = read_campaign(lay(tmp_path, in_nanometres(texts, scale=scale)))
    with pytest.raises(BadInput) as caught:
        bind(campaign, metres("V"))
    for token in (f"[{section}] amplitude: ", "'nm'", "'V'", "'q1_hybrid'"):
        assert token in str(caught.value)
    assert "\n" not in str(caught.value)


def test_without_scale_and_unit_amplitudes_are_taken_in_si(
    tmp_path: Path, texts: dict[str, str]
) -> None:
    campaign = bound(lay(tmp_path, in_nanometres(texts, scale="none")), metres(None))
    assert campaign.amplitude_unit == "m"
    assert "q1_hybrid" in [note.subject for note in campaign.notes]


def test_an_fmu_in_other_units_gets_them(tmp_path: Path, texts: dict[str, str]) -> None:
    plain = bound(lay(tmp_path, texts))
    kilo = {n: replace(v, unit="kHz") if v.unit == "Hz" else v for n, v in oscillator().items()}
    other = bound(tmp_path / "campaign.toml", kilo)
    assert other.experiments[0].settings["u1"] == 6940.16
    assert other.experiments[0].tones_hz == plain.experiments[0].tones_hz
    assert other.parameters[1].unit == "kHz"
    assert other.parameters[1].start == pytest.approx(plain.parameters[1].start / 1e3, rel=1e-15)
    assert other.drift.ends["eta_plus"][0] == pytest.approx(6940.21, abs=1e-3)
