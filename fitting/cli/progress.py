"""Progress on a terminal, silence in a pipe."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm


@contextmanager
def status_line(label: str) -> Iterator[Callable[[str], None]]:
    """A line that shows what is under way and for how long, gone at the end.

    Yields the function that changes its text. Nothing is shown unless stderr is a terminal.

    Args:
        label: that goes before the text.
    """
    with tqdm(
        desc=label,
        bar_format="{desc} [{elapsed}]{postfix}",
        leave=False,
        disable=not sys.stderr.isatty(),
    ) as bar:
        yield lambda text: bar.set_postfix_str(text)
