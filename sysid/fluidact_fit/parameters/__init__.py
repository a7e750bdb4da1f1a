"""The parameter file: its document, its schema, and the only YAML reader and writer.

Names are loaded when first used: pydantic and PyYAML cost start-up time that a command
which touches no parameter file should not pay.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .atomic import write_atomically as write_atomically
    from .document import ParameterDocument as ParameterDocument
    from .load import dump_document as dump_document
    from .load import make_document as make_document
    from .load import read_document as read_document
    from .load import save_document as save_document
    from .schema import build_schema as build_schema
    from .schema import shipped_schema as shipped_schema
    from .version import CURRENT_VERSION as CURRENT_VERSION
    from .yaml_io import dump_yaml as dump_yaml
    from .yaml_io import read_yaml as read_yaml

_HOMES = {
    "atomic": ["write_atomically"],
    "document": ["ParameterDocument"],
    "load": ["dump_document", "make_document", "read_document", "save_document"],
    "version": ["CURRENT_VERSION"],
    "schema": ["build_schema", "shipped_schema"],
    "yaml_io": ["dump_yaml", "read_yaml"],
}
__all__ = [name for names in _HOMES.values() for name in names]


def __getattr__(name: str) -> object:
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f".{home}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
