"""The oldest dependencies that ``pyproject.toml`` promises to work with, as constraints for pip.

``make test-oldest`` installs with them and runs a part of the tests, so that a lower bound is a
fact and not a hope.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

_LOWER_BOUND = re.compile(r"([A-Za-z0-9_.-]+)>=([0-9.]+)")


def oldest(requirements: list[str]) -> list[str]:
    """Turn every ``name>=1.2`` into ``name==1.2``.

    Raises
    ------
    ValueError
        When a requirement is not a plain lower bound.
    """
    pins = []
    for requirement in requirements:
        found = _LOWER_BOUND.fullmatch(requirement)
        if not found:
            raise ValueError(f"{requirement!r} in pyproject.toml is not of the form name>=version")
        pins.append(f"{found[1]}=={found[2]}")
    return pins


def main() -> None:
    """Print the constraints, one per line."""
    path = Path(__file__).parents[1] / "pyproject.toml"
    project = tomllib.loads(path.read_text(encoding="utf-8"))["project"]
    sys.stdout.write("\n".join(oldest(project["dependencies"])) + "\n")


if __name__ == "__main__":
    main()
