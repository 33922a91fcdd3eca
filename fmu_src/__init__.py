"""Models of the project, each packaged by ``build_fmu.py`` as an FMI 2.0 co-simulation FMU.

Nothing in this package but :mod:`fmu_src.slave` knows FMI, and nothing needs more than the standard
library (and, in the FMU, the copy of pythonfmu that it carries), so that the FMUs run in any host
that has libpython.
"""

from __future__ import annotations

#: Models that are built where none is named: name (the FMU's ``modelName`` and
#: ``modelIdentifier``) -> module of this package.
MODELS: dict[str, str] = {
    "CoupledOscillator": "coupled_oscillator",
    "DuffingOscillator": "duffing_oscillator",
}

#: Models built on demand, with a number of modes at the end of their name: what stands before it ->
#: (module, least, most).
FAMILIES: dict[str, tuple[str, int, int]] = {"CoupledModes": ("coupled_modes", 1, 9)}
