"""The public names, each with its home: the one table of them.

Type checkers and editors read it as it is; the package itself reads it when a name is first used,
so that importing the package costs nothing, and a worker process or ``--help`` loads no more than
it needs.
"""

from fitting.api import plot as plot
from fitting.api.calibration import calibrate as calibrate
from fitting.api.cost import Cost as Cost
from fitting.api.cost import cost as cost
from fitting.api.direct import fit_sweep as fit_sweep
from fitting.api.direct import fit_trace as fit_trace
from fitting.api.examples import example as example
from fitting.api.fitted import Fit as Fit
from fitting.api.fitted import Inference as Inference
from fitting.api.fitted import Tikhonov as Tikhonov
from fitting.api.fitted import Value as Value
from fitting.api.fitted import fit as fit
from fitting.api.fitted import profile as profile
from fitting.api.fitted import read_result as read_result
from fitting.api.fmu import Accuracy as Accuracy
from fitting.api.fmu import Fmu as Fmu
from fitting.api.fmu import simulate as simulate
from fitting.api.fmu import sweep as sweep
from fitting.api.jobs import identify as identify
from fitting.api.jobs import report as report
from fitting.api.line import Columns as Columns
from fitting.api.line import Line as Line
from fitting.api.line import NoiseLine as NoiseLine
from fitting.api.line import Ringdown as Ringdown
from fitting.api.line import line as line
from fitting.api.line import noise_line as noise_line
from fitting.api.line import ringdown as ringdown
from fitting.api.line import write_line as write_line
from fitting.api.lines import LineRow as LineRow
from fitting.api.lines import Lines as Lines
from fitting.api.lines import lines as lines
from fitting.api.lines import write_lines as write_lines
from fitting.api.problem import Problem as Problem
from fitting.campaign.arrays import Parameter as Parameter
from fitting.campaign.arrays import Sweep as Sweep
from fitting.campaign.arrays import Tones as Tones
from fitting.campaign.bound import Drive as Drive
from fitting.campaign.bound import Setup as Setup
from fitting.campaign.laws import Laws as Laws
from fitting.campaign.noise import Noise as Noise
from fitting.check.api import check as check
from fitting.design.api import Goal as Goal
from fitting.design.api import Limits as Limits
from fitting.design.api import design as design
from fitting.design.api import limits as limits
from fitting.draft.api import init as init
from fitting.ensembles.api import Ensemble as Ensemble
from fitting.ensembles.api import EnsembleOptions as EnsembleOptions
from fitting.ensembles.api import Laboratories as Laboratories
from fitting.ensembles.api import ensemble as ensemble
from fitting.ensembles.api import write_ensemble as write_ensemble
from fitting.fmu.isolation import Isolation as Isolation
from fitting.lab.synthesis import synthesize as synthesize
from fitting.lab.synthesis import synthesize_curves as synthesize_curves
from fitting.lab.tradeoff.api import StudyOptions as StudyOptions
from fitting.lab.tradeoff.api import tradeoff as tradeoff
from fitting.lab.tradeoff.api import write_tradeoff as write_tradeoff
from fitting.measurements.complex_sweep import ComplexCurve as ComplexCurve
from fitting.measurements.complex_sweep import ComplexSweep as ComplexSweep
from fitting.measurements.complex_sweep import Wiring as Wiring
from fitting.measurements.control_sweep import ControlSpectrum as ControlSpectrum
from fitting.measurements.control_sweep import ControlSweep as ControlSweep
from fitting.measurements.kinds import read_campaign as read_campaign
from fitting.measurements.noise import NoiseSpectrum as NoiseSpectrum
from fitting.measurements.traces import DemodulatedTrace as DemodulatedTrace
from fitting.measurements.traces import Trace as Trace
from fitting.measurements.waveform import Chirp as Chirp
from fitting.measurements.waveform import Pulse as Pulse
from fitting.posterior.api import Posterior as Posterior
from fitting.posterior.api import PosteriorCost as PosteriorCost
from fitting.posterior.api import Sampling as Sampling
from fitting.posterior.api import posterior as posterior
from fitting.posterior.api import posterior_cost as posterior_cost
from fitting.posterior.api import write_posterior as write_posterior
from fitting.text.errors import BadInput as BadInput
from fitting.text.errors import FmuFailure as FmuFailure
from fitting.text.errors import MissingFile as MissingFile

__version__: str
__all__: list[str]

def _table() -> dict[str, str]: ...
