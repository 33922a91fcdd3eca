"""A design as one self-contained HTML file: what to measure next, and why."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from fitting.design.result import Design, Expected, PlacePoint, Proposal
from fitting.report.figures.file import FigureFile
from fitting.report.page import Page, Section, Status, write_page
from fitting.report.table import Cell, Column, Table, pairs_table, tabulate
from fitting.report.words.design import (
    candidates_sentence,
    driven_words,
    equal_fits_sentences,
    promise_sentence,
)
from fitting.text.notation import hertz, number, prefixed, with_unit

Figures = tuple[FigureFile, ...]


def write_report(design: Design, figures: Sequence[FigureFile], folder: Path) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    Args:
        design: the proposed next measurement.
        figures: figure files that are shown.
        folder: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    return write_page(page_of(design, figures), folder)


def page_of(design: Design, figures: Sequence[FigureFile]) -> Page:
    """The report as a page.

    Args:
        design: the proposed next measurement.
        figures: figure files that are shown.
    """
    steps = tuple(figure for figure in figures if figure.kind == "design_steps")
    others = tuple(figure for figure in figures if figure.kind != "design_steps")
    return Page(
        title=f"Next measurement: {design.title}",
        kind="next measurement",
        status=Status(
            f"{len(design.proposals)} measurements proposed", promise_sentence(design), good=True
        ),
        sections=(
            _proposed(design, steps),
            Section(
                id="candidates",
                title="What else could be measured",
                paragraphs=(candidates_sentence(design),),
                figures=others,
            ),
            Section(
                id="points",
                title="Points that fit as well",
                paragraphs=equal_fits_sentences(design),
                tables=(places_table(design),),
            ),
            Section(
                id="limits",
                title="Limits that were kept to",
                tables=(
                    pairs_table("Limits of the instrument", ("limit", "value"), design.limits),
                ),
            ),
            Section(
                id="origin",
                title="Where this comes from",
                tables=(
                    pairs_table(
                        "Provenance",
                        ("what", "value"),
                        {"campaign": design.campaign, **design.provenance},
                    ),
                ),
            ),
        ),
        synthetic=design.synthetic,
    )


def _proposed(design: Design, figures: Figures) -> Section:
    said = (
        "A campaign with these settings lies in the folder campaign: its peaks are to be filled "
        "in. What drifts is to be measured anew before and after, and the tones are to keep their "
        "distance from the resonance."
    )
    if design.is_of_sweeps:
        said = (
            "A campaign with these settings lies in the folder campaign: what is measured in "
            "every sweep is to be filled in, a row for each frequency."
        )
    if design.is_of_traces:
        said = (
            "A campaign with these settings lies in the folder campaign: each recording is to be "
            "put in the place of its file."
        )
    return Section(
        id="proposed",
        title="What to measure next",
        paragraphs=(said,),
        points=design.sentences,
        tables=(proposal_table(design),),
        figures=figures,
    )


def proposal_table(design: Design) -> Table:
    """A row per proposed measurement, under one for the data so far.

    Args:
        design: the proposed next measurement.
    """
    smallest = min((min(p.peaks_v) for p in design.proposals), default=1.0)
    volts, volt = prefixed(smallest, design.amplitude_unit)
    factor, unit = prefixed(design.before.mean, design.unit)
    sigma = with_unit(f"σ({design.target})", unit)
    driven: tuple[Column[Proposal | None], ...] = (
        _of("from, to" if design.is_of_sweeps else "tones", lambda p: hertz(*p.tones_hz)),
        _of("around", _around, role="words"),
        _of("drive level", _level),
        _of("spectra", lambda p: p.repeats),
    )
    if design.is_of_traces:
        driven = (
            _of("as", lambda p: (p.recording and p.recording.trace) or "the trace"),
            _of("recording", driven_words, role="words"),
        )
    columns: tuple[Column[Proposal | None], ...] = (
        Column("", lambda p: "so far" if p is None else str(p.rank), role="name"),
        _of("observed", lambda p: p.output),
        *driven,
        _of(with_unit("peaks", volt), lambda p: ", ".join(number(a / volts, 3) for a in p.peaks_v)),
        Column(f"{sigma} here", lambda p: _sigma(_expected(p, design).at, factor)),
        Column("average", lambda p: _sigma(_expected(p, design).mean, factor)),
        Column("worst", lambda p: _sigma(_expected(p, design).worst, factor)),
    )
    return tabulate(
        "Proposed measurements, in the order of their use",
        columns,
        (None, *design.proposals),
        f"σ({design.target}) is that after the measurement and all before it: at the given "
        "point, on average (geometric) and at worst over points that fit the data as well. "
        + _units_words(design),
    )


def _units_words(design: Design) -> str:
    if design.is_of_traces:
        return "Peaks are the largest values, at the given point."
    return "Drive level in units of the campaign's; peaks at the given point."


def _of(
    name: str, of: Callable[[Proposal], float | str], role: str = ""
) -> Column[Proposal | None]:
    """A column of proposals, a dash for the data so far."""
    return Column(name, lambda p: "–" if p is None else of(p), role=role)


def _around(p: Proposal) -> str:
    if p.points:
        return f"{driven_words(p)} around {hertz(p.centre_hz, digits=7)}"
    offsets = " and ".join(f"{f - p.centre_hz:+.4g} Hz" for f in p.tones_hz)
    return f"{offsets} from {hertz(p.centre_hz, digits=7)}"


def _level(p: Proposal) -> str:
    settings = "".join(f", {name} = {value}" for name, value in p.settings.items())
    return f"{p.level:g}{settings}"


def _expected(p: Proposal | None, design: Design) -> Expected:
    return design.before if p is None else p.expected


def _sigma(exact: float, factor: float) -> Cell:
    """A standard deviation in the unit of the head, its exact value in the target's."""
    return Cell("–") if math.isnan(exact) else Cell(number(exact / factor, 3), value=exact)


def places_table(design: Design) -> Table:
    """The points at which the design was judged.

    Args:
        design: the proposed next measurement.
    """
    size = design.before.mean
    sigma = f"σ({design.target})"
    columns: list[Column[tuple[int, PlacePoint]]] = [
        Column("point", lambda row: "given" if row[0] == 0 else str(row[0]), role="name")
    ]
    if len({tuple(place.alternative.items()) for place in design.places}) > 1:
        columns.append(Column("alternative", lambda row: _alternative(row[1])))
    columns += [Column(name, _value(name), digits=6) for name in design.places[0].parameters]
    columns += [
        Column(design.target, lambda row: row[1].target, digits=3),
        Column(
            f"{sigma} so far", lambda row: row[1].sigmas[0], unit=design.unit, digits=3, size=size
        ),
        Column(
            f"{sigma} then", lambda row: row[1].sigmas[-1], unit=design.unit, digits=3, size=size
        ),
    ]
    return tabulate("Points at which the design was judged", columns, enumerate(design.places))


def _alternative(place: PlacePoint) -> str:
    return ", ".join(f"{name} = {str(v).lower()}" for name, v in place.alternative.items())


def _value(name: str) -> Callable[[tuple[int, PlacePoint]], float]:
    return lambda row: row[1].parameters[name]
