"""Runs the fits of one tool, inside the environment that has the tool.

    python bench/worker.py TOOL

One request per line on standard input, one answer per line on standard output, both JSON.
The first answer tells the tool's name, version and fits. Only the call of the fit is timed:
imports, reading of the request and the check of the answer are not. Whatever a tool prints
goes to standard error.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "tools")]


def main() -> int:
    """Answer requests until standard input ends."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    warnings.filterwarnings("ignore")

    def answer(**content: Any) -> None:
        answers.write(json.dumps(content) + "\n")
        answers.flush()

    try:
        tool = importlib.import_module(sys.argv[1])
        answer(title=tool.TITLE, version=tool.version(), fits=list(tool.FITS))
    except Exception as error:
        answer(error=f"{type(error).__name__}: {error}"[:200])
        return 1
    import numpy as np
    from problems import Log

    for text in sys.stdin:
        request = json.loads(text)
        arrays = [np.array(request[k]) for k in ("t", "u", "y")]
        log, guess = Log(*arrays, request["sample_time"]), request["guess"]
        prepare = getattr(tool, "prepare", None)
        try:
            given = prepare(request["fit"], log) if prepare else log
            began = time.perf_counter()
            theta = tool.FITS[request["fit"]](given, dict(guess))
            seconds = time.perf_counter() - began
            seconds = getattr(theta, "seconds", seconds)  # a tool in a process of its own
            answer(
                theta={k: None if v is None else float(v) for k, v in theta.items()},
                seconds=seconds,
            )
        except Exception as error:
            traceback.print_exc()
            answer(error=f"{type(error).__name__}: {error}"[:200])
    return 0


if __name__ == "__main__":
    sys.exit(main())
