"""The oldest dependencies that ``pyproject.toml`` promises to work with, as constraints for pip.

``make test-oldest`` installs with them, those of the extras too, and runs a part of the tests, so
that a lower bound is a fact and not a hope. The tools are those of ``uv.lock``.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

from locked import locked

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
    root = Path(__file__).parents[1]
    project, lock = (
        tomllib.loads((root / name).read_text(encoding="utf-8"))
        for name in ("pyproject.toml", "uv.lock")
    )
    extras = project["project"]["optional-dependencies"].values()
    pins = oldest([*project["project"]["dependencies"], *(r for e in extras for r in e)])
    names = {name_of(pin) for pin in pins}
    pins += [pin for pin in locked(lock) if name_of(pin) not in names]
    sys.stdout.write("\n".join(pins) + "\n")


def name_of(pin: str) -> str:
    """Name of the package of ``name==version``, as the index writes it."""
    return pin.partition("==")[0].lower().replace("_", "-")


if __name__ == "__main__":
    main()
