"""Names of what is next to a line, in a campaign's tables and of `fitting.lines.form`."""

from __future__ import annotations

from fitting.text.errors import BadInput

TRANSMISSION, FANO, SLOPED = "transmission", "fano", "sloped"
OFFSET, SLOPE, FLOOR, RICE, SINGLE, TAIL = "offset", "slope", "floor", "rice", "single", "tail"
SQUARED = ("squared", "squared_offset")
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
#: What a line may be asked to be: its shape, what is added to it, and how its noise was detected.
SHAPES = ("lorentzian", FANO, "duffing", "notch", "reflection")
ADDED_TERMS = ("none", "constant", SLOPE, TAIL)
NOISES = ("normal", "power", "amplitude", "readings")
#: The form with each of them that there is.
FORM_OF_TERMS = {
    **{(shape, "none", "normal"): shape for shape in SHAPES},
    ("lorentzian", "none", "normal"): TRANSMISSION,
    ("lorentzian", "constant", "normal"): OFFSET,
    ("lorentzian", SLOPE, "normal"): SLOPED,
    ("lorentzian", TAIL, "normal"): TAIL,
    ("lorentzian", "none", "power"): FLOOR,
    ("lorentzian", "none", "amplitude"): RICE,
    ("lorentzian", "none", "readings"): SINGLE,
    ("duffing", "constant", "normal"): "duffing_offset",
}


def form_of_terms(shape: str, background: str, noise: str) -> str:
    """The form that is asked for by its terms; empty where none of them is.

    Args:
        shape: one of `SHAPES`; empty: a Lorentzian, if another one is asked for.
        background: one of `ADDED_TERMS`; empty: none.
        noise: one of `NOISES`; empty: normal.

    Raises:
        BadInput: an unknown term, or terms that are not fitted together.
    """
    given = {"shape": shape, "background": background, "noise": noise}
    allowed = {"shape": SHAPES, "background": ADDED_TERMS, "noise": NOISES}
    for name, value in given.items():
        if value and value not in allowed[name]:
            raise BadInput(f"{name}: found '{value}', wanted one of {', '.join(allowed[name])}")
    if not any(given.values()):
        return ""
    wanted = (shape or "lorentzian", background or "none", noise or "normal")
    if wanted not in FORM_OF_TERMS:
        known = "; ".join(", ".join(terms) for terms in FORM_OF_TERMS)
        raise BadInput(
            f"shape, background and noise: found {', '.join(wanted)}, which are not fitted "
            f"together; wanted one of: {known}"
        )
    return FORM_OF_TERMS[wanted]
