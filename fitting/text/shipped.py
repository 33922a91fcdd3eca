"""Where the files are that come with the program: models' sources, their builder, examples."""

from __future__ import annotations

from pathlib import Path

import fitting
from fitting.text.errors import BadInput

#: The folder of an installed package that holds what stands at the top of a checkout.
INSTALLED = "shipped"


def shipped(name: str) -> Path:
    """Path of a file or folder that comes with the program, as `name` at the top of a checkout.

    An installed package has a copy, made when it was packaged; a checkout has the file itself.

    Raises:
        BadInput: it is in neither place.
    """
    package = Path(fitting.__file__).resolve().parent
    for home in (package / INSTALLED, package.parent):
        if (home / name).exists():
            return home / name
    raise BadInput(
        f"{package / INSTALLED / name}: No such file or directory; wanted a whole installation of "
        "fmu-fit, or its checkout"
    )
