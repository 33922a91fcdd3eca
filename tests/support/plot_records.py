"""Small records of inference, simulation and design with hand-picked numbers, for plots."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitting.design.result import Design, Expected, Kind, PlacePoint, Proposal
from fitting.inference.likelihood.knowledge import (
    Adequacy,
    Determined,
    Effort,
    Knowledge,
    NuChoice,
    NuRow,
    Profile,
    Scan,
)
from fitting.simulate.budget import Basis, Budget, Decision
from fitting.simulate.budget import Kind as Decided
from fitting.simulate.drive import Drive
from fitting.simulate.frf import Curve, Jump, Sweep, SweepResponse
from fitting.simulate.planner import DrivePlan
from fitting.simulate.response import DriveResponse, Remainder, RemainderKind, Spectrum, Trace
from fitting.text.estimate import OutputEstimate, ParameterEstimate, Verdict

TONES_HZ = (6940160.0, 6940360.0)


def profile(
    name: str = "d1",
    best: float = 94.0,
    sigma: float = 2.5,
    kind: type[ParameterEstimate] | type[OutputEstimate] = ParameterEstimate,
) -> Profile:
    """A parabola Dchi^2 = ((v - best)/sigma)^2, known over 7 points within 3 sigma."""
    steps = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
    values = tuple(best + sigma * s for s in steps)
    value = kind(
        name=name,
        unit="Hz",
        value=best,
        std=sigma,
        ci68=(best - sigma, best + sigma),
        ci95=(best - 1.96 * sigma, best + 1.96 * sigma),
        lower=1.0,
        upper=1000.0,
        closed_by=("data", "data"),
        shrinkage=0.99,
        status=Verdict.DETERMINED,
        reason="to 5.2 %",
        method="profile",
    )
    path = {"d1": values, "lambda": tuple(7e5 + 1e4 * s for s in steps)}
    scan = Scan(sigma=sigma, values=values, delta_chi2=tuple(s**2 for s in steps), path=path)
    return value, scan


def determined() -> Determined:
    """One parameter beside another that goes as its negative, and an output."""
    made = [profile(), profile("d2", 106.0), profile("lambda", 7e5, 1e4, OutputEstimate)]
    first = made[0][1].values
    path = {"d1": first, "d2": tuple(200.0 - v for v in first)}
    scans = {v.name: replace(scan, path={**scan.path, **path}) for v, scan in made}
    knowledge = Knowledge(
        data=True,
        chi_square=9.0,
        freedom=8.0,
        inflation=1.0,
        adequacy=Adequacy(chi_square=9.0, freedom=8.0, p_value=0.34, describes=True),
        most_likely={"d1": 94.0, "d2": 106.0},
        scans=scans,
        directions=(),
        without_effect=(),
        equivalents=(),
        effort=Effort(10, 10, 100),
        nu=nu_choice(),
    )
    values = [v for v, _ in made]
    return Determined(
        parameters={v.name: v for v in values if isinstance(v, ParameterEstimate)},
        derived={v.name: v for v in values if isinstance(v, OutputEstimate)},
        knowledge=knowledge,
    )


def nu_choice() -> NuChoice:
    """Three levels; the corner is the second."""
    rows = tuple(
        NuRow(
            nu=10.0**-k,
            j_fit=1.0 / k,
            distance=0.1 * k,
            chi_square=20.0 / k,
            curvature=0.0,
            parameters={"d1": 94.0 + k},
            derived={},
        )
        for k in (1, 2, 3)
    )
    return NuChoice(
        rows=rows,
        corner=1e-2,
        discrepancy=1e-2,
        allowed=12.0,
        last=1e-3,
        prior={"d1": 94.0},
        widths={"d1": 1000.0},
    )


def drive_plan(drive: Drive) -> DrivePlan:
    """A plan with one decision: 0.1 s to settle."""
    numbers = {"settle_s": 0.1}
    settling = Decision(kind=Decided.SETTLING, basis=Basis.WATCHED, bound=1e-7, numbers=numbers)
    return DrivePlan(
        drives=(drive,),
        settings={},
        windows=(drive.window(0.1),),
        readings=(),
        budget=Budget(1e-6, (settling,)),
        settle_s=0.1,
        order=1,
        longest_s=100.0,
    )


def drive_result() -> DriveResponse:
    """Two tones with peaks of 3 and 2 µV on one output."""
    times = np.linspace(0.0, 1e-2, 41 * 3)
    wave = 5e-6 * np.cos(2 * np.pi * 100.0 * times)[:, None]
    f = np.arange(6940100.0, 6940420.0, 20.0)
    amplitudes = np.full((len(f), 1), 1e-12)
    amplitudes[[3, 13], 0] = 3e-6, 2e-6
    drive = Drive(start_values={}, tones_hz=TONES_HZ, outputs=("q1",))
    return DriveResponse(
        drive=drive,
        plan=drive_plan(drive),
        peaks=np.array([[3e-6], [2e-6]]),
        spectrum=Spectrum(
            frequencies_hz=f,
            amplitudes=amplitudes,
            window_s=0.05,
            samples=32,
            coherent=True,
            bins=(3, 13),
            rounding=1e-13,
        ),
        lines=(),
        remainder=Remainder(RemainderKind.ROUNDING, 0.0, np.nan),
        other_line=None,
        beating=Trace(times, wave),
        carrier=Trace(times[:41] * 1e-4, wave[:41]),
        constants={},
    )


def frf_result() -> SweepResponse:
    """Up and down over five frequencies with a jump upward."""
    f = (6940100.0, 6940200.0, 6940300.0, 6940400.0, 6940500.0)
    up, down = np.array([1.0, 2.0, 4.0, 1.0, 0.5]), np.array([1.0, 1.5, 1.5, 1.0, 0.5])
    sweep = Sweep(
        start_values={},
        tone="u1",
        tone_unit="Hz",
        frequencies_hz=f,
        output="q1",
        directions=("up", "down"),
    )
    return SweepResponse(
        sweep=sweep,
        plan=drive_plan(sweep.drive(f[2], f[0])),
        curves=(Curve("up", 1e-6 * up), Curve("down", 1e-6 * down)),
        jumps=(Jump("up", f[2], f[3]),),
        difference=0.6,
    )


def design() -> Design:
    """One proposal that makes the error of the target ten times smaller."""
    after = Expected(100.0, 110.0, 200.0)
    return Design(
        title="A string",
        synthetic=True,
        campaign="campaign.toml",
        target="lambda",
        unit="Hz",
        amplitude_unit="V",
        criterion="c",
        before=Expected(1000.0, 1100.0, 2000.0),
        spread=5000.0,
        span=(6e5, 7e5),
        proposals=(
            Proposal(
                rank=1,
                tones_hz=TONES_HZ,
                centre_hz=6940260.0,
                output="q1",
                level=1.0,
                settings={},
                repeats=4,
                peaks_v=(3e-6, 2e-6),
                sigmas_v=(1e-8, 1e-8),
                expected=after,
            ),
        ),
        kinds=(
            Kind(
                output="q1",
                centre_hz=6940260.0,
                level=1.0,
                best=120.0,
                worst=900.0,
                beside=110.0,
                count=12,
            ),
        ),
        places=(
            PlacePoint(
                alternative={}, parameters={"d1": 94.0}, target=6.5e5, sigmas=(1000.0, 100.0)
            ),
        ),
        equal_fits=1,
        valueless=0,
        setups=1,
        candidates=12,
        sentences=(),
    )
