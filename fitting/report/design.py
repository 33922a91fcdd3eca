"""A design as one self-contained HTML file: what to measure next, and why."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from fitting.design.result import Design, Expected
from fitting.report.figures.style import FigureFile
from fitting.report.page import NAME, page
from fitting.report.sections import Section
from fitting.report.tables import Cell, Table
from fitting.text.files import write_whole
from fitting.text.notation import hertz, number, plain, prefixed, span


def write_report(design: Design, figures: Sequence[FigureFile], folder: Path) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    Raises:
        BadInput: the folder cannot be written.
    """
    path = folder / NAME
    write_whole(path, render(design, figures))
    return path


def render(design: Design, figures: Sequence[FigureFile]) -> str:
    """The report as HTML text."""
    shelf = {figure.name: figure for figure in figures}
    steps = tuple(f for name, f in shelf.items() if name.startswith("1_"))
    others = tuple(f for name, f in shelf.items() if not name.startswith("1_"))
    sections = [_proposed(design, steps), _candidates(design, others), _places(design)]
    sections += [_limits(design), _origin(design)]
    improvement = f"{number(design.improvement, 3)} times smaller on average"
    return page(
        f"Next measurement: {design.title}",
        "next measurement",
        sections,
        synthetic=design.synthetic,
        good=True,
        status=(
            f"{len(design.proposals)} measurements proposed",
            f"With them the standard deviation of {plain(design.target)} is expected to be "
            f"{improvement}.",
        ),
        warnings=(),
    )


def _sigmas(expected: Expected, factor: float) -> tuple[Cell, ...]:
    return tuple(_cell(v / factor, v) for v in (expected.at, expected.mean, expected.worst))


def _cell(shown: float, exact: float) -> Cell:
    return Cell("–") if math.isnan(exact) else Cell(number(shown, 3), exact)


def _heads(*texts: str) -> tuple[Cell, ...]:
    return tuple(Cell(text) for text in texts)


def _proposed(design: Design, figures: tuple[FigureFile, ...]) -> Section:
    factor, unit = prefixed(design.before.mean, design.unit)
    smallest = min((min(p.peaks_v) for p in design.proposals), default=1.0)
    volts, volt = prefixed(smallest, design.amplitude_unit)
    blank = [Cell("–")] * 6
    rows = [(Cell("so far", head=True), *blank, *_sigmas(design.before, factor))]
    for p in design.proposals:
        offsets = " and ".join(f"{f - p.centre_hz:+.4g} Hz" for f in p.tones_hz)
        settings = "".join(f", {name} = {value}" for name, value in p.settings.items())
        rows.append(
            (
                Cell(str(p.rank), head=True),
                Cell(p.output),
                Cell(hertz(*p.tones_hz)),
                Cell(f"{offsets} from {hertz(p.centre_hz, digits=7)}", mark="words"),
                Cell(f"{p.level:g}{settings}"),
                Cell(str(p.repeats), float(p.repeats)),
                Cell(", ".join(number(a / volts, 3) for a in p.peaks_v)),
                *_sigmas(p.expected, factor),
            )
        )
    sigma = f"σ({plain(design.target)}) ({unit})"
    heads = _heads(
        "",
        "observed",
        "tones",
        "around",
        "drive level",
        "spectra",
        f"peaks ({volt})",
        f"{sigma} here",
        "average",
        "worst",
    )
    table = Table(
        "Proposed measurements, in the order of their use",
        heads,
        tuple(rows),
        f"σ({plain(design.target)}) is that after the measurement and all before it: at the given "
        "point, on average (geometric) and at worst over points that fit the data as well. Drive "
        "level in units of the campaign's; peaks at the given point.",
    )
    said = (
        "A campaign with these settings lies in the folder campaign: its peaks are to be filled "
        "in. What drifts is to be measured anew before and after, and the tones are to keep their "
        "distance from the resonance.",
    )
    return Section("proposed", "What to measure next", said, design.sentences, (table,), figures)


def _candidates(design: Design, figures: tuple[FigureFile, ...]) -> Section:
    said = (
        f"{design.candidates} candidates ({design.setups} settings of drive and output, and "
        f"numbers of spectra; those whose peaks could not be seen or would overload the detector "
        f"left out), chosen by criterion {design.criterion}, greedy with exchanges."
    )
    return Section("candidates", "What else could be measured", (said,), figures=figures)


def _places(design: Design) -> Section:
    factor, unit = prefixed(design.before.mean, design.unit)
    names = list(design.places[0].parameters)
    several = len({tuple(p.alternative.items()) for p in design.places}) > 1
    rows = []
    for k, place in enumerate(design.places):
        other = ", ".join(f"{name} = {str(v).lower()}" for name, v in place.alternative.items())
        before, after = place.sigmas[0], place.sigmas[-1]
        rows.append(
            (
                Cell("given" if k == 0 else str(k), head=True),
                *((Cell(other),) if several else ()),
                *(Cell(number(v, 6), v) for v in place.parameters.values()),
                _cell(place.target, place.target),
                _cell(before / factor, before),
                _cell(after / factor, after),
            )
        )
    sigma = f"σ({plain(design.target)})"
    heads = _heads(
        "point",
        *(("alternative",) if several else ()),
        *map(plain, names),
        plain(design.target),
        f"{sigma} so far ({unit})",
        f"{sigma} then ({unit})",
    )
    said = [f"The data so far are fitted as well at {design.equal_fits} points that were found."]
    if all(map(math.isfinite, design.span)):
        low, high = design.span
        size, shown = prefixed(max(abs(low), abs(high)), design.unit)
        said.append(
            f"Over them {plain(design.target)} goes from {span(low / size, high / size, shown)}."
        )
    table = Table("Points at which the design was judged", heads, tuple(rows))
    return Section("points", "Points that fit as well", tuple(said), tables=(table,))


def _limits(design: Design) -> Section:
    rows = tuple((Cell(key, head=True), Cell(text)) for key, text in design.limits.items())
    table = Table("Limits of the instrument", _heads("limit", "value"), rows)
    return Section("limits", "Limits that were kept to", tables=(table,))


def _origin(design: Design) -> Section:
    everything = {"campaign": design.campaign, **design.provenance}
    rows = tuple((Cell(key, head=True), Cell(text)) for key, text in everything.items())
    return Section(
        "origin",
        "Where this comes from",
        tables=(Table("Provenance", _heads("what", "value"), rows),),
    )
