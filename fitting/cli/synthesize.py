"""``fmu-fit synthesize``: a campaign with known truth, noise and drift, made without the FMU."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import Any

import fitting as ff
from fitting.api.synthesis import SERIES, TRUTH_NAME, LockIns
from fitting.cli.options import bounded_number, seed
