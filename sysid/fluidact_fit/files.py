"""Parameter files with the families of the registry: what every reader above them uses."""

from __future__ import annotations

import os

from .families import get_family
from .parameters import ParameterDocument
from .parameters import read_document as _read


def read_document(path: str | os.PathLike[str]) -> ParameterDocument:
    """Read, migrate and check a parameter file.

    Raises
    ------
    ParameterFileError
        Naming every problem with its path and line.
    """
    return _read(path, get_family)
