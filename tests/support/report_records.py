"""Small results and campaigns with hand-picked numbers, for the tests of figures and report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign import Drive, Experiment, Setup, Spectrum
from fitting.fit.alternative import AlternativeResult, StartResult
from fitting.fit.fit import Status
from fitting.fit.path import HistoryRow
from fitting.inference.sweeps import SweepLine
from fitting.lines.form import fit_resonance
from fitting.lines.record import line_numbers, number_of_line
from fitting.measurements.figure import Figure
from fitting.measurements.sweep import Sweep
from fitting.measurements.tones import spectra_figure
from fitting.report.shown import ShownCampaign, ShownTones
from fitting.result.result import (
    Cost,
    Deviations,
    DeviationSet,
    Peak,
    Provenance,
    Result,
    Scale,
    SweepCurves,
)
from fitting.text.estimate import OutputEstimate, ParameterEstimate, Verdict
from fitting.text.finding import Finding, Kind

#: Drive pairs of the paper's first series, Hz, and peak amplitudes of the size it reports.
PAIRS_HZ = (
    (6940160.0, 6940360.0),
    (6940180.0, 6940340.0),
    (6940200.0, 6940320.0),
    (6940240.0, 6940280.0),
    (6940250.0, 6940270.0),
)
SIGMA_V = 0.2e-6
SWEEP_HZ = np.linspace(6939960.0, 6940560.0, 41)
WIDTH_HZ, ETA_HZ, TOP_V = 94.0, 6940260.0, 40e-6
WARNINGS = ("theta is not determined.", "A second warning with < and & in it.")


def lorentzian_v(f_hz: np.ndarray) -> np.ndarray:
    """Amplitude of a damped mode near its resonance: TOP/sqrt(1 + (2 (f - eta)/width)^2)."""
    result: np.ndarray = TOP_V / np.sqrt(1.0 + (2.0 * (f_hz - ETA_HZ) / WIDTH_HZ) ** 2)
    return result


SWEPT_V = lorentzian_v(SWEEP_HZ) * (1.0 + 1e-3 * np.cos(np.arange(41.0)))
RESONANCE = fit_resonance(SWEEP_HZ, SWEPT_V)


@dataclass(frozen=True, kw_only=True)
class MeasuredTones(ShownTones):
    """An experiment with what was measured: peaks (n,), their errors, its spectrum."""

    read_hz: tuple[float, ...]
    peaks: tuple[float, ...]
    sigmas: tuple[float, ...]
    floor: float
    trace: Spectrum | None
    unit: str = "V"


def measured(data: ShownCampaign) -> Sequence[MeasuredTones]:
    """The experiments of a campaign; those that were not made here get peaks as those have."""
    return [
        e if isinstance(e, MeasuredTones) else experiment(e.label, e.tones_hz, spectrum=False)
        for e in data.tones
    ]


def experiment(label: str, tones_hz: Sequence[float], *, spectrum: bool = True) -> MeasuredTones:
    """An experiment whose peaks lie on the Lorentzian, with a spectrum that shows them."""
    peaks = lorentzian_v(np.array(tones_hz))
    trace = None
    if spectrum:
        f = np.arange(min(tones_hz) - 150.0, max(tones_hz) + 151.0)
        a = 0.25e-6 * (1.0 + 0.5 * np.sin(0.7 * np.arange(f.size)))
        for tone, peak in zip(tones_hz, peaks, strict=True):
            a[int(np.argmin(np.abs(f - tone)))] = peak
        trace = Spectrum(f, a)
    return MeasuredTones(
        label=label,
        tones_hz=tuple(tones_hz),
        drive=(1.0,) * len(tones_hz),
        read_hz=tuple(tones_hz),
        peaks=tuple(map(float, peaks)),
        sigmas=(SIGMA_V,) * len(peaks),
        floor=0.25e-6,
        trace=trace,
        has_spectrum=spectrum,
    )


def campaign(
    tones: Sequence[MeasuredTones] | None = None,
    *,
    title: str = "A string",
    synthetic: bool = True,
    drift_hz: dict[str, tuple[float, float]] | None = None,
    unit: str = "V",
) -> ShownCampaign:
    """A campaign of two-tone experiments; the paper's pairs unless others are given."""
    if tones is None:
        tones = [experiment(f"pair{m + 1}", pair) for m, pair in enumerate(PAIRS_HZ)]
    return ShownCampaign(
        title=title,
        synthetic=synthetic,
        unit=unit,
        tones=tuple(replace(t, unit=unit) for t in tones),
        drift_hz={"eta_plus": (6940210.0, 6940310.0), "temperature": (300.0, 301.0)}
        if drift_hz is None
        else drift_hz,
        settings={"observed output": "q1_hybrid", "drive": "tones set by the FMU's u1 and u2"},
        notes=("A note of the binding.",),
    )


def deviation_set(data: ShownCampaign, values: Sequence[float]) -> DeviationSet:
    """Deviations per peak with their means, as the paper defines them."""
    counts = [len(e.tones_hz) for e in data.tones]
    groups = np.split(np.array(values), np.cumsum(counts)[:-1]) if counts else [np.array(values)]
    return DeviationSet(
        tuple(values), tuple(float(np.mean(g)) for g in groups), float(np.mean(values))
    )


def result_for(
    data: ShownCampaign,
    *,
    initial: Sequence[float] | None = None,
    final: Sequence[float] | None = None,
    sweep: bool = True,
) -> Result:
    """A result for a campaign; ``initial``, ``final`` are signed relative errors per peak."""
    peaks = [
        (e.label, f, float(v), float(s))
        for e in measured(data)
        for f, v, s in zip(e.tones_hz, e.peaks, e.sigmas, strict=True)
    ]
    count = len(peaks) or 41
    first = [0.3 + 0.01 * k for k in range(count)] if initial is None else list(initial)
    last = [0.01 * (-1) ** k for k in range(count)] if final is None else list(final)
    rows = tuple(
        Peak(
            experiment=label,
            frequency_hz=f,
            measured_v=v,
            sigma_v=s,
            initial_v=v * (1.0 + a),
            final_v=v * (1.0 + b),
        )
        for (label, f, v, s), a, b in zip(peaks, first, last, strict=False)
    )
    before = deviation_set(data, [abs(a) for a in first])
    after = deviation_set(data, [abs(b) for b in last])
    n = max(1, len(data.tones))
    swept = tuple(map(float, lorentzian_v(SWEEP_HZ)))
    return Result(
        title=data.title,
        synthetic=data.synthetic,
        status=Status.CONVERGED,
        message="All 3 levels were done.",
        parameters=parameters(),
        derived=derived(n),
        alternative={"reflection": False},
        deviations=Deviations(before, after, 100.0 * (1.0 - after.mean / before.mean)),
        j_fit=float(sum(after.per_peak)),
        j_reg=1.5e-9,
        optimality=1e-9,
        scale=Scale(
            kind="maximum",
            initial=1.03e6,
            final=1.04e6,
            grid_bias=2e-8,
            maximum_v=TOP_V,
            maximum_bias=1e-3,
            maximum_bias_std=5e-4,
        ),
        peaks=rows,
        sweep=SweepCurves(
            frequency_hz=tuple(map(float, SWEEP_HZ)),
            measured_v=swept,
            initial_v=tuple(0.9 * v for v in swept),
            final_v=swept,
        )
        if sweep
        else None,
        history=history(),
        alternatives=alternatives(),
        correlation=((1.0, -0.988), (-0.988, 1.0)),
        evaluations=Cost(120, 14, 1200),
        seconds=3.25,
        warnings=WARNINGS,
        findings=tuple(
            Finding(kind=Kind.file_remark, severity="warning", subject="", names={"text": (text,)})
            for text in WARNINGS
        ),
        provenance=provenance(),
        line=SweepLine(
            **line_numbers((ETA_HZ, 0.11), (WIDTH_HZ, 0.24), (73832.6, 190.0)),
            amplitude=number_of_line("amplitude", TOP_V, 5e-8, "V"),
            unit="V",
            rms_residual=4.3e-3,
            background="none",
            message="done",
            instrument={"frequency_hz": 6940261.5, "q": 70000.0},
            notes={},
        ),
    )


def spectra(data: ShownCampaign, result: Result) -> Figure:
    """What the experiments show beside the model of the result."""
    experiments, simulated = [], []
    for e in measured(data):
        peaks = [p for p in result.peaks if p.experiment == e.label]
        experiments.append(
            Experiment(
                label=e.label,
                tones_hz=tuple(e.read_hz),
                peaks_v=np.array(e.peaks),
                sigmas_v=np.array(e.sigmas),
                floor_v=e.floor,
                spectrum=e.trace,
            )
        )
        each = ([p.initial_v for p in peaks], [p.final_v for p in peaks])
        simulated.append((np.array(each[0]), np.array(each[1])))
    return spectra_figure(experiments, simulated, measured(data)[0].unit)


def response(data: ShownCampaign, result: Result) -> Figure:
    """What the sweep shows beside the model of the result."""
    curves = result.sweep
    assert curves is not None
    measured = Sweep(
        setup=Setup(Drive(input="b"), "q1"),
        frequency_hz=SWEEP_HZ,
        amplitude_v=SWEPT_V,
        fitted=not data.tones,
        unit=data.unit,
    )
    (figure,) = measured.figures(np.array(curves.initial_v), np.array(curves.final_v))
    return figure


def with_figures(data: ShownCampaign, result: Result) -> ShownCampaign:
    """The campaign with what its measurements show."""
    figures = [spectra(data, result)] if data.tones else []
    figures += [response(data, result)] if result.sweep is not None else []
    return replace(data, figures=tuple(figures))


def parameters() -> dict[str, ParameterEstimate]:
    """One parameter that the data do not determine, one that they do."""
    return {
        "theta": ParameterEstimate(
            name="theta",
            value=1.964226760285730,
            unit="rad",
            std=3.6,
            ci95=(0.0, 3.14159),
            algorithm2=1.9643,
            reference=1.9635,
            start=0.0,
            lower=-6.3,
            upper=6.3,
            shrinkage=8e-8,
            status=Verdict.UNCONSTRAINED,
        ),
        "d1": ParameterEstimate(
            name="d1",
            value=93.42457642728192,
            unit="Hz",
            std=0.24,
            ci95=(92.95, 93.89),
            algorithm2=93.6,
            reference=94.0,
            start=94.0,
            lower=1.0,
            upper=1000.0,
            shrinkage=0.98,
            status=Verdict.DETERMINED,
            reason="to 0.5 %",
        ),
    }


def derived(experiments: int) -> dict[str, OutputEstimate]:
    """The same for derived outputs: a drifting one not determined, a constant one determined."""
    drift = tuple(657227.49 + 1.1 * m for m in range(experiments))
    mean = float(np.mean(drift))
    return {
        "lambda": OutputEstimate(
            name="lambda",
            value=mean,
            unit="Hz",
            values=drift,
            spread=1.74,
            std=2.5,
            ci95=(63313.9, 780999.0),
            algorithm2=657000.0,
            reference=656749.9,
            shrinkage=8e-8,
            status=Verdict.UNCONSTRAINED,
            lower=63313.9,
            upper=780999.0,
        ),
        "D11": OutputEstimate(
            name="D11",
            value=599.134,
            unit="1/s",
            values=(599.134,) * experiments,
            spread=0.0,
            std=1.9,
            ci95=(595.4, 602.8),
            algorithm2=600.1,
            reference=622.96,
            shrinkage=1.0,
            status=Verdict.DETERMINED,
            reason="to 0.5 %",
            lower=131.6,
            upper=6076.9,
        ),
    }


def history() -> tuple[HistoryRow, ...]:
    """Start and three levels."""
    rows = [
        (-1, math.nan, 0.0, 94.0, math.nan, 591.7, 3.4, math.nan, "start"),
        (0, 0.1, 1.9641, 93.5, 657200.0, 599.3, 0.27, 9.6e-5, "converged"),
        (1, 0.01, 1.9642, 93.43, 657229.0, 599.14, 0.264, 9.6e-6, "converged"),
        (2, 0.001, 1.96422676, 93.424576, 657229.7, 599.134, 0.2637, 9.6e-7, "converged"),
    ]
    return tuple(
        HistoryRow(
            level=level,
            nu=nu,
            parameters={"theta": t, "d1": d},
            derived={"lambda": lam, "D11": d11},
            j_fit=fit,
            j_reg=reg,
            change=1.2,
            optimality=1e-6,
            second_j=fit + reg,
            status=status,
            message="as good as it gets",
            iterations=5,
            evaluations=40,
            seconds=0.8,
        )
        for level, nu, t, d, lam, d11, fit, reg, status in rows
    )


def alternatives() -> tuple[AlternativeResult, ...]:
    """Two that the data do not tell apart."""
    at = {"theta": 1.9642, "d1": 93.42}
    start = StartResult(
        begun={"theta": 0.0, "d1": 94.0},
        parameters=at,
        chi_square=4.2,
        descents=3,
        equivalent=True,
    )
    out = {"lambda": 657229.7, "D11": 599.1}
    return tuple(
        AlternativeResult(
            settings={"reflection": form},
            parameters=at,
            derived=out,
            chi_square=4.2,
            j_fit=0.2637,
            converged=True,
            reported=not form,
            equal_to_best=True,
            starts=(start,),
        )
        for form in (False, True)
    )


def provenance() -> Provenance:
    """Names and hashes that cannot be mistaken for others."""
    return Provenance(
        fmu_name="CoupledOscillator",
        fmu_file="CoupledOscillator.fmu",
        fmu_guid="{guid-of-fmu}",
        fmu_sha256="f" * 64,
        campaign="campaign.toml",
        files={"campaign.toml": "a" * 64},
        versions={"numpy": "9.9.9"},
        command="fmu-fit reconstruct campaign.toml",
        seed=1,
        settings={"nu_start": 0.1, "misfit": "slack"},
        plan=("The FMU starts on its periodic orbit.", "Windows hold whole periods."),
        finished="2026-01-02T03:04:05+00:00",
    )
