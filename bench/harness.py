"""Runs all tools side by side: one process per tool, trials interleaved, one fit at a time."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from environments import python_of
from problems import WARM_UP, Problem, Trial, bound, make_trial

HERE = Path(__file__).parent


class Worker:
    """A tool in its own environment; started when first asked, and again when it died."""

    def __init__(self, tool: str, directory: Path, log: Path) -> None:
        self.tool, self._log = tool, log
        self._python = python_of(tool, directory)
        self._process: subprocess.Popen[str] | None = None
        self._answers: queue.Queue[str] = queue.Queue()
        self.hello = self._start()

    def _start(self) -> dict[str, Any]:
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        with self._log.open("a", encoding="utf-8") as errors:
            self._process = subprocess.Popen(
                [self._python, str(HERE / "worker.py"), self.tool],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                env={**os.environ, **threads, "PYTHONDONTWRITEBYTECODE": "1"},
            )
        self._answers = queue.Queue()
        threading.Thread(
            target=self._listen, args=(self._process, self._answers), daemon=True
        ).start()
        return self._answer(300.0)

    @staticmethod
    def _listen(process: subprocess.Popen[str], answers: queue.Queue[str]) -> None:
        assert process.stdout is not None
        for text in process.stdout:
            answers.put(text)
        answers.put("")

    def _answer(self, limit: float) -> dict[str, Any]:
        try:
            text = self._answers.get(timeout=limit)
        except queue.Empty:
            self.stop()
            return {"error": f"no answer within {limit:g} s"}
        if not text:
            self.stop()
            return {"error": "the process of the tool died"}
        answer: dict[str, Any] = json.loads(text)
        return answer

    def fit(
        self, name: str, trial: Trial, guess: Mapping[str, float], limit: float
    ) -> dict[str, Any]:
        """Let the tool fit one trial; returns ``theta`` and ``seconds``, or ``error``."""
        if self._process is None:
            self._start()
        assert self._process is not None
        assert self._process.stdin is not None
        log = trial.log
        request = {
            "fit": name, "t": log.t.tolist(), "u": log.u.tolist(), "y": log.y.tolist(),
            "sample_time": log.sample_time, "guess": dict(guess),
        }  # fmt: skip
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        return self._answer(limit)

    def stop(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


@dataclass
class Row:
    """What one fit of one tool did: a row of a table.

    ``trials`` holds per trial: its number, errors of the parameters [SI], their bounds
    [SI], seconds; or the reason it failed.
    """

    problem: str
    tool: str
    title: str
    fit: str
    trials: list[dict[str, Any]] = field(default_factory=list)


def start(tools: Sequence[str], directory: Path) -> tuple[list[Worker], dict[str, str]]:
    """Start the tools that can be started; the others by name with the reason."""
    workers, missing = [], {}
    for tool in tools:
        try:
            worker = Worker(tool, directory, directory / "tools.log")
        except (RuntimeError, OSError) as error:
            missing[tool] = str(error)
            continue
        if "error" in worker.hello:
            missing[tool] = worker.hello["error"]
            worker.stop()
        else:
            workers.append(worker)
    return workers, missing


def run(
    problems: Mapping[str, Problem],
    workers: Sequence[Worker],
    trials: int,
    limit: float,
    left_out: Collection[tuple[str, str]] = (),
) -> list[Row]:
    """Let every tool fit every problem.

    The first log of a problem is fitted once and not counted, so that nobody pays for what
    is loaded or compiled at the first call only. A fit that took longer than 5 s gets three
    trials, longer than 20 s one. ``left_out`` are tools with the fits they shall not do.
    """
    rows = []
    for name, problem in problems.items():
        some = [
            (w, Row(name, w.tool, w.hello["title"], fit))
            for w in workers
            for fit in w.hello["fits"]
            if fit.split("|")[0] == name and (w.tool, fit) not in left_out
        ]
        warm = make_trial(problem, WARM_UP)
        counts = []
        for worker, row in some:
            took = worker.fit(row.fit, warm, problem.guess, limit).get("seconds", limit)
            _say(f"{name} warm-up {row.tool} {row.fit} {took:.2f} s")
            counts.append(trials if took < 5.0 else min(trials, 3) if took < 20.0 else 1)
        for number in range(trials):
            trial = make_trial(problem, number)
            sizes = bound(problem, trial)
            order = [*range(number % len(some), len(some)), *range(number % len(some))]
            for k in order:
                worker, row = some[k]
                if number < counts[k]:
                    answer = worker.fit(row.fit, trial, problem.guess, limit)
                    row.trials.append({"trial": number, **_judge(problem, sizes, answer)})
            _say(f"{name} trial {number} done")
        rows += [row for _, row in some]
    return rows


def _judge(
    problem: Problem, sizes: Mapping[str, float], answer: Mapping[str, Any]
) -> dict[str, Any]:
    if "error" in answer:
        return {"error": answer["error"]}
    theta = answer["theta"]
    return {
        "seconds": answer["seconds"],
        "errors": {
            k: None if theta.get(k) is None else theta[k] - v for k, v in problem.truth.items()
        },
        "bounds": dict(sizes),
        "scales": {k: problem.scale(k) for k in problem.truth},
    }


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()
