"""What developers work with, at the versions of ``uv.lock``, as constraints for pip.

``make`` installs the tools with them, so that the same commit passes the same checks everywhere;
what the program itself needs is tested at its newest.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import Any


def locked(lock: dict[str, Any]) -> list[str]:
    """Return ``name==version`` for every direct requirement of the dependency groups."""
    versions = {package["name"]: package.get("version") for package in lock["package"]}
    (project,) = (p for p in lock["package"] if "dev-dependencies" in p)
    names = {entry["name"] for group in project["dev-dependencies"].values() for entry in group}
    return [f"{name}=={versions[name]}" for name in sorted(names)]


def main() -> None:
    """Print the constraints, one per line."""
    path = Path(__file__).parents[1] / "uv.lock"
    lock = tomllib.loads(path.read_text(encoding="utf-8"))
    sys.stdout.write("\n".join(locked(lock)) + "\n")


if __name__ == "__main__":
    main()
