"""System identification for fluid-powered actuators.

>>> import fluidact_fit as ff
>>> result = ff.fit("valve", ["trial1.csv", "trial2.csv"])       # doctest: +SKIP
>>> result.save("valve.yaml")                                    # doctest: +SKIP
>>> model = ff.load("valve.yaml")                                # doctest: +SKIP

Names are loaded when first used: ``import fluidact_fit`` alone costs next to nothing.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from .version import __version__

if TYPE_CHECKING:
    from .check import check
    from .comparison import compare
    from .control import load, read_document
    from .errors import (
        ConsumerError,
        ControllerFileError,
        ExistingFileError,
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
    from .export import export
    from .families import family_names, get_family
    from .family_fits import *  # noqa: F403
    from .fitting import fit
    from .inspection import Inspection, inspect
    from .logs import Log, StepInput, read_log
    from .result import FitResult

_NAMES = {
    "check": ("check",),
    "comparison": ("compare",),
    "control": ("load", "read_document"),
    "errors": (
        "ConsumerError", "ControllerFileError", "ExistingFileError", "ExtrapolationWarning",
        "FluidactError", "JobsFileError", "LogError", "MismatchError", "NotIdentifiedError",
        "Notice", "OutputError", "ParameterFileError", "SchedulerError", "StrictError",
        "UnitError", "UsageError",
    ),
    "export": ("export",),
    "families": ("family_names", "get_family"),
    "fitting": ("fit",),
    "inspection": ("Inspection", "inspect"),
    "logs": ("Log", "StepInput", "read_log"),
    "result": ("FitResult",),
}  # fmt: skip
_HOMES = {name: module for module, names in _NAMES.items() for name in names}

__all__ = [
    "ConsumerError", "ControllerFileError", "ExistingFileError", "ExtrapolationWarning",
    "FitResult", "FluidactError", "Inspection", "JobsFileError", "Log", "LogError",
    "MismatchError", "NotIdentifiedError", "Notice", "OutputError", "ParameterFileError",
    "SchedulerError", "StepInput", "StrictError", "UnitError", "UsageError", "__version__",
    "check", "compare", "export", "family_names", "fit", "get_family", "inspect", "load",
    "read_document", "read_log",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name) or ("family_fits" if name in _fit_functions() else None)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{home}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *_fit_functions(), *(n for n in globals() if n.startswith("__"))})


def _fit_functions() -> list[str]:
    from .families import family_names, fit_function

    return [fit_function(name) for name in family_names()]


class _Package(ModuleType):
    """This package: a module never takes the place of the function that it is named after."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _HOMES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
