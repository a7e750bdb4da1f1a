"""Options of the force map: target, input layer, hidden units, and what the fit settles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from ...errors import UsageError
from ...experiment import Experiment
from ...family import FamilyOptions, Role
from ...options import choice, number, settled, text, whole

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


def _check_inputs(given: str) -> str:
    """Inputs by the names of their roles; each once."""
    found = [_ALIASES.get(name.strip(), name.strip()) for name in given.lower().split(",")]
    known = [r.name for r in ROLES if r.name != "time"]
    for name in found:
        if name not in known:
            raise ValueError(f"'{name}' is not a role; those are {', '.join(known)}")
    if len(set(found)) < len(found):
        raise ValueError("names an input twice")
    return ",".join(found)


def _check_hidden(given: str) -> str:
    words = [w.strip() for w in given.lower().split(",")]
    numbers = len(words) <= 2 and all(w.isdecimal() and 1 <= int(w) <= 64 for w in words)
    if words != ["auto"] and not numbers:
        raise ValueError("no such hidden layer")
    return ",".join(words)


@dataclass(frozen=True)
class ForceMapOptions(FamilyOptions):
    """Options of the user, and those that the training settled."""

    target: str = choice(
        "command", TARGETS,
        "what the network predicts: the command for a wanted force, or the force",
    )  # fmt: skip
    inputs: str | None = text(
        help="inputs in order, as force,position,direction (default: the paper's best)",
        check=_check_inputs,
        form="roles separated by commas",
    )
    hidden: str | None = text(
        help="hidden units, as 5 or 16,16; auto adds units while validation gains (default: 5 "
        "for the command, 7 for the force)",
        check=_check_hidden,
        form="auto, a number from 1 to 64, or two of them for two layers (16,16)",
    )
    activation: Literal["relu", "tanh"] = choice("relu", ("relu", "tanh"), "of the hidden units")
    dead_band: float | None = number(
        help="change of the command that reverses the motion state, in its SI unit (default: "
        "from its noise)",
        minimum=0.0,
    )
    starts: int = whole(16, help="searches from different starts", minimum=1)
    force_dead_band: float | None = settled(
        "float", "change of the force that reverses the motion state, in its SI unit", minimum=0.0
    )

    def __post_init__(self) -> None:
        """Refuse the target among the inputs."""
        if self.target in self.names:
            left = [r.name for r in ROLES if r.name not in ("time", self.target)]
            raise UsageError(
                f"--inputs={self.inputs}: '{self.target}' is what the network predicts",
                expected=f"For --target={self.target}: {', '.join(left)}.",
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Inputs in order; none while they have yet to be chosen."""
        return () if self.inputs is None else tuple(self.inputs.split(","))

    @property
    def layers(self) -> tuple[int, ...]:
        """Hidden units of each layer; none for ``auto``."""
        if self.hidden is None:
            return (PAPER_UNITS[self.target],)
        return () if self.hidden == "auto" else tuple(int(w) for w in self.hidden.split(","))

    @property
    def driver(self) -> str:
        """The input that the output has to rise with."""
        return "force" if self.target == "command" else "command"


def default_inputs(options: ForceMapOptions, experiments: Sequence[Experiment]) -> tuple[str, ...]:
    """The paper's best layer, as far as the logs hold it, with any length added."""
    names = [options.driver, "position"]
    if all("length" in e for e in experiments):
        names.append("length")
    known = ("velocity" in e or (e.time.size > 4 and e["position"].size > 1) for e in experiments)
    if options.target == "force" and all(known):  # or a position to compute it from
        names.append("velocity")
    return (*names, "direction")
