"""The next experiment is designed for every family, or the message says why not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import fluidact_fit as ff


def test_every_family_is_designed_for_or_refused(
    trial: Any, here: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # how good a design becomes is tested in test_excitation.py
    for name in ("_LEADERS", "_PIECES", "_TRIES"):
        monkeypatch.setattr(f"fluidact_fit.excitation.command.{name}", 2)
    target = tmp_path / "next.csv"
    done = here(
        "design", trial.family, "--from", trial.path, "--duration", "0.5", "-o", target
    )  # fmt: skip
    assert done.status in (0, 2), done.err
    if done.status == 0:
        assert len(target.read_text(encoding="utf-8").splitlines()) > 2
    else:
        assert done.err.strip(), "the message says why not"
        assert not target.exists()


@pytest.fixture
def undriven(trial: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of a family whose roles, but for time and output, have been taken away."""
    family = ff.get_family(trial.family)
    roles = tuple(r for r in trial.variant.roles if r.output or r.name == "time")
    variant = replace(trial.variant, roles=roles)

    def forget(raw: dict[str, Any]) -> None:
        kept = {role.name for role in roles}
        raw["validity"] = {k: v for k, v in raw["validity"].items() if k in kept}
        for log in raw["provenance"]["logs"]:
            log["columns"] = {k: v for k, v in log["columns"].items() if k in kept}

    path = trial.edit(tmp_path / "undriven.yaml", forget)
    monkeypatch.setattr(type(family), "variants", (variant,))
    return path


def test_a_family_that_nothing_drives_is_refused(
    trial: Any, undriven: Path, here: Callable[..., Any]
) -> None:
    done = here("design", trial.family, "--from", undriven, "--duration", "0.5")
    assert done.status == 2, done.err
    assert done.err.strip(), "the message says why not"
