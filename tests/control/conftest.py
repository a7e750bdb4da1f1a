"""Parameter documents made without a fit, so that the truth of a block is known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fluidact_fit.families import get_family
from fluidact_fit.family import Plant
from fluidact_fit.parameters import make_document, save_document

VALUES: dict[str, tuple[str, dict[str, float]]] = {
    "line": ("line", {"gain": 0.9, "time_constant": 0.12, "dead_time": 0.0147}),
    "valve": (
        "valve",
        {"gain": 1.5e5, "natural_frequency": 20.0, "damping_ratio": 0.7, "dead_time": 0.0},
    ),
    "hydrostatic": (
        "hydrostatic",
        {
            "mass": 53.7,
            "damping": 1720.5,
            "dead_zone_negative": -3.0,
            "dead_zone_positive": 1.2,
        },
    ),
    "ball-screw": (
        "rotary",
        {
            "inertia": 11.71e-7,
            "viscous": 2.0e-5,
            "coulomb_positive": 2.0e-3,
            "coulomb_negative": 1.6e-3,
            "breakaway_positive": 2.9e-3,
            "breakaway_negative": 1.9e-3,
        },
    ),
}


def build(
    family_name: str, values: dict[str, float] | None = None, sample_time: float = 0.01
) -> dict[str, Any]:
    """A valid document with the given parameter values."""
    variant_name, default = VALUES[family_name]
    family = get_family(family_name)
    variant = next(v for v in family.variants if v.name == variant_name)
    values = {**default, **(values or {})}
    specs = {s.name: s for s in variant.parameters}
    plant = Plant(variant, values, family.options_type())
    return {
        "format": "fluidact-parameters",
        "format_version": 1,
        "family": family_name,
        "variant": variant_name,
        "parameters": {
            n: {"value": v, "unit": specs[n].unit, "status": "fixed"} for n, v in values.items()
        },
        "options": plant.options.given(),
        "model": family.model(plant, sample_time, "zoh"),
        "validity": {
            r.name: {"low": -1.0, "high": 2.0, "unit": r.unit}
            for r in variant.roles
            if r.name != "time"
        },
        "fit": {
            "samples": 10,
            "rmse": {"value": 0.1, "unit": variant.output.unit},
            "fit_percent": 90.0,
            "verdict": "pass",
        },
        "provenance": {
            "tool": {"name": "fluidact-fit", "version": "0.1.0"},
            "created": "2026-11-20T22:00:00Z",
        },
    }


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write the parameter file of a family and return its path."""

    def writer(
        family: str, values: dict[str, float] | None = None, sample_time: float = 0.01
    ) -> Path:
        return save_document(
            make_document(build(family, values, sample_time), get_family),
            tmp_path / f"{family}.yaml",
            overwrite=True,
        )

    return writer
