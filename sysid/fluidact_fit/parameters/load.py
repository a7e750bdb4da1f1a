"""Parameter files in and out."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import ParameterFileError
from ..specification import Described
from .agreement import check_agreement
from .atomic import write_atomically
from .document import ParameterDocument
from .migrations import is_newer, migrate
from .plain import to_plain
from .problems import Location, Problems
from .validation import Lookup, validate
from .yaml_io import YamlText, dump_yaml, parse_yaml, read_yaml

_REMEDY = "Correct these, or fit again and use the new file."


def read_document(path: str | os.PathLike[str], lookup: Lookup | None = None) -> ParameterDocument:
    """Read, migrate and check a parameter file.

    Parameters
    ----------
    path
        The file.
    lookup
        Finds a family by name; the registry by default.

    Raises
    ------
    ParameterFileError
        Naming every problem with its path and line.
    """
    text = read_yaml(path)
    return _checked_text(os.fspath(path), text, lookup)


def parse_document(
    text: str, lookup: Lookup | None = None, where: str = "the document"
) -> ParameterDocument:
    """Read a parameter document from text, as ``read_document`` does from a file.

    Raises
    ------
    ParameterFileError
        Naming every problem with its path and line.
    """
    return _checked_text(where, parse_yaml(text, where), lookup)


def make_document(
    document: Mapping[str, Any], lookup: Lookup | None = None, where: str = "the document"
) -> ParameterDocument:
    """Check a document held in memory.

    Numpy scalars and arrays, tuples, ``Quantity`` and ``Notice`` are converted; keys
    whose value is ``None`` are left out.

    Raises
    ------
    ParameterFileError
        Naming every problem with its path.
    """
    return _checked(where, to_plain(document), Problems(), {}, lookup)


def dump_document(
    document: ParameterDocument | Mapping[str, Any], lookup: Lookup | None = None
) -> str:
    """Return a document as the text of a parameter file.

    What the reader would reject is not written.

    Raises
    ------
    ParameterFileError
        Naming every problem with its path.
    """
    if not isinstance(document, ParameterDocument):
        document = make_document(document, lookup)
    return dump_yaml(document.to_dict())


def save_document(
    document: ParameterDocument | Mapping[str, Any],
    path: str | os.PathLike[str],
    overwrite: bool = False,
    lookup: Lookup | None = None,
) -> Path:
    """Write a parameter file, whole or not at all.

    Raises
    ------
    ParameterFileError
        When the document is not valid.
    OutputError
        When the file exists and may not be replaced, or cannot be written.
    """
    return write_atomically(path, dump_document(document, lookup), overwrite=overwrite)


def _checked_text(where: str, text: YamlText, lookup: Lookup | None) -> ParameterDocument:
    document = _checked(where, text.data, text.problems, text.lines, lookup)
    check_agreement(document, (lookup or _registered)(document.family), where)
    return document


def _checked(
    where: str,
    data: dict[str, Any],
    problems: Problems,
    lines: Mapping[Location, int],
    lookup: Lookup | None,
) -> ParameterDocument:
    # What a newer version calls a problem is unknown here: nothing else is worth saying.
    migrated = migrate(data, problems)
    document = None if is_newer(data) else validate(migrated, problems, lookup or _registered)
    if document is None:
        raise ParameterFileError(where, problems.listed(lines), _REMEDY)
    return document


def _registered(name: str) -> Described:
    from ..families import get_family

    return get_family(name)
