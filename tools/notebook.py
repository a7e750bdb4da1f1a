"""Execute notebooks in place and clear what belongs to the machine.

    python tools/notebook.py [notebooks/NN_name.ipynb ...]

Without names, all of them. Timestamps, versions and kernels of the machine do not stay in the file.
"""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).parents[1]
_KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}


def execute(path: Path) -> None:
    """Run one notebook from its own folder and write it back."""
    notebook = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    place = {"metadata": {"path": str(path.parent)}}
    NotebookClient(notebook, timeout=600, resources=place).execute()
    notebook.metadata = {"kernelspec": _KERNEL, "language_info": {"name": "python"}}
    for cell in notebook.cells:
        cell.metadata = {}
    nbformat.write(notebook, path)  # type: ignore[no-untyped-call]


def main() -> None:
    """Execute what was named, or everything."""
    named = [Path(arg) for arg in sys.argv[1:]]
    for path in named or sorted((ROOT / "notebooks").glob("*.ipynb")):
        execute(path)
        sys.stdout.write(f"{path.name}\n")


if __name__ == "__main__":
    main()
