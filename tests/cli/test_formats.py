"""Recordings that are no text, on the command line: what ``inspect`` says, and the status."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from scipy.io import savemat

from bags import EPOCH, RIG, Messages, write_bag

Run = Callable[..., Any]
VALVE = Path(__file__).parents[2] / "datasets/valve/trial1.csv"


def bag_of_the_dataset(folder: Path) -> Path:
    """A bag with the log of the dataset, and the pressure of a joint beside it."""
    messages = Messages()
    time, command, outlet = pd.read_csv(VALVE, sep=";", decimal=",").to_numpy().T
    instants = [EPOCH + round(t * 1e9) for t in time]
    rows = [
        ("/valve", RIG, t + 1_000_000, messages.state(t, u, y))
        for t, u, y in zip(instants, command, outlet)
    ]
    return write_bag(folder / "run1", rows, messages)


def test_inspect_names_the_format_and_suggests_a_command_that_runs(
    tmp_path: Path, here: Run
) -> None:
    bag = bag_of_the_dataset(tmp_path)
    done = here("inspect", bag)
    assert done.status == 0
    assert "format: ROS 2 bag (MCAP)\n" in done.out
    assert f"/valve converted: {RIG}, 1000 messages, instants of its header" in done.out
    output = tmp_path / "valve.yaml"
    command = done.out.partition("next:")[2].strip().splitlines()[0]
    assert "--column outlet=/valve/outlet_bar" in command
    words = shlex.split(command)[1:]
    assert here(*words[: words.index("-o")], "-o", output).status == 0
    (log,) = yaml.safe_load(output.read_text())["provenance"]["logs"]
    assert log["details"] == {"format": "ROS 2 bag (MCAP)"}
    assert here("check", output, bag).status == 0


def test_inspect_names_every_other_format(tmp_path: Path, here: Run) -> None:
    t = 0.01 * np.arange(200)
    savemat(tmp_path / "v4.mat", {"time": t, "p": t}, format="4")
    pd.DataFrame({"time": t, "p": t}).to_parquet(tmp_path / "log.parquet")
    channels = [{"name": "time", "unit": "s", "values": t.tolist()},
                {"name": "p", "unit": "bar", "values": t.tolist()}]  # fmt: skip
    (tmp_path / "log.json").write_text(json.dumps(channels))
    for name, told in {"v4.mat": "MATLAB", "log.parquet": "Parquet", "log.json": "JSON"}.items():
        done = here("inspect", tmp_path / name)
        assert done.status == 0
        assert f"format: {told}" in done.out


def test_a_bag_that_is_cut_ends_with_status_3(tmp_path: Path, here: Run) -> None:
    (path,) = bag_of_the_dataset(tmp_path).glob("*.mcap")
    path.write_bytes(path.read_bytes()[:100_000])
    done = here("inspect", path)
    assert done.status == 3
    assert "run1.mcap: the bag cannot be read" in done.err
    assert "mcap recover" in done.err
