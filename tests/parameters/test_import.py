"""Importing the package costs next to nothing."""

from __future__ import annotations

import subprocess
import sys

import pytest

import fluidact_fit.parameters as package


def test_nothing_heavy_is_imported():
    code = (
        "import sys, fluidact_fit.parameters;"
        "found = {'pydantic', 'yaml', 'pint', 'pandas'} & set(sys.modules);"
        "sys.exit(f'imported: {found}' if found else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", package.__all__)
def test_every_public_name_is_there(name):
    assert getattr(package, name) is not None


def test_unknown_names_are_unknown():
    with pytest.raises(AttributeError, match="nothing_such"):
        package.nothing_such  # noqa: B018
