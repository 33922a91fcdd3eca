"""Run one instance in a process of its own: ``run_alone.py FOLDER NAME=VALUE...`` prints hex."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

import fmpy

from tests.support.fmus import TIMES, Instance, Unpacked

folder = Path(sys.argv[1])
fmu = Unpacked(folder, folder, fmpy.read_model_description(str(folder)))
values = {name: ast.literal_eval(text) for name, text in (a.split("=") for a in sys.argv[2:])}
with Instance(fmu) as instance:
    for row in instance.start(**values).run(TIMES[:10], "q1_hybrid", "q2", "D12"):
        print(*(x.hex() for x in row))
