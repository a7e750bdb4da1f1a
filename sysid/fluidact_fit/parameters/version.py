"""The version of the parameter file's layout, and whether this program reads a file's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .problems import Problems

CURRENT_VERSION = 1


def is_newer(document: Mapping[str, Any]) -> bool:
    """Return whether a document has a version that this program does not know yet."""
    version = document.get("format_version")
    return type(version) is int and version > CURRENT_VERSION


def check_version(document: Mapping[str, Any], problems: Problems) -> None:
    """Add a problem where the version is missing, not a version, or newer than this program."""
    version = document.get("format_version")
    if version is None:
        words = "missing"
    elif is_newer(document):
        words = f"{version} is newer than this program reads ({CURRENT_VERSION})"
        words += "; upgrade fluidact-fit"
    elif type(version) is int and version == CURRENT_VERSION:  # True is an int too
        return
    else:
        words = f"{version!r} is not a version; this program reads {CURRENT_VERSION}"
    problems.add(("format_version",), words)
