"""The names of the package: listed, typed, loaded when first used."""

from __future__ import annotations

import subprocess
import sys

import pytest

import fluidact_fit as ff

PROGRAM = """
import sys
import fluidact_fit as ff
assert not {"numpy", "pandas", "pydantic", "scipy"} & {*sys.modules}, "import is slow"
import fluidact_fit.check, fluidact_fit.export  # modules of the same names as functions
from fluidact_fit.export import TARGETS
assert all(callable(f) for f in (ff.check, ff.export, ff.compare, ff.fit_line))
assert ff.check.__module__ == "fluidact_fit.check"
"""


def test_a_module_does_not_hide_the_function_of_its_name() -> None:
    subprocess.run([sys.executable, "-c", PROGRAM], check=True)


def test_dir_lists_what_users_need_and_nothing_else() -> None:
    names = [name for name in dir(ff) if not name.startswith("_")]
    functions = [f"fit_{name.replace('-', '_')}" for name in ff.family_names()]
    assert {*ff.__all__, *functions} - {"__version__"} == {*names}
    assert all(getattr(ff, name) is not None for name in names)


def test_a_family_that_does_not_exist_has_no_function() -> None:
    with pytest.raises(AttributeError, match="fit_piano"):
        ff.fit_piano  # noqa: B018
