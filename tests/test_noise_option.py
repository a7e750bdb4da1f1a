"""``--noise``: what may be given, and that the file remembers it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import fluidact_fit as ff


def log(folder: Path) -> Path:
    rng = np.random.default_rng(7)
    t = 0.01 * np.arange(400)
    u = np.sin(3.0 * t) + np.sin(11.0 * t)
    y = lfilter([0.0, 0.1], [1.0, -0.9], u) + 0.01 * rng.standard_normal(t.size)
    rows = np.column_stack((t, 1e5 * u, 1e5 * y))
    path = folder / "log.csv"
    np.savetxt(path, rows, delimiter=",", header="time [s],inlet [Pa],outlet [Pa]", comments="")
    return path


def test_what_cannot_be_noise_is_refused(tmp_path: Path) -> None:
    path = log(tmp_path)
    with pytest.raises(ff.UsageError, match="not an input"):
        ff.fit("line", path, noise={"outlet": 1.0})
    with pytest.raises(ff.UsageError, match="not negative"):
        ff.fit("line", path, noise={"inlet": -1.0})


def test_the_file_remembers_it(tmp_path: Path) -> None:
    found = ff.fit("line", log(tmp_path), noise={"inlet": 0.0})
    assert found.document.provenance.options == {"noise": {"inlet": 0.0}}
    assert found.document.fit.details["input_noise"]["sigma"] == 0.0
