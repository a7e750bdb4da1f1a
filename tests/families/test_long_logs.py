"""Every family on its dataset as if it were 10^8 rows long: with nothing kept that can be made."""

import numpy as np
import pytest

from fluidact_fit import fit, rows
from fluidact_fit.demo import load_dataset
from fluidact_fit.families import family_names

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", family_names())
def test_the_same_is_found_with_nothing_kept(name, monkeypatch):
    dataset = load_dataset(name)
    kept = fit(name, dataset.read(), **dataset.options)
    monkeypatch.setattr(rows, "LONG", 150)
    monkeypatch.setattr(rows, "BLOCK_ROWS", 64)
    monkeypatch.setattr(rows, "MOST_KEPT", 0)
    monkeypatch.setattr(rows, "FEW_KEPT", 0)
    made = fit(name, dataset.read(), **dataset.options)
    assert made.verdict == kept.verdict
    assert [n.code for n in made.notices] == [n.code for n in kept.notices]
    for parameter, q in kept.parameters.items():
        other = made.parameters[parameter]
        assert other.status == q.status
        if q.value is not None and not isinstance(q.value, str):
            np.testing.assert_allclose(other.value, q.value, rtol=1e-9, err_msg=parameter)
        if q.status == "estimated" and q.std_error is not None:
            np.testing.assert_allclose(other.std_error, q.std_error, 1e-7, err_msg=parameter)
