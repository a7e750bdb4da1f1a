"""Read a table back and compare it with what was written."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import fluidact_fit as ff
from fluidact_fit.errors import FluidactError
from fluidact_fit.family import Role, Variant
from fluidact_fit.logs import experiments

from .text import Written
from .truth import Truth

RIGHT, REFUSED, DOUBTED, SILENT = "right", "refused", "doubt refused", "silently different"


@dataclass
class Outcome:
    """What became of a table: one of the words above, and what was said or is different."""

    word: str
    text: str = ""

    @property
    def kind(self) -> str:
        """The message without its numbers and names."""
        text = self.text.splitlines()[0] if self.text else ""
        return re.sub(r"'[^']*'", "'…'", re.sub(r"[0-9]+", "9", text))[:110]


def judge(truth: Truth, written: Written, path: Path) -> Outcome:
    """Read a file as a fit does, and compare values in SI and the time base."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return _compare(truth, *_read(truth, written, path))
        except FluidactError as error:
            return Outcome(REFUSED if truth.readable else DOUBTED, str(error))


def _read(truth: Truth, written: Written, path: Path) -> tuple[np.ndarray, list[np.ndarray]]:
    time = {"time": written.time} if written.time else {}
    log = ff.read_log(path, columns=time, sample_time=written.sample_time)
    before = len(log.columns) - len(truth.channels)
    columns = {f"c{k}": f"#{before + k}" for k in range(1, len(truth.channels) + 1)}
    log = replace(log, bindings={**log.bindings, **columns})
    roles = [Role(f"c{k}", c.si, "", output=k == 1) for k, c in enumerate(truth.channels, start=1)]
    variant = Variant("any", (Role("time", "s", ""), *roles), ())
    found, _ = experiments(log, variant)
    instants = np.concatenate([e.time for e in found])
    return instants, [np.concatenate([e[r.name] for e in found]) for r in roles]


def _compare(truth: Truth, time: np.ndarray, values: list[np.ndarray]) -> Outcome:
    wanted = np.array(truth.times)
    if time.size != wanted.size:
        return Outcome(SILENT, f"{time.size} instants of {wanted.size}")
    if not np.allclose(time - time[0], wanted, rtol=0.0, atol=2e-3 * truth.step):
        worst = float(np.abs(time - time[0] - wanted).max())
        return Outcome(SILENT, f"instants off by {worst / truth.step:.3g} steps")
    for c, read in zip(truth.channels, values):
        if c.size is None:
            return Outcome(SILENT, f"{c.quantity} in {c.unit!r} was read")
        if not np.allclose(read, c.size * np.array(c.values), rtol=1e-9, atol=1e-12 * c.size):
            return Outcome(SILENT, f"{c.quantity} in {c.unit!r}: {read[:2]} is "
                           f"{[c.size * v for v in c.values[:2]]}")  # fmt: skip
    return Outcome(RIGHT)
