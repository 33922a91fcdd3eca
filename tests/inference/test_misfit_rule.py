"""What a misfit does to the values: status, verdicts and findings, on lines in closed form."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import pytest

from fitting.campaign import Experiment
from fitting.fit.fit import Fit, Status, with_path
from fitting.inference.agreement import contradicted, pair_findings
from fitting.inference.checks.solutions import residual_findings
from fitting.inference.infer import Inference
from fitting.inference.likelihood.knowledge import (
    Adequacy,
    JointResult,
    PairTest,
    SeriesPart,
    ValueAlone,
)
from fitting.measurements.measurement import Prediction
from fitting.measurements.noise import NoiseSpectra, NoiseSpectrum
from fitting.measurements.residuals import ResidualCurve
from fitting.measurements.sweep import Sweep
from fitting.measurements.tones import Tones
from fitting.report.published import rows_of
from fitting.result.assembly import result_of
from fitting.result.result import Provenance
from fitting.signal.residual_tests import white_noise_p
from fitting.text.arrays import FloatArray
from fitting.text.estimate import FittedEstimate, Verdict
from fitting.text.finding import Kind
from tests.support.curve_fits import (
    CENTRE_HZ,
    WIDTH_HZ,
    U,
    fitted,
    fitted_line,
    inferred,
    line,
    parameter,
    sweep,
)
from tests.support.datasets import SETUP

NOISE = 0.02
UNKNOWN = ValueAlone(math.nan, math.nan)
#: Of a result that no campaign made.
ORIGIN = Provenance(
    fmu_name="",
    fmu_file="",
    fmu_guid="",
    fmu_sha256="",
    campaign="",
    files={},
    versions={},
    command="",
    seed=1,
    settings={},
    plan=(),
    finished="",
)


def noise(size: float = NOISE, seed: int = 1) -> np.ndarray:
    return size * np.random.default_rng(seed).standard_normal(U.size)


def kinds(found: Inference) -> dict[Kind, float]:
    return {finding.kind: finding.numbers.get("factor", math.nan) for finding in found.findings}


def withdrawn(found: Inference) -> bool:
    values: list[FittedEstimate]
    values = [*found.parameters.values(), *found.derived.values(), *found.offsets]
    return all(
        value.status is Verdict.WITHDRAWN
        and math.isnan(value.std)
        and all(map(math.isnan, value.ci95))
        for value in values
    )


# --- (a) correlated residuals -------------------------------------------------------------------


@pytest.mark.parametrize("profiles", [True, False])
def test_structure_of_a_tenth_is_no_noise_however_large_that_is_stated(profiles: bool) -> None:
    """A slope of 20 % that the model does not have; chi square is 2.5 times its freedom alone."""
    data = line(U) + 0.2 * (U - 1000.0) / 24.0 + 0.2 + noise()
    found = inferred(fitted_line(sweep(data, 0.07)), profiles=profiles)
    assert found.status is Status.MISFIT
    assert withdrawn(found)
    assert Kind.not_described in kinds(found)
    assert not {Kind.noise_underestimated, Kind.correlated_residuals} & set(kinds(found))


def test_small_structure_gives_values_with_the_errors_of_fewer_points() -> None:
    """A slope of 2 %: values within 4 errors, which are wider than those of white noise."""
    data = line(U) + 0.02 * (U - 1000.0) / 24.0 + 0.02 + noise(0.005)
    found = inferred(fitted_line(sweep(data, 0.005)))
    assert found.status is Status.CONVERGED
    assert Kind.correlated_residuals in kinds(found)
    plain = inferred(fitted_line(sweep(line(U) + noise(0.005), 0.005)))
    for name, truth in {"centre": CENTRE_HZ, "width": WIDTH_HZ}.items():
        value = found.parameters[name]
        assert value.std > 3.0 * plain.parameters[name].std
        assert abs(value.value - truth) < 4.0 * value.std


@dataclass(frozen=True)
class SweepOfPieces(Sweep):
    """Twelve sweeps of nine points over the same axis, with one model."""

    def residual_curves(self, residuals: FloatArray) -> Sequence[ResidualCurve]:
        [whole] = super().residual_curves(residuals)
        rows = whole.rows.reshape(12, 9)
        return [
            replace(
                whole,
                rows=mine,
                share=whole.share[mine],
                axis=whole.axis[mine],
                model=whole.model[mine],
                measured=whole.measured[mine],
                columns={kind: column[mine] for kind, column in whole.columns.items()},
                name=f"piece {k}",
            )
            for k, mine in enumerate(rows)
        ]


@pytest.mark.parametrize("times", [0.0, 1.0])
def test_what_every_sweep_has_too_weakly_is_seen_in_all_of_them(times: float) -> None:
    """A slope of a quarter of the line is beyond chance in none of the sweeps of nine points."""
    u = np.tile(np.linspace(CENTRE_HZ - 24.0, CENTRE_HZ + 24.0, 9), 12)
    background = 0.25 * times * np.tile(np.linspace(-1.0, 1.0, 9), 12)
    drawn = 0.07 * np.random.default_rng(3).standard_normal(u.size)
    plain = sweep(line(u) + background + drawn, 0.07, u)
    pieces = SweepOfPieces(**{f.name: getattr(plain, f.name) for f in fields(plain) if f.init})
    found = inferred(fitted([pieces], lambda p: [Prediction(line(u, *p))]))
    assert found.status is (Status.MISFIT if times else Status.CONVERGED)
    assert min(white_noise_p(rows) for rows in (background + drawn).reshape(12, 9)) > 1e-4


# --- (b) uncorrelated residuals -----------------------------------------------------------------


@pytest.mark.parametrize("times", [3.0, 10.0])
def test_noise_that_was_stated_too_small_is_told_with_its_factor(times: float) -> None:
    found = inferred(fitted_line(sweep(line(U) + noise(), NOISE / times)))
    assert found.status is Status.CONVERGED
    assert kinds(found)[Kind.noise_underestimated] == pytest.approx(times, rel=0.15)
    right = inferred(fitted_line(sweep(line(U) + noise(), NOISE)))
    assert not right.findings
    for name, truth in {"centre": CENTRE_HZ, "width": WIDTH_HZ}.items():
        value = found.parameters[name]
        assert value.std == pytest.approx(right.parameters[name].std, rel=0.15)
        assert abs(value.value - truth) < 4.0 * value.std


def test_beside_a_correlated_curve_larger_residuals_are_not_called_noise() -> None:
    """What is wrong on the one curve may be so on the other: two sentences would contradict."""
    rule = Adequacy(
        chi_square=3000.0,
        freedom=130.0,
        p_value=0.0,
        describes=True,
        noise_factor=6.0,
        correlated_p=1e-9,
        share=0.02,
    )
    found = {f.kind: f.numbers for f in residual_findings(rule, ("one", "other"), 11.0)}
    assert found.keys() == {Kind.correlated_residuals, Kind.excess_residuals}
    assert found[Kind.excess_residuals] == {"inflation": 6.0}
    [alone] = residual_findings(replace(rule, correlated_p=0.5), ("one", "other"), 1.0)
    assert alone.kind is Kind.noise_underestimated


def test_of_few_points_a_large_chi_square_leaves_no_value() -> None:
    u = U[::20]
    data = line(u) + 0.05 * np.random.default_rng(4).standard_normal(u.size)
    found = inferred(fitted_line(sweep(data, 0.01, u)))
    assert found.status is Status.MISFIT
    assert withdrawn(found)


# --- one point ----------------------------------------------------------------------------------


def test_a_single_point_far_off_is_named_and_is_no_larger_noise() -> None:
    data = line(U) + noise()
    data[30] += 1.5
    found = inferred(fitted_line(sweep(data, NOISE)))
    [outlier] = [f for f in found.findings if f.kind is Kind.outlier]
    assert outlier.numbers["frequency_hz"] == pytest.approx(U[30])
    assert Kind.noise_underestimated not in kinds(found)


@pytest.mark.parametrize(("other", "described"), [(90, True), (31, False)])
def test_points_next_to_each_other_are_no_single_ones(other: int, described: bool) -> None:
    """Two glitches, or a structure of two points: noise of three times the size is neither."""
    data = line(U) + noise()
    data[[30, other]] += 1.5
    found = inferred(fitted_line(sweep(data, NOISE)))
    assert found.status is (Status.CONVERGED if described else Status.MISFIT)
    assert withdrawn(found) is not described
    assert len([f for f in found.findings if f.kind is Kind.outlier]) == (2 if described else 0)
    assert Kind.noise_underestimated not in kinds(found)


# --- a fit that has not converged ---------------------------------------------------------------


def unconverged() -> Fit:
    return replace(fitted_line(sweep(line(U) + noise(), NOISE)), status=Status.NOT_CONVERGED)


@pytest.mark.parametrize("profiles", [True, False])
def test_a_fit_that_has_not_converged_gives_no_values(profiles: bool) -> None:
    found = inferred(unconverged(), profiles=profiles)
    assert found.status is Status.NOT_CONVERGED
    assert withdrawn(found)
    assert Kind.not_converged in kinds(found)
    if found.knowledge is not None:
        assert not found.knowledge.adequacy.gives_values
        verdicts = {profile.status for profile in found.profiled.values()}
        assert verdicts == {Verdict.WITHDRAWN}


def test_files_of_values_have_none_where_none_is_reported() -> None:
    fit = unconverged()
    found = inferred(fit)
    result = result_of(fit, found, ORIGIN)
    for row, _ in rows_of(result):
        assert all(map(math.isnan, (row.value, row.std, *row.ci95)))


# --- the discrepancy principle ------------------------------------------------------------------


def followed(measured: Sweep) -> Fit:
    """The fit of one damped mode, and the levels of nu."""
    fit = fitted_line(measured)
    return with_path(replace(fit, options=replace(fit.options, path=True)))


def test_no_misfit_is_within_the_noise_where_the_model_fails() -> None:
    data = line(U) + 0.2 * (U - 1000.0) / 24.0 + 0.2 + noise()
    bad = inferred(followed(sweep(data, 0.07)), profiles=True)
    assert bad.knowledge is not None
    assert bad.knowledge.nu is not None
    assert math.isnan(bad.knowledge.nu.discrepancy)
    good = inferred(followed(sweep(line(U) + noise(), NOISE)), profiles=True)
    assert good.knowledge is not None
    assert good.knowledge.nu is not None
    assert good.knowledge.nu.discrepancy > 0.0


# --- causes -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("more", "kind"),
    [(0.3, Kind.offset), (0.0, None)],
)
def test_an_offset_is_named_where_it_is_the_cause(more: float, kind: Kind | None) -> None:
    """Amplitudes of a known scale: what is added to all of them is no line."""
    measured = Sweep(
        setup=SETUP,
        frequency_hz=U,
        amplitude_v=line(U) + more + noise(0.005),
        fitted=True,
        scaled_by="none",
        known=True,
        sigmas_v=np.full(U.size, 0.005),
        maximum_v=1.0 + more,
    )
    fit = fitted(
        [measured],
        lambda p: [Prediction(line(U, *p))],
        (parameter("centre", 990.0, 1010.0, 1000.0), parameter("width", 2.0, 30.0, 9.0)),
    )
    found = inferred(fit)
    causes = [f for f in found.findings if f.kind in (Kind.gain, Kind.offset, Kind.shift)]
    assert [cause.kind for cause in causes] == ([] if kind is None else [kind])


# --- a noise spectrum ---------------------------------------------------------------------------

F = np.linspace(9_000.0, 11_000.0, 201)
KT = 1.380649e-23


def thermal(p: np.ndarray, u: np.ndarray = F) -> np.ndarray:
    """Response of a unit mass to a force, (n,): frequency and width, Hz."""
    return np.asarray(1.0 / ((2 * np.pi) ** 2 * (p[0] ** 2 - u**2 + 1j * u * p[1])))


def spectrum(
    kelvin: float, stated: float, seed: int = 5, bin_: int = -1, averages: int = 100
) -> NoiseSpectra:
    truth = NoiseSpectrum(F, np.ones(F.size), force="thermal", unit="m", averages=100)
    density = kelvin * KT * truth.shape(thermal(np.array([1e4, 120.0])))
    density = density + 0.02 * np.max(density)
    density *= np.random.default_rng(seed).gamma(100.0, 0.01, F.size)
    if bin_ >= 0:
        density[bin_] *= 30.0
    record = NoiseSpectrum(
        F, density, force="thermal", unit="m", averages=averages, temperature_k=stated, mass_kg=1.0
    )
    return NoiseSpectra(setup=SETUP, spectra=(record,))


def of_spectrum(measured: NoiseSpectra) -> Inference:
    return inferred(
        fitted(
            [measured],
            lambda p: [measured.solved([thermal(p)])],
            (parameter("centre", 9.8e3, 1.02e4, 9.99e3), parameter("width", 20.0, 500.0, 100.0)),
        )
    )


def test_a_temperature_stated_too_high_is_no_description() -> None:
    right = of_spectrum(spectrum(300.0, 300.0))
    assert (right.status, right.findings) == (Status.CONVERGED, ())
    wrong = of_spectrum(spectrum(300.0, 450.0))
    assert wrong.status is Status.MISFIT
    assert withdrawn(wrong)
    [cause] = [f for f in wrong.findings if f.kind is Kind.noise_level]
    assert 1.0 + cause.numbers["size"] == pytest.approx(300.0 / 450.0, abs=0.1)


def test_nine_times_too_many_averages_are_noise_stated_three_times_too_small() -> None:
    right = of_spectrum(spectrum(300.0, 300.0))
    found = of_spectrum(spectrum(300.0, 300.0, averages=900))
    assert found.status is Status.CONVERGED
    assert kinds(found).keys() == {Kind.noise_underestimated}
    assert kinds(found)[Kind.noise_underestimated] == pytest.approx(3.0, rel=0.15)
    for name, value in right.parameters.items():
        assert found.parameters[name].std == pytest.approx(value.std, rel=0.15)


def test_a_bin_of_a_spectrum_that_is_30_times_too_high_is_named() -> None:
    found = of_spectrum(spectrum(300.0, 300.0, bin_=20))
    [outlier] = [f for f in found.findings if f.kind is Kind.outlier]
    assert outlier.numbers["frequency_hz"] == pytest.approx(F[20])
    assert outlier.numbers["sigmas"] > 10.0
    assert Kind.noise_underestimated not in kinds(found)


# --- single peaks -------------------------------------------------------------------------------


def peaks(off: dict[str, float], drawn: float = 0.01, seed: int = 6) -> Tones:
    """Experiments e0 to e7 with two tones each; `off` are factors on both peaks of one."""
    rng = np.random.default_rng(seed)
    made = []
    for k in range(8):
        tones = (995.0 + 1.3 * k, 1006.0 - 1.1 * k)
        heights = line(np.array(tones)) * off.get(f"e{k}", 1.0)
        heights = heights * (1.0 + drawn * rng.standard_normal(2))
        made.append(
            Experiment(
                label=f"e{k}",
                settings={},
                tones_hz=tones,
                peaks_v=heights,
                sigmas_v=0.01 * heights,
                floor_v=0.0,
                spectrum=None,
            )
        )
    return Tones(SETUP, tuple(made))


def of_peaks(measured: Tones) -> Inference:
    tones = np.array([tone for e in measured.experiments for tone in e.read_hz])
    return inferred(fitted([measured], lambda p: [Prediction(line(tones, *p))]))


def test_the_experiment_that_is_too_high_is_named_and_no_other() -> None:
    assert of_peaks(peaks({})).findings == ()
    found = of_peaks(peaks({"e2": 1.5}))
    assert found.status is Status.MISFIT
    [outlier] = [f for f in found.findings if f.kind is Kind.outlier]
    assert outlier.subject == "e2"
    assert outlier.numbers["factor"] == pytest.approx(1.5, rel=0.05)
    assert Kind.drift_suspected not in kinds(found)


def test_weak_peaks_that_the_noise_explains_are_no_misfit() -> None:
    """Peaks 40 % off on average, by noise of 60 %: one decision."""
    measured = peaks({}, drawn=0.0)
    rng = np.random.default_rng(8)
    experiments = tuple(
        replace(e, peaks_v=high, sigmas_v=0.6 * e.peaks_v)
        for e in measured.experiments
        for high in [e.peaks_v * np.clip(1.0 + 0.6 * rng.standard_normal(2), 0.1, None)]
    )
    found = of_peaks(Tones(SETUP, experiments))
    assert Kind.not_converged not in kinds(found)
    assert Kind.not_described not in kinds(found)
    assert found.status is Status.CONVERGED


# --- campaigns that contradict each other -------------------------------------------------------


def joint(**sigmas: float) -> JointResult:
    """Campaigns a, b, c with distances of pairs "ab", "ac", "bc" and of each from the rest."""
    parts = tuple(
        SeriesPart(
            name=name,
            campaign=name,
            scale_kind="none",
            chi=1.0,
            rows=9,
            determined=2,
            chi_square_joint=9.0,
            chi_square_alone=7.0,
            inflation=1.0,
            alone={},
        )
        for name in "abc"
    )
    rest = {"a": "b + c", "b": "a + c", "c": "a + b"}
    tests = tuple(
        PairTest(
            one=key[0],
            other=rest[key[0]] if len(key) == 1 else key[1],
            chi_square=value**2,
            freedom=1,
            p_value=1e-9,
            sigmas=value,
        )
        for key, value in sigmas.items()
    )
    return JointResult(parts, tests)


@pytest.mark.parametrize(
    ("sigmas", "named"),
    [
        # c differs from a and from b, which agree
        ({"ab": 0.5, "ac": 9.0, "bc": 8.0, "a": 5.0, "b": 4.5, "c": 11.0}, ["c"]),
        # all differ: no one alone is named, and none is compared with two that contradict
        ({"ab": 9.0, "ac": 9.0, "bc": 9.0, "a": 9.0, "b": 9.0, "c": 9.0}, ["a, b", "a, c", "b, c"]),
        ({"ab": 0.5, "ac": 1.0, "bc": 0.5, "a": 1.0, "b": 0.5, "c": 1.0}, []),
    ],
)
def test_the_campaign_that_differs_is_named_once(
    sigmas: dict[str, float], named: list[str]
) -> None:
    found = pair_findings(joint(**sigmas), searched=True)
    assert [f.subject for f in found if f.kind is Kind.contradiction] == named


def test_values_stay_that_every_contradicting_campaign_determines_alone_and_alike() -> None:
    """What one of them alone determines rests, in the joint fit, on the other one's data, too."""
    told = {
        "a": {"f": ValueAlone(5.0, 0.1), "d": ValueAlone(10.0, 0.1), "theta": ValueAlone(1.0, 0.1)},
        "b": {"f": ValueAlone(5.1, 0.1), "d": ValueAlone(11.0, 0.1), "theta": UNKNOWN},
        "c": {"f": ValueAlone(9.0, 1.0), "d": UNKNOWN, "theta": UNKNOWN},
    }
    result = joint(ab=9.0, ac=0.5, bc=0.5)
    parts = tuple(replace(part, alone=told[part.name]) for part in result.series)
    units = dict.fromkeys(("f", "d", "theta", "gain_of_a"), "Hz")
    named = contradicted(replace(result, series=parts), units)
    assert set(named) == {"d", "theta", "gain_of_a"}
    assert contradicted(replace(joint(ab=1.0), series=parts), units) == {}
