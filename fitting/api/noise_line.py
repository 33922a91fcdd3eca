"""One resonance of a noise spectrum, of a file or of arrays, without any FMU."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy.typing as npt

import fitting.resonance.noise_line as resonance
from fitting.report.resonance import text
from fitting.resonance.noise_line import noise_line_of, noise_record_of
from fitting.resonance.noise_reading import is_noise_spectrum, read_noise_of
from fitting.resonance.reading import Columns
from fitting.signal.line_record import fields_of
from fitting.text.arguments import checked
from fitting.text.errors import BadInput

__all__ = ["NoiseLine", "is_noise_spectrum", "noise_line"]


@dataclass(frozen=True, kw_only=True, repr=False)
class NoiseLine(resonance.NoiseLine):
    """One resonance of a noise spectrum; printed, it says what the command ``line`` says.

    Numbers are `Estimate` records: ``value``, ``std``, half of the interval that holds the truth in
    68 of 100 such spectra, ``ci95`` that holds it in 95, and ``unit``.

    Attributes:
        frequency: eigenfrequency, Hz.
        width: full width at half of the density, Hz.
        q: their ratio.
        rms: root mean square of the line over all frequencies, in ``unit``.
        floor: white density under it, ``unit`` squared per Hz.
        averages: of how many periodograms the points are averages, as they scatter.
        second: a further line; None without.
        is_noise: whether the residuals are the scatter of such averages, by all tests.
        points: what was measured and fitted.

    `fitting.resonance.noise_line.NoiseLine` has the rest.
    """

    def __repr__(self) -> str:
        return text(self)


@checked
def noise_line(
    source: str | Path | npt.ArrayLike,
    density: npt.ArrayLike | None = None,
    *,
    unit: str = "1",
    within_hz: tuple[float | None, float | None] = (None, None),
    columns: Columns | None = None,
) -> NoiseLine:
    """One resonance of a noise spectrum: eigenfrequency, full width, quality and rms, with errors.

    The density is fitted by the likelihood of averages of periodograms, a line, or two, on a white
    floor, see `fitting.resonance.noise_line` for the formula. How many were averaged is told by the
    scatter.

    Args:
        source: A file, whose kind is recognised; or frequencies, shape (n,), Hz.
        density: With frequencies: densities above zero, in ``unit`` squared per Hz, shape (n,).
        unit: Of what is seen, as "V"; "1": the numbers are relative.
        within_hz: First and last frequency that are taken, Hz; None: as far as there are points.
        columns: Of a file, what it does not tell.

    Returns:
        ``frequency``, ``width``, ``q`` and ``rms``, each with its ``std`` and ``ci95``.

    Raises:
        BadInput: a file that is not read, no line, a density that is not above zero, or too few
            points.
    """
    if isinstance(source, str | PathLike):
        if density is not None:
            raise BadInput(
                "noise_line: found a file and densities, wanted frequencies and densities, or a "
                "file"
            )
        record = read_noise_of(Path(source), columns or Columns())
    elif density is None:
        raise BadInput("noise_line: found frequencies alone, wanted densities with them, or a file")
    else:
        record = noise_record_of(source, density, unit)
    found = noise_line_of(record.within(*within_hz))
    return NoiseLine(**fields_of(found, resonance.NoiseLine))
