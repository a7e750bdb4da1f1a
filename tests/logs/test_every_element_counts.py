"""No element of a recording vanishes without a word, whatever the format and its kind."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import pyarrow as pa
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyarrow import parquet
from scipy.io import savemat

from fluidact_fit.logs import Log, describe, read_log
from fluidact_fit_cli.main import run
from recordings import T

KINDS: dict[str, Any] = {
    "vector": 2 * T, "whole": np.arange(200), "bytes": np.arange(200, dtype="u1"), "truth": T > 1,
    "complex": T + 1j, "table": np.ones((200, 3)), "across": np.ones((3, 200)), "one": np.ones(1),
    "cube": np.ones((200, 2, 3)), "short": T[:7], "long": np.arange(900.0), "scalar": 5.0,
    "none": np.zeros(0), "time": T,
}  # fmt: skip
TEXT = np.array(["a"] * 200)


def matlab(path: Path, elements: dict[str, Any]) -> None:
    savemat(path, {k: TEXT if v is TEXT else v for k, v in elements.items()})


def structures(path: Path, elements: dict[str, Any]) -> None:
    half = len(elements) // 2
    items = list(elements.items())
    savemat(path, {"a": dict(items[:half]), "b": {"c": dict(items[half:])}, "vector_0": T})


def hdf5(path: Path, elements: dict[str, Any]) -> None:
    with h5py.File(path, "w") as file:
        for k, (name, values) in enumerate(elements.items()):
            place = file if k % 2 else file.require_group("rig")
            place[name] = values.astype("S") if values is TEXT else values


def tdms(path: Path, elements: dict[str, Any]) -> None:
    flat = {k: np.atleast_1d(v) for k, v in elements.items() if np.ndim(v) < 2}
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment([nptdms.ChannelObject("g", k, v) for k, v in flat.items()])


def columnar(path: Path, elements: dict[str, Any]) -> None:
    flat = {k: v for k, v in elements.items() if np.shape(v) == (200,) and np.isrealobj(v)}
    parquet.write_table(pa.table({**flat, "list": [[1]] * 200, "always": T}), path)


WRITERS: dict[str, Callable[[Path, dict[str, Any]], None]] = {
    "a.mat": matlab, "b.mat": structures, "c.h5": hdf5, "d.tdms": tdms, "e.parquet": columnar,
}  # fmt: skip


def is_named(name: str, log: Log) -> bool:
    """Whether an element is a column, its columns are, or it is in the account."""
    names = [c.header for c in log.columns] + [e.name for e in log.account.elements]
    last = [n.rsplit(".", 1)[-1] for n in names]
    return name in last or any(n.rstrip("0123456789") == name for n in last)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    writer=st.sampled_from(sorted(WRITERS)),
    kinds=st.lists(st.sampled_from([*sorted(KINDS), "text"]), min_size=1, max_size=9),
)
def test_every_element_is_read_converted_or_named(
    tmp_path_factory: pytest.TempPathFactory, writer: str, kinds: list[str]
) -> None:
    elements = {f"{kind}_{'abcdefghi'[k]}": KINDS.get(kind, TEXT) for k, kind in enumerate(kinds)}
    elements["always"] = T
    path = tmp_path_factory.mktemp("logs") / writer
    WRITERS[writer](path, elements)
    log = read_log(path)
    for name, values in elements.items():
        written = writer not in ("d.tdms", "e.parquet") or np.ndim(values) < 2
        written &= writer != "e.parquet" or (np.shape(values) == (200,) and np.isrealobj(values))
        if written:
            assert is_named(name, log), (name, log.account.elements, log.columns)
    for element in log.account.elements:
        assert element.fate in ("read", "converted", "left out")
        assert bool(element.how) is (element.fate != "read")


def test_inspect_shows_the_account(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "log.mat"
    savemat(path, {"t": T, "data": np.ones((200, 2)), "z": T + 1j, "who": "me"})
    assert run(["inspect", str(path)]) == 0
    said = capsys.readouterr().out
    assert "3 read, 1 converted, 2 left out\n" in said
    assert "  data converted: 2 columns to channels\n" in said
    assert "  z left out: complex numbers\n" in said
    assert "  who left out: text\n" in said
    assert run(["inspect", str(path), "--json"]) == 0
    elements = json.loads(capsys.readouterr().out)["elements"]
    assert {"name": "z", "fate": "left out", "how": "complex numbers"} in elements
    assert elements == describe(read_log(path))["elements"]
