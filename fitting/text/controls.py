"""Characters that steer a terminal, in words that somebody else wrote: spelled out instead."""

from __future__ import annotations

import re

#: What moves, colours or clears (C0, DEL, C1), and what turns the direction of writing.
_STEERS = re.compile("[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def spelled_out(text: str, kept: str = "") -> str:
    """A text whose control characters are spelled out, as JSON does.

    Args:
        text: of anybody, as an FMU.
        kept: characters that stay as they are.
    """
    return _STEERS.sub(lambda m: m[0] if m[0] in kept else f"\\u{ord(m[0]):04x}", text)
