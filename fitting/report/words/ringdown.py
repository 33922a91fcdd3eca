"""One resonance of a ringdown in words: its numbers first, then what they rest on."""

from __future__ import annotations

import math

from fitting.report.table import Column, Table, tabulate, terminal_text, text_lines, wrapped
from fitting.resonance.decay_record import AMPLITUDES, PHASORS
from fitting.resonance.ringdown import (
    ALONE,
    FORM_WORDS,
    MOVING,
    NOISE,
    DecayForm,
    DecayingLine,
    Ringdown,
)
from fitting.signal.residual_tests import TOGETHER, TOLD, found_words
from fitting.text.notation import hertz, number, prefixed, quantity, with_error

#: What was recorded, in words.
KIND_WORDS = {PHASORS: "X and Y of a demodulator", AMPLITUDES: "amplitudes"}
#: Widths of the first line from which what decays beside it is no line of its own.
FAST = 10.0
#: Standard errors from which a constant is seen.
SEEN = 2.0


def text(found: Ringdown) -> str:
    """All that the command tells of a ringdown: numbers, sentences, the forms that were compared.

    Args:
        found: as it was fitted.
    """
    lines = [*map(terminal_text, answer(found))]
    for sentence in sentences(found):
        lines += wrapped(sentence)
    return "\n".join([*lines, *text_lines(forms_table(found))])


def answer(found: Ringdown) -> list[str]:
    """Frequency, width, quality, decay time and amplitude, a line each, as far as they are known.

    Args:
        found: as it was fitted.
    """
    lines = []
    if math.isfinite(found.frequency_hz):
        lines.append(f"f      {quantity(found.frequency_hz, found.frequency_std_hz, 'Hz')}")
    elif found.kind == PHASORS:
        offset = with_error(found.offset_hz, found.offset_std_hz, "Hz")
        lines.append(f"offset {offset}  (from the frequency that was demodulated at)")
    width = quantity(found.width_hz, found.width_std_hz, "Hz")
    lines.append(f"width  {width}  (full, at half of the power)")
    if math.isfinite(found.q):
        lines.append(f"Q      {with_error(found.q, found.q_std)}")
    factor, unit = prefixed(found.decay_time_s, "s")
    time = with_error(found.decay_time_s / factor, found.decay_time_std_s / factor, unit)
    lines.append(f"decay  {time}  (of the amplitude to 1/e; of the power in half of it)")
    lines.append(
        f"A      {_sized(found, found.amplitude, found.amplitude_std)}  (at {_begin(found)})"
    )
    return lines


def sentences(found: Ringdown) -> list[str]:
    """What the numbers rest on, and what speaks against them.

    Args:
        found: as it was fitted.
    """
    return [
        *found.said,
        _ringdown(found),
        _taken(found),
        *_beside(found),
        *_rival(found),
        *_moving(found),
        *_second(found),
        *_reference(found),
        *_left(found),
    ]


def _begin(found: Ringdown) -> str:
    factor, unit = prefixed(abs(found.begin_s), "s")
    return f"t = {number(found.begin_s / factor, 6)} {unit}, where the fit begins"


def _ringdown(found: Ringdown) -> str:
    what = KIND_WORDS.get(found.kind, "samples of a motion")
    if found.left_out == 0:
        return f"A ringdown, {what}: it decays freely from its first sample on."
    before = (
        "the first one may belong to a drive or a blow, and was not used"
        if found.left_out == 1
        else "those before may belong to a drive or a blow, and were not used"
    )
    return f"A ringdown, {what}: it decays freely from sample {found.left_out + 1} on; {before}."


def _taken(found: Ringdown) -> str:
    left = f"it leaves {number(100.0 * found.residual, 2)} % of A (rms)"
    noise = ", which is noise by all tests" if found.describes else ""
    return f"Taken: {found.form}, {FORM_WORDS[found.form]}; {left}{noise}."


def _sized(found: Ringdown, value: float, error: float) -> str:
    factor, unit = prefixed(max(abs(value), error), "" if found.unit == "1" else found.unit)
    if error == 0.0:
        times = "× " if unit.startswith("10") else ""
        return f"{number(value / factor, 3)} {times}{unit}".rstrip()
    return with_error(value / factor, error / factor, unit)


def _beside(found: Ringdown) -> list[str]:
    """How large the constant is, or the noise of amplitudes."""
    if found.form == ALONE:
        return []
    size = _sized(found, found.beside, found.beside_std)
    if found.form != NOISE and abs(found.beside) < SEEN * found.beside_std:
        return [f"A constant beside it was solved for, {size}: none is seen."]
    if found.form == NOISE:
        return [f"The noise of X, and of Y, is {size}: amplitudes do not fall below it."]
    if found.kind == PHASORS:
        return [f"The constant is {size}: what leaks of the reference, or an offset of the input."]
    return [f"The constant is {size}: a zero of the detector."]


def _rival(found: Ringdown) -> list[str]:
    """A form for which the errors hold, too."""
    if not found.rival:
        return []
    return [
        f"The errors hold for {found.rival}, too, {FORM_WORDS[found.rival]}, which these samples "
        f"do not plainly tell from {found.form}."
    ]


def _moving(found: Ringdown) -> list[str]:
    """That the frequency moves with the amplitude."""
    if found.form != MOVING:
        return []
    size = with_error(abs(found.shift_hz), found.shift_std_hz, "Hz")
    way = "above" if found.shift_hz > 0.0 else "below"
    return [
        f"Its frequency moves with the square of its amplitude, as a Duffing oscillator's does: it "
        f"begins {size} {way} that of small amplitudes, which is told here."
    ]


def _second(found: Ringdown) -> list[str]:
    """What decays beside the line, or stays."""
    line = found.second
    if line is None:
        return []
    share = f"{number(100.0 * line.share, 2)} % of A"
    where = _place(found, line)
    if not line.decays:
        return [f"A tone that does not decay stands beside it, {where}, of {share}: fitted, too."]
    if line.width_hz > FAST * found.width_hz:
        factor, unit = prefixed(line.decay_time_s, "s")
        fast = f"{number(line.decay_time_s / factor, 2)} {unit}"
        return [
            f"Something else, of {share}, dies out beside it in {fast} (to 1/e): a filter that "
            "settles, or a mode of far lower quality. It was fitted, too."
        ]
    quality = f", Q {with_error(line.q, line.q_std)}" if math.isfinite(line.q) else ""
    return [
        f"Two lines decay. The second one is {where}, "
        f"{quantity(line.width_hz, line.width_std_hz, 'Hz')} wide{quality}, of {share}: both were "
        "fitted together, and all numbers above are of the first one."
    ]


def _place(found: Ringdown, line: DecayingLine) -> str:
    if math.isfinite(line.frequency_hz):
        return f"at {quantity(line.frequency_hz, line.frequency_std_hz, 'Hz')}"
    offset = with_error(line.offset_hz, line.offset_std_hz, "Hz")
    return f"at {offset} from the frequency that was demodulated at"


def _reference(found: Ringdown) -> list[str]:
    """What a demodulated record does not tell of the frequency."""
    rate = hertz(1.0 / found.spacing_s, digits=6)
    said = []
    if found.kind == PHASORS:
        said.append(
            "Phases are counted as those of Re[(X + iY) exp(i 2 pi f t)]; counted the other way "
            "the line lies as far on the other side of the reference. Lines that are "
            f"{rate} apart look alike in these samples."
        )
    if found.kind == AMPLITUDES:
        told = f": Q takes {hertz(found.reference_hz)}, as told" if math.isfinite(found.q) else ""
        said.append(f"Amplitudes tell no frequency{told}.")
    if found.kind in (PHASORS, AMPLITUDES) and math.isnan(found.reference_hz):
        said.append('For Q its frequency is wanted: --demodulated-at "1.2 MHz".')
    return said


def _left(found: Ringdown) -> list[str]:
    """What the residuals do that noise does not, and what it does to the errors."""
    if found.describes:
        return []
    what = found_words(found.structure_p, found.sizes_p)
    said = f"The residuals {what}"
    if found.widening > TOLD:
        said += (
            f": the {len(found.points.time_s)} samples count as "
            f"{number(found.independent_samples, 2)} independent and equal ones, and the errors "
            f"are {number(found.widening, 2)} times as wide for it"
        )
    noise = "noise that is slower than the samples" if TOGETHER in what else "noise that changes"
    return [f"{said}. It is {noise}, or something that this form does not have: see the figure."]


def forms_table(found: Ringdown) -> Table:
    """Every form that was tried, with what it gives, the one that was taken first.

    Args:
        found: as it was fitted.
    """
    tells = any(math.isfinite(form.frequency_hz) for form in found.forms)
    quality = any(math.isfinite(form.q) for form in found.forms)
    columns: list[Column[DecayForm]] = [Column("form", lambda form: form.name, role="name")]
    if tells:
        columns.append(Column("f (Hz)", lambda f: _value(f.frequency_hz, f.frequency_std_hz)))
    elif found.kind == PHASORS:
        columns.append(
            Column("offset (Hz)", lambda form: _value(form.offset_hz, form.offset_std_hz))
        )
    columns.append(Column("width (Hz)", lambda form: _value(form.width_hz, form.width_std_hz)))
    if quality:
        columns.append(Column("Q", lambda form: _value(form.q, form.q_std)))
    columns += [
        Column("left (%)", lambda form: number(100.0 * form.residual, 2)),
        Column("Akaike", lambda form: number(round(form.criterion, 1), 4)),
    ]
    return tabulate("Forms that were compared", columns, found.forms)


def _value(value: float, error: float) -> str:
    return with_error(value, error) if math.isfinite(value) else "–"
