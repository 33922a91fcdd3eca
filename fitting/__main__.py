"""``python -m fitting`` is ``fmu-fit``."""

import sys

from fitting.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
