"""``python -m fitting`` is ``fmu-fit``."""

import sys

from fitting.cli.main import main

if __name__ == "__main__":
    code = main()
    # An interrupt in code that is made of text, as that of dataclasses is, counts as unhandled in
    # CPython, which then ends ``python -m`` by SIGINT whatever was caught since; to run any other
    # such code takes that back.
    exec("")  # noqa: S102
    sys.exit(code)
