"""What every sample does to a fit, against leaving it out."""

import numpy as np
import pytest

from fluidact_fit import rows
from fluidact_fit.assessment.influence import measure_influence


@pytest.mark.parametrize("block", [1 << 15, 41])
@pytest.mark.parametrize("place", [0, 40, 41, 299, 499])
def test_every_sample_is_looked_at(block, place, monkeypatch):
    monkeypatch.setattr(rows, "BLOCK_ROWS", block)
    rng = np.random.default_rng(4)
    j = rng.standard_normal((500, 3)) * [1.0, 1e4, 1e-3]
    noise = rng.standard_normal(500)
    noise[place] += 30.0
    j[(place + 7) % 500] *= 5.0
    known = np.sqrt(np.diag(np.linalg.inv(j.T @ j)))
    r = noise - j @ np.linalg.lstsq(j, noise, rcond=None)[0]
    found = measure_influence([j[:300], j[300:]], [r[:300], r[300:]], known)
    shifts = []
    for k in range(500):
        others = np.arange(500) != k
        shifts.append(-np.linalg.lstsq(j[others], r[others], rcond=None)[0] / known)
    size = np.abs(shifts)
    assert found.largest_influence == pytest.approx(size.max(), rel=1e-9)
    hat = np.einsum("ij,jk,ik->i", j, np.linalg.inv(j.T @ j), j)
    assert found.largest_leverage == pytest.approx(hat.max(), rel=1e-9)
    outlying = [300 * e.series + e.row for e in found.effects if e.outlying]
    assert outlying == [place]
    (effect,) = (e for e in found.effects if e.outlying)
    assert effect.standard_errors == pytest.approx(shifts[place][effect.parameter], rel=1e-9)
    assert [x.size for x in found.odd] == [int(place < 300), int(place >= 300)]
    assert np.concatenate((found.odd[0], 300 + found.odd[1])).tolist() == [place]


def test_many_odd_samples_do_not_hide_one_another():
    rng = np.random.default_rng(1)
    j, r = rng.standard_normal((400, 2)), rng.standard_normal(400)
    r[::8] += 200.0  # their size by squares is far above that by the median
    found = measure_influence([j], [r], np.array([0.05, 0.05]))
    assert set(np.arange(0, 400, 8)) <= set(found.odd[0])
