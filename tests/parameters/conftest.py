"""A family of this package's own tests: one parameter of every kind, and two variants."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import pytest

from fluidact_fit.errors import UsageError
from fluidact_fit.family import Family, ParameterSpec, Role, Variant
from fluidact_fit.options import FamilyOptions, choice, flag, interval, number, settled, text, whole

_ROLES = (
    Role("time", "s", "instants", required=False),
    Role("force", "N", "force", hold="foh"),
    Role("position", "m", "position", output=True),
    Role("reading", "1", "raw reading", required=False),
)


@dataclass(frozen=True)
class DummyOptions(FamilyOptions):
    """One option of every kind."""

    degree: str | None = text("auto", help="degree of the curve")
    hidden: int | None = whole(help="hidden units", minimum=1)
    length: float | None = number(help="length of the line", unit="m", above=0.0)
    ends: str = choice("free", ("free", "fixed"), help="ends of the curve")
    monotone: bool | None = flag(help="whether the curve only rises")
    rails: tuple[float, float] | None = interval(help="rails of the converter", unit="V")
    spike_limit: float | None = settled("float", "largest residual that was kept", minimum=0.0)


class Dummy(Family[FamilyOptions]):
    """A mass with a calibration curve."""

    name = "dummy"
    title = "Dummy"
    equation = "y = x"
    options_type: type[FamilyOptions] = DummyOptions
    variants = (
        Variant(
            "plain",
            _ROLES,
            (
                ParameterSpec("mass", "kg", "moving mass", minimum=1e-12),
                ParameterSpec("dead_zone_negative", "N", "edge", neutral=0.0, maximum=0.0),
                ParameterSpec("control_points", "m", "curve", rank=1),
                ParameterSpec("weights", "1", "weights", minimum=1e-9, rank=1, length=3),
                ParameterSpec("layer", "1", "network layer", rank=2, optional=True),
                ParameterSpec("viscous", "N s/m", "friction", minimum=0.0, optional=True),
                ParameterSpec(
                    "reading_range", "1", "ends", rank=1, length=2, increasing=True, optional=True
                ),
            ),
        ),
    )

    def estimate(self, variant: Any, experiments: Any, request: Any) -> Any:
        raise NotImplementedError

    def simulate(self, *inputs: Any, **more: Any) -> Any:
        raise NotImplementedError

    def block(self, variant: Any, document: Any) -> Any:
        raise NotImplementedError

    def model(self, plant: Any, sample_time: float, hold: Any) -> dict[str, Any]:
        return copy.deepcopy(_DOCUMENT["model"]) if sample_time else {}


class Twin(Dummy):
    """A family of two variants."""

    name = "twin"
    options_type = FamilyOptions
    variants = (
        Variant("rotary", _ROLES, (ParameterSpec("inertia", "kg m2", "inertia", minimum=0.0),)),
        Variant("linear", _ROLES, (ParameterSpec("mass", "kg", "mass", minimum=0.0),)),
    )


FAMILIES = {"dummy": Dummy(), "twin": Twin()}


def find(name: str) -> Family:
    """Find one of the families above, as the registry would."""
    if name not in FAMILIES:
        raise UsageError(f"{name!r} is not a known family.", remedy="Known: dummy, twin.")
    return FAMILIES[name]


@pytest.fixture
def families() -> list[Family]:
    return list(FAMILIES.values())


@pytest.fixture
def lookup() -> Any:
    return find


_DOCUMENT: dict[str, Any] = {
    "format": "fluidact-parameters",
    "format_version": 1,
    "family": "dummy",
    "options": {
        "degree": "auto",
        "hidden": 4,
        "length": 2.5,
        "ends": "fixed",
        "monotone": True,
        "rails": [0.0, 5.0],
        "spike-limit": 0.01,
    },
    "parameters": {
        "mass": {
            "value": 53.71,
            "unit": "kg",
            "std_error": 0.21,
            "ci95": [53.3, 54.12],
            "status": "estimated",
            "method": "wald",
        },
        "dead_zone_negative": {"value": 0.0, "unit": "N", "status": "not_identified"},
        "control_points": {
            "value": [0.0, 0.1],
            "unit": "m",
            "std_error": [0.001, 1.5e-07],
            "ci95": [[-0.1, 0.1], [0.0, 0.2]],
            "status": "estimated",
        },
        "weights": {"value": [1.0, 2.5, 1e20], "unit": "1", "status": "fixed"},
        "layer": {"value": [[1.0, -2.0], [3.0, 4e-300]], "unit": "1", "status": "estimated"},
    },
    "derived": {"time_constant": {"value": 0.03122, "unit": "s", "std_error": 0.0001}},
    "covariance": {
        "order": ["mass", "control_points[0]", "control_points[1]"],
        "matrix": [[0.0441, 0.0, 1e-9], [0.0, 1e-6, 0.0], [1e-9, 0.0, 2.25e-14]],
    },
    "model": {
        "continuous": {"numerator": [1.0], "denominator": [53.71, 0.0], "dead_time": 0.0},
        "discrete": {"sample_time": 0.01, "hold": "zoh", "order": 2, "exact": True},
    },
    "validity": {
        "force": {"low": -11.8, "high": 12.1, "unit": "N"},
        "reading": {"low": 0.1, "high": 4.9, "unit": "V"},
    },
    "fit": {
        "samples": 3000,
        "rmse": {"value": 1.1e-05, "unit": "m"},
        "fit_percent": 98.9,
        "residual_whiteness": {"statistic": 12.5, "p_value": 0.4},
        "verdict": "pass",
        "method": "separable least squares",
        "logs": [
            {
                "file": "trial1.csv",
                "samples": 1000,
                "rmse": {"value": 1e-05, "unit": "m"},
                "fit_percent": 98.0,
                "left_out": 12,
                "offset": {"value": -0.25, "unit": "m"},
            }
        ],
        "details": {"starts": 3, "filter": {"order": 2, "cut_off": 12.5}},
    },
    "validation": [{"file": "v.csv", "rmse": {"value": 2e-05, "unit": "m"}, "fit_percent": 97.0}],
    "warnings": [{"code": "no", "message": "1e-3 of it; see #4: \"yes\", or 'no'\n"}],
    "provenance": {
        "tool": {"name": "fluidact-fit", "version": "0.1.0"},
        "created": "2026-11-20T22:00:00Z",
        "command": "fluidact-fit dummy trial1.csv",
        "logs": [
            {
                "file": "trial1.csv",
                "sha256": "0" * 63 + "f",
                "rows": 1000,
                "sample_time": 0.01,
                "columns": {
                    "time": {"header": "#1", "unit": "s", "assumed": True},
                    "force": {"header": "F [N]", "unit": "N", "scale": -1.0, "hold": "smooth"},
                    "reading": {
                        "step": {"from": 0.0, "to": 4.0, "at": 0.5},
                        "unit": "1",
                        "hold": "zoh",
                    },
                },
            }
        ],
        "seed": 0,
    },
}


@pytest.fixture
def document() -> dict[str, Any]:
    """A whole valid document."""
    return copy.deepcopy(_DOCUMENT)
