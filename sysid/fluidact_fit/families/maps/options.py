"""What the user chose: target, input layer, hidden units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...errors import UsageError
from ...estimation.network import Activation
from ...experiment import Experiment
from ...family import Role

TARGETS = ("command", "force")
PAPER_UNITS = {"command": 5, "force": 7}  # hidden units of the paper
_ALIASES = {
    "pressure": "command", "voltage": "command", "contraction": "position",
    "state": "direction", "motion-state": "direction", "motion_state": "direction",
}  # fmt: skip
ROLES = (
    Role("time", "s", "time of each sample", required=False),
    Role("command", "V", "valve command or pressure", alternatives=("Pa", "A", "1"), hold="zoh"),
    Role("position", "m", "position of the piston, or contraction as a ratio",
         alternatives=("1",), hold="zoh"),
    Role("force", "N", "force of the actuator", hold="zoh"),
    Role("velocity", "m/s", "velocity; computed from position where needed and not given",
         required=False, alternatives=("1/s",), hold="zoh"),
    Role("direction", "1", "motion state: 1 loading, -1 (or 2) unloading; held sign of the "
         "command's change where not given", required=False, hold="zoh"),
    Role("length", "m", "another input, such as the length of a muscle", required=False,
         hold="zoh"),
)  # fmt: skip


@dataclass(frozen=True)
class Options:
    """What the user chose. ``inputs`` is empty for the default, ``hidden`` for ``auto``."""

    target: str
    inputs: tuple[str, ...]
    compare: bool
    hidden: tuple[int, ...]
    activation: Activation
    dead_band: float | None
    starts: int

    @classmethod
    def read(cls, given: Mapping[str, Any]) -> Options:
        """Options as given by name, with the defaults of what is not given."""
        target = given.get("target") or "command"
        text = str(given.get("inputs") or "").strip().lower()
        compare = text == "compare"
        inputs = () if compare or not text else _read_inputs(text, target)
        return cls(
            target,
            inputs,
            compare,
            _read_hidden(str(given.get("hidden") or PAPER_UNITS[target])),
            given.get("activation") or "relu",
            given.get("dead-band"),
            int(given.get("starts") or 16),
        )

    @property
    def source(self) -> str:
        """Whose change is the motion state while training."""
        return "command"


def _read_inputs(text: str, target: str) -> tuple[str, ...]:
    known = [r.name for r in ROLES if r.name not in ("time", target)]
    found = tuple(_ALIASES.get(word.strip(), word.strip()) for word in text.split(","))
    for name in found:
        if name not in known:
            said = "is what the network predicts" if name == target else "is not a role"
            raise UsageError(
                f"--inputs {text}: '{name}' {said}",
                expected=f"For --target {target}: {', '.join(known)}, or compare.",
            )
    if len(set(found)) < len(found):
        raise UsageError(f"--inputs {text} names an input twice", remedy="Name each input once.")
    return found


def _read_hidden(text: str) -> tuple[int, ...]:
    """Hidden units per layer; empty for ``auto``."""
    if text.strip().lower() == "auto":
        return ()
    words = [w.strip() for w in text.split(",")]
    if len(words) <= 2 and all(w.isdigit() and 1 <= int(w) <= 64 for w in words):
        return tuple(int(w) for w in words)
    raise UsageError(
        f"--hidden {text}: no such hidden layer",
        expected="auto, a number from 1 to 64, or two of them for two layers (16,16).",
    )


def input_layers(target: str) -> list[tuple[str, ...]]:
    """The four input layers that the paper compares (figures 7 and 8)."""
    first = "force" if target == "command" else "command"
    return [
        (first, "position"),
        (first, "position", "velocity"),
        (first, "position", "direction"),
        (first, "position", "velocity", "direction"),
    ]


def default_inputs(options: Options, experiments: Sequence[Experiment]) -> tuple[str, ...]:
    """The paper's best layer, as far as the logs hold it, with any length added."""
    layer = input_layers(options.target)[2 if options.target == "command" else 3]
    kept = [n for n in layer if n != "velocity" or has_velocity(experiments)]
    if all("length" in e for e in experiments):
        kept.insert(2, "length")
    return tuple(kept)


def has_velocity(experiments: Sequence[Experiment]) -> bool:
    """Whether all logs hold a velocity or a position to compute it from."""
    return all("velocity" in e or (e.time.size > 4 and e["position"].size > 1) for e in experiments)


def driver(options: Options) -> str:
    """The input that the output has to rise with."""
    return "force" if options.target == "command" else "command"
