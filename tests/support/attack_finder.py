"""One attack of the red team by its name, for tests of what it once found."""

from __future__ import annotations

from types import ModuleType

from studies.red_team.attack import Attack


def find_attack(module: ModuleType, group: str, name: str) -> Attack:
    """The attack of a module with this group and name."""
    (found,) = (a for a in module.attacks() if (a.group, a.name) == (group, name))
    assert isinstance(found, Attack)
    return found
