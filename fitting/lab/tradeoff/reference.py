"""References that errors are measured from, each with its own error, where no closed form is."""

from __future__ import annotations

import numpy as np

from fitting.fmu import Run
from fitting.lab.tradeoff.bench import HELD, SUBSTEPS, Bench, setting_values
from fitting.lab.tradeoff.grid import period_s
from fitting.lab.tradeoff.quantities import exact_references, values_of
from fitting.lab.tradeoff.records import (
    AMPLITUDES,
    COHERENT,
    WIDTH_PEAKS,
    WIDTH_SWEEP,
    Reference,
    Setting,
)
from fitting.lab.tradeoff.scenes import Scene, Solver, scaled, single_tone
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure

#: Substeps per period of the three runs of a refinement; the last two for a closed orbit.
REFINED, QUICKLY = (320.0, 640.0, 1280.0), (80.0, 160.0, 320.0)
LEFT, QUICK_LEFT = 1e-13, 1e-9
SAMPLES = 64
FINEST_TOLERANCES = 1e-12, 1e-10
#: A change of the damping from which the sensitivity of the amplitudes is read.
NUDGE = 1e-2
#: What is left of a transient, and samples, of the two finest runs of a campaign.
CAMPAIGN_FINEST = ((1e-13, 129), (1e-11, 65))
CAMPAIGN_SUBSTEPS = (640.0, 320.0)
SWEEP_FINEST = (201, 101)


def references_of(bench: Bench, *, quick: bool = False) -> list[Reference]:
    """References of every quantity of the bench's scene.

    Raises:
        FmuFailure: the FMU failed.
        BadInput: no line in a campaign's sweep.
    """
    scene = bench.scene
    if scene.modes is None:
        return _of_campaign(bench)
    if scene.linear:
        return exact_references(scene)
    peaks = _averaged(bench) if scene.high_q else _refined(bench, quick)
    return [peaks, _of_width(bench, peaks)]


def refined_setting(
    scene: Scene, substeps: float, settle_s: float, *, periodic: bool = False
) -> Setting:
    """Amplitudes by the solver with that many substeps in a period of the fastest mode."""
    solver = next(s for s in scene.solvers if s.kind == SUBSTEPS)
    return Setting(
        AMPLITUDES,
        solver.name,
        setting_values(scene, solver, substeps, periodic),
        substeps,
        SUBSTEPS,
        periodic,
        settle_s,
        COHERENT,
        period_s(scene),
        SAMPLES,
    )


def richardson(coarse: FloatArray, fine: FloatArray) -> FloatArray:
    """Limit of a method of order four from two runs, the second with half the step."""
    return np.asarray(fine + (fine - coarse) / 15.0)


def _refined(bench: Bench, quick: bool) -> Reference:
    """Runge-Kutta from rest, settled, the substep halved twice.

    The value is the extrapolation of the two finer runs, its error the distance from that of the
    two coarser ones, which is far more than the finer one lacks, and what is left of the transient.
    """
    chosen, left = (QUICKLY, QUICK_LEFT) if quick else (REFINED, LEFT)
    settle = bench.scene.settling_s(left)
    runs = [values_of(bench, refined_setting(bench.scene, count, settle), None) for count in chosen]
    value, before = richardson(runs[1], runs[2]), richardson(runs[0], runs[1])
    error = float(np.max(np.abs(value / before - 1.0))) + left
    source = (
        f"rk4 from rest with {', '.join(f'{c:g}' for c in chosen)} substeps per period, "
        "extrapolated (Richardson)"
    )
    return Reference(AMPLITUDES, tuple(map(float, value)), error, source)


def _averaged(bench: Bench) -> Reference:
    """The envelope at its finest tolerance, with the error of the averaging.

    That is the largest of: the change from the next tolerance; the distance of each tone alone from
    rk4 on its closed orbit, refined and extrapolated; and eps (3 eps + |u1 - u2|/c), what the
    averaging leaves out, because a closed orbit knows nothing of the beat.
    """
    scene = bench.scene
    solver = next(s for s in scene.solvers if s.kind == "tolerance")
    runs = [
        values_of(bench, _envelope_setting(scene, solver, tolerance), None)
        for tolerance in FINEST_TOLERANCES
    ]
    tones = [tone for drive in scene.drives for tone in drive.tones_hz]
    alone = closed_orbits(bench, REFINED[1:])
    envelope = np.concatenate(
        bench.amplitudes(
            _envelope_setting(scene, solver, FINEST_TOLERANCES[0]),
            [single_tone(scene, tone) for tone in tones],
        )
    )
    shift = largest_shift(bench)
    left_out = shift * (3.0 * shift + abs(tones[0] - tones[1]) / (sum(tones) / len(tones)))
    apart = float(np.max(np.abs(envelope / richardson(alone[0], alone[1]) - 1.0)))
    error = max(float(np.max(np.abs(runs[0] / runs[1] - 1.0))), apart, left_out)
    source = (
        f"envelope with tolerance {FINEST_TOLERANCES[0]:g}; each tone alone is {apart:.1e} from "
        f"rk4 on its closed orbit, eps (3 eps + |u1 - u2|/c) = {left_out:.1e}"
    )
    return Reference(AMPLITUDES, tuple(map(float, runs[0])), error, source)


def closed_orbits(bench: Bench, counts: tuple[float, ...]) -> list[FloatArray]:
    """Amplitudes (tones,) of each tone alone by rk4 on its closed orbit, per number of substeps.

    The numbers are substeps per period of the tone. One period holds the whole orbit, so no quality
    factor is too high for it.
    """
    scene = bench.scene
    tones = [tone for drive in scene.drives for tone in drive.tones_hz]
    drives = [single_tone(scene, tone) for tone in tones]
    found = []
    for count in counts:
        per_fastest = count * min(tones) / scene.fastest_hz
        setting = refined_setting(scene, per_fastest, 0.0, periodic=True)
        found.append(np.concatenate(bench.amplitudes(setting, drives)))
    return found


def largest_shift(bench: Bench) -> float:
    """The FMU's own relative frequency shift by its cubic terms, the largest over a beat."""
    scene = bench.scene
    solver = scene.solvers[0]
    values = {
        **scene.values,
        **scene.drives[0].values,
        **setting_values(scene, solver, 1e-6, True),
    }
    step = period_s(scene) / SAMPLES
    run = Run(values, 0.0, step, SAMPLES, ("nonlinear_shift",))
    return float(np.max(bench.workers.run([run])[0]))


def _envelope_setting(scene: Scene, solver: Solver, tolerance: float) -> Setting:
    return Setting(
        AMPLITUDES,
        solver.name,
        setting_values(scene, solver, tolerance, True),
        tolerance,
        "tolerance",
        True,
        0.0,
        COHERENT,
        period_s(scene),
        SAMPLES,
    )


def _of_width(bench: Bench, peaks: Reference) -> Reference:
    """The width that the data were made with; their error shifts it by error over sensitivity."""
    scene = bench.scene
    solver = scene.solvers[0]
    setting = _envelope_setting(scene, solver, 1e-6)
    here = np.concatenate(bench.amplitudes(setting))
    moved = np.concatenate(bench.amplitudes(setting, None, scaled(scene, 1.0 + NUDGE)))
    slope = np.abs(moved / here - 1.0) / NUDGE
    error = peaks.error * float(np.sum(slope) / np.sum(slope**2))
    return Reference(
        WIDTH_PEAKS, (scene.width_hz,), error, f"the width behind the data; {peaks.source}"
    )


def _of_campaign(bench: Bench) -> list[Reference]:
    """The finest setting of a campaign's FMU, its distance from the next finest as its error.

    Of the full model; where that takes longer than the campaign's time limit, of the first
    reduction that does not, and the source says so.

    Raises:
        FmuFailure: every one of them failed.
    """
    scene = bench.scene
    kinds = {solver.name: solver for solver in reversed(scene.solvers)}
    failure: FmuFailure | None = None
    for name, solver in reversed(kinds.items()):
        source = f"the finest setting ({name}) against the next finest"
        try:
            pairs = [
                (q, [values_of(bench, _finest(scene, solver, k, q), None) for k in (0, 1)])
                for q in _campaign_quantities(scene)
            ]
        except FmuFailure as error:
            failure = failure or error
            continue
        return [_against(quantity, found[0], found[1], source) for quantity, found in pairs]
    assert failure is not None  # noqa: S101  (there is one solver at least)
    raise failure


def _campaign_quantities(scene: Scene) -> tuple[str, ...]:
    return (AMPLITUDES, WIDTH_SWEEP) if scene.sweep_hz and scene.tone else (AMPLITUDES,)


def _against(quantity: str, fine: FloatArray, coarse: FloatArray, source: str) -> Reference:
    error = max(float(np.max(np.abs(coarse / fine - 1.0))), float(np.finfo(float).eps))
    return Reference(quantity, tuple(map(float, fine)), error, source)


def _finest(scene: Scene, solver: Solver, place: int, quantity: str) -> Setting:
    """The finest setting (place 0) or the next (1), every knob of the FMU turned that far."""
    values = setting_values(scene, solver, solver.resolutions[0])
    resolution, kind = 0.0, ""
    for other in scene.solvers:
        if other.variable:
            best = sorted(other.resolutions)
            finest = CAMPAIGN_SUBSTEPS[place] if other.kind == SUBSTEPS else best[place]
            knob = setting_values(scene, other, finest)[other.variable]
            values[other.variable] = knob
    left, samples = CAMPAIGN_FINEST[place]
    if scene.held:
        resolution, kind = float(scene.held * (4, 2)[place]), HELD
    return Setting(
        quantity,
        solver.name,
        values,
        resolution,
        kind,
        False,
        0.0 if scene.steady else scene.settling_s(left),
        COHERENT,
        period_s(scene),
        samples,
        SWEEP_FINEST[place] if quantity == WIDTH_SWEEP else 0,
    )
