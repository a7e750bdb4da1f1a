"""Parameter files in the languages of controllers: one module per target.

Every target makes its files from a :class:`Job`, that is from a block that was loaded and
accepted; it writes nothing itself.
"""

from .registry import TARGETS, get_target
from .run import Exported, NotExportedError, export
from .target import Arithmetic, Job, Target, make_job, renamed

__all__ = [
    "TARGETS", "Arithmetic", "Exported", "Job", "NotExportedError", "Target", "export",
    "get_target", "make_job", "renamed",
]  # fmt: skip
