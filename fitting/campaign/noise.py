"""Noise of a campaign's amplitudes, before any model: declared, or seen in the data themselves.

    sigma^2 = floor^2 + (relative A)^2 + absolute^2

floor from the spectra (or the columns of standard deviations); relative and absolute as declared;
where no relative part is declared, it follows from repeated experiments. The sweep has no floor of
its own to read: without a declaration the scatter of its top about a parabola is taken for it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fitting.campaign.file import OUTLIERS
from fitting.campaign.parameters import Parameter
from fitting.signal.scale import laboratory_maximum
from fitting.text.arguments import checked
from fitting.text.arrays import LEAST, MOST, FloatArray
from fitting.text.errors import BadInput
from fitting.text.units import in_unit

if TYPE_CHECKING:  # it is read with what stands here
    from fitting.campaign.data import Campaign
    from fitting.campaign.measured import SweepData

#: Repeats tell the scatter from this many degrees of freedom on (to a third of it).
ENOUGH_REPEATS = 4
#: A fitted scale may leave the sweep's own by this factor, as a logarithm.
SCALE_REACH = 0.5
SCALE_NAME = "ln_scale"


@checked
@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise of peak amplitudes A: sigma^2 = (relative A)^2 + absolute_v^2.

    Args:
        relative: Share of each amplitude, in [0, 1).
        absolute_v: The same for all, in the detector's unit, at least 0.
        outliers: "keep"; "huber": residuals beyond 1.345 sigma count linearly.
        threshold: Standard deviations beyond which residuals are called outliers, above 0.

    Raises:
        BadInput: a share that is not from 0 to below 1, a negative or infinite ``absolute_v``,
            other ``outliers`` than "keep" or "huber", a ``threshold`` that is not above zero.
    """

    relative: float = 0.0
    absolute_v: float = 0.0
    outliers: str = "keep"
    threshold: float = 4.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.relative < 1.0:
            raise BadInput(f"noise: relative {self.relative:g}, wanted a share from 0 to below 1")
        if self.absolute_v != 0.0 and not LEAST <= self.absolute_v <= MOST:
            raise BadInput(
                f"noise: absolute {self.absolute_v:g}, wanted zero or {LEAST:g} to {MOST:g}"
            )
        if self.outliers not in OUTLIERS:
            raise BadInput(
                f"noise: outliers '{self.outliers}', wanted one of {', '.join(OUTLIERS)}"
            )
        if not self.threshold > 0.0:
            raise BadInput(f"noise: threshold {self.threshold:g}, wanted more than zero")

    @property
    def declared(self) -> bool:
        """Whether a standard deviation is declared."""
        return self.relative > 0.0 or self.absolute_v > 0.0

    def with_floor(self, amplitude_v: FloatArray, floor_v: FloatArray) -> FloatArray:
        """Standard deviations (n,) of amplitudes (n,) whose floor's are (n,), NaN for unknown.

        Args:
            amplitude_v: amplitudes (n,), V peak.
            floor_v: standard deviations (n,) of the floor, V; NaN where unknown.
        """
        if not self.declared:
            return floor_v
        # np.hypot, unlike a sum of squares, keeps amplitudes beyond 1e154
        own = np.hypot(self.relative * amplitude_v, self.absolute_v)
        return np.asarray(np.hypot(np.nan_to_num(floor_v, nan=0.0), own))


def bind_noise(campaign: Campaign) -> Noise:
    """Declared noise as peak amplitude, in the unit and the meaning of the campaign's amplitudes.

    Args:
        campaign: campaign as it was read.

    Raises:
        BadInput: an absolute noise that is negative or in another unit; outliers of peaks whose
            noise is not known.
    """
    trace, choice = campaign.file.experiments or campaign.file.sweep, campaign.file.noise
    if trace is None:
        return Noise()
    absolute_v = 0.0
    if choice.absolute is not None:
        absolute_v = in_unit(choice.absolute, campaign.amplitude_unit)
        if absolute_v < 0.0:
            raise BadInput(
                f"{choice.absolute.where}: found {choice.absolute.value!r}, wanted zero or more"
            )
        absolute_v *= math.sqrt(2.0) if trace.detector.kind == "rms" else 1.0
    noise = Noise(
        relative=choice.relative,
        absolute_v=absolute_v,
        outliers=choice.outliers,
        threshold=choice.threshold,
    )
    unknown = [e.label for e in campaign.experiments if not np.all(e.sigmas_v > 0.0)]
    if noise.outliers == "huber" and unknown and not noise.declared:
        raise BadInput(
            f'{campaign.path}: [noise] outliers = "huber" wants the noise of every peak, unknown '
            f"for '{unknown[0]}'; wanted peak_sigmas, or relative or absolute in [noise]"
        )
    return noise


def repeat_scatter(
    groups: Sequence[object], peaks_v: Sequence[FloatArray], sigmas_v: Sequence[FloatArray]
) -> tuple[float, int]:
    """Relative scatter that repeats show beyond their floor, and its degrees of freedom.

    Experiments of equal ``groups`` repeat each other. With z the logarithms of their peaks,
    s^2 = sum (z - mean)^2 / sum (repeats - 1), less the mean of the floors' relative variances.

    Args:
        groups: equal for experiments that repeat each other.
        peaks_v: amplitudes of each experiment, V peak.
        sigmas_v: standard deviations of each experiment, V.
    """
    squares, freedom, floors = 0.0, 0, []
    for group in set(groups):
        mine = [k for k, other in enumerate(groups) if other == group]
        if len(mine) < 2 or len({peaks_v[k].size for k in mine}) > 1:
            continue
        z = np.log(np.array([peaks_v[k] for k in mine]))
        squares += float(np.sum((z - z.mean(axis=0)) ** 2))
        freedom += (len(mine) - 1) * z.shape[1]
        floors += [np.nan_to_num(sigmas_v[k] / peaks_v[k], nan=0.0) ** 2 for k in mine]
    if freedom == 0:
        return 0.0, 0
    floor = float(np.mean(np.concatenate(floors)))
    return math.sqrt(max(0.0, squares / freedom - floor)), freedom


def sweep_sigmas(sweep: SweepData, noise: Noise) -> FloatArray:
    """Standard deviation of every sweep point (n,), in its unit: as declared, else as it scatters.

    The scatter is taken for absolute: equal at all points, as the noise of a detector is; and for
    as large as the few points allow from which it is estimated (Student's t).

    Args:
        sweep: amplitudes, with standard errors of their own or without.
        noise: declared noise of the amplitudes.
    """
    amplitude_v = sweep.amplitude_v
    if sweep.sigma_v is not None:
        return noise.with_floor(amplitude_v, sweep.sigma_v)
    if noise.declared:
        return noise.with_floor(amplitude_v, np.zeros(amplitude_v.size))
    top = laboratory_maximum(sweep.frequency_hz, amplitude_v)
    return np.full(amplitude_v.size, top.spread * top.value_v)


def maximum_sigma(sweep: SweepData, noise: Noise) -> float:
    """Relative error of the largest point as a maximum: noise, and the bias that its top shows.

    Args:
        sweep: amplitudes, with standard errors of their own or without.
        noise: declared noise of the amplitudes.
    """
    top = laboratory_maximum(sweep.frequency_hz, sweep.amplitude_v)
    if not (noise.declared or sweep.sigma_v is not None) or math.isnan(top.bias):
        return top.sigma
    floor_v = 0.0 if sweep.sigma_v is None else sweep.sigma_v[int(np.argmax(sweep.amplitude_v))]
    own = float(noise.with_floor(np.array([top.value_v]), np.array([floor_v]))[0]) / top.value_v
    return math.hypot(own, top.bias if top.is_biased else 0.0)


def sweep_scale_sigma(amplitude_v: FloatArray, sigma_v: FloatArray, scale: str) -> float:
    """Relative standard deviation of chi from the sweep's noise, for each way to take it.

    "maximum", "grid": that of the largest point. "fit": of chi = sum(L S)/sum(S^2) with S in the
    shape of L, sqrt(sum L^2 sigma^2)/sum L^2. "robust": the same over sqrt(0.95), Huber's
    efficiency.

    Args:
        amplitude_v: amplitudes (n,), V peak.
        sigma_v: standard deviations (n,), V.
        scale: how χ is taken from the sweep, by its points or by its maximum.
    """
    if amplitude_v.size == 0 or scale == "none":
        return 0.0
    if scale in ("maximum", "grid"):
        k = int(np.argmax(amplitude_v))
        return float(sigma_v[k] / amplitude_v[k])
    share = amplitude_v / float(np.max(amplitude_v))  # its square may be too small for a double
    spread = sigma_v / float(np.max(amplitude_v))
    fitted = float(np.linalg.norm(share * spread) / np.dot(share, share))
    return fitted / math.sqrt(0.95) if scale == "robust" else fitted


def scale_parameter(sigma: float, *, swept: bool) -> Parameter:
    """The logarithm of the factor between the fitted scale and that of the whole sweep.

    ``sigma``: relative standard deviation of the latter. Where the sweep's points are rows
    themselves (``swept``) it has no prior, their information is in the rows.
    """
    sigma = max(sigma, 1e-6)
    return Parameter(
        name=SCALE_NAME,
        unit="1",
        lower=-SCALE_REACH,
        upper=SCALE_REACH,
        start=0.0,
        reference=0.0,
        scale=min(sigma, 0.25 * SCALE_REACH),
        prior=None if swept else sigma,
        role="scale",
    )
