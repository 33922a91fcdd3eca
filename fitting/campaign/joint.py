"""Several campaigns of one sample: parameters shared by name, the rest its own; no data twice."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fitting.campaign.bound import BoundCampaign
from fitting.campaign.measured import Spectrum, SweepData
from fitting.campaign.parameters import Parameter
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind, note


def join_parameters(bounds: Sequence[BoundCampaign]) -> tuple[tuple[Parameter, ...], list[Finding]]:
    """Parameters of campaigns that are fitted together, and notes where these begin elsewhere.

    Parameters of a whole campaign are shared by name and must have the same unit, box, period and
    prior; where start, reference or scale differ, those of the first campaign are taken, which
    a note states. Drift offsets, other values of single experiments and fitted scales stay apart.

    Args:
        bounds: campaigns, each bound to its FMU.

    Raises:
        BadInput: parameters, alternatives or units that contradict each other; names both files.
    """
    wanted = "wanted the same in campaigns that are fitted together"
    first, *others = bounds
    for other in others:
        for what, one, two in (
            ("[alternatives]", first.alternatives, other.alternatives),
            ("unit of the amplitudes", first.amplitude_unit, other.amplitude_unit),
        ):
            if one != two:
                result, known = (
                    str([dict(v) for v in value]) if isinstance(value, tuple) else str(value)
                    for value in (two, one)
                )
                raise BadInput(
                    f"{other.path}: {what}: {result}, but {first.path} has {known}; {wanted}"
                )
        if first.path.resolve() == other.path.resolve():
            raise BadInput(f"{other.path}: is named twice; wanted different campaigns")
    shared: dict[str, tuple[Parameter, BoundCampaign]] = {}
    own: list[Parameter] = []
    notes: list[Finding] = []
    for bound in bounds:
        for p in bound.parameters:
            if not is_shared(p):
                own.append(p)
                continue
            q, home = shared.setdefault(p.name, (p, bound))
            for key in ("unit", "lower", "upper", "period", "prior"):
                if getattr(q, key) != getattr(p, key):
                    raise BadInput(
                        f"{bound.path}: parameter '{p.name}': {key} = {getattr(p, key)!r}, but "
                        f"{home.path} has {getattr(q, key)!r}; {wanted}"
                    )
            keys = ("start", "reference", "scale")
            apart = tuple(key for key in keys if getattr(q, key) != getattr(p, key))
            if apart:
                numbers = {f"{key}_one": float(getattr(q, key)) for key in apart}
                numbers |= {f"{key}_other": float(getattr(p, key)) for key in apart}
                folders = home.path.parent.name, bound.path.parent.name
                names = {"keys": apart, "campaigns": folders}
                notes.append(note(Kind.starts_differ, p.name, names, **numbers))
    return (*(p for p, _ in shared.values()), *own), notes


def named_apart(bounds: Sequence[BoundCampaign]) -> tuple[tuple[str, BoundCampaign], ...]:
    """Campaigns by a short name, which labels and parameters of their own carry; one has none.

    Args:
        bounds: campaigns, each bound to its FMU.
    """
    if len(bounds) == 1:
        return (("", bounds[0]),)
    named = []
    for name, bound in zip(series_names(bounds), bounds, strict=True):
        sweep, parameters = bound.sweep, []
        if sweep is not None and sweep.label:
            sweep = replace(sweep, label=f"{name}/{sweep.label}")
        for p in bound.parameters:
            if not is_shared(p):
                # offset[pair1] of the series a is offset[a/pair1], ln_scale is ln_scale[a]
                head, bracket, label = p.name.partition("[")
                labels = [f"{name}/{each}" for each in p.experiments]
                p = replace(
                    p,
                    name=f"{head}[{name}/{label}" if bracket else f"{p.name}[{name}]",
                    variable=p.target,
                    experiment=labels[0] if labels else None,
                    further=tuple(labels[1:]),
                )
            parameters.append(p)
        experiments = tuple(
            replace(e, label=f"{name}/{e.label}", output=e.output or bound.setup.output)
            for e in bound.experiments
        )
        apart = replace(bound, experiments=experiments, sweep=sweep, parameters=tuple(parameters))
        named.append((name, apart))
    return tuple(named)


def is_shared(parameter: Parameter) -> bool:
    """Whether campaigns that are fitted together share the parameter.

    Args:
        parameter: a fitted parameter.
    """
    return parameter.moves_model and not parameter.experiments


def series_names(bounds: Sequence[BoundCampaign]) -> tuple[str, ...]:
    """A short name for every campaign: its folder, or its file where folders are the same.

    Args:
        bounds: campaigns, each bound to its FMU.
    """
    folders = [bound.path.resolve().parent.name for bound in bounds]
    stems = [bound.path.stem for bound in bounds]
    for names in (folders, stems):
        if len(set(names)) == len(names):
            return tuple(names)
    return tuple(f"{name}{k}" for k, name in enumerate(folders, start=1))


#: Digits of all peaks of an experiment together from which equal ones are no coincidence: two
#: measurements of one setting, written with few digits, may well agree.
DIGITS = 8
#: Digits to which numbers are compared; more are lost between units.
COMPARED = 10
#: Binary digits, about as many.
BITS = 33


def refuse_repeats(bounds: Sequence[BoundCampaign]) -> None:
    """Refuse data that are listed twice, under whatever path or name.

    Compared is what was measured: spectra and sweeps point by point, ready peaks with their drive
    frequencies. Two campaigns may name one sweep if at most one of them fits it: the other takes
    its scale from there.

    Args:
        bounds: campaigns that are fitted together, or one.

    Raises:
        BadInput: names both.
    """
    known: dict[Hashable, list[tuple[str, Any]]] = {}
    for bound in bounds:
        for where, key, data in (*_curves(bound), *_rows(bound)):
            alike = known.setdefault(key, [])
            for other, its_data in alike:
                if _is_same(its_data, data):
                    raise BadInput(
                        f"{where}: are the data of {other} again; wanted every measurement once"
                    )
            alike.append((where, data))


#: Where data are, a key that is equal for equal ones, a curve or the settings of an experiment.
_Data = tuple[str, Hashable, Spectrum | Mapping[str, Scalar]]


def _curves(bound: BoundCampaign) -> Iterator[_Data]:
    """Spectra and the sweep, by a digest of their points, amplitudes in units of the largest."""
    named: list[tuple[str, Spectrum]] = [
        (f"{bound.path}: experiment '{e.label}' ({e.spectrum.source})", e.spectrum)
        for e in bound.experiments
        if e.spectrum is not None
    ]
    if bound.sweep is not None:
        source = bound.sweep.source
        file = f" ({source})" if source.is_file() else ""
        named.append((f"{bound.path}: sweep{file}", bound.sweep))
    for where, curve in named:
        relative = curve.amplitude_v / (np.max(curve.amplitude_v) or 1.0)
        mantissa, exponent = np.frexp(np.concatenate([curve.frequency_hz, relative]))
        rounded = np.round(np.ldexp(mantissa, BITS))
        key = hashlib.sha256(rounded.tobytes() + exponent.tobytes()).digest()
        yield where, key, curve


def _is_same(one: Any, two: Any) -> bool:
    """Whether data of one key are the same, and both are fitted.

    One measurement read in two units is; a linear sample driven at two levels is not, nor peaks at
    other settings.
    """
    if not isinstance(one, Spectrum):
        return all(one[name] == two[name] for name in one.keys() & two.keys())
    if any(isinstance(each, SweepData) and each.use != "fit" for each in (one, two)):
        return False
    tops = (float(np.max(each.amplitude_v)) for each in (one, two))
    files = one.source.is_file() and two.source.is_file()
    return math.isclose(*tops, rel_tol=10.0**-COMPARED) or (
        files and one.source.read_bytes() == two.source.read_bytes()
    )


def _rows(bound: BoundCampaign) -> Iterator[_Data]:
    """Experiments with ready peaks, by their numbers; the data are settings that do not drift."""
    moving = {*bound.drift.ends, *(name for p in bound.parameters for name in p.adds_to)}
    for e in bound.experiments:
        if e.spectrum is not None or not np.all(np.isfinite(e.peaks_v)):
            continue
        digits = 0
        for peak in e.peaks_v:
            # as few as it was written with: as peak, as rms, or in dBm at 50 ohm
            ways = (peak, peak / math.sqrt(2.0), 20.0 * math.log10(peak) + 10.0)
            mantissas = (f"{value:.{COMPARED - 1}e}".partition("e")[0] for value in ways)
            digits += min(len(m.strip("-0.").replace(".", "")) for m in mantissas)
        if digits >= DIGITS:
            numbers = (*e.tones_hz, *e.read_hz, *e.peaks_v.tolist())
            key = tuple(f"{value:.{COMPARED}g}" for value in numbers)
            settings = {name: value for name, value in e.settings.items() if name not in moving}
            yield f"{bound.path}: experiment '{e.label}'", key, settings
