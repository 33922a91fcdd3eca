"""Where the Duffing oscillator's slow motion stands still: the periodic orbits of one tone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .duffing_equations import find_root, steady_squares
from .oscillator_equations import TWO_PI, damping

if TYPE_CHECKING:
    from .duffing_slow import Pair, SlowModel


def averaged_orbit(model: SlowModel, linear: Pair, upper: bool) -> Pair:
    """Return Q of both modes by first-order averaging, the other mode's part iterated.

    ``linear`` is Q of the linear response, from which the drive's phasor follows. ``upper`` takes
    the largest of each mode's amplitudes where there are several, else the smallest.
    """
    p, cubic = model.p, model.cubic
    omega, widths = TWO_PI * model.centre, damping(p)
    cross = 1j * omega * TWO_PI * widths.w12
    loss = [omega * TWO_PI * w for w in (widths.w11, widths.w22)]
    detuning = [
        TWO_PI * (eta - model.centre) * TWO_PI * (eta + model.centre)
        for eta in (p.eta_plus, p.eta_minus)
    ]
    drive = [complex(detuning[i], loss[i]) * linear[i] + cross * linear[1 - i] for i in (0, 1)]
    q = [0j, 0j]
    for _ in range(40):
        before = list(q)
        for i, alpha in enumerate((cubic.alpha1, cubic.alpha2)):
            other = q[1 - i]
            lifted = detuning[i] + 0.5 * cubic.kappa * abs(other) ** 2
            force = drive[i] - cross * other
            force -= 0.25 * cubic.kappa * q[i].conjugate() * other * other
            square = steady_squares(lifted, loss[i], alpha, abs(force))[upper]
            q[i] = force / complex(lifted + 0.75 * alpha * square, loss[i])
        if q == before:
            break
    return q[0], q[1]


def fixed_point(model: SlowModel, linear: Pair, guess: Pair) -> Pair | None:
    """Return w near ``guess`` where the slow motion stands still, None if there is no stable one.

    ``linear`` is Q of the linear response, constant for one drive frequency.
    """

    def motion(x: list[float]) -> list[float]:
        w = complex(x[0], x[1]), complex(x[2], x[3])
        n1, n2, _, _ = model.slope(w, linear)
        v1, v2 = model.rates[0] * w[0] + n1, model.rates[1] * w[1] + n2
        return [v1.real, v1.imag, v2.real, v2.imag]

    sizes = [abs(y) + abs(x) for y, x in zip(guess, linear)]
    floor = 1e-9 * max(sizes)
    scales = [max(size, floor) for size in sizes for _ in (0, 1)]
    start = [guess[0].real, guess[0].imag, guess[1].real, guess[1].imag]
    x = find_root(motion, start, scales)
    return None if x is None else (complex(x[0], x[1]), complex(x[2], x[3]))
