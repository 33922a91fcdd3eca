"""One resonance as `fmu-fit line` prints it: its numbers first, then what they rest on.

Sentences are those of the template `resonance.txt.j2`; what several of them need is decided here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from fitting.lines.choice import FAR_MORE, SIMPLER
from fitting.lines.dip import NOTCH, REFLECTION
from fitting.lines.faults import fault_finding
from fitting.lines.line import Line
from fitting.lines.names import FANO, SQUARED, TRANSMISSION, WORDS, WORDS_COMPLEX
from fitting.lines.noise_spectrum import COUPLED, TOGETHER, NoiseLine
from fitting.lines.record import MeasuredLine, TriedForm
from fitting.lines.ringdown import ALONE, FORM_WORDS, Ringdown
from fitting.lines.trace import AMPLITUDES, PHASORS
from fitting.report.table import Table, environment, table, terminal_text, text_lines, wrapped
from fitting.signal.residual_tests import NOTABLE
from fitting.signal.residual_tests import TOGETHER as CORRELATED
from fitting.text.estimate import Estimate
from fitting.text.notation import prefixed, quantity, with_error, with_prefix
from fitting.text.once import made_once
from fitting.text.rendering import sentence

#: What each wiring is, in words.
WIRINGS = {
    TRANSMISSION: "the line alone",
    **{form: f"the line and {words}" for form, words in WORDS.items()},
    SQUARED[0]: "the square of the line: the column looks like a power",
    SQUARED[1]: "the square of the line and a constant: the column looks like a power",
    "duffing": "a line whose frequency follows its amplitude (Duffing)",
    NOTCH: "a resonator next to a feed line",
    REFLECTION: "a resonator at the end of a line",
}
#: Share of the height of a second line by which another height is printed, too.
SECOND_DIFFERS = 0.05
#: Standard errors by which another form that is nearly as good moves the line to be printed.
MOVES = 2.0


def answer(result: MeasuredLine) -> list[str]:
    """Frequency, width, quality and amplitude, a line each, as far as they are known.

    Args:
        result: as it was fitted.
    """
    return _rendered(result, "answer")


def sentences(result: MeasuredLine) -> list[str]:
    """What the numbers rest on, and what contradicts them, an entry for each fact.

    Args:
        result: as it was fitted.
    """
    return _rendered(result, "sentences")


def forms_table(result: MeasuredLine) -> Table | None:
    """Every form that was compared, the one that was taken first; None of a noise spectrum.

    Args:
        result: as it was fitted.
    """
    if not result.forms:
        return None
    return table("forms", forms=[(_row_name(result, form), form) for form in result.forms])


def text(result: MeasuredLine) -> str:
    """What the command prints: numbers and sentences; `forms_table` has the forms compared.

    Args:
        result: as it was fitted.
    """
    lines = [*map(terminal_text, answer(result))]
    for entry in sentences(result):
        lines += wrapped(entry)
    return "\n".join(lines)


def report(result: MeasuredLine) -> str:
    """What the command prints with ``--verbose``: the text, and the forms compared.

    Args:
        result: as it was fitted.
    """
    forms = forms_table(result)
    return "\n".join([text(result), *([] if forms is None else text_lines(forms))])


def _rendered(result: MeasuredLine, part: str) -> list[str]:
    """The lines of a part of the template."""
    kind, decided = "line", _of_line(result) if isinstance(result, Line) else {}
    if isinstance(result, Ringdown):
        kind, decided = "ringdown", _of_ringdown(result)
    elif isinstance(result, NoiseLine):
        kind, decided = "noise", {"together": TOGETHER, "coupled": COUPLED}
    block = getattr(_blocks(), f"{kind}_{part}")
    return [line for line in str(block(result, decided)).splitlines() if line]


@made_once
def _blocks() -> Any:
    """The template's blocks, compiled once."""
    templates = environment(escaped=False)
    templates.globals.update(notable=NOTABLE, **{f.__name__: f for f in FILTERS})
    return templates.get_template("resonance.txt.j2").module


# --- what sentences need -------------------------------------------------------------------------


def _of_line(line: Line) -> dict[str, Any]:
    second = line.second
    return {
        "name": _name(line.forms[0]),
        # a complex slope is complex
        "besides": (WORDS_COMPLEX if line.is_complex else WORDS).get(line.wiring),
        "choice": _choice(line),
        "wirings": WIRINGS,
        "other": _other_amplitude(line),
        "second_differs": second is not None
        and abs(second.mirrored - second.share) > SECOND_DIFFERS * second.share,
        "moving": _moving(line),
        "rivals": bool(line.rivals) and line.rivals_widening > NOTABLE,
        "faults": [sentence(fault_finding(fault)) for fault in line.faults],
    }


def _of_ringdown(result: Ringdown) -> dict[str, Any]:
    return {
        "forms": FORM_WORDS,
        "phasors": PHASORS,
        "amplitudes": AMPLITUDES,
        "alone": ALONE,
        # amplitudes without a constant have the noise of X and Y, which has no error
        "in_noise": result.kind == AMPLITUDES and result.background_std == 0.0,
        "correlated": CORRELATED in result.structure.deviations,
    }


def _choice(line: Line) -> dict[str, Any]:
    """Why this form was taken; empty where it is the only one, or was requested."""
    fitted = [form for form in line.forms if not math.isnan(form.criterion)]
    if line.is_requested or len(fitted) < 2:
        return {}
    chosen, best = line.forms[0].criterion, min(fitted, key=lambda form: form.criterion)
    rest = sorted(form.criterion for form in fitted)
    numbers = {"count": len(fitted), "near": SIMPLER, "delta": rest[1] - rest[0]}
    kind = "simplest" if chosen > best.criterion else "lowest"
    if line.wiring == "tail" and chosen > best.criterion:
        kind = "other_line"
    return {"kind": kind, **numbers}


def _other_amplitude(line: Line) -> str:
    """The amplitude that these points do not distinguish from the one printed; mostly empty."""
    other = line.mirrored
    if other is None or not abs(other.value - line.amplitude.value) > MOVES * line.amplitude.std:
        return ""
    return scaled(other)


def _moving(line: Line) -> list[tuple[str, dict[str, float]]]:
    """Forms that are nearly as good and move the line, or its FWHM, and by how much, Hz."""
    chosen, moving = line.forms[0], []
    alike = [
        form
        for form in line.forms[1:]
        if form.criterion - chosen.criterion < SIMPLER
        and form.rms_residual**2 < FAR_MORE * chosen.rms_residual**2
    ]
    for form in alike:
        moved = {
            what: there.value - here.value
            for what, there, here, own in (
                ("the line", form.frequency, line.frequency, chosen.frequency),
                ("its FWHM", form.width, line.width, chosen.width),
            )
            if abs(there.value - here.value) > MOVES * own.std
        }
        if moved:
            moving.append((form.name, moved))
    return moving


def _row_name(result: MeasuredLine, form: TriedForm) -> str:
    """A form as its row is called: a requested wiring with the form that is its curve."""
    if isinstance(result, Line) and result.wiring in (NOTCH, REFLECTION) and form.name == FANO:
        return f"{_name(replace(form, name=result.wiring))} ({FANO})"
    return _name(form)


def _name(form: TriedForm) -> str:
    return f"{form.name}{', delay' * form.delayed}{', second line' * form.second}"


# --- numbers -------------------------------------------------------------------------------------


def size(value: Estimate) -> str:
    """A number with its error, under the prefix that suits it by its unit.

    Args:
        value: with its error and its unit.
    """
    return quantity(value.value, value.std, "" if value.unit == "1" else value.unit)


def plain(value: Estimate, unit: str = "") -> str:
    """A number with its error, without a prefix.

    Args:
        value: with its error.
        unit: that is printed.
    """
    return with_error(value.value, value.std, unit)


def scaled(value: Estimate) -> str:
    """A number with its error, under the prefix that suits the number.

    Args:
        value: with its error and its unit; "1": none.
    """
    factor, shown = prefixed(value.value, "" if value.unit == "1" else value.unit)
    return with_error(value.value / factor, value.std / factor, shown)


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


FILTERS: tuple[Callable[..., str], ...] = (plain, scaled, size, size_of)
