"""Generate the synthetic logs of this directory.

    python datasets/generate.py [--output DIRECTORY]

Every module of ``generators/`` that holds a ``DATASET`` makes the directory of one family: closed
forms between events, or a grid much finer than the log. They need nothing but numpy and share no
code with ``fluidact_fit``, so that a fit which recovers the truth proves something. Running the
script again writes the same bytes.
"""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path

from generators.writing import Dataset, write_checksums, write_dataset


def find_datasets() -> list[Dataset]:
    """The datasets of all generators, by the name of their module."""
    names = sorted(p.stem for p in (Path(__file__).parent / "generators").glob("*.py"))
    modules = [import_module(f"generators.{name}") for name in names]
    return [module.DATASET for module in modules if hasattr(module, "DATASET")]


def main() -> None:
    """Write the datasets."""
    parser = argparse.ArgumentParser(description="Write the synthetic datasets.")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent)
    directory = parser.parse_args().output
    for data in find_datasets():
        write_dataset(data, directory)
    write_checksums(directory)


if __name__ == "__main__":
    main()
