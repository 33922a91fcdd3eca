"""Traces through FMUs, against closed forms, the matrix exponential and the Cramer-Rao bound."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2

import fitting as ff
from fitting.fmu.runs import Run, SampledSignal
from fitting.measurements.steps import first_steps
from fitting.measurements.waveform import Recorded, Waveform
from fitting.report.shown import shown_fit
from fitting.report.summary import summary_of
from fitting.simulate.budget import Kind
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.estimate import Verdict
from tests.support.cfmu_build import build_c_fmu, build_lag_fmu
from tests.support.linear_traces import held_response, oscillator, string

MASS, C, K = 1e-3, 5e-2, 4e3
#: The likelihood polishes what Algorithm 2 finds: one level is enough where the start is near.
QUICK = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
BEAM = ff.Setup(ff.Drive(), "displacement")
BEAM_PARAMETERS = (
    ff.Parameter("damping", 0.04, bounds=(0.01, 0.2)),
    ff.Parameter("stiffness", 3.95e3, bounds=(3.5e3, 4.5e3)),
)
TAU, GAIN = 0.3, 2.0
STRING = ff.Setup(ff.Drive(), "q1", start_values={"A1": 0.0, "A2": 0.0, "theta": 1.9})
LAG = ff.Setup(ff.Drive(), "y")
LAG_PARAMETERS = (
    ff.Parameter("tau", 0.5, bounds=(0.05, 2.0)),
    ff.Parameter("gain", 1.0, bounds=(0.1, 10.0)),
)


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ff.Fmu]:
    with ff.Fmu(build_c_fmu(tmp_path_factory.mktemp("beam")), workers=1) as fmu:
        yield fmu


@pytest.fixture(scope="module")
def lag(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ff.Fmu]:
    with ff.Fmu(build_lag_fmu(tmp_path_factory.mktemp("lag")), workers=1) as fmu:
        yield fmu


# --- inputs and runs ------------------------------------------------------------------------

T = np.array([0.0, 0.1, 0.3, 0.4])
U = np.array([1.0, -2.0, 0.5, 3.0])


@pytest.mark.parametrize(
    "waveform",
    [
        pytest.param(Recorded(T, U, "held"), id="held"),
        pytest.param(Recorded(T, U, "linear"), id="linear"),
        pytest.param(ff.Pulse(level=2.0, at_s=0.03, length_s=0.2), id="pulse"),
        pytest.param(ff.Pulse(level=2.0, at_s=0.03), id="step"),
        pytest.param(ff.Chirp(start_hz=1.0, stop_hz=30.0, length_s=0.4, level=0.5), id="chirp"),
    ],
)
def test_what_is_held_over_a_step_is_the_mean_of_the_input(waveform: Waveform) -> None:
    edges = np.sort(np.concatenate([np.linspace(-0.101, 0.503, 40), [0.03, 0.31]]))
    jumps = np.array([*T, 0.03, 0.23])
    exact = [
        quad(
            lambda t: float(waveform.at(np.array([t]))[0]),
            a,
            b,
            points=jumps[(jumps > a) & (jumps < b)],
        )[0]
        / (b - a)
        for a, b in itertools.pairwise(edges)
    ]
    assert waveform.means(edges) == pytest.approx(exact, abs=1e-7)


def test_a_run_with_held_values_is_the_matrix_exponential(beam: ff.Fmu) -> None:
    u = 1e-3 * np.random.default_rng(4).standard_normal(60)
    expected = held_response(oscillator(MASS, C, K), u, 1e-4)
    signal = SampledSignal(("force",), 1e-4, u[:-1, None], u[:, None])
    run = Run(
        start_values={"damping": C},
        settle_s=0.0,
        sample_step_s=1e-4,
        samples=60,
        outputs=("displacement",),
        input_signal=signal,
    )
    [found] = beam.workers.run([run])
    assert found[:, 0] == pytest.approx(expected, abs=1e-12 * np.max(np.abs(expected)))
    assert signal == SampledSignal(("force",), 1e-4, u[:-1, None].copy(), u[:, None])
    assert signal != SampledSignal(("force",), 1e-4, 2.0 * u[:-1, None], u[:, None])
    with pytest.raises(BadInput, match=r"59 .* 58 steps"):
        replace(run, samples=59)


# --- first order ----------------------------------------------------------------------------

LAG_T = np.arange(200) * 0.01
LAG_U = np.where(LAG_T >= 0.1, 1.0, 0.0)


def lag_step(tau: float, gain: float) -> FloatArray:
    """Step response from 0.1 s on."""
    past = np.maximum(LAG_T - 0.1, 0.0)
    return np.asarray(gain * -np.expm1(-past / tau))


def lag_trace(y: FloatArray, **more: object) -> ff.Trace:
    arguments: dict[str, object] = {"driven": (LAG_T, LAG_U), "interpolation": "held", **more}
    return ff.Trace(LAG_T, y, setup=LAG, input="u", **arguments)  # type: ignore[arg-type]


def lag_errors(sigma: float, *columns: FloatArray) -> FloatArray:
    """Cramer-Rao bound of tau and gain, with further columns that are unknown as well."""
    past = np.maximum(LAG_T - 0.1, 0.0)
    left = np.exp(-past / TAU)
    slopes = [-GAIN * past / TAU**2 * left, 1.0 - left, *columns]
    matrix = np.stack(slopes, axis=1) / sigma
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix))))[:2]


def widened(found: ff.Inference) -> float:
    assert found.inferred.knowledge is not None
    return float(found.inferred.knowledge.inflation)


def test_a_step_response_of_first_order_is_as_sure_as_can_be(lag: ff.Fmu) -> None:
    sigma = 0.02
    y = lag_step(TAU, GAIN) + sigma * np.random.default_rng(2).standard_normal(LAG_T.size)
    problem = ff.Problem(lag, LAG_PARAMETERS, lag_trace(y, sigma=sigma))
    found = ff.profile(ff.fit(problem, method=QUICK, starts=1))
    for name, true, std in zip(("tau", "gain"), (TAU, GAIN), lag_errors(sigma), strict=True):
        low, high = found[name].interval()
        assert 0.5 * (high - low) / 1.96 == pytest.approx(widened(found) * std, rel=0.05)
        assert abs(found[name].value - true) < 4.0 * std
        assert found[name].status == "determined"


def test_gain_and_offset_of_the_read_out_are_solved_for(lag: ff.Fmu) -> None:
    """Of a gain that is solved for nothing is left to tell the FMU's own: one parameter."""
    sigma = 0.02
    y = 7.0 * lag_step(TAU, GAIN) - 3.0
    noisy = y + 7.0 * sigma * np.random.default_rng(3).standard_normal(LAG_T.size)
    trace = lag_trace(noisy, gain="fit", offset=True, sigma=7.0 * sigma)
    problem = ff.Problem(lag, LAG_PARAMETERS[:1], trace)
    assert problem.record.measurements[0].solved_inside == 2
    found = ff.profile(ff.fit(problem, method=QUICK, starts=1))
    std = lag_errors(sigma, np.ones(LAG_T.size))[0]
    low, high = found["tau"].interval()
    assert 0.5 * (high - low) / 1.96 == pytest.approx(widened(found) * std, rel=0.05)
    assert abs(found["tau"].value - TAU) < 4.0 * std


def test_start_values_are_parameters_and_what_passes_through_is_seen_at_once(lag: ff.Fmu) -> None:
    past = np.maximum(LAG_T - 0.1, 0.0)
    y = 1.5 * np.exp(-LAG_T / TAU) + GAIN * -np.expm1(-past / TAU) + 0.25 * LAG_U
    parameters = (
        *LAG_PARAMETERS,
        ff.Parameter("x_start", 0.5, bounds=(-5.0, 5.0)),
        ff.Parameter("through", 0.0, bounds=(-1.0, 1.0)),
    )
    fit = ff.fit(ff.Problem(lag, parameters, lag_trace(y)), method=QUICK, starts=1)
    assert fit.x == pytest.approx([TAU, GAIN, 1.5, 0.25], rel=1e-6)


def test_a_lead_lets_the_first_value_of_the_input_act(lag: ff.Fmu) -> None:
    """The FMU has been under 2 V for 10 s, then it is let go."""
    y = 2.0 * GAIN * np.exp(-LAG_T / TAU)
    u = np.where(LAG_T > 0.0, 0.0, 2.0)
    y = np.concatenate([y[:1], y[:-1]])  # 2 V are held until the second sample
    fit = ff.fit(
        ff.Problem(lag, LAG_PARAMETERS, lag_trace(y, driven=(LAG_T, u), lead_s=10.0)), starts=1
    )
    assert fit.x == pytest.approx([TAU, GAIN], rel=1e-6)


@pytest.mark.parametrize("seeds", [2, pytest.param(6, marks=pytest.mark.nightly)])
def test_intervals_hold_the_truth_as_often_as_they_say(lag: ff.Fmu, seeds: int) -> None:
    sigma, deviations = 0.02, []
    for seed in range(seeds):
        y = lag_step(TAU, GAIN) + sigma * np.random.default_rng(seed).standard_normal(LAG_T.size)
        fit = ff.fit(ff.Problem(lag, LAG_PARAMETERS, lag_trace(y)), method=QUICK, starts=1)
        deviations.append((fit["tau"].value - TAU) / fit["tau"].std)
    squares = float(np.sum(np.square(deviations)))
    assert chi2.ppf(1e-3, seeds) < squares < chi2.ppf(1.0 - 1e-3, seeds)


def test_noise_that_hangs_together_widens_the_errors(lag: ff.Fmu) -> None:
    """AR(1) noise of coefficient 0.8: errors are those of white noise times about 3."""
    rng, e = np.random.default_rng(11), [0.0]
    for x in 0.02 * rng.standard_normal(LAG_T.size - 1):
        e.append(0.8 * e[-1] + x)
    y = lag_step(TAU, GAIN) + np.array(e)
    fit = ff.fit(ff.Problem(lag, LAG_PARAMETERS, lag_trace(y)), method=QUICK, starts=1)
    white = lag_errors(float(np.std(e)))
    assert 2.0 < fit["gain"].std / white[1] < 4.0  # sqrt((1 + 0.8)/(1 - 0.8)) = 3


# --- second order, two modes ----------------------------------------------------------------

BEAM_T = np.arange(300) * 1e-4


def test_a_step_response_of_second_order_is_as_sure_as_can_be(beam: ff.Fmu) -> None:
    u = np.where(BEAM_T >= 2e-3, 1e-3, 0.0)

    def exact(c: float, k: float) -> FloatArray:
        return held_response(oscillator(MASS, c, k), u, 1e-4)

    y, sigma = exact(C, K), 2e-9
    slopes = [
        (exact(C * 1.001, K) - exact(C * 0.999, K)) / (0.002 * C),
        (exact(C, K * 1.0001) - exact(C, K * 0.9999)) / (0.0002 * K),
    ]
    matrix = np.stack(slopes, axis=1) / sigma
    stds = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    noisy = y + sigma * np.random.default_rng(6).standard_normal(y.size)
    trace = ff.Trace(
        BEAM_T,
        noisy,
        setup=BEAM,
        input="force",
        driven=ff.Pulse(level=1e-3, at_s=2e-3),
        sigma=sigma,
        unit="m",
    )
    fit = ff.fit(ff.Problem(beam, BEAM_PARAMETERS, trace), method=QUICK, starts=1)
    for name, true, std in zip(("damping", "stiffness"), (C, K), stds, strict=True):
        assert fit[name].std == pytest.approx(std, rel=0.05)
        assert abs(fit[name].value - true) < 4.0 * std


def test_a_chirp_of_the_string_gives_back_its_coefficients(swift: ff.Fmu) -> None:
    """Both modes, 6 % apart, seen by an output each; coupled by their damping alone."""
    theta, d1, d2, eta = 1.9, 3.0, 1.2, (100.0, 106.0)
    t = np.linspace(0.0, 0.9975, 400)
    chirp = ff.Chirp(start_hz=80.0, stop_hz=125.0, length_s=0.8, level=100.0)
    u = chirp.at(t)
    setup = ff.Setup(
        ff.Drive(),
        "q1_hybrid",
        start_values={"A1": 0.0, "A2": 0.0, "eta_plus": eta[0], "eta_minus": eta[1]},
    )
    traces = [
        ff.Trace(
            t,
            held_response(string(theta, d1, d2, eta, seen), u, 2.5e-3),
            setup=setup,
            input="b",
            driven=(t, u),
            interpolation="held",
            output=output,
            label=output,
            unit="m",
        )
        for output, seen in (("q1_hybrid", (1.0, 0.0)), ("q2_hybrid", (0.0, 1.0)))
    ]
    parameters = [
        ff.Parameter("theta", 1.8, bounds=(1.58, 3.1)),
        ff.Parameter("d1", 2.5, bounds=(0.5, 10.0)),
        ff.Parameter("d2", 1.5, bounds=(0.5, 10.0)),
    ]
    exactly = ff.Tikhonov(nu=1e-6, beta=1e-4, levels=2, misfit="squares")
    fit = ff.fit(ff.Problem(swift, parameters, traces), method=exactly, starts=1)
    assert fit.x == pytest.approx([theta, d1, d2], rel=1e-9)


# --- ringdowns ------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [pytest.param(0.0, id="exact"), pytest.param(0.01, id="noisy")])
def test_a_ringdown_of_two_beating_modes(swift: ff.Fmu, noise: float) -> None:
    """Both displacements and velocities at the first sample are unknown; so is the gain."""
    theta, d1, d2, eta = 1.9, 3.0, 1.2, (100.0, 106.0)
    t = np.arange(300) * 2.7e-3
    matrices = string(theta, d1, d2, eta, (np.cos(theta), np.sin(theta)))  # seen: q1
    y = held_response(matrices, np.zeros(t.size), 2.7e-3, start=(1.0, -0.7, 300.0, 100.0))
    sigma = noise * float(np.max(np.abs(y)))
    y = y + sigma * np.random.default_rng(5).standard_normal(t.size)
    trace = ff.Trace(t, y, setup=STRING, input="b", start="unknown", states=4, unit="m")
    parameters = [
        ff.Parameter("eta_plus", 99.8, bounds=(98.0, 102.0)),
        ff.Parameter("eta_minus", 106.3, bounds=(104.0, 108.0)),
        ff.Parameter("d1", 2.5, bounds=(0.5, 10.0)),
        ff.Parameter("d2", 1.5, bounds=(0.5, 10.0)),
    ]
    fit = ff.fit(ff.Problem(swift, parameters, trace), method=QUICK, starts=1)
    truth = [*eta, d1, d2]
    if noise:
        for name, true in zip(("eta_plus", "eta_minus", "d1", "d2"), truth, strict=True):
            assert abs(fit[name].value - true) < 4.0 * fit[name].std
    else:
        assert fit.x == pytest.approx(truth, rel=1e-6)


def test_a_decay_is_found_behind_its_drive(beam: ff.Fmu) -> None:
    """0.1 s of a tone that clips, then 0.2 s of decay; samples before its end are not used."""
    t = np.linspace(0.0, 0.3, 601)
    matrices = oscillator(MASS, C, K)
    free = held_response(matrices, np.zeros(401), 5e-4, start=(1.0, 300.0))
    driven = np.clip(1.4 * np.sin(2.0 * np.pi * 320.0 * t[:200]), -1.0, 1.0)
    y = np.concatenate([driven, free])
    y += 0.005 * np.random.default_rng(9).standard_normal(t.size)
    trace = ff.Trace(
        t, y, setup=BEAM, input="force", start="unknown", begin="found", offset=True, unit="m"
    )
    assert 0.0995 <= trace.t[0] < 0.103
    fit = ff.fit(ff.Problem(beam, BEAM_PARAMETERS, trace), method=QUICK, starts=1)
    for name, true in (("damping", C), ("stiffness", K)):
        assert abs(fit[name].value - true) < 4.0 * fit[name].std


def test_an_unknown_start_wants_a_linear_fmu_that_answers(lag: ff.Fmu) -> None:
    trace = ff.Trace(RING_T, RING, setup=LAG, input="u", start="unknown", unit="V")
    deaf = replace(LAG, start_values={"gain": 0.0})
    with pytest.raises(BadInput, match=r"'y' .*'u'"):
        ff.fit(ff.Problem(lag, LAG_PARAMETERS[:1], replace(trace, setup=deaf)), starts=1)
    bent = replace(LAG, start_values={"x_start": 1.0})
    with pytest.raises(BadInput, match="linear FMU"):
        ff.fit(ff.Problem(lag, LAG_PARAMETERS[:1], replace(trace, setup=bent)), starts=1)


# --- the communication step -----------------------------------------------------------------


def test_the_step_is_halved_until_the_promise_holds(lag: ff.Fmu) -> None:
    """Euler's method: what the plan promises holds against the closed form."""
    setup = replace(LAG, start_values={"euler": 1.0}, accuracy=1e-3)
    trace = ff.Trace(
        LAG_T,
        lag_step(TAU, GAIN),
        setup=setup,
        input="u",
        driven=(LAG_T, LAG_U),
        interpolation="held",
    )
    parameters = (
        replace(LAG_PARAMETERS[0], start=TAU),
        replace(LAG_PARAMETERS[1], start=GAIN),
    )
    fit = ff.fit(ff.Problem(lag, parameters, trace), method=QUICK, starts=1)
    assert fit.result.plan is not None
    [decision] = [d for d in fit.result.plan.decisions if d.kind == Kind.STEP]
    euler = lag_euler(int(decision.numbers["per_sample"]))
    off = float(np.max(np.abs(euler - lag_step(TAU, GAIN)))) / GAIN
    assert 0.3 * decision.bound < off <= decision.bound <= 1e-3
    # and what is off enters the errors: the data are exact, the FMU is not
    assert abs(fit["tau"].value - TAU) < 2.0 * fit["tau"].std


def test_of_a_fit_that_follows_nothing_nothing_is_known(lag: ff.Fmu) -> None:
    """A step of 2 ms through a lag of 1 s, fitted by its gain alone: no gain follows it."""
    t = np.linspace(0.0, 0.0299, 300)
    y = 5.0 * -np.expm1(-t / 2.2e-3) + 0.01 * np.random.default_rng(7).standard_normal(t.size)
    trace = ff.Trace(t, y, setup=LAG, input="u", driven=(t, np.full(t.size, 5.0)))
    found = ff.profile(ff.fit(ff.Problem(lag, LAG_PARAMETERS[1:], trace), method=QUICK, starts=1))
    assert found.result.status != "converged"
    assert summary_of(found.result).values == ()
    assert found.result.parameters["gain"].status is Verdict.WITHDRAWN


def lag_euler(per_sample: int) -> FloatArray:
    """The lag by Euler's method, in python."""
    x, seen, h = 0.0, [], 0.01 / per_sample
    for u in LAG_U:
        seen.append(x)
        for _ in range(per_sample):
            x += h / TAU * (GAIN * u - x)
    return np.array(seen)


@pytest.mark.parametrize(
    ("spacing", "own", "expected"),
    [
        pytest.param(0.01, None, (1, 0.0), id="none"),
        pytest.param(0.01, 0.002, (5, 0.0), id="five of its own"),
        pytest.param(0.01, 0.01, (1, 0.0), id="the same"),
        pytest.param(0.01, 0.025, (1, 0.025), id="longer than a sample"),
        pytest.param(0.01, 1e-9, (1, 0.0), id="of a faster signal"),
    ],
)
def test_steps_begin_with_the_fmu_s_own(
    spacing: float, own: float | None, expected: tuple[int, float]
) -> None:
    assert first_steps(spacing, own) == expected


RING_T = np.arange(400) * 1e-3
RING = np.exp(-RING_T / 0.2) * np.cos(2 * np.pi * 40.0 * RING_T)

# --- campaign files -------------------------------------------------------------------------

CAMPAIGN = """
title = "Lag under a step"

[fmu]
file = "{fmu}"

[observe]
output = "y"

[[trace]]
file = "first.csv"
input = "u"
interpolation = "held"

[[trace]]
file = "second.csv"
columns = {{ output = "seen", time = "t" }}
input = "u"
gain = "fit"
signal = {{ kind = "step", level = "1000 mV", at = "100 ms" }}
sigma = "140 mV"

[[parameters]]
name = "tau"
lower = "50 ms"
upper = "2 s"
start = "0.5 s"

[[parameters]]
name = "gain"
lower = 0.1
upper = 10
start = 1

[continuation]
nu_start = 1e-6
iterations = 1
starts = 1
misfit = "squares"
"""


def written(folder: Path, fmu: Path, campaign: str = CAMPAIGN) -> Path:
    """Two traces in units that the FMU does not have, the second through a gain of 7."""
    rng = np.random.default_rng(8)
    first, second = (lag_step(TAU, GAIN) + 0.02 * rng.standard_normal(LAG_T.size) for _ in range(2))
    files = {
        "first.csv": ("time (ms),u (mV),y (mV)", (1e3 * LAG_T, 1e3 * LAG_U, 1e3 * first)),
        "second.csv": ("t (s);seen (V)", (LAG_T, 7.0 * second)),
    }
    for name, (head, columns) in files.items():
        mark = ";" if ";" in head else ","
        rows = [mark.join(map(repr, map(float, row))) for row in np.column_stack(columns)]
        (folder / name).write_text("\n".join([head, *rows]))
    path = folder / "campaign.toml"
    path.write_text(campaign.format(fmu=fmu.as_posix()))
    return path


@pytest.fixture(scope="module")
def lag_file(lag: ff.Fmu) -> Path:
    return lag.description.path


def test_a_campaign_file_tells_of_traces(lag_file: Path, tmp_path: Path) -> None:
    fit = ff.fit(ff.Problem.of(ff.read_campaign(written(tmp_path, lag_file))))
    assert fit.success
    assert abs(fit["tau"].value - TAU) < 4.0 * fit["tau"].std
    assert abs(fit["gain"].value - GAIN) < 4.0 * fit["gain"].std
    # tau is seen by both, the gain by the first alone: a bound that both share
    assert fit["tau"].std < lag_errors(0.02)[0]
    shown = shown_fit(fit.record)
    first, second = shown.figures
    assert "200 recorded values" in first.caption
    assert "input 1 from 0.1 s" in second.caption
    assert shown.settings["settling"].startswith("none")
    assert set(fit.result.provenance.files) == {"campaign.toml", "first.csv", "second.csv"}
    assert [figure.name for figure in shown.figures] == ["trace_1", "trace_2"]
    for figure in shown.figures:
        assert [p for p in figure.panels if p.y.label == "autocorrelation"]


def test_an_input_in_proportion_to_the_fmu_s_has_a_gain(lag_file: Path, tmp_path: Path) -> None:
    """A force seen as a current, one unit of which is three of the input: the gain is a third."""
    proportion = CAMPAIGN.replace(
        'interpolation = "held"',
        'interpolation = "held"\ngain = "fit"\nstart = "unknown"\nstates = 1',
    )
    path = written(tmp_path, lag_file, proportion)
    rows = zip(LAG_T, 3.0 * LAG_U, lag_step(TAU, GAIN), strict=True)
    lines = (",".join(map(repr, map(float, row))) for row in rows)
    (tmp_path / "first.csv").write_text("\n".join(["time (s),u (mA),y (V)", *lines]))
    fit = ff.fit(ff.Problem.of(ff.read_campaign(path)))
    assert fit.success
    assert abs(fit["tau"].value - TAU) < 4.0 * fit["tau"].std


def edited(head: str, change: str) -> str:
    """The first file's text with its header, or with a line changed."""
    rows = [f"{10 * k},{1000 * (k > 9)},{k % 7}" for k in range(40)]
    at, _, text = change.partition("=")
    if at:
        rows[int(at) - 2] = text
    return "\n".join([head, *rows])


HEAD = "time (ms),u (mV),y (mV)"


@pytest.mark.parametrize(
    ("head", "change", "said"),
    [
        pytest.param(HEAD, "20=170,1000,3", "row 20: ", id="not rising"),
        pytest.param(HEAD, "20=182.5,1000,3", "0.0025 s off", id="uneven"),
        pytest.param("time,u (mV),y (mV)", "", "'time' has no unit", id="no unit"),
        pytest.param("time (ms),u (mV),z (mV)", "", "no column 'y'", id="no output"),
        pytest.param("time (ms),u (mV),y (s)", "", 'gain = "fit"', id="unit"),
        pytest.param("time (ms),u (s),y (mV)", "", "in proportion", id="input"),
        pytest.param("y (ms),u (mV),time (mV)", "", "'mV', wanted 's'", id="swapped"),
        pytest.param(HEAD, "20=180,1000,much", "row 20, column 'y'", id="text"),
    ],
)
def test_bad_files_are_told_in_a_sentence(
    lag_file: Path, tmp_path: Path, head: str, change: str, said: str
) -> None:
    path = written(tmp_path, lag_file)
    (tmp_path / "first.csv").write_text(edited(head, change))
    with pytest.raises(BadInput) as raised:
        ff.Problem.of(ff.read_campaign(path)).record  # noqa: B018  # bound to the FMU here
    assert said in " ".join(raised.value.args)
    assert "\n" not in raised.value.args[0]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        pytest.param('"u"\ninterp', '"v"\ninterp', "no column 'v'", id="no input"),
        pytest.param('gain = "fit"', 'gain = "two"', '"one", "fit"', id="gain"),
        pytest.param('level = "1000 mV", ', "", "'level'", id="level"),
        pytest.param('kind = "step"', 'kind = "pulse"', "'length'", id="length"),
        pytest.param('gain = "fit"', "states = 3", 'start = "unknown"', id="states"),
        pytest.param('gain = "fit"', 'begin = "found"', "free decay", id="begin"),
        pytest.param('sigma = "140 mV"', 'sigma = "0 V"', "more than zero", id="sigma"),
        pytest.param("[fmu]", "[noise]\nrelative = 0.01\n[fmu]", "[sweep]", id="noise"),
    ],
)
def test_bad_keys_are_told_in_a_sentence(
    lag_file: Path, tmp_path: Path, old: str, new: str, said: str
) -> None:
    assert CAMPAIGN.count(old) == 1
    path = written(tmp_path, lag_file, CAMPAIGN.replace(old, new))
    with pytest.raises(BadInput) as raised:
        ff.Problem.of(ff.read_campaign(path)).record  # noqa: B018
    assert said in " ".join(raised.value.args)


def test_what_rests_on_tones_wants_a_drive(lag_file: Path, tmp_path: Path) -> None:
    path = written(tmp_path, lag_file, CAMPAIGN + '[design]\ncentres = ["1 Hz"]\n')
    with pytest.raises(BadInput, match=r"no \[drive\]"):
        ff.limits(ff.Problem.of(ff.read_campaign(path)))


@pytest.mark.parametrize(
    ("time", "values", "more", "said"),
    [
        pytest.param(RING_T, RING[:-1], {}, "(400,) times", id="shapes"),
        pytest.param(RING_T[:5], RING[:5], {}, "5 samples, ", id="few"),
        pytest.param(
            np.delete(RING_T, range(100, 120)),
            np.delete(RING, range(100, 120)),
            {},
            "sample 100: 0.021 s",
            id="gap",
        ),
        pytest.param(RING_T, np.clip(RING, -0.6, 0.6), {}, "clipped at -0.6", id="clipped"),
        pytest.param(RING_T, RING, {"driven": ff.Pulse()}, "but by no input", id="no input"),
        pytest.param(RING_T, RING, {"input": "u"}, "the input 'u'", id="no drive"),
        pytest.param(RING_T, RING, {"gain": "two"}, "wanted 'one' or 'fit'", id="gain"),
        pytest.param(
            RING_T,
            np.exp(-RING_T),
            {"input": "u", "start": "unknown"},
            "a period",
            id="short",
        ),
        pytest.param(RING_T, RING, {"start": "unknown"}, "a pulse", id="no pulse"),
        pytest.param(RING_T, RING, {"begin": "found"}, "free decay", id="begin"),
        pytest.param(
            RING_T,
            np.cos(0.3 * RING_T / RING_T[1]),
            {"input": "u", "start": "unknown", "begin": "found"},
            "of 2 states",
            id="no decay",
        ),
    ],
)
def test_bad_arrays_are_told_in_a_sentence(
    time: FloatArray, values: FloatArray, more: dict[str, object], said: str
) -> None:
    with pytest.raises(BadInput) as raised:
        ff.Trace(time, values, setup=LAG, **more)  # type: ignore[arg-type]
    assert said in str(raised.value)


def clipped_step(noise: float) -> FloatArray:
    """The step response in a range that ends at three quarters of it."""
    y = lag_step(TAU, GAIN) + noise * np.random.default_rng(4).standard_normal(LAG_T.size)
    return np.minimum(y, 0.75 * GAIN)


def test_a_noisy_trace_that_stays_at_the_end_of_its_range_is_clipped() -> None:
    """One stretch: noise does not repeat its extreme, what is without noise may."""
    with pytest.raises(BadInput, match=r"clipped at 1\.5\b"):
        lag_trace(clipped_step(0.02))
    assert lag_trace(clipped_step(0.0)).rows == LAG_T.size
    rounded = np.round(lag_step(TAU, GAIN) / 0.1) * 0.1
    assert lag_trace(rounded).rows == LAG_T.size


@pytest.mark.parametrize("every", [1, 5, 10, 20])
def test_signals_of_few_bits_are_not_clipped(every: int) -> None:
    """Flat at the top, but come there by few quanta."""
    t = np.arange(0, 2500, every) * 4e-6
    for hz in np.linspace(300.0, 1500.0, 13):
        y = np.round(4.1 * np.sin(2 * np.pi * hz * t) / 0.2) * 0.2
        assert ff.Trace(t, y, setup=LAG, input="u", driven=(t, y)).rows == t.size
