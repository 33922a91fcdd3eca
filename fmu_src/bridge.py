"""Two faults of the binary that pythonfmu 0.7 puts into an FMU, made good from inside.

* At every instantiation it runs the text of the slave module again and then gives back a reference
  to the module's namespace that it does not own: the second instance would find it freed.
* At the exit of the process the C++ run time destroys the binary's state, and then the library's
  own destructor takes a count down in it: once in some hundred processes the heap notices and the
  process aborts, after its work is done. The binary exports the function that lets go of the state,
  and lets go of it only once; calling it while Python still shuts down leaves nothing to destroy.

The second can be done here only where Python is the host. A host in C calls the function itself.
"""

from __future__ import annotations

import atexit
import os
import sys
from pathlib import Path
from typing import Any

_namespaces: list[dict[str, Any]] = []


def attach(namespace: dict[str, Any], model: str) -> None:
    """Take a reference to the slave module's namespace; the first time, see to a clean exit."""
    if not _namespaces:
        _exit_cleanly(Path(namespace["__file__"]).resolve().parents[1] / "binaries", model)
    _namespaces.append(namespace)


def _exit_cleanly(binaries: Path, model: str) -> None:
    """Register the release of the binary's state, if a Python program loaded it, on Linux."""
    # an interpreter started by Py_Initialize, as the binary does, has no command line
    if not getattr(sys, "orig_argv", None) or not hasattr(os, "RTLD_NOLOAD"):
        return
    try:
        import ctypes

        path = binaries / "linux64" / f"{model}.so"
        library = ctypes.CDLL(str(path), mode=os.RTLD_NOLOAD | os.RTLD_NOW)
        release = library.finalizePythonInterpreter
    except (ImportError, OSError, AttributeError):
        return  # no ctypes, or another binary than the one with the fault
    release.restype = None
    atexit.register(release)
