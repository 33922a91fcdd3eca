"""Names of what is next to a line, in a campaign's tables and of `fitting.lines.form`."""

from __future__ import annotations

TRANSMISSION, FANO, SLOPED = "transmission", "fano", "sloped"
OFFSET, SLOPE, FLOOR, RICE, SINGLE, TAIL = "offset", "slope", "floor", "rice", "single", "tail"
#: What a campaign may declare next to the line of a sweep, and what is added to its amplitudes.
BACKGROUNDS = ("none", "complex", OFFSET, SLOPE)
ADDED = (OFFSET, SLOPE)
#: The form of a line with each of these, and with noise.
FORM_OF = {
    "none": TRANSMISSION,
    "complex": FANO,
    OFFSET: OFFSET,
    SLOPE: SLOPED,
    FLOOR: FLOOR,
    RICE: RICE,
}
#: Unknowns of a line of amplitudes with each of these.
UNKNOWNS = {"none": 3, "complex": 5, OFFSET: 4, SLOPE: 5, FLOOR: 4, RICE: 4}
#: What is next to the line in each form, in words, of amplitudes and of complex values.
WORDS = {
    SINGLE: "noise that is in every single reading",
    OFFSET: "a constant that is added to its amplitude",
    SLOPED: "a background that changes linearly with frequency and is added to its amplitude",
    FLOOR: "noise whose power is added to its own",
    RICE: "noise, of which amplitudes were averaged",
    FANO: "a complex constant",
    TAIL: "the tail of another line",
    "duffing_offset": "a constant",
}
WORDS_COMPLEX = {**WORDS, SLOPED: "a complex background that changes linearly with frequency"}
#: Fewest points of a sweep that is fitted.
MIN_SWEEP_POINTS = 8
#: What fits a recording over time, and what is printed of one that is no free decay.
TIME_PAGE = "fmu-fit help traces"
TIME_WAY = (
    f"the FMU whose output was recorded, as fmu-fit init --fmu drafts a campaign: {TIME_PAGE}"
)
