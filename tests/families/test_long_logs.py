"""Every family on its dataset as if it were long: in many blocks of rows."""

import numpy as np
import pytest

from fluidact_fit import fit, rows
from fluidact_fit.demo import load_dataset
from fluidact_fit.families import family_names

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", family_names())
def test_the_same_is_found_in_many_blocks(name, monkeypatch):
    dataset = load_dataset(name)
    whole = fit(name, dataset.read(), **dataset.options)
    monkeypatch.setattr(rows, "BLOCK_ROWS", 64)
    cut = fit(name, dataset.read(), **dataset.options)
    assert cut.verdict == whole.verdict
    assert [n.code for n in cut.notices] == [n.code for n in whole.notices]
    for parameter, q in whole.parameters.items():
        other = cut.parameters[parameter]
        assert other.status == q.status
        # sums in another order may round the last digit of a file, four beyond the error, otherwise
        last = 2e-4 * np.asarray(q.std_error) if q.status == "estimated" and q.std_error else 0.0
        if q.value is not None and not isinstance(q.value, str):
            off = np.abs(np.subtract(other.value, q.value))
            assert np.all(off <= 1e-9 * np.abs(q.value) + last), parameter
        if q.status == "estimated" and q.std_error is not None:
            np.testing.assert_allclose(other.std_error, q.std_error, 1e-7, err_msg=parameter)
