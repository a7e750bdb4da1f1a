"""Binary recordings for tests: what is read of a file, and what became of the rest."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fluidact_fit.logs import Log, read_log

T = 0.01 * np.arange(200)


def columns(log: Log) -> dict[str, np.ndarray]:
    """Values of a log by header, without those at which a column was not sampled."""
    return {
        c.header: c.values[np.isfinite(c.values)] if c.sparse else c.values for c in log.columns
    }


def fates(log: Log) -> dict[str, str]:
    """What became of every element that was not simply read."""
    return {e.name: e.how for e in log.account.elements if e.fate != "read"}


def read_hdf5(folder: Path, fill: Callable[[h5py.File], object], **how: Any) -> Log:
    """Write an HDF5 file, and read it."""
    path = folder / "log.h5"
    with h5py.File(path, "w", **how) as file:
        fill(file)
    return read_log(path)


def put(file: h5py.Group, name: str, values: Any, attributes: Mapping[str, Any]) -> None:
    """Write a dataset with attributes."""
    dataset = file.create_dataset(name, data=values)
    for key, value in attributes.items():
        dataset.attrs[key] = value
