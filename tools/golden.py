"""Keep a parameter file of every family, as this version writes it.

    python tools/golden.py

Writes ``tests/golden/VERSION/FAMILY.yaml`` from the fits of the datasets. Files that are there
already stay as they are: they are kept for ever, and every later version has to read them.
"""

from __future__ import annotations

import sys
from pathlib import Path

import fluidact_fit as ff
from fluidact_fit.demo import load_dataset

GOLDEN = Path(__file__).parents[1] / "tests" / "golden"


def main() -> None:
    """Write the files that are missing."""
    folder = GOLDEN / ff.__version__
    folder.mkdir(parents=True, exist_ok=True)
    for name in ff.family_names():
        path = folder / f"{name}.yaml"
        if path.exists():
            continue
        data = load_dataset(name)
        ff.fit(name, data.read(), **data.options).save(path)
        sys.stdout.write(f"{path}\n")


if __name__ == "__main__":
    main()
