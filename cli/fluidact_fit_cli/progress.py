"""Progress on standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from threading import Event, Lock, Thread
from typing import Self

from .show import is_terminal, tell, width_of

_CLEAR = "\r\x1b[K"  # to the first column of an empty line
_TICK = 0.5  # seconds between two states of the line
_PATIENCE = 2.0  # seconds of silence before a plain line


class Progress:
    """Receives progress messages and shows them where they do not disturb.

    On a terminal one line is overwritten, with the number of the stage and the time since the
    beginning, which goes on while a stage lasts. Elsewhere nothing is shown, or with ``lines`` a
    line at most every two seconds. With ``verbose`` all messages are shown, and at the end where
    the time went.

    ``stages`` are the messages that are known to come, in their order; others belong to the stage
    in which they come.
    """

    def __init__(
        self, quiet: bool = False, verbose: bool = False, *, stages: Sequence[str] = (),
        lines: bool = False,
    ) -> None:  # fmt: skip
        self.quiet, self.verbose = quiet, verbose
        self.stages, self.number, self.lines = stages, 0, lines
        self.terminal = is_terminal(sys.stderr) and not quiet and not verbose
        self.begun = self.last = time.monotonic()
        self.messages: list[tuple[str, float]] = []
        self._lock, self._ended = Lock(), Event()
        self._ticker: Thread | None = None

    def __call__(self, message: str) -> None:
        """Show a message."""
        if self.quiet:
            return
        now = time.monotonic()
        if message in self.stages:
            self.number = max(self.number, self.stages.index(message) + 1)
        self.messages.append((message, now))
        if self.verbose:
            tell(f"[{now - self.begun:.1f} s] {message}")
        elif self.terminal:
            self._draw()
            if self._ticker is None:
                self._ticker = Thread(target=self._tick, daemon=True)
                self._ticker.start()
        elif self.lines and now - self.last > _PATIENCE:
            tell(f"{message} ... ({now - self.begun:.0f} s)")
            self.last = now

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    def clear(self) -> None:
        """Remove the line for a message, or for good."""
        if self._ticker is not None:
            with self._lock:
                tell("", before=_CLEAR, after="")

    def close(self) -> None:
        """End: remove the line, and with ``verbose`` say what every message took."""
        self._ended.set()
        if self._ticker is not None:
            self._ticker.join()
        self.clear()
        if self.verbose and self.messages and not self.quiet:
            tell(self._taken(time.monotonic()))

    def _tick(self) -> None:
        while not self._ended.wait(_TICK):
            self._draw()

    def _draw(self) -> None:
        stage = f"{self.number}/{len(self.stages)} " if self.number else ""
        seconds = time.monotonic() - self.begun
        end = f" ... {seconds:.1f} s" if seconds < 60.0 else (
            f" ... {seconds // 60:.0f} min {seconds % 60:02.0f} s")  # fmt: skip
        room = (width_of(sys.stderr) or 80) - len(stage + end)
        with self._lock:
            tell(stage + self.messages[-1][0][:room] + end, before=_CLEAR, after="")

    def _taken(self, end: float) -> str:
        """Seconds of every message, the longest first; those of one name together."""
        taken: dict[str, float] = {}
        later = [begun for _, begun in self.messages[1:]] + [end]
        for (message, begun), ended in zip(self.messages, later, strict=True):
            taken[message] = taken.get(message, 0.0) + ended - begun
        longest = sorted(taken.items(), key=lambda item: -item[1])
        listed = ", ".join(f"{message} {seconds:.1f}" for message, seconds in longest)
        return f"{end - self.begun:.1f} s in all: {listed}"
