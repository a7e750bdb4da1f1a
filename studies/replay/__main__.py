"""Write the page and its pictures: ``python -m studies.replay [--write]``."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from fluidact_fit.report import render

from .page import page, run
from .pictures import draw

PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "replay.md"
PICTURES = PAGE.with_name("pictures")
_PATH = re.compile(rb' d="[^"]*"')


def _shorter(path: re.Match[bytes]) -> bytes:
    """A path to a hundredth of a point, which is finer than any screen."""
    return re.sub(rb"(?<=\.\d\d)\d+", b"", path[0])


def main() -> None:
    """Print the page, or write it with its pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="write the page and its pictures")
    chosen = parser.parse_args()
    runs = run()
    text = page(runs)
    sys.stdout.write(text)
    if chosen.write:
        PICTURES.mkdir(exist_ok=True)
        for name, figure in draw(runs):
            (PICTURES / f"{name}.svg").write_bytes(_PATH.sub(_shorter, render(figure, "svg")))
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
