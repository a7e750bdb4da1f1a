"""Progress on standard error."""

from __future__ import annotations

import sys
import time

from .show import tell

_CLEAR = "\r\x1b[K"  # to the first column of an empty line
_PATIENCE = 2.0  # seconds of silence before a plain line


class Progress:
    """Receives progress messages and shows them where they do not disturb.

    On a terminal one line is overwritten; elsewhere lines appear only when a fit takes
    long, at most one every two seconds. With ``verbose`` all of them are shown, and at the end
    where the time went.
    """

    def __init__(self, quiet: bool = False, verbose: bool = False) -> None:
        self.quiet, self.verbose = quiet, verbose
        self.terminal = sys.stderr is not None and sys.stderr.isatty()
        self.begun = self.last = time.monotonic()
        self.shown = False
        self.stages: list[tuple[str, float]] = []

    def __call__(self, message: str) -> None:
        """Show a message."""
        if self.quiet:
            return
        now = time.monotonic()
        self.stages.append((message, now))
        if self.verbose:
            tell(f"[{now - self.begun:.1f} s] {message}")
        elif self.terminal:
            tell(f"{message} ...", before=_CLEAR, after="")
            self.shown = True
        elif now - self.last > _PATIENCE:
            tell(f"{message} ... ({now - self.begun:.0f} s)")
            self.last = now

    def close(self) -> None:
        """Remove the line; say what every stage took."""
        if self.shown:
            tell("", before=_CLEAR, after="")
            self.shown = False
        if self.verbose and self.stages and not self.quiet:
            tell(self._taken(time.monotonic()))

    def _taken(self, end: float) -> str:
        """Seconds of every stage, the longest first; stages of one name together."""
        taken: dict[str, float] = {}
        later = [begun for _, begun in self.stages[1:]] + [end]
        for (stage, begun), ended in zip(self.stages, later, strict=True):
            taken[stage] = taken.get(stage, 0.0) + ended - begun
        stages = sorted(taken.items(), key=lambda item: -item[1])
        listed = ", ".join(f"{stage} {seconds:.1f}" for stage, seconds in stages)
        return f"{end - self.begun:.1f} s in all: {listed}"
