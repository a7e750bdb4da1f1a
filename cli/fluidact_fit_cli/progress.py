"""Progress on standard error."""

from __future__ import annotations

import sys
import time

import click

_PATIENCE = 2.0  # seconds of silence before a plain line


class Progress:
    """Receives progress messages and shows them where they do not disturb.

    On a terminal one line is overwritten; elsewhere lines appear only when a fit takes
    long, at most one every two seconds (all of them with ``verbose``).
    """

    def __init__(self, quiet: bool = False, verbose: bool = False) -> None:
        self.quiet, self.verbose = quiet, verbose
        self.terminal = sys.stderr.isatty()
        self.begun = self.last = time.monotonic()
        self.shown = False

    def __call__(self, message: str) -> None:
        """Show a message."""
        if self.quiet:
            return
        now = time.monotonic()
        if self.verbose:
            click.echo(f"[{now - self.begun:.1f} s] {message}", err=True)
        elif self.terminal:
            click.echo(f"\r\x1b[K{message} ...", nl=False, err=True)
            self.shown = True
        elif now - self.last > _PATIENCE:
            click.echo(f"{message} ... ({now - self.begun:.0f} s)", err=True)
            self.last = now

    def close(self) -> None:
        """Remove the line."""
        if self.shown:
            click.echo("\r\x1b[K", nl=False, err=True)
            self.shown = False
