"""An end for what waits for ever."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def ended_after(seconds: int) -> Iterator[None]:
    """Raise ``TimeoutError`` in what takes longer; where there are no alarms, nothing ends it."""
    if os.name != "posix":
        yield
        return

    def end(*_: Any) -> None:
        raise TimeoutError("it hangs")

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(seconds)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)
