"""What a plan decided, in words: the one place where its sentences are made."""

from __future__ import annotations

from fitting.signal.window import Window
from fitting.text.notation import hertz


def window_in_words(window: Window) -> str:
    """Why a window does: whole periods and no folding, or the condition of a tone fit."""
    if window.coherent:
        said = (
            f"{hertz(*window.tones_hz)}: {window.length_s:.6g} s hold whole periods; "
            f"{window.samples} samples keep the tones apart and off 0 and half the rate, so that a "
            "fit of the tones is the Fourier bin"
        )
    else:
        said = (
            f"{' and '.join(f'{tone!r} Hz' for tone in window.tones_hz)}: no common period of "
            f"reasonable length; amplitudes by a tone fit of {window.samples} samples (condition "
            f"number {window.condition:.2f})"
        )
    if window.mixtures:
        said += f", clear of the {window.mixtures} mixtures that a nonlinear response may have"
    if window.held_steps:
        said += f"; the drive is held over steps of {window.input_step_s:.6g} s"
    return said
