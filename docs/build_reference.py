"""Write the generated pages of the reference from what they describe, never by hand.

    python docs/build_reference.py            # writes docs/reference/*.md
    python docs/build_reference.py --check    # writes nothing; names pages that are not up to date

Campaign keys come from the schema of the campaign file, results from the records that are written,
commands from their parsers, the Python names from the front door, FMU variables from the models'
own modelDescription.xml. No page depends on the terminal or on the version of Python.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from docs.site import campaign, commands, models, python, results
from fitting.result.result import Result
from fitting.result.schema import json_schema

REFERENCE = Path(__file__).resolve().parent / "reference"
#: What stands below the title: where a change has to be made to be seen here.
REMARK = "\n\n<!-- Written by docs/build_reference.py from {source}. Changes here are lost. -->\n\n"
PAGES: dict[str, tuple[str, Callable[[], str]]] = {
    "campaign": ("the schema of the campaign file", campaign.page),
    "commands": ("the commands' options", commands.page),
    "exit-codes": ("fitting/cli/words/parser.py", commands.exit_codes_page),
    "results": ("the records that are written", results.page),
    "python": ("the names of the package", python.page),
    "fmu-variables": ("the models' modelDescription.xml", models.page),
}


def main() -> int:
    """Write the pages, or compare them; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--check", action="store_true", help="write nothing, name old pages")
    check = parser.parse_args().check
    old = []
    for name, (source, page) in PAGES.items():
        path = REFERENCE / f"{name}.md"
        title, _, body = page().partition("\n\n")
        text = title + REMARK.format(source=source) + body.rstrip() + "\n"
        if path.is_file() and path.read_text("utf-8") == text:
            continue
        old.append(f"docs/reference/{name}.md")
        if not check:
            path.write_text(text, "utf-8")
    if not check:  # for editors and other programs; a library's version may order it otherwise
        schema = json.dumps(json_schema(Result), indent=1, ensure_ascii=False) + "\n"
        (REFERENCE / "result.schema.json").write_text(schema, "utf-8")
    for name in old:
        print(f"{name} is not what it describes" if check else f"written: {name}")
    return int(check and bool(old))


if __name__ == "__main__":
    sys.exit(main())
