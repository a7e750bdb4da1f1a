"""System identification for fluid-powered actuators.

>>> import fluidact_fit as ff
>>> result = ff.fit("valve", ["trial1.csv", "trial2.csv"])       # doctest: +SKIP
>>> result.save("valve.yaml")                                    # doctest: +SKIP
>>> model = ff.load("valve.yaml")                                # doctest: +SKIP

Names are loaded when first used: ``import fluidact_fit`` alone costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .version import __version__

if TYPE_CHECKING:
    from .control import load, read_document
    from .errors import (
        ConsumerError,
        ControllerFileError,
        ExtrapolationWarning,
        FluidactError,
        JobsFileError,
        LogError,
        MismatchError,
        Notice,
        NotIdentifiedError,
        OutputError,
        ParameterFileError,
        SchedulerError,
        StrictError,
        UnitError,
        UsageError,
    )
    from .families import family_names, get_family
    from .fitting import fit
    from .logs import Log, StepInput, read_log
    from .result import FitResult

_NAMES = {
    "control": ("load", "read_document"),
    "errors": (
        "ConsumerError", "ControllerFileError", "ExtrapolationWarning", "FluidactError",
        "JobsFileError", "LogError", "MismatchError", "NotIdentifiedError", "Notice", "OutputError",
        "ParameterFileError", "SchedulerError", "StrictError", "UnitError", "UsageError",
    ),
    "families": ("family_names", "get_family"),
    "fitting": ("fit",),
    "logs": ("Log", "StepInput", "read_log"),
    "result": ("FitResult",),
}  # fmt: skip
_HOMES = {name: module for module, names in _NAMES.items() for name in names}

__all__ = [
    "ConsumerError", "ControllerFileError", "ExtrapolationWarning", "FitResult", "FluidactError",
    "JobsFileError", "Log", "LogError", "MismatchError", "NotIdentifiedError", "Notice",
    "OutputError", "ParameterFileError", "SchedulerError", "StepInput", "StrictError", "UnitError",
    "UsageError", "__version__", "family_names", "fit", "get_family", "load", "read_document",
    "read_log",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*__all__, *(n for n in globals() if n.startswith("__"))})
