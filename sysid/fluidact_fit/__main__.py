"""The command line, as ``python -m fluidact_fit``: the entry point that is installed with it."""

from __future__ import annotations

from importlib.metadata import entry_points

if __name__ == "__main__":
    for command in entry_points(group="console_scripts", name="fluidact-fit"):
        raise SystemExit(command.load()())
