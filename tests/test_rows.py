"""Long records, looked at block by block."""

import numpy as np
import pytest

from fluidact_fit import fit, fitting, rows
from fluidact_fit.demo import load_dataset
from fluidact_fit.errors import LogError
from fluidact_fit.experiment import all_of, is_finite, where_finite

N = 1000


@pytest.mark.parametrize("place", [0, 36, 37, 999])
def test_a_hole_is_seen_wherever_it_is(place, monkeypatch):
    monkeypatch.setattr(rows, "BLOCK_ROWS", 37)
    values = np.random.default_rng(3).standard_normal(N)
    values[place] = np.nan
    assert not is_finite(values)
    assert np.flatnonzero(~where_finite(values)).tolist() == [place]
    assert all_of(values, where_finite(values)).size == N - 1


def test_more_samples_than_a_fit_takes_are_refused(monkeypatch):
    monkeypatch.setattr(fitting, "_MOST_SAMPLES", 100)
    dataset = load_dataset("valve")
    with pytest.raises(LogError, match="100 at most") as refused:
        fit("valve", dataset.read(), **dataset.options)
    assert "window" in str(refused.value)
