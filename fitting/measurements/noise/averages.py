"""How many periodograms were averaged, from how a density scatters from point to point.

The logarithm of an average of M periodograms has the variance psi'(M); of second differences of
neighbours that are independent it is six times as much, whatever the spectrum does slowly. The
median of their sizes does not see the few points at a line.
"""

from __future__ import annotations

import numpy as np
from scipy.special import polygamma

from fitting.text.arrays import FloatArray

#: Median of |x| over its standard deviation, of a normal x.
MEDIAN = 0.6744897501960817
#: Averages that are looked for.
MOST, KNOTS = 1e7, 2000


def averages_seen(density: FloatArray) -> float:
    """Number of averages, 1 or more.

    Args:
        density: at points that scatter independently, (n,), above zero.
    """
    bent = np.diff(np.log(density), 2)
    variance = (float(np.median(np.abs(bent))) / MEDIAN) ** 2 / 6.0
    counts = np.geomspace(1.0, MOST, KNOTS)
    falling = polygamma(1, counts)
    return float(np.exp(np.interp(-variance, -falling, np.log(counts))))
