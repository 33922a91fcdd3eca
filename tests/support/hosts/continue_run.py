"""Continue a run from a serialised state: ``continue_run.py FOLDER STATE`` prints hex numbers."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

import fmpy

from tests.models.test_hosts_state import continued
from tests.support.fmus import Instance, Unpacked

folder = Path(sys.argv[1])
fmu = Unpacked(folder, folder, fmpy.read_model_description(str(folder)))
with Instance(fmu) as instance:
    instance.slave.setFMUstate(instance.slave.deSerializeFMUstate(Path(sys.argv[2]).read_bytes()))
    for row in continued(instance, fmu.names("output")):
        print(*(x.hex() for x in row))
