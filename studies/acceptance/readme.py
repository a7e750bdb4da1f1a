"""The fits of the datasets' READMEs, each checked on its own logs."""

from __future__ import annotations

import re
import shlex
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fluidact_fit import family_names

from .command import ROOT, execute, fit
from .figures import Figure, codes, number, parameter, quantity, rmse, words
from .task import Task

GROUP = "readme"
_NETWORK = 0.3  # of the rmse of a network, whose seeds end between 0.0199 and 0.0252 V


@cache
def commands() -> dict[str, list[str]]:
    """The fits by family, without what they write."""
    found = {}
    for name in family_names():
        page = (ROOT / "datasets" / name / "README.md").read_text(encoding="utf-8")
        (block,) = re.findall(r"```sh\nfluidact-fit (.*?)```", page, re.DOTALL)
        given = shlex.split(block.replace("\\\n", " "))
        at = given.index("-o")
        found[name] = given[:at] + given[at + 2 :]
    return found


def logs(given: list[str]) -> list[str]:
    """The logs of a command."""
    return [word for word in given if word.startswith("datasets/")]


def tasks() -> list[Task]:
    """One task per fit."""
    cost = {"ball-screw": 30.0, "force-map": 20.0}
    return [
        Task(GROUP, family, cost.get(family, 5.0), partial(_family, family, given))
        for family, given in commands().items()
    ]


def _family(family: str, given: list[str], folder: Path) -> list[Figure]:
    path = folder / f"readme-{family}.yaml"
    run = fit(given, path)
    out = [
        words(GROUP, f"{family}: end", "exit status and verdict", run.outcome, "exit 0, pass"),
        words(GROUP, f"{family}: warnings", "codes", codes(run.file, run.word)),
        number(GROUP, f"{family}: rmse", "rmse of all logs [SI]", "-",
               rmse(run.file, run.word), "low", share=_NETWORK if _is_network(run.file) else 1e-3),
        *_parameters(family, run.file, run.word),
    ]  # fmt: skip
    if run.file is None:
        seen = f"no file ({run.word})"
    else:
        seen = execute(["check", str(path), *logs(given)]).word
    out.append(words(GROUP, f"{family}: check", "`check` of the same logs", seen, "exit 0"))
    return out


def _is_network(file: dict[str, Any] | None) -> bool:
    """Return whether nothing in a file has a standard error, as in a trained network."""
    return file is not None and "covariance" not in file


def _parameters(family: str, file: dict[str, Any] | None, missing: str) -> list[Figure]:
    """Every scalar parameter with a truth; of a calibration, its curve."""
    truth = yaml.safe_load((ROOT / "datasets" / family / "truth.yaml").read_text("utf-8"))
    if "curve" in truth:
        limit = float(truth["curve"]["tolerance"])
        seen = missing if file is None else _curve_distance(truth["parameters"], file)
        row = f"{family}: curve"
        what = "largest distance from the true curve [m]"
        return [number(GROUP, row, what, f"at most {limit:g}", seen, "low",
                       share=0.02, limit=limit)]  # fmt: skip
    return [
        parameter(GROUP, f"{family}: {name}", file, name, missing, truth=float(entry["value"]))
        for name, entry in truth["parameters"].items()
    ]


def _curve_distance(truth: dict[str, Any], file: dict[str, Any]) -> float:
    low, high = (float(v) for v in quantity(file, "reading_range")["value"])
    x = np.linspace(low, high, 2001)
    difference = _rational_bezier(truth, x) - _rational_bezier(file["parameters"], x)
    return float(np.abs(difference).max())


def _rational_bezier(values: dict[str, Any], x: np.ndarray) -> np.ndarray:
    """de Casteljau in homogeneous coordinates."""
    low, high = (float(v) for v in values["reading_range"]["value"])
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    weights = np.array(values["weights"]["value"], dtype=float)
    points = np.array(values["control_points"]["value"], dtype=float)
    levels = np.stack([weights * points, weights])[:, :, None] * np.ones_like(t)
    while levels.shape[1] > 1:
        levels = levels[:, :-1] * (1.0 - t) + levels[:, 1:] * t
    return np.asarray(levels[0, 0] / levels[1, 0])
