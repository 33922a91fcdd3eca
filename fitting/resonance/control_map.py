"""A long table of spectra over a control quantity, where one sweep is looked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fitting.campaign.instruments.plain import LEAST_POINTS
from fitting.campaign.instruments.recording import Channel, Recording
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.errors import BadInput
from fitting.text.notation import listed

#: Tables of a campaign that fit such a map, by whether it has phases.
TABLES = {False: "control_sweep", True: "complex_control_sweep"}
PAGE = "fmu-fit help control-sweep"


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlMap:
    """Spectra at several values of one or more controls, all in one table.

    ``rows`` are those of each spectrum, in the order of the table, (n,) each; ``settings``
    (spectra, controls) the values there, in the units of the columns ``controls``.
    """

    path: Path
    controls: tuple[Channel, ...]
    settings: FloatArray
    rows: tuple[IntArray, ...]

    @property
    def words(self) -> str:
        """What it is: "7 spectra over V (V), 61 frequencies each"."""
        counts = [rows.size for rows in self.rows]
        least, most = min(counts), max(counts)
        points = f"{least}" if least == most else f"{least} to {most}"
        over = listed(f"{c.name} ({c.unit or 'no unit stated'})" for c in self.controls)
        return f"{len(counts)} spectra over {over}, {points} frequencies each"

    def way(self, *, phases: bool, drafted: bool) -> str:
        """How it is fitted, for errors where one sweep is wanted.

        Args:
            phases: whether its values are complex.
            drafted: whether to mention that there may be a draft.
        """
        names = listed(c.name for c in self.controls)
        draft = ", and fmu-fit init drafts it for two modes that meet, --fmu CoupledModes2"
        return (
            f"[{TABLES[phases]}] of a campaign fits all of them together, by laws of what follows "
            f"{names}: {PAGE} describes it{draft * drafted}"
        )


def map_of(
    recording: Recording, frequencies: FloatArray, taken: Sequence[str]
) -> ControlMap | None:
    """The map that a file is; None for one sweep, also one that runs up and down.

    A control is a column of numbers each of whose few values has frequencies of its own that rise,
    or all that fall. One column is enough to find the spectra, or all of those with few values make
    them together; whatever else changes from spectrum to spectrum, and in none of them, is a
    control as well.

    Args:
        recording: the columns of the file.
        frequencies: (n,), in the order of the file.
        taken: names of the columns that are taken for frequencies, first, and for values.
    """
    steps = np.diff(frequencies)
    if np.all(steps > 0.0) or np.all(steps < 0.0):
        return None
    candidates = [(c, v) for c in recording.channels if c.name != taken[0] for v in _few(c)]
    free = [pair for pair in candidates if pair[0].name not in taken]
    for pairs in (*([pair] for pair in candidates), *([free] if len(free) > 1 else [])):
        values = np.column_stack([v for _, v in pairs])
        _, first, group = np.unique(values, axis=0, return_index=True, return_inverse=True)
        order = np.argsort(first)  # as the file has them
        rows = tuple(np.flatnonzero(group.ravel() == k) for k in order)
        if _are_spectra(frequencies, rows):
            own = [c.name for c, _ in pairs]
            further = [(c, v) for c, v in free if c.name not in own]
            steady = [(c, v) for c, v in further if all(np.ptp(v[each]) == 0.0 for each in rows)]
            controls = [*pairs, *steady]
            settings = np.column_stack([v[first[order]] for _, v in controls])
            return ControlMap(
                path=recording.path,
                controls=tuple(c for c, _ in controls),
                settings=settings,
                rows=rows,
            )
    return None


def _few(channel: Channel) -> list[FloatArray]:
    """The values (n,) of a column that could be a control; none of any other column."""
    if channel.is_complex:
        return []
    try:
        values = np.asarray(channel.read(), dtype=float)
    except BadInput:  # text, as that of a remark
        return []
    if not np.all(np.isfinite(values)):
        return []
    return [values] if 2 <= np.unique(values).size <= values.size // LEAST_POINTS else []


def _are_spectra(frequencies: FloatArray, rows: Sequence[IntArray]) -> bool:
    if min(each.size for each in rows) < LEAST_POINTS:
        return False
    steps = np.concatenate([np.diff(frequencies[each]) for each in rows])
    return bool(np.all(steps > 0.0) or np.all(steps < 0.0))
