"""Parameter files of this version: one of every family, and changed ones."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

import fluidact_fit as ff

GOLDEN = Path(__file__).parents[1] / "golden" / ff.__version__


@pytest.fixture(params=ff.family_names())
def parameter_file(request: pytest.FixtureRequest) -> Path:
    """The parameter file of a family."""
    return GOLDEN / f"{request.param}.yaml"


@pytest.fixture
def edited(tmp_path: Path) -> Callable[..., Path]:
    """Writes a changed copy of a parameter file."""

    def make(
        family: str, change: Callable[[dict[str, Any]], object], name: str = "edited.yaml"
    ) -> Path:
        text = (GOLDEN / f"{family}.yaml").read_text(encoding="utf-8")
        document = copy.deepcopy(yaml.safe_load(text))
        change(document)
        path = tmp_path / name
        path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
        return path

    return make
