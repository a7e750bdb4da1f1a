"""One attack: recorded, fitted through the public interface, compared with the truth."""

from __future__ import annotations

import signal
import time
import zlib
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any

import numpy as np

from .attack import Attack, Error, Recording, Result

SEED = 20_261_122
LIMIT = 120  # s of processor time after which a fit counts as endless


class _TooLong(Exception):
    """The limit of processor time was reached."""


def run(attack: Attack, repetition: int = 0, seed: int = SEED) -> Result:
    """Record and fit an attack once; every repetition has random numbers of its own."""
    key = zlib.crc32(f"{attack.family} {attack.group} {attack.name}".encode())
    rng = np.random.default_rng([seed, key, repetition])
    if attack.another is not None:
        attack = attack.another(rng)
    with TemporaryDirectory(prefix="red-team-") as name:
        paths = [
            write(Path(name) / f"log{k}.csv", recording, attack.units)
            for k, recording in enumerate(attack.record(rng), start=1)
        ]
        return _fit(attack, paths)


def write(path: str | Path, recording: Recording, units: Mapping[str, str]) -> Path:
    """Write a log as a table with units in its header."""
    units = {"time": "s", **units}
    header = ",".join(f"{role} [{units[role]}]" for role in recording)
    rows = np.column_stack(list(recording.values()))
    np.savetxt(path, rows, fmt="%.12g", delimiter=",", header=header, comments="")
    return Path(path)


def _fit(attack: Attack, paths: list[Path]) -> Result:
    import fluidact_fit as ff

    def stop(number: int, frame: FrameType | None) -> None:
        raise _TooLong

    def end(verdict: str, **more: Any) -> Result:
        seconds = time.process_time() - began
        about = attack.family, attack.group, attack.name
        return Result(*about, verdict, seconds=seconds, beyond=attack.beyond, **more)

    signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, LIMIT)
    began = time.process_time()
    try:
        found = ff.fit(attack.family, paths, hold=attack.hold, fixed=attack.fixed, **attack.options)
    except (ff.NotIdentifiedError, ff.LogError, ff.UsageError) as error:
        return end("refused", message=str(error), wrongly_refused=tuple(sorted(attack.determined)))
    except _TooLong:
        return end("endless")
    except Exception as error:  # a crash is what is looked for
        return end("crash", message=f"{type(error).__name__}: {error}")
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    errors = {}
    for parameter, truth in attack.truth.items():
        name, _, index = parameter.partition("[")
        q = found.parameters.get(name)
        if q is None or q.status != "estimated":
            continue
        k = int(index.rstrip("]") or 0)
        value, error = float(np.ravel(q.value)[k]), float(np.ravel(q.std_error)[k])
        ends = np.reshape(q.ci95, (-1, 2))[k].tolist()
        errors[parameter] = Error.of(value, truth, error, ends, attack.scale(parameter))
    if attack.judge is not None:
        errors.update(attack.judge(found))
    refused = tuple(n for n, q in found.parameters.items() if q.status == "not_identified")
    return end(
        str(found.verdict),
        codes=tuple(dict.fromkeys(n.code for n in found.notices)),
        errors=errors,
        not_identified=refused,
        wrongly_refused=tuple(sorted(attack.determined & set(refused))) if refused else (),
    )
