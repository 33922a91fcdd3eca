"""One resonance of a noise spectrum in words: its numbers first, then what they rest on."""

from __future__ import annotations

import math

from fitting.report.table import terminal_text, wrapped
from fitting.resonance.noise_line import FurtherNoiseLine, NoiseLine
from fitting.signal.noise_lines import COUPLED, TOGETHER
from fitting.signal.residual_tests import TOLD, found_words
from fitting.text.notation import number, prefixed, quantity, with_error

#: How two modes are moved, in words.
MOVED = {
    TOGETHER: "as modes which one force drives",
    COUPLED: "as two coupled modes in heat, of which one is seen",
}
#: Spacings of the points below which a window may have widened a line by much of its width.
NARROW = 4.0
#: Averages up to which nothing was averaged.
SINGLE = 1.5


def text(found: NoiseLine) -> str:
    """All that the command tells of a noise spectrum: numbers, then sentences.

    Args:
        found: as it was fitted.
    """
    lines = [*map(terminal_text, answer(found))]
    for sentence in sentences(found):
        lines += wrapped(sentence)
    return "\n".join(lines)


def answer(found: NoiseLine) -> list[str]:
    """Frequency, width, quality, and root mean square of the line, a line each.

    Args:
        found: as it was fitted.
    """
    lines = [
        f"f      {quantity(found.frequency_hz, found.frequency_std_hz, 'Hz')}",
        f"width  {quantity(found.width_hz, found.width_std_hz, 'Hz')}  (full, at half of the "
        "density)",
        f"Q      {with_error(found.q, found.q_std)}",
    ]
    if math.isfinite(found.rms_std) and found.unit != "1":
        factor, unit = prefixed(found.rms, found.unit)
        rms = with_error(found.rms / factor, found.rms_std / factor, unit)
        lines.append(f"rms    {rms}  (of the line over all frequencies, without the floor)")
    return lines


def sentences(found: NoiseLine) -> list[str]:
    """What the numbers rest on, and what speaks against them.

    Args:
        found: as it was fitted.
    """
    return [
        *found.said,
        _scatter(found),
        _floor(found),
        *_second(found),
        *_narrow(found),
        *_left(found),
    ]


def _scatter(found: NoiseLine) -> str:
    share = number(100.0 / math.sqrt(found.averages), 2)
    many = f"averages of {number(found.averages, 2)} periodograms do"
    as_what = "a single periodogram does" if found.averages < SINGLE else many
    return (
        f"A noise spectrum: its points scatter by {share} % of themselves, as {as_what}, and are "
        "weighed so."
    )


def _floor(found: NoiseLine) -> str:
    unit = "" if found.unit == "1" else f" {found.unit}²/Hz"
    share = number(100.0 * found.floor / found.height, 2)
    size = "of which no unit is told" if not unit else f"{number(found.floor, 3)}{unit}"
    return f"A white floor beside the line was solved for, {size}: {share} % of the line at f."


def _second(found: NoiseLine) -> list[str]:
    """What stands beside the line."""
    line = found.second
    if line is None:
        return []
    moved = f" They were fitted {MOVED[found.kind]}." if found.kind in MOVED else ""
    return [
        f"Two lines. {_place(line)}: both were fitted, and all numbers above are of the first."
        f"{moved}"
    ]


def _place(line: FurtherNoiseLine) -> str:
    f = quantity(line.frequency_hz, line.frequency_std_hz, "Hz")
    width, q = quantity(line.width_hz, line.width_std_hz, "Hz"), with_error(line.q, line.q_std)
    share = number(100.0 * line.share, 2)
    return f"The second one is at {f}, {width} wide, Q {q}, {share} % as high"


def _narrow(found: NoiseLine) -> list[str]:
    """That the window of the analyser may be seen in the width."""
    if found.width_hz > NARROW * found.spacing_hz:
        return []
    spacings = number(found.width_hz / found.spacing_hz, 2)
    return [
        f"The width is {spacings} times the spacing of the points: a window widens a line by one "
        "or two of them, which is not taken off here. A campaign does that, window = "
        '"hann" under [[noise_spectrum]].'
    ]


def _left(found: NoiseLine) -> list[str]:
    """What the residuals do that such a scatter does not, and what it does to the errors."""
    if found.describes:
        return []
    said = f"The residuals {found_words(found.structure_p, found.sizes_p)}"
    if found.widening > TOLD:
        said += (
            f": the {len(found.points.frequency_hz)} points count as "
            f"{number(found.independent_points, 2)} independent ones, and the errors are "
            f"{number(found.widening, 2)} times as wide for it"
        )
    return [
        f"{said}. A window makes neighbouring points hang together; or there is something that a "
        "line on a white floor does not have: see the figure."
    ]
