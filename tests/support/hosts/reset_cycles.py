"""Print by how many bytes a process grows: ``reset_cycles.py FOLDER CYCLES``, after a warm-up."""

from __future__ import annotations

import gc
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

import fmpy

from tests.support.fmus import Instance, Unpacked, resident_bytes


def cycle(instance: Instance, count: int) -> None:
    """Reset, set, initialise, step and read, again and again, each time with other numbers.

    The coupling is real at all of these angles: a message to the logger costs a few hundred bytes,
    because pythonfmu 0.7 never gives its strings back.
    """
    for k in range(count):
        instance.slave.reset()
        instance.start(theta=1.6 + 1e-4 * k, d1=100.0 + k)
        instance.step(0.0, 1e-5)
        instance.get("q1_hybrid", "q2_hybrid", "lambda")
        instance.messages.clear()


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    fmu = Unpacked(folder, folder, fmpy.read_model_description(str(folder)))
    with Instance(fmu) as made:
        cycle(made, 200)
        gc.collect()
        before = resident_bytes()
        cycle(made, int(sys.argv[2]))
        gc.collect()
        print(resident_bytes() - before)
