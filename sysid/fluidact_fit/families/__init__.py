"""The registry of model families: one line each, loaded when first asked for."""

from __future__ import annotations

from functools import cache
from importlib import import_module

from ..errors import UsageError
from ..family import Family

_REGISTRY = {
    "potentiometer": "potentiometer:Potentiometer",
    "ball-screw": "ball_screw:BallScrew",
    "hydrostatic": "hydrostatic:Hydrostatic",
    "valve": "valve:Valve",
    "line": "line:Line",
    "cylinder-friction": "cylinder_friction:CylinderFriction",
}


def family_names() -> tuple[str, ...]:
    """Names of all families, in the order of the documentation."""
    return tuple(_REGISTRY)


@cache
def get_family(name: str) -> Family:
    """Return the family of that name.

    Raises
    ------
    UsageError
        When there is none; the message lists those there are.
    """
    if name not in _REGISTRY:
        from difflib import get_close_matches

        close = get_close_matches(name, _REGISTRY, 1)
        hint = f" Did you mean {close[0]!r}?" if close else ""
        raise UsageError(
            f"there is no model family {name!r}.{hint}",
            expected="Families: " + ", ".join(_REGISTRY) + ".",
        )
    module, attribute = _REGISTRY[name].split(":")
    family: Family = getattr(import_module(f".{module}", __package__), attribute)()
    return family
