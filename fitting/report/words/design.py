"""What a design promises, in words."""

from __future__ import annotations

import math

from fitting.design.result import Design, Expected, Proposal, Recording
from fitting.design.ways import Way, Ways
from fitting.text.notation import hertz, how_many, number, prefixed, span, with_unit


def promise_sentence(design: Design) -> str:
    """How much better the target will be known.

    Args:
        design: the proposed next measurement.
    """
    return (
        f"With them the standard deviation of {design.target} is expected to be "
        f"{number(design.improvement, 3)} times smaller on average."
    )


def candidates_sentence(design: Design) -> str:
    """What was chosen from, and how.

    Args:
        design: the proposed next measurement.
    """
    if design.is_of_sweeps:
        return (
            f"{design.candidates} candidates ({design.setups} places of the controls; sweeps whose "
            "top could not be seen or would overload the detector left out), each measured once at "
            f"most, chosen by criterion {design.criterion}, greedy with exchanges."
        )
    if design.is_of_traces:
        return (
            f"{design.candidates} candidates (of {design.setups} traces, spacings and lengths; "
            "decays of less than a period left out, and recordings whose largest value could not "
            f"be seen or would overload the detector), chosen by criterion {design.criterion}, "
            "greedy with exchanges."
        )
    return (
        f"{design.candidates} candidates ({design.setups} settings of drive and output, and "
        "numbers of spectra; those whose peaks could not be seen or would overload the detector "
        f"left out), chosen by criterion {design.criterion}, greedy with exchanges."
    )


def equal_fits_sentences(design: Design) -> tuple[str, ...]:
    """At how many points the data are fitted as well, and how far the target goes over them.

    Args:
        design: the proposed next measurement.
    """
    said = [f"The data so far are fitted as well at {design.equal_fits} points that were found."]
    if all(map(math.isfinite, design.span)):
        low, high = design.span
        size, shown = prefixed(max(abs(low), abs(high)), design.unit)
        said.append(f"Over them {design.target} goes from {span(low / size, high / size, shown)}.")
    return tuple(said)


def driven_words(proposal: Proposal) -> str:
    """Where a measurement is driven: tones by their distance from the resonance, a sweep, a trace.

    Args:
        proposal: one proposed measurement.
    """
    if proposal.points:
        first, last = proposal.tones_hz
        return f"{proposal.points} points over {hertz(last - first)}"
    if proposal.recording is not None:
        return recorded_words(proposal.recording)
    return ", ".join(f"{f - proposal.centre_hz:+.4g}" for f in proposal.tones_hz) + " Hz"


def recorded_words(recording: Recording) -> str:
    """How a recording is made.

    Args:
        recording: that is proposed.
    """
    length, every = (_seconds(s) for s in (recording.length_s, recording.spacing_s))
    return f"{length}, {recording.samples} samples every {every}"


def _seconds(value: float) -> str:
    factor, unit = prefixed(value, "s")
    return f"{number(value / factor, 6)} {unit}"


def design_lines(design: Design) -> list[str]:
    """The design as lines of text.

    Args:
        design: the proposed next measurement.
    """
    marked = design.synthetic and "synthetic" not in design.title.lower()
    factor, unit = prefixed(design.before.mean, design.unit)

    def shown(value: float) -> str:
        return "-" if math.isnan(value) else number(value / factor, 3)

    lines = [design.title + (" [synthetic]" if marked else ""), ""]
    lines.append(
        f"expected standard deviation of {with_unit(design.target, unit)}: at the point given, on "
        "(geometric) average and at worst over points that fit as well"
    )
    lines.append(f"{'':52} {'here':>8} {'mean':>8} {'worst':>8}")
    before = design.before
    lines.append(
        f"{'so far':52} {shown(before.at):>8} {shown(before.mean):>8} {shown(before.worst):>8}"
    )
    for p in design.proposals:
        level = f" x{p.level:g}" if p.level != 1.0 else ""
        more = "".join(f" {name}={value}" for name, value in p.settings.items())
        driven = f"at {hertz(p.centre_hz, digits=6)} ({driven_words(p)})"
        if p.recording is not None:
            like = f"as {p.recording.trace}, " if p.recording.trace else ""
            driven = f"{like}{driven_words(p)}"
        what = f"{p.rank} {p.output} {driven}{level}{more}"
        what += f" avg {p.repeats}" if p.repeats > 1 else ""
        e = p.expected
        lines.append(f"{what:52} {shown(e.at):>8} {shown(e.mean):>8} {shown(e.worst):>8}")
    lines += [
        "",
        f"{design.improvement:.3g} times better on that average; {design.candidates} "
        f"candidates, criterion {design.criterion}",
    ]
    lines += [f"note: {text}" for text in design.sentences]
    return lines


def ways_lines(ways: Ways) -> list[str]:
    """Ways to spend the same time as lines of text, the least expected error first.

    Args:
        ways: of one campaign.
    """
    marked = ways.synthetic and "synthetic" not in ways.title.lower()
    factor, unit = prefixed(ways.before.mean, ways.unit)

    def row(what: str, takes: str, expected: Expected) -> str:
        values = (expected.at, expected.mean, expected.worst)
        cells = ("-" if math.isnan(v) else number(v / factor, 3) for v in values)
        return f"{what:44} {takes:>8} " + " ".join(f"{cell:>8}" for cell in cells)

    return [
        ways.title + (" [synthetic]" if marked else ""),
        "",
        f"with {ways.time_s:g} s of the laboratory: expected standard deviation of "
        f"{with_unit(ways.target, unit)}, at the point given, on (geometric) average and at worst "
        "over points that fit as well",
        f"{'':44} {'takes':>8} {'here':>8} {'mean':>8} {'worst':>8}",
        row("so far", "", ways.before),
        *(row(_way_words(way), f"{number(way.takes_s, 4)} s", way.expected) for way in ways.ways),
        "",
        best_way_sentence(ways),
        *(f"note: {text}" for text in ways.sentences),
    ]


def _way_words(way: Way) -> str:
    if len(way.counts) == 1:
        [count] = way.counts.values()
        return f"{way.name}, {how_many(count, 'measurement')}"
    return f"{way.name}, " + " and ".join(
        f"{count} of {kind}" for kind, count in way.counts.items()
    )


def best_way_sentence(ways: Ways) -> str:
    """Which way is expected to tell the target best.

    Args:
        ways: of one campaign.
    """
    best, *others = ways.ways
    ratio = others[0].expected.mean / best.expected.mean
    if not ratio > 1.0 + 1e-3:
        return f'"{best.name}" and "{others[0].name}" are expected to tell {ways.target} alike.'
    return (
        f'"{best.name}" is expected to tell {ways.target} best: its error is {number(ratio, 3)} '
        f'times smaller than with "{others[0].name}", on average.'
    )
