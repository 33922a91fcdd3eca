"""One resonance as `fmu-fit line` prints it: its numbers first, then what they rest on.

Sentences are those of the template `resonance.txt.j2`; what several of them need is decided here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from fitting.inference.mistakes import fault_finding
from fitting.report.table import (
    Column,
    Table,
    environment,
    tabulate,
    terminal_text,
    wrapped,
)
from fitting.resonance.decay_record import AMPLITUDES, PHASORS
from fitting.resonance.dip_reading import NOTCH, REFLECTION
from fitting.resonance.form import (
    FANO,
    SLOPED,
    TRANSMISSION,
    WORDS_BESIDE,
    WORDS_BESIDE_COMPLEX,
)
from fitting.resonance.form_choice import AS_GOOD
from fitting.resonance.line import Line, LineForm
from fitting.resonance.noise_line import NoiseLine
from fitting.resonance.ringdown import ALONE, FORM_WORDS, MOVING, NOISE, DecayForm, Ringdown
from fitting.signal.noise_lines import COUPLED, TOGETHER
from fitting.signal.peaks import TAIL
from fitting.signal.residual_tests import TOGETHER as CORRELATED
from fitting.signal.residual_tests import TOLD, found_words
from fitting.text.notation import hertz, number, percent, prefixed, with_error
from fitting.text.once import made_once
from fitting.text.rendering import with_prefix
from fitting.text.sentences import sentence

Resonance = Line | Ringdown | NoiseLine
#: What each wiring is, in words.
WIRINGS = {
    TRANSMISSION: "the line alone",
    **{form: f"the line and {words}" for form, words in WORDS_BESIDE.items()},
    NOTCH: "a resonator next to a feed line",
    REFLECTION: "a resonator at the end of a line",
}
#: What was recorded of a ringdown.
RECORDED = {PHASORS: "X and Y of a demodulator", AMPLITUDES: "amplitudes"}
#: How two modes of a noise spectrum are driven.
MOVED = {
    TOGETHER: "modes which one force drives",
    COUPLED: "two coupled modes in thermal motion, of which one is observed",
}
#: Share of the height of a second line by which another height is printed, too.
SECOND_DIFFERS = 0.05
#: Standard errors by which another form that is nearly as good moves the line to be printed.
MOVES = 2.0


def answer(found: Resonance) -> list[str]:
    """Frequency, width, quality and amplitude, a line each, as far as they are known.

    Args:
        found: as it was fitted.
    """
    return _rendered(found, "answer")


def sentences(found: Resonance) -> list[str]:
    """What the numbers rest on, and what contradicts them, an entry for each fact.

    Args:
        found: as it was fitted.
    """
    return _rendered(found, "sentences")


def forms_table(found: Resonance) -> Table | None:
    """Every form that was compared, the one that was taken first; None of a noise spectrum.

    Args:
        found: as it was fitted.
    """
    if isinstance(found, NoiseLine):
        return None
    first = (form for form in found.forms if math.isfinite(getattr(form, "frequency_hz", math.nan)))
    columns: list[Column[Any]] = [Column("form", lambda form: _row_name(found, form), role="name")]
    if isinstance(found, Line) or any(first):
        columns.append(Column("f (Hz)", lambda f: _value(f.frequency_hz, f.frequency_std_hz)))
    elif found.kind == PHASORS:
        columns.append(Column("offset (Hz)", lambda f: _value(f.offset_hz, f.offset_std_hz)))
    columns.append(Column("FWHM (Hz)", lambda form: _value(form.width_hz, form.width_std_hz)))
    if isinstance(found, Line) or any(math.isfinite(form.q) for form in found.forms):
        columns.append(Column("Q", lambda form: _value(form.q, form.q_std)))
    columns += [
        Column("residual (%)", lambda form: number(100.0 * form.residual, 2)),
        Column("AIC", lambda form: number(round(form.criterion, 1), 4)),
    ]
    return tabulate("Forms that were compared", columns, found.forms)


def text(found: Resonance) -> str:
    """What the command prints: numbers and sentences; `forms_table` has the forms compared.

    Args:
        found: as it was fitted.
    """
    lines = [*map(terminal_text, answer(found))]
    for entry in sentences(found):
        lines += wrapped(entry)
    return "\n".join(lines)


def _rendered(found: Resonance, part: str) -> list[str]:
    """The lines of a part of the template."""
    kind, decided = "line", _of_line(found) if isinstance(found, Line) else {}
    if isinstance(found, Ringdown):
        kind, decided = "ringdown", _of_ringdown(found)
    elif isinstance(found, NoiseLine):
        kind, decided = "noise", {"moved": MOVED.get(found.kind, "")}
    block = getattr(_blocks(), f"{kind}_{part}")
    return [line for line in str(block(found, decided)).splitlines() if line]


@made_once
def _blocks() -> Any:
    """The template's blocks, compiled once."""
    templates = environment(escaped=False)
    templates.globals.update(told=TOLD, **{f.__name__: f for f in FILTERS})
    return templates.get_template("resonance.txt.j2").module


# --- what sentences need -------------------------------------------------------------------------


def _of_line(line: Line) -> dict[str, Any]:
    second = line.second
    return {
        "model": _model(line),
        "choice": _choice(line),
        "wirings": WIRINGS,
        "other": _other_amplitude(line),
        "second_differs": second is not None
        and abs(second.mirrored - second.share) > SECOND_DIFFERS * second.share,
        "further": [hertz(f, digits=6) for f in line.further_hz],
        "moving": _moving(line),
        "rivals": bool(line.rivals) and line.rivals_widening > TOLD,
        "faults": [sentence(fault_finding(fault)) for fault in line.faults],
        "instrument": _instrument(line),
    }


def _of_ringdown(found: Ringdown) -> dict[str, Any]:
    return {
        "kind": RECORDED.get(found.kind, "samples of a motion"),
        "forms": FORM_WORDS,
        "phasors": PHASORS,
        "amplitudes": AMPLITUDES,
        "alone": ALONE,
        "noise": NOISE,
        "moving": MOVING,
        "correlated": CORRELATED in found_words(found.structure_p, found.sizes_p),
    }


def _model(line: Line) -> str:
    """The form that was taken, with what it has besides the line; a complex slope is complex."""
    known = WORDS_BESIDE_COMPLEX if line.is_complex else WORDS_BESIDE
    beside = known.get(line.wiring)
    words = f"the line and {beside}" if beside else WIRINGS[line.wiring]
    if line.second is not None:
        words = f"the line, a second one and {beside}" if beside else "the line and a second one"
    delay = ", and the delay of a cable" if line.forms[0].delayed else ""
    return f"{line.wiring if line.asked else _name(line.forms[0])}, {words}{delay}"


def _choice(line: Line) -> str:
    """Why this form was taken; empty where it is the only one, or was requested."""
    fitted = [form for form in line.forms if not math.isnan(form.criterion)]
    if line.asked or len(fitted) < 2:
        return ""
    chosen, best = line.forms[0].criterion, min(fitted, key=lambda form: form.criterion)
    lowest, near = f"lowest AIC of {len(fitted)} forms", number(AS_GOOD, 1)
    if not chosen > best.criterion:
        rest = sorted(form.criterion for form in fitted)
        return f"{lowest}, ΔAIC {number(rest[1] - rest[0], 2)}"
    if line.wiring == TAIL:
        return "not the lowest AIC, but the file has another line"
    if best.name == SLOPED and not line.is_complex:
        return f"{lowest}, or within {near} of it, except with a slope, which is not significant"
    if not line.is_complex or line.second is not None:
        return f"the simplest within ΔAIC {near} of the {lowest}"
    return f"{lowest} except with a cable delay, which is not significant"


def _other_amplitude(line: Line) -> str:
    """The amplitude that these points do not distinguish from the one printed; mostly empty."""
    if not abs(line.amplitude_mirrored - line.amplitude) > MOVES * line.amplitude_std:
        return ""
    return scaled(line.amplitude_mirrored, line.amplitude_mirrored_std, line.unit)


def _moving(line: Line) -> list[tuple[str, list[str]]]:
    """Forms that are nearly as good and move the line, and by how much."""
    chosen, found = line.forms[0], []
    for form in line.forms[1:]:
        moved = [
            f"{what} by {number(there - here, 2)} Hz"
            for what, there, here, std in (
                ("the line", form.frequency_hz, line.frequency_hz, chosen.frequency_std_hz),
                ("its FWHM", form.width_hz, line.width_hz, chosen.width_std_hz),
            )
            if abs(there - here) > MOVES * std
        ]
        if moved and form.criterion - chosen.criterion < AS_GOOD:
            found.append((form.name, moved))
    return found


def _instrument(line: Line) -> list[str]:
    own = []
    if "frequency_hz" in line.instrument:
        there = line.instrument["frequency_hz"]
        apart = there - line.frequency_hz
        way = "above" if apart > 0.0 else "below"
        own.append(f"f = {number(there, 9)} Hz ({number(abs(apart), 2)} Hz {way} this one)")
    if "q" in line.instrument:
        there = line.instrument["q"]
        own.append(f"Q = {number(there, 6)} ({percent(there / line.q - 1.0)})")
    return own


def _row_name(found: Line | Ringdown, form: LineForm | DecayForm) -> str:
    """A form as its row is called: a requested wiring with the form that is its curve."""
    if isinstance(form, DecayForm) or isinstance(found, Ringdown):
        return form.name
    if found.wiring in (NOTCH, REFLECTION) and form.name == FANO:
        return f"{_name(replace(form, name=found.wiring))} ({FANO})"
    return _name(form)


def _name(form: LineForm) -> str:
    return f"{form.name}{', delay' * form.delayed}{', second line' * form.second}"


# --- numbers -------------------------------------------------------------------------------------


def scaled(value: float, error: float, unit: str) -> str:
    """A value with its error, under the prefix that suits it.

    Args:
        value: in the unit.
        error: of the value.
        unit: of both; "1": none.
    """
    factor, shown = prefixed(value, "" if unit == "1" else unit)
    return with_error(value / factor, error / factor, shown)


def size_of(value: float, error: float, unit: str) -> str:
    """A value with its error, or alone where it has none, under the prefix of the larger.

    Args:
        value: in the unit.
        error: of the value; zero: it has none.
        unit: of both; "1": none.
    """
    if error == 0.0:
        return with_prefix(value, unit)
    factor, shown = prefixed(max(abs(value), error), "" if unit == "1" else unit)
    return with_error(value / factor, error / factor, shown)


FILTERS: tuple[Callable[..., str], ...] = (found_words, scaled, size_of)


def _value(value: float, error: float) -> str:
    return with_error(value, error) if math.isfinite(value) else "–"
