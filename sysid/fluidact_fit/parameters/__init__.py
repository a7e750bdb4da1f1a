"""The parameter file: its document, its schema, and the only YAML reader and writer.

Names are loaded when first used: pydantic and PyYAML cost start-up time that a command
which touches no parameter file should not pay.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .atomic import write_atomically
    from .document import ParameterDocument
    from .load import dump_document, make_document, read_document, save_document
    from .migrations import CURRENT_VERSION
    from .schema import build_schema, shipped_schema
    from .yaml_io import dump_yaml, read_yaml

__all__ = [
    "CURRENT_VERSION",
    "ParameterDocument",
    "build_schema",
    "dump_document",
    "dump_yaml",
    "make_document",
    "read_document",
    "read_yaml",
    "save_document",
    "shipped_schema",
    "write_atomically",
]

_HOMES = {
    "CURRENT_VERSION": "migrations",
    "ParameterDocument": "document",
    "build_schema": "schema",
    "dump_document": "load",
    "dump_yaml": "yaml_io",
    "make_document": "load",
    "read_document": "load",
    "read_yaml": "yaml_io",
    "save_document": "load",
    "shipped_schema": "schema",
    "write_atomically": "atomic",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)
