"""``python -m fitting`` is ``fmu-fit``."""

import sys

from fitting.cli import main

if __name__ == "__main__":
    sys.exit(main())
