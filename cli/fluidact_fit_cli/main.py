"""Entry point: it can be interrupted at any moment, so it imports next to nothing itself."""

from __future__ import annotations

import os
import signal
import sys

from . import INTERRUPTED

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import FrameType


def run(args: Sequence[str]) -> int:
    """Run the program with the words after its name and return its exit status."""
    from .program import run

    return run(args)


def main() -> None:
    """Run the program and leave the process with its exit status."""
    try:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, _interrupt)
        # A fit uses one thread (see fitting.py); a pool that waits costs a quarter of a short one.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # Nor has it a use for plugins of pydantic, looked for in all packages there are.
        os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
        _prepare_streams()
        status = run(sys.argv[1:])
        # All is done and said: whoever interrupts now only spoils the end of the interpreter.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    except KeyboardInterrupt:
        _leave()
    sys.exit(status)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise ``KeyboardInterrupt``, or leave at once where it would not arrive as one.

    Modules in C that are being imported print it as a traceback or turn it into an
    ``ImportError``. No file is being written then.
    """
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            _leave()
        frame = frame.f_back
    raise KeyboardInterrupt


def _leave() -> None:
    try:
        os.write(2, b"Interrupted.\n")
    finally:
        os._exit(INTERRUPTED)


def _prepare_streams() -> None:
    """Keep files from becoming standard streams, and characters from becoming errors."""
    # Where a standard stream is closed, the next file opened would take its place, and the
    # messages of libraries would end in it.
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(descriptor)
    if hasattr(sys.stdout, "reconfigure"):
        # A character that the terminal lacks (or a file name that is not text) is no error.
        sys.stdout.reconfigure(errors="backslashreplace")


if __name__ == "__main__":
    main()
