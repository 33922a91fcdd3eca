"""One resonance in words: its numbers first, then what they rest on."""

from __future__ import annotations

import math
from dataclasses import replace

from fitting.inference.mistakes import fault_finding
from fitting.report.table import Column, Table, tabulate, terminal_text, text_lines, wrapped
from fitting.resonance.dip_reading import NOTCH, REFLECTION, DipReading
from fitting.resonance.form import (
    FANO,
    SLOPED,
    TRANSMISSION,
    WORDS_BESIDE,
    WORDS_BESIDE_COMPLEX,
)
from fitting.resonance.form_choice import AS_GOOD
from fitting.resonance.line import Line, LineForm
from fitting.signal.peaks import FLOOR, RICE, SINGLE, TAIL
from fitting.signal.residual_tests import TOLD, found_words
from fitting.text.notation import hertz, listed, number, percent, prefixed, quantity, with_error
from fitting.text.sentences import sentence

#: What each wiring is, in words.
WIRINGS = {
    TRANSMISSION: "the line alone",
    **{form: f"the line and {words}" for form, words in WORDS_BESIDE.items()},
    NOTCH: "a resonator beside a feed line",
    REFLECTION: "a resonator at the end of a line",
}
#: Share of the height of a second line by which another height is told beside it.
SECOND_DIFFERS = 0.05
#: Standard errors by which another form that is nearly as good moves the line to be told.
MOVES = 2.0


def text(line: Line) -> str:
    """All that the command tells of a line: numbers, sentences, the forms that were compared.

    Args:
        line: as it was fitted.
    """
    lines = [*map(terminal_text, answer(line))]
    for text in sentences(line):
        lines += wrapped(text)
    return "\n".join([*lines, *text_lines(forms_table(line))])


def answer(line: Line) -> list[str]:
    """Frequency, width, quality and amplitude, a line each.

    Args:
        line: as it was fitted.
    """
    factor, unit = prefixed(line.amplitude, "" if line.unit == "1" else line.unit)
    amplitude = with_error(line.amplitude / factor, line.amplitude_std / factor, unit)
    other = _other_amplitude(line)
    alone = "of the line alone, at f" + "; not determined which" * bool(other)
    return [
        f"f      {quantity(line.frequency_hz, line.frequency_std_hz, 'Hz')}",
        f"width  {quantity(line.width_hz, line.width_std_hz, 'Hz')}  (full, at half of the power)",
        f"Q      {with_error(line.q, line.q_std)}",
        f"A      {amplitude}{f' or {other}' * bool(other)}  ({alone})",
    ]


def sentences(line: Line) -> list[str]:
    """What the numbers rest on, and what speaks against them.

    Args:
        line: as it was fitted.
    """
    return [
        *line.said,
        _taken(line),
        *([] if math.isnan(line.delay_s) else [f"Delay of the cable: {_delay(line)}."]),
        *(_reading(line, reading) for reading in line.readings),
        *_beside(line),
        *_second(line),
        *_further(line),
        *_mirrored(line),
        *_dependence(line),
        *_rivals(line),
        *_widening(line),
        *(sentence(fault_finding(fault)) for fault in line.faults),
        *_instrument(line),
    ]


def _taken(line: Line) -> str:
    left = f"it leaves {number(100.0 * line.residual, 2)} % of the line (rms)"
    delay = ", and the delay of a cable" if line.forms[0].delayed else ""
    if line.asked:
        return f"Wiring as asked: {line.wiring}, {_wiring_words(line)}{delay}; {left}."
    name = f"{_name(line.forms[0])}, {_wiring_words(line)}{delay}"
    fitted = [form for form in line.forms if not math.isnan(form.criterion)]
    if len(fitted) < 2:
        return f"Taken: {name}; {left}."
    least = min(form.criterion for form in fitted)
    if line.forms[0].criterion > least and line.wiring == TAIL:
        best = "as another line is there, and not for Akaike's criterion"
    elif line.forms[0].criterion > least and _is_slope(least, line):
        best = (
            f"by Akaike's criterion the best of the {len(fitted)} forms that could be fitted, or "
            f"within {number(AS_GOOD, 1)} of it, but for one with a slope, which these points do "
            "not plainly show"
        )
    elif line.forms[0].criterion > least and (not line.is_complex or line.second is not None):
        best = (
            "the simplest of the forms that Akaike's criterion hardly tells from the best of the "
            f"{len(fitted)} that could be fitted (by {number(AS_GOOD, 1)} at most)"
        )
    elif line.forms[0].criterion > least:
        best = (
            f"by Akaike's criterion the best of the {len(fitted)} forms that could be fitted but "
            "for one with the delay of a cable, which these points do not plainly show"
        )
    else:
        best = f"by Akaike's criterion the best of the {len(fitted)} forms that could be fitted"
    return f"Taken: {name}, {best}; {left}."


def _is_slope(criterion: float, line: Line) -> bool:
    """Whether the form of amplitudes with a criterion has a slope."""
    sloped = (form for form in line.forms if form.name == SLOPED and form.criterion == criterion)
    return not line.is_complex and any(sloped)


def _wiring_words(line: Line) -> str:
    """What the wiring is, in words; beside complex values a slope is complex."""
    known = WORDS_BESIDE_COMPLEX if line.is_complex else WORDS_BESIDE
    if line.second is not None:
        beside = known.get(line.wiring)
        return f"the line, a second one and {beside}" if beside else "the line and a second one"
    return f"the line and {known[line.wiring]}" if line.wiring in known else WIRINGS[line.wiring]


def _beside(line: Line) -> list[str]:
    """How large the constant of amplitudes is, and what may make it."""
    if line.beside == 0.0:
        return []
    size = _sized(line.beside, line.unit)
    if line.wiring in (FLOOR, RICE):
        return [
            f"The noise beside the line is {size}, the root mean square of its own amplitude, the "
            "same at every frequency."
        ]
    if line.wiring == SINGLE:
        return [
            f"Noise of each reading: {size}, in X and in Y alike. The points scatter by it on the "
            "line, and beside the line by 0.66 of it about 1.25 times it (Rice)."
        ]
    if line.wiring == SLOPED:
        first, last = line.points.frequency_hz[0], line.points.frequency_hz[-1]
        whole = _sized(abs(line.beside_slope) * (last - first), line.unit)
        way = "rises" if line.beside_slope > 0.0 else "falls"
        return [
            f"The background is {size} at the line, and {way} by {whole} from the first point to "
            "the last: a zero of the detector that drifts, or what changes with frequency."
        ]
    return [f"The constant is {size}: a zero of the detector, or what a range of it leaves out."]


def _sized(value: float, of: str) -> str:
    """A value with its unit, or a power of ten times it where it takes no prefix."""
    factor, unit = (1.0, "") if of == "1" else prefixed(abs(value), of)
    times = "× " if unit.startswith("10") else ""
    return f"{number(value / factor, 3)} {times}{unit}".rstrip()


def _second(line: Line) -> list[str]:
    """A weaker line among the points."""
    if line.second is None:
        return []
    second = line.second
    size = f"{number(100.0 * second.share, 2)} %"
    if abs(second.mirrored - second.share) > SECOND_DIFFERS * second.share:
        size += f" (or {number(100.0 * second.mirrored, 2)} %: without phases both describe it)"
    return [
        f"There is another line near {hertz(second.frequency_hz, digits=6)}, "
        f"{hertz(second.width_hz, digits=2)} wide, of {size} of the first one's height: it was "
        "fitted beside the first, to which all numbers above belong. A campaign whose model has "
        "two modes fits both, as fmu-fit init drafts it."
    ]


def _further(line: Line) -> list[str]:
    """Lines that the points outside of the range show."""
    if not line.further_hz:
        return []
    seen = f"Points outside of the range show another line, near {_places(line.further_hz)}"
    if line.wiring == TAIL or line.is_complex:
        return [f"{seen}: its tail stands among these points, and is fitted with them."]
    return [f"{seen}: what its tail does among these points is not in this form."]


def _places(frequencies_hz: tuple[float, ...]) -> str:
    return listed(hertz(f, digits=6) for f in frequencies_hz)


def _other_amplitude(line: Line) -> str:
    """The amplitude that these points do not tell from the one that was taken; mostly empty."""
    if not abs(line.amplitude_mirrored - line.amplitude) > MOVES * line.amplitude_std:
        return ""
    factor, unit = prefixed(line.amplitude_mirrored, "" if line.unit == "1" else line.unit)
    error = line.amplitude_mirrored_std / factor
    return with_error(line.amplitude_mirrored / factor, error, unit)


def _mirrored(line: Line) -> list[str]:
    """What is said of the other amplitude, where it is another one."""
    other = _other_amplitude(line)
    if not other:
        return []
    if line.wiring == TAIL or line.second is not None:
        return [f"Without phases A may as well be {other}: both describe these points."]
    return [
        f"Without phases A may as well be {other}: both have the same curve, and the same f and "
        "width."
    ]


def _delay(line: Line) -> str:
    return quantity(line.delay_s, line.delay_std_s, "s")


def _reading(line: Line, reading: DipReading) -> str:
    kind = WIRINGS[reading.wiring]
    internal, coupling = (
        _quality(reading.q_internal, reading.q_internal_std, reading.q_internal_ci95),
        _quality(reading.q_coupling, reading.q_coupling_std, reading.q_coupling_ci95),
    )
    if not internal:
        return (
            f"As {kind} it would give out more power than it takes: it is no {reading.wiring}, or "
            "the phases are not those of the line."
        )
    own = "" if line.asked else f"If it is {kind} ({reading.wiring}): "
    return f"{own}Q internal {internal}, Q coupling {coupling or 'negative'}."


def _quality(value: float, error: float, ends: tuple[float, float]) -> str:
    """Value ± error; the lower end where the interval is open above; empty without either."""
    if math.isnan(ends[0]):
        return ""
    if math.isinf(ends[1]) or math.isnan(value):
        return f"at least {number(ends[0], 2)} (95 %)"
    return with_error(value, error)


def _dependence(line: Line) -> list[str]:
    """Forms that are nearly as good and move the line."""
    chosen = line.forms[0]
    said = []
    for form in line.forms[1:]:
        near = form.criterion - chosen.criterion < AS_GOOD
        moved = [
            f"{what} by {number(there - here, 2)} Hz"
            for what, there, here, std in (
                ("the line", form.frequency_hz, line.frequency_hz, chosen.frequency_std_hz),
                ("its width", form.width_hz, line.width_hz, chosen.width_std_hz),
            )
            if abs(there - here) > MOVES * std
        ]
        if near and moved:
            said.append(
                f"{form.name} describes the points as well and moves {listed(moved)}: the data do "
                "not tell which it is."
            )
    return said


def _rivals(line: Line) -> list[str]:
    """Forms for which the errors hold, too."""
    if not line.rivals or line.rivals_widening <= TOLD:
        return []
    return [
        f"The errors hold for {listed(line.rivals)}, too, which these points do not plainly tell "
        f"from {line.forms[0].name}: they are up to {number(line.rivals_widening, 2)} times as "
        "wide for it (those in the table are of each form alone)."
    ]


def _widening(line: Line) -> list[str]:
    if line.widening <= TOLD:
        return []
    points = len(line.points.frequency_hz)
    return [
        f"The residuals {found_words(line.structure_p, line.sizes_p)}: the {points} points count "
        f"as {number(line.independent_points, 2)} independent and equal ones, and the errors are "
        f"{number(line.widening, 2)} times as wide for it."
    ]


def _instrument(line: Line) -> list[str]:
    own = []
    if "frequency_hz" in line.instrument:
        there = line.instrument["frequency_hz"]
        apart = there - line.frequency_hz
        own.append(
            f"f = {number(there, 9)} Hz ({number(abs(apart), 2)} Hz "
            f"{'above' if apart > 0.0 else 'below'} this one)"
        )
    if "q" in line.instrument:
        there = line.instrument["q"]
        own.append(f"Q = {number(there, 6)} ({percent(there / line.q - 1.0)})")
    return [f"The instrument's own estimate: {listed(own)}."] if own else []


def forms_table(line: Line) -> Table:
    """Every form that was tried, with what it gives, the one that was taken first.

    Args:
        line: as it was fitted.
    """
    columns: tuple[Column[LineForm], ...] = (
        Column("form", lambda form: _row_name(line, form), role="name"),
        Column("f (Hz)", lambda form: _value(form.frequency_hz, form.frequency_std_hz)),
        Column("width (Hz)", lambda form: _value(form.width_hz, form.width_std_hz)),
        Column("Q", lambda form: _value(form.q, form.q_std)),
        Column("left (%)", lambda form: number(100.0 * form.residual, 2)),
        Column("Akaike", lambda form: number(round(form.criterion, 1), 4)),
    )
    return tabulate("Forms that were compared", columns, line.forms)


def _row_name(line: Line, form: LineForm) -> str:
    """A form as its row is called: a wiring that was asked for, with the form that is its curve."""
    if line.wiring in (NOTCH, REFLECTION) and form.name == FANO:
        return f"{_name(replace(form, name=line.wiring))} ({FANO})"
    return _name(form)


def _name(form: LineForm) -> str:
    beside = ", delay" * form.delayed + ", second line" * form.second
    return f"{form.name}{beside}"


def _value(value: float, error: float) -> str:
    return with_error(value, error) if math.isfinite(value) else "–"
