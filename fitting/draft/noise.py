"""Whether a file is a noise spectrum, as a draft sees it: by unit, by name, or by how it scatters.

A density that nobody drove scatters by the same share of itself everywhere; a sweep scatters by the
same amount. With m the lines that follow the points y best, the logarithms of the likelihood are

    by a share     -n ln(rms((y - m)/m)) - sum ln m
    by an amount   -n ln(rms(y - m))
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.instruments.roles import (
    DENSITY,
    HOLDS,
    OBSERVED_UNITS,
    ROOT,
    Density,
    relative_density,
)
from fitting.draft.questions import Question
from fitting.draft.two_modes import COUPLED as COUPLED_MODES
from fitting.draft.two_modes import TwoModes, apart_hz
from fitting.extension.records import PLAIN
from fitting.lines.noise_model import COUPLED, TOGETHER
from fitting.lines.noise_spectrum import NoiseFit, noise_lines
from fitting.lines.several import TwoLines
from fitting.resonance.noise_reading import BY_NAME, BY_UNIT, stated_density
from fitting.resonance.reading import Roles
from fitting.text.arrays import FloatArray
from fitting.text.units import same_kind

NOISE, SWEEP = KINDS = ("noise", "sweep")
#: Gain of the logarithm of the likelihood from which the scatter tells, span of the lines over
#: their floor below which it does not, and the least share of itself that a density scatters by.
TELLS, SPAN, SHARE = 10.0, 3.0, 0.05
#: Mean square of steps between residuals over that of these: 2 of noise, 0 of a smooth misfit.
ROUGH = 1.0
#: How much less a density has to scatter than its root, where the unit is that of amplitudes.
PLAINLY = 1.5
#: Why a file is taken for a noise spectrum that neither unit nor name calls one.
BY_SCATTER = "scatter"


@dataclass(frozen=True, kw_only=True)
class NoiseLook:
    """What a file shows if it is a noise spectrum.

    `by` is why it seems to be one, empty where nothing says so; `holds` what its column holds where
    the unit does not tell it, else empty, and `is_root` whether that is the root of the density;
    `lines` None where it shows none.
    """

    lines: NoiseFit | None
    by: str
    holds: str
    is_root: bool

    @property
    def column(self) -> str:
        """What its column holds, in words."""
        return "root of the density" if self.is_root else "density"

    @property
    def is_sure(self) -> bool:
        """Whether it follows from unit or name, so that no question is needed."""
        return self.by in (BY_UNIT, BY_NAME)

    @property
    def two(self) -> TwoLines | None:
        """Its two lines as those of a sweep; None of others.

        The height of a mode that has a force of its own goes with g/(f^2 w), of modes under one
        force with the square of g/(f w): `ratio` is what makes g of both alike.
        """
        lines = self.lines
        if lines is None or len(lines.lines) < 2:
            return None
        (f1, w1), (f2, w2) = ((line.frequency.value, line.width.value) for line in lines.lines)
        a1, a2 = lines.height
        ratio = a2 / a1 * f2 / f1
        if lines.kind == TOGETHER:
            ratio = math.copysign(math.sqrt(abs(a2 / a1)), a2)
        return TwoLines((f1, f2), (w1, w2), complex(ratio))

    @property
    def modes(self) -> TwoModes | None:
        """Its coupled modes; None where it shows none."""
        lines = self.lines
        if lines is None or lines.kind != COUPLED:
            return None
        f1, w1, f2, w2, coupling = lines.modes
        numbers = [each.frequency for each in lines.lines] + [each.width for each in lines.lines]
        return TwoModes(
            kind=COUPLED_MODES,
            frequency_hz=(f1, f2),
            width_hz=(w1, w2),
            coupling_hz=coupling,
            drive=0.0,
            describes=True,
            line_hz=tuple(each.value for each in numbers),
            line_std_hz=tuple(each.std for each in numbers),
            apart_hz=apart_hz((f1, f2), (w1, w2), coupling),
        )

    @property
    def residual(self) -> float:
        """By which share of itself it scatters; 0: unknown."""
        return 0.0 if self.lines is None else 1.0 / math.sqrt(max(self.lines.averages, 1.0))


def noise_look(roles: Roles, frequency_hz: FloatArray) -> NoiseLook | None:
    """What a file shows if it is a noise spectrum; None where it cannot be one.

    Args:
        roles: of its columns.
        frequency_hz: of its points, shape (n,), Hz.
    """
    channel = roles.sizes
    if channel is None or roles.is_complex or np.any(np.diff(frequency_hz) <= 0.0):
        return None
    table = roles.recording
    frequency = table.find(roles.frequency.name)
    plain = roles.recording.layout == PLAIN and table.find(channel.name) is not None
    if not plain or frequency is None or frequency.unit is None:
        return None  # no table of text whose frequencies have a unit in their header
    given = stated_density(roles)
    if given is not None:
        return _look(given, frequency_hz)
    numbers = roles.recording.numbers(channel)
    if np.any(numbers < 0.0) and not (channel.unit or "").startswith("dB"):
        return None
    return _by_scatter(numbers, channel.unit, frequency_hz)


def _look(density: Density, frequency_hz: FloatArray) -> NoiseLook | None:
    result = density.numbers
    if not np.all(np.isfinite(result)) or np.any(result <= 0.0):
        return None
    try:
        lines = noise_lines(frequency_hz, result)
    except ValueError:  # of a line that is not resolved nothing can be drafted
        lines = None
    return NoiseLook(lines=lines, by=density.by, holds=density.holds, is_root=density.is_root)


def _by_scatter(numbers: FloatArray, unit: str | None, f: FloatArray) -> NoiseLook | None:
    """The same without unit or name: the closer of density and root."""
    looks = {
        way: _look(replace(relative_density(numbers, unit, way), holds=way), f) for way in HOLDS
    }
    # of a density that is read as a root the squares scatter twice as much
    left = {
        way: look.residual / (2.0 if way == ROOT else 1.0)
        for way, look in looks.items()
        if look is not None and look.lines is not None
    }
    if any(same_kind(unit or "", each) for each in OBSERVED_UNITS[:-1]) and DENSITY in left:
        left[DENSITY] *= PLAINLY  # an amplitude by its unit
    best = min(left, key=lambda way: left[way], default="")
    look = looks.get(best)
    if look is None:
        return None
    return replace(look, by=BY_SCATTER if _scatters_by_a_share(look, numbers, unit) else "")


def _scatters_by_a_share(look: NoiseLook, numbers: FloatArray, unit: str | None) -> bool:
    """Whether points scatter by the same share of themselves, and by no small one."""
    lines = look.lines
    if lines is None or look.residual < SHARE:
        return False
    curve = np.sqrt(lines.curve) if look.is_root else lines.curve
    y = numbers
    if (unit or "").startswith("dB"):
        y = relative_density(numbers, unit, DENSITY).numbers
    if not float(np.max(curve)) > SPAN * float(np.min(curve)):
        return False
    residuals = y - curve
    shares = residuals / curve
    square = float(np.mean(shares**2))
    # those of noise, next to each other, differ by twice their mean square; a curve that is another
    # leaves residuals that follow each other, and these are not what points scatter by
    if not float(np.mean(np.diff(shares) ** 2)) > ROUGH * square:
        return False
    amount = y.size * math.log(float(np.sqrt(np.mean(residuals**2))))
    share = y.size * math.log(float(np.sqrt(square)))
    return amount - share - float(np.sum(np.log(curve))) > TELLS


def kind_question(name: str, look: NoiseLook) -> Question:
    """Whether a file is a noise spectrum or a sweep, where that is not sure.

    Args:
        name: of the file.
        look: what it shows if it is a noise spectrum.
    """
    observed = look.by == BY_SCATTER
    return Question(
        key="kind",
        words=f"{name}: is it a noise spectrum without a drive, or a sweep of amplitudes?",
        options=KINDS,
        default=(NOISE,) if observed else (SWEEP,),
        why=f"a guess: its points scatter by the same share of themselves everywhere, as "
        f"the {look.column} of noise does"
        if observed
        else "neither unit, name nor scatter indicates noise",
    )
