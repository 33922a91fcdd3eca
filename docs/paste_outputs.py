"""Run the blocks of the pages, paste what they print below them, and copy what they draw.

    python docs/paste_outputs.py [PAGE ...]

All pages take about half an hour. `docs/site/blocks.py` tells what a page says of its blocks.
A remark above an image, `<!-- drawn: FILE -->`, says which file of the blocks it is.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from PIL import Image

import build_fmu
from docs.site.blocks import ROOT, blocks, pages, pasted, prepare, run

#: What is drawn, and where the page has it.
IMAGE = re.compile(r"<!-- drawn: (.*?) -->\n!\[[^]]*\]\((.*?)\)")
#: Width and height of a picture in a page.
LARGEST_PX = (1000, 1000)


def main() -> int:
    """Paste into the pages that are named, or into all; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("page", type=Path, nargs="*", help="pages (all)")
    named = [page.resolve() for page in parser.parse_args().page]
    for page in named or pages():
        print(page.relative_to(ROOT), file=sys.stderr)
        text = page.read_text("utf-8")
        if IMAGE.search(text) or any("output" in block.remarks for block in blocks(text)):
            new = with_outputs(text, page.parent)
            page.write_text(new, "utf-8")
            print(f"{page.relative_to(ROOT)}: {'new outputs' if new != text else 'as it was'}")
    return 0


def with_outputs(text: str, beside: Path) -> str:
    """The page with what its blocks print; its images are copied.

    Args:
        text: of the page.
        beside: folder of the page, from which it names its images.
    """
    found = blocks(text)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        for model in ("CoupledOscillator", "DuffingOscillator"):
            build_fmu.build(model, folder / "build")
        printed = {block.start: output for block, output in run(found, folder, tested=False)}
        for drawn, image in IMAGE.findall(text):
            [source] = folder.glob(drawn)
            with Image.open(source) as picture:  # a page needs no more than 64 colours
                picture.thumbnail(LARGEST_PX)
                picture.convert("RGB").quantize(64).save(beside / image, optimize=True)
    made, end, output = [], 0, ""
    for block in found:
        output = printed.get(block.start, output)
        if "output" in block.remarks:
            start = block.start + len("```\n")
            made += [text[end:start], pasted(block, output)]
            end = start + len(block.text)
    return "".join([*made, text[end:]])


if __name__ == "__main__":
    sys.exit(main())
